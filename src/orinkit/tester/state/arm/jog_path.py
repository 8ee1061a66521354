"""Paths of jogging: which joint position follows after a distance, and where the path must end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from orinkit.arms import ArmModel
from orinkit.arms.frames import inverse_of, rotation_about
from orinkit.arms.kinematics import Kinematics
from orinkit.arms.kinematics.chain import Array
from orinkit.core.errors import CallError, InvalidValue
from orinkit.core.i18n import tr

JogFrame = Literal["joint", "base", "tool"]

LINEAR_SPEED: Final = 250.0
"""Velocity of the tool at 100 %, mm/s."""
ROTATION_SPEED: Final = 45.0
"""Angular velocity of the tool at 100 %, deg/s."""
JOINT_SPEED: Final = 0.2
"""Velocity of a joint at 100 %, as a fraction of its limit."""
_MARGIN: Final = 0.05  # deg or mm that remain before a soft limit
_JOINT_SHARE: Final = 0.5  # part of the velocity limits of the joints that a path of the tool uses
_DIRECTIONS: Final = 6  # of the tool: X, Y, Z and the rotations about them
_AXES_OF_SCARA: Final = 4
_TILTS: Final = (4, 5)  # numbers of RX and RY
_JUMP: Final = 20.0  # deg; a larger step of a joint on a path is a change of the posture


@dataclass(frozen=True, slots=True)
class JogRequest:
    """The motion that a user requests.

    Attributes:
        frame: Coordinates: of the joints, of the base, or of the tool.
        axis: Number of the joint from 1; otherwise 1 to 3 for X, Y, Z and 4 to 6 for the rotations about them.
        sign: 1 or -1.
        speed: Speed in %, above 0 up to 100.
        step: Distance in mm or deg; 0 to move until the user releases the button.
    """

    frame: JogFrame
    axis: int
    sign: int
    speed: float
    step: float = 0.0

    def check(self, axes: int) -> None:
        """Check the values.

        Raises:
            InvalidValue: If a value is invalid.
        """
        most = axes if self.frame == "joint" else _DIRECTIONS
        if self.frame not in ("joint", "base", "tool") or not 1 <= self.axis <= most or self.sign not in (1, -1):
            raise InvalidValue(tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=self.axis, count=most))
        if axes == _AXES_OF_SCARA and self.frame != "joint" and self.axis in _TILTS:
            raise InvalidValue(tr("a SCARA cannot tilt its tool. Try: X, Y, Z or RZ"))
        if not 0 < self.speed <= 100:
            raise InvalidValue(tr("the speed must be above 0 and at most 100 %"))
        if not 0 <= self.step <= 100:
            raise InvalidValue(tr("the step must be 0 to 100 mm or deg"))


class JogPath(ABC):
    """A path that begins at the position of the arm.

    Attributes:
        full_speed: Velocity at 100 %, deg/s or mm/s.
    """

    full_speed: float

    @abstractmethod
    def point(self, distance: float, near: tuple[float, ...]) -> tuple[float, ...]:
        """Return the joints after a distance; ``near`` are the joints shortly before.

        Raises:
            CallError: If the arm cannot reach the point.
        """

    @abstractmethod
    def obstacle(self, distance: float, near: tuple[float, ...]) -> str:
        """Return why the arm must stop before a distance; ``""`` if it need not."""

    def fastest(self, distance: float, near: tuple[float, ...]) -> float:
        """Return the largest velocity at a distance, deg/s or mm/s."""
        return self.full_speed


class JointPath(JogPath):
    """The motion of one joint."""

    def __init__(self, model: ArmModel, start: tuple[float, ...], request: JogRequest) -> None:
        self._axis, self._sign, self._start = request.axis - 1, request.sign, start
        limits = model.axes[self._axis]
        self._end = limits.upper if request.sign > 0 else limits.lower
        self.full_speed = JOINT_SPEED * limits.velocity

    def point(self, distance: float, near: tuple[float, ...]) -> tuple[float, ...]:
        """Return the joints after a distance."""
        moved = self._start[self._axis] + self._sign * distance
        return (*self._start[: self._axis], moved, *self._start[self._axis + 1 :])

    def obstacle(self, distance: float, near: tuple[float, ...]) -> str:
        """Return the limit of the joint, if the distance reaches it."""
        room = abs(self._end - self._start[self._axis]) - _MARGIN
        return limit_text(self._axis + 1, self._end) if distance >= room else ""


class ToolPath(JogPath):
    """A straight line or a rotation of the tool, in coordinates of the base or of the tool."""

    def __init__(self, kinematics: Kinematics, start: tuple[float, ...], tool: Array, request: JogRequest) -> None:
        self._kinematics = kinematics
        self._axes = kinematics.model.robot_axes
        self._extended = start[self._axes :]
        self._unmounted = inverse_of(tool)
        self._from = kinematics.forward(start) @ tool
        self._in_tool = request.frame == "tool"
        self._turns = request.axis > 3
        self._direction = np.zeros(3)
        self._direction[(request.axis - 1) % 3] = request.sign
        self._velocities = np.array([axis.velocity for axis in kinematics.model.axes[: self._axes]]) * _JOINT_SHARE
        self.full_speed = ROTATION_SPEED if self._turns else LINEAR_SPEED

    def point(self, distance: float, near: tuple[float, ...]) -> tuple[float, ...]:
        """Return the joints after a distance."""
        flange = self._tool_at(distance) @ self._unmounted
        joints = self._kinematics.follow(flange[None], near)[0]
        return (*(float(joint) for joint in joints), *self._extended)

    def obstacle(self, distance: float, near: tuple[float, ...]) -> str:
        """Return the limit, the end of the reach or the singular point, if the distance reaches it."""
        try:
            joints = self.point(distance, near)
        except CallError:
            return tr("the tool cannot move further in this direction: the end of the reach")
        if self._kinematics.is_singular(joints) or self._largest_turn(joints, near) > _JUMP:
            return tr("a singular point is near. Try: jog the joints")
        for number, (joint, axis) in enumerate(zip(joints, self._kinematics.model.axes, strict=False), start=1):
            if joint < axis.lower + _MARGIN:
                return limit_text(number, axis.lower)
            if joint > axis.upper - _MARGIN:
                return limit_text(number, axis.upper)
        return ""

    def fastest(self, distance: float, near: tuple[float, ...]) -> float:
        """Return the largest velocity at a distance at which no joint exceeds half of its velocity limit."""
        ahead = 0.01
        joints = np.array(self.point(distance + ahead, near)[: self._axes]) - np.array(near[: self._axes])
        rates = np.abs(joints) / ahead
        return float(min(self.full_speed, np.min(self._velocities / np.maximum(rates, 1e-9))))

    def _largest_turn(self, joints: tuple[float, ...], near: tuple[float, ...]) -> float:
        axes = self._kinematics.model.axes[: self._axes]
        return max(abs(a - b) for a, b, axis in zip(joints, near, axes, strict=False) if not axis.linear)

    def _tool_at(self, distance: float) -> Array:
        moved = self._from.copy()
        axis = self._from[:3, :3] @ self._direction if self._in_tool else self._direction
        if self._turns:
            moved[:3, :3] = rotation_about(axis, distance) @ self._from[:3, :3]
        else:
            moved[:3, 3] += axis * distance
        return moved


def limit_text(number: int, value: float) -> str:
    """Return the message that a joint is at its soft limit."""
    return tr("joint {number} is at its limit of {value:g}. Try: the other direction", number=number, value=value)
