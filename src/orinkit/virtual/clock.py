"""The clock of a virtual device: real time, scaled time, or time advanced manually by a test.

The clock also calls devices that act without a request (:meth:`Clock.drive`). With real or scaled time, a thread calls
them; with manual time, :meth:`ManualClock.advance` does.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Final

from orinkit.core.i18n import tr
from orinkit.virtual.workers import Workers

_MANUAL_START: Final = datetime(2024, 4, 1, 9, 0, 0)
_SCALES: Final = (1e-6, 1e6)  # outside this range a clock cannot represent the times of a device

_PATIENCE: Final = 0.25  # s with real time; multiplied by the scale
_MIN_PATIENCE: Final = 0.05  # s; longer than the cycle of any device, so that a device with a slow clock makes progress
_MAX_PATIENCE: Final = 20.0  # s; a device with a fast clock can catch up this delay in a short time
SHORTEST_PAUSE: Final = 0.0002
"""Seconds between two calls of a device, so that other threads can access it."""
IDLE_TIME: Final = 0.1
"""Seconds without work after which a thread ends; a client that streams set-points to a resting arm keeps the thread."""
JOIN_TIMEOUT: Final = 5.0
"""Limit on the seconds to wait for the end of the call in progress when a device is closed."""


class ClockDriver(ABC):
    """Calls a device when its work is due by the clock; returned by :meth:`Clock.drive`."""

    @abstractmethod
    def wake(self) -> None:
        """Signal that the device has something to do; may be called from any thread."""

    @abstractmethod
    def close(self) -> None:
        """Stop driving the device after the call in progress has ended."""


class Clock:
    """Real time, or a multiple of it.

    Args:
        scale: Seconds of the device per real second, 0.000001 to 1000000; 1 is real time, 10 makes a motion ten times
            as fast.

    Attributes:
        scale: Seconds of the device per real second.
        patience: Longest delay that a device catches up, in seconds of the device; after a longer delay the device lags
            behind the clock.
        manual: True if the clock is moved manually; the device itself is then never late.

    Raises:
        ValueError: If the scale is out of range.
    """

    manual: bool = False

    def __init__(self, scale: float = 1.0) -> None:
        low, high = _SCALES
        if not low <= scale <= high:
            raise ValueError(
                tr(
                    "the time scale must be positive, from {low:f} to {high:.0f}, not {scale:g}",
                    low=low,
                    high=high,
                    scale=scale,
                )
            )
        self.scale = scale
        self.patience = min(max(_PATIENCE * scale, _MIN_PATIENCE), _MAX_PATIENCE)
        self._began = time.monotonic()
        self._began_wall = datetime.now()

    def now(self) -> float:
        """Return the seconds of the device since the clock was created; they never decrease."""
        return (time.monotonic() - self._began) * self.scale

    def first_cycle(self, period: float) -> float:
        """Return the time at which the cycles of a device that is created now begin, s.

        Args:
            period: Length of a cycle of the device, s.
        """
        return self.now()

    def wall(self) -> datetime:
        """Return the local date and time of the device."""
        if self.scale == 1.0:
            return datetime.now()  # follows corrections of the computer's clock; now() must not
        return self._began_wall + timedelta(seconds=self.now())

    def time_budget(self, seconds: float) -> Callable[[], bool]:
        """Return a function that returns True once ``seconds`` of real time have passed, to limit computing time."""
        end = time.monotonic() + seconds
        return lambda: time.monotonic() >= end

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        """Drive a device with this clock.

        Args:
            advance: Callback that performs the due work. It returns the seconds of the device after which it must be
                called again, or ``None`` if it has nothing to do until :meth:`ClockDriver.wake`.
        """
        return _Thread(advance, self.scale)

    def workers(self, name: str) -> Workers:
        """Return the threads for long work of a device: one thread, unless devices share this clock's threads.

        Args:
            name: Name of the threads.
        """
        return Workers(name)


class _Thread(ClockDriver):
    """Calls the device from a thread, which runs only while there is something to do."""

    def __init__(self, advance: Callable[[], float | None], scale: float) -> None:
        self._advance = advance
        self._scale = scale
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._woken = False
        self._closed = False

    def wake(self) -> None:
        with self._changed:
            self._woken = True
            self._changed.notify()
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="orinkit-device", daemon=True)
                self._thread.start()

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify()
            thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(JOIN_TIMEOUT)

    def _run(self) -> None:
        pause: float | None = 0.0
        try:
            while self._wait(pause):
                pause = self._advance()
        finally:
            with self._changed:
                if self._thread is threading.current_thread():  # the device has raised an exception
                    self._thread = None

    def _wait(self, pause: float | None) -> bool:
        """Wait until the device must be called again; return False if the thread must end instead.

        ``pause`` is the last result of the callback, in seconds of the device; ``None`` if nothing is left to do.
        """
        with self._changed:
            if pause is not None and not self._woken and not self._closed:
                self._changed.wait(min(max(pause / self._scale, SHORTEST_PAUSE), threading.TIMEOUT_MAX))
            elif pause is None:
                self._changed.wait_for(lambda: self._woken or self._closed, IDLE_TIME)
            if self._closed or (pause is None and not self._woken):
                self._thread = None
                return False
            self._woken = False
            return True


class ManualClock(Clock):
    """A clock that only :meth:`advance` moves.

    Args:
        start: The initial local date and time.
    """

    manual: bool = True

    def __init__(self, start: datetime = _MANUAL_START) -> None:
        super().__init__()
        self.patience = float("inf")
        self._start = start
        self._seconds = 0.0
        self._driven: list[Callable[[], float | None]] = []

    def advance(self, seconds: float) -> None:
        """Move the clock forward, then perform the due work of its devices.

        Raises:
            ValueError: If the step is negative or not finite.
        """
        if not 0 <= seconds < float("inf"):
            raise ValueError(
                tr("a clock must advance by a finite number of seconds, 0 or more, not by {seconds} s", seconds=seconds)
            )
        self._seconds += seconds
        for advance in list(self._driven):
            advance()

    def time_budget(self, seconds: float) -> Callable[[], bool]:
        """Return a function that always returns False: with a manual clock, computing time is not limited."""
        return lambda: False

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        """Drive a device whenever the clock is moved."""
        return _ByHand(self._driven, advance)

    def now(self) -> float:
        """Return by how many seconds the clock has been moved."""
        return self._seconds

    def wall(self) -> datetime:
        """Return the start time plus the seconds by which the clock has been moved."""
        return self._start + timedelta(seconds=self._seconds)


class _ByHand(ClockDriver):
    def __init__(self, driven: list[Callable[[], float | None]], advance: Callable[[], float | None]) -> None:
        self._driven = driven
        self._advance = advance
        driven.append(advance)

    def wake(self) -> None:
        """Do nothing: the device is called when the clock is moved."""

    def close(self) -> None:
        if self._advance in self._driven:
            self._driven.remove(self._advance)
