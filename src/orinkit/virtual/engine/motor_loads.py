"""Loads of the motors in percent of the rated torque, and current limits that let an axis yield."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from orinkit.arms import ArmModel
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.dynamics import ArmDynamics, Joints, Wrench

RATED_SPEED: Final = 4000.0
"""Speed of a motor at the largest velocity of its axis, min^-1 (an assumption of this project)."""

_FRICTION: Final = 10.0  # % of the rated torque
_EXTENDED_LOAD: Final = 33.3  # % of the rated torque of an extended joint at its largest acceleration
_FULL_FRICTION: Final = 0.01  # of the largest velocity, from which on the friction is constant
_YIELD: Final = 5e-4  # deg or mm for each percent above the limit in a cycle; small enough for contacts of 1000 N/mm
_FASTEST_YIELD: Final = 0.1  # of the largest velocity
_PERCENT: Final = 100.0


class MotorLoads:
    """The loads of the motors of one arm.

    Args:
        model: The arm model.

    Attributes:
        dynamics: Dynamics of the arm, with the payload.
        contact: Force and moment on the tool, or ``None`` without contact.
        gravity_control: True if the controller compensates the weight of arm and payload (GrvCtrl).
        offsets: Torques that are compensated in addition, % (GrvOffset); ``None`` if there are none.
        limits: Limits of the motor currents in % of the rated current, by index of the axis (CurLmt).
        force_limits: The same while force control is on (ForceParam).
        yielded: Distance by which each limited axis has yielded, deg or mm.
    """

    def __init__(self, model: ArmModel) -> None:
        self.dynamics = ArmDynamics(model)
        self.contact: Wrench | None = None
        self.gravity_control = False
        self.offsets: tuple[float, ...] | None = None
        self.limits: dict[int, float] = {}
        self.force_limits: dict[int, float] = {}
        self.yielded = [0.0] * len(model.axes)
        self._model = model

    @property
    def limiting(self) -> bool:
        """True while an axis has a current limit, or has not yet returned after one."""
        return bool(self.limits or self.force_limits) or any(self.yielded)

    def required(self, first: Joints, before: Joints, now: Joints) -> tuple[float, ...]:
        """Return the load of each axis, % of the rated torque, from its positions in the last three cycles."""
        torques = self.dynamics.torques(first, before, now, PERIOD, self.contact)
        loads = [_PERCENT * torque / rated for torque, rated in zip(torques, self.dynamics.rated, strict=True)]
        for index in range(self._model.robot_axes, len(now)):
            acceleration = (first[index] - 2 * before[index] + now[index]) / PERIOD**2
            loads.append(_EXTENDED_LOAD * acceleration / self._model.axes[index].acceleration)
        for index, (b, c, axis) in enumerate(zip(before, now, self._model.axes, strict=True)):
            speed = (c - b) / (PERIOD * axis.velocity * _FULL_FRICTION)
            loads[index] += _FRICTION * min(1.0, max(-1.0, speed))
        return tuple(loads)

    def commanded(self, first: Joints, before: Joints, now: Joints) -> tuple[float, ...]:
        """Return the torque command of each axis, %: its load without what the controller compensates."""
        loads = list(self.required(first, before, now))
        if self.gravity_control:
            for index, torque in enumerate(self.dynamics.holding(before)):
                loads[index] -= _PERCENT * torque / self.dynamics.rated[index]
        if self.offsets is not None:
            loads = [load - offset for load, offset in zip(loads, self.offsets, strict=True)]
        return tuple(loads)

    def yield_to(self, commanded: Sequence[float]) -> None:
        """Let axes whose torque command exceeds their limit yield by one cycle, and let the others return."""
        for index, load in enumerate(commanded):
            gone = self.yielded[index]
            limit = min(self.limits.get(index, math.inf), self.force_limits.get(index, math.inf))
            if not gone and limit == math.inf:
                continue
            direction = math.copysign(1.0, gone or load)
            excess = load * direction - limit
            most = _FASTEST_YIELD * self._model.axes[index].velocity * PERIOD
            change = min(max(excess * _YIELD, -most), most)
            self.yielded[index] = direction * max(0.0, abs(gone) + change)

    def forget(self) -> None:
        """Set the yielded distances to 0, after the command position has been set to the encoders."""
        self.yielded = [0.0] * len(self.yielded)
