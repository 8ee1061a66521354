"""A virtual RC8 with two robots, and a client that has taken both arms."""

from __future__ import annotations

from typing import Any

import numpy as np

from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.cell import Cell

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
APART = "P(900, 0, 0, 0, 0, 180)"
FAR = ("J(120, 20, 110, 40, 30, 90)", "J(-60, 30, 100, 20, 40, 30)")


class TwoArms(Cell):
    """Two robots, 900 mm apart, facing each other; the motors are on.

    Attributes:
        arms: the arms.
        robots: the Robot objects of the first client.
        traces: the command joints of both arms after each cycle.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"second_model": "VS-060", "second_joints": HOME, **options})
        self.arms = [robot.arm for robot in self.rc8.state.robots]
        self.robots = [self.robot, self.controller.get_robot("Second", "ID=1")]
        self.traces: list[list[tuple[float, ...]]] = [[arm.queue.joints] for arm in self.arms]

    def take(self) -> TwoArms:
        """Take both arms, and place the second one opposite to the first."""
        for robot in (0, 1):
            self.of(robot, "TakeArm", [0, 0])
        self.of(1, "SetBaseDef", [0, APART])
        return self

    def of(self, robot: int, command: str, parameter: Any = None) -> Any:
        """Execute a command of a robot to its end."""
        return self.run(self.robots[robot].execute(command, variant(parameter)))

    def begin(self, robot: int, command: str, parameter: Any = None) -> Any:
        """Begin a command of a robot; return its result or a Deferred."""
        return self.robots[robot].execute(command, variant(parameter))

    def move_of(self, robot: int, interpolation: int, pose: Any, option: str = "") -> Any:
        """Start a motion of a robot."""
        return self.robots[robot].move(interpolation, variant(pose), option)

    def cycle(self, count: int = 1) -> None:
        """Run cycles one by one and record the commands of both arms."""
        for _ in range(count):
            self.clock.advance(PERIOD)
            for trace, arm in zip(self.traces, self.arms, strict=True):
                trace.append(arm.queue.joints)

    def until_done(self, result: Any, most: int = 5000) -> Any:
        """Run cycles until a deferred result is available, and return it."""
        for _ in range(most):
            if result.done():
                return result.result()
            self.cycle()
        raise AssertionError("still not done")

    @property
    def moved(self) -> list[bool]:
        """For each arm, True if a command differs from the first one."""
        return [any(joints != trace[0] for joints in trace) for trace in self.traces]

    def check_limits(self) -> None:
        """Check velocity and acceleration of every joint in every cycle, and that both arms are at standstill."""
        self.cycle(2)
        for trace, arm in zip(self.traces, self.arms, strict=True):
            rows = np.array([trace[0], trace[0], *trace])
            velocity = np.diff(rows, axis=0) / PERIOD
            acceleration = np.diff(velocity, axis=0) / PERIOD
            axes = arm.model.axes
            assert np.all(np.abs(velocity) <= np.array([axis.velocity for axis in axes]) * (1 + 1e-6))
            assert np.all(np.abs(acceleration) <= np.array([axis.acceleration for axis in axes]) * (1 + 1e-6))
            assert trace[-1] == trace[-2]
            assert not arm.busy

    def tool(self, robot: int, joints: tuple[float, ...] | None = None) -> Any:
        """The tool frame (4, 4) of a robot in the world."""
        space = self.arms[robot].space
        return space.bases.matrix(0) @ space.tcp(self.arms[robot].queue.joints if joints is None else joints)

    @property
    def grasp(self) -> Any:
        """The tool of the second robot relative to the tool of the first one."""
        return np.linalg.inv(self.tool(0)) @ self.tool(1)
