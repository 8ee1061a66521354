"""Moving the clock of a virtual RC8 by hand while somebody streams to it: real time has no part in it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8

SLOW = 5.0  # deg/s, from which an arm may stop at once


class Hand:
    """Moves the clock of a controller on, cycle by cycle, but never past a set-point that is missing: no stall makes one late.

    In mode 1 a client repeats a set-point until a cycle has taken it: one that comes again is none while the arm moves.

    Args:
        device: the controller.
        clock: its clock; nobody else moves it.

    Attributes:
        between: is called by the hand between two cycles, by default to do nothing.
        error: that it has raised.
    """

    def __init__(self, device: VirtualRC8, clock: ManualClock) -> None:
        self.between: Callable[[], None] = lambda: None
        self.error: BaseException | None = None
        self._slave = device.state.arm.slave
        self._cycles = device.state.cycles
        self._clock = clock
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hand")
        self._thread.start()

    def _run(self) -> None:
        while not self._ending.wait(0.0005):
            self.move()
            try:
                self.between()
            except BaseException as error:  # noqa: BLE001 - is raised at the end
                self.error = error
                self.between = lambda: None

    def move(self) -> None:
        """Move the clock by a cycle, unless a set-point is missing."""
        with self._cycles:
            if not self._slave.starving and not self._repeated():
                self._clock.advance(PERIOD)

    def _repeated(self) -> bool:
        queue, buffer = self._slave._arm.queue, self._slave._buffer
        again = self._slave.overwrites and self._slave.taking and bool(buffer) and buffer[-1].joints == queue.joints
        return again and max(abs(b - a) for a, b in zip(queue.before, queue.joints, strict=True)) > SLOW * PERIOD

    def let_pass(self, seconds: float) -> bool:
        """Let time pass if a set-point is missing, which the next cycle needs; returns whether one is."""
        with self._cycles:
            if self._slave.starving:
                self._clock.advance(seconds)
                return True
        return False

    def close(self) -> None:
        """Move it no more."""
        self._ending.set()
        self._thread.join()
        if self.error is not None:
            raise self.error
