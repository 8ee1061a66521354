"""A smooth curve through the points of a trajectory: cubic splines over the sample number.

For points of a smooth motion, the curve is the spline with a continuous second derivative. Such a spline overshoots if
the motion is not smooth: before and after a jump, or at an abrupt stop. At these points the slopes are limited, so that
the curve stays between its points: a pause remains a pause, and a jump becomes a straight line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from operator import sub
from typing import TYPE_CHECKING, Final, NamedTuple

from orinkit.arms.geometry import Quaternion, angles_of, vectors_of
from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.finite_differences import Points, orientations
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.values.pose_numbers import FIG_AUTO

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind

_RATIO: Final = 2.0 - math.sqrt(3.0)  # limit of the elimination factors of the spline's equations
_SOLVED: Final = 40  # number of equations after which the factors equal the limit except for rounding
_ROUGH: Final = 0.5  # relative difference of neighbouring second differences above which a motion is not smooth
_STEEPEST: Final = 1.5  # largest slope, as a multiple of the smaller adjacent chord, if the motion is not smooth there
_HIGHEST: Final = 4.0 / 27.0  # overshoot of a cubic beyond its ends, as a multiple of the slope at an end


class Cubic(NamedTuple):
    """The cubics of one coordinate, one for each interval between samples: ``a + f * (b + f * (c + f * d))``.

    f is the fraction of the interval, from 0 to 1. Each attribute contains the coefficients of all intervals.
    """

    a: Sequence[float]
    b: Sequence[float]
    c: Sequence[float]
    d: Sequence[float]


class Curve:
    """The curve of a trajectory.

    Args:
        points: Two or more set-points, as ``read_trajectory`` returns them.
        kind: Pose type of the points. P and T are interpolated as positions and orientations.
        ranges: For J, lowest and highest value of each joint; the curve stays within them if the points do.
            Empty if there are no such limits, and for P and T.

    Attributes:
        coordinates: The cubics of each coordinate. For J, the coordinates are the joints. For P and T, they are three
            coordinates of the position, mm, and four of a quaternion, which is not normalized between the samples.

    Raises:
        TrajectoryError: If the figure of a P or T changes between samples.
        InvalidValue: If the orient and approach vectors of a T do not determine its orientation.
    """

    __slots__ = ("_figure", "_kind", "coordinates")

    def __init__(self, points: Points, kind: PoseKind, ranges: Sequence[tuple[float, float]] = ()) -> None:
        columns: list[Sequence[float]] = list(zip(*points, strict=True))
        self._kind = kind
        self._figure = float(FIG_AUTO)
        if kind != "J":
            self._figure = _figure_of(columns[-1])
            columns = [*columns[:3], *zip(*_without_flips(orientations(columns, kind)), strict=True)]
        everywhere = (-math.inf, math.inf)
        self.coordinates = [
            _cubic(column, *reach) for column, reach in zip_longest(columns, ranges, fillvalue=everywhere)
        ]

    def at(self, samples: Sequence[int], fractions: Sequence[float]) -> list[tuple[float, ...]]:
        """Return the poses at points of the curve.

        Args:
            samples: For each point of the curve, the number of the sample before it.
            fractions: For each point of the curve, the fraction of the interval to the next sample, 0 to 1.
        """
        columns = []
        for a, b, c, d in self.coordinates:
            columns.append([a[i] + f * (b[i] + f * (c[i] + f * d[i])) for i, f in zip(samples, fractions, strict=True)])
        if self._kind == "J":
            return list(zip(*columns, strict=True))
        return [self._pose(values) for values in zip(*columns, strict=True)]

    def _pose(self, values: Sequence[float]) -> tuple[float, ...]:
        x, y, z, *turn = values
        size = math.hypot(*turn)
        a, b, c, d = turn
        unit = a / size, b / size, c / size, d / size
        return (x, y, z, *(angles_of(unit) if self._kind == "P" else vectors_of(unit)), self._figure)


def _cubic(column: Sequence[float], lower: float, upper: float) -> Cubic:
    chords = list(map(sub, column[1:], column))
    slopes = _limited(_slopes(column, chords), chords)
    _keep_within(column, slopes, chords, lower, upper)
    c = [3 * chord - 2 * b - e for chord, b, e in zip(chords, slopes[:-1], slopes[1:], strict=True)]
    d = [b + e - 2 * chord for chord, b, e in zip(chords, slopes[:-1], slopes[1:], strict=True)]
    return Cubic(column[:-1], slopes[:-1], c, d)


def _slopes(column: Sequence[float], chords: Sequence[float]) -> list[float]:
    """Return the slope of the spline at each sample; the slopes at both ends are estimates.

    The slopes b and the values y of three successive samples satisfy ``b0 + 4 b1 + b2 = 3 (y2 - y0)``.
    """
    if len(chords) < 3:
        bend = 0.5 * (chords[-1] - chords[0])
        return [chord - bend for chord in chords[:1]] + [chords[0] + bend] * (len(chords) - 1) + [chords[-1] + bend]
    first = (
        11.0 * chords[0] - 7.0 * chords[1] + 2.0 * chords[2]
    ) / 6.0  # slope of the cubic through the first four points
    last = (11.0 * chords[-1] - 7.0 * chords[-2] + 2.0 * chords[-3]) / 6.0
    ratio = [0.0]
    while len(ratio) < min(len(chords), _SOLVED):
        ratio.append(1.0 / (4.0 - ratio[-1]))
    ratio.extend([_RATIO] * (len(chords) - len(ratio)))
    done = first
    forward = [first]
    for after, before, part in zip(column[2:], column, ratio[1:], strict=False):
        done = (3.0 * (after - before) - done) * part
        forward.append(done)
    slopes = [last]
    for done, part in zip(reversed(forward), reversed(ratio), strict=True):
        last = done - part * last
        slopes.append(last)
    slopes.reverse()
    return slopes


def _limited(slopes: list[float], chords: Sequence[float]) -> list[float]:
    """Limit the slopes that would make the curve overshoot, and return all slopes."""
    if len(chords) < 3:
        return slopes
    bends = list(map(sub, chords[1:], chords))
    bends = [bends[0], *bends, bends[-1]]
    for place in range(1, len(chords)):
        before, after = chords[place - 1], chords[place]
        slope, middle, bend = slopes[place], 0.5 * (before + after), bends[place]
        left, right = abs(bend - bends[place - 1]), abs(bends[place + 1] - bend)
        room = 0.5 * (abs(bend) + (min(right, left)))
        if not -room <= slope - middle <= room:
            slope = middle + (room if slope > middle else -room)
        if left > _ROUGH * abs(bend) or right > _ROUGH * abs(bend):
            most = _STEEPEST * min(abs(before), abs(after))
            if not -most <= slope <= most:
                slope = most if slope > 0.0 else -most
        slopes[place] = slope
    for place, chord, bend, beside in (
        (0, chords[0], bends[1], bends[2:3]),
        (-1, chords[-1], bends[-2], bends[-3:-2]),
    ):
        if any(abs(other - bend) > _ROUGH * abs(bend) for other in beside):
            ends = (0.0, _STEEPEST * chord)
            slopes[place] = min(max(slopes[place], min(ends)), max(ends))
    return slopes


def _keep_within(
    column: Sequence[float], slopes: list[float], chords: Sequence[float], lower: float, upper: float
) -> None:
    """Limit the slopes of intervals in which the curve could leave a range; it then stays between its points there."""
    steepest = _HIGHEST * 2 * max(map(abs, slopes))
    if min(column) - steepest >= lower and max(column) + steepest <= upper:
        return
    for place, chord in enumerate(chords):
        room = _HIGHEST * (abs(slopes[place]) + abs(slopes[place + 1]))
        low, high = (column[place], column[place + 1]) if chord > 0.0 else (column[place + 1], column[place])
        if low - room < lower or high + room > upper:
            for end in (place, place + 1):
                before, after = chords[max(end - 1, 0)], chords[min(end, len(chords) - 1)]
                most = _STEEPEST * min(abs(before), abs(after)) if before * after > 0.0 else 0.0
                slopes[end] = math.copysign(min(abs(slopes[end]), most), before)


def _figure_of(column: Sequence[float]) -> float:
    for sample, figure in enumerate(column):
        if figure != column[0]:
            raise TrajectoryError(
                tr(
                    "sample {sample} (counted from 0): the figure changes from {before:g} to {after:g} at an "
                    "unknown point between samples. Try: use joints, or the figure -1; the controller then "
                    "chooses the figure",
                    sample=sample,
                    before=column[0],
                    after=figure,
                ),
                sample,
                None,
            )
    return column[0]


def _without_flips(turns: list[Quaternion]) -> list[Quaternion]:
    """Return the same orientations; choose the sign of each quaternion so that it is near the previous one."""
    w, x, y, z = turns[0]
    chosen = []
    for turn in turns:
        a, b, c, d = turn
        if w * a + x * b + y * c + z * d < 0.0:
            a, b, c, d = -a, -b, -c, -d
        w, x, y, z = a, b, c, d
        chosen.append((a, b, c, d))
    return chosen
