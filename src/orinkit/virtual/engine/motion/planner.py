"""Planning: a motion from where the arm will be to a target, as fast as the model's limits and the rates allow.

Every joint stays within its velocity times ``speed``, and its acceleration times the greater of ``accel`` and
``decel``; on a path the TCP stays within the model's path speed times ``speed``. A path that asks too much of a joint
is run slower as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from orinkit.arms import ArmModel, AxisModel
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import PassMark
from orinkit.virtual.engine.motion import cartesian_path as courses
from orinkit.virtual.engine.motion.cartesian_path import CartesianPath
from orinkit.virtual.engine.motion.joint_path import JointPath, Joints, Path, singular, table_path
from orinkit.virtual.engine.motion.profile import Array, MotionProfile
from orinkit.virtual.engine.motion.soft_limits import check_end, check_way

LONGEST: Final = 36_000.0
"""Seconds that a motion can take."""

AT_TARGET: Final = PassMark("0")

_MARGIN: Final = 1.01  # of a path that is slowed down, for what lies between the places looked at
_SINGULAR_STRETCH: Final = 20.0  # a path slowed down more than this, and
_SINGULAR_TIME: Final = 2.0  # lasting longer than this, is too near a singular point
_STILL: Final = 1e-9  # deg or mm; a shorter way is none
_SAMPLES: Final = 1024  # of a motion, to see how fast its joints are, and when it is near its end


@dataclass(frozen=True, slots=True)
class Rates:
    """How fast a motion is, as parts of what the model can do.

    Attributes:
        speed: 0 < speed <= 1.
        accel: the same of the acceleration.
        decel: the same of the deceleration.
        time: seconds that the motion takes, ``None`` for as fast as the others allow. A time that is too short is not
            an error: the motion is then as fast as possible.

    Raises:
        ValueError: a value out of range.
    """

    speed: float = 1.0
    accel: float = 1.0
    decel: float = 1.0
    time: float | None = None

    def __post_init__(self) -> None:
        for value in (self.speed, self.accel, self.decel):
            if not 0 < value <= 1:
                raise ValueError(tr("a rate is above 0 and at most 1, not {value!r}", value=value))
        if self.time is not None and not (math.isfinite(self.time) and self.time > 0):
            raise ValueError(tr("the time of a motion is a number of seconds above 0, not {time!r}", time=self.time))


class Motion:
    """A path with its time law.

    Attributes:
        path, profile: what it is made of.
        rates: what it was planned with.
        mark: when it counts as done.
        length: mm that the TCP travels along its path; ``None`` for a point-to-point motion.
        pass_time: seconds after which the next motion may begin: with ``@P`` when this one begins to slow down, with
            ``@n`` when its TCP is, and stays, within the radius of its end, though not in the first half; else its end.
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
        """Seconds that it takes."""
        return self.profile.duration

    @property
    def start(self) -> Joints:
        """Joints where it begins."""
        return self.path.start

    @property
    def end(self) -> Joints:
        """Joints where it ends."""
        return self.path.end

    def joints_at(self, time: float) -> Joints:
        """Return the joints at a time in seconds: exactly ``start`` up to 0, exactly ``end`` from ``duration`` on."""
        return self.path.at(self.profile.at(time))

    def sampled(self, times: Array) -> tuple[Array, Array, Array]:
        """Return joints, velocities and accelerations, of shape (N, axes), at ``times`` of shape (N,)."""
        s, rate, acceleration = self.profile.sampled(times)
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
    """Plan a motion from joints to joints, all axes starting and stopping together.

    Args:
        kinematics: of the arm.
        start: joints where it begins, one for each axis.
        end: joints where it ends.
        rates: how fast.
        mark: when it counts as done.
        tool: frame of the TCP in the flange, for the radius of the mark; ``None`` for the flange itself.

    Raises:
        CallError: TARGET_OVER_SOFT_LIMIT_AXISn; VALUE_OUT_OF_RANGE, it would take more than 36,000 s.
    """
    model = kinematics.model
    path = JointPath(start, end)
    check_end(model, path.end)
    ways = [abs(b - a) for a, b in zip(path.start, path.end, strict=True)]
    limits = [
        _Limits(axis.velocity / way, axis.acceleration / way)
        for axis, way in zip(model.axes, ways, strict=True)
        if way > 0
    ]
    return _timed(kinematics, path, _law(limits, rates), rates, mark, tool, None)


def plan_line(
    kinematics: Kinematics,
    start: Sequence[float],
    end: Array,
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a straight motion of the TCP.

    Args:
        kinematics: of the arm.
        start: joints where it begins, one for each axis.
        end: frame of the TCP where it ends, shape (4, 4), in the base.
        tool: frame of the TCP in the flange.
        rates: how fast.
        mark: when it counts as done.
        extra_end: where the axes from the seventh on end; ``None`` to leave them where they are.

    Raises:
        CallError: TARGET_OUT_OF_RANGE if the arm does not reach the end, OUT_OF_WORKING_RANGE if it does not reach a
            place on the way; SINGULAR_POINT_REFUSED where the joints cannot follow, or only very slowly;
            TARGET_OVER_SOFT_LIMIT_AXISn of the end, SOFT_LIMIT_OVER_AXISn of the way there; VALUE_OUT_OF_RANGE, it
            would take more than 36,000 s.
    """
    course = courses.line(_tcp(kinematics, start, tool), end)
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end)


def plan_arc(
    kinematics: Kinematics,
    start: Sequence[float],
    via: Array,
    end: Array,
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a motion of the TCP on the circle through the position of ``via`` to the frame ``end``.

    The orientation turns evenly from start to end; that of ``via`` is not used.

    Raises:
        CallError: as :func:`plan_line`; VALUE_OUT_OF_RANGE also if the points are on a line or the same.
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
) -> Motion:
    """Plan a rotation of the TCP about an axis.

    Args:
        kinematics: of the arm.
        start: joints where it begins, one for each axis.
        axis: direction of the axis in the base, shape (3,).
        point: a point on it, shape (3,), mm.
        degrees: how far, by the right-hand rule.
        tool: frame of the TCP in the flange.
        rates: how fast.
        mark: when it counts as done.
        keep_orientation: whether the tool keeps its orientation instead of turning with it.

    Raises:
        CallError: as :func:`plan_line`; VALUE_OUT_OF_RANGE also for an axis without direction, and an angle of more
            than 100 turns.
    """
    course = courses.rotation(_tcp(kinematics, start, tool), axis, point, degrees, keep_orientation=keep_orientation)
    return _plan_course(kinematics, start, course, tool, rates, mark, None)


def plan_curve(
    kinematics: Kinematics,
    start: Sequence[float],
    points: Sequence[Array],
    tool: Array,
    rates: Rates,
    mark: PassMark = AT_TARGET,
    extra_end: Sequence[float] | None = None,
) -> Motion:
    """Plan a smooth motion of the TCP through frames, the last of which is the end.

    The TCP is at most as fast as on a line; where the points are uneven it is slower in between.

    Raises:
        CallError: as :func:`plan_line`; VALUE_OUT_OF_RANGE also for more than 5,000 points.
    """
    course = courses.curve([_tcp(kinematics, start, tool), *points])
    return _plan_course(kinematics, start, course, tool, rates, mark, extra_end)


@dataclass(frozen=True, slots=True)
class _Limits:
    """Velocity and acceleration as parts of the way, in 1/s and 1/s^2."""

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
) -> Motion:
    model = kinematics.model
    ends = start[6:] if extra_end is None else extra_end
    extra = [(abs(b - a), axis) for a, b, axis in zip(start[6:], ends, model.axes[6:], strict=True)]
    if course.length <= _STILL and course.angle <= _STILL and all(way == 0 for way, _ in extra):
        return Motion(JointPath(start, start), MotionProfile.instant(), rates, mark, 0.0)
    check_end(model, (*start[:6], *ends), first=6)  # before inverse kinematics looks at a NaN
    law = _law(_course_limits(model, course, extra), rates)
    path = table_path(kinematics, course, tool, tuple(start), ends, lambda rows: _hopeless(model, rows, law, rates))
    check_end(model, path.end)
    check_way(model, path)
    return _timed(kinematics, path, _within_joints(model, path, law, rates), rates, mark, tool, course.length)


def _course_limits(model: ArmModel, course: CartesianPath, extra: Sequence[tuple[float, AxisModel]]) -> list[_Limits]:
    limits = [_Limits(axis.velocity / way, axis.acceleration / way) for way, axis in extra if way > 0]
    if (far := course.greatest_rate) > _STILL:
        limits.append(_Limits(model.path_speed / far, model.path_acceleration / far))
    if (turn := course.greatest_turn) > _STILL:
        limits.append(_Limits(model.path_rotation / turn, model.path_rotation_acceleration / turn))
    return limits


def _law(limits: Sequence[_Limits], rates: Rates) -> MotionProfile:
    if not limits:
        return MotionProfile.instant()
    velocity = min(limit.velocity for limit in limits) * rates.speed
    acceleration = min(limit.acceleration for limit in limits)
    accel, decel = acceleration * rates.accel, acceleration * rates.decel
    if min(velocity, accel * LONGEST, decel * LONGEST) * LONGEST < 1:  # longer than that in any case
        raise _too_long()
    ceiling = 1e9  # of a way next to nothing; the time law smooths it anyway
    return MotionProfile.trapezoid(min(velocity, ceiling), min(accel, ceiling), min(decel, ceiling))


def _within_joints(model: ArmModel, path: Path, profile: MotionProfile, rates: Rates) -> MotionProfile:
    # Time stretched by k divides velocities by k and accelerations by k^2: no need to try.
    motion = Motion(path, profile, rates, AT_TARGET, None)
    times = np.concatenate((np.linspace(0, profile.duration, _SAMPLES), profile.moments(path.probes)))
    _, velocity, acceleration = motion.sampled(times)
    fast = np.abs(velocity).max(0) / ([axis.velocity * rates.speed for axis in model.axes])
    hard = np.abs(acceleration).max(0) / ([axis.acceleration * max(rates.accel, rates.decel) for axis in model.axes])
    stretch = max(float(fast.max()), math.sqrt(float(hard.max()))) * _MARGIN
    if stretch <= 1:
        return profile
    if _too_slow(stretch, profile):
        raise singular()
    return profile.stretched(profile.duration * stretch)


def _hopeless(model: ArmModel, rows: Array, profile: MotionProfile, rates: Rates) -> bool:
    # From one row to the next the joints cannot be slower than on the average.
    steps = len(rows) - 1
    pace = profile.sampled(profile.moments((np.arange(steps) + 0.5) / steps))[1]
    fast = np.abs(np.diff(rows, axis=0)) * steps * pace[:, None]
    most = np.array([axis.velocity for axis in model.axes[:6]]) * rates.speed
    return _too_slow(float((fast / most).max()), profile)


def _too_slow(stretch: float, profile: MotionProfile) -> bool:
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
    flanges = kinematics.forward(motion.sampled(times)[0])
    tips = (flanges if tool is None else flanges @ tool)[:, :3, 3]
    outside = np.flatnonzero(np.linalg.norm(tips - tips[-1], axis=1) > radius)
    return float(times[outside[-1] + 1]) if len(outside) else float(times[0])


def _too_long() -> Exception:
    return error_for(
        hresult.VALUE_OUT_OF_RANGE,
        tr("the motion would take more than {longest:g} s; raise the speed or shorten the time", longest=LONGEST),
    )
