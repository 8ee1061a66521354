"""What one axis may do: the law that keeps every command of a stream within the limits, whatever is wanted."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.planning.jerk_limited import PART

TOLERANCE: Final = 1e-9
"""By which part of a limit a set-point may be beyond it: the rounding of whoever made it."""
SLIGHT: Final = 1e-3
"""Of the largest change of a step: a command so near to what was planned is still on the plan."""
FINEST: Final = 1e4
"""Times the spacing of numbers: the least that an acceleration has to be in a period."""
ROUNDING: Final = 8.0
"""Such spacings by which own steps keep away from the limits."""
JUMPS: Final = 2
"""A set-point beside the others makes two changes that no arm can follow."""
PUSHED: Final = 0.7
"""Of the largest acceleration: what set-points are taken to have at most."""

_GREATEST: Final = 1e300


class AxisState(NamedTuple):
    """Where an axis is (deg or mm), or where it is as seen from something else, and how it moves (per second)."""

    position: float
    velocity: float
    acceleration: float


class TargetMotion(NamedTuple):
    """How set-points move.

    Attributes:
        velocity: at the last but one of them, per second.
        acceleration: per second squared.
        jumps: how many jumps in a row it has outlived.
    """

    velocity: float = 0.0
    acceleration: float = 0.0
    jumps: int = 0

    def outward(self, offset: float, velocity: float, acceleration: float, period: float) -> AxisState:
        """Return how an axis moves as seen from the set-points, a period before the last one.

        Args:
            offset: of the axis from the last set-point.
            velocity: of the axis.
            acceleration: of the axis.
            period: seconds.
        """
        way = (self.velocity + 0.5 * self.acceleration * period) * period
        return AxisState(offset + way, velocity - self.velocity, acceleration - self.acceleration)


class AxisLimiter:
    """What an axis may do: the law that keeps every command within the limits.

    A step is the difference of two commands. Of the steps that velocity and acceleration allow, those are taken from
    which the axis can be braked before the end of its range: with steps that become smaller by ``change`` each time.
    """

    __slots__ = (
        "_period", "_velocity", "acceleration", "change", "free", "jerk", "lower", "most", "name", "near", "slight",
        "upper", "velocity", "widest", "wildest",
    )  # fmt: skip

    def __init__(
        self, name: str, lower: float, upper: float, velocity: float, acceleration: float, jerk: float, period: float
    ) -> None:
        self.name = name
        self.lower = lower
        self.upper = upper
        self.widest = velocity * period * (1.0 + TOLERANCE)  # of other people's steps
        self.wildest = acceleration * period * period * (1.0 + TOLERANCE)  # change of other people's steps
        spacing = math.ulp(max(-lower, upper))
        change, most = acceleration * period * period, velocity * period
        if not (min(change, most) > FINEST * spacing and max(change, most) < _GREATEST):
            raise InvalidValue(
                tr(
                    "{name}: with a period of {period:g} s, a velocity of {velocity:g}/s or an acceleration "
                    "of {acceleration:g}/s^2 is lost in rounding",
                    name=name,
                    period=period,
                    velocity=velocity,
                    acceleration=acceleration,
                )
            )
        # so that set-points that brake with all that is allowed, right to the end of the range, are passed on to it
        self.change = change * (1.0 + 0.5 * TOLERANCE) - ROUNDING * spacing
        self.most = most - ROUNDING * spacing
        self.free = self.widest * (1.0 + 0.5 * self.widest / self.change)  # room that is enough for any step
        self.slight = SLIGHT * self.change
        self.velocity = velocity * PART
        self.acceleration = acceleration * PART
        self.jerk = jerk
        self.near = min(jerk * period**3, 0.5 * self.change)
        self._velocity = velocity
        self._period = period

    def start(self, joint: float) -> float:
        """Return where a stream can start if the axis stands at ``joint``.

        Raises:
            InvalidValue: it is outside its range.
        """
        inside = self.inside(joint)
        if abs(inside - joint) > self.change:
            raise InvalidValue(self._outside(joint))
        return inside

    def inside(self, value: float) -> float:
        """Return the nearest position in the range."""
        return self.lower if value < self.lower else min(value, self.upper)

    def fits(self, before: float, now: float, value: float) -> bool:
        """Tell whether a command may come after two others."""
        step = value - now
        return (
            -self.widest <= step <= self.widest
            and -self.wildest <= step - (now - before) <= self.wildest
            and -self._fastest(now - self.lower) <= step <= self._fastest(self.upper - now)
            and self.lower <= value <= self.upper
        )

    def within(self, before: float, now: float, wanted: float) -> float:
        """Return the command nearest to a wanted one that may come after two others.

        The range comes last: what rounding makes of its two bounds is within what own steps keep away from the others.
        """
        step = now - before
        move = min(max(wanted - now, step - self.change, -self.most), step + self.change, self.most)
        move = min(max(move, -self._fastest(now - self.lower)), self._fastest(self.upper - now))
        return self.inside(wanted if move == wanted - now else now + move)

    def towards(self, now: float, goal: float) -> float:
        """Return a command on the way to a goal from which the axis can be braked before it."""
        way = goal - now
        step = min(self._fastest(abs(way)), abs(way))
        return goal if step == abs(way) else now + math.copysign(step, way)

    def course(self, before: float, last: float, aim: float, held: TargetMotion | None) -> TargetMotion:
        """Return how three set-points move; where they jump, how they moved before, for a little while.

        Args:
            before: the first one.
            last: the second one.
            aim: the third one.
            held: how the first two moved, with the one before them; ``None`` where that is not known.
        """
        step, step_before = aim - last, last - before
        change = step - step_before
        if abs(change) > self.wildest or abs(step) > self.widest:
            held = held or TargetMotion(step_before / self._period if abs(step_before) <= self.widest else 0.0)
            if held.jumps < JUMPS:
                return TargetMotion(held.velocity, 0.0, held.jumps + 1)
            return TargetMotion(step / self._period if abs(step) <= self.widest else 0.0, 0.0, held.jumps)
        most = PUSHED * self.acceleration
        acceleration = min(max(change / self._period**2, -most), most)
        return TargetMotion(step / self._period - 0.5 * acceleration * self._period, acceleration)

    def motion(self, earlier: float, before: float, now: float) -> tuple[float, float]:
        """Return velocity and acceleration at the last of three commands, such that a smooth motion can begin there."""
        step = now - before
        if step == 0.0:  # it stands, however hard it was braked
            return 0.0, 0.0
        way = math.copysign(1.0, step)
        velocity = min(abs(step) / self._period, self.velocity)
        acceleration = way * (step - (before - earlier)) / self._period**2
        acceleration = min(max(acceleration, -self.acceleration), self.acceleration)
        acceleration = bearable(velocity, acceleration, self.velocity, self.jerk)
        velocity = min(max(velocity + 0.5 * acceleration * self._period, 0.0), self.velocity)
        return way * velocity, way * bearable(velocity, acceleration, self.velocity, self.jerk)

    def complaint(self, before: float, now: float, value: float, behind: float) -> str:
        """Return why a command may not come after two others.

        Args:
            before: the command before the last one.
            now: the last one.
            value: the one that may not come.
            behind: how far the last one is from the set-point that it was made of.
        """
        step = value - now
        change = abs(step - (now - before))
        if not self.lower <= value <= self.upper:
            return self._outside(value)
        if abs(step) > self.widest:
            most = self._velocity * self._period
            return tr(
                "{name}: {value:g} is {step:g} away from the last command, {excess:.3g} more than the "
                "{most:g} that a velocity of {velocity:g}/s allows in {period:g} s",
                name=self.name,
                value=value,
                step=abs(step),
                excess=abs(step) - most,
                most=most,
                velocity=self._velocity,
                period=self._period,
            )
        if change > self.wildest:
            most = self.wildest / (1.0 + TOLERANCE)
            rate = most / self._period**2
            return tr(
                "{name}: at {value:g} the step changes by {change:g}, {excess:.3g} more than the "
                "{most:g} that an acceleration of {rate:g}/s^2 allows in {period:g} s",
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
                "{name}: the arm has not caught up: it is still {behind:.3g} away from the last set-point",
                name=self.name,
                behind=abs(behind),
            )
        end, room = (self.upper, self.upper - now) if step > 0.0 else (self.lower, now - self.lower)
        rate, most = abs(step) / self._period, self._fastest(room) / self._period
        return tr(
            "{name}: at {value:g} with {rate:g}/s it could not be braked before the end of its "
            "range, {end:g}: {excess:.3g} more than the {most:g}/s that are possible here",
            name=self.name,
            value=value,
            rate=rate,
            end=end,
            excess=rate - most,
            most=most,
        )

    def _outside(self, value: float) -> str:
        beyond = abs(value - self.inside(value))
        return tr(
            "{name}: {value:g} is {beyond:.3g} outside its range, {lower:g} to {upper:g}",
            name=self.name,
            value=value,
            beyond=beyond,
            lower=self.lower,
            upper=self.upper,
        )

    def _fastest(self, room: float) -> float:
        return math.inf if room >= self.free else fastest(room, self.change)


def fastest(room: float, change: float) -> float:
    """Return the largest step from which there can be rest within the room in front of it.

    A step of up to (n + 1) changes is followed by n others before rest, each a change smaller.

    Args:
        room: deg or mm.
        change: by which a step can be smaller than the one before.
    """
    if room <= 0.0:
        return 0.0
    n = max(math.ceil(0.5 * math.sqrt(1.0 + 8.0 * room / change) - 1.5), 0)
    return room / (n + 1) + 0.5 * n * change


def bearable(velocity: float, acceleration: float, most: float, jerk: float) -> float:
    """Return the acceleration nearest to one that a velocity can have: it leads neither beyond a limit nor backwards.

    Args:
        velocity: from 0 to ``most``.
        acceleration: below 0 it brakes.
        most: largest velocity.
        jerk: with which the acceleration ends.
    """
    least = -math.sqrt(2.0 * jerk * velocity)
    return min(max(acceleration, least), math.sqrt(2.0 * jerk * (most - velocity)))
