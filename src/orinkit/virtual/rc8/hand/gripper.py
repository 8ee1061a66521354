"""An electric gripper on an extension board, ``Hand0`` to ``Hand7``, with the commands of the provider guide (5.2.36).

Ranges and types are those of the guide. The guide does not define the mechanics of a gripper, the numbers of the modes
and of the errors, the origin, nor the points that are stored initially; they are decisions of this project:

* The stroke is 30 mm, and positions are openings. The origin is the open hand.
* Points 0, 2, 4 ... close until they hold; points 1, 3, 5 ... open completely.
* At power-on, the motor is off and the origin is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.hand.fingers import Contact, FingerModel, Fingers, within
from orinkit.virtual.rc8.switches import Switches

BOARDS: Final = 8
"""Number of boards that a controller can have."""
POINTS: Final = 32
"""Number of points of a gripper (5.2.36)."""

MODEL: Final = FingerModel(stroke=30.0, speed=80.0, acceleration=800.0, force=20.0)
"""The mechanics; an assumption of this project."""

MOST: Final = 999.90
"""Largest amount of a position in a command, mm."""
SPEEDS: Final = (20, 100)
"""Range of the speed, percent."""
HOLDING_SPEEDS: Final = (20, 50)
"""Range of the speed of a movement until the gripper holds, percent."""
FORCES: Final = (30, 100)
"""Range of the force, percent."""
_ORIGIN_SPEED: Final = 20


class PointMode(IntEnum):
    """The movement of a point."""

    ABSOLUTE = 0
    RELATIVE = 1
    ABSOLUTE_HOLD = 2
    RELATIVE_HOLD = 3
    HOLD = 4
    ZONE_HOLD = 5


class GripperError(IntEnum):
    """The errors of a gripper (get_Error); after an error, the gripper has to return to its origin."""

    NONE = 0
    EMERGENCY_STOP = 1
    OVERLOAD = 2


@record
class Point:
    """The data of a point.

    Attributes:
        mode: The movement.
        distance: Position or distance, mm; for HOLD and ZONE_HOLD, 0 opens and other values close.
        speed: Speed, percent.
        force: Force, percent.
        zone: The zone of ZONE_HOLD, mm.
    """

    mode: PointMode = PointMode.ABSOLUTE
    distance: float = 0.0
    speed: int = SPEEDS[1]
    force: int = FORCES[1]
    zone: tuple[float, float] = (0.0, 0.0)

    @property
    def holds(self) -> bool:
        """True if the movement can hold a workpiece."""
        return self.mode >= PointMode.ABSOLUTE_HOLD

    def items(self) -> tuple[int, float, int, int, float, float]:
        """Return mode, distance, speed, force and zone, in the order of GetPoint."""
        return int(self.mode), self.distance, self.speed, self.force, *self.zone


_CLOSE: Final = Point(PointMode.HOLD, 1.0, HOLDING_SPEEDS[1], FORCES[1])
_OPEN: Final = Point(PointMode.ABSOLUTE, MODEL.stroke, SPEEDS[1], FORCES[1])
DEFAULT_POINTS: Final = (_CLOSE, _OPEN) * (POINTS // 2)
"""The points that are stored initially."""


class Gripper(Fingers):
    """An electric gripper.

    A command that moves the gripper is refused while it is busy. If a movement that does not control the force meets a
    workpiece, and if the emergency stop ends a movement, the gripper has an error.

    Args:
        cycles: The control loop of the controller.
        switches: The switches of the controller.
        number: Number of the board.

    Attributes:
        motor: True if the motor is on.
        origin: True if the gripper has returned to its origin since power-on and since the last error.
        in_zone: True if the last movement with a zone has held a workpiece in it.
        error: Number of the error, 0 if there is none.
        points: The stored points.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches, number: int) -> None:
        super().__init__(cycles, switches, MODEL)
        self.number: Final = number
        self.motor = False
        self.origin = False
        self.in_zone = False
        self.error = GripperError.NONE
        self.points: Sequence[Point] = DEFAULT_POINTS
        self._homing = False
        self._zone: tuple[float, float] | None = None

    @property
    def emergency(self) -> bool:
        """True while the emergency stop is pressed."""
        return self._switches.emergency_stop

    # --- commands -----------------------------------------------------------------------------------------------

    def switch_motor(self, on: bool) -> None:
        """Switch the motor without delay; switching it off releases a workpiece. In emergency stop it stays off.

        Raises:
            CallError: E_CAO_CMD_EXECUTE if the gripper is busy.
        """
        self._require_idle()
        self.motor = on and not self._switches.emergency_stop
        if not self.motor:
            self.force = 0.0

    def to_origin(self) -> Deferred[None]:
        """Return to the origin slowly; this also clears the error.

        Raises:
            CallError: E_CAO_CMD_EXECUTE; EMERGENCY_STOP_ON; MOTOR_NOT_ON.
        """
        self._require_idle()
        self._require_motor()
        self.origin, self.error = False, GripperError.NONE
        done = self.begin(MODEL.stroke, _ORIGIN_SPEED, 0.0, Contact.BLOCKED)
        self._homing = True
        return done

    def move(self, target: float, speed: float, *, force: float | None = None) -> Deferred[None]:
        """Move to an opening; with a force in percent, the gripper holds the workpiece that it meets.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; E_CAO_CMD_EXECUTE; EMERGENCY_STOP_ON; MOTOR_NOT_ON; CALSET_NOT_DONE if the
                origin is not known.
        """
        within(target, -MOST, MOST, "mm")
        within(speed, *SPEEDS, "%")
        contact = Contact.BLOCKED if force is None else Contact.GRIPS
        return self._begin(target, speed, FORCES[1] if force is None else force, contact)

    def shift(self, distance: float, speed: float, *, force: float | None = None) -> Deferred[None]:
        """Move by a distance; see :meth:`move`.

        Raises:
            CallError: As for :meth:`move`.
        """
        within(distance, -MOST, MOST, "mm")
        return self.move(self.position + distance, speed, force=force)

    def hold(self, speed: float, force: float, *, closing: bool) -> Deferred[None]:
        """Close or open at a constant speed until the gripper holds a workpiece or reaches the end of its stroke.

        Raises:
            CallError: As for :meth:`move`.
        """
        within(speed, *HOLDING_SPEEDS, "%")
        return self._begin(0.0 if closing else MODEL.stroke, speed, force, Contact.GRIPS)

    def hold_in_zone(self, low: float, high: float, speed: float, force: float, *, closing: bool) -> Deferred[None]:
        """Hold like :meth:`hold`; afterwards :attr:`in_zone` is True if the held workpiece is between two openings.

        Raises:
            CallError: As for :meth:`move`.
        """
        for limit in (low, high):
            within(limit, -MOST, MOST, "mm")
        done = self.hold(speed, force, closing=closing)
        self._zone = (min(low, high), max(low, high))
        return done

    def move_to_point(self, number: int, *, must_hold: bool = False) -> Deferred[None]:
        """Move as the data of a point define.

        Raises:
            CallError: VALUE_OUT_OF_RANGE, also if the mode of the point does not grip although ``must_hold`` is True;
                otherwise as for :meth:`move`.
        """
        point = self.point(number)
        if must_hold and not point.holds:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("the mode of point {number} does not grip. Try: UnChuck or MoveP", number=number),
            )
        force = point.force if point.holds else None
        closing = bool(point.distance)
        match point.mode:
            case PointMode.ABSOLUTE | PointMode.ABSOLUTE_HOLD:
                return self.move(point.distance, point.speed, force=force)
            case PointMode.RELATIVE | PointMode.RELATIVE_HOLD:
                return self.shift(point.distance, point.speed, force=force)
            case PointMode.HOLD:
                return self.hold(point.speed, point.force, closing=closing)
        return self.hold_in_zone(*point.zone, point.speed, point.force, closing=closing)

    def point(self, number: int) -> Point:
        """Return the data of a point.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if the point does not exist.
        """
        if not 0 <= number < len(self.points):
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("point {number} does not exist", number=number) + f" (0..{len(self.points) - 1})",
            )
        return self.points[number]

    def power_on(self) -> None:
        """Reset the gripper as at power-on."""
        self.stop()
        self.motor, self.origin, self.in_zone, self.force = False, False, False, 0.0
        self.error = GripperError.NONE

    def status(self) -> dict[str, object]:
        """Return the state of the gripper as a dictionary that can be converted to JSON."""
        return {**super().status(), "motor": self.motor, "origin": self.origin, "error": int(self.error)}

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Execute one cycle; an emergency stop ends a movement with an error and switches the motor off."""
        if self._switches.emergency_stop and self.busy:
            self._fail(GripperError.EMERGENCY_STOP)
            self.motor = False
        moving = super().step()
        if self.holding and self._zone is not None and not moving:
            self.in_zone = self._zone[0] <= self.position <= self._zone[1]
            self._zone = None
        return moving

    def stop(self, code: int = hresult.STOPPED_DURING_PC_MOTION) -> None:
        """Stop at the present position; a held workpiece stays held. A return to the origin is then not complete."""
        self._homing = False
        super().stop(code)

    def arrived(self) -> None:
        """Store that the origin is known."""
        self.origin = self.origin or self._homing
        self._homing = False

    def blocked(self) -> Exception:
        """Raise the error of the gripper for a movement that a workpiece has stopped."""
        self._fail(GripperError.OVERLOAD)
        return error_for(hresult.STOPPED_DURING_PC_MOTION, tr("Hand{number} has met a workpiece", number=self.number))

    def _fail(self, error: GripperError) -> None:
        self.error, self.origin, self._homing = error, False, False

    def _begin(self, target: float, speed: float, force: float, contact: Contact) -> Deferred[None]:
        within(force, *FORCES, "%")
        self._require_idle()
        self._require_motor()
        if not self.origin:
            raise error_for(hresult.CALSET_NOT_DONE, tr("Hand{number}. Try: Org", number=self.number))
        done = self.begin(target, speed, MODEL.force * force / 100, contact)
        self.in_zone, self._zone = False, None
        return done

    def _require_idle(self) -> None:
        if self.busy:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, tr("Hand{number} is busy", number=self.number))

    def _require_motor(self) -> None:
        if self._switches.emergency_stop:
            raise error_for(hresult.EMERGENCY_STOP_ON)
        if not self.motor:
            raise error_for(hresult.MOTOR_NOT_ON, tr("motor of the hand"))
