"""Errors and warnings of a virtual ABH3: time-outs, injected faults, and the reset. Times are in cycles of 1 ms."""

from __future__ import annotations

from typing import Final

from orinkit.virtual.abh3.flags import COMMUNICATION
from orinkit.virtual.abh3.parameters import Parameters

RESET_CYCLES: Final = 1
"""Number of cycles from the rising edge of the reset input to the reset of the errors."""


class FaultMonitor:
    """Tracks the errors and warnings of a driver.

    Args:
        parameters: Parameters of the driver; only the two time-outs are used.

    Attributes:
        errors: Latched errors, as bits.
        warnings: Present warnings, as bits.
        causes: Errors that cannot be reset because their cause remains, as bits.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.errors = 0
        self.warnings = 0
        self.causes = 0
        self._fed = 0
        self._reset_at: int | None = None
        self.set(parameters)

    def set(self, parameters: Parameters) -> None:
        """Replace the time-outs by those of ``parameters``."""
        self._command_timeout = parameters.command_timeout
        self._error_timeout = parameters.error_timeout

    @property
    def late(self) -> bool:
        """True if the command time-out has expired, so that the control flag ``start`` has no effect."""
        return self.warnings & COMMUNICATION != 0

    def feed(self, cycle: int) -> None:
        """Restart the time-outs after a command of the host.

        This also clears the communication warning, unless the communication error is latched.
        """
        self._fed = cycle
        if not self.errors & COMMUNICATION:
            self.warnings &= ~COMMUNICATION

    def reset(self, cycle: int) -> None:
        """Reset errors and warnings one cycle after ``cycle``; frames sent until then still contain them."""
        if self._reset_at is None:
            self._reset_at = cycle + RESET_CYCLES

    def next(self) -> int | None:
        """Return the cycle of the next time-out or reset, which may be in the past; ``None`` for never."""
        times = [self._reset_at] if self._reset_at is not None else []
        if self._command_timeout and not self.warnings & COMMUNICATION:
            times.append(self._fed + self._command_timeout)
        if self._error_timeout and not self.errors & COMMUNICATION:
            times.append(self._fed + self._error_timeout)
        return min(times, default=None)

    def advance(self, cycle: int) -> None:
        """Process time-outs and the reset that are due in a cycle."""
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
