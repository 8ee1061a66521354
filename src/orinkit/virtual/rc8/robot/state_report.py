"""The poses of the arm in every pose type, as clients read them."""

from __future__ import annotations

from typing import Final

from orinkit.core.record import record
from orinkit.virtual.engine.servo import AXES
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.target import Joints

Numbers = list[float]
_MILLISECONDS: Final = 1000


@record
class ArmPosition:
    """A joint position of the arm as P, J or T, in the current tool and work frames."""

    arm: RC8Arm
    joints: Joints

    def position(self) -> Numbers:
        """Return P, seven numbers: X, Y, Z in mm, RX, RY, RZ in deg, Fig."""
        return self.arm.space.position(self.joints)

    def angles(self) -> Numbers:
        """Return J, eight numbers in deg (mm for a linear axis), 0 for an axis that does not exist."""
        return eight(self.joints)

    def trans(self) -> Numbers:
        """Return T, ten numbers: X, Y, Z in mm, orient and approach vector, Fig."""
        return self.arm.space.trans(self.joints)

    def figure(self) -> int:
        """Return the figure (Fig)."""
        return self.arm.space.figure(self.joints)


def current(arm: RC8Arm) -> ArmPosition:
    """Return the position of the encoders."""
    return ArmPosition(arm, arm.servo.encoder)


def destination(arm: RC8Arm) -> ArmPosition:
    """Return the end of the running motion, or the command position if the arm is at standstill."""
    return ArmPosition(arm, arm.queue.target)


def eight(joints: Joints) -> Numbers:
    """Return a joint position as eight numbers, 0 for an axis that does not exist."""
    return [*joints, *[0.0] * (AXES - len(joints))]


def stamped(seconds: float, values: Numbers) -> Numbers:
    """Return values preceded by the time since power-on, ms."""
    return [seconds * _MILLISECONDS, *values]
