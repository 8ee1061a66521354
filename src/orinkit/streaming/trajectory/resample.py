"""Resampling of a trajectory to another period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.finite_differences import Points
from orinkit.streaming.trajectory.limit_violations import MOST_SAMPLES, TrajectoryError, check_period
from orinkit.streaming.trajectory.spline import Curve

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind

_SAME: Final = 1e-4  # periods with a smaller relative difference are equal, because times in files are rounded
_ROUNDING: Final = 1e-9


def resample(points: Points, from_period: float, to_period: float, kind: PoseKind) -> list[tuple[float, ...]]:
    """Return the same motion with another period, by cubic interpolation.

    The first and the last set-point are not changed. If the duration is not a multiple of the new period, the motion
    takes a fraction of a period longer. If the new period is longer than the old one, details between the new samples
    are lost, because samples are not averaged.

    Args:
        points: Set-points, as ``read_trajectory`` returns them.
        from_period: Period of the set-points, s.
        to_period: Period of the result, s.
        kind: Pose type of the set-points.

    Raises:
        TrajectoryError: If the result would be too long, or the figure of a P or T changes between samples.
        InvalidValue: If a period is not valid.
    """
    check_period(from_period)
    check_period(to_period)
    pieces = len(points) - 1
    if abs(from_period - to_period) <= _SAME * to_period or pieces < 1:
        return list(points)
    steps = pieces * from_period / to_period
    if steps >= MOST_SAMPLES:
        raise TrajectoryError(
            tr(
                "with a period of {period:g} s the trajectory would have more than {most} samples",
                period=to_period,
                most=MOST_SAMPLES,
            )
        )
    count = max(1, math.ceil(steps * (1 - _ROUNDING)))
    places = [number * pieces / count for number in range(1, count)]
    samples = [min(int(place), pieces - 1) for place in places]
    between = Curve(points, kind).at(samples, [place - sample for place, sample in zip(places, samples, strict=True)])
    return [points[0], *between, points[-1]]
