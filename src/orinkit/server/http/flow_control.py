"""When a connection of uvicorn is read, so that what waits behind a request is bounded."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from uvicorn.protocols.http.flow_control import FlowControl

HELD: Final = 64 * 1024
"""Bytes behind a request that is at work; where there are so many, no more are read until it has been answered."""


class BoundedFlowControl(FlowControl):
    """Does not read on while enough is kept, whoever asks: uvicorn does with each request and with each answer.

    Args:
        transport: of the connection.
        held: tells how many bytes are kept behind a request.
    """

    def __init__(self, transport: asyncio.Transport, held: Callable[[], int]) -> None:
        super().__init__(transport)
        self._held = held
        self._refused = False

    def pause_reading(self) -> None:
        """Read no more."""
        self._refused = False
        super().pause_reading()

    def resume_reading(self) -> None:
        """Read on, as soon as there is room for what comes."""
        self._refused = self._held() >= HELD
        if not self._refused:
            super().resume_reading()

    def look(self) -> None:
        """Read on if that was refused and there is room now."""
        if self._refused:
            self.resume_reading()
