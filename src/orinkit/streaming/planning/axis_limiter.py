"""Limiter of a single axis: keeps every command of a stream within the limits of the axis.

Set-points are the positions that the program requests. A command is the position that is sent to the controller.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.planning.jerk_limited import PART

TOLERANCE: Final = 1e-9
"""Relative tolerance by which a set-point may exceed a limit, because the program that sends it may have rounded it."""
SLIGHT: Final = 1e-3
"""Largest deviation at which a command counts as planned, as a fraction of the largest difference of two steps."""
FINEST: Final = 1e4
"""Smallest permitted limit on a step, and on the difference of two steps, in spacings of floating-point numbers.

A step is the difference of two consecutive commands. The spacing is that of the numbers around the largest position.
"""
ROUNDING: Final = 8.0
"""Margin between planned steps and the limit on a step, in spacings of floating-point numbers; see :data:`FINEST`."""
JUMPS: Final = 2
"""Number of consecutive jumps of the set-points that are ignored, because one outlier causes two jumps.

A jump is a change of the set-points that exceeds the limit of the velocity or of the acceleration.
"""
PUSHED: Final = 0.7
"""Largest acceleration that set-points are assumed to have, as a fraction of the acceleration limit."""

_GREATEST: Final = 1e300


class AxisState(NamedTuple):
    """The position, velocity and acceleration of an axis, absolute or relative to moving set-points.

    The units are deg or mm, and s.
    """

    position: float
    velocity: float
    acceleration: float


class TargetMotion(NamedTuple):
    """The estimated motion of the set-points of one axis.

    A jump is a change of the set-points that exceeds the limit of the velocity or of the acceleration.

    Attributes:
        velocity: Velocity at the set-point before the last one, per second.
        acceleration: Acceleration, per second squared.
        jump_count: Number of consecutive jumps of the set-points since this motion was estimated.
    """

    velocity: float = 0.0
    acceleration: float = 0.0
    jump_count: int = 0

    def relative_state(self, offset: float, velocity: float, acceleration: float, period: float) -> AxisState:
        """Return the state of an axis at its last command, relative to the moving set-points.

        The last set-point belongs to the next command, and the set-point before it to the last command. Therefore the
        relative position is the distance of the last command from the estimated position of the set-points one period
        before the last set-point.

        Args:
            offset: Last command minus last set-point.
            velocity: Velocity of the axis at its last command, per second.
            acceleration: Acceleration of the axis at its last command, per second squared.
            period: Period, s.
        """
        way = (self.velocity + 0.5 * self.acceleration * period) * period
        return AxisState(offset + way, velocity - self.velocity, acceleration - self.acceleration)


class AxisLimiter:
    """Keeps every command of an axis within the limits.

    A step is the difference of two consecutive commands. A step is admissible if it is within the limits of velocity
    and acceleration, and if the axis can still stop before the end of its range. During that stop, each step is shorter
    than the previous one by ``change``, the largest admissible difference of two steps.
    """

    __slots__ = (
        "_period", "_velocity", "acceleration", "change", "free", "jerk", "lower", "max_step", "max_step_change",
        "most", "name", "near", "plan_tolerance", "upper", "velocity",
    )  # fmt: skip

    def __init__(
        self, name: str, lower: float, upper: float, velocity: float, acceleration: float, jerk: float, period: float
    ) -> None:
        self.name = name
        self.lower = lower
        self.upper = upper
        self.max_step = velocity * period * (1.0 + TOLERANCE)  # limit for set-points of the program
        self.max_step_change = acceleration * period * period * (1.0 + TOLERANCE)  # limit for set-points of the program
        spacing = math.ulp(max(-lower, upper))
        change, most = acceleration * period * period, velocity * period
        if not (min(change, most) > FINEST * spacing and max(change, most) < _GREATEST):
            raise InvalidValue(
                tr(
                    "{name}: the period of {period:g} s is too short for a velocity of {velocity:g}/s and an "
                    "acceleration of {acceleration:g}/s^2: they would be lost in rounding",
                    name=name,
                    period=period,
                    velocity=velocity,
                    acceleration=acceleration,
                )
            )
        # With the tolerance, set-points are accepted that brake at the limit and stop exactly at the end of the range.
        self.change = change * (1.0 + 0.5 * TOLERANCE) - ROUNDING * spacing
        self.most = most - ROUNDING * spacing
        self.free = self.max_step * (
            1.0 + 0.5 * self.max_step / self.change
        )  # distance that is sufficient for braking from any step
        self.plan_tolerance = SLIGHT * self.change
        self.velocity = velocity * PART
        self.acceleration = acceleration * PART
        self.jerk = jerk
        self.near = min(jerk * period**3, 0.5 * self.change)
        self._velocity = velocity
        self._period = period

    def start_position(self, joint: float) -> float:
        """Return the position at which a stream starts: ``joint``, clipped to the range of the axis.

        Raises:
            InvalidValue: If ``joint`` is so far outside the range that the axis cannot return within one period.
        """
        clamped = self.clamp(joint)
        if abs(clamped - joint) > self.change:
            raise InvalidValue(self._outside(joint))
        return clamped

    def clamp(self, value: float) -> float:
        """Return the position in the range that is nearest to ``value``."""
        return self.lower if value < self.lower else min(value, self.upper)

    def fits(self, before: float, now: float, value: float) -> bool:
        """Return True if ``value`` is an admissible command after the last two commands, ``before`` and ``now``."""
        step = value - now
        return (
            -self.max_step <= step <= self.max_step
            and -self.max_step_change <= step - (now - before) <= self.max_step_change
            and -self._fastest(now - self.lower) <= step <= self._fastest(self.upper - now)
            and self.lower <= value <= self.upper
        )

    def within(self, before: float, now: float, wanted: float) -> float:
        """Return the admissible command nearest to ``wanted``, after the last two commands, ``before`` and ``now``.

        Finally, the command is clipped to the range of the axis. Clipping may change the step by a rounding error, for
        which the step has a margin from the limits of velocity and acceleration.
        """
        step = now - before
        move = min(max(wanted - now, step - self.change, -self.most), step + self.change, self.most)
        move = min(max(move, -self._fastest(now - self.lower)), self._fastest(self.upper - now))
        return self.clamp(wanted if move == wanted - now else now + move)

    def towards(self, now: float, goal: float) -> float:
        """Return the next command towards a goal: the largest step after which the axis can still stop at the goal."""
        way = goal - now
        step = min(self._fastest(abs(way)), abs(way))
        return goal if step == abs(way) else now + math.copysign(step, way)

    def target_motion(self, before: float, last: float, aim: float, held: TargetMotion | None) -> TargetMotion:
        """Return the motion of the set-points, estimated from the last three of them.

        After a jump, the velocity of the previous estimate is kept for up to two periods.

        Args:
            before: The first set-point.
            last: The second set-point.
            aim: The third set-point.
            held: The previous estimate; ``None`` if there is none.
        """
        step, step_before = aim - last, last - before
        change = step - step_before
        if abs(change) > self.max_step_change or abs(step) > self.max_step:
            held = held or TargetMotion(step_before / self._period if abs(step_before) <= self.max_step else 0.0)
            if held.jump_count < JUMPS:
                return TargetMotion(held.velocity, 0.0, held.jump_count + 1)
            return TargetMotion(step / self._period if abs(step) <= self.max_step else 0.0, 0.0, held.jump_count)
        most = PUSHED * self.acceleration
        acceleration = min(max(change / self._period**2, -most), most)
        return TargetMotion(step / self._period - 0.5 * acceleration * self._period, acceleration)

    def motion(self, earlier: float, before: float, now: float) -> tuple[float, float]:
        """Return the velocity and acceleration with which a smooth motion can begin at the last of three commands."""
        step = now - before
        if step == 0.0:  # the axis is at standstill, regardless of its previous deceleration
            return 0.0, 0.0
        way = math.copysign(1.0, step)
        velocity = min(abs(step) / self._period, self.velocity)
        acceleration = way * (step - (before - earlier)) / self._period**2
        acceleration = min(max(acceleration, -self.acceleration), self.acceleration)
        acceleration = clamp_acceleration(velocity, acceleration, self.velocity, self.jerk)
        velocity = min(max(velocity + 0.5 * acceleration * self._period, 0.0), self.velocity)
        return way * velocity, way * clamp_acceleration(velocity, acceleration, self.velocity, self.jerk)

    def complaint(self, before: float, now: float, value: float, behind: float) -> str:
        """Return the message for a command that is not admissible after the last two commands.

        Args:
            before: The command before the last one.
            now: The last command.
            value: The rejected command.
            behind: Distance from the last command to the last set-point, deg or mm.
        """
        step = value - now
        change = abs(step - (now - before))
        if not self.lower <= value <= self.upper:
            return self._outside(value)
        if abs(step) > self.max_step:
            most = self._velocity * self._period
            return tr(
                "{name}: the step of {step:g} to {value:g} is {excess:.3g} too large: the velocity limit of "
                "{velocity:g}/s allows {most:g} in {period:g} s",
                name=self.name,
                value=value,
                step=abs(step),
                excess=abs(step) - most,
                most=most,
                velocity=self._velocity,
                period=self._period,
            )
        if change > self.max_step_change:
            most = self.max_step_change / (1.0 + TOLERANCE)
            rate = most / self._period**2
            return tr(
                "{name}: at {value:g} the step differs from the last step by {change:g}, which is {excess:.3g} "
                "too much: the acceleration limit of {rate:g}/s^2 allows {most:g} in {period:g} s",
                name=self.name,
                value=value,
                change=change,
                excess=change - most,
                most=most,
                rate=rate,
                period=self._period,
            )
        if abs(behind) > self.near:
            return tr(
                "{name}: the arm lags behind: it is still {behind:.3g} from the last set-point",
                name=self.name,
                behind=abs(behind),
            )
        end, room = (self.upper, self.upper - now) if step > 0.0 else (self.lower, now - self.lower)
        rate, most = abs(step) / self._period, self._fastest(room) / self._period
        return tr(
            "{name}: at {value:g} the velocity is {rate:g}/s, which is {excess:.3g}/s too high; to stop before "
            "the end of its range, {end:g}, the axis may move at {most:g}/s at most",
            name=self.name,
            value=value,
            rate=rate,
            end=end,
            excess=rate - most,
            most=most,
        )

    def _outside(self, value: float) -> str:
        beyond = abs(value - self.clamp(value))
        return tr(
            "{name}: {value:g} is {beyond:.3g} outside the range of {lower:g} to {upper:g}",
            name=self.name,
            value=value,
            beyond=beyond,
            lower=self.lower,
            upper=self.upper,
        )

    def _fastest(self, room: float) -> float:
        return math.inf if room >= self.free else fastest(room, self.change)


def fastest(room: float, change: float) -> float:
    """Return the largest step after which an axis can still stop within a distance.

    If the step is at most (n + 1) times ``change``, n further steps follow before standstill. Each of them is shorter
    than the previous step by ``change``.

    Args:
        room: The distance that the step and the following stop may cover together, deg or mm.
        change: The largest difference between two steps.
    """
    if room <= 0.0:
        return 0.0
    n = max(math.ceil(0.5 * math.sqrt(1.0 + 8.0 * room / change) - 1.5), 0)
    return room / (n + 1) + 0.5 * n * change


def clamp_acceleration(velocity: float, acceleration: float, most: float, jerk: float) -> float:
    """Return the acceleration, limited so that the velocity can neither exceed its limit nor change its sign.

    Args:
        velocity: Velocity, from 0 to ``most``.
        acceleration: Acceleration; negative values brake.
        most: The largest velocity.
        jerk: The jerk with which the acceleration is then reduced to 0.
    """
    least = -math.sqrt(2.0 * jerk * velocity)
    return min(max(acceleration, least), math.sqrt(2.0 * jerk * (most - velocity)))
