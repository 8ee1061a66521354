"""The lateness of set-points in slave mode: slvGetLateness, a command of virtual controllers only.

A virtual controller waits for a late set-point unless time is strict. Only this command reports to a program that a
real controller would have stopped the arm.
"""

from __future__ import annotations

import math
from typing import Final

from orinkit.core.i18n import tr
from orinkit.core.public_name import public
from orinkit.core.record import record
from orinkit.values.variant import R8_ARRAY, Value, Variant

COMMAND: Final = "slvGetLateness"
"""A command of Robot_Execute. Its parameter is how many of the first late set-points are not counted; default 0."""

_NUMBERS: Final = 3


@public("orinkit")
@record
class Lateness:
    """Statistics of the late set-points.

    Attributes:
        count: Number of late set-points.
        longest: Largest delay, s.
        total: Sum of all delays, s.
    """

    count: int = 0
    longest: float = 0.0
    total: float = 0.0

    def __str__(self) -> str:
        longest = f"{self.longest * 1e3:.0f} ms"
        if self.count == 0:
            return tr("no late set-points")
        if self.count == 1:
            return tr("1 late set-point, by {longest}", longest=longest)
        return tr("{count} late set-points, by up to {longest}", count=self.count, longest=longest)


def build_lateness(lateness: Lateness) -> Variant:
    """Return the result of slvGetLateness: VT_R8 array of count, longest in s, total in s."""
    return Variant(R8_ARRAY, [float(lateness.count), lateness.longest, lateness.total])


def read_lateness(answer: Value) -> Lateness | None:
    """Parse a result of slvGetLateness that is given as plain Python; return ``None`` if it is not valid."""
    if not isinstance(answer, list) or len(answer) != _NUMBERS:
        return None
    if not all(isinstance(each, float) and 0 <= each < math.inf for each in answer):
        return None
    count, longest, total = answer
    return Lateness(int(count), longest, total)
