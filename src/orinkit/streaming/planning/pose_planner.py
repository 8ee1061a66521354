"""Commands for a stream of poses, P or T, that keep speed and acceleration of the tool within limits (RC8 4).

As :mod:`orinkit.streaming.planning.joint_planner` for joints. Whether a pose can be reached, and how fast its joints then are, only the
controller knows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.streaming.planning.cartesian_limiter import NOTHING, CartesianLimiter
from orinkit.streaming.planning.joint_planner import checked_period
from orinkit.streaming.planning.limits import PathLimits
from orinkit.streaming.planning.quaternions import (
    Quaternion,
    Vector,
    angles_of,
    of_angles,
    of_vectors,
    turn_between,
    turned,
    vectors_of,
)
from orinkit.values.pose_numbers import COUNTS, FIELDS, brief, conform, is_whole

Kind: TypeAlias = Literal["P", "T"]

_REACH: Final = 1e5  # mm: further away from the base no tool has ever been
_EXACT: Final = 2e-13  # deg: spacing of angles, and what becomes of it on the way to an orientation
_OPPOSITE: Final = 170.0  # deg: from here on it is not said which way round is the shorter one
_SURELY_FINITE: Final = 1e300
_FLOATS: Final = {float}


class _Pose(NamedTuple):
    """A pose as it was written, and what it is."""

    values: tuple[float, ...]
    place: Vector
    turn: Quaternion


class PosePlanner:
    """Makes the commands of a stream of P or T, one in each period, from rest.

    :meth:`goto`, :meth:`track` and :meth:`stop` each make the next command; they may be called in any order. The
    position of the tip moves from one command to the next by no more than speed * period, and this vector changes by
    no more than acceleration * period^2. So does the rotation between two orientations, which is the vector of its axis
    in the base times its angle in degrees. All up to a relative 10^-9, plus 10^-12 degrees for the rounding of angles,
    whatever numbers are given.

    Args:
        limits: of the tool.
        period: seconds from one command to the next.
        pose: where the arm stands: X, Y, Z mm, RX, RY, RZ deg, Fig; or X, Y, Z, O, A, Fig.
        kind: which of the two.

    Attributes:
        command: the last command, as many values as ``pose``. Its figure is the one of what was wanted last.
        at_rest: whether the last two commands are equal, and what was wanted has been reached.

    Raises:
        InvalidValue: the period is not a finite number above 0, or so short that a limit is lost in rounding; the pose
            is none, or more than 100 m away.
        MissingExtra: ruckig is not installed.
    """

    def __init__(self, limits: PathLimits, period: float, pose: Sequence[float], kind: Kind) -> None:
        period = checked_period(period)
        if kind not in ("P", "T"):
            raise InvalidValue(tr('kind is {kind}, "P" or "T" is wanted', kind=brief(kind)))
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
        self._left: Vector | None = None  # of the rotation to the last goal
        self._goal: tuple[float, ...] | None = None  # of follow, if it made the last command
        self._asked: _Pose | None = None  # the last set-point, if take made the last command
        self._behind = 0.0, 0.0  # mm, deg: how far the last command is from it

    def goto(self, target: Sequence[float]) -> tuple[float, ...]:
        """Return the next command of a smooth motion that ends at a target; the target may be another one each time.

        Position and orientation each take the time that they need. The orientation turns the shorter way round.

        Args:
            target: a pose. Its figure is passed on at once.

        Raises:
            InvalidValue: it is none.
        """
        goal = self._read(target)
        anew = self._goal != goal.values
        self._forget()
        self._goal = goal.values
        if self.at_rest and goal.values == self.command:
            return self._send(goal.values, goal.place, goal.turn)
        step, tip_there = self._tip.towards(_minus(_within_reach(goal.place), self._place), anew=anew)
        way = self._way_to(goal.turn)
        rotation, spin_there = self._spin.towards(way, anew=anew)
        self._left = _minus(way, rotation)
        place = self._reached(goal, step, there=tip_there)
        self._send_turned(goal, place, rotation, there=spin_there)
        self.at_rest = self.command == self._before and tip_there and spin_there
        return self.command

    def track(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return the next command for a program's own set-point: just this point, if :meth:`check` it.

        Otherwise position, or orientation, or both, come as near as they smoothly can, and go on to until they have
        caught up.

        Args:
            point: a pose.

        Raises:
            InvalidValue: it is none.
        """
        goal = self._read(point)
        step, rotation = self._steps_to(goal)
        tip_fits, spin_fits = self._fits(goal, step, rotation)
        moved = spun = NOTHING
        if self._asked is not None:
            moved, spun = _minus(goal.place, self._asked.place), turn_between(self._asked.turn, goal.turn)
        self._asked, self._goal = goal, None
        if tip_fits and spin_fits:
            self._left = None
        if tip_fits:
            self._tip.keep(step, moved)
            place = goal.place
        else:
            step, there = self._tip.chase(_minus(_within_reach(goal.place), self._place), moved)
            place = self._reached(goal, step, there=there)
        if spin_fits:
            self._spin.keep(rotation, spun)
        else:
            way = self._way_to(goal.turn)
            rotation, spin_fits = self._spin.chase(way, spun)
            self._left = _minus(way, rotation)
        self._send_turned(goal, place, rotation, there=spin_fits)
        self._behind = math.dist(_within_reach(goal.place), place), math.hypot(*turn_between(self._turn, goal.turn))
        self.at_rest = self.command == self._before and not any(self._behind)
        return self.command

    def stop(self) -> tuple[float, ...]:
        """Return the next command of coming to rest, the last one for ever when the tool is."""
        self._forget()
        self._left = None
        step, rotation = self._tip.halt(), self._spin.halt()
        here = _Pose(self.command, self._place, self._turn)
        self._send_turned(here, _plus(self._place, step), rotation, there=rotation == NOTHING)
        self.at_rest = self.command == self._before and self._tip.rests and self._spin.rests
        return self.command

    def check(self, point: Sequence[float]) -> None:
        """Check that :meth:`track` would pass a set-point on as it is; for those who refuse instead of coming near.

        Args:
            point: a pose.

        Raises:
            InvalidValue: it is none, or would not be passed on: what is exceeded, by how much, and the limit.
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
        return _minus(goal.place, self._place), turn_between(self._turn, goal.turn)

    def _fits(self, goal: _Pose, step: Vector, rotation: Vector) -> tuple[bool, bool]:
        near = goal.place == _within_reach(goal.place)
        return (
            near and self._behind[0] <= self._tip.near and self._tip.fits(step),
            self._behind[1] <= self._spin.near and self._spin.fits(rotation),
        )

    def _way_to(self, turn: Quaternion) -> Vector:
        """Return the rotation to an orientation: the shorter way, but near half a turn the way that was begun."""
        way = turn_between(self._turn, turn)
        angle = math.hypot(*way)
        if self._left is None or angle < _OPPOSITE:
            return way
        rest = 1.0 - 360.0 / angle
        other = way[0] * rest, way[1] * rest, way[2] * rest
        return other if math.dist(other, self._left) < math.dist(way, self._left) else way

    def _reached(self, goal: _Pose, step: Vector, *, there: bool) -> Vector:
        return _within_reach(goal.place) if there else _plus(self._place, step)

    def _send_turned(self, goal: _Pose, place: Vector, rotation: Vector, *, there: bool) -> None:
        """Make a command of a position and a rotation; the orientation is the goal's, as written, if it is ``there``."""
        if there:
            self._send((*place, *goal.values[3:]), place, goal.turn)
            return
        turn = turned(self._turn, rotation)
        written = angles_of(turn) if self._kind == "P" else vectors_of(turn)
        self._send((*place, *written, goal.values[-1]), place, turn)

    def _send(self, command: tuple[float, ...], place: Vector, turn: Quaternion) -> tuple[float, ...]:
        self._before, self.command = self.command, command
        self._tip.step = _minus(place, self._place)  # as it is after rounding
        self._place, self._turn = place, turn
        return command

    def _forget(self) -> None:
        self._goal = None
        self._asked, self._behind = None, (0.0, 0.0)
        self._tip.forget()
        self._spin.forget()

    def _read(self, values: Sequence[float]) -> _Pose:
        kind = self._kind
        count = COUNTS[kind][1]
        if len(values) != count:
            names = ", ".join(FIELDS[kind])
            raise InvalidValue(
                tr(
                    "{kind}: {count} values were given, {wanted} are wanted: {names}",
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
            values = conform(kind, values)
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
        "position: {furthest:g} mm is further away than any tool, at most {reach:g} mm is wanted",
        furthest=furthest,
        reach=_REACH,
    )


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
