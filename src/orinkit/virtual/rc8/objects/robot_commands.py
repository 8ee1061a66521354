"""The extended commands of Robot_Execute: a table of names and functions.

A command that changes something checks its conditions (:mod:`orinkit.virtual.rc8.robot.conditions`) itself; the other
commands require the right to read. Names are case-insensitive. :data:`NOT_SIMULATED` lists the commands that only real
controllers have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.motion_options import MotionOptions, parse_options
from orinkit.rc8.slave_lateness import COMMAND as LATENESS
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects import slave_commands as slave
from orinkit.virtual.rc8.objects.hand_commands import ROBOT_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.objects.hand_commands import of_controller
from orinkit.virtual.rc8.objects.motion_calls import MotionResult, begin_motions
from orinkit.virtual.rc8.robot import parameters, queries, state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.conditions import refusal, require
from orinkit.virtual.rc8.robot.speeds import SQUARE
from orinkit.virtual.rc8.variables import conversion

_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_OWN_GROUP: Final = -1


@dataclass(frozen=True, slots=True)
class RobotCommand:
    """An extended command.

    Attributes:
        name: Name as documented; case-insensitive for clients.
        run: Executes the command.
        reads: If True, the command requires only the right to read; otherwise it checks its conditions itself.
        in_slave: If True, a client in slave mode may use the command (RC8 4.1, note 2); otherwise it is rejected before
            any other check.
    """

    name: str
    run: Callable[[ClientContext, Variant], Any]
    reads: bool = True
    in_slave: bool = False


def execute(caller: ClientContext, name: str, parameter: Variant) -> Any:
    """Execute a command for a client.

    Raises:
        CallError: E_NOTIMPL; E_INVALID_CMD_NAME; REFUSED_IN_SLAVE_MODE; NO_READ_RIGHT; errors of the command.
    """
    wanted = name.strip().lower()
    command = ROBOT_COMMANDS.get(wanted)
    if command is None:
        raise error_for(hresult.E_NOTIMPL if wanted in _NOT_SIMULATED else hresult.E_INVALID_CMD_NAME, f"{name:.40}")
    if not command.in_slave:
        caller.require_not_slave()
    if command.reads:
        caller.require_read()
    return command.run(caller, parameter)


# --- arm and motor ----------------------------------------------------------------------------------------------------


def _take_arm(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    arm = caller.state.arm
    group, keep = parameters.whole_numbers(parameter, 0, 0)
    settings = parameters.flag(keep)
    if not 0 <= group <= 31:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("arm group {group} is not in 0 to 31", group=group))
    if refusal("TakeArm", arm, caller) == hresult.ROBOT_MOVING and arm.holder is None and arm.stopping:
        return arm.take_later(caller, keep=settings, check=lambda: require("TakeArm", arm, caller))
    require("TakeArm", arm, caller)
    arm.take(caller, keep=settings)
    return None


def _give_arm(caller: ClientContext, _: Variant) -> None:
    require("GiveArm", caller.state.arm, caller)
    caller.state.arm.give()


def _arm_state(caller: ClientContext, parameter: Variant) -> int:
    (group,) = parameters.whole_numbers(parameter, _OWN_GROUP)
    holder = caller.state.arm.holder
    return int(holder is caller if group == _OWN_GROUP else holder is not None)


def _motor(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    on, no_wait = (parameters.flag(value) for value in parameters.whole_numbers(parameter, None, 0))
    require("Motor on" if on else "Motor off", caller.state.arm, caller)
    done = caller.state.arm.switch_motor(on)
    return None if no_wait else done


# --- speeds -----------------------------------------------------------------------------------------------------------


def _ext_speed(caller: ClientContext, parameter: Variant) -> None:
    require("ExtSpeed", caller.state.arm, caller)
    caller.state.arm.speeds.set_external(*parameters.numbers(parameter, None, SQUARE, SQUARE))


def _of_arm(read: Callable[[RC8Arm], object], vt: int) -> Callable[[ClientContext, Variant], Value]:
    return lambda caller, _: Variant(vt, read(caller.state.arm))


# --- motions ----------------------------------------------------------------------------------------------------------


def _options(given: list[Variant]) -> MotionOptions:
    texts = [each.value for each in given if each.value is not None]
    for text in texts:
        if not isinstance(text, str):
            raise error_for(
                hresult.DISP_E_TYPEMISMATCH,
                tr("{text} is not an option of a motion", text=quoted(text)),
            )
    return parse_options(",".join(texts))


def _approach(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("Approach", caller.state.arm, caller)
    given = _at_least(parameter, 3)
    mark, distance = parameters.marked_number(given[2])
    options = _options(given[3:])
    target = parameters.pose(given[1])
    plans = caller.state.moves.approach(conversion.whole(given[0]), target, distance, mark, options)
    return begin_motions(caller.state, plans, options)


def _depart(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("Depart", caller.state.arm, caller)
    given = _at_least(parameter, 2)
    mark, distance = parameters.marked_number(given[1])
    options = _options(given[2:])
    plans = caller.state.moves.depart(conversion.whole(given[0]), distance, mark, options)
    return begin_motions(caller.state, plans, options)


def _drive(name: str, absolute: bool) -> Callable[[ClientContext, Variant], MotionResult]:
    def run(caller: ClientContext, parameter: Variant) -> MotionResult:
        require(name, caller.state.arm, caller)
        given = _at_least(parameter, 1)
        if isinstance(given[0].value, str):
            pairs, rest = given[:1], given[1:]
        else:
            pairs = [each for each in given if each.type & ARRAY]
            rest = [each for each in given if not each.type & ARRAY]
        mark, values = parameters.mark_and_axis_values(pairs)
        options = _options(rest)
        return begin_motions(caller.state, caller.state.moves.drive(values, absolute, mark, options), options)

    return run


def _rotate_hand(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("RotateH", caller.state.arm, caller)
    given = _at_least(parameter, 1)
    mark, angle = parameters.marked_number(given[0])
    options = _options(given[1:])
    return begin_motions(caller.state, caller.state.moves.rotate_hand(angle, mark, options), options)


def _motion_skip(caller: ClientContext, _: Variant) -> Deferred[None]:
    require("MotionSkip", caller.state.arm, caller)
    caller.state.arm.skip()
    return caller.state.arm.when_still()


def _motion_complete(caller: ClientContext, parameter: Variant) -> bool:
    _, mode = parameters.whole_numbers(parameter, _OWN_GROUP, 0)
    arm = caller.state.arm
    return arm.settled if parameters.flag(mode) else not arm.busy


def _at_least(parameter: Variant, count: int) -> list[Variant]:
    given = parameters.elements(parameter)
    if len(given) < count:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected at least {needed} parameters, got {count}", count=len(given), needed=count),
        )
    return given


# --- frames and paths -------------------------------------------------------------------------------------------------


def _define(name: str, tool: bool) -> Callable[[ClientContext, Variant], None]:
    def run(caller: ClientContext, parameter: Variant) -> None:
        arm = caller.state.arm
        require(name, arm, caller)
        given = _at_least(parameter, 2)
        target = parameters.position(parameters.pose(given[1]))
        kind, values = arm.space.resolve(target, arm.servo.command)
        if kind != "P":
            raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("a pose of type P is required"))
        (arm.space.tools if tool else arm.space.works).define(conversion.whole(given[0]), values)

    return run


def _defined(tool: bool) -> Callable[[ClientContext, Variant], Value]:
    def run(caller: ClientContext, parameter: Variant) -> Value:
        space = caller.state.arm.space
        (number,) = parameters.whole_numbers(parameter, None)
        values = (space.tools if tool else space.works).values(number)
        return Variant(_R8_ARRAY, [*values, -1.0])

    return run


def _add_path_point(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    given = _at_least(parameter, 2)
    caller.state.moves.add_path_point(conversion.whole(given[0]), parameters.pose(given[1]))


def _clear_path(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    caller.state.moves.clear_path(*parameters.whole_numbers(parameter, None))


def _path_length(caller: ClientContext, parameter: Variant) -> int:
    return caller.state.moves.path_length(*parameters.whole_numbers(parameter, None))


# --- control log ------------------------------------------------------------------------------------------------------


def _start_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.state.arm.log.running = True
    caller.state.cycles.wake()


def _stop_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.state.arm.log.running = False


def _clear_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.state.arm.log.clear()


def _log_record(caller: ClientContext, parameter: Variant) -> Value:
    (index,) = parameters.whole_numbers(parameter, None)
    log = caller.state.arm.log
    try:
        return log.record(index)
    except IndexError:
        raise error_for(
            hresult.DISP_E_BADINDEX, tr("no record {index}; the log has {count} records", index=index, count=len(log))
        ) from None


def _query(answer: queries.Answer) -> Callable[[ClientContext, Variant], Variant]:
    return lambda caller, parameter: answer(caller.state.arm, parameter)


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
            if source is not state_report.destination:
                made.append(RobotCommand(f"{prefix}{suffix}Ex", _query(queries.stamped_pose_command(source, read))))
        made.append(RobotCommand(f"{prefix}Fig", _query(queries.figure_command(source))))
    return made


_R4, _I4 = VarType.R4, VarType.I4
ROBOT_COMMANDS: Final[dict[str, RobotCommand]] = {
    command.name.lower(): command
    for command in (
        RobotCommand("TakeArm", _take_arm, reads=False),
        RobotCommand("GiveArm", _give_arm, reads=False),
        RobotCommand("TakeArmState", _arm_state),
        RobotCommand("Motor", _motor, reads=False),
        RobotCommand("ExtSpeed", _ext_speed, reads=False),
        RobotCommand("CurSpd", _of_arm(lambda arm: arm.speeds.path.speed, _R4)),
        RobotCommand("CurAcc", _of_arm(lambda arm: arm.speeds.path.accel, _R4)),
        RobotCommand("CurDec", _of_arm(lambda arm: arm.speeds.path.decel, _R4)),
        RobotCommand("CurJSpd", _of_arm(lambda arm: arm.speeds.joint.speed, _R4)),
        RobotCommand("CurJAcc", _of_arm(lambda arm: arm.speeds.joint.accel, _R4)),
        RobotCommand("CurJDec", _of_arm(lambda arm: arm.speeds.joint.decel, _R4)),
        RobotCommand("CurExtSpd", _of_arm(lambda arm: arm.speeds.external.speed, _R4)),
        RobotCommand("CurExtAcc", _of_arm(lambda arm: arm.speeds.external.accel, _R4)),
        RobotCommand("CurExtDec", _of_arm(lambda arm: arm.speeds.external.decel, _R4)),
        RobotCommand("CurTool", _of_arm(lambda arm: arm.space.tools.current, _I4)),
        RobotCommand("CurWork", _of_arm(lambda arm: arm.space.works.current, _I4)),
        *_pose_commands(),
        *(RobotCommand(name, _query(answer)) for name, answer in queries.CALCULATIONS.items()),
        RobotCommand("Approach", _approach, reads=False),
        RobotCommand("Depart", _depart, reads=False),
        RobotCommand("DriveEx", _drive("DriveEx", absolute=False), reads=False),
        RobotCommand("DriveAEx", _drive("DriveAEx", absolute=True), reads=False),
        RobotCommand("RotateH", _rotate_hand, reads=False),
        RobotCommand("MotionSkip", _motion_skip, reads=False),
        RobotCommand("MotionComplete", _motion_complete),
        RobotCommand("SetToolDef", _define("SetToolDef", tool=True), reads=False),
        RobotCommand("GetToolDef", _defined(tool=True)),
        RobotCommand("SetWorkDef", _define("SetWorkDef", tool=False), reads=False),
        RobotCommand("GetWorkDef", _defined(tool=False)),
        RobotCommand("AddPathPoint", _add_path_point, reads=False),
        RobotCommand("ClrPathPoint", _clear_path, reads=False),
        RobotCommand("GetPathPointCount", _path_length),
        RobotCommand("GetSrvData", _query(queries.servo_data), in_slave=True),  # as on real controllers
        RobotCommand("StartLog", _start_log, reads=False),
        RobotCommand("StopLog", _stop_log, reads=False),
        RobotCommand("ClearLog", _clear_log, reads=False),
        RobotCommand("GetLogCount", _of_arm(lambda arm: len(arm.log), _I4)),
        RobotCommand("GetLogRecord", _log_record),
        RobotCommand("slvChangeMode", slave.change_mode, reads=False, in_slave=True),
        RobotCommand("slvGetMode", slave.get_mode, in_slave=True),
        RobotCommand(LATENESS, slave.get_lateness, in_slave=True),  # only virtual controllers have it
        RobotCommand("slvMove", slave.move, reads=False, in_slave=True),
        RobotCommand("slvSendFormat", slave.set_send_format, reads=False),
        RobotCommand("slvRecvFormat", slave.set_receive_format, reads=False),
        RobotCommand("GetRobotTypeName", _of_arm(lambda arm: arm.model.type_name, VarType.BSTR)),
        *(RobotCommand(each.name, of_controller(each), reads=not each.writes) for each in HAND_COMMANDS),
    )
}

NOT_SIMULATED: Final = (
    "SpeedMode", "CurSpeedMode", "SetAreaEnabled", "GetAreaEnabled", "RobInfo", "PayLoad", "HighPathAccuracy",
    "GrvOffset", "GrvCtrl", "CurLmt", "Zforce", "ServoLock", "ForceCtrl", "ForceParam", "ForceValue", "ForceSensor",
    "ForceWaitCondition", "CurForceSensorPayLoad", "CheckVirtualFence", "SyncTimeStart", "SyncTimeEnd", "SyncMoveStart",
    "SyncMoveEnd", "LoadPathPoint", "ConvertPoswork", "SetBaseDef", "GetBaseDef", "MotionPreparation",
    "GetMotionPreparationState", "AutoCal", "GetMechaButtonState", "ClearMechaButtonState", "CurScene", "CurSubScene",
    "SceneInfo",
)  # fmt: skip
"""Commands of real controllers that return E_NOTIMPL here."""

_NOT_SIMULATED: Final = frozenset(name.lower() for name in NOT_SIMULATED)
