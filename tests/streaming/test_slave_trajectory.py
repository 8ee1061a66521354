"""Trajectories are read from common sources, and rejected before the arm moves if they violate its limits."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory.csv_file import load_csv
from orinkit.streaming.trajectory.trajectory import (
    TrajectoryError,
    check_path,
    check_range,
    check_trajectory,
    read_point,
    read_trajectory,
)
from orinkit.values.poses import J, P, T, V

PERIOD = 0.008
ROW = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
TRANS = (400.0, 0.0, 300.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0)


def limits(axes: int = 1, velocity: float = 100.0, acceleration: float = 500.0, reach: float = 170.0) -> Limits:
    return Limits(
        (-reach,) * axes, (reach,) * axes, (velocity,) * axes, (acceleration,) * axes, (acceleration * 20,) * axes
    )


class Hostile:
    """An element whose methods all raise an exception."""

    def __float__(self):
        raise RuntimeError

    def __repr__(self):
        raise RuntimeError


# --- reading ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "kind", "axes", "expected"),
    [
        ([ROW, ROW], "J", 6, [ROW, ROW]),
        (((1, 2, 3, 4, 5, 6),), "J", 6, [ROW]),
        ([[*ROW, 0, 0.0]], "J", 6, [ROW]),
        ([[*ROW, 7, 8]], "J", 8, [(*ROW, 7.0, 8.0)]),
        ([[1, 2, 3, 4]], "J", 4, [(1.0, 2.0, 3.0, 4.0)]),
        ([J(*ROW), J(*ROW, 0, 0)], "J", 6, [ROW, ROW]),
        (np.array([ROW, ROW]), "J", 6, [ROW, ROW]),
        (np.array([ROW], dtype=np.float32), "J", 6, [ROW]),
        (np.arange(1, 7).reshape(1, 6), "J", 6, [ROW]),
        ([np.array(ROW)], "J", 6, [ROW]),
        ([[np.float64(1), np.int16(2), Decimal(3), 4, 5, 6]], "J", 6, [ROW]),
        ([ROW], "P", 6, [(*ROW, -1.0)]),
        ([[*ROW, 5]], "P", 6, [(*ROW, 5.0)]),
        ([P(*ROW, 5)], "P", 6, [(*ROW, 5.0)]),
        (np.array([[*ROW, 261]]), "P", 6, [(*ROW, 261.0)]),
        ([TRANS], "T", 6, [(*TRANS, -1.0)]),
        ([T(*TRANS, 5)], "T", 6, [(*TRANS, 5.0)]),
    ],
)
def test_what_is_read(source, kind, axes, expected):
    points = read_trajectory(source, kind, axes)
    assert points == expected
    assert all(type(point) is tuple and {type(value) for value in point} == {float} for point in points)
    assert [read_point(row, kind, axes) for row in source] == expected


@pytest.mark.parametrize(
    ("row", "kind", "axis", "words"),
    [
        ((1, 2, 3, 4, 5, math.nan), "J", 6, "J6 is nan"),
        ((1, 2, math.inf, 4, 5, 6), "J", 3, "J3 is inf"),
        ((1, 2, -math.inf, math.inf, 5, 6), "J", 3, "J3 is -inf"),
        ((1, 2, 3, 4, 5, 1e7), "J", 6, "J6 is 10000000.0"),
        ((1, 2, 3, 4, 5, 10**400), "J", 6, "J6 is"),
        ((1, 2, 3, 4, "5", 6), "J", 5, "J5 is '5'"),
        ((1, 2, 3, 4, None, 6), "J", 5, "J5 is None"),
        ((True, 2, 3, 4, 5, 6), "J", 1, "J1 is True"),
        ((np.True_, 2, 3, 4, 5, 6), "J", 1, "J1 is"),
        ((1j, 2, 3, 4, 5, 6), "J", 1, "J1 is 1j"),
        (([1.0], 2, 3, 4, 5, 6), "J", 1, "J1 is"),
        ((Hostile(), 2, 3, 4, 5, 6), "J", 1, "J1 is <Hostile>"),
        ((1, 2, 3, 4, 5), "J", None, "got 5 values, expected 6 to 8 for J"),
        ((1,) * 9, "J", None, "9 values"),
        (range(10**12), "J", None, "values"),
        ((1, 2, 3, 4, 5, 6, 0, 8), "J", 8, "J8 is 8.0, but the arm has only 6 joints"),
        ((), "J", None, "0 values"),
        (5.0, "J", None, "5.0 is not a pose"),
        ("123456", "J", None, "'123456' is not a pose"),
        (b"123456", "J", None, "is not a pose"),
        (None, "J", None, "None is not a pose"),
        ({1: 2}, "J", None, "is not a pose"),
        (Hostile(), "J", None, "<Hostile> is not a pose"),
        (P(*ROW), "J", None, "is not a set-point of type J"),
        (J(*ROW), "P", None, "is not a set-point of type P"),
        (V(1, 2, 3), "P", None, "is not a set-point of type P"),
        ((*ROW, 5.5), "P", 7, "fig is 5.5"),
        ((*ROW, math.nan), "P", 7, "fig is nan"),
        ((1, 2, 3, 4, 5), "P", None, "got 5 values, expected 6 to 7 for P"),
        ((*ROW, 5, 0), "P", None, "8 values"),
        (TRANS[:8], "T", None, "got 8 values, expected 9 to 10 for T"),
        ((*TRANS, 0.5), "T", 10, "fig is 0.5"),
        ((1, 2, 3, 0, 0, 0, 0, 0, 1), "T", None, "vector is zero"),
        ((1, 2, 3, 0, 0, 2, 0, 0, 1), "T", None, "parallel"),
    ],
)
def test_a_set_point_that_is_none(row, kind, axis, words):
    good = {"J": ROW, "P": ROW, "T": TRANS}[kind]
    with pytest.raises(TrajectoryError) as caught:
        read_trajectory([good, good, row], kind)
    error = caught.value
    assert (error.sample, error.axis) == (2, axis)
    assert words in str(error)
    assert "sample 2 (counted from 0)" in str(error)
    with pytest.raises(TrajectoryError) as alone:
        read_point(row, kind)
    assert (alone.value.sample, alone.value.axis) == (None, axis)
    i18n.use("ja")
    with pytest.raises(TrajectoryError) as japanese:
        read_trajectory([good, good, row], kind)
    assert "サンプル 2 (0 始まり)" in str(japanese.value)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ([], "empty"),
        (np.zeros((0, 6)), "empty"),
        (None, "None is not a trajectory"),
        (5, "5 is not a trajectory"),
        (b"x", "is not a trajectory"),
        ({1: 2}, "is not a trajectory"),
        (iter([ROW]), "is not a trajectory"),
        (np.float64(1), "is not a trajectory"),
        (J(*ROW), "is not a trajectory"),
        (Hostile(), "<Hostile> is not a trajectory"),
        (range(10**12), "the limit of 1000000"),
        (np.zeros((2, 2, 6)), "2 values"),
        (np.zeros((2, 6, 6)), "J1 is"),
        (np.zeros(6), "0.0 is not a pose"),
    ],
)
def test_what_is_no_trajectory(source, words):
    with pytest.raises(TrajectoryError, match=words) as caught:
        read_trajectory(source, "J")
    i18n.use("ja")
    with pytest.raises(TrajectoryError) as japanese:
        read_trajectory(source, "J")
    assert str(japanese.value) != str(caught.value)


@pytest.mark.parametrize(("kind", "axes"), [("V", 6), ("", 6), (None, 6), ("J", 0), ("J", 9), ("J", 6.0), ("J", True)])
def test_kinds_and_axes_that_are_none(kind, axes):
    with pytest.raises(InvalidValue, match=r"kind|axes"):
        read_trajectory([ROW], kind, axes)
    with pytest.raises(InvalidValue, match=r"kind|axes"):
        read_point(ROW, kind, axes)


def test_deep_nesting_is_refused_quickly():
    row: list[object] = []
    for _ in range(100_000):
        row = [row]
    with pytest.raises(TrajectoryError):
        read_trajectory([row], "J")


def test_the_error_keeps_sample_and_axis_in_pickle():
    error = TrajectoryError("text", 12, 3)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.sample, again.axis) == (TrajectoryError, "text", 12, 3)
    assert isinstance(again, InvalidValue)


def test_numpy_is_not_needed():
    code = "import sys, orinkit.streaming.trajectory.retime, orinkit.streaming.recording.recorder; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- checking joints --------------------------------------------------------------------------------------------------

STEP = 500.0 * PERIOD**2  # the largest first step of an axis from standstill, 0.032 deg
RAMP = [STEP * n * (n + 1) / 2 for n in range(20)]  # each step is longer by STEP


def up_and_down() -> list[tuple[float]]:
    steps = [STEP * n for n in [*range(1, 20), *range(20, 0, -1)]]
    points, value = [(0.0,)], 0.0
    for step in steps:
        value += step
        points.append((value,))
    return points


def test_a_motion_at_the_limit_is_taken():
    points = up_and_down()
    check_trajectory(points, limits(velocity=STEP * 20 / PERIOD), (0.0,), PERIOD)
    check_trajectory(points, limits(velocity=STEP * 20 / PERIOD), None, PERIOD)
    with pytest.raises(TrajectoryError, match="velocity") as caught:
        check_trajectory(points, limits(velocity=STEP * 20 / PERIOD * 0.999), (0.0,), PERIOD)
    assert caught.value.sample == 20
    with pytest.raises(TrajectoryError, match="acceleration"):
        check_trajectory(points, limits(velocity=STEP * 20 / PERIOD, acceleration=499.0), (0.0,), PERIOD)


def test_rounding_of_numbers_does_not_matter_that_of_files_does():
    """Rounding to six decimals exceeds the tolerance of a controller, rounding to nine does not."""
    bounds = limits(acceleration=500.0 / 3)
    exact = [value / 3 for (value,) in up_and_down()]
    check_trajectory([(value,) for value in exact], bounds, (0.0,), PERIOD)
    check_trajectory([(round(value, 9),) for value in exact], bounds, (0.0,), PERIOD)
    rounded = [(round(value, 6),) for value in exact]
    with pytest.raises(TrajectoryError, match="acceleration"):
        check_trajectory(rounded, bounds, (0.0,), PERIOD)
    check_trajectory(rounded, bounds, (0.0,), PERIOD, tolerance=1e-3)


@pytest.mark.parametrize(
    ("points", "start", "sample", "axis", "words"),
    [
        (
            [(0.0, 0.0)] * 3 + [(0.0, 0.033)] * 3,
            (0, 0),
            3,
            2,
            "sample 3 (counted from 0, at 0.024 s), J2: acceleration",
        ),
        ([(0.0, value) for value in RAMP] + [(0.0, RAMP[-1])], (0, 0), 20, 2, "acceleration"),
        ([(0.0, value) for value in RAMP], (0, 0), 19, 2, "ends while the arm moves"),
        ([(0.0, 0.0)] * 3 + [(9.0, 9.0)] * 3, (0, 0), 3, 1, "J1: velocity 1125.0 deg/s exceeds the limit of 100"),
        ([(0.0, 0.0), (0.0, 170.1)], (0, 0), 1, 2, "J2: 170.100 is outside the range of -170 to 170"),
        ([(-171.0, 0.0)], (0, 0), 0, 1, "J1: -171.000 is outside the range"),
        ([(10.0, 20.0)] * 3, (10.0, 20.04), 0, 2, "the arm is at J(10, 20.04), but the trajectory begins at J(10, 20)"),
        ([(10.0, 20.0)], (0.0, 0.0), 0, 1, "J2 is off by 20.000. Try: move to the beginning of the trajectory first"),
        ([(10.0, 20.0)], (10.0, 25.0, 0, 0, 0, 0, 0, 0), 0, 2, "J2 is off by 5.000"),
    ],
)
def test_the_first_sample_that_breaks_a_limit(points, start, sample, axis, words):
    with pytest.raises(TrajectoryError) as caught:
        check_trajectory(points, limits(2), start, PERIOD)
    assert (caught.value.sample, caught.value.axis) == (sample, axis)
    assert words in str(caught.value)
    i18n.use("ja")
    with pytest.raises(TrajectoryError) as japanese:
        check_trajectory(points, limits(2), start, PERIOD)
    assert str(japanese.value) != str(caught.value)
    assert not str(japanese.value).isascii()


def test_a_start_one_step_away_is_near_enough():
    check_trajectory([(10.0,)] * 2, limits(), (10.0 + STEP,), PERIOD)


@pytest.mark.parametrize(
    "change",
    [
        {"points": [(1.0,), (2.0, 3.0)]},
        {"points": [(1.0, 2.0)]},
        {"points": []},
        {"points": [(math.nan,)] * 3},
        {"points": [(0.0,), (math.inf,), (-math.inf,)]},
        {"points": [("x",)]},
        {"points": [5.0]},
        {"start": ()},
        {"start": (0.0,) * 9},
        {"start": (math.nan,)},
        {"period": 0.0},
        {"period": -1.0},
        {"period": math.nan},
        {"period": math.inf},
        {"period": "8"},
        {"period": True},
    ],
)
def test_arguments_that_are_none(change):
    arguments = {"points": [(0.0,)], "limits": limits(), "start": (0.0,), "period": PERIOD} | change
    with pytest.raises(InvalidValue):
        check_trajectory(**arguments)


def slow_check(points: list[tuple[float, ...]], bounds: Limits, start: tuple[float, ...]) -> tuple[int, int] | None:
    """Return sample and axis of the first limit violation, computed literally by the rules of the document."""
    places = [start, start, *points, points[-1]]
    for sample in range(len(points) + 1):
        last = min(sample, len(points) - 1)
        for what in ("range", "velocity", "acceleration"):
            for axis in range(len(start)):
                before, old, new = (places[sample + back][axis] for back in range(3))
                broken = {
                    "range": sample < len(points) and not bounds.lower[axis] <= new <= bounds.upper[axis],
                    "velocity": abs(new - old) > bounds.velocity[axis] * PERIOD,
                    "acceleration": abs(new - 2 * old + before) > bounds.acceleration[axis] * PERIOD**2,
                }[what]
                if broken:
                    return last, axis + 1
    return None


@given(
    st.lists(st.tuples(*[st.integers(-40, 40)] * 3), min_size=1, max_size=12),
    st.tuples(*[st.integers(-40, 40)] * 3),
    st.sampled_from([0.5, 3.5, 20.5, 1000.5]),
    st.sampled_from([0.5, 5.5, 60.5, 1000.5]),
)
def test_it_is_what_the_document_says(points, start, velocity, acceleration):
    bounds = limits(3, velocity / PERIOD, acceleration / PERIOD**2, 30.5)
    places = [tuple(map(float, point)) for point in points]
    try:
        check_trajectory(places, bounds, tuple(map(float, start)), PERIOD)
    except TrajectoryError as error:
        found = (error.sample, error.axis)
    else:
        found = None
    assert found == slow_check(places, bounds, tuple(map(float, start)))


def test_range_alone():
    check_range([(0.0,), (160.0,)], limits(), PERIOD)
    with pytest.raises(TrajectoryError, match="outside the range") as caught:
        check_range([(0.0,), (160.0,), (-180.0,)], limits(), PERIOD)
    assert (caught.value.sample, caught.value.axis) == (2, 1)


# --- checking paths ---------------------------------------------------------------------------------------------------

SPACE = PathLimits(1000.0, 5000.0, 1e5, 200.0, 1000.0, 2e4)  # per period: 8 mm, 0.32 mm; 1.6 deg, 0.064 deg


def along(values: list[float], place: int) -> list[tuple[float, ...]]:
    """Return positions of which one value changes."""
    row = [400.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0]
    points = []
    for value in values:
        row[place] = value
        points.append(tuple(row))
    return points


def as_trans(point: tuple[float, ...]) -> tuple[float, ...]:
    """Return the T of a P, computed with numpy."""
    rx, ry, rz = np.radians(point[3:6])
    x = np.array([[1, 0, 0], [0, np.cos(rx), -np.sin(rx)], [0, np.sin(rx), np.cos(rx)]])
    y = np.array([[np.cos(ry), 0, np.sin(ry)], [0, 1, 0], [-np.sin(ry), 0, np.cos(ry)]])
    z = np.array([[np.cos(rz), -np.sin(rz), 0], [np.sin(rz), np.cos(rz), 0], [0, 0, 1]])
    turn = z @ y @ x
    return (*point[:3], *turn[:, 1].tolist(), *turn[:, 2].tolist(), *point[6:])


@pytest.mark.parametrize("kind", ["P", "T"])
@pytest.mark.parametrize(
    ("values", "place", "sample", "words"),
    [
        ([0.32 * n * (n + 1) / 2 for n in range(8)], 1, 7, "ends while the arm moves"),
        ([0.0, 0.3, 0.9, 1.5, 1.8, 1.8], 1, None, ""),
        ([0.0, 0.0, 0.33, 0.33], 1, 2, "tool acceleration 5156"),
        ([0.0, 0.0, 9.0, 9.0], 1, 2, "tool velocity 1125.0 mm/s exceeds the limit of 1000"),
        ([180.0, -179.95, -179.9, -179.9], 3, None, ""),
        ([180.0, -179.95, -179.9, -179.9], 5, None, ""),
        ([0.0, 0.0, 0.0645, 0.0645], 4, 2, "angular acceleration"),
        ([0.0, 0.0, 3.0, 3.0], 3, 2, "angular velocity 375.0 deg/s exceeds the limit of 200"),
    ],
)
def test_paths(kind, values, place, sample, words):
    points = along(values, place)
    if kind == "T":
        points = [as_trans(point) for point in points]
    if sample is None:
        check_path(points, SPACE, points[0], PERIOD, kind)
        return
    with pytest.raises(TrajectoryError) as caught:
        check_path(points, SPACE, points[0], PERIOD, kind)
    assert (caught.value.sample, caught.value.axis) == (sample, None)
    assert words in str(caught.value)


def test_turning_about_an_axis_that_is_no_axis_of_the_angles():
    """Near RY = 90 the angles of a P jump, although the tool hardly rotates."""
    points = [(400.0, 0.0, 300.0, 0.0, 90.0, 10.0, 5.0), (400.0, 0.0, 300.0, 50.0, 90.0, 60.02, 5.0)] * 2
    check_path([points[0], points[1], points[1]], SPACE, None, PERIOD, "P")


@pytest.mark.parametrize("kind", ["P", "T"])
def test_a_tool_that_is_somewhere_else(kind):
    points = along([0.0, 0.0], 1)
    start = along([30.0], 1)[0]
    if kind == "T":
        points, start = list(map(as_trans, points)), as_trans(start)
    with pytest.raises(
        TrajectoryError, match=r"the trajectory begins at .* 30\.000 mm, 0\.000 deg\. Try: move to the beginning"
    ) as caught:
        check_path(points, SPACE, start, PERIOD, kind)
    assert caught.value.sample == 0


def test_paths_of_nothing():
    good = along([0.0] * 3, 1)
    for arguments in (
        ([], SPACE, None, PERIOD, "P"),
        (good, SPACE, None, PERIOD, "J"),
        (good, SPACE, None, PERIOD, "X"),
        (good, SPACE, None, 0.0, "P"),
        (good, SPACE, (1.0, 2.0), PERIOD, "P"),
        ([point[:6] for point in good], SPACE, None, PERIOD, "P"),
        ([(math.nan,) * 7], SPACE, None, PERIOD, "P"),
    ):
        with pytest.raises(InvalidValue):
            check_path(*arguments)
    bad = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 5.0)
    with pytest.raises(TrajectoryError, match=r"sample 1 .*zero") as caught:
        check_path([(*TRANS, 5.0), bad], SPACE, None, PERIOD, "T")
    assert caught.value.sample == 1


# --- files ------------------------------------------------------------------------------------------------------------

NAMES = "j1,j2,j3,j4,j5,j6"


@pytest.mark.parametrize(
    ("text", "kind", "period", "rows"),
    [
        ("1,2,3,4,5,6\n2,3,4,5,6,7\n", "J", None, [ROW, (2, 3, 4, 5, 6, 7)]),
        ("1,2,3,4,5,6,0,0\n", "J", None, [(*ROW, 0, 0)]),
        ("1 2 3 4 5 6\n  2\t3 4 5 6 7  \n", "J", None, [ROW, (2, 3, 4, 5, 6, 7)]),
        ("1\t2\t3\t4\t5\t6\n", "J", None, [ROW]),
        ("1;2;3;4;5;6\n", "J", None, [ROW]),
        ("1e0, +2, 3.0, 4., 5, 6\n", "J", None, [ROW]),
        (f"{NAMES}\n1,2,3,4,5,6\n", "J", None, [ROW]),
        ("\ufeffJ1,J2,J3,J4,J5,J6\r\n1,2,3,4,5,6\r\n", "J", None, [ROW]),
        (f"# a comment\n\n{NAMES}\n\n# more\n1,2,3,4,5,6\n,,,,,\n\n", "J", None, [ROW]),
        ('"J1","J2","J3","J4","J5","J6"\n1,2,3,4,5,6', "J", None, [ROW]),
        (f"note,{NAMES},note\na,1,2,3,4,5,6,b\n", "J", None, [ROW]),
        ("J6, J5, J4, J3, J2, J1, note\n6,5,4,3,2,1,hello\n", "J", None, [ROW]),
        (f"time_s,{NAMES}\n0,1,2,3,4,5,6\n0.008,1,2,3,4,5,6\n", "J", 0.008, [ROW, ROW]),
        (f"{NAMES},Time\n1,2,3,4,5,6,10\n1,2,3,4,5,6,10.002\n", "J", 0.002, [ROW, ROW]),
        (f"T,{NAMES}\n0,1,2,3,4,5,6\n", "J", None, [ROW]),
        ("time_s,J1_command,J2_command,J1_encoder,J2_encoder\n0,1,2,x,\n0.008,3,4,,\n", "J", 0.008, [(1, 2), (3, 4)]),
        ("time_s,J1_command,J1,X,Y,Z\n0,1,2,3,4,5\n", "J", None, [(1,)]),
        ("J1,J2,J3,J4,J5,J6,J8\n1,2,3,4,5,6,8\n", "J", None, [(*ROW, 0, 8)]),
        ("x,y,z,rx,ry,rz\n1,2,3,4,5,6\n", "P", None, [ROW]),
        ("X,Y,Z,RX,RY,RZ,Fig\n1,2,3,4,5,6,5\n", "P", None, [(*ROW, 5)]),
        ("X_command,Y_command,Z_command,RX_command,RY_command,RZ_command,Fig_command,J1_encoder\n1,2,3,4,5,6,5,9\n",
         "P", None, [(*ROW, 5)]),
        ("x,y,z,ox,oy,oz,ax,ay,az,fig\n400,0,300,0,1,0,0,0,-1,5\n", "T", None, [(*TRANS, 5)]),
        ("# x,y,z,rx,ry,rz,fig\n1,2,3,4,5,6,5\n", "P", None, [(*ROW, 5)]),
        ("# x y z rx ry rz\n1 2 3 4 5 6\n", "P", None, [ROW]),
        ("# made by hand, on a Monday\n1,2,3,4,5,6\n", "J", None, [ROW]),
    ],
)  # fmt: skip
def test_files(tmp_path, text, kind, period, rows):
    path = tmp_path / "x.csv"
    path.write_bytes(text.encode())
    assert load_csv(path) == (kind, period, rows)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"\n\n# only this\n,,,\n", "the file is empty"),
        (b"j1,j2\n", "line 1: no rows after the header"),
        (b"1,2,3\n", "line 1: 3 columns without names"),
        (b"1,2,3,4,5,6,7,8,9\n", "line 1: 9 columns without names"),
        (b"a,b,c\n1,2,3\n", "line 1: the header contains no columns of a trajectory"),
        (b"j1,j2,j4\n1,2,3\n", "line 1: column J3 is missing"),
        (b"x,y,z,rx\n1,2,3,4\n", "line 1: columns are missing: ry, rz"),
        (b"j1,j1\n1,2\n", "line 1: two columns have the same name"),
        (b"j1,x,y,z\n1,2,3,4\n", "line 1: the file has both joints and positions"),
        (b"j1,j2\n1,2\n\n1\n", "line 4: got 1 values, expected 2"),
        (b"j1,j2\n1,2\n1,2,3\n", "line 3: got 3 values, expected 2"),
        (b"j1,j2\n1,2\n1,x\n", "line 3: column"),
        (b"j1,j2\n1,2\n1,nan\n", "line 3: column"),
        (b"j1,j2\n1,2\n1,1e999\n", "line 3: column"),
        (b"j1,j2\n1,2\n1,\n", "line 3: column"),
        (b"j1,j2\n1,2\n1\x00,2\n", "line 3|not a CSV file"),
        (b"j1;j2\n1,5;2\n", "line 2: column"),
        (b"t,j1\n0,1\n0.008,1\n0.016,1\n0.025,1\n", "line 3: the interval to the row before is 0.008 s"),
        (b"t,j1\n0,1\n0,1\n", "line 3: the interval to the row before is 0 s"),
        (b"t,j1\n0,1\n-1,1\n", "line 3: the interval to the row before is -1 s"),
        (b"t,j1\n0,1\n99,1\n", r"equal \(within 1 %\) and at most 10 s"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "not a CSV file"),
        (bytes(range(256)) * 50, "not a CSV file"),
        (b'time_s,"J1', "not a CSV file"),
        (b"j1," + b"x" * 300_000, "not a CSV file"),
        ("j1,j2\n1,2\n".encode("utf-16"), "not a CSV file"),
    ],
)
def test_files_that_are_none(tmp_path, content, words):
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    with pytest.raises(InvalidValue, match=words) as caught:
        load_csv(path)
    assert str(path) in str(caught.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as japanese:
        load_csv(path)
    assert str(japanese.value) != str(caught.value)


@pytest.mark.parametrize("name", [".", "none.csv", "x\x00y.csv", "y" * 5000])
def test_files_that_cannot_be_read(tmp_path, name):
    with pytest.raises(InvalidValue, match="cannot read") as caught:
        load_csv(tmp_path / name)
    assert len(str(caught.value)) < 400


def test_an_endless_file_ends():
    with pytest.raises(InvalidValue, match="not a CSV file"):
        load_csv(Path("/dev/zero"))


@given(st.binary(max_size=300))
def test_any_bytes_are_a_trajectory_or_an_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(content)
    try:
        kind, _, rows = load_csv(path)
    except InvalidValue:
        return
    assert kind in "JPT"
    assert all(math.isfinite(value) for row in rows for value in row)


def test_a_file_as_a_trajectory(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(f"{NAMES}\n1,2,3,4,5,6\n1,2,3,4,5,7\n")
    expected = [ROW, (1.0, 2.0, 3.0, 4.0, 5.0, 7.0)]
    assert read_trajectory(path, "J") == read_trajectory(str(path), "J", period=PERIOD) == expected
    with pytest.raises(TrajectoryError, match="set-points of type J, expected P"):
        read_trajectory(path, "P")
    with pytest.raises(TrajectoryError, match=r"x\.csv: sample 0 .*expected 7 to 8"):
        read_trajectory(path, "J", 7)


def test_a_file_of_another_period_is_resampled(tmp_path):
    path = tmp_path / "x.csv"
    rows = "".join(f"{n * 0.004:.3f},{n * n / 100},0,0,0,0,0\n" for n in range(21))
    path.write_text(f"time_s,{NAMES}\n{rows}")
    points = read_trajectory(path, "J", period=PERIOD)
    assert [point[0] for point in points] == pytest.approx([n * n / 25 for n in range(11)])
    assert len(read_trajectory(path, "J")) == 21
