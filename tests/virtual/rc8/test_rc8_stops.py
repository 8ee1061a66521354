"""Stops in the middle of a motion: the arm decelerates within its limits, and the state is as documented."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8.robot.motor import MotorState
from support.cell import Cell

MOVES = {
    "ptp": (1, "J(120, 20, 110, 40, 30, 90)", ""),
    "line": (2, "P(300, 250, 300, 180, 0, 180)", ""),
    "arc": (3, "P(330, 120, 300, 180, 0, 180), P(300, 250, 300, 180, 0, 180)", ""),
    "slow": (1, "J(120, 20, 110, 40, 30, 90)", "SPEED=10"),
}


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


def _halt(cell: Cell) -> None:
    cell.connect().get_robot("", "").halt("")


def _hold(cell: Cell) -> None:
    cell.robot.hold("")


def _release(cell: Cell) -> None:
    cell.robot.release()


def _emergency(cell: Cell) -> None:
    cell.rc8.pendant.emergency_stop()


def _protective(cell: Cell) -> None:
    cell.rc8.pendant.protective_stop()


def _mode(cell: Cell) -> None:
    cell.rc8.pendant.mode(1)


def _auto_enable(cell: Cell) -> None:
    cell.rc8.pendant.auto_enable(False)


def _error(level: int) -> Callable[[Cell], None]:
    return lambda cell: cell.rc8.pendant.raise_error(0x80204999 | level << 24)


def _skip(cell: Cell) -> None:
    cell.robot.execute("MotionSkip", variant([-1, 0]))


# the stop: (function, code of the stopped Move, whether the motor goes off)
STOPS: dict[str, tuple[Callable[[Cell], None], int | None, bool]] = {
    "halt": (_halt, hresult.STOPPED_DURING_PC_MOTION, False),
    "skip": (_skip, 0, False),
    "hold": (_hold, None, False),
    "robot released": (_release, hresult.STOPPED_DURING_PC_MOTION, False),
    "emergency stop": (_emergency, hresult.EMERGENCY_STOP_ON, True),
    "protective stop": (_protective, hresult.PROTECTIVE_STOP_ON, True),
    "mode": (_mode, hresult.EMERGENCY_STOP_OR_MODE_CHANGE, True),
    "auto enable": (_auto_enable, hresult.AUTO_ENABLE_WENT_OFF, True),
    "error of level 2": (_error(2), 0x82204999, False),
    "error of level 3": (_error(3), 0x83204999, True),
    "error of level 4": (_error(4), 0x84204999, True),
    "error of level 5": (_error(5), 0x85204999, True),
}


def within_limits(cell: Cell, joints: list[tuple[float, ...]]) -> None:
    """Check that velocity and acceleration of every joint, from differences of the commands, are within the limits."""
    samples = np.array(joints)
    velocity = np.diff(samples, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    for axis, limits in enumerate(cell.arm.model.axes):
        assert np.abs(velocity[:, axis]).max() <= limits.velocity * 1.001
        assert np.abs(acceleration[:, axis]).max() <= limits.acceleration * 1.001


@pytest.mark.parametrize("kind", MOVES)
@pytest.mark.parametrize("cause", STOPS)
@pytest.mark.parametrize("after", [1, 5, 12, 20, 31])
def test_the_arm_decelerates_within_its_limits(cell, cause, kind, after):
    stop, code, motor_off = STOPS[cause]
    move = cell.move(*MOVES[kind])
    joints = [cell.arm.queue.joints, *cell.trace(after)]
    assert cell.arm.busy
    stop(cell)
    joints += cell.trace(120)
    within_limits(cell, joints)
    assert joints[-1] == joints[-2] == joints[-3]
    assert cell.arm.queue.joints != cell.arm.model.home
    assert not cell.arm.queue.moving
    if code is None:
        assert not move.done()
    else:
        assert move.done()
        assert cell.code(move) == code
    assert (cell.arm.motor.state is MotorState.OFF) is motor_off


@pytest.mark.parametrize("level", [0, 1])
def test_a_notice_and_a_refusal_stop_nothing(cell, level):
    move = cell.move(*MOVES["ptp"])
    cell.trace(5)
    _error(level)(cell)
    assert cell.code(move) == 0
    assert cell.arm.motor.on


def test_a_fatal_error_needs_a_restart(cell):
    _error(5)(cell)
    assert cell.code_of(lambda: cell.controller.execute("ClearError", variant(None))) == hresult.FATAL_ERROR_BEFORE
    cell.rc8.pendant.restart()
    assert cell.rc8.state.faults.code == 0
    assert cell.arm.holder is None
    assert not cell.arm.motor.on


@pytest.mark.parametrize("kind", ["ptp", "line", "arc"])
def test_a_held_motion_continues_to_its_end(cell, kind):
    move = cell.move(*MOVES[kind])
    reference = Cell().take()
    assert reference.code(reference.move(*MOVES[kind])) == 0
    joints = [cell.arm.queue.joints, *cell.trace(10)]
    cell.run(cell.robot.hold(""))
    held = cell.arm.queue.joints
    assert cell.trace(50) == [held] * 50
    assert not move.done()
    cell.robot.unhold("")
    joints += cell.trace(200)
    assert cell.code(move) == 0
    assert cell.arm.queue.joints == reference.arm.queue.joints
    reference.close()


def test_hold_without_a_motion_keeps_the_next_one_from_starting(cell):
    cell.run(cell.robot.hold(""))
    assert cell.code_of(lambda: cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == hresult.ROBOT_PAUSED
    cell.robot.unhold("")
    assert cell.code(cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == 0


def test_halt_of_a_held_motion_drops_it(cell):
    move = cell.move(*MOVES["ptp"])
    cell.trace(10)
    cell.run(cell.robot.hold(""))
    cell.run(cell.robot.halt(""))
    cell.trace(1)
    assert cell.code(move) == hresult.STOPPED_DURING_PC_MOTION
    assert not cell.arm.busy
    assert not cell.arm.held
    assert cell.code(cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == 0


def test_halt_drops_queued_motions_and_the_first_cause_counts(cell):
    first = cell.move(1, "@P J(60, 45, 90, 0, 45, 0)")
    second = cell.move(1, "J(-60, 45, 90, 0, 45, 0)")
    cell.trace(8)
    _halt(cell)
    _emergency(cell)
    cell.trace(100)
    assert cell.code(first) == cell.code(second) == hresult.STOPPED_DURING_PC_MOTION
    assert cell.arm.motor.state is MotorState.OFF


def test_halt_is_answered_when_the_arm_stands(cell):
    cell.move(*MOVES["ptp"])
    cell.trace(12)
    halt = cell.robot.halt("")
    assert not halt.done()
    cell.run(halt)
    assert not cell.arm.busy


def test_another_client_takes_over_after_a_disconnect(cell):
    """It waits for standstill; its motions start there."""
    cell.move(*MOVES["ptp"])
    cell.trace(12)
    other = cell.connect().get_robot("", "")
    assert cell.code_of(lambda: other.execute("TakeArm", variant([0, 0]))) == hresult.ARM_NOT_TAKEN
    cell.robot.release()
    cell.controller.release()
    taking = other.execute("TakeArm", variant([0, 0]))
    assert not taking.done()
    cell.run(taking)
    assert cell.arm.holder is not None
    assert cell.code(other.move(1, variant("J(0, 45, 90, 0, 45, 0)"), "")) == 0
    assert cell.arm.motor.on


def test_an_emergency_stop_asks_for_release_and_motor_before_the_next_move(cell):
    cell.move(*MOVES["ptp"])
    cell.trace(12)
    _emergency(cell)
    cell.trace(100)
    assert (
        cell.code_of(lambda: cell.controller.execute("ManualReset", variant(None)))
        == hresult.EMERGENCY_STOP_NOT_RELEASED
    )
    assert cell.code_of(lambda: cell.execute("Motor", [1, 0])) == hresult.EMERGENCY_STOP_ON
    cell.rc8.pendant.emergency_stop(False)
    assert cell.code_of(lambda: cell.controller.execute("ManualReset", variant(None))) == 0
    assert cell.code_of(lambda: cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == hresult.MOTOR_NOT_ON
    cell.execute("Motor", [1, 0])
    assert cell.code(cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == 0


def test_an_emergency_stop_while_the_motor_comes_on(cell):
    cell.execute("Motor", [0, 0])
    coming = cell.robot.execute("Motor", variant([1, 0]))
    cell.trace(10)
    _emergency(cell)
    assert cell.code(coming) == hresult.MOTOR_ON_FAILED
    assert cell.arm.motor.state is MotorState.OFF


def test_the_motor_cannot_be_switched_on_while_switching_off(cell):
    going = cell.robot.execute("Motor", variant([0, 0]))
    assert cell.code_of(lambda: cell.execute("Motor", [1, 0])) == hresult.MOTOR_SWITCHING_OFF
    cell.run(going)
    cell.execute("Motor", "1")
    assert cell.arm.motor.on


def test_the_arm_stays_until_the_last_robot_object_of_a_client_is_released(cell):
    """A second Robot object, created for a query and released, stops nothing."""
    move = cell.move(*MOVES["slow"])
    cell.trace(10)
    looking = cell.controller.get_robot("Other", "")
    looking.execute("CurJnt", variant(None))
    looking.release()
    cell.trace(10)
    assert not cell.arm.stopping
    assert cell.code(move) == 0
    cell.robot.release()
    assert cell.arm.holder is None


def test_a_programs_error_is_reported_once(cell):
    cell.execute("GiveArm")
    cell.rc8.state.files.write("Far.pcs", b"Sub Main\n  Takearm\n  Move P, J(500, 0, 90, 0, 45, 0)\nEnd Sub\n")
    cell.controller.get_task("Far", "").start(1, "")
    cell.trace(5)
    assert len(cell.rc8.state.faults.current) == 1
    record = cell.rc8.state.faults.current.newest
    assert (record.code, record.line) == (hresult.TARGET_OVER_SOFT_LIMIT_AXIS1, 3)
    assert not cell.arm.motor.on


def _command(controller, name, parameters):
    command = controller.get_command(name, "")
    command.put_parameters(variant(parameters))
    return command


def test_a_client_without_a_robot_object_leaves_nothing_behind(cell):
    """It took the arm and moved with Command objects: a disconnect ends that too."""
    cell.execute("GiveArm")
    other = cell.connect()
    _command(other, "TakeArm", [0, 0]).execute(0)
    _command(other, "Robot.DriveAEx", [[1, 90.0], "NEXT"]).execute(1)
    cell.trace(10)
    assert cell.arm.busy
    other.release()
    cell.trace(60)
    assert not cell.arm.busy
    assert cell.arm.holder is None
    assert 0 < cell.arm.queue.joints[0] < 89
    cell.take()


def test_the_motor_is_switched_on_after_it_has_been_cut(cell):
    """The emergency stop was short, but its effect is still pending."""
    cell.move(*MOVES["ptp"])
    cell.trace(15)
    cell.rc8.pendant.emergency_stop()
    cell.rc8.pendant.emergency_stop(False)
    assert cell.arm.busy
    done = cell.robot.execute("Motor", variant([1, 0]))
    while cell.arm.busy:
        assert not done.done()
        cell.trace(1)
    assert not cell.arm.motor.on
    cell.run(done)
    assert cell.arm.motor.on


def test_a_hold_remains_after_its_client_has_disconnected(cell):
    move = cell.move(1, "J(40, 45, 90, 0, 45, 0)")
    cell.trace(10)
    other = cell.connect()
    cell.run(other.get_robot("", "").hold(""))
    held = cell.arm.queue.joints
    other.release()
    cell.trace(100)
    assert (cell.arm.held, cell.arm.queue.joints) == (True, held)
    cell.robot.unhold("")
    cell.run(move)
    assert cell.arm.queue.joints[0] == 40


def test_a_hold_without_a_motion_ends_with_unhold_of_the_next_holder(cell):
    other = cell.connect()
    cell.run(other.get_robot("", "").hold(""))
    other.release()
    assert cell.code_of(lambda: cell.move(1, "J(40, 45, 90, 0, 45, 0)")) == hresult.ROBOT_PAUSED
    cell.robot.unhold("")
    assert cell.code_of(lambda: cell.move(1, "J(40, 45, 90, 0, 45, 0)")) == 0


def test_a_hold_ends_if_the_holder_of_the_arm_disconnects(cell):
    cell.move(1, "J(40, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(10)
    cell.run(cell.robot.hold(""))
    held = cell.arm.queue.joints
    cell.robot.release()
    cell.trace(100)
    assert (cell.arm.held, cell.arm.busy, cell.arm.queue.joints) == (False, False, held)


def test_closing_the_controller_fails_every_waiting_call(cell):
    move = cell.move(*MOVES["ptp"])
    cell.trace(10)
    halt = cell.robot.halt("")
    cell.rc8.close()
    assert cell.code(move) == hresult.E_ABORT
    assert cell.code(halt) == hresult.E_ABORT
    assert not cell.arm.busy
    for call in (
        lambda: cell.robot.execute("Motor", variant([1, 0])),
        lambda: cell.move(1, "J(0, 45, 90, 0, 45, 0)"),
        lambda: cell.controller.get_task("Pro1", "").start(1, ""),
        lambda: cell.controller.execute("HandMoveA", variant([10, 50])),
    ):
        assert cell.code_of(call) != 0
    cell.robot.release()
    cell.controller.release()
    cell.rc8.close()


# --- restart ----------------------------------------------------------------------------------------------------------


def test_a_restart_during_a_stop_revokes_the_calls_that_wait_for_standstill(cell):
    """The errors are cleared, so that nothing else would prevent the motor from being switched on after the restart."""
    cell.move(1, MOVES["ptp"][1])
    cell.trace(60)
    cell.rc8.raise_error(0x84204071)
    cell.rc8.clear_errors()
    other = cell.connect().get_robot("", "")
    waiting = [cell.robot.execute("Motor", variant([1, 0])), cell.robot.execute("TakeArm", variant([0, 0]))]
    cell.rc8.pendant.restart()
    waiting.append(other.execute("TakeArm", variant([0, 0])))  # a client of after the restart
    cell.trace(300)
    assert [cell.code(each) for each in waiting] == [hresult.E_ABORT, hresult.E_ABORT, 0]
    assert cell.arm.motor.state is MotorState.OFF


def test_a_restart_resets_what_a_controller_loses_without_power(cell):
    for command, parameter in (
        ("CurLmt", [1, 2, 30]), ("GrvCtrl", 1), ("HighPathAccuracy", 1), ("SpeedMode", 3), ("ErAlw", [1, 1, 5]),
        ("StartLog", None), ("StartServoLog", None), ("PayLoad", [2000]), ("ExtSpeed", 40),
    ):  # fmt: skip
        cell.execute(command, parameter)
    cell.robot.change("Tool3")
    cell.robot.speed(-1, 30.0)
    cell.rc8.pendant.restart()
    loads, arm = cell.arm.servo.loads, cell.arm
    assert (loads.limits, loads.gravity_control, loads.offsets) == ({}, False, None)
    assert (arm.speeds.path.speed, arm.speeds.mode, arm.accuracy.deviation, arm.space.tools.current) == (100, 0, {}, 0)
    assert [arm.log.running, arm.hardware.servo_log.running] == [False, False]
    assert (loads.dynamics.payload.mass, arm.speeds.external.speed) == (2.0, 40)  # settings that are stored
