"""Signs of life of a client: something that is done again and again beside the program, in a thread.

The twin is :mod:`orinkit.transport.aio_keepalive`. A pulse does not keep alive what it belongs to, and ends with it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from weakref import WeakMethod, finalize

from orinkit.core.errors import OrinError


def take_now(lock: threading.RLock) -> bool:
    """Take a lock if nobody else has it; returns whether it was taken."""
    return lock.acquire(blocking=False)


class KeepAlive:
    """In a daemon thread of its own.

    Args:
        beat: a method; it may wait. What it fails with is for the program's next call to find out.
        every: seconds from one beat to the next.
    """

    def __init__(self, beat: Callable[[], object], every: float) -> None:
        self._beat = WeakMethod(beat)
        self._every = every
        self._ended = threading.Event()
        finalize(beat.__self__, self._ended.set)  # type: ignore[attr-defined]  # a method, as WeakMethod wants
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
