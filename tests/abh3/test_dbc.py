"""The DBC file decodes every frame as the codec does."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table import ids
from orinkit.abh3.table.dbc import dbc
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import Flags
from orinkit.abh3.table.signals import DIALECTS, V1, FrameLayout, SignalField
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core

cantools = pytest.importorskip("cantools")

CASES = [(name, unit) for name in DIALECTS for unit in (1.0, 0.1)]
DATABASES = {case: cantools.database.load_string(dbc(case[0], load_unit=case[1]), "dbc", strict=True) for case in CASES}
EXTENDED = 0x80000000


def number_of(layout: FrameLayout, address: int = 1, host: int = 2, group: int = 5) -> int:
    if layout.broadcast is not None:
        return ids.broadcast(group, layout.broadcast, address)
    to, source = (address, host) if layout.from_host else (host, address)
    return ids.single(to, source, dp=layout.dp)


def ours(layout: FrameLayout, dialect: str, unit: float, data: bytes) -> dict[str, float]:
    """Return what the codec decodes from a frame, with the names of the DBC file."""
    record = Codec(DIALECTS[dialect].with_load_unit(unit)).decode(layout.name, data)
    found: dict[str, float] = {}
    for field in layout.fields:
        value: Any = getattr(record, field.name)
        if isinstance(value, Flags):
            found |= {f"{field.name}_{bit.name}": int(value[bit.number]) for bit in value.word.bits}
        else:
            is_torque = field.torque_input and layout.name == "DP0S" and record.inputs[field.torque_input]
            found[field.name + ("_torque" if is_torque else "")] = value
    return found


def same(one: dict[str, float], other: dict[str, float]) -> bool:
    return one.keys() == other.keys() and all(
        (math.isnan(value) and math.isnan(other[name])) or math.isclose(value, other[name], rel_tol=1e-12)
        for name, value in one.items()
    )


@pytest.mark.parametrize(("dialect", "unit"), CASES)
@given(data=st.binary(min_size=8, max_size=8))
def test_every_frame_decodes_as_by_the_codec(dialect, unit, data):
    for layout in DIALECTS[dialect].layouts.values():
        theirs = DATABASES[dialect, unit].decode_message(number_of(layout), data, decode_choices=False)
        assert same(ours(layout, dialect, unit, data), theirs), layout.name


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_bit_alone(dialect):
    for layout in DIALECTS[dialect].layouts.values():
        for field, start in layout.starts:
            for number in range(32 if field.word else 0):
                data = (1 << start + number).to_bytes(8, "little")
                theirs = DATABASES[dialect, 1.0].decode_message(number_of(layout), data)
                on = [name for name, value in theirs.items() if value == "on"]
                bit = field.word.by_number.get(number)
                assert on == ([f"{field.name}_{bit.name}"] if bit else [])


@pytest.mark.parametrize("dialect", DIALECTS)
@given(data=st.binary(min_size=8, max_size=8).filter(lambda data: b"\xff" not in data))
def test_every_frame_encodes_as_by_the_codec(dialect, data):
    """Except for undefined bits."""
    for layout in DIALECTS[dialect].layouts.values():
        message = DATABASES[dialect, 1.0].get_message_by_frame_id(number_of(layout), force_extended_id=True)
        values = message.decode(data, decode_choices=False)
        if any(isinstance(value, float) and not math.isfinite(value) for value in values.values()):
            continue
        again = message.encode(values, strict=False)
        assert same(ours(layout, dialect, 1.0, data), ours(layout, dialect, 1.0, again)), layout.name


@pytest.mark.parametrize("dialect", DIALECTS)
def test_identifiers_and_senders(dialect):
    found = {message.name: message for message in DATABASES[dialect, 1.0].messages}
    assert {name: message.frame_id for name, message in found.items()} == {
        "DP0S": 0x00EF0102, "DP0R": 0x00EF0201, "DP1S": 0x01EF0102, "DP1R": 0x01EF0201,
        **{f"BR{n}": 0x00FF2801 + 0x100 * n for n in range(7)},
        "REQUEST": 0x00EA0102, "REQUEST_ALL": 0x00EAFF02,
        "TP_CM_S": 0x00EC0102, "TP_CM_R": 0x00EC0201, "TP_DT_S": 0x00EB0102, "TP_DT_R": 0x00EB0201,
    }  # fmt: skip
    assert all(message.is_extended_frame for message in found.values())
    assert {name: message.length for name, message in found.items() if message.length != 8} == {
        "DP1S": 0,
        "REQUEST": 3,
        "REQUEST_ALL": 3,
    }
    assert (found["DP0S"].senders, found["DP0R"].senders, found["BR3"].senders) == (["HOST"], ["ABH3"], ["ABH3"])
    assert "withholds" in found["DP1R"].comment
    assert "withholds" not in found["DP0R"].comment


@pytest.mark.parametrize(("dialect", "unit"), CASES)
def test_units_ranges_and_types(dialect, unit):
    database = DATABASES[dialect, unit]
    for layout in DIALECTS[dialect].with_load_unit(unit).layouts.values():
        signals = {signal.name: signal for signal in database.get_message_by_name(layout.name).signals}
        for field, start in layout.starts:
            quantity = field.quantity
            if quantity is None:
                continue
            signal = signals[field.name]
            assert (signal.start, signal.unit or "", signal.comment.startswith(field.title[:1].upper())) == (
                start,
                quantity.unit,
                True,
            )
            if quantity.steps:
                assert signal.conversion.scale == pytest.approx(1 / quantity.steps)
                assert signal.minimum == pytest.approx(quantity.low / quantity.steps)
                assert signal.maximum == pytest.approx(quantity.high / quantity.steps)
            assert signal.conversion.is_float == (quantity.steps == 0)


def test_requests_and_multi_packet_frames():
    database = DATABASES["v1", 1.0]
    assert database.decode_message(0x00EAFF02, bytes.fromhex("28ff00")) == {"pgn": "BR0"}
    assert database.decode_message(0x00EA0102, bytes.fromhex("00ef00")) == {"pgn": "DP0R"}
    assert database.decode_message(0x00EA0102, bytes.fromhex("00ef01")) == {"pgn": "DP1R"}
    for text, said in (
        ("1012000303 00ef00", {"control": "RTS", "size": 18, "packets": 3, "most_at_once": 3}),
        ("110301ffff 00ef00", {"control": "CTS", "allowed": 3, "next": 1}),
        ("13120003ff 00ef00", {"control": "EndOfMsgACK", "size": 18, "packets": 3}),
        ("ff03ffffff 00ef00", {"control": "Abort", "reason": "time-out"}),
    ):
        for number in (0x00EC0102, 0x00EC0201):
            assert database.decode_message(number, bytes.fromhex(text)) == {**said, "pgn": 0xEF00}
    packet = database.decode_message(0x00EB0201, bytes(range(1, 9)))
    assert packet == {"number": 1, **{f"data_{n}": n + 1 for n in range(1, 8)}}


def test_several_drivers():
    database = cantools.database.load_string(dbc("v2", addresses=(1, 3, 200), host=10, group=31), "dbc")
    names = {message.name for message in database.messages}
    assert {"DP0R_1", "DP0R_3", "BR6_200", "REQUEST_3", "TP_CM_S_200", "REQUEST_ALL"} <= names
    assert "DP0R" not in names
    assert database.get_message_by_name("DP0S_3").frame_id == 0x00EF030A
    assert database.get_message_by_name("BR6_200").frame_id == 0x00FFFEC8
    assert database.get_message_by_name("BR6_200").senders == ["ABH3_200"]
    assert [node.name for node in database.nodes] == ["HOST", "ABH3_1", "ABH3_3", "ABH3_200"]


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_it_is_plain_text_in_any_language(lang, tmp_path):
    i18n.use(lang)
    text = dbc()
    assert text.isascii()
    assert "\r" not in text
    path = tmp_path / "abh3.dbc"
    path.write_text(text, encoding="utf-8")
    assert len(cantools.database.load_file(path).messages) == len(DATABASES["v1", 1.0].messages)


def test_names_do_not_exceed_the_limit_of_dbc_files():
    for database in DATABASES.values():
        assert all(len(signal.name) <= 32 for message in database.messages for signal in message.signals)


@pytest.mark.parametrize(
    "options",
    [
        {"dialect": "v3"},
        {"addresses": ()},
        {"addresses": (1, 1)},
        {"addresses": (2,)},
        {"addresses": (254,)},
        {"host": -1},
        {"group": 32},
        {"load_unit": 0.5},
    ],
)
@pytest.mark.parametrize("lang", ["en", "ja"])
def test_invalid_arguments(options, lang):
    i18n.use(lang)
    with pytest.raises(InvalidValue):
        dbc(**options)


def test_an_unused_field_has_no_signal():
    """A user-defined dialect may have unused bytes."""
    spare = replace(V1.layouts["BR4"], fields=(SignalField("spare", "spare", "I"), V1.layouts["BR4"].fields[1]))
    database = cantools.database.load_string(dbc(replace(V1, layouts={**V1.layouts, "BR4": spare})), "dbc", strict=True)
    (signal,) = database.get_message_by_name("BR4").signals
    assert (signal.name, signal.start) == (spare.fields[1].name, 32)
