"""Conversions of coordinate frames between 4x4 matrices and the notations of the controller (P and T), and rotations.

P is X, Y, Z in mm and RX, RY, RZ in deg, with the rotation ``Rz(RZ) Ry(RY) Rx(RX)``. T is X, Y, Z in mm, then the
orient vector O (the tool's Y axis) and the approach vector A (its Z axis). Functions that convert from or to P accept
any number of frames in one call.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orinkit.arms.geometry import DEGREE, of_matrix
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

Array = NDArray[np.float64]

_NO_TURN: Final = 1e-150  # sine of half the angle; the inverse of a smaller one would overflow
_GIMBAL: Final = 1e-11  # cosine of RY below which RX and RZ turn about the same axis
_NOISE: Final = 1e-12  # deg, mm or a component of a unit vector; a value this close to a round number is rounded to it
_PARALLEL: Final = 1e-9  # sine of the angle between two vectors that count as parallel


def matrix_of_position(values: ArrayLike) -> Array:
    """Return the frame that P values describe, as a 4x4 matrix.

    Args:
        values: (..., 6) X, Y, Z mm, RX, RY, RZ deg.

    Returns:
        The frames, (..., 4, 4), mm.

    Raises:
        CallError: E_INVALIDARG if a number is not finite.
        ValueError: If the last dimension is not six.
    """
    given = _finite(values, 6)
    angles = given[..., 3:] / DEGREE
    (cx, cy, cz), (sx, sy, sz) = np.moveaxis(np.cos(angles), -1, 0), np.moveaxis(np.sin(angles), -1, 0)
    frame = np.zeros((*given.shape[:-1], 4, 4))
    frame[..., 0, 0] = cz * cy
    frame[..., 0, 1] = cz * sy * sx - sz * cx
    frame[..., 0, 2] = cz * sy * cx + sz * sx
    frame[..., 1, 0] = sz * cy
    frame[..., 1, 1] = sz * sy * sx + cz * cx
    frame[..., 1, 2] = sz * sy * cx - cz * sx
    frame[..., 2, 0] = -sy
    frame[..., 2, 1] = cy * sx
    frame[..., 2, 2] = cy * cx
    frame[..., :3, 3] = given[..., :3]
    frame[..., 3, 3] = 1.0
    return frame


def position_of_matrix(matrix: ArrayLike) -> Array:
    """Return the P values that describe a frame.

    RX and RZ are in -180 < angle <= 180, and RY is -90 to 90. If RY is 90 or -90, only the sum or the difference of RX
    and RZ is determined; RX is then 0. An angle within 1e-12 of a multiple of 90 deg is rounded to this multiple, and a
    length within 1e-12 of a whole number is rounded to this number.

    Args:
        matrix: The frames, (..., 4, 4), mm.

    Returns:
        The P values, (..., 6): X, Y, Z mm, RX, RY, RZ deg.

    Raises:
        CallError: E_INVALIDARG if a number is not finite.
        ValueError: If ``matrix`` is not a 4x4 matrix.
    """
    frame = _finite(matrix, 4, 4)
    x, y, z = (frame[..., :3, index] for index in range(3))
    level = np.hypot(x[..., 0], x[..., 1])
    turn = np.where(level >= _GIMBAL, np.arctan2(x[..., 1], x[..., 0]), np.arctan2(-y[..., 0], y[..., 1]))
    c, s = np.cos(turn), np.sin(turn)
    roll = np.arctan2(s * z[..., 0] - c * z[..., 1], c * y[..., 1] - s * y[..., 0])
    pitch = np.arctan2(-x[..., 2], c * x[..., 0] + s * x[..., 1])
    values = np.empty((*frame.shape[:-2], 6))
    values[..., :3] = _rounded(frame[..., :3, 3], 1.0)
    angles = _rounded(np.stack((roll, pitch, turn), axis=-1) * DEGREE, 90.0)
    values[..., 3:] = np.where(angles <= -180.0, 180.0, angles)
    return values


def matrix_of_trans(values: ArrayLike) -> Array:
    """Return the frame, a matrix (4, 4), that T values describe.

    A is the direction of Z, and the component of O perpendicular to A is the direction of Y. The lengths of O and A are
    irrelevant.

    Args:
        values: (9,) X, Y, Z in mm, the orient vector O, the approach vector A.

    Raises:
        CallError: E_INVALIDARG if a number is not finite, O or A is zero, or they are parallel.
        ValueError: If there are not nine values.
    """
    given = _finite(values, 9)
    frame = np.eye(4)
    z = _unit(given[6:], "A")
    orient = _unit(given[3:6], "O")
    across = orient - (orient @ z) * z
    if math.hypot(*across) < _PARALLEL:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("orient and approach vector are parallel"),
        )
    y = _unit(across, "O")
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = np.cross(y, z), y, z, given[:3]
    return frame


def trans_of_matrix(matrix: ArrayLike) -> Array:
    """Return the T values that describe a frame, (9,): X, Y, Z in mm, the orient vector O, the approach vector A.

    Args:
        matrix: The frame, (4, 4), mm.

    Raises:
        CallError: E_INVALIDARG if a number is not finite.
        ValueError: If ``matrix`` is not a 4x4 matrix.
    """
    frame = _finite(matrix, 4, 4)
    return _rounded(np.concatenate((frame[:3, 3], frame[:3, 1], frame[:3, 2])), 1.0)


def inverse_of(matrix: ArrayLike) -> Array:
    """Return the inverse of frames, (..., 4, 4).

    Raises:
        CallError: E_INVALIDARG if a number is not finite.
        ValueError: If ``matrix`` is not a 4x4 matrix.
    """
    frame = _finite(matrix, 4, 4)
    inverse = np.zeros_like(frame)
    transposed = np.swapaxes(frame[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = transposed
    inverse[..., :3, 3] = -(transposed @ frame[..., :3, 3, None])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Return the rotation (3, 3) about an axis (3,) by an angle in deg. The axis may have any length.

    Raises:
        CallError: E_INVALIDARG if a number is not finite, or the axis is zero.
        ValueError: If the axis does not have three components.
    """
    turns = turns_about(_unit(_finite(axis, 3), tr("the axis")), _finite([angle], 1))
    return np.asarray(turns[0], dtype=np.float64)


def turns_about(axis: Array, angles: Array) -> Array:
    """Return the rotations (N, 3, 3) about a unit vector (3,) by angles (N,) in deg; the arguments are not checked."""
    x, y, z = axis.tolist()
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    radians = angles[:, None, None] / DEGREE
    versine = 2.0 * np.sin(0.5 * radians) ** 2
    return np.asarray(np.eye(3) + np.sin(radians) * cross + versine * (cross @ cross), dtype=np.float64)


def rotation_between(first: ArrayLike, second: ArrayLike) -> tuple[Array, float]:
    """Return the rotation that turns one orientation into another: ``second = rotation_about(axis, angle) @ first``.

    Args:
        first: The orientation before the rotation, a matrix (3, 3).
        second: The orientation after the rotation, a matrix (3, 3).

    Returns:
        The axis and the angle. The axis is a unit vector (3,) in the base frame; it is (0, 0, 1) if the angle is 0. The
        angle is 0 to 180 deg.

    Raises:
        CallError: E_INVALIDARG if a number is not finite.
        ValueError: If ``first`` or ``second`` is not a 3x3 matrix.
    """
    (a, b, c), (d, e, f), (g, h, i) = (_finite(second, 3, 3) @ _finite(first, 3, 3).T).tolist()
    w, x, y, z = of_matrix(a, b, c, d, e, f, g, h, i)
    sine = math.hypot(x, y, z)
    if sine < _NO_TURN:
        return np.array((0.0, 0.0, 1.0)), 0.0
    sign = math.copysign(1.0 / sine, w)
    return np.array((x * sign, y * sign, z * sign)), 2.0 * math.atan2(sine, abs(w)) * DEGREE


def _unit(vector: Array, name: str) -> Array:
    largest = float(np.abs(vector).max())
    if largest == 0.0:
        raise error_for(hresult.E_INVALIDARG, tr("{name} is a zero vector", name=name))
    scaled = vector / largest  # the square of a huge vector would overflow
    return np.asarray(scaled / math.hypot(*scaled), dtype=np.float64)


def _rounded(values: Array, grid: float) -> Array:
    """Return values; a value very close to a multiple of ``grid`` becomes this multiple, and -0.0 becomes 0.0."""
    nearest = grid * np.round(values / grid)
    return np.where(np.abs(values - nearest) < _NOISE, nearest, values) + 0.0


def _finite(values: ArrayLike, *shape: int) -> Array:
    """Return values as an array after checking that they are finite and that the last dimensions are ``shape``."""
    given = np.asarray(values, dtype=np.float64)
    if given.shape[-len(shape) :] != shape:
        raise ValueError(tr("the shape must be {wanted}, not {shape}", wanted=shape, shape=given.shape))
    if not np.isfinite(given).all():
        raise error_for(hresult.E_INVALIDARG, tr("a number is not finite"))
    return given
