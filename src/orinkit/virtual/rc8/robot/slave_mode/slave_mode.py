"""Slave mode: its owner, the execution of set-points in each cycle, and the end of the mode."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Final, Protocol

from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.rc8.slave_formats import SlaveMode
from orinkit.values.variant import Value
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.elastic_time import WhenInputProcessed, late_detail, late_stream_message, timed_out_detail
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.set_point_buffer import (
    FollowingArm,
    PlannedSetPoint,
    ReplyFactory,
    SetPointBuffer,
    SlaveFault,
)
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.slave_mode.limits import SlaveLimits
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.switches import Switches

logger = logging.getLogger("orinkit.rc8")

ROOM: Final = 3
"""Capacity of the buffer in modes 0 and 2 (RC8 table 4-4)."""

QUEUE, NEWEST, WAIT = 0, 1, 2  # buffering according to table 4-4


class StreamedArm(FollowingArm, Protocol):
    """The arm that slave mode moves."""

    @property
    def switches(self) -> Switches:
        """Switches of the controller."""

    @property
    def speeds(self) -> Speeds:
        """Internal and external speeds."""

    @property
    def busy(self) -> bool:
        """True while the arm moves or has motions queued."""

    def stop(self, code: int) -> None:
        """Stop within the limits; calls that wait fail with the code."""

    def stop_and_power_off(self, code: int) -> None:
        """Stop and then switch the motor off; calls that wait fail with the code."""


class RC8SlaveMode(SetPointBuffer):
    """Slave mode of one arm; initially off.

    Args:
        arm: The arm. While slave mode is on, the arm calls :meth:`step` and :meth:`complete_waiting` in each cycle, and
            :meth:`end` when it is stopped.
        cycles: The control loop of the controller.
        fault: Callback that raises an error of the controller; invoked with code and detail.

    Attributes:
        mode: The active mode, or ``None``.
        owner: Operator that has switched the mode on, or ``None``.
        newest: Joint position of the last accepted set-point.
    """

    _arm: StreamedArm

    def __init__(self, arm: StreamedArm, cycles: ControlLoop, fault: Callable[[int, str], None]) -> None:
        super().__init__(arm, cycles, ROOM)
        self.mode: SlaveMode | None = None
        self.owner: Operator | None = None
        self.newest: Joints = ()
        self._fault = fault
        self._limits = SlaveLimits(arm.model, arm.switches, arm.speeds)
        self._leaving: list[Deferred[None]] = []  # calls waiting for the end of the mode
        self._unreported: tuple[Operator, int] | None = None  # the client that has not received the code of the end

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def on(self) -> bool:
        """True while slave mode is on."""
        return self.mode is not None

    @property
    def taking(self) -> bool:
        """True if slave mode is on and no call has requested its end; only then set-points are accepted."""
        return self.on and not self._leaving

    @property
    def overwrites(self) -> bool:
        """True if only the newest set-point counts (mode 1)."""
        return self.mode is not None and self.mode.buffering == NEWEST

    @property
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and the buffer has none.

        In mode 1, a client repeats its set-point while it waits for the next cycle (RC8 4.3.2). A repeated set-point
        therefore does not count if the arm cannot stop at this position within its limits.
        """
        if not self.taking or not self.moving:
            return False
        return not self._buffer or (self.overwrites and self._stops_hard(self._buffer[-1].joints))

    @property
    def has_work(self) -> bool:
        """True if the next cycle has work to do, even if nothing moves."""
        return bool(self._buffer or self._leaving)

    # --- functions of clients -----------------------------------------------------------------------------------

    def begin(self, owner: Operator, mode: SlaveMode, when_input_processed: WhenInputProcessed | None) -> None:
        """Switch slave mode on; the caller has checked the conditions, and the arm is at standstill.

        Args:
            owner: The operator that switches slave mode on.
            mode: The mode.
            when_input_processed: Function that invokes a callback after all data received from the operator so far has
                been processed; see :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
        """
        self._cycles.require_open()
        self.mode, self.owner, self._unreported = mode, owner, None
        self.newest = self._arm.queue.joints
        self._open(when_input_processed, strict=self._arm.switches.strict_time)

    def leave(self) -> Deferred[None]:
        """Switch slave mode off when the buffer is empty and the arm is at standstill.

        Returns:
            A Deferred that resolves when slave mode is off.
        """
        done = Deferred[None]()
        self._leaving.append(done)
        self._resume()
        self.complete_waiting()
        if not done.done():
            self._cycles.wake()
        return done

    def require_room(self) -> None:
        """Raise an exception if the buffer is full in mode 0; in the other modes, a set-point is accepted or waits.

        Raises:
            CallError: E_BUF_FULL (mode 0).
        """
        if self.mode is not None and self.mode.buffering == QUEUE and self.full:
            raise error_for(hresult.E_BUF_FULL)

    def put(self, command: PlannedSetPoint, make_reply: ReplyFactory) -> Value | ResultWithCode | Deferred[Value]:
        """Put a set-point into the buffer; return the result, or in mode 2 a Deferred if the buffer is full."""
        self.newest = command.joints
        reply = self.accept(command, make_reply)
        if self.full and self.mode is not None and self.mode.buffering == QUEUE and not isinstance(reply, Deferred):
            return ResultWithCode(hresult.S_BUF_FULL, reply)
        return reply

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Take the command of this cycle from the buffer; must be called before the step of the arm's queue."""
        queue = self._arm.queue
        if self._buffer:
            self._carry_out(self._buffer.popleft())
        elif self._leaving:
            queue.halt()
        elif self.moving:
            late = late_detail() if self._arm.switches.strict_time else timed_out_detail()
            if self.overwrites:  # equivalent to a command to stay in place (RC8 table 4-6)
                self._lead_to(queue.joints, late)
            else:
                self.fail(hresult.COMMAND_DELAY, late)
        self._end_cycle()

    def complete_waiting(self) -> None:
        """Put waiting set-points into the buffer and complete their calls; must be called at the end of a cycle.

        If the buffer is empty and the arm is at standstill, also complete the calls of :meth:`leave`.
        """
        self._refill()
        if self._leaving and not self._buffer and not self._arm.busy:
            leaving = self._leaving
            self._turn_off()
            for done in leaving:
                done.set_result()

    def end(self, code: int) -> None:
        """Switch slave mode off immediately and clear the buffer; calls that wait fail with the code.

        If no call waits, the owner's next slvMove fails with the code, except with a strict controller. The caller
        stops the arm.
        """
        owner, leaving = self.owner, self._leaving
        calls: list[Deferred[Any]] = [*leaving, *self._turn_off()]
        if owner is not None and not self._arm.switches.strict and all(call.done() for call in calls):
            self._unreported = owner, code
        for call in calls:
            call.set_exception(error_for(code))

    def report_end(self, operator: Operator) -> int:
        """Return the code with which slave mode of this operator has ended, once; otherwise 0."""
        if self._unreported is None or self._unreported[0] is not operator:
            return 0
        code, self._unreported = self._unreported[1], None
        return code

    def fail(self, code: int, detail: str = "") -> None:
        """Raise an error of the controller, which ends slave mode and stops the arm (RC8 4.7)."""
        logger.warning("%s: slave mode: %s", self.owner, error_for(code, detail))
        self._fault(code, detail)
        self._arm.stop(code)  # needed because an error of a low level does not stop the arm

    def limit_violation(self, before: Joints, now: Joints, wanted: Joints, *, lenient: bool) -> SlaveFault | None:
        """Return the first limit that a command position violates, or None; see :class:`SlaveLimits`."""
        return self._limits.violation(before, now, wanted, lenient=lenient)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _carry_out(self, command: PlannedSetPoint) -> None:
        if self._lead_to(command.joints):
            try:
                if command.set_outputs is not None:
                    command.set_outputs()
            except Exception as error:  # an error of the outputs must not interrupt the cycle while the arm moves
                logger.exception("outputs")
                self.fail(hresult.UNDEFINED_ERROR, f"{type(error).__name__}: {error}")
                self._arm.stop_and_power_off(hresult.UNDEFINED_ERROR)

    def _stops_hard(self, joints: Joints) -> bool:
        """Return True if this joint position repeats the last command, and a stop at it would be sudden."""
        queue = self._arm.queue
        return joints == queue.joints and self._limits.stops_suddenly(queue.previous_joints, joints)

    def _turn_off(self) -> list[Deferred[Value]]:
        """Switch slave mode off; return the replies that still wait."""
        self._resume()
        late = self.lateness(0)
        if self.on and late.count:
            logger.warning("%s: %s", self.owner, late_stream_message(late, strict=self._arm.switches.strict_time))
        self.mode = self.owner = None
        self._leaving = []
        return self._close()
