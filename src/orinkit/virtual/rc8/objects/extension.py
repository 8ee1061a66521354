"""The commands of the electric hand in two tables: one for Controller_Execute, one for the extension ``Hand0``.

A command that moves the hand completes when the movement ends. With ``NEXT`` as the last parameter, it completes
immediately.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit.cao.provider import Deferred, ExtensionObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.hand import Hand
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.variables import conversion

HAND_NAME: Final = "Hand0"

NOT_SIMULATED: Final = ("Pallet", "Comm")
"""Extensions of real controllers that return E_NOTIMPL here."""

_NEXT: Final = "next"
_MAX_PARAMETERS: Final = 8


@dataclass(frozen=True, slots=True)
class HandCommand:
    """A command of the hand.

    Attributes:
        name: Name as documented; case-insensitive for clients.
        run: Executes the command.
        writes: If True, the command requires the right to write, else the right to read.
        simulated: If False, the command returns E_NOTIMPL.
    """

    name: str
    run: Callable[[Hand, Variant], Any]
    writes: bool = True
    simulated: bool = True

    def execute(self, caller: ClientContext, parameter: Variant) -> Any:
        """Execute the command for a client.

        Raises:
            CallError: NO_READ_RIGHT; NO_WRITE_RIGHT; errors of the hand.
        """
        if self.writes:
            caller.require_write()
        else:
            caller.require_read()
        return self.run(caller.state.hand, parameter)


class Hand0(ExtensionObject):
    """The hand as an Extension object of one client."""

    def __init__(self, caller: ClientContext, name: str) -> None:
        super().__init__(name, attribute=int(caller.access), help=caller.state.say("Electric hand"))
        self._caller = caller

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute a command: Chuck, UnChuck, CurPos ...

        Raises:
            CallError: E_INVALID_CMD_NAME; errors of the command.
        """
        found = EXTENSION_COMMANDS.get(command.strip().lower())
        if found is None:
            raise error_for(hresult.E_INVALID_CMD_NAME, f"{command:.40}")
        return found.execute(self._caller, parameter)


def find_extension(caller: ClientContext, name: str) -> Hand0:
    """Return an extension by its name; case-insensitive.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the extension.
    """
    wanted = name.strip().lower()
    if wanted == HAND_NAME.lower():
        return Hand0(caller, name)
    if wanted in map(str.lower, NOT_SIMULATED):
        raise error_for(hresult.E_NOTIMPL, f"{name:.40}")
    raise not_found(name)


# --- commands ---------------------------------------------------------------------------------------------------------


def _completion(move: Deferred[None], at_once: bool) -> Deferred[None] | None:
    return None if at_once else move


def _options(parameter: Variant) -> tuple[list[Variant], bool]:
    """Return the elements of a parameter without a trailing ``NEXT``, and True if there was one."""
    given = parameters.elements(parameter)
    if len(given) == 1 and isinstance(given[0].value, str):  # the string contains all elements
        given = [
            Variant(VarType.BSTR, part) for part in parameters.check_length(given[0].value).split(",", _MAX_PARAMETERS)
        ]
    last = given[-1].value if given else None
    at_once = isinstance(last, str) and parameters.check_length(last).strip().lower() == _NEXT
    return (given[:-1] if at_once else given), at_once


def _numbers(parameter: Variant, *names: str) -> tuple[list[float], bool]:
    """Return one number for each name, and True if the command completes immediately."""
    given, at_once = _options(parameter)
    if len(given) != len(names):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected the parameters [{names}], got {given} parameters", given=len(given), names=", ".join(names)),
        )
    return [conversion.double(each) for each in given], at_once


def _move_to(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (position, speed), at_once = _numbers(parameter, "mm", "%")
    return _completion(hand.move(position, speed), at_once)


def _move_by(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (distance, speed), at_once = _numbers(parameter, "mm", "%")
    return _completion(hand.move(hand.position + distance, speed), at_once)


def _hold_to(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (position, speed, force), at_once = _numbers(parameter, "mm", "%", "N")
    return _completion(hand.move(position, speed, force), at_once)


def _hold_by(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (distance, speed, force), at_once = _numbers(parameter, "mm", "%", "N")
    return _completion(hand.move(hand.position + distance, speed, force), at_once)


def _grip(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    given, at_once = _options(parameter)
    if len(given) != 2:
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "expected the parameters [force in N, True to close or False to open], got {given} parameters",
                given=len(given),
            ),
        )
    force, closing = conversion.double(given[0]), conversion.boolean(given[1])
    return _completion(hand.grip(force, closing=closing), at_once)


def _chuck(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (number,), at_once = _numbers(parameter, "n")
    return _completion(hand.chuck(parameters.whole(number)), at_once)


def _unchuck(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    (number,), at_once = _numbers(parameter, "n")
    return _completion(hand.unchuck(parameters.whole(number)), at_once)


def _to_origin(hand: Hand, parameter: Variant) -> Deferred[None] | None:
    _, at_once = _options(parameter)
    return _completion(hand.to_origin(), at_once)


def _motor(hand: Hand, parameter: Variant) -> None:
    (on,) = parameters.whole_numbers(parameter, 1)
    hand.switch_motor(bool(on))


def _stop(hand: Hand, _: Variant) -> None:
    hand.stop()


def _not_simulated(name: str, *, writes: bool = True) -> HandCommand:
    def fail(_hand: Hand, _parameter: Variant) -> None:
        raise error_for(hresult.E_NOTIMPL, name)

    return HandCommand(name, fail, writes, simulated=False)


def _query(vt: VarType, read: Callable[[Hand], object]) -> Callable[[Hand, Variant], Variant]:
    return lambda hand, _: Variant(vt, read(hand))


_POSITION: Final = _query(VarType.R8, lambda hand: hand.position)
_BUSY: Final = _query(VarType.BOOL, lambda hand: hand.busy)
_HOLDING: Final = _query(VarType.BOOL, lambda hand: hand.holding)

CONTROLLER_COMMANDS: Final = (
    HandCommand("HandMoveA", _move_to),
    HandCommand("HandMoveR", _move_by),
    HandCommand("HandMoveAH", _hold_to),
    HandCommand("HandMoveRH", _hold_by),
    HandCommand("HandMoveH", _grip),
    HandCommand("HandStop", _stop),
    HandCommand("HandCurPos", _POSITION, writes=False),
    HandCommand("HandCurLoad", _query(VarType.R8, lambda hand: hand.load), writes=False),
    HandCommand("HandBusyState", _BUSY, writes=False),
    HandCommand("HandHoldState", _HOLDING, writes=False),
    HandCommand("HandMotorState", _query(VarType.BOOL, lambda hand: hand.motor), writes=False),
    _not_simulated("HandMoveZH"),  # undocumented
    _not_simulated("HandMoveVH"),  # HandMoveVH and HandCurPressure are for vacuum hands
    _not_simulated("HandCurPressure", writes=False),
)
"""Commands of the hand for Controller_Execute."""

EXTENSION_COMMANDS: Final[dict[str, HandCommand]] = {
    command.name.lower(): command
    for command in (
        HandCommand("Chuck", _chuck),
        HandCommand("UnChuck", _unchuck),
        HandCommand("Motor", _motor),
        HandCommand("Org", _to_origin),
        HandCommand("Stop", _stop),
        HandCommand("CurPos", _POSITION, writes=False),
        HandCommand("get_BusyState", _BUSY, writes=False),
        HandCommand("get_HoldState", _HOLDING, writes=False),
        HandCommand("get_OrgState", _query(VarType.BOOL, lambda hand: hand.origin), writes=False),
    )
}
"""Commands of the hand for the extension ``Hand0``, by name in lower case."""
