"""Cartesian paths of the tool centre point (TCP) in the base frame, independent of time and of the arm.

A path is a line, an arc, a rotation about an axis, or a free curve. Lengths are in mm, angles in degrees. A frame is a
position and an orientation, as a 4x4 matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from orinkit.arms.frames import rotation_between, turns_about
from orinkit.arms.geometry import matrix_of
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.engine.motion.profile import Array

LONGEST_CURVE: Final = 5001
"""Largest number of points of a free curve, including its start."""

_FARTHEST: Final = 1e6  # mm; no arm reaches that far, and its square is still exact enough
_SAME_POINT: Final = 1e-3  # mm; closer points do not define a circle
_COLLINEAR: Final = 1e-6  # smallest sine of the angle between the chords of an arc
_MAX_DEGREES: Final = 36_000  # of a rotation
_MAX_PARTS: Final = 20_000  # largest number of parts into which a curve is divided to measure it


@record
class CartesianPath:
    """A path of the TCP with the parameter u from 0 to 1.

    Attributes:
        frames: Function that returns the frames of the TCP, shape (N, 4, 4), at the parameters u, shape (N,).
        length: Distance that the TCP travels, mm.
        angle: Angle by which the TCP turns, degrees.
        greatest_rate: Largest rate at which the TCP travels along the path, mm per unit of u. It is equal to ``length``
            if u is proportional to the distance travelled.
        greatest_turn: Largest rate at which the TCP turns, degrees per unit of u.
    """

    frames: Callable[[Array], Array]
    length: float
    angle: float
    greatest_rate: float
    greatest_turn: float


def line(start: Array, end: Array) -> CartesianPath:
    """Return the straight path between two frames; the orientation turns about a single axis.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if a frame is not finite, or farther away than any arm reaches.
    """
    start, end = _checked(start), _checked(end)
    displacement = end[:3, 3] - start[:3, 3]
    axis, angle = rotation_between(start[:3, :3], end[:3, :3])

    def frames(u: Array) -> Array:
        return _frames(turns_about(axis, angle * u) @ start[:3, :3], start[:3, 3] + u[:, None] * displacement, u, end)

    return _even(frames, float(np.linalg.norm(displacement)), angle)


def arc(start: Array, via: Array, end: Array) -> CartesianPath:
    """Return the circular path from a start frame through a via point to an end frame.

    The orientation turns evenly about a single axis, from the orientation of ``start`` to the orientation of ``end``.
    The orientation of ``via`` is not used.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE if two of the points coincide or all
            three are on a line, so that there is no circle.
    """
    start, via, end = _checked(start), _checked(via), _checked(end)
    origin = start[:3, 3]
    a, b = via[:3, 3] - origin, end[:3, 3] - origin
    normal = np.cross(a, b)
    far_a, far_b, area = (float(np.linalg.norm(v)) for v in (a, b, normal))
    if min(far_a, far_b, float(np.linalg.norm(b - a))) < _SAME_POINT or area < _COLLINEAR * far_a * far_b:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("an arc requires three different points that are not on a line"),
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
    """Return the path of a rotation about an axis, by the right-hand rule.

    Args:
        start: The start frame of the TCP.
        axis: Direction of the axis, shape (3,), of any length except 0.
        point: A point on the axis, shape (3,), mm.
        degrees: The angle; negative angles and more than one turn are allowed.
        keep_orientation: True if the tool keeps its orientation; False if it turns about the axis too.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE if the axis has no direction, or the
            angle is more than 100 turns.
    """
    start = _checked(start)
    length = float(np.linalg.norm(axis)) if np.all(np.abs(axis) <= _FARTHEST) else math.nan
    if not (length > _SAME_POINT**2 and abs(degrees) <= _MAX_DEGREES and np.all(np.abs(point) <= _FARTHEST)):
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr(
                "a rotation requires an axis whose vector is not zero, a point on the axis, and an angle of up to "
                "36,000 deg"
            ),
        )
    axis = axis / length
    radius = start[:3, 3] - point
    radius = radius - (radius @ axis) * axis
    turns = 0.0 if keep_orientation else degrees

    def frames(u: Array) -> Array:
        positions = start[:3, 3] + _on_circle(radius, np.cross(axis, radius), math.radians(degrees) * u)
        return _frames(turns_about(axis, turns * u) @ start[:3, :3], positions, u, None)

    return _even(frames, float(np.linalg.norm(radius)) * math.radians(abs(degrees)), abs(turns))


def curve(points: Sequence[Array]) -> CartesianPath:
    """Return the free curve through frames; the first one is the start frame of the TCP.

    Positions and orientations (as quaternions) are interpolated by natural cubic splines, so velocity and acceleration
    are continuous. The parameter of the splines is the sum of the distances between successive points; a distance is
    the number of mm, or the number of degrees if that is larger. A point that coincides with the one before it is
    skipped.

    Raises:
        CallError: TARGET_OUT_OF_RANGE as for :func:`line`; VALUE_OUT_OF_RANGE if there are no points, or more than
            5,001.
    """
    if not 1 <= len(points) <= LONGEST_CURVE:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr(
                "a free curve must have 1 to {most} points, not {count}",
                most=LONGEST_CURVE,
                count=len(points),
            ),
        )
    start = end = _checked(points[0])
    distances, values = [0.0], [np.array([*start[:3, 3], 1.0, 0.0, 0.0, 0.0])]
    for point in points[1:]:
        frame = _checked(point)
        axis, angle = rotation_between(end[:3, :3], frame[:3, :3])
        far = max(float(np.linalg.norm(frame[:3, 3] - end[:3, 3])), angle)
        if far > _SAME_POINT:
            distances.append(distances[-1] + far)
            values.append(np.concatenate((frame[:3, 3], _turned_quaternion(values[-1][3:], axis, angle))))
            end = frame
    if len(distances) == 1:
        return line(start, start)
    spline = _natural_spline(np.array(distances) / distances[-1], np.array(values))

    def frames(u: Array) -> Array:
        value = spline(u)
        return _frames(_from_quaternions(value[:, 3:]) @ start[:3, :3], value[:, :3], u, end)

    return measured(frames, min(64 * len(distances), _MAX_PARTS))


def angles_between(a: Array, b: Array) -> Array:
    """Return the angles in degrees, shape (N,), between each frame of ``a`` and the frame of ``b`` at the same index.

    ``a`` and ``b`` have the shape (N, 4, 4).
    """
    # For small angles the difference is more precise than the trace.
    apart = np.linalg.norm(a[:, :3, :3] - b[:, :3, :3], axis=(1, 2))
    angles: Array = np.degrees(2 * np.arcsin(np.minimum(apart / math.sqrt(8), 1.0)))
    return angles


def _checked(frame: Array) -> Array:
    if not np.all(np.abs(frame) <= _FARTHEST):  # False for NaN too
        raise error_for(
            hresult.TARGET_OUT_OF_RANGE,
            tr("a coordinate is not finite, or farther away than any arm reaches"),
        )
    return frame


def _even(frames: Callable[[Array], Array], length: float, angle: float) -> CartesianPath:
    return CartesianPath(frames, length, angle, length, angle)


def measured(frames: Callable[[Array], Array], parts: int) -> CartesianPath:
    """Return the path of a function, whose lengths are measured in a number of parts.

    Args:
        frames: Function that returns the frames of the TCP, shape (N, 4, 4), at parameters from 0 to 1, shape (N,).
        parts: Number of parts.
    """
    samples = frames(np.linspace(0, 1, parts + 1))
    far = np.linalg.norm(np.diff(samples[:, :3, 3], axis=0), axis=1)
    turn = angles_between(samples[:-1], samples[1:])
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


def _on_circle(radius: Array, across: Array, angles: Array) -> Array:
    # Relative to the first point, to avoid differences of large numbers if the circle is very large.
    moved: Array = np.sin(angles)[:, None] * across - 2 * np.sin(angles / 2)[:, None] ** 2 * radius
    return moved


def _turned_quaternion(q: Array, axis: Array, degrees: float) -> Array:
    # Successive points are less than half a turn apart, so the quaternions never change their sign.
    half = math.radians(degrees) / 2
    w, v = math.cos(half), math.sin(half) * np.asarray(axis)
    return np.concatenate(([w * q[0] - v @ q[1:]], w * q[1:] + q[0] * v + np.cross(v, q[1:])))


def _from_quaternions(q: Array) -> Array:
    w, x, y, z = (q / np.linalg.norm(q, axis=1)[:, None]).T
    return np.moveaxis(np.array(matrix_of(w, x, y, z)), 2, 0)


def _natural_spline(distances: Array, values: Array) -> Callable[[Array], Array]:
    width = np.diff(distances)[:, None]
    slope = np.diff(values, axis=0) / width
    curvature = np.zeros_like(values)  # second derivatives: zero at both ends
    if len(distances) > 2:
        curvature[1:-1] = _tridiagonal(
            width[:-1, 0], 2 * (width[:-1, 0] + width[1:, 0]), width[1:, 0], 6 * np.diff(slope, axis=0)
        )

    def spline(u: Array) -> Array:
        cell = np.clip(np.searchsorted(distances, u, "right") - 1, 0, len(distances) - 2)
        x = (u - distances[cell])[:, None]
        h, low, high = width[cell], curvature[cell], curvature[cell + 1]
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
