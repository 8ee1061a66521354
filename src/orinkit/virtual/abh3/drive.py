"""Both axes of a virtual ABH3, and the motors A and B that they turn."""

from __future__ import annotations

import math
from typing import Final

from orinkit.abh3.table.signals import PULSES, VELOCITY, Quantity
from orinkit.virtual.abh3.axis import FINE, AxisLimits, MotorAxis
from orinkit.virtual.abh3.parameters import Parameters

AXES: Final = ("ay", "bx")
MOTORS: Final = ("a", "b")
MOST_LOAD: Final = 255.0
"""% of the load on CAN, at most (section 3)."""

_TURN: Final = 2 * 60_000 * FINE  # of the way that an axis counts, in one revolution
_CODES: Final = 100  # of a current, in 1 %


class Drive:
    """Two axes and two motors.

    Args:
        parameters: of the driver.

    Attributes:
        axes: A/Y and B/X by ``"ay"`` and ``"bx"``.
    """

    def __init__(self, parameters: Parameters) -> None:
        limits = AxisLimits(parameters)
        self.axes = {name: MotorAxis(limits) for name in AXES}
        self._travel = parameters.model == "travel"
        self._pulses = parameters.pulses_per_revolution
        self._cleared = [0, 0]

    def run(self, cycles: int) -> None:
        """Go on by a number of cycles."""
        for axis in self.axes.values():
            axis.run(cycles)

    def clear(self, motor: str) -> None:
        """Begin to count the pulses of a motor (``"a"``, ``"b"``) from 0."""
        number = MOTORS.index(motor)
        self._cleared[number] = self._of_motors(*(axis.travelled for axis in self.axes.values()))[number]

    def pulses(self) -> tuple[int, int]:
        """The pulse counts of A and B, signed with 32 bits; they wrap."""
        ways = self._of_motors(*(axis.travelled for axis in self.axes.values()))
        a, b = (wrapped((way - start) * self._pulses // _TURN) for way, start in zip(ways, self._cleared, strict=True))
        return a, b

    def velocities(self) -> tuple[int, int]:
        """The velocities of A and B in fine units."""
        return self._of_motors(*(axis.velocity for axis in self.axes.values()))

    def torques(self) -> tuple[float, float]:
        """The currents of A and B in %."""
        a, b = self._of_motors(*(axis.current for axis in self.axes.values()))
        return a / _CODES, b / _CODES

    def loads(self) -> tuple[float, float]:
        """The loads of A and B in %, 0 to 255: how great their currents are."""
        a, b = self.torques()
        return min(abs(a), MOST_LOAD), min(abs(b), MOST_LOAD)

    def _of_motors(self, ay: int, bx: int) -> tuple[int, int]:
        return (ay + bx, ay - bx) if self._travel else (ay, bx)


def wrapped(count: int) -> int:
    """Return what is left of a count in 32 bits, signed."""
    return (count - PULSES.low) % (1 << 32) + PULSES.low


def velocity(fine: int, parts: int = 1) -> float:
    """Return a velocity in min^-1 as it is on CAN: the nearest code; beyond the last one that one.

    Args:
        fine: in fine units, times ``parts``.
        parts: 2 of the mean of two velocities.
    """
    unit = FINE // VELOCITY.steps * parts
    code = (2 * abs(fine) + unit) // (2 * unit)
    return held(VELOCITY, code if fine > 0 else -code)


def held(quantity: Quantity, code: int) -> float:
    """Return the value of a code; beyond the last one that of the last one."""
    return max(quantity.low, min(code, quantity.high)) / quantity.steps


def load(percent: float, unit: Quantity) -> float:
    """Return a load in % as it is on CAN."""
    return held(unit, math.floor(percent * unit.steps + 0.5))
