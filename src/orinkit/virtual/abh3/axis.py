"""One axis of a virtual ABH3: its servo and its velocity, in whole numbers.

All states follow each other in cycles of 1 ms. In each of them the velocity goes towards a goal by a fixed step, so that
any number of cycles is computed at once, with the very same result as one after the other.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from orinkit.virtual.abh3.parameters import Parameters

FINE: Final = 1_000_000
"""Fine units of a velocity in 1 min^-1."""
_CYCLES: Final = 1000  # in 1 s
_CODES: Final = 100  # of a current, in 1 %


class AxisMode(Enum):
    """What an axis does."""

    OFF = "off"
    """The servo is off: it coasts until friction has stopped it."""
    STOP = "stop"
    """It decelerates and then stands with the servo on."""
    SPEED = "speed"
    """It follows a velocity."""
    TORQUE = "torque"
    """It turns by a current."""


class AxisLimits:
    """What the parameters mean for an axis: velocities in fine units, steps in fine units each cycle.

    Args:
        parameters: of the driver.
    """

    def __init__(self, parameters: Parameters) -> None:
        rated = parameters.rated_speed * FINE / _CYCLES
        self.fastest = round(parameters.speed_limit * FINE)
        self.strongest = round(parameters.current_limit * _CODES)
        self.accelerate = int(rated / parameters.acceleration_time) or 1
        self.decelerate = int(rated / parameters.deceleration_time) or 1
        self.friction = round(parameters.friction * _CODES)
        self._gain = rated / parameters.inertia / (100 * _CODES)

    def step(self, codes: int) -> int:
        """Return what a current (0.01 %) changes the velocity by in a cycle; 1 at least, unless it is 0."""
        return (round(abs(codes) * self._gain) or 1) * _sign(codes)

    def current(self, step: int) -> int:
        """Return the current (0.01 %) that changes the velocity so."""
        return round(step / self._gain)


class MotorAxis:
    """An axis, A/Y or B/X.

    Args:
        limits: of the driver.

    Attributes:
        velocity: in fine units.
        travelled: sum over all cycles of the velocities at their beginning and their end: twice the way.
        servo: whether the servo is on.
        mode: what it does.
        command: velocity in fine units in mode SPEED, current in 0.01 % in mode TORQUE, within the limits.
        load: current in 0.01 % that a load from outside takes to hold it; acts while the servo is on.
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
        """Do something else from the next cycle on."""
        most = self._limits.strongest if mode is AxisMode.TORQUE else self._limits.fastest
        self.mode = mode
        self.command = max(-most, min(command, most))

    def run(self, cycles: int) -> None:
        """Go on by a number of cycles. Takes a few steps of computing, however many they are."""
        while cycles > 0:
            goal, step = self._plan()
            way = goal - self.velocity
            if way == 0:
                self.travelled += 2 * self.velocity * cycles
                return
            count = min(abs(way) // step, cycles)
            if count:
                change = step * count * _sign(way)
            else:  # the rest of the way takes less than a cycle
                count, change = 1, way
            self.travelled += (2 * self.velocity + change) * count
            self.velocity += change
            cycles -= count

    @property
    def velocity_command(self) -> int:
        """The velocity that it is to reach, in fine units."""
        return self.command if self.mode is AxisMode.SPEED else 0

    @property
    def current(self) -> int:
        """The current that it takes, in 0.01 %."""
        if self.mode is AxisMode.OFF:
            return 0
        if self.mode is AxisMode.TORQUE:
            return self.command
        goal, step = self._plan()
        direction = _sign(goal - self.velocity)
        friction = self._limits.friction * (_sign(self.velocity) or direction)
        most = self._limits.strongest
        return max(-most, min(self._limits.current(step) * direction + friction + self.load, most))

    def _plan(self) -> tuple[int, int]:
        """Return the velocity that it goes to now, and the step; neither changes before that velocity is there."""
        velocity, limits = self.velocity, self._limits
        if self.mode is AxisMode.OFF:
            return 0, limits.step(limits.friction)
        if self.mode is AxisMode.TORQUE:
            return self._driven()
        goal = self.command if self.mode is AxisMode.SPEED else 0
        if velocity * goal < 0:
            return 0, limits.decelerate
        return goal, limits.accelerate if abs(goal) > abs(velocity) else limits.decelerate

    def _driven(self) -> tuple[int, int]:
        velocity, limits = self.velocity, self._limits
        torque = self.command - self.load
        direction = _sign(velocity) or _sign(torque)
        net = torque - limits.friction * direction
        if velocity == 0 and net * direction <= 0:  # it does not break away
            return 0, 1
        if net * direction < 0:
            return 0, abs(limits.step(net))
        if abs(velocity) > limits.fastest:
            return limits.fastest * direction, limits.decelerate
        return (limits.fastest * direction if net else velocity), abs(limits.step(net)) or 1


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
