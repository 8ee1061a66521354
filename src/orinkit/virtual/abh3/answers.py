"""Frames of a virtual ABH3, built from its state."""

from __future__ import annotations

from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import BR0, BR1, BR1V2, BR2, BR3, BR4, BR5, BR6, DP0R, DP0RV2, Record
from orinkit.abh3.table.signals import ANALOG, CURRENT, VOLTAGE, Dialect, Quantity
from orinkit.virtual.abh3.axis import FINE
from orinkit.virtual.abh3.drive import held, load, velocity
from orinkit.virtual.abh3.state import DriverState


class ReportBuilder:
    """Builds the frames of one dialect.

    Args:
        dialect: The dialect; its frame BR3 must already have the unit of loads that the driver uses.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.codec = Codec(dialect)
        self._v2 = dialect.name == "v2"
        loads = {field.name: field.quantity for field in dialect.layouts["BR3"].fields}["a_load"]
        assert loads is not None
        self._load = loads

    def data(self, name: str, state: DriverState) -> bytes:
        """Return the data of a frame, ``"DP0R"`` or ``"BR0"`` to ``"BR6"``; values are limited to their ranges."""
        return self.codec.encode(self._record(name, state), name)

    def _record(self, name: str, s: DriverState) -> Record:
        if name == "DP0R":
            return self._feedback(s)
        if name == "BR0":
            return BR0(s.errors, s.warnings)
        if name == "BR1":
            return BR1V2(s.io, s.external) if self._v2 else BR1(s.control, s.io)
        if name == "BR2":
            return BR2(
                _velocity(s.ay_velocity_command),
                _velocity(s.bx_velocity_command),
                _velocity(s.ay_velocity),
                _velocity(s.bx_velocity),
            )
        if name == "BR3":
            return BR3(
                _value(CURRENT, s.ay_current_command),
                _value(CURRENT, s.bx_current_command),
                load(s.a_load, self._load),
                load(s.b_load, self._load),
            )
        if name == "BR4":
            return BR4(s.a_pulses, s.b_pulses)
        if name == "BR5":
            return BR5(
                _value(ANALOG, s.analog_0),
                _value(ANALOG, s.analog_1),
                _value(VOLTAGE, s.main_voltage),
                _value(VOLTAGE, s.control_voltage),
            )
        return BR6(s.monitor_0, s.monitor_1)

    def _feedback(self, s: DriverState) -> Record:
        if self._v2:
            return DP0RV2(_velocity(s.ay_velocity), _velocity(s.bx_velocity), s.control)
        return DP0R(_velocity(s.a_velocity), _velocity(s.b_velocity), _velocity(s.y_velocity), _velocity(s.x_velocity))


def _velocity(value: float) -> float:
    return velocity(round(value * 2 * FINE), 2)  # the mean of two velocities may be a multiple of half a fine unit


def _value(quantity: Quantity, value: float) -> float:
    return held(quantity, round(value * quantity.steps))
