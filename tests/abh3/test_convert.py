"""The conversion functions of the document, section 4.9."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table.convert import (
    cnvCAN2Analog,
    cnvCAN2Cur,
    cnvCAN2Load,
    cnvCAN2Vel,
    cnvCAN2Volt,
    cnvCur2CAN,
    cnvVel2CAN,
    flt_to_pkflt,
    pkflt_to_flt,
    pkflt_to_str,
    str_to_pkflt,
)
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core

ROUND_TRIPS = [(cnvVel2CAN, cnvCAN2Vel, 5), (cnvCur2CAN, cnvCAN2Cur, 100)]


@pytest.mark.parametrize(("to_can", "from_can", "steps"), ROUND_TRIPS)
def test_every_code_survives(to_can: Callable[[float], int], from_can: Callable[[int], float], steps: int) -> None:
    for code in range(-0x8000, 0x8000):
        value = from_can(code)
        assert value == float(Fraction(code, steps))
        assert to_can(value) == code


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (6553.4, 32767),
        (-6553.6, -32768),
        (0.1, 1),
        (-0.1, -1),
        (0.0999, 0),
        (6553.49, 32767),
        (-6553.69, -32768),
        (0, 0),
    ],
)
def test_velocities(value: float, code: int) -> None:
    assert cnvVel2CAN(value) == code


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (327.67, 32767),
        (-327.68, -32768),
        (0.29, 29),
        (0.57, 57),
        (0.005, 1),
        (-0.005, -1),
        (0.0049, 0),
        (327.674, 32767),
    ],
)
def test_currents(value: float, code: int) -> None:
    assert cnvCur2CAN(value) == code


@pytest.mark.parametrize("value", [6553.5, -6553.7, 7000, -7000, math.inf, -math.inf, math.nan, 1e308, 10**400])
def test_velocities_without_a_code(value: float) -> None:
    with pytest.raises(InvalidValue) as caught:
        cnvVel2CAN(value)
    for part in ("velocity", "-6553.6", "6553.4", "min^-1"):
        assert part in str(caught.value)


@pytest.mark.parametrize("value", [327.675, -327.685, 330, math.inf, math.nan, -1e308])
def test_currents_without_a_code(value: float) -> None:
    i18n.use("ja")
    with pytest.raises(InvalidValue) as caught:
        cnvCur2CAN(value)
    for part in ("電流", "-327.68", "327.67", "%"):
        assert part in str(caught.value)


@given(st.floats(-6553.69, 6553.49))
def test_the_code_is_the_nearest(value: float) -> None:
    error = abs(Fraction(value) - Fraction(cnvVel2CAN(value), 5))
    assert error <= Fraction(1, 10) + Fraction(1, 10**9)


@pytest.mark.parametrize("function", [cnvCAN2Vel, cnvCAN2Cur, cnvCAN2Analog])
@pytest.mark.parametrize("code", [-32769, 32768, 65535, 1 << 64])
def test_signed_codes_out_of_range(function: Callable[[int], float], code: int) -> None:
    with pytest.raises(InvalidValue, match="-32768"):
        function(code)


@pytest.mark.parametrize("function", [cnvCAN2Load, cnvCAN2Volt])
@pytest.mark.parametrize("code", [-32769, 65536])
def test_unsigned_codes_out_of_range(function: Callable[[int], float], code: int) -> None:
    with pytest.raises(InvalidValue, match="65535"):
        function(code)


@pytest.mark.parametrize(("code", "value"), [(0, 0), (255, 255), (-1, 65535), (65535, 65535), (-32768, 32768)])
def test_loads(code: int, value: float) -> None:
    assert cnvCAN2Load(code) == value
    assert cnvCAN2Load(code, 0.1) == float(Fraction(value) / 10)


@pytest.mark.parametrize("unit", [0, 10, math.nan, "0.1"])
def test_other_units_of_a_load(unit: float) -> None:
    with pytest.raises(InvalidValue, match=r"unit of a load, in %, must be 1 or 0\.1"):
        cnvCAN2Load(1, unit)


def test_voltages() -> None:
    assert cnvCAN2Volt(237) == 23.7
    assert cnvCAN2Volt(-1) == cnvCAN2Volt(65535) == 6553.5
    assert cnvCAN2Analog(-32768) == -327.68
    assert cnvCAN2Analog(14) == 0.14


def test_pack_float() -> None:
    assert flt_to_pkflt(1234567) == 0x0D61E241
    assert flt_to_pkflt(1234567, "trunc") == 0x0D61E240
    assert pkflt_to_flt(0x01C00019) == 0.25
    assert str_to_pkflt("26214400E+27") == 910426112
    assert pkflt_to_str(910426112) == "26214400e+27"
    with pytest.raises(InvalidValue):
        str_to_pkflt("1.2.3")
