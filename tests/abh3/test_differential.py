"""Conversion between the motion of a vehicle and the commands of its motors."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.differential import Differential, MotorVelocities, Travel, Twist
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core

AGV = Differential(wheel_diameter=0.1, track=0.5, gear=1 / 10)
METRES = math.pi / 100  # m per revolution of a motor
SPEEDS = st.floats(-1e6, 1e6)


def test_straight_ahead() -> None:
    wheels = AGV.to_motors(1.0, 0.0)
    assert wheels.a == wheels.b == pytest.approx(60 / METRES)
    assert AGV.to_travel(1.0, 0.0) == (wheels.a, 0.0)
    assert str(AGV.to_travel(1.0, 0.0).x) == "0.0"
    assert str(AGV.from_motors(600.0, 600.0).omega) == "0.0"


def test_the_formulas() -> None:
    assert AGV.from_travel(600.0, -60.0) == pytest.approx((600 / 60 * METRES, 60 / 60 * METRES / 0.25))
    assert AGV.from_motors(540.0, 660.0) == pytest.approx(AGV.from_travel(600.0, -60.0))


def test_the_right_wheel_is_faster_in_a_left_turn() -> None:
    a, b = AGV.to_motors(0.0, 1.0)
    assert b == -a > 0
    assert AGV.to_travel(0.0, 1.0).x == pytest.approx(-0.25 * 60 / METRES)


@given(SPEEDS, SPEEDS)
def test_round_trip(v: float, omega: float) -> None:
    def near(one: Twist, other: Twist) -> bool:
        return one == pytest.approx(other, rel=1e-9, abs=1e-6)

    travel, wheels = AGV.to_travel(v, omega), AGV.to_motors(v, omega)
    assert isinstance(travel, Travel)
    assert isinstance(wheels, MotorVelocities)
    assert near(AGV.from_travel(*travel), Twist(v, omega))
    assert near(AGV.from_motors(*wheels), Twist(v, omega))
    assert (travel.y, travel.x) == pytest.approx(
        ((wheels.a + wheels.b) / 2, (wheels.a - wheels.b) / 2), rel=1e-9, abs=1e-3
    )


def test_distance() -> None:
    assert AGV.metres(2560, 256) == pytest.approx(10 * METRES)
    assert AGV.metres(-256, 256) == pytest.approx(-METRES)


@pytest.mark.parametrize("wrong", [0, -1, math.inf, math.nan, 10**400, None, "wide", 1e-320])
@pytest.mark.parametrize("name", ["wheel_diameter", "track", "gear"])
def test_invalid_dimensions(name: str, wrong: float) -> None:
    measures = {"wheel_diameter": 1e-10, "track": 0.5, "gear": 1e-10, name: wrong}
    if (name, wrong) == ("track", 1e-320):
        measures["track"] = 5e-324  # half of it is 0
    with pytest.raises(InvalidValue):
        Differential(**measures)


def test_messages_name_the_dimension() -> None:
    with pytest.raises(InvalidValue, match="track must be greater than 0, not -1"):
        Differential(wheel_diameter=0.1, track=-1, gear=1)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=r"gear は有限の数値でなければなりません \(nan\)"):
        Differential(wheel_diameter=0.1, track=1, gear=math.nan)


@pytest.mark.parametrize("function", [AGV.to_travel, AGV.to_motors, AGV.from_travel, AGV.from_motors])
@pytest.mark.parametrize("wrong", [(math.nan, 0.0), (0.0, math.inf), (10**400, 0.0), (None, 0.0)])
def test_invalid_motions(function: object, wrong: tuple[float, float]) -> None:
    assert callable(function)
    with pytest.raises(InvalidValue):
        function(*wrong)


def test_motions_that_overflow() -> None:
    fast = Differential(wheel_diameter=1e300, track=1e-300, gear=1.0)
    with pytest.raises(InvalidValue, match="v must be a finite number, not inf"):
        fast.from_travel(1e10, 0.0)
    with pytest.raises(InvalidValue, match="omega must be a finite number"):
        fast.from_motors(1.0, -1.0)
    with pytest.raises(InvalidValue, match="metres must be a finite number"):
        fast.metres(1e10, 1)
    with pytest.raises(InvalidValue, match="omega must be a finite number"):
        AGV.to_travel(0.0, 1.7e308)
    with pytest.raises(InvalidValue, match="b must be a finite number"):
        AGV.to_motors(1e308 * METRES / 60, 1e308 * METRES / 60 / 0.25)


@pytest.mark.parametrize(("pulses", "each"), [(1, 0), (1, -256), (math.nan, 256), (1, math.inf)])
def test_invalid_pulses(pulses: float, each: float) -> None:
    with pytest.raises(InvalidValue):
        AGV.metres(pulses, each)
