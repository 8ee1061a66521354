"""Torques and forces of the axes of an arm: rigid-body dynamics of links that are point masses.

Neither masses nor torques of the arms are published. The mass of the arm, from its model, is distributed over the links
by fixed shares, and each link has its centre halfway to the next joint. The rated torque of an axis is derived from the
load that the axis carries when the arm is stretched out horizontally with its largest payload. All results are
estimates: they have the right signs, orders of magnitude and dependencies, not the values of a real arm. What this module
calls a torque, N m, is a force, N, for the linear axis of a SCARA.
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
_LINEAR: Final = "l"
_AXES: Final = {"six-axis": "zyyzyz", "scara": "zzlz"}  # axes of rotation, as in ArmModel; the linear one is along z
_SHARES: Final = {  # of the mass of the arm; the rest is its base
    "six-axis": (0.25, 0.2, 0.15, 0.08, 0.05, 0.02),
    "scara": (0.3, 0.25, 0.05, 0.02),
}
_STRETCHED: Final = {"six-axis": (0.0, 90.0, 0.0, 0.0, 0.0, 0.0), "scara": (0.0, 0.0, 0.0, 0.0)}
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
        rated: Rated torque of each robot axis, N m, or rated force, N.
    """

    def __init__(self, model: ArmModel) -> None:
        origins = model.origins
        reach = sum(math.dist(origin, _REST) for origin in origins[1:]) / _METRE
        mass = model.mass or DEFAULT_MASS * reach
        self._axes = _AXES[model.kind]
        self._origins = [_scaled(origin, 1 / _METRE) for origin in origins]
        self._centres = _centres_of_scara(self._origins) if model.is_scara else _centres(self._origins)
        self._masses = [mass * share for share in _SHARES[model.kind]]
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
        """Return the torques of the robot axes at ``now``, N m, from joint positions that are ``period`` s apart."""
        posture = self._posture(now)
        accelerations = self._accelerations(before, now, after, period, posture)
        turns = [
            _si(kind, a - 2 * b + c) / period**2
            for kind, a, b, c in zip(self._axes, before, now, after, strict=False)  # without extended joints
        ]
        torques = self._torques(posture, accelerations, turns)
        return torques if wrench is None else self._loaded(torques, posture, wrench)

    def holding(self, joints: Joints) -> list[float]:
        """Return the torques of the robot axes that hold arm and payload against gravity, N m."""
        posture = self._posture(joints)
        return self._torques(posture, [_REST] * len(posture.centres), [0.0] * len(self._axes))

    def _torques(self, posture: _Posture, accelerations: Sequence[Vector], turns: Sequence[float]) -> list[float]:
        masses = [*self._masses, self.payload.mass]
        forces = [
            (mass * x, mass * y, mass * (z + GRAVITY)) for mass, (x, y, z) in zip(masses, accelerations, strict=True)
        ]
        spin = self._spin(posture, turns)
        torques = []
        for index, (kind, axis, origin) in enumerate(zip(self._axes, posture.axes, posture.origins, strict=True)):
            if kind == _LINEAR:
                torques.append(sum(_dot(axis, force) for force in forces[index:]))
                continue
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
        for kind, axis, turn in zip(self._axes, posture.axes, turns, strict=True):
            if kind != _LINEAR:
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
        for index, kind in enumerate(self._axes):
            place = _plus(place, _turned(x, y, z, self._origins[index]))
            moved = _si(kind, joints[index])
            c, s = math.cos(moved), math.sin(moved)
            origins.append(place)
            if kind == _LINEAR:
                axes.append(z)
                place = _plus(place, _scaled(z, moved))
            elif kind == "z":
                axes.append(z)
                x, y = _mixed(x, c, y, s), _mixed(x, -s, y, c)
            else:
                axes.append(y)
                x, z = _mixed(x, c, z, -s), _mixed(x, s, z, c)
            centres.append(_plus(place, _turned(x, y, z, self._centres[index])))
        centres.append(_plus(place, _turned(x, y, z, _scaled(self.payload.centre, 1 / _METRE))))
        return _Posture(axes, origins, centres, (x, y, z))

    def _loaded(self, torques: Sequence[float], posture: _Posture, wrench: Wrench) -> list[float]:
        point = _scaled(wrench.point, 1 / _METRE)
        return [
            torque - _dot(axis, wrench.force)
            if kind == _LINEAR
            else torque - _dot(axis, _plus(_cross(_less(point, origin), wrench.force), wrench.moment))
            for kind, torque, axis, origin in zip(self._axes, torques, posture.axes, posture.origins, strict=True)
        ]

    def _rating(self, model: ArmModel) -> tuple[float, ...]:
        posture = self._posture(_STRETCHED[model.kind])
        static = self._torques(posture, [_REST] * len(posture.centres), [0.0] * len(self._axes))
        masses = [*self._masses, self.payload.mass]
        rated = []
        for index, (kind, axis, origin) in enumerate(zip(self._axes, posture.axes, posture.origins, strict=True)):
            inertia = sum(masses[index:]) if kind == _LINEAR else self._inertias[index]
            for mass, centre in zip(masses[index:], posture.centres[index:], strict=True):
                arm = _REST if kind == _LINEAR else _cross(axis, _less(centre, origin))
                inertia += mass * _dot(arm, arm)
            accelerating = inertia * _si(kind, model.axes[index].acceleration)
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


def _centres_of_scara(origins: Sequence[Vector]) -> list[Vector]:
    """Return the centre of each link of a SCARA in its own frame, m: of the arms halfway, of the shaft at the flange."""
    return [_scaled(origins[1], 0.5), _scaled(_plus(origins[2], origins[3]), 0.5), origins[3], _REST]


def _si(kind: str, value: float) -> float:
    """Return deg in rad, or mm of a linear axis in m."""
    return value / _METRE if kind == _LINEAR else math.radians(value)


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
