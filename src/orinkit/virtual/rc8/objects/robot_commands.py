"""The extended commands of Robot_Execute: a table of names and functions.

A command that changes something checks its conditions (:mod:`orinkit.virtual.rc8.robot.conditions`) itself; the other
commands require the right to read. Names are case-insensitive. :data:`NOT_SIMULATED` lists the commands that only real
controllers have.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.rc8.slave_lateness import COMMAND as LATENESS
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects import controller_commands
from orinkit.virtual.rc8.objects import slave_commands as slave
from orinkit.virtual.rc8.objects.device_commands import DEVICE_COMMANDS, DeviceCommand
from orinkit.virtual.rc8.objects.hand_commands import ROBOT_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.objects.hand_commands import of_controller
from orinkit.virtual.rc8.objects.motion_calls import switch_motor
from orinkit.virtual.rc8.objects.motion_commands import MOTION_COMMANDS
from orinkit.virtual.rc8.objects.slave_use import SlaveUse
from orinkit.virtual.rc8.objects.sync_commands import SYNC_COMMANDS
from orinkit.virtual.rc8.robot import parameters, queries, state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.conditions import refusal, require
from orinkit.virtual.rc8.robot.shared_command import SharedCommand
from orinkit.virtual.rc8.robot.shared_commands import SHARED_COMMANDS
from orinkit.virtual.rc8.robot.speeds import SQUARE
from orinkit.virtual.rc8.variables import conversion

_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_OWN_GROUP: Final = -1


@record
class RobotCommand:
    """An extended command.

    Attributes:
        name: Name as documented; case-insensitive for clients.
        run: Executes the command.
        reads: If True, the command requires only the right to read; otherwise it checks its conditions itself.
        slave_mode: Use by the client that is in slave mode, checked before everything else. The default, ``None``, is
            ANSWERED for a command that only reads, otherwise REFUSED.
    """

    name: str
    run: Callable[[ClientContext, Variant], Any]
    reads: bool = True
    slave_mode: SlaveUse | None = None

    def require_slave_use(self, caller: ClientContext) -> None:
        """Raise an exception if the client is in slave mode and may not use the command.

        Raises:
            CallError: REFUSED_IN_SLAVE_MODE.
        """
        (self.slave_mode or (SlaveUse.ANSWERED if self.reads else SlaveUse.REFUSED)).require(caller)


def execute(caller: ClientContext, name: str, parameter: Variant) -> Any:
    """Execute a command for a client.

    Raises:
        CallError: E_NOTIMPL; E_INVALID_CMD_NAME; REFUSED_IN_SLAVE_MODE; NO_READ_RIGHT; errors of the command.
    """
    wanted = name.strip().lower()
    command = ROBOT_COMMANDS.get(wanted)
    if command is None:
        raise error_for(hresult.E_NOTIMPL if wanted in _NOT_SIMULATED else hresult.E_INVALID_CMD_NAME, f"{name:.40}")
    command.require_slave_use(caller)
    if command.reads:
        caller.require_read()
    return command.run(caller, parameter)


# --- arm and motor ----------------------------------------------------------------------------------------------------


def _take_arm(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    arm = caller.robot.arm
    group, keep = parameters.whole_numbers(parameter, 0, 0)
    settings = parameters.flag(keep)
    if not 0 <= group <= 31:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("arm group {group} is not in 0 to 31", group=group))
    if refusal("TakeArm", arm, caller) == hresult.ROBOT_MOVING and arm.holder in (None, caller) and arm.stopping:
        return arm.take_later(caller, keep=settings, check=lambda: require("TakeArm", arm, caller))
    require("TakeArm", arm, caller)
    arm.take(caller, keep=settings)
    return None


def _give_arm(caller: ClientContext, _: Variant) -> Deferred[None] | None:
    arm = caller.robot.arm
    require("GiveArm", arm, caller)
    return arm.give_at_end(caller) if arm.holder is caller else None


def _arm_state(caller: ClientContext, parameter: Variant) -> int:
    (group,) = parameters.whole_numbers(parameter, _OWN_GROUP)
    holder = caller.robot.arm.holder
    return int(holder is caller if group == _OWN_GROUP else holder is not None)


def _motor(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    on, no_wait = (parameters.flag(value) for value in parameters.whole_numbers(parameter, None, 0))
    done = switch_motor(caller, on)
    return None if no_wait else done


# --- speeds -----------------------------------------------------------------------------------------------------------


def _ext_speed(caller: ClientContext, parameter: Variant) -> None:
    require("ExtSpeed", caller.robot.arm, caller)
    caller.robot.arm.speeds.set_external(*parameters.numbers(parameter, None, SQUARE, SQUARE))


def _non_stop_path(caller: ClientContext, _: Variant) -> None:
    """GenerateNonStopPath belongs to an option with a licence of its own, which a virtual controller does not have."""
    caller.require_write()
    raise error_for(hresult.OPTION_NOT_LICENSED, "GenerateNonStopPath")


def _of_arm(read: Callable[[RC8Arm], object], vt: int) -> Callable[[ClientContext, Variant], Value]:
    return lambda caller, _: Variant(vt, read(caller.robot.arm))


# --- stored paths -----------------------------------------------------------------------------------------------------


def _add_path_point(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    given = parameters.at_least(parameter, 2)
    caller.robot.moves.add_path_point(conversion.whole(given[0]), parameters.pose(given[1]))


def _clear_path(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    caller.robot.moves.clear_path(*parameters.whole_numbers(parameter, None))


def _path_point(caller: ClientContext, parameter: Variant) -> Value:
    path, point = parameters.whole_numbers(parameter, None, None)
    return Variant(_R8_ARRAY, caller.robot.moves.path_point(path, point))


def _path_length(caller: ClientContext, parameter: Variant) -> int:
    return caller.robot.moves.path_length(*parameters.whole_numbers(parameter, None))


# --- control log ------------------------------------------------------------------------------------------------------


def _start_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.robot.arm.log.start()
    caller.state.cycles.wake()


def _stop_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.robot.arm.log.running = False


def _clear_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.robot.arm.log.clear()
    caller.state.cycles.wake()


def _log_record(caller: ClientContext, parameter: Variant) -> Value:
    (index,) = parameters.whole_numbers(parameter, None)
    log = caller.robot.arm.log
    try:
        return log.record(index)
    except IndexError:
        raise error_for(
            hresult.DISP_E_BADINDEX, tr("no record {index}; the log has {count} records", index=index, count=len(log))
        ) from None


def _slave_use(command: SharedCommand | DeviceCommand) -> SlaveUse:
    if command.name == "GetSrvData":  # as on real controllers
        return SlaveUse.ALWAYS
    return SlaveUse.ANSWERED if command.in_slave else SlaveUse.REFUSED


def _shared(command: SharedCommand) -> Callable[[ClientContext, Variant], Any]:
    return lambda caller, parameter: command.run(caller.robot.arm, caller, parameter)


def _query(answer: queries.Answer) -> Callable[[ClientContext, Variant], Variant]:
    return lambda caller, parameter: answer(caller.robot.arm, parameter)


def _pose_commands() -> list[RobotCommand]:
    """Return the commands that read a pose or a figure: CurPos, HighCurJntEx, DestTrn, CurFig ...

    Commands that begin with Cur or HighCur return the position of the encoders. Commands that begin with Dest return
    the destination of the motion. Commands that end in Ex also return the time since power-on.
    """
    made = []
    for prefix, source in (
        ("Cur", state_report.current),
        ("HighCur", state_report.current),
        ("Dest", state_report.destination),
    ):
        for suffix, read in queries.POSES.items():
            made.append(RobotCommand(f"{prefix}{suffix}", _query(queries.pose_command(source, read))))
            made.append(RobotCommand(f"{prefix}{suffix}Ex", _query(queries.stamped_pose_command(source, read))))
        made.append(RobotCommand(f"{prefix}Fig", _query(queries.figure_command(source))))
    return made


OF_CONTROLLER: Final = ("ClearError", "ManualReset", "ManualResetPreparation", "MotionPreparation")
"""Commands of the controller that programs also send with Robot_Execute."""


def _of_controller(name: str) -> Callable[[ClientContext, Variant], Any]:
    return lambda caller, parameter: controller_commands.execute(caller, name, parameter)


_I4: Final = VarType.I4
ROBOT_COMMANDS: Final[dict[str, RobotCommand]] = {
    command.name.lower(): command
    for command in (
        RobotCommand("TakeArm", _take_arm, reads=False),
        RobotCommand("GiveArm", _give_arm, reads=False, slave_mode=SlaveUse.ANSWERED),
        RobotCommand("TakeArmState", _arm_state),
        RobotCommand("Motor", _motor, reads=False),
        RobotCommand("ExtSpeed", _ext_speed, reads=False),
        *_pose_commands(),
        *(RobotCommand(name, run, reads=False) for name, run in (MOTION_COMMANDS | SYNC_COMMANDS).items()),
        RobotCommand("GenerateNonStopPath", _non_stop_path, reads=False, slave_mode=SlaveUse.ANSWERED),
        *(
            RobotCommand(name, _of_controller(name), reads=False, slave_mode=SlaveUse.ANSWERED)
            for name in OF_CONTROLLER
        ),
        *(RobotCommand(each.name, _shared(each), each.reads, _slave_use(each)) for each in SHARED_COMMANDS.values()),
        *(RobotCommand(each.name, each.run, each.reads, _slave_use(each)) for each in DEVICE_COMMANDS),
        RobotCommand("AddPathPoint", _add_path_point, reads=False),
        RobotCommand("ClrPathPoint", _clear_path, reads=False),
        RobotCommand("GetPathPointCount", _path_length),
        RobotCommand("GetPathPoint", _path_point),
        RobotCommand("StartLog", _start_log, reads=False),
        RobotCommand("StopLog", _stop_log, reads=False, slave_mode=SlaveUse.ANSWERED),
        RobotCommand("ClearLog", _clear_log, reads=False),
        RobotCommand("GetLogCount", _of_arm(lambda arm: len(arm.log), _I4)),
        RobotCommand("GetLogRecord", _log_record),
        RobotCommand("slvChangeMode", slave.change_mode, reads=False, slave_mode=SlaveUse.ALWAYS),
        RobotCommand("slvGetMode", slave.get_mode, slave_mode=SlaveUse.ALWAYS),
        RobotCommand(LATENESS, slave.get_lateness, slave_mode=SlaveUse.ALWAYS),  # only virtual controllers have it
        RobotCommand("slvMove", slave.move, reads=False, slave_mode=SlaveUse.ALWAYS),
        RobotCommand("slvSendFormat", slave.set_send_format, reads=False),
        RobotCommand("slvRecvFormat", slave.set_receive_format, reads=False),
        RobotCommand("GetRobotTypeName", _of_arm(lambda arm: arm.model.type_name, VarType.BSTR)),
        *(RobotCommand(each.name, of_controller(each), reads=not each.writes) for each in HAND_COMMANDS),
    )
}

NOT_SIMULATED: Final = ("ServoLock", "GetMotionPreparationState")
"""Commands of real controllers that return E_NOTIMPL here."""

_NOT_SIMULATED: Final = frozenset(name.lower() for name in NOT_SIMULATED)
