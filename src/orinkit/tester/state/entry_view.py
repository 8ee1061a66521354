"""The entries of a long log that match a filter, found without blocking the event loop: :class:`EntryView`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Sequence
from time import perf_counter
from typing import Final, Generic, Protocol, TypeVar

SLICE: Final = 0.004
"""Time in s for which a search occupies the event loop at a time."""
PAUSE: Final = 0.001
"""Time in s between two slices."""

E_co = TypeVar("E_co", covariant=True)
E = TypeVar("E")


class EntryLog(Protocol[E_co]):
    """A log whose entries have consecutive numbers, and which discards its oldest entries."""

    @property
    def total(self) -> int:
        """Number of the newest entry."""

    @property
    def first_number(self) -> int:
        """Number of the oldest entry that is kept; ``total + 1`` if there is none."""

    def get(self, number: int) -> E_co | None:
        """Return the entry with a number; ``None`` if there is none."""


class EntryView(ABC, Generic[E]):
    """The entries of a log that match a filter, found incrementally.

    A position counts the matches from 0, including those that the log has discarded since. So the position of an entry
    never changes. The positions ``first`` to ``end - 1`` exist.

    Args:
        log: The log.
        accepts_all: True if every entry matches.
    """

    def __init__(self, log: EntryLog[E], *, accepts_all: bool) -> None:
        self._log = log
        self._all = accepts_all
        self._numbers: list[int] = []
        self._dropped = 0  # positions before _numbers[0]
        self._next = log.first_number  # the next entry to examine

    @abstractmethod
    def _examine(self, entry: E) -> bool | None:
        """Return True if an entry matches; ``None`` if this method must be called again to decide."""

    @property
    def behind(self) -> int:
        """Number of entries that have not been examined yet."""
        return 0 if self._all else self._log.total + 1 - max(self._next, self._log.first_number)

    @property
    def first(self) -> int:
        """Position of the oldest match that the log still has."""
        oldest = self._log.first_number
        if self._all:
            return oldest - 1
        return self._dropped + bisect_left(self._numbers, oldest)

    @property
    def end(self) -> int:
        """Position after the last match."""
        return self._log.total if self._all else self._dropped + len(self._numbers)

    def __len__(self) -> int:
        return self.end - self.first

    def position(self, number: int) -> int:
        """Return the position of an entry; -1 if it does not match, or the log has discarded it."""
        if self._log.get(number) is None:
            return -1
        if self._all:
            return number - 1
        index = bisect_left(self._numbers, number)
        return self._dropped + index if self._numbers[index : index + 1] == [number] else -1

    def number(self, position: int) -> int:
        """Return the number of the entry at a position; 0 if there is none."""
        if not self.first <= position < self.end:
            return 0
        return position + 1 if self._all else self._numbers[position - self._dropped]

    def numbers(self) -> Sequence[int]:
        """Return the numbers of all matches found so far; later changes of the view do not affect the result."""
        return range(self.first + 1, self.end + 1) if self._all else self._numbers[self.first - self._dropped :]

    def window(self, position: int, count: int) -> Sequence[E]:
        """Return up to ``count`` entries from a position, which must not be before :attr:`first`."""
        stop = min(position + count, self.end)
        found = (self._log.get(self.number(each)) for each in range(max(position, self.first), stop))
        return [each for each in found if each is not None]

    def advance(self, seconds: float = SLICE) -> bool:
        """Examine further entries for a limited time; return True if some are left."""
        self._prune()
        if self._all:
            return False
        stop = perf_counter() + seconds
        self._next, total = max(self._next, self._log.first_number), self._log.total
        while self._next <= total:
            entry = self._log.get(self._next)
            assert entry is not None  # its number is between the first and the last
            matches = self._examine(entry)
            if matches is not None:
                if matches:
                    self._numbers.append(self._next)
                self._next += 1
            if perf_counter() > stop:
                break
        return self._next <= total

    def _prune(self) -> None:
        """Forget the numbers of discarded entries, if they are many."""
        gone = bisect_left(self._numbers, self._log.first_number)
        if gone > len(self._numbers) // 2:
            del self._numbers[:gone]
            self._dropped += gone
