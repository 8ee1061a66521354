"""Robots and motions of both clients: against the virtual RC8, and against a scripted robot."""

from __future__ import annotations

import asyncio
import gc
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import orinkit
from orinkit import J, P, T, V, aio
from orinkit import functions as f
from orinkit.cao import provider as p
from orinkit.cao.provider import BlockingCall, ClientInfo, Deferred, Provider
from orinkit.core import hresult, i18n
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectionClosed,
    InvalidValue,
    NotationError,
    ProtocolError,
    TransportError,
)
from orinkit.values.poses import PassMark, Target, parse_target
from orinkit.values.variant import Variant, plain
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.clocks import HeldClock
from support.devices import Call, Recorder
from support.waiting import TooSlow, until, with_longer_times

HOME = J(0, 45, 90, 0, 45, 0)
THERE = J(45, 30, 120, 0, -60, 0)
PATIENCE = 20.0
SLOWLY = 0.1  # % of the speed: the motion takes far longer than the test before it is stopped
SEVERAL = only("tcp", "udp", "http", because="a line has one client at a time")


# --- calls ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


@pytest.fixture
def recorded(both: Both, listen_at: str, recorder: Recorder) -> Iterator[Any]:
    with orinkit.serve(recorder, listen_at) as server:
        controller = both.connect(server.url, provider="Test.Recorder", name="RC")
        yield both.run(controller.robot())
        both.run(controller.close())


MOVE, EXECUTE = "Robot_Move", "Robot_Execute"


@pytest.mark.parametrize(
    ("use", "function", "arguments"),
    [
        (lambda r: r.move(THERE), MOVE, (1, "J(45, 30, 120, 0, -60, 0)", "")),
        (lambda r: r.move(THERE, "@E", speed=20), MOVE, (1, "@E J(45, 30, 120, 0, -60, 0)", "SPEED=20")),
        (lambda r: r.move("P1"), MOVE, (1, "P1", "")),
        (lambda r: r.move("@P P1", accel=50.5, decel=1), MOVE, (1, "@P P1", "ACCEL=50.5,DECEL=1")),
        (lambda r: r.move(P(1, 2, 3, 4, 5, 6, 5), PassMark("n", 12.5)), MOVE, (1, "@12.5 P(1, 2, 3, 4, 5, 6, 5)", "")),
        (lambda r: r.move(pose=Target("J", 3), mark="@0", time=1.5), MOVE, (1, "@0 J3", "TIME=1500")),
        (lambda r: r.move(parse_target("P2 EX((7, 30))"), time=0.0001), MOVE, (1, "P2 EX((7, 30))", "TIME=1")),
        (lambda r: r.move_l(T(1, 2, 3, 0, 1, 0, 0, 0, -1)), MOVE, (2, "T(1, 2, 3, 0, 1, 0, 0, 0, -1, -1)", "")),
        (lambda r: r.move_l("P1", "@10", speed=0.00001), MOVE, (2, "@10 P1", "SPEED=0.00001")),
        (lambda r: r.move_c("P1", "P2", "@E", speed=5), MOVE, (3, "P1, @E P2", "SPEED=5")),
        (lambda r: r.move_s(3), MOVE, (4, "3", "")),
        (lambda r: r.move_s(3, "@E", wait=True), MOVE, (4, "@E 3", "")),
        (lambda r: r.move_s(["P1", "P2", HOME], "@P"), MOVE, (4, "P1, P2, @P J(0, 45, 90, 0, 45, 0)", "")),
        (lambda r: r.approach("P1", 50), EXECUTE, ("Approach", [1, "P1", "@0 50"])),
        (lambda r: r.approach("P1", 50.5, "@P", line=True, speed=9), EXECUTE, ("Approach", [2, "P1", "@P 50.5", "SPEED=9"])),
        (lambda r: r.depart(1e-7, line=True), EXECUTE, ("Depart", [2, "@0 0.0000001"])),
        (lambda r: r.drive({1: 10, 2: -5.5}), EXECUTE, ("DriveEx", ["@0 (1,10),(2,-5.5)"])),
        (lambda r: r.drive({7: 1}, "@E", absolute=True, speed=3), EXECUTE, ("DriveAEx", ["@E (7,1)", "SPEED=3"])),
        # the form of CAO
        (lambda r: r.move(1, "P1"), MOVE, (1, "P1", "")),
        (lambda r: r.move(2, [1.0, 2.0, 3.0], "NEXT"), MOVE, (2, [1.0, 2.0, 3.0], "NEXT")),
        (lambda r: r.move(interpolation=1, pose="P1", option="Next"), MOVE, (1, "P1", "Next")),
        # a pose is never sent as bare numbers
        (lambda r: r.move(1, J(10, 30, 100, 0, 50, 0)), MOVE, (1, "J(10, 30, 100, 0, 50, 0)", "")),
        (lambda r: r.move(2, P(1, 2, 3, 4, 5, 1 / 3)), MOVE, (2, "P(1, 2, 3, 4, 5, 0.3333333333333333, -1)", "")),
        (lambda r: r.move(1, [[HOME, "@E"], T(1, 2, 3, 0, 1, 0, 0, 0, -1)]), MOVE,
         (1, [["J(0, 45, 90, 0, 45, 0)", "@E"], "T(1, 2, 3, 0, 1, 0, 0, 0, -1, -1)"], "")),
        (lambda r: r.move(1, Target("J", 3, PassMark("E"))), MOVE, (1, "@E J3", "")),
        (lambda r: r.move(1, [[1.0] * 6, "J", "@E"]), MOVE, (1, [[1.0] * 6, "J", "@E"], "")),
        (lambda r: r.move(1, [1.0] * 8), MOVE, (1, [1.0] * 8, "")),
        (lambda r: r.move(1, "J(0,45"), MOVE, (1, "J(0,45", "")),
        (lambda r: r.move(4, 3), MOVE, (4, 3, "")),
        (lambda r: r.rotate(["XY", V(0, 0, 1)], 45, V(1, 2, 3)), "Robot_Rotate", (["XY", "V(0, 0, 1)"], 45.0, "V(1, 2, 3)", "")),
        (lambda r: r.execute("OutRange", HOME), EXECUTE, ("OutRange", "J(0, 45, 90, 0, 45, 0)")),
        (lambda r: r.execute("Approach", [1, (P(1, 2, 3, 4, 5, 6), [J(1)]), "@P 5"]), EXECUTE,
         ("Approach", [1, ["P(1, 2, 3, 4, 5, 6, -1)", ["J(1)"]], "@P 5"])),
        (lambda r: r.drive(1, 10), "Robot_Drive", (1, 10.0, "")),
        (lambda r: r.drive(axis=1, value=10, option="NEXT"), "Robot_Drive", (1, 10.0, "NEXT")),
        (lambda r: r.rotate("XY", 45, "V(0, 0, 0)", "@E,NEXT"), "Robot_Rotate", ("XY", 45.0, "V(0, 0, 0)", "@E,NEXT")),
        (lambda r: r.go_home(), "Robot_GoHome", ()),
        # settings
        (lambda r: r.put_ext_speed(50), EXECUTE, ("ExtSpeed", [50.0])),
        (lambda r: r.put_tool(3), "Robot_Change", ("Tool3",)),
        (lambda r: r.put_work(2), "Robot_Change", ("Work2",)),
        (lambda r: r.set_tool(1, P(0, 0, 100, 0, 0, 0)), EXECUTE, ("SetToolDef", [1, "P(0, 0, 100, 0, 0, 0, -1)"])),
        (lambda r: r.set_work(1, "P1"), EXECUTE, ("SetWorkDef", [1, "P1"])),
    ],
)  # fmt: skip
def test_a_method_is_one_call(
    both: Both, recorder: Recorder, recorded: Any, use: Callable[[Any], Any], function: str, arguments: tuple[Any, ...]
) -> None:
    del recorder.calls[:]
    both.run(use(recorded))
    assert recorder.calls == [Call(function, "RC/Arm", arguments)]


@pytest.mark.parametrize(
    ("use", "words"),
    [
        (lambda r: r.move(HOME, speed=0), "above 0 and at most 100"),
        (lambda r: r.move(HOME, speed=100.5), "100.5"),
        (lambda r: r.move(HOME, speed=float("nan")), "nan"),
        (lambda r: r.move(HOME, accel=float("inf")), "inf"),
        (lambda r: r.move(HOME, decel=10**400), "decel"),
        (lambda r: r.move(HOME, speed="fast"), "'fast'"),
        (lambda r: r.move(HOME, time=-1), "time"),
        (lambda r: r.move(HOME, time=1e9), "3600"),
        (lambda r: r.move([1.0, 2.0]), "not a pose"),
        (lambda r: r.move(None), "not a pose"),
        (lambda r: r.move("@E P1", "@E"), "pass mark"),
        (lambda r: r.move(HOME, 10), '10 is not a pass mark. Try: a text, "@P"'),
        (lambda r: r.move_l(HOME, None), "None is not a pass mark"),
        (lambda r: r.drive({1: 1}, 10), "10 is not a pass mark"),
        (lambda r: r.depart(10, 10), "10 is not a pass mark"),
        (
            lambda r: r.move(1, [0.0, 45, 90, 0, 45, 0]),
            r"6 numbers may be joints or a position. Try: J\(...\) or P\(...\)",
        ),
        (lambda r: r.move(2, (0, 45, 90, 0, 45, 0), "NEXT"), "6 numbers"),
        (lambda r: r.move(interpolation=1, pose=Variant(0x2005, [0.0] * 6)), "6 numbers"),
        (lambda r: r.move("J(0,45"), r"'J\(0,45' is not a pose: column 7: .*move\(1, text\)"),
        (lambda r: r.move("X(0,45)"), "column 1"),
        (lambda r: r.move_l("P(1,2,3"), "column 8"),
        (lambda r: r.move_c("P1", "P("), "column 3"),
        (lambda r: r.move_c("P(", "P1"), "column 3"),
        (lambda r: r.move_s(["P1", "P2 x"]), "column 4"),
        (lambda r: r.approach("J(0,,1)", 50), "column 5"),
        (lambda r: r.set_tool(1, "P(1"), "column 4"),
        (lambda r: r.move_s([]), "path"),
        (lambda r: r.move_s("P1"), "list of poses"),
        (lambda r: r.move_s(-1), "-1"),
        (lambda r: r.move_s(HOME), "list of poses"),
        (lambda r: r.approach("P1", float("nan")), "distance"),
        (lambda r: r.depart("far"), "distance"),
        (lambda r: r.drive({}), "axes from 1 to 8"),
        (lambda r: r.drive({0: 1}), "1 to 8"),
        (lambda r: r.drive({9: 1}), "1 to 8"),
        (lambda r: r.drive({"1": 1}), "1 to 8"),
        (lambda r: r.drive({1: float("inf")}), "J1"),
        (lambda r: r.drive([(1, 10)]), "axes from 1 to 8"),
        (lambda r: r.execute(5), "command"),
        (lambda r: r.move(1, "P1", 5), "option"),
        (lambda r: r.to_joints(HOME), "cannot be converted to J"),
        (lambda r: r.to_position(V(1, 2, 3)), "cannot be converted to P"),
    ],
)
def test_invalid_arguments_are_refused_before_anything_is_sent(
    both: Both, recorder: Recorder, recorded: Any, use: Callable[[Any], Any], words: str
) -> None:
    del recorder.calls[:]
    with pytest.raises(InvalidValue, match=words) as caught:
        both.run(use(recorded))
    english = str(caught.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as caught:
        both.run(use(recorded))
    assert str(caught.value) != english
    assert recorder.calls == []


@pytest.mark.parametrize(
    ("use", "error", "words"),
    [
        (lambda r: r.move(HOME, "E"), NotationError, "@"),
        (lambda r: r.to_joints("Q1"), NotationError, "column 1"),
        (lambda r: r.move(HOME, sped=1), TypeError, "'sped'.*speed, accel"),
        (lambda r: r.drive({1: 1}, spede=1), TypeError, "'spede'"),
        (lambda r: r.move(1), TypeError, r"Robot.move\(\): missing .*'pose'. Try: move\("),
        (lambda r: r.move(), TypeError, "pose"),
        (
            lambda r: r.move(0, 45, 90, 0, 45, 0),
            TypeError,
            r"Robot.move\(\) takes a pose.*move\(J\(0, 45, 90, 0, 45, 0\)\)",
        ),
        (lambda r: r.move(0.5, 45.0, 90.0), TypeError, r"move\(J\(0.5, 45, 90\)\)"),
        (lambda r: r.move(HOME, "@E", "SPEED=5"), TypeError, r"Robot.move\(\): too many"),
        (lambda r: r.move(1, "P1", speed=5), TypeError, r"Robot.move\(\): .*'speed'"),
        (lambda r: r.drive(1), TypeError, r"Robot.drive\(\): missing .*'value'"),
    ],
)
def test_other_wrong_arguments(
    both: Both, recorder: Recorder, recorded: Any, use: Callable[[Any], Any], error: type[Exception], words: str
) -> None:
    del recorder.calls[:]
    with pytest.raises(error, match=words):
        both.run(use(recorded))
    assert recorder.calls == []


def test_poses_in_the_parameters_of_a_command(both: Both, recorder: Recorder, recorded: Any) -> None:
    command = both.run(recorded._parent.command("Job"))
    del recorder.calls[:]
    both.run(command.put_parameters([1, [HOME], P(1, 2, 3, 4, 5, 6)]))
    (call,) = recorder.calls
    assert call.arguments == ([1, ["J(0, 45, 90, 0, 45, 0)"], "P(1, 2, 3, 4, 5, 6, -1)"],)


def test_a_variable_takes_the_numbers_of_a_pose(both: Both, recorder: Recorder, recorded: Any) -> None:
    variable = both.run(recorded.variable("J1"))
    del recorder.calls[:]
    both.run(variable.put_value(HOME))
    (call,) = recorder.calls
    assert call.arguments == ([0.0, 45.0, 90.0, 0.0, 45.0, 0.0],)


def test_a_list_without_an_end(both: Both, recorded: Any) -> None:
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(InvalidValue):
        both.run(recorded.execute("OutRange", endless))


def test_a_deleted_robot_is_released_before_the_next_object(both: Both, recorder: Recorder, recorded: Any) -> None:
    """A finished motion creates no reference cycle, so that no garbage collection is required."""
    controller = recorded._parent
    gc.disable()
    try:
        robot = both.run(controller.robot("Second"))
        motion = both.run(robot.move(HOME))
        assert "over" in repr(motion)
        del robot, motion
        both.run(controller.variable("V"))
    finally:
        gc.enable()
    assert Call("Robot_Release", "RC/Second", ()) in recorder.calls


# --- against the virtual RC8 ----------------------------------------------------------------------------------------


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
def url(listen_at: str, rc8: VirtualRC8) -> Iterator[str]:
    with orinkit.serve(rc8, listen_at, alive=60.0) as server:  # a busy machine may delay signs of life by 2 s
        yield server.url


@pytest.fixture
def robot(both: Both, url: str) -> Iterator[Any]:
    controller = both.connect(url)
    yield both.run(controller.robot())
    both.run(controller.close())


@pytest.fixture
def moving(both: Both, robot: Any) -> Any:
    """Return a robot with the arm taken and the motor on."""
    both.run(robot.execute("TakeArm", [0, 0]))
    both.run(robot.execute("Motor", [1, 0]))
    return robot


def standing_at(joints: J) -> Any:
    return pytest.approx([*joints, *[0.0] * (8 - len(joints))], abs=1e-6)


def progress_of(both: Both, motion: Any, then: Callable[[], object] = lambda: None) -> list[float]:
    """Return the progress values of a motion until it is over; call a function after each."""
    if both.kind == "sync":
        return [(fraction, then())[0] for fraction in motion]

    async def collect() -> list[float]:
        return [(fraction, then())[0] async for fraction in motion]

    return both.run(collect())


def finished(both: Both, motion: Any) -> None:
    """Wait for a motion: ``motion.wait()`` or ``await motion``."""
    both.run(motion.wait() if both.kind == "sync" else motion)


def test_a_motion_that_is_waited_for(both: Both, moving: Any) -> None:
    motion = both.run(moving.move(THERE, "@E", speed=50))
    assert both.run(moving.get_joints()) == standing_at(THERE)
    assert both.run(motion.get_done()) is True
    assert both.run(motion.get_progress()) == 1.0
    assert progress_of(both, motion) == [1.0]
    finished(both, motion)
    assert both.run(moving.get_moving()) is False


def test_a_motion_without_waiting(both: Both, moving: Any, clock: HeldClock) -> None:
    with clock.held():  # the motion takes 7 s
        motion = both.run(moving.move(THERE, speed=5, wait=False))
        assert both.run(moving.get_moving()) is True
        assert both.run(moving.get_destination()) == standing_at(THERE)
        fractions = progress_of(both, motion, lambda: clock.advance(0.6))
    assert fractions == sorted(fractions)
    assert len(set(fractions)) > 3
    assert fractions[-1] == 1.0
    assert all(0.0 <= fraction < 1.0 for fraction in fractions[:-1])
    assert both.run(motion.get_done()) is True
    finished(both, motion)
    until(lambda: both.run(moving.motion_complete(1)))  # the encoders lag behind the command
    assert both.run(moving.get_joints()) == pytest.approx([*THERE, 0, 0], abs=0.1)


def test_waiting_has_a_limit(both: Both, moving: Any) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    with pytest.raises(TimeoutError, match=r"after 0\.05 s"):
        both.run(motion.wait(0.05))
    assert both.run(moving.get_moving()) is True
    both.run(motion.halt())


@pytest.mark.parametrize(
    "use",
    [
        lambda r: r.move_l("P(380, 0, 250, 180, 0, 180, 5)", wait=False),
        lambda r: r.move_c(P(370, 30, 270, 180, 0, 180, 5), P(360, 60, 270, 180, 0, 180, 5), wait=False),
        lambda r: r.move_s([P(370, 30, 270, 180, 0, 180, 5), P(360, 60, 270, 180, 0, 180, 5)], wait=False),
        lambda r: r.approach(P(380, 0, 250, 180, 0, 180, 5), 20, wait=False),
        lambda r: r.depart(20, line=True, wait=False),
        lambda r: r.drive({1: 10, 2: -5}, wait=False),
        lambda r: r.drive({1: 10}, absolute=True, wait=False),
    ],
)
def test_the_progress_of_all_kinds_of_motions(both: Both, moving: Any, use: Callable[[Any], Any]) -> None:
    motion = both.run(use(moving))
    end = both.run(moving.get_destination())
    assert progress_of(both, motion)[-1] == 1.0
    until(lambda: both.run(moving.motion_complete(1)))
    assert both.run(moving.get_joints()) == pytest.approx(list(end), abs=1e-6)


def test_motions_that_follow_each_other(both: Both, moving: Any, clock: HeldClock) -> None:
    """The first motion is over when the robot executes the second, which begins at the end of the first."""
    with clock.held():
        first = both.run(moving.move(THERE, "@P", speed=10, wait=False))
        second = both.run(moving.move(HOME, speed=SLOWLY, wait=False))  # the motion takes 350 s
        assert both.run(first.get_done()) is False
        assert both.run(second.get_progress()) == 0.0
    finished(both, first)
    assert both.run(second.get_done()) is False
    fractions = progress_of(both, second, lambda: clock.advance(40))
    assert fractions == sorted(fractions)
    assert len(set(fractions)) > 2
    assert both.run(first.get_done()) is True


@SEVERAL
def test_a_motion_whose_follower_is_stopped_is_over(both: Both, moving: Any, url: str) -> None:
    first = both.run(moving.move(THERE, speed=50, wait=False))
    second = both.run(moving.move(HOME, speed=SLOWLY, wait=False))
    finished(both, first)
    halt_from_elsewhere(url)
    with pytest.raises(CallError) as caught:
        finished(both, second)
    assert caught.value.code == hresult.STOPPED_DURING_PC_MOTION
    assert both.run(first.get_done()) is True


@SEVERAL
def test_a_stop_before_a_queued_motion_begins_is_reported_for_it(both: Both, moving: Any, url: str) -> None:
    both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    for pose in (HOME, P(380, 0, 250, 180, 0, 180, 5)):
        second = both.run(moving.move(pose, wait=False))
    halt_from_elsewhere(url)
    with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
        finished(both, second)


def halt_from_elsewhere(url: str) -> None:
    with orinkit.connect(url) as other:
        other.robot().halt()


@SEVERAL
def test_another_client_halts(both: Both, moving: Any, url: str) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    assert both.run(motion.get_progress()) < 1
    halt_from_elsewhere(url)
    for ask in (motion.get_done, motion.get_progress, motion.wait, motion.get_done):
        with pytest.raises(CallError) as caught:
            both.run(ask())
        error = caught.value
        assert error.code == hresult.STOPPED_DURING_PC_MOTION
        assert (error.function, error.subject) == ("Robot_Move", "Arm")
        assert error.arguments[1:] == (1, "J(45, 30, 120, 0, -60, 0)", "SPEED=0.1,NEXT")
        assert "the arm stopped at J(" in str(error)
        assert ", target J(45, 30, 120, 0, -60, 0)" in str(error)
    with pytest.raises(CallError):
        progress_of(both, motion)
    assert "stopped" in repr(motion)
    both.run(moving.move(HOME))  # the next motion is not affected


@SEVERAL
def test_another_client_halts_a_motion_that_is_waited_for(both: Both, moving: Any, rc8: VirtualRC8, url: str) -> None:
    def halt() -> None:
        until(lambda: bool(rc8.pendant.status()["moving"]))
        halt_from_elsewhere(url)

    thread = threading.Thread(target=halt)
    thread.start()
    with pytest.raises(CallError) as caught:
        both.run(moving.move(THERE, speed=SLOWLY))
    thread.join()
    assert caught.value.code == hresult.STOPPED_DURING_PC_MOTION


def test_the_error_contains_the_cause_of_a_stop(both: Both, moving: Any, rc8: VirtualRC8) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    rc8.raise_error(0x83204071, "axis 1 is at its limit")
    rc8.raise_error(hresult.COMMAND_GENERATION_STOPPED)
    with pytest.raises(CallError, match=r"the controller reports 0x83204071 axis 1 is at its limit"):
        finished(both, motion)


def test_the_emergency_stop_ends_a_motion(both: Both, moving: Any, rc8: VirtualRC8) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    rc8.pendant.emergency_stop()
    with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
        finished(both, motion)
    with pytest.raises(CallError, match="EMERGENCY_STOP_ON"):
        both.run(moving.move(THERE))


def test_a_motion_halted_by_this_program(both: Both, moving: Any) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    both.run(motion.halt())
    assert both.run(moving.get_moving()) is False
    with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
        finished(both, motion)


def test_a_paused_motion_is_not_over(both: Both, moving: Any, clock: HeldClock) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))
    both.run(moving.hold())
    assert both.run(motion.get_done()) is False
    until(lambda: both.run(motion.get_progress()) == both.run(motion.get_progress()))
    clock.advance(1000)  # the motion would take 350 s
    assert both.run(motion.get_progress()) < 1
    assert both.run(motion.get_done()) is False
    both.run(moving.unhold())
    clock.advance(400)
    finished(both, motion)


def test_a_machine_lock_is_no_stop(both: Both, robot: Any, rc8: VirtualRC8) -> None:
    rc8.pendant.machine_lock()
    both.run(robot.execute("TakeArm"))
    both.run(robot.execute("Motor", 1))
    finished(both, both.run(robot.move(THERE, wait=False)))
    assert both.run(robot.get_joints()) == standing_at(HOME)


def test_a_refused_motion_is_no_motion(both: Both, moving: Any, clock: HeldClock) -> None:
    motion = both.run(moving.move(THERE, speed=SLOWLY, wait=False))  # the motion takes 350 s
    for refused in (P(5000, 0, 0, 0, 0, 0), "P9999"):
        with pytest.raises(CallError):
            both.run(moving.move(refused, wait=False))
    fractions = progress_of(both, motion, lambda: clock.advance(40))
    assert len(set(fractions)) > 2
    assert fractions[-1] == 1.0


def test_the_position_of_the_arm(both: Both, robot: Any) -> None:
    assert both.run(robot.get_joints()) == standing_at(HOME)
    position = both.run(robot.get_position())
    assert isinstance(position, P)
    assert position[:3] == pytest.approx([364.159992, 0, 278.535534], abs=1e-5)  # as in the b-CAP document
    assert position.fig == both.run(robot.get_figure()) == 5
    trans = both.run(robot.get_trans())
    assert isinstance(trans, T)
    assert trans[3:9] == pytest.approx([0, 1, 0, 0, 0, -1], abs=1e-9)
    assert both.run(robot.get_motor_on()) is False
    assert both.run(robot.get_moving()) is False


def test_conversions(both: Both, robot: Any) -> None:
    position = both.run(robot.get_position())
    joints = both.run(robot.to_joints(position))
    assert joints == standing_at(HOME)
    assert both.run(robot.to_position(HOME)) == pytest.approx(list(position))
    assert both.run(robot.to_trans(HOME)) == pytest.approx(list(both.run(robot.get_trans())))
    assert both.run(robot.to_position(both.run(robot.to_trans(position)))) == pytest.approx(list(position))
    assert both.run(robot.out_of_range(HOME)) == 0
    assert both.run(robot.out_of_range(J(180, 45, 160, 0, 45, 0))) == 0b101
    assert both.run(robot.out_of_range("P(5000, 0, 0, 0, 0, 0)")) == -1
    with pytest.raises(CallError, match="TARGET_OUT_OF_RANGE"):
        both.run(robot.to_joints(P(5000, 0, 0, 0, 0, 0)))


def test_settings(both: Both, moving: Any) -> None:
    both.run(moving.put_ext_speed(50))
    assert both.run(moving.get_ext_speed()) == 50.0
    before = both.run(moving.get_position())
    both.run(moving.set_tool(1, P(0, 0, 100, 0, 0, 0)))
    both.run(moving.put_tool(1))
    assert both.run(moving.get_tool()) == 1
    assert both.run(moving.get_position()).z == pytest.approx(before.z - 100)
    both.run(moving.put_tool(0))
    both.run(moving.set_work(2, P(100, 0, 0, 0, 0, 0)))
    both.run(moving.put_work(2))
    assert both.run(moving.get_work()) == 2
    assert both.run(moving.get_position()).x == pytest.approx(before.x - 100)


def test_properties_of_the_synchronous_robot(url: str, clock: HeldClock) -> None:
    with orinkit.connect(url) as controller, controller.robot() as robot, robot.arm(), robot.motor():
        robot.ext_speed = 30
        robot.tool = 2
        robot.work = 1
        assert (robot.ext_speed, robot.tool, robot.work, robot.motor_on, robot.moving) == (30.0, 2, 1, True, False)
        robot.tool = robot.work = 0
        assert robot.joints == robot.destination == standing_at(HOME)
        assert (robot.position.fig, robot.figure, robot.trans.fig) == (5, 5, 5)
        with clock.held():
            motion = robot.move(THERE, wait=False)
            assert [motion.done, motion.progress < 1] == [False, True]
        for fraction in motion:
            assert 0 <= fraction <= 1
        assert (motion.done, motion.progress) == (True, 1.0)
        for name in ("joints", "position", "moving", "motor_on", "destination"):
            with pytest.raises(AttributeError):
                setattr(robot, name, 1)


# --- holding the arm and the motor ----------------------------------------------------------------------------------


class Trouble(Exception):
    pass


def holding(both: Both, robot: Any, body: Callable[[], None]) -> None:
    """Execute ``with robot.arm(), robot.motor(): body()``."""
    both.within(robot.arm(), lambda _: both.within(robot.motor(), lambda _: body()))


def status(rc8: VirtualRC8, *names: str) -> list[Any]:
    found = rc8.pendant.status()
    return [found[name] for name in names]


def test_a_block_that_ends_normally_waits_for_its_motion(both: Both, robot: Any, rc8: VirtualRC8) -> None:
    def body() -> None:
        assert status(rc8, "motor") == ["on"]
        assert status(rc8, "arm_holder") != [""]
        both.run(robot.move(THERE, speed=20, wait=False))

    holding(both, robot, body)
    assert both.run(robot.get_joints()) == pytest.approx([*THERE, 0, 0], abs=0.1)
    assert status(rc8, "motor", "moving", "arm_holder") == ["off", False, ""]


def test_a_block_that_fails_halts(both: Both, robot: Any, rc8: VirtualRC8) -> None:
    def body() -> None:
        both.run(robot.move(THERE, speed=SLOWLY, wait=False))
        raise Trouble

    with pytest.raises(Trouble) as caught:
        holding(both, robot, body)
    assert not hasattr(caught.value, "__notes__")
    assert both.run(robot.get_joints())[0] < 40
    assert status(rc8, "motor", "moving", "arm_holder") == ["off", False, ""]


@SEVERAL
def test_the_error_of_a_stop_propagates_from_the_block(both: Both, robot: Any, rc8: VirtualRC8, url: str) -> None:
    def body() -> None:
        both.run(robot.move(THERE, speed=SLOWLY, wait=False))
        halt_from_elsewhere(url)

    with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
        holding(both, robot, body)
    assert status(rc8, "motor", "moving", "arm_holder") == ["off", False, ""]


def test_keeping_the_settings(both: Both, robot: Any) -> None:
    both.within(robot.arm(), lambda _: both.run(robot.put_tool(3)))
    both.within(robot.arm(keep=True), lambda _: None)
    assert both.run(robot.get_tool()) == 3
    both.within(robot.arm(), lambda _: None)
    assert both.run(robot.get_tool()) == 0
    with pytest.raises(CallError, match="VALUE_OUT_OF_RANGE"):
        both.within(robot.arm(group=99), lambda _: None)


@SEVERAL
def test_an_arm_that_another_client_holds(both: Both, robot: Any, url: str) -> None:
    entered = []
    with orinkit.connect(url) as other:
        other.robot().execute("TakeArm")
        thief = other.robot()
        thief.execute("TakeArm")
        with pytest.raises(CallError, match="ARM_NOT_TAKEN"):
            both.within(robot.arm(), entered.append)
    assert entered == []


def test_a_motor_that_cannot_go_on_gives_the_arm_back(both: Both, robot: Any, rc8: VirtualRC8) -> None:
    rc8.pendant.emergency_stop()
    with pytest.raises(CallError, match="EMERGENCY_STOP_ON"):
        holding(both, robot, lambda: None)
    assert status(rc8, "arm_holder") == [""]


@only("tcp", "http", because="on the others nobody tells of it")
def test_the_controller_disconnects_during_a_motion(both: Both, listen_at: str, rc8: VirtualRC8) -> None:
    server = orinkit.serve(rc8, listen_at)
    controller = both.connect(server.url, timeout=3 * PATIENCE)
    robot = both.run(controller.robot())

    def body() -> None:
        motion = both.run(robot.move(THERE, speed=SLOWLY, wait=False))
        server.close()
        finished(both, motion)

    began = time.monotonic()
    with pytest.raises(TransportError) as caught:
        holding(both, robot, body)
    assert time.monotonic() - began < PATIENCE  # no time-out has expired
    assert ["the connection is lost" in note for note in caught.value.__notes__] == [True]
    both.run(controller.close())


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
def test_ctrl_c_while_a_motion_is_waited_for(rc8: VirtualRC8, url: str, clock: HeldClock) -> None:
    """The connection is closed, so that the controller stops the arm; on UDP after some seconds without a request."""

    def interrupt() -> None:
        until(lambda: status(rc8, "moving") == [True])
        clock.pace(1.0)
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    controller = orinkit.connect(url)
    robot = controller.robot()
    thread = threading.Thread(target=interrupt)
    with pytest.raises(KeyboardInterrupt), robot.arm(), robot.motor():
        thread.start()
        robot.move(THERE, speed=SLOWLY)
    thread.join()
    until(lambda: status(rc8, "moving", "arm_holder") == [False, ""])
    assert status(rc8, "joints")[0][0] < 40
    with pytest.raises(ConnectionClosed):
        robot.joints  # noqa: B018 - reading the attribute raises
    controller.close()


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
def test_ctrl_c_during_a_motion_without_waiting(rc8: VirtualRC8, url: str) -> None:
    """Between two queries, the connection stays open: the arm and the motor are given back as usual."""
    with orinkit.connect(url) as controller:
        robot = controller.robot()

        def interrupt(number: int, frame: object) -> None:
            raise KeyboardInterrupt

        before = signal.signal(signal.SIGALRM, interrupt)
        try:
            with pytest.raises(KeyboardInterrupt), robot.arm(), robot.motor():
                robot.move(THERE, speed=SLOWLY, wait=False)
                signal.setitimer(signal.ITIMER_REAL, 0.01)
                time.sleep(PATIENCE)
        finally:
            signal.signal(signal.SIGALRM, before)
        assert status(rc8, "motor", "moving", "arm_holder") == ["off", False, ""]


def test_cancelling_a_motion_that_is_waited_for(rc8: VirtualRC8, url: str) -> None:
    """The call cannot be withdrawn and occupies the connection, so the connection is closed."""

    async def body() -> None:
        async with aio.connect(url) as controller:
            robot = await controller.robot()
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(PATIENCE) as limit, robot.arm(), robot.motor():
                    passing = asyncio.create_task(pass_when_it_moves(limit))
                    await robot.move(THERE, speed=SLOWLY)
            await passing
            with pytest.raises(ConnectionClosed):
                await robot.get_joints()

    async def pass_when_it_moves(limit: asyncio.Timeout) -> None:
        while status(rc8, "moving") != [True]:  # noqa: ASYNC110 - a thread moves it
            await asyncio.sleep(0.002)
        limit.reschedule(0.0)

    asyncio.run(body())
    until(lambda: status(rc8, "moving", "arm_holder") == [False, ""])


def test_cancelling_the_wait_for_a_motion(rc8: VirtualRC8, url: str) -> None:
    async def body() -> None:
        async with aio.connect(url) as controller:
            robot = await controller.robot()
            async with robot.arm(), robot.motor():
                motion = await robot.move(THERE, speed=SLOWLY, wait=False)
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.05):
                        await motion
                assert await robot.get_moving()
                waiting = asyncio.create_task(motion.wait())
                await asyncio.sleep(0)
                await robot.halt()  # from another task, over the same connection
                with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
                    await waiting
        assert status(rc8, "motor", "arm_holder") == ["off", ""]

    asyncio.run(body())


def test_a_cancelled_call_does_not_stop_the_arm(rc8: VirtualRC8, url: str) -> None:
    """On HTTP a cancelled call closes the connection: the next call opens another one, before the server gives up the client."""

    async def body() -> None:
        async with aio.connect(url) as controller:
            robot = await controller.robot()
            async with robot.arm(), robot.motor():
                await robot.move(THERE, speed=SLOWLY, wait=False)
                for turns in range(0, 40, 4):  # of the loop, until the call is cancelled
                    call = asyncio.create_task(robot.get_moving())
                    for _ in range(turns):
                        await asyncio.sleep(0)
                    call.cancel()
                    await asyncio.gather(call, return_exceptions=True)
                    assert await robot.get_moving()
                await robot.halt()  # otherwise, give_arm() waits for the end of the motion

    asyncio.run(body())


# --- a scripted robot -----------------------------------------------------------------------------------------------


class ScriptedRobot(p.RobotObject):
    """A robot that records its calls and returns the scripted results of its device; the last one is repeated."""

    def __init__(self, device: Scripted) -> None:
        super().__init__("Arm")
        self._device = device

    def move(self, interpolation: int, pose: Variant, option: str) -> Any:
        return self._device.answer("Move", option)

    def halt(self, option: str) -> Any:
        return self._device.answer("Halt", None)

    def hold(self, option: str) -> Any:
        return self._device.answer("Hold", None)

    def execute(self, command: str, parameter: Variant) -> Any:
        return self._device.answer(command, plain(parameter))

    def get_variable(self, name: str, option: str) -> Any:
        raise p.not_found(name)


class ScriptedController(p.ControllerObject):
    def __init__(self, device: Scripted) -> None:
        super().__init__("Scripted")
        self._device = device

    def get_robot(self, name: str, option: str) -> ScriptedRobot:
        return ScriptedRobot(self._device)


TIMES_OUT = only("tcp", because="other transports report S_EXECUTING, so the call never times out")


class Scripted(Provider):
    """A controller with a scripted robot.

    Attributes:
        answers: Results of each call, in order; an exception is raised.
        calls: Recorded calls, without queries.
    """

    provider_names = ("Test.Scripted",)

    def __init__(self) -> None:
        self.answers: dict[str, list[Any]] = {
            "CurJnt": [[0.0] * 8], "DestJnt": [[0.0] * 8, [10.0] * 8], "MotionComplete": [True, False],
        }  # fmt: skip
        self.calls: list[Any] = []
        self.asked: list[str] = []
        self.never: Deferred[None] = Deferred()

    def answer(self, name: str, parameter: Any) -> Any:
        self.asked.append(name)
        if name not in ("CurJnt", "CurPos", "DestJnt", "MotionComplete"):
            self.calls.append(name if parameter is None else (name, parameter))
        found = self.answers.get(name, [None])
        what = found.pop(0) if len(found) > 1 else found[0]
        if isinstance(what, Exception):
            raise what
        return what

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ScriptedController:
        return ScriptedController(self)

    def close(self) -> None:
        self.never.set_result()


@pytest.fixture
def device() -> Scripted:
    return Scripted()


@pytest.fixture
def scripted(both: Both, listen_at: str, device: Scripted) -> Iterator[Any]:
    with orinkit.serve(device, listen_at) as server:
        controller = both.connect(server.url, provider="Test.Scripted", timeout=PATIENCE, service="")
        yield both.run(controller.robot())
        device.close()
        both.run(controller.close())


SHORT = 0.1  # a time-out that is expected to expire


def impatient(robot: Any, device: Scripted, *names: str) -> threading.Semaphore:
    """Let the next call of each command time out shortly after the device has received it.

    Returns:
        A semaphore that is released for each of these calls after its time-out.
    """
    conversation, given_up, left = robot.client._conversation, threading.Semaphore(0), list(names)
    call = conversation.call

    def impatiently(name: str, operation: Any) -> Any:
        before = device.asked.count(name)
        exchange = next(operation)
        while True:
            received = yield exchange
            while received is None and device.asked.count(name) == before:  # the device has not received it yet
                received = yield b"", SHORT
            try:
                exchange = operation.send(received)
            except StopIteration as stop:
                return stop.value
            except CallTimeout:
                left.remove(name)
                given_up.release()
                raise

    def shortened(function: Any, arguments: tuple[Any, ...], seconds: float, **options: Any) -> Any:
        name = arguments[1] if function is f.robot_execute else function.name.removeprefix("Robot_")
        if name not in left:
            return call(function, arguments, seconds, **options)
        return impatiently(name, call(function, arguments, SHORT, **options))

    conversation.call = shortened
    robot.client._direct = None  # so that every call is made by conversation.call
    return given_up


def until_given_up(given_up: threading.Semaphore) -> BlockingCall:
    """Execute a command until its client no longer waits for it."""
    return BlockingCall(lambda: given_up.acquire(timeout=PATIENCE) and None)


TAKEN = [("TakeArm", [0, 0]), ("Motor", [1, 0])]
GIVEN = [("Motor", [0, 0]), "GiveArm"]
REFUSED = CallError(hresult.MOTOR_OFF_WHILE_MOVING)


def raising(_: object = None) -> None:
    raise Trouble


def test_the_order_of_a_block_that_ends_normally(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["MotionComplete"] = [True, False, False, True]
    device.answers["CurJnt"] = [[0.0] * 8, [10.0] * 8]
    holding(both, scripted, lambda: both.run(scripted.move("P1", wait=False)))
    assert device.calls == [*TAKEN, ("Move", "NEXT"), *GIVEN]
    assert device.asked.count("MotionComplete") == 4


def test_the_order_of_a_block_that_fails(both: Both, scripted: Any, device: Scripted) -> None:
    with pytest.raises(Trouble):
        holding(both, scripted, raising)
    assert device.calls == [*TAKEN, "Halt", *GIVEN]


def test_no_queries_without_motion(both: Both, scripted: Any, device: Scripted) -> None:
    holding(both, scripted, lambda: None)
    assert device.asked == ["TakeArm", "Motor", "Motor", "GiveArm"]


def test_a_paused_motion_is_halted_at_the_end_of_the_block(both: Both, scripted: Any, device: Scripted) -> None:
    def body() -> None:
        both.run(scripted.move("P1", wait=False))
        both.run(scripted.hold())

    holding(both, scripted, body)
    assert device.calls == [*TAKEN, ("Move", "NEXT"), "Hold", "Halt", *GIVEN]


def test_a_raw_motion_is_waited_for_too(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["MotionComplete"] = [False, True]
    holding(both, scripted, lambda: both.run(scripted.move(1, "P1", "NEXT")))
    asked = ["MotionComplete"] * 3  # executing; over; still over, so it had begun
    assert device.asked == ["TakeArm", "Motor", "Move", *asked, "Motor", "GiveArm"]


@pytest.mark.parametrize("failing", ["Halt", "Motor", "GiveArm"])
def test_a_failed_step_of_the_clean_up_hides_no_error(
    both: Both, scripted: Any, device: Scripted, failing: str
) -> None:
    def body() -> None:
        device.answers[failing] = [REFUSED]
        raising()

    with pytest.raises(Trouble) as caught:
        holding(both, scripted, body)
    assert device.calls == [*TAKEN, "Halt", *GIVEN]
    (note,) = caught.value.__notes__
    assert "error during clean-up" in note
    assert "MOTOR_OFF_WHILE_MOVING" in note


def test_the_end_of_a_block_may_fail(both: Both, scripted: Any, device: Scripted) -> None:
    """The error is raised, and the arm is still halted and given back."""

    def body() -> None:
        device.answers["Motor"] = [REFUSED]

    with pytest.raises(CallError, match="MOTOR_OFF_WHILE_MOVING"):
        holding(both, scripted, body)
    assert device.calls == [*TAKEN, ("Motor", [0, 0]), "Halt", "GiveArm"]


@pytest.fixture
def patient_with_halting(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("_sync", "_async"):
        monkeypatch.setattr(f"orinkit.client.{module}.leases._HALT_TIMEOUT", PATIENCE)


@TIMES_OUT
def test_each_step_takes_one_timeout_at_most(
    both: Both, scripted: Any, device: Scripted, patient_with_halting: None
) -> None:
    def body() -> None:
        given_up = impatient(scripted, device, "Halt", "Motor", "Halt", "GiveArm")
        for name in ("Halt", "Motor", "GiveArm"):
            device.answers[name] = [until_given_up(given_up)]
        raising()

    with pytest.raises(Trouble) as caught:
        holding(both, scripted, body)
    assert device.calls == [*TAKEN, "Halt", ("Motor", [0, 0]), "Halt", "GiveArm"]  # both blocks halt
    assert len(caught.value.__notes__) in (3, 4)  # a call that has waited for the one before it may be answered in time


@TIMES_OUT
def test_an_arm_that_can_only_be_stopped_by_closing_the_connection(both: Both, scripted: Any, device: Scripted) -> None:
    """The controller does not reply within the time-out, and is busy with the motion from then on, even for Halt."""
    device.answers["Move"] = [device.never]
    device.answers["Halt"] = [CallError(hresult.E_BUSY_PROC)] * 100_000
    impatient(scripted, device, "Move")
    with pytest.raises(CallTimeout) as caught:
        holding(both, scripted, lambda: both.run(scripted.move("P1")))
    assert any("closed to stop the arm" in note for note in caught.value.__notes__)
    assert device.calls[: len(TAKEN) + 1] == [*TAKEN, ("Move", "")]
    assert set(device.calls[len(TAKEN) + 1 :]) <= {"Halt"}
    with pytest.raises(ConnectionClosed):
        both.run(scripted.get_joints())


@only("http", because="elsewhere the controller is busy with the call before")
@with_longer_times(0.05, 1.0, PATIENCE)
def test_the_arm_can_be_halted_while_a_call_is_executing(
    both: Both, scripted: Any, device: Scripted, short: float
) -> None:
    del device.calls[:]
    device.answers["Move"] = [device.never]
    move = (f.robot_move, scripted.handle, 1, "P1", "")
    with pytest.raises(CallTimeout) as caught:
        holding(both, scripted, lambda: both.run(scripted.client.request(*move, timeout=short)))
    if ("Move", "") not in device.calls:
        raise TooSlow
    assert not hasattr(caught.value, "__notes__")
    assert device.calls == [*TAKEN, ("Move", ""), "Halt", *GIVEN]


@TIMES_OUT
def test_the_clean_up_waits_for_a_slow_call(
    both: Both, scripted: Any, device: Scripted, patient_with_halting: None
) -> None:
    impatient(scripted, device, "Slow")
    slow = Deferred[None]()
    device.answers["Slow"] = [slow]

    def body() -> None:
        with pytest.raises(CallTimeout):
            both.run(scripted.execute("Slow"))
        threading.Timer(0.05, slow.set_result).start()
        raising()

    with pytest.raises(Trouble) as caught:
        holding(both, scripted, body)
    assert not hasattr(caught.value, "__notes__")
    assert device.calls == [*TAKEN, "Slow", "Halt", *GIVEN]


@TIMES_OUT
def test_an_arm_that_may_have_been_taken_is_given_back(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["Motor"] = [until_given_up(impatient(scripted, device, "Motor")), None]
    with pytest.raises(CallTimeout):
        holding(both, scripted, lambda: None)
    assert device.calls == [*TAKEN, ("Motor", [0, 0]), "GiveArm"]


def test_a_robot_that_is_closed_in_its_block(both: Both, scripted: Any, device: Scripted) -> None:
    def body() -> None:
        both.run(scripted.close())
        raising()

    with pytest.raises(Trouble) as caught:
        holding(both, scripted, body)
    assert device.calls == TAKEN
    assert "closed" in caught.value.__notes__[0]


def test_a_motion_that_was_just_accepted_is_not_reported_as_stopped(
    both: Both, scripted: Any, device: Scripted
) -> None:
    device.answers["MotionComplete"] = [True, True, False, False, True]
    device.answers["CurJnt"] = [[0.0] * 8, [0.0] * 8, [10.0] * 8]
    motion = both.run(scripted.move("P1", wait=False))
    assert both.run(motion.get_done()) is False
    assert both.run(motion.get_done()) is False
    assert both.run(motion.get_done()) is True


def test_late_encoders_are_not_reported_as_a_stop(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["MotionComplete"] = [True]
    device.answers["CurJnt"] = [[0.0] * 8, [9.0] * 8, [10.0] * 8]
    finished(both, both.run(scripted.move("P1", wait=False)))


def test_a_controller_that_does_not_report_the_end_of_a_motion(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["DestJnt"] = [CallError(hresult.E_NOTIMPL)]
    device.answers["MotionComplete"] = [True, False, False, True]
    motion = both.run(scripted.move("P1", wait=False))
    assert progress_of(both, motion) == [0.0, 0.0, 1.0]
    # a pose in joints determines the end
    device.answers["MotionComplete"] = [True]
    motion = both.run(scripted.move(J(*[20.0] * 8), wait=False))
    with pytest.raises(CallError, match="STOPPED_DURING_PC_MOTION"):
        finished(both, motion)


@pytest.mark.parametrize("answer", [None, "x", [1.0, "x"], [float("nan")] * 8, [], 5])
def test_results_that_are_not_joints(both: Both, scripted: Any, device: Scripted, answer: Any) -> None:
    device.answers["CurJnt"] = [answer]
    with pytest.raises(ProtocolError, match="CurJnt returned an unexpected value"):
        both.run(scripted.get_joints())


@pytest.mark.parametrize("answer", [None, "yes", [True], float("inf")])
def test_results_that_are_not_numbers(both: Both, scripted: Any, device: Scripted, answer: Any) -> None:
    device.answers["MotionComplete"] = [answer]
    with pytest.raises(ProtocolError, match="MotionComplete returned an unexpected value"):
        both.run(scripted.motion_complete())


@TIMES_OUT
def test_a_halt_does_not_wait_for_a_motion_without_a_reply(both: Both, scripted: Any, device: Scripted) -> None:
    device.answers["Move"] = [device.never]
    impatient(scripted, device, "Move")
    with pytest.raises(CallTimeout):
        both.run(scripted.move("P1"))
    both.run(scripted.halt())
