"""The parameter tables of force control (RC8 provider guide, ForceParam)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, TypeAlias

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record

Six: TypeAlias = tuple[float, float, float, float, float, float]
"""Values for X, Y, Z and for the rotations about X, Y, Z."""

TABLES: Final = 10
COMPLIANCE, SENSOR, FOLLOWING = 0, 1, 2
BASE, TOOL, WORK = 0, 1, 2

_ZERO: Final[Six] = (0.0,) * 6
_LARGEST: Final = 1e6
_LARGEST_RATE: Final = 100.0
_LEAST_RESISTANCE: Final = 1e-4  # N s/mm, N m s/deg: without any, a force would cause an infinite velocity


@record
class ForceParameters:
    """One parameter table.

    The units of spring, damping and mass are assumptions of this project.

    Attributes:
        coordinates: 0 base, 1 tool, 2 work: the axes of all vectors.
        force: N, N m. With compliance, the largest force with which the arm resists; with the force sensor, the force
            that the tool exerts.
        position_deviation: Largest displacement of the tool tip, mm, deg; a larger one is an error.
        spring: Force that pulls the tool back to the commanded pose, N/mm, N m/deg.
        damping: Resistance to the velocity, N s/mm, N m s/deg.
        mass: Resistance to the acceleration, kg, kg m^2.
        current_limit: Largest motor current of each axis while force control is on, %.
        offset: Force that is added to the measured one, N, N m.
        axis_deviation: Largest displacement of each axis, deg, or mm of a linear axis; a larger one is an error.
        mode: 0 compliance, 1 force sensor, 2 following of external forces.
        rate: Share of the force that is controlled, %; 0 keeps the arm rigid in this direction.
        translation: Largest velocity of the displacement, mm/s.
        rotation: Largest velocity of the displacement, deg/s.
    """

    coordinates: int = BASE
    force: Six = _ZERO
    position_deviation: Six = (100.0, 100.0, 100.0, 45.0, 45.0, 45.0)
    spring: Six = _ZERO
    damping: Six = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    mass: Six = (1.0, 1.0, 1.0, 0.01, 0.01, 0.01)
    current_limit: tuple[float, ...] = (100.0,) * 8
    offset: Six = _ZERO
    axis_deviation: tuple[float, ...] = (45.0,) * 8
    mode: int = COMPLIANCE
    rate: Six = (100.0,) * 6
    translation: float = 100.0
    rotation: float = 30.0

    def __post_init__(self) -> None:
        _require(self.coordinates in (BASE, TOOL, WORK), "coordinates", self.coordinates)
        _require(self.mode in (COMPLIANCE, SENSOR, FOLLOWING), "mode", self.mode)
        for name, values, low, high in (
            ("force", self.force, -_LARGEST, _LARGEST),
            ("position deviation", self.position_deviation, 0.0, _LARGEST),
            ("spring", self.spring, 0.0, _LARGEST),
            ("damping", self.damping, 0.0, _LARGEST),
            ("mass", self.mass, 0.0, _LARGEST),
            ("current limit", self.current_limit, 1.0, 100.0),
            ("offset", self.offset, -_LARGEST, _LARGEST),
            ("axis deviation", self.axis_deviation, 0.0, _LARGEST),
            ("rate", self.rate, 0.0, _LARGEST_RATE),
            ("translation", (self.translation,), 0.0, _LARGEST),
            ("rotation", (self.rotation,), 0.0, _LARGEST),
        ):
            for value in values:
                _require(low <= value <= high, name, value)

    def resistance(self, index: int) -> float:
        """Return the damping of an axis, which is never 0."""
        return max(self.damping[index], _LEAST_RESISTANCE)


@dataclass(slots=True)
class ForceTables:
    """The ten parameter tables."""

    _tables: dict[int, ForceParameters] = field(default_factory=dict)

    def table(self, number: int) -> ForceParameters:
        """Return a table.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it does not exist.
        """
        return self._tables.get(check_table(number)) or ForceParameters()

    def set_table(self, number: int, parameters: ForceParameters) -> None:
        """Set a table.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it does not exist.
        """
        self._tables[check_table(number)] = parameters


def check_table(number: int) -> int:
    """Return the number of a parameter table after checking it.

    Raises:
        CallError: VALUE_OUT_OF_RANGE.
    """
    if not 1 <= number <= TABLES:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("parameter table {number} does not exist; tables: 1 to {most}", number=number, most=TABLES),
        )
    return number


def _require(valid: bool, name: str, value: float) -> None:
    if not valid:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE, tr("{name} of force control: {value:g} is out of range", name=name, value=value)
        )
