"""Search for all roots of several functions of one angle, beginning with samples over the range of the angle.

The search finds changes of sign between samples, pairs of roots between samples (the function crosses zero and
returns), and roots between a sample and the edge of the domain. The domain of a function consists of the angles at
which it has a value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from orinkit.arms.kinematics.chain import Array
from orinkit.core.record import record

Lines = NDArray[np.int_]
Function = Callable[[Lines, Array], tuple[Array, Array]]
"""Computes several functions of one angle, numbered from 0.

The arguments are indices of functions (M,) and angles (M,). The results are values (M,) and margins (M,).

Each value is the value of a function at its angle. Each margin shows how far the angle is inside the domain of the
function, in a unit of the caller's choice. The margin is 0 at the edge of the domain and negative outside the domain.
Outside, the value is NaN.
"""

TOUCHING: Final = 1e-11
"""A minimum of the absolute value of a function counts as a root if it is below this, even without a change of sign."""

_LEVELS: Final = 2  # number of times that doubtful intervals are sampled more finely
_REFINEMENT: Final = 32  # factor of the finer sampling
_FLAT: Final = 0.01  # a function that is smaller than this at both ends of an interval may have three roots in it
_FLAT_FACTOR: Final = 0.01  # _FLAT is multiplied by this at each finer level
_EDGE_SAMPLES: Final = 12
_EDGE_MARGIN: Final = 1e-9
_DIP_ROUNDS: Final = 42
_ROOT_ROUNDS: Final = 60
_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0
_SHALLOW: Final = (
    0.02  # a dip whose lowest sample is above this is examined only if a parabola predicts that it is deep
)
_EPSILON: Final = 2.0**-52


@record
class Samples:
    """Samples of functions.

    Attributes:
        lines: Indices of the functions, one for each row, (L,).
        angles: Angles of the samples, (L, S), rising or falling along a row.
        values: Values of the functions at the angles, (L, S); NaN outside the domain.
        domain_margins: Margins of the angles (see :data:`Function`), negative outside the domain, (L, S).
    """

    lines: Lines
    angles: Array
    values: Array
    domain_margins: Array


@record
class _Brackets:
    """Intervals that contain a root: the values at ``first`` and at ``last``, (M,), have different signs."""

    lines: Lines
    first: Array
    last: Array


def all_roots(function: Function, samples: Samples, steepness: float) -> tuple[Lines, Array]:
    """Return the roots of all functions as two arrays (M,): for each root, the index of its function, and its angle.

    A root may occur more than once.

    Args:
        function: The functions.
        samples: Samples of all functions over their whole range. The last two samples of a row repeat its first two
            samples, one turn further, so that no root at the ends of the range is missed.
        steepness: Upper bound of the change of a margin (see :data:`Function`) per rad of the angle.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        every = _resampled(function, samples, steepness)
        every.append(_edges(function, every))
        brackets = [_crossings(some) for some in every]
        touched_lines, touched = [], []
        for some in every:
            before, after, lines, angles = _dips(function, some)
            brackets += [before, after]
            touched_lines.append(lines)
            touched.append(angles)
        joined = _Brackets(
            np.concatenate([one.lines for one in brackets]),
            np.concatenate([one.first for one in brackets]),
            np.concatenate([one.last for one in brackets]),
        )
        roots = _refined(lambda *at: function(*at)[0], joined)
        return np.concatenate((joined.lines, *touched_lines)), np.concatenate((roots, *touched))


def _resampled(function: Function, samples: Samples, steepness: float) -> list[Samples]:
    """Return the samples, and finer samples of the intervals that may hide roots.

    An interval between two samples may hide roots in two cases: the domain may have a gap or an isolated part there, or
    the function may have three roots there.
    """
    levels = [samples]
    flat = _FLAT
    for _ in range(_LEVELS):
        step = samples.angles[:1, 1:2] - samples.angles[:1, :1]
        first, last = np.abs(samples.domain_margins[:, :-1]), np.abs(samples.domain_margins[:, 1:])
        hidden = (first + last < steepness * step) & (
            samples.domain_margins[:, :-1] * samples.domain_margins[:, 1:] >= 0.0
        )
        doubtful = hidden | (np.abs(samples.values[:, :-1]) + np.abs(samples.values[:, 1:]) < flat)
        row, column = np.nonzero(doubtful)
        angles = samples.angles[row, column][:, None] + step * (np.arange(-1, _REFINEMENT + 2) / _REFINEMENT)
        lines = samples.lines[row]
        values, margins = function(np.repeat(lines, angles.shape[1]), angles.ravel())
        samples = Samples(lines, angles, values.reshape(angles.shape), margins.reshape(angles.shape))
        levels.append(samples)
        flat *= _FLAT_FACTOR
        if not len(row):
            break
    return levels


def _crossings(samples: Samples) -> _Brackets:
    """Return the intervals between samples over which the sign changes."""
    first, last = samples.values[:, :-1], samples.values[:, 1:]
    row, column = np.nonzero(np.isfinite(first) & np.isfinite(last) & ((first >= 0.0) != (last >= 0.0)))
    return _Brackets(samples.lines[row], samples.angles[row, column], samples.angles[row, column + 1])


def _dips(function: Function, samples: Samples) -> tuple[_Brackets, _Brackets, Lines, Array]:
    """Search for dips: minima of the absolute value of a function, near zero, between samples of one sign.

    Returns:
        For the dips that cross zero, the intervals before the bottom of each dip, and the intervals after the bottom.
        For the dips that only touch zero, the indices of the functions, and the angles.
    """
    sizes = np.abs(samples.values)
    before, low, after = sizes[:, :-2], sizes[:, 1:-1], sizes[:, 2:]
    x0, x1, x2 = samples.angles[:, :-2], samples.angles[:, 1:-1], samples.angles[:, 2:]
    positive = samples.values >= 0.0
    one_sign = (positive[:, :-2] == positive[:, 1:-1]) & (positive[:, 1:-1] == positive[:, 2:])
    slope = (low - before) / (x1 - x0)
    curve = ((after - low) / (x2 - x1) - slope) / (x2 - x0)
    bottom = low - (slope + curve * (x1 - x0)) ** 2 / (4.0 * curve)
    deep = (low < _SHALLOW) | (bottom < 0.5 * low)
    row, column = np.nonzero(one_sign & (low <= before) & (low <= after) & deep)  # comparisons with NaN are False
    lines, first, last = samples.lines[row], samples.angles[row, column], samples.angles[row, column + 2]
    sign = np.where(positive[row, column], 1.0, -1.0)
    angle, value = _lowest(lambda at: sign * function(lines, at)[0], first, last)
    through, touching = value < 0.0, (value >= 0.0) & (value < TOUCHING)
    return (
        _Brackets(lines[through], first[through], angle[through]),
        _Brackets(lines[through], angle[through], last[through]),
        lines[touching],
        angle[touching],
    )


def _lowest(function: Callable[[Array], Array], first: Array, last: Array) -> tuple[Array, Array]:
    """Return the angles and the values of the minima of functions between two angles, by golden-section search.

    The search ends early if all values found are negative.
    """
    left, right = last - _GOLDEN * (last - first), first + _GOLDEN * (last - first)
    at_left, at_right = function(left), function(right)
    for _ in range(_DIP_ROUNDS):
        if not np.any(np.minimum(at_left, at_right) >= 0.0):
            break
        lower = at_left < at_right
        first, last = np.where(lower, first, left), np.where(lower, right, last)
        new = np.where(lower, last - _GOLDEN * (last - first), first + _GOLDEN * (last - first))
        value = function(new)
        left, right = np.where(lower, new, right), np.where(lower, left, new)
        at_left, at_right = np.where(lower, value, at_right), np.where(lower, at_left, value)
    return np.where(at_left < at_right, left, right), np.minimum(at_left, at_right)


def _edges(function: Function, every: Sequence[Samples]) -> Samples:
    """Return samples between each edge of a domain and the sample next to it inside, denser towards the edge.

    Each row ends with one more sample, farther inside the domain, so that a dip at the last sample but one is detected.
    """
    columns = [column for samples in every for column in _over_the_edge(samples)]
    lines, sample, outside, before, value, margin = map(np.concatenate, zip(*columns, strict=True))
    edge = _refined(lambda *at: function(*at)[1] - _EDGE_MARGIN, _Brackets(lines, sample, outside))
    part = (np.arange(_EDGE_SAMPLES + 1) / _EDGE_SAMPLES) ** 4  # the function is steep at the edge, like a square root
    angles = edge[:, None] + part * (sample - edge)[:, None]
    values, margins = function(np.repeat(lines, angles.shape[1]), angles.ravel())
    return Samples(
        lines,
        np.column_stack((angles, before)),
        np.column_stack((values.reshape(angles.shape), value)),
        np.column_stack((margins.reshape(angles.shape), margin)),
    )


def _over_the_edge(samples: Samples) -> Iterator[tuple[Lines, Array, Array, Array, Array, Array]]:
    """Yield two items: the samples beside the edges at which domains end along a row, and at which they begin.

    Each item contains the indices of the functions; the angles of the samples inside, outside and farther inside; and
    the values and the margins at the angles farther inside.
    """
    inside = samples.domain_margins >= _EDGE_MARGIN
    for outward, rows in ((1, inside[:, 1:-1] & ~inside[:, 2:]), (-1, inside[:, 1:-1] & ~inside[:, :-2])):
        row, column = np.nonzero(rows)
        here, farther = (row, column + 1), (row, column + 1 - outward)
        yield (
            samples.lines[row],
            samples.angles[here],
            samples.angles[row, column + 1 + outward],
            samples.angles[farther],
            samples.values[farther],
            samples.domain_margins[farther],
        )


def _refined(function: Callable[[Lines, Array], Array], brackets: _Brackets) -> Array:
    """Return the root in each bracket by Chandrupatla's method: inverse quadratic interpolation or bisection."""
    a, b = brackets.first, brackets.last
    at_a, at_b = function(brackets.lines, a), function(brackets.lines, b)
    part = np.full(len(a), 0.5)
    for _ in range(_ROOT_ROUNDS):
        x = a + part * (b - a)
        at_x = function(brackets.lines, x)
        same = (at_x >= 0.0) == (at_a >= 0.0)
        c, at_c = np.where(same, a, b), np.where(same, at_a, at_b)
        b, at_b = np.where(same, b, a), np.where(same, at_b, at_a)
        a, at_a = x, at_x
        nearest = np.where(np.abs(at_a) < np.abs(at_b), a, b)
        smallest = np.minimum(np.abs(at_a), np.abs(at_b))
        least = 2.0 * _EPSILON * (np.abs(nearest) + 1.0) / np.abs(b - a)
        if np.all((least > 0.5) | (smallest < 4.0 * _EPSILON)):
            break
        part = np.clip(_quadratic(a, b, c, at_a, at_b, at_c), np.minimum(least, 0.5), 1.0 - np.minimum(least, 0.5))
    return np.where(np.abs(at_a) < np.abs(at_b), a, b)


def _quadratic(a: Array, b: Array, c: Array, at_a: Array, at_b: Array, at_c: Array) -> Array:
    """Return the step of inverse quadratic interpolation as a fraction of b - a; 1/2 if the step is not reliable."""
    xi, phi = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
    fits = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
    part = at_a / (at_b - at_a) * at_c / (at_b - at_c) + (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
    return np.where(fits & np.isfinite(part), part, 0.5)
