"""What a virtual ABH3 looks like at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from orinkit.abh3.table.records import Flags


@dataclass(frozen=True, slots=True)
class DriverState:
    """A driver at one moment. Velocities are finer than on CAN.

    Attributes:
        time: of the driver's clock, s.
        ay_velocity_command: what A/Y is to reach, min^-1; 0 in torque mode, and where start is off.
        bx_velocity_command: B/X.
        ay_velocity: min^-1.
        bx_velocity: min^-1.
        a_velocity: of motor A, min^-1.
        b_velocity: of motor B.
        y_velocity: (A + B) / 2.
        x_velocity: (A - B) / 2.
        ay_current_command: %.
        bx_current_command: %.
        a_load: %, 0 to 255.
        b_load: %, 0 to 255.
        a_pulses: signed, 32 bits.
        b_pulses: signed, 32 bits.
        analog_0: V.
        analog_1: V.
        main_voltage: V.
        control_voltage: V.
        monitor_0: what was chosen by ``set_monitor``.
        monitor_1: the same.
        inputs: as the host has sent them.
        external: terminals, numbered like the inputs.
        control: control flags.
        io: I/O flags.
        errors: error flags.
        warnings: warning flags.
        ay_servo: whether the servo of A/Y is on in fact.
        bx_servo: the same of B/X.
        ay_set: number of the data set of A/Y, 0 to 7.
        bx_set: the same of B/X.
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
        """Whether a motor turns."""
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
"""What a monitor can show."""
