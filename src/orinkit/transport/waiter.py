"""Waiting of one task in asyncio, with a time-out."""

from __future__ import annotations

import asyncio


class AsyncWaiter:
    """Makes one task wait until it is woken, or the time has passed."""

    def __init__(self) -> None:
        self._future: asyncio.Future[None] | None = None

    async def wait(self, seconds: float) -> None:
        """Wait until :meth:`wake` is called, for at most the given seconds."""
        loop = asyncio.get_running_loop()
        self._future = loop.create_future()
        alarm = loop.call_later(seconds, self.wake)
        try:
            await self._future
        finally:
            alarm.cancel()
            self._future = None

    def wake(self) -> None:
        """Wake the waiting task, if there is one."""
        if self._future is not None and not self._future.done():
            self._future.set_result(None)


class ConnectionWaiter(AsyncWaiter):
    """An :class:`AsyncWaiter` for many waits on one connection; call :meth:`close` with the connection.

    A single timer serves all waits: it is started for the first one, and moved only when it fires, or if a wait ends
    before it would fire. Most waits therefore neither start nor cancel a timer.
    """

    def __init__(self) -> None:
        super().__init__()
        self._alarm: asyncio.TimerHandle | None = None
        self._alarm_at = 0.0
        self._end = 0.0

    async def wait(self, seconds: float) -> None:
        """Wait until :meth:`wake` is called, for at most the given seconds."""
        loop = asyncio.get_running_loop()
        end = self._end = loop.time() + seconds
        if self._alarm is None or self._alarm_at > end:
            self._set_alarm(loop)
        future = self._future = loop.create_future()
        try:
            await future
        finally:
            self._future = None

    def close(self) -> None:
        """Wake the waiting task, if there is one, and stop the timer."""
        self.wake()
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    def _set_alarm(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm_at = self._end
        self._alarm = loop.call_at(self._end, self._ring, loop)

    def _ring(self, loop: asyncio.AbstractEventLoop) -> None:
        self._alarm = None
        if self._future is None:
            return
        if loop.time() < self._end:
            self._set_alarm(loop)
        else:
            self.wake()
