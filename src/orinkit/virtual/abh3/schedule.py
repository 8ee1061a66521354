"""When a virtual ABH3 sends frames unasked. Times are in cycles of 1 ms."""

from __future__ import annotations

from collections.abc import Mapping


class Schedule:
    """Frames by their names, each with its own period."""

    def __init__(self) -> None:
        self._periods: dict[str, int] = {}
        self._next: dict[str, int] = {}

    def set(self, periods: Mapping[str, int], cycle: int) -> None:
        """Take other periods, in cycles; 0 and less for never. Those that stay the same go on."""
        for name, period in periods.items():
            if period != self._periods.get(name):
                self._next.pop(name, None)
                if period > 0:
                    self._next[name] = cycle + period
        self._periods = dict(periods)

    def next(self) -> int | None:
        """Return the cycle in which a frame is due; ``None`` for never."""
        return min(self._next.values(), default=None)

    def take(self, cycle: int) -> list[str]:
        """Return the names that are due, each of them once; periods that were missed are left out."""
        due = [name for name, time in self._next.items() if time <= cycle]
        for name in due:
            period = self._periods[name]
            self._next[name] += ((cycle - self._next[name]) // period + 1) * period
        return due
