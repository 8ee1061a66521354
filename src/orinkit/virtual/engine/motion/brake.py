"""Braking from any velocity to standstill, for set-points from outside: there is no planned path on which to stop."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orinkit.arms import ArmModel
from orinkit.virtual.engine.motion.joint_path import Joints


class Brake:
    """Brings a moving command position to standstill in its present direction.

    All axes slow down together with constant deceleration, determined by the axis whose acceleration limit is smallest
    in relation to its velocity. The end point is not planned: it may be beyond a soft limit, because stopping at the
    soft limit would exceed an acceleration limit.

    Args:
        model: The arm model, for its acceleration limits.
        before: The command position one cycle ago, deg or mm.
        joints: The present command position.
        cycle: Length of a :meth:`step` in seconds.
    """

    def __init__(self, model: ArmModel, before: Sequence[float], joints: Joints, cycle: float) -> None:
        self._joints = joints
        self._velocity = tuple([b - a for a, b in zip(before, joints, strict=True)])  # per cycle
        self._fraction = 1.0  # of the initial velocity
        steps = [axis.acceleration * cycle * cycle for axis in model.axes]
        self._decrease = min(
            [limit / abs(v) for limit, v in zip(steps, self._velocity, strict=True) if v], default=math.inf
        )

    def step(self) -> Joints:
        """Return the command position of the next cycle; after standstill it does not change."""
        self._fraction = max(0.0, self._fraction - self._decrease)
        if self._fraction:
            self._joints = tuple([q + self._fraction * v for q, v in zip(self._joints, self._velocity, strict=True)])
        return self._joints
