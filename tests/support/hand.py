"""Advancing the clock of a virtual RC8 step by step while a client streams to it, independent of real time."""

from __future__ import annotations

import threading
from collections.abc import Callable

from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8

SLOW = 5.0  # deg/s, highest velocity from which an arm may stop immediately


class Hand:
    """Advances the clock of a controller cycle by cycle, but never past a missing set-point: no stall makes one late.

    In mode 1 a client repeats a set-point until a cycle has consumed it, so a repeated set-point does not count while the
    arm moves.

    Args:
        device: the controller.
        clock: its clock; must not be advanced by other code.

    Attributes:
        between: callback invoked between two cycles; does nothing by default.
        error: the exception that the callback has raised.
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
            except BaseException as error:  # noqa: BLE001 - raised by close()
                self.error = error
                self.between = lambda: None

    def move(self) -> None:
        """Advance the clock by a cycle, unless a set-point is missing."""
        with self._cycles:
            if not self._slave.starving and not self._repeated():
                self._clock.advance(PERIOD)

    def _repeated(self) -> bool:
        queue, buffer = self._slave._arm.queue, self._slave._buffer
        again = self._slave.overwrites and self._slave.taking and bool(buffer) and buffer[-1].joints == queue.joints
        return (
            again and max(abs(b - a) for a, b in zip(queue.previous_joints, queue.joints, strict=True)) > SLOW * PERIOD
        )

    def let_pass(self, seconds: float) -> bool:
        """Advance the clock if the set-point for the next cycle is missing; return True if it is."""
        with self._cycles:
            if self._slave.starving:
                self._clock.advance(seconds)
                return True
        return False

    def close(self) -> None:
        """Stop advancing the clock and raise the error of the callback."""
        self._ending.set()
        self._thread.join()
        if self.error is not None:
            raise self.error
