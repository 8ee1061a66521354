"""Limits of the commands in slave mode (RC8 4.8): velocity and acceleration of each axis."""

from __future__ import annotations

from typing import Final

from orinkit.arms import ArmModel, AxisModel
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.set_point_buffer import LENIENCY, SERVO_LIMIT, SlaveFault
from orinkit.virtual.rc8.robot.speeds import FULL, Speeds
from orinkit.virtual.rc8.switches import SlaveLimit, Switches

_ROUNDING: Final = 1 + 1e-6
_LINKED: Final = (SlaveLimit.SERVO_EXTERNAL, SlaveLimit.COMMAND_EXTERNAL)
_SERVO: Final = (SlaveLimit.SERVO, SlaveLimit.SERVO_EXTERNAL)


class SlaveLimits:
    """The limits that the parameter "153: b-CAP Slave speed setting" selects.

    Args:
        model: The arm model.
        switches: The switches of the controller, including this parameter.
        speeds: The speeds of the arm; some settings multiply the limits by the external speeds.
    """

    def __init__(self, model: ArmModel, switches: Switches, speeds: Speeds) -> None:
        self._axes = model.axes
        self._switches = switches
        self._speeds = speeds

    def violation(self, before: Joints, now: Joints, wanted: Joints, *, lenient: bool) -> SlaveFault | None:
        """Return the first limit that a command position violates, or None.

        The velocities of all axes are checked before the accelerations; axes are checked in the order of their numbers.

        Args:
            before: The command position one cycle before the present one, deg or mm.
            now: The present command position.
            wanted: The next command position, which is checked.
            lenient: True to multiply the limits by :data:`~orinkit.virtual.engine.set_point_buffer.LENIENCY`.
        """
        speed, acceleration = self._parts()
        tolerance = LENIENCY * _ROUNDING if lenient else _ROUNDING
        for number, (axis, b, c) in enumerate(zip(self._axes, now, wanted, strict=True)):
            if abs(c - b) > axis.velocity * speed * tolerance * PERIOD:
                return _fault(hresult.SENT_SPEED_OVER_AXIS1 + number, axis, (c - b) / PERIOD, axis.velocity * speed, 1)
        for number, (axis, a, b, c) in enumerate(zip(self._axes, before, now, wanted, strict=True)):
            change = (c - b) - (b - a)
            limit = axis.slave_acceleration * acceleration
            if abs(change) > limit * tolerance * PERIOD**2:
                return _fault(hresult.COMMAND_ACCELERATION_OVER_AXIS1 + number, axis, change / PERIOD**2, limit, 2)
        return None

    def stops_suddenly(self, before: Joints, now: Joints) -> bool:
        """Return True if a stop at the present command position exceeds the accelerations of planned motions.

        The limit of set-points is larger, so that a client may send such a stop on purpose.
        """
        part = self._parts()[1] * _ROUNDING * PERIOD**2
        return any(abs(b - a) > axis.acceleration * part for axis, a, b in zip(self._axes, before, now, strict=True))

    def _parts(self) -> tuple[float, float]:
        """Return the limits as fractions of the model's velocity and acceleration."""
        setting, external = self._switches.slave_limit, self._speeds.external
        part = SERVO_LIMIT if setting in _SERVO else 1.0
        if setting not in _LINKED:
            return part, part
        return part * external.speed / FULL, part * external.accel / FULL


def _fault(code: int, axis: AxisModel, value: float, limit: float, order: int) -> SlaveFault:
    unit = ("mm" if axis.linear else "deg") + ("/s" if order == 1 else "/s^2")
    return SlaveFault(
        code, tr("{value:.6g} {unit} exceeds the limit of {most:.6g}", value=value, unit=unit, most=limit)
    )
