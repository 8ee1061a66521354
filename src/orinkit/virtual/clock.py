"""The clock of a virtual device: real time, scaled time, or time that a test moves by hand."""

from __future__ import annotations

import time
from datetime import datetime, timedelta
from typing import Final

from orinkit.language import pick

_MANUAL_START: Final = datetime(2024, 4, 1, 9, 0, 0)


class Clock:
    """Real time, or a multiple of it.

    Args:
        scale: seconds of the device per real second; 1 is real time, 10 makes a motion ten times as fast.

    Raises:
        ValueError: the scale is not positive.
    """

    def __init__(self, scale: float = 1.0) -> None:
        if not 0 < scale < float("inf"):
            raise ValueError(pick(f"the time scale must be positive, not {scale}", f"時間倍率は正の数です: {scale}"))
        self.scale = scale
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


class ManualClock(Clock):
    """A clock that stands still until :meth:`advance` moves it.

    Args:
        start: local date and time at which it stands first.
    """

    def __init__(self, start: datetime = _MANUAL_START) -> None:
        super().__init__()
        self._start = start
        self._seconds = 0.0

    def advance(self, seconds: float) -> None:
        """Move the clock forward.

        Raises:
            ValueError: the step is negative.
        """
        if not seconds >= 0:
            raise ValueError(pick(f"a clock does not go back: {seconds} s", f"時計は戻せません: {seconds} 秒"))
        self._seconds += seconds

    def now(self) -> float:
        """Return the seconds that the clock has been moved by."""
        return self._seconds

    def wall(self) -> datetime:
        """Return the start and the seconds together."""
        return self._start + timedelta(seconds=self._seconds)
