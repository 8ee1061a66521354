"""Inverse kinematics, figures and singular points of six-axis arms: closed form or search, whichever fits the arm."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from orinkit.arms import ArmModel
from orinkit.arms.kinematics import figures
from orinkit.arms.kinematics.arm_solver import ArmSolver
from orinkit.arms.kinematics.chain import ARM_AXES, RADIAN, Array, Chain
from orinkit.arms.kinematics.inverse import Mask, SphericalWrist
from orinkit.arms.kinematics.search import Search

WRIST_SINGULAR: Final = 0.01
"""Absolute value of joint 5 or of the bend of the elbow, deg, below which an arm is at a singular point.

The bend of the elbow is the difference between joint 3 and its value at full stretch.
"""
SHOULDER_SINGULAR: Final = 0.1
"""Absolute x coordinate of the wrist centre in the frame of joint 1, mm, below which an arm is at a singular point."""
CONDITION_SINGULAR: Final = 1e-4
"""Limit for an arm whose last three axes do not intersect at one point. The arm is at a singular point if the ratio of
the smallest to the largest singular value of the Jacobian, with lengths divided by the arm's reach, is below this."""

_SAME: Final = 1e-6  # deg; closer solutions count as one
_CLOSE: Final = 30.0  # deg; a solution of Newton's method that is closer than this counts as the nearest one


class SixAxisSolver(ArmSolver):
    """The solver of one six-axis arm.

    Args:
        model: The arm model.
    """

    posture_bits = figures.POSTURE
    double_bits = figures.DOUBLE_BITS

    def __init__(self, model: ArmModel) -> None:
        self._chain = Chain(model)
        self._wrist = SphericalWrist(model, self._chain) if SphericalWrist.fits(self._chain) else None
        self._search = Search(model, self._chain)
        self._base = np.array(self._chain.base)
        self._home = np.array(model.home[:ARM_AXES])

    @property
    def chain(self) -> Chain:
        """The frames of the arm."""
        return self._chain

    def figure_of(self, joints: Sequence[float]) -> int:
        """Return the figure, 0 to 63, of joints in deg."""
        return figures.figure_of(self._chain, joints)

    def known_bits(self, figure: int) -> int | None:
        """Return a figure without the bit that a COBOTTA adds; ``None`` if there is no such figure."""
        bits = figure & ~figures.COBOTTA_BIT if self._wrist is None and figure >= 0 else figure
        return bits if 0 <= bits <= figures.HIGHEST else None

    def path_bits(self, joints: Sequence[float]) -> int:
        """Return the bits of the figure that a path which begins or ends at these joints cannot change."""
        return figures.POSTURE & ~figures.NONFLIP if figures.is_wrist_straight(joints) else figures.POSTURE

    def equal_figures(self, figure: int, joints: Sequence[float]) -> list[int]:
        """Return the figures that count as the figure of these joints: with joint 5 at 0, FLIP and NONFLIP are equal."""
        return [figure, figure ^ figures.NONFLIP] if figures.is_wrist_straight(joints) else [figure]

    def of_posture(self, frame: Array, posture: int, near: Array | None) -> Iterator[list[float]]:
        """Yield the solutions of one posture, with J1, J4, J6 SINGLE."""
        if not self._in_reach(frame):
            return
        if self._wrist is not None:
            joints, reached = self._wrist.branch(frame, posture, np.zeros(ARM_AXES) if near is None else near)
            if reached:
                yield joints.tolist()
            return
        if near is not None:
            found = self._newton_near(frame, near)
            if found is not None and figures.figure_of(self._chain, found) & figures.POSTURE == posture:
                yield found
                return
        for base in self.bases(frame, self._home):
            if figures.figure_of(self._chain, base) & figures.POSTURE == posture:
                yield base

    def bases(self, frame: Array, near: Array) -> list[list[float]]:
        """Return all distinct solutions, with J1, J4, J6 SINGLE."""
        if not self._in_reach(frame):
            return []
        if self._wrist is None:
            close = self._newton_near(frame, near)
            found = self._search.solutions(frame[None])[0].tolist() + ([close] if close else [])
        else:
            joints, reached = self._wrist.branch(frame, np.arange(figures.POSTURE + 1), near)
            found = joints[reached].tolist()
        distinct: list[list[float]] = []
        for one in found:
            if all(max(abs(a - b) for a, b in zip(one, other, strict=True)) > _SAME for other in distinct):
                distinct.append(one)
        return distinct

    def follow(self, flanges: Array, start: Array) -> tuple[Array, Mask]:
        """Return joints (N, 6), deg, along a path, each row nearest to the previous one; and which rows are in reach."""
        near = self._in_reach(flanges)
        count = len(flanges) if near.all() else int(np.argmin(near))
        joints, reached = (self._wrist or self._search).follow(flanges[:count], start)
        if count == len(flanges):
            return joints, reached
        missing = np.full((len(flanges) - count, ARM_AXES), np.nan)
        return np.vstack((joints, missing)), np.append(reached, np.zeros(len(missing), dtype=np.bool_))

    def is_singular(self, values: Array) -> bool:
        """Return True at a singular point or close to one."""
        if self._wrist is None:
            jacobian = self._chain.jacobian(values)
            jacobian[:3] /= self._chain.reach * RADIAN
            sizes = np.linalg.svd(jacobian, compute_uv=False)
            return bool(sizes[-1] < CONDITION_SINGULAR * sizes[0])
        angles: list[float] = values.tolist()
        least = math.sin(WRIST_SINGULAR * RADIAN)
        bend = angles[2] - figures.stretched_elbow(self._chain)
        if abs(math.sin(angles[4] * RADIAN)) < least or abs(math.sin(bend * RADIAN)) < least:
            return True
        return abs(figures.wrist_distance(self._chain, angles)) < SHOULDER_SINGULAR

    def _newton_near(self, frame: Array, near: Array) -> list[float] | None:
        found = self._search.newton(frame, near)
        if found is None or np.abs(found - near).max() > _CLOSE:
            return None
        joints: list[float] = found.tolist()
        for index, _ in figures.DOUBLE_BITS:
            joints[index] = figures.normalize_angle(joints[index])
        return joints

    def _in_reach(self, frames: Array) -> Mask:
        near: Mask = np.abs(frames[..., :3, 3] - self._base).max(axis=-1) <= self._chain.reach + 1.0
        return near
