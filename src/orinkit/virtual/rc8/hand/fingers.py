"""Two parallel fingers that open, close and grip in the controller's 8 ms cycles, and the workpiece that they meet."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.rc8.switches import Switches


@record
class FingerModel:
    """The mechanical data of a hand.

    Attributes:
        stroke: Travel of the fingers, mm.
        speed: Largest speed of the fingers relative to each other, mm/s.
        acceleration: Acceleration, mm/s^2.
        force: Largest gripping force, N.
    """

    stroke: float
    speed: float
    acceleration: float
    force: float


@record
class Workpiece:
    """A workpiece between the fingers or around them.

    Attributes:
        width: Width, mm.
        inside: True for a ring that is gripped from inside, by opening; ``width`` is its inner width.
    """

    width: float
    inside: bool = False


class Contact(Enum):
    """The reaction of a movement to a workpiece that the fingers meet, or do not meet."""

    GRIPS = "grips"  #: they grip it; without a workpiece, the movement ends at its target
    MUST_GRIP = "must grip"  #: they grip it; without a workpiece, the movement fails with GRIP_NOT_DETECTED
    BLOCKED = "blocked"  #: the movement fails, because it does not control the force


@record
class _Move:
    """A movement: target (mm), speed (mm/s), gripping force (N), and the Deferred that resolves when it ends."""

    target: float
    speed: float
    force: float
    contact: Contact
    done: Deferred[None]


class Fingers:
    """Two parallel fingers; the control loop calls :meth:`step` in every cycle.

    Callers must hold the control loop ``cycles``, which is also a lock; only :meth:`put` acquires it itself. An
    emergency stop ends a movement; a gripped workpiece stays gripped.

    Args:
        cycles: The control loop of the controller.
        switches: The switches of the controller.
        model: The mechanical data.

    Attributes:
        position: Distance between the fingers, mm; 0 if the hand is closed.
        force: Gripping force, N; 0 if nothing is gripped.
        in_position: True if the last movement has ended at its target.
        workpiece: The workpiece that the fingers can meet, or ``None``.
        active: True if :meth:`step` has to be called in the next cycle.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches, model: FingerModel) -> None:
        self.model: Final = model
        self.position = model.stroke
        self.force = 0.0
        self.in_position = False
        self.workpiece: Workpiece | None = None
        self.active = False
        self._cycles = cycles
        self._switches = switches
        self._move: _Move | None = None
        self._speed = 0.0

    @property
    def busy(self) -> bool:
        """True while a movement is in progress."""
        return self._move is not None

    @property
    def holding(self) -> bool:
        """True while a workpiece is gripped."""
        return self.force > 0

    @property
    def load(self) -> float:
        """The gripping force in percent of the largest force."""
        return self.force / self.model.force * 100

    def begin(self, target: float, speed: float, force: float, contact: Contact = Contact.GRIPS) -> Deferred[None]:
        """Begin a movement; a movement in progress fails with STOPPED_DURING_PC_MOTION.

        Args:
            target: Opening, mm.
            speed: Speed, percent.
            force: Gripping force, N.
            contact: What happens if the fingers meet a workpiece.

        Returns:
            A Deferred that resolves at the end of the movement.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if the target is outside the stroke; EMERGENCY_STOP_ON.
        """
        within(target, 0.0, self.model.stroke, "mm")
        if self._switches.emergency_stop:
            raise error_for(hresult.EMERGENCY_STOP_ON)
        self._cycles.require_open()
        self.stop()
        self.force, self.in_position = 0.0, False
        move = self._move = _Move(target, self.model.speed * speed / 100, force, contact, Deferred[None]())
        self.active = True
        self._cycles.wake()
        return move.done

    def stop(self, code: int = hresult.STOPPED_DURING_PC_MOTION) -> None:
        """Stop at the present position; a gripped workpiece stays gripped.

        Args:
            code: Error code with which the movement fails.
        """
        move, self._move = self._move, None
        self._speed = 0.0
        if move is not None:
            move.done.set_exception(error_for(code))

    def put(self, width: float | None, *, inside: bool = False) -> None:
        """Place a workpiece between or around the fingers, or remove it; called by tests and by users.

        Args:
            width: Width, mm; ``None`` removes the workpiece, even if it is gripped.
            inside: True for a ring around the fingers, gripped by opening; ``width`` is its inner width.

        Raises:
            ValueError: If the width is not within the stroke; if a workpiece is wider than the present opening; if a
                ring is narrower than the present opening.
        """
        with self._cycles:
            offset = self.offset(inside)
            low, high = (self.position, self.model.stroke) if inside else (0.0, self.position)
            if width is not None and not low + offset <= width <= high + offset:  # rejects NaN as well
                raise ValueError(
                    tr(
                        "a workpiece of {width:g} mm does not fit; at the current opening of the hand, its width "
                        "must be {low:g} to {high:g} mm",
                        width=width,
                        low=low + offset,
                        high=high + offset,
                    )
                )
            self.workpiece = None if width is None else Workpiece(float(width), inside)
            self.force = 0.0

    def offset(self, inside: bool) -> float:
        """Return the width of a workpiece that touches both fingers of the closed hand, mm."""
        return 0.0

    def status(self) -> dict[str, object]:
        """Return the state of the hand as a dictionary that can be converted to JSON."""
        return {
            "position": round(self.position, 6),
            "moving": self.busy,
            "holding": self.holding,
            "force": self.force,
            "workpiece": None if self.workpiece is None else self.workpiece.width,
        }

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Execute one cycle; return True if a movement is still in progress."""
        if self._move is not None:
            if self._switches.emergency_stop:
                self.stop(hresult.EMERGENCY_STOP_ON)
            else:
                self._advance(self._move)
        self.active = self._move is not None
        return self.active

    def _advance(self, move: _Move) -> None:
        start, remaining = self.position, abs(move.target - self.position)
        braking = math.sqrt(2 * self.model.acceleration * remaining)
        self._speed = min(self._speed + self.model.acceleration * PERIOD, move.speed, braking)
        distance = self._speed * PERIOD
        arrived = distance >= remaining
        end = move.target if arrived else start + math.copysign(distance, move.target - start)
        met = self._met(start, end)
        self.position = end if met is None else met
        if met is not None:
            self._meet(move)
        elif arrived:
            self._arrive(move)

    def _met(self, start: float, end: float) -> float | None:
        """Return the opening at which the fingers meet the workpiece while they move, or None."""
        piece = self.workpiece
        if piece is None:
            return None
        place = piece.width - self.offset(piece.inside)
        meets = start <= place <= end if piece.inside else end <= place <= start
        return place if meets else None

    def _meet(self, move: _Move) -> None:
        self._move, self._speed = None, 0.0
        if move.contact is Contact.BLOCKED:
            move.done.set_exception(self.blocked())
            return
        self.force = move.force
        self.in_position = self.position == move.target
        move.done.set_result()

    def _arrive(self, move: _Move) -> None:
        self._move, self._speed = None, 0.0
        self.in_position = True
        if move.contact is Contact.MUST_GRIP:
            move.done.set_exception(error_for(hresult.GRIP_NOT_DETECTED))
            return
        self.arrived()
        move.done.set_result()

    def arrived(self) -> None:
        """Called when a movement has ended at its target."""

    def blocked(self) -> Exception:
        """Return the error of a movement that a workpiece has stopped."""
        return error_for(hresult.STOPPED_DURING_PC_MOTION)


def within(value: float, low: float, high: float, unit: str) -> None:
    """Check that a value is in a range.

    Raises:
        CallError: VALUE_OUT_OF_RANGE.
    """
    if not low <= value <= high:  # rejects NaN as well
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{value:g} {unit} is not within", value=value, unit=unit) + f" {low:g}..{high:g}",
        )
