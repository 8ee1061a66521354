"""Repeated access to a variable, with statistics: :class:`Performance` ([Performance] in DENSO's Tester)."""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from math import log
from time import perf_counter
from typing import Final

from orinkit.cao import functions as f
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.objects import ObjectRegistry, RemoteObject

MAX_CALLS: Final = 1_000_000
MAX_SECONDS: Final = 600
BINS: Final = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0, 20.0, 50.0, 100.0)
"""Upper bounds of the columns of the histogram, ms; a further column contains the rest."""
_PERCENTILES: Final = (50, 90, 99, 99.9)
_TURN: Final = 200  # calls between two turns of the other tasks
_FINEST: Final = 0.001  # ms
_RESOLUTION: Final = log(1.01)  # percentiles are exact to 1 %, so that no durations need to be kept and sorted


@dataclass(frozen=True, slots=True)
class PerformanceReport:
    """Statistics of a measurement; times in ms.

    Attributes:
        calls: Number of calls.
        seconds: Duration in s.
        rate: Calls per second.
        mean: Mean duration of a call.
        largest: Longest duration of a call.
        percentiles: Percentiles of the durations, by percentage.
        histogram: Number of calls for each column of :data:`BINS`.
    """

    calls: int
    seconds: float
    rate: float
    mean: float
    largest: float
    percentiles: dict[float, float]
    histogram: list[int]


class Performance:
    """A measurement: Variable_GetValue is called again and again until a limit is reached, or :meth:`stop` is called.

    Args:
        objects: The objects of the connection.
        variable: The variable to read.
        calls: Maximum number of calls, 1 to 1,000,000.
        seconds: Maximum duration in s, up to 600.

    Raises:
        InvalidValue: If a limit is out of range.

    Attributes:
        calls: Number of calls up to now.
    """

    def __init__(self, objects: ObjectRegistry, variable: RemoteObject, calls: int, seconds: float) -> None:
        if not 1 <= calls <= MAX_CALLS:
            raise InvalidValue(tr("the number of calls must be 1 to {most}, not {calls}", most=MAX_CALLS, calls=calls))
        if not 0 < seconds <= MAX_SECONDS:
            raise InvalidValue(
                tr("the duration must be up to {most} s, not {seconds:g}", most=MAX_SECONDS, seconds=seconds)
            )
        self._objects, self._variable = objects, variable
        self._calls, self._seconds = calls, seconds
        self._fine: Counter[int] = Counter()
        self._sum = self._largest = 0.0
        self.calls = 0
        self._columns = [0] * (len(BINS) + 1)
        self._stopped = False
        self._elapsed = 0.0

    def stop(self) -> None:
        """End the measurement after the call in progress."""
        self._stopped = True

    async def run(self) -> None:
        """Measure.

        Raises:
            OrinError: If a call fails; the measurement up to then remains.
        """
        begun = perf_counter()
        while not self._stopped and self.calls < self._calls and self._elapsed < self._seconds:
            outcome = await self._objects.call(self._variable, f.variable_get_value)
            self._count(outcome.seconds * 1000)
            self._elapsed = perf_counter() - begun
            if self.calls % _TURN == 0:
                await asyncio.sleep(0)

    def _count(self, milliseconds: float) -> None:
        self.calls += 1
        self._sum += milliseconds
        self._largest = max(self._largest, milliseconds)
        self._columns[bisect_right(BINS, milliseconds)] += 1
        self._fine[int(log(max(milliseconds, _FINEST) / _FINEST) / _RESOLUTION)] += 1

    def report(self) -> PerformanceReport:
        """Return the statistics up to now."""
        return PerformanceReport(
            self.calls,
            self._elapsed,
            self.calls / self._elapsed if self._elapsed else 0.0,
            self._sum / self.calls if self.calls else 0.0,
            self._largest,
            self._percentiles(),
            list(self._columns),
        )

    def _percentiles(self) -> dict[float, float]:
        found: dict[float, float] = {}
        passed = 0
        for index, count in sorted(self._fine.items()):
            passed += count
            for each in _PERCENTILES:
                if each not in found and passed * 100 >= each * self.calls:
                    found[each] = min(_FINEST * 1.01 ** (index + 1), self._largest)
        return found
