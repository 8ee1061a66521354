"""One robot of the controller; a controller has one or two."""

from __future__ import annotations

from dataclasses import dataclass

from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.moves import Moves


@dataclass(frozen=True, slots=True, eq=False)
class RobotUnit:
    """One robot: everything that belongs to one arm.

    Attributes:
        number: Number of the robot, counted from 0 (``ID`` of Controller_GetRobot).
        arm: The arm, with its motor, its frames, its speeds and the hardware around it.
        moves: The planner of its motions, with its stored paths.
    """

    number: int
    arm: RC8Arm
    moves: Moves

    @property
    def name(self) -> str:
        """Name of the robot in Controller_GetRobotNames."""
        return f"Arm{self.number}"
