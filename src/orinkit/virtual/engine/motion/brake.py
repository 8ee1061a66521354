"""To rest from a velocity that no motion was planned for: commands that came from outside, and come no more."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orinkit.arms import ArmModel
from orinkit.virtual.engine.motion.joint_path import Joints


class Brake:
    """Brings a command to rest, straight on in the direction in which it goes.

    All axes slow down together, evenly and as fast as the one with the least acceleration for its velocity can. There is
    no path that says where it ends: it may go beyond a soft limit, because stopping there would exceed an acceleration.

    Args:
        model: of the arm, for its accelerations.
        before: joints one cycle ago, degrees or mm.
        joints: where the command is.
        cycle: seconds of a :meth:`step`.
    """

    def __init__(self, model: ArmModel, before: Sequence[float], joints: Joints, cycle: float) -> None:
        self._joints = joints
        self._ways = tuple([b - a for a, b in zip(before, joints, strict=True)])
        self._part = 1.0  # of the velocity at the beginning
        steps = [axis.acceleration * cycle * cycle for axis in model.axes]
        self._less = min(
            [most / abs(way) for most, way in zip(steps, self._ways, strict=True) if way], default=math.inf
        )

    def step(self) -> Joints:
        """Return the command of the next cycle; the same again when it is at rest."""
        self._part = max(0.0, self._part - self._less)
        if self._part:
            self._joints = tuple([q + self._part * way for q, way in zip(self._joints, self._ways, strict=True)])
        return self._joints
