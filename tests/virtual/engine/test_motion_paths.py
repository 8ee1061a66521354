from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable

import numpy as np
import pytest

from orinkit.arms import AxisModel, load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.values.poses import PassMark
from orinkit.virtual.engine.motion import cartesian_path as courses
from orinkit.virtual.engine.motion.joint_path import JointPath, TablePath, table_path
from orinkit.virtual.engine.motion.planner import (
    AT_TARGET,
    LONGEST,
    Motion,
    Rates,
    plan_arc,
    plan_curve,
    plan_line,
    plan_ptp,
    plan_rotation,
)

CYCLE = 0.008
VS050 = Kinematics(load_model("VS-050"))
COBOTTA = Kinematics(load_model("COBOTTA"))
HOME = (0.0, 20.0, 100.0, 0.0, 60.0, 0.0)
FLANGE = np.eye(4)
TOOL = np.array([[1.0, 0, 0, 10], [0, 1, 0, 0], [0, 0, 1, 80], [0, 0, 0, 1]])
UNREACHABLE = {
    hresult.SINGULAR_POINT_REFUSED,
    hresult.OUT_OF_WORKING_RANGE,
    hresult.TARGET_OUT_OF_RANGE,
    hresult.VALUE_OUT_OF_RANGE,
}
UNREACHABLE |= {
    first + n for first in (hresult.TARGET_OVER_SOFT_LIMIT_AXIS1, hresult.SOFT_LIMIT_OVER_AXIS1) for n in range(8)
}
U = np.linspace(0, 1, 201)


def tcp(joints, arm: Kinematics = VS050, tool=TOOL) -> np.ndarray:
    return arm.forward(np.array(joints)) @ tool


def moved(frame, *way) -> np.ndarray:
    frame = frame.copy()
    frame[:3, 3] += way
    return frame


def turned(frame, axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }
    frame = frame.copy()
    frame[:3, :3] = np.array(turn[axis]) @ frame[:3, :3]
    return frame


def angle(a, b) -> np.ndarray:
    """Return the angle between orientations, degrees."""
    return np.degrees(
        2 * np.arcsin(np.minimum(np.linalg.norm(a[..., :3, :3] - b[..., :3, :3], axis=(-2, -1)) / math.sqrt(8), 1))
    )


def commands(motion: Motion) -> np.ndarray:
    """Return the command of each cycle, with two cycles of rest at either end."""
    return motion.states_at(np.arange(-2, math.ceil(motion.duration / CYCLE) + 3) * CYCLE)[0]


def check_limits(motion: Motion, arm: Kinematics = VS050) -> None:
    velocity = np.diff(commands(motion), axis=0) / CYCLE
    acceleration = np.diff(velocity, axis=0) / CYCLE
    rates = motion.rates
    most = np.array([(axis.velocity, axis.acceleration) for axis in arm.model.axes]) * (
        rates.speed,
        max(rates.accel, rates.decel),
    )
    assert np.all(np.abs(velocity).max(0) <= most[:, 0] * (1 + 1e-6))
    assert np.all(np.abs(acceleration).max(0) <= most[:, 1] * (1 + 1e-6))


def code(call: Callable[[], object]) -> int:
    with pytest.raises(CallError) as caught:
        call()
    return caught.value.code


# --- courses ------------------------------------------------------------------------------------------------------


def test_a_line_is_straight_and_turns_evenly():
    start = tcp(HOME)
    end = turned(moved(start, 30, -40, 120), "y", 50)
    course = courses.line(start, end)
    frames = course.frames(U)
    assert (course.length, course.angle) == (pytest.approx(130), pytest.approx(50))
    assert frames[:, :3, 3] == pytest.approx(start[:3, 3] + U[:, None] * [30, -40, 120], abs=1e-9)
    assert angle(frames, start) == pytest.approx(50 * U, abs=1e-6)
    assert angle(frames, end) == pytest.approx(50 * (1 - U), abs=1e-6)
    assert np.array_equal(frames[-1], end)
    assert frames[0] == pytest.approx(start, abs=1e-12)


@pytest.mark.parametrize("degrees", [179.999, 180])
def test_a_line_may_turn_by_half_a_turn(degrees):
    start = tcp(HOME)
    end = turned(start, "z", degrees)
    frames = courses.line(start, end).frames(U)
    assert angle(frames, start) == pytest.approx(degrees * U, abs=1e-4)
    assert np.abs(angle(frames[1:], frames[:-1]) - degrees / 200).max() < 1e-4


@pytest.mark.parametrize(
    ("via", "end", "sweep"),
    [((50, 50, 0), (100, 0, 0), 180), ((50, -50, 0), (100, 0, 0), 180), ((50, 50, 0), (50, -50, 0), 270), ((0, 0, 100), (0, 80, 20), 233.13)],
)  # fmt: skip
def test_an_arc_is_a_circle_through_three_points(via, end, sweep):
    start = tcp(HOME)
    frames = (course := courses.arc(start, moved(start, *via), turned(moved(start, *end), "x", 40))).frames(U)
    positions = frames[:, :3, 3] - start[:3, 3]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    radius = steps[0] / 2 / math.sin(math.radians(sweep) / 400)
    assert course.length == pytest.approx(radius * math.radians(sweep), rel=1e-4)
    assert steps == pytest.approx(steps[0])
    fine = course.frames(np.linspace(0, 1, 100_001))[:, :3, 3] - start[:3, 3]
    assert np.linalg.norm(fine - via, axis=1).min() < 0.01
    assert positions[-1] == pytest.approx(np.array(end))
    normal = np.cross(via, end)
    assert positions @ normal == pytest.approx(0, abs=1e-6)
    assert angle(frames, start) == pytest.approx(40 * U, abs=1e-6)


def test_a_nearly_straight_arc_is_exact():
    start = tcp(HOME)
    course = courses.arc(start, moved(start, 50, 0.001, 0), moved(start, 100, 0, 0))
    positions = course.frames(U)[:, :3, 3] - start[:3, 3]
    assert positions[:, 0] == pytest.approx(100 * U, abs=1e-3)
    assert 0.00099 < positions[:, 1].max() < 0.00101
    assert course.length == pytest.approx(100)


@pytest.mark.parametrize(
    ("via", "end"),
    [
        ((50, 0, 0), (100, 0, 0)),
        ((-50, 0, 0), (100, 0, 0)),
        ((0, 0, 0), (100, 0, 0)),
        ((50, 50, 0), (50, 50, 0)),
        ((50, 50, 0), (0, 0, 0)),
        ((0, 0, 0), (0, 0, 0)),
        ((1e5, 1e-3, 0), (2e5, 0, 0)),
    ],
)
def test_an_arc_needs_three_points(via, end):
    start = tcp(HOME)
    assert code(lambda: courses.arc(start, moved(start, *via), moved(start, *end))) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.parametrize("degrees", [90, -90, 400, -720, 1e-3])
@pytest.mark.parametrize("keep", [True, False])
def test_a_rotation_turns_about_its_axis(degrees, keep):
    start = tcp(HOME)
    point = start[:3, 3] + (0, 30, 500)
    course = courses.rotation(start, np.array([0, 0, 7.0]), point, degrees, keep_orientation=keep)
    frames = course.frames(U)
    arms = frames[:, :2, 3] - point[:2]
    turns = np.radians(degrees) * U
    assert arms == pytest.approx(np.stack((30 * np.sin(turns), -30 * np.cos(turns)), 1), abs=1e-9)
    assert frames[:, 2, 3] == pytest.approx(start[2, 3])
    assert course.length == pytest.approx(30 * math.radians(abs(degrees)))
    wanted = np.array([start if keep else turned(start, "z", degrees * u) for u in U])
    assert frames[:, :3, :3] == pytest.approx(wanted[:, :3, :3], abs=1e-9)


@pytest.mark.parametrize(
    ("axis", "point", "degrees"),
    [
        ((0, 0, 0), (0, 0, 0), 90),
        ((math.nan, 0, 1), (0, 0, 0), 90),
        ((0, 0, math.inf), (0, 0, 0), 90),
        ((0, 0, 1e300), (0, 0, 0), 90),
        ((0, 0, 1), (0, math.nan, 0), 90),
        ((0, 0, 1), (0, 1e300, 0), 90),
        ((0, 0, 1), (0, 0, 0), math.nan),
        ((0, 0, 1), (0, 0, 0), 1e9),
    ],
)
def test_a_rotation_needs_an_axis(axis, point, degrees):
    make = lambda: courses.rotation(tcp(HOME), np.array(axis), np.array(point), degrees, keep_orientation=False)  # noqa: E731 - a name for one call
    assert code(make) == hresult.VALUE_OUT_OF_RANGE


def some_points(count: int = 5) -> list[np.ndarray]:
    start = tcp(HOME)
    return [
        turned(turned(moved(start, 25 * n, 30 * math.sin(n), 20 * math.cos(2 * n)), "x", 12 * n), "z", 25 * math.sin(n))
        for n in range(count)
    ]


def test_a_curve_passes_its_points_smoothly():
    points = some_points()
    course = courses.curve(points)
    u = np.linspace(0, 1, 20_001)
    frames = course.frames(u)
    for point in points:
        near = int(np.argmin(np.linalg.norm(frames[:, :3, 3] - point[:3, 3], axis=1)))
        assert np.linalg.norm(frames[near, :3, 3] - point[:3, 3]) < 0.01
        assert angle(frames[near], point) < 0.01
    assert np.array_equal(frames[-1], points[-1])
    assert frames[0] == pytest.approx(points[0], abs=1e-9)
    rates = np.diff(frames[:, :3, :], axis=0) / u[1]
    changes = np.diff(rates, axis=0) / u[1]
    assert np.abs(np.diff(changes, axis=0)).max() < 0.01 * np.abs(changes).max()  # no jump of the second derivative
    assert frames[:, :3, :3] @ np.swapaxes(frames[:, :3, :3], 1, 2) == pytest.approx(
        np.broadcast_to(np.eye(3), (20_001, 3, 3))
    )
    assert np.linalg.norm(rates[:, :, 3], axis=1).max() <= course.greatest_rate * 1.01
    assert course.length == pytest.approx(np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1).sum(), rel=1e-3)


def test_a_curve_of_points_on_a_line_is_the_line():
    start = tcp(HOME)
    course = courses.curve([start, moved(start, 10, 0, 0), moved(start, 70, 0, 0), moved(start, 100, 0, 0)])
    assert course.frames(U)[:, :3, 3] == pytest.approx(start[:3, 3] + U[:, None] * [100, 0, 0], abs=1e-9)
    assert course.greatest_rate == pytest.approx(100)


def test_a_point_twice_counts_once():
    points = some_points()
    doubled = [point for point in points for _ in range(2)]
    assert courses.curve(doubled).frames(U) == pytest.approx(courses.curve(points).frames(U), abs=1e-9)
    still = courses.curve([points[0]] * 3)
    assert (still.length, still.angle) == (0, 0)


@pytest.mark.parametrize("points", [[], [np.eye(4)] * (courses.LONGEST_CURVE + 1)])
def test_a_curve_has_some_points(points):
    assert code(lambda: courses.curve(points)) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, 1e7])
@pytest.mark.parametrize("place", [(0, 3), (1, 1)])
def test_frames_out_of_reach_of_any_arm(value, place):
    frame, start = tcp(HOME), tcp(HOME)
    frame[place] = value
    other = moved(start, 10, 10, 0)
    for make in (
        lambda: courses.line(start, frame),
        lambda: courses.arc(start, frame, other),
        lambda: courses.arc(start, other, frame),
        lambda: courses.curve([start, other, frame]),
    ):
        assert code(make) == hresult.TARGET_OUT_OF_RANGE


# --- paths --------------------------------------------------------------------------------------------------------


def test_a_joint_path_is_straight_and_exact():
    path = JointPath((0.1, 20, -30), (0.3, -7.123456789, 1e-9))
    assert path.at(-1) == path.at(0) == (0.1, 20, -30)
    assert path.at(1) == path.at(2) == (0.3, -7.123456789, 1e-9)
    joints, first, second = path.sampled(U)
    assert np.array([path.at(u) for u in U]) == pytest.approx(joints, abs=1e-12)
    assert tuple(joints[-1]) == path.end
    assert first == pytest.approx(np.broadcast_to(np.array(path.end) - path.start, first.shape))
    assert not second.any()


def test_a_table_follows_a_smooth_function():
    def function(u):
        return np.stack((np.sin(3 * u), np.cos(2 * u) * 50, u**3), 1)

    path = TablePath(function(np.linspace(0, 1, 65)))
    assert np.abs(path.sampled(U)[0] - function(U)).max() < 1e-5
    assert path.sampled(U)[1][:, 0] == pytest.approx(3 * np.cos(3 * U), abs=1e-3)
    assert path.sampled(path.probes)[2][:, 0] == pytest.approx(-9 * np.sin(3 * path.probes), abs=0.05)
    assert np.array([path.at(u) for u in U]) == pytest.approx(path.sampled(U)[0], abs=1e-9)
    assert path.at(0) == path.start == tuple(function(np.array([0.0]))[0])
    assert path.at(1) == path.end == tuple(function(np.array([1.0]))[0])


@pytest.mark.parametrize("arm", [VS050, COBOTTA], ids=["VS-050", "COBOTTA"])
def test_the_joints_move_the_tool_along_the_cartesian_path(arm):
    start = tuple(arm.model.home)
    course = courses.line(tcp(start, arm), turned(moved(tcp(start, arm), 40, 60, 30), "z", 30))
    path = table_path(arm, course, TOOL, start)
    u = np.linspace(0, 1, 3001)
    made = tcp(path.sampled(u)[0], arm)
    wanted = course.frames(u)
    assert np.linalg.norm(made[:, :3, 3] - wanted[:, :3, 3], axis=1).max() < 3e-3
    assert angle(made, wanted).max() < 3e-4
    assert path.start == start
    assert tcp(path.end, arm) == pytest.approx(wanted[-1], abs=1e-6)


# --- plans --------------------------------------------------------------------------------------------------------


def some_joints(dice: random.Random, arm: Kinematics) -> tuple[float, ...]:
    return tuple(dice.uniform(axis.lower, axis.upper) for axis in arm.model.axes)


def near(joints, dice: random.Random, arm: Kinematics, spread: float = 20) -> tuple[float, ...]:
    return tuple(
        min(max(dice.gauss(joint, spread), axis.lower), axis.upper)
        for joint, axis in zip(joints, arm.model.axes, strict=True)
    )


def some_rates(dice: random.Random) -> Rates:
    if dice.random() < 0.3:
        return Rates()
    return Rates(dice.uniform(0.01, 1), dice.uniform(0.01, 1), dice.uniform(0.01, 1))


def some_motions(plan, count: int, arm: Kinematics, seed: int) -> list[Motion]:
    """Return the given number of motions between random poses, without those that the arm cannot execute."""
    dice = random.Random(seed)
    motions = []
    for _ in range(count * 6):
        start = some_joints(dice, arm)
        try:
            motions.append(plan(arm, start, dice, some_rates(dice)))
        except CallError as error:
            if error.code not in UNREACHABLE:
                raise
        if len(motions) == count:
            return motions
    raise AssertionError(f"only {len(motions)} of {count * 6} were possible")


def any_ptp(arm, start, dice, rates):
    return plan_ptp(arm, start, some_joints(dice, arm), rates)


def any_line(arm, start, dice, rates):
    return plan_line(arm, start, tcp(near(start, dice, arm), arm), TOOL, rates)


def any_arc(arm, start, dice, rates):
    via, end = (tcp(near(start, dice, arm, 12), arm) for _ in range(2))
    return plan_arc(arm, start, via, end, TOOL, rates)


def any_curve(arm, start, dice, rates):
    points = [start]
    for _ in range(dice.randint(2, 5)):
        points.append(near(points[-1], dice, arm, 8))
    return plan_curve(arm, start, [tcp(point, arm) for point in points[1:]], TOOL, rates)


def any_rotation(arm, start, dice, rates):
    axis = np.array([dice.gauss(0, 1) for _ in range(3)])
    point = tcp(start, arm)[:3, 3] + [dice.uniform(-80, 80) for _ in range(3)]
    return plan_rotation(
        arm, start, axis, point, dice.uniform(-60, 60), TOOL, rates, keep_orientation=dice.random() < 0.5
    )


def distance_from_line(positions: np.ndarray) -> float:
    way = positions[-1] - positions[0]
    return float(np.linalg.norm(np.cross(positions - positions[0], way / np.linalg.norm(way)), axis=1).max())


@pytest.mark.parametrize("plan", [any_ptp, any_line, any_arc, any_curve, any_rotation])
@pytest.mark.parametrize(
    ("arm", "count"),
    [(VS050, 80), (COBOTTA, 5), pytest.param(VS050, 1000, marks=pytest.mark.soak)],
    ids=["VS-050", "COBOTTA", "VS-050-many"],
)
def test_every_joint_stays_within_its_limits(plan, arm, count):
    """Random moves of each interpolation (1,000 in ``make soak``); velocity and acceleration are differences of the commands."""
    for motion in some_motions(plan, count, arm, seed=7):
        check_limits(motion, arm)
        joints = commands(motion)
        assert tuple(joints[0]) == motion.start
        assert tuple(joints[-1]) == motion.end == motion.joints_at(motion.duration)
        assert len(joints) - 5 == math.ceil(motion.duration / CYCLE)
        if plan is any_line:
            assert distance_from_line(tcp(joints, arm)[:, :3, 3]) < 0.01


def test_the_end_of_a_path_is_its_target():
    dice = random.Random(3)
    reached = 0
    for _ in range(100):
        start = some_joints(dice, VS050)
        end = tcp(near(start, dice, VS050))
        try:
            motion = plan_line(VS050, start, end, TOOL, Rates())
        except CallError:
            continue
        reached += 1
        assert tcp(motion.joints_at(motion.duration)) == pytest.approx(end, abs=1e-8)
    assert reached > 40


def test_single_values_and_arrays_are_the_same():
    for motion in (
        plan_ptp(VS050, HOME, (40, 50, 60, 70, 80, 90), Rates()),
        plan_line(VS050, HOME, moved(tcp(HOME), 0, 80, 50), TOOL, Rates()),
    ):
        times = np.arange(-1, motion.duration / CYCLE + 2) * CYCLE
        assert np.array([motion.joints_at(time) for time in times]) == pytest.approx(
            motion.states_at(times)[0], abs=1e-9
        )


def test_the_derivatives_are_those_of_the_joints():
    motion = plan_line(VS050, HOME, turned(moved(tcp(HOME), 0, 80, 50), "z", 60), TOOL, Rates())
    times = np.linspace(0, motion.duration, 20_001)
    joints, velocity, acceleration = motion.states_at(times)
    assert np.gradient(joints, times, axis=0)[1:-1] == pytest.approx(velocity[1:-1], abs=0.1)
    assert np.gradient(velocity, times, axis=0)[1:-1] == pytest.approx(acceleration[1:-1], abs=20)


def test_a_point_to_point_motion_is_as_fast_as_its_slowest_joint():
    motion = plan_ptp(VS050, HOME, (150, *HOME[1:4], 75, 0), Rates())
    _, velocity, acceleration = motion.states_at(np.linspace(0, motion.duration, 5001))
    assert np.abs(velocity).max(0) == pytest.approx([425, 0, 0, 0, 42.5, 0])
    assert np.abs(acceleration).max(0) == pytest.approx([2125, 0, 0, 0, 212.5, 0])
    slow = plan_ptp(VS050, HOME, (150, *HOME[1:4], 75, 0), Rates(0.1, 0.5, 0.25))
    _, velocity, acceleration = slow.states_at(np.linspace(0, slow.duration, 5001))
    assert velocity[:, 0].max() == pytest.approx(42.5)
    assert acceleration[:, 0].max() == pytest.approx(1062.5, rel=0.01)
    assert acceleration[:, 0].min() == pytest.approx(-531.25, rel=0.01)


def test_a_line_is_as_fast_as_the_model_allows():
    model = VS050.model
    motion = plan_line(VS050, (-30, *HOME[1:]), moved(tcp((-30, *HOME[1:])), 0, 200, 0), TOOL, Rates(0.1, 0.1, 0.05))
    joints = motion.states_at(np.arange(0, motion.duration, 1e-3))[0]
    speeds = np.linalg.norm(np.diff(tcp(joints)[:, :3, 3], axis=0), axis=1) / 1e-3
    assert speeds.max() == pytest.approx(model.path_speed * 0.1, rel=1e-4)
    assert np.diff(speeds).max() / 1e-3 == pytest.approx(model.path_acceleration * 0.1, rel=0.01)
    assert np.diff(speeds).min() / 1e-3 == pytest.approx(-model.path_acceleration * 0.05, rel=0.01)
    assert motion.length == pytest.approx(200)


def test_a_turn_on_the_spot_is_as_fast_as_the_model_allows():
    motion = plan_line(VS050, HOME, turned(tcp(HOME), "z", 40), TOOL, Rates(0.05, 0.05, 0.05))
    frames = tcp(motion.states_at(np.arange(0, motion.duration, 1e-3))[0])
    assert angle(frames[1:], frames[:-1]).max() / 1e-3 == pytest.approx(VS050.model.path_rotation * 0.05, rel=1e-3)
    assert motion.length == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("plan", [lambda rates: plan_ptp(VS050, HOME, (50, *HOME[1:]), rates),
                                  lambda rates: plan_line(VS050, HOME, moved(tcp(HOME), 0, 0, 90), TOOL, rates)])  # fmt: skip
def test_a_motion_takes_the_time_it_is_given(plan):
    free = plan(Rates())
    assert plan(Rates(time=7.5)).duration == pytest.approx(7.5)
    assert plan(Rates(time=free.duration / 2)).duration == free.duration
    assert code(lambda: plan(Rates(time=LONGEST * 1.01))) == hresult.VALUE_OUT_OF_RANGE
    assert code(lambda: plan(Rates(time=1e300))) == hresult.VALUE_OUT_OF_RANGE
    assert code(lambda: plan(Rates(speed=1e-9))) == hresult.VALUE_OUT_OF_RANGE
    assert code(lambda: plan(Rates(speed=5e-324, accel=5e-324, decel=5e-324))) == hresult.VALUE_OUT_OF_RANGE
    assert code(lambda: plan(Rates(decel=1e-300))) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.parametrize("wrong", [0, -0.1, 1.01, math.nan, math.inf])
@pytest.mark.parametrize("name", ["speed", "accel", "decel"])
def test_rates_are_fractions(name, wrong):
    with pytest.raises(ValueError, match="speed, accel and decel"):
        Rates(**{name: wrong})


@pytest.mark.parametrize("wrong", [0, -1, math.nan, math.inf])
def test_a_time_is_above_0(wrong):
    with pytest.raises(ValueError, match="time"):
        Rates(time=wrong)


def test_motions_to_where_the_arm_is():
    here = tcp(HOME)
    for motion in (
        plan_ptp(VS050, HOME, HOME, Rates(time=5)),
        plan_line(VS050, HOME, here, TOOL, Rates()),
        plan_curve(VS050, HOME, [here, here], TOOL, Rates()),
        plan_rotation(VS050, HOME, np.array([0, 0, 1.0]), here[:3, 3], 0, TOOL, Rates()),
    ):
        assert (motion.duration, motion.pass_time, motion.joints_at(0), motion.end) == (0, 0, HOME, HOME)
        assert motion.joints_at(1) == HOME


@pytest.mark.parametrize("way", [1e-6, 1e-3])
def test_very_short_motions(way):
    for motion in (
        plan_ptp(VS050, HOME, (way, *HOME[1:]), Rates()),
        plan_line(VS050, HOME, moved(tcp(HOME), way, 0, 0), TOOL, Rates()),
    ):
        check_limits(motion)
        assert 0.04 < motion.duration < 0.2


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_a_target_beyond_a_soft_limit(axis, side):
    limit = getattr(VS050.model.axes[axis], side)
    end = [0.0] * 6
    end[axis] = limit
    assert plan_ptp(VS050, HOME, end, Rates()).end == tuple(end)
    for beyond in (limit * 1.001, limit * 1e300, math.nan):
        end[axis] = beyond
        assert code(lambda: plan_ptp(VS050, HOME, end, Rates())) == hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + axis


def narrowed(number: int, lower: float, upper: float) -> Kinematics:
    axes = list(VS050.model.axes)
    axes[number] = dataclasses.replace(axes[number], lower=lower, upper=upper)
    return Kinematics(dataclasses.replace(VS050.model, axes=tuple(axes)))


def test_a_path_beyond_a_soft_limit():
    start = (-40.0, *HOME[1:])
    end = tcp((40.0, *HOME[1:]))  # a chord: the elbow bends along the path
    motion = plan_line(VS050, start, end, TOOL, Rates())
    elbow = commands(motion)[:, 2]
    assert elbow.max() > max(elbow[0], elbow[-1]) + 2
    arm = narrowed(2, -120, elbow[0] + 1)
    assert code(lambda: plan_line(arm, start, end, TOOL, Rates())) == hresult.SOFT_LIMIT_OVER_AXIS1 + 2
    arm = narrowed(0, -170, 39)
    assert code(lambda: plan_line(arm, start, end, TOOL, Rates())) == hresult.TARGET_OVER_SOFT_LIMIT_AXIS1


def test_an_arm_beyond_its_limits_can_come_back():
    arm = narrowed(0, -10, 170)
    start, end = (-20.0, *HOME[1:]), (5.0, *HOME[1:])
    assert plan_ptp(arm, start, end, Rates()).end == end
    assert plan_line(arm, start, tcp(end), TOOL, Rates()).end == pytest.approx(end, abs=1e-6)


def test_beyond_reach():
    here = tcp(HOME)
    for frame in (moved(here, 2000, 0, 0), moved(here, 1e5, 0, 0)):
        assert code(lambda: plan_line(VS050, HOME, frame, TOOL, Rates())) == hresult.TARGET_OUT_OF_RANGE  # noqa: B023 - called in this iteration
    via, end = moved(here, 1000, 1, 0), moved(here, 0, 20, 0)
    assert code(lambda: plan_arc(VS050, HOME, via, end, TOOL, Rates())) == hresult.OUT_OF_WORKING_RANGE


@pytest.mark.parametrize("aside", [0.01, 0.1, 1])
def test_too_near_a_singular_point(aside):
    wrist = (0.0, 45.0, 60.0, 0.0, 20.0, 0.0)  # joint 5 to the other side, past 0 by a little
    end = turned(tcp((*wrist[:4], -20.0, 0.0), tool=FLANGE), "x", aside)
    assert code(lambda: plan_line(VS050, wrist, end, FLANGE, Rates())) == hresult.SINGULAR_POINT_REFUSED
    shoulder = (0.0, 20.0, 120.0, 0.0, 40.0, 0.0)  # the wrist to the other side of the axis of joint 1
    end = tcp(shoulder, tool=FLANGE)
    end[:2, 3] = -end[0, 3], aside
    assert code(lambda: plan_line(VS050, shoulder, end, FLANGE, Rates())) == hresult.SINGULAR_POINT_REFUSED


def test_straight_through_a_singular_point_of_the_wrist():
    start, end = (0.0, 45.0, 60.0, 0.0, 20.0, 0.0), (0.0, 45.0, 60.0, 0.0, -20.0, 0.0)
    motion = plan_line(VS050, start, tcp(end), TOOL, Rates())
    assert motion.end == pytest.approx(end, abs=1e-6)
    check_limits(motion)


def test_near_a_singular_point_the_path_is_slower():
    start, end = (0.0, 45.0, 90.0, 30.0, 4.0, -30.0), (0.0, 45.0, 90.0, -30.0, 4.0, 30.0)
    end_frame = tcp(end, tool=FLANGE)
    motion = plan_line(VS050, start, end_frame, FLANGE, Rates())
    assert (
        motion.duration
        > 2
        * plan_line(
            VS050, HOME, moved(tcp(HOME), *(end_frame - tcp(start, tool=FLANGE))[:3, 3]), TOOL, Rates()
        ).duration
    )
    check_limits(motion)
    assert distance_from_line(VS050.forward(commands(motion))[:, :3, 3]) < 0.01


def eight_axes() -> Kinematics:
    extra = (AxisModel(-500, 500, 100, 400, linear=True), AxisModel(-90, 90, 30, 60))
    model = VS050.model
    return Kinematics(dataclasses.replace(model, axes=(*model.axes, *extra), home=(*model.home, 0, 0)))


def test_extra_axes_run_in_proportion():
    arm = eight_axes()
    start = (*HOME, 10.0, -20.0)
    frame = tcp(HOME)
    motions = (
        plan_ptp(arm, start, (10, *HOME[1:], 310, 20), Rates()),
        plan_line(arm, start, moved(frame, 0, 50, 0), TOOL, Rates(), AT_TARGET, (310, 20)),
        plan_arc(arm, start, moved(frame, 20, 20, 0), moved(frame, 0, 50, 0), TOOL, Rates(), AT_TARGET, (310, 20)),
        plan_line(arm, start, frame, TOOL, Rates(), AT_TARGET, (310, 20)),
    )
    for motion in motions:
        joints = commands(motion)
        check_limits(motion, arm)
        assert motion.end[6:] == (310, 20)
        assert (joints[:, 6] - 10) / 300 == pytest.approx((joints[:, 7] + 20) / 40, abs=1e-9)
    assert motions[3].end[:6] == pytest.approx(HOME)
    stay = plan_line(arm, start, moved(frame, 0, 50, 0), TOOL, Rates())
    assert stay.end[6:] == start[6:]
    assert (
        code(lambda: plan_line(arm, start, frame, TOOL, Rates(), AT_TARGET, (501, 0)))
        == hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 6
    )
    assert (
        code(lambda: plan_line(arm, start, frame, TOOL, Rates(), AT_TARGET, (0, math.nan)))
        == hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 7
    )


def test_pass_marks_determine_when_the_next_motion_may_begin():
    end = moved(tcp(HOME), 0, 100, 0)
    motions = {
        mark: plan_line(VS050, HOME, end, TOOL, Rates(0.2), mark)
        for mark in (AT_TARGET, PassMark("E"), PassMark("P"), PassMark("n", 10), PassMark("n", 0.01), PassMark("n", 99))
    }
    for mark, motion in motions.items():
        assert (motion.mark, motion.duration) == (mark, motions[AT_TARGET].duration)
        remaining = np.linalg.norm(tcp(motion.joints_at(motion.pass_time))[:3, 3] - end[:3, 3])
        if mark.mode in "0E":
            assert motion.pass_time == motion.duration
        elif mark.mode == "P":
            assert motion.pass_time == motion.profile.slowing
            assert 0 < remaining < 50
        elif mark.radius == 99:
            assert motion.pass_time == pytest.approx(motion.duration / 2)
        else:
            assert mark.radius - 0.5 < remaining <= mark.radius
    ptp = plan_ptp(VS050, HOME, (60, *HOME[1:]), Rates(), PassMark("n", 25), TOOL)
    assert 20 < np.linalg.norm((tcp(ptp.end) - tcp(ptp.joints_at(ptp.pass_time)))[:3, 3]) <= 25


def test_texts_are_in_both_languages():
    details = {}
    for name in ("en", "ja"):
        i18n.use(name)
        with pytest.raises(CallError) as caught:
            plan_ptp(VS050, HOME, (200, *HOME[1:]), Rates())
        details[name] = caught.value.detail
    assert "200 deg is outside the soft limits, -170 to 170 deg" in details["en"]
    assert "ソフトリミット" in details["ja"]
