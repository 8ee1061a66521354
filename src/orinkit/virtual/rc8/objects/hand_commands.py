"""The commands of the hands of COBOTTA and COBOTTA PRO, for Controller_Execute and Robot_Execute.

A command that moves a hand completes when the movement ends. With ``NEXT`` as the last parameter, or with 0 for the
parameter "wait" of the commands ``Twofg...`` and ``Vgc10...``, it completes immediately.

Public programs and their comments name the commands of the parallel hand, of the vacuum hand and of the 2FG7. No public
source defines those of the VGC10, nor the parameters of HandMoveZH; here, their form is that of similar commands.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.hand.onrobot import EXTERNAL, INTERNAL, TwoFinger
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.variables import conversion

T = TypeVar("T")

_NEXT: Final = "next"
_MAX_PARAMETERS: Final = 8
_PRO: Final = "PRO"


@record
class HandCommand(Generic[T]):
    """A command of a hand.

    Attributes:
        name: Name as documented; case-insensitive for clients.
        run: Executes the command; its arguments are the hand, or the state of the controller, and the parameter.
        writes: True if the client must have the right to write; otherwise the right to read is sufficient.
    """

    name: str
    run: Callable[[T, Variant], Any]
    writes: bool = True

    def execute(self, caller: ClientContext, hand: T, parameter: Variant) -> Any:
        """Execute the command for a client.

        Raises:
            CallError: NO_READ_RIGHT; NO_WRITE_RIGHT; errors of the hand.
        """
        if self.writes:
            caller.require_write()
        else:
            caller.require_read()
        return self.run(hand, parameter)


def of_controller(command: HandCommand[RC8State]) -> Callable[[ClientContext, Variant], Any]:
    """Return the function that executes a command for a client of the controller or the robot."""
    return lambda caller, parameter: command.execute(caller, caller.state, parameter)


# --- parameters -------------------------------------------------------------------------------------------------------


def options(parameter: Variant) -> tuple[list[Variant], bool]:
    """Return the elements of a parameter without a trailing ``NEXT``, and True if there was one."""
    given = parameters.elements(parameter)
    if len(given) == 1 and isinstance(given[0].value, str):  # the string contains all elements
        given = [
            Variant(VarType.BSTR, part) for part in parameters.check_length(given[0].value).split(",", _MAX_PARAMETERS)
        ]
    last = given[-1].value if given else None
    at_once = isinstance(last, str) and parameters.check_length(last).strip().lower() == _NEXT
    return (given[:-1] if at_once else given), at_once


def numbers(parameter: Variant, *names: str) -> tuple[list[float], bool]:
    """Return one number for each name, and True if the command completes immediately.

    Raises:
        CallError: E_INVALIDARG if the number of parameters is wrong; DISP_E_TYPEMISMATCH.
    """
    given, at_once = options(parameter)
    if len(given) != len(names):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected the parameters [{names}], got {given} parameters", given=len(given), names=", ".join(names)),
        )
    return [conversion.double(each) for each in given], at_once


def completion(move: Deferred[None], at_once: bool) -> Deferred[None] | None:
    """Return the result of a command: the movement, or None if the command completes immediately."""
    return None if at_once else move


def query(vt: VarType, read: Callable[[RC8State], object]) -> Callable[[RC8State, Variant], Variant]:
    """Return the function of a command that reads a value."""
    return lambda state, _: Variant(vt, read(state))


# --- the hands of a COBOTTA -------------------------------------------------------------------------------------------


def _move_to(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    (position, speed), at_once = numbers(parameter, "mm", "%")
    return completion(state.hand.move(position, speed), at_once)


def _move_by(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    (distance, speed), at_once = numbers(parameter, "mm", "%")
    return completion(state.hand.move(state.hand.position + distance, speed), at_once)


def _hold_to(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    (position, speed, force), at_once = numbers(parameter, "mm", "%", "N")
    return completion(state.hand.move(position, speed, force), at_once)


def _hold_by(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    (distance, speed, force), at_once = numbers(parameter, "mm", "%", "N")
    return completion(state.hand.move(state.hand.position + distance, speed, force), at_once)


def _grip(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    given, at_once = options(parameter)
    if len(given) != 2:
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "expected the parameters [force in N, True to close or False to open], got {given} parameters",
                given=len(given),
            ),
        )
    force, closing = conversion.double(given[0]), conversion.boolean(given[1])
    return completion(state.hand.grip(force, closing=closing), at_once)


def _grip_in_zone(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    (low, high, force, closing), at_once = numbers(parameter, "mm", "mm", "N", tr("True to close or False to open"))
    return completion(state.hand.grip_in_zone(low, high, force, closing=parameters.flag(closing)), at_once)


def _suck(state: RC8State, parameter: Variant) -> None:
    given, _ = options(parameter)
    if len(given) != 2:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected the parameters [power in %, True for suction], got {given} parameters", given=len(given)),
        )
    power, suction = conversion.double(given[0]), conversion.boolean(given[1])
    if suction:
        state.hands.vacuum.start(power)
    else:
        state.hands.vacuum.stop()


def _stop(state: RC8State, _: Variant) -> None:
    state.hand.stop()
    state.hands.vacuum.stop()


def _load(state: RC8State) -> float:
    return max(state.hand.load, state.hands.vacuum.load)


def _holds(state: RC8State) -> bool:
    return state.hand.holding or state.hands.vacuum.holding


def _cobotta_commands() -> tuple[HandCommand[RC8State], ...]:
    r8, boolean = VarType.R8, VarType.BOOL
    return (
        HandCommand("HandMoveA", _move_to),
        HandCommand("HandMoveR", _move_by),
        HandCommand("HandMoveAH", _hold_to),
        HandCommand("HandMoveRH", _hold_by),
        HandCommand("HandMoveH", _grip),
        HandCommand("HandMoveZH", _grip_in_zone),
        HandCommand("HandMoveVH", _suck),
        HandCommand("HandStop", _stop),
        HandCommand("HandCurPos", query(r8, lambda state: state.hand.position), writes=False),
        HandCommand("HandCurLoad", query(r8, _load), writes=False),
        HandCommand("HandCurPressure", query(r8, lambda state: state.hands.vacuum.pressure), writes=False),
        HandCommand("HandBusyState", query(boolean, lambda state: state.hand.busy), writes=False),
        HandCommand("HandHoldState", query(boolean, _holds), writes=False),
        HandCommand("HandInposState", query(boolean, lambda state: state.hand.in_position), writes=False),
        HandCommand("HandZonState", query(boolean, lambda state: state.hand.in_zone), writes=False),
        HandCommand("HandMotorState", query(boolean, lambda state: state.hand.motor), writes=False),
        HandCommand("HandGrip", _stored_grip),
        HandCommand("HandRelease", _stored_release),
    )


def _stored_grip(state: RC8State, _: Variant) -> Deferred[None]:
    """Grip with stored parameters: on a COBOTTA PRO with the 2FG7, otherwise with the parallel hand."""
    if _PRO not in state.arm.model.name.upper():
        return _reported(state, state.hand.grip())
    hand = state.hands.two_finger
    low, high = hand.widths
    return _reported(state, hand.grip(low if hand.mode == EXTERNAL else high, 20, 100, must_grip=True))


def _stored_release(state: RC8State, _: Variant) -> Deferred[None]:
    if _PRO not in state.arm.model.name.upper():
        return state.hand.move(state.hand.model.stroke, 100)
    hand = state.hands.two_finger
    low, high = hand.widths
    return hand.release(high if hand.mode == EXTERNAL else low)


def _reported(state: RC8State, move: Deferred[None]) -> Deferred[None]:
    """Return a movement whose failure to grip also becomes an error of the controller, as on real controllers."""

    def report() -> None:
        try:
            move.result()
        except CallError as error:
            if error.code == hresult.GRIP_NOT_DETECTED:
                state.raise_error(error.code)

    move.add_done_callback(report)
    return move


# --- 2FG7 -------------------------------------------------------------------------------------------------------------


def _two_grip(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    width, force, speed, wait = parameters.numbers(parameter, None, None, None, 1)
    waits = parameters.flag(wait)
    move = state.hands.two_finger.grip(width, force, speed, must_grip=waits)
    return _reported(state, move) if waits else None


def _two_release(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    width, wait = parameters.numbers(parameter, None, 1)
    waits = parameters.flag(wait)
    move = state.hands.two_finger.release(width)
    return move if waits else None


def _two_set(change: Callable[[TwoFinger, float], None]) -> Callable[[RC8State, Variant], None]:
    def run(state: RC8State, parameter: Variant) -> None:
        (value,) = parameters.numbers(parameter, None)
        change(state.hands.two_finger, value)

    return run


def _two_query(vt: VarType, read: Callable[[TwoFinger], object]) -> Callable[[RC8State, Variant], Variant]:
    return query(vt, lambda state: read(state.hands.two_finger))


def _reading(name: str, run: Callable[[RC8State, Variant], Any]) -> HandCommand[RC8State]:
    return HandCommand(name, run, writes=False)


def _two_switch(mode: int) -> Callable[[RC8State, Variant], None]:
    return lambda state, _: state.hands.two_finger.switch(mode)


def _two_finger_commands() -> tuple[HandCommand[RC8State], ...]:
    i4, r4 = VarType.I4, VarType.R4
    return (
        HandCommand("TwofgGrip", _two_grip),
        HandCommand("TwofgRelease", _two_release),
        HandCommand("TwofgStop", lambda state, _: state.hands.two_finger.stop()),
        _reading("TwofgIsConn", query(i4, lambda _: 1)),
        _reading("TwofgIsBusy", _two_query(i4, lambda hand: int(hand.busy))),
        _reading("TwofgIsGrip", _two_query(i4, lambda hand: int(hand.holding))),
        _reading("TwofgGetErrorCode", query(i4, lambda _: 0)),  # calibration and sensor of the model cannot fail
        _reading("TwofgGetWidth", _two_query(r4, lambda hand: hand.width)),
        _reading("TwofgGetMinWidth", _two_query(r4, lambda hand: hand.widths[0])),
        _reading("TwofgGetMaxWidth", _two_query(r4, lambda hand: hand.widths[1])),
        _reading("TwofgGetForce", _two_query(i4, lambda hand: round(hand.force))),
        _reading("TwofgGetOrientation", _two_query(i4, lambda hand: hand.orientation)),
        _reading("TwofgGetFingerLength", _two_query(r4, lambda hand: hand.finger_length)),
        _reading("TwofgGetFTWidth", _two_query(r4, lambda hand: hand.tip_width)),
        _reading("TwofgGetMode", _two_query(i4, lambda hand: hand.mode)),
        HandCommand("TwofgSetOrientation", _two_set(lambda hand, value: hand.orient(parameters.whole(value)))),
        HandCommand("TwofgSetFingerLength", _two_set(lambda hand, value: hand.measure(finger_length=value))),
        HandCommand("TwofgSetFTWidth", _two_set(lambda hand, value: hand.measure(tip_width=value))),
        HandCommand("TwofgSwitchToExternal", _two_switch(EXTERNAL)),
        HandCommand("TwofgSwitchToInternal", _two_switch(INTERNAL)),
    )


# --- VGC10 ------------------------------------------------------------------------------------------------------------


def _vacuum_grip(state: RC8State, parameter: Variant) -> Deferred[None] | None:
    channel, power, wait = parameters.numbers(parameter, None, None, 1)
    waits = parameters.flag(wait)
    held = state.hands.vacuum_gripper.grip(parameters.whole(channel), power)
    return _reported(state, held) if waits else None


def _vacuum_release(state: RC8State, parameter: Variant) -> None:
    (channel,) = parameters.whole_numbers(parameter, 0)
    state.hands.vacuum_gripper.release(channel)


def _vacuum_pressure(state: RC8State, parameter: Variant) -> Variant:
    (channel,) = parameters.whole_numbers(parameter, 1)
    pressure = max(each.pressure for each in state.hands.vacuum_gripper.of(channel))
    return Variant(VarType.R4, -pressure)


def _vacuum_holds(state: RC8State, parameter: Variant) -> Variant:
    (channel,) = parameters.whole_numbers(parameter, 0)
    return Variant(VarType.I4, int(all(each.holding for each in state.hands.vacuum_gripper.of(channel))))


CONTROLLER_COMMANDS: Final = _cobotta_commands()
"""Commands of the hands for Controller_Execute."""

ROBOT_COMMANDS: Final[tuple[HandCommand[RC8State], ...]] = (
    *CONTROLLER_COMMANDS,
    *_two_finger_commands(),
    HandCommand("Vgc10Grip", _vacuum_grip),
    HandCommand("Vgc10Release", _vacuum_release),
    HandCommand("Vgc10IsConn", query(VarType.I4, lambda _: 1), writes=False),
    HandCommand("Vgc10IsGrip", _vacuum_holds, writes=False),
    HandCommand("Vgc10GetVacuum", _vacuum_pressure, writes=False),
)
"""Commands of the hands for Robot_Execute."""
