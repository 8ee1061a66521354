"""Several queues that run cooperative motions in step: in every cycle they have the same pace.

If one of the queues halts or holds, the pace of all decreases as fast as the limits of all arms allow. The arms therefore
stay on their paths, at the same progress, until standstill.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol

_HALVINGS: Final = 12


class PacedQueue(Protocol):
    """The part of a queue of motions that :class:`Coupling` uses."""

    @property
    def moving(self) -> bool:
        """True if the command position moves, or is about to move."""

    @property
    def pace(self) -> float:
        """Seconds by which the elapsed times increased in the last cycle."""

    def intended_pace(self) -> tuple[float, float]:
        """Return the pace that the state requires, s, and the acceleration allowed to reach it, as a fraction."""

    def allows(self, pace: float, fraction: float) -> bool:
        """Return True if a pace is within the acceleration limits of the joints, multiplied by a fraction."""


class Coupling:
    """The common pace of several queues, each of which is stepped once in a cycle.

    Args:
        queues: The queues.
    """

    def __init__(self, queues: Sequence[PacedQueue]) -> None:
        self._queues = tuple(queues)
        self._due: list[PacedQueue] = []  # queues that have not taken the pace of this cycle yet
        self._pace = 0.0

    def pace_of(self, queue: PacedQueue) -> float:
        """Return the pace of a queue in this cycle, s; the first queue that asks determines it for all."""
        if queue not in self._due:
            self._pace = self._common_pace()
            self._due = list(self._queues)
        self._due.remove(queue)
        return self._pace

    def _common_pace(self) -> float:
        moving = [(queue, *queue.intended_pace()) for queue in self._queues if queue.moving]
        desired = min(pace for _, pace, _ in moving)
        present = min(queue.pace for queue, _, _ in moving)
        if desired == present:
            return desired
        return nearest_pace(
            desired, present, lambda pace: all(queue.allows(pace, fraction) for queue, _, fraction in moving)
        )


def nearest_pace(desired: float, present: float, allows: Callable[[float], bool]) -> float:
    """Return the allowed pace that is nearest to the desired one, s.

    The present pace is always allowed, apart from rounding, because each motion is within the limits.
    """
    if allows(desired):
        return desired
    possible = present
    for _ in range(_HALVINGS):
        middle = (desired + possible) / 2
        if allows(middle):
            possible = middle
        else:
            desired = middle
    return possible
