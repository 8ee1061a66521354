"""Which sample of a trajectory breaks a limit first, and what is said about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from orinkit._pose_checks import brief, rounded
from orinkit.errors import InvalidValue
from orinkit.language import pick
from orinkit.slave import measure

if TYPE_CHECKING:
    from orinkit.cao.slave_formats import PoseKind
    from orinkit.slave.limits import Limits, PathLimits

MOST_SAMPLES: Final = 1_000_000
"""The most set-points of a trajectory: more than two hours of 8 ms."""


class TrajectoryError(InvalidValue):
    """A trajectory that cannot be used; nothing was sent.

    Attributes:
        sample: number of the set-point, from 0; ``None`` where it is not about one.
        axis: number of the joint, or of the value of a P or T, from 1; ``None`` where it is not about one.
    """

    def __init__(self, message: str, sample: int | None = None, axis: int | None = None) -> None:
        super().__init__(message)
        self.sample = sample
        self.axis = axis

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (*self.args, self.sample, self.axis)


def check_period(period: object) -> None:
    """Make sure that there can be such a period.

    Raises:
        InvalidValue: it is not above 0 and up to 10 s.
    """
    if isinstance(period, bool) or not isinstance(period, int | float) or not 0 < period <= 10:
        raise InvalidValue(
            pick(
                f"period {brief(period)}: seconds above 0, up to 10, are wanted",
                f"周期 {brief(period)}: 0 より大きく 10 以下の秒数を指定してください",
            )
        )


RANGE: Final = -1
"""Rank of a breach that is told before all others of the same sample: a joint is out of its range."""

_ROUNDING: Final = 1e-9  # deg, mm
_POSITION_TOLERANCE: Final = 1e-6  # mm
_ANGLE_TOLERANCE: Final = 1e-4  # deg: vectors with six decimals
_ROBOT_JOINTS: Final = 6
_SHOWN: Final = 3  # decimals


class Breach(NamedTuple):
    """The first sample that breaks a limit. The smallest of several is told.

    Attributes:
        sample: its number from 0; the number of samples where the arm would have to stop after the last one.
        rank: which of several of the same sample comes first.
        axis: number of the joint from 1, 0 for a tool.
        value: what is beyond the limit.
    """

    sample: int
    rank: int
    axis: int
    value: float


class Rule(NamedTuple):
    """A limit that differences have to keep.

    Attributes:
        rank, axis: as of the breach.
        values: the differences, one per sample and one after the last.
        most: of such a difference.
        limit: in its own unit.
        per: what a difference is divided by to have that unit.
        unit: its name.
        en, ja: what is limited.
    """

    rank: int
    axis: int
    values: Sequence[float]
    most: float
    limit: float
    per: float
    unit: str
    en: str
    ja: str

    def breach(self) -> Breach | None:
        """Return where it is broken first."""
        most = self.most
        if max(self.values) <= most and min(self.values) >= -most:
            return None
        sample = next(place for place, value in enumerate(self.values) if not -most <= value <= most)
        return Breach(sample, self.rank, self.axis, abs(self.values[sample]))


def joint_rules(
    column: Sequence[float], start: float, axis: int, limits: Limits, period: float, tolerance: float
) -> tuple[Rule, Rule]:
    """Return what is asked of a joint, ``axis`` from 0, that stands at ``start`` before."""
    steps, changes = measure.of_column(column, start)
    velocity, acceleration = limits.velocity[axis], limits.acceleration[axis]
    more = 1.0 + tolerance
    unit = "deg" if axis < _ROBOT_JOINTS else "deg (mm)"
    return (
        Rule(0, axis + 1, steps, velocity * period * more, velocity, period, f"{unit}/s", "velocity", "速度"),
        Rule(
            1, axis + 1, changes, acceleration * period**2 * more, acceleration, period**2, f"{unit}/s^2",
            "acceleration", "加速度",
        ),
    )  # fmt: skip


def path_rules(place: measure.Differences, turn: measure.Differences, limits: PathLimits, period: float) -> list[Rule]:
    """Return what is asked of a tool, by the differences of its position and its orientation."""
    rows = (
        (place.steps, limits.speed, 1, "mm/s", "speed of the tool", "ツールの速度", _POSITION_TOLERANCE),
        (turn.steps, limits.rotation, 1, "deg/s", "speed of rotation", "回転速度", _ANGLE_TOLERANCE),
        (place.changes, limits.acceleration, 2, "mm/s^2", "acceleration of the tool", "ツールの加速度",
         _POSITION_TOLERANCE),
        (turn.changes, limits.rotation_acceleration, 2, "deg/s^2", "acceleration of rotation", "回転の加速度",
         _ANGLE_TOLERANCE),
    )  # fmt: skip
    return [
        Rule(
            rank,
            0,
            values,
            limit * period**order + 2 * order * tolerance,
            limit,
            period**order,
            unit,
            en,
            ja,
        )
        for rank, (values, limit, order, unit, en, ja, tolerance) in enumerate(rows)
    ]


def out_of_range(columns: Sequence[Sequence[float]], limits: Limits) -> list[Breach]:
    """Return where joints leave their range first."""
    breaches = []
    for axis, column in enumerate(columns):
        lower, upper = limits.lower[axis] - _ROUNDING, limits.upper[axis] + _ROUNDING
        if min(column) < lower or max(column) > upper:
            sample = next(place for place, value in enumerate(column) if not lower <= value <= upper)
            breaches.append(Breach(sample, RANGE, axis + 1, column[sample]))
    return breaches


def broken(rules: Sequence[Rule]) -> list[Breach]:
    """Return where rules are broken first."""
    return [breach for rule in rules if (breach := rule.breach()) is not None]


def text_of(breach: Breach, rules: Sequence[Rule], count: int, period: float) -> str:
    """Return what is said about a breach of a rule."""
    rule = next(rule for rule in rules if (rule.rank, rule.axis) == (breach.rank, breach.axis))
    name = f"J{rule.axis}: " if rule.axis else ""
    value = f"{breach.value / rule.per:.1f} {rule.unit}"
    if breach.sample == count:
        return (
            _at(count - 1, period)
            + name
            + pick(
                f"the trajectory ends while the arm moves, and to stop there takes {value} of {rule.limit:g}; "
                "try: slow down before the end, or retime (retime=True, --retime)",
                f"動作中に軌道が終わっており、そこで停止するには {value} が必要です (上限 {rule.limit:g})。"
                "対処: 終端の手前で減速させるか、retime (retime=True, --retime) を指定してください",
            )
        )
    return (
        _at(breach.sample, period)
        + name
        + pick(
            f"{rule.en} {value} of {rule.limit:g}; try: retime (retime=True, --retime), which slows down where it is needed",
            f"{rule.ja} {value} が上限 {rule.limit:g} を超えています。"
            "対処: retime (retime=True, --retime) を指定すると、必要な区間だけ減速します",
        )
    )


def outside(breach: Breach, limits: Limits, period: float) -> str:
    """Return what is said about a joint out of its range."""
    lower, upper = limits.lower[breach.axis - 1], limits.upper[breach.axis - 1]
    return _at(breach.sample, period) + pick(
        f"J{breach.axis}: {breach.value:.{_SHOWN}f} is outside its range, {lower:g} to {upper:g}; "
        "try: another trajectory, or limits of your own if the arm's are set wider",
        f"J{breach.axis}: {breach.value:.{_SHOWN}f} が動作範囲 {lower:g}～{upper:g} の外です。"
        "対処: 軌道を見直すか、アームの設定範囲が広い場合は limits を指定してください",
    )


def joints_away(start: Sequence[float], first: Sequence[float]) -> str:
    """Return what is said about an arm that is not where the trajectory begins."""
    far = max(range(len(first)), key=lambda axis: abs(first[axis] - start[axis]))
    by = f"{abs(first[far] - start[far]):.{_SHOWN}f}"
    return pick(
        f"the arm is at {_short('J', start)}, the trajectory begins at {_short('J', first)}, "
        f"with J{far + 1} {by} away: move there first",
        f"アームの現在位置は {_short('J', start)}、軌道の始点は {_short('J', first)} です "
        f"(J{far + 1} の差 {by})。先に始点へ移動してください",
    )


def tool_away(start: Sequence[float], first: Sequence[float], distance: float, angle: float, kind: PoseKind) -> str:
    """Return the same of a tool, ``distance`` in mm, ``angle`` in degrees."""
    by = f"{distance:.{_SHOWN}f} mm, {angle:.{_SHOWN}f} deg"
    return pick(
        f"the tool is at {_short(kind, start)}, the trajectory begins at {_short(kind, first)}, {by} away: "
        "move there first",
        f"ツールの現在位置は {_short(kind, start)}、軌道の始点は {_short(kind, first)} です (差 {by})。"
        "先に始点へ移動してください",
    )


def _at(sample: int, period: float) -> str:
    time = sample * period
    return pick(
        f"sample {sample} (counted from 0, at {time:.3f} s), ", f"サンプル {sample} (0 から数えて。{time:.3f} 秒)、"
    )


def _short(kind: str, values: Sequence[float]) -> str:
    return rounded(kind, [round(value, _SHOWN) for value in values])
