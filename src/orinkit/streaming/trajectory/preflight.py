"""The check of a trajectory before a motion: :func:`find_violations` reports all limit violations, not only the first one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Final

from orinkit.arms import joint_unit
from orinkit.core.i18n import N_, tr
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory import finite_differences, limit_violations
from orinkit.streaming.trajectory.limit_violations import LimitCheck, check_period
from orinkit.streaming.trajectory.trajectory import TOLERANCE, read_point

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind
    from orinkit.streaming.trajectory.finite_differences import Points

MOST_FOUND: Final = 1000
"""The largest number of violations that are reported for each limit."""

_ROUNDING: Final = 1e-9  # deg, mm


@dataclass(frozen=True, slots=True, order=True)
class Violation:
    """Successive set-points that exceed one limit.

    Attributes:
        sample: Number of the first set-point, from 0; the number of set-points for the stop after the last one.
        last: Number of the last set-point of the violation.
        axis: Number of the joint, from 1; 0 for the tool.
        what: The limited quantity, in English.
        value: The largest excess, in ``unit``.
        limit: The limit, in ``unit``.
        unit: The unit.
        time: Time of the first set-point, s.
    """

    sample: int
    last: int
    axis: int
    what: str
    value: float
    limit: float
    unit: str
    time: float

    def __str__(self) -> str:
        name = f"J{self.axis}: " if self.axis else ""
        where = tr("sample {sample} (counted from 0, at {time:.3f} s), ", sample=self.sample, time=self.time)
        return where + name + tr(
            "{what} {value:.3f} {unit}, the limit is {limit:g}",
            what=tr(self.what), value=self.value, unit=self.unit, limit=self.limit,
        )  # fmt: skip


def find_violations(
    points: Points, limits: Limits | PathLimits, period: float, kind: PoseKind = "J",
    start: Sequence[float] | None = None,
) -> list[Violation]:  # fmt: skip
    """Return all limit violations of a trajectory, earliest first.

    The rules are those of :func:`orinkit.streaming.trajectory.trajectory.check_trajectory` and ``check_path``. The arm
    stands at ``start`` before the first set-point, and at the last set-point afterwards.

    Args:
        points: Set-points, as ``read_trajectory`` returns them.
        limits: Limits of the joints for J, of the path for P and T.
        period: Time between two set-points, s.
        kind: Pose type of the set-points.
        start: Pose of the arm; ``None``: the first set-point.

    Raises:
        InvalidValue: If the period or an orientation is not valid.
    """
    check_period(period)
    found: list[Violation] = []
    if isinstance(limits, PathLimits):
        begin = points[0] if start is None else read_point(start, kind)
        place, turn = finite_differences.of_path(points, begin, kind)
        rules = limit_violations.path_rules(place, turn, limits, period)
    else:
        columns = list(zip(*points, strict=True))
        begin = points[0] if start is None else tuple(start)
        rules = []
        for axis, column in enumerate(columns):
            found.extend(_beyond_range(column, limits, axis, period))
            rules.extend(limit_violations.joint_rules(column, begin[axis], axis, limits, period, TOLERANCE))
    for rule in rules:
        if rule.breach() is not None:
            found.extend(islice(_exceeding(rule, period), MOST_FOUND))
    return sorted(found)


def _exceeding(rule: LimitCheck, period: float) -> Iterator[Violation]:
    for first, last in _groups([abs(value) > rule.most for value in rule.values]):
        worst = max(abs(value) for value in rule.values[first : last + 1]) / rule.per
        yield Violation(first, last, rule.axis, rule.text, worst, rule.limit, rule.unit, first * period)


def _beyond_range(column: Sequence[float], limits: Limits, axis: int, period: float) -> Iterator[Violation]:
    lower, upper = limits.lower[axis], limits.upper[axis]
    for values, limit, sign in ((column, lower, -1.0), (column, upper, 1.0)):
        if max(sign * min(values), sign * max(values)) <= sign * limit + _ROUNDING:
            continue
        outside = [sign * value > sign * limit + _ROUNDING for value in values]
        for first, last in islice(_groups(outside), MOST_FOUND):
            worst = sign * max(sign * value for value in values[first : last + 1])
            unit = joint_unit(axis, len(limits.lower))
            yield Violation(first, last, axis + 1, POSITION, worst, limit, unit, first * period)


POSITION: Final = N_("position")
"""The quantity of a joint that is out of its range."""


def _groups(flags: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """Yield the first and the last index of each group of successive true flags."""
    first = -1
    for index, flag in enumerate(flags):
        if flag and first < 0:
            first = index
        elif not flag and first >= 0:
            yield first, index - 1
            first = -1
    if first >= 0:
        yield first, len(flags) - 1
