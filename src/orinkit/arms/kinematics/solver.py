"""Kinematics of one arm: forward, inverse, and the choice between several solutions.

Frames are 4x4 matrices in the base frame of the arm, mm. Joints are in degrees, joint 3 of a SCARA in mm; extended joints
have no influence. In shapes, ``n`` is the number of joints given and ``m`` the number of joints that move the flange: 6, or
4 for a SCARA.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from orinkit.arms import ArmModel
from orinkit.arms.kinematics import figures
from orinkit.arms.kinematics.arm_solver import ArmSolver
from orinkit.arms.kinematics.chain import Array, joints_of
from orinkit.arms.kinematics.scara import ScaraSolver
from orinkit.arms.kinematics.six_axis import SixAxisSolver
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr

AUTOMATIC: Final = -1
"""Rule of :meth:`Kinematics.choose`: keep the figure of ``near`` if possible."""
LEAST_CHANGE: Final = -2
"""Rule of :meth:`Kinematics.choose`: select the solution with the least change from ``near``."""
WITHIN_LIMITS: Final = -3
"""Rule of :meth:`Kinematics.choose`: select the solution within the soft limits with the least change."""

_ROTATION_NOISE: Final = 1e-6


class Kinematics:
    """Forward and inverse kinematics of an arm.

    A SCARA, and an arm whose last three axes intersect at one point, are solved in closed form, other arms by numeric
    search. The results have the same meaning in all cases.

    Args:
        model: The arm model.
    """

    def __init__(self, model: ArmModel) -> None:
        self.model = model
        self._solver: ArmSolver = ScaraSolver(model) if model.is_scara else SixAxisSolver(model)
        self._axes = model.robot_axes
        self._home = np.array(model.home[: self._axes])
        self._velocities = np.array([axis.velocity for axis in model.axes[: self._axes]])

    def forward(self, joints: ArrayLike) -> Array:
        """Return the flange frame.

        Args:
            joints: (..., n >= m) deg.

        Returns:
            The frames, (..., 4, 4), mm.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer joints than the arm has.
        """
        return self._solver.chain.forward(joints)

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return the Jacobian of the flange in the base frame.

        Args:
            joints: (..., n >= m) deg.

        Returns:
            The Jacobian, (..., 6, m): rows are x, y, z in mm per deg, then the rotation about the axes x, y, z in deg
            per deg; columns are the joints. The unit of the column of a linear joint is per mm.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer joints than the arm has.
        """
        return self._solver.chain.jacobian(joints)

    def figure(self, joints: ArrayLike) -> int:
        """Return the figure, 0 to 63 (:mod:`orinkit.arms.kinematics.figures`), of joints (n >= m,) deg.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer joints than the arm has.
        """
        return self._solver.figure_of(self._joints(joints).tolist())

    def inverse(self, flange: ArrayLike, figure: int, near: ArrayLike | None = None) -> Array:
        """Return the joints with which the flange reaches a frame and the arm has exactly the figure ``figure``.

        The solution may be outside the soft limits; only the joints that the figure makes DOUBLE are within them.

        Args:
            flange: The frame, (4, 4), mm.
            figure: 0 to 63.
            near: (n >= m,) deg. If the flange does not determine joint 1 or 4, this joint is taken from ``near``;
                without ``near``, it is 0. If two angles are possible for a DOUBLE joint, the one nearer to ``near`` is
                used; without ``near``, the one nearer to 0. If several solutions have the figure, those within the soft
                limits are preferred, and of these the one nearest to ``near``; without ``near``, the one nearest to the
                home position.

        Returns:
            The joints, (m,) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE if the flange is out of reach; FIGURE_INVALID if it cannot be reached with
                this figure; FIGURE_OUT_OF_RANGE if there is no such figure; E_INVALIDARG if a number is not finite or
                the matrix is not a frame.
        """
        figure = self._checked_figure(figure)
        frame = self._checked_frame(flange)
        close = None if near is None else self._joints(near)[: self._axes]
        goal = None if close is None else close.tolist()
        found = [
            turned
            for base in self._solver.of_posture(frame, figure & self._solver.posture_bits, close)
            if (turned := figures.with_turns(base, figure, self.model.axes, goal, self._solver.double_bits)) is not None
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
            near: (n >= m,) deg; joints 1 and 4 are taken from it if the flange does not determine them. Without
                ``near``, they are 0 in this case.

        Returns:
            Pairs (figure, joints (m,) deg), ordered by figure; empty if the flange is out of reach.

        Raises:
            CallError: E_INVALIDARG if a number is not finite or the matrix is not a frame.
        """
        close = np.zeros(self._axes) if near is None else self._joints(near)[: self._axes]
        found = [
            (self._solver.figure_of(joints), np.array(joints))
            for base in self._solver.bases(self._checked_frame(flange), close)
            for joints in figures.all_turns(base, self.model.axes, self._solver.double_bits)
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
            near: (n >= m,) deg.

        Returns:
            The joints, (m,) deg.

        Raises:
            CallError: As for :meth:`inverse`.
        """
        close = self._joints(near)[: self._axes]
        if not WITHIN_LIMITS <= rule < 0:
            return self.inverse(flange, rule, close)
        if rule == AUTOMATIC:
            kept = self._with_same_figure(flange, close)
            if kept is not None:
                return kept
        found = [joints for _, joints in self.solutions(flange, close)]
        if not found:
            raise _unreachable(self._solver.obstacle(self._checked_frame(flange)))
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
            start: (n >= m,) deg, the joints before the first row. If they reach the first flange, they are the first
                row.

        Returns:
            The joints, (N, m) deg.

        Raises:
            CallError: OUT_OF_WORKING_RANGE if a flange is out of reach (``detail`` contains its row, counted from 0);
                E_INVALIDARG if a number is not finite or a matrix is not a frame.
        """
        frames = _finite_frames(flanges)
        if frames.ndim != 3:
            raise ValueError(tr("a path must be an array with the shape (N, 4, 4), not {shape}", shape=frames.shape))
        first = self._joints(start)[: self._axes]
        if not len(frames):
            return np.empty((0, self._axes))
        joints, reached = self._solver.follow(frames, first)
        if not reached.all():
            row = int(np.argmin(reached))
            raise _unreachable(self._solver.obstacle(frames[row]), row)
        return joints

    def limits_exceeded(self, joints: ArrayLike) -> int:
        """Return the axes outside their soft limits as bits; J1 is bit 0. Extended joints are checked too.

        The tolerance is :data:`orinkit.arms.kinematics.figures.LIMIT_TOLERANCE`.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer joints than the arm has.
        """
        exceeded = 0
        for index, (value, axis) in enumerate(zip(self._joints(joints).tolist(), self.model.axes, strict=False)):
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
            ValueError: If there are fewer joints than the arm has.
        """
        return self._solver.is_singular(self._joints(joints))

    def obstacle(self, flange: ArrayLike) -> str:
        """Return why no position of the arm can hold the flange in the orientation of a frame; ``""`` if one can."""
        return self._solver.obstacle(self._checked_frame(flange))

    def path_bits(self, joints: ArrayLike) -> int:
        """Return the bits of the figure that a path which begins or ends at these joints cannot change.

        Raises:
            CallError: E_INVALIDARG if a joint is not finite.
            ValueError: If there are fewer joints than the arm has.
        """
        return self._solver.path_bits(self._joints(joints).tolist())

    def _joints(self, joints: ArrayLike) -> Array:
        return joints_of(joints, self._axes)

    def _checked_figure(self, figure: int) -> int:
        bits = self._solver.known_bits(figure)
        if bits is None:
            raise error_for(
                hresult.FIGURE_OUT_OF_RANGE,
                tr("the figure of a SCARA must be -3 to 1, 16 or 17")
                if self.model.is_scara
                else tr("the figure must be -3 to 63"),
            )
        return bits

    def _checked_frame(self, flange: ArrayLike) -> Array:
        frame = _finite_frames(flange)
        if frame.ndim != 2:
            raise ValueError(tr("a flange pose must be an array with the shape (4, 4), not {shape}", shape=frame.shape))
        return frame

    def _with_same_figure(self, flange: ArrayLike, near: Array) -> Array | None:
        """Return the solution with the figure of ``near``; ``None`` if there is none within the limits."""
        kept = []
        for one in self._solver.equal_figures(self.figure(near), near.tolist()):
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
            return _unreachable(self._solver.obstacle(frame))
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


def _unreachable(obstacle: str, row: int | None = None) -> CallError:
    """Return the error for a frame out of reach; ``obstacle`` is the reason if it is not the distance."""
    place = "" if row is None else tr("row {row} of the path (counted from 0)", row=row)
    return error_for(hresult.OUT_OF_WORKING_RANGE, "; ".join(filter(None, (place, obstacle))))
