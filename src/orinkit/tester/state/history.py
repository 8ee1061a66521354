"""The past values of a variable, for plots and CSV files: :class:`History`."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from typing import Final

CAPACITY: Final = 6000
"""Number of values of a variable that are kept; at ten values per second, the latest 10 minutes."""
MAX_ELEMENTS: Final = 10
"""Number of elements of an array that are kept."""
_GAP: Final = 4.0  # s; a longer interval between two values is a gap in the plot


class History:
    """The latest numeric values of a variable: one column, or for an array one for each element.

    Args:
        capacity: Number of values that are kept at least.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._first = 0  # number of the oldest value, so that the intervals of a plot do not move
        self.times = array("d")
        self.columns: list[array[float]] = []

    def __len__(self) -> int:
        return len(self.times)

    def add(self, time: float, values: Sequence[float]) -> None:
        """Add a value; if the number of elements has changed, discard the previous values.

        Args:
            time: Time of day, s since 1970.
            values: The number, or the elements of the array.
        """
        values = values[:MAX_ELEMENTS]
        if len(values) != len(self.columns):
            self.times = array("d")
            self.columns = [array("d") for _ in values]
        self.times.append(time)
        for column, value in zip(self.columns, values, strict=True):
            column.append(value)
        if len(self.times) > self._capacity * 5 // 4:
            surplus = len(self.times) - self._capacity
            self._first += surplus
            del self.times[:surplus]
            for column in self.columns:
                del column[:surplus]

    def copy(self) -> History:
        """Return a copy, which another thread may read."""
        new = History(self._capacity)
        new.times, new.columns = self.times[:], [column[:] for column in self.columns]
        return new

    def plot(self, column: int, since: float, points: int) -> list[tuple[float, float | None]]:
        """Return the values after a time for a plot: of each interval the lowest and the highest one, in order of time.

        The intervals do not depend on the current time, so that a plot that is drawn again and again does not flicker.

        Args:
            column: Index of the column.
            since: Time of day, s since 1970.
            points: Maximum number of values.

        Returns:
            Pairs of time and value; the value is ``None`` at a gap, and if it is not finite.
        """
        first = bisect_left(self.times, since)
        count = len(self.times) - first
        size = 1
        while count > points // 2 * size and count > points:
            size *= 2
        if size == 1:
            return _with_gaps(zip(self.times[first:], self.columns[column][first:], strict=True))
        start = first - (self._first + first) % size
        found: list[tuple[float, float]] = []
        for at in range(start, len(self.times), size):
            found += self._extremes(column, max(at, first), at + size)
        return _with_gaps(found)

    def _extremes(self, column: int, start: int, end: int) -> list[tuple[float, float]]:
        part = self.columns[column][start:end]
        low, high = part.index(min(part)) if part else 0, part.index(max(part)) if part else 0
        return [(self.times[start + at], part[at]) for at in sorted({low, high})] if part else []


def _with_gaps(values: Iterable[tuple[float, float]]) -> list[tuple[float, float | None]]:
    shown: list[tuple[float, float | None]] = []
    for time, value in values:
        if shown and time - shown[-1][0] > _GAP:
            shown.append((shown[-1][0], None))
        shown.append((time, value if math.isfinite(value) else None))
    return shown


def merged_rows(histories: Sequence[History]) -> list[list[float | None]]:
    """Return the values of several variables as rows for a table: the time, then all columns; ``None`` is a missing value."""
    width = 1 + sum(len(each.columns) for each in histories)
    rows: dict[float, list[float | None]] = {}
    offset = 1
    for history in histories:
        for index, time in enumerate(history.times):
            row = rows.get(time)
            if row is None:
                row = rows[time] = [time] + [None] * (width - 1)
            for number, column in enumerate(history.columns):
                row[offset + number] = column[index]
        offset += len(history.columns)
    return [rows[time] for time in sorted(rows)]
