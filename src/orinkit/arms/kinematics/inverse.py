"""Inverse kinematics in closed form.

:class:`ArmGeometry` solves joints 1 to 3 for the wrist centre. :class:`SphericalWrist` solves all joints of an arm
whose last three axes intersect at one point. All functions accept any number of flange frames in one call.
:class:`ArmGeometry` uses radians; :class:`SphericalWrist` returns joints in degrees.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from orinkit.arms import ArmModel
from orinkit.arms.kinematics.chain import RADIAN, Array, Chain
from orinkit.arms.kinematics.figures import BELOW, LEFTY, NONFLIP, figure_of, normalize_around, turn_centres
from orinkit.core.record import record

Mask = NDArray[np.bool_]

REACH_TOLERANCE: Final = 1e-7
"""Distance in mm: a wrist centre outside the reach by up to this distance is moved to the boundary of the reach."""

_WRIST_SINGULAR: Final = 1e-10  # sine of joint 5 below which joint 4 is undetermined
_SHOULDER_SINGULAR: Final = 1e-7  # mm from the axis of joint 1 below which joint 1 is undetermined
_STEP_NOISE: Final = 1e-6  # deg


@record
class ArmGeometry:
    """Lengths and angles of the arm up to the wrist centre; its methods compute joints 1 to 3 from the wrist centre.

    Attributes:
        chain: The frames of the arm.
        lateral: Y coordinate of the wrist centre in the frame of joint 1, mm.
        upper: Length of the upper arm (joint 2 to joint 3), mm.
        upper_angle: Angle of the upper arm from the vertical when all joints are zero, rad.
        fore: Length of the forearm (joint 3 to the wrist centre), mm.
        fore_angle: Angle of the forearm from the vertical when all joints are zero, rad.
    """

    chain: Chain
    lateral: float
    upper: float
    upper_angle: float
    fore: float
    fore_angle: float

    @classmethod
    def of(cls, chain: Chain) -> ArmGeometry:
        """Return the geometry of a chain."""
        x, z = chain.fore[0], chain.fore[2] + chain.wrist[2]
        return cls(
            chain,
            chain.shoulder[1] + chain.upper[1] + chain.fore[1],
            math.hypot(chain.upper[0], chain.upper[2]),
            math.atan2(chain.upper[0], chain.upper[2]),
            math.hypot(x, z),
            math.atan2(x, z),
        )

    def shoulder(self, x: Array, y: Array, lefty: Mask) -> tuple[Array, Array, Array, Mask]:
        """Solve joint 1 so that joints 2 and 3 can move the wrist centre to a position.

        Args:
            x: X of the wrist centre in the base frame, relative to the origin of joint 1, mm.
            y: Y of the wrist centre in the base frame, relative to the origin of joint 1, mm.
            lefty: True if the wrist centre must be on the +X side of the frame of joint 1.

        Returns:
            Joint 1, rad; the x coordinate of the wrist centre in the frame of joint 1, mm; the distance of the wrist
            centre from the boundary of the reach, mm, negative if it is out of reach; a mask, False if joint 1 is
            undetermined.
        """
        distance = np.hypot(x, y)
        inner = (distance - self.lateral) * (distance + self.lateral)
        forward = np.sqrt(np.maximum(inner, 0.0))
        forward = np.where(lefty, forward, -forward)
        first = np.arctan2(y, x) - np.arctan2(self.lateral, forward)
        margin = distance - (abs(self.lateral) - REACH_TOLERANCE)
        return first, forward, margin, distance >= _SHOULDER_SINGULAR

    def elbow(self, forward: Array, up: Array, positive: Mask) -> tuple[Array, Array, Array]:
        """Solve joints 2 and 3 for a wrist centre, after joint 1 has been solved.

        Args:
            forward: X coordinate of the wrist centre in the frame of joint 1, mm.
            up: Height of the wrist centre above the origin of joint 1, mm.
            positive: Side to which the elbow bends: True if joint 3 is greater than at full stretch.

        Returns:
            Joint 2, rad; the sum of joints 2 and 3, rad; the distance of the wrist centre from the boundary of the
            reach, mm, negative if it is out of reach.
        """
        u, w = forward - self.chain.shoulder[0], up - self.chain.shoulder[2]
        distance = np.hypot(u, w)
        upper, fore = self.upper, self.fore
        cosine = (distance * distance - (upper * upper + fore * fore)) / (2.0 * upper * fore)
        bend = np.arccos(np.clip(cosine, -1.0, 1.0))
        bend = np.where(positive, bend, -bend)
        total = self.upper_angle + bend
        second = np.arctan2(u, w) - np.arctan2(
            upper * math.sin(self.upper_angle) + fore * np.sin(total),
            upper * math.cos(self.upper_angle) + fore * np.cos(total),
        )
        margin = np.minimum(upper + fore - distance, distance - abs(upper - fore)) + REACH_TOLERANCE
        return second, second + total - self.fore_angle, margin


class InverseSolver:
    """Base of the two solvers of the inverse kinematics.

    Args:
        model: The arm model.
        chain: The frames of the arm.
    """

    def __init__(self, model: ArmModel, chain: Chain) -> None:
        self._chain = chain
        self._arm = ArmGeometry.of(chain)
        self._centres = turn_centres(model)
        self._base = np.array(chain.base)


class SphericalWrist(InverseSolver):
    """Closed-form solution for an arm whose axes 4, 5 and 6 intersect at the wrist centre."""

    @staticmethod
    def fits(chain: Chain) -> bool:
        """Return True if the axes of joints 4, 5 and 6 intersect at one point."""
        return chain.wrist[0] == 0.0 and chain.flange[0] == 0.0 and abs(chain.flange[1]) < 1e-12

    def branch(self, flanges: Array, posture: int | NDArray[np.int_], near: Array) -> tuple[Array, Mask]:
        """Return, for each flange frame, the joints with which the arm reaches it in one posture.

        Args:
            flanges: The flange frames, (..., 4, 4), mm.
            posture: Bits 0 to 2 of a figure; its shape broadcasts with that of ``flanges``.
            near: (..., n >= 6) deg; joints 1 and 4 are taken from it if the flange does not determine them.

        Returns:
            Joints (..., 6), deg, with J1, J4, J6 SINGLE (-180 < angle <= 180); and a mask (...), False for flanges
            out of reach.
        """
        bits = np.asarray(posture)
        lefty, below, nonflip = (bits & LEFTY) != 0, (bits & BELOW) != 0, (bits & NONFLIP) != 0
        near = near * RADIAN
        x, y, z = self._wrist_centre(flanges)
        first, forward, beside, determined = self._arm.shoulder(x, y, lefty)
        first = np.where(determined, first, near[..., 0])
        second, both, reached = self._arm.elbow(forward, z, lefty != below)
        columns = flange_in_forearm(flanges, first, both)
        fourth, determined = _fourth(columns, nonflip == lefty)
        fourth = np.where(determined, fourth, near[..., 3])
        fifth, sixth = _fifth_and_sixth(columns, fourth)
        return self._degrees(first, second, both, fourth, fifth, sixth), np.minimum(beside, reached) >= 0.0

    def follow(self, flanges: Array, start: Array) -> tuple[Array, Mask]:
        """Return joints along a path: each row is the solution nearest to the previous row.

        The bits LEFTY and BELOW of the figure stay unchanged. The wrist passes through joint 5 = 0, so that FLIP
        changes, if the joints then change less. If the flange does not determine joint 1 or 4, the joint has the same
        value as in the previous row.

        Args:
            flanges: The flange frames along the path, (N, 4, 4), mm.
            start: (6,) deg, the joints before the first row.

        Returns:
            Joints (N, 6), deg, beyond 180 deg if the path leads there; and a mask (N,), False for flanges out of reach.
        """
        figure = figure_of(self._chain, start.tolist())
        lefty, below = (np.asarray(figure & bit != 0) for bit in (LEFTY, BELOW))
        x, y, z = self._wrist_centre(flanges)
        first, forward, beside, determined = self._arm.shoulder(x, y, lefty)
        first = _hold_undetermined(first, determined, start[0] * RADIAN)
        second, both, reached = self._arm.elbow(forward, z, lefty != below)
        columns = flange_in_forearm(flanges, first, both)
        fourth, determined = _fourth(columns, np.asarray(start[4] >= 0.0))
        fourth = _hold_undetermined(fourth, determined, start[3] * RADIAN)
        fifth, sixth = _fifth_and_sixth(columns, fourth)
        joints = np.vstack((start, np.stack((first, second, both - second, fourth, fifth, sixth), -1) / RADIAN))
        _pass_wrist(joints)
        turns = np.cumsum(np.round(np.diff(joints, axis=0) / 360.0), axis=0)
        return joints[1:] - 360.0 * turns, np.minimum(beside, reached) >= 0.0

    def _wrist_centre(self, flanges: Array) -> tuple[Array, Array, Array]:
        centre = flanges[..., :3, 3] - self._base - self._chain.flange[2] * flanges[..., :3, 2]
        return centre[..., 0], centre[..., 1], centre[..., 2]

    def _degrees(self, first: Array, second: Array, both: Array, fourth: Array, fifth: Array, sixth: Array) -> Array:
        joints = np.stack(np.broadcast_arrays(first, second, both - second, fourth, fifth, sixth), -1) / RADIAN
        return normalize_around(joints, self._centres)


def flange_in_forearm(flanges: Array, joint1: Array, joint23: Array) -> tuple[Array, Array, Array]:
    """Return the columns (..., 3) of the flange's rotation matrix in the frame of joint 3.

    Args:
        flanges: Matrices (..., >= 3, >= 3) whose upper left 3x3 part is the rotation matrix of the flange.
        joint1: Joint 1, rad.
        joint23: The sum of joints 2 and 3, rad.
    """
    c1, s1, c23, s23 = np.cos(joint1), np.sin(joint1), np.cos(joint23), np.sin(joint23)
    columns = []
    for index in range(3):
        x, y, z = flanges[..., 0, index], flanges[..., 1, index], flanges[..., 2, index]
        ahead = c1 * x + s1 * y
        columns.append(np.stack(np.broadcast_arrays(c23 * ahead - s23 * z, c1 * y - s1 * x, s23 * ahead + c23 * z), -1))
    return columns[0], columns[1], columns[2]


def _fourth(columns: tuple[Array, Array, Array], positive: Mask) -> tuple[Array, Mask]:
    """Return joint 4 for a positive or negative joint 5, and a mask that is False if joint 4 is undetermined."""
    x, y = columns[2][..., 0], columns[2][..., 1]
    sign = np.where(positive, 1.0, -1.0)
    return np.arctan2(sign * y, sign * x), np.hypot(x, y) >= _WRIST_SINGULAR


def _fifth_and_sixth(columns: tuple[Array, Array, Array], fourth: Array) -> tuple[Array, Array]:
    """Return joints 5 and 6 for a given joint 4.

    Near joint 5 = 0, joint 4 has a large rounding error. Joints 5 and 6 compensate for it, so that the flange is exact.
    """
    c4, s4 = np.cos(fourth), np.sin(fourth)
    x, y, z = columns
    fifth = np.arctan2(c4 * z[..., 0] + s4 * z[..., 1], z[..., 2])
    return fifth, np.arctan2(c4 * x[..., 1] - s4 * x[..., 0], c4 * y[..., 1] - s4 * y[..., 0])


def _hold_undetermined(angles: Array, determined: Mask, start: float) -> Array:
    """Return angles (N,); an undetermined angle is replaced by the last determined angle before it, or by ``start``."""
    last = np.maximum.accumulate(np.where(determined, np.arange(len(angles)), -1))
    return np.where(last >= 0, angles[last], start)


def _pass_wrist(joints: Array) -> None:
    """Change the sign of joint 5 in the rows of joints (N, 6), deg, that are then nearer to the previous row.

    Joints 4 and 6 of such a row are turned by 180 deg, so that the flange frame is the same.
    """
    step = np.diff(joints[:, 3:], axis=0)
    other = np.stack((step[:, 0] + 180.0, joints[1:, 4] + joints[:-1, 4], step[:, 2] + 180.0), -1)
    passing = _largest_turn(other) < _largest_turn(step) - _STEP_NOISE
    rows = 1 + np.flatnonzero(np.cumsum(passing) % 2)
    joints[rows, 4] *= -1.0
    joints[rows, 3] += 180.0
    joints[rows, 5] += 180.0


def _largest_turn(angles: Array) -> Array:
    largest: Array = np.abs(angles - 360.0 * np.round(angles / 360.0)).max(axis=-1)
    return largest
