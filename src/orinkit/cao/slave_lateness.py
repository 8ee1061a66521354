"""How late the set-points of slave mode were: slvGetLateness, which virtual controllers have beside DENSO's commands.

A virtual controller waits for a late set-point unless it is told to be strict. Without this command a program would not
learn that a real controller would have stopped the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from orinkit.language import pick
from orinkit.variant import R8_ARRAY, Value, Variant

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
            return pick("no late set-points", "位置指令の遅延なし")
        if self.count == 1:
            return pick(f"1 late set-point, by {longest}", f"遅延した位置指令 1 個 ({longest})")
        return pick(
            f"{self.count} late set-points, by up to {longest}",
            f"遅延した位置指令 {self.count} 個 (最大 {longest})",
        )


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
