"""Planner of a stream of poses, P or T, that keeps velocity and acceleration of the tool within limits (RC8 4).

The planner for joint positions is in :mod:`orinkit.streaming.planning.joint_planner`. Only the controller can check
that a pose is reachable and that the joints are fast enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple, TypeAlias

from orinkit.arms.geometry import (
    Quaternion,
    Vector,
    angles_of,
    minus,
    of_angles,
    of_vectors,
    plus,
    rotvec_between,
    turned,
    vectors_of,
)
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.validation import brief
from orinkit.streaming.planning.cartesian_limiter import NOTHING, CartesianLimiter
from orinkit.streaming.planning.joint_planner import checked_period
from orinkit.streaming.planning.limits import PathLimits
from orinkit.values.pose_numbers import COUNTS, FIELDS, is_whole, to_floats

Kind: TypeAlias = Literal["P", "T"]

_REACH: Final = 1e5  # mm: largest coordinate in the base frame
_EXACT: Final = 2e-13  # deg: spacing of floating-point angles, plus the rounding error of their conversion
_OPPOSITE: Final = 170.0  # deg: from this angle on, the direction of rotation is ambiguous
_SURELY_FINITE: Final = 1e300
_FLOATS: Final = {float}


class _Pose(NamedTuple):
    """A pose: its values as given, its position, and its orientation."""

    values: tuple[float, ...]
    place: Vector
    turn: Quaternion


class PosePlanner:
    """Computes the commands of a stream of P or T, one per period; the arm is initially at standstill.

    :meth:`goto`, :meth:`track` and :meth:`stop` each return the next command; they may be called in any order. A
    command is the pose that is sent to the controller. The step of the tool tip from one command to the next is at most
    speed * period long. The difference of two consecutive steps, as vectors, is at most acceleration * period^2 long.
    The same applies to the rotation from one command to the next, expressed as a vector: its axis in the base frame
    times its angle in degrees. These conditions hold for any input, with a relative tolerance of 10^-9, plus 10^-12
    degrees for the rounding of angles.

    Args:
        limits: Limits of the tool.
        period: Time between two commands, s.
        pose: The pose at which the arm stands: X, Y, Z mm, RX, RY, RZ deg, Fig for P; X, Y, Z, the vectors O and A, Fig
            for T.
        kind: Pose type, ``"P"`` or ``"T"``.

    Attributes:
        command: The last command, with as many values as ``pose``. It has the figure of the last target or set-point.
        at_rest: True if the last two commands are equal, and the target or set-point is reached.

    Raises:
        InvalidValue: If the period is not a positive finite number, or so short that the largest step would be lost in
            rounding; or if the pose is not valid, or more than 100 m from the base.
        MissingExtra: If ruckig is not installed.
    """

    def __init__(self, limits: PathLimits, period: float, pose: Sequence[float], kind: Kind) -> None:
        period = checked_period(period)
        if kind not in ("P", "T"):
            raise InvalidValue(tr('kind is {kind}, but must be "P" or "T"', kind=brief(kind)))
        self._kind: Kind = kind
        start = self._read(pose)
        if max(map(abs, start.place)) > _REACH:
            raise InvalidValue(_too_far(start.place))
        self._tip = CartesianLimiter(
            N_("position"), "mm", limits.speed, limits.acceleration, limits.jerk, period, math.ulp(_REACH)
        )
        self._spin = CartesianLimiter(
            N_("orientation"), "deg", limits.rotation, limits.rotation_acceleration, limits.rotation_jerk, period,
            _EXACT, turning=True,
        )  # fmt: skip
        self.command: tuple[float, ...] = start.values
        self.at_rest = True
        self._before = self.command
        self._place = start.place
        self._turn = start.turn
        self._rotation_left: Vector | None = None  # remaining rotation to the last goal
        self._goal: tuple[float, ...] | None = None  # target of goto(), if it made the last command
        self._last_point: _Pose | None = None  # last set-point, if track() made the last command
        self._behind = 0.0, 0.0  # mm, deg: distance of the last command from the last set-point

    def goto(self, target: Sequence[float]) -> tuple[float, ...]:
        """Return the next command of a smooth motion to a target, which may change with each call.

        The position and the orientation may reach the target at different times. The orientation turns in the shorter
        direction.

        Args:
            target: A pose. The next command already has the figure of this pose.

        Raises:
            InvalidValue: If the pose is not valid.
        """
        goal = self._read(target)
        anew = self._goal != goal.values
        self._forget()
        self._goal = goal.values
        if self.at_rest and goal.values == self.command:
            return self._send(goal.values, goal.place, goal.turn)
        step, tip_there = self._tip.towards(minus(_within_reach(goal.place), self._place), anew=anew)
        way = self._way_to(goal.turn)
        rotation, spin_there = self._spin.towards(way, anew=anew)
        self._rotation_left = minus(way, rotation)
        place = self._reached(goal, step, there=tip_there)
        self._send_turned(goal, place, rotation, there=spin_there)
        self.at_rest = self.command == self._before and tip_there and spin_there
        return self.command

    def track(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return the next command for a set-point of the program: the set-point itself, if it passes :meth:`check`.

        Otherwise the position, the orientation, or both approach the set-point smoothly, until they have caught up with
        the set-points.

        Args:
            point: A pose.

        Raises:
            InvalidValue: If the pose is not valid.
        """
        goal = self._read(point)
        step, rotation = self._steps_to(goal)
        tip_fits, spin_fits = self._fits(goal, step, rotation)
        moved = spun = NOTHING
        if self._last_point is not None:
            moved, spun = minus(goal.place, self._last_point.place), rotvec_between(self._last_point.turn, goal.turn)
        self._last_point, self._goal = goal, None
        if tip_fits and spin_fits:
            self._rotation_left = None
        if tip_fits:
            self._tip.keep(step, moved)
            place = goal.place
        else:
            step, there = self._tip.chase(minus(_within_reach(goal.place), self._place), moved)
            place = self._reached(goal, step, there=there)
        if spin_fits:
            self._spin.keep(rotation, spun)
        else:
            way = self._way_to(goal.turn)
            rotation, spin_fits = self._spin.chase(way, spun)
            self._rotation_left = minus(way, rotation)
        self._send_turned(goal, place, rotation, there=spin_fits)
        self._behind = math.dist(_within_reach(goal.place), place), math.hypot(*rotvec_between(self._turn, goal.turn))
        self.at_rest = self.command == self._before and not any(self._behind)
        return self.command

    def stop(self) -> tuple[float, ...]:
        """Return the next command of a stop; at standstill, return the last command."""
        self._forget()
        self._rotation_left = None
        step, rotation = self._tip.halt(), self._spin.halt()
        here = _Pose(self.command, self._place, self._turn)
        self._send_turned(here, plus(self._place, step), rotation, there=rotation == NOTHING)
        self.at_rest = self.command == self._before and self._tip.at_rest and self._spin.at_rest
        return self.command

    def check(self, point: Sequence[float]) -> None:
        """Check that :meth:`track` would return a set-point unchanged. A caller can thus reject other set-points.

        Args:
            point: A pose.

        Raises:
            InvalidValue: If the pose is not valid, or :meth:`track` would change it; the message contains the limit and
                the excess.
        """
        goal = self._read(point)
        step, rotation = self._steps_to(goal)
        tip_fits, spin_fits = self._fits(goal, step, rotation)
        if not tip_fits:
            far = goal.place != _within_reach(goal.place)
            raise InvalidValue(_too_far(goal.place) if far else self._tip.complaint(step, self._behind[0]))
        if not spin_fits:
            raise InvalidValue(self._spin.complaint(rotation, self._behind[1]))

    def _steps_to(self, goal: _Pose) -> tuple[Vector, Vector]:
        return minus(goal.place, self._place), rotvec_between(self._turn, goal.turn)

    def _fits(self, goal: _Pose, step: Vector, rotation: Vector) -> tuple[bool, bool]:
        near = goal.place == _within_reach(goal.place)
        return (
            near and self._behind[0] <= self._tip.near and self._tip.fits(step),
            self._behind[1] <= self._spin.near and self._spin.fits(rotation),
        )

    def _way_to(self, turn: Quaternion) -> Vector:
        """Return the rotation to an orientation in the shorter direction; near 180 deg, keep the previous direction."""
        way = rotvec_between(self._turn, turn)
        angle = math.hypot(*way)
        if self._rotation_left is None or angle < _OPPOSITE:
            return way
        rest = 1.0 - 360.0 / angle
        other = way[0] * rest, way[1] * rest, way[2] * rest
        return other if math.dist(other, self._rotation_left) < math.dist(way, self._rotation_left) else way

    def _reached(self, goal: _Pose, step: Vector, *, there: bool) -> Vector:
        return _within_reach(goal.place) if there else plus(self._place, step)

    def _send_turned(self, goal: _Pose, place: Vector, rotation: Vector, *, there: bool) -> None:
        """Make a command with the position ``place`` and the last orientation, turned by ``rotation``.

        If ``there`` is True, use the orientation of the goal instead of the turned one.
        """
        if there:
            self._send((*place, *goal.values[3:]), place, goal.turn)
            return
        turn = turned(self._turn, rotation)
        written = angles_of(turn) if self._kind == "P" else vectors_of(turn)
        self._send((*place, *written, goal.values[-1]), place, turn)

    def _send(self, command: tuple[float, ...], place: Vector, turn: Quaternion) -> tuple[float, ...]:
        self._before, self.command = self.command, command
        self._tip.step = minus(place, self._place)  # the step after rounding
        self._place, self._turn = place, turn
        return command

    def _forget(self) -> None:
        self._goal = None
        self._last_point, self._behind = None, (0.0, 0.0)
        self._tip.forget()
        self._spin.forget()

    def _read(self, values: Sequence[float]) -> _Pose:
        kind = self._kind
        count = COUNTS[kind][1]
        if len(values) != count:
            names = ", ".join(FIELDS[kind])
            raise InvalidValue(
                tr(
                    "{kind}: got {count} values, expected {wanted}: {names}",
                    kind=kind,
                    count=len(values),
                    wanted=count,
                    names=names,
                )
            )
        if (
            set(map(type, values)) != _FLOATS
            or not -_SURELY_FINITE < sum(values) < _SURELY_FINITE
            or not is_whole(values[-1])
        ):
            values = to_floats(kind, values)
        x, y, z, a, b, c = values[:6]
        turn = of_angles(a, b, c) if kind == "P" else of_vectors((a, b, c), values[6:9])
        return _Pose(tuple(values), (x, y, z), turn)


def _within_reach(place: Vector) -> Vector:
    x, y, z = place
    if -_REACH <= x <= _REACH and -_REACH <= y <= _REACH and -_REACH <= z <= _REACH:
        return place
    x, y, z = (min(max(value, -_REACH), _REACH) for value in place)
    return x, y, z


def _too_far(place: Vector) -> str:
    furthest = max(place, key=abs)
    return tr(
        "position: {furthest:g} mm is out of reach; the largest allowed coordinate is {reach:g} mm",
        furthest=furthest,
        reach=_REACH,
    )
