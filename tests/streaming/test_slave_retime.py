"""Retiming: the same path within the limits, as fast as possible. Resampling: the same motion with another period."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from orinkit.arms.geometry import angles_of, of_angles, of_vectors, rotvec_between, vectors_of
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory.resample import resample
from orinkit.streaming.trajectory.retime import retime
from orinkit.streaming.trajectory.trajectory import TrajectoryError, check_path, check_trajectory

PERIOD = 0.008
SPACE = PathLimits(1000.0, 5000.0, 1e5, 200.0, 1000.0, 2e4)
HERE = (400.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0)


def limits(axes: int = 1, velocity: float = 100.0, acceleration: float = 500.0, reach: float = 170.0) -> Limits:
    return Limits(
        (-reach,) * axes, (reach,) * axes, (velocity,) * axes, (acceleration,) * axes, (acceleration * 20,) * axes
    )


def retimed(points, bounds, kind="J"):
    """Retime, and check the properties of every result."""
    result = retime(points, bounds, PERIOD, kind)
    check = check_trajectory if kind == "J" else check_path
    check(result, bounds, points[0], PERIOD, *([] if kind == "J" else [kind]))
    assert result[0] == tuple(points[0])
    assert result[-1] == tuple(points[-1])
    assert len(result) >= len(points)
    return result


def seconds(result) -> float:
    return (len(result) - 1) * PERIOD


def shortest(distance: float, velocity: float, acceleration: float) -> float:
    """Return a motion between two standstills."""
    if distance * acceleration < velocity**2:
        return 2 * math.sqrt(distance / acceleration)
    return distance / velocity + velocity / acceleration


def off_the_path(result, points) -> float:
    """Return the largest distance of samples from the polygon of points."""
    corners = np.array(points)
    begin, along = corners[:-1], np.diff(corners, axis=0)
    size = np.maximum((along**2).sum(axis=1), 1e-300)
    worst = 0.0
    for place in np.array(result):
        part = np.clip(((place - begin) * along).sum(axis=1) / size, 0, 1)
        worst = max(worst, float(np.linalg.norm(begin + part[:, None] * along - place, axis=1).min()))
    return worst


# --- joints -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points",
    [
        [(5.0,)],
        [(5.0,)] * 7,
        [(0.0,), (0.01,), (0.03,), (0.05,), (0.06,), (0.06,)],
    ],
)
def test_what_keeps_the_limits_stays_as_it_is(points):
    assert retimed(points, limits()) == points


@pytest.mark.parametrize(
    ("distance", "velocity"), [(0.5, 100.0), (5.0, 100.0), (30.0, 100.0), (160.0, 100.0), (90.0, 5.0)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_jump_takes_the_shortest_time(distance, velocity, sign):
    result = retimed([(0.0,), (sign * distance,)], limits(velocity=velocity))
    best = shortest(distance, velocity, 500.0)
    assert best - 1e-9 <= seconds(result) <= best * 1.02 + 1.5 * PERIOD
    places = [sign * value for (value,) in result]
    assert places == sorted(places)


def test_a_jump_between_holds():
    """Pauses remain pauses, and jumps become straight lines in joint space."""
    before, after = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0), (90.0, 10.0, 30.0, 20.0, -45.0, 160.0)
    result = retimed([before] * 20 + [after] * 20, limits(6))
    assert off_the_path(result, [before, after]) < 1e-9
    assert result[:18] == [before] * 18
    assert result[-18:] == [after] * 18
    assert seconds(result) < 38 * PERIOD + shortest(160.0, 100.0, 500.0) * 1.05


def test_a_jump_out_of_a_motion_is_a_straight_line():
    points = [(0.5 * n, 0.1 * n) for n in range(50)] + [(60 + 0.5 * n, -90 + 0.1 * n) for n in range(50)]
    result = retimed(points, limits(2))
    assert off_the_path(result, points) < 0.2
    assert seconds(result) < 98 * PERIOD + shortest(95.0, 100.0, 500.0) * 1.05 + 0.5


def test_only_what_is_too_fast_is_slowed_down():
    """A slow wave with a jump in the middle: the parts of the wave keep their velocity."""
    wave = [20 * math.sin(n * 0.01) for n in range(2000)]
    points = [(value + (3.0 if 1000 <= n < 1004 else 0.0),) for n, value in enumerate(wave)]
    result = retimed([(0.0,)] * 2 + points, limits())
    assert len(points) < len(result) < len(points) + 100
    places = np.array(result)[:, 0]
    for part in (places[100:900], places[-900:-100]):
        steps = np.abs(np.diff(part))
        given = 0.2 * np.sqrt(1 - (np.clip(part, -20, 20) / 20) ** 2)
        assert np.abs(steps - (given[1:] + given[:-1]) / 2).max() < 0.01
    assert places.max() < 23.01


def test_a_corner_is_passed_slowly_and_kept():
    points = [(n * 0.5, 0.0) for n in range(50)] + [(24.5, n * 0.5) for n in range(1, 50)]
    result = retimed(points, limits(2))
    assert off_the_path(result, points) < 0.05
    assert seconds(result) < 98 * PERIOD + 1.0


def test_twice_too_fast_in_its_middle():
    wave = [(50 - 50 * math.cos(n * 0.02 * 2),) for n in range(1000)]  # 250 deg/s, 1250 deg/s^2 at most
    result = retimed(wave, limits(velocity=125.0, acceleration=1e5))
    assert 1.3 * len(wave) < len(result) < 2.0 * len(wave) + 40
    assert max(abs(after[0] - before[0]) for before, after in pairwise(result)) > 124.5 * PERIOD


def test_the_axis_that_needs_most_time_decides():
    bounds = Limits((-170.0,) * 2, (170.0,) * 2, (100.0, 10.0), (500.0, 500.0), (1e4, 1e4))
    result = retimed([(0.0, 0.0), (50.0, 50.0)], bounds)
    assert seconds(result) == pytest.approx(shortest(50, 10, 500), abs=0.05)


def test_an_arm_at_the_end_of_its_range_stays_within_it():
    points = [(min(170.0, 200 * math.sin(n * 0.1)),) for n in range(40)]
    result = retimed(points, limits())
    assert max(result) == (170.0,)


def test_twice_is_once():
    points = [(50 * math.sin(n * 0.1), 20 * math.cos(n * 0.23)) for n in range(300)]
    once = retimed(points, limits(2))
    assert retimed(once, limits(2)) == once


values = st.floats(-150, 150)


@settings(max_examples=60)
@given(
    st.lists(st.tuples(values, values), min_size=1, max_size=8),
    st.sampled_from([20.0, 100.0, 3000.0]),
    st.sampled_from([100.0, 2000.0, 100_000.0]),
)
def test_any_points_become_a_trajectory(points, velocity, acceleration):
    result = retimed(points, limits(2, velocity, acceleration))
    for point in points[:-1]:  # it passes all points within one step
        step = 2 * velocity * PERIOD + acceleration * PERIOD**2
        assert min(math.dist(point, place) for place in result) <= step


@pytest.mark.parametrize("seed", [279, 750960])
def test_an_arm_that_all_but_rests_on_its_way_goes_on(seed):
    random = np.random.default_rng(seed)
    waves = np.sin(np.outer(np.arange(30), (0.001, 0.0))) * (60, 30) + random.normal(0, 0.25, (30, 2))
    assert len(retimed([tuple(row) for row in waves.tolist()], limits(2, 300.0, 1500.0))) < 200


@settings(max_examples=40)
@given(st.floats(0.001, 1.5), st.floats(0.0, 1.0), st.floats(1e-6, 1.0), st.integers(0, 10**6))
def test_any_motion_with_noise_becomes_a_trajectory(rate, phase, noise, seed):
    random = np.random.default_rng(seed)
    waves = np.sin(np.outer(np.arange(30), (rate, rate * phase))) * (60, 30) + random.normal(0, noise, (30, 2))
    retimed([tuple(row) for row in waves.tolist()], limits(2, 300.0, 1500.0))


@pytest.mark.parametrize(
    ("points", "bounds", "words"),
    [
        ([(0.0,), (171.0,), (0.0,)], limits(), "outside the range"),
        ([(0.0,), (math.nan,)], limits(), "J1 is nan"),
        ([(0.0, 1.0, 2.0)], limits(2), "J3 is 2.0"),
        ([], limits(), "empty"),
        ([(0.0,), (100.0,)], limits(velocity=1e-3), "would take 100[0-9]{3} s"),
        ([(0.0,), (100.0,)], limits(acceleration=1e-9), "would take"),
    ],
)
def test_what_cannot_be_retimed(points, bounds, words):
    with pytest.raises(TrajectoryError, match=words) as caught:
        retime(points, bounds, PERIOD)
    i18n.use("ja")
    with pytest.raises(TrajectoryError) as japanese:
        retime(points, bounds, PERIOD)
    assert str(japanese.value) != str(caught.value)


@pytest.mark.parametrize(
    ("bounds", "kind", "period"),
    [(SPACE, "J", PERIOD), (limits(), "P", PERIOD), (limits(), "X", PERIOD), (None, "J", PERIOD), (limits(), "J", 0.0)],
)
def test_arguments_that_do_not_fit(bounds, kind, period):
    with pytest.raises(InvalidValue):
        retime([(0.0,), (1.0,)], bounds, period, kind)


# --- positions --------------------------------------------------------------------------------------------------------


def as_trans(point):
    """Return the T of a P, computed with numpy."""
    rx, ry, rz = np.radians(point[3:6])
    x = np.array([[1, 0, 0], [0, np.cos(rx), -np.sin(rx)], [0, np.sin(rx), np.cos(rx)]])
    y = np.array([[np.cos(ry), 0, np.sin(ry)], [0, 1, 0], [-np.sin(ry), 0, np.cos(ry)]])
    z = np.array([[np.cos(rz), -np.sin(rz), 0], [np.sin(rz), np.cos(rz), 0], [0, 0, 1]])
    turn = z @ y @ x
    return (*point[:3], *turn[:, 1].tolist(), *turn[:, 2].tolist(), *point[6:])


def moved(x=0.0, y=0.0, z=0.0, rx=0.0, ry=0.0, rz=0.0):
    return tuple(a + b for a, b in zip(HERE, (x, y, z, rx, ry, rz, 0.0), strict=True))


@pytest.mark.parametrize("kind", ["P", "T"])
@pytest.mark.parametrize(
    ("goal", "best"),
    [
        (moved(x=100.0), shortest(100, 1000, 5000)),
        (moved(x=300.0, y=-300.0, z=100.0), shortest(math.hypot(300, 300, 100), 1000, 5000)),
        (moved(rz=10.0), shortest(10, 200, 1000)),
        (moved(rx=100.0), shortest(100, 200, 1000)),
        (moved(x=10.0, rx=170.0), shortest(170, 200, 1000)),
    ],
)
def test_a_jump_in_space_takes_the_shortest_time(kind, goal, best):
    points = [HERE, goal]
    if kind == "T":
        points = list(map(as_trans, points))
    result = retimed(points, SPACE, kind)
    assert best - 1e-9 <= seconds(result) <= best * 1.08 + 2 * PERIOD
    assert off_the_path([row[:3] for row in result], [row[:3] for row in points]) < 1e-6


def test_a_step_over_180_degrees_is_no_jump():
    points = [moved(rz=0.5 * n if n < 1 else 0.5 * n - 360) for n in range(40)]
    result = retimed(points, SPACE, "P")
    assert seconds(result) < 39 * PERIOD + 0.2
    assert all(-180 < row[5] <= 180 for row in result)
    turned = [(row[5] - 180) % 360 for row in result[1:]]
    assert turned == sorted(turned)
    assert max(turned) < 20


def test_a_circle_is_kept():
    points = [(400 + 100 * math.cos(n * 0.08), 100 * math.sin(n * 0.08), *HERE[2:]) for n in range(300)]
    result = retimed(points, SPACE, "P")
    assert max(abs(math.hypot(row[0] - 400, row[1]) - 100) for row in result) < 1e-3
    # at sqrt(5000 * 100) = 707 mm/s the centripetal acceleration reaches the limit
    assert seconds(result) == pytest.approx(299 * 8 / math.sqrt(5000 * 100) + 707 / 5000, rel=0.03)


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(*[st.floats(-500, 500)] * 3, *[st.floats(-180, 180)] * 3, st.just(-1.0)), min_size=1, max_size=8
    ),
    st.sampled_from(["P", "T"]),
)
def test_any_poses_become_a_trajectory(points, kind):
    if kind == "T":
        points = list(map(as_trans, points))
    retimed(points, SPACE, kind)


@pytest.mark.parametrize("make", [lambda points: retime(points, SPACE, PERIOD, "P"),
                                  lambda points: resample(points, 0.004, PERIOD, "P")])  # fmt: skip
def test_a_figure_that_changes_on_the_way_is_refused(make):
    points = [HERE, HERE, (*moved(x=50.0)[:6], 4.0)]
    with pytest.raises(TrajectoryError, match="the figure changes from 5 to 4") as caught:
        make(points)
    assert caught.value.sample == 2


# --- resampling -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new"), [(0.001, 0.008), (0.004, 0.008), (0.008, 0.001), (0.01, 0.008), (0.0333, 0.008)]
)
def test_the_motion_is_the_same(old, new):
    def place(time):
        return 50 * math.sin(3 * time), 10 * time**2

    points = [place(n * old) for n in range(round(2 / old) + 1)]
    result = resample(points, old, new, "J")
    whole = (len(points) - 1) * old
    assert result[0] == points[0]
    assert result[-1] == points[-1]
    assert whole - 1e-9 <= (len(result) - 1) * new < whole + new
    stretch = whole / ((len(result) - 1) * new)
    for number, point in enumerate(result):
        assert point == pytest.approx(place(number * new * stretch), abs=old**2 * 0.5)


def test_resampling_of_little():
    assert resample([(1.0,)], 0.001, 0.008, "J") == [(1.0,)]
    assert resample([(1.0,), (2.0,)], 0.001, 0.008, "J") == [(1.0,), (2.0,)]
    assert resample([(1.0,), (2.0,), (4.0,)], 0.008, 0.008, "J") == [(1.0,), (2.0,), (4.0,)]
    assert resample([(1.0,), (2.0,)], 0.008, 0.004, "J") == [(1.0,), (1.5,), (2.0,)]
    for periods in ((0.0, 0.008), (0.008, 0.0), (math.nan, 0.008)):
        with pytest.raises(InvalidValue):
            resample([(1.0,), (2.0,)], *periods, "J")
    with pytest.raises(TrajectoryError, match="more than 1000000 samples"):
        resample([(1.0,)] * 3, 10.0, 1e-9, "J")


@given(
    st.lists(st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(-180, 180)), min_size=2, max_size=2),
    st.integers(2, 7),
)
def test_orientations_turn_the_shorter_way(angles, parts):
    """The tool rotates about one axis between two orientations."""
    points = [(0.0, 0.0, 0.0, *turn, 5.0) for turn in angles]
    turns = [np.array(as_trans(point)[3:9]) for point in points]
    assume(float(turns[0] @ turns[1]) > -0.5)
    result = resample(points, 0.008 * parts, 0.008, "P")
    assert len(result) == parts + 1
    rotations = [full(as_trans(point)) for point in result]
    angles_between = [turn_angle(a, b) for a, b in pairwise(rotations)]
    assert sum(angles_between) == pytest.approx(turn_angle(rotations[0], rotations[-1]), abs=1e-4)


@given(
    st.floats(-180, 180),
    st.sampled_from([-90.0, 90.0, 0.0, 45.0]) | st.floats(-1e-7, 1e-7).map(lambda off: 90.0 + off),
    st.floats(-180, 180),
)
def test_angles_are_exact_where_two_axes_are_one(rx, ry, rz):
    turn = of_angles(rx, ry, rz)
    angles = angles_of(turn)
    assert max(map(abs, rotvec_between(turn, of_angles(*angles)))) < 1e-6
    assert -180 < angles[0] <= 180
    assert -90 <= angles[1] <= 90
    assert -180 < angles[2] <= 180
    trans = as_trans((0.0, 0.0, 0.0, *angles, 5.0))
    assert vectors_of(turn) == pytest.approx(trans[3:9], abs=1e-7)
    assert max(map(abs, rotvec_between(turn, of_vectors(trans[3:6], trans[6:9])))) < 1e-5


def full(trans):
    orient, approach = np.array(trans[3:6]), np.array(trans[6:9])
    return np.stack([np.cross(orient, approach), orient, approach], axis=1)


def turn_angle(first, second) -> float:
    turn = second @ first.T
    sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    return math.degrees(math.atan2(sine, (np.trace(turn) - 1) / 2))
