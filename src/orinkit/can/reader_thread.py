"""A thread that reads a CAN bus for an event loop that cannot watch its descriptor."""

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

_SLICE: Final = 0.25  # s between checks for a stop
_BACKLOG: Final = 10_000  # frames buffered while the loop is not running


class BusReader(threading.Thread):
    """Reads a bus, and notifies the event loop of new frames.

    Args:
        bus: The bus; nothing else may read it.
        loop: The event loop to notify.
        came: Callback invoked in the loop when there are new frames or an error.

    Attributes:
        stopping: Set this to True to end the thread; it ends within a fraction of a second.
        quiet: True while the thread has read all frames that have arrived, and waits for more.
        error: The error that ended the thread; ``None`` if there was none.
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
        self._notified = False  # the loop has been notified, and has not taken the frames yet

    def run(self) -> None:
        """Read frames until the thread is stopped or the bus is lost."""
        frame = None
        try:
            while not self.stopping:
                self.quiet = frame is None
                frame = self._bus.receive(_SLICE if frame is None else 0.0)
                self.quiet = False
                if frame is not None:
                    self._frames.append(frame)
                    if not self._notified:
                        self._notified = True
                        self._post(self._came)
        except OrinError as error:
            self.error = error
            self._post(self._came)
        except Exception as error:  # noqa: BLE001 - from an adapter's driver; raised in the receivers
            self.error = lost(f"{self._bus}: {error!r}")
            self._post(self._came)
        self._post(self._ended.set)

    def _post(self, call: Callable[[], None]) -> None:
        try:
            self._loop.call_soon_threadsafe(call)
        except RuntimeError:  # the loop was closed, but not the bus
            self.stopping = True

    def take_frames(self) -> list[CanFrame]:
        """Return the new frames; called in the loop."""
        self._notified = False  # before the frames are taken, so that later frames notify the loop again
        return [self._frames.popleft() for _ in range(len(self._frames))]

    async def wait_ended(self, seconds: float) -> None:
        """Wait until the thread has ended, for at most ``seconds``."""
        try:
            async with asyncio.timeout(seconds):
                await self._ended.wait()
        except TimeoutError:  # the adapter's driver does not return; the thread does not block exiting: it is a daemon
            return
        self.join()
