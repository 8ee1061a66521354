"""Commands and functions of the robot that programs share with clients: a row for each.

The arguments are those of the command of Robot_Execute, in the same order; named arguments are not supported.
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
    "CurLmt": RobotWord("CurLmt", 2, 3),
    "ForceChangeTable": RobotWord("ForceChangeTable", 1, 1),
    "ForceCtrl": RobotWord("ForceCtrl", 1, 3),
    "ForceParam": RobotWord("ForceParam", 3, 14),
    "ForceSensor": RobotWord("ForceSensor", 1, 1),
    "ForceWaitCondition": RobotWord("ForceWaitCondition", 1, 5),
    "GrvCtrl": RobotWord("GrvCtrl", 1, 1),
    "GrvOffset": RobotWord("GrvOffset", 1, 1),
    "HighPathAccuracy": RobotWord("HighPathAccuracy", 1, 1),
    "PayLoad": RobotWord("PayLoad", 1, 3),
    "ResetArea": RobotWord("ResetArea", 1, 1),
    "SetArea": RobotWord("SetArea", 1, 1),
    "Tool": RobotWord("SetToolDef", 2, 2),
    "Work": RobotWord("SetWorkDef", 2, 3),
    "ZForce": RobotWord("Zforce", 1, 1),
}
"""Statements, by their documented spelling."""

VALUES: Final[Mapping[str, RobotWord]] = {
    "AreaSize": RobotWord("AreaSize", 1, 1),
    "CurTool": RobotWord("CurTool", 0, 0),
    "CurWork": RobotWord("CurWork", 0, 0),
    "ForceValue": RobotWord("ForceValue", 1, 2),
    "GetSrvData": RobotWord("GetSrvData", 1, 1),
    "GetSrvJntData": RobotWord("GetSrvJntData", 2, 2),
    "RobInfo": RobotWord("RobInfo", 1, 1),
}
"""Functions, by their documented spelling."""
