"""The extensions ``Hand0`` to ``Hand7``: electric grippers and their commands (provider guide 5.2.36).

A command that moves a gripper completes when the movement ends; with ``NEXT`` as the last parameter, it completes
immediately. The guide does not say which of the two a real controller does.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final

from orinkit.cao.provider import Deferred, ExtensionObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.hand.gripper import Gripper
from orinkit.virtual.rc8.objects.hand_commands import HandCommand, completion, numbers, options
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.state import RC8State

HAND_NAME: Final = "Hand"
"""Name of an extension, before the number of its board."""

NOT_SIMULATED: Final = ("Pallet", "Comm")
"""Extensions of real controllers that return E_NOTIMPL here."""

_NAME: Final = re.compile(r"\s*hand([0-7])\s*", re.IGNORECASE)


class HandExtension(ExtensionObject):
    """A gripper as an Extension object of one client."""

    def __init__(self, caller: ClientContext, name: str, gripper: Gripper) -> None:
        super().__init__(name, attribute=int(caller.access), help=caller.state.say("Electric hand"))
        self._caller = caller
        self._gripper = gripper

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute a command: Chuck, UnChuck, CurPos ...

        Raises:
            CallError: E_INVALID_CMD_NAME; errors of the command.
        """
        found = EXTENSION_COMMANDS.get(command.strip().lower())
        if found is None:
            raise error_for(hresult.E_INVALID_CMD_NAME, f"{command:.40}")
        return found.execute(self._caller, self._gripper, parameter)


def find_extension(caller: ClientContext, name: str) -> HandExtension:
    """Return an extension by its name; case-insensitive.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the extension.
    """
    gripper = find_gripper(caller.state, name)
    if gripper is not None:
        return HandExtension(caller, name, gripper)
    if name.strip().lower() in map(str.lower, NOT_SIMULATED):
        raise error_for(hresult.E_NOTIMPL, f"{name:.40}")
    raise not_found(name)


def find_gripper(state: RC8State, name: str) -> Gripper | None:
    """Return the gripper with a name such as ``Hand0``, or None if it is not fitted."""
    found = _NAME.fullmatch(name)
    return state.hands.grippers.get(int(found[1])) if found else None


def extension_names(state: RC8State) -> list[str]:
    """Return the names of the grippers that are fitted."""
    return [f"{HAND_NAME}{number}" for number in state.hands.grippers]


# --- commands ---------------------------------------------------------------------------------------------------------


def _point(move: Callable[[Gripper, int], Deferred[None]]) -> Callable[[Gripper, Variant], Deferred[None] | None]:
    def run(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
        (number,), at_once = numbers(parameter, "n")
        return completion(move(gripper, parameters.whole(number)), at_once)

    return run


def _motor(gripper: Gripper, parameter: Variant) -> None:
    (on,) = parameters.whole_numbers(parameter, 1)
    gripper.switch_motor(bool(on))


def _origin(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    _, at_once = options(parameter)
    return completion(gripper.to_origin(), at_once)


def _move(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    (position, speed), at_once = numbers(parameter, "mm", "%")
    return completion(gripper.move(position, parameters.whole(speed)), at_once)


def _shift(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    (distance, speed), at_once = numbers(parameter, "mm", "%")
    return completion(gripper.shift(distance, parameters.whole(speed)), at_once)


def _move_hold(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    (position, speed, force), at_once = numbers(parameter, "mm", "%", "%")
    return completion(gripper.move(position, parameters.whole(speed), force=parameters.whole(force)), at_once)


def _shift_hold(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    (distance, speed, force), at_once = numbers(parameter, "mm", "%", "%")
    return completion(gripper.shift(distance, parameters.whole(speed), force=parameters.whole(force)), at_once)


def _hold(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    given, at_once = numbers(parameter, "%", "%", tr("0 to open"))
    speed, force, direction = map(parameters.whole, given)
    return completion(gripper.hold(speed, force, closing=bool(direction)), at_once)


def _hold_in_zone(gripper: Gripper, parameter: Variant) -> Deferred[None] | None:
    (low, high, *rest), at_once = numbers(parameter, "mm", "mm", "%", "%", tr("0 to open"))
    speed, force, direction = map(parameters.whole, rest)
    return completion(gripper.hold_in_zone(low, high, speed, force, closing=bool(direction)), at_once)


_ITEM_TYPES: Final = (VarType.I4, VarType.R4, VarType.I4, VarType.I4, VarType.R4, VarType.R4)


def _get_point(gripper: Gripper, parameter: Variant) -> Variant:
    number, item = parameters.whole_numbers(parameter, None, None)
    items = gripper.point(number).items()
    if not 0 <= item < len(items):
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("item {item} is not within", item=item) + f" 0..{len(items) - 1}",
        )
    return Variant(_ITEM_TYPES[item], items[item])


def _state(read: Callable[[Gripper], int]) -> Callable[[Gripper, Variant], Variant]:
    return lambda gripper, _: Variant(VarType.I4, int(read(gripper)))


EXTENSION_COMMANDS: Final[dict[str, HandCommand[Gripper]]] = {
    command.name.lower(): command
    for command in (
        HandCommand("Chuck", _point(lambda gripper, number: gripper.move_to_point(number, must_hold=True))),
        HandCommand("UnChuck", _point(Gripper.move_to_point)),
        HandCommand("Motor", _motor),
        HandCommand("Org", _origin),
        HandCommand("MoveP", _point(Gripper.move_to_point)),
        HandCommand("MoveA", _move),
        HandCommand("MoveR", _shift),
        HandCommand("MoveAH", _move_hold),
        HandCommand("MoveRH", _shift_hold),
        HandCommand("MoveH", _hold),
        HandCommand("MoveZH", _hold_in_zone),
        HandCommand("Stop", lambda gripper, _: gripper.stop()),
        HandCommand("CurPos", lambda gripper, _: Variant(VarType.R4, gripper.position), writes=False),
        HandCommand("GetPoint", _get_point, writes=False),
        HandCommand("get_EmgState", _state(lambda gripper: not gripper.emergency), writes=False),
        HandCommand("get_ZonState", _state(lambda gripper: gripper.in_zone), writes=False),
        HandCommand("get_OrgState", _state(lambda gripper: gripper.origin), writes=False),
        HandCommand("get_HoldState", _state(lambda gripper: gripper.holding), writes=False),
        HandCommand("get_InposState", _state(lambda gripper: gripper.in_position), writes=False),
        HandCommand("get_Error", _state(lambda gripper: gripper.error), writes=False),
        HandCommand("get_BusyState", _state(lambda gripper: gripper.busy), writes=False),
        HandCommand("get_MotorState", _state(lambda gripper: gripper.motor), writes=False),
    )
}
"""Commands of an electric gripper, by name in lower case."""
