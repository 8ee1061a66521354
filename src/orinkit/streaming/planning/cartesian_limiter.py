"""Limiter of the tip of a tool, or of its orientation: keeps a stream of poses within limits.

A step is the difference of two commands: mm, or the rotation between two orientations as its axis in the base frame
times its angle in degrees. The lengths of the step and of its change are limited, independently of the direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.planning.axis_limiter import (
    FINEST,
    JUMPS,
    PUSHED,
    ROUNDING,
    SLIGHT,
    TOLERANCE,
    bearable,
    fastest,
)
from orinkit.streaming.planning.jerk_limited import PART, SLOWEST, SNAP, JerkLimitedMotion, keeping_up
from orinkit.streaming.planning.quaternions import DEGREE, Vector

Basis: TypeAlias = tuple[Vector, Vector, Vector]
"""Three orthogonal unit vectors."""

NOTHING: Final[Vector] = (0.0, 0.0, 0.0)
"""The zero vector."""

_ALIKE: Final = 1.0 / math.sqrt(3.0)  # share of the limits for each of three equal axes
_LEAST: Final = 0.05  # the same for the axes perpendicular to a straight path
_STRAIGHT: Final = 1e-3  # fraction of the limits up to which a lateral motion is neglected
_ASIDE: Final = 1.2  # share of the limits for stopping a lateral motion, as a multiple of the fraction that it has
_FAR: Final = 1000.0  # s at full speed: a longer distance need not be planned
_TINY: Final = 1e-100  # so small that its inverse could overflow


class _Frame(NamedTuple):
    """The axes in which a motion is planned, and the share of the limits that each of them has."""

    basis: Basis
    shares: Vector


_EVERY_WAY: Final = _Frame(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (_ALIKE, _ALIKE, _ALIKE))


class TargetMotion3D(NamedTuple):
    """The motion of set-points in space, like :class:`~orinkit.streaming.planning.axis_limiter.TargetMotion` of one axis."""

    velocity: Vector = NOTHING
    acceleration: Vector = NOTHING
    jumps: int = 0


class CartesianLimiter:
    """Keeps the position or the orientation of the commanded pose within limits.

    Args:
        name: Name of the quantity for messages, which translate it.
        unit: Unit of a step.
        speed: Largest velocity, per second.
        acceleration: Largest acceleration, per second squared.
        jerk: Jerk of planned motions, per second cubed.
        period: Period, s.
        spacing: Spacing of the floating-point numbers from which steps are computed.
        turning: True for the orientation.

    Attributes:
        step: The last step.
        near: Distance to the last set-point within which the command has caught up.

    Raises:
        InvalidValue: If the period is so short that a limit would be lost in rounding.
        MissingExtra: If ruckig is not installed.
    """

    def __init__(
        self,
        name: str,
        unit: str,
        speed: float,
        acceleration: float,
        jerk: float,
        period: float,
        spacing: float,
        *,
        turning: bool = False,
    ) -> None:
        change, most = acceleration * period * period, speed * period
        if not FINEST * spacing < min(change, most) <= max(change, most) < math.inf:
            raise InvalidValue(
                tr(
                    "{what}: the period of {period:g} s is too short for limits of {speed:g} {unit}/s and "
                    "{acceleration:g} {unit}/s^2: they would be lost in rounding",
                    what=tr(name),
                    period=period,
                    speed=speed,
                    unit=unit,
                    acceleration=acceleration,
                )
            )
        self._name, self._unit = name, unit
        self._period = period
        self._limits = speed, acceleration
        self._widest = most * (1.0 + TOLERANCE)
        self._wildest = change * (1.0 + TOLERANCE)
        self._most = most - ROUNDING * spacing
        self._change = change - ROUNDING * spacing
        self._speed = speed * PART
        self._acceleration = acceleration * PART
        self._jerk = jerk
        self._bend = 0.5 / DEGREE if turning else 0.0
        self.near = min(jerk * period**3, 0.5 * self._change)
        self.step = self._before = NOTHING
        self._velocity = self._push = NOTHING  # velocity and acceleration at the last step
        self._known = True
        self._moved = NOTHING  # last step of the set-points
        self._course: TargetMotion3D | None = None  # motion of the set-points, while catching up
        self._frame = _EVERY_WAY
        self._halting = False  # True if the frame is that of a stop
        self._towards = JerkLimitedMotion(3, period)
        self._to_rest = JerkLimitedMotion(3, period, halting=True)

    @property
    def rests(self) -> bool:
        """True at standstill."""
        return self.step == self._velocity == self._push == NOTHING

    def fits(self, step: Vector) -> bool:
        """Return True if a step may follow the last one."""
        return _size(step) <= self._widest and _size(_minus(step, self.step)) <= self._wildest

    def keep(self, step: Vector, moved: Vector) -> None:
        """Take over a step of the program's own set-points.

        Args:
            step: A step that :meth:`fits`.
            moved: Step of the set-points.
        """
        self._before, self.step = self.step, step
        self._known = False
        self._moved, self._course = moved, None

    def forget(self) -> None:
        """Discard the motion of the set-points."""
        self._moved, self._course = NOTHING, None

    def chase(self, way: Vector, moved: Vector) -> tuple[Vector, bool]:
        """Return the next step towards moving set-points, and True if it reaches the last one.

        Args:
            way: Vector to the last set-point.
            moved: Step of the set-points.
        """
        course = self._course_of(moved)
        self._moved, self._course = moved, course
        return self.towards(way, course, anew=True)

    def towards(self, way: Vector, course: TargetMotion3D | None = None, *, anew: bool) -> tuple[Vector, bool]:
        """Return the next step of a smooth motion to a goal, and True if it reaches the goal.

        Args:
            way: Vector to the goal.
            course: Motion of the goal.
            anew: True if the goal differs from that of the last step.
        """
        self._know()
        course = course or TargetMotion3D()
        period = self._period
        drift = _times(_plus(course.velocity, _times(course.acceleration, 0.5 * period)), period)
        left = _shortened(_minus(way, drift), _FAR * self._speed)
        velocity, push = _minus(self._velocity, course.velocity), _minus(self._push, course.acceleration)
        pushed = _size(course.acceleration)
        speed = max(self._speed - _size(course.velocity), SLOWEST * self._speed)
        acceleration = self._acceleration - pushed
        if anew or self._halting:
            self._frame = _frame_towards(left, _times(velocity, 1.0 / speed), _times(push, 1.0 / acceleration))
            self._halting = False
        basis = self._frame.basis
        smooth = self._towards
        self._limit(smooth, speed, acceleration, keeping_up(self._jerk, pushed / self._acceleration))
        smooth.aim(list(_into(basis, left)))
        ended = smooth.step(NOTHING, _into(basis, velocity), _into(basis, push))
        if ended is None:
            size = _size(way)
            wanted = _times(way, min(fastest(size, self._change) / size, 1.0) if size else 0.0)
        else:
            wanted = way if ended else _plus(drift, _out_of(basis, smooth.position))
        gained = _plus(course.velocity, _times(course.acceleration, period))
        step = self._advance(
            wanted,
            _plus(gained, _out_of(basis, smooth.velocity)),
            _plus(course.acceleration, _out_of(basis, smooth.acceleration)),
            planned=ended is not None,
        )
        return step, step == way

    def halt(self) -> Vector:
        """Return the next step of a stop."""
        self._know()
        if self._velocity == self._push == NOTHING:
            return self._advance(NOTHING, NOTHING, NOTHING, planned=True)
        if not self._halting:
            self._frame = _frame_along(self._velocity, _times(self._push, 1.0 / self._acceleration))
            self._halting = True
        basis = self._frame.basis
        smooth = self._to_rest
        self._limit(smooth, self._speed, self._acceleration, self._jerk)
        ended = smooth.step(NOTHING, _into(basis, self._velocity), _into(basis, self._push))
        wanted = NOTHING if ended is None else _out_of(basis, smooth.position)
        if ended:
            return self._advance(wanted, NOTHING, NOTHING, planned=True)
        after = _out_of(basis, smooth.velocity), _out_of(basis, smooth.acceleration)
        return self._advance(wanted, *after, planned=ended is not None)

    def complaint(self, step: Vector, behind: float) -> str:
        """Return the message for a step that may not follow the last one.

        Args:
            step: The rejected step.
            behind: Distance from the last command to the set-point it was planned for.
        """
        what, unit = tr(self._name), self._unit
        speed, acceleration = self._limits
        size, change = _size(step), _size(_minus(step, self.step))
        if size > self._widest:
            most = speed * self._period
            return tr(
                "{what}: the step of {size:g} {unit} exceeds by {excess:.3g} the {most:g} that the "
                "velocity limit of {speed:g} {unit}/s allows in {period:g} s",
                what=what,
                size=size,
                unit=unit,
                excess=size - most,
                most=most,
                speed=speed,
                period=self._period,
            )
        if change > self._wildest:
            most = acceleration * self._period**2
            return tr(
                "{what}: the step changes by {change:g} {unit}, which exceeds by {excess:.3g} the {most:g} that "
                "the acceleration limit of {acceleration:g} {unit}/s^2 allows in {period:g} s",
                what=what,
                change=change,
                unit=unit,
                excess=change - most,
                most=most,
                acceleration=acceleration,
                period=self._period,
            )
        return tr(
            "{what}: the arm lags behind: it is still {behind:.3g} {unit} from the last set-point",
            what=what,
            behind=behind,
            unit=unit,
        )

    def _course_of(self, moved: Vector) -> TargetMotion3D:
        period = self._period
        change = _minus(moved, self._moved)
        if _size(change) > self._wildest or _size(moved) > self._widest:
            held = self._course or TargetMotion3D(self._pace(self._moved))
            if held.jumps < JUMPS:
                return TargetMotion3D(held.velocity, NOTHING, held.jumps + 1)
            return TargetMotion3D(self._pace(moved), NOTHING, held.jumps)
        acceleration = _shortened(_times(change, period**-2), PUSHED * self._acceleration)
        return TargetMotion3D(_minus(_times(moved, 1.0 / period), _times(acceleration, 0.5 * period)), acceleration)

    def _pace(self, moved: Vector) -> Vector:
        return _times(moved, 1.0 / self._period) if _size(moved) <= self._widest else NOTHING

    def _limit(self, smooth: JerkLimitedMotion, speed: float, acceleration: float, jerk: float) -> None:
        shares = self._frame.shares
        speeds, accelerations = _times(shares, speed), _times(shares, acceleration)
        smooth.limit(speeds, speeds, accelerations, accelerations, _times(shares, jerk))

    def _advance(self, wanted: Vector, velocity: Vector, push: Vector, *, planned: bool) -> Vector:
        """Take the admissible step nearest to the desired one, which has these derivatives if it was ``planned``."""
        step = self._within(wanted)
        self._before, self.step = self.step, step
        self._known = planned and _size(_minus(step, wanted)) <= SLIGHT * self._change
        bend = _times(_cross(step, velocity), self._bend)  # the rotation velocity seen from the new orientation
        self._velocity, self._push = _plus(velocity, bend), push
        return step

    def _within(self, wanted: Vector) -> Vector:
        """Clip the desired step to the admissible step closest to it along the line from the previous step."""
        wanted = _shortened(wanted, self._most)
        change = _minus(wanted, self.step)
        return wanted if _size(change) <= self._change else _plus(self.step, _shortened(change, self._change))

    def _know(self) -> None:
        """Estimate velocity and acceleration if the last step was not planned."""
        if self._known:
            return
        self._known = True
        size, period = _size(self.step), self._period
        if size <= _TINY:  # at standstill, regardless of the deceleration before
            self._velocity = self._push = NOTHING
            return
        way = _times(self.step, 1.0 / size)
        speed = min(size / period, self._speed)
        push = _shortened(_times(_minus(self.step, self._before), period**-2), self._acceleration)
        along = _dot(push, way)
        aside = _minus(push, _times(way, along))
        along = bearable(speed, along, self._speed, self._jerk)
        speed = min(max(speed + 0.5 * along * period, 0.0), self._speed)
        along = bearable(speed, along, self._speed, self._jerk)
        self._velocity = _plus(_times(way, speed), _times(aside, 0.5 * period))
        self._push = _plus(_times(way, along), aside)


def _frame_towards(way: Vector, velocity: Vector, push: Vector) -> _Frame:
    """Return the frame for planning a motion to a goal.

    A motion from standstill, or one that already moves towards the goal, is planned on a straight line, nearly as fast
    as the limits allow. Otherwise the frame is fixed: in a frame that turns with the direction to the goal, a motion
    could circle its goal forever.

    Args:
        way: Vector to the goal.
        velocity: Velocity as a fraction of the limit.
        push: Acceleration as a fraction of the limit.
    """
    if _size(way) > SNAP:
        basis = _basis(way)
        v, a = _into(basis, velocity), _into(basis, push)
        if max(abs(v[1]), abs(v[2]), abs(a[1]), abs(a[2])) <= _STRAIGHT:
            return _Frame(basis, _shares(0.0))
    return _EVERY_WAY


def _frame_along(velocity: Vector, push: Vector) -> _Frame:
    """Return the frame for planning a stop.

    Args:
        velocity: Velocity of the motion.
        push: Acceleration of the motion as a fraction of the limit.
    """
    if _size(velocity) <= _TINY:
        return _EVERY_WAY
    basis = _basis(velocity)
    _, y, z = _into(basis, push)
    return _Frame(basis, _shares(_ASIDE * math.hypot(y, z)))


def _shares(across: float) -> Vector:
    """Return the shares of three axes in the limits; their vector sum never exceeds the limit."""
    across = min(max(across, _LEAST), _ALIKE)
    return math.sqrt(1.0 - 2.0 * across * across), across, across


def _basis(first: Vector) -> Basis:
    """Return three orthogonal unit vectors, the first one along a vector."""
    x = _times(first, 1.0 / _size(first))
    least = min(range(3), key=lambda axis: abs(x[axis]))
    y = _cross(x, (float(least == 0), float(least == 1), float(least == 2)))
    y = _times(y, 1.0 / _size(y))
    return x, y, _cross(x, y)


def _into(basis: Basis, vector: Vector) -> Vector:
    return _dot(basis[0], vector), _dot(basis[1], vector), _dot(basis[2], vector)


def _out_of(basis: Basis, parts: Sequence[float]) -> Vector:
    (a, b, c), (d, e, f), (g, h, i) = basis
    x, y, z = parts
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _times(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _size(a: Vector) -> float:
    return math.hypot(a[0], a[1], a[2])


def _shortened(a: Vector, most: float) -> Vector:
    size = _size(a)
    return a if size <= most else _times(a, most / size)
