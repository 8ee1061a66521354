"""Keep-alives of a client: a method that is called periodically in a background thread.

The asynchronous counterpart is :mod:`orinkit.transport.aio_keepalive`. The thread has only a weak reference to the
object of the method, and ends when that object is deleted.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from weakref import WeakMethod, finalize

from orinkit.core.errors import OrinError


def try_acquire(lock: threading.RLock) -> bool:
    """Acquire a lock if no other thread has it; return True if it was acquired."""
    return lock.acquire(blocking=False)


class KeepAlive:
    """Calls a method at a fixed interval, in a separate daemon thread.

    Args:
        beat: A method; it may block. Its errors are ignored, because the program's next call reports them.
        every: Interval between two calls, s.
    """

    def __init__(self, beat: Callable[[], object], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._ended = threading.Event()
        finalize(beat.__self__, self._ended.set)  # type: ignore[attr-defined]  # WeakMethod requires a method
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
        """Stop the calls."""
        self._ended.set()
