"""The robot's system variables: THE TABLE of names, types and sources (reference: RC8 provider, robot variables)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit import hresult
from orinkit.cao.provider import Later, VariableObject, not_found
from orinkit.errors import error_for
from orinkit.variant import ARRAY, Value, Variant, VarType, type_name
from orinkit.virtual.rc8 import conversion
from orinkit.virtual.rc8.caller import Caller
from orinkit.virtual.rc8.permission import Access
from orinkit.virtual.rc8.robot import report
from orinkit.virtual.rc8.robot.arm import Arm
from orinkit.virtual.rc8.robot.conditions import require

_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_TYPE_VERTICAL: Final = 0


@dataclass(frozen=True, slots=True)
class RobotVariable:
    """One entry, as :class:`~orinkit.virtual.rc8.system.SystemVariable`, of the arm."""

    name: str
    vt: int
    read: Callable[[Arm], Any]
    en: str
    ja: str
    write: Callable[[Caller, Variant], Later[None] | None] | None = None


def _servo(caller: Caller, given: Variant) -> Later[None]:
    on = conversion.boolean(given)
    require("Motor on" if on else "Motor off", caller.state.arm, caller)
    return caller.state.arm.switch_motor(on)


def _tool(caller: Caller, given: Variant) -> None:
    require("Change", caller.state.arm, caller)
    tools = caller.state.arm.space.tools
    tools.current = tools.check(conversion.whole(given))


def _work(caller: Caller, given: Variant) -> None:
    require("Change", caller.state.arm, caller)
    works = caller.state.arm.space.works
    works.current = works.check(conversion.whole(given))


def _external(caller: Caller, given: Variant) -> None:
    require("ExtSpeed", caller.state.arm, caller)
    caller.state.arm.speeds.set_external(conversion.double(given))


def _poses(prefix: str, source: Callable[[Arm], report.Source], en: str, ja: str) -> tuple[RobotVariable, ...]:
    return (
        RobotVariable(f"@{prefix}_POSITION", _R8_ARRAY, lambda arm: source(arm).position(), f"{en}: P", f"{ja}: P 型"),
        RobotVariable(f"@{prefix}_ANGLE", _R8_ARRAY, lambda arm: source(arm).angles(), f"{en}: J", f"{ja}: J 型"),
        RobotVariable(f"@{prefix}_TRANS", _R8_ARRAY, lambda arm: source(arm).trans(), f"{en}: T", f"{ja}: T 型"),
    )


ROBOT_VARIABLES: Final[dict[str, RobotVariable]] = {
    entry.name: entry
    for entry in (
        *_poses("CURRENT", report.current, "Present pose", "現在位置"),
        *_poses("HIGH_CURRENT", report.current, "Present pose, newest", "現在位置 (最新)"),
        *_poses("DEST", report.destination, "Pose where the motion ends", "目標位置"),
        RobotVariable("@SERVO_ON", VarType.BOOL, lambda arm: arm.motor.on, "The motor is on", "モータ ON", _servo),
        RobotVariable("@BUSY_STATUS", VarType.BOOL, lambda arm: arm.busy, "The robot moves", "動作中"),
        RobotVariable("@TYPE", VarType.I4, lambda _: _TYPE_VERTICAL, "0 vertical six-axis arm", "0 垂直 6 軸"),
        RobotVariable("@TYPE_NAME", VarType.BSTR, lambda arm: arm.model.type_name, "Type of the robot", "ロボットの型式"),
        RobotVariable("@CURRENT_TOOL", VarType.I4, lambda arm: arm.space.tools.current, "Tool in use", "現在のツール番号", _tool),
        RobotVariable("@CURRENT_WORK", VarType.I4, lambda arm: arm.space.works.current, "Work in use", "現在のワーク番号", _work),
        RobotVariable("@SPEED", VarType.R4, lambda arm: arm.speeds.path.speed, "Internal speed [%]", "内部速度 [%]"),
        RobotVariable("@ACCEL", VarType.R4, lambda arm: arm.speeds.path.accel, "Internal acceleration [%]", "内部加速度 [%]"),
        RobotVariable("@DECEL", VarType.R4, lambda arm: arm.speeds.path.decel, "Internal deceleration [%]", "内部減速度 [%]"),
        RobotVariable("@JSPEED", VarType.R4, lambda arm: arm.speeds.joint.speed, "Internal axis speed [%]", "内部軸速度 [%]"),
        RobotVariable("@JACCEL", VarType.R4, lambda arm: arm.speeds.joint.accel, "Internal axis acceleration [%]", "内部軸加速度 [%]"),
        RobotVariable("@JDECEL", VarType.R4, lambda arm: arm.speeds.joint.decel, "Internal axis deceleration [%]", "内部軸減速度 [%]"),
        RobotVariable("@EXTSPEED", VarType.R4, lambda arm: arm.speeds.external.speed, "External speed [%]", "外部速度 [%]", _external),
        RobotVariable("@EXTACCEL", VarType.R4, lambda arm: arm.speeds.external.accel, "External acceleration [%]", "外部加速度 [%]"),
        RobotVariable("@EXTDECEL", VarType.R4, lambda arm: arm.speeds.external.decel, "External deceleration [%]", "外部減速度 [%]"),
    )
}  # fmt: skip


class RobotSystem(VariableObject):
    """A system variable of the robot, held by a client."""

    def __init__(self, caller: Caller, name: str, entry: RobotVariable) -> None:
        own = Access.READ_WRITE if entry.write else Access.READ
        text = f"{caller.state.say(entry.en, entry.ja)} ({type_name(entry.vt)})"
        super().__init__(name, attribute=int(own & caller.access), help=text)
        self._caller = caller
        self._entry = entry
        self._read = caller.state.calendar.now()

    def get_value(self) -> Value:
        """The value at this moment, with its exact type."""
        self._caller.require_read()
        self._read = self._caller.state.calendar.now()
        return Variant(self._entry.vt, self._entry.read(self._caller.state.arm))

    def put_value(self, value: Variant) -> Later[None] | None:
        """Set the value.

        Raises:
            CallError: NO_WRITE_RIGHT; E_CAO_NOT_WRITABLE; the value, or the state of the robot, does not allow it.
        """
        self._caller.require_write()
        if self._entry.write is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)
        return self._entry.write(self._caller, value)

    def get_date_time(self) -> Value:
        """When the value was read last."""
        self._caller.require_read()
        return self._read

    def get_microsecond(self) -> int:
        """Microseconds of that time, 0 to 999999."""
        self._caller.require_read()
        return self._read.microsecond


def find_robot_variable(caller: Caller, name: str) -> VariableObject:
    """Return the robot's variable of that name, in upper or lower case.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND.
    """
    entry = ROBOT_VARIABLES.get(name.strip().upper())
    if entry is None:
        raise not_found(name)
    return RobotSystem(caller, name, entry)


def robot_variable_names() -> list[str]:
    """Return the names of the robot's variables."""
    return list(ROBOT_VARIABLES)
