from __future__ import annotations

import math
import random
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import pytest
import ruckig
from hypothesis import given
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, MissingExtra
from orinkit.streaming.planning.joint_planner import JointPlanner
from orinkit.streaming.planning.limits import Limits

Joints = tuple[float, ...]

ROUNDING = 1e-9
LIMITS = {name: Limits.of_model(load_model(name)) for name in ("VS-050", "COBOTTA")}
HOMES = {name: tuple(map(float, load_model(name).home)) for name in LIMITS}
PERIODS = (0.008, 0.004, 0.001)
VS050, HOME = LIMITS["VS-050"], HOMES["VS-050"]

every_arm = pytest.mark.parametrize("arm", list(LIMITS))
every_period = pytest.mark.parametrize("period", PERIODS)


@dataclass
class Stream:
    """A planner each of whose commands is checked against the limits for which the controller stops an arm."""

    limits: Limits
    period: float
    start: Joints
    planner: JointPlanner = field(init=False)
    commands: list[Joints] = field(init=False)

    def __post_init__(self) -> None:
        self.planner = JointPlanner(self.limits, self.period, self.start)
        self.commands = [self.planner.command] * 3

    def __call__(self, method: str, values: Sequence[float] | None = None) -> Joints:
        call = getattr(self.planner, method)
        command: Joints = call() if values is None else call(values)
        assert command is self.planner.command
        (before, now), period = self.commands[-2:], self.period
        self.commands.append(command)
        for axis, (a, b, c) in enumerate(zip(before, now, command, strict=True)):
            assert self.limits.lower[axis] <= c <= self.limits.upper[axis]
            assert abs(c - b) <= self.limits.velocity[axis] * period * (1 + ROUNDING)
            assert abs((c - b) - (b - a)) <= self.limits.acceleration[axis] * period**2 * (1 + ROUNDING)
        return command

    def until_rest(self, method: str, values: Sequence[float] | None = None, most: float = 10.0) -> int:
        """Repeat a call until standstill; return the number of commands."""
        for count in range(int(most / self.period)):
            self(method, values)
            if self.planner.at_rest:
                return count
        raise AssertionError(f"still moving after {most} s")

    def hardest(self, last: int | None = None) -> float:
        """Return the greatest jerk of the last commands, as a fraction of the limit."""
        rows = self.commands if last is None else self.commands[-last:]
        return max(
            abs((d - c) - 2 * (c - b) + (b - a)) / (self.limits.jerk[axis] * self.period**3)
            for four in zip(rows, rows[1:], rows[2:], rows[3:], strict=False)
            for axis, (a, b, c, d) in enumerate(zip(*four, strict=True))
        )


def stream(arm: str = "VS-050", period: float = 0.008, start: Joints | None = None) -> Stream:
    return Stream(LIMITS[arm], period, start or HOMES[arm])


def bits(values: Sequence[float]) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


def duration(limits: Limits, start: Joints, goal: Joints) -> float:
    """Return the duration that ruckig itself needs between two standstills."""
    given = ruckig.InputParameter(len(start))
    given.current_position, given.target_position = start, goal
    given.max_velocity, given.max_acceleration, given.max_jerk = limits.velocity, limits.acceleration, limits.jerk
    trajectory = ruckig.Trajectory(len(start))
    ruckig.Ruckig(len(start)).calculate(given, trajectory)
    return float(trajectory.duration)


def trapezoid(limits: Limits, period: float, axis: int, start: Joints, way: float) -> list[Joints]:
    """Return the fastest set-points along one axis: the greatest acceleration, the greatest velocity, and back."""
    change = limits.acceleration[axis] * period**2
    most = int(limits.velocity[axis] * period / change)
    rising = [change * step for step in range(1, most + 1)]
    level = max(int((abs(way) - 2 * sum(rising)) / (change * most)), 0)
    points, at = [], start[axis]
    for step in [*rising, *[change * most] * level, *reversed(rising), 0.0, 0.0]:
        at += math.copysign(step, way)
        points.append((*start[:axis], at, *start[axis + 1 :]))
    return points


# --- follow -----------------------------------------------------------------------------------------------------------


@every_arm
@every_period
@pytest.mark.parametrize("seed", range(4))
def test_follow_reaches_a_target_exactly_and_as_soon_as_ruckig_would(arm: str, period: float, seed: int) -> None:
    draw = random.Random(seed)
    limits = LIMITS[arm]
    goal = tuple(draw.uniform(low, high) for low, high in zip(limits.lower, limits.upper, strict=True))
    arms = stream(arm, period)
    count = arms.until_rest("goto", goal)
    assert bits(arms.planner.command) == bits(goal)
    assert abs(count * period - duration(limits, HOMES[arm], goal)) <= 5 * period
    assert arms.hardest() <= 1.001


def test_follow_from_rest_goes_straight_in_joint_space() -> None:
    arms = stream()
    goal = (100.0, -30.0, 20.0, 50.0, -60.0, 200.0)
    arms.until_rest("goto", goal)
    for command in arms.commands:
        parts = [(c - a) / (b - a) for a, b, c in zip(HOME, goal, command, strict=True)]
        assert max(parts) - min(parts) < 1e-6


def test_follow_is_at_rest_after_the_last_command_was_repeated() -> None:
    arms = stream()
    assert arms.planner.at_rest
    goal = (1.0, *HOME[1:])
    while arms("goto", goal) != goal:
        assert not arms.planner.at_rest
    assert not arms.planner.at_rest
    arms("goto", goal)
    assert arms.planner.at_rest
    arms("goto", HOME)
    assert not arms.planner.at_rest


@every_period
def test_a_target_that_moves_slowly_is_followed_smoothly(period: float) -> None:
    arms = stream(period=period)
    for step in range(int(3 / period)):
        arms("goto", [joint + 20 * math.sin(2 * step * period) for joint in HOME])
    assert arms.hardest() <= 1.001
    assert max(abs(a - b) for a, b in zip(arms.planner.command, HOME, strict=True)) < 21


@every_arm
@every_period
def test_an_oscillation_that_no_arm_can_follow(arm: str, period: float) -> None:
    """10 Hz with an amplitude of 30 deg has 1900 deg/s."""
    for method in ("goto", "track"):
        arms = stream(arm, period)
        for step in range(int(1 / period)):
            arms(method, [joint + 30 * math.sin(20 * math.pi * step * period) for joint in HOMES[arm]])


@every_arm
@every_period
@pytest.mark.parametrize("method", ["goto", "track"])
@pytest.mark.parametrize("beyond", [1.0, 1e6, 1e300, sys.float_info.max])
def test_a_target_beyond_the_range_is_the_end_of_the_range(arm: str, period: float, method: str, beyond: float) -> None:
    arms = stream(arm, period)
    limits = LIMITS[arm]
    arms.until_rest(method, [high + beyond for high in limits.upper])
    assert arms.planner.command == limits.upper
    arms.until_rest(method, [low - beyond for low in limits.lower])
    assert arms.planner.command == limits.lower


@every_arm
@every_period
@pytest.mark.parametrize("method", ["goto", "track"])
@pytest.mark.parametrize("value", [0.0, -0.0, 5e-324, -5e-324, 1e-310, 2.2250738585072014e-308, 1e-13])
def test_the_smallest_numbers(arm: str, period: float, method: str, value: float) -> None:
    goal = [20.0 if low > 0 else value for low in LIMITS[arm].lower]
    arms = stream(arm, period)
    arms.until_rest(method, goal)
    assert arms.planner.command == tuple(goal)


def test_changes_that_are_next_to_nothing() -> None:
    arms = stream()
    for step in range(400):
        goal = tuple(joint + 10.0 ** -(step % 16) * (-1) ** step for joint in HOME)
        arms("goto", goal)
        if step % 40 == 0:
            arms.until_rest("goto", goal)
            assert bits(arms.planner.command) == bits(goal)


@every_arm
@every_period
def test_the_end_of_the_range_while_moving_fast_towards_it(arm: str, period: float) -> None:
    """The target becomes the end of the range, when no smooth motion can reach it without passing it."""
    limits = LIMITS[arm]
    for axis, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
        start = (*HOMES[arm][:axis], low, *HOMES[arm][axis + 1 :])
        arms = Stream(limits, period, start)
        points = trapezoid(limits, period, axis, start, high - low)
        slowing = len(points) - int(limits.velocity[axis] / limits.acceleration[axis] / period) - 4
        for point in points[:slowing]:
            assert arms("track", point) == point
        end = (*start[:axis], high, *start[axis + 1 :])
        arms.until_rest("goto", end)
        assert arms.planner.command == end


# --- stop -------------------------------------------------------------------------------------------------------------


@every_arm
@every_period
def test_stop_in_the_middle_of_a_motion(arm: str, period: float) -> None:
    arms = stream(arm, period)
    limits = LIMITS[arm]
    for _ in range(int(0.3 / period)):
        arms("goto", limits.upper)
    count = arms.until_rest("stop")
    longest = max(v / a + a / j for v, a, j in zip(limits.velocity, limits.acceleration, limits.jerk, strict=True))
    assert count * period <= longest * 1.01 + 5 * period
    assert arms.hardest() <= 1.001
    rest = arms.planner.command
    for _ in range(20):
        assert arms("stop") is not None
        assert bits(arms.planner.command) == bits(rest)


def test_stop_at_rest_repeats_the_last_command() -> None:
    arms = stream()
    for _ in range(5):
        assert arms("stop") == HOME
        assert arms.planner.at_rest


@every_arm
@every_period
@pytest.mark.parametrize("late", range(6))
def test_stop_right_before_the_end_of_the_range(arm: str, period: float, late: int) -> None:
    """The stop is smooth if the range has room for it; otherwise it uses the full acceleration."""
    limits = LIMITS[arm]
    axis = 2
    low, high = limits.lower[axis], limits.upper[axis]
    start = (*HOMES[arm][:axis], low, *HOMES[arm][axis + 1 :])
    arms = Stream(limits, period, start)
    seconds = limits.velocity[axis] / limits.acceleration[axis]
    points = trapezoid(limits, period, axis, start, high - low)
    gap = high - points[-1][axis]  # less than one step of full velocity
    last = len(points) - int(seconds / period) - 3 - int(late * 0.01 / period)
    for point in points[:last]:
        arms("track", point)
    arms.until_rest("stop", most=2)
    assert arms.planner.command[axis] <= high
    if late == 0:
        assert arms.planner.command[axis] >= high - gap - limits.velocity[axis] * (period + 0.05)
    if late == 5:
        assert arms.hardest(int(0.15 / period)) <= 1.001


def test_a_motion_that_was_braked_hard_does_not_swing_back() -> None:
    """The set-points end with the greatest deceleration; the stop from there does not reverse."""
    points = trapezoid(VS050, 0.008, 0, HOME, 60.0)
    arms = stream()
    for point in points[:-6]:
        assert arms("track", point) == point
    arms.until_rest("stop")
    way = [command[0] for command in arms.commands]
    assert way == sorted(way)


# --- take -------------------------------------------------------------------------------------------------------------


@every_arm
@every_period
@pytest.mark.parametrize("part", [1.0, 0.3])
def test_take_passes_on_what_is_within_the_limits(arm: str, period: float, part: float) -> None:
    """Set-points at full acceleration and full velocity are passed on bit for bit."""
    limits = LIMITS[arm]
    for axis, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
        start = (*HOMES[arm][:axis], low + 0.01, *HOMES[arm][axis + 1 :])
        arms = Stream(limits, period, start)
        scaled = limits.scaled(velocity=part, acceleration=part)
        for point in trapezoid(scaled, period, axis, start, 0.9 * (high - low)):
            arms.planner.check(point)
            assert bits(arms("track", point)) == bits(point)
        assert arms.planner.at_rest


@every_arm
@every_period
def test_take_passes_on_smooth_set_points_of_all_axes(arm: str, period: float) -> None:
    limits = LIMITS[arm]
    arms = stream(arm, period)
    for step in range(int(2 / period)):
        swing = 0.5 * (1 - math.cos(3 * step * period))
        point = tuple(
            joint + 0.1 * velocity * swing for joint, velocity in zip(HOMES[arm], limits.velocity, strict=True)
        )
        assert bits(arms("track", point)) == bits(point)


def test_take_accepts_any_kind_of_number() -> None:
    arms = stream()
    assert arms("track", [0, 45, 90, 0, 45, 0]) == HOME
    assert all(type(value) is float for value in arms.planner.command)


def test_a_negative_zero_is_passed_on_as_it_is() -> None:
    arms = stream()
    point = (-0.0, *HOME[1:])
    assert bits(arms("track", point)) == bits(point)


@every_arm
@every_period
@pytest.mark.parametrize("jump", [0.001, 0.3, 5.0, -30.0])
def test_catching_up_after_a_jump(arm: str, period: float, jump: float) -> None:
    arms = stream(arm, period)
    home = HOMES[arm]
    for _ in range(5):
        assert arms("track", home) == home
    point = (home[0] + jump, *home[1:])
    goal_in = duration(LIMITS[arm], home, point)
    count = arms.until_rest("track", point)
    assert bits(arms.planner.command) == bits(point)
    assert count * period <= goal_in + 5 * period
    assert max(command[0] * math.copysign(1, jump) for command in arms.commands) <= abs(jump)


@every_period
@pytest.mark.parametrize("jump", [2.0, -10.0])
@pytest.mark.parametrize("speed", [0.0, 60.0, -120.0])
def test_catching_up_with_set_points_that_go_on(period: float, jump: float, speed: float) -> None:
    """After a jump the set-points continue as before: the arm catches up while moving, then follows them exactly."""
    arms = stream(period=period)
    goes, off, late = True, 0.0, 0
    for step in range(int(1.2 / period)):
        time = step * period
        moved = speed * (time - 0.15 * (1 - math.exp(-time / 0.15)))
        off = jump if time > 0.6 else 0.0
        point = (HOME[0] + moved + off, HOME[1] + 5 * (1 - math.cos(time)), *HOME[2:])
        command = arms("track", point)
        assert bits(command[1:]) == bits(point[1:])
        goes = bits(command) == bits(point)
        late += not goes
    assert goes
    assert 0 < late * period < 0.45
    assert abs(arms.planner.command[0] - point[0]) == 0.0


@every_period
@pytest.mark.parametrize(("frequency", "swing"), [(0.5, 60.0), (1.0, 30.0), (2.5, 4.0)])
def test_catching_up_with_an_oscillation(period: float, frequency: float, swing: float) -> None:
    """The set-points begin at full velocity, while the arm is at standstill."""
    arms = stream(period=period)
    exact = []
    for step in range(int(3 / period)):
        point = (swing * math.sin(2 * math.pi * frequency * step * period), *HOME[1:])
        exact.append(arms("track", point) == point)
        assert abs(arms.planner.command[0]) < 1.5 * swing
    assert all(exact[len(exact) // 2 :])


@every_period
def test_one_set_point_beside_the_others(period: float) -> None:
    arms = stream(period=period)
    exact = 0
    for step in range(int(1 / period)):
        time = step * period
        swing = 20 * (1 - math.cos(3 * time)) + (2.0 if step == int(0.5 / period) else 0.0)
        exact += arms("track", (HOME[0] + swing, *HOME[1:])) == (HOME[0] + swing, *HOME[1:])
    assert 1 / period - exact <= max(0.03 / period, 6)


def test_axes_that_can_be_there_are() -> None:
    arms = stream()
    for step in range(30):
        point = (HOME[0] + 30.0, HOME[1] + 0.01 * step, *HOME[2:])
        command = arms("track", point)
        assert command[0] != point[0]
        assert bits(command[1:]) == bits(point[1:])


@every_period
def test_take_refuses_a_state_from_which_the_arm_could_not_be_braked(period: float) -> None:
    """The set-point is within velocity, acceleration and range, but the next ones could not be."""
    limits = VS050
    start = (limits.lower[0], *HOME[1:])
    arms = Stream(limits, period, start)
    points = trapezoid(limits, period, 0, start, 1e4)
    for point in points:
        command = arms("track", point)
        if point[0] > limits.upper[0]:
            break
        if command != point:
            assert point[0] > limits.upper[0] - limits.velocity[0] * 0.12
    arms.until_rest("track", (limits.upper[0], *HOME[1:]))
    assert arms.planner.command[0] == limits.upper[0]


def test_set_points_may_brake_as_hard_as_allowed_right_to_the_end() -> None:
    """Rounding has no effect."""
    for period in PERIODS:
        limits = VS050
        points = trapezoid(limits, period, 0, HOME, 150.0)
        offset = limits.upper[0] - points[-1][0]
        start = (HOME[0] + offset, *HOME[1:])
        arms = Stream(limits, period, start)
        for point in points:
            moved = (min(point[0] + offset, limits.upper[0]), *point[1:])
            assert arms("track", moved) == moved
        arms.until_rest("track", moved)
        assert arms.planner.command[0] == limits.upper[0]


# --- check ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "english", "japanese"),
    [
        (
            (0.0, 45.0, 160.0, 0.0, 45.0, 0.0),
            "J3: 160 is 9 outside the range of -120 to 151",
            "J3: 160 は動作範囲 -120～151 を 9 超えています",
        ),
        (
            (-4.0, 45.0, 90.0, 0.0, 45.0, 0.0),
            "J1: the step of 4 to -4 is 0.6 too large: the velocity limit of 425/s allows 3.4 in 0.008 s",
            "J1: -4 は直前の指令値から 4 離れています。速度 425/s で 0.008 秒に許される 3.4 を 0.6 超えています",
        ),
        (
            (0.0, 45.0, 90.0, 0.0, 45.0, 0.5),
            "J6: at 0.5 the step differs from the last step by 0.5, which is 0.282 too much: the acceleration limit of 3400/s^2 allows 0.2176 in 0.008 s",
            "J6: 0.5 では指令値の増分が直前の増分から 0.5 変化します。加速度 3400/s^2 で 0.008 秒に許される 0.2176 を 0.282 超えています",
        ),
    ],
)
def test_check_says_what_is_exceeded(point: Joints, english: str, japanese: str) -> None:
    planner = JointPlanner(VS050, 0.008, HOME)
    with pytest.raises(InvalidValue) as error:
        planner.check(point)
    assert str(error.value) == english
    i18n.use("ja")
    with pytest.raises(InvalidValue) as error:
        planner.check(point)
    assert str(error.value) == japanese
    assert planner.command == HOME
    assert planner.at_rest


def test_check_says_that_the_arm_could_not_be_braked() -> None:
    start = (VS050.upper[0] - 0.3, *HOME[1:])
    arms = Stream(VS050, 0.008, start)
    arms("track", (start[0] + 0.13, *start[1:]))
    for text, tongue in (("to stop before the end of its range, 170", "en"), ("までに停止するには", "ja")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text) as error:
            arms.planner.check((start[0] + 0.29, *start[1:]))
        assert "J1" in str(error.value)
    arms.planner.check((start[0] + 0.21, *start[1:]))


def test_check_says_that_the_arm_has_not_caught_up() -> None:
    arms = stream()
    arms("track", (5.0, *HOME[1:]))
    for text, tongue in (("J1: the arm lags behind: it is still", "en"), ("まだ追いついていません", "ja")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            arms.planner.check(arms.planner.command)
    arms("stop")
    arms.planner.check(arms.planner.command)


@given(st.data())
def test_check_predicts_track(data: st.DataObject) -> None:
    arms = stream(period=data.draw(st.sampled_from(PERIODS)))
    for _ in range(data.draw(st.integers(1, 12))):
        before, now = arms.commands[-2:]
        near = [
            2 * b - a + data.draw(st.floats(-1.2, 1.2)) * most * arms.period**2
            for a, b, most in zip(before, now, VS050.acceleration, strict=True)
        ]
        try:
            arms.planner.check(near)
            why = ""
        except InvalidValue as error:
            why = str(error)
        exact = bits(arms("track", near)) == bits(near)
        assert exact == (not why) or "lags behind" in why  # an axis that is catching up may arrive exactly there


# --- any input --------------------------------------------------------------------------------------------------------

ODD_NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-400, 400),
    st.sampled_from([0.0, -0.0, 5e-324, 1e300, -1e300, 170.0, -170.0, 169.9999999999, 1e-9]),
)


@given(st.data())
def test_any_calls_with_any_numbers_keep_the_limits(data: st.DataObject) -> None:
    arm = data.draw(st.sampled_from(list(LIMITS)))
    arms = stream(arm, data.draw(st.sampled_from(PERIODS)))
    for _ in range(data.draw(st.integers(1, 8))):
        method = data.draw(st.sampled_from(["goto", "track", "stop"]))
        values = None if method == "stop" else data.draw(st.lists(ODD_NUMBERS, min_size=6, max_size=6))
        drift = data.draw(st.sampled_from([0.0, 0.001, 0.5, 3.0])) if values else 0.0
        for step in range(data.draw(st.integers(1, 40))):
            arms(method, [value + drift * step for value in values] if values else None)
    arms.until_rest("stop")


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=40), st.sampled_from(PERIODS))
def test_any_feasible_motion_can_be_followed_by_a_stop(pushes: list[tuple[float, float]], period: float) -> None:
    """Return limits unlike those of an arm, for a linear and a rotary axis."""
    limits = Limits((-1.0, 0.0), (0.5, 3000.0), (3.0, 900.0), (90.0, 500.0), (400.0, 1e5))
    arms = Stream(limits, period, (0.0, 1500.0))
    for push in pushes:
        for _ in range(10):
            before, now = arms.commands[-2:]
            arms(
                "track",
                [
                    2 * b - a + part * most * period**2
                    for a, b, part, most in zip(before, now, push, limits.acceleration, strict=True)
                ],
            )
    arms.until_rest("stop", most=20)


def any_calls(arms: Stream, draw: random.Random, seconds: float) -> None:
    """Use jumps, oscillations, pauses, stops, targets out of range, and set-points nearly within the limits."""
    limits, period = arms.limits, arms.period
    left = int(seconds / period)
    rows = list(zip(limits.lower, limits.upper, strict=True))
    while left > 0:
        hold = min(draw.choice([1, 1, 2, 5, 20, 60, 200, 500]), left)
        left -= hold
        method = draw.choice(["goto", "goto", "track", "track", "track", "stop"])
        kind = draw.choice(["jump", "ends", "near", "beyond", "here", "single"])
        goal = list(arms.planner.command)
        if kind == "jump":
            goal = [draw.uniform(low, high) for low, high in rows]
        elif kind == "ends":
            goal = [draw.choice(row) for row in rows]
        elif kind == "near":
            goal = [joint + draw.uniform(-3, 3) for joint in goal]
        elif kind == "beyond":
            goal = [draw.choice([1e300, -1e300, high + 5, low - 5, 1e9]) for low, high in rows]
        elif kind == "single":
            axis = draw.randrange(len(goal))
            goal[axis] = draw.uniform(*rows[axis])
        pace = [draw.choice([0.0, 0.0, draw.uniform(-1, 1)]) * most * period for most in limits.velocity]
        swing, turn = draw.choice([0.0, 0.0, 1.0, 10.0, 40.0]), draw.uniform(1, 70)
        nearly = method == "track" and draw.random() < 0.3
        for step in range(hold):
            if method == "stop":
                arms("stop")
            elif nearly:
                before, now = arms.commands[-2:]
                rate = draw.choice([0.2, 1.0, 1.000000001, 1.1]) * period**2
                arms(
                    method,
                    [
                        2 * b - a + draw.uniform(-1, 1) * rate * most
                        for a, b, most in zip(before, now, limits.acceleration, strict=True)
                    ],
                )
            else:
                off = swing * math.sin(turn * step * period)
                arms(method, [at + step * move + off for at, move in zip(goal, pace, strict=True)])
        del arms.commands[:-4]


@every_arm
@every_period
def test_random_calls(arm: str, period: float) -> None:
    any_calls(stream(arm, period), random.Random(period), 4.0)


@pytest.mark.parametrize("seed", range(2))
def test_a_minute_of_random_calls(seed: int) -> None:
    any_calls(stream(), random.Random(seed), 60.0)


@pytest.mark.soak
@pytest.mark.timeout(900)
@every_arm
def test_an_hour_of_random_calls(arm: str) -> None:
    any_calls(stream(arm), random.Random(arm), 3600.0)


def random_targets(seed: int, seconds: float, period: float) -> float:
    """Follow targets that jump and drift; return the greatest jerk as a fraction of its limit."""
    draw = random.Random(seed)
    arms = stream(period=period)
    hardest = 0.0
    rows = list(zip(VS050.lower, VS050.upper, strict=True))
    for _ in range(int(seconds / period / 60)):
        goal = [draw.choice([draw.uniform(*row), *row]) for row in rows]
        hold, drift = draw.choice([1, 5, 20, 60]), draw.choice([0.0, 0.1, 1.0])
        for step in range(60):
            arms("goto", [at + drift * (step // hold) for at in goal])
        hardest = max(hardest, arms.hardest(63))
        del arms.commands[:-4]
    return hardest


@every_period
def test_follow_is_smooth_whatever_the_target_does(period: float) -> None:
    assert random_targets(1, 8000 * period, period) <= 1.001


def test_limits_scaled_down_to_a_crawl() -> None:
    limits = VS050.scaled(velocity=0.001, acceleration=0.001, jerk=0.001)
    arms = Stream(limits, 0.008, HOME)
    goal = tuple(joint + 0.2 for joint in HOME)
    arms.until_rest("goto", goal)
    assert arms.planner.command == goal
    any_calls(arms, random.Random(7), 8.0)


@pytest.mark.parametrize("axes", [1, 6, 7, 8])
def test_arms_of_any_number_of_axes(axes: int) -> None:
    limits = Limits((-100.0,) * axes, (1000.0,) * axes, (300.0,) * axes, (1500.0,) * axes, (30_000.0,) * axes)
    arms = Stream(limits, 0.008, (0.0,) * axes)
    arms.until_rest("goto", (500.0,) * axes)
    arms.until_rest("track", (10.0,) * axes)
    any_calls(arms, random.Random(axes), 3.0)


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["goto", "track", "check"])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((0.0, math.nan, 0.0, 0.0, 0.0, 0.0), "J2 must be a finite number, not nan"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, math.inf), "J6 must be a finite number, not inf"),
        ((-math.inf, 0.0, math.inf, 0.0, 0.0, 0.0), "J1 must be a finite number, not -inf"),
        ((0.0, 0.0, 0.0, 10**400, 0.0, 0.0), "J4 must be a finite number, not 1000"),
        ((0.0, 0.0, None, 0.0, 0.0, 0.0), "J3 must be a finite number, not None"),
        ((0.0, 0.0, "1", 0.0, 0.0, 0.0), "J3 must be a finite number, not '1'"),
        ((0.0,) * 5, "got 5 values, but the stream has 6 axes"),
        ((0.0,) * 8, "got 8 values"),
        ((), "got 0 values"),
    ],
)
def test_numbers_that_cannot_be_change_nothing(method: str, moving: bool, values: Joints, said: str) -> None:
    arms, same = stream(), stream()
    for _ in range(20 if moving else 0):
        arms("goto", (50.0, *HOME[1:]))
        same("goto", (50.0, *HOME[1:]))
    with pytest.raises(InvalidValue) as error:
        getattr(arms.planner, method)(values)
    assert said in str(error.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as error:
        getattr(arms.planner, method)(values)
    assert "値" in str(error.value)
    assert arms.planner.command == arms.commands[-1]
    for _ in range(20):
        assert arms("goto", (50.0, *HOME[1:])) == same("goto", (50.0, *HOME[1:]))


@pytest.mark.parametrize("period", [0.0, -0.008, math.nan, math.inf, "8", None])
def test_periods_that_cannot_be(period: float) -> None:
    with pytest.raises(InvalidValue, match="period"):
        JointPlanner(VS050, period, HOME)


def test_a_period_in_which_limits_are_lost() -> None:
    with pytest.raises(InvalidValue, match=r"J1: the period of 1e-09 s .* lost in rounding"):
        JointPlanner(VS050, 1e-9, HOME)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="丸め誤差"):
        JointPlanner(VS050, 1e-9, HOME)


@pytest.mark.parametrize("period", [1e-4, 0.1, 5.0, 1e4])
def test_unusual_periods(period: float) -> None:
    arms = stream(period=period)
    for step in range(300):
        arms("goto", [joint + 10 * math.sin(0.1 * step) for joint in HOME])
        arms("track", HOME)
    for _ in range(300):
        arms("stop")


def test_an_arm_that_stands_outside_its_range() -> None:
    start = (VS050.upper[0] + 0.05, *HOME[1:])
    planner = JointPlanner(VS050, 0.008, start)
    assert planner.command == (VS050.upper[0], *HOME[1:])
    with pytest.raises(InvalidValue, match="J1: 171 is 1 outside the range of -170 to 170"):
        JointPlanner(VS050, 0.008, (171.0, *HOME[1:]))


@pytest.mark.parametrize("start", [(0.0,) * 5, (math.nan, *HOME[1:]), (*HOME[:5], None)])
def test_starts_that_cannot_be(start: Joints) -> None:
    with pytest.raises(InvalidValue):
        JointPlanner(VS050, 0.008, start)


# --- without ruckig, and where it gives up ----------------------------------------------------------------------------


def test_ruckig_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ruckig", None)
    for text, tongue in (("slave mode needs ruckig", "en"), ("ruckig が必要です", "ja")):
        i18n.use(tongue)
        with pytest.raises(MissingExtra, match=text) as error:
            JointPlanner(VS050, 0.008, HOME)
        assert "pip install 'orinkit[stream]'" in str(error.value)


RUCKIG = ruckig.Ruckig


class Unable(RUCKIG):
    """Ruckig in states for which it has no solution."""

    answer: Callable[[ruckig.InputParameter, ruckig.OutputParameter], object]

    def update(self, given: ruckig.InputParameter, output: ruckig.OutputParameter) -> object:
        return type(self).answer(self, given, output)


def _raise(*_: object) -> object:
    raise ruckig.RuckigError("no solution")


def _too_long(*_: object) -> object:
    return ruckig.Result(-101)  # the result for a motion of several hours is a ValueError


def _refuse(*_: object) -> object:
    return ruckig.Result.ErrorExecutionTimeCalculation


def _now_and_then(unable: Unable, given: ruckig.InputParameter, output: ruckig.OutputParameter) -> object:
    if math.sin(1e6 * given.current_position[0]) > 0.3:
        return _raise()
    return RUCKIG.update(unable, given, output)


@every_period
@pytest.mark.parametrize("answer", [_raise, _refuse, _too_long, _now_and_then])
def test_where_ruckig_has_no_solution(
    monkeypatch: pytest.MonkeyPatch, answer: Callable[..., object], period: float
) -> None:
    """Without Ruckig's solutions, motions keep all limits except jerk, and still reach the target."""
    monkeypatch.setattr(Unable, "answer", answer, raising=False)
    monkeypatch.setattr(ruckig, "Ruckig", Unable)
    arms = stream(period=period)
    any_calls(arms, random.Random(3), 2.0)
    arms.until_rest("stop")
    goal = tuple(0.9 * high for high in VS050.upper)
    for method in ("goto", "track"):
        arms.until_rest(method, goal)
        assert bits(arms.planner.command) == bits(goal)
        goal = HOME


def test_limits_of_a_planner_are_its_own() -> None:
    """Set-points that use the full limits are not passed on if the planner has half of them."""
    half = replace(VS050, velocity=tuple(value / 2 for value in VS050.velocity))
    arms = Stream(half, 0.008, HOME)
    exact = [arms("track", point) == point for point in trapezoid(VS050, 0.008, 0, HOME, 150.0)]
    assert not all(exact)
