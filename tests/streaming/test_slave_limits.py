from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import astuple, replace

import pytest

from orinkit.arms import MODEL_NAMES, load_model
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.streaming.planning.limits import Limits, PathLimits

TWO = Limits((-10.0, -20.0), (10.0, 20.0), (100.0, 200.0), (500.0, 1000.0), (1e4, 2e4))
PATH = PathLimits(1500.0, 7500.0, 150_000.0, 360.0, 1800.0, 36_000.0)


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_limits_of_a_model_are_those_of_its_axes(name: str) -> None:
    model = load_model(name)
    limits = Limits.of_model(model)
    for number, axis in enumerate(model.axes):
        assert (limits.lower[number], limits.upper[number]) == (axis.lower, axis.upper)
        assert (limits.velocity[number], limits.acceleration[number]) == (axis.velocity, axis.acceleration)
        assert limits.jerk[number] == pytest.approx(axis.acceleration / 0.05)


def test_limits_of_a_model_with_extra_axes() -> None:
    model = load_model("VS-050")
    rail = replace(model.axes[0], lower=0.0, upper=2000.0, velocity=800.0, acceleration=2000.0, linear=True)
    limits = Limits.of_model(replace(model, axes=(*model.axes, rail, rail), home=(*model.home, 0.0, 0.0)))
    assert len(limits.jerk) == 8
    assert limits.upper[7] == 2000.0
    assert limits.jerk[7] == pytest.approx(40_000.0)


def test_path_limits_of_a_model() -> None:
    limits = PathLimits.of_model(load_model("VS-050"))
    assert astuple(limits) == pytest.approx((1500.0, 7500.0, 150_000.0, 360.0, 1800.0, 36_000.0))


def test_numbers_become_floats_in_tuples() -> None:
    limits = Limits([-1], [1], [2], [3], [4])
    assert astuple(limits) == ((-1.0,), (1.0,), (2.0,), (3.0,), (4.0,))
    assert all(type(row[0]) is float for row in astuple(limits))
    assert type(PathLimits(1, 2, 3, 4, 5, 6).speed) is float


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"lower": (10.0, -20.0)}, "J1: lower (10) is not below upper (10)"),
        ({"upper": (10.0, -21.0)}, "J2: lower (-20) is not below upper (-21)"),
        ({"velocity": (100.0,)}, "velocity has 1 values, lower has 2"),
        ({"jerk": (1.0, 2.0, 3.0)}, "jerk has 3 values"),
        ({"velocity": (100.0, 0.0)}, "J2 velocity must be greater than 0, not 0"),
        ({"acceleration": (-1.0, 1.0)}, "J1 acceleration must be greater than 0, not -1"),
        ({"jerk": (1.0, math.nan)}, "J2 jerk must be a finite number, not nan"),
        ({"upper": (math.inf, 1.0)}, "J1 upper must be a finite number, not inf"),
        ({"velocity": (1e10, 1.0)}, "J1 velocity is 1e+10; the largest allowed value is 1e+09"),
        ({"velocity": ("fast", 1.0)}, "J1 velocity must be a finite number, not 'fast'"),
        ({"velocity": (10**400, 1.0)}, "J1 velocity must be a finite number, not 1000"),
        ({"velocity": (True, 1.0)}, "J1 velocity must be a finite number, not True"),
        ({"lower": ()}, "lower is (); expected 1 to 8 numbers"),
        ({"lower": (1.0,) * 9}, "1 to 8 numbers"),
        ({"lower": None}, "lower is None"),
        ({"lower": "-1"}, "lower is '-1'"),
        ({"lower": 5.0}, "lower is 5.0"),
    ],
)
def test_limits_that_cannot_be(changes: dict[str, tuple[float, ...]], said: str) -> None:
    with pytest.raises(InvalidValue) as error:
        replace(TWO, **changes)
    assert said in str(error.value)
    assert isinstance(error.value, ValueError)
    assert isinstance(error.value, OrinError)


@pytest.mark.parametrize(
    "name", ["speed", "acceleration", "jerk", "rotation", "rotation_acceleration", "rotation_jerk"]
)
@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "must be greater than 0, not 0.0"),
        (-1.0, "must be greater than 0, not -1.0"),
        (2e9, r"is 2e\+09"),
        (math.nan, "must be a finite number, not nan"),
        (math.inf, "must be a finite number, not inf"),
        (-math.inf, "must be a finite number, not -inf"),
        (None, "must be a finite number, not None"),
        ("1", "must be a finite number, not '1'"),
    ],
)
def test_path_limits_that_cannot_be(name: str, value: float, said: str) -> None:
    with pytest.raises(InvalidValue, match=f"limits: {name} {said}"):
        replace(PATH, **{name: value})


def test_parts_of_limits() -> None:
    part = TWO.scaled(velocity=0.5, acceleration=0.25, jerk=0.1)
    assert (part.lower, part.upper) == (TWO.lower, TWO.upper)
    assert part.velocity == (50.0, 100.0)
    assert part.acceleration == (125.0, 250.0)
    assert part.jerk == pytest.approx((1e3, 2e3))
    assert TWO.scaled() == TWO


def test_parts_of_path_limits() -> None:
    part = PATH.scaled(velocity=0.5, acceleration=0.25, jerk=0.1)
    assert astuple(part) == pytest.approx((750.0, 1875.0, 15_000.0, 180.0, 450.0, 3600.0))
    assert PATH.scaled() == PATH


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("value", [0.0, -0.5, 1.0000001, math.nan, math.inf, "half"])
@pytest.mark.parametrize("limits", [TWO, PATH])
def test_parts_that_cannot_be(limits: Limits | PathLimits, name: str, value: float) -> None:
    with pytest.raises(InvalidValue, match=name):
        limits.scaled(**{name: value})


def test_limits_do_not_change() -> None:
    with pytest.raises(AttributeError):
        TWO.lower = (0.0, 0.0)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: replace(TWO, lower=(10.0, -20.0)),
            "制限値: J1: lower (10) は upper (10) より小さくなければなりません",
        ),
        (lambda: replace(TWO, jerk=(1.0,)), "制限値: jerk は 1 個ですが lower は 2 個です"),
        (lambda: replace(PATH, speed=0.0), "制限値: speed は 0 より大きい値でなければなりません (0.0)"),
        (lambda: PATH.scaled(velocity=2.0), "制限値: velocity の割合 は 0 より大きく 1 以下でなければなりません (2.0)"),
    ],
)
def test_complaints_in_japanese(make: object, said: str) -> None:
    i18n.use("ja")
    with pytest.raises(InvalidValue) as error:
        make()
    assert said in str(error.value)


def test_limits_need_neither_ruckig_nor_numpy() -> None:
    program = (
        "import sys; sys.modules['ruckig'] = None; sys.modules['numpy'] = None;"
        "from orinkit.streaming.planning.limits import Limits; from orinkit.arms import load_model;"
        "print(len(Limits.of_model(load_model('COBOTTA')).jerk))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "6\n"
