"""When the encoders count as arrived at the end of a motion, and how far they may be from the command position.

The settings belong to CrtMotionAllow (pass mark ``@C``), EncMotionAllow and EncMotionAllowJnt (``@E``), ErAlw and
MotionTimeout (RC8 provider guide 5.2.28). Initially the encoders must have reached the command position exactly, and no
deviation is an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.servo import Servo
from orinkit.virtual.rc8.robot.target import FrameContext

PULSES: Final = 131_072
"""Pulses of an encoder for a turn of 360 deg, or for 360 mm of a linear axis: an assumption of this project."""

ALL_AXES: Final = 0
_TURN: Final = 360.0
_LONGEST: Final = 30_000  # ms
_LONGEST_CHORD: Final = math.sqrt(8.0)  # norm of the difference of two rotations that differ by 180 deg


@dataclass(slots=True)
class Accuracy:
    """The settings of one arm; TakeArm without Keep resets them.

    Attributes:
        encoder: Largest distance of the encoders of the robot's axes for ``@E``, deg; ``None`` for the exact position.
        extended: The same for each extended joint, deg or mm, by its number.
        position: Largest distance of the tool for ``@C``, mm; ``None`` for the exact position.
        posture: Largest angle of the tool for ``@C``, deg; ``None`` for any angle.
        deviation: Largest deviation of each axis from the command position, deg or mm, by its number.
        timeout: Longest time from the end of the command to the arrival of the encoders, ms; ``None`` for any time.
    """

    encoder: float | None = None
    extended: dict[int, float] = field(default_factory=dict)
    position: float | None = None
    posture: float | None = None
    deviation: dict[int, float] = field(default_factory=dict)
    timeout: int | None = None

    def reset(self) -> None:
        """Set all settings to their initial values."""
        self.encoder = self.position = self.posture = self.timeout = None
        self.extended, self.deviation = {}, {}

    def set_timeout(self, milliseconds: int) -> None:
        """Set the longest time to the arrival.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it is not 1 to 30,000 ms.
        """
        if not 1 <= milliseconds <= _LONGEST:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("the time-out {time} ms is not in 1 to {longest} ms", time=milliseconds, longest=_LONGEST),
            )
        self.timeout = milliseconds

    def arrived(self, mark: str, servo: Servo, space: FrameContext) -> bool:
        """Return True if the encoders count as arrived at the command position; only ``E`` and ``C`` require it."""
        if mark not in ("E", "C") or servo.settled:
            return True
        if mark == "C":
            return self._tool_arrived(servo, space)
        for number, (command, encoder) in enumerate(zip(servo.command, servo.encoder, strict=True), start=1):
            allowed = self.encoder if number <= space.model.robot_axes else self.extended.get(number)
            if abs(command - encoder) > (allowed or 0.0):
                return False
        return True

    def _tool_arrived(self, servo: Servo, space: FrameContext) -> bool:
        if self.position is None:
            return False
        wanted, actual = space.tcp(servo.command), space.tcp(servo.encoder)
        if math.dist(wanted[:3, 3], actual[:3, 3]) > self.position:
            return False
        chord = float(np.linalg.norm(wanted[:3, :3] - actual[:3, :3])) / _LONGEST_CHORD
        return self.posture is None or 2.0 * math.degrees(math.asin(min(1.0, chord))) <= self.posture

    def deviating_axis(self, servo: Servo) -> tuple[int, float] | None:
        """Return the first axis that deviates too much from the command position, and its deviation."""
        if servo.frozen:
            return None
        for number, allowed in self.deviation.items():
            deviation = abs(servo.command[number - 1] - servo.encoder[number - 1])
            if deviation > allowed:
                return number, deviation
        return None

    def report_deviation(self, servo: Servo, fault: Callable[[int, str], None]) -> None:
        """Raise the error of ErAlw if an axis deviates too much from the command position."""
        found = self.deviating_axis(servo)
        if found is not None:
            number, deviation = found
            fault(
                hresult.POSITION_DEVIATION_AXIS1 + number - 1,
                tr("{deviation:.4g} exceeds the tolerance of ErAlw", deviation=deviation),
            )


def length_of_pulses(pulses: float) -> float:
    """Convert a number of pulses to deg, or to mm of a linear axis."""
    return pulses * _TURN / PULSES


def check_axis(model: ArmModel, axis: int) -> int:
    """Return the number of an axis after checking that it exists.

    Raises:
        CallError: E_INVALIDARG.
    """
    count = len(model.axes)
    if not 1 <= axis <= count:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=axis, count=count),
        )
    return axis


def check_extended_joint(model: ArmModel, axis: int) -> int:
    """Return the number of an extended joint after checking that it exists.

    Raises:
        CallError: E_INVALIDARG.
    """
    if 1 <= axis <= model.robot_axes:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("axis {axis} belongs to the robot and is not an extended joint. Try: EncMotionAllow", axis=axis),
        )
    if not model.robot_axes < axis <= len(model.axes):
        raise error_for(hresult.E_INVALIDARG, tr("{name} has no extended joint {number}", name=model.name, number=axis))
    return axis
