"""Torques of the axes of an arm: rigid-body dynamics of links that are point masses.

Neither masses nor torques of the arms are published. The mass of the arm, from its model, is distributed over the links
by fixed shares, and each link has its centre halfway to the next joint. The rated torque of an axis is derived from the
load that the axis carries when the arm is stretched out horizontally with its largest payload. All results are
estimates: they have the right signs, orders of magnitude and dependencies, not the values of a real arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

from orinkit.arms import ArmModel
from orinkit.arms.models import DEFAULT_MASS, DEFAULT_PAYLOAD
from orinkit.core.record import record

Vector: TypeAlias = tuple[float, float, float]
Joints: TypeAlias = tuple[float, ...]

GRAVITY: Final = 9.80665  # m/s^2
ARM_AXES: Final = 6
_AXES: Final = "zyyzyz"  # directions of the axes, as in ArmModel
_SHARES: Final = (0.25, 0.2, 0.15, 0.08, 0.05, 0.02)  # of the mass of the arm; the rest is its base
_GYRATION: Final = 0.06  # m, radius of gyration of everything that an axis turns, in addition to the point masses
_GRAVITY_RESERVE: Final = 1.25  # of the largest static torque
_ACCELERATION_SHARE: Final = 0.5  # of the torque for the largest acceleration, which may exceed the rated torque
_RATING_CENTRE: Final = (0.0, 50.0, 100.0)  # mm, centre of the payload for which the axes are rated
_LEAST_TORQUE: Final = 0.1  # N m
_METRE: Final = 1000.0  # mm
_SQUARE_METRE: Final = 1e4  # cm^2
_REST: Final = (0.0, 0.0, 0.0)


@record
class Payload:
    """A load at the flange.

    Attributes:
        mass: Mass, kg.
        centre: Centre of gravity in the frame of the flange, mm.
        inertia: Moments of inertia about the axes through the centre, kg cm^2.
    """

    mass: float = 0.0
    centre: Vector = _REST
    inertia: Vector = _REST


@record
class Wrench:
    """A force and a moment at a point of the tool, in the base frame.

    Attributes:
        force: Force on the tool, N.
        moment: Moment on the tool about the point, N m.
        point: The point, mm.
    """

    force: Vector = _REST
    moment: Vector = _REST
    point: Vector = _REST


@record
class _Posture:
    """Axes (unit vectors), origins of the joints and centres of the links, m, in the base frame; payload last."""

    axes: list[Vector]
    origins: list[Vector]
    centres: list[Vector]
    flange: tuple[Vector, Vector, Vector]  # columns of the rotation


class ArmDynamics:
    """The dynamics of one arm.

    Args:
        model: The arm model.

    Attributes:
        payload: The load at the flange.
        rated: Rated torque of each of the six axes, N m.
    """

    def __init__(self, model: ArmModel) -> None:
        origins = model.origins
        reach = sum(math.dist(origin, _REST) for origin in origins[1:]) / _METRE
        mass = model.mass or DEFAULT_MASS * reach
        self._origins = [_scaled(origin, 1 / _METRE) for origin in origins]
        self._centres = _centres(self._origins)
        self._masses = [mass * share for share in _SHARES]
        self.payload = Payload()
        empty = self._rating(model)
        self.payload = Payload(model.payload or DEFAULT_PAYLOAD * mass, _RATING_CENTRE)
        self.rated = tuple(map(max, empty, self._rating(model)))
        self.payload = Payload()

    @property
    def payload(self) -> Payload:
        """The load at the flange."""
        return self._payload

    @payload.setter
    def payload(self, payload: Payload) -> None:
        self._payload = payload
        carried, total = [], payload.mass
        for mass in reversed(self._masses):
            total += mass
            carried.append(total * _GYRATION**2)
        self._inertias = carried[::-1]

    def torques(self, before: Joints, now: Joints, after: Joints, period: float, wrench: Wrench | None) -> list[float]:
        """Return the torques of the six axes at ``now``, N m, from joint positions that are ``period`` s apart."""
        posture = self._posture(now)
        accelerations = self._accelerations(before, now, after, period, posture)
        turns = [math.radians(a - 2 * b + c) / period**2 for a, b, c in zip(before, now, after, strict=True)]
        torques = self._torques(posture, accelerations, turns)
        return torques if wrench is None else _loaded(torques, posture, wrench)

    def holding(self, joints: Joints) -> list[float]:
        """Return the torques of the six axes that hold arm and payload against gravity, N m."""
        posture = self._posture(joints)
        return self._torques(posture, [_REST] * len(posture.centres), [0.0] * ARM_AXES)

    def _torques(self, posture: _Posture, accelerations: Sequence[Vector], turns: Sequence[float]) -> list[float]:
        masses = [*self._masses, self.payload.mass]
        forces = [
            (mass * x, mass * y, mass * (z + GRAVITY)) for mass, (x, y, z) in zip(masses, accelerations, strict=True)
        ]
        spin = self._spin(posture, turns)
        torques = []
        for index, (axis, origin) in enumerate(zip(posture.axes, posture.origins, strict=True)):
            torque = self._inertias[index] * turns[index] + _dot(axis, spin)
            for centre, force in zip(posture.centres[index:], forces[index:], strict=True):
                torque += _dot(axis, _cross(_less(centre, origin), force))
            torques.append(torque)
        return torques

    def _spin(self, posture: _Posture, turns: Sequence[float]) -> Vector:
        """Return the moment that accelerates the payload about its centre, N m."""
        if not any(self.payload.inertia):
            return _REST
        alpha = _REST
        for axis, turn in zip(posture.axes, turns, strict=False):
            alpha = _plus(alpha, _scaled(axis, turn))
        moment = _REST
        for column, inertia in zip(posture.flange, self.payload.inertia, strict=True):
            moment = _plus(moment, _scaled(column, _dot(column, alpha) * inertia / _SQUARE_METRE))
        return moment

    def _accelerations(
        self, before: Joints, now: Joints, after: Joints, period: float, posture: _Posture
    ) -> list[Vector]:
        if before == now == after:
            return [_REST] * len(posture.centres)
        first, last = self._posture(before).centres, self._posture(after).centres
        rate = 1 / period**2
        return [
            ((a[0] - 2 * b[0] + c[0]) * rate, (a[1] - 2 * b[1] + c[1]) * rate, (a[2] - 2 * b[2] + c[2]) * rate)
            for a, b, c in zip(first, posture.centres, last, strict=True)
        ]

    def _posture(self, joints: Joints) -> _Posture:
        x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        place = _REST
        axes, origins, centres = [], [], []
        for index, kind in enumerate(_AXES):
            place = _plus(place, _turned(x, y, z, self._origins[index]))
            angle = math.radians(joints[index])
            c, s = math.cos(angle), math.sin(angle)
            origins.append(place)
            if kind == "z":
                axes.append(z)
                x, y = _mixed(x, c, y, s), _mixed(x, -s, y, c)
            else:
                axes.append(y)
                x, z = _mixed(x, c, z, -s), _mixed(x, s, z, c)
            centres.append(_plus(place, _turned(x, y, z, self._centres[index])))
        centres.append(_plus(place, _turned(x, y, z, _scaled(self.payload.centre, 1 / _METRE))))
        return _Posture(axes, origins, centres, (x, y, z))

    def _rating(self, model: ArmModel) -> tuple[float, ...]:
        posture = self._posture((0.0, 90.0, 0.0, 0.0, 0.0, 0.0))
        static = self._torques(posture, [_REST] * len(posture.centres), [0.0] * ARM_AXES)
        masses = [*self._masses, self.payload.mass]
        rated = []
        for index, (axis, origin) in enumerate(zip(posture.axes, posture.origins, strict=True)):
            inertia = self._inertias[index]
            for mass, centre in zip(masses[index:], posture.centres[index:], strict=True):
                arm = _cross(axis, _less(centre, origin))
                inertia += mass * _dot(arm, arm)
            accelerating = inertia * math.radians(model.axes[index].acceleration)
            rated.append(max(_LEAST_TORQUE, _GRAVITY_RESERVE * abs(static[index]) + _ACCELERATION_SHARE * accelerating))
        return tuple(rated)


def _centres(origins: Sequence[Vector]) -> list[Vector]:
    """Return the centre of each link in its own frame, m: halfway to the next joint.

    The forearm is one part before joint 4 and one behind it; the origin of joint 4 can be anywhere on its axis.
    """
    fore = _plus(origins[3], (0.0, 0.0, origins[4][2]))
    wrist = (0.0, 0.0, origins[4][2] - fore[2] / 4)
    return [
        _scaled(origins[1], 0.5), _scaled(origins[2], 0.5), _scaled(fore, 0.25), wrist, _scaled(origins[5], 0.5),
        _scaled(origins[5], -0.25),
    ]  # fmt: skip


def _loaded(torques: Sequence[float], posture: _Posture, wrench: Wrench) -> list[float]:
    point = _scaled(wrench.point, 1 / _METRE)
    return [
        torque - _dot(axis, _plus(_cross(_less(point, origin), wrench.force), wrench.moment))
        for torque, axis, origin in zip(torques, posture.axes, posture.origins, strict=True)
    ]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _less(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _scaled(a: Sequence[float], factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def _mixed(a: Vector, p: float, b: Vector, q: float) -> Vector:
    return (a[0] * p + b[0] * q, a[1] * p + b[1] * q, a[2] * p + b[2] * q)


def _turned(x: Vector, y: Vector, z: Vector, given: Vector) -> Vector:
    return _plus(_mixed(x, given[0], y, given[1]), _scaled(z, given[2]))
