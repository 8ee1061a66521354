"""Flow control for a connection of uvicorn that limits the data buffered behind a request."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from uvicorn.protocols.http.flow_control import FlowControl

HELD: Final = 64 * 1024
"""Bytes buffered behind a request in progress; from this number on, reading pauses until the response is sent."""


class BoundedFlowControl(FlowControl):
    """Flow control that does not resume reading while the buffer is full; uvicorn resumes with each request and response.

    Args:
        transport: transport of the connection.
        held: returns the number of bytes buffered behind a request.
    """

    def __init__(self, transport: asyncio.Transport, held: Callable[[], int]) -> None:
        super().__init__(transport)
        self._held = held
        self._refused = False

    def pause_reading(self) -> None:
        """Pause reading."""
        self._refused = False
        super().pause_reading()

    def resume_reading(self) -> None:
        """Resume reading, unless the buffer is full."""
        self._refused = self._held() >= HELD
        if not self._refused:
            super().resume_reading()

    def resume_if_possible(self) -> None:
        """Resume reading if that was refused before and the buffer has room now."""
        if self._refused:
            self.resume_reading()
