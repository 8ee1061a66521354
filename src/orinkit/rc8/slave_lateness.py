"""How late the set-points of slave mode were: slvGetLateness, which virtual controllers have beside DENSO's commands.

A virtual controller waits for a late set-point unless it is told to be strict. Without this command a program would not
learn that a real controller would have stopped the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from orinkit.core.i18n import tr
from orinkit.values.variant import R8_ARRAY, Value, Variant

COMMAND: Final = "slvGetLateness"
"""A command of Robot_Execute. Its parameter is the number of late set-points to leave out, the first ones; 0 by default."""

_NUMBERS: Final = 3


@dataclass(frozen=True, slots=True)
class Lateness:
    """Set-points that came too late for a real controller.

    Attributes:
        count: how many.
        longest: how late the latest one was, s.
        total: how late all of them were together, s.
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
    """Return the answer of slvGetLateness: VT_R8 array of count, longest in s, total in s."""
    return Variant(R8_ARRAY, [float(lateness.count), lateness.longest, lateness.total])


def read_lateness(answer: Value) -> Lateness | None:
    """Return what slvGetLateness answered as plain Python; ``None`` if a controller answered something else."""
    if not isinstance(answer, list) or len(answer) != _NUMBERS:
        return None
    if not all(isinstance(each, float) and 0 <= each < math.inf for each in answer):
        return None
    count, longest, total = answer
    return Lateness(int(count), longest, total)
