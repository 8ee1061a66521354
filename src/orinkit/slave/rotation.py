"""Turning orientations, in the numbers of a stream (see also :mod:`orinkit.slave.orientation`)."""

from __future__ import annotations

import math
from typing import Final

from orinkit.slave.orientation import DEGREE, Quaternion, Vector

_GIMBAL: Final = 1e-15  # cosine of RY below which RX and RZ turn about the same axis


def turned(orientation: Quaternion, turn: Vector) -> Quaternion:
    """Return an orientation after a rotation.

    Args:
        orientation: before it.
        turn: axis in the base, times the angle in degrees.
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


def angles_of(orientation: Quaternion) -> Vector:
    """Return RX, RY, RZ in degrees: -180 < RX, RZ <= 180, RY from -90 to 90.

    Where RY is near its end, RX and RZ turn about nearly the same axis: RX is worked out with RZ as it is then, so that
    together they are as exact as elsewhere.
    """
    w, x, y, z = orientation
    r00, r01, r02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    r10, r11, r12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    r20 = 2.0 * (x * z - w * y)
    rz = math.atan2(r10, r00) if math.hypot(r00, r10) >= _GIMBAL else math.atan2(-r01, r11)
    c, s = math.cos(rz), math.sin(rz)
    rx = math.atan2(s * r02 - c * r12, c * r11 - s * r01)
    ry = math.atan2(-r20, c * r00 + s * r10) * DEGREE
    return _above(rx * DEGREE), min(max(ry, -90.0), 90.0), _above(rz * DEGREE)


def _above(angle: float) -> float:
    """Return 180 for -180, and no negative zero."""
    return 180.0 if angle <= -180.0 else angle + 0.0
