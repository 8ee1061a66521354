"""Keep-alives of a client in asyncio; the synchronous counterpart is :mod:`orinkit.transport.keepalive`."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from weakref import WeakMethod, finalize

from orinkit.core.errors import OrinError


async def atry_acquire(lock: asyncio.Lock) -> bool:
    """Acquire a lock if it is free, without yielding to other tasks; return True if it was acquired."""
    return not lock.locked() and await lock.acquire()


class AsyncKeepAlive:
    """Calls a coroutine method at a fixed interval, in a task; while the event loop is blocked, there are no calls."""

    def __init__(self, beat: Callable[[], Awaitable[object]], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._task = asyncio.get_running_loop().create_task(self._run())
        self._task.add_done_callback(_forget)
        finalize(beat.__self__, _cancel, self._task)  # type: ignore[attr-defined]  # WeakMethod requires a method

    async def _run(self) -> None:
        while True:
            await asyncio.sleep(self._every)
            beat = self._beat()
            if beat is None:
                return
            try:
                await beat()
            except OrinError:
                pass
            del beat

    def end(self) -> None:
        """Stop the calls."""
        _cancel(self._task)


def _cancel(task: asyncio.Task[None]) -> None:
    if not task.get_loop().is_closed():
        task.cancel()


def _forget(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()
