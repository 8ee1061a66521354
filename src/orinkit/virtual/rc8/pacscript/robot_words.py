"""Commands and functions of the robot that programs share with clients: a row for each.

The arguments are those of the command of Robot_Execute, in the same order; named arguments are not supported. A row is
all that a word needs, if its command is one of :data:`orinkit.virtual.rc8.robot.shared_commands.SHARED_COMMANDS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class RobotWord:
    """A word of a program.

    Attributes:
        name: Name of the command of Robot_Execute.
        least: Minimum number of arguments.
        most: Maximum number of arguments.
    """

    name: str
    least: int
    most: int


STATEMENTS: Final[Mapping[str, RobotWord]] = {
    "Arrive": RobotWord("Arrive", 1, 1),
    "CrtMotionAllow": RobotWord("CrtMotionAllow", 1, 3),
    "CurLmt": RobotWord("CurLmt", 2, 3),
    "EncMotionAllow": RobotWord("EncMotionAllow", 1, 3),
    "EncMotionAllowJnt": RobotWord("EncMotionAllowJnt", 2, 4),
    "ErAlw": RobotWord("ErAlw", 2, 3),
    "ForceChangeTable": RobotWord("ForceChangeTable", 1, 1),
    "ForceCtrl": RobotWord("ForceCtrl", 1, 3),
    "ForceParam": RobotWord("ForceParam", 3, 14),
    "ForceSensor": RobotWord("ForceSensor", 1, 1),
    "ForceWaitCondition": RobotWord("ForceWaitCondition", 1, 5),
    "GrvCtrl": RobotWord("GrvCtrl", 1, 1),
    "GrvOffset": RobotWord("GrvOffset", 1, 1),
    "HighPathAccuracy": RobotWord("HighPathAccuracy", 1, 1),
    "MotionSkip": RobotWord("MotionSkip", 0, 2),
    "MotionTimeout": RobotWord("MotionTimeout", 1, 2),
    "PayLoad": RobotWord("PayLoad", 1, 3),
    "ResetArea": RobotWord("ResetArea", 1, 1),
    "SetArea": RobotWord("SetArea", 1, 1),
    "SetAreaEnabled": RobotWord("SetAreaEnabled", 2, 2),
    "SingularAvoid": RobotWord("SingularAvoid", 1, 1),
    "SpeedMode": RobotWord("SpeedMode", 1, 1),
    "Tool": RobotWord("SetToolDef", 2, 2),
    "Work": RobotWord("SetWorkDef", 2, 3),
    "ZForce": RobotWord("Zforce", 1, 1),
}
"""Statements, by their documented spelling."""

VALUES: Final[Mapping[str, RobotWord]] = {
    "AreaSize": RobotWord("AreaSize", 1, 1),
    "CurAcc": RobotWord("CurAcc", 0, 1),
    "CurDec": RobotWord("CurDec", 0, 1),
    "CurExtAcc": RobotWord("CurExtAcc", 0, 1),
    "CurExtDec": RobotWord("CurExtDec", 0, 1),
    "CurExtSpd": RobotWord("CurExtSpd", 0, 1),
    "CurJAcc": RobotWord("CurJAcc", 0, 1),
    "CurJDec": RobotWord("CurJDec", 0, 1),
    "CurJSpd": RobotWord("CurJSpd", 0, 1),
    "CurSpd": RobotWord("CurSpd", 0, 1),
    "CurSpeedMode": RobotWord("CurSpeedMode", 0, 0),
    "CurTool": RobotWord("CurTool", 0, 0),
    "CurWork": RobotWord("CurWork", 0, 0),
    "DPS": RobotWord("DPS", 1, 2),
    "ForceValue": RobotWord("ForceValue", 1, 2),
    "GetAreaEnabled": RobotWord("GetAreaEnabled", 1, 1),
    "GetSrvData": RobotWord("GetSrvData", 1, 1),
    "GetSrvJntData": RobotWord("GetSrvJntData", 2, 2),
    "MPS": RobotWord("MPS", 1, 1),
    "MotionComplete": RobotWord("MotionComplete", 0, 2),
    "RPM": RobotWord("RPM", 2, 2),
    "RobInfo": RobotWord("RobInfo", 1, 1),
    "TInv": RobotWord("TInv", 1, 1),
    "TNorm": RobotWord("TNorm", 1, 1),
    "ToolPos": RobotWord("GetToolDef", 1, 1),
    "WorkAttribute": RobotWord("WorkAttribute", 1, 1),
}
"""Functions, by their documented spelling."""
