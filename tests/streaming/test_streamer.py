"""The streaming process in unusual states of the memory that it shares with the program."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from time import monotonic, monotonic_ns
from typing import Any

import pytest

from orinkit.arms import load_model
from orinkit.bcap.profiles import STREAM
from orinkit.core import hresult
from orinkit.core.errors import CallTimeout, error_for
from orinkit.rc8.slave_formats import ReceiveFormat, SendBits, SlaveReply, UserWindow, mode_of
from orinkit.rc8.slave_lateness import Lateness
from orinkit.streaming.planning.joint_planner import JointPlanner
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.process.channel import Channel
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.pacing import Delivery
from orinkit.streaming.process.shared_memory import Outputs, StreamCommand, StreamMemory, _Word
from orinkit.streaming.process.streamer import ParentMonitor, Streamer, StreamerConnection
from support.stopping import stopped
from support.waiting import until

HOME = (0.0, 0.0, 90.0, 0.0, 90.0, 0.0)
PERIOD = 0.008
LIMITS = Limits.of_model(load_model("vs-050"))


def setup() -> StreamerConfig:
    mode = mode_of(0x202)
    assert mode is not None
    return StreamerConfig(
        1, 2, mode, SendBits(0), ReceiveFormat(4, microseconds=True), None, Outputs(), PERIOD, LIMITS, HOME, (), 1, 1.0, None,
        os.getppid(),
    )  # fmt: skip


class Controller(StreamerConnection):
    """A connection that accepts every set-point at once; a script simulates the program meanwhile.

    Attributes:
        count: Number of set-points.
        asked: For each query of late set-points: the number of set-points before it, and how many to leave out.
        answer: The reply to a query, or a function that returns an exception to raise.
    """

    def __init__(self, script: Callable[[int], None]) -> None:
        super().__init__(None, setup(), STREAM)  # nothing is sent
        self._script = script
        self.count = 0
        self.asked: list[tuple[int, int]] = []
        self.answer: Any = [0.0, 0.0, 0.0]

    def execute(self, command: str, parameter: Any) -> tuple[int, Any]:
        if command == "slvChangeMode":
            return 0, None
        assert command == "slvGetLateness"
        self.asked.append((self.count, parameter))
        if callable(self.answer):
            raise self.answer()
        return 0, self.answer

    def move(self, parameter: Any) -> Delivery:
        self.count += 1
        assert self.count < 5000
        self._script(self.count)
        return Delivery(monotonic(), monotonic(), 0, SlaveReply())


@pytest.fixture
def shared() -> Iterator[StreamMemory]:
    memory = StreamMemory.make()
    yield memory
    memory.close()


@pytest.fixture
def watch() -> Iterator[ParentMonitor]:
    """Monitors the parent of this process, over a channel."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ParentMonitor(Channel(theirs), os.getppid())


def commands(shared: StreamMemory, script: Callable[[int], None]) -> list[tuple[float, ...]]:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        watch = ParentMonitor(Channel(theirs), os.getppid())
        Streamer(setup(), Controller(script), shared, watch, JointPlanner(LIMITS, PERIOD, HOME)).run()
    samples = [shared.sample(number) for number in range(shared.samples)]
    return [sample.command for sample in samples if sample is not None]


def test_a_target_that_is_being_written_is_no_reason_to_brake(shared: StreamMemory) -> None:
    def script(cycle: int) -> None:
        if cycle == 2:
            shared.set_target((40.0, *HOME[1:]), monotonic_ns())
        elif cycle == 10:  # the program is suspended while it writes the next one
            shared._words[_Word.TARGET_BEGUN] += 1
        elif cycle == 1000:
            shared.order(StreamCommand.LEAVE)

    made = commands(shared, script)
    assert made[-1][0] == pytest.approx(40.0)
    steps = [after[0] - before[0] for before, after in pairwise(made)]
    first = next(place for place, step in enumerate(steps) if step > 0)
    fastest = steps.index(max(steps))
    assert all(after >= before for before, after in pairwise(steps[first : fastest + 1]))


def test_a_target_before_a_halt_is_not_taken_up_again(shared: StreamMemory) -> None:
    def script(cycle: int) -> None:
        if cycle == 2:
            shared.set_target((150.0, *HOME[1:]), monotonic_ns())
        elif cycle == 30:
            shared.order(StreamCommand.HALT)
        elif cycle == 200:
            shared._words[_Word.TARGET_BEGUN] += 1  # of another target, which is incomplete
            shared.order(StreamCommand.RUN)
        elif cycle == 300:
            shared.order(StreamCommand.LEAVE)

    made = commands(shared, script)
    assert 0.0 < made[200][0] < 150.0
    assert {command[0] for command in made[200:]} == {made[200][0]}


@pytest.mark.parametrize(
    ("number", "changes"),
    [
        (0x202, {}),
        (0x201, {"limits": PathLimits(100.0, 200.0, 300.0, 40.0, 50.0, 60.0), "start": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)}),
        (
            0x102,
            {"window": UserWindow(128, 16), "outputs": Outputs(1, 2, (128, b"\x01\xff")), "unlimited_joints": (0.5,)},
        ),
        (0x002, {"receive": ReceiveFormat(0x14, microseconds=False), "send": SendBits(0x20), "idle": 2.5}),
    ],
)
def test_what_the_process_is_told_arrives(number: int, changes: dict[str, Any]) -> None:
    mode = mode_of(number)
    assert mode is not None
    told = dataclasses.replace(setup(), mode=mode, **changes)
    assert StreamerConfig.from_message(json.loads(json.dumps(told.to_message()))) == told


# --- a program that is stopped ----------------------------------------------------------------------------------------


class Times:
    """A clock that a test controls, and the state of the program (stopped or not)."""

    def __init__(self, watch: ParentMonitor, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.stopped = False
        monkeypatch.setattr("orinkit.streaming.process.streamer.monotonic", lambda: self.now)
        monkeypatch.setattr(watch, "_is_stopped", lambda: self.stopped)


@pytest.fixture
def times(watch: ParentMonitor, monkeypatch: pytest.MonkeyPatch) -> Times:
    return Times(watch, monkeypatch)


def test_how_long_a_program_may_be_stopped(watch: ParentMonitor, times: Times) -> None:
    """A program may be stopped for as long as a machine may stall, repeatedly."""
    story = [  # s that pass, whether the program is stopped then, whether it has been stopped for too long
        (1.0, False, ""),
        (0.03, True, ""),
        (0.2, True, ""),
        (0.04, True, ""),
        (0.03, False, ""),
        (0.03, True, ""),
        (0.24, True, ""),
        (0.03, True, "stopped"),
        (5.0, True, "stopped"),
        (0.03, False, ""),
        (0.03, True, ""),
    ]
    for seconds, times.stopped, reason in story:
        times.now += seconds
        assert watch.end_reason() == reason


def test_it_is_looked_at_fifty_times_a_second(watch: ParentMonitor, times: Times) -> None:
    looks: list[float] = []
    watch._is_stopped = lambda: looks.append(times.now) is not None
    for _ in range(1000):
        times.now += 0.001
        watch.end_reason()
    assert 45 <= len(looks) <= 50


@pytest.mark.parametrize(("cycles", "goes_on"), [(1, True), (31, True), (40, False), (500, False)])
def test_a_program_that_is_stopped_while_it_streams(
    shared: StreamMemory, watch: ParentMonitor, times: Times, cycles: int, goes_on: bool
) -> None:
    """If the program is stopped for less than 0.25 s, the arm continues to its live target; otherwise it stops."""

    def script(cycle: int) -> None:
        times.now += PERIOD
        if cycle == 2:
            shared.set_target((150.0, *HOME[1:]), monotonic_ns())
        times.stopped = 20 <= cycle < 20 + cycles
        if cycle == 1000:
            shared.order(StreamCommand.LEAVE)

    controller = Controller(script)
    reason = Streamer(setup(), controller, shared, watch, JointPlanner(LIMITS.scaled(0.1, 0.1), PERIOD, HOME)).run()
    assert reason == ("left" if goes_on else "stopped")
    last = shared.sample(shared.samples - 1)
    assert last is not None
    assert (last.command[0] == pytest.approx(150.0)) is goes_on
    assert goes_on or controller.count < 200


def test_the_state_of_a_process_that_is_stopped(watch: ParentMonitor) -> None:
    """The state is that reported by the system."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        looking = ParentMonitor(watch._channel, child.pid)
        try:
            assert not looking._is_stopped()
            with stopped(child.pid):
                until(looking._is_stopped)
            until(lambda: not looking._is_stopped())
        finally:
            child.kill()
    until(lambda: not looking._is_stopped())  # it has ended
    assert not ParentMonitor(watch._channel, child.pid)._is_stopped()


# --- how late set-points were -----------------------------------------------------------------------------------------


def not_implemented() -> Exception:
    return error_for(hresult.E_NOTIMPL)


def no_answer() -> Exception:
    return CallTimeout("Robot_Execute", 3.0, 1)


def late(shared: StreamMemory, watch: ParentMonitor, controller: Controller) -> None:
    reports_lateness = controller.lateness(0) is not None
    Streamer(
        setup(), controller, shared, watch, JointPlanner(LIMITS, PERIOD, HOME), reports_lateness=reports_lateness
    ).run()


def test_a_controller_is_asked_when_the_arm_has_come_to_rest(shared: StreamMemory, watch: ParentMonitor) -> None:
    """The query is sent once, without those already reported, before the program can see that the arm stands."""

    def script(cycle: int) -> None:
        if cycle in (100, 600):
            shared.set_target((10.0 if cycle == 100 else 20.0, *HOME[1:]), monotonic_ns())
            controller.answer = [2.0, 0.1, 0.15] if cycle == 100 else [1.0, 0.02, 0.02]
        elif cycle == 1200:
            shared.order(StreamCommand.LEAVE)
        rested[cycle] = shared.lateness_queried
        told[cycle] = shared.lateness

    rested: dict[int, bool] = {}
    told: dict[int, Lateness] = {}
    controller = Controller(script)
    late(shared, watch, controller)
    (before, start, first, second) = controller.asked
    assert before == (0, 0)  # slave mode is not on yet
    assert start[0] < 100 < first[0] < 600 < second[0] < 1200
    assert [start[1], first[1], second[1]] == [0, 0, 2]
    for moment, known, then in (
        (first[0], Lateness(), Lateness(2, 0.1, 0.15)),
        (second[0], Lateness(2, 0.1, 0.15), Lateness(3, 0.02, pytest.approx(0.17))),
    ):
        assert (rested[moment], told[moment]) == (False, known)
        assert (rested[moment + 1], told[moment + 1]) == (True, then)


@pytest.mark.parametrize(
    "answer",
    [
        not_implemented,
        lambda: error_for(hresult.E_INVALID_CMD_NAME),
        no_answer,
        "1",
        None,
        [1.0, 2.0],
        [1.0, math.nan, 2.0],
        [True, 1.0, 2.0],
    ],
)
def test_a_controller_that_does_not_tell_is_asked_once(shared: StreamMemory, watch: ParentMonitor, answer: Any) -> None:
    def script(cycle: int) -> None:
        if cycle == 10:
            shared.set_target((10.0, *HOME[1:]), monotonic_ns())
        elif cycle == 500:
            shared.order(StreamCommand.LEAVE)

    controller = Controller(script)
    controller.answer = answer
    late(shared, watch, controller)
    assert controller.asked == [(0, 0)]
    assert shared.lateness == Lateness()
    last = shared.sample(shared.samples - 1)
    assert last is not None
    assert last.command[0] == pytest.approx(10.0)


@pytest.mark.parametrize("answer", [not_implemented, no_answer, "garbage"])
def test_a_controller_that_stops_reporting_late_set_points(
    shared: StreamMemory, watch: ParentMonitor, answer: Any
) -> None:
    """The stream continues, and the reports so far count."""

    def script(cycle: int) -> None:
        if cycle == 10:
            shared.set_target((10.0, *HOME[1:]), monotonic_ns())
            controller.answer = [1.0, 0.1, 0.1]
        elif cycle == 500:
            shared.set_target((20.0, *HOME[1:]), monotonic_ns())
            controller.answer = answer
        elif cycle == 1000:
            shared.order(StreamCommand.LEAVE)

    controller = Controller(script)
    late(shared, watch, controller)
    assert [skip_first for _, skip_first in controller.asked] == [0, 0, 0, 1]
    assert shared.lateness == Lateness(1, 0.1, 0.1)
    last = shared.sample(shared.samples - 1)
    assert last is not None
    assert last.command[0] == pytest.approx(20.0)


# --- outputs ----------------------------------------------------------------------------------------------------------


def test_a_change_of_outputs_does_not_replace_one_that_was_not_read(shared: StreamMemory) -> None:
    shared.set_outputs(Outputs(mini=1, hand=2))
    shared.set_outputs(Outputs(hand=3))
    assert shared.newer_outputs(0) == (2, Outputs(mini=1, hand=3))


def test_a_change_of_outputs_does_not_repeat_one_that_was_read(shared: StreamMemory) -> None:
    shared.set_outputs(Outputs(mini=1))
    assert shared.newer_outputs(0) == (1, Outputs(mini=1))
    shared.set_outputs(Outputs(hand=3))
    assert shared.newer_outputs(1) == (2, Outputs(hand=3))
    assert shared.newer_outputs(2) is None


def test_the_last_outputs_are_those_sent_and_the_changes_that_were_not_read(shared: StreamMemory) -> None:
    assert shared.last_outputs == Outputs()
    shared.report_outputs(Outputs(mini=1, hand=2))
    assert shared.last_outputs == Outputs(mini=1, hand=2)
    shared.set_outputs(Outputs(hand=3))
    assert shared.last_outputs == Outputs(mini=1, hand=3)
