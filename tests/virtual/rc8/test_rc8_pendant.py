"""The pendant: its buttons, their conditions, and jogging."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest

from orinkit.core import hresult
from orinkit.virtual.engine.motion.queue import TicketState
from orinkit.virtual.rc8 import Token, VirtualRC8
from orinkit.virtual.rc8.robot.motor import MotorState
from support.cell import Cell

MANUAL, AUTOMATIC = 1, 3


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell(motor=False)
    yield made
    made.close()


@pytest.fixture
def by_hand(cell) -> Cell:
    """Manual mode, the enable switch held, the motor on."""
    cell.rc8.pendant.mode(MANUAL)
    cell.rc8.pendant.deadman()
    cell.rc8.pendant.motor()
    cell.clock.advance(1.5)
    assert cell.arm.motor.on
    return cell


def test_it_starts_as_documented(cell):
    assert cell.rc8.pendant.status() == {
        "mode": "automatic", "token": "any", "emergency_stop": False, "protective_stop": False, "auto_enable": True,
        "deadman": False, "machine_lock": False, "motor": "off", "moving": False, "held": False, "arm_holder": "",
        "error": "", "joints": [0, 45, 90, 0, 45, 0], "programs": 0, "supervisory": 0, "slave_mode": 0, "slave_limit": 0,
    }  # fmt: skip


def test_options_change_how_it_starts():
    made = Cell(mode=MANUAL, token="ethernet:10.0.0.1", motor=True, joints=(10, 40, 80, 0, 50, 0), model="vs-060")
    status = made.rc8.pendant.status()
    assert (status["mode"], status["token"], status["motor"]) == ("manual", "ethernet:10.0.0.1", "on")
    assert status["joints"] == [10, 40, 80, 0, 50, 0]
    assert made.arm.model.name == "VS-060"
    made.close()


@pytest.mark.parametrize(
    "options",
    [
        {"mode": 4},
        {"token": "nobody"},
        {"model": "vs-999"},
        {"joints": ()},
        {"joints": (0, 0, 0)},
        {"joints": (0, 0, 0, 0, 0, 999)},
    ],
)
def test_what_cannot_be_is_refused(options):
    with pytest.raises(ValueError):
        VirtualRC8(**options)


def test_jogging_moves_one_axis_at_a_tenth_of_its_speed(by_hand):
    ticket = by_hand.rc8.pendant.jog(1, 5.0)
    joints = [by_hand.arm.queue.joints[0], *(joints[0] for joints in by_hand.trace(200))]
    assert ticket.state is TicketState.DONE
    assert by_hand.arm.queue.joints == (5, 45, 90, 0, 45, 0)
    fastest = max(abs(b - a) for a, b in pairwise(joints)) / 0.008
    assert fastest <= by_hand.arm.model.axes[0].velocity * 0.1 * 1.001


def test_letting_the_enable_switch_go_stops_and_cuts_the_motor(by_hand):
    by_hand.rc8.pendant.jog(1, 50.0)
    by_hand.trace(30)
    by_hand.rc8.pendant.deadman(False)
    by_hand.trace(100)
    assert 0 < by_hand.arm.queue.joints[0] < 50
    assert by_hand.arm.motor.state is MotorState.OFF
    assert by_hand.code_of(lambda: by_hand.rc8.pendant.motor()) == hresult.E_ACCESSDENIED
    assert by_hand.code_of(lambda: by_hand.rc8.pendant.jog(1, 1)) == hresult.E_ACCESSDENIED


def test_in_automatic_mode_the_enable_switch_does_not_matter(cell):
    cell.rc8.pendant.motor()
    cell.clock.advance(1.5)
    cell.rc8.pendant.deadman()
    cell.rc8.pendant.deadman(False)
    assert cell.arm.motor.on
    assert cell.code_of(lambda: cell.rc8.pendant.jog(1, 1)) == hresult.REFUSED_IN_AUTO_MODE


def test_what_jogging_refuses(by_hand):
    pendant = by_hand.rc8.pendant
    for axis in (0, 7, -1):
        with pytest.raises(ValueError):
            pendant.jog(axis, 1)
    assert by_hand.code_of(lambda: pendant.jog(2, 100)) == hresult.MANUAL_SOFT_LIMIT_AXIS1 + 1
    assert by_hand.code_of(lambda: pendant.jog(2, float("nan"))) == hresult.MANUAL_SOFT_LIMIT_AXIS1 + 1
    pendant.jog(1, 50)
    assert by_hand.code_of(lambda: pendant.jog(1, 1)) == hresult.ROBOT_MOVING
    assert by_hand.code_of(lambda: pendant.motor(False)) == hresult.MOTOR_OFF_WHILE_MOVING
    pendant.emergency_stop()
    by_hand.trace(100)
    assert by_hand.code_of(lambda: pendant.jog(1, 1)) == hresult.EMERGENCY_STOP_ON
    pendant.emergency_stop(False)
    assert by_hand.code_of(lambda: pendant.jog(1, 1)) == hresult.MOTOR_NOT_ON
    pendant.raise_error("MOTOR_OVERLOAD_AXIS1")
    assert by_hand.code_of(lambda: pendant.motor()) == hresult.ERROR_PRESENT
    pendant.clear_errors()
    pendant.protective_stop()
    assert by_hand.code_of(lambda: pendant.motor()) == hresult.PROTECTIVE_STOP_ON


def test_errors_by_name_and_by_code(cell):
    cell.rc8.pendant.raise_error("MOTOR_OVERLOAD_AXIS1", "hot")
    assert cell.rc8.state.faults.current.newest.message == "hot"
    cell.rc8.pendant.raise_error(0x84404511)
    assert cell.rc8.pendant.status()["error"] == "84404511"
    with pytest.raises(ValueError):
        cell.rc8.pendant.raise_error("NO_SUCH_ERROR")


def test_poses_and_speed_are_taught(cell):
    cell.rc8.pendant.teach("P", 1, (350, 0, 300, 180, 0, 180, 5))
    cell.rc8.pendant.speed(30)
    assert cell.controller.get_variable("P1", "").get_value().plain[:3] == [350, 0, 300]
    assert (cell.arm.speeds.external.speed, cell.arm.speeds.external.accel) == (30, 9)
    with pytest.raises(ValueError):
        cell.rc8.pendant.teach("I", 1, (1,))
    assert cell.code_of(lambda: cell.rc8.pendant.teach("P", 100, (0,) * 7)) == hresult.VARIABLE_INDEX_INVALID
    assert cell.code_of(lambda: cell.rc8.pendant.speed(101)) == hresult.VALUE_OUT_OF_RANGE


def test_the_machine_lock_keeps_the_arm_in_place(cell):
    cell.rc8.pendant.machine_lock()
    cell.take()
    cell.execute("Motor", [1, 0])
    assert cell.code(cell.move(1, "J(20, 45, 90, 0, 45, 0)")) == 0
    assert cell.rc8.pendant.status()["joints"] == [0, 45, 90, 0, 45, 0]
    assert cell.code_of(lambda: cell.rc8.pendant.machine_lock(False)) == hresult.MOTOR_IS_ON
    cell.execute("Motor", [0, 0])
    cell.rc8.pendant.machine_lock(False)
    assert cell.arm.queue.joints == (0, 45, 90, 0, 45, 0)  # its next motion starts at the position of the arm


def test_a_restart_clears_errors_and_motions_and_releases_the_arm(cell):
    cell.rc8.pendant.motor()
    cell.clock.advance(1.5)
    cell.take()
    cell.move(1, "J(90, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(20)
    cell.rc8.pendant.raise_error(0x85204999)
    cell.rc8.pendant.restart()
    cell.trace(100)
    status = cell.rc8.pendant.status()
    assert (status["error"], status["motor"], status["arm_holder"], status["moving"]) == ("", "off", "", False)


def test_the_token_may_be_an_object(cell):
    cell.rc8.pendant.token(Token.parse("TP"))
    assert cell.rc8.pendant.status()["token"] == "tp"
