"""SysInfo: the items of information of the controller (provider guide 5.2.11.16)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.variables import conversion

_TEACH_PENDANT: Final = 1
_NOT_IDENTIFIED: Final = 0  # the CPU of a virtual controller
_TRUE: Final = -1
_COUNT_ORDER: Final = "IFDVPJTS"
_BATTERY_DATE: Final = 15


def _mac_address(state: RC8State) -> str:
    """Return a locally administered address that depends only on the serial number."""
    digest = hashlib.sha256(state.identity.serial_no.encode()).digest()
    return "02:" + ":".join(f"{byte:02X}" for byte in digest[:5])


def _flag(read: Callable[[RC8State], bool]) -> Callable[[RC8State], int]:
    return lambda state: _TRUE if read(state) else 0


_I4: Final = int(VarType.I4)
_ITEMS: Final[tuple[tuple[int, Callable[[RC8State], Any]], ...]] = (
    (VarType.BSTR, lambda state: state.identity.serial_no),
    (VarType.BSTR, _mac_address),
    (_I4, lambda _: _TEACH_PENDANT),
    (_I4 | ARRAY, lambda state: [state.variables.counts[name] for name in _COUNT_ORDER]),
    (_I4, lambda _: _NOT_IDENTIFIED),
    (_I4, lambda state: state.login_level),
    (_I4, _flag(lambda state: state.tasks.supervisors_running > 0)),
    (_I4, lambda _: 0),  # the virtual pendant has no panels
    (_I4, lambda state: state.usage.total.powered),
    (_I4, lambda state: state.usage.total.running),
    (_I4, lambda state: state.usage.cumulative.powered),
    (_I4, lambda state: state.usage.cumulative.running),
    (_I4, lambda state: state.usage.since_start.powered),
    (_I4, lambda state: state.usage.since_start.running),
    (_I4, lambda state: state.usage.motor_starts),
    (_I4, _flag(lambda state: state.battery_overdue)),
    (_I4, _flag(lambda state: state.battery_overdue)),
)
"""VARIANT type and source of each item, by its number."""


def system_info(caller: ClientContext, parameter: Variant) -> Variant:
    """Return an item of information.

    With ``strict``, item 15 is the date on which the encoder batteries have to be replaced, until this date.

    Raises:
        CallError: E_INVALIDARG if the item does not exist.
    """
    item = conversion.whole(parameter)
    if not 0 <= item < len(_ITEMS):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("unknown item {item}; valid items: 0 to {last}", item=item, last=len(_ITEMS) - 1),
        )
    state = caller.state
    if item == _BATTERY_DATE and state.switches.strict and not state.battery_overdue:
        return Variant(VarType.DATE, state.battery_due)
    vt, read = _ITEMS[item]
    return Variant(vt, read(state))
