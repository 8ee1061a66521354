"""Slave mode stopped from outside: the arm brakes within its limits, waiting calls fail, the state is documented."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import variant
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.motion.brake import Brake
from orinkit.virtual.engine.motion.planner import Rates, plan_ptp
from orinkit.virtual.engine.motion.queue import CYCLE, MotionQueue, QueueState
from orinkit.virtual.rc8.robot.motor import MotorState
from support.slave_cell import HOME, J0, J1, J2, P0, SlaveCell, sine, straight

VS050 = load_model("VS-050")
SINE = sine(101, (0, 1, 3))
MOTION = plan_ptp(Kinematics(VS050), HOME, (5.0, *HOME[1:]), Rates())


@pytest.fixture
def cell() -> Iterator[SlaveCell]:
    made = SlaveCell()
    yield made
    made.close()


def _halt(cell: SlaveCell) -> None:
    cell.connect().get_robot("", "").halt("")


def _release(cell: SlaveCell) -> None:
    cell.robot.release()


def _disconnect(cell: SlaveCell) -> None:
    cell.robot.release()
    cell.controller.release()


def _disconnect_controller(cell: SlaveCell) -> None:
    """The client disconnects without releasing its robot object."""
    cell.controller.release()


def _emergency(cell: SlaveCell) -> None:
    cell.rc8.pendant.emergency_stop()


def _protective(cell: SlaveCell) -> None:
    cell.rc8.pendant.protective_stop()


def _mode(cell: SlaveCell) -> None:
    cell.rc8.pendant.mode(1)


def _auto_enable(cell: SlaveCell) -> None:
    cell.rc8.pendant.auto_enable(False)


def _restart(cell: SlaveCell) -> None:
    cell.rc8.pendant.restart()


def _error(level: int) -> Callable[[SlaveCell], None]:
    return lambda cell: cell.rc8.pendant.raise_error(0x80204999 | level << 24)


def _program(cell: SlaveCell) -> None:
    """A program of another operator fails."""
    cell.rc8.pendant.raise_error(0x83500002)


# the stop: (function, code of a waiting call, whether the motor goes off)
ENDS: dict[str, tuple[Callable[[SlaveCell], None], int, bool]] = {
    "halt": (_halt, hresult.STOPPED_DURING_PC_MOTION, False),
    "robot released": (_release, hresult.STOPPED_DURING_PC_MOTION, False),
    "disconnected": (_disconnect, hresult.STOPPED_DURING_PC_MOTION, False),
    "controller released": (_disconnect_controller, hresult.STOPPED_DURING_PC_MOTION, False),
    "emergency stop": (_emergency, hresult.EMERGENCY_STOP_ON, True),
    "protective stop": (_protective, hresult.PROTECTIVE_STOP_ON, True),
    "mode": (_mode, hresult.EMERGENCY_STOP_OR_MODE_CHANGE, True),
    "auto enable": (_auto_enable, hresult.AUTO_ENABLE_WENT_OFF, True),
    "restart": (_restart, hresult.STOPPED_DURING_PC_MOTION, True),
    "error of level 2": (_error(2), 0x82204999, False),
    "error of level 3": (_error(3), 0x83204999, True),
    "error of a program": (_program, 0x83500002, False),
    "error of level 4": (_error(4), 0x84204999, True),
    "error of level 5": (_error(5), 0x85204999, True),
}
NO_ERROR = (
    "halt",
    "robot released",
    "disconnected",
    "controller released",
    "emergency stop",
    "protective stop",
    "mode",
    "restart",
)


@pytest.mark.parametrize("mode", [J0, J1, J2])
@pytest.mark.parametrize("cause", ENDS)
@pytest.mark.parametrize("after", [1, 10, 26, 50, 90])
def test_the_arm_brakes_within_its_limits(cell, cause, mode, after):
    end, _, motor_off = ENDS[cause]
    cell.on(mode)
    cell.stream(SINE[: after + 1])
    cell.send(SINE[after + 1])  # in the buffer: it is dropped
    assert cell.arm.busy
    last = len(cell.commands) - 1
    end(cell)
    assert not cell.arm.slave.on
    cell.rest()
    cell.check_brake(last)
    assert cell.arm.queue.state is QueueState.IDLE
    assert (cell.arm.motor.state is MotorState.OFF) is motor_off
    assert (cell.error == 0) is (cause in NO_ERROR)
    assert not cell.rc8.state.cycles.busy or cell.arm.queue.standing


@pytest.mark.parametrize("cause", ENDS)
def test_what_is_held_is_answered_with_the_cause(cell, cause):
    """A slvMove of mode 2, and a slvChangeMode 0."""
    end, code, _ = ENDS[cause]
    cell.on(J2)
    cell.stream(SINE[:26])
    for pose in SINE[26:29]:
        cell.send(pose)
    held = [cell.send(pose) for pose in SINE[29:31]]
    held.append(cell.robot.execute("slvChangeMode", variant(0)))
    end(cell)
    for each in held:
        assert isinstance(each, Deferred)
        assert each.done()
        assert cell.code(each) == code
    cell.rest()


@pytest.mark.parametrize("cause", ENDS)
def test_an_arm_that_stands_ends_it_too(cell, cause):
    end, _, motor_off = ENDS[cause]
    cell.on(J0)
    cell.send(SINE[30])  # far away: it must not be executed
    end(cell)
    cell.cycle(10)
    assert set(cell.commands) == {HOME}
    assert not cell.arm.slave.on
    assert cell.arm.motor.on is not motor_off


@pytest.mark.parametrize(
    "cause", ["halt", "emergency stop", "mode", "auto enable", "error of level 2", "error of level 4"]
)
def test_the_next_set_point_fails_because_slave_mode_is_off(cell, cause):
    cell.on(J0)
    cell.stream(SINE[:26])
    ENDS[cause][0](cell)
    assert cell.code_of(lambda: cell.send(SINE[26])) == ENDS[cause][1]
    assert cell.code_of(lambda: cell.send(SINE[26])) == hresult.SLAVE_MODE_OFF
    assert cell.mode == 0
    cell.rest()
    assert cell.code_of(lambda: cell.send(SINE[26])) == hresult.SLAVE_MODE_OFF


@pytest.mark.parametrize("level", [0, 1])
def test_a_notice_and_a_refusal_end_nothing(cell, level):
    cell.on(J0)
    cell.stream(SINE[:26])
    _error(level)(cell)
    cell.stream([*SINE[26:], SINE[-1]])
    assert cell.mode == J0
    assert cell.commands[-1] == SINE[-1]


def test_the_token_may_go(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    cell.rc8.pendant.token("tp")
    cell.stream([*SINE[26:], SINE[-1]])
    assert (cell.mode, cell.error, cell.commands[-1]) == (J0, 0, SINE[-1])


def test_a_second_robot_object_may_go(cell):
    cell.on(J0)
    looking = cell.controller.get_robot("Other", "")
    cell.stream(SINE[:26])
    looking.release()
    cell.stream([*SINE[26:], SINE[-1]])
    assert (cell.mode, cell.commands[-1]) == (J0, SINE[-1])


def test_halt_is_answered_when_the_arm_stands_and_frees_nothing_else(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    other = cell.connect().get_robot("", "")
    halt = other.halt("")
    assert not halt.done()
    cell.run(halt)
    assert not cell.arm.busy
    assert cell.error == 0
    assert cell.execute("TakeArmState", -1) == 1
    assert cell.code(cell.move()) == 0
    cell.on(J0)


def test_halt_of_its_own_client_ends_slave_mode(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    assert cell.code(cell.robot.halt("")) == 0
    assert cell.mode == 0


def test_a_move_waits_for_the_brake(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    _halt(cell)
    assert cell.code_of(lambda: cell.move()) == hresult.STOPPING_MOTION
    assert cell.code_of(lambda: cell.on()) == hresult.ROBOT_MOVING
    cell.rest()
    assert cell.code(cell.move()) == 0


def test_the_brake_is_seen_as_a_stop(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    other = cell.connect()
    _halt(cell)
    cell.cycle(2)
    bits = other.execute("SysState", variant(None))
    assert (bits >> 13 & 1, bits >> 20 & 1, bits >> 24 & 1) == (1, 1, 0)
    robot = other.get_robot("", "")
    assert robot.get_variable("@BUSY_STATUS", "").get_value().plain is True
    assert robot.execute("DestJnt", variant(None)).plain[:6] == list(cell.arm.queue.joints)
    cell.rest()
    cell.cycle(3)
    bits = other.execute("SysState", variant(None))
    assert (bits >> 13 & 1, bits >> 20 & 1, bits >> 21 & 1, bits >> 24 & 1) == (0, 0, 0, 1)


def test_a_second_cause_changes_neither_brake_nor_code(cell):
    cell.on(J2)
    cell.stream(SINE[:26])
    for pose in SINE[26:29]:
        cell.send(pose)
    held = cell.send(SINE[29])
    last = len(cell.commands) - 1
    _halt(cell)
    cell.cycle(2)
    _emergency(cell)
    cell.rest()
    cell.check_brake(last)
    assert cell.code(held) == hresult.STOPPED_DURING_PC_MOTION
    assert not cell.arm.motor.on


def test_hold_during_the_brake_changes_nothing(cell):
    cell.on(J0)
    cell.stream(SINE[:26])
    last = len(cell.commands) - 1
    _halt(cell)
    cell.connect().get_robot("", "").hold("")
    cell.rest()
    cell.check_brake(last)


def test_another_client_takes_over_when_the_arm_stands(cell):
    cell.on(J1)
    cell.stream(SINE[:26])
    other = cell.connect().get_robot("", "")
    _disconnect(cell)
    taking = other.execute("TakeArm", variant([0, 0]))
    assert not taking.done()
    cell.run(taking)
    assert other.execute("slvChangeMode", variant(J0)) is None
    assert other.execute("slvGetMode", variant(None)) == J0
    other.execute("slvMove", variant([*cell.arm.queue.joints, 0.0, 0.0]))


def test_the_motor_button_ends_it(cell):
    cell.on(J2)
    for _ in range(3):
        cell.send(HOME)
    held = cell.send(HOME)
    cell.rc8.pendant.motor(False)
    assert cell.code(held) == hresult.MOTOR_NOT_ON
    assert cell.mode == 0
    cell.cycle(60)
    assert cell.arm.motor.state is MotorState.OFF
    cell.rc8.pendant.motor()
    cell.cycle(200)
    cell.on(J0)
    cell.stream(SINE[:26])
    with pytest.raises(CallError, match="MOTOR_OFF_WHILE_MOVING"):
        cell.rc8.pendant.motor(False)
    assert cell.mode == J0


def test_closing_the_controller_fails_every_waiting_call(cell):
    cell.on(J2)
    cell.stream(SINE[:26])
    for pose in SINE[26:29]:
        cell.send(pose)
    held, leaving = cell.send(SINE[29]), cell.robot.execute("slvChangeMode", variant(0))
    cell.rc8.close()
    assert cell.code(held) == cell.code(leaving) == hresult.E_ABORT
    assert not cell.arm.busy
    assert not cell.arm.slave.on
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.SLAVE_MODE_OFF


def test_a_cancelled_command_object_ends_it(cell):
    """Cancelling a call stops what its client has begun."""
    command = cell.controller.get_command("Robot.slvMove", "")
    cell.on(J2)
    cell.stream(SINE[:26])
    for pose in SINE[26:29]:
        cell.send(pose)
    command.put_parameters(variant([*SINE[29], 0.0, 0.0]))
    command.execute(1)
    cancelled = command.cancel()
    cell.run(cancelled)
    assert cell.code_of(command.get_result) == hresult.E_CANCEL
    assert not cell.arm.slave.on
    cell.rest()


def test_something_that_breaks_in_the_cycle_brings_the_arm_to_rest(cell, caplog):
    cell.execute("slvSendFormat", 0x20)
    cell.on(J0)
    for pose in SINE[:26]:
        cell.send(pose, 0)
        cell.cycle()
    cell.rc8.state.variables._save = None  # for example, the disk is full
    cell.send(SINE[26], 1)
    with caplog.at_level("CRITICAL", "orinkit.rc8"):
        cell.cycle()
    last = len(cell.commands) - 1
    assert cell.error == hresult.UNDEFINED_ERROR
    assert not cell.arm.slave.on
    cell.rest()
    cell.check_brake(last)
    assert not cell.arm.motor.on


def test_the_control_log_has_the_brake(cell):
    """All commands, and the encoders three cycles later."""
    cell.execute("StartLog")
    cell.on(J0)
    cell.stream(SINE[:26])
    _emergency(cell)
    cell.rest()
    cell.cycle(5)
    records = [np.array(cell.arm.log.record(index)[:32]).reshape(8, 4) for index in range(len(cell.arm.log))]
    commands, encoders = (np.array([record[:6, column] for record in records]) for column in (0, 1))
    assert np.array_equal(commands[:-3], encoders[3:])
    first = 26
    for joints in (commands[first - 2 :], encoders[first + 1 :]):
        bends = np.diff(joints, 2, axis=0) / PERIOD**2
        assert np.all(np.abs(bends) <= np.array([axis.acceleration for axis in VS050.axes]) * (1 + 1e-6))
    assert [tuple(row) for row in commands[:26].tolist()] == SINE[:26]


def test_a_stop_in_position_mode(cell):
    start = cell.execute("CurPos")
    cell.on(P0)
    way = 0.0
    for index in range(40):
        way += min(0.1 * index, 1.5)
        cell.send([start[0], start[1] + way, *start[2:]])
        cell.cycle()
    assert cell.error == 0
    last = len(cell.commands) - 1
    _emergency(cell)
    cell.rest()
    cell.check_brake(last)


# --- the brake and the queue by themselves ----------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1.25, 1.25), min_size=6, max_size=6))
def test_any_velocity_is_braked_straight_and_within_the_limits(parts):
    """Up to the servo limit."""
    steps = [part * axis.velocity * CYCLE for part, axis in zip(parts, VS050.axes, strict=True)]
    before, now = (0.0,) * 6, tuple(steps)
    brake = Brake(VS050, before, now, CYCLE)
    commands = [before, now]
    while commands[-1] != commands[-2]:
        commands.append(brake.step())
        assert len(commands) < 60
    assert brake.step() == commands[-1]
    bends = np.diff(np.array(commands), 2, axis=0) / CYCLE**2
    limits = np.array([axis.acceleration for axis in VS050.axes])
    assert np.all(np.abs(bends) <= limits * (1 + 1e-6) + 1e-9)
    if any(abs(part) > 0.1 for part in parts):
        used = (np.abs(bends[:-2]) / limits).max(axis=1)
        assert np.all(used > 0.999)  # every axis uses its limit
        length = np.linalg.norm(np.array(commands[-1]))
        assert np.linalg.norm(np.cross(np.array(steps)[:3], np.array(commands[-1])[:3])) < 1e-9 * (1 + length) ** 2


def test_a_queue_follows_and_stands():
    queue = MotionQueue(VS050, HOME)
    queue.follow((0.1, *HOME[1:]))
    assert (queue.state, queue.moving, queue.standing) == (QueueState.FOLLOWING, True, True)
    queue.step()
    assert (queue.joints[0], queue.previous_joints[0], queue.state) == (0.1, 0.0, QueueState.FOLLOWING)
    assert queue.velocity_and_acceleration()[0][0] == pytest.approx(12.5)
    assert queue.target == queue.end_joints == queue.joints
    queue.follow((0.1, *HOME[1:]))
    queue.step()
    assert (queue.state, queue.standing) == (QueueState.IDLE, True)


def test_a_queue_that_is_not_led_on_brakes():
    queue = MotionQueue(VS050, HOME)
    for joints in straight(1.0, 20):
        queue.follow(joints)
        queue.step()
    commands = [queue.previous_joints, queue.joints]
    while queue.state is not QueueState.IDLE:
        queue.step()
        commands.append(queue.joints)
        assert queue.state in (QueueState.BRAKING, QueueState.IDLE)
    assert np.abs(np.diff(np.array(commands)[:, 0], 2)).max() <= VS050.axes[0].acceleration * CYCLE**2 * (1 + 1e-9)
    assert commands[-1] == commands[-2]


def test_a_queue_does_not_mix_motions_and_commands():
    queue = MotionQueue(VS050, HOME)
    queue.add(MOTION)
    with pytest.raises(ValueError, match="motions"):
        queue.follow(HOME)
    queue = MotionQueue(VS050, HOME)
    queue.follow((0.1, *HOME[1:]))
    with pytest.raises(ValueError, match="external commands"):
        queue.add(MOTION)
    queue.halt()  # before the step: it is not executed
    queue.step()
    assert (queue.joints, queue.state) == (HOME, QueueState.IDLE)
    queue.add(MOTION)


def test_a_braking_queue_takes_no_motions():
    queue = MotionQueue(VS050, HOME)
    for joints in straight(1.0, 20):
        queue.follow(joints)
        queue.step()
    queue.halt()
    queue.hold()
    queue.halt()
    assert queue.state is QueueState.BRAKING
    with pytest.raises(CallError, match="STOPPING_MOTION"):
        queue.add(MOTION)
    with pytest.raises(ValueError, match="motions"):
        queue.follow(HOME)
    with pytest.raises(ValueError, match="cannot be set while motions"):
        queue.place(HOME)


def test_outputs_that_cannot_be_saved_do_not_jolt_the_arm(cell, monkeypatch):
    """The cycle continues: the failure is an error of the controller, and the arm brakes from its velocity."""
    cell.execute("slvSendFormat", 0x200)
    cell.on(J2)
    poses = list(straight(1.0, 60))

    def full(*_: object) -> None:
        raise OSError("disk full")

    for index, pose in enumerate(poses):
        if index == 30:
            monkeypatch.setattr(cell.rc8.state.variables, "set_points", full)
        if not cell.arm.slave.taking:
            break
        cell.send(pose, 128, 1, bytes([index]))
        cell.cycle()
    assert cell.error == hresult.UNDEFINED_ERROR
    cell.rest()
    cell.check_brake(31)


def test_a_slow_clock_continues():
    assert Clock(0.001).patience > 2 * PERIOD


def test_a_set_point_that_is_cancelled_is_not_carried_out(cell):
    """Command objects may execute several calls at a time; cancelling one of them ends slave mode."""
    commands = []
    for angle in (0.0, 0.1, 0.3, 0.6, 0.9, 1.1):
        command = cell.controller.get_command("Robot.slvMove", "")
        command.put_parameters(variant([angle, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0]))
        commands.append(command)
    cell.on(J2)
    for command in commands:
        command.execute(1)
    commands[4].cancel()
    cell.rest()
    assert cell.mode == 0
    assert cell.commands[-1][0] < 0.31
    assert cell.error == 0
