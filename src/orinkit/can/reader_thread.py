"""The thread that reads a CAN bus for an event loop that cannot watch it."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame
from orinkit.core.errors import OrinError
from orinkit.transport.link_errors import lost

_SLICE: Final = 0.25  # s after which it finds that it is to end
_BACKLOG: Final = 10_000  # frames that are kept for a loop that is not running


class BusReader(threading.Thread):
    """Reads a bus, and tells the loop that something has come.

    Args:
        bus: that nobody else reads.
        loop: that is told.
        came: is called there when there are frames, or an error.

    Attributes:
        stopping: to be set when it is to end, which it does within a fraction of a second.
        quiet: whether it has taken all that had arrived, and waits for more.
        error: that it has ended by.
    """

    def __init__(self, bus: Bus, loop: asyncio.AbstractEventLoop, came: Callable[[], None]) -> None:
        super().__init__(name=f"orinkit {bus}", daemon=True)
        self.stopping = False
        self.quiet = False
        self.error: OrinError | None = None
        self._bus = bus
        self._loop = loop
        self._came = came
        self._ended = asyncio.Event()
        self._frames: deque[CanFrame] = deque(maxlen=_BACKLOG)
        self._told = False  # the loop knows that there is something

    def run(self) -> None:
        """Read until it is told to stop, or the bus is gone."""
        frame = None
        try:
            while not self.stopping:
                self.quiet = frame is None
                frame = self._bus.receive(_SLICE if frame is None else 0.0)
                self.quiet = False
                if frame is not None:
                    self._frames.append(frame)
                    if not self._told:
                        self._told = True
                        self._post(self._came)
        except OrinError as error:
            self.error = error
            self._post(self._came)
        except Exception as error:  # noqa: BLE001 - of an adapter's driver; who waits is to know
            self.error = lost(f"{self._bus}: {error!r}")
            self._post(self._came)
        self._post(self._ended.set)

    def _post(self, call: Callable[[], None]) -> None:
        try:
            self._loop.call_soon_threadsafe(call)
        except RuntimeError:  # the loop was closed, and nobody has closed the line
            self.stopping = True

    def taken(self) -> list[CanFrame]:
        """Return what has come; is called in the loop."""
        self._told = False  # first: what comes from now on is told again
        return [self._frames.popleft() for _ in range(len(self._frames))]

    async def left(self, seconds: float) -> None:
        """Wait until it has ended, at most so many seconds."""
        try:
            async with asyncio.timeout(seconds):
                await self._ended.wait()
        except TimeoutError:  # a driver that does not come back; it is a daemon
            return
        self.join()
