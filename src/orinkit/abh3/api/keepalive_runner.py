"""Periodic calls for keep-alives: from a thread, or from an asyncio task.

The calls end with the program: the thread is a daemon. It also ends when the thread that started it ends, when the main
thread ends, or when the driver object is garbage collected. A process that is stopped or killed sends nothing. The
periodic sending of some CAN interfaces is not used, because it would continue while the program hangs.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from typing import TypeAlias
from weakref import WeakMethod

Beat: TypeAlias = Callable[[], float | None]
"""Function that sends a command if it is due; returns the seconds until the next call, or ``None`` to end the calls."""
AsyncBeat: TypeAlias = Callable[[], Awaitable[float | None]]
_JOIN_TIMEOUT = 2.0


class PeriodicCall:
    """Calls a method periodically from its own thread.

    Args:
        beat: The method to call; the calls end when its object is garbage collected.
        ended: Method that is called if the calls end although :meth:`stop` was not called and ``beat`` did not return
            ``None``.
        name: Name of the thread.
    """

    def __init__(self, beat: Beat, ended: Callable[[], None], name: str) -> None:
        self._beat = WeakMethod(beat)
        self._ended = WeakMethod(ended)
        self._owner = threading.current_thread()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the calls. The last call may still be in progress when this method returns."""
        self._stopped.set()

    def join(self) -> None:
        """Wait until the thread has ended, at most 2 s; if called in this thread, return immediately."""
        if self._thread is not threading.current_thread():
            self._thread.join(_JOIN_TIMEOUT)

    def _run(self) -> None:
        pause: float | None = 0.0
        try:
            while pause is not None and not self._stopped.wait(pause):
                beat = self._beat()
                if beat is None or not self._owner.is_alive() or not threading.main_thread().is_alive():
                    break
                pause = beat()
                del beat  # so that the object can be garbage collected during the wait
        finally:
            if pause is not None and not self._stopped.is_set():
                _notify(self._ended)


class AsyncPeriodicCall:
    """Calls a coroutine method periodically from a task of the running event loop; see :class:`PeriodicCall`."""

    def __init__(self, beat: AsyncBeat, ended: Callable[[], None], name: str) -> None:
        self._beat = WeakMethod(beat)
        self._ended = WeakMethod(ended)
        self._stopped = False
        self._task = asyncio.get_running_loop().create_task(self._run(), name=name)
        self._task.add_done_callback(self._done)  # also called if the task is cancelled before it starts

    def stop(self) -> None:
        """Stop the calls."""
        self._stopped = True
        if self._task is not _current_task():
            self._task.cancel()

    def join(self) -> None:
        """Return immediately, because there is no thread to wait for."""

    async def _run(self) -> None:
        pause: float | None = 0.0
        while pause is not None:
            await asyncio.sleep(pause)
            beat = self._beat()
            pause = await beat() if beat is not None else None
            del beat
        self._stopped = True  # "beat" returned None, or its object was garbage collected

    def _done(self, _task: asyncio.Task[None]) -> None:
        if not self._stopped:
            _notify(self._ended)


def _notify(ended: WeakMethod[Callable[[], None]]) -> None:
    method = ended()
    if method is not None:
        method()


def _current_task() -> asyncio.Task[object] | None:
    try:
        return asyncio.current_task()
    except RuntimeError:  # called outside an event loop
        return None
