"""Kinematics of one arm: the flange of joints, the joints of a flange, and which of several.

Frames are 4x4 matrices in the base frame of the arm, mm. Joints are degrees; of a row of seven or eight the extra axes
have no influence.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from orinkit.arms import ArmModel
from orinkit.arms.kinematics import figures
from orinkit.arms.kinematics.chain import ARM_AXES, RADIAN, Array, Chain, joints_of
from orinkit.arms.kinematics.inverse import Mask, SphericalWrist
from orinkit.arms.kinematics.search import Search
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr

AUTOMATIC: Final = -1
"""Rule of :meth:`Kinematics.choose`: keep the figure."""
LEAST_CHANGE: Final = -2
"""Rule: the least change."""
WITHIN_LIMITS: Final = -3
"""Rule: the least change of those within the soft limits."""

WRIST_SINGULAR: Final = 0.01
"""Joint 5, deg, or the bend of the elbow, deg, below which an arm is at a singular point."""
SHOULDER_SINGULAR: Final = 0.1
"""Distance of the wrist centre from above or below joint 1, mm, below which an arm is at a singular point."""
CONDITION_SINGULAR: Final = 1e-4
"""Smallest by largest singular value of the Jacobian, lengths by the arm's reach, of an arm without wrist centre."""

_SAME: Final = 1e-6  # deg; solutions as close as this are one
_CLOSE: Final = 30.0  # deg; Newton's method is trusted to have found the nearest solution within this
_ROTATION_NOISE: Final = 1e-6


class Kinematics:
    """Forward and inverse kinematics of an arm.

    An arm whose last three axes cross in one point is solved in closed form, others by search; both give the same.

    Args:
        model: the arm.
    """

    def __init__(self, model: ArmModel) -> None:
        self.model = model
        self._chain = Chain(model)
        self._wrist = SphericalWrist(model, self._chain) if SphericalWrist.fits(self._chain) else None
        self._search = Search(model, self._chain)
        self._base = np.array(self._chain.base)
        self._home = np.array(model.home[:ARM_AXES])
        self._velocities = np.array([axis.velocity for axis in model.axes[:ARM_AXES]])

    def forward(self, joints: ArrayLike) -> Array:
        """Return the flange frame.

        Args:
            joints: (..., n >= 6) deg.

        Returns:
            (..., 4, 4), mm.

        Raises:
            CallError: E_INVALIDARG, a joint is not finite.
            ValueError: there are fewer than six.
        """
        return self._chain.forward(joints)

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return how the flange moves with each joint, in the base frame.

        Args:
            joints: (..., n >= 6) deg.

        Returns:
            (..., 6, 6): rows are x, y, z in mm per deg, then the rotation about the axes x, y, z in deg per deg;
            columns are the joints.

        Raises:
            CallError: E_INVALIDARG, a joint is not finite.
            ValueError: there are fewer than six.
        """
        return self._chain.jacobian(joints)

    def figure(self, joints: ArrayLike) -> int:
        """Return the figure, 0 to 63 (:mod:`orinkit.arms.kinematics.figures`), of joints (n >= 6,) deg.

        Raises:
            CallError: E_INVALIDARG, a joint is not finite.
            ValueError: there are fewer than six.
        """
        return figures.figure_of(self._chain, joints_of(joints).tolist())

    def inverse(self, flange: ArrayLike, figure: int, near: ArrayLike | None = None) -> Array:
        """Return the joints that hold the flange with exactly this figure.

        A solution is given whether or not it is within the soft limits; a joint that is DOUBLE must be.

        Args:
            flange: (4, 4).
            figure: 0 to 63.
            near: (n >= 6,) deg. Decides where the flange leaves joint 1 or 4 free (joint 4 is 0 without it), which of
                two turns a DOUBLE joint takes, and between solutions of one figure.

        Returns:
            (6,) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE, the flange cannot be held; FIGURE_INVALID, not with this figure;
                FIGURE_OUT_OF_RANGE, there is no such figure; E_INVALIDARG, a number is not finite or no frame.
        """
        figure = self._checked_figure(figure)
        frame = self._checked(flange)
        close = None if near is None else joints_of(near)[:ARM_AXES]
        goal = None if close is None else close.tolist()
        found = [
            turned
            for base in self._of_posture(frame, figure & figures.POSTURE, close)
            if (turned := figures.with_turns(base, figure, self.model.axes, goal)) is not None
        ]
        if not found:
            raise self._without(frame, figure)
        if len(found) == 1:
            return np.array(found[0])
        pull = self._home if close is None else close
        return np.array(min(found, key=lambda joints: (self.limits_exceeded(joints) != 0, self._change(joints, pull))))

    def solutions(self, flange: ArrayLike, near: ArrayLike | None = None) -> list[tuple[int, Array]]:
        """Return every way to hold the flange.

        Joints 1, 4 and 6 are SINGLE, and DOUBLE in addition where that is within the soft limits; nothing else looks
        at the limits.

        Args:
            flange: (4, 4).
            near: (n >= 6,) deg; where the flange leaves joint 1 or 4 free they are as in it, else 0.

        Returns:
            (figure, joints (6,) deg), ordered by figure; empty where the flange cannot be held.

        Raises:
            CallError: E_INVALIDARG, a number is not finite or no frame.
        """
        close = np.zeros(ARM_AXES) if near is None else joints_of(near)[:ARM_AXES]
        found = [
            (figures.figure_of(self._chain, joints), np.array(joints))
            for base in self._bases(self._checked(flange), close)
            for joints in figures.all_turns(base, self.model.axes)
        ]
        return sorted(found, key=lambda entry: entry[0])

    def choose(self, flange: ArrayLike, rule: int, near: ArrayLike) -> Array:
        """Return the joints that hold the flange by one of the rules for a pose without figure.

        Change is the largest of the joints' changes, each by its velocity.

        Args:
            flange: (4, 4).
            rule: :data:`AUTOMATIC` keeps the figure of ``near`` where it exists within the soft limits, and else is as
                -3; where joint 5 is 0 in ``near``, FLIP and NONFLIP are both its figure. :data:`LEAST_CHANGE` is the solution with the least change from ``near``. :data:`WITHIN_LIMITS` is
                that with the least change of those within the soft limits; if none is, of all. 0 to 63 is a figure,
                as for :meth:`inverse`.
            near: (n >= 6,) deg.

        Returns:
            (6,) deg.

        Raises:
            CallError: as :meth:`inverse`.
        """
        close = joints_of(near)[:ARM_AXES]
        if not WITHIN_LIMITS <= rule < 0:
            return self.inverse(flange, rule, close)
        if rule == AUTOMATIC:
            kept = self._kept(flange, close)
            if kept is not None:
                return kept
        found = [joints for _, joints in self.solutions(flange, close)]
        if not found:
            raise _unreachable()
        if rule != LEAST_CHANGE:
            found = [joints for joints in found if not self.limits_exceeded(joints)] or found
        return min(found, key=lambda joints: self._change(joints, close))

    def follow(self, flanges: ArrayLike, start: ArrayLike) -> Array:
        """Return joints along a continuous path, each row the solution nearest to the row before.

        Shoulder and elbow stay as they are at the start. The wrist may pass through joint 5 = 0, so that FLIP changes,
        where the other way would be a half turn of joint 4. Joints may go beyond a half turn. Near a singular point
        rows may be far apart although the flanges are not; soft limits are not looked at. Both are for the caller.

        Args:
            flanges: (N, 4, 4).
            start: (n >= 6,) deg, the joints before the first row; they are the first row if they hold its flange.

        Returns:
            (N, 6) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE, a flange cannot be held, the detail says which row, counted from 0;
                E_INVALIDARG, a number is not finite or no frame.
        """
        frames = _finite_frames(flanges)
        if frames.ndim != 3:
            raise ValueError(tr("a path is (N, 4, 4), not {shape}", shape=frames.shape))
        first = joints_of(start)[:ARM_AXES]
        if not len(frames):
            return np.empty((0, ARM_AXES))
        near = self._in_reach(frames)
        count = len(frames) if near.all() else int(np.argmin(near))
        joints, reached = (self._wrist or self._search).follow(frames[:count], first)
        if not reached.all():
            raise _unreachable(int(np.argmin(reached)))
        if count < len(frames):
            raise _unreachable(count)
        return joints

    def limits_exceeded(self, joints: ArrayLike) -> int:
        """Return the axes outside their soft limits as bits, J1 is bit 0; extra axes count where ``joints`` has them.

        Up to :data:`orinkit.arms.kinematics.figures.LIMIT_TOLERANCE` beyond a limit is within it.

        Raises:
            CallError: E_INVALIDARG, a joint is not finite.
            ValueError: there are fewer than six.
        """
        exceeded = 0
        for index, (value, axis) in enumerate(zip(joints_of(joints).tolist(), self.model.axes, strict=False)):
            if not figures.within(value, axis):
                exceeded |= 1 << index
        return exceeded

    def is_singular(self, joints: ArrayLike) -> bool:
        """Return whether the arm is at a singular point, or so close that a path through it would be a jump.

        With a wrist centre: joint 5 or the bend of the elbow within :data:`WRIST_SINGULAR` of 0 or 180 deg, or the
        wrist centre within :data:`SHOULDER_SINGULAR` above or below joint 1. Without: the Jacobian is near singular
        (:data:`CONDITION_SINGULAR`).

        Raises:
            CallError: E_INVALIDARG, a joint is not finite.
            ValueError: there are fewer than six.
        """
        values = joints_of(joints)
        if self._wrist is None:
            jacobian = self._chain.jacobian(values)
            jacobian[:3] /= self._chain.reach * RADIAN
            sizes = np.linalg.svd(jacobian, compute_uv=False)
            return bool(sizes[-1] < CONDITION_SINGULAR * sizes[0])
        angles: list[float] = values.tolist()
        least = math.sin(WRIST_SINGULAR * RADIAN)
        bend = angles[2] - figures.stretched(self._chain)
        if abs(math.sin(angles[4] * RADIAN)) < least or abs(math.sin(bend * RADIAN)) < least:
            return True
        return abs(figures.wrist_ahead(self._chain, angles)) < SHOULDER_SINGULAR

    def _checked_figure(self, figure: int) -> int:
        bits = figure
        if self._wrist is None and figure >= 0:
            bits &= ~figures.COBOTTA_BIT
        if not 0 <= bits <= figures.HIGHEST:
            raise error_for(
                hresult.FIGURE_OUT_OF_RANGE,
                tr("the figure must be -3 to 63"),
            )
        return bits

    def _checked(self, flange: ArrayLike) -> Array:
        frame = _finite_frames(flange)
        if frame.ndim != 2:
            raise ValueError(tr("a flange is (4, 4), not {shape}", shape=frame.shape))
        return frame

    def _in_reach(self, frames: Array) -> Mask:
        near: Mask = np.abs(frames[..., :3, 3] - self._base).max(axis=-1) <= self._chain.reach + 1.0
        return near

    def _of_posture(self, frame: Array, posture: int, near: Array | None) -> Iterator[list[float]]:
        """Return the solutions of one posture, J1, J4, J6 SINGLE."""
        if not self._in_reach(frame):
            return
        if self._wrist is not None:
            joints, reached = self._wrist.branch(frame, posture, np.zeros(ARM_AXES) if near is None else near)
            if reached:
                yield joints.tolist()
            return
        if near is not None:
            found = self._close_by(frame, near)
            if found is not None and figures.figure_of(self._chain, found) & figures.POSTURE == posture:
                yield found
                return
        for base in self._bases(frame, self._home):
            if figures.figure_of(self._chain, base) & figures.POSTURE == posture:
                yield base

    def _close_by(self, frame: Array, near: Array) -> list[float] | None:
        found = self._search.newton(frame, near)
        if found is None or np.abs(found - near).max() > _CLOSE:
            return None
        joints: list[float] = found.tolist()
        for index, _ in figures.DOUBLE_BITS:
            joints[index] = figures.single(joints[index])
        return joints

    def _bases(self, frame: Array, near: Array) -> list[list[float]]:
        """Return all distinct solutions, J1, J4, J6 SINGLE."""
        if not self._in_reach(frame):
            return []
        if self._wrist is None:
            close = self._close_by(frame, near)
            found = self._search.solutions(frame[None])[0].tolist() + ([close] if close else [])
        else:
            joints, reached = self._wrist.branch(frame, np.arange(figures.POSTURE + 1), near)
            found = joints[reached].tolist()
        distinct: list[list[float]] = []
        for one in found:
            if all(max(abs(a - b) for a, b in zip(one, other, strict=True)) > _SAME for other in distinct):
                distinct.append(one)
        return distinct

    def _kept(self, flange: ArrayLike, near: Array) -> Array | None:
        """Return the solution with the figure of ``near``, None where there is none within the limits."""
        figure = self.figure(near)
        same = [figure, figure ^ figures.NONFLIP] if figures.is_straight(near.tolist()) else [figure]
        kept = []
        for one in same:
            try:
                kept.append(self.inverse(flange, one, near))
            except CallError as error:
                if error.code != hresult.FIGURE_INVALID:
                    raise
        kept = [joints for joints in kept if not self.limits_exceeded(joints)]
        return min(kept, key=lambda joints: self._change(joints, near)) if kept else None

    def _change(self, joints: ArrayLike, near: Array) -> float:
        return float(np.max(np.abs(np.asarray(joints, dtype=np.float64) - near) / self._velocities))

    def _without(self, frame: Array, figure: int) -> CallError:
        existing = sorted({found for found, _ in self.solutions(frame)})
        if not existing:
            return _unreachable()
        names = ", ".join(map(str, existing))
        return error_for(
            hresult.FIGURE_INVALID,
            tr("figure {figure} does not exist at this pose; those that do: {names}", figure=figure, names=names),
        )


def _finite_frames(flanges: ArrayLike) -> Array:
    frames = np.asarray(flanges, dtype=np.float64)
    if frames.ndim < 2 or frames.shape[-2:] != (4, 4):
        raise ValueError(tr("a frame is (4, 4), not {shape}", shape=frames.shape))
    rotations = frames[..., :3, :3]
    if not np.isfinite(frames).all() or (rotations.size and np.abs(rotations).max() > 1.0 + _ROTATION_NOISE):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("a flange is not a frame of finite numbers"),
        )
    return frames


def _unreachable(row: int | None = None) -> CallError:
    if row is None:
        return error_for(hresult.OUT_OF_WORKING_RANGE)
    return error_for(
        hresult.OUT_OF_WORKING_RANGE,
        tr("row {row} of the path (counted from 0)", row=row),
    )
