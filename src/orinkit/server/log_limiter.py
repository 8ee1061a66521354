"""Rate limit of log messages per client: ten messages of a kind, then one every ten seconds, and a count of the rest.

:func:`install` adds one :class:`LogLimiter` to the loggers whose messages clients can cause. The limiter acts before
the log handlers of the program. Servers set :data:`CLIENT` to the client whose request they process. A kind of message
is the combination of the logger, the level, the format string (``"%s: %s"``), and the element ``kind`` that the logging
call may pass in ``extra``.
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
"""Address of the client whose request the current context processes; ``""`` if there is no client."""

LOGGERS: Final = (
    "orinkit.server", "orinkit.session", "orinkit.bcap.server", "orinkit.gateway", "orinkit.rc8", "orinkit.virtual.rc8",
    "orinkit.ve026a",
)  # fmt: skip
"""Loggers whose messages clients can cause."""

BURST: Final = 10
"""Number of messages of one kind from one client before messages are suppressed."""
INTERVAL: Final = 10.0
"""Seconds after which one more message is allowed, and after which the number of suppressed messages is logged."""

_MAX_KINDS: Final = 1024  # number of combinations of client and kind with their own count; further clients share counts
_REPORT: Final = "throttle_report"

_Key: TypeAlias = tuple[str, str, int, str, str]  # client, logger, level, message, kind


class _Timer(Protocol):
    def cancel(self) -> None: ...


@dataclass(slots=True)
class _MessageCount:
    """Token bucket of one kind of message from one client."""

    left: float
    at: float
    suppressed: int = 0
    sample: str = ""


class LogLimiter(logging.Filter):
    """Passes :data:`BURST` messages of each kind from each client, then one per :data:`INTERVAL`.

    Args:
        clock: callback that returns the time in s.
        later: callback that schedules a function to be called after a number of seconds, and returns a timer. By
            default, the function is called in a thread.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        later: Callable[[float, Callable[[], None]], _Timer] | None = None,
    ) -> None:
        super().__init__()
        self._clock = clock
        self._later = later or _thread_timer
        self._lock = threading.Lock()
        self._counts: dict[_Key, _MessageCount] = {}  # the least recently used count first
        self._timer: _Timer | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Return True if the record is to be written."""
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
        if count is None and len(self._counts) >= _MAX_KINDS and not self._discard_quiet(now):
            key = ("", *key[1:])
            count = self._counts.pop(key, None)
        if count is None:
            count = _MessageCount(BURST, now)
        self._counts[key] = count
        return count

    def _discard_quiet(self, now: float) -> bool:
        """Discard the least recently used count and return True; if that count is still required, return False."""
        key, count = next(iter(self._counts.items()))
        quiet = not count.suppressed and count.left + (now - count.at) / INTERVAL >= BURST
        if quiet:
            del self._counts[key]
        return quiet

    def report(self) -> None:
        """Log how many messages have been suppressed since the last report."""
        with self._lock:
            timer, self._timer = self._timer, None
            reports = [
                (key[1], key[2], count.suppressed, count.sample)
                for key, count in self._counts.items()
                if count.suppressed
            ]
            for count in self._counts.values():
                count.suppressed = 0
        if timer is not None:
            timer.cancel()
        one, several = tr("%s similar message suppressed: %s"), tr("%s similar messages suppressed: %s")
        for name, level, suppressed, sample in reports:
            logging.getLogger(name).log(
                level,
                one if suppressed == 1 else several,
                f"{suppressed:,}",
                sample,
                extra={_REPORT: True},
            )

    def forget(self) -> None:
        """Reset all counts without reporting suppressed messages."""
        with self._lock:
            timer, self._timer = self._timer, None
            self._counts.clear()
        if timer is not None:
            timer.cancel()


def _first_line(record: logging.LogRecord) -> str:
    try:
        return record.getMessage().partition("\n")[0]
    except Exception:  # noqa: BLE001 - if the arguments do not match the format, the handlers report it
        return str(record.msg)


def _thread_timer(seconds: float, function: Callable[[], None]) -> _Timer:
    timer = threading.Timer(seconds, function)
    timer.name = "orinkit-throttle"
    timer.daemon = True
    timer.start()
    return timer


LOG_LIMITER: Final = LogLimiter()
"""The limiter of all servers in this process."""


def install() -> None:
    """Add :data:`LOG_LIMITER` to :data:`LOGGERS`; further calls do nothing."""
    for name in LOGGERS:
        logging.getLogger(name).addFilter(LOG_LIMITER)
