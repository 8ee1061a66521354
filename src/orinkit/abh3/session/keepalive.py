"""Timing of a keep-alive, without clock and I/O: when to repeat the command, and when to end.

A driver stops by itself if no command arrives for 500 ms (section 1, "指令ゼロ タイムアウト判定値"). This time-out protects
people if a host fails. Therefore a keep-alive continues only while the driver replies and the program is active.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, TypeVar

from orinkit.abh3.session.host import Host
from orinkit.can.frame import CanFrame, CanOperation
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import check_seconds

R = TypeVar("R")
_SHORTEST: Final = 0.001
"""Shortest period in s: one cycle of the driver."""
_LATE: Final = 1.5
"""Limit in periods. The next command is late if the last reply is older than this limit and older than the patience."""


class KeepAliveEnd(Enum):
    """The reason why a keep-alive ended."""

    SILENT = "silent"
    """The driver does not reply."""
    IDLE = "idle"
    """The program has made no call for the idle time."""


@dataclass(slots=True)
class KeepAliveTimer:
    """The timer of a keep-alive. Every argument ``now`` is a time of the same clock, in s.

    Args:
        period: Seconds between commands. A command that the program sends also restarts the period.
        patience: Seconds without a reply after which the keep-alive ends.
        idle: Seconds without a call of the program after which the keep-alive ends; ``None`` for no such limit.
        now: Time at which the keep-alive begins.

    Raises:
        InvalidValue: If an argument is not positive or exceeds one hour, or if ``period`` is below 1 ms or is not below
            ``patience``.
    """

    period: float
    patience: float
    idle: float | None
    now: float

    def __post_init__(self) -> None:
        self.period = check_seconds("period", self.period)
        if self.period < _SHORTEST:
            raise InvalidValue(
                tr(
                    "the period must be {shortest:g} s or more, not {period:g} s. Try: 0.1 s",
                    shortest=_SHORTEST,
                    period=self.period,
                )
            )
        self.patience = check_seconds("patience", self.patience)
        if self.idle is not None:
            self.idle = check_seconds("idle", self.idle)
        if self.period >= self.patience:
            raise InvalidValue(
                tr(
                    "the period of {period:g} s must be below the patience of {patience:g} s: a driver stops "
                    "by itself if no command arrives for 0.5 s (a parameter of the driver). Try: a period of 0.1 s",
                    period=self.period,
                    patience=self.patience,
                )
            )
        self._sent = self._replied = self._called = self.now

    _sent: float = 0.0
    _replied: float = 0.0
    _called: float = 0.0

    @property
    def next_time(self) -> float:
        """Time at which to repeat the command."""
        return self._sent + self.period

    def called(self, now: float) -> None:
        """Record a call of the program."""
        self._called = now

    def sent(self, now: float, *, replied: bool) -> None:
        """Record that a command was sent, by the program or by the keep-alive.

        Args:
            now: Time at which the command was sent. The time at which its reply was read may be much later, if the
                program was suspended.
            replied: True if the driver replied.
        """
        self._sent = now
        if replied:
            self._replied = now

    def end_reason_if_delayed(self, now: float) -> KeepAliveEnd | None:
        """Return the reason to end if the next command is late because this program was delayed; otherwise ``None``.

        The keep-alive calls this method before it sends the next command.
        """
        return KeepAliveEnd.SILENT if now - self._replied > max(self.patience, _LATE * self.period) else None

    def end_reason(self, now: float) -> KeepAliveEnd | None:
        """Return the reason to end now, ``None`` to continue."""
        if now - self._replied > self.patience:
            return KeepAliveEnd.SILENT
        if self.idle is not None and now - self._called > self.idle:
            return KeepAliveEnd.IDLE
        return None


def report_commands(
    operation: CanOperation[R], timer: KeepAliveTimer, host: Host[Any], clock: Callable[[], float]
) -> CanOperation[R]:
    """Run an operation, and report to the timer of a keep-alive each command to which the driver replied.

    Args:
        operation: An operation of the host.
        timer: The timer of the keep-alive.
        host: The host, which counts its commands.
        clock: The clock of the keep-alive.
    """
    received: CanFrame | None = None
    sent: float | None = None
    try:
        while True:
            before = host.commanded
            step = operation.send(received)
            if host.commanded != before:
                if sent is not None:  # a further command shows that the previous one got a reply
                    timer.sent(sent, replied=True)
                sent = clock()
                timer.called(sent)
            received = yield step
    except StopIteration as stop:
        if sent is not None:
            timer.sent(sent, replied=True)
        result: R = stop.value
        return result
    finally:
        operation.close()
