"""Round trip of every code of every 16-bit field of ABH3 drivers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.signals import V1, V2, Dialect, FrameLayout, SignalField
from support.abh3_frames import FRAMES, QUANTITIES, TENTHS


def _distinct() -> Iterator[Any]:
    """Each frame with 16-bit fields, in each dialect and load unit, unless it was there already."""
    seen: list[FrameLayout] = []
    for dialect in (V1, V2, TENTHS["v1"]):
        for name, layout in dialect.layouts.items():
            if layout not in seen and any(field.code in "hH" for field in layout.fields):
                seen.append(layout)
                unit = " 0.1 %" if dialect is TENTHS["v1"] else ""
                yield pytest.param(dialect, name, 0, id=f"{dialect.name} {name}{unit}")
    for dialect in (V1, V2):
        mask = dialect.inputs.mask("torque")
        yield pytest.param(dialect, "DP0S", mask, id=f"{dialect.name} DP0S torque")


def _steps(field: SignalField, dialect: Dialect, inputs: int) -> int:
    if field.torque_input and inputs:
        return 100
    if field.name.endswith("_load"):
        return 10 if dialect is TENTHS["v1"] else 1
    return QUANTITIES[field.name][1]


@pytest.mark.parametrize("step", [9, pytest.param(1, marks=pytest.mark.soak)])
@pytest.mark.parametrize(("dialect", "name", "inputs"), list(_distinct()))
def test_codes_of_16_bits_survive(dialect: Dialect, name: str, inputs: int, step: int) -> None:
    """Every ninth (``make soak``: each) of the 65,536 codes, each field with other ones than its neighbours."""
    codec = Codec(dialect)
    fields = FRAMES[dialect.name][name][3]
    table = [
        (place, field, 0x8000 if code == "h" else 0, _steps(dialect.layouts[name].fields[place], dialect, inputs))
        for place, (field, _, _, size, code) in enumerate(fields)
        if size == 2
    ]
    pack = struct.Struct("<" + "H" * len(table) + "I" * (len(table) == 2)).pack
    rest = (inputs,) if len(table) == 2 else ()
    for number in range(0, 0x10000, step):
        unsigned = [(number * (2 * place + 1) + 0x1234 * place) & 0xFFFF for place, *_ in table]
        data = pack(*unsigned, *rest)
        record = codec.decode(name, data)
        for code, (_, field, sign, steps) in zip(unsigned, table, strict=True):
            signed = code - 0x10000 if code & sign else code
            if getattr(record, field) != signed / steps or record.raw_values[field] != signed:
                pytest.fail(f"{field}: {signed} becomes {record}")
        if codec.encode(record) != data:
            pytest.fail(f"{record} becomes {codec.encode(record).hex()}")
