"""The extended commands of Controller_Execute: a table of names, functions and required rights.

A parameter may be a scalar, a one-element array or a number as text. A command without parameters accepts any value and
ignores it, because clients send VT_EMPTY, 0 or "". A command without a result returns None.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.rc8.task_modes import StopMode
from orinkit.values.variant import Value, Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects import program_commands as programs
from orinkit.virtual.rc8.objects.hand_commands import CONTROLLER_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.objects.hand_commands import of_controller
from orinkit.virtual.rc8.objects.slave_use import SlaveUse
from orinkit.virtual.rc8.objects.system_info import system_info
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.switches import ModeSwitch, TokenKind
from orinkit.virtual.rc8.variables import conversion


@record
class ControllerCommand:
    """An extended command.

    Attributes:
        name: Name as documented; case-insensitive for clients.
        run: Executes the command.
        writes: If True, the command requires the right to write, else the right to read.
        slave_mode: Use by the client that is in slave mode; the provider guide restricts no command of the controller.
    """

    name: str
    run: Callable[[ClientContext, Variant], Any]
    writes: bool = False
    slave_mode: SlaveUse = SlaveUse.ANSWERED


def execute(caller: ClientContext, name: str, parameter: Variant) -> Any:
    """Execute a command for a client.

    Raises:
        CallError: E_INVALID_CMD_NAME; REFUSED_IN_SLAVE_MODE; NO_READ_RIGHT; NO_WRITE_RIGHT; errors of the command.
    """
    command = COMMANDS.get(name.strip().lower())
    if command is None:
        raise error_for(hresult.E_INVALID_CMD_NAME, name)
    command.slave_mode.require(caller)
    if command.writes:
        caller.require_write()
    else:
        caller.require_read()
    return command.run(caller, parameter)


def _clear_error(caller: ClientContext, _: Variant) -> Value:
    caller.state.clear_errors(caller.origin)
    return None


def _error_description(caller: ClientContext, parameter: Variant) -> Value:
    code = conversion.whole(parameter)
    if not -(2**31) <= code < 2**32:
        raise error_for(hresult.E_INVALIDARG, tr("{code} exceeds 32 bits", code=code))
    return caller.state.faults.text_of(code)


def _current_error_count(caller: ClientContext, _: Variant) -> Value:
    return len(caller.state.faults.current)


def _current_error(caller: ClientContext, parameter: Variant) -> Value:
    record = caller.state.faults.current.at(conversion.whole(parameter))
    return record.as_current(dated=caller.state.profile.dated_errors)


def _error_log_count(caller: ClientContext, _: Variant) -> Value:
    return len(caller.state.faults.log)


def _error_log(caller: ClientContext, parameter: Variant) -> Value:
    return caller.state.faults.log.at(conversion.whole(parameter)).as_logged()


def _operation_log_count(caller: ClientContext, _: Variant) -> Value:
    return len(caller.state.operations)


def _operation_log(caller: ClientContext, parameter: Variant) -> Value:
    return caller.state.operations.at(conversion.whole(parameter)).as_logged()


def system_state(state: RC8State) -> int:
    """Return the 32 bits of SysState; bits of features that are not simulated are 0."""
    switches = state.switches
    bits = {
        0: state.running_programs > 0,
        1: state.faults.code != 0,
        2: state.robots.motors_on,
        3: True,  # initialised: clients can connect only after the start
        4: switches.mode is ModeSwitch.AUTOMATIC,
        5: switches.mode is ModeSwitch.AUTOMATIC and switches.token.kind is not TokenKind.TP,
        6: state.battery_overdue,
        10: switches.emergency_stop,
        11: switches.auto_enable,
        12: switches.protective_stop,
        13: state.robots.stopping,
        17: state.robots.calibrated,
        18: switches.mode is ModeSwitch.MANUAL,
        19: state.tasks.cycle_complete,
        20: state.robots.busy,
        21: not state.robots.settled,
        24: not state.robots.busy,
    }
    return sum(1 << bit for bit, on in bits.items() if on)


def _system_state(caller: ClientContext, _: Variant) -> Value:
    return system_state(caller.state)


def _manual_reset(caller: ClientContext, _: Variant) -> Value:
    """Reset the safety functions; this fails while the emergency stop or the protective stop is active."""
    switches = caller.state.switches
    if switches.emergency_stop:
        raise error_for(hresult.EMERGENCY_STOP_NOT_RELEASED)
    if switches.protective_stop:
        raise error_for(hresult.PROTECTIVE_STOP_ON)
    return None


def _motion_preparation(caller: ClientContext, parameter: Variant) -> Value:
    """Prepare the robot for motions; this fails during a stop, and while there is an error."""
    _manual_reset(caller, parameter)
    if caller.state.faults.code:
        raise error_for(hresult.ERROR_PRESENT)
    return None


def _torque_off(caller: ClientContext, _: Variant) -> Value:
    return caller.state.switches.torque_off


COMMANDS: Final[dict[str, ControllerCommand]] = {
    command.name.lower(): command
    for command in (
        ControllerCommand("ClearError", _clear_error, writes=True),
        ControllerCommand("GetErrorDescription", _error_description),
        ControllerCommand("GetCurErrorCount", _current_error_count),
        ControllerCommand("GetCurErrorInfo", _current_error),
        ControllerCommand("GetErrorLogCount", _error_log_count),
        ControllerCommand("GetErrorLog", _error_log),
        ControllerCommand("GetOprLogCount", _operation_log_count),
        ControllerCommand("GetOprLog", _operation_log),
        ControllerCommand("KillAll", programs.stop_group(StopMode.INITIALIZE), writes=True),
        ControllerCommand("KillAllTsr", programs.stop_group(StopMode.INITIALIZE, supervisory=True), writes=True),
        ControllerCommand("RunAllTsr", programs.run_supervisors, writes=True),
        ControllerCommand("SuspendAll", programs.stop_group(StopMode.INSTANT), writes=True),
        ControllerCommand("StepStopAll", programs.stop_group(StopMode.STEP), writes=True),
        ControllerCommand("ContinueStartAll", programs.continue_all, writes=True),
        ControllerCommand("GetPublicValue", programs.get_public),
        ControllerCommand("SetPublicValue", programs.set_public, writes=True),
        ControllerCommand("SysInfo", system_info),
        ControllerCommand("SysState", _system_state),
        ControllerCommand("StoState", _torque_off),
        ControllerCommand("ManualReset", _manual_reset, writes=True),
        ControllerCommand("ManualResetPreparation", _manual_reset, writes=True),
        ControllerCommand("ResetStoState", _manual_reset, writes=True),
        ControllerCommand("MotionPreparation", _motion_preparation, writes=True),
        *(ControllerCommand(each.name, of_controller(each), each.writes) for each in HAND_COMMANDS),
    )
}
