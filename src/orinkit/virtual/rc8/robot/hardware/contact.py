"""Compliant surfaces in the workspace, and the force that they exert on the tool.

A surface is a rectangular plate that yields like a spring with a damper. The tool touches it with the tip, or with a
flat disc about the tip. The force is computed from the penetration in each cycle, without the dynamics of the plate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from orinkit.arms import frames
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.engine.dynamics import Vector, Wrench

Matrix = NDArray[np.float64]

MOST_SURFACES: Final = 16
_FARTHEST: Final = 1e5  # mm, deg
_LEAST_EDGE, _LARGEST_EDGE = 0.1, 1e5  # mm
_LARGEST_RADIUS: Final = 500.0  # mm
_LEAST_STIFFNESS, _LARGEST_STIFFNESS = 1e-3, 1e3  # N/mm
_LARGEST_DAMPING: Final = 10.0  # N s/mm
_LARGEST_FRICTION: Final = 2.0
_SLIDING: Final = 1.0  # mm/s; below it, friction is proportional to the velocity
_METRE: Final = 1000.0  # mm
_RIM: Final = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


@record
class CompliantSurface:
    """A rectangular plate that yields when the tool presses on it.

    Attributes:
        pose: X, Y, Z (mm), RX, RY, RZ (deg) of the centre of the plate in the base frame; the plate is the XY plane of
            this frame, and its free side is +Z.
        size: Lengths of the edges along X and Y, mm.
        thickness: Deepest penetration, mm; a tip that is farther behind the surface does not touch it.
        stiffness: N/mm.
        damping: N s/mm.
        friction: Coefficient of sliding friction.
        radius: Radius of the flat end of the tool, mm; 0 for a point. Only a disc can transmit a moment.

    Raises:
        ValueError: If a number is out of range.
    """

    pose: tuple[float, ...]
    size: tuple[float, float] = (200.0, 200.0)
    thickness: float = 100.0
    stiffness: float = 10.0
    damping: float = 0.0
    friction: float = 0.0
    radius: float = 0.0

    def __post_init__(self) -> None:
        if len(self.pose) != 6:
            raise ValueError(tr("a surface needs six numbers: X, Y, Z in mm, RX, RY, RZ in deg"))
        for value in self.pose:
            _within(value, "pose", -_FARTHEST, _FARTHEST)
        for edge in self.size:
            _within(edge, "size", _LEAST_EDGE, _LARGEST_EDGE)
        _within(self.thickness, "thickness", _LEAST_EDGE, _LARGEST_EDGE)
        _within(self.stiffness, "stiffness", _LEAST_STIFFNESS, _LARGEST_STIFFNESS)
        _within(self.damping, "damping", 0.0, _LARGEST_DAMPING)
        _within(self.friction, "friction", 0.0, _LARGEST_FRICTION)
        _within(self.radius, "radius", 0.0, _LARGEST_RADIUS)


class _Plate:
    """A surface with its frame as plain numbers."""

    __slots__ = ("_half", "_origin", "_x", "_y", "_z", "given")

    def __init__(self, given: CompliantSurface) -> None:
        frame = frames.matrix_of_position(given.pose).tolist()
        self.given = given
        self._half = (given.size[0] / 2, given.size[1] / 2)
        self._x, self._y, self._z, self._origin = (tuple(row[column] for row in frame[:3]) for column in range(4))

    def force_at(self, point: Vector, velocity: Vector, share: float) -> Vector | None:
        """Return the force on a point of the tool, N; ``None`` if it does not touch the plate."""
        given = self.given
        away = (point[0] - self._origin[0], point[1] - self._origin[1], point[2] - self._origin[2])
        height = _dot(away, self._z)
        if not -given.thickness <= height < 0.0:
            return None
        if abs(_dot(away, self._x)) > self._half[0] or abs(_dot(away, self._y)) > self._half[1]:
            return None
        rising = _dot(velocity, self._z)
        normal = max(0.0, given.stiffness * -height - given.damping * rising) * share
        x, y = _dot(velocity, self._x), _dot(velocity, self._y)
        drag = given.friction * normal / max(math.hypot(x, y), _SLIDING)
        return (
            normal * self._z[0] - drag * (x * self._x[0] + y * self._y[0]),
            normal * self._z[1] - drag * (x * self._x[1] + y * self._y[1]),
            normal * self._z[2] - drag * (x * self._x[2] + y * self._y[2]),
        )


class Surfaces:
    """The surfaces in the workspace, by name."""

    def __init__(self) -> None:
        self._plates: dict[str, _Plate] = {}

    def __len__(self) -> int:
        return len(self._plates)

    def __iter__(self) -> Iterator[tuple[str, CompliantSurface]]:
        return iter([(name, plate.given) for name, plate in self._plates.items()])

    def place(self, name: str, surface: CompliantSurface) -> None:
        """Place a surface; another one of the same name is replaced.

        Raises:
            ValueError: If there are too many surfaces.
        """
        if name not in self._plates and len(self._plates) >= MOST_SURFACES:
            raise ValueError(tr("there are {most} surfaces already. Try: remove one of them", most=MOST_SURFACES))
        self._plates[name] = _Plate(surface)

    def remove(self, name: str) -> None:
        """Remove a surface.

        Raises:
            ValueError: If there is no surface of this name.
        """
        if self._plates.pop(name, None) is None:
            names = ", ".join(self._plates) or "-"
            raise ValueError(tr("there is no surface {name}; surfaces: {names}", name=name, names=names))

    def wrench(self, tip: Matrix, velocity: Vector) -> Wrench | None:
        """Return force and moment on the tool tip in the base frame; ``None`` if the tool touches nothing.

        Args:
            tip: Tool frame in the base frame.
            velocity: Velocity of the tip, mm/s.
        """
        rows: list[list[float]] = tip.tolist()
        point = (rows[0][3], rows[1][3], rows[2][3])
        force, moment, touched = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], False
        for plate in self._plates.values():
            for arm, share in _contacts(rows, plate.given.radius):
                found = plate.force_at((point[0] + arm[0], point[1] + arm[1], point[2] + arm[2]), velocity, share)
                if found is None:
                    continue
                touched = True
                for index in range(3):
                    after, last = (index + 1) % 3, (index + 2) % 3
                    force[index] += found[index]
                    moment[index] += (arm[after] * found[last] - arm[last] * found[after]) / _METRE
        if not touched:
            return None
        return Wrench((force[0], force[1], force[2]), (moment[0], moment[1], moment[2]), point)


def _contacts(rows: Sequence[Sequence[float]], radius: float) -> list[tuple[Vector, float]]:
    """Return the points of the tool that can touch a surface, relative to the tip, and the share of each."""
    if not radius:
        return [((0.0, 0.0, 0.0), 1.0)]
    points: list[tuple[Vector, float]] = []
    for u, v in _RIM:
        x, y, z = (radius * (u * row[0] + v * row[1]) for row in rows[:3])
        points.append(((x, y, z), 1 / len(_RIM)))
    return points


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _within(value: Any, name: str, low: float, high: float) -> None:
    if not low <= value <= high:  # rejects NaN as well
        raise ValueError(
            tr("{name} must be {low:g} to {high:g}, not {value}", name=name, low=low, high=high, value=value)
        )
