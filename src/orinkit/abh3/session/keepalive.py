"""When a keep-alive sends the command again, and when it ends: without clock and I/O.

A driver stops by itself when no command has come for 500 ms (section 1, "指令ゼロ タイムアウト判定値"). That is what protects people from
a host that has died, so a keep-alive goes on only while the driver answers and somebody is there who wants it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, TypeVar

from orinkit.abh3.session.host import Host
from orinkit.abh3.table.checks import check_seconds
from orinkit.can.frame import CanFrame, CanOperation
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

R = TypeVar("R")
_SHORTEST: Final = 0.001
"""s: a cycle of the driver."""
_LATE: Final = 1.5
"""Periods after which a command was too late, where these are longer than the patience."""


class KeepAliveEnd(Enum):
    """Why a keep-alive has ended."""

    SILENT = "silent"
    """The driver does not answer."""
    IDLE = "idle"
    """The program has not called for too long."""


@dataclass(slots=True)
class KeepAliveTimer:
    """The times of a keep-alive; every ``now`` is in s of one clock.

    Args:
        period: s between commands; a command of the program counts too.
        patience: s without an answer after which it ends.
        idle: s without a call of the program after which it ends; ``None`` for never.
        now: when it begins.

    Raises:
        InvalidValue: a number is not positive and finite, the period below 1 ms, or not below the patience.
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
                    "the period is {shortest:g} s or more, not {period:g}. Try: 0.1 s",
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
                    "the period of {period:g} s is not below the patience of {patience:g} s: a driver stops "
                    "by itself when no command has come for 0.5 s (its parameter). Try: a period of 0.1 s",
                    period=self.period,
                    patience=self.patience,
                )
            )
        self._sent = self._answered = self._called = self.now

    _sent: float = 0.0
    _answered: float = 0.0
    _called: float = 0.0

    @property
    def due(self) -> float:
        """When the command is to be sent again."""
        return self._sent + self.period

    def called(self, now: float) -> None:
        """The program calls."""
        self._called = now

    def sent(self, now: float, *, answered: bool) -> None:
        """A command was sent, by the program or by the keep-alive.

        Args:
            now: when it was sent; not when its answer was read, which may be much later where the program stood still.
            answered: whether an answer came.
        """
        self._sent = now
        if answered:
            self._answered = now

    def too_late(self, now: float) -> KeepAliveEnd | None:
        """Return why it is to end before anything is sent: it was held up itself, by a program or a system that stood still."""
        return KeepAliveEnd.SILENT if now - self._answered > max(self.patience, _LATE * self.period) else None

    def end(self, now: float) -> KeepAliveEnd | None:
        """Return why it is to end now, ``None`` if it goes on."""
        if now - self._answered > self.patience:
            return KeepAliveEnd.SILENT
        if self.idle is not None and now - self._called > self.idle:
            return KeepAliveEnd.IDLE
        return None


def watched(
    operation: CanOperation[R], heart: KeepAliveTimer, host: Host[Any], clock: Callable[[], float]
) -> CanOperation[R]:
    """Carry out an operation, and tell a keep-alive of each command of it that was answered, however many there are.

    Args:
        operation: of the host.
        heart: is told.
        host: counts its commands.
        clock: of the keep-alive.
    """
    received: CanFrame | None = None
    sent: float | None = None
    try:
        while True:
            before = host.commanded
            turn = operation.send(received)
            if host.commanded != before:
                if sent is not None:  # it would not go on without an answer
                    heart.sent(sent, answered=True)
                sent = clock()
                heart.called(sent)
            received = yield turn
    except StopIteration as stop:
        if sent is not None:
            heart.sent(sent, answered=True)
        result: R = stop.value
        return result
    finally:
        operation.close()
