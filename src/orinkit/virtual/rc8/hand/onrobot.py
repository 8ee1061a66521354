"""The hands of OnRobot on a COBOTTA PRO: the two-finger gripper 2FG7 and the vacuum gripper VGC10.

The widths, forces and speeds of the 2FG7 are those that published drivers and the manufacturer's data sheet name. The
figures of the VGC10 are those of :mod:`~orinkit.virtual.rc8.hand.vacuum`.
"""

from __future__ import annotations

from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.hand.fingers import Contact, FingerModel, Fingers, within
from orinkit.virtual.rc8.hand.vacuum import Vacuum
from orinkit.virtual.rc8.switches import Switches

INWARD, OUTWARD = 1, 2
"""Orientations of the fingers of a 2FG7."""
EXTERNAL, INTERNAL = 1, 2
"""Modes of a 2FG7: it grips a workpiece from outside or from inside."""

FINGERS: Final = FingerModel(stroke=38.0, speed=450.0, acceleration=3000.0, force=140.0)
"""The mechanics of a 2FG7; the acceleration is an assumption of this project."""
_CLOSED: Final = 1.0  # mm, external width of the closed hand with inward fingers
_OUTWARD: Final = 34.0  # mm, additional width with outward fingers
FORCES: Final = (20.0, 140.0)
"""Range of the force, N."""
SPEEDS: Final = (10.0, 100.0)
"""Range of the speed, percent."""
_RELEASE_SPEED: Final = 50.0

LENGTHS: Final = (0.0, 150.0)
"""Range of the length of the fingers and of the width of their tips, mm."""


class TwoFinger(Fingers):
    """A 2FG7; widths are measured on the surfaces that grip in the present mode.

    Attributes:
        mode: EXTERNAL or INTERNAL.
        orientation: INWARD or OUTWARD.
        finger_length: Length of the fingers, mm; stored only.
        tip_width: Width of the tips, mm; an internal width is larger than the external one by twice this width.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches) -> None:
        super().__init__(cycles, switches, FINGERS)
        self.mode = EXTERNAL
        self.orientation = INWARD
        self.finger_length = 8.5
        self.tip_width = 5.0

    def offset(self, inside: bool) -> float:
        """Return the width of a workpiece that touches both fingers of the closed hand, mm."""
        outward = _OUTWARD if self.orientation == OUTWARD else 0.0
        return _CLOSED + outward + (2 * self.tip_width if inside else 0.0)

    @property
    def width(self) -> float:
        """The present width, mm."""
        return self.position + self.offset(self.mode == INTERNAL)

    @property
    def widths(self) -> tuple[float, float]:
        """The smallest and the largest width, mm."""
        low = self.offset(self.mode == INTERNAL)
        return low, low + self.model.stroke

    def grip(self, width: float, force: float, speed: float, *, must_grip: bool) -> Deferred[None]:
        """Move to a width and grip the workpiece that the fingers meet.

        Args:
            width: Width, mm.
            force: Force, 20 to 140 N.
            speed: Speed, 10 to 100 percent.
            must_grip: If True, the movement fails with GRIP_NOT_DETECTED if the fingers meet no workpiece.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; EMERGENCY_STOP_ON.
        """
        within(force, *FORCES, "N")
        within(speed, *SPEEDS, "%")
        return self._to_width(width, speed, force, Contact.MUST_GRIP if must_grip else Contact.GRIPS)

    def release(self, width: float) -> Deferred[None]:
        """Move to a width at half the speed.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; EMERGENCY_STOP_ON.
        """
        return self._to_width(width, _RELEASE_SPEED, FORCES[0], Contact.GRIPS)

    def orient(self, orientation: int) -> None:
        """Set the orientation of the fingers, which changes the widths.

        Raises:
            CallError: E_CAO_CMD_EXECUTE if the hand moves; VALUE_OUT_OF_RANGE.
        """
        self._require_idle()
        within(orientation, INWARD, OUTWARD, "")
        self.orientation = orientation

    def measure(self, *, finger_length: float | None = None, tip_width: float | None = None) -> None:
        """Set the dimensions of the fingers, mm.

        Raises:
            CallError: E_CAO_CMD_EXECUTE if the hand moves; VALUE_OUT_OF_RANGE.
        """
        self._require_idle()
        for value in (finger_length, tip_width):
            if value is not None:
                within(value, *LENGTHS, "mm")
        self.finger_length = self.finger_length if finger_length is None else finger_length
        self.tip_width = self.tip_width if tip_width is None else tip_width

    def switch(self, mode: int) -> None:
        """Select EXTERNAL or INTERNAL.

        Raises:
            CallError: E_CAO_CMD_EXECUTE if the hand moves.
        """
        self._require_idle()
        self.mode = mode

    def status(self) -> dict[str, object]:
        """Return the state of the hand as a dictionary that can be converted to JSON."""
        return {**super().status(), "width": round(self.width, 6)}

    def _to_width(self, width: float, speed: float, force: float, contact: Contact) -> Deferred[None]:
        within(width, *self.widths, "mm")
        return self.begin(width - self.offset(self.mode == INTERNAL), speed, force, contact)

    def _require_idle(self) -> None:
        if self.busy:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, tr("the 2FG7 is moving"))


BOTH, CHANNEL_A, CHANNEL_B = 0, 1, 2
"""Channels of a VGC10."""
_GRIP_CYCLES: Final = 250  # cycles in which a channel has to hold a workpiece: 2 s


class VacuumGripper:
    """A VGC10: two channels with their own pressure.

    Args:
        cycles: The control loop of the controller.

    Attributes:
        channels: The channels A and B.
    """

    def __init__(self, cycles: ControlLoop) -> None:
        self.channels = Vacuum(cycles), Vacuum(cycles)
        self._grips: list[tuple[tuple[Vacuum, ...], int, Deferred[None]]] = []

    @property
    def active(self) -> bool:
        """True if :meth:`step` has to be called in the next cycle."""
        return bool(self._grips) or self.channels[0].active or self.channels[1].active

    def of(self, channel: int) -> tuple[Vacuum, ...]:
        """Return the channels with a number: 0 both, 1 A, 2 B.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        within(channel, BOTH, CHANNEL_B, "")
        return self.channels if channel == BOTH else (self.channels[channel - 1],)

    def grip(self, channel: int, power: float) -> Deferred[None]:
        """Switch channels on.

        Returns:
            A Deferred that resolves when all of these channels hold a workpiece; it fails with GRIP_NOT_DETECTED if
            they do not within 2 s.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        chosen = self.of(channel)
        for each in chosen:
            each.start(power)
        done = Deferred[None]()
        self._grips.append((chosen, _GRIP_CYCLES, done))
        return done

    def release(self, channel: int) -> None:
        """Switch channels off and let air in.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        for each in self.of(channel):
            each.stop()

    def step(self) -> bool:
        """Execute one cycle; return True if a pressure or a load still changes."""
        moving = [channel.step() for channel in self.channels]
        grips, self._grips = self._grips, []
        for chosen, left, done in grips:
            if all(channel.holding for channel in chosen):
                done.set_result()
            elif not left or any(not channel.power for channel in chosen):
                done.set_exception(error_for(hresult.GRIP_NOT_DETECTED))
            else:
                self._grips.append((chosen, left - 1, done))
        return any(moving) or bool(self._grips)

    def close(self, code: int) -> None:
        """Fail the calls that wait for a workpiece."""
        grips, self._grips = self._grips, []
        for _, _, done in grips:
            done.set_exception(error_for(code))
