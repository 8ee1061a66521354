"""Signs of life of a client in asyncio, by a task; the twin is :mod:`orinkit.transport.keepalive`."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from weakref import WeakMethod, finalize

from orinkit.core.errors import OrinError


async def atake_now(lock: asyncio.Lock) -> bool:
    """Take a lock if nobody has it; returns whether it was taken; nobody else runs meanwhile."""
    return not lock.locked() and await lock.acquire()


class AsyncKeepAlive:
    """In a task: a blocked event loop does not beat."""

    def __init__(self, beat: Callable[[], Awaitable[object]], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._task = asyncio.get_running_loop().create_task(self._run())
        self._task.add_done_callback(_forget)
        finalize(beat.__self__, _cancel, self._task)  # type: ignore[attr-defined]  # a method, as WeakMethod wants

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
        """Beat no more."""
        _cancel(self._task)


def _cancel(task: asyncio.Task[None]) -> None:
    if not task.get_loop().is_closed():
        task.cancel()


def _forget(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()
