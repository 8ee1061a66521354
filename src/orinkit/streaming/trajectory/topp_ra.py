"""TOPP-RA: time-optimal path parameterization based on reachability analysis.

The algorithm is that of H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", IEEE Transactions on Robotics 34(3), 2018.

The path parameter is s, the number of the sample; its rate ds/dt is limited to 1 sample per period. The state is
z = (ds/dt)^2, and the control is u = d2s/dt2. All constraints are linear in z and u: with the derivatives q' and q'' of
a coordinate q with respect to s, ``|q' u + q'' z| <= acceleration`` and ``q'^2 z <= velocity^2``. The path is divided
into cells with constant u. The ends of the cells are the grid points.

The backward pass, from the end to the start, computes the controllable set at each grid point: the interval of z from
which the end can be reached within all constraints. Only the upper end of the interval is required. It is computed by
Newton's method; a linear program is not required. The forward pass, from the start to the end, applies the greatest u
for which z stays in the controllable sets.

A second difference of set-points is a mean of the accelerations of the motion. Therefore the set-points satisfy every
limit that the motion satisfies. Time is in periods, and accelerations are fractions of their limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple, Protocol, TypeAlias

from orinkit.arms.geometry import DEGREE
from orinkit.streaming.trajectory.spline import Cubic

Terms: TypeAlias = list[tuple[float, float]]
"""Constraints on accelerations: each pair (a, b) means ``-1 <= a * u + b * z <= 1``.

u is d2s/dt2, and z is (ds/dt)^2; s is the number of the sample.
"""

_MOST_CELLS: Final = 64  # cells of an interval between samples
_MARGIN: Final = (
    0.998  # part of the limits to use: inside a cell, an acceleration can be slightly greater than at its ends
)
_HIGH_CURVATURE: Final = 4.0  # q'' above which an interval with a small q' at an end is divided into more cells
_STEEPNESS: Final = 5.0  # cells per root of q'' / q' at an end: q' then changes by a tenth in the first cell
_LOW_CURVATURE: Final = 0.2  # q'' / q' up to which q' hardly changes from sample to sample
_NOTHING: Final = 1e-12
_LEAST: Final = 0.01  # lower bound of z, as a fraction of the greatest z at a grid point
_MAX_NEWTON_STEPS: Final = 30  # two or three are usual: a step is exact while the active constraints are the same
_DIRECTIONS: Final = tuple((math.cos(n * math.pi / 6), math.sin(n * math.pi / 6)) for n in range(6))
_INSCRIBED: Final = 1.0 / math.cos(math.pi / 12)  # makes the polygon of these directions lie within the circle


class CurveConstraints(Protocol):
    """The constraints that limits impose on a curve."""

    def feasible_at_full_rate(self) -> list[bool]:
        """Return, for each interval between samples, True if a rate of 1 sample per period is within the limits."""

    def at(self, interval: int, fraction: float) -> tuple[Terms, float]:
        """Return the constraints on accelerations at a point of an interval, and the greatest z = (ds/dt)^2 there.

        s is the number of the sample. The velocity limits restrict its rate, which is at most 1 sample per period.
        """


class JointConstraints:
    """The constraints of joint limits, independent for each joint.

    Args:
        coordinates: Coordinates of the curve, one per joint.
        velocity: Velocity limit of each joint, deg or mm per period.
        acceleration: Acceleration limit of each joint, deg or mm per period squared.
    """

    __slots__ = ("_count", "_joints")

    def __init__(self, coordinates: Sequence[Cubic], velocity: Sequence[float], acceleration: Sequence[float]) -> None:
        self._joints = [
            (_scaled(cubic.b, most), _scaled(cubic.c, most), _scaled(cubic.d, most), (most / fastest) ** 2)
            for cubic, fastest, most in zip(coordinates, velocity, acceleration, strict=True)
            if any(cubic.b) or any(cubic.c)
        ]
        self._count = len(coordinates[0].b)

    def feasible_at_full_rate(self) -> list[bool]:
        """Return, for each interval between samples, True if a rate of 1 sample per period is within the limits."""
        free = [True] * self._count
        for b, c, d, scale in self._joints:
            fastest = 1.0 / math.sqrt(scale)
            free = [
                known
                and -0.5 <= bend <= 0.5
                and -0.5 <= bend + 3.0 * change <= 0.5
                and -fastest <= slope <= fastest
                and -fastest <= slope + bend + 0.75 * change <= fastest
                and -fastest <= slope + 2.0 * bend + 3.0 * change <= fastest
                for known, slope, bend, change in zip(free, b, c, d, strict=True)
            ]
        return free

    def at(self, interval: int, fraction: float) -> tuple[Terms, float]:
        """Return the constraints on accelerations at a point of an interval, and the greatest z = (ds/dt)^2 there.

        s is the number of the sample. The velocity limits restrict its rate, which is at most 1 sample per period.
        """
        terms = []
        fastest = 1.0
        for b, c, d, scale in self._joints:
            bend, change = c[interval], 3.0 * fraction * d[interval]
            slope = b[interval] + fraction * (2.0 * bend + change)
            terms.append((slope, 2.0 * (bend + change)))
            speed = slope * slope * scale
            if speed > fastest:
                fastest = speed
        return terms, 1.0 / fastest


class PathConstraints:
    """The constraints of tool limits, on the magnitudes of velocity and acceleration, linear and angular.

    Args:
        coordinates: Coordinates of the curve: three of the position, four of a quaternion.
        speed: Velocity limit, mm per period.
        acceleration: Acceleration limit, mm per period squared.
        rotation: Angular velocity limit, degrees per period.
        rotation_acceleration: Angular acceleration limit, degrees per period squared.
    """

    __slots__ = ("_acceleration", "_place", "_rotation", "_rotation_acceleration", "_speed", "_turn")

    def __init__(
        self,
        coordinates: Sequence[Cubic],
        speed: float,
        acceleration: float,
        rotation: float,
        rotation_acceleration: float,
    ) -> None:
        self._place, self._turn = coordinates[:3], coordinates[3:]
        self._speed, self._acceleration = speed, acceleration
        self._rotation, self._rotation_acceleration = rotation, rotation_acceleration

    def feasible_at_full_rate(self) -> list[bool]:
        """Return, for each interval between samples, True if a rate of 1 sample per period is within the limits."""
        free = []
        for interval in range(len(self._place[0].b)):
            rows = [self.at(interval, place) for place in (0.0, 0.5, 1.0)]
            free.append(all(cap >= 1.0 and all(abs(bend) <= 1.0 for _, bend in terms) for terms, cap in rows))
        return free

    def at(self, interval: int, fraction: float) -> tuple[Terms, float]:
        """Return the constraints on accelerations at a point of an interval, and the greatest z = (ds/dt)^2 there.

        s is the number of the sample. The velocity limits restrict its rate, which is at most 1 sample per period.
        """
        rows = [_derivatives(cubic, interval, fraction) for cubic in self._place]
        slope, along, across = _along(rows)
        terms = _polygon_terms(slope, along, across, self._acceleration)
        fastest = max(1.0, (slope / self._speed) ** 2)
        rows = _on_sphere([_derivatives(cubic, interval, fraction) for cubic in self._turn])
        slope, along, across = _along(rows)
        terms += _polygon_terms(slope, along, across, self._rotation_acceleration)
        return terms, 1.0 / max(fastest, (slope / self._rotation) ** 2)


class SpeedProfile(NamedTuple):
    """The time parameterization of a curve.

    Attributes:
        squares: Square of the rate in samples per period, at each end of a cell, beginning with the start of the curve.
        cells: Number of cells of each interval between samples.
        periods: Duration of the motion, in periods.
    """

    squares: Sequence[float]
    cells: Sequence[int]
    periods: float

    def sampled(self) -> tuple[list[int], list[float]]:
        """Return the points of the curve that are reached after each period, except the first and the last one.

        A point is the number of the sample before it, and the fraction of the interval to the next sample. The motion
        is slowed down by a fraction of a period, so that it ends after a whole number of periods.
        """
        count = math.ceil(self.periods - 1e-6)
        pace = self.periods / count
        samples: list[int] = []
        fractions: list[float] = []
        number, wanted, began = 1, pace, 0.0
        for interval, begin, width, first, last in self._walk():
            took = 2.0 * width / (math.sqrt(first) + math.sqrt(last))
            while wanted < began + took and number < count:
                time = wanted - began
                far = time * (math.sqrt(first) + time * (last - first) / (4.0 * width))
                samples.append(interval)
                fractions.append(begin + min(far, width))
                number += 1
                wanted = number * pace
            began += took
        missing = count - 1 - len(samples)  # places at the end that are missing because of rounding
        return samples + [len(self.cells) - 1] * missing, fractions + [1.0] * missing

    def _walk(self) -> Iterator[tuple[int, float, float, float, float]]:
        place = 0
        for interval, count in enumerate(self.cells):
            for begin, end in pairwise(_grid(count)):
                yield interval, begin, end - begin, self.squares[place], self.squares[place + 1]
                place += 1


class Cells(NamedTuple):
    """The cells of a curve: the parts into which each interval between samples is divided.

    In a cell, the acceleration in samples per period squared is constant.

    Attributes:
        feasible_at_full_rate: For each interval between samples, True if a rate of 1 sample per period is within the
            limits.
        counts: Number of cells of each interval.
    """

    feasible_at_full_rate: Sequence[bool]
    counts: Sequence[int]


def cells_of(constraints: CurveConstraints) -> Cells:
    """Divide a curve into cells; an interval that takes n periods is divided into about n cells."""
    free = constraints.feasible_at_full_rate()
    last = len(free) - 1
    return Cells(
        free,
        [
            1 if known and 0 < interval < last else _count(constraints, interval, at_end=interval in (0, last))
            for interval, known in enumerate(free)
        ],
    )


def profile_of(constraints: CurveConstraints, cells: Cells, allowed: Sequence[float]) -> SpeedProfile:
    """Return the time-optimal parameterization of a curve, with standstill at both ends.

    Args:
        constraints: The constraints.
        cells: The cells of the curve.
        allowed: For each interval between samples, the fraction of the limits that may be used.
    """
    free = [known and part == 1.0 for known, part in zip(cells.feasible_at_full_rate, allowed, strict=True)]
    controllable = _backward_pass(constraints, allowed, cells.counts, free)
    squares = _forward_pass(constraints, allowed, cells.counts, free, controllable)
    periods = 0.0
    place = 0
    for count in cells.counts:
        for begin, end in pairwise(_grid(count)):
            periods += 2.0 * (end - begin) / (math.sqrt(squares[place]) + math.sqrt(squares[place + 1]))
            place += 1
    return SpeedProfile(squares, cells.counts, periods)


def _count(constraints: CurveConstraints, interval: int, *, at_end: bool) -> int:
    (begin, cap), (end, other) = constraints.at(interval, 0.0), constraints.at(interval, 1.0)
    bend = max([abs(row[1]) for row in (*begin, *end)], default=0.0)
    slopes = max([abs(row[0]) for row in begin], default=0.0), max([abs(row[0]) for row in end], default=0.0)
    if not at_end and bend <= _LOW_CURVATURE * min(slopes) and bend <= 1.0:
        return 1
    middle, third = constraints.at(interval, 0.5)
    largest = max(*slopes, *[abs(row[0]) for row in middle], _NOTHING)
    periods = math.sqrt(max(bend, 1.0 / min(cap, other, third)))
    if at_end:  # the interval begins or ends at standstill
        return min(_MOST_CELLS, math.ceil(max(periods, math.sqrt(2.0 * largest))))
    changes = [max(abs(b[0] - a[0]), abs(c[0] - b[0])) for a, b, c in zip(begin, middle, end, strict=True)]
    part = min(1.0, 4.0 * max(changes, default=0.0) / largest)  # fewer cells if the slopes hardly change
    if min(cap, other) > third:
        part = max(part, 0.5)  # the velocity limits are active, mainly in the middle of the interval
    steep = _STEEPNESS * math.sqrt(bend / max(min(slopes), _NOTHING)) if bend > _HIGH_CURVATURE else 0.0
    return max(1, min(_MOST_CELLS, math.ceil(max(periods * part, steep))))


@lru_cache(maxsize=_MOST_CELLS)
def _grid(count: int) -> tuple[float, ...]:
    """Return the ends of the ``count`` cells of an interval, as fractions of the interval from 0 to 1.

    The cells at both ends of the interval are short, because the arm may stand there.
    """
    return (0.0, *(0.5 - 0.5 * math.cos(math.pi * number / count) for number in range(1, count)), 1.0)


def _backward_pass(
    constraints: CurveConstraints, allowed: Sequence[float], cells: Sequence[int], free: Sequence[bool]
) -> list[float]:
    """Backward pass: return the greatest controllable z at each end of a cell.

    z is the square of the rate in samples per period. It is controllable if the motion can reach the end of the curve
    from it within all constraints.
    """
    controllable = [0.0]
    following = 0.0
    for interval in range(len(cells) - 1, -1, -1):
        if free[interval] and following == 1.0 and cells[interval] == 1:
            controllable.append(1.0)
            continue
        count, part = cells[interval], allowed[interval] * _MARGIN
        end, cap_end = constraints.at(interval, 1.0)
        controllable[-1] = following = min(following, _cap(cap_end, part))
        for place, after in pairwise(reversed(_grid(count))):
            begin, cap = constraints.at(interval, after)
            width = 2.0 * (place - after)
            rows, most = _cell_constraints(begin, end, width, part, _cap(cap, part))
            least = _LEAST * min([following, *[limit * width for limit, _ in rows]])
            following = _max_controllable(rows, most, following, least, width)
            controllable.append(following)
            end = begin
    controllable.reverse()
    return controllable


def _forward_pass(
    constraints: CurveConstraints,
    allowed: Sequence[float],
    cells: Sequence[int],
    free: Sequence[bool],
    controllable: Sequence[float],
) -> list[float]:
    """Forward pass: return z, the square of the rate in samples per period, at each end of a cell.

    In each cell, the acceleration is the greatest one for which z satisfies the constraints and remains controllable.
    """
    z = 0.0
    squares = [z]
    place = 0
    for interval, count in enumerate(cells):
        if free[interval] and z == 1.0 and count == 1 and controllable[place + 1] == 1.0:
            place += 1
            squares.append(z)
            continue
        part = allowed[interval] * _MARGIN
        begin, _ = constraints.at(interval, 0.0)
        for before, after in pairwise(_grid(count)):
            end, _ = constraints.at(interval, after)
            width = 2.0 * (after - before)
            rows, _ = _cell_constraints(begin, end, width, part, 1.0)
            place += 1
            rate = (controllable[place] - z) / width
            for most, fall in rows:
                if most - fall * z < rate:
                    rate = most - fall * z
            z = min(max(z + width * rate, 0.0), controllable[place])
            squares.append(z)
            begin = end
    return squares


def _cap(cap: float, part: float) -> float:
    return 1.0 if cap >= 1.0 else cap * part * part


def _cell_constraints(begin: Terms, end: Terms, width: float, part: float, cap: float) -> tuple[Terms, float]:
    """Return the constraints on u in a cell, and the greatest z at the beginning of the cell.

    u is d2s/dt2, and z is (ds/dt)^2 at the beginning of the cell; s is the number of the sample. A constraint is a pair
    (most, fall), which means ``-most - fall * z <= u <= most - fall * z``.

    Args:
        begin: Constraints on accelerations at the beginning of the cell.
        end: Constraints on accelerations at the end of the cell, at which z has become ``z + width * u``.
        width: Twice the length of the cell.
        part: Fraction of the limits that may be used.
        cap: Upper bound of z that results from the velocity limits.
    """
    rows = []
    for slope, bend in begin:
        if -_NOTHING < slope < _NOTHING:
            if abs(bend) * cap > part:
                cap = part / abs(bend)
        else:
            rows.append((part / abs(slope), bend / slope))
    for slope, bend in end:
        both = slope + width * bend
        if -_NOTHING < both < _NOTHING:
            if abs(bend) * cap > part:
                cap = part / abs(bend)
        else:
            rows.append((part / abs(both), bend / both))
    return rows, cap


def _max_controllable(rows: Terms, cap: float, following: float, least: float, width: float) -> float:
    """Return the greatest controllable z at the beginning of a cell, at most ``cap``.

    z is (ds/dt)^2, and u is d2s/dt2; s is the number of the sample. z is controllable if a u exists that satisfies the
    constraints ``rows`` (see :func:`_cell_constraints`) and leads to a controllable z at the end of the cell:
    ``least <= z + width * u <= following``. ``least`` is slightly above 0: if the arm stopped before a point that it
    must pass slowly, it could not continue. The length of the interval of permitted u is a concave function of z.
    Therefore Newton's method converges from above to the z at which this length is 0, without undershooting.
    """
    z = cap
    for _ in range(_MAX_NEWTON_STEPS):
        top, top_slope = (following - z) / width, -1.0 / width
        bottom, bottom_slope = (least - z) / width, -1.0 / width
        for most, fall in rows:
            shift = fall * z
            if most - shift < top:
                top, top_slope = most - shift, -fall
            if -most - shift > bottom:
                bottom, bottom_slope = -most - shift, -fall
        room = top - bottom
        steepness = top_slope - bottom_slope
        if room >= 0.0:
            return z
        if steepness >= 0.0:
            return 0.0
        step = room / steepness
        z -= step
        if step <= 1e-13 * cap or z <= 0.0:
            break
    return max(z, 0.0) * (1.0 - 1e-9)


def _scaled(column: Sequence[float], unit: float) -> list[float]:
    return [value / unit for value in column]


def _derivatives(cubic: Cubic, interval: int, fraction: float) -> tuple[float, float, float]:
    """Return a coordinate at a point of an interval, and its derivatives with respect to the number of the sample."""
    a, b, c, d = (column[interval] for column in cubic)
    return (
        a + fraction * (b + fraction * (c + fraction * d)),
        b + fraction * (2.0 * c + fraction * 3.0 * d),
        2.0 * c + 6.0 * fraction * d,
    )


def _along(rows: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Return the length of a first derivative, and the parts of the second derivative along and across the first.

    Each row contains one coordinate, and its first and second derivatives.
    """
    slope = math.hypot(*[row[1] for row in rows])
    bend = math.hypot(*[row[2] for row in rows])
    if slope < _NOTHING:
        return 0.0, 0.0, bend
    along = sum([row[1] * row[2] for row in rows]) / slope
    return slope, along, math.sqrt(max(0.0, bend * bend - along * along))


def _polygon_terms(slope: float, along: float, across: float, most: float) -> Terms:
    """Return constraints that keep an acceleration within a twelve-sided polygon in the circle of radius ``most``."""
    size = _INSCRIBED / most
    return [(slope * cosine * size, (along * cosine + across * sine) * size) for cosine, sine in _DIRECTIONS]


def _on_sphere(rows: Sequence[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """Return the rows of the normalized quaternion; derivatives are tangential to the unit sphere, degrees of rotation.

    Each row contains one coordinate of a quaternion, and its first and second derivatives.
    """
    length = math.hypot(*[row[0] for row in rows])
    unit = [row[0] / length for row in rows]
    out = sum([a * row[1] for a, row in zip(unit, rows, strict=True)])
    bent = sum([a * row[2] for a, row in zip(unit, rows, strict=True)])
    size = 2.0 * DEGREE / length
    turned = []
    for a, (_, slope, bend) in zip(unit, rows, strict=True):
        first = slope - out * a
        turned.append((a, first * size, (bend - bent * a - 2.0 * out / length * first) * size))
    return turned
