"""Kinematics of SCARA arms, in closed form.

Joints 1 and 2 rotate about vertical axes, joint 3 moves along z, joint 4 rotates about z. The Z axis of the flange always
points upwards, so that RX and RY of the flange are 0, and RZ is the sum of joints 1, 2 and 4 (RC8 manual, position data of
4-axis robots).

========= ======= =========== ==========================================
bit       0       1           condition for 1
========= ======= =========== ==========================================
1         RIGHTY  LEFTY       the elbow is bent to the negative side
16        SINGLE  DOUBLE      joint 4 is outside -180 < angle <= 180
========= ======= =========== ==========================================

The elbow is bent to the negative side if joint 2 is below its value at full stretch, which is 0 if the arms have no lateral
offsets. The RC8 manual names the figures 0, 1, 16 and 17; that joint 2 above 0 is RIGHTY is an assumption of this project.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from orinkit.arms import ArmModel
from orinkit.arms.kinematics.arm_solver import ArmSolver
from orinkit.arms.kinematics.chain import RADIAN, Array, joints_of
from orinkit.arms.kinematics.figures import J4_DOUBLE, LEFTY, normalize_angle
from orinkit.arms.kinematics.inverse import REACH_TOLERANCE, Mask
from orinkit.core.i18n import tr

SCARA_AXES: Final = 4
ELBOW_SINGULAR: Final = 0.01
"""Bend of the elbow, deg, from 0 or 180, below which a SCARA is at a singular point."""
TILT_TOLERANCE: Final = 1e-6
"""Sine of the angle between the Z axis of a flange and the vertical up to which the flange counts as upright."""

_ANGLE_NOISE: Final = 1e-9  # deg; a bend this close to 0 counts as 0
_LENGTH_NOISE: Final = 1e-7  # mm from the axis of joint 1 below which joint 1 is undetermined
_FOURTH: Final = 3  # index of joint 4


class ScaraChain:
    """The coordinate frames of a SCARA.

    Attributes:
        base: X and Y of joint 1 in the base frame, mm.
        upper: X and Y of joint 2 in the frame of joint 1, mm.
        fore: X and Y of joint 4 in the frame of joint 2, mm.
        height: Z of the flange in the base frame when joint 3 is 0, mm.
    """

    def __init__(self, model: ArmModel) -> None:
        first, second, third, fourth = model.origins
        self.base = first[:2]
        self.upper = second[:2]
        self.fore = (third[0] + fourth[0], third[1] + fourth[1])
        self.height = sum(origin[2] for origin in model.origins)

    def forward(self, joints: ArrayLike) -> Array:
        """Return the flange frames (..., 4, 4), mm, of joints (..., n >= 4)."""
        values = joints_of(joints, SCARA_AXES)
        first, both = values[..., 0] * RADIAN, (values[..., 0] + values[..., 1]) * RADIAN
        turn = (values[..., 0] + values[..., 1] + values[..., 3]) * RADIAN
        frames = np.zeros((*values.shape[:-1], 4, 4))
        upper, fore = _turned(self.upper, first), _turned(self.fore, both)
        frames[..., 0, 3] = self.base[0] + upper[0] + fore[0]
        frames[..., 1, 3] = self.base[1] + upper[1] + fore[1]
        frames[..., 2, 3] = self.height + values[..., 2]
        frames[..., 0, 0] = frames[..., 1, 1] = np.cos(turn)
        frames[..., 1, 0] = np.sin(turn)
        frames[..., 0, 1] = -frames[..., 1, 0]
        frames[..., 2, 2] = frames[..., 3, 3] = 1.0
        return frames

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return the Jacobians (..., 6, 4) of the flange; see :meth:`orinkit.arms.kinematics.solver.Kinematics.jacobian`."""
        values = joints_of(joints, SCARA_AXES)
        first, both = values[..., 0] * RADIAN, (values[..., 0] + values[..., 1]) * RADIAN
        upper, fore = _turned(self.upper, first), _turned(self.fore, both)
        result = np.zeros((*values.shape[:-1], 6, SCARA_AXES))
        result[..., 0, 0], result[..., 1, 0] = -(upper[1] + fore[1]) * RADIAN, (upper[0] + fore[0]) * RADIAN
        result[..., 0, 1], result[..., 1, 1] = -fore[1] * RADIAN, fore[0] * RADIAN
        result[..., 2, 2] = 1.0
        result[..., 5, (0, 1, 3)] = 1.0
        return result


class ScaraSolver(ArmSolver):
    """The solver of one SCARA.

    Args:
        model: The arm model.
    """

    posture_bits = LEFTY
    double_bits = ((_FOURTH, J4_DOUBLE),)

    def __init__(self, model: ArmModel) -> None:
        self._chain = ScaraChain(model)
        upper, fore = self._chain.upper, self._chain.fore
        self._upper, self._fore = math.hypot(*upper), math.hypot(*fore)
        self._upper_angle, self._fore_angle = math.atan2(upper[1], upper[0]), math.atan2(fore[1], fore[0])
        self._centres = tuple((axis.lower + axis.upper) / 2.0 for axis in model.axes[:2])

    @property
    def chain(self) -> ScaraChain:
        """The frames of the arm."""
        return self._chain

    def figure_of(self, joints: Sequence[float]) -> int:
        """Return the figure of joints: 0, 1, 16 or 17."""
        lefty = self._bend(joints) < -_ANGLE_NOISE
        return LEFTY * lefty | J4_DOUBLE * (normalize_angle(joints[_FOURTH]) != joints[_FOURTH])

    def known_bits(self, figure: int) -> int | None:
        """Return the figure itself; ``None`` if it is not 0, 1, 16 or 17."""
        return figure if figure >= 0 and not figure & ~(LEFTY | J4_DOUBLE) else None

    def path_bits(self, joints: Sequence[float]) -> int:
        """Return the bits of the figure that a path cannot change: at full stretch, LEFTY and RIGHTY are equal."""
        return 0 if abs(self._bend(joints)) <= _ANGLE_NOISE else LEFTY

    def equal_figures(self, figure: int, joints: Sequence[float]) -> list[int]:
        """Return the figures that count as the figure of these joints: at full stretch, LEFTY and RIGHTY are equal."""
        return [figure] if self.path_bits(joints) else [figure, figure ^ LEFTY]

    def of_posture(self, frame: Array, posture: int, near: Array | None) -> Iterator[list[float]]:
        """Yield the solution of one posture, with J4 SINGLE."""
        hold = 0.0 if near is None else float(near[0])
        joints, reached = self._solved(frame[None], lefty=posture & LEFTY != 0, hold=hold)
        if reached[0]:
            yield joints[0].tolist()

    def bases(self, frame: Array, near: Array) -> list[list[float]]:
        """Return all distinct solutions, with J4 SINGLE."""
        found = [each for posture in (0, LEFTY) for each in self.of_posture(frame, posture, near)]
        if len(found) == 2 and max(abs(a - b) for a, b in zip(*found, strict=True)) <= _ANGLE_NOISE:
            return found[:1]
        return found

    def follow(self, flanges: Array, start: Array) -> tuple[Array, Mask]:
        """Return joints (N, 4) along a path, and which rows are in reach; the elbow stays bent to the same side."""
        lefty = self.figure_of(start.tolist()) & LEFTY != 0
        joints, reached = self._solved(flanges, lefty=lefty, hold=float(start[0]))
        rows = np.vstack((start[:SCARA_AXES], joints))
        turns = np.cumsum(np.round(np.diff(rows[:, (0, 1, 3)], axis=0) / 360.0), axis=0)
        joints[:, (0, 1, 3)] -= 360.0 * turns
        return joints, reached

    def is_singular(self, values: Array) -> bool:
        """Return True if the elbow is straight or completely folded, or almost so."""
        return abs(math.sin(self._bend(values.tolist()) * RADIAN)) < math.sin(ELBOW_SINGULAR * RADIAN)

    def obstacle(self, frame: Array) -> str:
        """Return why the arm cannot hold its flange in this frame, if the flange is not upright."""
        if _upright(frame):
            return ""
        return tr("a SCARA cannot tilt its tool: the Z axis of its flange always points upwards")

    def _bend(self, joints: Sequence[float]) -> float:
        """Return the angle between the two arms, deg, normalized; 0 at full stretch."""
        return normalize_angle(joints[1] + (self._fore_angle - self._upper_angle) / RADIAN)

    def _solved(self, flanges: Array, *, lefty: bool, hold: float) -> tuple[Array, Mask]:
        """Return joints (N, 4) with J4 SINGLE, and which rows are in reach.

        Joint 1, which the flange does not determine on the axis of joint 1, is then ``hold``, deg.
        """
        upper, fore = self._upper, self._fore
        x, y = flanges[:, 0, 3] - self._chain.base[0], flanges[:, 1, 3] - self._chain.base[1]
        distance = np.minimum(np.hypot(x, y), 2.0 * (upper + fore))  # its square must be finite
        cosine = (distance * distance - (upper * upper + fore * fore)) / (2.0 * upper * fore)
        bend = np.arccos(np.clip(cosine, -1.0, 1.0)) * (-1.0 if lefty else 1.0)
        first = np.arctan2(y, x) - np.arctan2(fore * np.sin(bend), upper + fore * np.cos(bend)) - self._upper_angle
        first = np.where(distance >= _LENGTH_NOISE, first / RADIAN, hold)
        second = bend / RADIAN + (self._upper_angle - self._fore_angle) / RADIAN
        turn = np.arctan2(flanges[:, 1, 0], flanges[:, 0, 0]) / RADIAN
        first, second = (_around(angle, centre) for angle, centre in zip((first, second), self._centres, strict=True))
        joints = np.stack(
            (first, second, flanges[:, 2, 3] - self._chain.height, _around(turn - first - second, 0.0)), -1
        )
        margin = np.minimum(upper + fore - distance, distance - abs(upper - fore)) + REACH_TOLERANCE
        return joints, (margin >= 0.0) & _upright(flanges)


def _upright(frames: Array) -> Mask:
    upright: Mask = (np.hypot(frames[..., 0, 2], frames[..., 1, 2]) <= TILT_TOLERANCE) & (frames[..., 2, 2] > 0.0)
    return upright


def _turned(vector: tuple[float, float], angle: Array) -> tuple[Array, Array]:
    c, s = np.cos(angle), np.sin(angle)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


def _around(angles: Array, centre: float) -> Array:
    """Return angles, deg, normalized to within half a turn of ``centre``."""
    normalized: Array = angles - 360.0 * np.ceil((angles - centre - 180.0 - _ANGLE_NOISE) / 360.0)
    return normalized
