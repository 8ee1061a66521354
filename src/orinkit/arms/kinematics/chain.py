"""Forward kinematics: the chain of a six-axis arm, and its Jacobian. The chain of a SCARA is in ``scara``.

A single pose is computed in plain Python, several in numpy; both use the same formulas.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Array)

RADIAN: Final = math.pi / 180.0  # radians per degree
ARM_AXES: Final = 6


class Chain:
    """The coordinate frames of a model's six axes.

    The axes of joints 2 and 3 are parallel, so these joints move the arm parallel to the x-z plane of the frame of
    joint 1. Positions are computed in this frame and then rotated by joint 1. The y offset of joint 5 is along the axis
    of joint 5; therefore it is added to the offset of joint 6.

    Attributes:
        base: Origin of joint 1 in the base frame of the arm, mm.
        shoulder: Origin of joint 2 in the frame of joint 1, mm.
        upper: Origin of joint 3 in the frame of joint 2, mm.
        fore: Origin of joint 4 in the frame of joint 3, mm.
        wrist: Origin of joint 5 in the frame of joint 4, mm; its y is 0.
        flange: Origin of joint 6 in the frame of joint 5, mm.
        reach: Upper bound of the distance of the flange from ``base``, mm.
    """

    def __init__(self, model: ArmModel) -> None:
        self.base, self.shoulder, self.upper, self.fore, wrist, flange = model.origins
        self.wrist = (wrist[0], 0.0, wrist[2])
        self.flange = (flange[0], flange[1] + wrist[1], flange[2])
        self.reach = sum(
            math.dist(origin, (0.0, 0.0, 0.0))
            for origin in (self.shoulder, self.upper, self.fore, self.wrist, self.flange)
        )

    def forward(self, joints: ArrayLike) -> Array:
        """Return the flange frame in the base frame; see :meth:`orinkit.arms.kinematics.solver.Kinematics.forward`.

        Joints after the sixth have no influence.
        """
        values = joints_of(joints)
        if values.ndim == 1:
            cosines, sines = _cosines_and_sines(values)
            a, b, c, x, d, e, f, y, g, h, i, z = self._flange_rows(cosines, sines)
            return np.array(((a, b, c, x), (d, e, f, y), (g, h, i, z), (0.0, 0.0, 0.0, 1.0)))
        frames = np.empty((*values.shape[:-1], 4, 4))
        frames[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
        for index, entry in enumerate(self._flange_rows(*_cosines_and_sines_of_many(values))):
            frames[..., index // 4, index % 4] = entry
        return frames

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return the Jacobian of the flange in the base frame.

        See :meth:`orinkit.arms.kinematics.solver.Kinematics.jacobian`.
        """
        values = joints_of(joints)
        if values.ndim == 1:
            result = np.array(self._jacobian_entries(*_cosines_and_sines(values))).reshape(ARM_AXES, 6).T
        else:
            entries = self._jacobian_entries(*_cosines_and_sines_of_many(values))
            result = np.empty((*values.shape[:-1], 6, ARM_AXES))
            for index, entry in enumerate(entries):
                result[..., index % 6, index // 6] = entry
        result[..., :3, :] *= RADIAN
        return result

    def _flange_rows(self, c: Sequence[Number], s: Sequence[Number]) -> tuple[Number, ...]:
        """Return the upper three rows of the flange frame, as one tuple, from the cosines and sines of the joints."""
        c1, c2, c3, c4, c5, c6 = c
        s1, s2, s3, s4, s5, s6 = s
        c23, s23 = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        x, y, z = self._plane_point(c2, s2, c23, s23, *self._on_forearm(c4, s4, c5, s5))
        # Rz(J4) Ry(J5) Rz(J6), by rows
        c45, s45 = c4 * c5, s4 * c5
        xx, xy, xz = c45 * c6 - s4 * s6, -c45 * s6 - s4 * c6, c4 * s5
        yx, yy, yz = s45 * c6 + c4 * s6, c4 * c6 - s45 * s6, s4 * s5
        zx, zy, zz = -s5 * c6, s5 * s6, c5
        ux, uy, uz = c23 * xx + s23 * zx, c23 * xy + s23 * zy, c23 * xz + s23 * zz
        return (
            c1 * ux - s1 * yx,
            c1 * uy - s1 * yy,
            c1 * uz - s1 * yz,
            c1 * x - s1 * y + self.base[0],
            s1 * ux + c1 * yx,
            s1 * uy + c1 * yy,
            s1 * uz + c1 * yz,
            s1 * x + c1 * y + self.base[1],
            c23 * zx - s23 * xx,
            c23 * zy - s23 * xy,
            c23 * zz - s23 * xz,
            z + self.base[2],
        )

    def _jacobian_entries(self, c: Sequence[Number], s: Sequence[Number]) -> tuple[Number, ...]:
        """Return the translation and rotation of the flange per radian of each joint, in the order of the joints."""
        c1, c2, c3, c4, c5, _ = c
        s1, s2, s3, s4, s5, _ = s
        c23, s23 = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        fx, fy, fz = self._on_forearm(c4, s4, c5, s5)
        px, py, pz = self._plane_point(c2, s2, c23, s23, fx, fy, fz)
        elbow_x = self.shoulder[0] + c2 * self.upper[0] + s2 * self.upper[2]
        elbow_z = self.shoulder[2] - s2 * self.upper[0] + c2 * self.upper[2]
        zero, one = 0.0 * c1, 0.0 * c1 + 1.0
        columns: list[tuple[Number, ...]] = [
            (-py, px, zero, zero, zero, one),
            (pz - self.shoulder[2], zero, self.shoulder[0] - px, zero, one, zero),
            (pz - elbow_z, zero, elbow_x - px, zero, one, zero),
        ]
        # joints 4, 5 and 6: axes and origins in the frame of joint 3
        wrist_x, _, wrist_z = self.wrist
        for ax, ay, az, ox, oy, oz in (
            (zero, zero, one, self.fore[0] + zero, self.fore[1] + zero, self.fore[2] + zero),
            (-s4, c4, zero, self.fore[0] + c4 * wrist_x, self.fore[1] + s4 * wrist_x, self.fore[2] + wrist_z + zero),
            (c4 * s5, s4 * s5, c5, fx, fy, fz),
        ):
            dx, dy, dz = fx - ox, fy - oy, fz - oz
            vx, vy, vz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
            columns.append((c23 * vx + s23 * vz, vy, c23 * vz - s23 * vx, c23 * ax + s23 * az, ay, c23 * az - s23 * ax))
        turned: list[Number] = []
        for vx, vy, vz, ax, ay, az in columns:
            turned += (c1 * vx - s1 * vy, s1 * vx + c1 * vy, vz, c1 * ax - s1 * ay, s1 * ax + c1 * ay, az)
        return tuple(turned)

    def _on_forearm(self, c4: Number, s4: Number, c5: Number, s5: Number) -> tuple[Number, Number, Number]:
        """Return the origin of the flange in the frame of joint 3."""
        x6, y6, z6 = self.flange
        x = self.wrist[0] + c5 * x6 + s5 * z6
        z = self.wrist[2] - s5 * x6 + c5 * z6
        return self.fore[0] + c4 * x - s4 * y6, self.fore[1] + s4 * x + c4 * y6, self.fore[2] + z

    def _plane_point(
        self, c2: Number, s2: Number, c23: Number, s23: Number, x: Number, y: Number, z: Number
    ) -> tuple[Number, Number, Number]:
        """Transform a point from the frame of joint 3 to the frame of joint 1."""
        shoulder, upper = self.shoulder, self.upper
        return (
            shoulder[0] + c2 * upper[0] + s2 * upper[2] + c23 * x + s23 * z,
            shoulder[1] + upper[1] + y,
            shoulder[2] - s2 * upper[0] + c2 * upper[2] - s23 * x + c23 * z,
        )


def joints_of(joints: ArrayLike, fewest: int = ARM_AXES) -> Array:
    """Return joint positions as an array (..., n), n >= ``fewest``, after checking them.

    Raises:
        CallError: E_INVALIDARG if a joint is not finite.
        ValueError: If there are fewer joints.
    """
    values = np.asarray(joints, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] < fewest:
        raise ValueError(
            tr("the shape must be (..., n) with n of {fewest} or more, not {shape}", fewest=fewest, shape=values.shape)
        )
    if not np.isfinite(values).all():
        raise error_for(hresult.E_INVALIDARG, tr("a joint is not a finite number"))
    return values


def _cosines_and_sines(joints: Array) -> tuple[list[float], list[float]]:
    angles = [value * RADIAN for value in joints.tolist()[:ARM_AXES]]
    return [math.cos(angle) for angle in angles], [math.sin(angle) for angle in angles]


def _cosines_and_sines_of_many(joints: Array) -> tuple[Sequence[Array], Sequence[Array]]:
    angles = np.moveaxis(joints[..., :ARM_AXES], -1, 0) * RADIAN
    return tuple(np.cos(angles)), tuple(np.sin(angles))
