"""Counters of the use of the controller: hours of operation, and how often the motor was switched on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from orinkit.virtual.engine.control_loop import PERIOD

_MINUTE: Final = 60.0


@dataclass(slots=True)
class UsageTimes:
    """Times of use.

    Attributes:
        powered_seconds: Time since power-on, s.
        running_seconds: Time in which programs ran or the arm moved, s.
    """

    powered_seconds: float = 0.0
    running_seconds: float = 0.0

    @property
    def powered(self) -> int:
        """Time since power-on, whole minutes."""
        return int(self.powered_seconds // _MINUTE)

    @property
    def running(self) -> int:
        """Time in which programs ran or the arm moved, whole minutes."""
        return int(self.running_seconds // _MINUTE)


class Usage:
    """The counters; the control loop calls :meth:`step` in every cycle, after programs and arm.

    "Total" begins with the first start of the controller, "cumulative" with the last :meth:`reset`, and "since start"
    with the last power-on.

    Args:
        seconds: Callback that returns the controller's time, s.
        working: Callback that returns True while a program runs or the arm moves.
        motor: Callback that returns True while the motor is on.

    Attributes:
        motor_starts: How often the motor was switched on.
    """

    def __init__(self, seconds: Callable[[], float], working: Callable[[], bool], motor: Callable[[], bool]) -> None:
        self.motor_starts = 0
        self._seconds = seconds
        self._working = working
        self._motor = motor
        self._motor_on = False
        self._running = 0.0
        self._reset_at = self._started_at = (0.0, 0.0)

    @property
    def total(self) -> UsageTimes:
        """Times since the first start."""
        return UsageTimes(self._seconds(), self._running)

    @property
    def cumulative(self) -> UsageTimes:
        """Times since the last reset."""
        return self._since(self._reset_at)

    @property
    def since_start(self) -> UsageTimes:
        """Times since the last power-on."""
        return self._since(self._started_at)

    def reset(self) -> None:
        """Set the cumulative times to 0."""
        self._reset_at = self._seconds(), self._running

    def power_on(self) -> None:
        """Set the times since power-on to 0."""
        self._started_at = self._seconds(), self._running

    def step(self) -> bool:
        """Count a cycle; return False, because counting does not require further cycles."""
        if self._working():
            self._running += PERIOD
        on = self._motor()
        self.motor_starts += on and not self._motor_on
        self._motor_on = on
        return False

    def _since(self, start: tuple[float, float]) -> UsageTimes:
        return UsageTimes(self._seconds() - start[0], self._running - start[1])
