"""Limiter of the position of the tool tip, or of the orientation of the tool: keeps a stream of poses within limits.

A step is the difference of two consecutive commands as a vector. For the tip it is in mm. For the orientation it is the
axis of the rotation in the base frame times the angle in degrees. The limits apply to the length of a step, and to the
length of the difference of two steps. They are the same in every direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

from orinkit.arms.geometry import DEGREE, Vector, cross, dot, minus, norm, plus, times
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.planning.axis_limiter import (
    FINEST,
    JUMPS,
    PUSHED,
    ROUNDING,
    SLIGHT,
    TOLERANCE,
    clamp_acceleration,
    fastest,
)
from orinkit.streaming.planning.jerk_limited import PART, SLOWEST, SNAP, JerkLimitedMotion, catch_up_jerk

Basis: TypeAlias = tuple[Vector, Vector, Vector]
"""Three orthogonal unit vectors."""

NOTHING: Final[Vector] = (0.0, 0.0, 0.0)
"""The zero vector."""

_EQUAL_SHARE: Final = 1.0 / math.sqrt(3.0)  # share of the limits for each of three equal axes
_MIN_SHARE: Final = 0.05  # share of the limits for each of the two axes perpendicular to a straight path
_LATERAL_TOLERANCE: Final = 1e-3  # fraction of the limits up to which a lateral motion is neglected
_LATERAL_SHARE: Final = (
    1.2  # share of the limits for stopping a lateral motion, as a multiple of its acceleration divided by the limit
)
_FAR: Final = 1000.0  # s; a motion is planned for at most the distance that full speed covers in this time
_TINY: Final = 1e-100  # the inverse of a smaller length could overflow


class _Frame(NamedTuple):
    """The axes in which a motion is planned, and the fraction of the limits that each axis may use."""

    basis: Basis
    shares: Vector


_FIXED_FRAME: Final = _Frame(
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (_EQUAL_SHARE, _EQUAL_SHARE, _EQUAL_SHARE)
)


class TargetMotion3D(NamedTuple):
    """The estimated motion of the set-points in space.

    The attributes are those of :class:`~orinkit.streaming.planning.axis_limiter.TargetMotion`; velocity and
    acceleration are vectors.
    """

    velocity: Vector = NOTHING
    acceleration: Vector = NOTHING
    jump_count: int = 0


class CartesianLimiter:
    """Keeps the position or the orientation of the commanded pose within limits.

    Args:
        name: Name of the limited quantity in English; messages contain its translation.
        unit: Unit of a step, which is the difference of two consecutive commands.
        speed: Largest velocity, per second.
        acceleration: Largest acceleration, per second squared.
        jerk: Jerk of planned motions, per second cubed.
        period: Period, s.
        spacing: Rounding error of a step, in its unit. It results from the spacing of floating-point numbers as large
            as the coordinates or angles from which the step is computed.
        turning: True if the orientation is limited, False if the position is limited.

    Attributes:
        step: The last step.
        near: The command counts as having caught up if it is at most this far from the last set-point.

    Raises:
        InvalidValue: If the period is so short that the largest step would be lost in rounding.
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
        self._max_step = most * (1.0 + TOLERANCE)
        self._max_step_change = change * (1.0 + TOLERANCE)
        self._own_max_step = most - ROUNDING * spacing
        self._own_max_change = change - ROUNDING * spacing
        self._speed = speed * PART
        self._acceleration = acceleration * PART
        self._jerk = jerk
        self._bend = 0.5 / DEGREE if turning else 0.0
        self.near = min(jerk * period**3, 0.5 * self._own_max_change)
        self.step = self._before = NOTHING
        self._velocity = self._accel = NOTHING  # velocity and acceleration at the last step
        self._state_known = True
        self._last_target_step = NOTHING  # last step of the set-points
        self._target_motion: TargetMotion3D | None = None  # motion of the set-points, while catching up
        self._frame = _FIXED_FRAME
        self._halting = False  # True if the frame is the one for a stop
        self._towards = JerkLimitedMotion(3, period)
        self._to_rest = JerkLimitedMotion(3, period, halting=True)

    @property
    def at_rest(self) -> bool:
        """True if the position or the orientation is at standstill."""
        return self.step == self._velocity == self._accel == NOTHING

    def fits(self, step: Vector) -> bool:
        """Return True if the limits allow a step to follow the last step."""
        return norm(step) <= self._max_step and norm(minus(step, self.step)) <= self._max_step_change

    def keep(self, step: Vector, moved: Vector) -> None:
        """Store, as the last step, a step that ends exactly at a set-point of the program.

        Args:
            step: A step that :meth:`fits` accepts.
            moved: Difference of the last two set-points.
        """
        self._before, self.step = self.step, step
        self._state_known = False
        self._last_target_step, self._target_motion = moved, None

    def forget(self) -> None:
        """Discard the last step of the set-points and the estimate of their motion."""
        self._last_target_step, self._target_motion = NOTHING, None

    def chase(self, way: Vector, moved: Vector) -> tuple[Vector, bool]:
        """Return the next step towards moving set-points, and True if this step reaches the last set-point.

        Args:
            way: Vector from the last command to the last set-point.
            moved: Difference of the last two set-points.
        """
        target_motion = self._estimate_target_motion(moved)
        self._last_target_step, self._target_motion = moved, target_motion
        return self.towards(way, target_motion, anew=True)

    def towards(self, way: Vector, target_motion: TargetMotion3D | None = None, *, anew: bool) -> tuple[Vector, bool]:
        """Return the next step of a smooth motion to a goal, and True if this step reaches the goal.

        Args:
            way: Vector to the goal.
            target_motion: Motion of the goal; ``None`` if the goal does not move.
            anew: True if the last step had another goal.
        """
        self._estimate_state()
        target_motion = target_motion or TargetMotion3D()
        period = self._period
        drift = times(plus(target_motion.velocity, times(target_motion.acceleration, 0.5 * period)), period)
        left = _clip_norm(minus(way, drift), _FAR * self._speed)
        velocity, accel = minus(self._velocity, target_motion.velocity), minus(self._accel, target_motion.acceleration)
        pushed = norm(target_motion.acceleration)
        speed = max(self._speed - norm(target_motion.velocity), SLOWEST * self._speed)
        acceleration = self._acceleration - pushed
        if anew or self._halting:
            self._frame = _frame_to_goal(left, times(velocity, 1.0 / speed), times(accel, 1.0 / acceleration))
            self._halting = False
        basis = self._frame.basis
        smooth = self._towards
        self._limit(smooth, speed, acceleration, catch_up_jerk(self._jerk, pushed / self._acceleration))
        smooth.aim(list(_into(basis, left)))
        ended = smooth.step(NOTHING, _into(basis, velocity), _into(basis, accel))
        if ended is None:
            size = norm(way)
            wanted = times(way, min(fastest(size, self._own_max_change) / size, 1.0) if size else 0.0)
        else:
            wanted = way if ended else plus(drift, _out_of(basis, smooth.position))
        gained = plus(target_motion.velocity, times(target_motion.acceleration, period))
        step = self._advance(
            wanted,
            plus(gained, _out_of(basis, smooth.velocity)),
            plus(target_motion.acceleration, _out_of(basis, smooth.acceleration)),
            planned=ended is not None,
        )
        return step, step == way

    def halt(self) -> Vector:
        """Return the next step of a stop."""
        self._estimate_state()
        if self._velocity == self._accel == NOTHING:
            return self._advance(NOTHING, NOTHING, NOTHING, planned=True)
        if not self._halting:
            self._frame = _frame_for_stop(self._velocity, times(self._accel, 1.0 / self._acceleration))
            self._halting = True
        basis = self._frame.basis
        smooth = self._to_rest
        self._limit(smooth, self._speed, self._acceleration, self._jerk)
        ended = smooth.step(NOTHING, _into(basis, self._velocity), _into(basis, self._accel))
        wanted = NOTHING if ended is None else _out_of(basis, smooth.position)
        if ended:
            return self._advance(wanted, NOTHING, NOTHING, planned=True)
        after = _out_of(basis, smooth.velocity), _out_of(basis, smooth.acceleration)
        return self._advance(wanted, *after, planned=ended is not None)

    def complaint(self, step: Vector, behind: float) -> str:
        """Return the message for a step that the limits do not allow to follow the last step.

        Args:
            step: The rejected step.
            behind: Distance from the last command to the last set-point.
        """
        what, unit = tr(self._name), self._unit
        speed, acceleration = self._limits
        size, change = norm(step), norm(minus(step, self.step))
        if size > self._max_step:
            most = speed * self._period
            return tr(
                "{what}: the step of {size:g} {unit} is {excess:.3g} {unit} too large: the velocity limit of "
                "{speed:g} {unit}/s allows {most:g} {unit} in {period:g} s",
                what=what,
                size=size,
                unit=unit,
                excess=size - most,
                most=most,
                speed=speed,
                period=self._period,
            )
        if change > self._max_step_change:
            most = acceleration * self._period**2
            return tr(
                "{what}: the step differs from the last step by {change:g} {unit}, which is {excess:.3g} {unit} "
                "too much: the acceleration limit of {acceleration:g} {unit}/s^2 allows {most:g} {unit} in "
                "{period:g} s",
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

    def _estimate_target_motion(self, moved: Vector) -> TargetMotion3D:
        period = self._period
        change = minus(moved, self._last_target_step)
        if norm(change) > self._max_step_change or norm(moved) > self._max_step:
            held = self._target_motion or TargetMotion3D(self._velocity_of(self._last_target_step))
            if held.jump_count < JUMPS:
                return TargetMotion3D(held.velocity, NOTHING, held.jump_count + 1)
            return TargetMotion3D(self._velocity_of(moved), NOTHING, held.jump_count)
        acceleration = _clip_norm(times(change, period**-2), PUSHED * self._acceleration)
        return TargetMotion3D(minus(times(moved, 1.0 / period), times(acceleration, 0.5 * period)), acceleration)

    def _velocity_of(self, moved: Vector) -> Vector:
        return times(moved, 1.0 / self._period) if norm(moved) <= self._max_step else NOTHING

    def _limit(self, smooth: JerkLimitedMotion, speed: float, acceleration: float, jerk: float) -> None:
        shares = self._frame.shares
        speeds, accelerations = times(shares, speed), times(shares, acceleration)
        smooth.limit(speeds, speeds, accelerations, accelerations, times(shares, jerk))

    def _advance(self, wanted: Vector, velocity: Vector, accel: Vector, *, planned: bool) -> Vector:
        """Make the admissible step nearest to the desired one, and return it.

        ``velocity`` and ``accel`` are the state after the desired step. If that step was not ``planned``, this state is
        not known, and is estimated when it is next required.
        """
        step = self._clip(wanted)
        self._before, self.step = self.step, step
        self._state_known = planned and norm(minus(step, wanted)) <= SLIGHT * self._own_max_change
        bend = times(cross(step, velocity), self._bend)  # converts the angular velocity to the new orientation
        self._velocity, self._accel = plus(velocity, bend), accel
        return step

    def _clip(self, wanted: Vector) -> Vector:
        """Return the admissible step closest to the desired one, on the line from the last step to the desired one."""
        wanted = _clip_norm(wanted, self._own_max_step)
        change = minus(wanted, self.step)
        return (
            wanted
            if norm(change) <= self._own_max_change
            else plus(self.step, _clip_norm(change, self._own_max_change))
        )

    def _estimate_state(self) -> None:
        """Estimate the current velocity and acceleration from the last two steps, unless the last step was planned."""
        if self._state_known:
            return
        self._state_known = True
        size, period = norm(self.step), self._period
        if size <= _TINY:  # standstill, regardless of the previous deceleration
            self._velocity = self._accel = NOTHING
            return
        way = times(self.step, 1.0 / size)
        speed = min(size / period, self._speed)
        accel = _clip_norm(times(minus(self.step, self._before), period**-2), self._acceleration)
        along = dot(accel, way)
        aside = minus(accel, times(way, along))
        along = clamp_acceleration(speed, along, self._speed, self._jerk)
        speed = min(max(speed + 0.5 * along * period, 0.0), self._speed)
        along = clamp_acceleration(speed, along, self._speed, self._jerk)
        self._velocity = plus(times(way, speed), times(aside, 0.5 * period))
        self._accel = plus(times(way, along), aside)


def _frame_to_goal(way: Vector, velocity: Vector, accel: Vector) -> _Frame:
    """Return the frame for planning a motion to a goal.

    A motion from standstill, or one that already moves towards the goal, is planned on a straight line, nearly as fast
    as the limits allow. Otherwise the frame is fixed: in a frame that turns with the direction to the goal, a motion
    could circle its goal forever.

    Args:
        way: Vector to the goal.
        velocity: Velocity as a fraction of the limit.
        accel: Acceleration as a fraction of the limit.
    """
    if norm(way) > SNAP:
        basis = _basis(way)
        v, a = _into(basis, velocity), _into(basis, accel)
        if max(abs(v[1]), abs(v[2]), abs(a[1]), abs(a[2])) <= _LATERAL_TOLERANCE:
            return _Frame(basis, _shares(0.0))
    return _FIXED_FRAME


def _frame_for_stop(velocity: Vector, accel: Vector) -> _Frame:
    """Return the frame for planning a stop.

    Args:
        velocity: Velocity of the motion.
        accel: Acceleration of the motion as a fraction of the limit.
    """
    if norm(velocity) <= _TINY:
        return _FIXED_FRAME
    basis = _basis(velocity)
    _, y, z = _into(basis, accel)
    return _Frame(basis, _shares(_LATERAL_SHARE * math.hypot(y, z)))


def _shares(across: float) -> Vector:
    """Return the fraction of the limits that each of three axes may use.

    The vector sum of three axes that use these fractions never exceeds the limits. ``across`` is the fraction that the
    second axis and the third axis each require.
    """
    across = min(max(across, _MIN_SHARE), _EQUAL_SHARE)
    return math.sqrt(1.0 - 2.0 * across * across), across, across


def _basis(first: Vector) -> Basis:
    """Return three orthogonal unit vectors; the first one has the direction of ``first``."""
    x = times(first, 1.0 / norm(first))
    least = min(range(3), key=lambda axis: abs(x[axis]))
    y = cross(x, (float(least == 0), float(least == 1), float(least == 2)))
    y = times(y, 1.0 / norm(y))
    return x, y, cross(x, y)


def _into(basis: Basis, vector: Vector) -> Vector:
    return dot(basis[0], vector), dot(basis[1], vector), dot(basis[2], vector)


def _out_of(basis: Basis, parts: Sequence[float]) -> Vector:
    (a, b, c), (d, e, f), (g, h, i) = basis
    x, y, z = parts
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _clip_norm(a: Vector, most: float) -> Vector:
    size = norm(a)
    return a if size <= most else times(a, most / size)
