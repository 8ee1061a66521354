"""The clock of a virtual device: real time, scaled time, or time that a test moves by hand.

A device that does things by itself has the clock drive it (:meth:`Clock.drive`): in a thread where time passes by
itself, from :meth:`ManualClock.advance` where it does not.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Final

from orinkit.core.i18n import tr

_MANUAL_START: Final = datetime(2024, 4, 1, 9, 0, 0)
_SCALES: Final = (1e-6, 1e6)  # beyond, a device's times are no numbers that a clock can count

_PATIENCE: Final = 0.25
_LEAST_PATIENCE: Final = 0.05  # more than any device's own cycle, so that a slow clock's device goes on at all
_MOST_PATIENCE: Final = 20.0  # what a fast clock's device can make up for in a moment
_SHORTEST_PAUSE: Final = 0.0002  # s; others need a chance to look at the device too
_JOIN_TIMEOUT: Final = 5.0


class ClockDriver(ABC):
    """What has a device go on as its clock does."""

    @abstractmethod
    def wake(self) -> None:
        """Tell that the device has something to do; may be called from any thread."""

    @abstractmethod
    def close(self) -> None:
        """Drive no more; what is being done is finished first."""


class Clock:
    """Real time, or a multiple of it.

    Args:
        scale: seconds of the device per real second, 0.000001 to 1000000; 1 is real time, 10 makes a motion ten times as
            fast.

    Attributes:
        scale: as given.
        patience: how many seconds of its own a device that could not keep up tries to make up for; beyond that it
            goes on late.
        manual: whether the clock is moved by hand: nothing is ever done late then.

    Raises:
        ValueError: the scale is out of its range.
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
        self.patience = min(max(_PATIENCE * scale, _LEAST_PATIENCE), _MOST_PATIENCE)
        self._began = time.monotonic()
        self._began_wall = datetime.now()

    def now(self) -> float:
        """Return the seconds of the device since the clock was made; never goes back."""
        return (time.monotonic() - self._began) * self.scale

    def wall(self) -> datetime:
        """Return the local date and time of the device."""
        if self.scale == 1.0:
            return datetime.now()  # follows corrections of the computer's clock, as now() must not
        return self._began_wall + timedelta(seconds=self.now())

    def stopwatch(self, seconds: float) -> Callable[[], bool]:
        """Return what tells whether so many real seconds have passed; for a device that must not work for too long."""
        end = time.monotonic() + seconds
        return lambda: time.monotonic() >= end

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        """Have a device go on with time.

        Args:
            advance: does what is due and returns after how many seconds of the device it wants to be called again,
                ``None`` when it has nothing to do until it is woken.
        """
        return _Thread(advance, self.scale)


class _Thread(ClockDriver):
    """Calls the device from a thread that lives as long as there is something to do."""

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
            thread.join(_JOIN_TIMEOUT)

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
        """Wait until the device is to be called again; returns whether it is."""
        with self._changed:
            if pause is not None and not self._woken and not self._closed:
                self._changed.wait(min(max(pause / self._scale, _SHORTEST_PAUSE), threading.TIMEOUT_MAX))
            if self._closed or (pause is None and not self._woken):
                self._thread = None
                return False
            self._woken = False
            return True


class ManualClock(Clock):
    """A clock that stands still until :meth:`advance` moves it.

    Args:
        start: local date and time at which it stands first.
    """

    manual: bool = True

    def __init__(self, start: datetime = _MANUAL_START) -> None:
        super().__init__()
        self.patience = float("inf")
        self._start = start
        self._seconds = 0.0
        self._driven: list[Callable[[], float | None]] = []

    def advance(self, seconds: float) -> None:
        """Move the clock forward; the devices that it drives do what is due before this returns.

        Raises:
            ValueError: the step is negative, or no finite number.
        """
        if not 0 <= seconds < float("inf"):
            raise ValueError(tr("a clock goes on by a number of seconds and never back: {seconds} s", seconds=seconds))
        self._seconds += seconds
        for advance in list(self._driven):
            advance()

    def stopwatch(self, seconds: float) -> Callable[[], bool]:  # noqa: ARG002 - declared by the base
        """Return what is never true: on this clock everything is done that is due, however long it takes."""
        return lambda: False

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        """Have a device go on whenever the clock is moved."""
        return _ByHand(self._driven, advance)

    def now(self) -> float:
        """Return the seconds that the clock has been moved by."""
        return self._seconds

    def wall(self) -> datetime:
        """Return the start and the seconds together."""
        return self._start + timedelta(seconds=self._seconds)


class _ByHand(ClockDriver):
    def __init__(self, driven: list[Callable[[], float | None]], advance: Callable[[], float | None]) -> None:
        self._driven = driven
        self._advance = advance
        driven.append(advance)

    def wake(self) -> None:
        """Nothing happens until the clock is moved."""

    def close(self) -> None:
        if self._advance in self._driven:
            self._driven.remove(self._advance)
