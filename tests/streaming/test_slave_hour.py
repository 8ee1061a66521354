"""Random live targets over a connection, for a long time: no command of the arm violates a limit."""

from __future__ import annotations

import math
import random
import time
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit.cao.provider import ClientInfo
from orinkit.core.errors import InvalidValue
from orinkit.streaming.planning.joint_planner import JointPlanner
from orinkit.streaming.planning.limits import Limits
from orinkit.values.poses import J
from orinkit.values.variant import variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from support.streams import HOME, PERIOD, Arm, served

TOLERANCE = 1 + 1e-6


class Monitor:
    """Checks every command of the arm; the control log holds only 100 s."""

    def __init__(self, arm: Arm) -> None:
        axes = arm.model.axes[:6]
        self.velocity = np.array([axis.velocity for axis in axes]) * PERIOD * TOLERANCE
        self.acceleration = np.array([axis.acceleration for axis in axes]) * PERIOD**2 * TOLERANCE
        self.low = np.array([axis.lower for axis in axes])
        self.high = np.array([axis.upper for axis in axes])
        self.cycles = 0
        self.bad: list[Any] = []
        self.moved = np.zeros(6)
        self._before = self._earlier = np.array(arm.arm.queue.joints[:6])
        servo = arm.arm.servo
        step = servo.step

        def watched(command: tuple[float, ...]) -> bool:
            self.look(np.array(command[:6]))
            return step(command)

        servo.step = watched

    def look(self, now: Any) -> None:
        way, change = now - self._before, now - 2 * self._before + self._earlier
        wrong = (abs(way) > self.velocity) | (abs(change) > self.acceleration) | (now < self.low) | (now > self.high)
        if wrong.any():
            self.bad.append((self.cycles, self._earlier, self._before, now))
        self.moved += abs(way)
        self._earlier, self._before = self._before, now
        self.cycles += 1


def target(rng: random.Random, arm: Arm, seconds: float) -> tuple[float, ...]:
    """Return a jump, a step, an oscillation at 10 Hz, the same target again, or a target out of range."""
    axes = arm.model.axes[:6]
    kind = rng.randrange(6)
    if kind == 0:
        return tuple(rng.uniform(axis.lower, axis.upper) for axis in axes)
    if kind == 1:
        return tuple(joint + rng.uniform(-5, 5) for joint in HOME)
    if kind == 2:
        return tuple(joint + 30 * math.sin(2 * math.pi * 10 * seconds) for joint in HOME)
    if kind == 3:
        return HOME
    if kind == 4:
        return tuple(rng.uniform(-1e4, 1e4) for _ in axes)
    return tuple(rng.choice((axis.lower, axis.upper)) for axis in axes)


def stream(arm: Arm, seconds: float) -> Monitor:
    """Set targets at irregular times for some seconds of the controller's time, which runs slower on a busy machine."""
    rng = random.Random(4)
    monitor = Monitor(arm)
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor(), robot.slave_mode() as live:
            while monitor.cycles < seconds / PERIOD:
                live.target = J(*target(rng, arm, time.monotonic()))
                if not rng.randrange(20):
                    with pytest.raises(InvalidValue):
                        live.target = (math.nan, *HOME[1:])
                time.sleep(rng.choice((0.0, 0.001, 0.004, 0.03, 0.3)))
    return monitor


def check(arm: Arm, monitor: Monitor, seconds: float) -> None:
    assert monitor.bad == []
    assert arm.errors == []
    assert monitor.cycles > seconds / PERIOD - 2  # the first and the last may be cut short
    assert (monitor.moved > 10).all()


def test_random_targets_over_the_wire() -> None:
    with served() as arm:
        check(arm, stream(arm, 4.0), 4.0)
        assert arm.mode == 0


def by_hand(seconds: float) -> None:
    """Run planner and controller cycle by cycle, with a clock that the test controls."""
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    arm = Arm(device, "")
    arm.arm.log.running = False
    monitor = Monitor(arm)
    robot = device.connect("c", "", "", ClientInfo("127.0.0.1", "tcp")).get_robot("Arm", "")
    robot.execute("TakeArm", variant([0, 0]))
    robot.execute("slvChangeMode", variant(0x202))
    planner = JointPlanner(Limits.of_model(arm.model), PERIOD, HOME)
    rng = random.Random(5)
    wanted = HOME
    for number in range(round(seconds / PERIOD)):
        if not rng.randrange(12):
            wanted = target(rng, arm, number * PERIOD)
        if not rng.randrange(2000):
            with pytest.raises(InvalidValue):
                planner.goto((math.nan, *HOME[1:]))
        robot.execute("slvMove", variant([*planner.goto(wanted), 0.0, 0.0]))
        clock.advance(PERIOD)
    check(arm, monitor, seconds)


def test_a_minute_of_random_targets() -> None:
    by_hand(60.0)


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_an_hour_of_random_targets() -> None:
    by_hand(3600.0)
