"""Signs of life of a client: something that is done again and again beside the program, in a thread or in a task.

A pulse does not keep alive what it belongs to, and ends with it.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from weakref import WeakMethod, finalize

from orinkit.errors import OrinError


def take_now(lock: threading.RLock) -> bool:
    """Take a lock if nobody else has it; returns whether it was taken."""
    return lock.acquire(blocking=False)


async def atake_now(lock: asyncio.Lock) -> bool:
    """The same in asyncio; nobody else runs meanwhile."""
    return not lock.locked() and await lock.acquire()


class Pulse:
    """In a daemon thread of its own.

    Args:
        beat: a method; it may wait. What it fails with is for the program's next call to find out.
        every: seconds from one beat to the next.
    """

    def __init__(self, beat: Callable[[], object], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._ended = threading.Event()
        finalize(beat.__self__, self._ended.set)  # type: ignore[attr-defined]
        threading.Thread(target=self._run, name="orinkit-pulse", daemon=True).start()

    def _run(self) -> None:
        while not self._ended.wait(self._every):
            beat = self._beat()
            if beat is None:
                return
            try:
                beat()
            except OrinError:
                pass
            del beat

    def end(self) -> None:
        """Beat no more."""
        self._ended.set()


class AsyncPulse:
    """In a task: a blocked event loop does not beat."""

    def __init__(self, beat: Callable[[], Awaitable[object]], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._task = asyncio.get_running_loop().create_task(self._run())
        self._task.add_done_callback(_forget)
        finalize(beat.__self__, _cancel, self._task)  # type: ignore[attr-defined]

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
