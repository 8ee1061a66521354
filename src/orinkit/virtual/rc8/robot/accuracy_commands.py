"""The commands of Robot_Execute and of programs that set the accuracy of motions and the behaviour of the planner.

CrtMotionAllow, EncMotionAllow, EncMotionAllowJnt, ErAlw and MotionTimeout set :mod:`orinkit.virtual.rc8.robot.accuracy`;
SingularAvoid and SpeedMode set :mod:`orinkit.virtual.rc8.robot.speeds`.
"""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.accuracy import ALL_AXES, check_axis, check_extended_joint, length_of_pulses
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.shared_command import SharedCommand, truth
from orinkit.virtual.rc8.variables import conversion

_SPEED_MODES: Final = (0, 1, 2, 3)
_SINGULAR_MODES: Final = {0: False, 2: True}


def _setting(least: int, most: int, given: Variant) -> tuple[bool, list[float]]:
    """Return the switch at the start of a parameter, and the numbers after it.

    If the switch is on, ``least`` to ``most`` numbers are required.
    """
    elements = parameters.at_least(given, 1)
    on = truth(elements[0])
    numbers = [conversion.double(each) for each in elements[1:]]
    if on and not least <= len(numbers) <= most:
        wanted = least if least == most else f"{least}..{most}"
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected the switch and {wanted} numbers, got {count} numbers", wanted=wanted, count=len(numbers)),
        )
    return on, numbers


def _setting_of_axis(least: int, most: int, given: Variant) -> tuple[bool, int, list[float]]:
    """Return the switch, the number of the axis, and the numbers after it; see :func:`_setting`."""
    on, numbers = _setting(least, most, given)
    if not numbers:
        raise error_for(hresult.E_INVALIDARG, tr("the number of the axis is missing"))
    return on, parameters.whole(numbers[0]), numbers[1:]


def _positive(value: float) -> float:
    if not value > 0:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("the tolerance {value:g} is not above 0", value=value))
    return value


def _tolerance(value: float, mode: float) -> float:
    """Return a tolerance in deg or mm, given in this unit (mode 0) or in pulses (mode 1)."""
    return _positive(length_of_pulses(value) if parameters.flag(mode) else value)


def _crt_motion_allow(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("CrtMotionAllow", arm, operator)
    on, numbers = _setting(1, 2, parameter)
    values = [_positive(value) for value in numbers] if on else []
    accuracy = arm.accuracy
    accuracy.position = values[0] if on else None
    accuracy.posture = values[1] if len(values) > 1 else None


def _enc_motion_allow(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("EncMotionAllow", arm, operator)
    on, numbers = _setting(1, 2, parameter)
    arm.accuracy.encoder = _tolerance(numbers[0], *numbers[1:] or [0]) if on else None


def _enc_motion_allow_joint(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("EncMotionAllowJnt", arm, operator)
    on, axis, numbers = _setting_of_axis(2, 3, parameter)
    if on:
        arm.accuracy.extended[check_extended_joint(arm.model, axis)] = _tolerance(numbers[0], *numbers[1:] or [0])
    else:
        arm.accuracy.extended.pop(axis, None)


def _er_alw(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("ErAlw", arm, operator)
    on, number, numbers = _setting_of_axis(2, 2, parameter)
    if on:
        arm.accuracy.deviation[check_axis(arm.model, number)] = _positive(numbers[0])
    elif number == ALL_AXES:
        arm.accuracy.deviation.clear()
    else:
        arm.accuracy.deviation.pop(check_axis(arm.model, number), None)


def _motion_timeout(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("MotionTimeout", arm, operator)
    on, numbers = _setting(1, 1, parameter)
    if on:
        arm.accuracy.set_timeout(parameters.whole(numbers[0]))
    else:
        arm.accuracy.timeout = None


def _singular_avoid(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SingularAvoid", arm, operator)
    (mode,) = parameters.whole_numbers(parameter, None)
    if mode not in _SINGULAR_MODES:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is neither 0 (off) nor 2 (on)", mode=mode))
    arm.speeds.avoid_singular = _SINGULAR_MODES[mode]


def _speed_mode(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SpeedMode", arm, operator)
    (mode,) = parameters.whole_numbers(parameter, None)
    if mode not in _SPEED_MODES:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is not 0 (off), 1 (PTP), 2 (CP) or 3 (both)", mode=mode)
        )
    arm.speeds.mode = mode


ACCURACY_COMMANDS: Final = (
    SharedCommand("CrtMotionAllow", _crt_motion_allow, reads=False, in_slave=False),
    SharedCommand("EncMotionAllow", _enc_motion_allow, reads=False, in_slave=False),
    SharedCommand("EncMotionAllowJnt", _enc_motion_allow_joint, reads=False, in_slave=False),
    SharedCommand("ErAlw", _er_alw, reads=False, in_slave=False),
    SharedCommand("MotionTimeout", _motion_timeout, reads=False, in_slave=False),
    SharedCommand("SingularAvoid", _singular_avoid, reads=False, in_slave=False),
    SharedCommand("SpeedMode", _speed_mode, reads=False, in_slave=False),
    SharedCommand("CurSpeedMode", lambda arm, _, __: arm.speeds.mode),
)
