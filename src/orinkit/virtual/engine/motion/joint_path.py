"""Joint paths: the joints as a function of a parameter u from 0 to 1, independent of time.

A path is either straight between two sets of joints, or a table computed from a Cartesian path by inverse kinematics.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
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

_STEP: Final = 1.0  # mm, initial step of a table
_STEP_ANGLE: Final = 0.25  # deg, initial step of a table
_MIN_STEPS: Final = 16
MAX_STEPS: Final = 8192
"""Maximum number of steps of a table."""
_POSITION_ERROR: Final = 1e-3  # mm, largest error between the steps of a table
_ANGLE_ERROR: Final = 1e-4  # deg, largest error between the steps of a table
_LARGEST_STEP: Final = 20.0  # deg of a joint; a larger step is a jump from one solution to another
_START_ERROR: Final = 1e-3  # deg, largest difference between the joints of the arm and the start of its path
_SIDE: Final = 1e-6  # fraction of a step: distance of the outer probes from its beginning and its end


class _Path(ABC):
    """A path of the joints.

    Attributes:
        start: Joints at u = 0.
        end: Joints at u = 1.
        probes: Values of u at which limits are checked with :meth:`sampled`; the derivatives are greatest at some of
            them.
    """

    __slots__ = ("end", "probes", "start")

    start: Joints
    end: Joints
    probes: Array

    def at(self, u: float) -> Joints:
        """Return the joints at u; exactly ``start`` for u <= 0 and ``end`` for u >= 1."""
        if u >= 1:
            return self.end
        if u <= 0:
            return self.start
        return self._between(u)

    @abstractmethod
    def _between(self, u: float) -> Joints:
        """Return the joints at u, above 0 and below 1."""

    @abstractmethod
    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """Return the joints and their first and second derivatives by u, shape (N, axes), at ``u`` of shape (N,)."""


class JointPath(_Path):
    """A straight path from one set of joints to another (PTP): all axes move in proportion.

    ``probes`` is empty, because the derivatives are constant.
    """

    __slots__ = ("_difference",)

    def __init__(self, start: Sequence[float], end: Sequence[float]) -> None:
        self.start = tuple(map(float, start))
        self.end = tuple(map(float, end))
        self.probes = np.empty(0)
        self._difference = [b - a for a, b in zip(self.start, self.end, strict=True)]

    def _between(self, u: float) -> Joints:
        return tuple([a + u * d for a, d in zip(self.start, self._difference, strict=True)])

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """Return the joints and their first and second derivatives by u, shape (N, axes), at ``u`` of shape (N,)."""
        difference = np.array(self._difference)
        joints = np.array(self.start) + u[:, None] * difference
        joints[u >= 1] = self.end
        return joints, np.broadcast_to(difference, joints.shape), np.zeros_like(joints)


class TablePath(_Path):
    """A path through a table of joints at equal steps of u.

    Between two rows of the table, the joints are interpolated by cubic polynomials. The slopes of the polynomials at
    the rows are computed from the table.

    Args:
        joints: The table, shape (steps + 1, axes), of at least 4 steps.
    """

    __slots__ = ("_cell", "_cubic", "_cubics", "_steps")

    def __init__(self, joints: Array) -> None:
        steps = len(joints) - 1
        slopes = _slopes(joints)
        rise = np.diff(joints, axis=0)
        before, after = slopes[:-1], slopes[1:]
        self._cubics = np.stack((joints[:-1], before, 3 * rise - 2 * before - after, before + after - 2 * rise), 1)
        self._steps = steps
        self._cell = -1
        self._cubic: list[tuple[float, ...]] = []
        self.start = tuple(joints[0].tolist())
        self.end = tuple(joints[-1].tolist())
        self.probes = ((np.arange(steps)[:, None] + (_SIDE, 0.5, 1 - _SIDE)) / steps).ravel()

    def _between(self, u: float) -> Joints:
        x = u * self._steps
        cell = int(x)
        if cell != self._cell:  # successive values of u are mostly in the same step or the next
            self._cubic = list(zip(*self._cubics[cell].tolist(), strict=True))
            self._cell = cell
        x -= cell
        return tuple([a + x * (b + x * (c + x * d)) for a, b, c, d in self._cubic])

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """Return the joints and their first and second derivatives by u, shape (N, axes), at ``u`` of shape (N,)."""
        steps = self._steps
        cell = np.clip((u * steps).astype(int), 0, steps - 1)
        x = (u * steps - cell)[:, None]
        a, b, c, d = np.moveaxis(self._cubics[cell], 1, 0)
        joints = a + x * (b + x * (c + x * d))
        joints[u >= 1] = self.end
        return joints, (b + x * (2 * c + x * (3 * d))) * steps, (2 * c + x * (6 * d)) * steps**2


Path: TypeAlias = JointPath | TablePath


class TooManySteps(Exception):
    """A table requires more steps than the caller permits."""


def table_path(
    kinematics: Kinematics,
    course: CartesianPath,
    tool: Array,
    start: Joints,
    extra_end: Sequence[float] | None = None,
    hopeless: Callable[[Array], bool] = lambda _: False,
    most_steps: int = MAX_STEPS,
) -> TablePath:
    """Return the joint path that moves the TCP along a Cartesian path.

    Args:
        kinematics: Kinematics of the arm.
        course: The path of the TCP, starting at its present frame.
        tool: Frame of the TCP relative to the flange.
        start: Joints of all axes at the start.
        extra_end: End values of the extended joints; ``None`` to leave them unchanged.
        hopeless: Callback that is called if the joints change too much between two rows of a table. It receives the
            table of the robot axes, shape (N, axes), and returns True if a finer table cannot succeed either.
        most_steps: Maximum number of steps; it limits the time for planning.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if the end is out of reach; OUT_OF_WORKING_RANGE if another point of the path is
            out of reach; SINGULAR_POINT_REFUSED if the joints cannot follow, because the path leads through a singular
            point or too near to one.
        TooManySteps: If the table requires more than ``most_steps``.
    """
    inverse_tool = inverse_of(tool)
    steps = max(_MIN_STEPS, math.ceil(course.length / _STEP), math.ceil(course.angle / _STEP_ANGLE))
    steps = min(steps, MAX_STEPS)
    axes = kinematics.model.robot_axes
    extra = JointPath(start[axes:], start[axes:] if extra_end is None else extra_end)
    while True:
        if steps > most_steps:
            raise TooManySteps
        u = np.linspace(0, 1, steps + 1)
        rows = _inverse_kinematics(kinematics, course.frames(u) @ inverse_tool, start)
        if float(np.max(np.abs(rows[0] - start[:axes]))) > _START_ERROR:
            raise singular()
        rows[0] = start[:axes]
        path = TablePath(np.concatenate((rows, extra.sampled(u)[0]), 1))
        jumps = float(np.max(np.abs(np.diff(rows, axis=0)))) > _LARGEST_STEP
        if not jumps:
            middle = (u[:-1] + u[1:]) / 2
            actual = kinematics.forward(path.sampled(middle)[0])
            if _agree(actual, course.frames(middle) @ inverse_tool):
                return path
        if steps >= MAX_STEPS or (jumps and hopeless(rows)):
            raise singular()
        steps = min(2 * steps, MAX_STEPS)


def singular() -> CallError:
    """Return the error for a path that is too near a singular point."""
    return error_for(
        hresult.SINGULAR_POINT_REFUSED,
        tr("the joints cannot follow the path. Try: a PTP motion or another figure"),
    )


def _inverse_kinematics(kinematics: Kinematics, flanges: Array, start: Joints) -> Array:
    try:
        return kinematics.follow(flanges, start)
    except CallError as error:
        if error.code != hresult.OUT_OF_WORKING_RANGE:
            raise
        if not kinematics.solutions(flanges[-1]):
            raise error_for(hresult.TARGET_OUT_OF_RANGE, kinematics.obstacle(flanges[-1])) from None
        text = tr("a point on the path to the target")
        raise error_for(hresult.OUT_OF_WORKING_RANGE, text) from None


def _agree(a: Array, b: Array) -> bool:
    far = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
    return float(far.max()) <= _POSITION_ERROR and float(angles_between(a, b).max()) <= _ANGLE_ERROR


def _slopes(joints: Array) -> Array:
    # Finite differences of the fourth order, per step; one-sided at the ends.
    q = joints
    slopes = np.empty_like(q)
    slopes[2:-2] = (q[:-4] - 8 * q[1:-3] + 8 * q[3:-1] - q[4:]) / 12
    first = np.array([[-25, 48, -36, 16, -3], [-3, -10, 18, -6, 1]]) / 12
    slopes[:2] = first @ q[:5]
    slopes[-2:] = -(first @ q[:-6:-1])[::-1]
    return slopes
