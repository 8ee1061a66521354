"""A clock for virtual devices that runs by itself and can be held, so that no state changes while a test inspects it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from orinkit.virtual.clock import ManualClock

_STEP = 0.001  # s between two steps


class HeldClock(ManualClock):
    """A manual clock that a thread advances in small steps unless a test holds it.

    The clock stalls with the program: no motion ends while the machine stalls.

    Args:
        scale: highest speed, as a multiple of real time.
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
        """Advance the clock; the devices that it drives have processed everything due when this returns."""
        with self._moving:
            super().advance(seconds)

    def pace(self, scale: float) -> None:
        """Set the speed, as a multiple of real time."""
        self._step = _STEP * scale

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the clock; only :meth:`advance` moves it."""
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
        """Stop the clock permanently; close the device first."""
        self._ended.set()
        self._thread.join()
