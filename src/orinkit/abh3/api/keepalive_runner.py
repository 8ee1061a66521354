"""What has a keep-alive beat: a thread, or a task of asyncio.

Neither outlives the program: the thread is a daemon, and ends with the thread that began it, with the main thread, and with
the driver's object. A process that is stopped or killed sends nothing. (CAN interfaces could send periodically by themselves;
they would go on when the program hangs.)
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from typing import TypeAlias
from weakref import WeakMethod

Beat: TypeAlias = Callable[[], float | None]
"""Does what is due, and returns the seconds until the next time, ``None`` when there is none."""
AsyncBeat: TypeAlias = Callable[[], Awaitable[float | None]]
_JOINING = 2.0


class PeriodicCall:
    """Calls a method again and again from a thread of its own.

    Args:
        beat: a method; that its object goes away ends the keeping too.
        ended: a method that is called when it ends otherwise than by :meth:`stop` or by the beat's own will.
        name: of the thread.
    """

    def __init__(self, beat: Beat, ended: Callable[[], None], name: str) -> None:
        self._beat = WeakMethod(beat)
        self._ended = WeakMethod(ended)
        self._owner = threading.current_thread()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Call it no more; one call may be at work."""
        self._stopped.set()

    def join(self) -> None:
        """Wait until it has stopped."""
        if self._thread is not threading.current_thread():
            self._thread.join(_JOINING)

    def _run(self) -> None:
        pause: float | None = 0.0
        try:
            while pause is not None and not self._stopped.wait(pause):
                beat = self._beat()
                if beat is None or not self._owner.is_alive() or not threading.main_thread().is_alive():
                    break
                pause = beat()
                del beat  # while this thread waits the object may go away
        finally:
            if pause is not None and not self._stopped.is_set():
                _tell(self._ended)


class AsyncPeriodicCall:
    """The same as a task of the event loop that is running."""

    def __init__(self, beat: AsyncBeat, ended: Callable[[], None], name: str) -> None:
        self._beat = WeakMethod(beat)
        self._ended = WeakMethod(ended)
        self._stopped = False
        self._task = asyncio.get_running_loop().create_task(self._run(), name=name)
        self._task.add_done_callback(self._done)  # that of a task that was cancelled before it began is called too

    def stop(self) -> None:
        """Call it no more."""
        self._stopped = True
        if self._task is not _current_task():
            self._task.cancel()

    def join(self) -> None:
        """Nothing is left to wait for."""

    async def _run(self) -> None:
        pause: float | None = 0.0
        while pause is not None:
            await asyncio.sleep(pause)
            beat = self._beat()
            pause = await beat() if beat is not None else None
            del beat
        self._stopped = True  # by the beat's own will, or with its object

    def _done(self, _task: asyncio.Task[None]) -> None:
        if not self._stopped:
            _tell(self._ended)


def _tell(ended: WeakMethod[Callable[[], None]]) -> None:
    method = ended()
    if method is not None:
        method()


def _current_task() -> asyncio.Task[object] | None:
    try:
        return asyncio.current_task()
    except RuntimeError:  # it is closed from outside of a loop
        return None
