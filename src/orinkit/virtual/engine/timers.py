"""Timers counted in the controller's cycles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop

_MILLISECONDS: Final = 1000


class Timer:
    """A running timer of :class:`Timers`."""

    __slots__ = ("cycles", "ended")

    def __init__(self, cycles: int, ended: Callable[[], None]) -> None:
        self.cycles = cycles
        self.ended: Callable[[], None] | None = ended

    def cancel(self) -> None:
        """Cancel the timer; its callback is not invoked."""
        self.ended = None


class Timers:
    """Invokes callbacks after a number of cycles.

    Args:
        cycles: The control loop of the controller; :meth:`step` must be called in each of its cycles.
    """

    def __init__(self, cycles: ControlLoop) -> None:
        self._cycles = cycles
        self._running: list[Timer] = []

    def after(self, milliseconds: int, ended: Callable[[], None]) -> Timer:
        """Start a timer.

        Args:
            milliseconds: Duration; it is rounded up to whole cycles, at least one.
            ended: Callback invoked in the cycle in which the timer expires.
        """
        self._cycles.require_open()
        timer = Timer(max(1, math.ceil(milliseconds / (PERIOD * _MILLISECONDS))), ended)
        self._running.append(timer)
        self._cycles.wake()
        return timer

    def step(self) -> bool:
        """Run one cycle; return True if a timer is still running."""
        running, self._running = self._running, []
        for timer in running:
            timer.cycles -= 1
            if timer.cycles > 0 and timer.ended is not None:
                self._running.append(timer)
            elif timer.ended is not None:
                timer.ended()
        return bool(self._running)
