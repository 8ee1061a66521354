"""The controller's system variables: a table of names, types, and functions that read and write the values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import N_, Translate, tr
from orinkit.core.record import EMPTY, record
from orinkit.values.variant import Variant, VarType, type_name
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.variables import conversion, types


@record
class SystemVariable:
    """A row of the table.

    Attributes:
        name: Name with ``@``, in upper case.
        vt: VARIANT type of the value.
        read: Reads the value from the controller.
        text: Description in English.
        write: Sets the value for a client; None if the variable is read-only.
        text_values: Values of the placeholders in the text.
    """

    name: str
    vt: int
    read: Callable[[RC8State], Any]
    text: str
    write: Callable[[ClientContext, Variant], None] | None = None
    text_values: Mapping[str, str] = EMPTY

    def help(self, say: Translate) -> str:
        """Return a description and the type, in the controller's language."""
        return f"{say(self.text, **self.text_values)} ({type_name(self.vt)})"


def _clear_error(caller: ClientContext, given: Variant) -> None:
    code = conversion.whole(given)
    if code != 0:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("only 0, which clears the errors, can be written; got {code}", code=code),
        )
    caller.state.clear_errors(caller.origin)


def _set_lock(caller: ClientContext, given: Variant) -> None:
    caller.state.machine_lock(conversion.boolean(given), caller.origin)


def _count(name: str) -> SystemVariable:
    return SystemVariable(
        f"@VAR_{name}_LEN",
        VarType.I4,
        lambda state: state.variables.counts[name],
        N_("Number of {name} variables"),
        lambda caller, given: caller.state.variables.resize(name, conversion.whole(given)),
        text_values={"name": name},
    )


SYSTEM_VARIABLES: Final[dict[str, SystemVariable]] = {
    entry.name: entry
    for entry in (
        SystemVariable("@MODE", VarType.I4, lambda s: s.switches.mode,
                       N_("Mode: 1 manual, 2 teach check, 3 automatic")),
        SystemVariable("@ERROR_CODE", VarType.I4, lambda s: hresult.signed(s.faults.code),
                       N_("Newest current error, 0 if there is none; writing 0 clears the errors"), _clear_error),
        SystemVariable("@ERROR_CODE_HEX", VarType.BSTR, lambda s: f"{s.faults.code:08X}",
                       N_("Newest current error as eight hexadecimal digits")),
        SystemVariable("@ERROR_DESCRIPTION", VarType.BSTR, lambda s: s.faults.message,
                       N_("Text of the newest current error")),
        SystemVariable("@ERROR", VarType.I4, lambda s: hresult.signed(s.faults.code),
                       N_("The same as @ERROR_CODE"), _clear_error),
        SystemVariable("@EMERGENCY_STOP", VarType.BOOL, lambda s: s.switches.emergency_stop,
                       N_("Emergency stop is pressed")),
        SystemVariable("@DEADMAN_SW", VarType.BOOL, lambda s: s.switches.deadman,
                       N_("Enable (deadman) switch is held")),
        SystemVariable("@AUTO_ENABLE", VarType.BOOL, lambda s: s.switches.auto_enable,
                       N_("Auto-enable input is on")),
        SystemVariable("@PROTECTIVE_STOP", VarType.BOOL, lambda s: s.switches.protective_stop,
                       N_("Protective stop is on")),
        SystemVariable("@LOCK", VarType.BOOL, lambda s: s.switches.machine_lock,
                       N_("Machine lock: motions are executed, but the arm does not move"), _set_lock),
        SystemVariable("@BUSY_STATUS", VarType.BOOL, lambda s: s.running_programs > 0,
                       N_("A program task is running")),
        SystemVariable("@NORMAL_STATUS", VarType.BOOL, lambda s: s.faults.code == 0,
                       N_("No error is active")),
        SystemVariable("@TSR_BUSY_STATUS", VarType.BOOL, lambda s: s.tasks.supervisors_running > 0,
                       N_("A supervisory task (TSR) is running")),
        SystemVariable("@TIME", VarType.I4, RC8State.milliseconds,
                       N_("Milliseconds since power-on")),
        SystemVariable("@CURRENT_TIME", VarType.DATE, lambda s: s.calendar.now(),
                       N_("Local date and time")),
        SystemVariable("@MAKER_NAME", VarType.BSTR, lambda s: s.identity.maker, N_("Maker")),
        SystemVariable("@TYPE", VarType.BSTR, lambda s: s.identity.type, N_("Type of the controller")),
        SystemVariable("@VERSION", VarType.BSTR, lambda s: s.identity.version, N_("Software version")),
        SystemVariable("@SERIAL_NO", VarType.BSTR, lambda s: s.identity.serial_no, N_("Serial number")),
        SystemVariable("@IO_ALLOC_MODE", VarType.I4, lambda _: types.IO_ALLOCATION_MINI,
                       N_("I/O allocation mode: 0 is mini")),
        *map(_count, types.USER_CLASSES),
        SystemVariable("@VAR_IO_LEN", VarType.I4, lambda s: s.variables.io_points, N_("Number of I/O points")),
    )
}  # fmt: skip
