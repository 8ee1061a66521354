"""Slave mode (VE026A 2): each cycle of 8 ms uses a set-point as its command.

The buffer has room for one set-point, as in the RC7 controllers of that time (reference: slave mode). Synchronous and
asynchronous mode differ in when slvMove returns and in the time-out detection (2.2.1):

* Synchronous: slvMove returns when there is room for its set-point. A client that then sends the next one stays in step,
  one set-point ahead. After the first set-point, a cycle without a new one is an error, after 250 ms unless time is strict.
* Asynchronous: slvMove returns at once, and its set-point replaces one that has not been used yet. Without a new set-point
  the arm stays at the last one.

The largest distance of a set-point is the distance that an axis travels in a cycle, times
:data:`~orinkit.virtual.rc8.robot.slave_mode.limits.SERVO_LIMIT`. Its acceleration is not checked: over a serial line
set-points arrive a few cycles apart, and the arm stands still in between.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Final, Protocol

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred
from orinkit.core.i18n import tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.values.variant import Value, Variant
from orinkit.virtual.engine.catch_up import gentlest
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.engine.elastic_time import CyclePacer, DrainInput, left_late, waited_in_vain
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.queue import MotionQueue, QueueState
from orinkit.virtual.rc8.robot.slave_mode.limits import LENIENCY, SERVO_LIMIT, SlaveFault
from orinkit.virtual.ve026a.arm_owner import Operator
from orinkit.virtual.ve026a.codes import SET_POINT_MISSED, TOO_FAST_AXIS1, refusal
from orinkit.virtual.ve026a.parameters import ASYNCHRONOUS, OFF, SYNCHRONOUS

logger = logging.getLogger("orinkit.ve026a")

_ROUNDING: Final = 1e-4  # deg; set-points of clients are R4 numbers


class StreamedArm(Protocol):
    """The arm that slave mode moves."""

    @property
    def model(self) -> ArmModel:
        """The arm's model."""

    @property
    def queue(self) -> MotionQueue:
        """The motion queue, which follows the set-points."""

    def angles(self) -> Variant:
        """Return the reply to slvMove: the encoder values."""

    def fail(self, code: int, detail: str = "") -> None:
        """Enter an error state: decelerate, leave slave mode."""


class VE026ASlaveMode:
    """Slave mode of one arm; initially off. For a late server see :mod:`orinkit.virtual.engine.elastic_time`.

    Args:
        arm: The arm; it calls :meth:`step` and :meth:`settle` in each cycle while the mode is on, and :meth:`end` when it is
            stopped.
        cycles: The controller's cycle.
        strict_time: True to not wait for late set-points.

    Attributes:
        mode: 0x002 (synchronous), 0x102 (asynchronous), or 0 for off.
        owner: The client that has turned it on.
        lenient: Number of cycles for which the limits are larger, because set-points were lost while the server was late.
    """

    def __init__(self, arm: StreamedArm, cycles: ControlLoop, *, strict_time: bool) -> None:
        self.mode = OFF
        self.owner: Operator | None = None
        self.lenient = 0
        self._arm = arm
        self._cycles = cycles
        self._commands: list[
            Joints
        ] = []  # the newest set-point, after the commands that lead to it if the server was late
        self._waiting: deque[tuple[Joints, Deferred[Value]]] = deque()  # slvMoves that wait for room
        self._started = False
        self._strict = strict_time
        self._pace: CyclePacer | None = None  # of the present stream, or of the last one

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def on(self) -> bool:
        """True if slave mode is on."""
        return self.mode != OFF

    @property
    def empty(self) -> bool:
        """True if there is no unused set-point."""
        return not self._commands and not self._waiting

    @property
    def watched(self) -> bool:
        """True if the next cycle needs a set-point: time-out detection is active."""
        return self.mode == SYNCHRONOUS and self._started

    @property
    def pending(self) -> bool:
        """True if the next cycle has something to do, even if the arm does not move."""
        return bool(self._commands) or self.watched

    @property
    def overwrites(self) -> bool:
        """True if missed cycles are caught up (asynchronous mode), because set-points have been overwritten meanwhile."""
        return self.mode == ASYNCHRONOUS

    @property
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and there is none."""
        return self.watched and not self._commands

    @property
    def moving(self) -> bool:
        """True if the command moves."""
        return self._arm.queue.state is QueueState.FOLLOWING

    @property
    def lateness(self) -> Callable[[int], Lateness]:
        """Function that returns the lateness of the present or last stream, without its first n late set-points."""
        return self._pace.lateness if self._pace is not None else lambda _: Lateness()

    # --- commands of clients ------------------------------------------------------------------------------------

    def begin(self, owner: Operator, mode: int, drain_input: DrainInput | None) -> None:
        """Turn slave mode on; the arm must stand still, and the caller must have checked all preconditions.

        Args:
            owner: The client.
            mode: 0x002 or 0x102.
            drain_input: Drains the client's input, see :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
        """
        self.mode, self.owner = mode, owner
        self.lenient, self._started = 0, False
        self._pace = self._cycles.pace = CyclePacer(self._cycles, self, drain_input, strict=self._strict)

    def put(self, joints: Joints) -> Value | Deferred[Value]:
        """Accept a set-point; return the reply, or a deferred reply if the buffer is full in synchronous mode."""
        if self.mode == SYNCHRONOUS and self._commands:
            reply = Deferred[Value]()
            self._waiting.append((joints, reply))
            return reply
        self._commands = [joints]
        self._started = True
        self._resume()
        self._cycles.wake()
        return self._arm.angles()

    def end(self, code: int) -> None:
        """Turn slave mode off at once; waiting slvMoves fail with the code. The caller must stop the arm."""
        self._resume()
        late = self.lateness(0)
        if self.on and late.count:
            logger.warning("%s", left_late(late, strict=self._strict))
        waiting, self._waiting = self._waiting, deque()
        self.mode, self.owner = OFF, None
        self._cycles.pace = None
        self._commands, self._started = [], False
        for _, reply in waiting:
            reply.set_exception(refusal(code))

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Set the command of this cycle; call it before the step of the arm's queue."""
        queue = self._arm.queue
        if self._commands:
            self._follow(self._commands.pop(0))
        elif self.watched:
            self._arm.fail(SET_POINT_MISSED, "" if self._strict else waited_in_vain())
        elif queue.state is QueueState.FOLLOWING:
            queue.follow(queue.joints)
        self.lenient = max(0, self.lenient - 1)

    def settle(self) -> None:
        """Accept and answer a slvMove that waits for room; call it at the end of a cycle."""
        while self._waiting and not self._commands:
            joints, reply = self._waiting.popleft()
            if not reply.done():  # it may have been cancelled
                self._commands = [joints]
                reply.set_result(self._arm.angles())

    def bridge(self, most: int) -> int:
        """Plan commands to the newest set-point of asynchronous mode for at most ``most`` cycles.

        Returns:
            Their number; 0 if there is no set-point.
        """
        if not self._commands:
            return 0
        goal, queue = self._commands[-1], self._arm.queue
        if self._fault(goal) is None:  # the set-point can be reached in one cycle
            return 1
        self._commands = gentlest(self._arm.model, queue.before, queue.joints, goal, most)
        return len(self._commands)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _resume(self) -> None:
        if self._pace is not None:
            self._pace.resume()

    def _follow(self, joints: Joints) -> None:
        fault = self._fault(joints, LENIENCY if self.lenient else 1.0)
        if fault is not None:
            self._arm.fail(*fault)
        else:
            self._arm.queue.follow(joints)

    def _fault(self, joints: Joints, factor: float = 1.0) -> SlaveFault | None:
        """Return the limit violation of the lowest axis; ``None`` if the command is within the limits."""
        for number, (axis, b, c) in enumerate(zip(self._arm.model.axes, self._arm.queue.joints, joints, strict=True)):
            most = axis.velocity * SERVO_LIMIT
            if abs(c - b) > most * factor * PERIOD + _ROUNDING:
                wanted = abs(c - b) / PERIOD
                return SlaveFault(
                    TOO_FAST_AXIS1 + number,
                    tr("{wanted:.6g} deg/s exceeds the limit of {most:.6g} deg/s", wanted=wanted, most=most),
                )
        return None
