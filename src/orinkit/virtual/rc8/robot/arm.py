"""The arm: who holds it, its motor, its queue of motions, and what stops it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.queue import MotionQueue, QueueState, Ticket, TicketState
from orinkit.virtual.engine.servo import ControlLog, Servo
from orinkit.virtual.rc8.error_list import ErrorList
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.motor import Motor
from orinkit.virtual.rc8.robot.slave_mode.slave_mode import RC8SlaveMode
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.robot.target import FrameContext
from orinkit.virtual.rc8.switches import Switches
from orinkit.virtual.rc8.variables.table import VariableTable

_PASSED = (TicketState.PASSED, TicketState.DONE)


@dataclass(slots=True)
class _Waiting:
    """Someone who waits for a motion: until it is passed, commanded to its end, or arrived there."""

    ticket: Ticket
    passing: bool
    arrived: bool
    done: Deferred[None]


class RC8Arm:
    """The arm and everything that moves it.

    Args:
        model: which arm it is.
        cycles: the controller's cycle.
        switches: of the controller.
        faults: of the controller.
        variables: of the controller.
        seconds: gives the time since the controller was switched on, s.
        fault: is told of an error of the controller: code and detail.

    Attributes:
        holder: who has taken it (TakeArm), ``None`` for nobody.
        held: paused by Hold.
        queue: motions that run and wait.
        servo: encoders and loads.
        motor, speeds, space, log: what their names say.
        slave: slave mode, in which the commands come from a client.
    """

    def __init__(
        self, model: ArmModel, cycles: ControlLoop, switches: Switches, faults: ErrorList, variables: VariableTable,
        seconds: Callable[[], float], fault: Callable[[int, str], None],
    ) -> None:  # fmt: skip
        self.model = model
        self.switches = switches
        self.faults = faults
        self.seconds = seconds
        self.motor = Motor()
        self.speeds = Speeds()
        self.space = FrameContext(model, variables)
        self.queue = MotionQueue(model, model.home)
        self.servo = Servo(model, model.home)
        self.log = ControlLog()
        self.slave = RC8SlaveMode(self, cycles, variables, fault)
        self.holder: Operator | None = None
        self.held = False
        self._cycles = cycles
        self._objects: Counter[Operator] = Counter()
        self._waiting: list[_Waiting] = []
        self._still: list[Deferred[None]] = []
        self._takers: list[tuple[Operator, Deferred[None]]] = []  # who waits for it to stand still, to take it
        self._stop_code: int | None = None  # while it is being brought to rest; 0: a motion that is skipped
        self._cut = False

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """Whether a motion runs, is paused, or is being stopped; in slave mode whether the command moves."""
        return self.queue.state is not QueueState.IDLE

    @property
    def stopping(self) -> bool:
        """Whether it is being brought to rest."""
        return self._stop_code is not None

    @property
    def settled(self) -> bool:
        """Whether it stands where it was told to, encoders too."""
        return not self.busy and self.servo.settled

    # --- who has it ---------------------------------------------------------------------------------------------

    def take(self, operator: Operator, *, keep: bool) -> None:
        """Give the arm to an operator: internal speeds to 100 %, tool 0, work 0, unless they are to be kept."""
        self.holder = operator
        if not keep:
            self.speeds.reset()
            self.space.tools.current = self.space.works.current = 0

    def take_later(self, operator: Operator, *, keep: bool, check: Callable[[], None]) -> Deferred[None]:
        """Give the arm to an operator when nothing moves any more.

        Args:
            operator: who is to have it.
            keep: as :meth:`take`.
            check: raises an exception if the operator may not have it at that moment; the promise is broken with it.
        """
        promise = Deferred[None]()
        self._takers.append((operator, promise))

        def take() -> None:
            self._takers.remove((operator, promise))
            if promise.done():  # it has gone meanwhile
                return
            try:
                check()
            except Exception as error:  # noqa: BLE001 - told to the operator
                promise.set_exception(error)
            else:
                self.take(operator, keep=keep)
                promise.set_result()

        self.when_still().add_done_callback(take)
        return promise

    def give(self) -> None:
        """Take the arm from whoever has it; nothing moves."""
        self.holder = None

    def enter(self, operator: Operator) -> None:
        """Count a client's Robot objects: the arm is its own as long as it has one."""
        self._objects[operator] += 1

    def leave(self, operator: Operator) -> None:
        """Take a client's Robot object off; with its last one what it moves is brought to rest, and the arm is free."""
        self._objects[operator] -= 1
        if self._objects[operator] <= 0:
            self.forget(operator)

    def forget(self, operator: Operator) -> None:
        """An operator has gone, however it took the arm: what it moves is brought to rest, and the arm is free."""
        self._objects.pop(operator, None)
        for taker, promise in self._takers:
            if taker is operator:
                promise.set_exception(error_for(hresult.E_ABORT))
        if self.holder is operator:
            self.holder = None
            self.stop(hresult.STOPPED_DURING_PC_MOTION)

    # --- motion -------------------------------------------------------------------------------------------------

    def begin(self, motion: Motion) -> Ticket:
        """Put a motion at the end of the queue; it starts in the next cycle if nothing else runs."""
        self._cycles.require_open()
        ticket = self.queue.add(motion)
        self._cycles.wake()
        return ticket

    def when_done(self, ticket: Ticket) -> Deferred[None]:
        """Return what is kept when a motion is over, as its pass mark has it; broken when it is stopped."""
        mark = ticket.motion.mark.mode
        wait = _Waiting(ticket, mark in ("P", "n"), mark == "E", Deferred[None]())
        if not self._finish(wait):
            self._waiting.append(wait)
        return wait.done

    def when_still(self) -> Deferred[None]:
        """Return what is kept when nothing moves any more; a paused motion counts as still."""
        done = Deferred[None]()
        if self._at_rest():
            done.set_result()
        else:
            self._still.append(done)
        return done

    def stop(self, code: int) -> None:
        """Bring the arm to rest within its limits and forget its motions; slave mode is off.

        Args:
            code: with which those who wait for them are answered; the first one counts.
        """
        self.held = False
        if self.slave.on:
            self.slave.end(code)
        if self.busy:
            self._stop_code = code if self._stop_code is None else self._stop_code
            self.queue.halt()
            self._answer()  # a paused arm stands already
            self._cycles.wake()

    def cut(self, code: int) -> None:
        """Bring the arm to rest and take its motor supply away: emergency stop, grave errors."""
        self.stop(code)
        if self.busy:
            self._cut = True
        else:
            self.motor.cut()

    def hold(self) -> None:
        """Pause: bring the arm to rest on its path; the motions are kept."""
        self.held = True
        if self.busy and not self.stopping:
            self.queue.hold()
            self._cycles.wake()

    def unhold(self) -> None:
        """Go on."""
        self.held = False
        if self.busy and not self.stopping:
            self.queue.unhold()
            self._cycles.wake()

    def skip(self) -> None:
        """Bring the arm to rest and forget its motions; those who wait for them are told that they are over."""
        if self.busy:
            self.stop(hresult.S_OK)

    def switch_motor(self, on: bool) -> Deferred[None]:
        """Begin to switch the motor; kept when that is done.

        Raises:
            CallError: MOTOR_SWITCHING_OFF, also while the arm is being brought to rest to be cut off.
        """
        self._cycles.require_open()
        if on and self._cut:
            raise error_for(hresult.MOTOR_SWITCHING_OFF)
        if not on and self.slave.on:
            self.slave.end(hresult.MOTOR_NOT_ON)
        done = self.motor.switch(on)
        self._cycles.wake()
        return done

    def lock(self, on: bool) -> None:
        """Set the machine lock: the commands go on, the arm stays. When it is taken off they begin where the arm is."""
        self.switches.machine_lock = on
        self.servo.frozen = on
        if not on:
            self.servo.place(self.servo.encoder)
            self.queue.place(self.servo.encoder)

    def place(self, joints: Sequence[float]) -> None:
        """Put the arm somewhere without moving, before anything runs.

        Raises:
            ValueError: another number of joints than it has axes, or beyond their limits.
        """
        wanted = (*map(float, joints), *self.model.home[len(joints) :])
        finite = len(wanted) == len(self.model.axes) and all(map(math.isfinite, wanted))
        if not finite or self.space.kinematics.limits_exceeded(wanted):
            raise ValueError(tr("{name} cannot stand at {joints}", name=self.model.name, joints=tuple(joints)))
        self.queue.place(wanted)
        self.servo.place(wanted)

    def close(self) -> None:
        """The controller is switched off: whoever waits for anything is told that it will not come."""
        gone = error_for(hresult.E_ABORT)
        if self.slave.on:
            self.slave.end(hresult.E_ABORT)
        for done in (*(promise for _, promise in self._takers), *(wait.done for wait in self._waiting), *self._still):
            done.set_exception(gone)
        self._waiting, self._still, self._takers = [], [], []
        self.queue = MotionQueue(self.model, self.queue.joints)  # the brakes hold it where it is
        self.motor.cut()

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Do one cycle; returns whether anything still happens."""
        if self.slave.on:
            self.slave.step()
        self.queue.step()
        moving = self.servo.step(self.queue.joints)
        switching = self.motor.step()
        self.log.add(
            lambda: self.servo.sample(self.motor.on),
            self._cycles.number,
            self.space.tools.current,
            self.space.works.current,
        )
        self._answer()
        if self.slave.on:
            self.slave.settle()
        paused = self.queue.state is QueueState.HELD
        going_on = (self.busy and not paused) or not self.queue.standing or self.slave.pending
        return going_on or moving or switching or self.log.running

    def _answer(self) -> None:
        """Tell those who wait what has become of their motions."""
        waiting, self._waiting = self._waiting, []
        self._waiting += [wait for wait in waiting if not self._finish(wait)]
        self._come_to_rest()

    def _finish(self, wait: _Waiting) -> bool:
        state = wait.ticket.state
        if state is TicketState.STOPPED:
            if self._stop_code == hresult.S_OK:
                wait.done.set_result()
            else:
                wait.done.set_exception(error_for(self._stop_code or hresult.STOPPED_DURING_PC_MOTION))
            return True
        if state is TicketState.DONE and (not wait.arrived or self.servo.settled):
            wait.done.set_result()
            return True
        if wait.passing and state in _PASSED:
            wait.done.set_result()
            return True
        return False

    def _at_rest(self) -> bool:
        return self.queue.state in (QueueState.IDLE, QueueState.HELD)

    def _come_to_rest(self) -> None:
        if not self.busy:
            self._stop_code = None
            if self._cut:
                self._cut = False
                self.motor.cut()
        if self._still and self._at_rest():
            still, self._still = self._still, []
            for done in still:
                done.set_result()
