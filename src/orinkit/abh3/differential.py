"""Conversion between the motion of a differential-drive vehicle and the motor commands of its ABH3.

With the motor-axis model, the commands are the velocities of motors A and B. With the travel-axis model, they are Y
(travel) and X (turn): ``Y = (A + B) / 2``, ``X = (A - B) / 2``. The document does not define how the vehicle moves at
these velocities. The formulas here are taken from the vendor's ROS programs (v in m/s, omega in rad/s, X and Y in
min^-1)::

    v     =  Y / 60 * gear * wheel_diameter * pi
    omega = -X / 60 * gear * wheel_diameter * pi / (track / 2)

Therefore B is the motor of the right wheel: if B is faster, the vehicle turns left and omega is positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from orinkit.core.validation import check_finite, check_positive


class MotorVelocities(NamedTuple):
    """Velocities of the motors, which are the driver's commands in the motor-axis model.

    Attributes:
        a: Velocity of motor A in min^-1.
        b: Velocity of motor B in min^-1.
    """

    a: float
    b: float


class Travel(NamedTuple):
    """Velocities of the axes Y (travel) and X (turn), which are the driver's commands in the travel-axis model.

    Attributes:
        y: Travel velocity in min^-1, (A + B) / 2 of the motor velocities.
        x: Turning velocity in min^-1, (A - B) / 2 of the motor velocities, positive to the right.
    """

    y: float
    x: float


class Twist(NamedTuple):
    """The velocities of the vehicle.

    Attributes:
        v: Forward velocity, in m/s.
        omega: Angular velocity in rad/s, positive to the left.
    """

    v: float
    omega: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Differential:
    """The dimensions of a vehicle. They have no defaults, because a wrong value would cause a wrong velocity.

    Attributes:
        wheel_diameter: Wheel diameter in m.
        track: Distance between the wheels in m.
        gear: Wheel revolutions per motor revolution, 1/10 for a gear of 10:1.

    Raises:
        InvalidValue: If a value is not a finite number greater than 0.
    """

    wheel_diameter: float
    track: float
    gear: float

    def __post_init__(self) -> None:
        for name in ("wheel_diameter", "track", "gear"):
            check_positive(name, getattr(self, name))
        check_positive("gear * wheel_diameter", self.metres_per_motor_revolution)
        check_positive("track / 2", self.track / 2)

    @property
    def metres_per_motor_revolution(self) -> float:
        """Distance in m that the vehicle travels during one revolution of the motors."""
        return self.gear * self.wheel_diameter * math.pi

    def to_travel(self, v: float, omega: float) -> Travel:
        """Return the velocities of the axes Y (travel) and X (turn) in min^-1 for given velocities of the vehicle.

        Args:
            v: Forward velocity in m/s.
            omega: Angular velocity in rad/s, positive to the left.

        Raises:
            InvalidValue: If an argument is not a finite number, or the result overflows.
        """
        rim = check_finite("omega", omega) * (self.track / 2)
        return Travel(self._turns("v", check_finite("v", v)), 0.0 - self._turns("omega", rim))

    def from_travel(self, y: float, x: float) -> Twist:
        """Return the velocities of the vehicle in m/s and rad/s for velocities of the axes Y and X in min^-1.

        Y is the travel velocity, X the turning velocity.

        Raises:
            InvalidValue: If an argument is not a finite number, or the result overflows.
        """
        v = check_finite("y", y) / 60 * self.metres_per_motor_revolution
        omega = check_finite("x", x) / 60 * self.metres_per_motor_revolution / (self.track / 2)
        return Twist(check_finite("v", v), 0.0 - check_finite("omega", omega))

    def to_motors(self, v: float, omega: float) -> MotorVelocities:
        """Return the velocities of motors A and B in min^-1 for given velocities of the vehicle.

        Args:
            v: Forward velocity in m/s, as for :meth:`to_travel`.
            omega: Angular velocity in rad/s, as for :meth:`to_travel`.

        Raises:
            InvalidValue: If an argument is not a finite number, or the result overflows.
        """
        y, x = self.to_travel(v, omega)
        return MotorVelocities(check_finite("a", y + x), check_finite("b", y - x))

    def from_motors(self, a: float, b: float) -> Twist:
        """Return the velocities of the vehicle in m/s and rad/s for velocities of motors A and B in min^-1.

        Raises:
            InvalidValue: If an argument is not a finite number, or the result overflows.
        """
        a, b = check_finite("a", a), check_finite("b", b)
        return self.from_travel(a / 2 + b / 2, a / 2 - b / 2)

    def metres(self, pulses: float, pulses_per_revolution: float) -> float:
        """Return the distance in m that a wheel has rolled.

        Args:
            pulses: Difference of two pulse counts of the wheel's motor.
            pulses_per_revolution: Pulses per revolution of the motor.

        Raises:
            InvalidValue: If an argument is not a finite number, or ``pulses_per_revolution`` is not positive.
        """
        each = check_positive("pulses_per_revolution", pulses_per_revolution)
        return check_finite("metres", check_finite("pulses", pulses) / each * self.metres_per_motor_revolution)

    def _turns(self, name: str, metres_per_second: float) -> float:
        return check_finite(name, metres_per_second * 60 / self.metres_per_motor_revolution)
