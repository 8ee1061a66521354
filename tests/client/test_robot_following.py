"""Motions that follow unfinished motions, and causes of stops: both clients against the virtual RC8."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import orinkit
from orinkit import J, P, T
from orinkit.client._shared.motion import MotionSegment, same_place
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.clocks import HeldClock
from support.waiting import until

HOME = J(0, 45, 90, 0, 45, 0)
LEFT = J(-30, 45, 90, 0, 45, 0)
RIGHT = J(20, 45, 90, 0, 45, 0)
PLACE = P(380, 0, 250, 180, 0, 180, 5)
OTHER = P(364, 20, 290, 180, 0, 180, 5)
SLOWLY = 0.1  # % of the speed: the motion takes far longer than the test before it is stopped

MARKS = ("@P", "@10", "@0", "@E", "")
FIRST: dict[str, Callable[[Any, str], Any]] = {
    "move": lambda r, mark: r.move(LEFT, mark),
    "raw move": lambda r, mark: r.move(1, f"{mark} J(-30, 45, 90, 0, 45, 0)".strip()),
    "approach": lambda r, mark: r.approach(PLACE, 20, mark),
    "depart": lambda r, mark: r.depart(30, mark, line=True),
    "drive": lambda r, mark: r.drive({1: -20}, mark),
}
SECOND: dict[str, Callable[[Any], Any]] = {
    "joints": lambda r: r.move(RIGHT, wait=False),
    "back": lambda r: r.move(HOME, wait=False),
    "position": lambda r: r.move(OTHER, wait=False),
    "trans": lambda r: r.move(T(364, 20, 290, 0, 1, 0, 0, 0, -1, 5), wait=False),
    "approach": lambda r: r.approach(OTHER, 20, wait=False),
    "depart": lambda r: r.depart(20, line=True, wait=False),
    "drive": lambda r: r.drive({1: 10}, wait=False),
}


@pytest.fixture
def clock() -> Iterator[HeldClock]:
    made = HeldClock()
    yield made
    made.close()


@pytest.fixture
def rc8(clock: HeldClock) -> Iterator[VirtualRC8]:
    device = VirtualRC8(clock=clock, language="en")
    yield device
    device.close()


@pytest.fixture
def url(rc8: VirtualRC8) -> Iterator[str]:
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield server.url


@pytest.fixture
def moving(both: Both, url: str) -> Iterator[Any]:
    """Return a robot with the arm taken and the motor on."""
    controller = both.connect(url)
    robot = both.run(controller.robot())
    both.run(robot.execute("TakeArm", [0, 0]))
    both.run(robot.execute("Motor", [1, 0]))
    yield robot
    both.run(controller.close())


def at_rest(both: Both, robot: Any) -> None:
    until(lambda: bool(both.run(robot.motion_complete(1))))


# --- no false stops -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("name", FIRST)
def test_a_motion_after_one_with_a_reply_at_its_pass_mark(both: Both, moving: Any, name: str, mark: str) -> None:
    """The first motion may still be executing; its end is not the end of the second."""
    for second in SECOND.values():
        both.run(moving.move(HOME))
        both.run(FIRST[name](moving, mark))
        motion = both.run(second(moving))
        both.run(motion.wait())
        assert both.run(moving.motion_complete())
        assert both.run(motion.get_done()) is True


@pytest.mark.parametrize("mark", ["@P", ""])
@pytest.mark.parametrize("name", FIRST)
def test_chains_of_three(both: Both, moving: Any, name: str, mark: str) -> None:
    for second in SECOND.values():
        both.run(moving.move(HOME))
        both.run(FIRST[name](moving, mark))
        middle = both.run(second(moving))
        last = both.run(moving.move(LEFT, wait=False))
        both.run(middle.wait())
        both.run(last.wait())
        at_rest(both, moving)
        assert both.run(moving.get_joints())[:6] == pytest.approx(LEFT, abs=1e-6)


def test_a_chain_after_raw_motions(both: Both, moving: Any) -> None:
    both.run(moving.move(1, "@P J(-30, 45, 90, 0, 45, 0)", "NEXT"))
    both.run(moving.move(1, "J(0, 45, 90, 0, 45, 0)", "SPEED=50,NEXT"))
    for use in SECOND.values():
        motion = both.run(use(moving))
    both.run(motion.wait())
    assert both.run(moving.motion_complete())


def test_a_chain_that_returns_to_an_earlier_end(both: Both, moving: Any, clock: HeldClock) -> None:
    """The third motion is not over when the first, with the same end, is."""
    ways = ((LEFT, 3), (HOME, 3), (LEFT, 3), (RIGHT, SLOWLY))
    with clock.held():
        motions = [both.run(moving.move(pose, speed=speed, wait=False)) for pose, speed in ways]
        assert [both.run(motion.get_done()) for motion in motions] == [False] * 4
    both.run(motions[2].wait())
    assert both.run(moving.get_joints())[0] < 0
    clock.advance(1000)
    both.run(motions[3].wait())
    assert [both.run(motion.get_done()) for motion in motions] == [True] * 4


def test_a_motion_that_was_commanded_by_another_object(both: Both, moving: Any) -> None:
    other = both.run(moving._parent.robot("Other"))
    both.run(other.move(LEFT, speed=20, wait=False))
    motion = both.run(moving.depart(20, line=True, wait=False))
    both.run(motion.wait())
    assert both.run(moving.motion_complete())


def test_motions_before_a_completed_motion_are_over(both: Both, moving: Any) -> None:
    first = both.run(moving.move(LEFT, wait=False))
    both.run(moving.move(RIGHT, speed=50))
    assert both.run(first.get_done()) is True


@pytest.mark.parametrize("mark", ["@P", "@10"])
def test_a_block_ends_at_standstill(both: Both, url: str, rc8: VirtualRC8, mark: str) -> None:
    controller = both.connect(url)
    robot = both.run(controller.robot())
    both.within(robot.arm(), lambda _: both.within(robot.motor(), lambda _: both.run(robot.move(LEFT, mark, speed=50))))
    at_rest(both, robot)
    assert both.run(robot.get_joints())[:6] == pytest.approx(LEFT, abs=1e-6)
    assert rc8.pendant.status()["motor"] == "off"
    both.run(controller.close())


# --- stops ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("name", SECOND)
def test_a_stop_after_a_motion_with_a_reply_at_its_pass_mark(
    both: Both, moving: Any, url: str, clock: HeldClock, name: str, mark: str
) -> None:
    both.run(moving.move(LEFT, mark))
    with clock.held():
        both.run(moving.put_ext_speed(2))
        motion = both.run(SECOND[name](moving))
        while both.run(motion.get_progress()) == 0:
            clock.advance(0.1)
        clock.pace(0.2)  # the motion would take several seconds
    with orinkit.connect(url) as other:
        other.robot().halt()
    with pytest.raises(CallError) as caught:
        both.run(motion.wait())
    assert caught.value.code == hresult.STOPPED_DURING_PC_MOTION
    assert "halted by another client or program" in caught.value.detail


@pytest.mark.parametrize(
    ("stop", "words"),
    [
        (lambda rc8, motion: rc8.pendant.emergency_stop(), "the emergency stop is pressed"),
        (lambda rc8, motion: rc8.pendant.protective_stop(), "the protective stop is on"),
        (lambda rc8, motion: rc8.pendant.mode(1), "the controller is in manual mode"),
        (lambda rc8, motion: rc8.pendant.mode(2), "the controller is in teach-check mode"),
        (
            lambda rc8, motion: rc8.raise_error(0x83204071, "axis 1"),
            "the motor is off; the controller reports 0x83204071",
        ),
        (lambda rc8, motion: motion.halt(), "halted by this program"),
    ],
)
def test_causes_of_stops(both: Both, moving: Any, rc8: VirtualRC8, stop: Callable[..., Any], words: str) -> None:
    motion = both.run(moving.move(LEFT, speed=SLOWLY, wait=False))
    result = stop(rc8, motion)
    if result is not None and both.kind == "async":
        both.run(result)
    with pytest.raises(CallError) as caught:
        both.run(motion.wait())
    assert caught.value.code == hresult.STOPPED_DURING_PC_MOTION
    assert f"; {words}" in caught.value.detail


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
def test_ctrl_c_during_a_motion_adds_one_note(rc8: VirtualRC8, url: str) -> None:
    def interrupt() -> None:
        until(lambda: bool(rc8.pendant.status()["moving"]))
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    with orinkit.connect(url) as controller:
        robot = controller.robot()
        thread = threading.Thread(target=interrupt)
        with pytest.raises(KeyboardInterrupt) as caught, robot.arm(), robot.motor():
            thread.start()
            robot.move(LEFT, speed=SLOWLY)
        thread.join()
    (note,) = caught.value.__notes__
    assert note.endswith(
        "the motion call was interrupted, so the connection was closed; the arm stops and its semaphore is released; "
        "the motor may still be on"
    )


# --- motion segments ------------------------------------------------------------------------------------------------


def test_a_segment_begins_when_the_destination_changes() -> None:
    way = MotionSegment()
    way.begin(MotionSegment.begun_to(HOME), HOME, HOME)
    assert [way.awaits_start, way.begun, way.end] == [True, False, None]
    way.see(LEFT)
    assert [way.awaits_start, way.begun, way.end] == [False, True, LEFT]
    assert not way.left_behind(LEFT)
    assert way.left_behind(RIGHT)


def test_a_segment_after_an_unknown_one_stays_unknown() -> None:
    way = MotionSegment()
    way.begin(MotionSegment(), None, HOME)
    way.see(LEFT)
    way.see(RIGHT)
    assert not way.begun
    assert way.end is None


def test_a_long_chain_is_not_tracked() -> None:
    way = MotionSegment.begun_to(HOME)
    for _ in range(10_000):
        new = MotionSegment(LEFT)
        new.begin(way, None, HOME)
        way = new
    way.see(LEFT)
    assert not way.begun


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (P(1, 2, 3, 180, 0, 180), P(1, 2, 3, -180, 0, -180), True),
        (P(1, 2, 3, 180, 0, 180), P(1, 2, 3, 0, 180, 0), True),
        (P(1, 2, 3, 10, 90, 0), P(1, 2, 3, 0, 90, -10), True),
        (P(1, 2, 3, 0, 0, 0, 5), P(1, 2, 3, 0, 0, 0, 1), True),
        (P(1, 2, 3, 0, 0, 0), P(1, 2, 3.2, 0, 0, 0), False),
        (P(1, 2, 3, 0, 0, 0), P(1, 2, 3, 0, 0, 1), False),
        (P(1, 2, 3, 0, 0, 0), P(1, 2, 3, 1, 0, 0), False),
    ],
)
def test_equal_positions(one: P, other: P, same: bool) -> None:
    assert same_place(one, other) is same
