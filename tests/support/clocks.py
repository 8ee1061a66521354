"""A clock for virtual devices that goes on by itself and can be held, so that nothing happens while a test looks."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from orinkit.virtual.clock import ManualClock

_STEP = 0.001  # s between two steps


class HeldClock(ManualClock):
    """A manual clock that a thread moves, in small steps, unless a test holds it.

    Time stands still for the device when it does for the program: no motion ends while the machine stalls.

    Args:
        scale: how many times as fast as real time it is at most.
    """

    def __init__(self, scale: float = 25.0) -> None:
        super().__init__()
        self.pace(scale)
        self._moving = threading.RLock()
        self._free = True
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="held clock", daemon=True)
        self._thread.start()

    def advance(self, seconds: float) -> None:
        """Move the clock forward; the devices that it drives do what is due before this returns."""
        with self._moving:
            super().advance(seconds)

    def pace(self, scale: float) -> None:
        """Have it go on faster or more slowly from now on."""
        self._step = _STEP * scale

    @contextmanager
    def held(self) -> Iterator[None]:
        """Have the clock stand still, but for :meth:`advance`."""
        with self._moving:
            self._free = False
        try:
            yield
        finally:
            self._free = True

    def _run(self) -> None:
        while not self._ended.wait(_STEP):
            with self._moving:
                if self._free:
                    super().advance(self._step)

    def close(self) -> None:
        """Stand still for good; the device is to be closed before."""
        self._ended.set()
        self._thread.join()
