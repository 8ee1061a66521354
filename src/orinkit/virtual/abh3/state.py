"""State of a virtual ABH3 at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from orinkit.abh3.table.records import Flags


@dataclass(frozen=True, slots=True)
class DriverState:
    """State of a driver at one moment. Velocities have a higher resolution than on CAN.

    Attributes:
        time: Time of the driver's clock, s.
        ay_velocity_command: Target velocity of A/Y, min^-1; 0 in torque mode, or if start is off.
        bx_velocity_command: Target velocity of B/X, min^-1; 0 in torque mode, or if start is off.
        ay_velocity: Velocity of A/Y, min^-1.
        bx_velocity: Velocity of B/X, min^-1.
        a_velocity: Velocity of motor A, min^-1.
        b_velocity: Velocity of motor B, min^-1.
        y_velocity: Velocity (A + B) / 2, min^-1.
        x_velocity: Velocity (A - B) / 2, min^-1.
        ay_current_command: Current command of A/Y, %.
        bx_current_command: Current command of B/X, %.
        a_load: Load of motor A, %, 0 to 255.
        b_load: Load of motor B, %, 0 to 255.
        a_pulses: Pulse count of motor A, signed 32 bits.
        b_pulses: Pulse count of motor B, signed 32 bits.
        analog_0: Analog input 0, V.
        analog_1: Analog input 1, V.
        main_voltage: Main supply, V.
        control_voltage: Control supply, V.
        monitor_0: Value of monitor 0, see :meth:`VirtualABH3.set_monitor`.
        monitor_1: Value of monitor 1.
        inputs: Inputs as last sent by the host.
        external: The terminals that are combined with inputs; a terminal has the bit of its input.
        control: Control flags.
        io: I/O flags.
        errors: Error flags.
        warnings: Warning flags.
        ay_servo: True if the servo of A/Y is actually on.
        bx_servo: True if the servo of B/X is actually on.
        ay_set: Number of the data set of A/Y, 0 to 7.
        bx_set: Number of the data set of B/X, 0 to 7.
    """

    time: float
    ay_velocity_command: float
    bx_velocity_command: float
    ay_velocity: float
    bx_velocity: float
    a_velocity: float
    b_velocity: float
    y_velocity: float
    x_velocity: float
    ay_current_command: float
    bx_current_command: float
    a_load: float
    b_load: float
    a_pulses: int
    b_pulses: int
    analog_0: float
    analog_1: float
    main_voltage: float
    control_voltage: float
    monitor_0: float
    monitor_1: float
    inputs: Flags
    external: Flags
    control: Flags
    io: Flags
    errors: Flags
    warnings: Flags
    ay_servo: bool
    bx_servo: bool
    ay_set: int
    bx_set: int

    @property
    def moving(self) -> bool:
        """True if a motor turns."""
        return bool(self.ay_velocity or self.bx_velocity)


MONITORS: Final = (
    "ay_velocity_command",
    "bx_velocity_command",
    "ay_velocity",
    "bx_velocity",
    "a_velocity",
    "b_velocity",
    "y_velocity",
    "x_velocity",
    "ay_current_command",
    "bx_current_command",
    "a_load",
    "b_load",
    "a_pulses",
    "b_pulses",
    "analog_0",
    "analog_1",
    "main_voltage",
    "control_voltage",
)
"""Names of the quantities of :class:`DriverState` that a monitor can show."""
