"""Slave mode itself: who has turned it on, the buffer of set-points, what each cycle takes from it, and what ends it."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.rc8.slave_formats import SlaveMode
from orinkit.rc8.slave_lateness import Lateness
from orinkit.values.variant import Value
from orinkit.virtual.engine.catch_up import gentlest
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.elastic_time import CyclePacer, DrainInput, left_late, not_waited, waited_in_vain
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.queue import MotionQueue, QueueState
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.slave_mode.io import OutputRange
from orinkit.virtual.rc8.robot.slave_mode.limits import SlaveLimits
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.switches import Switches
from orinkit.virtual.rc8.variables.table import VariableTable

logger = logging.getLogger("orinkit.rc8")

ROOM: Final = 3
"""Set-points that modes 0 and 2 have room for (RC8 table 4-4)."""

QUEUE, NEWEST, WAIT = 0, 1, 2  # the bufferings of table 4-4

Told: TypeAlias = Callable[[], Value]
"""Makes what a slvMove is answered, at the moment when it is."""


@dataclass(frozen=True, slots=True)
class PlannedSetPoint:
    """A set-point as it is carried out.

    Attributes:
        joints: where the command is then, deg or mm.
        outputs: points that are set at the same time.
    """

    joints: Joints
    outputs: tuple[OutputRange, ...] = ()


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A slvMove that is answered when there is room for its set-point (mode 2)."""

    command: PlannedSetPoint
    told: Told
    promise: Deferred[Value]


class StreamedArm(Protocol):
    """The arm that slave mode moves."""

    @property
    def model(self) -> ArmModel:
        """The arm's model."""

    @property
    def switches(self) -> Switches:
        """Switches of the controller."""

    @property
    def speeds(self) -> Speeds:
        """Internal and external speeds."""

    @property
    def queue(self) -> MotionQueue:
        """The motion queue, which follows the set-points."""

    @property
    def busy(self) -> bool:
        """Whether the arm moves or has motions queued."""

    def stop(self, code: int) -> None:
        """Decelerate, and fail waiting calls with a code."""

    def cut(self, code: int) -> None:
        """Stop at once, and fail waiting calls with a code."""


class RC8SlaveMode:
    """Slave mode of one arm. It is off at the beginning.

    Args:
        arm: the arm; it calls :meth:`step` and :meth:`settle` in each cycle while the mode is on, and :meth:`end`
            whenever it is stopped.
        cycles: the controller's cycle.
        variables: of the controller, for the I/O.
        fault: is told of an error of the controller: code and detail.

    Attributes:
        mode: which mode is on, ``None`` for off.
        owner: who has turned it on.
        newest: joints of the last set-point that was taken.
        lenient: for how many cycles the limits are larger, because set-points of mode 1 were lost while time stood still.
    """

    def __init__(
        self, arm: StreamedArm, cycles: ControlLoop, variables: VariableTable, fault: Callable[[int, str], None]
    ) -> None:
        self.mode: SlaveMode | None = None
        self.owner: Operator | None = None
        self.newest: Joints = ()
        self.lenient = 0
        self._arm = arm
        self._cycles = cycles
        self._variables = variables
        self._fault = fault
        self._limits = SlaveLimits(arm.model, arm.switches, arm.speeds)
        self._buffer: deque[PlannedSetPoint] = deque()
        self._waiting: deque[_Waiting] = deque()
        self._leaving: list[Deferred[None]] = []  # who waits for the end of the mode
        self._pace: CyclePacer | None = None  # of the present stream, or of the last one

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def on(self) -> bool:
        """Whether it is on."""
        return self.mode is not None

    @property
    def taking(self) -> bool:
        """Whether it is on and takes set-points: it is not about to be left."""
        return self.on and not self._leaving

    @property
    def overwrites(self) -> bool:
        """Whether the newest set-point counts (mode 1)."""
        return self.mode is not None and self.mode.buffering == NEWEST

    @property
    def moving(self) -> bool:
        """Whether the command moves, as set-points have it."""
        return self._arm.queue.state is QueueState.FOLLOWING

    @property
    def starving(self) -> bool:
        """Whether the next cycle needs a set-point and there is none.

        In mode 1 one that was sent again is none if the arm cannot stop there: the client repeats it while it waits for
        the next cycle (RC8 4.3.2).
        """
        if not self.taking or not self.moving:
            return False
        return not self._buffer or (self.overwrites and self._stops_hard(self._buffer[-1].joints))

    @property
    def lateness(self) -> Callable[[int], Lateness]:
        """How late the set-points of the stream were, or of the last one; called with how many to leave out."""
        return self._pace.lateness if self._pace is not None else lambda _: Lateness()

    @property
    def pending(self) -> bool:
        """Whether the next cycle has something to do, though nothing may move."""
        return bool(self._buffer or self._leaving)

    # --- what clients do ----------------------------------------------------------------------------------------

    def begin(self, owner: Operator, mode: SlaveMode, drain_input: DrainInput | None) -> None:
        """Turn it on; the arm stands, and whoever calls this has checked what has to be so.

        Args:
            owner: who does.
            mode: which.
            drain_input: of its client, see :class:`~orinkit.virtual.engine.elastic_time.CyclePacer`.
        """
        self._cycles.require_open()
        self.mode, self.owner = mode, owner
        self.newest = self._arm.queue.joints
        self.lenient = 0
        self._pace = self._cycles.pace = CyclePacer(
            self._cycles, self, drain_input, strict=self._arm.switches.strict_time
        )

    def leave(self) -> Deferred[None]:
        """Turn it off when the buffer is empty and the arm is at rest; kept then."""
        done = Deferred[None]()
        self._leaving.append(done)
        self._resume()
        self.settle()
        if not done.done():
            self._cycles.wake()
        return done

    def require_room(self) -> None:
        """Check that a set-point would be taken, or wait for room.

        Raises:
            CallError: E_BUF_FULL (mode 0).
        """
        if self.mode is not None and self.mode.buffering == QUEUE and len(self._buffer) >= ROOM:
            raise error_for(hresult.E_BUF_FULL)

    def put(self, command: PlannedSetPoint, told: Told) -> Value | ResultWithCode | Deferred[Value]:
        """Take a set-point into the buffer; returns the answer, in mode 2 a promise of it where there is no room."""
        self.newest = command.joints
        if self.overwrites:
            self._buffer.clear()
        elif len(self._buffer) >= ROOM:
            waiting = _Waiting(command, told, Deferred[Value]())
            self._waiting.append(waiting)
            return waiting.promise
        self._buffer.append(command)
        if not self.starving:
            self._resume()
        self._cycles.wake()
        full = len(self._buffer) == ROOM and self.mode is not None and self.mode.buffering == QUEUE
        return ResultWithCode(hresult.S_BUF_FULL, told()) if full else told()

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Take the command of this cycle from the buffer; to be called before the arm's queue steps."""
        queue = self._arm.queue
        if self._buffer:
            self._carry_out(self._buffer.popleft())
        elif self._leaving:
            queue.halt()
        elif queue.state is QueueState.FOLLOWING:
            late = not_waited() if self._arm.switches.strict_time else waited_in_vain()
            if self.overwrites:  # a command to stay where it is (RC8 table 4-6)
                self._lead_to(queue.joints, late)
            else:
                self.fail(hresult.COMMAND_DELAY, late)
        self.lenient = max(0, self.lenient - 1)

    def settle(self) -> None:
        """Fill up the buffer, answer whose turn it is; to be called at the end of a cycle."""
        while self._waiting and len(self._buffer) < ROOM:
            waiting = self._waiting.popleft()
            if waiting.promise.done():  # it was cancelled
                continue
            self._buffer.append(waiting.command)
            waiting.promise.set_result(waiting.told())
        if self._leaving and not self._buffer and not self._arm.busy:
            leaving = self._leaving
            self._turn_off()
            for done in leaving:
                done.set_result()

    def bridge(self, most: int) -> int:
        """Lead to the set-point of mode 1 in at most so many cycles.

        Returns:
            in how many; 0 where there is no set-point.
        """
        if not self._buffer:
            return 0
        goal, queue = self._buffer[-1], self._arm.queue
        if self._limits.fault(queue.before, queue.joints, goal.joints, lenient=False) is None:
            return 1  # nothing is missing, or it does not matter
        *way, _ = gentlest(self._arm.model, queue.before, queue.joints, goal.joints, most)
        self._buffer = deque([*map(PlannedSetPoint, way), goal])
        return len(self._buffer)

    def end(self, code: int) -> None:
        """Turn it off at once and forget the buffer; who waits is answered with a code. The arm is for others to stop."""
        moves, leaving = list(self._waiting), self._leaving
        self._turn_off()
        for move in moves:
            move.promise.set_exception(error_for(code))
        for done in leaving:
            done.set_exception(error_for(code))

    def fail(self, code: int, detail: str = "") -> None:
        """Raise an error of the controller that ends slave mode and brings the arm to rest (RC8 4.7)."""
        logger.warning("%s: slave mode: %s", self.owner, error_for(code, detail))
        self._fault(code, detail)
        self._arm.stop(code)  # an error of a low level does not

    # --- helpers ------------------------------------------------------------------------------------------------

    def _carry_out(self, command: PlannedSetPoint) -> None:
        if self._lead_to(command.joints):
            try:
                for output in command.outputs:
                    self._variables.set_points(output.first, output.count, output.states)
            except Exception as error:  # the arm moves: this cycle goes on whatever becomes of them
                logger.exception("outputs")
                self.fail(hresult.UNDEFINED_ERROR, f"{type(error).__name__}: {error}")
                self._arm.cut(hresult.UNDEFINED_ERROR)

    def _lead_to(self, joints: Joints, why: str = "") -> bool:
        """Have the command be at joints in this cycle, if the limits allow it; else that is an error.

        Args:
            joints: where, deg or mm.
            why: what the error is to tell beside the limit.
        """
        queue = self._arm.queue
        fault = self._limits.fault(queue.before, queue.joints, joints, lenient=self.lenient > 0)
        if fault is not None:
            code, detail = fault
            self.fail(code, "; ".join(filter(None, (why, detail))))
            return False
        queue.follow(joints)
        return True

    def _stops_hard(self, joints: Joints) -> bool:
        """Whether to be at these joints again is to stop harder than the limits allow."""
        queue = self._arm.queue
        return joints == queue.joints and self._limits.fault(queue.before, joints, joints, lenient=False) is not None

    def _resume(self) -> None:
        if self._pace is not None:
            self._pace.resume()

    def _turn_off(self) -> None:
        self._resume()
        late = self.lateness(0)
        if self.on and late.count:
            logger.warning("%s: %s", self.owner, left_late(late, strict=self._arm.switches.strict_time))
        self.mode = self.owner = None
        self._cycles.pace = None
        self._buffer.clear()
        self._waiting.clear()
        self._leaving = []
