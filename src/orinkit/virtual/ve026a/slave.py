"""Slave mode (section 2 of the VE026A document): in each cycle of 8 ms a set-point becomes the command position.

The buffer has room for one set-point, as in RC7 controllers of the same time as the VE026A. Synchronous and
asynchronous mode differ in the time at which slvMove returns and in the time-out detection (2.2.1):

* Synchronous: slvMove returns when there is room for its set-point. A client that sends the next set-point after each
  reply is always one set-point ahead. After the first set-point, a cycle without a new one is an error: immediately
  with strict time, otherwise after a wait of 250 ms.
* Asynchronous: slvMove returns immediately, and its set-point replaces one that has not been used yet. Without a new
  set-point the arm stays at the last one.

The distance from one set-point to the next is limited for each axis: to the distance that the axis travels in a cycle
at its largest velocity, times :data:`~orinkit.virtual.engine.set_point_buffer.SERVO_LIMIT`. The acceleration is not
checked, because set-points arrive a few cycles apart over a serial line and the arm stands still in between.
"""

from __future__ import annotations

import logging
from typing import Final, Protocol

from orinkit.cao.provider import Deferred
from orinkit.core.i18n import tr
from orinkit.values.variant import Value, Variant
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.engine.elastic_time import WhenInputProcessed, late_stream_message, timed_out_detail
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.set_point_buffer import (
    LENIENCY,
    SERVO_LIMIT,
    FollowingArm,
    PlannedSetPoint,
    SetPointBuffer,
    SlaveFault,
)
from orinkit.virtual.ve026a.arm_owner import Operator
from orinkit.virtual.ve026a.codes import SET_POINT_MISSED, TOO_FAST_AXIS1, device_error
from orinkit.virtual.ve026a.parameters import ASYNCHRONOUS, OFF, SYNCHRONOUS

logger = logging.getLogger("orinkit.ve026a")

_ROOM: Final = 1
_ROUNDING: Final = 1e-4  # deg; set-points of clients are R4 numbers


class StreamedArm(FollowingArm, Protocol):
    """The arm that slave mode moves."""

    def angles(self) -> Variant:
        """Return the reply to slvMove: the encoder values."""

    def fail(self, code: int, detail: str = "") -> None:
        """Enter an error state: brake and leave slave mode."""


class VE026ASlaveMode(SetPointBuffer):
    """Slave mode of one arm; initially off. For a late server see :mod:`orinkit.virtual.engine.elastic_time`.

    Args:
        arm: The arm. It must call :meth:`step` and :meth:`accept_waiting` in each cycle while slave mode is on, and
            :meth:`end` when the arm is stopped.
        cycles: The control loop of the controller.
        strict_time: True to report a late set-point as an error immediately, False to wait for it.

    Attributes:
        mode: 0x002 (synchronous), 0x102 (asynchronous), or 0 for off.
        owner: The client that has turned slave mode on; ``None`` if it is off.
    """

    _arm: StreamedArm

    def __init__(self, arm: StreamedArm, cycles: ControlLoop, *, strict_time: bool) -> None:
        super().__init__(arm, cycles, _ROOM)
        self.mode = OFF
        self.owner: Operator | None = None
        self._started = False
        self._strict = strict_time

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def on(self) -> bool:
        """True if slave mode is on."""
        return self.mode != OFF

    @property
    def empty(self) -> bool:
        """True if there is no unused set-point."""
        return not self._buffer and not self._waiting

    @property
    def watched(self) -> bool:
        """True if the next cycle needs a set-point: time-out detection is active."""
        return self.mode == SYNCHRONOUS and self._started

    @property
    def has_work(self) -> bool:
        """True if the next cycle has something to do, even if the arm does not move."""
        return bool(self._buffer) or self.watched

    @property
    def overwrites(self) -> bool:
        """True in asynchronous mode, in which only the newest set-point counts.

        After missed cycles, the arm moves to this set-point in several cycles, because it may be far away.
        """
        return self.mode == ASYNCHRONOUS

    @property
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and there is none."""
        return self.watched and not self._buffer

    # --- commands of clients ------------------------------------------------------------------------------------

    def begin(self, owner: Operator, mode: int, when_input_processed: WhenInputProcessed | None) -> None:
        """Turn slave mode on; the arm must stand still, and the caller must have checked all preconditions.

        Args:
            owner: The client.
            mode: 0x002 or 0x102.
            when_input_processed: See :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
        """
        self.mode, self.owner = mode, owner
        self._started = False
        self._open(when_input_processed, strict=self._strict)

    def put(self, joints: Joints) -> Value | Deferred[Value]:
        """Accept a set-point; return the reply, or a deferred reply if the buffer is full in synchronous mode."""
        self._started = True
        return self.accept(PlannedSetPoint(joints), self._arm.angles)

    def end(self, code: int) -> None:
        """Turn slave mode off immediately; waiting slvMoves fail with the code. The caller must stop the arm."""
        self._resume()
        late = self.lateness(0)
        if self.on and late.count:
            logger.warning("%s", late_stream_message(late, strict=self._strict))
        self.mode, self.owner, self._started = OFF, None, False
        for reply in self._close():
            reply.set_exception(device_error(code))

    def fail(self, code: int, detail: str = "") -> None:
        """Enter an error state: brake and leave slave mode."""
        self._arm.fail(code, detail)

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Set the command position of this cycle; call it before the step of the arm's queue."""
        queue = self._arm.queue
        if self._buffer:
            self._lead_to(self._buffer.popleft().joints)
        elif self.watched:
            self.fail(SET_POINT_MISSED, "" if self._strict else timed_out_detail())
        elif self.moving:
            queue.follow(queue.joints)
        self._end_cycle()

    def accept_waiting(self) -> None:
        """Accept a slvMove that waits for room and send its reply; call it at the end of a cycle."""
        self._refill()

    def limit_violation(
        self,
        before: Joints,
        now: Joints,
        wanted: Joints,
        *,
        lenient: bool,
    ) -> SlaveFault | None:
        """Return the violation of the axis with the lowest number that exceeds its limit; ``None`` if no axis does."""
        factor = LENIENCY if lenient else 1.0
        for number, (axis, b, c) in enumerate(zip(self._arm.model.axes, now, wanted, strict=True)):
            most = axis.velocity * SERVO_LIMIT
            if abs(c - b) > most * factor * PERIOD + _ROUNDING:
                velocity = abs(c - b) / PERIOD
                return SlaveFault(
                    TOO_FAST_AXIS1 + number,
                    tr("{wanted:.6g} deg/s exceeds the limit of {most:.6g} deg/s", wanted=velocity, most=most),
                )
        return None
