"""Motions that are limited in jerk, one period at a time: Ruckig, as the planners need it (extra ``stream``).

Never with way-points: those Ruckig has computed by a service in the internet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

PART: Final = 0.999
"""Of velocity and acceleration that smooth motions use: what is sampled from them is within the limits for sure."""
SNAP: Final = 1e-6
"""So near, in deg or mm, a goal has been reached."""
SLOWEST: Final = 0.02
"""Of the largest velocity: what is always left for catching up."""

_EXTRA_JERK: Final = 3.0  # times the jerk that catching up may have besides, with set-points of
_FULL: Final = 0.1  # of the largest acceleration, or more
_BESIDE: Final = 1.0 - 1e-6
_BEYOND: Final = 1e-6  # deg outside a range that are rounding


class JerkLimitedMotion:
    """A smooth motion of some axes: its state one period later.

    Args:
        count: number of axes.
        period: seconds.
        halting: whether it ends at rest wherever that is, instead of at a goal.
        ranges: lower and upper positions. With them all axes arrive together, from rest on a straight line; unless the
            way would lead outside, or cannot be computed, when each axis is as fast as it can be.

    Attributes:
        position: after the last step.
        velocity: the same, per second.
        acceleration: the same, per second squared.

    Raises:
        MissingExtra: ruckig is not installed.
    """

    __slots__ = (
        "_alone", "_errors", "_finished", "_generator", "_goal", "_input", "_output", "_period", "_ranges", "_together",
        "_working", "acceleration", "position", "velocity",
    )  # fmt: skip

    def __init__(
        self,
        count: int,
        period: float,
        *,
        halting: bool = False,
        ranges: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> None:
        ruckig = load_ruckig()
        self._generator: Any = ruckig.Ruckig(count, period)
        self._input: Any = ruckig.InputParameter(count)
        self._output: Any = ruckig.OutputParameter(count)
        # ValueError: a motion of some hours has a result that ruckig's module for Python does not know
        self._errors: tuple[type[Exception], ...] = (ruckig.RuckigError, ValueError)
        self._working: Any = ruckig.Result.Working
        self._finished: Any = ruckig.Result.Finished
        self._alone: Any = ruckig.Synchronization.No
        self._together: Any = ruckig.Synchronization.Phase
        self._ranges = ranges
        self._period = period
        self._goal: list[float] | None = None
        self._input.synchronization = self._alone
        if halting:
            self._input.control_interface = ruckig.ControlInterface.Velocity
        self.position = self.velocity = self.acceleration = [0.0] * count

    def limit(
        self,
        forth: Sequence[float],
        back: Sequence[float],
        faster: Sequence[float],
        slower: Sequence[float],
        jerk: Sequence[float],
    ) -> None:
        """Set the limits of the next steps, one value for each axis, all above 0.

        Args:
            forth: largest velocity, per second.
            back: the same in the other direction.
            faster: largest acceleration, per second squared.
            slower: the same in the other direction.
            jerk: per second cubed, in both.
        """
        given = self._input
        given.max_velocity = forth
        given.min_velocity = [-value for value in back]
        given.max_acceleration = faster
        given.min_acceleration = [-value for value in slower]
        given.max_jerk = jerk

    def aim(self, goal: list[float]) -> None:
        """Set the goal of the next steps; with the same goal as before, a motion just goes on."""
        if goal != self._goal:
            self._goal = goal
            self._input.target_position = goal
            self.restart()

    def restart(self) -> None:
        """Have all axes arrive together again."""
        if self._ranges is not None:
            self._input.synchronization = self._together

    def step(self, position: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]) -> bool | None:
        """Compute the state one period after a state.

        Returns:
            Whether the motion has ended; ``None`` where it cannot be computed, and the last step is still the last one.
        """
        ended = self._update(position, velocity, acceleration)
        if ended is not None:
            return ended
        beside = self._beside(position, velocity, acceleration)
        ended = self._update(*beside)
        if ended is None and self._input.synchronization != self._alone:
            self._input.synchronization = self._alone
            ended = self._update(position, velocity, acceleration)
            if ended is None:
                ended = self._update(*beside)
        return ended

    def _beside(
        self, position: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]
    ) -> tuple[list[float], list[float], list[float]]:
        """Return a state right beside one: those that Ruckig cannot solve, one in 10,000 or so, stand alone.

        An axis that is all but at its goal is there: much less can be computed exactly.
        """
        x, v, a = list(position), list(velocity), [value * _BESIDE for value in acceleration]
        for axis, aim in enumerate(self._goal or ()):
            if max(abs(x[axis] - aim), abs(v[axis]) * self._period, abs(a[axis]) * self._period**2) <= SNAP:
                x[axis], v[axis], a[axis] = aim, 0.0, 0.0
        return x, v, a

    def _update(
        self, position: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]
    ) -> bool | None:
        given = self._input
        given.current_position = position
        given.current_velocity = velocity
        given.current_acceleration = acceleration
        output = self._output
        try:
            result = self._generator.update(self._input, output)
        except self._errors:
            return None
        reached: list[float] = output.new_position
        if result not in (self._working, self._finished) or not math.isfinite(sum(reached)):
            return None
        if output.new_calculation and self._ranges is not None and not self._stays_inside():
            return None
        self.position = reached
        self.velocity = output.new_velocity
        self.acceleration = output.new_acceleration
        return bool(result == self._finished)

    def _stays_inside(self) -> bool:
        if self._ranges is None or self._input.synchronization == self._alone:
            return True
        extrema = zip(self._output.trajectory.position_extrema, *self._ranges, strict=True)
        return all(lower - _BEYOND <= way.min and way.max <= upper + _BEYOND for way, lower, upper in extrema)


def keeping_up(jerk: float, part: float) -> float:
    """Return the jerk of a motion that catches up with set-points.

    Planned as seen from something with an acceleration that changes, a motion with little jerk comes too late for ever.

    Args:
        jerk: of smooth motions.
        part: acceleration of the set-points, as a part of the largest one.
    """
    return jerk * (1.0 + _EXTRA_JERK * min(part / _FULL, 1.0))


def load_ruckig() -> ModuleType:
    """Return the module ruckig.

    Raises:
        MissingExtra: it is not installed.
    """
    require(tr("streaming in slave mode"), "stream", "ruckig")
    import ruckig

    module: ModuleType = ruckig
    return module
