from __future__ import annotations

import math
import random
import struct
import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace
from itertools import pairwise

import pytest
import ruckig
from hypothesis import given
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.arms.geometry import (
    Quaternion,
    angles_of,
    of_angles,
    of_vectors,
    rotvec_between,
    turned,
    vectors_of,
)
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, MissingExtra
from orinkit.streaming.planning.limits import PathLimits
from orinkit.streaming.planning.pose_planner import Kind, PosePlanner

Pose = tuple[float, ...]

ROUNDING = 1e-9
ANGLES = 1e-12  # deg: rounding of angles
LIMITS = PathLimits.of_model(load_model("VS-050"))
HOME = (300.0, 0.0, 300.0, 180.0, 0.0, 180.0)
PERIODS = (0.008, 0.004, 0.001)

every_kind = pytest.mark.parametrize("kind", ["P", "T"])
every_period = pytest.mark.parametrize("period", PERIODS)


def pose(kind: Kind, values: Sequence[float], fig: float = 5.0) -> Pose:
    """Return X, Y, Z, RX, RY, RZ as a P or a T."""
    x, y, z, *angles = map(float, values)
    return (x, y, z, *(angles if kind == "P" else vectors_of(of_angles(*angles))), fig)


def turn_of(kind: Kind, values: Pose) -> Quaternion:
    return of_angles(*values[3:6]) if kind == "P" else of_vectors(values[3:6], values[6:9])


@dataclass
class Stream:
    """A planner each of whose commands is checked."""

    kind: Kind = "P"
    period: float = 0.008
    start: Sequence[float] = HOME
    limits: PathLimits = LIMITS
    planner: PosePlanner = field(init=False)
    commands: list[Pose] = field(init=False)
    steps: list[tuple[Pose, Pose]] = field(init=False)

    def __post_init__(self) -> None:
        start = pose(self.kind, self.start)
        self.planner = PosePlanner(self.limits, self.period, start, self.kind)
        self.commands = [start]
        self.steps = [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))] * 2

    def __call__(self, method: str, values: Sequence[float] | None = None) -> Pose:
        call = getattr(self.planner, method)
        command: Pose = call() if values is None else call(values)
        before = self.commands[-1]
        assert command is self.planner.command
        self.commands.append(command)
        step = tuple(b - a for a, b in zip(before[:3], command[:3], strict=True))
        turn = rotvec_between(turn_of(self.kind, before), turn_of(self.kind, command))
        limits, period = self.limits, self.period
        assert math.hypot(*step) <= limits.speed * period * (1 + ROUNDING)
        assert math.dist(step, self.steps[-1][0]) <= limits.acceleration * period**2 * (1 + ROUNDING)
        assert math.hypot(*turn) <= limits.rotation * period * (1 + ROUNDING) + ANGLES
        most = limits.rotation_acceleration * period**2 * (1 + ROUNDING) + ANGLES
        assert math.dist(turn, self.steps[-1][1]) <= most
        self.steps.append((step, turn))
        return command

    def until_rest(self, method: str, values: Sequence[float] | None = None, most: float = 10.0) -> int:
        for count in range(int(most / self.period)):
            self(method, values)
            if self.planner.at_rest:
                return count
        raise AssertionError(f"still moving after {most} s")

    def hardest(self) -> tuple[float, float]:
        """Return the greatest jerk of position and orientation, as fractions of their limits."""
        found = [0.0, 0.0]
        for a, b, c in zip(self.steps, self.steps[1:], self.steps[2:], strict=False):
            for which, limit in enumerate((self.limits.jerk, self.limits.rotation_jerk)):
                size = math.hypot(*(x - 2 * y + z for x, y, z in zip(a[which], b[which], c[which], strict=True)))
                found[which] = max(found[which], size / limit / self.period**3)
        return found[0], found[1]


def bits(values: Sequence[float]) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


def duration(way: float, speed: float, acceleration: float, jerk: float) -> float:
    """Return the duration that ruckig itself needs between two standstills on a line."""
    given = ruckig.InputParameter(1)
    given.target_position = [way]
    given.max_velocity, given.max_acceleration, given.max_jerk = [speed], [acceleration], [jerk]
    trajectory = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(given, trajectory)
    return float(trajectory.duration)


def any_pose(draw: random.Random) -> list[float]:
    return [draw.uniform(-400, 400) for _ in range(3)] + [draw.uniform(-180, 180) for _ in range(3)]


# --- rotations --------------------------------------------------------------------------------------------------------


@given(
    st.floats(-180, 180), st.floats(-180, 180), st.one_of(st.floats(-90, 90), st.floats(0, 1e-6).map(lambda x: 90 - x))
)
def test_angles_are_those_of_the_orientation(rx: float, rz: float, ry: float) -> None:
    """The check includes poses near RY = 90, where RX and RZ are not determined individually."""
    turn = of_angles(rx, ry, rz)
    angles = angles_of(turn)
    assert math.hypot(*rotvec_between(turn, of_angles(*angles))) < 1e-12
    assert -180 < angles[0] <= 180
    assert -90 <= angles[1] <= 90
    assert -180 < angles[2] <= 180


@pytest.mark.parametrize(
    ("angles", "turn", "after"),
    [
        ((0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (90.0, 0.0, 0.0)),
        ((90.0, 0.0, 0.0), (0.0, 0.0, 90.0), (90.0, 0.0, 90.0)),
        ((0.0, 0.0, 90.0), (0.0, 30.0, 0.0), (30.0, 0.0, 90.0)),
        ((10.0, 20.0, 30.0), (0.0, 0.0, 0.0), (10.0, 20.0, 30.0)),
        ((180.0, 0.0, 0.0), (0.0, 0.0, -180.0), (180.0, 0.0, 180.0)),
    ],
)
def test_turning_about_axes_of_the_base(angles: Pose, turn: Pose, after: Pose) -> None:
    result = turned(of_angles(*angles), turn)
    assert math.hypot(*rotvec_between(result, of_angles(*after))) < 1e-12
    assert angles_of(result) == pytest.approx(after, abs=1e-12)


@given(st.tuples(*[st.floats(-100, 100)] * 3), st.tuples(*[st.floats(-180, 180)] * 3))
def test_the_rotation_between_two_orientations_leads_from_one_to_the_other(turn: Pose, angles: Pose) -> None:
    start = of_angles(*angles)
    assert rotvec_between(start, turned(start, turn)) == pytest.approx(turn, abs=1e-11)


# --- follow -----------------------------------------------------------------------------------------------------------


@every_kind
@every_period
@pytest.mark.parametrize("seed", range(4))
def test_follow_reaches_a_target_exactly_and_about_as_soon_as_ruckig_would(
    kind: Kind, period: float, seed: int
) -> None:
    draw = random.Random(seed)
    tool = Stream(kind, period)
    goal = pose(kind, any_pose(draw))
    way = math.dist(goal[:3], tool.planner.command[:3])
    angle = math.hypot(*rotvec_between(turn_of(kind, tool.planner.command), turn_of(kind, goal)))
    limits = astuple(LIMITS)
    wanted = max(duration(way, *limits[:3]), duration(angle, *limits[3:]))
    count = tool.until_rest("goto", goal)
    assert bits(tool.planner.command) == bits(goal)
    assert abs(count * period - wanted) <= 5 * period
    assert max(tool.hardest()) <= 1.001


def test_follow_goes_straight_and_turns_about_one_axis() -> None:
    tool = Stream()
    goal = pose("P", (100.0, 250.0, 400.0, 90.0, 30.0, 20.0))
    first, last = turn_of("P", tool.commands[0]), turn_of("P", goal)
    axis = rotvec_between(first, last)
    tool.until_rest("goto", goal)
    for command in tool.commands:
        parts = [(c - a) / (b - a) for a, b, c in zip(tool.commands[0][:3], goal[:3], command[:3], strict=True)]
        assert max(parts) - min(parts) < 1e-6
        turn = rotvec_between(first, turn_of("P", command))
        part = math.hypot(*turn) / math.hypot(*axis)
        assert turn == pytest.approx([part * value for value in axis], abs=1e-6)


@every_kind
@every_period
def test_follow_ends_from_any_motion(kind: Kind, period: float) -> None:
    """The motion does not circle the target."""
    draw = random.Random(11)
    tool = Stream(kind, period)
    for _ in range(8):
        for _ in range(draw.randrange(3)):
            goal = pose(kind, any_pose(draw))
            for _ in range(int(draw.uniform(0.05, 0.4) / period)):
                tool("goto", goal)
        goal = pose(kind, any_pose(draw))
        count = tool.until_rest("goto", goal, most=3)
        assert count * period < 2.6
        assert bits(tool.planner.command) == bits(goal)


def test_the_figure_is_the_one_of_the_target_at_once() -> None:
    tool = Stream()
    goal = pose("P", (300.0, 50.0, 300.0, 180.0, 0.0, 180.0), fig=1.0)
    assert tool("goto", goal)[6] == 1.0
    assert tool("stop")[6] == 1.0
    assert tool("track", (*tool.planner.command[:6], 5.0))[6] == 5.0


@every_kind
@every_period
def test_a_live_target_is_followed_smoothly(kind: Kind, period: float) -> None:
    tool = Stream(kind, period)
    for step in range(int(3 / period)):
        t = step * period
        swing = (
            300 + 40 * math.sin(2 * t),
            40 * math.sin(3 * t),
            300,
            180 + 20 * math.sin(2 * t),
            15 * math.sin(t),
            180,
        )
        tool("goto", pose(kind, swing))
    assert math.dist(tool.planner.command[:3], pose(kind, swing)[:3]) < 30
    assert max(tool.hardest()) <= 1.05  # a rotation also rotates the axes in which it is planned


@every_kind
@every_period
@pytest.mark.parametrize("method", ["goto", "track"])
def test_an_oscillation_that_no_tool_can_follow(kind: Kind, period: float, method: str) -> None:
    tool = Stream(kind, period)
    for step in range(int(1 / period)):
        swing = math.sin(20 * math.pi * step * period)
        tool(method, pose(kind, (300 + 200 * swing, 100 * swing, 300, 180, 80 * swing, 180 + 90 * swing)))


def test_half_a_turn_goes_on_the_way_that_it_began() -> None:
    """The target moves back and forth across the opposite orientation; the tool does not reverse each time."""
    tool = Stream(start=(300.0, 0.0, 300.0, 0.0, 0.0, 0.0))
    angles = []
    for step in range(200):
        tool("goto", pose("P", (300.0, 0.0, 300.0, 0.0, 0.0, 179.0 if step % 2 else -179.0)))
        angles.append(math.degrees(math.atan2(*reversed(_direction(tool.planner.command)))))
    moved = [(b - a + 180) % 360 - 180 for a, b in pairwise(angles[:61])]
    assert all(move >= 0 for move in moved) or all(move <= 0 for move in moved)
    assert abs(sum(moved)) > 90


def _direction(command: Pose) -> tuple[float, float]:
    turn = math.radians(command[5])
    return math.cos(turn), math.sin(turn)


@every_kind
@pytest.mark.parametrize("method", ["goto", "track"])
@pytest.mark.parametrize("place", [(1e300, 0.0, 0.0), (1e308, -1e308, 1e308), (-1e6, 0.0, 0.0)])
def test_a_target_that_is_absurdly_far_away(kind: Kind, method: str, place: Pose) -> None:
    tool = Stream(kind)
    for _ in range(200):
        tool(method, (*place, *tool.planner.command[3:]))
    tool.until_rest("stop")
    assert math.dist(tool.planner.command[:3], HOME[:3]) > 100


@every_kind
@pytest.mark.parametrize("method", ["goto", "track"])
@pytest.mark.parametrize("value", [0.0, -0.0, 5e-324, 1e-310, 1e-13, -1e-8])
def test_the_smallest_numbers(kind: Kind, method: str, value: float) -> None:
    tool = Stream(kind)
    goal = list(tool.planner.command)
    goal[1] = value
    if kind == "P":
        goal[4] = value
    tool.until_rest(method, goal)
    assert tool.planner.command == tuple(goal)


def test_a_step_that_is_next_to_nothing_can_be_gone_on_from() -> None:
    for method in ("stop", "goto"):
        tool = Stream(start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        tool("track", (5e-324, 0.0, 1e-310, 5e-324, 0.0, 0.0, 5.0))
        tool.until_rest(method, pose("P", HOME) if method == "goto" else None)
        assert all(math.isfinite(value) for value in tool.planner.command)


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_past_the_pole_of_the_angles(pole: float) -> None:
    """RX and RZ jump by 180 deg; the orientation does not."""
    tool = Stream(start=(300.0, 0.0, 300.0, 10.0, pole - 30.0, 20.0))
    for ry in (pole + 30.0, pole, pole - 30.0):
        goal = pose("P", (300.0, 0.0, 300.0, 10.0, ry, 20.0))
        tool.until_rest("goto", goal)
        assert bits(tool.planner.command) == bits(goal)


# --- stop -------------------------------------------------------------------------------------------------------------


@every_kind
@every_period
@pytest.mark.parametrize("after", [0.02, 0.1, 0.25])
def test_stop_in_the_middle_of_a_motion(kind: Kind, period: float, after: float) -> None:
    tool = Stream(kind, period)
    goal = pose(kind, (-300.0, 200.0, 600.0, 0.0, 20.0, 90.0))
    for _ in range(int(after / period)):
        tool("goto", goal)
    count = tool.until_rest("stop")
    assert count * period < 0.2 + 0.05 + 0.02 + 3 * period
    rest = tool.planner.command
    for _ in range(10):
        assert bits(tool("stop")) == bits(rest)
        assert tool.planner.at_rest


@every_period
def test_stop_on_a_circle(period: float) -> None:
    """The stop follows set-points that were passed on, with an acceleration orthogonal to the velocity."""
    tool = Stream("P", period)
    for step in range(int(0.9 / period)):
        t = step * period
        angle = 3 * (t - 0.2 * (1 - math.exp(-t / 0.2)))
        point = pose("P", (220 + 80 * math.cos(angle), 80 * math.sin(angle), 300, 180, 10 * math.sin(angle), 180))
        assert bits(tool("track", point)) == bits(point)
    assert tool.until_rest("stop") * period < 0.3


# --- take -------------------------------------------------------------------------------------------------------------


@every_kind
@every_period
def test_take_passes_on_what_is_within_the_limits(kind: Kind, period: float) -> None:
    """Set-points at full acceleration and full velocity are passed on bit for bit."""
    tool = Stream(kind, period)
    change, most = LIMITS.acceleration * period**2, LIMITS.speed * period
    at, step, points = 300.0, 0.0, []
    while step < most:
        step = min(step + change, most)
        at -= step
        points.append(at)
    for _ in range(3):
        at -= step
        points.append(at)
    while step > 0.0:
        step = max(step - change, 0.0)
        at -= step
        points.append(at)
    for x in [*points, at, at]:
        point = pose(kind, (x, *HOME[1:]))
        tool.planner.check(point)
        assert bits(tool("track", point)) == bits(point)
    assert tool.planner.at_rest


@every_kind
@every_period
def test_take_passes_on_smooth_set_points(kind: Kind, period: float) -> None:
    tool = Stream(kind, period)
    for step in range(int(2 / period)):
        swing = 1 - math.cos(3 * step * period)
        point = pose(kind, (300 - 60 * swing, 40 * swing, 300, 180, 30 * swing, 180 - 20 * swing))
        tool.planner.check(point)
        assert bits(tool("track", point)) == bits(point)


def test_take_passes_on_numbers_as_they_are_written() -> None:
    """The set-points have angles beyond 180 deg, and vectors that are not exactly normalized."""
    tool = Stream()
    point = (300.0, -0.0, 300.0, -180.0, 0.0, 540.0, 5.0)
    assert bits(tool("track", point)) == bits(point)
    other = Stream("T", start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    point = (0.0, 0.0, 0.0, 1e-9, 1.5, 0.0, 0.0, 0.0, 3.0, 5.0)
    assert bits(other("track", point)) == bits(point)
    assert tool("track", [300, 0, 300, 180, 0, 180, 5]) == (*HOME, 5.0)


@every_kind
@every_period
@pytest.mark.parametrize(("way", "turn"), [(30.0, 0.0), (0.0, 20.0), (-5.0, 5.0)])
def test_catching_up_after_a_jump(kind: Kind, period: float, way: float, turn: float) -> None:
    tool = Stream(kind, period)
    for _ in range(5):
        tool("track", pose(kind, HOME))
    point = pose(kind, (300 + way, 0, 300, 180 - turn, 0, 180))
    count = tool.until_rest("track", point)
    assert bits(tool.planner.command) == bits(point)
    assert count * period < 0.35
    past = [command[0] - 300 for command in tool.commands]
    assert min(way, 0.0) <= min(past)
    assert max(past) <= max(way, 0.0)


@every_kind
@every_period
def test_catching_up_with_set_points_that_go_on(kind: Kind, period: float) -> None:
    """The set-points begin at full velocity, while the tool is at standstill, and later jump."""
    tool = Stream(kind, period)
    exact = []
    for step in range(int(3 / period)):
        t = step * period
        off = 15.0 if t > 1.5 else 0.0
        point = pose(
            kind,
            (300 + 60 * math.sin(2 * t) + off, 60 * math.cos(2 * t) - 60, 300, 170 + 15 * math.sin(2 * t), off, 170),
        )
        exact.append(bits(tool("track", point)) == bits(point))
        assert math.dist(tool.planner.command[:3], point[:3]) < 40
    half = len(exact) // 2
    assert all(exact[int(0.3 * half) : half])
    assert not all(exact[half:])
    assert all(exact[-int(0.5 * half) :])


def test_position_is_passed_on_while_the_orientation_catches_up() -> None:
    tool = Stream()
    for step in range(10):
        command = tool("track", (300.0 - 0.1 * step, 0.0, 300.0, 150.0, 0.0, 180.0, 5.0))
        assert command[:3] == (300.0 - 0.1 * step, 0.0, 300.0)
        assert command[3] != 150.0


# --- check ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "english", "japanese"),
    [
        (
            (315.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0),
            "position: the step of 15 mm is 3 mm too large: the velocity limit of 1500 mm/s allows 12 mm in 0.008 s",
            "位置: 直前の指令値から 15 mm 離れています。速度 1500 mm/s で 0.008 秒に許される 12 mm を 3 mm 超えています",
        ),
        (
            (301.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0),
            "position: the step differs from the last step by 1 mm, which is 0.52 mm too much: the acceleration limit of 7500 mm/s^2 allows 0.48 mm in 0.008 s",
            "位置: 指令値の増分が直前の増分から 1 mm 変化します。加速度 7500 mm/s^2 で 0.008 秒に許される 0.48 mm を 0.52 mm 超えています",
        ),
        (
            (300.0, 0.0, 300.0, 170.0, 0.0, 180.0, 5.0),
            "orientation: the step of 10 deg is 7.12 deg too large: the velocity limit of 360 deg/s allows 2.88 deg in 0.008 s",
            "姿勢: 直前の指令値から 10 deg 離れています。速度 360 deg/s で 0.008 秒に許される 2.88 deg を 7.12 deg 超えています",
        ),
        (
            (2e5, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0),
            "position: 200000 mm is out of reach; the largest allowed coordinate is 100000 mm",
            "位置: 200000 mm は遠すぎます。100000 mm 以内にしてください",
        ),
    ],
)
def test_check_says_what_is_exceeded(point: Pose, english: str, japanese: str) -> None:
    planner = PosePlanner(LIMITS, 0.008, (*HOME, 5.0), "P")
    with pytest.raises(InvalidValue) as error:
        planner.check(point)
    assert str(error.value) == english
    i18n.use("ja")
    with pytest.raises(InvalidValue) as error:
        planner.check(point)
    assert str(error.value) == japanese
    assert planner.command == (*HOME, 5.0)


def test_check_says_that_the_tool_has_not_caught_up() -> None:
    tool = Stream()
    tool("track", pose("P", (350.0, 0.0, 300.0, 150.0, 0.0, 180.0)))
    for text, tongue in (("position: the arm lags behind", "en"), ("位置: アームがまだ追いついていません", "ja")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            tool.planner.check(tool.planner.command)
    tool("stop")
    tool.planner.check(tool.planner.command)


@given(st.data())
def test_check_predicts_track(data: st.DataObject) -> None:
    tool = Stream("P", data.draw(st.sampled_from(PERIODS)))
    change = LIMITS.acceleration * tool.period**2
    turn = LIMITS.rotation_acceleration * tool.period**2
    for _ in range(data.draw(st.integers(1, 10))):
        at, step = tool.commands[-1], tool.steps[-1][0]
        push = [data.draw(st.floats(-0.8, 0.8)) for _ in range(4)]
        point = (
            *(x + d + part * change for x, d, part in zip(at, step, push, strict=False)),
            *at[3:5],
            at[5] + push[3] * turn,
            5.0,
        )
        try:
            tool.planner.check(point)
            why = ""
        except InvalidValue as error:
            why = str(error)
        exact = bits(tool("track", point)) == bits(point)
        assert exact == (not why) or "lags behind" in why  # a motion that is catching up may arrive exactly there


# --- any input --------------------------------------------------------------------------------------------------------

ODD_NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-500, 500),
    st.sampled_from([0.0, -0.0, 90.0, -90.0, 180.0, -180.0, 5e-324, 1e300]),
)


@given(st.data())
def test_any_calls_with_any_numbers_keep_the_limits(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["P", "T"]))
    tool = Stream(kind, data.draw(st.sampled_from(PERIODS)))
    for _ in range(data.draw(st.integers(1, 8))):
        method = data.draw(st.sampled_from(["goto", "track", "stop"]))
        values = None
        if method != "stop":
            place = data.draw(st.lists(ODD_NUMBERS, min_size=3, max_size=3))
            angles = data.draw(st.lists(ODD_NUMBERS, min_size=3, max_size=3))
            values = pose(kind, [*place, *angles])
        for _ in range(data.draw(st.integers(1, 40))):
            tool(method, values)
    tool.until_rest("stop")


def any_calls(tool: Stream, draw: random.Random, seconds: float) -> None:
    kind, period = tool.kind, tool.period
    left = int(seconds / period)
    goal = list(HOME)
    while left > 0:
        hold = min(draw.choice([1, 1, 2, 5, 20, 60, 200, 500]), left)
        left -= hold
        method = draw.choice(["goto", "goto", "track", "track", "track", "stop"])
        chance = draw.random()
        if chance < 0.4:
            goal = any_pose(draw)
        elif chance < 0.6:
            goal = [value + draw.uniform(-20, 20) for value in goal]
        elif chance < 0.7:
            goal = [
                *(draw.choice([1e300, -1e7, 5e-324, -0.0]) for _ in range(3)),
                180.0,
                draw.choice([90.0, -90.0]),
                0.0,
            ]
        pace = [draw.choice([0.0, 0.0, draw.uniform(-1200, 1200)]) * period for _ in range(3)]
        pace += [draw.choice([0.0, 0.0, draw.uniform(-300, 300)]) * period for _ in range(3)]
        swing, turn = draw.choice([0.0, 0.0, 5.0, 50.0]), draw.uniform(1, 70)
        for step in range(hold):
            if method == "stop":
                tool("stop")
                continue
            off = swing * math.sin(turn * step * period)
            tool(method, pose(kind, [at + step * move + off for at, move in zip(goal, pace, strict=True)]))
        del tool.commands[:-4]
        del tool.steps[:-4]


@every_kind
@every_period
def test_random_calls(kind: Kind, period: float) -> None:
    any_calls(Stream(kind, period), random.Random(period), 4.0)


@every_kind
def test_a_minute_of_random_calls(kind: Kind) -> None:
    any_calls(Stream(kind), random.Random(kind), 60.0)


@pytest.mark.soak
@pytest.mark.timeout(900)
@every_kind
def test_an_hour_of_random_calls(kind: Kind) -> None:
    any_calls(Stream(kind), random.Random(kind), 3600.0)


def test_limits_scaled_down_to_a_crawl() -> None:
    tool = Stream(limits=LIMITS.scaled(velocity=0.01, acceleration=0.01, jerk=0.01))
    goal = pose("P", (301.0, 1.0, 300.0, 179.0, 1.0, 180.0))
    tool.until_rest("goto", goal)
    assert tool.planner.command == goal
    any_calls(tool, random.Random(7), 8.0)


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["goto", "track", "check"])
@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        ("P", (300.0, math.nan, 300.0, 180.0, 0.0, 180.0, 5.0), "P: y must be a finite number, not nan"),
        ("P", (300.0, 0.0, 300.0, 180.0, 0.0, -math.inf, 5.0), "P: rz must be a finite number, not -inf"),
        ("P", (300.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.5), "P: fig must be a whole number of 32 bits, not 5.5"),
        ("P", (300.0, 0.0, 300.0, 180.0, 0.0, 180.0), "P: got 6 values, expected 7: x, y, z, rx, ry, rz, fig"),
        ("P", (None, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0), "P: x must be a finite number, not None"),
        ("T", (300.0, 0.0, 300.0, 0.0, 1.0, math.inf, 0.0, 0.0, 1.0, 5.0), "T: oz must be a finite number, not inf"),
        ("T", (300.0, 0.0, 300.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 5.0), "orient and approach vectors are parallel"),
        ("T", (300.0, 0.0, 300.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0), "orient or approach vector is zero"),
        ("T", (300.0,) * 7, "T: got 7 values, expected 10"),
    ],
)
def test_poses_that_cannot_be_change_nothing(method: str, kind: Kind, values: Pose, said: str) -> None:
    tool, same = Stream(kind), Stream(kind)
    goal = pose(kind, (250.0, 100.0, 350.0, 150.0, 10.0, 180.0))
    for _ in range(20):
        tool("goto", goal)
        same("goto", goal)
    with pytest.raises(InvalidValue) as error:
        getattr(tool.planner, method)(values)
    assert said in str(error.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as error:
        getattr(tool.planner, method)(values)
    assert said not in str(error.value)
    for _ in range(20):
        assert tool("goto", goal) == same("goto", goal)


@pytest.mark.parametrize("period", [0.0, -0.008, math.nan, math.inf])
def test_periods_that_cannot_be(period: float) -> None:
    with pytest.raises(InvalidValue, match="period"):
        PosePlanner(LIMITS, period, (*HOME, 5.0), "P")


def test_a_period_in_which_limits_are_lost() -> None:
    for text, tongue in (("position: the period of 1e-09 s", "en"), ("丸め誤差", "ja")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            PosePlanner(LIMITS, 1e-9, (*HOME, 5.0), "P")
    slow = replace(LIMITS, rotation_acceleration=1e-6)
    i18n.use("en")
    with pytest.raises(InvalidValue, match="orientation: the period"):
        PosePlanner(slow, 0.008, (*HOME, 5.0), "P")


@pytest.mark.parametrize(
    ("start", "kind", "said"),
    [
        ((*HOME, 5.0), "J", "kind is 'J'"),
        ((2e5, *HOME[1:], 5.0), "P", "200000 mm is out of reach"),
        (HOME, "P", "got 6 values"),
        ((math.nan, *HOME[1:], 5.0), "P", "x must be a finite number, not nan"),
    ],
)
def test_starts_that_cannot_be(start: Pose, kind: Kind, said: str) -> None:
    with pytest.raises(InvalidValue, match=said):
        PosePlanner(LIMITS, 0.008, start, kind)


def test_ruckig_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ruckig", None)
    with pytest.raises(MissingExtra, match="pip install"):
        PosePlanner(LIMITS, 0.008, (*HOME, 5.0), "P")


class Unable(ruckig.Ruckig):
    """Ruckig in states for which it has no solution."""

    def update(self, given: ruckig.InputParameter, output: ruckig.OutputParameter) -> object:
        raise ruckig.RuckigError("no solution")


@every_period
def test_where_ruckig_has_no_solution(monkeypatch: pytest.MonkeyPatch, period: float) -> None:
    monkeypatch.setattr(ruckig, "Ruckig", Unable)
    tool = Stream("P", period)
    any_calls(tool, random.Random(3), 2.0)
    tool.until_rest("stop")
    for goal in (pose("P", (100.0, 200.0, 300.0, 90.0, 0.0, 0.0)), pose("P", HOME)):
        tool.until_rest("goto", goal)
        assert bits(tool.planner.command) == bits(goal)
