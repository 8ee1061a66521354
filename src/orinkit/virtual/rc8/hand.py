"""The electric hand: two parallel fingers that open, close and grip in the controller's 8 ms cycles.

What documents and users of such hands tell is the stroke of 30 mm, speeds in percent and forces in newtons. The speed
at 100 %, the acceleration, the range of the force and the taught positions are this project's own assumptions.
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
"""mm between the fingers when the hand is open; closed it is 0."""

SPEED: Final = 80.0
"""mm/s at 100 %."""

ACCELERATION: Final = 800.0
"""mm/s^2."""

LEAST_SPEED, MOST_SPEED = 1.0, 100.0
"""Percent."""

LEAST_FORCE, MOST_FORCE = 6.0, 20.0
"""N."""

ORIGIN_SPEED: Final = 20.0
"""Percent, of a return to the origin."""


@dataclass(frozen=True, slots=True)
class Taught:
    """What Chuck and UnChuck do under one number.

    Attributes:
        closed: how far Chuck closes at most, mm.
        opened: where UnChuck opens to, mm.
        speed: of both, percent.
        force: with which Chuck grips, N.
    """

    closed: float
    opened: float
    speed: float
    force: float


TAUGHT: Final = (Taught(0, 30, 100, 20), Taught(0, 20, 100, 15), Taught(0, 15, 50, 10), Taught(0, 10, 50, 6))
"""The taught positions at the beginning; number 0 is the first."""


@dataclass(frozen=True, slots=True)
class Workpiece:
    """What is between the fingers, or around them.

    Attributes:
        width: mm.
        inside: it is a ring of that inner width, which is gripped by opening.
    """

    width: float
    inside: bool = False

    def meets(self, start: float, end: float) -> bool:
        """Return whether the fingers meet it on their way from one opening to another, mm."""
        return start <= self.width <= end if self.inside else end <= self.width <= start


@dataclass(frozen=True, slots=True)
class _Move:
    """A movement: where to, how fast (mm/s), how strongly it holds what it meets (N), who waits for it."""

    target: float
    speed: float
    force: float
    grips: bool  # and has failed where it has met nothing
    homing: bool
    done: Deferred[None]


class Hand:
    """The hand; a part of the cycle. To be used inside the lock of ``cycles``; :meth:`put` may be called from any thread.

    A movement that begins replaces the one before; whoever waits for that one is answered with
    STOPPED_DURING_PC_MOTION. An emergency stop ends a movement; what is held stays held.

    Args:
        cycles: the controller's cycle.
        switches: of the controller.

    Attributes:
        position: how far the fingers are apart, mm.
        motor: whether it is switched on.
        origin: whether its last return to the origin was completed; it begins as if it had been.
        force: with which it holds something, N; 0 if it holds nothing.
        workpiece: what the fingers can meet, ``None`` for nothing.
        taught: positions of Chuck and UnChuck, by number.
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
        """Whether it moves."""
        return self._move is not None

    @property
    def holding(self) -> bool:
        """Whether it holds something."""
        return self.force > 0

    @property
    def load(self) -> float:
        """The force in percent of the largest one."""
        return self.force / MOST_FORCE * 100

    # --- movements ----------------------------------------------------------------------------------------------

    def move(self, target: float, speed: float, force: float = MOST_FORCE) -> Deferred[None]:
        """Open or close to a position; what the fingers meet on the way ends the movement and is held.

        Args:
            target: mm, 0 to 30.
            speed: percent, 1 to 100.
            force: N, 6 to 20.

        Returns:
            what is kept when it is over.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; EMERGENCY_STOP_ON; MOTOR_NOT_ON.
        """
        return self._begin(target, speed, force)

    def grip(self, force: float, *, closing: bool = True, speed: float = MOST_SPEED) -> Deferred[None]:
        """Close, or open, until the fingers meet something, and hold it.

        Returns:
            what is kept when it holds; broken with GRIP_NOT_DETECTED at the end of the stroke.

        Raises:
            CallError: as :meth:`move`.
        """
        return self._begin(0.0 if closing else STROKE, speed, force, grips=True)

    def chuck(self, number: int) -> Deferred[None]:
        """Close to a taught position and grip.

        Returns:
            what is kept when it holds; broken with GRIP_NOT_DETECTED where nothing was met.

        Raises:
            CallError: VALUE_OUT_OF_RANGE, there is no such number; as :meth:`move`.
        """
        taught = self._taught(number)
        return self._begin(taught.closed, taught.speed, taught.force, grips=True)

    def unchuck(self, number: int) -> Deferred[None]:
        """Open to a taught position.

        Raises:
            CallError: as :meth:`chuck`.
        """
        taught = self._taught(number)
        return self._begin(taught.opened, taught.speed, taught.force)

    def to_origin(self) -> Deferred[None]:
        """Return to the origin: open, slowly.

        Raises:
            CallError: EMERGENCY_STOP_ON; MOTOR_NOT_ON.
        """
        done = self._begin(STROKE, ORIGIN_SPEED, LEAST_FORCE, homing=True)
        self.origin = False
        return done

    def stop(self, code: int = hresult.STOPPED_DURING_PC_MOTION) -> None:
        """Stop where it is; what is held stays held.

        Args:
            code: with which whoever waits for the movement is answered.
        """
        move, self._move = self._move, None
        self._speed = 0.0
        if move is not None:
            move.done.set_exception(error_for(code))

    def switch_motor(self, on: bool) -> None:
        """Switch its motor, at once; off, it lets go of what it holds.

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
        """Put a workpiece between the fingers, for them to meet; a test or a person does so.

        Args:
            width: mm; ``None`` takes away what is there, out of the fingers too.
            inside: it is a ring around the fingers, gripped by opening; ``width`` is its inner width.

        Raises:
            ValueError: it does not fit: wider than the hand is open, a ring narrower, below 0 or above the stroke.
        """
        with self._cycles:
            low, high = (self.position, STROKE) if inside else (0.0, self.position)
            if width is not None and not low <= width <= high:  # NaN is not
                raise ValueError(
                    tr(
                        "a workpiece of {width:g} mm does not fit: {low:g} to {high:g} mm at this opening",
                        width=width,
                        low=low,
                        high=high,
                    )
                )
            self.workpiece = None if width is None else Workpiece(float(width), inside)
            self.force = 0.0

    def status(self) -> dict[str, object]:
        """Return how it stands: plain values by name."""
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
        """Do one cycle; returns whether there is more to do."""
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
        _within(speed, LEAST_SPEED, MOST_SPEED, "%")
        _within(force, LEAST_FORCE, MOST_FORCE, "N")
        if self._switches.emergency_stop:
            raise error_for(hresult.EMERGENCY_STOP_ON)
        if not self.motor:
            raise error_for(hresult.MOTOR_NOT_ON, tr("motor of the hand"))
        self._cycles.require_open()
        self.stop()
        self.force = 0.0
        self._move = _Move(target, SPEED * speed / MOST_SPEED, force, grips, homing, Deferred[None]())
        self._cycles.wake()
        return self._move.done

    def _advance(self, move: _Move) -> None:
        start, remaining = self.position, abs(move.target - self.position)
        braking = math.sqrt(2 * ACCELERATION * remaining)
        self._speed = min(self._speed + ACCELERATION * PERIOD, move.speed, braking)
        way = self._speed * PERIOD
        arrived = way >= remaining
        end = move.target if arrived else start + math.copysign(way, move.target - start)
        if self.workpiece is not None and self.workpiece.meets(start, end):
            self.position, self.force = self.workpiece.width, move.force
        else:
            self.position = end
        if arrived or self.holding:
            self._over(move)

    def _over(self, move: _Move) -> None:
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
                tr("no taught position {number:g}", number=number) + f" (0..{len(self.taught) - 1})",
            )
        return self.taught[number]


def _within(value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:  # NaN is not
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{value:g} {unit} is not within", value=value, unit=unit) + f" {low:g}..{high:g}",
        )
