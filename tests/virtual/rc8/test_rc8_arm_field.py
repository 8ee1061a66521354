"""The arm as published programs use it: GiveArm and Motor off after a move that goes on, recovery, programs, Halt."""

from __future__ import annotations

from typing import Any

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8.robot.motor import MotorState
from support.cell import Cell

FAR = "J(60, 45, 90, 0, 45, 0)"
GOING_ON = pytest.mark.parametrize(("mark", "option"), [("@P ", ""), ("@50 ", ""), ("", "NEXT"), ("@E ", "NEXT")])


@pytest.fixture
def cell():
    cell = Cell()
    yield cell
    cell.close()


def go(cell: Cell, mark: str = "", option: str = "NEXT") -> None:
    """Start a motion and wait for the reply to the call; the arm then still moves."""
    cell.take()
    cell.run(cell.move(1, mark + FAR, option))
    if option:
        cell.clock.advance(10 * PERIOD)
    assert cell.arm.busy


def execute(cell: Cell, command: str, parameter: Any = None) -> Any:
    return cell.robot.execute(command, variant(parameter))


# --- GiveArm ----------------------------------------------------------------------------------------------------------


@GOING_ON
@pytest.mark.field("2.1")
@pytest.mark.guide("5.2.28.44 GiveArm")
def test_give_arm_waits_for_the_end_of_the_motion(cell, mark, option):
    go(cell, mark, option)
    done = execute(cell, "GiveArm")
    assert isinstance(done, Deferred)
    assert not done.done()
    assert cell.arm.holder is not None
    assert cell.run(done) is None
    assert cell.arm.holder is None
    assert cell.arm.queue.joints[0] == pytest.approx(60.0)
    assert not cell.arm.busy


@pytest.mark.guide("5.2.28.44 GiveArm")
def test_give_arm_waits_for_several_motions(cell):
    go(cell)
    cell.run(cell.move(1, "J(10, 45, 90, 0, 45, 0)", "NEXT"))
    cell.run(execute(cell, "GiveArm"))
    assert cell.arm.queue.joints[0] == pytest.approx(10.0)


@pytest.mark.field("2.2")
def test_give_arm_without_the_arm_has_no_effect(cell):
    assert execute(cell, "GiveArm") is None
    other = cell.connect().get_robot("", "")
    cell.run(other.execute("TakeArm", variant([0, 0])))
    holder = cell.arm.holder
    assert execute(cell, "GiveArm") is None
    assert cell.arm.holder is holder is not None


@pytest.mark.field("2.2")
def test_give_arm_without_the_arm_is_refused_by_a_strict_controller():
    cell = Cell(strict=True)
    assert cell.code_of(lambda: execute(cell, "GiveArm")) == hresult.ARM_NOT_TAKEN
    cell.close()


def test_give_arm_of_a_stopped_motion_completes_at_standstill(cell):
    go(cell)
    done = execute(cell, "GiveArm")
    other = cell.connect().get_robot("", "")
    halted = other.halt("")
    assert not done.done()
    assert cell.run(done) is None
    assert halted.done()
    assert cell.arm.holder is None
    assert cell.arm.queue.joints[0] < 59.0


def test_give_arm_of_a_paused_motion_is_refused(cell):
    go(cell)
    cell.run(cell.robot.hold(""))
    assert cell.code_of(lambda: execute(cell, "GiveArm")) == hresult.ROBOT_PAUSED
    assert cell.arm.holder is not None


def test_a_client_that_disappears_while_it_gives_the_arm_is_stopped(cell):
    go(cell)
    execute(cell, "GiveArm")
    cell.controller.release()
    assert cell.arm.holder is None
    assert cell.arm.stopping
    cell.run(cell.arm.when_still())
    assert cell.arm.queue.joints[0] < 59.0


# --- Motor off --------------------------------------------------------------------------------------------------------


@GOING_ON
@pytest.mark.field("2.1")
@pytest.mark.guide("5.2.28.41 Motor")
def test_motor_off_waits_for_the_end_of_the_motion(cell, mark, option):
    go(cell, mark, option)
    done = execute(cell, "Motor", [0, 0])
    assert not done.done()
    assert cell.arm.motor.on
    assert cell.run(done) is None
    assert cell.arm.motor.state is MotorState.OFF
    assert cell.arm.queue.joints[0] == pytest.approx(60.0)


def test_motor_off_without_waiting_is_still_off_after_the_motion(cell):
    go(cell)
    assert execute(cell, "Motor", [0, 1]) is None
    assert cell.arm.motor.on
    assert cell.code_of(lambda: cell.move(1, FAR, "NEXT")) == hresult.MOTOR_NOT_ON  # nothing prolongs the motion
    assert cell.code_of(lambda: execute(cell, "Motor", [1, 0])) == hresult.MOTOR_SWITCHING_OFF
    cell.clock.advance(3.0)
    assert cell.arm.motor.state is MotorState.OFF
    assert cell.arm.queue.joints[0] == pytest.approx(60.0)


def test_motor_off_during_a_motion_that_a_call_awaits_is_refused(cell):
    cell.take()
    move = cell.move(1, FAR)
    assert cell.code_of(lambda: execute(cell, "Motor", [0, 0])) == hresult.MOTOR_OFF_WHILE_MOVING
    assert cell.code(move) == 0
    assert cell.arm.motor.on


def test_an_emergency_stop_while_motor_off_waits(cell):
    go(cell)
    done = execute(cell, "Motor", [0, 0])
    cell.rc8.emergency_stop(True)
    assert cell.run(done) is None
    assert cell.arm.motor.state is MotorState.OFF
    assert cell.arm.queue.joints[0] < 59.0


# --- recovery ---------------------------------------------------------------------------------------------------------


@pytest.mark.field("1.5")
@pytest.mark.field("2.6")
@pytest.mark.parametrize("code", [hresult.SOFT_LIMIT_OVER_AXIS1, hresult.COMMAND_ACCELERATION_OVER_AXIS1])
def test_the_recovery_of_drivers_works_at_once_after_an_error(cell, code):
    """ManualReset, ClearError and three times Motor on within a few ms; TakeArm at once."""
    go(cell)
    cell.rc8.raise_error(code)
    assert cell.arm.stopping
    take = execute(cell, "TakeArm", [0, 0])
    assert cell.controller.execute("ManualReset", variant(None)) is None
    assert execute(cell, "ManualResetPreparation") is None
    assert execute(cell, "ClearError") is None
    motor = [execute(cell, "Motor", [1, 0]) for _ in range(3)]
    assert not any(done.done() for done in motor)
    for done in [take, *motor]:
        assert cell.run(done) is None
    assert cell.arm.motor.on
    assert cell.arm.holder is not None
    assert cell.code(cell.move(1, "J(0, 45, 90, 0, 45, 0)")) == 0


def test_motor_on_after_an_error_stays_off_if_another_stop_comes(cell):
    go(cell)
    cell.rc8.raise_error(hresult.COMMAND_ACCELERATION_OVER_AXIS1)
    cell.rc8.clear_errors()
    done = execute(cell, "Motor", [1, 0])
    cell.rc8.emergency_stop(True)
    assert cell.code(done) == hresult.EMERGENCY_STOP_ON
    assert cell.arm.motor.state is MotorState.OFF


def test_motor_on_of_a_client_that_disappears_is_dropped(cell):
    go(cell)
    cell.rc8.raise_error(hresult.COMMAND_ACCELERATION_OVER_AXIS1)
    cell.rc8.clear_errors()
    done = execute(cell, "Motor", [1, 0])
    cell.controller.release()
    assert cell.code(done) == hresult.E_ABORT
    cell.clock.advance(3.0)
    assert cell.arm.motor.state is MotorState.OFF


def test_motor_on_during_a_stop_is_refused_by_a_strict_controller():
    cell = Cell(strict=True)
    go(cell)
    cell.rc8.raise_error(hresult.COMMAND_ACCELERATION_OVER_AXIS1)
    cell.rc8.clear_errors()
    assert cell.code_of(lambda: execute(cell, "Motor", [1, 0])) == hresult.MOTOR_SWITCHING_OFF
    cell.close()


@pytest.mark.field("2.6")
def test_commands_of_the_controller_by_robot_execute(cell):
    cell.rc8.raise_error(hresult.PROGRAM_RUNNING)
    assert cell.code_of(lambda: execute(cell, "MotionPreparation")) == hresult.ERROR_PRESENT
    assert execute(cell, "clearerror", 0) is None
    assert cell.rc8.state.faults.code == 0
    assert execute(cell, "MotionPreparation") is None
    cell.rc8.emergency_stop(True)
    for command in ("ManualReset", "ManualResetPreparation", "MotionPreparation"):
        assert cell.code_of(lambda command=command: execute(cell, command)) == hresult.EMERGENCY_STOP_NOT_RELEASED


# --- programs ---------------------------------------------------------------------------------------------------------


def run_program(cell: Cell, text: str, seconds: float) -> Any:
    """Run a program for some time; return its task."""
    cell.rc8.state.files.write("field.pcs", text.encode())
    task = cell.controller.get_task("field", "")
    task = task.result() if isinstance(task, Deferred) else task
    cell.run(task.start(1, ""))
    cell.clock.advance(seconds)
    return task


@pytest.mark.guide("5.2.28.44 GiveArm")
def test_a_program_that_ends_without_givearm_halts_its_motion(cell):
    run_program(cell, f"Sub Main\nTakeArm\nMove P, {FAR}, Next\nEnd Sub\n", 0.1)
    cell.run(cell.arm.when_still())
    assert cell.arm.holder is None
    assert cell.arm.queue.joints[0] < 59.0
    assert cell.rc8.state.faults.code == 0


@pytest.mark.guide("5.2.28.44 GiveArm")
def test_givearm_of_a_program_waits_for_its_motion(cell):
    run_program(cell, f"Sub Main\nTakeArm\nMove P, {FAR}, Next\nGiveArm\nI1 = 1\nEnd Sub\n", 0.1)
    assert cell.arm.holder is not None
    assert cell.controller.get_variable("I1", "").get_value().plain == 0
    cell.clock.advance(5.0)
    assert cell.arm.holder is None
    assert cell.arm.queue.joints[0] == pytest.approx(60.0)
    assert cell.controller.get_variable("I1", "").get_value().plain == 1


@pytest.mark.guide("5.2.22 Halt")
def test_halt_of_a_program_stops_the_arm_and_fails(cell):
    run_program(cell, f"Sub Main\nTakeArm\nMove P, {FAR}, S=10\nGiveArm\nEnd Sub\n", 0.5)
    assert cell.arm.busy
    assert cell.code(cell.robot.halt("")) == hresult.ARM_TAKEN_BY_PACSCRIPT
    assert not cell.arm.busy
    assert cell.arm.queue.joints[0] < 59.0


@pytest.mark.guide("5.2.22 Halt")
def test_halt_of_a_client_succeeds(cell):
    go(cell)
    assert cell.code(cell.robot.halt("")) == 0
    assert cell.arm.queue.joints[0] < 59.0
    assert cell.arm.holder is not None
