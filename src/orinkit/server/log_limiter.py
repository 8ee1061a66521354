"""How much log one client can cause: ten messages of a kind, then one in ten seconds, and how many were left out.

:func:`install` puts one :class:`LogLimiter` on the loggers that a client's calls reach, whatever handlers the program has.
Servers say with :data:`CLIENT` on whose behalf something is being done. A kind is a logger with a message as it is written
in the source, ``"%s: %s"``, and the record's ``kind`` where the call gave one in ``extra``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

from orinkit.core.i18n import printable, tr

CLIENT: Final[ContextVar[str]] = ContextVar("client", default="")
"""Address of the client for whom something is being done; ``""`` where it is done for nobody in particular."""

LOGGERS: Final = (
    "orinkit.server", "orinkit.session", "orinkit.bcap.server", "orinkit.gateway", "orinkit.rc8", "orinkit.virtual.rc8",
    "orinkit.ve026a",
)  # fmt: skip
"""Loggers whose records a client can cause."""

BURST: Final = 10
"""Messages of one kind that one client causes before any is left out."""
INTERVAL: Final = 10.0
"""Seconds for one more message; and after which it is told how many were left out."""

_MOST_KINDS: Final = 1024  # that are counted apart; those of all further clients count together
_REPORT: Final = "throttle_report"

_Key: TypeAlias = tuple[str, str, int, str, str]  # client, logger, level, message, kind


class _Timer(Protocol):
    def cancel(self) -> None: ...


@dataclass(slots=True)
class _MessageCount:
    """What is known of one kind of message of one client."""

    left: float
    at: float
    suppressed: int = 0
    sample: str = ""


class LogLimiter(logging.Filter):
    """Lets a burst of each kind of message of each client through, then one in :data:`INTERVAL` seconds.

    Args:
        clock: returns the time, s.
        later: calls a function after some seconds.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        later: Callable[[float, Callable[[], None]], _Timer] | None = None,
    ) -> None:
        super().__init__()
        self._clock = clock
        self._later = later or _in_a_thread
        self._lock = threading.Lock()
        self._counts: dict[_Key, _MessageCount] = {}  # the one that has been quiet longest first
        self._timer: _Timer | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is to be written."""
        if _REPORT in record.__dict__:
            return True
        now = self._clock()
        with self._lock:
            count = self._count(record, now)
            count.left = min(BURST, count.left + (now - count.at) / INTERVAL)
            count.at = now
            if count.left >= 1:
                count.left -= 1
                count.sample = printable(_first_line(record))
                return True
            count.suppressed += 1
            if self._timer is None:
                self._timer = self._later(INTERVAL, self.report)
        return False

    def _count(self, record: logging.LogRecord, now: float) -> _MessageCount:
        kind = str(getattr(record, "kind", ""))
        key = (CLIENT.get(), record.name, record.levelno, str(record.msg), kind)
        count = self._counts.pop(key, None)
        if count is None and len(self._counts) >= _MOST_KINDS and not self._forget_quiet(now):
            key = ("", *key[1:])
            count = self._counts.pop(key, None)
        if count is None:
            count = _MessageCount(BURST, now)
        self._counts[key] = count
        return count

    def _forget_quiet(self, now: float) -> bool:
        """Forget the kind that has been quiet longest; False where even that one counts still."""
        key, count = next(iter(self._counts.items()))
        quiet = not count.suppressed and count.left + (now - count.at) / INTERVAL >= BURST
        if quiet:
            del self._counts[key]
        return quiet

    def report(self) -> None:
        """Log how many messages have been left out since it was said last."""
        with self._lock:
            timer, self._timer = self._timer, None
            told = [
                (key[1], key[2], count.suppressed, count.sample)
                for key, count in self._counts.items()
                if count.suppressed
            ]
            for count in self._counts.values():
                count.suppressed = 0
        if timer is not None:
            timer.cancel()
        for name, level, suppressed, sample in told:
            logging.getLogger(name).log(
                level,
                tr("%s similar messages suppressed: %s"),
                f"{suppressed:,}",
                sample,
                extra={_REPORT: True},
            )

    def forget(self) -> None:
        """Begin anew; what was left out is not told."""
        with self._lock:
            timer, self._timer = self._timer, None
            self._counts.clear()
        if timer is not None:
            timer.cancel()


def _first_line(record: logging.LogRecord) -> str:
    try:
        return record.getMessage().partition("\n")[0]
    except Exception:  # noqa: BLE001 - arguments that do not fit are for whoever writes the record to tell of
        return str(record.msg)


def _in_a_thread(seconds: float, function: Callable[[], None]) -> _Timer:
    timer = threading.Timer(seconds, function)
    timer.name = "orinkit-throttle"
    timer.daemon = True
    timer.start()
    return timer


THROTTLE: Final = LogLimiter()
"""That of all servers of the process."""


def install() -> None:
    """Have :data:`THROTTLE` watch the loggers whose records a client can cause; again does nothing."""
    for name in LOGGERS:
        logging.getLogger(name).addFilter(THROTTLE)
