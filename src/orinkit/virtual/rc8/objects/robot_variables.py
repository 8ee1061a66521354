"""The robot's system variables: a table of names, types and sources (RC8 provider guide, robot variables)."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from orinkit.cao.provider import Deferred, VariableObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import N_, Translate, tr
from orinkit.core.record import record
from orinkit.values.variant import ARRAY, Value, Variant, VarType, type_name
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects.motion_calls import switch_motor
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.robot import parameters, state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.hardware.areas import Area
from orinkit.virtual.rc8.robot.speeds import KEEP
from orinkit.virtual.rc8.variables import conversion

_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_TYPE_VERTICAL: Final = 0
_TYPE_SCARA: Final = 1  # an assumption of this project: the number is not published
_FRAME_VALUES: Final = 6
FRAME_NAMES: Final = ("Tool*", "Work*")
"""Names of the variables of tool and work frames; the number replaces the ``*``."""

Write: TypeAlias = "Callable[[ClientContext, Variant], Deferred[None] | None]"
"""Sets a variable for a client."""


@record
class RobotVariable:
    """A row of the table.

    Attributes that are not listed here have the same meaning as in
    :class:`~orinkit.virtual.rc8.objects.system_variables.SystemVariable`.

    Attributes:
        pose_type: Type of a pose, ``"P"``, ``"J"`` or ``"T"``; empty if the value is not a pose.
    """

    name: str
    vt: int
    read: Callable[[RC8Arm], Any]
    text: str
    write: Write | None = None
    pose_type: str = ""

    def help(self, say: Translate) -> str:
        """Return a description and the type, in the controller's language."""
        what = say(self.text)
        if self.pose_type:
            what = say("{pose}: {kind}", pose=what, kind=self.pose_type)
        return f"{what} ({type_name(self.vt)})"


def _servo(caller: ClientContext, given: Variant) -> Deferred[None]:
    return switch_motor(caller, conversion.boolean(given))


def _tool(caller: ClientContext, given: Variant) -> None:
    require("Change", caller.robot.arm, caller)
    tools = caller.robot.arm.space.tools
    tools.current = tools.check(conversion.whole(given))


def _work(caller: ClientContext, given: Variant) -> None:
    require("Change", caller.robot.arm, caller)
    works = caller.robot.arm.space.works
    works.current = works.check(conversion.whole(given))


def _external(caller: ClientContext, given: Variant) -> None:
    require("ExtSpeed", caller.robot.arm, caller)
    caller.robot.arm.speeds.set_external(conversion.double(given))


def _external_accel(caller: ClientContext, given: Variant) -> None:
    require("ExtSpeed", caller.robot.arm, caller)
    caller.robot.arm.speeds.set_external(KEEP, conversion.double(given), KEEP)


def _external_decel(caller: ClientContext, given: Variant) -> None:
    require("ExtSpeed", caller.robot.arm, caller)
    caller.robot.arm.speeds.set_external(KEEP, KEEP, conversion.double(given))


def _speed(*, joint_only: bool) -> Write:
    def write(caller: ClientContext, given: Variant) -> None:
        require("Speed", caller.robot.arm, caller)
        caller.robot.arm.speeds.set_internal(conversion.double(given), joint_only=joint_only)

    return write


def _accel(*, joint_only: bool) -> Write:
    def write(caller: ClientContext, given: Variant) -> None:
        require("Accelerate", caller.robot.arm, caller)
        caller.robot.arm.speeds.set_acceleration(conversion.double(given), KEEP, joint_only=joint_only)

    return write


def _decel(*, joint_only: bool) -> Write:
    def write(caller: ClientContext, given: Variant) -> None:
        require("Accelerate", caller.robot.arm, caller)
        caller.robot.arm.speeds.set_acceleration(KEEP, conversion.double(given), joint_only=joint_only)

    return write


def _poses(prefix: str, source: Callable[[RC8Arm], state_report.ArmPosition], text: str) -> tuple[RobotVariable, ...]:
    return (
        RobotVariable(f"@{prefix}_POSITION", _R8_ARRAY, lambda arm: source(arm).position(), text, pose_type="P"),
        RobotVariable(f"@{prefix}_ANGLE", _R8_ARRAY, lambda arm: source(arm).angles(), text, pose_type="J"),
        RobotVariable(f"@{prefix}_TRANS", _R8_ARRAY, lambda arm: source(arm).trans(), text, pose_type="T"),
    )


ROBOT_VARIABLES: Final[dict[str, RobotVariable]] = {
    entry.name: entry
    for entry in (
        *_poses("CURRENT", state_report.current, N_("Current pose")),
        *_poses("HIGH_CURRENT", state_report.current, N_("Current pose, latest value")),
        *_poses("DEST", state_report.destination, N_("Destination of the motion")),
        RobotVariable("@SERVO_ON", VarType.BOOL, lambda arm: arm.motor.on, N_("The motor is on"), _servo),
        RobotVariable("@BUSY_STATUS", VarType.BOOL, lambda arm: arm.busy, N_("A motion is in progress or paused")),
        RobotVariable("@TYPE", VarType.I4, lambda arm: _TYPE_SCARA if arm.model.is_scara else _TYPE_VERTICAL,
                      N_("Type of arm: 0 is a vertical arm with six axes, 1 a horizontal arm with four axes")),
        RobotVariable("@TYPE_NAME", VarType.BSTR, lambda arm: arm.model.type_name, N_("Name of the robot type")),
        RobotVariable("@CURRENT_TOOL", VarType.I4, lambda arm: arm.space.tools.current, N_("Current tool"), _tool),
        RobotVariable("@CURRENT_WORK", VarType.I4, lambda arm: arm.space.works.current, N_("Current work"), _work),
        RobotVariable("@SPEED", VarType.R4, lambda arm: arm.speeds.path.speed, N_("Internal speed [%]"),
                      _speed(joint_only=False)),
        RobotVariable("@ACCEL", VarType.R4, lambda arm: arm.speeds.path.accel, N_("Internal acceleration [%]"),
                      _accel(joint_only=False)),
        RobotVariable("@DECEL", VarType.R4, lambda arm: arm.speeds.path.decel, N_("Internal deceleration [%]"),
                      _decel(joint_only=False)),
        RobotVariable("@JSPEED", VarType.R4, lambda arm: arm.speeds.joint.speed, N_("Internal axis speed [%]"),
                      _speed(joint_only=True)),
        RobotVariable("@JACCEL", VarType.R4, lambda arm: arm.speeds.joint.accel, N_("Internal axis acceleration [%]"),
                      _accel(joint_only=True)),
        RobotVariable("@JDECEL", VarType.R4, lambda arm: arm.speeds.joint.decel, N_("Internal axis deceleration [%]"),
                      _decel(joint_only=True)),
        RobotVariable("@EXTSPEED", VarType.R4, lambda arm: arm.speeds.external.speed, N_("External speed [%]"), _external),
        RobotVariable("@EXTACCEL", VarType.R4, lambda arm: arm.speeds.external.accel, N_("External acceleration [%]"),
                      _external_accel),
        RobotVariable("@EXTDECEL", VarType.R4, lambda arm: arm.speeds.external.decel, N_("External deceleration [%]"),
                      _external_decel),
    )
}  # fmt: skip


class RobotVariableObject(VariableObject):
    """A system variable of the robot, for one client."""

    def __init__(self, caller: ClientContext, name: str, entry: RobotVariable) -> None:
        own = AccessRight.READ_WRITE if entry.write else AccessRight.READ
        super().__init__(name, attribute=int(own & caller.access), help=entry.help(caller.state.say))
        self._caller = caller
        self._entry = entry
        self._read = caller.state.calendar.now()

    def get_value(self) -> Value:
        """Return the current value, with its exact type."""
        self._caller.require_read()
        self._read = self._caller.state.calendar.now()
        return Variant(self._entry.vt, self._entry.read(self._caller.robot.arm))

    def put_value(self, value: Variant) -> Deferred[None] | None:
        """Set the value.

        Raises:
            CallError: NO_WRITE_RIGHT; E_CAO_NOT_WRITABLE; other codes if the value is invalid or the state of the robot
                does not allow the change.
        """
        self._caller.require_write()
        if self._entry.write is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)
        self._caller.require_not_slave()
        return self._entry.write(self._caller, value)

    def get_date_time(self) -> Value:
        """Return the time of the last read; before the first read, the time at which the object was created."""
        self._caller.require_read()
        return self._read

    def get_microsecond(self) -> int:
        """Return the microseconds of the time returned by :meth:`get_date_time`, 0 to 999999."""
        self._caller.require_read()
        return self._read.microsecond


def find_robot_variable(caller: ClientContext, name: str) -> VariableObject:
    """Return a variable of the robot by its name; case-insensitive.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND.
    """
    entry = ROBOT_VARIABLES.get(name.strip().upper()) or find_frame(name) or find_area(name)
    if entry is None:
        raise not_found(name)
    return RobotVariableObject(caller, name, entry)


_FRAME: Final = re.compile(r"\s*(TOOL|WORK)\[?([0-9]{1,4})\]?\s*", re.IGNORECASE | re.ASCII)


def find_frame(name: str) -> RobotVariable | None:
    """Return the variable of a tool or work frame, such as ``Tool1``; None for other names.

    Raises:
        CallError: TOOL_NUMBER_OUT_OF_RANGE, WORK_NUMBER_OUT_OF_RANGE when the variable is read or written.
    """
    found = _FRAME.fullmatch(name)
    if found is None:
        return None
    return _frame(int(found[2]), tool=found[1].upper() == "TOOL")


def _frame(number: int, *, tool: bool) -> RobotVariable:
    def write(caller: ClientContext, given: Variant) -> None:
        arm = caller.robot.arm
        require("SetToolDef" if tool else "SetWorkDef", arm, caller)
        elements = [conversion.double(each) for each in parameters.elements(given)]
        if not _FRAME_VALUES <= len(elements) <= _FRAME_VALUES + 1:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("got {count} values, expected {length}", count=len(elements), length=_FRAME_VALUES),
            )
        values = elements[:_FRAME_VALUES]
        if tool:  # a seventh element is the Fig of a P, which a tool does not have
            arm.space.tools.define(number, values)
        else:
            arm.space.works.define(number, values, parameters.whole(elements[-1]) if elements[_FRAME_VALUES:] else 0)

    def read(arm: RC8Arm) -> list[float]:
        works = arm.space.works
        return list(arm.space.tools.values(number)) if tool else [*works.values(number), float(works.attribute(number))]

    text = N_("Tool frame: X, Y, Z, RX, RY, RZ") if tool else N_("Work frame: X, Y, Z, RX, RY, RZ, attribute")
    return RobotVariable(f"{'TOOL' if tool else 'WORK'}{number}", _R8_ARRAY, read, text, write)


_AREA: Final = re.compile(r"\s*AREA\[?([0-9]{1,4})\]?\s*", re.IGNORECASE | re.ASCII)
AREA_NAME: Final = "Area*"
"""Name of the variables of areas; the number replaces the ``*``."""


def find_area(name: str) -> RobotVariable | None:
    """Return the variable of an area, such as ``Area1``; None for other names.

    Reading or writing it raises VALUE_OUT_OF_RANGE if the area does not exist.
    """
    found = _AREA.fullmatch(name)
    if found is None:
        return None
    number = int(found[1])

    def write(caller: ClientContext, given: Variant) -> None:
        hardware = caller.robot.arm.hardware
        require("SetAreaDef", caller.robot.arm, caller)
        elements = [conversion.double(each) for each in parameters.elements(given)]
        hardware.define_area(number, Area.of_elements(elements, hardware.areas.area(number)))

    return RobotVariable(
        f"AREA{number}", _R8_ARRAY, lambda arm: arm.hardware.areas.area(number).elements(),
        N_("Area: the 34 elements of GetAreaDef"), write,
    )  # fmt: skip


def robot_variable_names() -> list[str]:
    """Return the names of the robot's variables."""
    return [*ROBOT_VARIABLES, *FRAME_NAMES, AREA_NAME]
