"""The arm: its holder, its motor, its queue of motions, and its stops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from orinkit.arms import ArmModel
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.queue import ROOM, MotionQueue, QueueState, Ticket
from orinkit.virtual.engine.servo import ControlLog, Servo
from orinkit.virtual.rc8.error_list import ErrorList
from orinkit.virtual.rc8.robot.accuracy import Accuracy
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.hardware.arm_hardware import ArmHardware
from orinkit.virtual.rc8.robot.motor import Motor
from orinkit.virtual.rc8.robot.slave_mode.slave_mode import RC8SlaveMode
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.robot.standstill import StandstillActions
from orinkit.virtual.rc8.robot.target import FrameContext
from orinkit.virtual.rc8.robot.waiting_calls import MotionCalls, PendingMotions, WaitingCall, WaitingTakers
from orinkit.virtual.rc8.switches import Switches
from orinkit.virtual.rc8.variables.table import VariableTable

_IDLE: Final = QueueState.IDLE  # for every cycle; see orinkit.virtual.engine.motion.queue


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
        accuracy: Tolerances of the encoders.
        slave: Slave mode, in which a client sends a set-point for each cycle.
        hardware: Hardware around the arm: force sensor, areas, buttons.
        companions: The other arms of a cooperative motion, until standstill; a stop, a pause or its end concerns all.
        interruptions: Number of stops, releases and power-offs so far. A motion that was planned earlier, but has not
            begun, is no longer valid.
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
        self.accuracy = Accuracy()
        self._fault = fault
        self.holder: Operator | None = None
        self.held = False
        self.companions: tuple[RC8Arm, ...] = ()
        self.interruptions = 0
        self._cycles = cycles
        self._objects: Counter[Operator] = Counter()
        self._pending: list[PendingMotions] = []
        self._calls = MotionCalls(self.accuracy, self.servo, self.space, seconds)
        self._still: list[Deferred[None]] = []
        self._takers = WaitingTakers()
        self._at_standstill = StandstillActions()
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
        return self.queue.state is not _IDLE

    @property
    def room(self) -> int:
        """Number of motions that can be added to those that are queued or being planned."""
        return ROOM - len(self.queue.tickets) - sum(each.count for each in self._pending)

    @property
    def stopping(self) -> bool:
        """True while the arm is being stopped."""
        return self._stop_code is not None

    @property
    def awaited(self) -> bool:
        """True if a call waits for a motion, or for its planning."""
        return bool(self._calls or self._pending)

    @property
    def powering_off(self) -> bool:
        """True if the motor will be switched off at the end of the motions."""
        return self._at_standstill.includes(self._switch_off)

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
            self.accuracy.reset()
            self.space.tools.current = self.space.works.current = 0

    def take_later(self, operator: Operator, *, keep: bool, check: Callable[[], None]) -> Deferred[None]:
        """Give the arm to an operator at the next standstill; the first operator that waits receives it.

        Args:
            operator: New holder of the arm.
            keep: As for :meth:`take`.
            check: Called at that standstill; if it raises an exception, the operator does not receive the arm, and the
                Deferred fails with the exception.
        """
        done = self._takers.add(operator, keep=keep, check=check)
        if self._at_rest():
            self._serve_takers()
        return done

    def _serve_takers(self) -> None:
        self._takers.serve(lambda operator, keep: self.take(operator, keep=keep))

    def power_on(self) -> None:
        """Put the arm into its state after power-on; call it after :meth:`stop_and_power_off`.

        Calls that wait for standstill fail, so that none of them switches the motor on or takes the arm afterwards.
        """
        error = error_for(hresult.E_ABORT)
        self._at_standstill.drop(error)
        self._takers.drop(error)
        self.give()
        self._when_at_standstill(None, self._reset_settings)

    def _reset_settings(self) -> None:
        """Reset the settings that a controller loses when it is switched off."""
        self.speeds.reset()
        self.accuracy.reset()
        self.space.tools.current = self.space.works.current = 0
        self.log.running = False
        self.servo.power_on()
        self.hardware.servo_log.running = False

    def give(self) -> None:
        """Release the arm semaphore; running motions are not affected, force control ends."""
        self.holder = None
        self.interruptions += 1
        self.hardware.released()

    def give_at_end(self, operator: Operator) -> Deferred[None]:
        """Release the arm semaphore when all motions of its holder have ended; slave mode is left before.

        Returns:
            A Deferred that resolves when the arm is released.
        """
        if self.slave.owner is operator:
            self.slave.leave()

        def give() -> None:
            if self.holder is operator:
                self.give()

        return self._when_at_standstill(operator, give)

    def withdraw(self, call: Deferred[None]) -> bool:
        """Drop a call that waits for standstill: TakeArm, GiveArm, Motor off, or Motor on after a stop.

        Args:
            call: The Deferred that the function of this arm has returned.

        Returns:
            True if the call has no effect any more, and has failed with E_CANCEL; False if it does not wait.
        """
        return self._takers.withdraw(call) or self._at_standstill.withdraw(call)

    def _when_at_standstill(
        self, operator: Operator | None, run: Callable[[], Deferred[None] | None], *, revocable: bool = False
    ) -> Deferred[None]:
        done = self._at_standstill.add(operator, run, revocable=revocable)
        self._stand_still()
        if not done.done():
            self._cycles.wake()
        return done

    def _stand_still(self) -> None:
        if self._at_standstill and not self.busy and not self.slave.on:
            self._at_standstill.run()

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
        self._takers.drop(error_for(hresult.E_ABORT), operator)
        self.hardware.waits.cancel(hresult.E_ABORT, operator)
        self._at_standstill.drop(error_for(hresult.E_ABORT), operator)
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
        return self._calls.add(WaitingCall(ticket, Deferred[None]()), self._stop_code)

    def when_arrived(self, progress: float) -> Deferred[None]:
        """Return a Deferred that resolves when the running motion has covered a share of its path, 0 to 1.

        If there is no motion, it is resolved already. It fails as for :meth:`when_done`.
        """
        if not self.queue.tickets:
            return self.when_still()
        return self._calls.add(WaitingCall(self.queue.tickets[0], Deferred[None](), progress), self._stop_code)

    def when_still(self) -> Deferred[None]:
        """Return a Deferred that resolves at standstill; a paused motion counts as standstill."""
        done = Deferred[None]()
        if self._at_rest():
            done.set_result()
        else:
            self._still.append(done)
        return done

    def stop(self, code: int, *, as_set: bool = False) -> None:
        """Stop the arm within its limits, discard its motions and end slave mode.

        Args:
            code: Error code with which the motions fail; if the arm is already stopping, the code of the earlier stop
                applies.
            as_set: True to decelerate as set for the motion, False to decelerate as fast as possible.
        """
        for arm in (self, *self.companions):
            arm.stop_alone(code, as_set=as_set)

    def stop_alone(self, code: int, *, as_set: bool = False) -> None:
        """Stop this arm without its companions; see :meth:`stop`."""
        self.held = False
        self.interruptions += 1
        if self.slave.on:
            self.slave.end(code)
        self.hardware.stopped(code)
        self._discard_pending(code)
        if self._moving:
            self._stop_code = code if self._stop_code is None else self._stop_code
            self.queue.halt(as_set=as_set)
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
        for arm in (self, *self.companions):
            arm.held = True
            if arm.busy and not arm.stopping:
                arm.queue.hold()
                self._cycles.wake()

    def unhold(self) -> None:
        """Continue after a pause."""
        for arm in (self, *self.companions):
            arm.held = False
            if arm.busy and not arm.stopping:
                arm.queue.unhold()
                self._cycles.wake()

    def skip(self, *, as_set: bool = False) -> None:
        """Stop the arm and discard its motions, see :meth:`stop`; the calls that wait for these motions succeed."""
        if self.busy:
            self.stop(hresult.S_OK, as_set=as_set)

    def switch_motor(
        self, on: bool, operator: Operator | None = None, check: Callable[[], None] | None = None
    ) -> Deferred[None]:
        """Begin to switch the motor on or off; return a Deferred that resolves when the motor is on or off.

        While the arm moves, the motor is switched off at the end of its motions.

        Args:
            on: True to switch the motor on, False to switch it off.
            operator: The operator; ``None`` for the pendant.
            check: During a stop after which the motor is switched off, the motor is switched on at standstill if this
                function then raises no exception; otherwise the Deferred fails with the exception. Without it, and in a
                strict controller, a call during such a stop is refused.

        Raises:
            CallError: MOTOR_SWITCHING_OFF if ``on`` is True while the motor is being switched off, or during a stop
                after which it will be switched off.
        """
        self._cycles.require_open()
        if on and self.powering_off:
            raise error_for(hresult.MOTOR_SWITCHING_OFF)
        if on and self._cut:
            if check is None or self.switches.strict:
                raise error_for(hresult.MOTOR_SWITCHING_OFF)
            return self._when_at_standstill(operator, lambda: self._switch_on_again(check), revocable=True)
        self.interruptions += not on
        if not on and self.slave.on:
            self.slave.end(hresult.MOTOR_NOT_ON)
        if not on and self.busy:
            return self._when_at_standstill(operator, self._switch_off)
        done = self.motor.switch(on)
        self._cycles.wake()
        return done

    def _switch_off(self) -> Deferred[None]:
        return self.motor.switch(False)

    def _switch_on_again(self, check: Callable[[], None]) -> Deferred[None]:
        check()
        return self.motor.switch(True)

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
        position = self.space.complete(joints)
        self.queue.place(position)
        self.servo.place(position)

    def close(self) -> None:
        """Switch the arm off when the controller is switched off; all calls that wait fail with E_ABORT."""
        error = error_for(hresult.E_ABORT)
        if self.slave.on:
            self.slave.end(hresult.E_ABORT)
        self._discard_pending(hresult.E_ABORT)
        self.hardware.close()
        self._at_standstill.drop(error)
        self._takers.drop(error)
        self._calls.fail(error)
        still, self._still = self._still, []
        for done in still:
            done.set_exception(error)
        self.queue = MotionQueue(self.model, self.queue.joints)  # the brakes hold the present position
        self.motor.cut()

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Execute one cycle; return True if the arm requires another cycle."""
        if self.slave.on:
            self.slave.step()
        self.queue.step()
        self.servo.braked = not self.motor.on
        moving = self.servo.step(self.hardware.command(self.queue.joints))
        if self.accuracy.deviation and not self.stopping:
            self.accuracy.report_deviation(self.servo, self._fault)
        switching = self.motor.step()
        moving = self.hardware.step() or moving
        if self.log.running:
            self.log.add(
                lambda: self.servo.sample(self.motor.on),
                self._cycles.number,
                self.space.tools.current,
                self.space.works.current,
            )
        self._answer()
        if self.slave.on:
            self.slave.complete_waiting()
        commanding = self.queue.moving or not self.queue.standing or self.slave.has_work
        return commanding or moving or switching or self.log.running or bool(self._takers or self._at_standstill)

    def _answer(self) -> None:
        """Complete the calls whose motions have ended."""
        if self._calls:
            self._calls.answer(self._stop_code)
        self._come_to_rest()

    def _at_rest(self) -> bool:
        return self.queue.state in (QueueState.IDLE, QueueState.HELD)

    def _come_to_rest(self) -> None:
        if self.queue.moving:
            return
        if not self._moving:
            self._stop_code = None
            self.companions = ()
            if self._cut:
                self._cut = False
                self.motor.cut()
        if self._still:
            still, self._still = self._still, []
            for done in still:
                done.set_result()
        if self._takers:
            self._serve_takers()
        self._stand_still()
