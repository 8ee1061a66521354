"""Jerk-limited motions, one period at a time, computed by the library Ruckig (extra ``stream``).

Way-points are never used, because Ruckig calls an internet service to compute motions with way-points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

PART: Final = 0.999
"""Fraction of the velocity and acceleration limits that smooth motions use, so that no command exceeds a limit."""
SNAP: Final = 1e-6
"""Distance from a goal, deg or mm, up to which the goal counts as reached."""
SLOWEST: Final = 0.02
"""Fraction of the largest velocity that always remains available for catching up with set-points."""

_EXTRA_JERK: Final = 3.0  # largest additional jerk for catching up, as a multiple of the limit
_FULL: Final = 0.1  # acceleration of the set-points, as a fraction of the limit, from which all of it is available
_BESIDE: Final = 1.0 - 1e-6
_BEYOND: Final = 1e-6  # deg: tolerance of a range, for rounding


class JerkLimitedMotion:
    """A smooth motion of several axes; each :meth:`step` computes the state one period later.

    Args:
        count: Number of axes.
        period: Period, s.
        halting: True for a stop, which ends at any position; False for a motion to a goal.
        ranges: Lowest positions and highest positions, one value per axis; ``None`` if each axis moves independently.
            With ranges, the axes are synchronized: they arrive at the same time, and a motion that begins at standstill
            follows a straight line. If a synchronized motion would leave the ranges, or cannot be computed, each axis
            moves independently, as fast as possible.

    Attributes:
        position: Position after the last :meth:`step`, one value per axis.
        velocity: Velocity after the last :meth:`step`, per second.
        acceleration: Acceleration after the last :meth:`step`, per second squared.

    Raises:
        MissingExtra: If ruckig is not installed.
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
        # ValueError: for a motion of several hours, Ruckig returns a result that its Python module does not define
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
        """Set the limits of the next steps, one value per axis, all positive.

        Args:
            forth: Largest velocity in the positive direction, per second.
            back: Largest velocity in the negative direction.
            faster: Largest acceleration in the positive direction, per second squared.
            slower: Largest acceleration in the negative direction.
            jerk: Largest jerk in both directions, per second cubed.
        """
        given = self._input
        given.max_velocity = forth
        given.min_velocity = [-value for value in back]
        given.max_acceleration = faster
        given.min_acceleration = [-value for value in slower]
        given.max_jerk = jerk

    def aim(self, goal: list[float]) -> None:
        """Set the goal of the next steps; with the same goal as before, the motion continues unchanged."""
        if goal != self._goal:
            self._goal = goal
            self._input.target_position = goal
            self.resynchronize()

    def resynchronize(self) -> None:
        """Synchronize the axes again, after :meth:`step` has ended the synchronization."""
        if self._ranges is not None:
            self._input.synchronization = self._together

    def step(self, position: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]) -> bool | None:
        """Compute the state one period after the given state, and store it in the attributes.

        Returns:
            True if the motion has ended, False if it continues; ``None`` if the state cannot be computed. In the last
            case, the attributes keep the values of the previous step.
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
        """Return a state very close to a state from which Ruckig cannot compute a motion.

        Ruckig fails for about one state in 10,000, but not for the states close to it. An axis that is almost at its
        goal is set to the goal, because Ruckig cannot compute such short motions exactly.
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


def catch_up_jerk(jerk: float, part: float) -> float:
    """Return the jerk limit of a motion that catches up with set-points.

    The limit increases with the acceleration of the set-points: if this acceleration changes, a motion with low jerk
    would never catch up.

    Args:
        jerk: Jerk limit of smooth motions.
        part: Acceleration of the set-points as a fraction of the acceleration limit.
    """
    return jerk * (1.0 + _EXTRA_JERK * min(part / _FULL, 1.0))


def load_ruckig() -> ModuleType:
    """Import ruckig and return the module.

    Raises:
        MissingExtra: If ruckig is not installed.
    """
    require(tr("streaming in slave mode"), "stream", "ruckig")
    import ruckig

    module: ModuleType = ruckig
    return module
