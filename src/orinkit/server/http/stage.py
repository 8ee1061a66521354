"""The stages of an HTTP connection, and the timer that limits their duration."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from enum import Enum
from typing import Final

KEPT_ALIVE: Final = 75.0
"""Seconds after a response after which a connection without another request is closed."""

PROGRESS: Final = 64 * 1024
"""Number of bytes that a client must read of a response within the time of :class:`Stage`."""


class Stage(Enum):
    """State of a connection: the event that the server waits for, and the time limit for that event in s."""

    NEW = "a request", 10.0
    HEADER = "the rest of a request's header", 10.0
    BODY = "the rest of a request's body", 30.0
    WORK = "the response to a request", math.inf
    TAKING = "the client to read more of its response", 30.0
    REST = "another request", KEPT_ALIVE
    LEAVING = "the client to read its last response", 30.0

    def __init__(self, awaited: str, seconds: float) -> None:
        self.awaited = awaited
        self.seconds = seconds


class StageTimer:
    """The stage of a connection, and the timer that expires if the connection remains in it for too long.

    While the client reads its response, the time starts again whenever it has read :data:`PROGRESS` bytes.

    Args:
        loop: the event loop.
        unsent: callback that returns the number of unsent bytes of responses.
        is_queued: callback that returns True if received data waits for the server. The client is not late then.
        on_expired: callback invoked if the connection remains in its stage for too long.

    Attributes:
        stage: the present stage.
    """

    __slots__ = ("_armed", "_before", "_is_queued", "_loop", "_on_expired", "_timer", "_unsent", "_until", "stage")

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        unsent: Callable[[], int],
        is_queued: Callable[[], bool],
        on_expired: Callable[[], None],
    ) -> None:
        self.stage = Stage.NEW
        self._loop = loop
        self._unsent = unsent
        self._is_queued = is_queued
        self._on_expired = on_expired
        self._before = 0  # unsent bytes at the time from which the stage is measured
        self._until = self._armed = math.inf
        self._timer: asyncio.TimerHandle | None = None

    def enter(self, stage: Stage) -> None:
        """Enter a stage; the time limit starts again if the connection is in this stage already."""
        self.stage = stage
        self._until = self._loop.time() + stage.seconds
        self._before = self._unsent() if stage in (Stage.TAKING, Stage.LEAVING) else 0
        if self._until < self._armed:  # a timer that expires too early costs less than a new timer for each request
            self._arm()

    def cancel(self) -> None:
        """Cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()

    def _arm(self) -> None:
        self.cancel()
        self._armed = self._until
        self._timer = self._loop.call_at(self._until, self._check) if self._until < math.inf else None

    def _check(self) -> None:
        self._timer = None
        self._armed = math.inf
        if self._loop.time() < self._until:
            self._arm()
        elif self._is_queued() or self._unsent() <= self._before - PROGRESS:
            self.enter(self.stage)  # the server is late, or the client is slow, but reads its response
        else:
            self._on_expired()
