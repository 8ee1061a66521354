"""One axis of a virtual ABH3: its servo and its velocity, in integer arithmetic.

The state changes in cycles of 1 ms. In each cycle the velocity changes by a fixed amount towards a target velocity.
Therefore any number of cycles can be computed at once, with exactly the same result as cycle by cycle.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from orinkit.virtual.abh3.parameters import Parameters

FINE: Final = 1_000_000
"""Number of fine units of velocity per 1 min^-1."""
_CYCLES: Final = 1000  # per second
_CODES: Final = 100  # codes of a current per 1 %


class AxisMode(Enum):
    """Mode of an axis."""

    OFF = "off"
    """The servo is off: the axis coasts until friction stops it."""
    STOP = "stop"
    """The axis decelerates to standstill; the servo stays on."""
    SPEED = "speed"
    """The axis follows a velocity command."""
    TORQUE = "torque"
    """The axis is driven by a current command."""


class AxisLimits:
    """Limits of an axis, computed from the parameters.

    Velocities are in fine units (:data:`FINE`), changes of velocity in fine units per cycle.

    Args:
        parameters: Parameters of the driver.
    """

    def __init__(self, parameters: Parameters) -> None:
        rated = parameters.rated_speed * FINE / _CYCLES
        self.fastest = round(parameters.speed_limit * FINE)
        self.strongest = round(parameters.current_limit * _CODES)
        self.accelerate = int(rated / parameters.acceleration_time) or 1
        self.decelerate = int(rated / parameters.deceleration_time) or 1
        self.friction = round(parameters.friction * _CODES)
        self._gain = rated / parameters.inertia / (100 * _CODES)

    def velocity_step(self, codes: int) -> int:
        """Return the change of velocity in fine units, with its sign, that a current causes in a cycle.

        The current is in units of 0.01 % of the rated current. If it is not 0, the change is at least 1 fine unit.
        """
        return (round(abs(codes) * self._gain) or 1) * _sign(codes)

    def current_for(self, step: int) -> int:
        """Return the current, in 0.01 % of the rated current, that changes the velocity by ``step`` in a cycle."""
        return round(step / self._gain)


class MotorAxis:
    """An axis, A/Y or B/X.

    Args:
        limits: Limits of the axis.

    Attributes:
        velocity: Velocity in fine units (:data:`FINE`).
        travelled: Twice the distance that the axis has travelled, in fine units times cycles. It is the sum, over all
            cycles, of the velocity at the beginning and the velocity at the end of the cycle.
        servo: True if the servo is on.
        mode: Mode of the axis.
        command: The command, within the limits: a velocity in fine units in mode SPEED, a current in 0.01 % of the
            rated current in mode TORQUE, otherwise 0.
        load: Current in 0.01 % that is needed to hold an external load; the load acts only while the servo is on.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self.velocity = 0
        self.travelled = 0
        self.servo = False
        self.mode = AxisMode.OFF
        self.command = 0
        self.load = 0

    def order(self, mode: AxisMode, command: int = 0) -> None:
        """Set the mode and the command that apply from the next cycle on."""
        limit = self._limits.strongest if mode is AxisMode.TORQUE else self._limits.fastest
        self.mode = mode
        self.command = max(-limit, min(command, limit))

    def run(self, cycles: int) -> None:
        """Run a number of cycles; the computing time does not depend on the number."""
        while cycles > 0:
            goal, step = self._plan()
            difference = goal - self.velocity
            if difference == 0:
                self.travelled += 2 * self.velocity * cycles
                return
            count = min(abs(difference) // step, cycles)
            if count:
                change = step * count * _sign(difference)
            else:  # the remaining difference is less than a step
                count, change = 1, difference
            self.travelled += (2 * self.velocity + change) * count
            self.velocity += change
            cycles -= count

    @property
    def velocity_command(self) -> int:
        """The target velocity in fine units; 0 except in mode SPEED."""
        return self.command if self.mode is AxisMode.SPEED else 0

    @property
    def current(self) -> int:
        """The motor current in 0.01 %."""
        if self.mode is AxisMode.OFF:
            return 0
        if self.mode is AxisMode.TORQUE:
            return self.command
        goal, step = self._plan()
        direction = _sign(goal - self.velocity)
        friction = self._limits.friction * (_sign(self.velocity) or direction)
        limit = self._limits.strongest
        return max(-limit, min(self._limits.current_for(step) * direction + friction + self.load, limit))

    def _plan(self) -> tuple[int, int]:
        """Return the velocity that the axis approaches now, and the change of velocity per cycle.

        Both are constant until the axis has reached that velocity.
        """
        velocity, limits = self.velocity, self._limits
        if self.mode is AxisMode.OFF:
            return 0, limits.velocity_step(limits.friction)
        if self.mode is AxisMode.TORQUE:
            return self._plan_torque()
        goal = self.command if self.mode is AxisMode.SPEED else 0
        if velocity * goal < 0:
            return 0, limits.decelerate
        return goal, limits.accelerate if abs(goal) > abs(velocity) else limits.decelerate

    def _plan_torque(self) -> tuple[int, int]:
        velocity, limits = self.velocity, self._limits
        torque = self.command - self.load
        direction = _sign(velocity) or _sign(torque)
        net = torque - limits.friction * direction
        if velocity == 0 and net * direction <= 0:  # the torque does not overcome friction
            return 0, 1
        if net * direction < 0:
            return 0, abs(limits.velocity_step(net))
        if abs(velocity) > limits.fastest:
            return limits.fastest * direction, limits.decelerate
        return (limits.fastest * direction if net else velocity), abs(limits.velocity_step(net)) or 1


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
