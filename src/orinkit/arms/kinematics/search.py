"""Inverse kinematics of arms without a closed form, such as the COBOTTA.

In these arms, the axis of joint 6 does not intersect the axes of joints 4 and 5. For each angle of joint 6, the wrist
centre is known, and joints 1 to 3 have up to four solutions in closed form. One condition remains: the axis of joint 5
must be perpendicular to the forearm. The roots of this condition over one turn of joint 6 are all the solutions. If the
axes of joints 4 and 5 do not intersect either, the roots are approximations, which are refined by damped least squares.
"""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from orinkit.arms import ArmModel
from orinkit.arms.kinematics.chain import ARM_AXES, RADIAN, Array, Chain
from orinkit.arms.kinematics.figures import normalize_around
from orinkit.arms.kinematics.inverse import InverseSolver, Mask, flange_in_forearm
from orinkit.arms.kinematics.roots import Samples, all_roots

_SAMPLES: Final = 96  # in one turn of joint 6
_ROUNDS: Final = 60
_ACCURACY: Final = 1e-10  # deg; a length is divided by the reach of the arm and counts as an angle
_NEWTON_ROUNDS: Final = 10
_LARGEST_STEP: Final = 20.0  # deg, in one step of Newton's method
_SAME: Final = 1e-6  # deg; closer solutions count as one
_OFFSET_ROUNDS: Final = 8
_POSTURES: Final = np.array(list(itertools.product((True, False), repeat=2)))  # lefty, elbow bent to the positive side


class Search(InverseSolver):
    """Numeric inverse kinematics of an arm; finds all solutions."""

    def __init__(self, model: ArmModel, chain: Chain) -> None:
        super().__init__(model, chain)
        self._scale = 1.0 / (RADIAN * chain.reach)  # converts mm at the flange to deg

    def solutions(self, flanges: Array) -> tuple[Array, NDArray[np.int_]]:
        """Return all solutions for each flange.

        Args:
            flanges: The flange frames, (N, 4, 4), mm.

        Returns:
            Joints (M, 6), deg, with J1, J4, J6 SINGLE, in the order of the flanges; and for each row of joints, the
            index of its flange in ``flanges``, (M,).
        """
        rows, postures, angles = self._roots(flanges)
        goal = flanges[rows]
        joints = self._complete(goal, _POSTURES[postures], angles)
        if self._chain.wrist[0]:
            joints, _ = self.refine(goal, joints)
        good = _norm(self.error(joints, goal)) < 10.0 * _ACCURACY
        joints, rows = normalize_around(joints[good], self._centres), rows[good]
        return _distinct(joints, rows)

    def refine(self, flanges: Array, seeds: Array) -> tuple[Array, Mask]:
        """Improve approximate joints by damped least squares.

        Args:
            flanges: The flange frames to reach, (N, 4, 4), mm.
            seeds: The approximate joints, (N, 6), deg.

        Returns:
            Joints (N, 6), deg; and a mask (N,), True for rows whose joints reach their flange.
        """
        joints = seeds.copy()
        errors = self.error(joints, flanges)
        sizes, damping = _norm(errors), np.full(len(joints), 1e-3)
        for _ in range(_ROUNDS):
            rows = np.flatnonzero(sizes > _ACCURACY)
            if not len(rows):
                break
            tried = joints[rows] + self._step(joints[rows], errors[rows], damping[rows])
            new = self.error(tried, flanges[rows])
            new_sizes = _norm(new)
            better = new_sizes < sizes[rows]
            damping[rows] = np.where(better, damping[rows] * 0.01, damping[rows] * 10.0).clip(1e-12, 1e8)
            chosen = rows[better]
            joints[chosen], errors[chosen], sizes[chosen] = tried[better], new[better], new_sizes[better]
        return joints, sizes <= 10.0 * _ACCURACY

    def newton(self, flange: Array, seed: Array) -> Array | None:
        """Return the joints (6,), deg, found by Newton's method from a seed; ``None`` if it does not converge."""
        joints = seed.copy()
        goal = flange.tolist()
        size = math.inf
        for _ in range(_NEWTON_ROUNDS):
            error = _small_error(self._chain.forward(joints).tolist(), goal, self._scale)
            before, size = size, max(map(abs, error))
            if size <= _ACCURACY:
                return joints
            if not size < before:  # also True for NaN
                return None
            step = _solve(self._scaled_jacobian(joints), np.array(error))
            if step is None or not np.abs(step).max() <= _LARGEST_STEP:  # also True for NaN
                return None
            joints += step
        return None

    def follow(self, flanges: Array, start: Array) -> tuple[Array, Mask]:
        """Return joints along a path: each row is the solution nearest to the previous row.

        Args:
            flanges: The flange frames, (N, 4, 4), mm.
            start: (6,) deg, the joints before the first row.

        Returns:
            Joints (N, 6), deg; and a mask (N,), False from the first row that is out of reach.
        """
        joints = np.full((len(flanges), ARM_AXES), np.nan)
        reached = np.zeros(len(flanges), dtype=np.bool_)
        before = last = start
        for row, flange in enumerate(flanges):
            found = self.newton(flange, 2.0 * last - before)
            if found is None:
                found = self.nearest(flange, last)
            if found is None:
                break
            joints[row], reached[row] = found, True
            before, last = last, found
        return joints, reached

    def nearest(self, flange: Array, near: Array) -> Array | None:
        """Return the solution (6,), deg, nearest to ``near``; ``None`` if there is none.

        The joints of the solution may be beyond 180 deg.
        """
        found, _ = self.solutions(flange[None])
        if not len(found):
            return None
        found += 360.0 * np.round((near - found) / 360.0)
        nearest: Array = found[np.abs(found - near).max(axis=1).argmin()]
        return nearest

    def error(self, joints: Array, flanges: Array) -> Array:
        """Return the deviations between the flange frames at ``joints`` and the wanted frames ``flanges``, (..., 6).

        A deviation consists of three components of the translation and three of the rotation. All are in deg: a
        translation by the reach of the arm counts as a rotation by 1 rad.
        """
        held = self._chain.forward(joints)
        turn = flanges[..., :3, :3] @ np.swapaxes(held[..., :3, :3], -1, -2)
        error = np.empty((*turn.shape[:-2], 6))
        error[..., :3] = (flanges[..., :3, 3] - held[..., :3, 3]) * self._scale
        sine: Array = 0.5 * (turn[..., (2, 0, 1), (1, 2, 0)] - turn[..., (1, 2, 0), (2, 0, 1)])
        size = _norm(sine)
        angle = np.arctan2(size, 0.5 * (np.trace(turn, axis1=-2, axis2=-1) - 1.0))
        error[..., 3:] = sine * np.where(size > 0.0, angle / np.where(size > 0.0, size, 1.0), 1.0)[..., None] / RADIAN
        return error

    def _scaled_jacobian(self, joints: Array) -> Array:
        jacobian = self._chain.jacobian(joints)
        jacobian[..., :3, :] *= self._scale
        return jacobian

    def _step(self, joints: Array, errors: Array, damping: Array) -> Array:
        jacobian = self._scaled_jacobian(joints)
        transposed = np.swapaxes(jacobian, -1, -2)
        square = transposed @ jacobian + damping[:, None, None] * np.eye(ARM_AXES)
        step: Array = np.asarray(np.linalg.solve(square, transposed @ errors[..., None])[..., 0], dtype=np.float64)
        step *= _LARGEST_STEP / np.maximum(np.abs(step).max(axis=-1, keepdims=True), _LARGEST_STEP)
        return step

    # ---------------------------------------------------------------- one condition over joint 6

    def _arm_for(self, flanges: Array, postures: Mask, angles: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return joints 1 to 3 for angles of joint 6, and the value of the remaining condition.

        The condition is that the axis of joint 5 is perpendicular to the forearm.

        Args:
            flanges: The flange frames, (..., 4, 4), mm.
            postures: (..., 2): the first is True if the arm is LEFTY, the second if joint 3 is greater than at full
                stretch.
            angles: Joint 6, (...), rad.

        Returns:
            Joint 1, rad; joint 2, rad; the sum of joints 2 and 3, rad; the value of the condition, 0 for a solution;
            the distance of the wrist centre from the boundary of the reach, mm, negative if it is out of reach.
        """
        c, s = np.cos(angles), np.sin(angles)
        x6, y6, z6 = self._chain.flange
        ex, ey, ez = (flanges[..., :3, index] for index in range(3))
        ahead = c[..., None] * ex - s[..., None] * ey  # "ahead" and "axis" are x and y of the frame of joint 5
        axis = s[..., None] * ex + c[..., None] * ey
        centre = flanges[..., :3, 3] - self._base - x6 * ahead - y6 * axis - z6 * ez
        held = self._reach(centre, postures)
        for _ in range(_OFFSET_ROUNDS if self._chain.wrist[0] else 0):
            across = np.cross(axis, _forearm(held[0], held[2]))
            length = np.maximum(_norm(across), 1e-3)[..., None]
            held = self._reach(centre - self._chain.wrist[0] * across / length, postures)
        first, second, both, margin = held
        return first, second, both, (axis * _forearm(first, both)).sum(axis=-1), margin

    def _reach(self, centre: Array, postures: Mask) -> tuple[Array, Array, Array, Array]:
        lefty, positive = postures[..., 0], postures[..., 1]
        first, forward, beside, _ = self._arm.shoulder(centre[..., 0], centre[..., 1], lefty)
        second, both, margin = self._arm.elbow(forward, centre[..., 2], positive)
        return first, second, both, np.minimum(beside, margin)

    def _complete(self, flanges: Array, postures: Mask, angles: Array) -> Array:
        """Return all six joints, (M, 6), deg, for angles of joint 6, rad, that are roots of the condition."""
        first, second, both, _, _ = self._arm_for(flanges, postures, angles)
        x, y, z = flange_in_forearm(flanges, first, both)
        c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
        ahead, axis = c * x - s * y, s * x + c * y
        fourth = np.arctan2(-axis[:, 0], axis[:, 1])
        fifth = np.arctan2(-ahead[:, 2], z[:, 2])
        return np.stack((first, second, both - second, fourth, fifth, angles), axis=-1) / RADIAN

    def _roots(self, flanges: Array) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
        """Return three arrays with one entry per root: index of the flange, index of the posture, joint 6 in rad."""
        count = len(flanges) * len(_POSTURES)

        def condition(lines: NDArray[np.int_], at: Array) -> tuple[Array, Array]:
            flange, posture = np.divmod(lines, len(_POSTURES))
            return _masked(*self._arm_for(flanges[flange], _POSTURES[posture], at)[3:])

        turn: Array = (np.arange(_SAMPLES + 2, dtype=np.float64) * (2.0 / _SAMPLES) - 1.0) * math.pi
        held = self._arm_for(flanges[:, None, None], _POSTURES[None, :, None], turn[:-2])
        values, margins = (_closed(entry.reshape(count, _SAMPLES)) for entry in _masked(*held[3:]))
        samples = Samples(np.arange(count), np.broadcast_to(turn, values.shape), values, margins)
        x6, y6, _ = self._chain.flange
        lines, found = all_roots(condition, samples, abs(x6) + abs(y6))
        flange, posture = np.divmod(lines, len(_POSTURES))
        return flange, posture, found


def _masked(values: Array, margins: Array) -> tuple[Array, Array]:
    return np.where(margins >= 0.0, values, np.nan), margins


def _closed(entries: Array) -> Array:
    """Return samples of one turn (L, S) with the first two repeated at the end."""
    return np.concatenate((entries, entries[:, :2]), axis=1)


def _small_error(held: list[list[float]], goal: list[list[float]], scale: float) -> list[float]:
    """Return the deviation between two frames, as :meth:`Search.error`; infinite if the rotation exceeds 90 deg."""
    (ax, bx, cx, px), (ay, by, cy, py), (az, bz, cz, pz), _ = held
    (dx, ex, fx, qx), (dy, ey, fy, qy), (dz, ez, fz, qz), _ = goal
    if ax * dx + ay * dy + az * dz + bx * ex + by * ey + bz * ez + cx * fx + cy * fy + cz * fz < 1.0:
        return [math.inf]
    half = 0.5 / RADIAN
    return [
        (qx - px) * scale,
        (qy - py) * scale,
        (qz - pz) * scale,
        half * (ay * dz - az * dy + by * ez - bz * ey + cy * fz - cz * fy),
        half * (az * dx - ax * dz + bz * ex - bx * ez + cz * fx - cx * fz),
        half * (ax * dy - ay * dx + bx * ey - by * ex + cx * fy - cy * fx),
    ]


def _forearm(first: Array, both: Array) -> Array:
    """Return the direction of the forearm (..., 3), which is the axis of joint 4.

    The arguments are joint 1, and the sum of joints 2 and 3, in rad.
    """
    s = np.sin(both)
    return np.stack((np.cos(first) * s, np.sin(first) * s, np.cos(both)), axis=-1)


def _norm(vectors: Array) -> Array:
    size: Array = np.sqrt((vectors * vectors).sum(axis=-1))
    return size


def _solve(matrix: Array, right: Array) -> Array | None:
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None


def _distinct(joints: Array, rows: NDArray[np.int_]) -> tuple[Array, NDArray[np.int_]]:
    """Return each solution once, ordered by the row of its flange."""
    key = np.column_stack((rows, np.round(joints[:, ::-1] / (10.0 * _SAME))))
    order = np.lexsort(key.T[::-1])
    joints, rows = joints[order], rows[order]
    repeated = (np.diff(rows) == 0) & (np.abs(np.diff(joints, axis=0)).max(axis=1, initial=0.0) < _SAME)
    first = np.append(True, ~repeated)[: len(rows)]
    return joints[first], rows[first]
