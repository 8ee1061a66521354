"""A virtual RC8 whose client has taken the arm and sends set-points, and set-points to send."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.values.variant import Variant, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.cell import Cell

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
P0, J0, T0, P1, J1, T1, P2, J2, T2 = 0x001, 0x002, 0x003, 0x101, 0x102, 0x103, 0x201, 0x202, 0x203


class SlaveCell(Cell):
    """A virtual RC8 with strict time, as documented; its first client has taken the arm."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"strict_time": True, **options})
        self.take()
        self.commands = [self.arm.queue.joints]

    def on(self, mode: int = J0) -> SlaveCell:
        """Enter slave mode."""
        assert self.execute("slvChangeMode", mode) is None
        return self

    def send(self, pose: Sequence[float], *beside: Any) -> Any:
        """Call slvMove and return its result: a value, a ResultWithCode, or a Deferred."""
        numbers = [float(value) for value in pose]
        if len(numbers) == 6:
            numbers += [0.0, 0.0]
        return self.robot.execute("slvMove", variant([numbers, *beside] if beside else numbers))

    def cycle(self, count: int = 1) -> None:
        """Run cycles one by one and record their commands."""
        for _ in range(count):
            self.clock.advance(PERIOD)
            self.commands.append(self.arm.queue.joints)

    def stream(self, poses: Sequence[Sequence[float]]) -> None:
        """Send a set-point for each cycle."""
        for pose in poses:
            self.send(pose)
            self.cycle()

    def move(self, interpolation: int = 1, pose: Any = "@E J(10, 45, 90, 0, 45, 0)", option: str = "") -> Any:
        """Start a motion."""
        return super().move(interpolation, pose, option)

    @property
    def mode(self) -> int:
        """The mode returned by slvGetMode."""
        return self.execute("slvGetMode")

    @property
    def error(self) -> int:
        """The code of the controller's latest error, 0 if there is none."""
        return self.rc8.state.faults.code

    def rest(self) -> list[tuple[float, ...]]:
        """Run until the arm is at standstill; return all commands."""
        for _ in range(500):
            if not self.arm.busy:
                break
            self.cycle()
        assert not self.arm.busy
        self.cycle(2)
        assert self.commands[-1] == self.commands[-2]
        return self.commands

    def check_brake(self, since: int) -> None:
        """Check the braking from a command on: in a straight line, within the accelerations of the model, never backwards."""
        steps = np.diff(np.array(self.commands), axis=0)
        bends = np.diff(steps, axis=0)[since - 1 :] / PERIOD**2
        limits = np.array([axis.acceleration for axis in self.arm.model.axes])
        assert np.all(np.abs(bends) <= limits * (1 + 1e-6))
        first = steps[since - 1]
        speeds = steps[since - 1 :] @ first / (first @ first)
        assert np.all(np.diff(speeds) <= 1e-9)
        assert np.all(speeds >= -1e-9)
        assert np.allclose(steps[since:], speeds[1:, None] * first, atol=1e-9)  # in a straight line


def sine(count: int = 101, axes: Sequence[int] = (0, 1), amplitude: float = 10.0) -> list[tuple[float, ...]]:
    """Return the set-points of the sample program of RC8 4.9: one period of a sine, from the home pose and back."""
    moved = []
    for index in range(count):
        off = amplitude * (1 - math.cos(2 * math.pi * index / 100))
        moved.append(tuple(q + off * (axis in axes) for axis, q in enumerate(HOME)))
    return moved


def straight(step: float, count: int, ramp: float = 0.12, axis: int = 0) -> Iterator[tuple[float, ...]]:
    """Yield set-points of one axis whose step grows by ``ramp`` deg per cycle up to ``step`` deg."""
    place, speed = HOME[axis], 0.0
    for _ in range(count):
        speed = min(step, speed + ramp)
        place += speed
        yield (*HOME[:axis], place, *HOME[axis + 1 :])


def code(result: Any) -> int:
    """Return the success code of a result."""
    return result.code if isinstance(result, ResultWithCode) else 0


def value(result: Any) -> Any:
    """Return a result as a plain Python value."""
    if isinstance(result, Deferred):
        result = result.result()
    if isinstance(result, ResultWithCode):
        result = result.value
    return result.plain if isinstance(result, Variant) else result
