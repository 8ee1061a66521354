"""The buffer of slave mode: set-points of a client, the command position of each cycle, and calls that wait for room.

The virtual RC8 and the virtual VE026A share this module; an RC8 has room for three set-points, a VE026A for one. The
subclasses define what differs between the controllers: the modes, the limits, and the errors.
:mod:`orinkit.virtual.engine.elastic_time` handles late clients and servers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol, TypeAlias

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred
from orinkit.core.record import record
from orinkit.rc8.slave_lateness import Lateness
from orinkit.values.variant import Value
from orinkit.virtual.engine.catch_up import gentlest_path
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.elastic_time import CyclePacer, WhenInputProcessed
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.queue import MotionQueue, QueueState

SERVO_LIMIT: Final = 1.25
"""The servo limit as a multiple of the command limit, which is the limit of the arm model. DENSO publishes only that
the servo limit is larger; the number is an assumption of this project."""

LENIENCY: Final = 2.0
"""Factor by which limits are multiplied after a delay of the server, because the client has not caused the delay."""

ReplyFactory: TypeAlias = Callable[[], Value]
"""Function that returns the result of a slvMove; it is called when the reply is sent."""


class SlaveFault(NamedTuple):
    """A violated limit: error code and description."""

    code: int
    detail: str


@record
class PlannedSetPoint:
    """A set-point converted for execution.

    Attributes:
        joints: Command position, deg or mm.
        set_outputs: Function that sets the I/O outputs of the set-point; called in the cycle in which ``joints`` is the
            command position. ``None`` if the set-point has no outputs.
    """

    joints: Joints
    set_outputs: Callable[[], None] | None = None


@record
class _Waiting:
    """A slvMove whose reply waits until the buffer has room for its set-point."""

    command: PlannedSetPoint
    make_reply: ReplyFactory
    deferred: Deferred[Value]


class FollowingArm(Protocol):
    """The arm that executes the set-points."""

    @property
    def model(self) -> ArmModel:
        """The arm's model."""

    @property
    def queue(self) -> MotionQueue:
        """The motion queue, which follows the set-points."""


class SetPointBuffer(ABC):
    """The buffer of slave mode; initially empty.

    Args:
        arm: The arm.
        cycles: The control loop of the controller.
        capacity: Number of set-points for which there is room.

    Attributes:
        lenient_cycles: Number of cycles for which the limits are larger, because set-points were lost while the server
            was late.
    """

    def __init__(self, arm: FollowingArm, cycles: ControlLoop, capacity: int) -> None:
        self.lenient_cycles = 0
        self._arm = arm
        self._cycles = cycles
        self._capacity = capacity
        self._buffer: deque[PlannedSetPoint] = deque()  # after a catch-up: the command positions up to the newest one
        self._waiting: deque[_Waiting] = deque()
        self._pace: CyclePacer | None = None  # of the current stream, or of the last one

    # --- what the controllers define ----------------------------------------------------------------------------

    @property
    @abstractmethod
    def overwrites(self) -> bool:
        """True if only the newest set-point counts."""

    @property
    @abstractmethod
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and there is none."""

    @abstractmethod
    def limit_violation(self, before: Joints, now: Joints, wanted: Joints, *, lenient: bool) -> SlaveFault | None:
        """Return the first limit that a command position violates; ``None`` if it is within the limits.

        Args:
            before: The command position one cycle ago, deg or mm.
            now: The present command position.
            wanted: The next command position.
            lenient: True to multiply the limits by :data:`LENIENCY`.
        """

    @abstractmethod
    def fail(self, code: int, detail: str = "") -> None:
        """Raise an error of the controller, which ends slave mode and stops the arm."""

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """True while the command position follows set-points and moves."""
        return self._arm.queue.state is QueueState.FOLLOWING

    @property
    def full(self) -> bool:
        """True if there is no room for another set-point."""
        return len(self._buffer) >= self._capacity

    @property
    def lateness(self) -> Callable[[int], Lateness]:
        """Function that returns the lateness of the current stream, or of the last one if no stream is running.

        The argument of the function is the number of late set-points at the beginning that are not counted.
        """
        return self._pace.lateness if self._pace is not None else lambda _: Lateness()

    # --- set-points ---------------------------------------------------------------------------------------------

    def accept(self, command: PlannedSetPoint, make_reply: ReplyFactory) -> Value | Deferred[Value]:
        """Put a set-point into the buffer; return the reply, or a deferred reply if the buffer is full."""
        if self.overwrites:
            self._buffer.clear()
        elif self.full:
            waiting = _Waiting(command, make_reply, Deferred[Value]())
            self._waiting.append(waiting)
            return waiting.deferred
        self._buffer.append(command)
        if not self.starving:
            self._resume()
        self._cycles.wake()
        return make_reply()

    def plan_catch_up(self, most: int) -> int:
        """Plan the command positions that lead to the newest set-point in at most ``most`` cycles.

        Returns:
            Number of planned cycles; 0 if there is no set-point.
        """
        if not self._buffer:
            return 0
        goal, queue = self._buffer[-1], self._arm.queue
        if self.limit_violation(queue.previous_joints, queue.joints, goal.joints, lenient=False) is None:
            return 1  # no set-points were lost, or one cycle is enough
        *path, _ = gentlest_path(self._arm.model, queue.previous_joints, queue.joints, goal.joints, most)
        self._buffer = deque([*map(PlannedSetPoint, path), goal])
        return len(self._buffer)

    # --- for the subclasses -------------------------------------------------------------------------------------

    def _open(self, when_input_processed: WhenInputProcessed | None, *, strict: bool) -> None:
        """Begin a stream: from now on the control loop waits for its set-points.

        Args:
            when_input_processed: See :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
            strict: True for strict time: the controller does not wait for late set-points.
        """
        self.lenient_cycles = 0
        self._pace = CyclePacer(self._cycles, self, when_input_processed, strict=strict)
        self._pace.begin()

    def _close(self) -> list[Deferred[Value]]:
        """End the stream and clear the buffer; return the deferred replies of the calls that still wait for room."""
        if self._pace is not None:
            self._pace.end()
        self._buffer.clear()
        waiting, self._waiting = self._waiting, deque()
        return [each.deferred for each in waiting]

    def _resume(self) -> None:
        """Stop waiting for a set-point."""
        if self._pace is not None:
            self._pace.resume()

    def _refill(self) -> None:
        """While there is room, put the set-points of waiting calls into the buffer, and send the replies."""
        while self._waiting and not self.full:
            waiting = self._waiting.popleft()
            if waiting.deferred.done():  # it was cancelled
                continue
            self._buffer.append(waiting.command)
            waiting.deferred.set_result(waiting.make_reply())

    def _lead_to(self, joints: Joints, why: str = "") -> bool:
        """Set the command position of this cycle; raise an error of the controller if it violates a limit.

        Args:
            joints: Command position, deg or mm.
            why: Reason to add to the message about the limit.

        Returns:
            True if the limits allow the command position.
        """
        queue = self._arm.queue
        fault = self.limit_violation(queue.previous_joints, queue.joints, joints, lenient=self.lenient_cycles > 0)
        if fault is not None:
            self.fail(fault.code, "; ".join(filter(None, (why, fault.detail))))
            return False
        queue.follow(joints)
        return True

    def _end_cycle(self) -> None:
        """Count down the cycles with larger limits; call it at the end of a step."""
        self.lenient_cycles = max(0, self.lenient_cycles - 1)
