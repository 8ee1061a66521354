"""Detection of the end of a connection from which the server does not read at the moment.

An event loop detects that a client has disconnected only while it reads. The server stops reading while received
requests are queued, and while a call of the client is being computed. A client that is lost meanwhile would not be
noticed, and its arm would continue to move.
"""

from __future__ import annotations

import asyncio
import select
from collections.abc import Callable
from typing import Final

INTERVAL: Final = 0.1
"""Time in s between two checks while reading is paused."""

_ENDED: Final = getattr(select, "POLLRDHUP", 0)  # the peer sends no more, even if received data has not been read yet
_BROKEN: Final = getattr(select, "POLLERR", 0) | getattr(select, "POLLHUP", 0)


class EndWatch:
    """Detects the end of one connection while reading is paused, on systems that report it (Linux).

    Args:
        loop: the event loop of the connection.
        transport: the transport of the connection.
        is_needed: callback that returns True while the connection is to be watched.
        on_end: callback that is invoked when the client has closed the connection, or it is broken; it is invoked again
            after :data:`INTERVAL` if the connection is still to be watched.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        transport: asyncio.Transport,
        is_needed: Callable[[], bool],
        on_end: Callable[[], object],
    ) -> None:
        self._loop = loop
        self._is_needed = is_needed
        self._on_end = on_end
        self._timer: asyncio.TimerHandle | None = None
        self._poll = _poll_of(transport)

    def start(self) -> None:
        """Begin to watch, after reading was paused; does nothing if the connection is being watched."""
        if self._timer is None and self._poll is not None:
            self._timer = self._loop.call_later(INTERVAL, self._check)

    def close(self) -> None:
        """Stop watching."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._poll = None

    def _check(self) -> None:
        self._timer = None
        if self._poll is None or not self._is_needed():
            return
        if self._poll.poll(0):
            self._on_end()
        self.start()


def _poll_of(transport: asyncio.Transport) -> select.poll | None:
    """Return an object that reports the end of a connection; ``None`` if the system or the transport has none."""
    opened = transport.get_extra_info("socket")
    if not _ENDED or opened is None:
        return None
    poll = select.poll()
    poll.register(opened.fileno(), _ENDED | _BROKEN)
    return poll
