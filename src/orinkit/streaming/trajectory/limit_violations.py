"""Detection of the first limit violation of a trajectory, and its messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from orinkit.arms import joint_unit
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.public_name import public
from orinkit.core.validation import check_seconds
from orinkit.streaming.trajectory import finite_differences
from orinkit.values.pose_numbers import rounded_text

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind
    from orinkit.streaming.planning.limits import Limits, PathLimits

MOST_SAMPLES: Final = 1_000_000
"""The largest number of set-points of a trajectory: more than two hours with a period of 8 ms."""


@public("orinkit")
class TrajectoryError(InvalidValue):
    """A trajectory that cannot be used; nothing was sent.

    Attributes:
        sample: Number of the set-point, from 0; ``None`` if the error does not concern a single one.
        axis: Number of the joint, or of the value of a P or T, from 1; ``None`` if the error does not concern a single
            one.
    """

    def __init__(self, message: str, sample: int | None = None, axis: int | None = None) -> None:
        super().__init__(message)
        self.sample = sample
        self.axis = axis

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (*self.args, self.sample, self.axis)


def check_period(period: object) -> None:
    """Check a period.

    Raises:
        InvalidValue: If the period is not above 0 and at most 10 s.
    """
    check_seconds("period", period, 10.0)


RANGE: Final = -1
"""Rank of a joint that is out of its range: the lowest one, to be reported before other violations of the sample."""

_ROUNDING: Final = 1e-9  # deg, mm
_POSITION_TOLERANCE: Final = 1e-6  # mm
_ANGLE_TOLERANCE: Final = 1e-4  # deg: for orientations given by vectors with six decimals
_SHOWN: Final = 3  # number of decimals in messages


class LimitViolation(NamedTuple):
    """The first violation of a limit.

    If several limits are violated, the smallest of these tuples is reported: the violation at the earliest sample, and
    among several violations at this sample, the one of the lowest rank.

    Attributes:
        sample: Number of the sample, from 0; for the stop after the last sample, the number of samples.
        rank: Order in which several violations at the same sample are reported.
        axis: Number of the joint, from 1; 0 for a tool.
        value: The difference that exceeds the limit (see :class:`LimitCheck`); for a joint out of its range, the
            position.
    """

    sample: int
    rank: int
    axis: int
    value: float


class LimitCheck(NamedTuple):
    """A limit, and the differences of set-points to which it applies.

    Attributes:
        rank, axis: As in :class:`LimitViolation`.
        values: The differences, one per sample, and one for the stop after the last sample.
        most: The largest allowed magnitude of a difference.
        limit: The limit in ``unit``.
        per: Divisor that converts a difference to ``unit``.
        unit: The unit.
        text: Name of the limited quantity in English; messages contain its translation.
    """

    rank: int
    axis: int
    values: Sequence[float]
    most: float
    limit: float
    per: float
    unit: str
    text: str

    def breach(self) -> LimitViolation | None:
        """Return the first violation of the limit; ``None`` if there is none."""
        most = self.most
        if max(self.values) <= most and min(self.values) >= -most:
            return None
        sample = next(place for place, value in enumerate(self.values) if not -most <= value <= most)
        return LimitViolation(sample, self.rank, self.axis, abs(self.values[sample]))


def joint_rules(
    column: Sequence[float], start: float, axis: int, limits: Limits, period: float, tolerance: float
) -> tuple[LimitCheck, LimitCheck]:
    """Return the limit checks of joint ``axis`` (from 0), which stands at ``start`` before the trajectory."""
    steps, changes = finite_differences.of_column(column, start)
    velocity, acceleration = limits.velocity[axis], limits.acceleration[axis]
    more = 1.0 + tolerance
    unit = joint_unit(axis, len(limits.lower))
    return (
        LimitCheck(0, axis + 1, steps, velocity * period * more, velocity, period, f"{unit}/s", N_("velocity")),
        LimitCheck(
            1, axis + 1, changes, acceleration * period**2 * more, acceleration, period**2, f"{unit}/s^2",
            N_("acceleration"),
        ),
    )  # fmt: skip


def path_rules(
    place: finite_differences.Differences, turn: finite_differences.Differences, limits: PathLimits, period: float
) -> list[LimitCheck]:
    """Return the limit checks of a tool from the differences of its position (``place``) and orientation (``turn``)."""
    rows = (
        (place.steps, limits.speed, 1, "mm/s", N_("tool velocity"), _POSITION_TOLERANCE),
        (turn.steps, limits.rotation, 1, "deg/s", N_("angular velocity"), _ANGLE_TOLERANCE),
        (place.changes, limits.acceleration, 2, "mm/s^2", N_("tool acceleration"),
         _POSITION_TOLERANCE),
        (turn.changes, limits.rotation_acceleration, 2, "deg/s^2", N_("angular acceleration"),
         _ANGLE_TOLERANCE),
    )  # fmt: skip
    return [
        LimitCheck(
            rank,
            0,
            values,
            limit * period**order + 2 * order * tolerance,
            limit,
            period**order,
            unit,
            text,
        )
        for rank, (values, limit, order, unit, text, tolerance) in enumerate(rows)
    ]


def out_of_range(columns: Sequence[Sequence[float]], limits: Limits) -> list[LimitViolation]:
    """Return, for each joint that leaves its range, a limit violation at the first sample out of range."""
    breaches = []
    for axis, column in enumerate(columns):
        lower, upper = limits.lower[axis] - _ROUNDING, limits.upper[axis] + _ROUNDING
        if min(column) < lower or max(column) > upper:
            sample = next(place for place, value in enumerate(column) if not lower <= value <= upper)
            breaches.append(LimitViolation(sample, RANGE, axis + 1, column[sample]))
    return breaches


def broken(rules: Sequence[LimitCheck]) -> list[LimitViolation]:
    """Return the first violation of each limit that is violated."""
    return [breach for rule in rules if (breach := rule.breach()) is not None]


def text_of(breach: LimitViolation, rules: Sequence[LimitCheck], count: int, period: float) -> str:
    """Return the message for a limit violation.

    ``rules`` are the limit checks, and ``count`` is the number of samples of the trajectory.
    """
    rule = next(rule for rule in rules if (rule.rank, rule.axis) == (breach.rank, breach.axis))
    name = f"J{rule.axis}: " if rule.axis else ""
    value = f"{breach.value / rule.per:.1f} {rule.unit}"
    if breach.sample == count:
        return (
            _at(count - 1, period)
            + name
            + tr(
                "the trajectory ends while the arm moves; the stop requires {value}, the limit is {limit:g}. "
                "Try: slow down before the end, or retime (retime=True, --retime)",
                value=value,
                limit=rule.limit,
            )
        )
    return (
        _at(breach.sample, period)
        + name
        + tr(
            "{what} {value} exceeds the limit of {limit:g}. Try: retime (retime=True, --retime)",
            what=tr(rule.text),
            value=value,
            limit=rule.limit,
        )
    )


def outside(breach: LimitViolation, limits: Limits, period: float) -> str:
    """Return the message for a joint out of its range."""
    lower, upper = limits.lower[breach.axis - 1], limits.upper[breach.axis - 1]
    return _at(breach.sample, period) + tr(
        "J{axis}: {value:.{digits}f} is outside the range of {lower:g} to {upper:g}. Try: another "
        "trajectory, or pass limits= if the arm has a wider range",
        axis=breach.axis,
        digits=_SHOWN,
        value=breach.value,
        lower=lower,
        upper=upper,
    )


def joints_away(start: Sequence[float], first: Sequence[float]) -> str:
    """Return the message for an arm that is not at the beginning of the trajectory."""
    far = max(range(len(first)), key=lambda axis: abs(first[axis] - start[axis]))
    by = f"{abs(first[far] - start[far]):.{_SHOWN}f}"
    return tr(
        "the arm is at {here}, but the trajectory begins at {first}; J{axis} is off by {by}. Try: move to the "
        "beginning of the trajectory first",
        here=_short("J", start),
        first=_short("J", first),
        axis=far + 1,
        by=by,
    )


def tool_away(start: Sequence[float], first: Sequence[float], distance: float, angle: float, kind: PoseKind) -> str:
    """Return the message for a tool that is not at the beginning of the trajectory.

    Args:
        start: Pose of the tool.
        first: First point of the trajectory.
        distance: Distance between the pose of the tool and the first point, mm.
        angle: Angle between their orientations, deg.
        kind: Pose type.
    """
    by = f"{distance:.{_SHOWN}f} mm, {angle:.{_SHOWN}f} deg"
    return tr(
        "the tool is at {here}, but the trajectory begins at {first}; the tool is off by {by}. Try: move to the "
        "beginning of the trajectory first",
        here=_short(kind, start),
        first=_short(kind, first),
        by=by,
    )


def _at(sample: int, period: float) -> str:
    time = sample * period
    return tr("sample {sample} (counted from 0, at {time:.3f} s), ", sample=sample, time=time)


def _short(kind: str, values: Sequence[float]) -> str:
    return rounded_text(kind, [round(value, _SHOWN) for value in values])
