"""Retiming: slows a trajectory down where it exceeds the limits of the arm, without changing its path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final, Protocol

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory import finite_differences
from orinkit.streaming.trajectory.limit_violations import MOST_SAMPLES, TrajectoryError, check_period
from orinkit.streaming.trajectory.spline import Curve
from orinkit.streaming.trajectory.topp_ra import (
    CurveConstraints,
    JointConstraints,
    PathConstraints,
    cells_of,
    profile_of,
)
from orinkit.streaming.trajectory.trajectory import check_path, check_range, check_trajectory, read_trajectory

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind
    from orinkit.streaming.trajectory.finite_differences import Points

_ROUNDS: Final = 20  # the largest number of attempts, each slower than the one before
_MORE: Final = 0.005  # reduction of the limits in each round, at limit violations
_LITTLE: Final = 0.002  # reduction of the limits in each round, everywhere else


def retime(
    points: Sequence[Sequence[float]], limits: Limits | PathLimits, period: float, kind: PoseKind = "J"
) -> list[tuple[float, ...]]:
    """Return the fastest trajectory that has the same path and stays within the limits.

    The result is nowhere faster than the original trajectory. It begins at the first point and ends at the last one, at
    standstill. A jump between two points becomes a straight motion (of the joints for J, of the tool for P and T). A
    trajectory within the limits is returned unchanged.

    Args:
        points: The trajectory, one point per period.
        limits: Limits of the joints for J, of the path for P and T.
        period: Time between two set-points, s.
        kind: Pose type of the points.

    Raises:
        TrajectoryError: If a point is not valid or out of range, the figure of a P or T changes between samples, or the
            result would be too long or would still violate the limits.
        InvalidValue: If the period is not valid.
    """
    check_period(period)
    arm = _arm(limits, period, kind)
    given = read_trajectory(points, kind, arm.axes)
    if arm.fault(given) is None or len(given) == 1:
        return given
    arm.check_range(given)
    curve = Curve(given, kind, arm.ranges)
    constraints = arm.constraints(curve)
    cells = cells_of(constraints)
    allowed = [1.0] * (len(given) - 1)
    for number in range(1, _ROUNDS + 1):
        profile = profile_of(constraints, cells, allowed)
        if profile.periods > MOST_SAMPLES - 1:
            raise _too_long(profile.periods * period)
        samples, fractions = profile.sampled()
        result = [given[0], *map(arm.within, curve.at(samples, fractions)), given[-1]]
        fault = arm.fault(result)
        if fault is None:
            return result
        _slow_down(allowed, cells.feasible_at_full_rate, samples, arm.excesses(result), number)
    raise _impossible(fault)


class _RetimeProblem(Protocol):
    """The limits of a trajectory of one pose type, and the checks against them."""

    axes: int
    ranges: Sequence[tuple[float, float]]

    def fault(self, points: Points) -> TrajectoryError | None:
        """Return the error for the first limit violation of a trajectory; ``None`` if there is none."""

    def check_range(self, points: Points) -> None:
        """Raise TrajectoryError if a point is out of range, because retiming cannot correct that."""

    def constraints(self, curve: Curve) -> CurveConstraints:
        """Return the constraints that the limits impose on a curve."""

    def within(self, point: tuple[float, ...]) -> tuple[float, ...]:
        """Return a point of the curve, clipped to the range; between samples, the curve may leave the range."""

    def excesses(self, points: Points) -> list[float]:
        """Return the largest ratio of a difference to its limit, for each sample and the stop after the last one."""


class _JointProblem:
    def __init__(self, limits: Limits, period: float) -> None:
        self.axes = len(limits.lower)
        self.ranges: Sequence[tuple[float, float]] = list(zip(limits.lower, limits.upper, strict=True))
        self._limits = limits
        self._period = period
        self._velocity = [limit * period for limit in limits.velocity]
        self._acceleration = [limit * period**2 for limit in limits.acceleration]

    def fault(self, points: Points) -> TrajectoryError | None:
        return _caught(lambda: check_trajectory(points, self._limits, None, self._period))

    def check_range(self, points: Points) -> None:
        check_range(points, self._limits, self._period)

    def constraints(self, curve: Curve) -> CurveConstraints:
        return JointConstraints(curve.coordinates, self._velocity, self._acceleration)

    def within(self, point: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(map(min, map(max, point, self._limits.lower), self._limits.upper))

    def excesses(self, points: Points) -> list[float]:
        rows = []
        for axis, column in enumerate(zip(*points, strict=True)):
            steps, changes = finite_differences.of_column(column, column[0])
            rows.append(_parts(steps, self._velocity[axis]))
            rows.append(_parts(changes, self._acceleration[axis]))
        return list(map(max, *rows))


class _PathProblem:
    axes = 6

    def __init__(self, limits: PathLimits, period: float, kind: PoseKind) -> None:
        self.ranges: Sequence[tuple[float, float]] = ()
        self._limits = limits
        self._period = period
        self._kind = kind
        self._velocities = limits.speed * period, limits.rotation * period
        self._accelerations = limits.acceleration * period**2, limits.rotation_acceleration * period**2

    def fault(self, points: Points) -> TrajectoryError | None:
        return _caught(lambda: check_path(points, self._limits, None, self._period, self._kind))

    def check_range(self, points: Points) -> None:
        """Accept all points, because the poses of a tool have no range."""

    def constraints(self, curve: Curve) -> CurveConstraints:
        return PathConstraints(
            curve.coordinates,
            self._velocities[0], self._accelerations[0], self._velocities[1], self._accelerations[1],
        )  # fmt: skip

    def within(self, point: tuple[float, ...]) -> tuple[float, ...]:
        return point

    def excesses(self, points: Points) -> list[float]:
        rows = []
        for differences, velocity, acceleration in zip(
            finite_differences.of_path(points, points[0], self._kind),
            self._velocities,
            self._accelerations,
            strict=True,
        ):
            rows.append(_parts(differences.steps, velocity))
            rows.append(_parts(differences.changes, acceleration))
        return list(map(max, *rows))


def _arm(limits: object, period: float, kind: PoseKind) -> _RetimeProblem:
    if kind == "J" and isinstance(limits, Limits):
        return _JointProblem(limits, period)
    if kind in ("P", "T") and isinstance(limits, PathLimits):
        return _PathProblem(limits, period, kind)
    raise InvalidValue(
        tr(
            "{name} cannot be used with set-points of type {kind}: J requires Limits, P and T require PathLimits",
            name=type(limits).__name__,
            kind=brief(kind),
        )
    )


def _slow_down(
    allowed: list[float], free: Sequence[bool], samples: Sequence[int], excesses: Sequence[float], number: int
) -> None:
    """Reduce ``allowed``, the usable fraction of the limits, around each limit violation, and slightly elsewhere.

    ``number`` is the number of the attempt, from 1. The slight reduction applies from the second attempt on, except in
    intervals that are within the limits at the original rate (``free``). It is for samples that are just within the
    limits, and could violate them after other samples have moved.
    """
    last = len(allowed) - 1
    places = [0, *samples, last]
    lowered: dict[int, float] = {}
    for sample, excess in enumerate(excesses):
        if excess > 1.0:
            begin, end = (places[min(max(other, 0), len(places) - 1)] for other in (sample - 2, sample + 1))
            for interval in range(max(begin - 1, 0), min(end + 1, last) + 1):
                lowered[interval] = max(excess, lowered.get(interval, 1.0))
    everywhere = 1.0 - _LITTLE * (number - 1)
    for interval, known in enumerate(free):
        if interval in lowered:
            allowed[interval] *= (1.0 - _MORE * number) / lowered[interval]
        elif not known:
            allowed[interval] *= everywhere


def _parts(values: Sequence[float], most: float) -> list[float]:
    return [abs(value) / most for value in values]


def _caught(check: Callable[[], None]) -> TrajectoryError | None:
    try:
        check()
    except TrajectoryError as error:
        return error
    return None


def _too_long(seconds: float) -> TrajectoryError:
    return TrajectoryError(
        tr(
            "within these limits the trajectory would take {seconds:.0f} s, which is more than {most} samples",
            seconds=seconds,
            most=MOST_SAMPLES,
        )
    )


def _impossible(fault: TrajectoryError | None) -> TrajectoryError:
    return TrajectoryError(
        tr(
            "the trajectory could not be slowed down enough to stay within the limits: {fault}. Try: points that "
            "form a smoother path",
            fault=fault,
        ),
        *((fault.sample, fault.axis) if fault is not None else ()),
    )
