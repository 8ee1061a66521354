"""What the tests of streaming share: a virtual RC8 on the wire that keeps a log of what its arm did, and moves its clock."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import orinkit
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.cycle import PERIOD

PATIENCE = 30.0
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
ROUNDING = 1e-6
SLOW = 5.0  # deg/s, from which an arm may stop at once


def sine(
    seconds: float, amplitude: float = 10.0, axes: tuple[int, ...] = (0, 1), home: Any = HOME
) -> list[tuple[float, ...]]:
    """A trajectory that begins and ends at rest: two sines of some joints. No set-point is the same as the one before it.

    Where two are the same the arm stands, and a late set-point is no gap.
    """
    count = 4 * round(seconds / PERIOD / 4)
    points = []
    for number in range(count + 1):
        sway = amplitude * (1 - math.cos(4 * math.pi * number / count)) / 2
        points.append(tuple(joint + sway * (axis in axes) for axis, joint in enumerate(home)))
    return points


class Arm:
    """A virtual RC8 that is served, and what its own log tells."""

    def __init__(self, device: VirtualRC8, url: str) -> None:
        self.device = device
        self.url = url
        self.arm = device.state.arm
        self.model = self.arm.model
        self.record()

    def record(self) -> None:
        """Forget the log and begin again."""
        with self.device.state.cycles:
            self.arm.log.clear()
            self.arm.log.running = True
            self.device.state.cycles.wake()

    @property
    def commands(self) -> np.ndarray[Any, Any]:
        """Command joints, a row for each cycle."""
        with self.device.state.cycles:
            log = self.arm.log
            rows = [log.record(index)[0:24:4] for index in range(len(log))]
        return np.array(rows, dtype=float).reshape(-1, 6)

    @property
    def errors(self) -> list[int]:
        """Codes of all errors that have been logged, the oldest first."""
        log = self.device.state.faults.log
        return [log.at(index).code for index in reversed(range(len(log)))]

    @property
    def mode(self) -> int:
        """What slvGetMode answers."""
        mode = self.arm.slave.mode
        return mode.number if mode is not None else 0

    def peaks(self) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Largest velocity and acceleration of each joint, as parts of the arm's limits."""
        commands = self.commands
        axes = self.model.axes[:6]
        velocity = np.abs(np.diff(commands, axis=0)).max(axis=0) / PERIOD
        acceleration = np.abs(np.diff(commands, n=2, axis=0)).max(axis=0) / PERIOD**2
        return (
            velocity / np.array([axis.velocity for axis in axes]),
            acceleration / np.array([axis.acceleration for axis in axes]),
        )

    def within_limits(self) -> bool:
        """Whether no joint ever was faster, or accelerated or braked more, than the arm can."""
        velocity, acceleration = self.peaks()
        return bool((velocity <= 1 + ROUNDING).all() and (acceleration <= 1 + ROUNDING).all())

    def carried_out(self, points: list[tuple[float, ...]]) -> bool:
        """Whether these commands were given, one in each cycle, without a gap."""
        commands = [tuple(row) for row in self.commands.tolist()]
        count = len(points)
        return any(commands[index : index + count] == points for index in range(len(commands) - count + 1))

    def standing(self) -> bool:
        """Whether nothing moves and slave mode is off."""
        return not self.arm.busy and self.mode == 0

    def free(self) -> bool:
        """Whether nobody has the arm any more."""
        return self.standing() and self.arm.holder is None


@contextmanager
def served(
    *, scale: float = 1.0, listen: str = "tcp://127.0.0.1:0", clock: Clock | None = None, **options: Any
) -> Iterator[Arm]:
    """Serve a virtual RC8 with its motor on."""
    device = VirtualRC8(clock=clock or Clock(scale), **{"motor": True, **options})
    with orinkit.serve(device, listen) as server:
        yield Arm(device, server.url)


class Hand:
    """Moves the clock of a controller on, cycle by cycle, but never past a set-point that is missing: no stall makes one late.

    In mode 1 a client repeats a set-point until a cycle has taken it: one that comes again is none while the arm moves.

    Args:
        arm: of the controller.
        clock: of the controller; nobody else moves it.

    Attributes:
        breaks: conditions; the hand stands as soon as the first one is met, and goes on to the next one then.
        standing: whether it does; to be set to ``False`` to have it go on.
    """

    def __init__(self, arm: Arm, clock: ManualClock) -> None:
        self.breaks: list[Callable[[], bool]] = []
        self.standing = False
        self._slave = arm.arm.slave
        self._cycles = arm.device.state.cycles
        self._clock = clock
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hand")
        self._thread.start()

    def _run(self) -> None:
        while not self._ending.wait(0.0005):
            with self._cycles:
                if self.breaks and self.breaks[0]():
                    del self.breaks[0]
                    self.standing = True
                elif not self.standing and not self._slave.starving and not self._repeated():
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


@contextmanager
def by_hand(**options: Any) -> Iterator[tuple[Arm, Hand]]:
    """Serve a virtual RC8 whose clock is moved by hand."""
    clock = ManualClock()
    with served(clock=clock, **options) as arm:
        hand = Hand(arm, clock)
        try:
            yield arm, hand
        finally:
            hand.close()
