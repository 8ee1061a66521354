"""Limits of the commands in slave mode (RC8 4.8): the velocity and the acceleration that each axis may have."""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.arms import ArmModel, AxisModel
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.rc8.robot.speeds import FULL, Speeds
from orinkit.virtual.rc8.switches import SlaveLimit, Switches

SERVO_LIMIT: Final = 1.25
"""The servo limit as a multiple of the command limit, which is the model's. DENSO publishes only that it is larger; the
number is this project's assumption."""

LENIENCY: Final = 2.0
"""By how much the limits are larger where the server was late, and not the client."""

_ROUNDING: Final = 1 + 1e-6
_LINKED: Final = (SlaveLimit.SERVO_EXTERNAL, SlaveLimit.COMMAND_EXTERNAL)
_SERVO: Final = (SlaveLimit.SERVO, SlaveLimit.SERVO_EXTERNAL)


class SlaveFault(NamedTuple):
    """Why a command is not carried out: code, and details in words."""

    code: int
    detail: str


class SlaveLimits:
    """What "153: b-CAP Slave speed setting" allows at this moment.

    Args:
        model: of the arm.
        switches: of the controller; they have the setting.
        speeds: of the arm; the external ones count where the setting says so.
    """

    def __init__(self, model: ArmModel, switches: Switches, speeds: Speeds) -> None:
        self._axes = model.axes
        self._switches = switches
        self._speeds = speeds

    def fault(self, before: Joints, now: Joints, wanted: Joints, *, lenient: bool) -> SlaveFault | None:
        """Return what is wrong with a command: velocities come before accelerations, lower axes before higher ones.

        Args:
            before: the command one cycle ago, deg or mm.
            now: the present command.
            wanted: the next one.
            lenient: the limits are :data:`LENIENCY` times as large.
        """
        speed, acceleration = self._parts()
        more = LENIENCY * _ROUNDING if lenient else _ROUNDING
        for number, (axis, b, c) in enumerate(zip(self._axes, now, wanted, strict=True)):
            if abs(c - b) > axis.velocity * speed * more * PERIOD:
                return _fault(hresult.SENT_SPEED_OVER_AXIS1 + number, axis, (c - b) / PERIOD, axis.velocity * speed, 1)
        for number, (axis, a, b, c) in enumerate(zip(self._axes, before, now, wanted, strict=True)):
            change = (c - b) - (b - a)
            if abs(change) > axis.acceleration * acceleration * more * PERIOD**2:
                most = axis.acceleration * acceleration
                return _fault(hresult.COMMAND_ACCELERATION_OVER_AXIS1 + number, axis, change / PERIOD**2, most, 2)
        return None

    def _parts(self) -> tuple[float, float]:
        """Return the limits as parts of the model's velocity and acceleration."""
        setting, external = self._switches.slave_limit, self._speeds.external
        part = SERVO_LIMIT if setting in _SERVO else 1.0
        if setting not in _LINKED:
            return part, part
        return part * external.speed / FULL, part * external.accel / FULL


def _fault(code: int, axis: AxisModel, value: float, most: float, order: int) -> SlaveFault:
    unit = ("mm" if axis.linear else "deg") + ("/s" if order == 1 else "/s^2")
    return SlaveFault(code, tr("{value:.6g} {unit}; the limit is {most:.6g}", value=value, unit=unit, most=most))
