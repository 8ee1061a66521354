"""The electric hand: two parallel fingers that open, close and grip in the controller's 8 ms cycles.

According to documents and users of such hands, the stroke is 30 mm, speeds are in percent and forces in newtons. The
speed at 100 %, the acceleration, the range of the force and the taught positions are assumptions of this project.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
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

ORIGIN_SPEED: Final = 20.0
"""Speed of a return to the origin, percent."""


@dataclass(frozen=True, slots=True)
class Taught:
    """A taught position: the settings that Chuck and UnChuck use for one number.

    Attributes:
        closed: Smallest opening to which Chuck closes, mm.
        opened: Opening to which UnChuck opens, mm.
        speed: Speed of both Chuck and UnChuck, percent.
        force: Gripping force of Chuck, N.
    """

    closed: float
    opened: float
    speed: float
    force: float


TAUGHT: Final = (Taught(0, 30, 100, 20), Taught(0, 20, 100, 15), Taught(0, 15, 50, 10), Taught(0, 10, 50, 6))
"""The default taught positions, by number from 0."""


@dataclass(frozen=True, slots=True)
class Workpiece:
    """A workpiece between the fingers or around them.

    Attributes:
        width: Width, mm.
        inside: True for a ring that is gripped from inside, by opening; ``width`` is its inner width.
    """

    width: float
    inside: bool = False

    def meets(self, start: float, end: float) -> bool:
        """Return True if the fingers meet the workpiece while they move from one opening to another, mm."""
        return start <= self.width <= end if self.inside else end <= self.width <= start


@dataclass(frozen=True, slots=True)
class _Move:
    """A movement: target (mm), speed (mm/s), gripping force (N), and the Deferred that resolves when it ends."""

    target: float
    speed: float
    force: float
    grips: bool  # the movement fails if the fingers meet no workpiece
    homing: bool
    done: Deferred[None]


class Hand:
    """The electric hand; the control loop calls :meth:`step` in every cycle.

    Callers must hold the control loop ``cycles``, which is also a lock; only :meth:`put` acquires it itself. A new
    movement replaces the current one, which fails with STOPPED_DURING_PC_MOTION. An emergency stop ends a movement; a
    gripped workpiece stays gripped.

    Args:
        cycles: The control loop of the controller.
        switches: The switches of the controller.

    Attributes:
        position: Distance between the fingers, mm.
        motor: True if the motor is on.
        origin: True if the last return to the origin was completed; initially True.
        force: Gripping force, N; 0 if nothing is gripped.
        workpiece: The workpiece that the fingers can meet, or ``None``.
        taught: The taught positions of Chuck and UnChuck, by number.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches) -> None:
        self.position = STROKE
        self.motor = True
        self.origin = True
        self.force = 0.0
        self.workpiece: Workpiece | None = None
        self.taught: Sequence[Taught] = TAUGHT
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
        return self.force / MAX_FORCE * 100

    # --- movements ----------------------------------------------------------------------------------------------

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
        return self._begin(target, speed, force)

    def grip(self, force: float, *, closing: bool = True, speed: float = MAX_SPEED) -> Deferred[None]:
        """Close (open if ``closing`` is False) until the fingers meet a workpiece, and grip it.

        Returns:
            A Deferred that resolves when the workpiece is gripped. It fails with GRIP_NOT_DETECTED if the fingers reach
            the end of the stroke without a workpiece.

        Raises:
            CallError: As for :meth:`move`.
        """
        return self._begin(0.0 if closing else STROKE, speed, force, grips=True)

    def chuck(self, number: int) -> Deferred[None]:
        """Close to a taught position; if the fingers meet a workpiece, they grip it.

        Returns:
            A Deferred that resolves when a workpiece is gripped. It fails with GRIP_NOT_DETECTED if the fingers reach
            the taught position without a workpiece.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if the number does not exist; otherwise as for :meth:`move`.
        """
        taught = self._taught(number)
        return self._begin(taught.closed, taught.speed, taught.force, grips=True)

    def unchuck(self, number: int) -> Deferred[None]:
        """Open to a taught position.

        Raises:
            CallError: As for :meth:`chuck`.
        """
        taught = self._taught(number)
        return self._begin(taught.opened, taught.speed, taught.force)

    def to_origin(self) -> Deferred[None]:
        """Return to the origin by opening slowly.

        Raises:
            CallError: EMERGENCY_STOP_ON; MOTOR_NOT_ON.
        """
        done = self._begin(STROKE, ORIGIN_SPEED, MIN_FORCE, homing=True)
        self.origin = False
        return done

    def stop(self, code: int = hresult.STOPPED_DURING_PC_MOTION) -> None:
        """Stop at the present position; a gripped workpiece stays gripped.

        Args:
            code: Error code with which the movement fails.
        """
        move, self._move = self._move, None
        self._speed = 0.0
        if move is not None:
            move.done.set_exception(error_for(code))

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

    def put(self, width: float | None, *, inside: bool = False) -> None:
        """Place a workpiece between or around the fingers, or remove it; called by tests and by users.

        Args:
            width: Width, mm; ``None`` removes the workpiece, even if it is gripped.
            inside: True for a ring around the fingers, gripped by opening; ``width`` is its inner width.

        Raises:
            ValueError: If the width is not between 0 and the stroke; if a workpiece is wider than the present opening;
                if a ring is narrower than the present opening.
        """
        with self._cycles:
            low, high = (self.position, STROKE) if inside else (0.0, self.position)
            if width is not None and not low <= width <= high:  # rejects NaN as well
                raise ValueError(
                    tr(
                        "a workpiece of {width:g} mm does not fit; at the current opening of the hand, its width "
                        "must be {low:g} to {high:g} mm",
                        width=width,
                        low=low,
                        high=high,
                    )
                )
            self.workpiece = None if width is None else Workpiece(float(width), inside)
            self.force = 0.0

    def status(self) -> dict[str, object]:
        """Return the state of the hand as a dictionary that can be converted to JSON."""
        return {
            "position": round(self.position, 6),
            "motor": self.motor,
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
        return self.busy

    def _begin(
        self, target: float, speed: float, force: float, *, grips: bool = False, homing: bool = False
    ) -> Deferred[None]:
        _within(target, 0.0, STROKE, "mm")
        _within(speed, MIN_SPEED, MAX_SPEED, "%")
        _within(force, MIN_FORCE, MAX_FORCE, "N")
        if self._switches.emergency_stop:
            raise error_for(hresult.EMERGENCY_STOP_ON)
        if not self.motor:
            raise error_for(hresult.MOTOR_NOT_ON, tr("motor of the hand"))
        self._cycles.require_open()
        self.stop()
        self.force = 0.0
        self._move = _Move(target, SPEED * speed / MAX_SPEED, force, grips, homing, Deferred[None]())
        self._cycles.wake()
        return self._move.done

    def _advance(self, move: _Move) -> None:
        start, remaining = self.position, abs(move.target - self.position)
        braking = math.sqrt(2 * ACCELERATION * remaining)
        self._speed = min(self._speed + ACCELERATION * PERIOD, move.speed, braking)
        distance = self._speed * PERIOD
        arrived = distance >= remaining
        end = move.target if arrived else start + math.copysign(distance, move.target - start)
        if self.workpiece is not None and self.workpiece.meets(start, end):
            self.position, self.force = self.workpiece.width, move.force
        else:
            self.position = end
        if arrived or self.holding:
            self._finish(move)

    def _finish(self, move: _Move) -> None:
        self._move, self._speed = None, 0.0
        if move.grips and not self.holding:
            move.done.set_exception(error_for(hresult.GRIP_NOT_DETECTED))
            return
        self.origin = self.origin or move.homing
        move.done.set_result()

    def _taught(self, number: int) -> Taught:
        if not 0 <= number < len(self.taught):
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("taught position {number:g} does not exist", number=number) + f" (0..{len(self.taught) - 1})",
            )
        return self.taught[number]


def _within(value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:  # rejects NaN as well
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{value:g} {unit} is not within", value=value, unit=unit) + f" {low:g}..{high:g}",
        )
