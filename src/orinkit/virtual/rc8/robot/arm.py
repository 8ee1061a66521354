"""The arm: its holder, its motor, its queue of motions, and its stops."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.queue import ROOM, MotionQueue, QueueState, Ticket, TicketState
from orinkit.virtual.engine.servo import ControlLog, Servo
from orinkit.virtual.rc8.error_list import ErrorList
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.hardware.arm_hardware import ArmHardware
from orinkit.virtual.rc8.robot.motor import Motor
from orinkit.virtual.rc8.robot.slave_mode.slave_mode import RC8SlaveMode
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.robot.target import ROBOT_AXES, FrameContext
from orinkit.virtual.rc8.switches import Switches
from orinkit.virtual.rc8.variables.table import VariableTable

_PASSED = (TicketState.PASSED, TicketState.DONE)
_TAKERS: Final = 100  # operators waiting for the arm that are answered in a cycle


@dataclass(slots=True)
class _Waiting:
    """A call that waits for a motion.

    Attributes:
        ticket: The motion.
        passing: True if the call completes when the motion reaches its pass mark.
        arrived: True if the call completes only when the encoders have reached the end of the motion.
        done: The Deferred of the call.
    """

    ticket: Ticket
    passing: bool
    arrived: bool
    done: Deferred[None]


@dataclass(slots=True)
class _Taker:
    """The arguments of :meth:`RC8Arm.take_later`, and the Deferred that it returned."""

    keep: bool
    check: Callable[[], None]
    done: Deferred[None]


@dataclass(slots=True, eq=False)
class PendingMotions:
    """Motions of one call that are being planned.

    Attributes:
        count: Number of motions.
        done: The Deferred of the call.
    """

    count: int
    done: Deferred[Any]


class RC8Arm:
    """The arm and everything that moves it.

    Args:
        model: The arm model.
        cycles: The control loop of the controller.
        switches: The switches of the controller.
        faults: The errors of the controller.
        variables: The variables of the controller.
        seconds: Callback that returns the time since the controller was switched on, s.
        fault: Callback that raises an error of the controller; invoked with code and detail.

    Attributes:
        holder: Holder of the arm semaphore (TakeArm), or ``None``.
        held: True after Hold, until Unhold or a stop.
        queue: Running and queued motions.
        servo: Encoders and loads.
        motor: Motor supply.
        speeds: Internal and external speeds.
        space: Frames and kinematics.
        log: Control log.
        slave: Slave mode, in which a client sends a set-point for each cycle.
        hardware: Hardware around the arm: force sensor, areas, buttons.
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
        self.slave = RC8SlaveMode(self, cycles, fault)
        self.hardware = ArmHardware(self, cycles, variables, seconds, fault)
        self.holder: Operator | None = None
        self.held = False
        self._cycles = cycles
        self._objects: Counter[Operator] = Counter()
        self._pending: list[PendingMotions] = []
        self._waiting: list[_Waiting] = []
        self._still: list[Deferred[None]] = []
        self._takers: dict[Operator, _Taker] = {}  # operators waiting for standstill to take the arm
        self._stop_code: int | None = None  # during a stop: the code with which motions fail; 0 if they are skipped
        self._cut = False

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """True while a motion is being planned, runs, is paused or is being stopped.

        In slave mode, it is True while the command position moves.
        """
        return self._moving or self.planning

    @property
    def planning(self) -> bool:
        """True while a motion is being planned in a thread."""
        return bool(self._pending)

    @property
    def _moving(self) -> bool:
        return self.queue.state is not QueueState.IDLE

    @property
    def room(self) -> int:
        """Number of motions that can be added to those that are queued or being planned."""
        return ROOM - len(self.queue.tickets) - sum(each.count for each in self._pending)

    @property
    def stopping(self) -> bool:
        """True while the arm is being stopped."""
        return self._stop_code is not None

    @property
    def settled(self) -> bool:
        """True if no motion is in progress and the encoders have reached the command position."""
        return not self.busy and self.servo.settled

    # --- arm semaphore ------------------------------------------------------------------------------------------

    def take(self, operator: Operator, *, keep: bool) -> None:
        """Give the arm to an operator, which is a client or a program.

        If ``keep`` is False, set the internal speeds to 100 %, and make tool 0 and work 0 the current ones.
        """
        self.holder = operator
        if not keep:
            self.speeds.reset()
            self.space.tools.current = self.space.works.current = 0

    def take_later(self, operator: Operator, *, keep: bool, check: Callable[[], None]) -> Deferred[None]:
        """Give the arm to an operator at the next standstill; the first operator that waits receives it.

        Args:
            operator: New holder of the arm.
            keep: As for :meth:`take`.
            check: Called at that standstill; if it raises an exception, the operator does not receive the arm, and the
                Deferred fails with the exception.
        """
        if operator in self._takers:
            return self._takers[operator].done
        taker = self._takers[operator] = _Taker(keep, check, Deferred[None]())
        if self._at_rest():
            self._serve_takers()
        return taker.done

    def _serve_takers(self) -> None:
        for operator in list(itertools.islice(self._takers, _TAKERS)):
            taker = self._takers.pop(operator)
            try:
                taker.check()
            except Exception as error:  # noqa: BLE001 - passed to the operator
                taker.done.set_exception(error)
            else:
                self.take(operator, keep=taker.keep)
                taker.done.set_result()

    def give(self) -> None:
        """Release the arm semaphore; running motions are not affected, force control ends."""
        self.holder = None
        self.hardware.released()

    def add_robot_object(self, operator: Operator) -> None:
        """Count a Robot object of a client; a client can keep the arm while it has at least one Robot object."""
        self._objects[operator] += 1

    def remove_robot_object(self, operator: Operator) -> None:
        """Remove a Robot object of a client from the count.

        If it was the last one, stop the client's motions and release the arm.
        """
        self._objects[operator] -= 1
        if self._objects[operator] <= 0:
            self.forget(operator)

    def forget(self, operator: Operator) -> None:
        """Remove a disconnected operator: stop its motions and release the arm."""
        self._objects.pop(operator, None)
        taker = self._takers.pop(operator, None)
        if taker is not None:
            taker.done.set_exception(error_for(hresult.E_ABORT))
        self.hardware.waits.cancel(hresult.E_ABORT, operator)
        if self.holder is operator:
            self.give()
            self.stop(hresult.STOPPED_DURING_PC_MOTION)

    # --- motion -------------------------------------------------------------------------------------------------

    def expect_motions(self, pending: PendingMotions) -> None:
        """Count motions that are being planned as motions of the arm, so that a stop discards them."""
        self._pending.append(pending)

    def forget_motions(self, pending: PendingMotions) -> bool:
        """Remove motions that have been planned; return False if a stop has discarded them."""
        if pending not in self._pending:
            return False
        self._pending.remove(pending)
        return True

    def enqueue(self, motion: Motion) -> Ticket:
        """Append a motion to the queue; it starts in the next cycle if no other motion runs and the arm is not held."""
        self._cycles.require_open()
        ticket = self.queue.add(motion)
        if self.held:  # Hold was called while the motion was planned
            self.queue.hold()
        self._cycles.wake()
        return ticket

    def when_done(self, ticket: Ticket) -> Deferred[None]:
        """Return a Deferred that resolves when a motion is complete according to its pass mark.

        The Deferred fails if the motion is stopped, except by :meth:`skip`.
        """
        mark = ticket.motion.mark.mode
        wait = _Waiting(ticket, mark in ("P", "n"), mark == "E", Deferred[None]())
        if not self._finish(wait):
            self._waiting.append(wait)
        return wait.done

    def when_still(self) -> Deferred[None]:
        """Return a Deferred that resolves at standstill; a paused motion counts as standstill."""
        done = Deferred[None]()
        if self._at_rest():
            done.set_result()
        else:
            self._still.append(done)
        return done

    def stop(self, code: int) -> None:
        """Stop the arm within its limits, discard its motions and end slave mode.

        Args:
            code: Error code with which the motions fail; if the arm is already stopping, the code of the earlier stop
                applies.
        """
        self.held = False
        if self.slave.on:
            self.slave.end(code)
        self.hardware.stopped(code)
        self._discard_pending(code)
        if self._moving:
            self._stop_code = code if self._stop_code is None else self._stop_code
            self.queue.halt()
            self._answer()  # a paused arm is already at standstill, so its calls complete now
            self._cycles.wake()

    def _discard_pending(self, code: int) -> None:
        pending, self._pending = self._pending, []
        for each in pending:
            if code == hresult.S_OK:
                each.done.set_result()
            else:
                each.done.set_exception(error_for(code))

    def stop_and_power_off(self, code: int) -> None:
        """Stop the arm and then switch its motor off: for an emergency stop or a severe error."""
        self.stop(code)
        if self.busy:
            self._cut = True
        else:
            self.motor.cut()

    def hold(self) -> None:
        """Pause: stop the arm on its path without discarding its motions."""
        self.held = True
        if self.busy and not self.stopping:
            self.queue.hold()
            self._cycles.wake()

    def unhold(self) -> None:
        """Continue after a pause."""
        self.held = False
        if self.busy and not self.stopping:
            self.queue.unhold()
            self._cycles.wake()

    def skip(self) -> None:
        """Stop the arm and discard its motions; the calls that wait for these motions succeed."""
        if self.busy:
            self.stop(hresult.S_OK)

    def switch_motor(self, on: bool) -> Deferred[None]:
        """Begin to switch the motor on or off; return a Deferred that resolves when the motor is on or off.

        Raises:
            CallError: MOTOR_SWITCHING_OFF if ``on`` is True while the motor is being switched off, or during a stop
                after which it will be switched off.
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
        """Set or clear the machine lock, which keeps the arm in place.

        Clearing it sets the command position to the actual position of the arm.
        """
        self.switches.machine_lock = on
        self.servo.frozen = on
        if not on:
            self.servo.place(self.servo.encoder)
            self.queue.place(self.servo.encoder)

    def place(self, joints: Sequence[float]) -> None:
        """Set the joint position without a motion, before the controller runs; omitted extended joints are at home.

        Raises:
            ValueError: If there are fewer joints than the arm has, or more than axes, or if a joint is outside its
                limits.
        """
        axes = len(self.model.axes)
        position = (*map(float, joints), *self.model.home[len(joints) :])
        complete = len(joints) >= ROBOT_AXES and len(position) == axes and all(map(math.isfinite, position))
        if not complete or self.space.kinematics.limits_exceeded(position):
            raise ValueError(
                tr(
                    "joint position {joints} is not valid for {name}. Try: {count} joints within their limits",
                    name=self.model.name,
                    joints=", ".join(f"{value:g}" for value in joints),
                    count=ROBOT_AXES if axes == ROBOT_AXES else f"{ROBOT_AXES}-{axes}",
                )
            )
        self.queue.place(position)
        self.servo.place(position)

    def close(self) -> None:
        """Switch the arm off when the controller is switched off; all calls that wait fail with E_ABORT."""
        error = error_for(hresult.E_ABORT)
        if self.slave.on:
            self.slave.end(hresult.E_ABORT)
        self._discard_pending(hresult.E_ABORT)
        self.hardware.close()
        for done in (
            *(taker.done for taker in self._takers.values()),
            *(wait.done for wait in self._waiting),
            *self._still,
        ):
            done.set_exception(error)
        self._waiting, self._still, self._takers = [], [], {}
        self.queue = MotionQueue(self.model, self.queue.joints)  # the brakes hold the present position
        self.motor.cut()

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Execute one cycle; return True if the arm requires another cycle."""
        if self.slave.on:
            self.slave.step()
        self.queue.step()
        moving = self.servo.step(self.hardware.command(self.queue.joints))
        switching = self.motor.step()
        moving = self.hardware.step() or moving
        self.log.add(
            lambda: self.servo.sample(self.motor.on),
            self._cycles.number,
            self.space.tools.current,
            self.space.works.current,
        )
        self._answer()
        if self.slave.on:
            self.slave.complete_waiting()
        paused = self.queue.state is QueueState.HELD
        commanding = (self._moving and not paused) or not self.queue.standing or self.slave.has_work
        return commanding or moving or switching or self.log.running or bool(self._takers)

    def _answer(self) -> None:
        """Complete the calls whose motions have ended."""
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
        if not self._moving:
            self._stop_code = None
            if self._cut:
                self._cut = False
                self.motor.cut()
        if self._still and self._at_rest():
            still, self._still = self._still, []
            for done in still:
                done.set_result()
        if self._takers and self._at_rest():
            self._serve_takers()
