"""Streaming over a connection: trajectories, live targets, single set-points; one test body for sync and async."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, MotionError, StreamError
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.process.shared_memory import StreamMemory
from orinkit.streaming.trajectory.trajectory import TrajectoryError
from orinkit.values.poses import J, P, T
from support.both import Both
from support.streams import HOME, PERIOD, Arm, served, sine
from support.waiting import until

pytestmark = pytest.mark.slow


@pytest.fixture
def arm() -> Iterator[Arm]:
    with served() as served_arm:
        yield served_arm


@pytest.fixture(params=["sync", "async"])
def both(request: Any) -> Iterator[Both]:
    instance = Both(request.param)
    yield instance
    instance.close()


class Session:
    """A client with the arm taken and the motor on, and slave mode."""

    def __init__(self, both: Both, url: str) -> None:
        self.both = both
        self.rc8 = both.connect(url)
        self.robot = both.run(self.rc8.robot("Arm"))
        both.run(self.robot.execute("TakeArm", [0, 0]))
        both.run(self.robot.execute("Motor", [1, 0]))

    def stream(self, body: Any, **options: Any) -> None:
        self.both.within(self.robot.slave_mode(**options), body)

    def close(self) -> None:
        self.both.run(self.rc8.close())


@pytest.fixture
def session(both: Both, arm: Arm) -> Iterator[Session]:
    opened = Session(both, arm.url)
    yield opened
    opened.close()


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_trajectory_is_carried_out_point_by_point(session: Session, arm: Arm, mode: int) -> None:
    amplitude = (
        5.0 if mode == 1 else 10.0
    )  # a cycle without a new set-point stops the arm for a cycle, within the limits
    points = sine(2.0, amplitude)
    told: list[Any] = []
    results: list[Any] = []

    session.stream(lambda stream: results.append(session.both.run(stream.run(points, progress=told.append))), mode=mode)
    (result,) = results
    assert result.sent == len(points)
    assert result.underflows == 0
    assert result.missed == 0
    assert told[-1] == (len(points), len(points))
    if mode == 1:  # the newest one counts: a late server may have skipped some
        assert len(set(points) & {tuple(row) for row in arm.commands.tolist()}) > 0.9 * len(set(points))
    else:
        assert arm.carried_out(points)
    assert arm.errors == []
    assert arm.mode == 0
    assert arm.within_limits() or (mode == 1 and not arm.carried_out(points))  # a late server is lenient
    numbers = [sample.number for sample in result.samples]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert {tuple(sample.command[:6]) for sample in result.samples} >= set(points)
    swing = max(sample.joints[0] for sample in result.samples)
    assert swing == pytest.approx(amplitude, abs=0.5)
    times = [sample.time for sample in result.samples]
    assert times == sorted(times)
    assert sum(result.timing.histogram().values()) == len(result.timing.gaps) > 200


def test_only_the_set_points_of_a_short_time_are_queued(session: Session, arm: Arm) -> None:
    points = sine(2.0)
    queued: list[int] = []

    def body(stream: Any) -> None:
        run = stream.run(points, ahead=0.2, progress=lambda _: queued.append(stream.queued))
        assert session.both.run(run).sent == len(points)
        with pytest.raises(InvalidValue, match="ahead"):
            session.both.run(stream.run(points, ahead=0.05))

    session.stream(body)
    assert 0 < max(queued) <= 25
    assert set(points) <= {tuple(row) for row in arm.commands.tolist()}
    assert arm.within_limits()


def test_a_long_trajectory_needs_no_memory_for_samples(session: Session, arm: Arm) -> None:
    points = sine(2.0)

    def body(stream: Any) -> None:
        result = session.both.run(stream.run(points, keep_samples=False))
        assert result.sent == len(points)
        assert result.samples == ()
        assert len(result.timing.gaps) > 200

    session.stream(body)
    assert arm.within_limits()


def test_the_client_is_as_before_when_the_block_has_ended(session: Session, arm: Arm) -> None:
    def body(stream: Any) -> None:
        with pytest.raises(StreamError, match="slave mode"):
            session.both.run(session.robot.execute("CurJnt"))

    session.stream(body)
    session.stream(lambda stream: None)
    assert session.both.run(session.robot.get_joints())[:6] == pytest.approx(HOME)
    assert session.both.run(session.robot.execute("slvGetMode")) == 0
    assert arm.errors == []


def test_a_live_target_is_reached_within_the_limits(session: Session, arm: Arm) -> None:
    goal = J(60, 20, 100, 30, 40, -90)

    def body(stream: Any) -> None:
        for step in range(40):
            stream.target = J(*(a + (b - a) * math.sin(step / 8) for a, b in zip(HOME, goal, strict=False)))
            time.sleep(0.003 + 0.02 * (step * 0.618 % 1))
        stream.target = goal
        session.both.run(stream.wait())
        assert stream.latest.command[:6] == pytest.approx(tuple(goal)[:6])
        assert stream.target == goal

    session.stream(body)
    assert arm.commands[-1] == pytest.approx(tuple(goal)[:6])
    assert arm.within_limits()
    assert arm.errors == []


@contextmanager
def gathered() -> Iterator[None]:
    """Keep pushed set-points in the queue, so that it does not run empty if the program is suspended afterwards."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StreamMemory, "select_queue", lambda _: None)
        yield


def test_set_points_can_be_pushed_one_by_one(session: Session, arm: Arm) -> None:
    points = sine(1.0)

    def body(stream: Any) -> None:
        with gathered():
            for point in points[:60]:
                session.both.run(stream.push(point))
        for point in points[60:]:
            session.both.run(stream.push(point))
        assert stream.queued <= 100
        session.both.run(stream.wait())
        assert stream.underflows == 0

    session.stream(body)
    assert arm.carried_out(points)
    assert arm.errors == []


def test_when_set_points_stop_the_arm_comes_to_rest_and_slave_mode_is_left(session: Session, arm: Arm) -> None:
    fast = [tuple(joint + number * 0.5 * (axis == 0) for axis, joint in enumerate(HOME)) for number in range(1)]
    ramp = 0.0
    position = HOME[0]
    for _ in range(60):  # 0 to 60 deg/s at 500 deg/s^2 and on
        ramp = min(60.0, ramp + 4.0)
        position += ramp * PERIOD
        fast.append((position, *HOME[1:]))

    def body(stream: Any) -> None:
        with gathered():
            for point in fast[:-1]:
                session.both.run(stream.push(point))
        session.both.run(stream.push(fast[-1]))
        until(lambda: arm.mode == 0)
        until(lambda: stream.error is not None)
        with pytest.raises(StreamError, match="no set-point"):
            session.both.run(stream.push(fast[-1]))

    session.stream(body, idle=0.4)
    assert arm.errors == []
    assert arm.within_limits()
    assert arm.standing()
    last = arm.commands[-3:]
    assert (last == last[0]).all()
    assert last[0][0] > position


def test_an_iterator_is_taken_as_it_comes(session: Session, arm: Arm) -> None:
    points = sine(1.0)
    session.stream(lambda stream: session.both.run(stream.run(iter(points))))
    assert arm.carried_out(points)


def test_stop_brings_the_arm_to_rest_and_goes_on(session: Session, arm: Arm) -> None:
    def body(stream: Any) -> None:
        stream.target = J(160, 45, 90, 0, 45, 0)
        until(lambda: arm.arm.queue.joints[0] > 10)
        session.both.run(stream.stop())
        place = stream.latest.command[0]
        assert 10 < place < 159
        assert stream.target is None
        stream.target = J(*HOME)
        session.both.run(stream.wait())

    session.stream(body)
    assert arm.commands[-1] == pytest.approx(HOME)
    assert arm.within_limits()
    assert arm.errors == []


def test_what_was_pushed_is_no_hindrance_for_what_follows(session: Session, arm: Arm) -> None:
    points = sine(0.6, amplitude=2.0)

    def body(stream: Any) -> None:
        run = session.both.run
        for point in points[:20]:
            run(stream.push(point))
        run(stream.stop())
        for _ in range(2):
            run(stream.push((stream.latest.command[0], *HOME[1:])))
        stream.target = J(*HOME)
        run(stream.wait())
        run(stream.push(HOME))
        run(stream.stop())
        for point in points:
            run(stream.push(point))
        run(stream.run(points))
        run(stream.push(HOME))
        run(stream.stop())
        stream.target = J(90, 45, 90, 0, 45, 0)

    session.stream(body)
    assert arm.errors == []
    assert arm.within_limits()
    assert arm.mode == 0


def test_samples_are_given_once(session: Session, arm: Arm) -> None:
    def body(stream: Any) -> None:
        first = stream.new_samples()
        until(lambda: stream.latest.number > first[-1].number + 20)
        second = stream.new_samples()
        assert [each.number for each in [*first, *second]] == list(range(len(first) + len(second)))
        assert all(each.sent < each.replied for each in second)

    session.stream(body)


def test_feedback_gives_every_sample(session: Session, arm: Arm) -> None:
    got: list[Any] = []

    def sync_body(stream: Any) -> None:
        stream.target = J(10, 45, 90, 0, 45, 0)
        for sample in stream.feedback():
            got.append(sample)
            if len(got) == 50:
                return

    async def take(stream: Any) -> None:
        stream.target = J(10, 45, 90, 0, 45, 0)
        async for sample in stream.feedback():
            got.append(sample)
            if len(got) == 50:
                return

    session.stream(sync_body if session.both.kind == "sync" else lambda stream: session.both.run(take(stream)))
    assert [sample.number for sample in got] == list(range(got[0].number, got[0].number + 50))
    assert got[-1].joints[0] > 1


@pytest.mark.parametrize(
    ("pose", "recv", "kind"),
    [("P", ("position", "joints", "current"), P), ("T", ("trans", "joints", "mini", "hand"), T)],
)
def test_positions_can_be_streamed(session: Session, arm: Arm, pose: str, recv: Any, kind: Any) -> None:
    start = tuple(arm.arm.space.position(HOME) if pose == "P" else arm.arm.space.trans(HOME))
    points = [(start[0], start[1] + 10 * (1 - math.cos(number / 20)), *start[2:]) for number in range(126)]
    points = [*points, *[points[-1]] * 2]
    results: list[Any] = []
    session.stream(
        lambda stream: results.append(session.both.run(stream.run(points, retime=True))), pose=pose, recv=recv
    )
    (result,) = results
    last = result.samples[-1]
    assert arm.errors == []
    got = last.position if pose == "P" else last.trans
    assert isinstance(got, kind)
    assert got[:3] == pytest.approx(points[-1][:3], abs=1e-3)
    assert last.joints is not None
    if pose == "P":
        assert len(last.current) == 8
        assert any(sample.current != last.current for sample in result.samples)
    else:
        assert last.mini is not None
        assert last.hand is not None


def test_a_live_target_may_be_a_position(session: Session, arm: Arm) -> None:
    start = tuple(arm.arm.space.position(HOME))
    goal = P(start[0] - 30, start[1] + 60, start[2] + 20, *start[3:])

    def body(stream: Any) -> None:
        stream.target = goal
        session.both.run(stream.wait())

    session.stream(body, pose="P", recv=("position", "joints"))
    assert arm.errors == []
    assert tuple(arm.arm.space.position(tuple(arm.commands[-1])))[:3] == pytest.approx(tuple(goal)[:3], abs=1e-3)


@pytest.mark.parametrize(
    ("point", "text"),
    [
        ((math.nan, *HOME[1:]), "nan"),
        ((math.inf, *HOME[1:]), "inf"),
        (("a", *HOME[1:]), "a"),
        (HOME[:3], "3"),
        (None, "None"),
    ],
)
def test_what_is_no_set_point_is_refused_and_nothing_moves(session: Session, arm: Arm, point: Any, text: str) -> None:
    def body(stream: Any) -> None:
        with pytest.raises(InvalidValue, match=text):
            stream.target = point
        with pytest.raises(InvalidValue, match=text):
            session.both.run(stream.push(point))
        with pytest.raises(InvalidValue, match=text):
            session.both.run(stream.run([HOME, point]))

    session.stream(body)
    assert (arm.commands == HOME).all()


def test_a_trajectory_that_breaks_a_limit_is_refused_before_anything_moves(session: Session, arm: Arm) -> None:
    points = sine(1.0)
    points[60] = (points[60][0], points[60][1] + 8.0, *points[60][2:])

    def body(stream: Any) -> None:
        with pytest.raises(TrajectoryError) as told:
            session.both.run(stream.run(points))
        assert (told.value.sample, told.value.axis) == (60, 2)
        with pytest.raises(TrajectoryError):
            session.both.run(stream.run([(20.0, *HOME[1:])]))
        with pytest.raises(InvalidValue, match="velocity"):
            session.both.run(stream.push((20.0, *HOME[1:])))

    session.stream(body)
    assert (arm.commands == HOME).all()


def test_retiming_makes_a_path_that_is_too_fast_fit(session: Session, arm: Arm) -> None:
    points = sine(0.2, amplitude=60.0)
    results: list[Any] = []
    session.stream(lambda stream: results.append(session.both.run(stream.run(points, retime=True))))
    assert results[0].sent > len(points)
    assert arm.errors == []
    assert arm.within_limits()
    assert arm.commands.max(axis=0)[0] == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize("on_range", ["clamp", "refuse"])
def test_a_target_beyond_the_range_is_clamped_or_refused(session: Session, arm: Arm, on_range: str) -> None:
    def body(stream: Any) -> None:
        if on_range == "refuse":
            with pytest.raises(InvalidValue, match="axis 1"):
                stream.target = J(500, 45, 90, 0, 45, 0)
            return
        stream.target = J(0, 45, 90, 0, 500, 0)
        session.both.run(stream.wait())

    session.stream(body, on_range=on_range)
    assert arm.errors == []
    assert arm.commands[-1][4] == pytest.approx(120.0 if on_range == "clamp" else 45.0)


def test_the_first_error_is_raised_and_can_be_recovered_from(session: Session, arm: Arm) -> None:
    def body(stream: Any) -> None:
        stream.target = J(90, 45, 90, 0, 45, 0)
        until(lambda: arm.arm.queue.joints[0] > 5)
        arm.device.state.raise_error(0x84201486)
        until(lambda: stream.error is not None)
        with pytest.raises(MotionError) as told:
            session.both.run(stream.push(HOME))
        assert told.value.code == 0x84201486
        session.both.run(stream.recover())
        assert arm.mode == 0x202
        stream.target = J(*HOME)
        session.both.run(stream.wait())

    session.stream(body)
    assert arm.commands[-1] == pytest.approx(HOME)
    assert arm.within_limits()
    assert arm.errors == [0x84201486]


def test_an_error_that_nobody_asked_for_is_raised_at_the_end(session: Session, arm: Arm) -> None:
    with pytest.raises(CallError) as told:
        session.stream(lambda stream: arm.device.state.raise_error(0x84201486))
    assert told.value.code == 0x84201486
    assert session.both.run(session.rc8.execute("GetCurErrorCount")) == 1


def test_what_slave_mode_needs_is_said(both: Both, arm: Arm) -> None:
    rc8 = both.connect(arm.url)
    robot = both.run(rc8.robot("Arm"))
    with pytest.raises(CallError) as told:
        both.within(robot.slave_mode(), lambda stream: None)
    assert told.value.code == hresult.ARM_NOT_TAKEN
    assert both.run(robot.get_joints())
    both.run(rc8.close())


def test_outputs_of_queued_set_points_are_not_sent_early(session: Session, arm: Arm) -> None:
    *points, last = sine(1.0)

    def body(stream: Any) -> None:
        stream.outputs(mini=0b10)
        stream.outputs(hand=0b10)  # does not undo the change before it
        until(lambda: stream.latest.mini >> 16 & 0xFF == stream.latest.hand >> 8 == 0b10)
        with gathered():
            for point in points:
                session.both.run(stream.push(point))
            session.both.run(stream.push(last, mini=0b1))
            stream.outputs(hand=0b1)  # does not anticipate the outputs of the last set-point
            until(lambda: stream.latest.hand >> 8 == 0b1)
            assert stream.latest.mini >> 16 & 0xFF == 0b10
        session.both.run(stream.push(last))
        session.both.run(stream.wait())
        assert stream.latest.mini >> 16 & 0xFF == 0b1
        stream.outputs(mini=0b100)
        until(lambda: stream.latest.mini >> 16 & 0xFF == 0b100)

    session.stream(body, mini=0, hand=0, recv=("mini", "hand"), queue=len(points) + 2)


def test_recovery_sends_only_outputs_that_have_been_sent(session: Session, arm: Arm) -> None:
    *points, last = sine(1.0)

    def body(stream: Any) -> None:
        run = session.both.run
        stream.outputs(mini=0b10)
        with gathered():
            for point in points:
                run(stream.push(point))
            run(stream.push(last, mini=0b1))
            until(lambda: stream.latest.mini >> 16 & 0xFF == 0b10)
        arm.device.state.raise_error(hresult.COMMAND_DELAY)
        until(lambda: stream.error is not None)
        run(stream.recover())
        assert stream.latest.mini >> 16 & 0xFF == 0b10

    session.stream(body, mini=0, recv=("mini",), queue=len(points) + 2)


def test_outputs_go_with_the_set_points(session: Session, arm: Arm) -> None:
    io = arm.device.state.variables

    def body(stream: Any) -> None:
        session.both.run(stream.push(HOME, mini=0b101))
        session.both.run(stream.wait())
        stream.outputs(hand=0b11)
        until(lambda: stream.latest.hand >> 8 == 0b11)
        assert stream.latest.mini >> 16 & 0xFF == 0b101
        with pytest.raises(InvalidValue, match="user"):
            stream.outputs(user=(128, b"\1"))

    session.stream(body, mini=0, hand=0, recv=("mini", "hand"))
    assert io is not None


@pytest.mark.parametrize(
    "options",
    [
        {"mode": 3},
        {"pose": "V"},
        {"recv": ("position", "trans")},
        {"recv": ("speed",)},
        {"speed": 0},
        {"speed": 101},
        {"queue": 0},
        {"idle": -1},
        {"on_range": "jump"},
        {"record": "nowhere.txt"},
        {"period": math.nan},
        {"mini": 0, "user": (128, b"\0")},
    ],
)
def test_options_that_cannot_be_are_refused(session: Session, arm: Arm, options: Any) -> None:
    with pytest.raises((InvalidValue, StreamError)):
        session.stream(lambda stream: None, **options)
    assert session.both.run(session.robot.execute("slvGetMode")) == 0


def test_speed_and_limits_are_kept_to(session: Session, arm: Arm) -> None:
    def body(stream: Any) -> None:
        stream.target = J(60, 45, 90, 0, 45, 0)
        session.both.run(stream.wait())

    session.stream(body, speed=20)
    velocity, acceleration = arm.peaks()
    assert 0.15 < velocity.max() <= 0.2 + 1e-6
    assert acceleration.max() <= 0.2 + 1e-6
    limits = Limits.of_model(arm.model).scaled(0.1, 0.5)
    arm.record()

    def back(stream: Any) -> None:
        assert stream.limits == limits
        stream.target = J(*HOME)
        session.both.run(stream.wait())

    session.stream(back, limits=limits)
    assert 0.09 < arm.peaks()[0].max() <= 0.1 + 1e-6


def test_what_was_streamed_is_recorded(session: Session, arm: Arm, tmp_path: Any) -> None:
    points = sine(1.0)
    path = tmp_path / "run.csv"
    session.stream(lambda stream: session.both.run(stream.run(points)), record=path)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("time_s,J1_command")
    assert len(lines) > len(points)


def test_two_threads_may_not_stream_over_one_connection(arm: Arm) -> None:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor(), robot.slave_mode(), pytest.raises(StreamError), robot.slave_mode():
            pass
        assert np.allclose(robot.joints[:6], HOME)
