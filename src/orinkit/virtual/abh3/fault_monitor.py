"""Errors and warnings of a virtual ABH3: time-outs, faults that are raised, and the reset. Times are in cycles of 1 ms."""

from __future__ import annotations

from typing import Final

from orinkit.virtual.abh3.flags import COMMUNICATION
from orinkit.virtual.abh3.parameters import Parameters

RESET_CYCLES: Final = 1
"""Cycles between the edge that resets errors and the reset."""


class FaultMonitor:
    """What is wrong with a driver.

    Args:
        parameters: its time-outs.

    Attributes:
        errors: latched.
        warnings: those of now.
        causes: errors whose cause stays, so that they cannot be reset.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.errors = 0
        self.warnings = 0
        self.causes = 0
        self._fed = 0
        self._reset_at: int | None = None
        self.set(parameters)

    def set(self, parameters: Parameters) -> None:
        """Take other time-outs."""
        self._command_timeout = parameters.command_timeout
        self._error_timeout = parameters.error_timeout

    @property
    def late(self) -> bool:
        """Whether the host was silent for too long: start is as good as off."""
        return self.warnings & COMMUNICATION != 0

    def feed(self, cycle: int) -> None:
        """The host has sent a command. A warning ends with it, unless it has become an error."""
        self._fed = cycle
        if not self.errors & COMMUNICATION:
            self.warnings &= ~COMMUNICATION

    def reset(self, cycle: int) -> None:
        """Errors and warnings are to be reset; that takes a cycle, so that a request right behind still sees them."""
        if self._reset_at is None:
            self._reset_at = cycle + RESET_CYCLES

    def next(self) -> int | None:
        """Return the cycle in which something happens by itself, ``None`` for never; it may be over already."""
        times = [self._reset_at] if self._reset_at is not None else []
        if self._command_timeout and not self.warnings & COMMUNICATION:
            times.append(self._fed + self._command_timeout)
        if self._error_timeout and not self.errors & COMMUNICATION:
            times.append(self._fed + self._error_timeout)
        return min(times, default=None)

    def at(self, cycle: int) -> None:
        """Let happen what does in a cycle."""
        warn = self._is_over(self._command_timeout, cycle)
        fail = self._is_over(self._error_timeout, cycle)
        if self._reset_at is not None and cycle >= self._reset_at:
            self._reset_at = None
            self.errors = self.causes
            self.warnings = 0
        self.warnings |= COMMUNICATION if warn else 0
        self.errors |= COMMUNICATION if fail else 0

    def _is_over(self, timeout: int, cycle: int) -> bool:
        return timeout > 0 and cycle - self._fed >= timeout
