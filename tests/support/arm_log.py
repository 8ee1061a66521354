"""The commands of a virtual arm in each cycle, and checks against the limits of its model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.set_point_buffer import SERVO_LIMIT
from orinkit.virtual.rc8 import VirtualRC8


class ArmLog:
    """Records the command position of each cycle in which the arm is stepped."""

    def __init__(self, rc8: VirtualRC8, robot: int = 0) -> None:
        self._arm = rc8.state.robots[robot].arm
        self.commands: list[tuple[float, ...]] = []

    def note(self) -> None:
        self.commands.append(self._arm.queue.joints)

    @property
    def moved(self) -> bool:
        """True if a command differs from the first one."""
        return any(each != self.commands[0] for each in self.commands)

    def check_limits(self, *, newest_only: bool = False) -> None:
        """Check velocity and acceleration of every cycle, and that the arm is at standstill.

        Args:
            newest_only: True for mode 1 of slave mode, in which the arm follows a set-point that was late within the servo
                limits.
        """
        rows = np.array([self.commands[0], *self.commands, self.commands[-1]])
        steps = np.diff(rows, axis=0) / PERIOD
        bends = np.diff(steps, axis=0) / PERIOD
        axes = self._arm.model.axes
        factor = (SERVO_LIMIT if newest_only else 1.0) * (1 + 1e-6)
        accelerations = [axis.slave_acceleration if newest_only else axis.acceleration for axis in axes]
        assert np.all(np.abs(steps) <= np.array([axis.velocity for axis in axes]) * factor)
        assert np.all(np.abs(bends) <= np.array(accelerations) * factor)
        assert not self._arm.busy


@contextmanager
def logged(rc8: VirtualRC8, robot: int = 0) -> Iterator[ArmLog]:
    """Record the commands for the duration of a block."""
    arm, log = rc8.state.robots[robot].arm, ArmLog(rc8, robot)
    step = arm.step

    def step_and_note() -> bool:
        again = step()
        log.note()
        return again

    log.note()
    arm.step = step_and_note  # type: ignore[method-assign]  # replaced by the test
    try:
        yield log
    finally:
        del arm.step
