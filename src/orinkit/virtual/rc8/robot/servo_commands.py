"""Commands about motors and loads: servo data, payload, gravity, current limits, accuracy, information."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.dynamics import Payload
from orinkit.virtual.engine.servo import ACCURATE_LAG, LAG
from orinkit.virtual.rc8.robot import parameters, state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.hardware.contact import Matrix
from orinkit.virtual.rc8.robot.shared_command import SharedCommand, is_given, numbers_of, r8, truth
from orinkit.virtual.rc8.variables import conversion

_LARGEST_MASS: Final = 1e6  # g
_FARTHEST: Final = 1e5  # mm, kg cm^2
_GRAMS: Final = 1000.0
_TYPE, _NAME, _WAY = 0, 1, 2
TYPE_VERTICAL: Final = 0

# --- servo data -------------------------------------------------------------------------------------------------------

_OF_AXES: Final[Mapping[int, Callable[[RC8Arm], Sequence[float]]]] = {
    1: lambda arm: arm.servo.motor_speed(),
    2: lambda arm: arm.servo.deviation(arm.motor.on),
    4: lambda arm: [abs(load) for load in arm.servo.torque_command(arm.motor.on)],
    5: lambda arm: arm.servo.torque_command(arm.motor.on),
    7: lambda arm: arm.servo.load_factor(arm.motor.on),
    8: lambda arm: arm.servo.command,
}
_JOINT_ITEMS: Final = (1, 2, 4, 5, 8)


def _tip_speed(arm: RC8Arm) -> Matrix:
    now, velocity = arm.servo.encoder, arm.servo.velocity()
    before = tuple(joint - rate * PERIOD for joint, rate in zip(now, velocity, strict=True))
    return np.asarray((arm.space.tcp(now)[:3, 3] - arm.space.tcp(before)[:3, 3]) / PERIOD)


def _tip_deviation(arm: RC8Arm) -> Matrix:
    return np.asarray(arm.space.tcp(arm.servo.command)[:3, 3] - arm.space.tcp(arm.servo.encoder)[:3, 3])


def _in_work(read: Callable[[RC8Arm], Matrix]) -> Callable[[RC8Arm], Matrix]:
    return lambda arm: np.asarray(arm.space.works.matrix()[:3, :3].T @ read(arm))


def _in_tool(read: Callable[[RC8Arm], Matrix]) -> Callable[[RC8Arm], Matrix]:
    return lambda arm: np.asarray(arm.space.tcp(arm.servo.encoder)[:3, :3].T @ read(arm))


_OF_TIP: Final[Mapping[int, Callable[[RC8Arm], Matrix]]] = {
    17: _in_work(_tip_speed),
    18: _in_work(_tip_deviation),
    19: _in_tool(_tip_speed),
    20: _in_tool(_tip_deviation),
}


def _servo_data(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    """GetSrvData: return an item for the eight axes, or the X, Y, Z of an item of the tool tip and four zeros."""
    (item,) = parameters.whole_numbers(parameter, None)
    if item in _OF_AXES:
        return r8(state_report.eight(tuple(_OF_AXES[item](arm))))
    if item in _OF_TIP:
        return r8([*_OF_TIP[item](arm).tolist(), 0.0, 0.0, 0.0, 0.0])
    raise _no_item(item, (*_OF_AXES, *_OF_TIP))


def _servo_data_of_axis(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    """GetSrvJntData: return an item for one axis."""
    item, axis = parameters.whole_numbers(parameter, None, None)
    if item not in _JOINT_ITEMS:
        raise _no_item(item, _JOINT_ITEMS)
    return Variant(VarType.R4, float(_OF_AXES[item](arm)[_axis(arm, axis)]))


def _no_item(item: int, items: Sequence[int]) -> Exception:
    return error_for(
        hresult.E_INVALIDARG,
        tr("item {item} does not exist; items: {items}", item=item, items=", ".join(map(str, items))),
    )


def _axis(arm: RC8Arm, axis: int, last: int | None = None) -> int:
    """Return the index of an axis after checking its number."""
    count = len(arm.model.axes) if last is None else last
    if not 1 <= axis <= count:
        raise error_for(
            hresult.E_INVALIDARG, tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=axis, count=count)
        )
    return axis - 1


# --- payload, gravity, currents ---------------------------------------------------------------------------------------


def _read_payload(arm: RC8Arm, parameter: Variant) -> Payload:
    given = parameters.at_least(parameter, 1)
    mass = conversion.double(given[0])
    centre, inertia = (
        numbers_of(arm, given[index], 3, "V") if is_given(given, index) else (0.0, 0.0, 0.0) for index in (1, 2)
    )
    if not 0 <= mass <= _LARGEST_MASS or not all(abs(value) <= _FARTHEST for value in (*centre, *inertia)):
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("mass, centre or inertia of the load is out of range"))
    return Payload(mass / _GRAMS, (centre[0], centre[1], centre[2]), (inertia[0], inertia[1], inertia[2]))


def _payload_value(payload: Payload) -> Variant:
    return Variant(
        VARIANT_ARRAY, [Variant(VarType.I4, round(payload.mass * _GRAMS)), r8(payload.centre), r8(payload.inertia)]
    )


def _is_on(parameter: Variant) -> bool:
    """Return False for 0, True for any other number."""
    return bool(parameters.numbers(parameter, None)[0])


def _set_payload(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("PayLoad", arm, operator)
    arm.servo.loads.dynamics.payload = _read_payload(arm, parameter)


def _set_sensor_payload(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("ForceSensorPayLoad", arm, operator)
    arm.hardware.force.sensor_payload = _read_payload(arm, parameter)


def _gravity_control(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("GrvCtrl", arm, operator)
    arm.servo.loads.gravity_control = _is_on(parameter)


def _gravity_offset(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("GrvOffset", arm, operator)
    loads = arm.servo.loads
    on = _is_on(parameter)
    loads.offsets = None
    if on:
        loads.offsets = arm.servo.torque_command(arm.motor.on)


def _current_limit(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("CurLmt", arm, operator)
    given = parameters.at_least(parameter, 2)
    axis = conversion.whole(given[1])
    limits = arm.servo.loads.limits
    if not truth(given[0]):
        if axis == 0:
            limits.clear()
        else:
            limits.pop(_axis(arm, axis, arm.model.robot_axes), None)
        return
    index = _axis(arm, axis, arm.model.robot_axes)
    percent = conversion.double(parameters.at_least(parameter, 3)[2])
    if not 1.0 <= percent <= 100.0:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("a current limit is 1 to 100 %, not {value:g}", value=percent))
    limits[index] = percent
    arm.hardware.wake()


def _z_force(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    """Zforce: limit the thrust of a linear third axis, N."""
    require("Zforce", arm, operator)
    (thrust,) = parameters.numbers(parameter, None)
    if not arm.model.axes[2].linear:
        raise error_for(
            hresult.E_INVALIDARG, tr("the third axis of {name} is not linear", name=arm.model.name)
        )  # fmt: skip
    percent = 100.0 * thrust / arm.servo.loads.dynamics.rated[2]
    if not 1.0 <= percent <= 100.0:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("a thrust of {value:g} N is out of range", value=thrust))
    arm.servo.loads.limits[2] = percent
    arm.hardware.wake()


def _path_accuracy(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("HighPathAccuracy", arm, operator)
    arm.servo.lag = ACCURATE_LAG if _is_on(parameter) else LAG


# --- information ------------------------------------------------------------------------------------------------------


def _robot_info(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    (item,) = parameters.whole_numbers(parameter, None)
    if item == _TYPE:
        return Variant(VarType.I4, TYPE_VERTICAL)
    if item == _NAME:
        return Variant(VarType.BSTR, arm.model.type_name)
    if item == _WAY:
        return r8(state_report.eight(tuple(arm.servo.travelled)))
    raise _no_item(item, (_TYPE, _NAME, _WAY))


SERVO_COMMANDS: Final = (
    SharedCommand("GetSrvData", _servo_data),
    SharedCommand("GetSrvJntData", _servo_data_of_axis),
    SharedCommand("PayLoad", _set_payload, reads=False, in_slave=False),
    SharedCommand("CurPayLoad", lambda arm, _, __: _payload_value(arm.servo.loads.dynamics.payload)),
    SharedCommand("ForceSensorPayLoad", _set_sensor_payload, reads=False, in_slave=False),
    SharedCommand("CurForceSensorPayLoad", lambda arm, _, __: _payload_value(arm.hardware.force.sensor_payload)),
    SharedCommand("GrvCtrl", _gravity_control, reads=False, in_slave=False),
    SharedCommand("GrvOffset", _gravity_offset, reads=False, in_slave=False),
    SharedCommand("CurLmt", _current_limit, reads=False, in_slave=False),
    SharedCommand("Zforce", _z_force, reads=False, in_slave=False),
    SharedCommand("HighPathAccuracy", _path_accuracy, reads=False, in_slave=False),
    SharedCommand("RobInfo", _robot_info),
)
