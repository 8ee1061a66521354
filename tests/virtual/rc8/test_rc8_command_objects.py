from __future__ import annotations

import pytest

from orinkit.cao.outcomes import Pending
from orinkit.cao.provider import Deferred
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.objects.command import CommandState, RC8Command
from orinkit.virtual.rc8.robot.motor import MotorState

EMPTY = Variant(VarType.EMPTY)
WAIT, AT_ONCE = 0, 1
IDLE, EXECUTING, DONE, FAILED, CANCELLED = range(5)


@pytest.fixture
def command(controller):
    """Return a factory of commands with a parameter."""

    def command(name: str, parameter: object = None) -> RC8Command:
        made = controller.get_command(name, "")
        made.put_parameters(variant(parameter))
        return made

    return command


@pytest.fixture
def ready(rc8, controller):
    """Return the robot with the arm taken and the motor on."""
    robot = controller.get_robot("Arm", "")
    robot.execute("TakeArm", variant([0, 0]))
    rc8.state.arm.motor.state = MotorState.ON
    return robot


def code(deferred: Deferred[None]) -> int:
    """Return the code with which a Deferred failed, 0 if it succeeded."""
    assert deferred.done()
    try:
        deferred.result()
    except CallError as error:
        return error.code
    return 0


def result_code(command: RC8Command) -> int:
    try:
        command.get_result()
    except CallError as error:
        return error.code
    return 0


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["SysState", "sysstate", " SysState ", "HandMoveA", "Motor", "Robot.Motor", "robot . motor", "Arm0.Motor", "Hand0.Chuck",
     "CurJnt", "Robot.CurPos", "HAND0.get_BusyState"],
)  # fmt: skip
def test_names(name, controller):
    made = controller.get_command(name, "")
    assert (made.get_name(), made.get_state(), made.get_attribute()) == (name, IDLE, 3)
    assert name in made.get_help()


@pytest.mark.parametrize(
    ("name", "refusal"),
    [
        ("", hresult.E_CAO_OBJECT_NOTFOUND),
        (".", hresult.E_CAO_OBJECT_NOTFOUND),
        ("NoSuch", hresult.E_CAO_OBJECT_NOTFOUND),
        ("Robot.SysState", hresult.E_CAO_OBJECT_NOTFOUND),
        ("Robot.Chuck", hresult.E_CAO_OBJECT_NOTFOUND),
        ("Robot.Robot.Motor", hresult.E_CAO_OBJECT_NOTFOUND),
        ("Hand1.Chuck", hresult.E_CAO_OBJECT_NOTFOUND),
        ("Hand0.Motor2", hresult.E_CAO_OBJECT_NOTFOUND),
        ("x" * 100_000, hresult.E_CAO_OBJECT_NOTFOUND),
        ("Robot.ServoLock", hresult.E_NOTIMPL),
        ("servolock", hresult.E_NOTIMPL),
    ],
)
def test_unknown_names(name, refusal, controller, refused):
    assert refused(controller.get_command, name, "") == refusal


def test_every_name_of_the_list_is_a_command(controller):
    names = controller.get_command_names("")
    assert {"ClearError", "HandMoveA", "Robot.Motor", "Hand0.Chuck"} <= set(names)
    assert "Robot.ServoLock" not in names
    assert len(names) == len(set(names))
    for name in names:
        assert controller.get_command(name, "").get_state() == IDLE


# --- commands that complete at once -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [WAIT, AT_ONCE])
def test_a_command_that_completes_at_once(mode, command):
    info = command("SysInfo", 0)
    assert info.get_result() is None
    answer = info.execute(mode)
    assert answer.done() if mode == WAIT else answer is None
    assert (info.get_state(), info.get_result()) == (DONE, variant("SN-42"))
    assert info.get_parameters() == variant(0)
    info.put_parameters(variant(99))
    info.execute(AT_ONCE)
    assert (info.get_state(), result_code(info)) == (FAILED, hresult.E_INVALIDARG)
    info.put_parameters(variant([0]))
    info.execute(AT_ONCE)
    assert info.get_result() == variant("SN-42")


def test_a_command_that_fails_at_once(command):
    motor = command("Motor", [1, 0])
    motor._caller.state.emergency_stop(True)
    assert code(motor.execute(WAIT)) == hresult.EMERGENCY_STOP_ON
    assert (motor.get_state(), result_code(motor)) == (FAILED, hresult.EMERGENCY_STOP_ON)


@pytest.mark.parametrize("mode", [-1, 2, 2**31 - 1])
def test_unknown_modes(mode, command, refused):
    info = command("SysInfo", 0)
    assert refused(info.execute, mode) == hresult.E_INVALIDARG
    assert info.get_state() == IDLE


# --- commands that take time ------------------------------------------------------------------------------------------


def test_waiting_for_a_command(command, clock, rc8):
    move = command("HandMoveA", [10, 100])
    answer = move.execute(WAIT)
    assert (move.get_state(), answer.done(), result_code(move)) == (EXECUTING, False, hresult.E_CAO_CMD_EXECUTE)
    clock.advance(1)
    assert (move.get_state(), code(answer), move.get_result()) == (DONE, 0, None)
    assert rc8.state.hand.position == 10.0


def test_polling_the_state_of_a_command(command, clock, rc8, refused):
    motor = command("Robot.Motor", [1, 0])
    assert motor.execute(AT_ONCE) is None
    assert motor.get_state() == EXECUTING
    for mode in (WAIT, AT_ONCE):
        assert refused(motor.execute, mode) == hresult.E_CAO_CMD_EXECUTE
    clock.advance(0.5)
    assert motor.get_state() == EXECUTING
    clock.advance(1)
    assert (motor.get_state(), rc8.state.arm.motor.on) == (DONE, True)
    motor.put_parameters(variant([0, 0]))
    motor.execute(AT_ONCE)
    clock.advance(1)
    assert (motor.get_state(), rc8.state.arm.motor.on) == (DONE, False)


def test_a_command_that_fails_later(command, clock):
    grip = command("HandMoveH", [10, True])
    answer = grip.execute(WAIT)
    clock.advance(1)
    assert (grip.get_state(), code(answer), result_code(grip)) == (FAILED, *[hresult.GRIP_NOT_DETECTED] * 2)


def test_a_robot_command_uses_the_arm_of_its_client(command, ready, clock, connect, rc8):
    drive = command("DriveEx", "(1, 10)")
    drive.execute(AT_ONCE)
    other = connect("other").get_command("DriveEx", "")
    other.put_parameters(variant("(1, 10)"))
    other.execute(AT_ONCE)
    assert (other.get_state(), result_code(other)) == (FAILED, hresult.ARM_NOT_TAKEN)
    clock.advance(5)
    assert drive.get_state() == DONE
    assert rc8.state.arm.servo.encoder[0] == pytest.approx(10.0, abs=1e-3)


# --- cancelling -------------------------------------------------------------------------------------------------------


def test_cancelling_a_motion_stops_the_arm(command, ready, clock, rc8):
    drive = command("DriveEx", "(1, 60)")
    answer = drive.execute(WAIT)
    clock.advance(0.2)
    over = drive.cancel()
    assert (drive.get_state(), over.done()) == (EXECUTING, False)  # the arm is still decelerating
    assert rc8.state.arm.stopping
    clock.advance(1)
    assert (code(over), code(answer)) == (0, hresult.E_CANCEL)
    assert (drive.get_state(), result_code(drive)) == (CANCELLED, hresult.E_CANCEL)
    assert not rc8.state.arm.busy
    assert 0 < rc8.state.arm.servo.encoder[0] < 60
    drive.execute(AT_ONCE)  # the command can be executed again
    clock.advance(5)
    assert (drive.get_state(), drive.get_result()) == (DONE, None)


def test_cancelling_twice(command, ready, clock):
    drive = command("DriveEx", "(1, 60)")
    drive.execute(AT_ONCE)
    clock.advance(0.2)
    both = [drive.cancel(), drive.cancel()]
    clock.advance(1)
    assert [code(each) for each in both] == [0, 0]
    assert drive.get_state() == CANCELLED


def test_cancelling_a_paused_motion(command, ready, clock):
    drive = command("DriveEx", "(1, 60)")
    drive.execute(AT_ONCE)
    clock.advance(0.2)
    ready.hold("")
    clock.advance(5)
    assert drive.get_state() == EXECUTING
    drive.cancel()
    clock.advance(1)
    assert drive.get_state() == CANCELLED


def test_cancelling_the_hand(command, clock, rc8):
    gripper = rc8.state.hands.grippers[0]
    gripper.switch_motor(True)
    gripper.position = 1.0
    move = command("Hand0.Org")
    answer = move.execute(WAIT)
    clock.advance(0.1)
    assert code(move.cancel()) == 0
    assert (code(answer), move.get_state(), gripper.busy) == (hresult.E_CANCEL, CANCELLED, False)


def test_cancelling_a_command_that_cannot_be_stopped(command, clock, rc8):
    """The motor continues to be switched; the command ends nevertheless, and its state does not change afterwards."""
    motor = command("Motor", [1, 0])
    answer = motor.execute(WAIT)
    assert code(motor.cancel()) == 0
    assert (code(answer), motor.get_state()) == (hresult.E_CANCEL, CANCELLED)
    clock.advance(2)
    assert (motor.get_state(), rc8.state.arm.motor.on) == (CANCELLED, True)


@pytest.mark.parametrize("end", ["cancel", "release", "timeout"])
def test_a_cancelled_wait_for_a_force_does_not_stop_a_later_motion(command, ready, clock, rc8, end):
    wait = command("Robot.ForceWaitCondition", ["P(5, -1, -1, -1, -1, -1)", -1, -1, 1])
    wait.put_timeout(100)
    wait.execute(AT_ONCE)
    if end == "timeout":
        clock.advance(0.2)
    else:
        getattr(wait, end)()
    assert wait.get_state() == CANCELLED
    drive = command("DriveEx", "(1, 20)")
    drive.execute(AT_ONCE)
    clock.advance(5)
    assert drive.get_state() == DONE
    assert rc8.state.arm.queue.joints[0] == 20
    assert len(rc8.state.arm.hardware.waits) == 0


def end_early(command: RC8Command, end: str, clock: ManualClock) -> None:
    """Cancel or release a command that executes, or let it time out."""
    if end == "timeout":
        clock.advance(3 * PERIOD)
    else:
        getattr(command, end)()
    assert (command.get_state(), result_code(command)) == (
        CANCELLED,
        hresult.E_TIMEOUT if end == "timeout" else hresult.E_CANCEL,
    )


ENDS = pytest.mark.parametrize("end", ["cancel", "release", "timeout"])


@ENDS
def test_a_cancelled_take_arm_does_not_take_the_arm_later(command, ready, clock, connect, rc8, end):
    ready.move(1, variant("J(90, 45, 90, 0, 45, 0)"), "")
    clock.advance(0.1)
    ready.release()
    taking = [connect("other").get_command("TakeArm", "") for _ in range(2)]
    for each in taking:
        each.put_timeout(round(2 * PERIOD * 1000))
        each.execute(AT_ONCE)
        assert each.get_state() == EXECUTING
        end_early(each, end, clock)
    assert rc8.state.arm.stopping
    clock.advance(2)
    assert not rc8.state.arm.stopping
    assert rc8.state.arm.holder is None


@ENDS
def test_a_cancelled_take_arm_does_not_reset_the_settings_of_the_holder(command, ready, clock, rc8, end):
    """The second TakeArm of the holder waits because its motion is being stopped, and resets speeds and tool."""
    ready.speed(-1, 30)
    ready.move(1, variant("J(90, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    ready.halt("")
    taking = command("TakeArm", [0, 0])
    taking.put_timeout(round(2 * PERIOD * 1000))
    taking.execute(AT_ONCE)
    assert taking.get_state() == EXECUTING
    end_early(taking, end, clock)
    clock.advance(2)
    assert not rc8.state.arm.busy
    assert rc8.state.arm.speeds.path.speed == 30


@ENDS
@pytest.mark.parametrize(("name", "parameter"), [("GiveArm", None), ("Motor", [0, 0])])
def test_a_cancelled_call_that_waits_for_standstill_has_no_effect(command, ready, clock, rc8, name, parameter, end):
    """The motion that it waits for continues, and further motions are accepted."""
    ready.move(1, variant("J(20, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    waiting = command(name, parameter)
    waiting.put_timeout(round(2 * PERIOD * 1000))
    waiting.execute(AT_ONCE)
    assert waiting.get_state() == EXECUTING
    end_early(waiting, end, clock)
    ready.move(1, variant("J(25, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(5)
    assert rc8.state.arm.queue.joints[0] == 25
    assert rc8.state.arm.holder is not None
    assert rc8.state.arm.motor.on


def test_the_motor_is_switched_off_if_only_one_of_two_calls_is_cancelled(command, ready, clock, rc8, refused):
    ready.move(1, variant("J(20, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    first, second = command("Motor", 0), command("Motor", 0)
    for each in (first, second):
        each.execute(AT_ONCE)
    assert code(first.cancel()) == 0
    assert refused(ready.move, 1, variant("J(25, 45, 90, 0, 45, 0)"), "NEXT") == hresult.MOTOR_NOT_ON
    clock.advance(5)
    assert (second.get_state(), rc8.state.arm.motor.on) == (DONE, False)
    assert rc8.state.arm.queue.joints[0] == 20


@ENDS
def test_a_cancelled_motor_on_after_a_stop_does_not_switch_the_motor_on(command, ready, clock, rc8, end):
    ready.move(1, variant("J(90, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    rc8.emergency_stop(True)
    rc8.emergency_stop(False)
    motor = command("Motor", 1)
    motor.put_timeout(round(2 * PERIOD * 1000))
    motor.execute(AT_ONCE)
    assert motor.get_state() == EXECUTING
    end_early(motor, end, clock)
    assert rc8.state.arm.busy
    clock.advance(3)
    assert rc8.state.arm.motor.state is MotorState.OFF


def test_a_take_arm_whose_client_no_longer_waits_has_no_effect(ready, clock, connect, rc8):
    """The server abandons the call before it sends E_TIMEOUT."""
    ready.move(1, variant("J(90, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    ready.release()
    taking = connect("other").get_robot("", "").execute("TakeArm", variant([0, 0]))
    taking.abandon()
    clock.advance(2)
    assert rc8.state.arm.holder is None


def test_a_cancelled_execution_does_not_end_a_later_one(command, clock, rc8):
    motor = command("Motor", [1, 0])
    motor.execute(AT_ONCE)
    clock.advance(0.5)
    motor.cancel()
    motor.put_parameters(variant([0, 0]))
    motor.execute(AT_ONCE)  # this ends the cancelled switching on
    assert motor.get_state() == EXECUTING
    clock.advance(1)
    assert (motor.get_state(), rc8.state.arm.motor.on) == (DONE, False)


def test_cancelling_without_an_execution(command):
    info = command("SysInfo", 0)
    assert info.cancel() is None
    assert info.get_state() == IDLE
    info.execute(AT_ONCE)
    assert info.cancel() is None
    assert (info.get_state(), info.get_result()) == (DONE, variant("SN-42"))


def test_cancelling_does_not_stop_the_motion_of_another_client(command, ready, clock, connect, rc8):
    """A stale command has no effect after the arm was released and another client moves it."""
    motor = command("Motor", [1, 1])
    motor.execute(AT_ONCE)
    ready.execute("GiveArm", EMPTY)
    other = connect("other")
    other.get_robot("Arm", "").execute("TakeArm", variant([0, 0]))
    drive = other.get_command("DriveEx", "")
    drive.put_parameters(variant("(1, 10)"))
    drive.execute(AT_ONCE)
    motor.cancel()
    motor.release()
    clock.advance(5)
    assert drive.get_state() == DONE


def test_releasing_cancels(command, ready, clock, rc8):
    drive = command("DriveEx", "(1, 60)")
    drive.execute(AT_ONCE)
    clock.advance(0.2)
    drive.release()
    clock.advance(1)
    assert not rc8.state.arm.busy
    assert rc8.state.arm.servo.encoder[0] < 60
    move = command("HandMoveA", [0, 1])
    move.execute(AT_ONCE)
    move.release()
    move.release()
    assert not rc8.state.hand.busy


def test_an_emergency_stop_fails_the_command(command, ready, clock, rc8):
    drive = command("DriveEx", "(1, 60)")
    answer = drive.execute(WAIT)
    clock.advance(0.2)
    rc8.emergency_stop(True)
    clock.advance(1)
    assert (drive.get_state(), code(answer)) == (FAILED, hresult.EMERGENCY_STOP_ON)


# --- time-outs --------------------------------------------------------------------------------------------------------


def test_a_time_out_is_counted_in_cycles(command, clock, rc8):
    move = command("HandMoveA", [0, 1])  # 37 s
    assert move.get_timeout() == 0
    move.put_timeout(1000)
    assert move.get_timeout() == 1000
    answer = move.execute(WAIT)
    clock.advance(1 - PERIOD)
    assert move.get_state() == EXECUTING
    clock.advance(PERIOD)
    assert (move.get_state(), code(answer), result_code(move)) == (CANCELLED, *[hresult.E_TIMEOUT] * 2)
    assert not rc8.state.hand.busy


def test_a_time_out_stops_the_arm(command, ready, clock, rc8):
    drive = command("DriveEx", "(1, 60)")
    drive.put_timeout(200)
    answer = drive.execute(WAIT)
    clock.advance(1.5)
    assert (drive.get_state(), code(answer)) == (CANCELLED, hresult.E_TIMEOUT)
    assert not rc8.state.arm.busy
    assert 0 < rc8.state.arm.servo.encoder[0] < 60


def test_a_time_out_continues_while_the_motion_is_paused(command, ready, clock):
    drive = command("DriveEx", "(1, 60)")
    drive.put_timeout(3000)
    drive.execute(AT_ONCE)
    clock.advance(0.2)
    ready.hold("")
    clock.advance(2)
    assert drive.get_state() == EXECUTING
    clock.advance(2)
    assert (drive.get_state(), result_code(drive)) == (CANCELLED, hresult.E_TIMEOUT)


def test_a_command_that_completes_before_its_time_out(command, clock, rc8):
    move = command("HandMoveA", [20, 100])
    move.put_timeout(60_000)
    move.execute(AT_ONCE)
    clock.advance(1)
    assert move.get_state() == DONE
    assert not rc8.state.cycles.busy  # the timer was cancelled
    move.put_timeout(2**31 - 1)
    move.put_parameters(variant([10, 100]))
    move.execute(AT_ONCE)
    clock.advance(1)
    assert move.get_state() == DONE


def test_the_time_out_of_an_earlier_execution_has_no_effect(command, clock):
    move = command("HandMoveA", [20, 100])
    move.put_timeout(1000)
    move.execute(AT_ONCE)
    clock.advance(0.5)
    assert move.get_state() == DONE
    move.put_timeout(0)
    move.put_parameters(variant([0, 1]))
    move.execute(AT_ONCE)
    clock.advance(2)
    assert move.get_state() == EXECUTING


def test_a_negative_time_out(command, refused):
    info = command("SysInfo", 0)
    assert refused(info.put_timeout, -1) == hresult.E_INVALIDARG
    assert info.get_timeout() == 0


# --- rights and sessions ----------------------------------------------------------------------------------------------


def test_a_command_object_requires_the_rights_of_its_command(connect):
    device = VirtualRC8(permission=Permission.parse("*=r"), clock=ManualClock())
    controller = connect(device=device)
    for name, parameter, expected in [
        ("SysInfo", 0, 0),
        ("ClearError", None, hresult.NO_WRITE_RIGHT),
        ("Motor", 1, hresult.NO_WRITE_RIGHT),
        ("Hand0.Chuck", 0, hresult.NO_WRITE_RIGHT),
        ("Hand0.CurPos", None, 0),
    ]:
        made = controller.get_command(name, "")
        made.put_parameters(variant(parameter))
        made.execute(AT_ONCE)
        assert result_code(made) == expected
    device.close()


def test_calls_through_a_session(rc8, clock):
    session = Session(ProviderRegistry(rc8))
    controller = session.invoke(3, [variant(part) for part in ("", "CaoProv.DENSO.VRC", "localhost", "")]).result
    handle = session.invoke(10, [controller, variant("HandMoveA"), variant("")]).result
    assert session.invoke(118, [handle, variant([10, 100])]).code == 0
    assert session.invoke(117, [handle]).result == variant([10, 100])
    pending = session.invoke(112, [handle, variant(0)])
    assert isinstance(pending, Pending)
    assert session.invoke(116, [handle]).result == Variant(VarType.I4, EXECUTING)
    clock.advance(1)
    assert session.complete(pending, pending.work.result()).code == 0
    assert session.invoke(119, [handle]).result == EMPTY
    assert session.invoke(118, [handle, variant([99, 100])]).code == 0
    assert session.invoke(112, [handle]).code == hresult.VALUE_OUT_OF_RANGE
    assert session.invoke(116, [handle]).result == Variant(VarType.I4, FAILED)
    assert session.invoke(113, [handle]).code == 0
    assert session.invoke(115, [handle, variant(500)]).code == 0
    assert session.invoke(114, [handle]).result == Variant(VarType.I4, 500)
    assert session.invoke(127, [handle]).code == 0
    assert session.invoke(116, [handle]).code == hresult.E_HANDLE


def test_closing_a_session_cancels_its_commands(rc8, clock):
    session = Session(ProviderRegistry(rc8))
    controller = session.invoke(3, [variant(part) for part in ("", "CaoProv.DENSO.VRC", "localhost", "")]).result
    handle = session.invoke(10, [controller, variant("HandMoveA"), variant("")]).result
    session.invoke(118, [handle, variant([0, 1])])
    session.invoke(112, [handle, variant(1)])
    clock.advance(0.5)
    session.close()
    assert not rc8.state.hand.busy


def test_states_are_as_documented():
    assert [state.name for state in CommandState] == ["IDLE", "EXECUTING", "DONE", "FAILED", "CANCELLED"]
    assert [*CommandState] == [0, 1, 2, 3, 4]


def test_the_number_of_executing_commands_is_limited(rc8, ready, command, monkeypatch):
    monkeypatch.setattr("orinkit.virtual.rc8.objects.command.MOST_EXECUTING", 2)
    ready.move(1, variant("J(20, 45, 90, 0, 45, 0)"), "NEXT")
    made = [command("Robot.DriveEx", ["(1, 1)"]) for _ in range(3)]
    for each in made[:2]:
        each.execute(AT_ONCE)
    with pytest.raises(CallError) as refused:
        made[2].execute(AT_ONCE)
    assert refused.value.code == hresult.E_MAX_OBJECT
    ready.halt("")
    rc8.state.cycles.clock.advance(5)
    made[2].execute(AT_ONCE)
    assert made[2].get_state() == EXECUTING
