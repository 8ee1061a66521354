"""Set-points that are too late for a real controller are counted, if the controller reports them.

The test controls the controller's clock, which stands still while the streaming process is stopped: nothing depends on
real time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import nan
from typing import Any

import pytest

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.rc8.slave_lateness import COMMAND, Lateness
from orinkit.values.poses import J
from orinkit.values.variant import R8_ARRAY, Variant
from orinkit.virtual.rc8.objects.robot_commands import ROBOT_COMMANDS, RobotCommand
from orinkit.virtual.rc8.objects.slave_use import SlaveUse
from support.both import Both
from support.hand import Hand
from support.stopping import stopped
from support.streams import HOME, PERIOD, Arm, by_hand, sine
from support.waiting import until

pytestmark = pytest.mark.longest_wait

POINTS = sine(0.8, 5.0)


class Bench:
    """A stream, and the means to stop its process while the arm moves."""

    def __init__(self, both: Both, arm: Arm, hand: Hand) -> None:
        self.both = both
        self.arm = arm
        self.hand = hand

    def stream(self, body: Callable[[Any], None], **options: Any) -> None:
        rc8 = self.both.connect(self.arm.url)
        robot = self.both.run(rc8.robot("Arm"))
        self.both.within(robot.arm(), lambda _: self.both.within(robot.slave_mode(**options), body))
        self.both.run(rc8.close())

    @contextmanager
    def late(self, stream: Any, *seconds: float) -> Iterator[None]:
        """Delay a set-point each time that the first joint has moved a little."""
        left = list(seconds)
        joint = 1.0

        def between() -> None:
            nonlocal joint
            if left and self.arm.arm.queue.joints[0] > joint:
                with stopped(stream._streaming._process.pid):
                    until(lambda: self.hand.let_pass(PERIOD + left[0]) or self.hand.move())  # its buffer is empty
                    del left[0]
                    joint = self.arm.arm.queue.joints[0] + 0.2

        self.hand.between = between
        yield
        assert left == []


@pytest.fixture
def bench(both: Both) -> Iterator[Bench]:
    with by_hand(joints=HOME) as (arm, hand):
        yield Bench(both, arm, hand)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_late_set_points_are_counted_and_measured(bench: Bench, mode: int) -> None:
    results: list[Any] = []

    def body(stream: Any) -> None:
        with bench.late(stream, 0.06, 0.1, 0.03):
            results.append(bench.both.run(stream.run(POINTS)))
        results.append(bench.both.run(stream.run(POINTS)))  # of another trajectory, without disturbance

    bench.stream(body, mode=mode)
    first, second = results
    assert first.late == Lateness(3, pytest.approx(0.1), pytest.approx(0.19))
    assert str(first).endswith("; 3 late set-points, by up to 100 ms")
    assert first.underflows == 0
    assert second.late == Lateness()
    assert "late" not in str(second)
    assert bench.arm.device.set_point_lateness == first.late
    assert bench.arm.errors == []
    assert bench.arm.within_limits()
    assert bench.arm.carried_out(POINTS) or mode == 1


def test_a_trajectory_is_not_told_of_what_was_late_before_it(bench: Bench) -> None:
    """The delay begins as soon as the arm stands at the live target."""
    there = (5.0, *HOME[1:])
    results: list[Any] = []

    def body(stream: Any) -> None:
        with bench.late(stream, 0.05):
            stream.target = J(*there)
            results.append(bench.both.run(stream.run(sine(0.8, 5.0, home=there))))

    bench.stream(body)
    assert results[0].late == Lateness()
    assert bench.arm.device.set_point_lateness.count == 1


def test_strict_time_waits_for_nobody(both: Both) -> None:
    with by_hand(joints=HOME, strict_time=True) as (arm, hand):
        bench = Bench(both, arm, hand)

        def body(stream: Any) -> None:
            with bench.late(stream, 0.0), pytest.raises(CallError) as told:
                both.run(stream.run(POINTS))
            assert told.value.code == hresult.COMMAND_DELAY
            until(lambda: not arm.arm.busy)

        bench.stream(body)
        assert arm.errors == [hresult.COMMAND_DELAY]
        assert arm.device.set_point_lateness == Lateness()
        assert arm.within_limits()


def test_a_controller_does_not_wait_for_ever(bench: Bench) -> None:
    def body(stream: Any) -> None:
        with bench.late(stream, 0.26), pytest.raises(CallError, match="250 ms") as told:
            bench.both.run(stream.run(POINTS))
        assert told.value.code == hresult.COMMAND_DELAY
        until(lambda: not bench.arm.arm.busy)

    bench.stream(body)
    assert bench.arm.errors == [hresult.COMMAND_DELAY]
    assert bench.arm.within_limits()


def refuses(*_: object) -> Any:
    raise error_for(hresult.E_NOTIMPL)


@pytest.mark.parametrize(
    "answer",
    [
        None,
        refuses,
        lambda *_: "1",
        lambda *_: None,
        lambda *_: 3,
        lambda *_: Variant(R8_ARRAY, [1.0]),
        lambda *_: Variant(R8_ARRAY, [1.0, nan, 0.5]),
        lambda *_: Variant(R8_ARRAY, [-1.0, 0.5, 0.5]),
    ],
    ids=["unknown", "not implemented", "text", "nothing", "a number", "too few", "nan", "negative"],
)
def test_a_controller_that_does_not_tell(bench: Bench, monkeypatch: pytest.MonkeyPatch, answer: Any) -> None:
    """Like a real controller: it is queried before slave mode is on, and never again."""
    asked: list[bool] = []
    results: list[Any] = []

    def execute(*given: Any) -> Any:
        asked.append(bench.arm.arm.slave.on)
        return answer(*given)

    if answer is None:
        monkeypatch.delitem(ROBOT_COMMANDS, COMMAND.lower())
    else:
        monkeypatch.setitem(ROBOT_COMMANDS, COMMAND.lower(), RobotCommand(COMMAND, execute, slave_mode=SlaveUse.ALWAYS))

    def body(stream: Any) -> None:
        with bench.late(stream, 0.05):
            results.append(bench.both.run(stream.run(POINTS)))

    bench.stream(body)
    assert results[0].late == Lateness()
    assert results[0].sent == len(POINTS)
    assert bench.arm.device.set_point_lateness.count == 1
    assert asked == ([] if answer is None else [False])
    assert bench.arm.carried_out(POINTS)
    assert bench.arm.errors == []
