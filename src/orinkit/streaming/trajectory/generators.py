"""Generated trajectories of joints: a sine on one joint, a line and a circle in space.

All of them begin and end at standstill at the starting joint position. A repetition takes ``period``; at the beginning
and at the end, the motion speeds up and slows down, which adds half a period. The limits of the arm are not considered;
:func:`orinkit.streaming.trajectory.preflight.find_violations` checks them.

The line and the circle move the tool without turning it. They are in base coordinates, and independent of the tool.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

from orinkit.core.errors import CallError
from orinkit.core.i18n import tr
from orinkit.core.validation import check_finite, check_positive, check_range, check_whole
from orinkit.streaming.trajectory.limit_violations import MOST_SAMPLES, TrajectoryError, check_period

if TYPE_CHECKING:
    from orinkit.arms import ArmModel

Points: TypeAlias = list[tuple[float, ...]]
Plane: TypeAlias = Literal["XY", "YZ", "ZX"]

PLANES: Final[dict[Plane, tuple[int, int]]] = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}
"""The planes of a circle, with the numbers of their two axes, from 0."""
SHORTEST: Final = 0.1
"""The shortest period of a repetition, s."""
LONGEST: Final = 3600.0
"""The longest period of a repetition, s."""
MOST_REPETITIONS: Final = 10_000
"""The largest number of repetitions."""

_RAMP: Final = 0.5  # periods in which the motion reaches its velocity


def phases(period: float, repetitions: int, cycle: float) -> list[float]:
    """Return the number of completed repetitions for each set-point: from 0 to ``repetitions``, with smooth ends.

    The arguments and the exceptions are those of :func:`sine`.
    """
    check_range(tr("period"), period, SHORTEST, LONGEST)
    check_whole(tr("repetitions"), repetitions, MOST_REPETITIONS, 1)
    check_period(cycle)
    ramp = _RAMP * period
    duration = repetitions * period + ramp
    if duration / cycle >= MOST_SAMPLES:
        raise TrajectoryError(
            tr(
                "the trajectory would take {seconds:.0f} s, which is more than {most} samples",
                seconds=duration,
                most=MOST_SAMPLES,
            )
        )
    count = math.ceil(round(duration / cycle, 6))  # 4.8 s of 8 ms are 600 cycles, although the quotient is above 600
    times = (number * duration / count for number in range(count + 1))
    return [_phase(time, duration, ramp, period, repetitions) for time in times]


def _phase(time: float, duration: float, ramp: float, period: float, repetitions: int) -> float:
    if time < ramp:
        return (time - ramp / math.pi * math.sin(math.pi * time / ramp)) / (2.0 * period)
    if time > duration - ramp:
        return repetitions - _phase(max(0.0, duration - time), duration, ramp, period, repetitions)
    return (time - ramp / 2.0) / period


def sine(
    start: Sequence[float], axis: int, amplitude: float, period: float, repetitions: int = 1, *, cycle: float = 0.008
) -> Points:
    """Return a sine on one joint, around its starting position.

    Args:
        start: Joint position at the beginning and at the end, deg.
        axis: Number of the joint, from 1.
        amplitude: Amplitude, deg (mm for a linear axis); a negative amplitude begins in the other direction.
        period: Time of one repetition, s.
        repetitions: Number of repetitions.
        cycle: Time between two set-points, s.

    Raises:
        InvalidValue: If an argument is out of range.
        TrajectoryError: If there would be too many set-points.
    """
    check_whole(tr("joint"), axis, len(start), 1)
    size = check_finite(tr("amplitude"), amplitude)
    before, centre, after = tuple(start[: axis - 1]), start[axis - 1], tuple(start[axis:])
    points = [
        (*before, centre + size * math.sin(2.0 * math.pi * phase), *after)
        for phase in phases(period, repetitions, cycle)
    ]
    points[-1] = points[0]  # exactly
    return points


def line(
    model: ArmModel, start: Sequence[float], distance: Sequence[float], period: float, repetitions: int = 1, *,
    cycle: float = 0.008,
) -> Points:  # fmt: skip
    """Return a motion along a straight line in space and back.

    Args:
        model: The arm.
        start: Joint position at the beginning and at the end, deg.
        distance: From the starting position to the other end of the line in base coordinates: X, Y, Z in mm.
        period: Time of one repetition (there and back), s.
        repetitions: Number of repetitions.
        cycle: Time between two set-points, s.

    Raises:
        InvalidValue: If an argument is out of range.
        TrajectoryError: If the arm cannot follow the line, or there would be too many set-points.
        MissingExtra: If numpy is not installed (extra ``virtual``).
    """
    x, y, z = (check_finite(name, value) for name, value in zip("XYZ", distance, strict=True))
    offsets = []
    for phase in phases(period, repetitions, cycle):
        part = (1.0 - math.cos(2.0 * math.pi * phase)) / 2.0
        offsets.append((part * x, part * y, part * z))
    return _shifted(model, start, offsets)


def circle(
    model: ArmModel, start: Sequence[float], radius: float, plane: Plane, period: float, repetitions: int = 1, *,
    cycle: float = 0.008,
) -> Points:  # fmt: skip
    """Return a motion along a circle in space.

    Args:
        model: The arm.
        start: Joint position at the beginning and at the end, deg.
        radius: Radius, mm. The centre is at this distance from the starting position, in the negative direction of the
            first axis of the plane.
        plane: Plane of the circle in base coordinates: XY, YZ or ZX.
        period: Time of one turn, s.
        repetitions: Number of turns.
        cycle: Time between two set-points, s.

    Raises:
        InvalidValue: If an argument is out of range.
        TrajectoryError: If the arm cannot follow the circle, or there would be too many set-points.
        MissingExtra: If numpy is not installed (extra ``virtual``).
    """
    size = check_positive(tr("radius"), radius)
    if plane not in PLANES:
        raise TrajectoryError(tr("the plane must be XY, YZ or ZX, not {plane}", plane=plane))
    first, second = PLANES[plane]
    offsets = []
    for phase in phases(period, repetitions, cycle):
        offset = [0.0, 0.0, 0.0]
        offset[first] = size * (math.cos(2.0 * math.pi * phase) - 1.0)
        offset[second] = size * math.sin(2.0 * math.pi * phase)
        offsets.append((offset[0], offset[1], offset[2]))
    return _shifted(model, start, offsets)


def _shifted(model: ArmModel, start: Sequence[float], offsets: Sequence[tuple[float, float, float]]) -> Points:
    """Return the joints at which the flange is shifted from its pose at ``start`` by each offset, mm."""
    from orinkit.core.optional_deps import require

    require(tr("motions in space"), "virtual", "numpy")
    import numpy as np

    from orinkit.arms.kinematics import Kinematics

    solver = Kinematics(model)
    frames = np.repeat(solver.forward(start)[np.newaxis], len(offsets), axis=0)
    frames[:, :3, 3] += np.array(offsets)
    try:
        joints = solver.follow(frames, start).tolist()
    except CallError as error:
        raise TrajectoryError(tr("the arm cannot follow the path: {error}", error=error)) from None
    rest = tuple(start[len(joints[0]) :])
    first = tuple(map(float, start))
    return [first, *((*row, *rest) for row in joints[1:-1]), first]
