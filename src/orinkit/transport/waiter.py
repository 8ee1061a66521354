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
