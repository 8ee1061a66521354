"""First and second differences of set-points; a controller checks both.

The functions assume that the arm stands at ``start`` before the trajectory, and at the last point afterwards. Each list
of differences has one entry per sample, and one more entry for the change to standstill after the last sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import sub
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from orinkit.arms.geometry import Quaternion, of_angles, of_vectors, rotvec_between

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind

Points: TypeAlias = Sequence[tuple[float, ...]]
"""Set-points, one per period."""


class Differences(NamedTuple):
    """The differences of one quantity: one entry per sample, and one more for the stop after the last sample.

    Attributes:
        steps: First differences: each sample minus the one before; 0 for the stop.
        changes: Second differences: each step minus the one before.
    """

    steps: list[float]
    changes: list[float]


def of_column(column: Sequence[float], start: float) -> Differences:
    """Return the differences of one joint, which stands at ``start`` before the first sample."""
    steps = list(map(sub, column, (start, *column[:-1])))
    return Differences([*steps, 0.0], list(map(sub, (*steps, 0.0), (0.0, *steps))))


def of_path(points: Points, start: Sequence[float], kind: PoseKind) -> tuple[Differences, Differences]:
    """Return the differences of the position (lengths, mm) and of the orientation (angles, deg) of P or T.

    ``start`` is the pose at which the arm stands before the first point.

    Raises:
        InvalidValue: If the orient and approach vectors of a T do not determine its orientation.
    """
    columns = list(zip(start, *points, strict=True))
    x, y, z = (of_column(column[1:], column[0]) for column in columns[:3])
    turns = orientations(columns, kind)
    a, b, c = zip(*map(rotvec_between, turns[:-1], turns[1:]), strict=True)
    return (
        Differences(_lengths(x.steps, y.steps, z.steps), _lengths(x.changes, y.changes, z.changes)),
        Differences([*_lengths(a, b, c), 0.0], _lengths(*map(_changes, (a, b, c)))),
    )


def orientations(columns: Sequence[Sequence[float]], kind: PoseKind) -> list[Quaternion]:
    """Return the orientation of each point; ``columns`` contains one column per value of the P or T.

    Raises:
        InvalidValue: If the orient and approach vectors of a T do not determine its orientation.
    """
    if kind == "P":
        return list(map(of_angles, *columns[3:6]))
    return list(
        map(of_vectors, zip(*columns[3:6], strict=True), zip(*columns[6:9], strict=True))  # O, A
    )


def _changes(steps: Sequence[float]) -> list[float]:
    return list(map(sub, (*steps, 0.0), (0.0, *steps)))


def _lengths(x: Sequence[float], y: Sequence[float], z: Sequence[float]) -> list[float]:
    return list(map(math.hypot, x, y, z))
