"""Commands of force sensor and force control (RC8 provider guide, ForceCtrl to ForceChangeTable)."""

from __future__ import annotations

from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.hardware.force_control import require_speed
from orinkit.virtual.rc8.robot.hardware.force_parameters import ForceParameters
from orinkit.virtual.rc8.robot.hardware.force_waits import CONTINUE, END, ForceCondition
from orinkit.virtual.rc8.robot.shared_command import SharedCommand, is_given, numbers_of, r8, truth
from orinkit.virtual.rc8.variables import conversion

_RESET: Final = -1
_SENSOR, _PULSES, _SENSED = 0, 1, 13
# item: quantity (0 force, 1 travel by command, 2 by encoder, 3 deviation), and True or False for its peaks
_ITEMS: Final = {
    2: (0, True), 3: (0, False), 4: (1, None), 5: (1, True), 6: (1, False), 7: (2, None), 8: (2, True), 9: (2, False),
    10: (3, None), 11: (3, True), 12: (3, False),
}  # fmt: skip
# position of a parameter of ForceParam, its name, and its number of elements (0: a number, -1: a whole number)
_PARAMETERS: Final = (
    "coordinates", "force", "position_deviation", "spring", "damping", "mass", "current_limit", "offset",
    "axis_deviation", "mode", "rate", "translation", "rotation",
)  # fmt: skip
_OF_JOINTS: Final = ("current_limit", "axis_deviation")
_WHOLE: Final = ("coordinates", "mode")
_SINGLE: Final = ("translation", "rotation")


def _force_control(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    """ForceCtrl: switch force control on with a parameter table, or off; without power, it has no effect.

    Raises:
        CallError: FORCE_CONTROL_TOO_FAST if a motion that runs, is paused or is queued is too fast for force control. A
            motion that is still being planned is checked when it is queued.
    """
    given = parameters.at_least(parameter, 1)
    require("ForceCtrl", arm, operator)
    if not truth(given[0]):
        arm.hardware.force.switch_off()
        return
    number = conversion.whole(parameters.at_least(parameter, 2)[1])
    mode = conversion.whole(given[2]) if is_given(given, 2) else None
    arm.hardware.force.tables.table(number)
    if arm.motor.on:
        require_speed(ticket.motion for ticket in arm.queue.tickets)
        arm.hardware.force.switch_on(number, mode)
        arm.hardware.wake()


def _force_parameters(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("ForceParam", arm, operator)
    given = parameters.at_least(parameter, 3)
    number = conversion.whole(given[0])
    if len(given) > 1 + len(_PARAMETERS):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("got {given} parameters, expected {wanted}", given=len(given), wanted=f"3..{1 + len(_PARAMETERS)}"),
        )
    values: dict[str, Any] = {}
    for index, name in enumerate(_PARAMETERS, start=1):
        if is_given(given, index):
            values[name] = _parameter(arm, name, given[index])
    arm.hardware.force.tables.set_table(number, ForceParameters(**values))


def _parameter(arm: RC8Arm, name: str, given: Variant) -> Any:
    if name in _WHOLE:
        return conversion.whole(given)
    if name in _SINGLE:
        return conversion.double(given)
    return numbers_of(arm, given, 6, "J" if name in _OF_JOINTS else "P")


def _change_table(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("ForceChangeTable", arm, operator)
    arm.hardware.force.change_table(*parameters.whole_numbers(parameter, None))


def _force_value(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    item, mode = parameters.whole_numbers(parameter, None, 0)
    force = arm.hardware.force
    if mode not in (0, _RESET):
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is neither 0 nor -1", mode=mode))
    if item == _SENSOR:
        return r8(force.force())
    if item == _PULSES:
        return r8(force.pulses())
    if item == _SENSED:
        return r8(force.sensed())
    if item not in _ITEMS:
        raise error_for(
            hresult.E_INVALIDARG, tr("item {item} does not exist; items: {items}", item=item, items="0 .. 13")
        )
    quantity, positive = _ITEMS[item]
    if positive is None:
        return r8(force.value(quantity))
    return r8(force.peak(quantity, positive=positive, reset=mode == _RESET))


def _force_sensor(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("ForceSensor", arm, operator)
    (function,) = parameters.whole_numbers(parameter, None)
    if function != 0:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE, tr("function {function} does not exist. Try: 0 (reset)", function=function)
        )
    arm.hardware.force.reset_sensor()


def _wait_condition(arm: RC8Arm, operator: Operator, parameter: Variant) -> Deferred[None]:
    require("ForceWaitCondition", arm, operator)
    given = parameters.elements(parameter)
    condition = ForceCondition(
        _least(arm, given, 0),
        _least(arm, given, 1),
        conversion.double(given[2]) if is_given(given, 2) else -1.0,
        conversion.whole(given[3]) if is_given(given, 3) else CONTINUE,
        conversion.double(given[4]) if is_given(given, 4) else -1.0,
    )
    if not CONTINUE <= condition.mode <= END:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("mode {mode} is not 0, 1 or 2", mode=condition.mode))
    done = arm.hardware.waits.add(operator, condition, arm.seconds())
    arm.hardware.wake()
    return done


def _least(arm: RC8Arm, given: list[Variant], index: int) -> tuple[float, ...]:
    """Return six least values; -1 alone, or nothing, means that none is looked at."""
    if not is_given(given, index) or given[index].value == -1:
        return (-1.0,) * 6
    return numbers_of(arm, given[index], 6)


FORCE_COMMANDS: Final = (
    SharedCommand("ForceCtrl", _force_control, reads=False, in_slave=False),
    SharedCommand("ForceParam", _force_parameters, reads=False, in_slave=False),
    SharedCommand("ForceChangeTable", _change_table, reads=False, in_slave=False),
    SharedCommand("ForceValue", _force_value),
    SharedCommand("ForceSensor", _force_sensor, reads=False, in_slave=False),
    SharedCommand("ForceWaitCondition", _wait_condition, reads=False, in_slave=False),
)
