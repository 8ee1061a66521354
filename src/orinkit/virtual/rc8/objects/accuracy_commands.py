"""The extended commands of Robot_Execute that set the accuracy of motions and the behaviour of the planner.

CrtMotionAllow, EncMotionAllow, EncMotionAllowJnt, ErAlw and MotionTimeout set :mod:`orinkit.virtual.rc8.robot.accuracy`;
SingularAvoid and SpeedMode set :mod:`orinkit.virtual.rc8.robot.speeds`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.accuracy import ALL_AXES, check_axis, length_of_pulses
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.variables import conversion

_SPEED_MODES: Final = (0, 1, 2, 3)
_SINGULAR_MODES: Final = {0: False, 2: True}


def _setting(name: str, least: int, most: int, given: Variant, caller: ClientContext) -> tuple[bool, list[float]]:
    """Return the switch at the start of a parameter, and the numbers after it.

    If the switch is on, ``least`` to ``most`` numbers are required.
    """
    require(name, caller.robot.arm, caller)
    elements = parameters.at_least(given, 1)
    on = conversion.double(elements[0]) != 0
    numbers = [conversion.double(each) for each in elements[1:]]
    if on and not least <= len(numbers) <= most:
        wanted = least if least == most else f"{least}..{most}"
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected the switch and {wanted} numbers, got {count} numbers", wanted=wanted, count=len(numbers)),
        )
    return on, numbers


def _positive(value: float) -> float:
    if not value > 0:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("the tolerance {value:g} is not above 0", value=value))
    return value


def _tolerance(value: float, mode: float) -> float:
    """Return a tolerance in deg or mm, given in this unit (mode 0) or in pulses (mode 1)."""
    return _positive(length_of_pulses(value) if parameters.flag(mode) else value)


def _crt_motion_allow(caller: ClientContext, parameter: Variant) -> None:
    on, numbers = _setting("CrtMotionAllow", 1, 2, parameter, caller)
    values = [_positive(value) for value in numbers] if on else []
    accuracy = caller.robot.arm.accuracy
    accuracy.position = values[0] if on else None
    accuracy.posture = values[1] if len(values) > 1 else None


def _enc_motion_allow(caller: ClientContext, parameter: Variant) -> None:
    on, numbers = _setting("EncMotionAllow", 1, 2, parameter, caller)
    caller.robot.arm.accuracy.encoder = _tolerance(numbers[0], *numbers[1:] or [0]) if on else None


def _enc_motion_allow_joint(caller: ClientContext, parameter: Variant) -> None:
    on, numbers = _setting("EncMotionAllowJnt", 2, 3, parameter, caller)
    if not numbers:
        raise error_for(hresult.E_INVALIDARG, tr("the number of the axis is missing"))
    arm, axis = caller.robot.arm, parameters.whole(numbers[0])
    if on:
        check_axis(arm.model, axis, arm.model.robot_axes + 1)
        arm.accuracy.extended[axis] = _tolerance(numbers[1], *numbers[2:] or [0])
    else:
        arm.accuracy.extended.pop(axis, None)


def _er_alw(caller: ClientContext, parameter: Variant) -> None:
    on, numbers = _setting("ErAlw", 2, 2, parameter, caller)
    if not numbers:
        raise error_for(hresult.E_INVALIDARG, tr("the number of the axis is missing"))
    arm, number = caller.robot.arm, parameters.whole(numbers[0])
    if on:
        arm.accuracy.deviation[check_axis(arm.model, number)] = _positive(numbers[1])
    elif number == ALL_AXES:
        arm.accuracy.deviation.clear()
    else:
        arm.accuracy.deviation.pop(check_axis(arm.model, number), None)


def _motion_timeout(caller: ClientContext, parameter: Variant) -> None:
    on, numbers = _setting("MotionTimeout", 1, 1, parameter, caller)
    if on:
        caller.robot.arm.accuracy.set_timeout(parameters.whole(numbers[0]))
    else:
        caller.robot.arm.accuracy.timeout = None


def _singular_avoid(caller: ClientContext, parameter: Variant) -> None:
    require("SingularAvoid", caller.robot.arm, caller)
    (mode,) = parameters.whole_numbers(parameter, None)
    if mode not in _SINGULAR_MODES:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is neither 0 (off) nor 2 (on)", mode=mode))
    caller.robot.arm.speeds.avoid_singular = _SINGULAR_MODES[mode]


def _speed_mode(caller: ClientContext, parameter: Variant) -> None:
    require("SpeedMode", caller.robot.arm, caller)
    (mode,) = parameters.whole_numbers(parameter, None)
    if mode not in _SPEED_MODES:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is not 0 (off), 1 (PTP), 2 (CP) or 3 (both)", mode=mode)
        )
    caller.robot.arm.speeds.mode = mode


def _current_speed_mode(caller: ClientContext, _: Variant) -> int:
    return caller.robot.arm.speeds.mode


def _non_stop_path(caller: ClientContext, _: Variant) -> None:
    """GenerateNonStopPath belongs to an option with a licence of its own, which a virtual controller does not have."""
    caller.require_write()
    raise error_for(hresult.OPTION_NOT_LICENSED, "GenerateNonStopPath")


ACCURACY_COMMANDS: Final[dict[str, Callable[[ClientContext, Variant], Any]]] = {
    "CrtMotionAllow": _crt_motion_allow,
    "EncMotionAllow": _enc_motion_allow,
    "EncMotionAllowJnt": _enc_motion_allow_joint,
    "ErAlw": _er_alw,
    "MotionTimeout": _motion_timeout,
    "SingularAvoid": _singular_avoid,
    "SpeedMode": _speed_mode,
    "GenerateNonStopPath": _non_stop_path,
}
"""The commands that check their conditions themselves, by name."""

ACCURACY_QUERIES: Final[dict[str, Callable[[ClientContext, Variant], Any]]] = {"CurSpeedMode": _current_speed_mode}
"""The commands that only read, by name."""
