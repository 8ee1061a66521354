"""The past values of a variable, for plots and CSV files: :class:`History`."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
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
        self._gaps: list[int] = []  # numbers of the values after a gap
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
            self._gaps = []
        if self.times and time - self.times[-1] > _GAP:
            self._gaps.append(self._first + len(self.times))
        self.times.append(time)
        for column, value in zip(self.columns, values, strict=True):
            column.append(value)
        if len(self.times) > self._capacity * 5 // 4:
            surplus = len(self.times) - self._capacity
            self._first += surplus
            del self.times[:surplus]
            self._gaps = [number for number in self._gaps if number > self._first]
            for column in self.columns:
                del column[:surplus]

    def copy(self) -> History:
        """Return a copy, which another thread may read."""
        new = History(self._capacity)
        new._gaps, new._first = list(self._gaps), self._first
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
        start = first - (self._first + first) % size
        found: list[int] = []
        for at in range(start, len(self.times), size):
            found += self._extremes(column, max(at, first), at + size)
        return self._with_gaps(column, found)

    def _extremes(self, column: int, start: int, end: int) -> list[int]:
        """Return the indices of the lowest and the highest value of an interval."""
        part = self.columns[column][start:end]
        return sorted({start + part.index(min(part)), start + part.index(max(part))}) if end - start > 1 else [start]

    def _with_gaps(self, column: int, indices: list[int]) -> list[tuple[float, float | None]]:
        shown: list[tuple[float, float | None]] = []
        gaps = [number - self._first for number in self._gaps]
        previous = indices[0] if indices else 0
        for index in indices:
            if bisect_right(gaps, previous) < bisect_right(gaps, index):
                shown.append((self.times[previous], None))
            value = self.columns[column][index]
            shown.append((self.times[index], value if math.isfinite(value) else None))
            previous = index
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
