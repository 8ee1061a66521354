"""A vacuum pump with its cups: pressure and thermal load in the controller's 8 ms cycles.

The pressure approaches its final value exponentially. On a workpiece, the final value is proportional to the power;
without a workpiece, air leaks in. The figures are assumptions of this project; published measurements of a COBOTTA's
vacuum hand show pressures of some tens of kPa, and a load that reaches 100 % after minutes at full power.
"""

from __future__ import annotations

import math
from typing import Final

from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.rc8.hand.fingers import within

SEALED: Final = -60.0
"""Pressure on a workpiece at 100 % power, kPa relative to the atmosphere."""
LEAKING: Final = -6.0
"""Pressure without a workpiece at 100 % power, kPa."""
_RISE: Final = 0.2  # s, time constant of the pressure
_FALL: Final = 0.1  # s, time constant after the valve has opened
_HEATING: Final = 300.0  # s, time constant of the thermal load
_HOTTEST: Final = 120.0  # %, thermal load after a long time at 100 % power
_STILL: Final = 0.01  # kPa, %: smaller differences are not followed


class Vacuum:
    """A vacuum pump.

    Callers must hold the control loop; only :meth:`put` acquires it itself. An emergency stop does not switch the pump
    off, so that the hand does not drop a workpiece.

    Args:
        cycles: The control loop of the controller.
        threshold: Pressure at which a workpiece counts as held, kPa.

    Attributes:
        pressure: Pressure, kPa relative to the atmosphere.
        load: Thermal load, percent.
        power: Power, percent; 0 if the pump is off.
        covered: True if a workpiece covers the cups.
        active: True if :meth:`step` has to be called in the next cycle.
    """

    def __init__(self, cycles: ControlLoop, threshold: float = -20.0) -> None:
        self.pressure = 0.0
        self.load = 0.0
        self.power = 0.0
        self.covered = False
        self.threshold = threshold
        self.active = False
        self._cycles = cycles

    @property
    def holding(self) -> bool:
        """True while a workpiece is held."""
        return self.covered and self.pressure <= self.threshold

    def start(self, power: float) -> None:
        """Switch the pump on.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if the power is not 0 to 100 percent.
        """
        within(power, 0.0, 100.0, "%")
        self._cycles.require_open()
        self.power = power
        self._wake()

    def stop(self) -> None:
        """Switch the pump off and let air in."""
        self.power = 0.0
        self._wake()

    def put(self, covered: bool) -> None:
        """Place a workpiece on the cups, or remove it; called by tests and by users."""
        with self._cycles:
            self.covered = bool(covered)
            self._wake()

    @property
    def final(self) -> float:
        """The pressure that the pump reaches, kPa."""
        return (SEALED if self.covered else LEAKING) * self.power / 100

    def step(self) -> bool:
        """Execute one cycle; return True if pressure or load still change."""
        final, hottest = self.final, _HOTTEST * self.power / 100
        self.pressure = _approach(self.pressure, final, _RISE if self.power else _FALL)
        self.load = _approach(self.load, hottest, _HEATING)
        self.active = self.pressure != final or self.load != hottest
        return self.active

    def _wake(self) -> None:
        self.active = True
        self._cycles.wake()


def _approach(value: float, final: float, seconds: float) -> float:
    rest = (final - value) * math.exp(-PERIOD / seconds)
    return final if abs(rest) < _STILL else final - rest
