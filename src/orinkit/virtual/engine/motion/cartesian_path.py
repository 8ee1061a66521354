"""Courses: the way of the tool's tip (TCP) in the base frame, without time and without an arm.

A line, an arc, a turn about an axis, a free curve. Lengths are mm, angles degrees; a frame is a 4x4 matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from orinkit.arms.frames import rotation_between, turns_about
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.profile import Array

LONGEST_CURVE: Final = 5001
"""How many points a free curve can have, with the one where it begins."""

_FARTHEST: Final = 1e6  # mm; beyond it no arm reaches, and squares of it are still exact enough
_SAME_PLACE: Final = 1e-3  # mm; nearer points do not tell a circle
_COLLINEAR: Final = 1e-6  # sine of the angle between the chords of an arc
_MOST_DEGREES: Final = 36_000
_MOST_PARTS: Final = 20_000  # in which a curve is measured


@dataclass(frozen=True, slots=True)
class CartesianPath:
    """The way of the TCP.

    Attributes:
        frames: gives the TCP's frames, shape (N, 4, 4), at the parts u, shape (N,), of the way.
        length: mm that the TCP travels.
        angle: degrees that it turns.
        greatest_rate: mm per unit of u where it is farthest from one place to the next; the length, if u is even.
        greatest_turn: the same in degrees.
    """

    frames: Callable[[Array], Array]
    length: float
    angle: float
    greatest_rate: float
    greatest_turn: float


def line(start: Array, end: Array) -> CartesianPath:
    """Return the straight way between two frames, turning about one axis all the way.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if a frame is not finite, or farther away than any arm reaches.
    """
    start, end = _checked(start), _checked(end)
    way = end[:3, 3] - start[:3, 3]
    axis, angle = rotation_between(start[:3, :3], end[:3, :3])

    def frames(u: Array) -> Array:
        return _frames(turns_about(axis, angle * u) @ start[:3, :3], start[:3, 3] + u[:, None] * way, u, end)

    return _even(frames, float(np.linalg.norm(way)), angle)


def arc(start: Array, via: Array, end: Array) -> CartesianPath:
    """Return the circular way from one frame through a point to another frame.

    The orientation turns evenly from that of the start to that of the end, about one axis; that of the point on the
    way is not used.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE if two of the points are the same, or all
            three are on a line, so that there is no circle.
    """
    start, via, end = _checked(start), _checked(via), _checked(end)
    origin = start[:3, 3]
    a, b = via[:3, 3] - origin, end[:3, 3] - origin
    normal = np.cross(a, b)
    far_a, far_b, area = (float(np.linalg.norm(v)) for v in (a, b, normal))
    if min(far_a, far_b, float(np.linalg.norm(b - a))) < _SAME_PLACE or area < _COLLINEAR * far_a * far_b:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("an arc needs three different points that are not on a line"),
        )
    centre = np.cross(far_a**2 * b - far_b**2 * a, normal) / (2 * area**2)
    across = np.cross(normal / area, -centre)
    sweep = math.atan2(float(across @ (b - centre)), float(-centre @ (b - centre))) % math.tau
    axis, angle = rotation_between(start[:3, :3], end[:3, :3])

    def frames(u: Array) -> Array:
        positions = origin + _on_circle(-centre, across, sweep * u)
        return _frames(turns_about(axis, angle * u) @ start[:3, :3], positions, u, end)

    return _even(frames, float(np.linalg.norm(centre)) * sweep, angle)


def rotation(start: Array, axis: Array, point: Array, degrees: float, *, keep_orientation: bool) -> CartesianPath:
    """Return the way of a turn about an axis, by the right-hand rule.

    Args:
        start: where the TCP is.
        axis: direction of the axis, shape (3,), of any length but 0.
        point: a point on it, shape (3,), mm.
        degrees: how far; more than a turn and negative is allowed.
        keep_orientation: whether the tool keeps its orientation, or turns with it.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE for an axis without a direction, and for
            more than 100 turns.
    """
    start = _checked(start)
    length = float(np.linalg.norm(axis)) if np.all(np.abs(axis) <= _FARTHEST) else math.nan
    if not (length > _SAME_PLACE**2 and abs(degrees) <= _MOST_DEGREES and np.all(np.abs(point) <= _FARTHEST)):
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("a rotation needs an axis with a direction, a point, and an angle of up to 36,000 degrees"),
        )
    axis = axis / length
    arm = start[:3, 3] - point
    arm = arm - (arm @ axis) * axis
    turns = 0.0 if keep_orientation else degrees

    def frames(u: Array) -> Array:
        positions = start[:3, 3] + _on_circle(arm, np.cross(axis, arm), math.radians(degrees) * u)
        return _frames(turns_about(axis, turns * u) @ start[:3, :3], positions, u, None)

    return _even(frames, float(np.linalg.norm(arm)) * math.radians(abs(degrees)), abs(turns))


def curve(points: Sequence[Array]) -> CartesianPath:
    """Return the free curve through frames, the first of which is where the TCP is.

    Positions and orientations (as quaternions) are natural cubic splines over the distances of the points, so velocity
    and acceleration are continuous. A point that is the same as the one before it counts once.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE for no points, or more than 5,001.
    """
    if not 1 <= len(points) <= LONGEST_CURVE:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr(
                "a free curve has 1 to {most} points, not {count}",
                most=LONGEST_CURVE,
                count=len(points),
            ),
        )
    start = end = _checked(points[0])
    places, values = [0.0], [np.array([*start[:3, 3], 1.0, 0.0, 0.0, 0.0])]
    for point in points[1:]:
        frame = _checked(point)
        axis, angle = rotation_between(end[:3, :3], frame[:3, :3])
        far = max(float(np.linalg.norm(frame[:3, 3] - end[:3, 3])), angle)
        if far > _SAME_PLACE:
            places.append(places[-1] + far)
            values.append(np.concatenate((frame[:3, 3], _turned_quaternion(values[-1][3:], axis, angle))))
            end = frame
    if len(places) == 1:
        return line(start, start)
    spline = _natural_spline(np.array(places) / places[-1], np.array(values))

    def frames(u: Array) -> Array:
        value = spline(u)
        return _frames(_from_quaternions(value[:, 3:]) @ start[:3, :3], value[:, :3], u, end)

    return _measured(frames, min(64 * len(places), _MOST_PARTS))


def angles_between(a: Array, b: Array) -> Array:
    """Return the angles in degrees, shape (N,), between the orientations of frames, shape (N, 4, 4)."""
    # Of small angles the difference tells more than the trace.
    apart = np.linalg.norm(a[:, :3, :3] - b[:, :3, :3], axis=(1, 2))
    angles: Array = np.degrees(2 * np.arcsin(np.minimum(apart / math.sqrt(8), 1.0)))
    return angles


def _checked(frame: Array) -> Array:
    if not np.all(np.abs(frame) <= _FARTHEST):  # False for NaN too
        raise error_for(
            hresult.TARGET_OUT_OF_RANGE,
            tr("a coordinate is not a number that an arm can reach"),
        )
    return frame


def _even(frames: Callable[[Array], Array], length: float, angle: float) -> CartesianPath:
    return CartesianPath(frames, length, angle, length, angle)


def _measured(frames: Callable[[Array], Array], parts: int) -> CartesianPath:
    made = frames(np.linspace(0, 1, parts + 1))
    far = np.linalg.norm(np.diff(made[:, :3, 3], axis=0), axis=1)
    turn = angles_between(made[:-1], made[1:])
    return CartesianPath(
        frames, float(far.sum()), float(turn.sum()), float(far.max()) * parts, float(turn.max()) * parts
    )


def _frames(rotations: Array, positions: Array, u: Array, end: Array | None) -> Array:
    frames = np.zeros((len(u), 4, 4))
    frames[:, :3, :3] = rotations
    frames[:, :3, 3] = positions
    frames[:, 3, 3] = 1
    if end is not None:
        frames[u >= 1] = end
    return frames


def _on_circle(arm: Array, across: Array, angles: Array) -> Array:
    # From its first point, with no difference of large numbers however large the circle is.
    moved: Array = np.sin(angles)[:, None] * across - 2 * np.sin(angles / 2)[:, None] ** 2 * arm
    return moved


def _turned_quaternion(q: Array, axis: Array, degrees: float) -> Array:
    # Less than half a turn from one to the next: they never change their sign.
    half = math.radians(degrees) / 2
    w, v = math.cos(half), math.sin(half) * np.asarray(axis)
    return np.concatenate(([w * q[0] - v @ q[1:]], w * q[1:] + q[0] * v + np.cross(v, q[1:])))


def _from_quaternions(q: Array) -> Array:
    w, x, y, z = (q / np.linalg.norm(q, axis=1)[:, None]).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def _natural_spline(places: Array, values: Array) -> Callable[[Array], Array]:
    width = np.diff(places)[:, None]
    slope = np.diff(values, axis=0) / width
    bend = np.zeros_like(values)  # second derivatives: none at both ends
    if len(places) > 2:
        bend[1:-1] = _tridiagonal(
            width[:-1, 0], 2 * (width[:-1, 0] + width[1:, 0]), width[1:, 0], 6 * np.diff(slope, axis=0)
        )

    def spline(u: Array) -> Array:
        cell = np.clip(np.searchsorted(places, u, "right") - 1, 0, len(places) - 2)
        x = (u - places[cell])[:, None]
        h, low, high = width[cell], bend[cell], bend[cell + 1]
        start = slope[cell] - h * (2 * low + high) / 6
        value: Array = values[cell] + x * (start + x * (low / 2 + x * (high - low) / (6 * h)))
        return value

    return spline


def _tridiagonal(below: Array, middle: Array, above: Array, right: Array) -> Array:
    middle, right = middle.copy(), right.copy()
    for n in range(1, len(middle)):
        factor = below[n] / middle[n - 1]
        middle[n] -= factor * above[n - 1]
        right[n] -= factor * right[n - 1]
    right[-1] /= middle[-1]
    for n in range(len(middle) - 2, -1, -1):
        right[n] = (right[n] - above[n] * right[n + 1]) / middle[n]
    return right
