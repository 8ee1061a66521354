"""The hands of a COBOTTA: the parallel hand, and the vacuum hand.

According to documents and users of the parallel hand, its stroke is 30 mm, speeds are in percent and forces in newtons.
The speed at 100 %, the acceleration, the range of the force, and the force of HandGrip are assumptions of this project.
A real COBOTTA has one of the two hands; the virtual controller has both.
"""

from __future__ import annotations

from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.hand.fingers import Contact, FingerModel, Fingers, within
from orinkit.virtual.rc8.switches import Switches

STROKE: Final = 30.0
"""Distance between the fingers of the open hand, mm; if the hand is closed, the distance is 0."""

SPEED: Final = 80.0
"""Finger speed at 100 %, mm/s."""

ACCELERATION: Final = 800.0
"""Acceleration of the fingers, mm/s^2."""

MIN_SPEED, MAX_SPEED = 1.0, 100.0
"""Range of the speed, percent."""

MIN_FORCE, MAX_FORCE = 6.0, 20.0
"""Range of the force, N."""


class CobottaHand(Fingers):
    """The parallel hand of a COBOTTA.

    A new movement replaces the current one, which fails with STOPPED_DURING_PC_MOTION.

    Args:
        cycles: The control loop of the controller.
        switches: The switches of the controller.

    Attributes:
        motor: True if the motor is on.
        zone: True if the last HandMoveZH has gripped a workpiece within its zone.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches) -> None:
        super().__init__(cycles, switches, FingerModel(STROKE, SPEED, ACCELERATION, MAX_FORCE))
        self.motor = True
        self._zone = (0.0, 0.0)

    def move(self, target: float, speed: float, force: float = MAX_FORCE) -> Deferred[None]:
        """Open or close to a position; if the fingers meet a workpiece, they grip it and the movement ends.

        Args:
            target: Opening, 0 to 30 mm.
            speed: Speed, 1 to 100 percent.
            force: Gripping force, 6 to 20 N.

        Returns:
            A Deferred that resolves at the end of the movement.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; EMERGENCY_STOP_ON; MOTOR_NOT_ON.
        """
        return self._checked(target, speed, force, Contact.GRIPS)

    def grip(self, force: float = MAX_FORCE, *, closing: bool = True, speed: float = MAX_SPEED) -> Deferred[None]:
        """Close (open if ``closing`` is False) until the fingers meet a workpiece, and grip it.

        Returns:
            A Deferred that resolves when the workpiece is gripped. It fails with GRIP_NOT_DETECTED if the fingers reach
            the end of the stroke without a workpiece.

        Raises:
            CallError: As for :meth:`move`.
        """
        return self._checked(0.0 if closing else STROKE, speed, force, Contact.MUST_GRIP)

    def grip_in_zone(self, low: float, high: float, force: float, *, closing: bool = True) -> Deferred[None]:
        """Grip like :meth:`grip`; :attr:`in_zone` is True if the gripped workpiece is between two openings, mm.

        Raises:
            CallError: As for :meth:`move`.
        """
        for limit in (low, high):
            within(limit, 0.0, STROKE, "mm")
        done = self.grip(force, closing=closing)
        self._zone = (min(low, high), max(low, high))
        return done

    @property
    def in_zone(self) -> bool:
        """True if a workpiece is gripped within the zone of the last HandMoveZH."""
        return self.holding and self._zone[0] <= self.position <= self._zone[1]

    def _checked(self, target: float, speed: float, force: float, contact: Contact) -> Deferred[None]:
        within(target, 0.0, STROKE, "mm")
        within(speed, MIN_SPEED, MAX_SPEED, "%")
        within(force, MIN_FORCE, MAX_FORCE, "N")
        if not self._switches.emergency_stop and not self.motor:
            raise error_for(hresult.MOTOR_NOT_ON, tr("motor of the hand"))
        return self.begin(target, speed, force, contact)

    def switch_motor(self, on: bool) -> None:
        """Switch the motor of the hand without delay; switching it off releases a gripped workpiece.

        Raises:
            CallError: EMERGENCY_STOP_ON.
        """
        if on and self._switches.emergency_stop:
            raise error_for(hresult.EMERGENCY_STOP_ON)
        self.motor = on
        if not on:
            self.stop(hresult.MOTOR_NOT_ON)
            self.force = 0.0

    def status(self) -> dict[str, object]:
        """Return the state of the hand as a dictionary that can be converted to JSON."""
        return {**super().status(), "motor": self.motor}
