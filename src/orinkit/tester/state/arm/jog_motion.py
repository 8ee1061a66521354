"""The set-points of jogging: smooth, within the limits, and at standstill before obstacles."""

from __future__ import annotations

from collections import deque
from typing import Final

from orinkit.core.errors import CallError
from orinkit.core.i18n import tr
from orinkit.streaming.planning.joint_planner import JointPlanner
from orinkit.streaming.planning.limits import Limits
from orinkit.tester.state.arm.jog_path import JogPath

_RISE: Final = 0.2  # s from standstill to 100 %
_SMOOTH: Final = 8  # cycles over which the speed is averaged, which limits the jerk
_SHORTEST_STEP: Final = 0.32  # s
_PEAK: Final = 1.875  # largest velocity of the step's profile, relative to the mean one
_SLOWEST: Final = 0.02  # part of the requested speed below which a singular point counts as reached
_MARGIN_CYCLES: Final = 2


class SpeedProfile:
    """A speed, 0 to 1, that follows its goal with limited acceleration and jerk."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._slope = period / _RISE
        self._raw: deque[float] = deque([0.0] * _SMOOTH, _SMOOTH)
        self.speed = 0.0

    def step(self, goal: float) -> float:
        """Return the speed of the next cycle."""
        last = self._raw[-1]
        self._raw.append(last + max(-self._slope, min(self._slope, goal - last)))
        self.speed = sum(self._raw) / _SMOOTH
        return self.speed

    def begin_at(self, speed: float) -> None:
        """Continue from another speed."""
        self._raw.extend([speed] * _SMOOTH)
        self.speed = speed

    @property
    def resting(self) -> bool:
        """True at standstill."""
        return not any(self._raw)

    @property
    def braking(self) -> float:
        """The distance until standstill if the goal is 0 from now on, at a full speed of 1 per s."""
        lag = sum(value * number for number, value in enumerate(self._raw)) / _SMOOTH
        return self._raw[-1] ** 2 / (2 * self._slope) * self._period + lag * self._period


class JogMotion:
    """One motion of jogging, from standstill to standstill.

    Args:
        path: The path.
        start: Joints at which the arm stands.
        limits: Limits of the stream.
        period: Cycle time, s.
        speed: Speed in %.
        step: Distance in deg or mm; 0 to move until :meth:`release`.

    Attributes:
        obstacle: Why the motion ends by itself; ``""`` if it does not.
        ended: True at standstill.
    """

    def __init__(
        self, path: JogPath, start: tuple[float, ...], limits: Limits, period: float, speed: float, step: float = 0.0
    ) -> None:
        self._path, self._period, self._step = path, period, step
        self._planner = JointPlanner(limits, period, start)
        self._profile = SpeedProfile(period)
        self._speed = speed / 100.0
        self._held = True
        self._distance = 0.0
        self._cycle = 0
        self._point = start
        self._cycles = max(1, round(max(_SHORTEST_STEP, _PEAK * step / (self._speed * path.full_speed)) / period))
        self._lost = False  # True if the path cannot be continued: stop in joint space
        self.obstacle = ""
        self.ended = False

    def release(self) -> None:
        """Decelerate and stop."""
        if self._held and self._step:
            self._profile.begin_at(self._step_speed())
        self._held = False

    def next(self) -> tuple[float, ...]:
        """Return the next set-point; it is within the limits."""
        if not self._lost:
            try:
                self._advance()
            except CallError as error:  # the deceleration leads out of the reach
                self.obstacle = self.obstacle or f"{error}"
                self._held, self._lost = False, True
        if self._lost:
            command = self._planner.stop()
            self.ended = self._planner.at_rest
            return command
        command = self._planner.track(self._point)
        still = self._done() if self._held and self._step else self._profile.resting and not self._held
        self.ended = still and self._planner.at_rest and command == self._point
        return command

    def _advance(self) -> None:
        unit = self._path.full_speed
        if self._held and self._step:
            self._look_ahead(self._step if not self._cycle else 0.0)
            if self._held:
                self._cycle = min(self._cycle + 1, self._cycles)
                self._distance = self._step * _quintic(self._cycle / self._cycles)
        else:
            goal = self._speed if self._held else 0.0
            if self._held:
                margin = (self._profile.speed + goal) * _MARGIN_CYCLES * self._period
                self._look_ahead((self._profile.braking + margin) * unit)
                goal = self._goal()
            self._distance += self._profile.step(goal) * unit * self._period
        self._point = self._path.point(self._distance, self._point)

    def _look_ahead(self, distance: float) -> None:
        """Stop in time if there is an obstacle within a distance."""
        if distance:
            self.obstacle = self._path.obstacle(self._distance + distance, self._point)
            self._held = not self.obstacle

    def _goal(self) -> float:
        """Return the speed to reach: 0 if the motion has to end."""
        if not self._held:
            return 0.0
        fastest = self._path.fastest(self._distance, self._point)
        if fastest < _SLOWEST * self._path.full_speed:
            self.obstacle = tr("a singular point is near. Try: jog the joints")
            self._held = False
            return 0.0
        return min(self._speed, fastest / self._path.full_speed)

    def _done(self) -> bool:
        return self._cycle >= self._cycles

    def _step_speed(self) -> float:
        """Return the speed within a step, as a part of the full speed."""
        x = self._cycle / self._cycles
        mean = self._step / (self._cycles * self._period) / self._path.full_speed
        return 30 * x**2 * (1 - x) ** 2 * mean


def _quintic(x: float) -> float:
    return x**3 * (10 - 15 * x + 6 * x**2)
