"""Reading trajectories (set-points, one per period of the controller), and checking them before the arm moves.

The controller stops the arm with an error in three cases (RC8 4.5): the step of a joint in a period exceeds its
velocity limit; the difference of two consecutive steps exceeds its acceleration limit (0x8420404*); or a joint leaves
its range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from orinkit.arms.geometry import of_vectors
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief
from orinkit.streaming.trajectory import finite_differences, limit_violations
from orinkit.streaming.trajectory.finite_differences import Points
from orinkit.streaming.trajectory.limit_violations import (
    MOST_SAMPLES,
    RANGE,
    LimitCheck,
    LimitViolation,
    TrajectoryError,
    check_period,
)
from orinkit.values.pose_numbers import COUNTS, FIELDS, FIG_AUTO, is_whole
from orinkit.values.poses import J, P, T, V

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind
    from orinkit.streaming.planning.limits import Limits, PathLimits

LARGEST: Final = 1e6
"""The largest magnitude of a value of a set-point, mm or deg."""
TOLERANCE: Final = 5e-7
"""Relative tolerance of the limits of a joint, for rounding errors. A controller may not permit a larger excess."""

_NUMERIC: Final = frozenset({float, int})
_SIZES: Final[dict[str, int]] = {kind: COUNTS[kind][1] for kind in ("J", "P", "T")}
_MOST_JOINTS: Final = _SIZES["J"]


def read_trajectory(
    source: object, kind: PoseKind, axes: int = 6, *, period: float | None = None
) -> list[tuple[float, ...]]:
    """Read a trajectory and return its set-points.

    Args:
        source: The poses: a numpy array of the shape (samples, values); a sequence whose elements are sequences of
            numbers, P, J or T; or the path of a CSV file (:func:`orinkit.streaming.trajectory.csv_file.load_csv`).
        kind: Pose type. A J has ``axes`` to 8 values, deg (mm for linear axes), a P has 6 or 7, a T has 9 or 10.
        axes: Number of joints of the arm; further values of a J must be 0.
        period: Time between two set-points, s; a file with times of another period is resampled. ``None``: the rows are
            not resampled.

    Returns:
        For each sample ``axes`` joints, the 7 values of a P, or the 10 of a T; an omitted figure is FIG_AUTO.

    Raises:
        TrajectoryError: If the trajectory is empty or too long, or a value is not valid; the exception contains sample
            and axis.
        InvalidValue: If the file cannot be used; the message contains the name of the file, and the line.
    """
    _check_kind(kind, axes)
    if isinstance(source, str | Path):
        return _from_file(Path(source), kind, axes, period)
    rows = _rows(source)
    size = axes if kind == "J" else _SIZES[kind]
    points = []
    for sample, row in enumerate(rows):
        if (
            (type(row) is list or type(row) is tuple)
            and len(row) == size
            and set(map(type, row)) <= _NUMERIC
            and min(row) >= -LARGEST
            and max(row) <= LARGEST
            and math.isfinite(sum(row))
            and (kind == "J" or (kind == "P" and row[-1] == int(row[-1])))
        ):  # fast path
            points.append(tuple(map(float, row)))
        else:
            points.append(read_point(row, kind, axes, sample))
    return points


def read_point(value: object, kind: PoseKind, axes: int = 6, sample: int | None = None) -> tuple[float, ...]:
    """Read one set-point; :func:`read_trajectory` describes its forms.

    Args:
        value: A sequence of numbers, a numpy array (values,), a P, J or T.
        kind: Pose type of the values.
        axes: Number of joints of the arm.
        sample: Number of the sample from 0, for the message; ``None`` if the set-point is not part of a trajectory.

    Raises:
        TrajectoryError: If the value is not a set-point of the pose type.
    """
    _check_kind(kind, axes)
    numbers = _numbers(value, kind, axes, sample)
    if kind == "J":
        for axis in range(axes, len(numbers)):
            if numbers[axis]:
                raise _refused(
                    sample,
                    axis + 1,
                    tr(
                        "J{axis} is {value}, but the arm has only {axes} joints",
                        axis=axis + 1,
                        value=brief(numbers[axis]),
                        axes=axes,
                    ),
                )
        return tuple(numbers[:axes])
    if len(numbers) < _SIZES[kind]:
        numbers.append(float(FIG_AUTO))
    if not is_whole(numbers[-1]):
        raise _refused(
            sample,
            len(numbers),
            tr("fig is {figure:g}, but must be an integer", figure=numbers[-1]),
        )
    if kind == "T":
        _check_orientation(numbers, sample)
    return tuple(numbers)


def _check_kind(kind: object, axes: object) -> None:
    if kind not in _SIZES:
        raise _not_among(kind, '"J", "P", "T"')
    if isinstance(axes, bool) or not isinstance(axes, int) or not 1 <= axes <= _MOST_JOINTS:
        raise InvalidValue(tr("axes is {axes}, but must be 1 to {most}", axes=brief(axes), most=_MOST_JOINTS))


def _not_among(kind: object, kinds: str) -> InvalidValue:
    return InvalidValue(tr("kind is {kind}, but must be one of {kinds}", kind=brief(kind), kinds=kinds))


def _from_file(path: Path, kind: PoseKind, axes: int, period: float | None) -> list[tuple[float, ...]]:
    from orinkit.streaming.trajectory.csv_file import load_csv
    from orinkit.streaming.trajectory.resample import resample

    found, given, rows = load_csv(path)
    if found != kind:
        raise TrajectoryError(
            tr("{path}: the file has set-points of type {found}, expected {kind}", path=path, found=found, kind=kind)
        )
    try:
        points = read_trajectory(rows, kind, axes)
        return points if period is None or given is None else resample(points, given, period, kind)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}", error.sample, error.axis) from None


def _rows(source: Any) -> Sequence[Any]:
    rows = source.tolist() if callable(getattr(source, "tolist", None)) else source
    if isinstance(rows, str | bytes | bytearray | P | J | T | V) or not isinstance(rows, Sequence):
        raise TrajectoryError(
            tr(
                "{source} is not a trajectory. Try: a sequence of poses, an array (samples, values), the "
                "path of a CSV file, or a synchronous iterator",
                source=brief(source),
            )
        )
    if not rows:
        raise TrajectoryError(tr("the trajectory is empty"))
    if len(rows) > MOST_SAMPLES:
        raise TrajectoryError(
            tr(
                "{count} samples exceed the limit of {most}. Try: an iterator, or several streams",
                count=len(rows),
                most=MOST_SAMPLES,
            )
        )
    return rows


def _numbers(value: Any, kind: PoseKind, axes: int, sample: int | None) -> list[float]:
    if isinstance(value, P | J | T | V) and type(value).__name__ != kind:
        raise _refused(
            sample,
            None,
            tr("{value} is not a set-point of type {kind}", value=brief(value), kind=kind),
        )
    items = value.tolist() if callable(getattr(value, "tolist", None)) else value
    if isinstance(items, str | bytes | bytearray) or not isinstance(items, Sequence):
        raise _refused(sample, None, tr("{value} is not a pose", value=brief(value)))
    least, most = (axes, _MOST_JOINTS) if kind == "J" else COUNTS[kind]
    if not least <= len(items) <= most:
        count, wanted = len(items), str(least) if least == most else tr("{least} to {most}", least=least, most=most)
        raise _refused(
            sample,
            None,
            tr("got {count} values, expected {wanted} for {kind}", count=count, wanted=wanted, kind=kind),
        )
    return [_number(item, kind, sample, place) for place, item in enumerate(items)]


def _number(item: Any, kind: PoseKind, sample: int | None, place: int) -> float:
    number = math.nan
    if not isinstance(item, bool | str | bytes | bytearray) and type(item).__name__ not in ("bool_", "bool"):
        try:
            number = float(item)
        except Exception:  # noqa: BLE001 - the object's own conversion may raise anything
            number = math.nan
    if not -LARGEST <= number <= LARGEST:
        name = FIELDS[kind][place]
        raise _refused(
            sample,
            place + 1,
            tr(
                "{name} is {value}, but must be a finite number of magnitude up to {largest:,.0f}",
                name=name,
                value=brief(item),
                largest=LARGEST,
            ),
        )
    return number


def _check_orientation(numbers: Sequence[float], sample: int | None) -> None:
    try:
        of_vectors(numbers[3:6], numbers[6:9])
    except InvalidValue as error:
        raise TrajectoryError(_where(sample) + str(error), sample) from None


def _refused(sample: int | None, axis: int | None, text: str) -> TrajectoryError:
    return TrajectoryError(_where(sample) + text, sample, axis)


def _where(sample: int | None) -> str:
    if sample is None:
        return tr("set-point: ")
    return tr("sample {sample} (counted from 0): ", sample=sample)


# --- checking ---------------------------------------------------------------------------------------------------------


def check_trajectory(
    points: Points, limits: Limits, start: Sequence[float] | None, period: float, *, tolerance: float = TOLERANCE
) -> None:
    """Check range, velocity and acceleration of every sample of a trajectory of joints.

    The arm stands at ``start`` before the first sample, and at the last sample afterwards.

    Args:
        points: Joints, as :func:`read_trajectory` returns them.
        limits: Limits of the arm, with as many axes as the points have.
        start: Joint position of the arm; ``None``: the first sample.
        period: Time between two set-points, s.
        tolerance: Relative tolerance of the velocity and acceleration limits.

    Raises:
        TrajectoryError: If a limit is violated; the message contains the first sample that violates a limit, the
            values, and a remedy.
    """
    check_period(period)
    axes = len(limits.lower)
    columns = _columns(points, axes)
    begin = points[0] if start is None else _start(start, axes)
    rules = [
        rule
        for axis, column in enumerate(columns)
        for rule in limit_violations.joint_rules(column, begin[axis], axis, limits, period, tolerance)
    ]
    _raise_first(
        [*limit_violations.out_of_range(columns, limits), *limit_violations.broken(rules)],
        rules,
        points,
        period,
        away=lambda: limit_violations.joints_away(begin, points[0]),
        out=lambda breach: limit_violations.outside(breach, limits, period),
    )


def check_range(points: Points, limits: Limits, period: float) -> None:
    """Check that no joint leaves its range, regardless of velocities.

    Raises:
        TrajectoryError: If a joint leaves its range; the message contains the first sample at which this happens.
    """
    found = limit_violations.out_of_range(_columns(points, len(limits.lower)), limits)
    if found:
        first = min(found)
        raise TrajectoryError(limit_violations.outside(first, limits, period), first.sample, first.axis)


def check_path(
    points: Points, limits: PathLimits, start: Sequence[float] | None, period: float, kind: PoseKind
) -> None:
    """Check linear and angular velocity and acceleration of the tool, for a trajectory of P or T.

    The joints are not checked, because that requires the kinematics of the arm.

    Args:
        points: Set-points, as :func:`read_trajectory` returns them.
        limits: Limits of the path.
        start: Pose of the tool, as a point; ``None``: the first sample.
        period: Time between two set-points, s.
        kind: Pose type, ``"P"`` or ``"T"``.

    Raises:
        TrajectoryError: If a limit is violated; see :func:`check_trajectory`.
    """
    check_period(period)
    if kind not in ("P", "T"):
        raise _not_among(kind, '"P", "T"')
    size = _SIZES[kind]
    _columns(points, size)
    begin = points[0] if start is None else read_point(start, kind)
    try:
        place, turn = finite_differences.of_path(points, begin[:size], kind)
    except InvalidValue as error:
        raise _first_unusable(points, error) from None
    rules = limit_violations.path_rules(place, turn, limits, period)
    _raise_first(
        limit_violations.broken(rules),
        rules,
        points,
        period,
        away=lambda: limit_violations.tool_away(begin, points[0], place.steps[0], turn.steps[0], kind),
    )


def _columns(points: Points, size: int) -> list[tuple[float, ...]]:
    try:
        columns = list(zip(*points, strict=True))
        usable = len(columns) == size and all(map(math.isfinite, map(sum, columns)))
    except (TypeError, ValueError):
        usable = False
    if not usable:
        raise TrajectoryError(
            tr(
                "each set-point must be {size} finite numbers. Try: create the trajectory with read_trajectory",
                size=size,
            )
        )
    return columns


def _start(start: Sequence[float], axes: int) -> tuple[float, ...]:
    """Return the first ``axes`` joints, because a controller reports eight joints even for an arm with six."""
    if not axes <= len(start) <= _MOST_JOINTS:
        raise TrajectoryError(tr("start is {start}, but {axes} joints are required", start=brief(start), axes=axes))
    return tuple(_number(value, "J", None, place) for place, value in enumerate(start[:axes]))


def _raise_first(
    found: Sequence[LimitViolation],
    rules: Sequence[LimitCheck],
    points: Points,
    period: float,
    *,
    away: Callable[[], str],
    out: Callable[[LimitViolation], str] | None = None,
) -> None:
    """Raise the error for the first limit violation, if there is one.

    ``away`` returns the message for an arm that is not at the beginning of the trajectory. ``out`` returns the message
    for a joint that is out of its range; it is ``None`` if ranges were not checked.
    """
    if not found:
        return
    breach = min(found)
    if breach.rank == RANGE and out is not None:
        text = out(breach)
    elif breach.sample == 0:
        text = away()
    else:
        text = limit_violations.text_of(breach, rules, len(points), period)
    raise TrajectoryError(text, min(breach.sample, len(points) - 1), breach.axis or None)


def _first_unusable(points: Points, error: InvalidValue) -> TrajectoryError:
    """Return the error for the first T whose vectors do not determine its orientation; ``error`` if there is none."""
    for sample, point in enumerate(points):
        try:
            _check_orientation(point, sample)
        except TrajectoryError as found:
            return found
    return TrajectoryError(str(error))
