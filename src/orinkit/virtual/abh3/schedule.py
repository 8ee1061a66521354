"""Schedule of the periodic frames of a virtual ABH3. Times are in cycles of 1 ms."""

from __future__ import annotations

from collections.abc import Mapping


class Schedule:
    """Schedule of frames, identified by their names, each with its own period."""

    def __init__(self) -> None:
        self._periods: dict[str, int] = {}
        self._next: dict[str, int] = {}

    def set(self, periods: Mapping[str, int], cycle: int) -> None:
        """Set the periods, in cycles; 0 or less for never.

        A frame with an unchanged period keeps the time at which it is due next. A frame with a new period is next
        due one period after ``cycle``.
        """
        for name, period in periods.items():
            if period != self._periods.get(name):
                self._next.pop(name, None)
                if period > 0:
                    self._next[name] = cycle + period
        self._periods = dict(periods)

    def next(self) -> int | None:
        """Return the cycle in which the next frame is due; ``None`` for never."""
        return min(self._next.values(), default=None)

    def take(self, cycle: int) -> list[str]:
        """Return the names of the frames that are due in or before ``cycle``, each once; missed periods are skipped."""
        due = [name for name, time in self._next.items() if time <= cycle]
        for name in due:
            period = self._periods[name]
            self._next[name] += ((cycle - self._next[name]) // period + 1) * period
        return due
