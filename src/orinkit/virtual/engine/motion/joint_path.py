"""Paths: the way of the joints, q(u) for u from 0 to 1, without time.

Straight from one set of joints to another, or a table made of a course by inverse kinematics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np

from orinkit.arms.frames import inverse_of
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.cartesian_path import CartesianPath, angles_between
from orinkit.virtual.engine.motion.profile import Array

Joints: TypeAlias = tuple[float, ...]

_STEP: Final = 1.0  # mm of a table, to begin with
_STEP_ANGLE: Final = 0.25  # deg
_FEWEST_STEPS: Final = 16
_MOST_STEPS: Final = 8192
_POSITION_ERROR: Final = 1e-3  # mm between the steps of a table
_ANGLE_ERROR: Final = 1e-4  # deg
_LARGEST_STEP: Final = 20.0  # deg of a joint; more is a jump from one solution to another
_START_ERROR: Final = 1e-3  # deg between where the arm is and where its path begins
_SIDE: Final = 1e-6  # part of a step: just after its beginning, just before its end


class JointPath:
    """The straight way from one set of joints to another (PTP): all axes run in proportion.

    Attributes:
        start: joints at u = 0.
        end: joints at u = 1.
        probes: no place on it is special.
    """

    __slots__ = ("_way", "end", "probes", "start")

    def __init__(self, start: Sequence[float], end: Sequence[float]) -> None:
        self.start: Joints = tuple(map(float, start))
        self.end: Joints = tuple(map(float, end))
        self.probes: Array = np.empty(0)
        self._way = [b - a for a, b in zip(self.start, self.end, strict=True)]

    def at(self, u: float) -> Joints:
        """Return the joints at one place; exactly ``start`` up to 0 and ``end`` from 1 on."""
        if u >= 1:
            return self.end
        if u <= 0:
            return self.start
        return tuple([a + u * d for a, d in zip(self.start, self._way, strict=True)])

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """Return joints, and their first and second derivative by u, of shape (N, axes), at ``u`` of shape (N,)."""
        way = np.array(self._way)
        joints = np.array(self.start) + u[:, None] * way
        joints[u >= 1] = self.end
        return joints, np.broadcast_to(way, joints.shape), np.zeros_like(joints)


class TablePath:
    """Joints at equal steps of u, and a cubic between each two that has the table's slopes at both.

    Args:
        joints: the table, shape (steps + 1, axes), of at least 4 steps.

    Attributes:
        start: joints at u = 0.
        end: joints at u = 1.
        probes: values of u among which are the greatest derivatives, for :meth:`sampled`.
    """

    __slots__ = ("_cell", "_cubic", "_cubics", "_steps", "end", "probes", "start")

    def __init__(self, joints: Array) -> None:
        steps = len(joints) - 1
        slopes = _slopes(joints)
        rise = np.diff(joints, axis=0)
        before, after = slopes[:-1], slopes[1:]
        self._cubics = np.stack((joints[:-1], before, 3 * rise - 2 * before - after, before + after - 2 * rise), 1)
        self._steps = steps
        self._cell = -1
        self._cubic: list[tuple[float, ...]] = []
        self.start: Joints = tuple(joints[0].tolist())
        self.end: Joints = tuple(joints[-1].tolist())
        self.probes: Array = ((np.arange(steps)[:, None] + (_SIDE, 0.5, 1 - _SIDE)) / steps).ravel()

    def at(self, u: float) -> Joints:
        """Return the joints at one place; exactly ``start`` up to 0 and ``end`` from 1 on."""
        if u >= 1:
            return self.end
        if u <= 0:
            return self.start
        x = u * self._steps
        cell = int(x)
        if cell != self._cell:  # successive places are mostly in the same step or the next
            self._cubic = list(zip(*self._cubics[cell].tolist(), strict=True))
            self._cell = cell
        x -= cell
        return tuple([a + x * (b + x * (c + x * d)) for a, b, c, d in self._cubic])

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """Return joints, and their first and second derivative by u, of shape (N, axes), at ``u`` of shape (N,)."""
        steps = self._steps
        cell = np.clip((u * steps).astype(int), 0, steps - 1)
        x = (u * steps - cell)[:, None]
        a, b, c, d = np.moveaxis(self._cubics[cell], 1, 0)
        joints = a + x * (b + x * (c + x * d))
        joints[u >= 1] = self.end
        return joints, (b + x * (2 * c + x * (3 * d))) * steps, (2 * c + x * (6 * d)) * steps**2


Path: TypeAlias = JointPath | TablePath


def table_path(
    kinematics: Kinematics,
    course: CartesianPath,
    tool: Array,
    start: Joints,
    extra_end: Sequence[float] | None = None,
    hopeless: Callable[[Array], bool] = lambda _: False,
) -> TablePath:
    """Return the way of the joints that takes the TCP along a course.

    Args:
        kinematics: of the arm.
        course: of the TCP, from where it is.
        tool: frame of the TCP in the flange.
        start: joints where the arm is, all its axes.
        extra_end: where axes 7 and 8 end, as many as the arm has; ``None`` to leave them where they are.
        hopeless: says of a table of the six joints, shape (N, 6), with large steps, that finer ones are of no use.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if the arm does not reach the end, OUT_OF_WORKING_RANGE if it does not reach a
            place on the way; SINGULAR_POINT_REFUSED where the joints cannot
            follow, because the arm passes through, or too near, a singular point.
    """
    back = inverse_of(tool)
    steps = max(_FEWEST_STEPS, math.ceil(course.length / _STEP), math.ceil(course.angle / _STEP_ANGLE))
    steps = min(steps, _MOST_STEPS)
    extra = JointPath(start[6:], start[6:] if extra_end is None else extra_end)
    while True:
        u = np.linspace(0, 1, steps + 1)
        rows = _followed(kinematics, course.frames(u) @ back, start)
        if float(np.max(np.abs(rows[0] - start[:6]))) > _START_ERROR:
            raise singular()
        rows[0] = start[:6]
        path = TablePath(np.concatenate((rows, extra.sampled(u)[0]), 1))
        jumps = float(np.max(np.abs(np.diff(rows, axis=0)))) > _LARGEST_STEP
        if not jumps:
            middle = (u[:-1] + u[1:]) / 2
            made = kinematics.forward(path.sampled(middle)[0])
            if _agree(made, course.frames(middle) @ back):
                return path
        if steps >= _MOST_STEPS or (jumps and hopeless(rows)):
            raise singular()
        steps = min(2 * steps, _MOST_STEPS)


def singular() -> CallError:
    """Return the error of a course that is too near a singular point."""
    return error_for(
        hresult.SINGULAR_POINT_REFUSED,
        tr("the joints cannot follow the path; try a PTP motion or another figure"),
    )


def _followed(kinematics: Kinematics, flanges: Array, start: Joints) -> Array:
    try:
        return kinematics.follow(flanges, start[:6])
    except CallError as error:
        if error.code != hresult.OUT_OF_WORKING_RANGE:
            raise
        if not kinematics.solutions(flanges[-1]):
            raise error_for(hresult.TARGET_OUT_OF_RANGE) from None
        text = tr("a place on the way to the target")
        raise error_for(hresult.OUT_OF_WORKING_RANGE, text) from None


def _agree(a: Array, b: Array) -> bool:
    far = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
    return float(far.max()) <= _POSITION_ERROR and float(angles_between(a, b).max()) <= _ANGLE_ERROR


def _slopes(joints: Array) -> Array:
    # Of the fourth order, per step; at the ends from one side.
    q = joints
    slopes = np.empty_like(q)
    slopes[2:-2] = (q[:-4] - 8 * q[1:-3] + 8 * q[3:-1] - q[4:]) / 12
    first = np.array([[-25, 48, -36, 16, -3], [-3, -10, 18, -6, 1]]) / 12
    slopes[:2] = first @ q[:5]
    slopes[-2:] = -(first @ q[:-6:-1])[::-1]
    return slopes
