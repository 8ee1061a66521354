"""Motion profiles: the progress of a motion along its path over time, from rest to rest.

A profile is a trapezoidal velocity profile, smoothed by a moving average over the time ``smoothing``. An average never
exceeds the maximum of the averaged values. Velocity and acceleration therefore stay within the limits of the trapezoid,
and the jerk is at most the sum of acceleration and deceleration, divided by ``smoothing``. The result has up to seven
pieces of constant jerk.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from orinkit.core.i18n import tr

Array: TypeAlias = npt.NDArray[np.float64]

SMOOTHING: Final = 0.04
"""Seconds over which a trapezoid is averaged."""

_SAMPLES: Final = 4096  # of a profile, to compute its inverse
# A very short piece of a long profile would be lost in the rounding of its times. These constants limit the
# acceleration and deceleration times (s) and the ratio of the longer to the shorter one.
_SHORTEST_RISE: Final = 1e-3
_GREATEST_RATIO: Final = 1e4
_SMALLEST: Final = 1e-18


class Knot(NamedTuple):
    """A point at which the jerk of a profile changes.

    Position, velocity and acceleration are the values at ``time``; the jerk applies from ``time`` on.
    """

    time: float
    position: float
    velocity: float
    acceleration: float
    jerk: float


class MotionProfile:
    """A motion profile: the progress s along the path at time t.

    s is 0 until t = 0, exactly 1 from ``duration`` on, and never above 1.

    Attributes:
        knots: The beginnings of the pieces, in order of time; empty for a profile of duration 0.
        duration: Duration of the motion, in seconds.
        slowing: Time at which the deceleration begins, in seconds.
    """

    __slots__ = ("_times", "duration", "knots", "slowing")

    def __init__(self, knots: tuple[Knot, ...], duration: float, slowing: float) -> None:
        self.knots = knots
        self.duration = duration
        self.slowing = slowing
        self._times = [knot.time for knot in knots]

    @classmethod
    def trapezoid(
        cls, velocity: float, acceleration: float, deceleration: float, smoothing: float = SMOOTHING
    ) -> MotionProfile:
        """Return the fastest profile within limits.

        Args:
            velocity: Largest rate of s, in 1/s.
            acceleration: Largest acceleration of s, in 1/s^2.
            deceleration: Largest deceleration of s, in 1/s^2.
            smoothing: Seconds over which the trapezoid is averaged, more than 0.

        Raises:
            ValueError: If an argument is not finite, or is below 10^-18.
        """
        for limit in (velocity, acceleration, deceleration, smoothing):
            if not (math.isfinite(limit) and limit >= _SMALLEST):
                raise ValueError(
                    tr(
                        "a limit of a motion profile must be a finite number of at least {smallest:g}, not {limit!r}",
                        smallest=_SMALLEST,
                        limit=limit,
                    )
                )
        slower, quickest = min(acceleration, deceleration) * _GREATEST_RATIO, velocity / _SHORTEST_RISE
        acceleration, deceleration = min(acceleration, slower, quickest), min(deceleration, slower, quickest)
        top = min(velocity, math.sqrt(2 / (1 / acceleration + 1 / deceleration)))
        rise, fall = top / acceleration, top / deceleration
        cruise = max(0.0, 1 / top - rise / 2 - fall / 2)
        return cls(*_smoothed(top, rise, cruise, fall, smoothing))

    @classmethod
    def instant(cls) -> MotionProfile:
        """Return the profile of a motion of length 0."""
        return cls((), 0.0, 0.0)

    def stretched(self, duration: float) -> MotionProfile:
        """Return this profile slowed down to ``duration`` in seconds, or unchanged if it already takes that long.

        Raises:
            ValueError: If the duration is not finite.
        """
        if not math.isfinite(duration):
            raise ValueError(tr("a duration must be a finite number of seconds, not {duration!r}", duration=duration))
        if duration <= self.duration or not self.knots:
            return self
        k = duration / self.duration
        knots = tuple(Knot(t * k, s, v / k, a / k**2, j / k**3) for t, s, v, a, j in self.knots)
        return MotionProfile(knots, duration, self.slowing * k)

    def at(self, time: float) -> float:
        """Return s, the progress along the path from 0 to 1, at ``time`` in seconds."""
        if time >= self.duration:
            return 1.0
        if time <= 0:
            return 0.0
        start, s, v, a, j = self.knots[bisect_right(self._times, time) - 1]
        t = time - start
        s += t * (v + t * (a / 2 + t * (j / 6)))
        return s if s < 1 else 1.0

    def rate(self, time: float) -> float:
        """Return the rate of s, in 1/s, at ``time`` in seconds."""
        if not 0 < time < self.duration:
            return 0.0
        start, _, v, a, j = self.knots[bisect_right(self._times, time) - 1]
        t = time - start
        return v + t * (a + t * (j / 2))

    def states_at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return s, its rate (1/s) and its acceleration (1/s^2) at ``times`` in seconds; all arrays have one shape."""
        inside = (times > 0) & (times < self.duration)
        if not self.knots:
            zeros = np.zeros_like(times)
            return np.where(times >= self.duration, 1.0, 0.0), zeros, zeros
        table = np.array(self.knots)
        row = table[np.clip(np.searchsorted(table[:, 0], times, "right") - 1, 0, len(table) - 1)]
        t = times - row[..., 0]
        s, v, a, j = (row[..., n] for n in range(1, 5))
        position = np.minimum(s + t * (v + t * (a / 2 + t * (j / 6))), 1.0)
        position = np.where(inside, position, np.where(times >= self.duration, 1.0, 0.0))
        return position, np.where(inside, v + t * (a + t * (j / 2)), 0.0), np.where(inside, a + t * j, 0.0)

    def moments(self, positions: Array) -> Array:
        """Return the times in seconds at which s reaches ``positions``, with a resolution of 1/4096 of the duration."""
        times = np.union1d(np.linspace(0.0, self.duration, _SAMPLES), [*self._times, self.duration])
        moments: Array = np.interp(positions, self.states_at(times)[0], times)
        return moments


def _smoothed(
    top: float, rise: float, cruise: float, fall: float, width: float
) -> tuple[tuple[Knot, ...], float, float]:
    # The acceleration of a trapezoid changes in steps. If it is averaged over the last `width` seconds, the jerk
    # changes when a step enters the average, and by the opposite amount when the step leaves the average.
    slowing = rise + cruise
    end = slowing + fall
    steps = ((0.0, top / rise), (rise, -top / rise), (slowing, -top / fall), (end, top / fall))
    changes = sorted([(t, a / width) for t, a in steps] + [(t + width, -a / width) for t, a in steps])
    knots: list[Knot] = []
    s = v = a = j = 0.0
    for (time, change), (following, _) in pairwise(changes):
        j += change
        if (t := following - time) > 0:
            knots.append(Knot(time, s, v, a, j))
            s += t * (v + t * (a / 2 + t * (j / 6)))
            v += t * (a + t * (j / 2))
            a += t * j
    return tuple(knots), end + width, slowing
