"""What the arm says about itself: poses in every type, as clients read them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from orinkit.virtual.engine.servo import AXES
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.target import Joints

Numbers = list[float]
_MILLISECONDS: Final = 1000


@dataclass(frozen=True, slots=True)
class Source:
    """Joints of the arm as P, J or T, in the tool and work frames in use."""

    arm: RC8Arm
    joints: Joints

    def position(self) -> Numbers:
        """P, seven numbers: X, Y, Z in mm, RX, RY, RZ in degrees, Fig."""
        return self.arm.space.position(self.joints)

    def angles(self) -> Numbers:
        """J, eight numbers in degrees (mm for a linear axis), 0 for an axis that there is not."""
        return eight(self.joints)

    def trans(self) -> Numbers:
        """T, ten numbers: X, Y, Z in mm, orient and approach vector, Fig."""
        return self.arm.space.trans(self.joints)

    def figure(self) -> int:
        """Fig."""
        return self.arm.space.kinematics.figure(self.joints)


def current(arm: RC8Arm) -> Source:
    """Where the encoders are."""
    return Source(arm, arm.servo.encoder)


def destination(arm: RC8Arm) -> Source:
    """Where the running motion ends; where the command stands when nothing moves."""
    return Source(arm, arm.queue.target)


def eight(joints: Joints) -> Numbers:
    """Return joints filled up with 0 to eight."""
    return [*joints, *[0.0] * (AXES - len(joints))]


def stamped(seconds: float, values: Numbers) -> Numbers:
    """Return values with the time since power-on in front, ms."""
    return [seconds * _MILLISECONDS, *values]
