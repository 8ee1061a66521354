"""Both axes of a virtual ABH3, and the motors A and B driven by them."""

from __future__ import annotations

import math
from typing import Final

from orinkit.abh3.table.signals import PULSES, VELOCITY, Quantity
from orinkit.virtual.abh3.axis import FINE, AxisLimits, MotorAxis
from orinkit.virtual.abh3.parameters import Parameters

AXES: Final = ("ay", "bx")
MOTORS: Final = ("a", "b")
MOST_LOAD: Final = 255.0
"""Largest load that a driver reports on CAN, % (section 3 of the manufacturer's document)."""

_REVOLUTION: Final = 2 * 60_000 * FINE  # one revolution in units of MotorAxis.travelled
_CODES: Final = 100  # codes of a current per 1 %


class Drive:
    """Two axes and two motors.

    Args:
        parameters: Parameters of the driver.

    Attributes:
        axes: The axes A/Y and B/X, with the keys ``"ay"`` and ``"bx"``.
    """

    def __init__(self, parameters: Parameters) -> None:
        limits = AxisLimits(parameters)
        self.axes = {name: MotorAxis(limits) for name in AXES}
        self._travel = parameters.model == "travel"
        self._pulses = parameters.pulses_per_revolution
        self._cleared = [0, 0]

    def run(self, cycles: int) -> None:
        """Run a number of cycles."""
        for axis in self.axes.values():
            axis.run(cycles)

    def clear(self, motor: str) -> None:
        """Reset the pulse count of a motor (``"a"``, ``"b"``) to 0."""
        number = MOTORS.index(motor)
        self._cleared[number] = self._of_motors(*(axis.travelled for axis in self.axes.values()))[number]

    def pulses(self) -> tuple[int, int]:
        """Return the pulse counts of the motors A and B, wrapped to signed 32 bits."""
        distances = self._of_motors(*(axis.travelled for axis in self.axes.values()))
        a, b = (
            wrapped((distance - start) * self._pulses // _REVOLUTION)
            for distance, start in zip(distances, self._cleared, strict=True)
        )
        return a, b

    def velocities(self) -> tuple[int, int]:
        """Return the velocities of the motors A and B in fine units (:data:`~orinkit.virtual.abh3.axis.FINE`)."""
        return self._of_motors(*(axis.velocity for axis in self.axes.values()))

    def currents(self) -> tuple[float, float]:
        """Return the currents of the motors A and B in % of the rated current."""
        a, b = self._of_motors(*(axis.current for axis in self.axes.values()))
        return a / _CODES, b / _CODES

    def loads(self) -> tuple[float, float]:
        """Return the loads of the motors A and B in %, 0 to 255: the absolute values of their currents."""
        a, b = self.currents()
        return min(abs(a), MOST_LOAD), min(abs(b), MOST_LOAD)

    def _of_motors(self, ay: int, bx: int) -> tuple[int, int]:
        return (ay + bx, ay - bx) if self._travel else (ay, bx)


def wrapped(count: int) -> int:
    """Return a count wrapped to signed 32 bits."""
    return (count - PULSES.low) % (1 << 32) + PULSES.low


def velocity(fine: int, parts: int = 1) -> float:
    """Return a velocity in min^-1, rounded and limited to the values that a frame can contain.

    Args:
        fine: Velocity in fine units (:data:`~orinkit.virtual.abh3.axis.FINE`), multiplied by ``parts``.
        parts: Divisor of ``fine``: 2 for the mean of two velocities.
    """
    unit = FINE // VELOCITY.steps * parts
    code = (2 * abs(fine) + unit) // (2 * unit)
    return held(VELOCITY, code if fine > 0 else -code)


def held(quantity: Quantity, code: int) -> float:
    """Return the value that a code on CAN represents; the code is first limited to the range of the quantity."""
    return max(quantity.low, min(code, quantity.high)) / quantity.steps


def load(percent: float, unit: Quantity) -> float:
    """Return a load in %, rounded and limited to the values that a frame with the given unit of loads can contain."""
    return held(unit, math.floor(percent * unit.steps + 0.5))
