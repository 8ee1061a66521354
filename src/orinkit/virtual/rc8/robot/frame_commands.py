"""Commands about frames and areas: tools, works, base, areas, virtual fences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.hardware.areas import ELEMENTS, Area
from orinkit.virtual.rc8.robot.shared_command import SharedCommand, is_given, numbers_of, r8, truth
from orinkit.virtual.rc8.robot.target import NO_FRAME, figure_of
from orinkit.virtual.rc8.robot.tools import STANDARD
from orinkit.virtual.rc8.variables import conversion

# --- tools, works, base -----------------------------------------------------------------------------------------------


def _pose(arm: RC8Arm, given: Variant) -> tuple[float, ...]:
    """Return the six numbers of a pose of type P; Fig is ignored."""
    target = parameters.position(parameters.pose(given))
    kind, values = arm.space.resolve(target, arm.servo.command)
    if kind != "P":
        raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("a pose of type P is required"))
    return tuple(values[:6])


def _set_tool(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SetToolDef", arm, operator)
    given = parameters.at_least(parameter, 2)
    arm.space.tools.define(conversion.whole(given[0]), _pose(arm, given[1]))


def _set_work(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SetWorkDef", arm, operator)
    given = parameters.at_least(parameter, 2)
    attribute = conversion.whole(given[2]) if is_given(given, 2) else STANDARD
    arm.space.works.define(conversion.whole(given[0]), _pose(arm, given[1]), attribute)


def _set_base(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SetBaseDef", arm, operator)
    given = parameters.at_least(parameter, 2)
    attribute = conversion.whole(given[2]) if is_given(given, 2) else STANDARD
    arm.space.define_base(conversion.whole(given[0]), _pose(arm, given[1]), attribute)


def _tool(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    return r8(arm.space.tools.values(*parameters.whole_numbers(parameter, None)))


def _work(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    (number,) = parameters.whole_numbers(parameter, None)
    return r8([*arm.space.works.values(number), float(arm.space.works.attribute(arm.space.works.check(number)))])


def _base(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    (number,) = parameters.whole_numbers(parameter, None)
    return r8([*arm.space.bases.values(number), float(arm.space.bases.attribute(arm.space.bases.check(number)))])


def _work_attribute(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    works = arm.space.works
    return Variant(VarType.I4, works.attribute(works.check(*parameters.whole_numbers(parameter, None))))


def _convert_work(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    """ConvertPosWork: convert a position in one work frame to the same place in another work frame."""
    given = parameters.at_least(parameter, 3)
    kind, values = arm.space.resolve(parameters.position(parameters.pose(given[0])), arm.servo.command)
    if kind == "J":
        raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("a pose of type P is required"))
    works = arm.space.works
    first, second = (works.check(conversion.whole(each)) for each in given[1:3])
    frame = works.matrix(first) @ arm.space.frame_in_base(kind, values, NO_FRAME)
    moved = frames.inverse_of(works.matrix(second)) @ frame
    return r8([*frames.position_of_matrix(moved).tolist(), float(figure_of(kind, values))])


# --- areas ------------------------------------------------------------------------------------------------------------


def _set_area_definition(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    """SetAreaDef: area, centre, size, I/O, variable and detection; or area and an array of 11 to 34 numbers."""
    require("SetAreaDef", arm, operator)
    given = parameters.at_least(parameter, 2)
    number = conversion.whole(given[0])
    before = arm.hardware.areas.area(number)
    if len(given) == 2:
        elements = [conversion.double(each) for each in parameters.elements(given[1])]
    else:
        given = parameters.at_least(parameter, 5)
        elements = [*_pose(arm, given[1]), *numbers_of(arm, given[2], 3, "V"), *map(conversion.double, given[3:5])]
        elements += [conversion.double(given[5])] if is_given(given, 5) else []
    arm.hardware.define_area(number, Area.of_elements(elements, before))


def _area_definition(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    elements = arm.hardware.areas.area(*parameters.whole_numbers(parameter, None)).elements()
    assert len(elements) == ELEMENTS
    return r8(elements)


def _switch_area(name: str, on: bool) -> Callable[[RC8Arm, Operator, Variant], None]:
    def run(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
        require(name, arm, operator)
        (number,) = parameters.whole_numbers(parameter, None)
        _enable(arm, number, on)

    return run


def _set_area_enabled(arm: RC8Arm, operator: Operator, parameter: Variant) -> None:
    require("SetAreaEnabled", arm, operator)
    given = parameters.at_least(parameter, 2)
    _enable(arm, conversion.whole(given[0]), truth(given[1]))


def _enable(arm: RC8Arm, number: int, on: bool) -> None:
    arm.hardware.define_area(number, replace(arm.hardware.areas.area(number), enabled=on))


def _area_size(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    return r8(arm.hardware.areas.area(*parameters.whole_numbers(parameter, None)).box.size)


def _area_enabled(arm: RC8Arm, _: Operator, parameter: Variant) -> bool:
    return arm.hardware.areas.area(*parameters.whole_numbers(parameter, None)).enabled


def _check_fence(arm: RC8Arm, _: Operator, parameter: Variant) -> Variant:
    """CheckVirtualFence: return 0 if the tool is within all fences at a pose, otherwise the number of a fence."""
    kind, values = arm.space.resolve(parameters.pose(_untyped(parameter)), arm.servo.command)
    if kind == "J":
        tip = arm.space.tcp((*values[: len(arm.model.axes)], *arm.servo.command[len(values) :]))
    else:
        tip = arm.space.frame_in_base(kind, values)
    return Variant(VarType.I4, arm.hardware.fences.crossed_by(np.asarray(tip)))


def _untyped(parameter: Variant) -> Variant:
    """Return the only element of an array, which clients send as the list of arguments."""
    if parameter.type == VARIANT_ARRAY and len(parameter.value) == 1:
        return parameters.elements(parameter)[0]
    if parameter.type == VarType.BSTR | ARRAY and len(parameter.value) == 1:
        return Variant(VarType.BSTR, parameter.value[0])
    return parameter


FRAME_COMMANDS: Final = (
    SharedCommand("CurTool", lambda arm, _, __: Variant(VarType.I4, arm.space.tools.current)),
    SharedCommand("CurWork", lambda arm, _, __: Variant(VarType.I4, arm.space.works.current)),
    SharedCommand("SetToolDef", _set_tool, reads=False, in_slave=False),
    SharedCommand("GetToolDef", _tool),
    SharedCommand("SetWorkDef", _set_work, reads=False, in_slave=False),
    SharedCommand("GetWorkDef", _work),
    SharedCommand("WorkAttribute", _work_attribute),
    SharedCommand("SetBaseDef", _set_base, reads=False),
    SharedCommand("GetBaseDef", _base),
    SharedCommand("ConvertPosWork", _convert_work),
    SharedCommand("SetAreaDef", _set_area_definition, reads=False, in_slave=False),
    SharedCommand("GetAreaDef", _area_definition),
    SharedCommand("SetArea", _switch_area("SetArea", on=True), reads=False, in_slave=False),
    SharedCommand("ResetArea", _switch_area("ResetArea", on=False), reads=False, in_slave=False),
    SharedCommand("AreaSize", _area_size),
    SharedCommand("GetAreaEnabled", _area_enabled),
    SharedCommand("SetAreaEnabled", _set_area_enabled, reads=False, in_slave=False),
    SharedCommand("CheckVirtualFence", _check_fence),
)
