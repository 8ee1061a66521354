"""The extended commands of controllers (Controller_Execute, Robot_Execute, ...): names and parameters, for users.

The documents define a command by its name and the layout of its parameter. A program that offers commands for selection
uses these tables. A controller may have further commands, and its software version decides which of these it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from orinkit.core.i18n import N_
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, VarType

_I2, _I4, _R8, _BSTR = (int(vt) for vt in (VarType.I2, VarType.I4, VarType.R8, VarType.BSTR))
_EMPTY: Final = int(VarType.EMPTY)
_R8S, _I4S = _R8 | ARRAY, _I4 | ARRAY


@dataclass(frozen=True, slots=True)
class ExtendedCommand:
    """An extended command.

    Attributes:
        name: Name as documented; case-insensitive.
        vt: Usual VARIANT type of the parameter; VT_EMPTY if the command has none.
        example: Example of a parameter in VARIANT notation, without its type.
        hint: Meaning of the parameter, in English; ``""`` if it has none.
    """

    name: str
    vt: int = _EMPTY
    example: str = ""
    hint: str = ""


_POSE: Final = N_("a pose: P(...), J(...), T(...) or a variable such as P1")
_GROUP: Final = N_("arm group, 1 to keep the internal speeds, tool and work")
_SPEEDS: Final = N_("speed, acceleration, deceleration in %")
_INDEX: Final = N_("index, from 0")
_MOTION: Final = N_("(interpolation), (pose), (pass mark and distance in mm), (option)")
_AXES: Final = N_("(axis and value in deg or mm), ..., (option)")
_AREA: Final = N_("number of the area")
_LOAD: Final = N_("(mass in g), (centre in mm), (inertia in kg cm2)")
_HAND_POSITION: Final = N_("mm, speed in %, NEXT to return immediately")
_HAND_HOLD: Final = N_("mm, speed in %, force in N, NEXT to return immediately")
_GRIPPER_HOLD: Final = N_("mm, speed in %, force in %, NEXT to return immediately")
_POINT: Final = N_("number of the point, NEXT to return immediately")
_NEXT: Final = N_("0 to wait for the end of the motions, 1 to return immediately (NEXT)")
_WAIT: Final = N_("1 to wait until programs and arm have stopped")
_CHANNEL: Final = N_("channel: 0 both, 1 A, 2 B")


def _readings() -> list[ExtendedCommand]:
    """Return the commands that read a pose or a figure."""
    names = []
    for prefix in ("Cur", "HighCur", "Dest"):
        for suffix in ("Pos", "Jnt", "Trn"):
            names += [prefix + suffix, prefix + suffix + "Ex"]
        names.append(prefix + "Fig")
    return [ExtendedCommand(name) for name in names]


def _conversions() -> list[ExtendedCommand]:
    return [ExtendedCommand(f"{a}2{b}", _BSTR, f"{a}1", _POSE) for a in "PJT" for b in "PJT" if a != b]


_HAND_OF_CONTROLLER: Final = (
    ExtendedCommand("HandMoveA", _R8S, "10,50", _HAND_POSITION),
    ExtendedCommand("HandMoveR", _R8S, "-2,50", _HAND_POSITION),
    ExtendedCommand("HandMoveAH", _R8S, "10,50,20", _HAND_HOLD),
    ExtendedCommand("HandMoveRH", _R8S, "-2,50,20", _HAND_HOLD),
    ExtendedCommand("HandMoveH", VARIANT_ARRAY, "(5,20),(11,True)", N_("(force in N), (True to close, False to open)")),
    ExtendedCommand("HandMoveZH", VARIANT_ARRAY, "(5,10),(5,20),(5,15),(11,True)",
                    N_("(zone in mm), (zone in mm), (force in N), (True to close, False to open)")),
    ExtendedCommand("HandMoveVH", VARIANT_ARRAY, "(5,100),(11,True)", N_("(power in %), (True for suction)")),
    *(ExtendedCommand(name) for name in (
        "HandStop", "HandCurPos", "HandCurLoad", "HandCurPressure", "HandBusyState", "HandHoldState", "HandInposState",
        "HandZonState", "HandMotorState", "HandGrip", "HandRelease",
    )),
)  # fmt: skip
_FORCE: Final = (
    ExtendedCommand("ForceCtrl", _I4S, "1,1,1", N_("1 on or 0 off, parameter table, 0 compliance or 1 force sensor")),
    ExtendedCommand("ForceParam", VARIANT_ARRAY, "(3,1),(3,1),(8,P(0,0,10,0,0,0))",
                    N_("(table), (0 base, 1 tool, 2 work), (force in N and N m), (further parameters)")),
    ExtendedCommand("ForceChangeTable", _I4, "2", N_("parameter table")),
    ExtendedCommand("ForceValue", _I4S, "0,0", N_("item 0 to 13, -1 to reset a peak")),
    ExtendedCommand("ForceSensor", _I4, "0", N_("0 to reset the force sensor")),
    ExtendedCommand("ForceWaitCondition", VARIANT_ARRAY, "(3,-1),(8,P(-1,-1,20,-1,-1,-1)),(3,-1),(3,1),(3,5000)",
                    N_("(way), (force), (time in ms), (0 go on, 1 stop, 2 end force control), (time-out in ms)")),
    ExtendedCommand("ForceSensorPayLoad", VARIANT_ARRAY, "(3,500),(8,V(0,0,50))", _LOAD),
    ExtendedCommand("CurForceSensorPayLoad"),
)  # fmt: skip
_HARDWARE: Final = (
    ExtendedCommand("PayLoad", VARIANT_ARRAY, "(3,2000),(8,V(0,0,50)),(8,V(10,10,10))", _LOAD),
    ExtendedCommand("CurPayLoad"),
    *(ExtendedCommand(name, _I4, "1", N_("1 on or 0 off")) for name in ("GrvCtrl", "GrvOffset", "HighPathAccuracy")),
    ExtendedCommand("CurLmt", VARIANT_ARRAY, "(3,1),(3,2),(4,50)", N_("(1 on or 0 off), (axis, 0 for all), (percent of the current)")),
    ExtendedCommand("Zforce", _R8, "50", N_("thrust of the third axis in N")),
    ExtendedCommand("RobInfo", _I4, "2", N_("0 type, 1 name of the type, 2 way of each axis")),
    ExtendedCommand("SetHandIO", _I4S, "64,1,8", N_("first point, value, number of points")),
    ExtendedCommand("GetHandIO", _I4S, "48,8", N_("first point, number of points")),
    *(ExtendedCommand(name) for name in (
        "StartServoLog", "StopServoLog", "ClearServoLog", "GetCtrlLogMaxTime", "GetCtrlLogInterval", "AutoCal", "CurScene",
        "CurSubScene",
    )),
    ExtendedCommand("SetCtrlLogMaxTime", _I4, "10", N_("duration of the control log in s")),
    ExtendedCommand("SetCtrlLogInterval", _I4, "8", N_("interval of the control log in ms")),
    *(ExtendedCommand(name, _I4S, "1,1", N_("scene, sub-scene")) for name in ("SceneInfo", "ChangeScene")),
    *(ExtendedCommand(name, _I4, "0", N_("button of the arm, 0 to 2"))
      for name in ("GetMechaButtonState", "ClearMechaButtonState")),
)  # fmt: skip

ROBOT_COMMANDS: Final = (
    ExtendedCommand("TakeArm", _I4S, "0,1", _GROUP),
    ExtendedCommand("GiveArm"),
    ExtendedCommand("TakeArmState", _I4, "-1", N_("arm group; -1 for the group of this client")),
    ExtendedCommand("Motor", _I4S, "1,0", N_("1 on or 0 off, 1 to return immediately")),
    ExtendedCommand("ExtSpeed", _R8S, "50,25,25", _SPEEDS),
    *(ExtendedCommand(name) for name in (
        "CurSpd", "CurAcc", "CurDec", "CurJSpd", "CurJAcc", "CurJDec", "CurExtSpd", "CurExtAcc", "CurExtDec", "CurTool", "CurWork",
    )),
    *_readings(),
    *_conversions(),
    ExtendedCommand("Dev", _BSTR, "P1,P2", N_("pose, offset along the axes of the work frame")),
    ExtendedCommand("DevH", _BSTR, "P1,P2", N_("pose, offset along the axes of the tool")),
    ExtendedCommand("TMul", _BSTR, "T1,T2", N_("two transformations")),
    ExtendedCommand("TInv", _BSTR, "T1", N_("a transformation")),
    ExtendedCommand("TNorm", _BSTR, "T1", N_("a transformation")),
    ExtendedCommand("MPS", _R8, "250", N_("velocity of the tool in mm/s")),
    ExtendedCommand("RPM", _R8S, "1,30", N_("axis, velocity in turns per minute")),
    ExtendedCommand("DPS", _R8S, "1,90", N_("axis, velocity in deg/s; without the axis, for paths")),
    ExtendedCommand("OutRange", _BSTR, "P1", N_("pose, number of the tool, number of the work")),
    ExtendedCommand("Approach", VARIANT_ARRAY, "(3,1),(8,P1),(8,@P 50),(8,SPEED=20)", _MOTION),
    ExtendedCommand("Depart", VARIANT_ARRAY, "(3,2),(8,@P 50),(8,SPEED=20)",
                    N_("(interpolation), (pass mark and distance in mm), (option)")),
    ExtendedCommand("Draw", VARIANT_ARRAY, "(3,2),(8,@P V(0,0,50)),(8,SPEED=20)",
                    N_("(interpolation), (pass mark and vector in the work frame, mm), (option)")),
    ExtendedCommand("ArchMove", VARIANT_ARRAY, "(8,P1),(5,50),(5,30),(5,30)",
                    N_("(pose), (height, start and end of the arch in mm)")),
    ExtendedCommand("DriveEx", VARIANT_ARRAY, "(8,@P (1,10),(2,5)),(8,SPEED=20)", _AXES),
    ExtendedCommand("DriveAEx", VARIANT_ARRAY, "(8,@P (1,10),(2,45)),(8,SPEED=20)", _AXES),
    ExtendedCommand("RotateH", VARIANT_ARRAY, "(8,@P 30),(8,SPEED=20)", N_("(pass mark and angle in deg), (option)")),
    ExtendedCommand("Arrive", _R8, "50", N_("share of the motion in %")),
    ExtendedCommand("SyncTimeStart"),
    ExtendedCommand("SyncTimeEnd", VarType.I4, "0", _NEXT),
    ExtendedCommand("SyncMoveStart", _I4S, "1", N_("numbers of the robots that follow this one")),
    ExtendedCommand("SyncMoveEnd", VarType.I4, "0", _NEXT),
    ExtendedCommand("MotionSkip", _I4S, "-1,0", N_("arm group, pattern: 0 or 1 as fast as possible, 2 or 3 as set")),
    ExtendedCommand("MotionComplete", _I4S, "-1,0", N_("arm group, 0 or 1 to include the settling of the encoders")),
    ExtendedCommand("CrtMotionAllow", _R8S, "1,0.5", N_("1 on or 0 off, tolerance in mm, tolerance in deg")),
    ExtendedCommand("EncMotionAllow", _R8S, "1,0.5,0", N_("1 on or 0 off, tolerance, 0 in deg or 1 in pulses")),
    ExtendedCommand("EncMotionAllowJnt", _R8S, "1,7,0.5,0", N_("1 on or 0 off, axis, tolerance, 0 in deg or mm, or 1 in pulses")),
    ExtendedCommand("ErAlw", _R8S, "1,1,5", N_("1 on or 0 off, axis, tolerance in deg or mm")),
    ExtendedCommand("MotionTimeout", _I4S, "1,5600", N_("1 on or 0 off, time in ms")),
    ExtendedCommand("SingularAvoid", _I4, "2", N_("0 off or 2 on")),
    ExtendedCommand("SpeedMode", _I4, "3", N_("0 off, 1 PTP, 2 paths, 3 both")),
    ExtendedCommand("CurSpeedMode"),
    ExtendedCommand("GenerateNonStopPath", VARIANT_ARRAY, "(3,1),(5,1)",
                    N_("requires a licence, which a virtual controller does not have")),
    ExtendedCommand("SetToolDef", VARIANT_ARRAY, "(3,1),(8,P(0,0,100,0,0,0))", N_("(number of the tool), (pose)")),
    ExtendedCommand("GetToolDef", _I4, "1", N_("number of the tool")),
    ExtendedCommand("SetWorkDef", VARIANT_ARRAY, "(3,1),(8,P(300,0,0,0,0,0)),(3,0)",
                    N_("(number of the work), (pose), (0 standard, 1 fixed tool)")),
    ExtendedCommand("GetWorkDef", _I4, "1", N_("number of the work")),
    ExtendedCommand("WorkAttribute", _I4, "1", N_("number of the work")),
    ExtendedCommand("SetBaseDef", VARIANT_ARRAY, "(3,0),(8,P(0,0,500,0,0,0))", N_("(number of the base), (pose)")),
    ExtendedCommand("GetBaseDef", _I4, "0", N_("number of the base")),
    ExtendedCommand("ConvertPosWork", VARIANT_ARRAY, "(8,P1),(3,1),(3,0)", N_("(position), (its work), (wanted work)")),
    ExtendedCommand("SetAreaDef", VARIANT_ARRAY, "(3,1),(8,P(300,0,300,0,0,0)),(8,V(100,100,100)),(3,128),(3,1)",
                    N_("(area), (centre), (lengths of the edges), (I/O), (variable), (1 to stop)")),
    *(ExtendedCommand(name, _I4, "1", _AREA) for name in ("GetAreaDef", "AreaSize", "GetAreaEnabled", "SetArea", "ResetArea")),
    ExtendedCommand("SetAreaEnabled", VARIANT_ARRAY, "(3,1),(11,True)", N_("(area), (True to watch it)")),
    ExtendedCommand("CheckVirtualFence", _BSTR, "P1", _POSE),
    *_FORCE,
    ExtendedCommand("AddPathPoint", VARIANT_ARRAY, "(3,1),(8,P1)", N_("(number of the path), (pose)")),
    ExtendedCommand("ClrPathPoint", _I4, "1", N_("number of the path")),
    ExtendedCommand("GetPathPointCount", _I4, "1", N_("number of the path")),
    ExtendedCommand("GetPathPoint", _I4S, "1,1", N_("number of the path, point from 1")),
    ExtendedCommand("LoadPathPoint", _I4, "1", N_("number of the path")),
    ExtendedCommand("GetSrvData", _I4, "2",
                    N_("1 motor speed, 2 deviation, 4 current, 5 torque, 7 load factor, 8 command, 17 to 20 tool tip")),
    ExtendedCommand("GetSrvJntData", _I4S, "4,1", N_("1 motor speed, 2 deviation, 4 current, 5 torque or 8 command, axis")),
    *_HARDWARE,
    *(ExtendedCommand(name) for name in ("StartLog", "StopLog", "ClearLog", "GetLogCount")),
    ExtendedCommand("GetLogRecord", _I4, "0", _INDEX),
    ExtendedCommand("slvChangeMode", _I4, "513", N_("0 off; type of pose 1 P, 2 J, 3 T, plus 0, 256 or 512 for the mode")),
    ExtendedCommand("slvGetMode"),
    ExtendedCommand("slvGetLateness", _I4, "0", N_("number of set-points at the beginning that are not counted")),
    ExtendedCommand("slvMove", _R8S, "364.16,0,278.5355,180,1.272222E-14,180,5", N_("the set-point, in the type of the mode")),
    ExtendedCommand("slvSendFormat", _I4, "0", N_("sum of the fields that are sent in addition to the pose")),
    ExtendedCommand("slvRecvFormat", _I4, "2", N_("sum of the fields that are returned")),
    ExtendedCommand("GetRobotTypeName"),
    *_HAND_OF_CONTROLLER,
    ExtendedCommand("TwofgGrip", _R8S, "10,20,50,1", N_("width in mm, force in N, speed in %, 1 to wait")),
    ExtendedCommand("TwofgRelease", _R8S, "35,1", N_("width in mm, 1 to wait")),
    *(ExtendedCommand(name) for name in (
        "TwofgStop", "TwofgIsConn", "TwofgIsBusy", "TwofgIsGrip", "TwofgGetErrorCode", "TwofgGetWidth", "TwofgGetMinWidth",
        "TwofgGetMaxWidth", "TwofgGetForce", "TwofgGetOrientation", "TwofgGetFingerLength", "TwofgGetFTWidth", "TwofgGetMode",
        "TwofgSwitchToExternal", "TwofgSwitchToInternal",
    )),
    ExtendedCommand("TwofgSetOrientation", _I4, "1", N_("1 inward, 2 outward")),
    ExtendedCommand("TwofgSetFingerLength", _R8, "8.5", N_("length in mm")),
    ExtendedCommand("TwofgSetFTWidth", _R8, "5", N_("width in mm")),
    ExtendedCommand("Vgc10Grip", _R8S, "0,60,1", N_("channel 0 both, 1 A, 2 B; vacuum in %; 1 to wait")),
    *(ExtendedCommand(name, _I4, "0", _CHANNEL) for name in ("Vgc10Release", "Vgc10IsGrip", "Vgc10GetVacuum")),
    ExtendedCommand("Vgc10IsConn"),
    *(ExtendedCommand(name) for name in ("ClearError", "ManualReset", "ManualResetPreparation", "MotionPreparation")),
)  # fmt: skip
"""Commands of Robot_Execute (RC8, and DENSO's published implementations)."""

CONTROLLER_COMMANDS: Final = (
    ExtendedCommand("ClearError"),
    ExtendedCommand("GetErrorDescription", _I4, "-2147467259", N_("return code")),
    ExtendedCommand("GetCurErrorCount"),
    ExtendedCommand("GetCurErrorInfo", _I4, "0", _INDEX),
    ExtendedCommand("GetErrorLogCount"),
    ExtendedCommand("GetErrorLog", _I4, "0", _INDEX),
    ExtendedCommand("GetOprLogCount"),
    ExtendedCommand("GetOprLog", _I4, "0", _INDEX),
    ExtendedCommand("KillAll", _I4, "0", _WAIT),
    ExtendedCommand("KillAllTsr", _I4, "0", _WAIT),
    ExtendedCommand("RunAllTsr", _I4, "0", N_("0 for the root folder, 1 for all folders")),
    ExtendedCommand("SuspendAll", _I4, "0", _WAIT),
    ExtendedCommand("StepStopAll", _I4, "0", _WAIT),
    ExtendedCommand("ContinueStartAll"),
    ExtendedCommand("GetPublicValue", VARIANT_ARRAY, "(8,Pro1),(8,count)", N_("(task), (variable), (index), ...")),
    ExtendedCommand("SetPublicValue", VARIANT_ARRAY, "(3,1),(8,Pro1),(8,count)",
                    N_("(value), (task), (variable), (index), ...")),
    ExtendedCommand("SysInfo", _I4, "0", N_("item 0 to 16: 0 serial number, 8 minutes since the first start")),
    *(ExtendedCommand(name) for name in ("SysState", "StoState", "ManualReset", "ManualResetPreparation", "ResetStoState", "MotionPreparation")),
    *_HAND_OF_CONTROLLER,
)  # fmt: skip
"""Commands of Controller_Execute (RC8)."""

TASK_COMMANDS: Final = (
    ExtendedCommand("GetStatus"),
    ExtendedCommand("GetThreadPriority"),
    ExtendedCommand("SetThreadPriority", _I4, "0", N_("-2 lowest to 2 highest")),
)
"""Commands of Task_Execute."""

EXTENSION_COMMANDS: Final = (
    ExtendedCommand("Chuck", _I4, "0", _POINT),
    ExtendedCommand("UnChuck", _I4, "1", _POINT),
    ExtendedCommand("MoveP", _I4, "1", _POINT),
    ExtendedCommand("MoveA", _R8S, "10,50", _HAND_POSITION),
    ExtendedCommand("MoveR", _R8S, "-2,50", _HAND_POSITION),
    ExtendedCommand("MoveAH", _R8S, "10,50,50", _GRIPPER_HOLD),
    ExtendedCommand("MoveRH", _R8S, "-2,50,50", _GRIPPER_HOLD),
    ExtendedCommand("MoveH", _R8S, "50,50,1", N_("speed in %, force in %, 0 to open")),
    ExtendedCommand("MoveZH", _R8S, "5,15,50,50,1", N_("zone in mm, zone in mm, speed in %, force in %, 0 to open")),
    ExtendedCommand("Motor", _I4, "1", N_("1 on or 0 off")),
    ExtendedCommand("GetPoint", _I4S, "0,0", N_("point, item 0 to 5: mode, distance, speed, force, zone")),
    *(ExtendedCommand(name) for name in (
        "Org", "Stop", "CurPos", "get_EmgState", "get_ZonState", "get_OrgState", "get_HoldState", "get_InposState", "get_Error",
        "get_BusyState", "get_MotorState",
    )),
)  # fmt: skip
"""Commands of Extension_Execute of an electric gripper, ``Hand0`` to ``Hand7`` (provider guide 5.2.36)."""

VE026A_ROBOT_COMMANDS: Final = (
    ExtendedCommand("Motor", _I2, "1", N_("1 on or 0 off")),
    ExtendedCommand("slvChangeMode", _I4, "258", N_("2 or 258 to begin, 0 to end")),
    ExtendedCommand("slvMove", int(VarType.R4) | ARRAY, "0,30,120,0,30,0,0,0", N_("the angles of the axes in deg")),
    ExtendedCommand("slvGetLateness", _I4, "0", N_("number of set-points at the beginning that are not counted")),
)
"""Commands of Robot_Execute of the VE026A (VE026A table 5-3)."""
VE026A_CONTROLLER_COMMANDS: Final = (ExtendedCommand("ClearError", _I2, "0", N_("return code")),)
"""Commands of Controller_Execute of the VE026A (VE026A table 5-1)."""

COMMANDS: Final[Mapping[str, Mapping[str, tuple[ExtendedCommand, ...]]]] = MappingProxyType({
    "rc8": {
        "Controller": CONTROLLER_COMMANDS, "Robot": ROBOT_COMMANDS, "Task": TASK_COMMANDS, "File": (),
        "Extension": EXTENSION_COMMANDS,
    },
    "ve026a": {"Controller": VE026A_CONTROLLER_COMMANDS, "Robot": VE026A_ROBOT_COMMANDS},
})  # fmt: skip
"""The commands by dialect and by the interface of the object."""
