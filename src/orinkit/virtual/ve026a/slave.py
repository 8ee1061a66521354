"""Slave mode (VE026A 2): each cycle of 8 ms takes a set-point as its command.

There is room for one set-point, as in the RC7 controllers of that time (reference: slave mode). Synchronous and asynchronous
mode differ in two things, the style of the answer and the time-out detector (2.2.1):

* synchronous: slvMove is answered when there is room for its set-point, so a client that sends the next one then keeps in
  step and one ahead; and once the first one has come, a cycle without a new one is an error, after 250 ms unless time is
  strict.
* asynchronous: slvMove is answered at once and its set-point takes the place of one that no cycle has taken; without a new
  one the arm stays at the last one.

A set-point may be as far away as an axis gets in a cycle, :data:`~orinkit.virtual.rc8.robot.slave_mode.limits.SERVO_LIMIT` times. Its
acceleration is not looked at: over a serial line set-points come a few cycles apart, and the arm stands between them.
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

_ROUNDING: Final = 1e-4  # deg: a client's set-points are R4 numbers


class StreamedArm(Protocol):
    """The arm that slave mode moves."""

    @property
    def model(self) -> ArmModel:
        """The arm's model."""

    @property
    def queue(self) -> MotionQueue:
        """The motion queue, which follows the set-points."""

    def angles(self) -> Variant:
        """Return the answer of slvMove: where the arm is."""

    def fail(self, code: int, detail: str = "") -> None:
        """Enter an error state: decelerate, leave slave mode."""


class VE026ASlaveMode:
    """Slave mode of one arm; it is off at the beginning. What is said of a late server is in ``rc8.slave.pace``.

    Args:
        arm: the arm; it calls :meth:`step` and :meth:`settle` in each cycle while the mode is on, and :meth:`end` whenever
            it is stopped.
        cycles: the controller's cycle.
        strict_time: a late set-point is not waited for.

    Attributes:
        mode: 0x002, 0x102, or 0 for off.
        owner: who has turned it on.
        lenient: for how many cycles the limits are larger, because set-points were lost while the server was late.
    """

    def __init__(self, arm: StreamedArm, cycles: ControlLoop, *, strict_time: bool) -> None:
        self.mode = OFF
        self.owner: Operator | None = None
        self.lenient = 0
        self._arm = arm
        self._cycles = cycles
        self._way: list[Joints] = []  # the newest set-point; the commands that lead to it where the server was late
        self._waiting: deque[tuple[Joints, Deferred[Value]]] = deque()  # slvMoves that wait for room
        self._started = False
        self._strict = strict_time
        self._pace: CyclePacer | None = None  # of the present stream, or of the last one

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def on(self) -> bool:
        """Whether it is on."""
        return self.mode != OFF

    @property
    def empty(self) -> bool:
        """Whether there is no set-point that a cycle has still to take."""
        return not self._way and not self._waiting

    @property
    def watched(self) -> bool:
        """Whether the next cycle needs a set-point: the time-out detector is at work."""
        return self.mode == SYNCHRONOUS and self._started

    @property
    def pending(self) -> bool:
        """Whether the next cycle has something to do, though nothing may move."""
        return bool(self._way) or self.watched

    @property
    def overwrites(self) -> bool:
        """Whether cycles that were missed are made up for: set-points have come and gone meanwhile."""
        return self.mode == ASYNCHRONOUS

    @property
    def starving(self) -> bool:
        """Whether the next cycle needs a set-point and there is none."""
        return self.watched and not self._way

    @property
    def moving(self) -> bool:
        """Whether the command moves."""
        return self._arm.queue.state is QueueState.FOLLOWING

    @property
    def lateness(self) -> Callable[[int], Lateness]:
        """How late the set-points of the stream were, or of the last one; called with how many to leave out."""
        return self._pace.lateness if self._pace is not None else lambda _: Lateness()

    # --- what clients do ----------------------------------------------------------------------------------------

    def begin(self, owner: Operator, mode: int, drain_input: DrainInput | None) -> None:
        """Turn it on; the arm stands, and whoever calls this has checked what has to be so.

        Args:
            owner: who does.
            mode: 0x002 or 0x102.
            drain_input: of its client, see :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
        """
        self.mode, self.owner = mode, owner
        self.lenient, self._started = 0, False
        self._pace = self._cycles.pace = CyclePacer(self._cycles, self, drain_input, strict=self._strict)

    def put(self, joints: Joints) -> Value | Deferred[Value]:
        """Take a set-point; returns the answer, in synchronous mode a promise of it where there is no room."""
        if self.mode == SYNCHRONOUS and self._way:
            promise = Deferred[Value]()
            self._waiting.append((joints, promise))
            return promise
        self._way = [joints]
        self._started = True
        self._resume()
        self._cycles.wake()
        return self._arm.angles()

    def end(self, code: int) -> None:
        """Turn it off at once; who waits for an answer gets a code. The arm is for others to stop."""
        self._resume()
        late = self.lateness(0)
        if self.on and late.count:
            logger.warning("%s", left_late(late, strict=self._strict))
        waiting, self._waiting = self._waiting, deque()
        self.mode, self.owner = OFF, None
        self._cycles.pace = None
        self._way, self._started = [], False
        for _, promise in waiting:
            promise.set_exception(refusal(code))

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Take the command of this cycle; to be called before the arm's queue steps."""
        queue = self._arm.queue
        if self._way:
            self._lead_to(self._way.pop(0))
        elif self.watched:
            self._arm.fail(SET_POINT_MISSED, "" if self._strict else waited_in_vain())
        elif queue.state is QueueState.FOLLOWING:
            queue.follow(queue.joints)
        self.lenient = max(0, self.lenient - 1)

    def settle(self) -> None:
        """Take what waits for room, and answer it; to be called at the end of a cycle."""
        while self._waiting and not self._way:
            joints, promise = self._waiting.popleft()
            if not promise.done():  # else it was cancelled
                self._way = [joints]
                promise.set_result(self._arm.angles())

    def bridge(self, most: int) -> int:
        """Lead to the set-point of asynchronous mode in at most so many cycles.

        Returns:
            in how many; 0 where there is no set-point.
        """
        if not self._way:
            return 0
        goal, queue = self._way[-1], self._arm.queue
        if self._fault(goal) is None:  # nothing is missing, or it does not matter
            return 1
        self._way = gentlest(self._arm.model, queue.before, queue.joints, goal, most)
        return len(self._way)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _resume(self) -> None:
        if self._pace is not None:
            self._pace.resume()

    def _lead_to(self, joints: Joints) -> None:
        fault = self._fault(joints, LENIENCY if self.lenient else 1.0)
        if fault is not None:
            self._arm.fail(*fault)
        else:
            self._arm.queue.follow(joints)

    def _fault(self, joints: Joints, more: float = 1.0) -> SlaveFault | None:
        """Return what is wrong with a command, the lowest axis first."""
        for number, (axis, b, c) in enumerate(zip(self._arm.model.axes, self._arm.queue.joints, joints, strict=True)):
            most = axis.velocity * SERVO_LIMIT
            if abs(c - b) > most * more * PERIOD + _ROUNDING:
                wanted = abs(c - b) / PERIOD
                return SlaveFault(
                    TOO_FAST_AXIS1 + number,
                    tr("{wanted:.6g} deg/s; the limit is {most:.6g}", wanted=wanted, most=most),
                )
        return None
