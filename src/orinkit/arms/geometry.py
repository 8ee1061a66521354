"""Vectors in space, and orientations as unit quaternions (w, x, y, z).

This module does not import numpy, because the streaming process must start quickly. :mod:`orinkit.arms.frames` converts
whole arrays. The rotation matrix of a pose of type P is R = Rz(RZ) * Ry(RY) * Rx(RX). A pose of type T contains the
tool's Y axis (O) and Z axis (A).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, TypeAlias, TypeVar

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Quaternion: TypeAlias = tuple[float, float, float, float]
"""w, x, y, z, with norm 1."""
Vector: TypeAlias = tuple[float, float, float]
"""A vector in space."""

DEGREE: Final = 180.0 / math.pi
"""Degrees per radian."""

_HALF: Final = 0.5 / DEGREE
_GIMBAL: Final = 1e-15  # cosine of RY below which RX and RZ turn about the same axis
_PARALLEL: Final = 1e-9  # sine of the angle below which two vectors count as parallel
_NO_TURN: Final = 1e-150

_Number = TypeVar("_Number", float, "NDArray[np.float64]")


# --- vectors ----------------------------------------------------------------------------------------------------------


def plus(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Return the difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(a: Vector, factor: float) -> Vector:
    """Return a vector times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def norm(a: Vector) -> float:
    """Return the length of a vector."""
    return math.hypot(a[0], a[1], a[2])


# --- orientations -----------------------------------------------------------------------------------------------------


def of_angles(rx: float, ry: float, rz: float) -> Quaternion:
    """Return the orientation given by RX, RY, RZ in degrees."""
    x, y, z = rx * _HALF, ry * _HALF, rz * _HALF
    cx, cy, cz = math.cos(x), math.cos(y), math.cos(z)
    sx, sy, sz = math.sin(x), math.sin(y), math.sin(z)
    return (
        cx * cy * cz + sx * sy * sz,
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
    )


def angles_of(turn: Quaternion) -> Vector:
    """Return RX, RY, RZ in degrees: -180 < RX, RZ <= 180, RY from -90 to 90.

    Near RY = -90 and 90, RX and RZ rotate about nearly the same axis. In this case, RX is computed from the result for
    RZ, so that the resulting orientation is as precise as for other values of RY.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, _, _) = matrix_of(*turn)
    rz = math.atan2(r10, r00) if math.hypot(r00, r10) >= _GIMBAL else math.atan2(-r01, r11)
    c, s = math.cos(rz), math.sin(rz)
    rx = math.atan2(s * r02 - c * r12, c * r11 - s * r01)
    ry = math.atan2(-r20, c * r00 + s * r10)
    return _above(rx * DEGREE), max(-90.0, min(ry * DEGREE, 90.0)), _above(rz * DEGREE)


def of_vectors(orient: Sequence[float], approach: Sequence[float]) -> Quaternion:
    """Return the orientation given by the orient vector O and the approach vector A of a pose of type T.

    A is the direction of Z, and the component of O perpendicular to A is the direction of Y.

    Raises:
        InvalidValue: If O or A is zero, or if O and A are parallel.
    """
    az = _unit(approach)
    oy = _unit(orient)
    along = oy[0] * az[0] + oy[1] * az[1] + oy[2] * az[2]
    across = oy[0] - along * az[0], oy[1] - along * az[1], oy[2] - along * az[2]
    if math.hypot(*across) < _PARALLEL:
        raise InvalidValue(tr("the orient and approach vectors are parallel"))
    b, e, h = _unit(across)
    c, f, i = az
    a, d, g = e * i - h * f, h * c - b * i, b * f - e * c
    w, x, y, z = of_matrix(a, b, c, d, e, f, g, h, i)
    size = math.hypot(w, x, y, z)
    return w / size, x / size, y / size, z / size


def of_matrix(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> tuple[float, float, float, float]:
    """Return the orientation given by a rotation matrix, as a quaternion w, x, y, z with a norm of 2 to 4.

    The arguments are the elements of the matrix, row by row. There are four formulas, one for each component of the
    quaternion. Each returns the quaternion multiplied by four times this component. The formula for the largest
    component is used, so that the norm is never near zero.
    """
    trace = a + e + i
    if trace >= a and trace >= e and trace >= i:
        return 1.0 + trace, h - f, c - g, d - b
    if a >= e and a >= i:
        return h - f, 1.0 + a - e - i, b + d, c + g
    if e >= i:
        return c - g, b + d, 1.0 + e - a - i, f + h
    return d - b, c + g, f + h, 1.0 + i - a - e


def matrix_of(
    w: _Number, x: _Number, y: _Number, z: _Number
) -> tuple[tuple[_Number, _Number, _Number], tuple[_Number, _Number, _Number], tuple[_Number, _Number, _Number]]:
    """Return the rows of the rotation matrix of an orientation, given by a unit quaternion.

    To convert many orientations in one call, pass arrays: each element of the rows is then an array.
    """
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def vectors_of(turn: Quaternion) -> tuple[float, float, float, float, float, float]:
    """Return the directions of the Y axis (O) and the Z axis (A) of an orientation: unit vectors, as six numbers."""
    (_, r01, r02), (_, r11, r12), (_, r21, r22) = matrix_of(*turn)
    return r01, r11, r21, r02, r12, r22


def rotvec_between(first: Quaternion, second: Quaternion) -> Vector:
    """Return the rotation from ``first`` to ``second``: its axis in the base frame times its angle, 0 to 180 deg."""
    a, b, c, d = first
    w, x, y, z = second
    real = w * a + x * b + y * c + z * d
    i = x * a - w * b - y * d + z * c
    j = y * a - w * c - z * b + x * d
    k = z * a - w * d - x * c + y * b
    sine = math.sqrt(i * i + j * j + k * k)
    if sine < _NO_TURN:
        return 0.0, 0.0, 0.0
    size = math.copysign(2.0 * DEGREE * math.atan2(sine, abs(real)) / sine, real)
    return i * size, j * size, k * size


def turned(orientation: Quaternion, turn: Vector) -> Quaternion:
    """Return an orientation after a rotation.

    Args:
        orientation: The orientation before the rotation.
        turn: The rotation: its axis in the base frame times its angle in degrees.
    """
    x, y, z = turn
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return orientation
    half = 0.5 * angle / DEGREE
    part = math.sin(half) / angle
    a, b, c, d = math.cos(half), x * part, y * part, z * part
    w, i, j, k = orientation
    p, q, r, s = (
        a * w - b * i - c * j - d * k,
        a * i + b * w + c * k - d * j,
        a * j + c * w + d * i - b * k,
        a * k + d * w + b * j - c * i,
    )
    size = 1.0 / math.sqrt(p * p + q * q + r * r + s * s)
    return p * size, q * size, r * size, s * size


def _unit(vector: Sequence[float]) -> Vector:
    x, y, z = vector
    size = math.hypot(x, y, z)
    if size < _NO_TURN:
        raise InvalidValue(tr("the orient or approach vector is zero"))
    return x / size, y / size, z / size


def _above(angle: float) -> float:
    """Return an angle with -180 replaced by 180, and negative zero by zero."""
    return 180.0 if angle <= -180.0 else angle + 0.0
