"""Motions that are planned in a thread: their order, and what happens if something else happens meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.values.poses import P
from orinkit.values.variant import variant
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.rc8.objects.command import CommandState
from support.busy import BusyCell, finish, occupy
from support.waiting import until

POSE = "P(330, 0, 300, 180, 0, 180)"
VIA = "P(345, 60, 290, 180, 0, 180)"
PTP = "J(20, 45, 90, 0, 45, 0)"


class PlanningCell(BusyCell):
    """A cell whose planning thread is occupied until :attr:`going` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.take()
        self.lane = self.rc8.state.moves._lane = self.rc8.state.planning = Lane("test", Clock())
        self.occupy()

    def occupy(self) -> None:
        """Occupy the thread."""
        self.going.clear()
        occupy(self.lane, self.going)

    def plan(self) -> None:
        """Let the thread plan all motions."""
        finish(self.lane, self.going)

    def planned(self, call: Deferred[Any]) -> Any:
        """Let the thread plan all motions; return the result of a call, or its return code."""
        self.plan()
        assert call.done()
        return self.code(call) or call.result()


@pytest.fixture
def cell() -> Iterator[PlanningCell]:
    with closing(PlanningCell()) as made:
        yield made


def test_the_arm_is_busy_while_a_motion_is_planned(cell):
    call = cell.move(4, POSE, "NEXT")
    assert call.brief
    assert not call.done()
    assert cell.arm.busy
    assert cell.code_of(lambda: cell.robot.change("Tool1")) == hresult.TOOL_WORK_CHANGE_WHILE_MOVING
    assert cell.trace(10) == [cell.arm.model.home] * 10
    assert cell.planned(call) is None
    assert cell.trace(10)[-1] != cell.arm.model.home


def test_a_call_without_next_completes_at_the_end_of_its_motion(cell):
    call = cell.move(4, POSE)
    cell.plan()
    end = call.result()
    assert isinstance(end, Deferred)
    assert not end.done()
    assert cell.code(end) == 0
    assert cell.tip[:3, 3] == pytest.approx([330, 0, 300], abs=1e-3)


def test_a_quick_motion_does_not_overtake_one_that_is_planned(cell):
    calls = [cell.move(4, POSE, "NEXT"), cell.move(1, PTP, "NEXT")]
    cell.plan()
    assert [cell.code(call) for call in calls] == [0, 0]
    first, second = cell.arm.queue.tickets
    assert first.motion.length is not None
    assert second.motion.start == first.motion.end


def test_quick_motions_are_planned_immediately(cell):
    assert cell.move(1, PTP, "NEXT") is None
    assert cell.move(2, POSE, "NEXT") is None
    assert len(cell.arm.queue.tickets) == 2


def test_a_line_whose_planning_takes_long_is_planned_in_the_thread(cell):
    x, y, z, rx, ry, rz, figure = cell.arm.space.position(cell.arm.model.home)
    call = cell.move(2, f"{P(x, y, z, rx, ry, rz + 160, figure)}", "NEXT")
    assert isinstance(call, Deferred)
    assert cell.planned(call) is None
    assert len(cell.arm.queue.tickets) == 1


def test_no_more_motions_are_planned_than_fit_into_the_queue(cell):
    for _ in range(10):
        cell.move(4, POSE, "NEXT")
    assert cell.code_of(lambda: cell.move(4, POSE, "NEXT")) == hresult.ROBOT_MOVING
    assert cell.code_of(lambda: cell.move(1, PTP, "NEXT")) == hresult.ROBOT_MOVING
    cell.plan()
    assert len(cell.arm.queue.tickets) == 10


STOPS: dict[str, tuple[Callable[[BusyCell], object], int]] = {
    "Halt of another client": (
        lambda cell: cell.connect().get_robot("", "").halt(""), hresult.STOPPED_DURING_PC_MOTION,
    ),
    "emergency stop": (lambda cell: cell.rc8.pendant.emergency_stop(), hresult.EMERGENCY_STOP_ON),
    "protective stop": (lambda cell: cell.rc8.pendant.protective_stop(), hresult.PROTECTIVE_STOP_ON),
    "error": (lambda cell: cell.rc8.pendant.raise_error(0x84204999), 0x84204999),
    "client disconnected": (lambda cell: cell.controller.release(), hresult.STOPPED_DURING_PC_MOTION),
    "robot object released": (lambda cell: cell.robot.release(), hresult.STOPPED_DURING_PC_MOTION),
    "mode": (lambda cell: cell.rc8.pendant.mode(1), 0),
    "switched off": (lambda cell: cell.rc8.close(), hresult.E_ABORT),
}  # fmt: skip


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("name", STOPS)
def test_a_stop_discards_motions_that_are_being_planned(cell, name, moving):
    """Nothing moves afterwards, even if the cause of the stop has ended before the motions have been planned."""
    if moving:
        assert cell.move(1, PTP, "NEXT") is None
        cell.trace(5)
    calls = [cell.move(4, POSE, "NEXT"), cell.move(1, PTP)]
    stop, code = STOPS[name]
    stop(cell)
    assert all(call.done() for call in calls)
    assert all(cell.code(call) == code if code else cell.code(call) for call in calls)
    assert not cell.arm.planning
    cell.trace(200)
    assert not cell.arm.busy
    still = cell.arm.queue.joints
    cell.going.set()
    until(lambda: not cell.lane._working)
    assert cell.trace(20) == [still] * 20
    assert not cell.arm.queue.tickets


def test_skipped_motions_succeed(cell):
    call = cell.move(4, POSE)
    cell.execute("MotionSkip", seconds=1.0)
    assert cell.planned(call) is None
    assert not cell.arm.queue.tickets


def test_a_motion_that_is_planned_during_hold_begins_after_unhold(cell):
    call = cell.move(4, POSE, "NEXT")
    cell.robot.hold("")
    assert cell.planned(call) is None
    assert set(cell.trace(10)) == {cell.arm.model.home}
    cell.robot.unhold("")
    assert cell.trace(10)[-1] != cell.arm.model.home


def test_errors_of_planning_are_raised_in_the_call_and_reported(cell):
    call = cell.move(4, "P(5000, 0, 300, 180, 0, 180)", "NEXT")
    assert cell.planned(call) == hresult.TARGET_OUT_OF_RANGE
    assert not cell.arm.busy
    assert cell.rc8.state.faults.code == 0
    cell.occupy()
    x, y, z, *rest = cell.arm.space.position(cell.arm.model.home)
    call = cell.move(4, f"{P(-x, y, z, *rest)}", "NEXT")  # the straight line leads through the body of the arm
    assert cell.planned(call) == cell.rc8.state.faults.code == hresult.OUT_OF_WORKING_RANGE


def test_no_motion_of_a_call_is_queued_if_one_is_impossible(cell):
    call = cell.move(4, f"{POSE}, P(5000, 0, 300, 180, 0, 180)", "NEXT")
    assert cell.planned(call) == hresult.TARGET_OUT_OF_RANGE
    assert not cell.arm.queue.tickets


def test_a_motion_depends_on_the_variables_and_speeds_at_its_call(cell):
    cell.put("P1", [330.0, 0.0, 300.0, 180.0, 0.0, 180.0, -1.0])
    cell.put("F1", 10.0)
    calls = [cell.move(4, "P1", "NEXT, SPEED=F1")]
    cell.put("P1", [300.0, 100.0, 300.0, 180.0, 0.0, 180.0, -1.0])
    cell.put("F1", 100.0)
    calls.append(cell.move(4, "P1", "NEXT, SPEED=F1"))
    cell.plan()
    assert [cell.code(call) for call in calls] == [0, 0]
    slow, fast = (ticket.motion for ticket in cell.arm.queue.tickets)
    assert cell.arm.space.tcp(slow.end)[:2, 3] == pytest.approx([330, 0], abs=1e-3)
    assert cell.arm.space.tcp(fast.end)[:2, 3] == pytest.approx([300, 100], abs=1e-3)
    assert (slow.rates.speed, fast.rates.speed) == pytest.approx((0.1 * fast.rates.speed, fast.rates.speed))


def test_a_path_has_the_points_that_it_had_at_the_call(cell):
    cell.execute("AddPathPoint", [1, POSE])
    call = cell.move(4, 1, "NEXT")
    cell.execute("AddPathPoint", [1, "P(300, 100, 300, 180, 0, 180)"])
    assert cell.planned(call) is None
    (ticket,) = cell.arm.queue.tickets
    assert cell.arm.space.tcp(ticket.motion.end)[:2, 3] == pytest.approx([330, 0], abs=1e-3)


def test_a_command_object_waits_for_the_end_of_the_motion(cell):
    command = cell.controller.get_command("Robot.RotateH", "")
    command.put_parameters(variant(["90"]))
    command.execute(1)
    cell.plan()
    assert command.get_state() == CommandState.EXECUTING
    cell.trace(1_000)
    assert command.get_state() == CommandState.DONE
    assert cell.arm.queue.joints != cell.arm.model.home


def test_a_command_object_that_is_cancelled_moves_nothing(cell):
    command = cell.controller.get_command("Robot.RotateH", "")
    command.put_parameters(variant(["90"]))
    command.execute(1)
    command.cancel()
    cell.plan()
    assert set(cell.trace(10)) == {cell.arm.model.home}


# --- programs ---------------------------------------------------------------------------------------------------------


def start(cell: BusyCell, body: str) -> Any:
    """Start a program that takes the arm."""
    cell.execute("GiveArm")
    file = cell.controller.get_file("Test.pcs", "@Create=1")
    file.put_value(variant(f"Sub Main\n  TakeArm\n{body}End Sub\n"))
    task = cell.controller.get_task("Test", "")
    task.start(1, "")
    return task


def test_planning_takes_no_time_of_the_controller_in_a_program(cell):
    cycles = cell.rc8.state.cycles
    start(cell, f"  Move C, {VIA}, {POSE}, Next\n  I1 = 1\n")
    cell.clock.advance(PERIOD)
    number = cycles.number
    cell.clock.advance(0.1)
    assert cycles.number == number
    cell.plan()
    cell.clock.advance(PERIOD)
    assert cycles.number > number
    assert cell.controller.get_variable("I1", "").get_value().value == 1
    cell.trace(1_000)
    assert cell.arm.holder is None


@pytest.mark.parametrize("stop", ["task", "emergency", "halt"])
def test_a_stopped_program_moves_nothing(cell, stop):
    task = start(cell, f"  Move C, {VIA}, {POSE}\n  I1 = 1\n")
    cell.clock.advance(PERIOD)
    assert cell.arm.planning
    if stop == "task":
        task.stop(4, "")
    elif stop == "halt":
        cell.robot.halt("")
    else:
        cell.rc8.pendant.emergency_stop()
    assert not cell.arm.planning
    cell.plan()
    assert set(cell.trace(20)) == {cell.arm.model.home}
    assert not cell.rc8.state.tasks.running
    assert cell.controller.get_variable("I1", "").get_value().value == 0


def test_a_suspended_program_continues_its_motion(cell):
    task = start(cell, f"  Move C, {VIA}, {POSE}\n  I1 = 1\n")
    cell.clock.advance(PERIOD)
    task.stop(0, "")
    cell.plan()
    assert set(cell.trace(20)) == {cell.arm.model.home}
    task.start(1, "")
    cell.trace(1_000)
    assert cell.controller.get_variable("I1", "").get_value().value == 1
