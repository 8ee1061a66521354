"""The table of the functions that command the robot, and of the conditions under which the controller executes them.

The conditions of each function are in the order of the checks; the first violated condition determines the error
code. ``docs/howto/robot.md`` has a table of the resulting codes, and a test compares it with the table of this module.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Final, TypeAlias

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.speeds import FULL
from orinkit.virtual.rc8.switches import ModeSwitch

_FORCE_SPEED: Final = 50.0  # %


class Condition(Enum):
    """A condition under which the controller executes a function."""

    WRITE = "right to write"
    TOKEN = "executable token"  # noqa: S105 - the right to start, not a secret
    AUTO = "automatic mode"
    ENABLED = "auto enable"
    NO_EMERGENCY = "no emergency stop"
    NO_PROTECTIVE = "no protective stop"
    NO_ERROR = "no error"
    FREE = "arm not taken by another"
    ARM = "arm taken"
    ARM_IF_STRICT = "arm taken (strict controller)"
    RESUMER = "arm taken, or held by a program"
    MOTOR = "motor on"
    STAYS_ON = "motor not about to be switched off"
    NOT_HELD = "not held"
    OWN_NOT_HELD = "own motion not held"
    STILL = "standing still"
    STILL_SPEED = "standing still (speeds)"
    STILL_FRAME = "standing still (tool, work)"
    NOT_AWAITED = "no call waits for a motion"
    SLOW = "at most half speed while force control is on"
    CALIBRATED = "reference positions of the encoders known"
    LICENCE = "licence of the slave function"
    NOT_SLAVE = "slave mode off"
    NOT_SLAVE_ELSEWHERE = "slave mode off, or of this client"
    SLAVE = "slave mode on"


Check: TypeAlias = Callable[[RC8Arm, Operator], int]


def _mode(arm: RC8Arm, _: Operator) -> int:
    return 0 if arm.switches.mode is ModeSwitch.AUTOMATIC else hresult.AUTO_MODE_REQUIRED


def _free(arm: RC8Arm, operator: Operator) -> int:
    if arm.holder is None or arm.holder is operator:
        return 0
    if arm.holder.program:
        return hresult.ARM_TAKEN_BY_PACSCRIPT
    return hresult.ARM_GROUP_TAKEN if operator.program else hresult.ARM_NOT_TAKEN


def _arm(arm: RC8Arm, operator: Operator) -> int:
    return 0 if arm.holder is operator else hresult.ARM_NOT_TAKEN


def _arm_if_strict(arm: RC8Arm, operator: Operator) -> int:
    return _arm(arm, operator) if arm.switches.strict else 0


def _own_not_held(arm: RC8Arm, operator: Operator) -> int:
    return hresult.ROBOT_PAUSED if arm.holder is operator and arm.held and arm.busy else 0


def _not_awaited(arm: RC8Arm, _: Operator) -> int:
    """Return 0 if the motor may be switched off at the end of the motions.

    The motions must have been commanded by calls that are complete, with NEXT or at a pass mark. A paused motion may
    never end.
    """
    awaited = arm.held or arm.awaited or arm.holder is None
    return hresult.MOTOR_OFF_WHILE_MOVING if arm.busy and awaited else 0


def _resumer(arm: RC8Arm, operator: Operator) -> int:
    """Return 0 if the operator may resume the arm, otherwise the error code.

    A program that was paused while it held the arm cannot resume by itself, so any client may resume the arm.
    """
    return 0 if arm.holder is not None and arm.holder.program else _arm(arm, operator)


def _still(code: int) -> Check:
    def check(arm: RC8Arm, _: Operator) -> int:
        return code if arm.busy else 0

    return check


def _standing(arm: RC8Arm, _: Operator) -> int:
    if arm.held and arm.busy:
        return hresult.ROBOT_PAUSED
    return hresult.ROBOT_MOVING if arm.busy else 0


def _not_slave_elsewhere(arm: RC8Arm, operator: Operator) -> int:
    return hresult.REFUSED_IN_SLAVE_MODE if arm.slave.on and arm.slave.owner is not operator else 0


def _slow(arm: RC8Arm, _: Operator) -> int:
    """Return 0 unless a motion would be too fast for force control: more than 50 % of internal x external speed."""
    if not arm.hardware.force.on:
        return 0
    speeds = arm.speeds
    fastest = max(speeds.path.speed, speeds.joint.speed) * speeds.external.speed / FULL
    return hresult.FORCE_CONTROL_TOO_FAST if fastest > _FORCE_SPEED else 0


_CHECKS: Final[dict[Condition, Check]] = {
    Condition.WRITE: lambda _, operator: operator.write_refusal(),
    Condition.TOKEN: lambda arm, operator: operator.token_refusal(arm.switches),
    Condition.AUTO: _mode,
    Condition.ENABLED: lambda arm, _: 0 if arm.switches.auto_enable else hresult.AUTO_ENABLE_REQUIRED,
    Condition.NO_EMERGENCY: lambda arm, _: hresult.EMERGENCY_STOP_ON if arm.switches.emergency_stop else 0,
    Condition.NO_PROTECTIVE: lambda arm, _: hresult.PROTECTIVE_STOP_ON if arm.switches.protective_stop else 0,
    Condition.NO_ERROR: lambda arm, _: hresult.ERROR_PRESENT if arm.faults.code else 0,
    Condition.FREE: _free,
    Condition.ARM: _arm,
    Condition.ARM_IF_STRICT: _arm_if_strict,
    Condition.RESUMER: _resumer,
    Condition.MOTOR: lambda arm, _: 0 if arm.motor.on else hresult.MOTOR_NOT_ON,
    Condition.STAYS_ON: lambda arm, _: hresult.MOTOR_NOT_ON if arm.powering_off else 0,
    Condition.NOT_HELD: lambda arm, _: hresult.ROBOT_PAUSED if arm.held else 0,
    Condition.OWN_NOT_HELD: _own_not_held,
    Condition.STILL: _standing,
    Condition.STILL_SPEED: _still(hresult.SPEED_CHANGE_WHILE_MOVING),
    Condition.STILL_FRAME: _still(hresult.TOOL_WORK_CHANGE_WHILE_MOVING),
    Condition.NOT_AWAITED: _not_awaited,
    Condition.SLOW: _slow,
    Condition.CALIBRATED: lambda arm, _: 0 if arm.hardware.calibrated else hresult.ENCODER_REFERENCE_LOST,
    Condition.LICENCE: lambda arm, _: 0 if arm.switches.slave_licence else hresult.LICENSE_NOT_REGISTERED,
    Condition.NOT_SLAVE: lambda arm, _: hresult.REFUSED_IN_SLAVE_MODE if arm.slave.on else 0,
    Condition.NOT_SLAVE_ELSEWHERE: _not_slave_elsewhere,
    Condition.SLAVE: lambda arm, _: 0 if arm.slave.taking else hresult.SLAVE_MODE_OFF,
}

C = Condition
_READY: Final = (C.TOKEN, C.AUTO, C.ENABLED, C.NO_EMERGENCY, C.NO_PROTECTIVE, C.NO_ERROR)
_SET: Final = (C.WRITE, C.NOT_SLAVE)
_START: Final = (*_SET, *_READY)
_MOTION: Final = (*_START, C.ARM, C.MOTOR, C.STAYS_ON, C.NOT_HELD, C.SLOW)

NEEDS: Final[dict[str, tuple[Condition, ...]]] = {
    "TakeArm": (*_SET, C.TOKEN, C.AUTO, C.FREE, C.STILL),
    "GiveArm": (C.WRITE, C.ARM_IF_STRICT, C.OWN_NOT_HELD),
    "Motor on": (*_START, C.FREE, C.CALIBRATED),
    "Motor off": (*_SET, C.FREE, C.NOT_AWAITED),
    "Move": _MOTION,
    "Approach": _MOTION,
    "Depart": _MOTION,
    "Draw": _MOTION,
    "DriveEx": _MOTION,
    "DriveAEx": _MOTION,
    "Rotate": _MOTION,
    "RotateH": _MOTION,
    "ArchMove": _MOTION,
    "GoHome": _MOTION,
    "Halt": (C.WRITE,),
    "Hold": _SET,
    "Unhold": (*_START, C.RESUMER, C.MOTOR),
    "SyncTimeStart": (*_SET, C.ARM),
    "SyncTimeEnd": _SET,
    "SyncMoveStart": _MOTION,
    "SyncMoveEnd": _SET,
    "Arrive": (*_SET, C.ARM, C.NOT_HELD),
    "MotionSkip": (*_SET, C.ARM),
    "CrtMotionAllow": (*_SET, C.ARM),
    "EncMotionAllow": (*_SET, C.ARM),
    "EncMotionAllowJnt": (*_SET, C.ARM),
    "ErAlw": (*_SET, C.ARM),
    "MotionTimeout": (*_SET, C.ARM),
    "SingularAvoid": (*_SET, C.ARM),
    "SpeedMode": (*_SET, C.ARM),
    "Speed": (*_SET, C.ARM, C.STILL_SPEED),
    "Accelerate": (*_SET, C.ARM, C.STILL_SPEED),
    "ExtSpeed": (*_SET, C.FREE),
    "Change": (*_SET, C.ARM, C.STILL_FRAME),
    "SetToolDef": (*_SET, C.ARM, C.STILL_FRAME),
    "SetWorkDef": (*_SET, C.ARM, C.STILL_FRAME),
    "SetBaseDef": (*_SET, C.ARM, C.STILL_FRAME),
    "ChangeScene": (*_SET, C.ARM, C.STILL_FRAME),
    "SetAreaDef": _SET,
    "SetArea": _SET,
    "ResetArea": _SET,
    "SetAreaEnabled": _SET,
    "PayLoad": (*_SET, C.FREE),
    "ForceSensorPayLoad": (*_SET, C.FREE),
    "GrvCtrl": (*_SET, C.FREE),
    "GrvOffset": (*_SET, C.FREE),
    "CurLmt": (*_SET, C.FREE),
    "Zforce": (*_SET, C.FREE),
    "HighPathAccuracy": (*_SET, C.FREE, C.STILL),
    "ForceCtrl": (*_SET, C.ARM),
    "ForceChangeTable": (*_SET, C.ARM),
    "ForceParam": _SET,
    "ForceSensor": _SET,
    "ForceWaitCondition": (C.WRITE,),
    "AutoCal": (*_SET, C.TOKEN, C.NO_EMERGENCY, C.NO_PROTECTIVE, C.FREE, C.STILL),
    "slvChangeMode on": (*_SET, C.LICENCE, *_READY, C.ARM, C.MOTOR, C.NOT_HELD, C.STILL),
    "slvChangeMode off": (C.WRITE, C.NOT_SLAVE_ELSEWHERE),
    "slvMove": (C.WRITE, C.SLAVE, C.ARM),
    "slvSendFormat": _SET,
    "slvRecvFormat": _SET,
    "Task_Start": _START,
    "Task_Stop": (C.WRITE,),
    "RunAllTsr": (C.WRITE, C.TOKEN),
}
"""The conditions of every function that commands the robot, by the name of the function."""


def refusal(name: str, arm: RC8Arm, operator: Operator) -> int:
    """Return the code with which a function is refused at present, or 0 if it is allowed."""
    for condition in NEEDS[name]:
        code = _CHECKS[condition](arm, operator)
        if code:
            return code
    return 0


def require(name: str, arm: RC8Arm, operator: Operator) -> None:
    """Raise an exception if a function is not allowed at present.

    Raises:
        CallError: The code of the first violated condition.
    """
    code = refusal(name, arm, operator)
    if code:
        raise error_for(code, f"{name}, {operator}")
