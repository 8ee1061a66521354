"""Helpers of the tests of streaming: a served virtual RC8 that logs the commands of its arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import orinkit
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from support.hand import Hand

PATIENCE = 30.0
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
ROUNDING = 1e-6


def sine(
    seconds: float, amplitude: float = 10.0, axes: tuple[int, ...] = (0, 1), home: Any = HOME
) -> list[tuple[float, ...]]:
    """Return a trajectory from standstill to standstill: two periods of a sine on some joints, without repeated set-points.

    Repeated set-points would be a standstill, in which a late set-point is not a gap.
    """
    count = 4 * round(seconds / PERIOD / 4)
    points = []
    for number in range(count + 1):
        sway = amplitude * (1 - math.cos(4 * math.pi * number / count)) / 2
        points.append(tuple(joint + sway * (axis in axes) for axis, joint in enumerate(home)))
    return points


class Arm:
    """A served virtual RC8 and an evaluation of its log."""

    def __init__(self, device: VirtualRC8, url: str) -> None:
        self.device = device
        self.url = url
        self.arm = device.state.arm
        self.model = self.arm.model
        self.record()

    def record(self) -> None:
        """Clear the log and start it again."""
        with self.device.state.cycles:
            self.arm.log.clear()
            self.arm.log.running = True
            self.device.state.cycles.wake()

    @property
    def commands(self) -> np.ndarray[Any, Any]:
        """The command joints, one row per cycle."""
        with self.device.state.cycles:
            log = self.arm.log
            rows = [log.record(index)[0:24:4] for index in range(len(log))]
        return np.array(rows, dtype=float).reshape(-1, 6)

    @property
    def errors(self) -> list[int]:
        """The codes of all logged errors, oldest first."""
        log = self.device.state.faults.log
        return [log.at(index).code for index in reversed(range(len(log)))]

    @property
    def mode(self) -> int:
        """The mode returned by slvGetMode."""
        mode = self.arm.slave.mode
        return mode.number if mode is not None else 0

    def peaks(self) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Return the largest velocity and acceleration of each joint, as fractions of the arm's limits."""
        commands = self.commands
        axes = self.model.axes[:6]
        velocity = np.abs(np.diff(commands, axis=0)).max(axis=0) / PERIOD
        acceleration = np.abs(np.diff(commands, n=2, axis=0)).max(axis=0) / PERIOD**2
        return (
            velocity / np.array([axis.velocity for axis in axes]),
            acceleration / np.array([axis.acceleration for axis in axes]),
        )

    def within_limits(self) -> bool:
        """Return True if no joint has exceeded the velocity or acceleration limits of the arm."""
        velocity, acceleration = self.peaks()
        return bool((velocity <= 1 + ROUNDING).all() and (acceleration <= 1 + ROUNDING).all())

    def carried_out(self, points: list[tuple[float, ...]]) -> bool:
        """Return True if these points were executed, one per cycle, without a gap."""
        commands = [tuple(row) for row in self.commands.tolist()]
        count = len(points)
        return any(commands[index : index + count] == points for index in range(len(commands) - count + 1))

    def standing(self) -> bool:
        """Return True if the arm is at standstill and slave mode is off."""
        return not self.arm.busy and self.mode == 0

    def free(self) -> bool:
        """Return True if the arm is at standstill and free."""
        return self.standing() and self.arm.holder is None


@contextmanager
def served(
    *, scale: float = 1.0, listen: str = "tcp://127.0.0.1:0", clock: Clock | None = None, **options: Any
) -> Iterator[Arm]:
    """Serve a virtual RC8 with its motor on."""
    device = VirtualRC8(clock=clock or Clock(scale), **{"motor": True, **options})
    with orinkit.serve(device, listen) as server:
        yield Arm(device, server.url)


@contextmanager
def by_hand(**options: Any) -> Iterator[tuple[Arm, Hand]]:
    """Serve a virtual RC8 whose clock is advanced by a :class:`Hand`."""
    clock = ManualClock()
    with served(clock=clock, **options) as arm:
        hand = Hand(arm.device, clock)
        try:
            yield arm, hand
        finally:
            hand.close()
