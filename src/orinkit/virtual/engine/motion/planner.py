"""Planning of motions to a target, as fast as the limits of the arm model and the :class:`Rates` allow.

The velocity of each joint stays within its limit times ``speed``, and its acceleration within its limit times the
greater of ``accel`` and ``decel``; these three are the rates. On a Cartesian path, the velocity of the TCP also stays
within the model's path speed times ``speed``. If a joint would exceed a limit, the motion is slowed down as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from orinkit.arms import ArmModel, AxisModel
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.poses import PassMark
from orinkit.virtual.engine.motion import cartesian_path as courses
from orinkit.virtual.engine.motion.cartesian_path import CartesianPath
from orinkit.virtual.engine.motion.joint_path import MAX_STEPS, JointPath, Joints, Path, singular, table_path
from orinkit.virtual.engine.motion.profile import Array, MotionProfile
from orinkit.virtual.engine.motion.soft_limits import check_end, check_way

LONGEST: Final = 36_000.0
"""Longest duration of a motion in seconds."""

AT_TARGET: Final = PassMark("0")

_MARGIN: Final = 1.01  # additional factor for a motion that is slowed down, because of peaks between the samples
# A path is too near to a singular point if its motion is slowed down by more than this factor and takes longer than
# this time (s).
_SINGULAR_STRETCH: Final = 20.0
_SINGULAR_TIME: Final = 2.0
_STILL: Final = 1e-9  # deg or mm; a shorter distance counts as zero
_SAMPLES: Final = 1024  # of a motion, for the velocities of its joints and its distance from the end


@record
class Rates:
    """Velocity and acceleration of a motion, as fractions of the limits of the arm model.

    Attributes:
        speed: Fraction of the velocity limits, above 0 and at most 1.
        accel: Fraction of the acceleration limits, above 0 and at most 1.
        decel: Fraction of the deceleration limits, above 0 and at most 1.
        time: Duration of the motion in seconds; ``None`` for as fast as the other rates allow. A time that is too short
            is not an error: the motion is then as fast as possible.
        avoid_singular: True to slow a path down near a singular point as much as necessary; False to refuse a path that
            would have to be slowed down too much.

    Raises:
        ValueError: If a value is out of range.
    """

    speed: float = 1.0
    accel: float = 1.0
    decel: float = 1.0
    time: float | None = None
    avoid_singular: bool = False

    def __post_init__(self) -> None:
        for value in (self.speed, self.accel, self.decel):
            if not 0 < value <= 1:
                raise ValueError(tr("speed, accel and decel must be above 0 and at most 1, not {value!r}", value=value))
        if self.time is not None and not (math.isfinite(self.time) and self.time > 0):
            raise ValueError(tr("the time of a motion must be above 0 s and finite, not {time!r}", time=self.time))


class Motion:
    """A path with its motion profile.

    Attributes:
        path: The path of the joints.
        profile: The progress along the path over time.
        rates: The rates with which the motion was planned.
        mark: The pass mark.
        length: Distance that the TCP travels along its path, mm; ``None`` for a point-to-point motion.
        pass_time: Time in seconds after which the next motion may begin. With ``@P`` it is the start of the
            deceleration. With ``@n`` it is the time from which the distance of the TCP from its end position stays
            within n mm, but at least half the duration. With other marks it is the duration.
    """

    __slots__ = ("length", "mark", "pass_time", "path", "profile", "rates")

    def __init__(self, path: Path, profile: MotionProfile, rates: Rates, mark: PassMark, length: float | None) -> None:
        self.path = path
        self.profile = profile
        self.rates = rates
        self.mark = mark
        self.length = length
        self.pass_time = profile.slowing if mark.mode == "P" else profile.duration

    @property
    def duration(self) -> float:
        """Duration in seconds."""
        return self.profile.duration

    @property
    def start(self) -> Joints:
        """Joints at the start."""
        return self.path.start

    @property
    def end(self) -> Joints:
        """Joints at the end."""
        return self.path.end

    def joints_at(self, time: float) -> Joints:
        """Return the joints at a time in seconds: exactly ``start`` until 0, exactly ``end`` from ``duration`` on."""
        return self.path.at(self.profile.at(time))

    def states_at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return joints, velocities and accelerations, each of shape (N, axes), at ``times`` in seconds, shape (N,)."""
        s, rate, acceleration = self.profile.states_at(times)
        joints, first, second = self.path.sampled(s)
        rate, acceleration = rate[:, None], acceleration[:, None]
        return joints, first * rate, second * rate**2 + first * acceleration


def plan_ptp(
    kinematics: Kinematics,
    start: Sequence[float],
    end: Sequence[float],
    rates: Rates,
    mark: PassMark = AT_TARGET,
    tool: Array | None = None,
) -> Motion:
    """Plan a PTP motion: all axes start and stop together.

    Args:
        kinematics: Kinematics of the arm.
        start: Joints at the start, one for each axis.
        end: Joints at the end.
        rates: Velocity and acceleration.
        mark: The pass mark.
        tool: Frame of the TCP relative to the flange, for the radius of the pass mark ``@n``; ``None`` for the
            flange itself.

    Raises:
        CallError: TARGET_OVER_SOFT_LIMIT_AXISn if the end is outside the soft limits of axis n; VALUE_OUT_OF_RANGE if
            the motion would take more than 36,000 s.
    """
    model = kinematics.model
    path = JointPath(start, end)
    check_end(model, path.end)
    distances = [abs(b - a) for a, b in zip(path.start, path.end, strict=True)]
    limits = [
        _Limits(axis.velocity / distance, axis.acceleration / distance)
        for axis, distance in zip(model.axes, distances, strict=True)
        if distance > 0
    ]
    return _timed(kinematics, path, _profile(limits, rates), rates, mark, tool, None)


def plan_line(
    kinematics: Kinematics,
    start: Sequence[float],
    end: Array,
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
    most_steps: int = MAX_STEPS,
) -> Motion:
    """Plan a straight motion of the TCP.

    Args:
        kinematics: Kinematics of the arm.
        start: Joints at the start, one for each axis.
        end: Frame of the TCP at the end, shape (4, 4), in the base frame.
        tool: Frame of the TCP relative to the flange.
        rates: Velocity and acceleration.
        mark: The pass mark.
        extra_end: End values of the extended joints; ``None`` to leave them unchanged.
        most_steps: Maximum number of steps in the table of joints; it limits the time for planning.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if the end is out of reach; OUT_OF_WORKING_RANGE if another point of the path is
            out of reach; SINGULAR_POINT_REFUSED if the joints cannot follow the path, or only very slowly;
            TARGET_OVER_SOFT_LIMIT_AXISn if the end is outside the soft limits of axis n; SOFT_LIMIT_OVER_AXISn if the
            path leaves the soft limits of axis n; VALUE_OUT_OF_RANGE if the motion would take more than 36,000 s.
        TooManySteps: If the table requires more than ``most_steps``.
    """
    course = courses.line(_tcp(kinematics, start, tool), end)
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end, most_steps)


def plan_arc(
    kinematics: Kinematics,
    start: Sequence[float],
    via: Array,
    end: Array,
    # Also in virtual.engine.motion.planner: every planner of a path in space takes these arguments.
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a motion of the TCP on the arc from the start through the position of ``via`` to the frame ``end``.

    The orientation turns evenly from start to end; the orientation of ``via`` is not used.

    Raises:
        CallError: As for :func:`plan_line`; VALUE_OUT_OF_RANGE also if the three points are on a line or coincide.
    """
    course = courses.arc(_tcp(kinematics, start, tool), via, end)
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end)


def plan_rotation(
    kinematics: Kinematics,
    start: Sequence[float],
    axis: Array,
    point: Array,
    degrees: float,
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    *,
    keep_orientation: bool = False,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a rotation of the TCP about an axis.

    Args:
        kinematics: Kinematics of the arm.
        start: Joints at the start, one for each axis.
        axis: Direction of the axis in the base frame, shape (3,).
        point: A point on the axis, shape (3,), mm.
        degrees: The angle, by the right-hand rule.
        tool: Frame of the TCP relative to the flange.
        rates: Velocity and acceleration.
        mark: The pass mark.
        keep_orientation: True if the tool keeps its orientation; False if it turns about the axis too.
        extra_end: End values of the extended joints; ``None`` to leave them unchanged.

    Raises:
        CallError: As for :func:`plan_line`; VALUE_OUT_OF_RANGE also if the axis has no direction, or the angle is more
            than 100 turns.
    """
    course = courses.rotation(_tcp(kinematics, start, tool), axis, point, degrees, keep_orientation=keep_orientation)
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end)


def plan_curve(
    kinematics: Kinematics,
    start: Sequence[float],
    points: Sequence[Array],
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a smooth motion of the TCP through frames; the last one is the end.

    The TCP is at most as fast as on a straight path; between unevenly spaced points it is slower.

    Raises:
        CallError: As for :func:`plan_line`; VALUE_OUT_OF_RANGE also for more than 5,000 points.
    """
    course = courses.curve([_tcp(kinematics, start, tool), *points])
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end)


def plan_carried(
    kinematics: Kinematics, start: Sequence[float], course: CartesianPath, tool: Array, carrier: Motion
) -> Motion:
    """Plan the motion of an arm along a path that is given by the motion of another arm.

    Args:
        kinematics: Kinematics of the arm.
        start: Joints at the start, one for each axis; axes from the seventh on do not move.
        course: The path of the TCP, with the same parameter as the path of the other arm.
        tool: Frame of the TCP relative to the flange.
        carrier: The motion of the other arm.

    Returns:
        A motion with the profile of ``carrier``, slowed down as a whole if a limit of the arm requires it.

    Raises:
        CallError: As for :func:`plan_line`.
    """
    model, rates, profile = kinematics.model, carrier.rates, carrier.profile
    if not profile.knots:
        return Motion(JointPath(start, start), profile, rates, carrier.mark, 0.0)
    path = table_path(kinematics, course, tool, tuple(start), None, lambda rows: _hopeless(model, rows, profile, rates))
    check_end(model, path.end)
    check_way(model, path)
    _, velocity, acceleration = profile.states_at(np.linspace(0, profile.duration, _SAMPLES))
    fast, hard = float(np.abs(velocity).max()), float(np.abs(acceleration).max())
    accel = max(rates.accel, rates.decel)
    stretch = max(
        (
            max(fast / (limit.velocity * rates.speed), math.sqrt(hard / (limit.acceleration * accel)))
            for limit in _course_limits(model, course, ())
        ),
        default=1.0,
    )
    profile = profile.stretched(profile.duration * stretch)
    profile = _within_joints(model, path, profile, rates)
    if profile.duration > LONGEST:
        raise _too_long()
    return Motion(path, profile, rates, carrier.mark, course.length)


@record
class _Limits:
    """Largest velocity and acceleration of the path parameter, in 1/s and 1/s^2."""

    velocity: float
    acceleration: float


def _tcp(kinematics: Kinematics, start: Sequence[float], tool: Array) -> Array:
    frame: Array = kinematics.forward(np.array(start)) @ tool
    return frame


def _plan_course(
    kinematics: Kinematics,
    start: Sequence[float],
    course: CartesianPath,
    tool: Array,
    rates: Rates,
    mark: PassMark,
    extra_end: Sequence[float] | None,
    most_steps: int = MAX_STEPS,
) -> Motion:
    model = kinematics.model
    count = model.robot_axes
    ends = start[count:] if extra_end is None else extra_end
    extra = [(abs(b - a), axis) for a, b, axis in zip(start[count:], ends, model.axes[count:], strict=True)]
    if course.length <= _STILL and course.angle <= _STILL and all(distance == 0 for distance, _ in extra):
        return Motion(JointPath(start, start), MotionProfile.instant(), rates, mark, 0.0)
    check_end(model, (*start[:count], *ends), first_axis=count)  # reject NaN before inverse kinematics
    profile = _profile(_course_limits(model, course, extra), rates)
    path = table_path(
        kinematics, course, tool, tuple(start), ends, lambda rows: _hopeless(model, rows, profile, rates), most_steps
    )
    check_end(model, path.end)
    check_way(model, path)
    return _timed(kinematics, path, _within_joints(model, path, profile, rates), rates, mark, tool, course.length)


def _course_limits(model: ArmModel, course: CartesianPath, extra: Sequence[tuple[float, AxisModel]]) -> list[_Limits]:
    limits = [
        _Limits(axis.velocity / distance, axis.acceleration / distance) for distance, axis in extra if distance > 0
    ]
    if (far := course.greatest_rate) > _STILL:
        limits.append(_Limits(model.path_speed / far, model.path_acceleration / far))
    if (turn := course.greatest_turn) > _STILL:
        limits.append(_Limits(model.path_rotation / turn, model.path_rotation_acceleration / turn))
    return limits


def _profile(limits: Sequence[_Limits], rates: Rates) -> MotionProfile:
    if not limits:
        return MotionProfile.instant()
    velocity = min(limit.velocity for limit in limits) * rates.speed
    acceleration = min(limit.acceleration for limit in limits)
    accel, decel = acceleration * rates.accel, acceleration * rates.decel
    if (
        min(velocity, accel * LONGEST, decel * LONGEST) * LONGEST < 1
    ):  # the motion takes longer than LONGEST in any case
        raise _too_long()
    ceiling = 1e9  # for very short distances; the profile is smoothed anyway
    return MotionProfile.trapezoid(min(velocity, ceiling), min(accel, ceiling), min(decel, ceiling))


def _within_joints(model: ArmModel, path: Path, profile: MotionProfile, rates: Rates) -> MotionProfile:
    # Stretching the time by k divides velocities by k and accelerations by k^2, so k follows directly.
    motion = Motion(path, profile, rates, AT_TARGET, None)
    times = np.concatenate((np.linspace(0, profile.duration, _SAMPLES), profile.moments(path.probes)))
    _, velocity, acceleration = motion.states_at(times)
    fast = np.abs(velocity).max(0) / ([axis.velocity * rates.speed for axis in model.axes])
    hard = np.abs(acceleration).max(0) / ([axis.acceleration * max(rates.accel, rates.decel) for axis in model.axes])
    stretch = max(float(fast.max()), math.sqrt(float(hard.max()))) * _MARGIN
    if stretch <= 1:
        return profile
    if _too_slow(stretch, profile, rates):
        raise singular()
    return profile.stretched(profile.duration * stretch)


def _hopeless(model: ArmModel, rows: Array, profile: MotionProfile, rates: Rates) -> bool:
    # Between two rows the largest velocity of a joint is at least its average velocity.
    steps = len(rows) - 1
    pace = profile.states_at(profile.moments((np.arange(steps) + 0.5) / steps))[1]
    fast = np.abs(np.diff(rows, axis=0)) * steps * pace[:, None]
    limit = np.array([axis.velocity for axis in model.axes[: model.robot_axes]]) * rates.speed
    return _too_slow(float((fast / limit).max()), profile, rates)


def _too_slow(stretch: float, profile: MotionProfile, rates: Rates) -> bool:
    if rates.avoid_singular:
        return False
    return stretch > _SINGULAR_STRETCH and profile.duration * stretch > _SINGULAR_TIME


def _timed(
    kinematics: Kinematics,
    path: Path,
    profile: MotionProfile,
    rates: Rates,
    mark: PassMark,
    tool: Array | None,
    length: float | None,
) -> Motion:
    if max(profile.duration, rates.time or 0.0) > LONGEST:
        raise _too_long()
    if rates.time is not None:
        profile = profile.stretched(rates.time)
    motion = Motion(path, profile, rates, mark, length)
    if mark.mode == "n" and motion.duration > 0:
        motion.pass_time = _time_within(kinematics, motion, mark.radius, tool)
    return motion


def _time_within(kinematics: Kinematics, motion: Motion, radius: float, tool: Array | None) -> float:
    times = np.linspace(motion.duration / 2, motion.duration, _SAMPLES)
    flanges = kinematics.forward(motion.states_at(times)[0])
    tips = (flanges if tool is None else flanges @ tool)[:, :3, 3]
    outside = np.flatnonzero(np.linalg.norm(tips - tips[-1], axis=1) > radius)
    return float(times[outside[-1] + 1]) if len(outside) else float(times[0])


def _too_long() -> Exception:
    return error_for(
        hresult.VALUE_OUT_OF_RANGE,
        tr("the motion would take more than {longest:g} s. Try: a higher speed, or a shorter time", longest=LONGEST),
    )
