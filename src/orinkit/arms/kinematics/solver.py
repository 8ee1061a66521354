"""Kinematics of one arm: forward, inverse, and the choice between several solutions.

Frames are 4x4 matrices in the base frame of the arm, mm. Joints are in degrees; the seventh and eighth have no
influence.
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
"""Rule of :meth:`Kinematics.choose`: keep the figure of ``near`` if possible."""
LEAST_CHANGE: Final = -2
"""Rule of :meth:`Kinematics.choose`: select the solution with the least change from ``near``."""
WITHIN_LIMITS: Final = -3
"""Rule of :meth:`Kinematics.choose`: select the solution within the soft limits with the least change."""

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
_ROTATION_NOISE: Final = 1e-6


class Kinematics:
    """Forward and inverse kinematics of an arm.

    An arm whose last three axes intersect at one point is solved in closed form, other arms by numeric search. The
    results have the same meaning in both cases.

    Args:
        model: The arm model.
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
            The frames, (..., 4, 4), mm.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer than six joints.
        """
        return self._chain.forward(joints)

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return the Jacobian of the flange in the base frame.

        Args:
            joints: (..., n >= 6) deg.

        Returns:
            The Jacobian, (..., 6, 6): rows are x, y, z in mm per deg, then the rotation about the axes x, y, z in deg
            per deg; columns are the joints.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer than six joints.
        """
        return self._chain.jacobian(joints)

    def figure(self, joints: ArrayLike) -> int:
        """Return the figure, 0 to 63 (:mod:`orinkit.arms.kinematics.figures`), of joints (n >= 6,) deg.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer than six joints.
        """
        return figures.figure_of(self._chain, joints_of(joints).tolist())

    def inverse(self, flange: ArrayLike, figure: int, near: ArrayLike | None = None) -> Array:
        """Return the joints with which the flange reaches a frame and the arm has exactly the figure ``figure``.

        The solution may be outside the soft limits; only the joints that the figure makes DOUBLE are within them.

        Args:
            flange: The frame, (4, 4), mm.
            figure: 0 to 63.
            near: (n >= 6,) deg. If the flange does not determine joint 1 or 4, this joint is taken from ``near``;
                without ``near``, it is 0. If two angles are possible for a DOUBLE joint, the one nearer to ``near`` is
                used; without ``near``, the one nearer to 0. If several solutions have the figure, those within the soft
                limits are preferred, and of these the one nearest to ``near``; without ``near``, the one nearest to the
                home position.

        Returns:
            The joints, (6,) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE if the flange is out of reach; FIGURE_INVALID if it cannot be reached with
                this figure; FIGURE_OUT_OF_RANGE if there is no such figure; E_INVALIDARG if a number is not finite or
                the matrix is not a frame.
        """
        figure = self._checked_figure(figure)
        frame = self._checked_frame(flange)
        close = None if near is None else joints_of(near)[:ARM_AXES]
        goal = None if close is None else close.tolist()
        found = [
            turned
            for base in self._of_posture(frame, figure & figures.POSTURE, close)
            if (turned := figures.with_turns(base, figure, self.model.axes, goal)) is not None
        ]
        if not found:
            raise self._figure_error(frame, figure)
        if len(found) == 1:
            return np.array(found[0])
        pull = self._home if close is None else close
        return np.array(min(found, key=lambda joints: (self.limits_exceeded(joints) != 0, self._change(joints, pull))))

    def solutions(self, flange: ArrayLike, near: ArrayLike | None = None) -> list[tuple[int, Array]]:
        """Return all solutions: the joints with which the flange reaches a frame, and their figures.

        Joints 1, 4 and 6 are SINGLE (-180 < angle <= 180). Solutions in which some of them are DOUBLE (outside this
        range) are added if the DOUBLE joints are within the soft limits. The other joints are not checked.

        Args:
            flange: The frame, (4, 4), mm.
            near: (n >= 6,) deg; joints 1 and 4 are taken from it if the flange does not determine them. Without
                ``near``, they are 0 in this case.

        Returns:
            Pairs (figure, joints (6,) deg), ordered by figure; empty if the flange is out of reach.

        Raises:
            CallError: E_INVALIDARG if a number is not finite or the matrix is not a frame.
        """
        close = np.zeros(ARM_AXES) if near is None else joints_of(near)[:ARM_AXES]
        found = [
            (figures.figure_of(self._chain, joints), np.array(joints))
            for base in self._bases(self._checked_frame(flange), close)
            for joints in figures.all_turns(base, self.model.axes)
        ]
        return sorted(found, key=lambda entry: entry[0])

    def choose(self, flange: ArrayLike, rule: int, near: ArrayLike) -> Array:
        """Return the joints with which the flange reaches a frame, selected by a rule for poses without a figure.

        For each joint, the change from ``near`` is divided by the largest velocity of the axis. The largest of these
        quotients is the change of the solution.

        Args:
            flange: The frame, (4, 4), mm.
            rule: :data:`AUTOMATIC` keeps the figure of ``near`` if a solution with this figure is within the soft
                limits; otherwise it is the same as :data:`WITHIN_LIMITS`. If joint 5 of ``near`` is 0, FLIP and NONFLIP
                both count as its figure. :data:`LEAST_CHANGE` is the solution with the least change.
                :data:`WITHIN_LIMITS` is the solution with the least change among those within the soft limits, or among
                all solutions if none is within them. A number from 0 to 63 is a figure, as for :meth:`inverse`.
            near: (n >= 6,) deg.

        Returns:
            The joints, (6,) deg.

        Raises:
            CallError: As for :meth:`inverse`.
        """
        close = joints_of(near)[:ARM_AXES]
        if not WITHIN_LIMITS <= rule < 0:
            return self.inverse(flange, rule, close)
        if rule == AUTOMATIC:
            kept = self._with_same_figure(flange, close)
            if kept is not None:
                return kept
        found = [joints for _, joints in self.solutions(flange, close)]
        if not found:
            raise _unreachable()
        if rule != LEAST_CHANGE:
            found = [joints for joints in found if not self.limits_exceeded(joints)] or found
        return min(found, key=lambda joints: self._change(joints, close))

    def follow(self, flanges: ArrayLike, start: ArrayLike) -> Array:
        """Return joints along a continuous path: each row is the solution nearest to the previous row.

        The bits LEFTY and BELOW of the figure stay as at the start. The wrist may pass through joint 5 = 0, so that
        FLIP changes, if joint 4 would otherwise turn by 180 deg. Joints may be beyond 180 deg. Near a singular point,
        successive rows may be far apart although the flanges are close together. The caller must check for such jumps
        and for joints outside the soft limits.

        Args:
            flanges: The flange frames along the path, (N, 4, 4), mm.
            start: (n >= 6,) deg, the joints before the first row. If they reach the first flange, they are the first
                row.

        Returns:
            The joints, (N, 6) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE if a flange is out of reach (``detail`` contains its row, counted from 0);
                E_INVALIDARG if a number is not finite or a matrix is not a frame.
        """
        frames = _finite_frames(flanges)
        if frames.ndim != 3:
            raise ValueError(tr("a path must be an array with the shape (N, 4, 4), not {shape}", shape=frames.shape))
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
        """Return the axes outside their soft limits as bits; J1 is bit 0. Extended joints are checked too.

        The tolerance is :data:`orinkit.arms.kinematics.figures.LIMIT_TOLERANCE`.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer than six joints.
        """
        exceeded = 0
        for index, (value, axis) in enumerate(zip(joints_of(joints).tolist(), self.model.axes, strict=False)):
            if not figures.within(value, axis):
                exceeded |= 1 << index
        return exceeded

    def is_singular(self, joints: ArrayLike) -> bool:
        """Return True if the arm is at a singular point, or so close to one that the joints would jump on a path.

        An arm whose last three axes intersect at one point is at a singular point if joint 5 or the bend of the elbow
        is within :data:`WRIST_SINGULAR` of 0 or 180 deg, or if the absolute x coordinate of the wrist centre in the
        frame of joint 1 is below :data:`SHOULDER_SINGULAR`. Any other arm is at a singular point if its Jacobian is
        nearly singular (:data:`CONDITION_SINGULAR`).

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer than six joints.
        """
        values = joints_of(joints)
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

    def _checked_frame(self, flange: ArrayLike) -> Array:
        frame = _finite_frames(flange)
        if frame.ndim != 2:
            raise ValueError(tr("a flange pose must be an array with the shape (4, 4), not {shape}", shape=frame.shape))
        return frame

    def _in_reach(self, frames: Array) -> Mask:
        near: Mask = np.abs(frames[..., :3, 3] - self._base).max(axis=-1) <= self._chain.reach + 1.0
        return near

    def _of_posture(self, frame: Array, posture: int, near: Array | None) -> Iterator[list[float]]:
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
        for base in self._bases(frame, self._home):
            if figures.figure_of(self._chain, base) & figures.POSTURE == posture:
                yield base

    def _newton_near(self, frame: Array, near: Array) -> list[float] | None:
        found = self._search.newton(frame, near)
        if found is None or np.abs(found - near).max() > _CLOSE:
            return None
        joints: list[float] = found.tolist()
        for index, _ in figures.DOUBLE_BITS:
            joints[index] = figures.normalize_angle(joints[index])
        return joints

    def _bases(self, frame: Array, near: Array) -> list[list[float]]:
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

    def _with_same_figure(self, flange: ArrayLike, near: Array) -> Array | None:
        """Return the solution with the figure of ``near``; ``None`` if there is none within the limits."""
        figure = self.figure(near)
        same = [figure, figure ^ figures.NONFLIP] if figures.is_wrist_straight(near.tolist()) else [figure]
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

    def _figure_error(self, frame: Array, figure: int) -> CallError:
        existing = sorted({found for found, _ in self.solutions(frame)})
        if not existing:
            return _unreachable()
        names = ", ".join(map(str, existing))
        return error_for(
            hresult.FIGURE_INVALID,
            tr("figure {figure} does not exist at this pose; possible figures: {names}", figure=figure, names=names),
        )


def _finite_frames(flanges: ArrayLike) -> Array:
    frames = np.asarray(flanges, dtype=np.float64)
    if frames.ndim < 2 or frames.shape[-2:] != (4, 4):
        raise ValueError(
            tr("a coordinate frame must be an array with the shape (4, 4), not {shape}", shape=frames.shape)
        )
    rotations = frames[..., :3, :3]
    if not np.isfinite(frames).all() or (rotations.size and np.abs(rotations).max() > 1.0 + _ROTATION_NOISE):
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "the frame of a flange must contain only finite numbers, and the elements of its rotation must be "
                "-1 to 1"
            ),
        )
    return frames


def _unreachable(row: int | None = None) -> CallError:
    if row is None:
        return error_for(hresult.OUT_OF_WORKING_RANGE)
    return error_for(
        hresult.OUT_OF_WORKING_RANGE,
        tr("row {row} of the path (counted from 0)", row=row),
    )
