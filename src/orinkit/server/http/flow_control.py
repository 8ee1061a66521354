"""Flow control for a connection of uvicorn: limits the data that is buffered while a request is in progress."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from uvicorn.protocols.http.flow_control import FlowControl

HELD: Final = 64 * 1024
"""Number of bytes received after a request in progress at which reading pauses until the response has been sent."""


class BoundedFlowControl(FlowControl):
    """Flow control that does not resume reading while the buffer is full.

    The buffer contains the data that was received after the request in progress. Reading also pauses while received
    data waits in the queue of the server (:mod:`orinkit.server.fair_queue`).

    uvicorn's own flow control resumes reading with each request and each response, even if the buffer is full.

    Args:
        transport: transport of the connection.
        held: callback that returns the number of bytes received after the request in progress.

    Attributes:
        is_queued: True if reading is paused because received data is queued.
    """

    def __init__(self, transport: asyncio.Transport, held: Callable[[], int]) -> None:
        super().__init__(transport)
        self._held = held
        self._refused = False
        self.is_queued = False

    def pause_reading(self) -> None:
        """Pause reading."""
        self._refused = False
        super().pause_reading()

    def resume_reading(self) -> None:
        """Resume reading, unless the buffer is full."""
        self._refused = self._held() >= HELD
        if not self._refused and self.read_paused:
            self.read_paused = False
            if not self.is_queued:
                self._transport.resume_reading()

    def set_queued(self, *, queued: bool) -> None:
        """Pause reading while received data is queued; then resume reading, unless it is paused for another reason."""
        if queued:
            self._transport.pause_reading()  # even if it was paused before, because uvicorn may have resumed it directly
        elif self.is_queued and not self.read_paused:
            self._transport.resume_reading()
        self.is_queued = queued

    def resume_if_possible(self) -> None:
        """Resume reading if the last :meth:`resume_reading` found the buffer full and the buffer has room now."""
        if self._refused:
            self.resume_reading()
