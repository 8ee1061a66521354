"""Planner of a stream of joint positions, whose commands never violate the limits that the controller checks (RC8 4).

The controller stops an arm in three cases: the step from one set-point to the next exceeds the velocity limit; the
difference of two consecutive steps exceeds the acceleration limit; or an axis leaves its range. The commands of a
:class:`JointPlanner` never cause such a stop, regardless of its input.

Ruckig plans smooth (jerk-limited) motions. A limiter of each axis,
:class:`orinkit.streaming.planning.axis_limiter.AxisLimiter`, then corrects the next step. It ensures that the step is
within the limits of velocity and acceleration, and that the axis can still brake before the end of its range. Such a
step always exists, because the axis can continue to brake.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import check_finite, check_positive
from orinkit.streaming.planning.axis_limiter import AxisLimiter, AxisState, TargetMotion
from orinkit.streaming.planning.jerk_limited import SLOWEST, SNAP, JerkLimitedMotion, catch_up_jerk
from orinkit.streaming.planning.limits import Limits

_SURELY_FINITE: Final = 1e300
_NOTHING: Final = AxisState(0.0, 0.0, 0.0)
_FLOATS: Final = {float}


class JointPlanner:
    """Computes the commands of a stream of joint positions, one per period; the arm is initially at standstill.

    A command is the joint position that is sent to the controller.

    :meth:`goto`, :meth:`track` and :meth:`stop` each return the next command; they may be called in any order. For any
    input, consecutive commands c[k] satisfy these conditions, with a relative tolerance of 10^-9::

        lower <= c[k] <= upper
        |c[k] - c[k-1]| <= velocity * period
        |c[k] - 2 c[k-1] + c[k-2]| <= acceleration * period^2

    Args:
        limits: Limits of the arm.
        period: Time between two commands, s.
        joints: Joint position at which the arm stands, deg (mm for linear axes), one value per axis. If an axis is
            outside its range but can return within one period, it is treated as if it were at the end of its range.

    Attributes:
        command: The last command, deg (mm for linear axes), one value per axis.
        at_rest: True if the last two commands are equal, and the target or set-point is reached.

    Raises:
        InvalidValue: If the period is not a positive finite number, or so short that the largest step would be lost in
            rounding; or if the arm is outside its range.
        MissingExtra: If ruckig is not installed.
    """

    def __init__(self, limits: Limits, period: float, joints: Sequence[float]) -> None:
        self._period = checked_period(period)
        rows = zip(limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.jerk, strict=True)
        self._axes = [AxisLimiter(f"J{number}", *row, self._period) for number, row in enumerate(rows, start=1)]
        start = self._numbers(joints)
        self.command: tuple[float, ...] = tuple(
            axis.start_position(joint) for axis, joint in zip(self._axes, start, strict=True)
        )
        self.at_rest = True
        self._before = self._earlier = self.command  # the commands before the last one
        self._velocity = [0.0] * len(start)  # velocity at the last command
        self._acceleration = [0.0] * len(start)
        self._state_known = True  # True if _velocity and _acceleration are up to date
        self._halting = False  # True if stop() made the last command
        # State of track(): the last two set-points, each clipped to the range; the distance from the command to the
        # last set-point, None if it is reached; the motion of the set-points, None if the last set-point is reached.
        self._last_points: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._behind: list[float] | None = None
        self._target_motions: list[TargetMotion] | None = None
        self._make_smooth()

    def goto(self, target: Sequence[float]) -> tuple[float, ...]:
        """Return the next command of a smooth motion to a target, which may change with each call.

        All axes arrive together; from standstill they move on a straight line in joint space.

        Args:
            target: Target, deg (mm), one value per axis; clipped to the range.

        Raises:
            InvalidValue: If the number of values is wrong, or a value is not finite.
        """
        goal = self._clip_to_range(self._numbers(target))
        self._last_points = self._behind = self._target_motions = None
        self._halting = False
        if self.at_rest and goal == self.command:
            return self._advance(goal)
        self._estimate_state()
        smooth = self._towards
        smooth.aim(list(goal))
        ended = smooth.step(list(self.command), self._velocity, self._acceleration)
        if ended is None:
            self._send_without_jerk_limit(goal)
        elif ended:
            reached = [aim if abs(aim - x) <= SNAP else x for aim, x in zip(goal, smooth.position, strict=True)]
            self._send(reached, self._zeros(), self._zeros())
        else:
            self._send(smooth.position, smooth.velocity, smooth.acceleration)
        self.at_rest = self.command == self._before == goal
        return self.command

    def track(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return the next command for a set-point of the program: the set-point itself, if it passes :meth:`check`.

        Otherwise each axis that cannot reach the set-point approaches it smoothly, until the axis has caught up with
        the set-points.

        Args:
            point: Set-point, deg (mm), one value per axis.

        Raises:
            InvalidValue: If the number of values is wrong, or a value is not finite.
        """
        values = self._numbers(point)
        self._halting = False
        rows = zip(self._axes, self._before, self.command, values, strict=True)
        if self._behind is None:
            fits = [axis.fits(before, now, value) for axis, before, now, value in rows]
        else:
            fits = [
                abs(behind) <= axis.near and axis.fits(before, now, value)
                for (axis, before, now, value), behind in zip(rows, self._behind, strict=True)
            ]
        if all(fits):
            self._behind = self._target_motions = None
            self._last_points = (self._last_points or (values, values))[1], values
            self._state_known = False
            self.at_rest = values == self.command
            return self._advance(values)
        return self._approach(values, fits)

    def stop(self) -> tuple[float, ...]:
        """Return the next command of a stop; at standstill, return the last command.

        The stop is smooth if the range leaves enough distance; otherwise it uses the full acceleration.
        """
        self._last_points = self._behind = self._target_motions = None
        self._estimate_state()
        smooth = self._to_rest
        if not self._halting:
            self._halting = True
            smooth.resynchronize()
        if self._is_standing():
            self._send(list(self.command), self._zeros(), self._zeros())
        else:
            ended = smooth.step(list(self.command), self._velocity, self._acceleration)
            if ended is None:
                self._send_without_jerk_limit(self.command)
            elif ended:
                self._send(smooth.position, self._zeros(), self._zeros())
            else:
                self._send(smooth.position, smooth.velocity, smooth.acceleration)
        self.at_rest = self.command == self._before and self._is_standing()
        return self.command

    def check(self, point: Sequence[float]) -> None:
        """Check that :meth:`track` would return a set-point unchanged. A caller can thus reject other set-points.

        Args:
            point: Set-point, deg (mm), one value per axis.

        Raises:
            InvalidValue: If :meth:`track` would change the set-point; the message contains the axis, the limit and the
                excess.
        """
        values = self._numbers(point)
        for number, (axis, before, now, value) in enumerate(
            zip(self._axes, self._before, self.command, values, strict=True)
        ):
            behind = self._behind[number] if self._behind is not None else 0.0
            if abs(behind) > axis.near or not axis.fits(before, now, value):
                raise InvalidValue(axis.complaint(before, now, value, behind))

    def _approach(self, values: tuple[float, ...], fits: list[bool]) -> tuple[float, ...]:
        """Return the next command if not all axes can reach a set-point.

        The motion is planned relative to the moving set-points, and ends at standstill relative to them. Thus the
        motion can end although the set-points continue to move. If the set-points accelerate, the motion may have more
        jerk, so that it can follow changes of their acceleration.
        """
        self._estimate_state()
        axes, now, period = self._axes, self.command, self._period
        aims = self._clip_to_range(values)
        first, last = self._last_points or (aims, aims)
        held: Sequence[TargetMotion | None] = self._target_motions or [None] * len(axes)
        motions = [
            axis.target_motion(before, at, aim, motion)
            for axis, before, at, aim, motion in zip(axes, first, last, aims, held, strict=True)
        ]
        seen = [
            _NOTHING if fit else motion.relative_state(at - aim, v, a, period)
            for fit, motion, at, aim, v, a in zip(
                fits, motions, now, aims, self._velocity, self._acceleration, strict=True
            )
        ]
        smooth = self._catching_up
        self._limit(smooth, motions)
        ended = smooth.step(*zip(*seen, strict=True))
        if ended is None:
            wanted = [axis.towards(at, aim) for axis, at, aim in zip(axes, now, aims, strict=True)]
        else:
            wanted = [aim + (x if abs(x) > SNAP else 0.0) for aim, x in zip(aims, smooth.position, strict=True)]
        self._send(
            [value if fit else x for fit, value, x in zip(fits, values, wanted, strict=True)],
            [v + c.velocity + c.acceleration * period for v, c in zip(smooth.velocity, motions, strict=True)],
            [a + c.acceleration for a, c in zip(smooth.acceleration, motions, strict=True)],
            exact=fits,
            planned=ended is not None,
        )
        self._last_points, self._target_motions = (last, aims), motions
        behind = [aim - at for aim, at in zip(aims, self.command, strict=True)]
        self._behind = behind if any(behind) else None
        self.at_rest = self.command == self._before == aims
        return self.command

    def _make_smooth(self) -> None:
        axes = self._axes
        count, ranges = len(axes), ([axis.lower for axis in axes], [axis.upper for axis in axes])
        self._towards = JerkLimitedMotion(count, self._period, ranges=ranges)
        self._to_rest = JerkLimitedMotion(count, self._period, ranges=ranges, halting=True)
        self._catching_up = JerkLimitedMotion(count, self._period)
        self._catching_up.aim(self._zeros())
        for smooth in (self._towards, self._to_rest):
            self._limit(smooth, [TargetMotion()] * count)

    def _limit(self, smooth: JerkLimitedMotion, motions: Sequence[TargetMotion]) -> None:
        """Set the limits of a motion that is planned relative to moving set-points."""
        rows = list(zip(self._axes, motions, strict=True))
        smooth.limit(
            [max(axis.velocity - motion.velocity, SLOWEST * axis.velocity) for axis, motion in rows],
            [max(axis.velocity + motion.velocity, SLOWEST * axis.velocity) for axis, motion in rows],
            [axis.acceleration - motion.acceleration for axis, motion in rows],
            [axis.acceleration + motion.acceleration for axis, motion in rows],
            [catch_up_jerk(axis.jerk, abs(motion.acceleration) / axis.acceleration) for axis, motion in rows],
        )

    def _send(
        self,
        wanted: Sequence[float],
        velocity: list[float],
        acceleration: list[float],
        exact: Sequence[bool] = (),
        *,
        planned: bool = True,
    ) -> None:
        """Make the admissible command nearest to the desired one, and store the state of the axes after it.

        ``velocity`` and ``acceleration`` are the state after the desired command. They are replaced by estimates if
        that command was not ``planned``, and for each axis that cannot reach it. ``exact`` is True for each axis that
        reaches its set-point: its position is not changed, and its state is estimated.
        """
        before, now = self._before, self.command
        exact = exact or (False,) * len(now)
        rows = zip(self._axes, before, now, wanted, exact, strict=True)
        command = self._advance(
            tuple(value if fit else axis.within(last, at, value) for axis, last, at, value, fit in rows)
        )
        for number, axis in enumerate(self._axes):
            off_plan = abs(command[number] - wanted[number]) > axis.plan_tolerance
            if off_plan or exact[number] or not planned:
                velocity[number], acceleration[number] = axis.motion(before[number], now[number], command[number])
        self._velocity, self._acceleration, self._state_known = velocity, acceleration, True

    def _send_without_jerk_limit(self, goal: Sequence[float]) -> None:
        """Make a command towards a goal, within all limits except jerk; used if Ruckig returns no command."""
        wanted = [axis.towards(now, aim) for axis, now, aim in zip(self._axes, self.command, goal, strict=True)]
        self._send(wanted, self._zeros(), self._zeros(), planned=False)

    def _advance(self, command: tuple[float, ...]) -> tuple[float, ...]:
        self._earlier, self._before, self.command = self._before, self.command, command
        return command

    def _estimate_state(self) -> None:
        """Estimate the current velocity and acceleration if the last command was a set-point of the program."""
        if not self._state_known:
            rows = zip(self._axes, self._earlier, self._before, self.command, strict=True)
            motions = [axis.motion(*commands) for axis, *commands in rows]
            self._velocity = [velocity for velocity, _ in motions]
            self._acceleration = [acceleration for _, acceleration in motions]
            self._state_known = True

    def _is_standing(self) -> bool:
        return not any(self._velocity) and not any(self._acceleration)

    def _clip_to_range(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(axis.clamp(value) for axis, value in zip(self._axes, values, strict=True))

    def _zeros(self) -> list[float]:
        return [0.0] * len(self._axes)

    def _numbers(self, values: Sequence[float]) -> tuple[float, ...]:
        count = len(self._axes)
        if len(values) != count:
            raise InvalidValue(tr("got {given} values, but the stream has {axes} axes", given=len(values), axes=count))
        if set(map(type, values)) == _FLOATS and -_SURELY_FINITE < sum(values) < _SURELY_FINITE:
            return tuple(values)  # fast path
        return tuple(
            check_finite(axis.name, value, tr("set-point")) for axis, value in zip(self._axes, values, strict=True)
        )


def checked_period(period: float) -> float:
    """Check the period of a stream, s, and return it as a float.

    Raises:
        InvalidValue: If the period is not a positive finite number.
    """
    return check_positive("period", period, tr("stream"))
