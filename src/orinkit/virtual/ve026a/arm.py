"""The arm: its motor, its error, the works that take their time, and who moves it."""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from orinkit.arms import ArmModel
from orinkit.arms.kinematics import Kinematics
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.queue import MotionQueue
from orinkit.virtual.engine.servo import Servo
from orinkit.virtual.ve026a.arm_owner import Operator
from orinkit.virtual.ve026a.codes import EMERGENCY_STOP, OUT_OF_RANGE_AXIS1, ROBOT_RUNNING, refusal
from orinkit.virtual.ve026a.parameters import OFF, VALUES
from orinkit.virtual.ve026a.slave import VE026ASlaveMode

logger = logging.getLogger("orinkit.ve026a")

LONGEST_WAIT: Final = 0.5
"""Seconds that slvChangeMode waits until the arm stands (2.2.1)."""

_R4_ARRAY: Final = int(VarType.R4) | ARRAY
_R4: Final = struct.Struct(f"<{VALUES}f")
_SINGLE: Final = struct.Struct("<f")


class OperationKind(Enum):
    """What the controller is busy with."""

    MOTOR_ON = "motor on"
    MOTOR_OFF = "motor off"
    CLEAR_ERROR = "clear error"


@dataclass(slots=True)
class _Operation:
    """A work, the cycles that it still takes, and who waits for it."""

    work: OperationKind
    cycles: int
    done: Deferred[None] = field(default_factory=Deferred)


@dataclass(slots=True)
class _Change:
    """A slvChangeMode that waits until the arm stands."""

    operator: Operator
    mode: int
    cycles: int = 0
    done: Deferred[None] = field(default_factory=Deferred)


class VE026AArm:
    """The arm and everything that moves it.

    Args:
        model: which arm it is.
        cycles: the controller's cycle.
        joints: where it stands, one for each axis, deg.
        motor_seconds: how long Motor takes.
        clear_seconds: how long ClearError takes.
        strict_time: a late set-point is not waited for.

    Attributes:
        error: code of the error that it is in, 0 for none. The first one counts, until it is cleared.
        motor_on: whether the motor is on.
        emergency: whether the emergency stop is pressed.
        queue: the command.
        servo: the encoders.
        slave: slave mode.
    """

    def __init__(
        self, model: ArmModel, cycles: ControlLoop, joints: Joints, motor_seconds: float, clear_seconds: float, *,
        strict_time: bool,
    ) -> None:  # fmt: skip
        self.model = model
        self.kinematics = Kinematics(model)
        self.queue = MotionQueue(model, joints)
        self.servo = Servo(model, joints)
        self.slave = VE026ASlaveMode(self, cycles, strict_time=strict_time)
        self.error = hresult.S_OK
        self.motor_on = self.emergency = False
        self._cycles = cycles
        self._seconds = {
            OperationKind.MOTOR_ON: motor_seconds,
            OperationKind.MOTOR_OFF: motor_seconds,
            OperationKind.CLEAR_ERROR: clear_seconds,
        }
        self._job: _Operation | None = None
        self._change: _Change | None = None
        self._cut = False  # the motor goes off as soon as it stands
        self._following = False  # the encoders are on their way to where the command stands

    @property
    def standing(self) -> bool:
        """Whether it stands still, encoders too."""
        return not self.queue.moving and self.queue.standing and not self._following

    def exceeded(self, joints: Joints) -> int:
        """Return the axes that joints (deg) are beyond the range of, as bits; J1 is bit 0."""
        return self.kinematics.limits_exceeded(joints)

    def place(self, joints: Joints) -> None:
        """Put it somewhere without moving, before anything runs."""
        self.queue.place(joints)
        self.servo.place(joints)

    def angles(self) -> Variant:
        """Return where the encoders are: VT_R4 array of eight, deg; the last one is 0."""
        return Variant(_R4_ARRAY, list(_R4.unpack(_R4.pack(*self.servo.encoder, 0.0))))

    # --- what clients do ----------------------------------------------------------------------------------------

    def switch_motor(self, operator: Operator, on: bool) -> Deferred[None] | None:
        """Begin to switch the motor, kept when that is done; ``None`` where it is so already. A moving arm brakes first.

        Whoever switches it off ends slave mode, of another client too.

        Raises:
            CallError: E_ACCESSDENIED, E_ROBOTISBUSY; the error that it is in, when it is to go on.
        """
        self._require(operator, no_error=on, stops=not on)
        if not on:
            self._overrule(operator)
        if self._change is not None:
            raise _busy()
        if on == self.motor_on:
            return None
        if not on:
            self.stop(hresult.E_ABORT)
        return self._begin(OperationKind.MOTOR_ON if on else OperationKind.MOTOR_OFF)

    def clear_error(self, operator: Operator) -> Deferred[None]:
        """Begin to clear the error, kept when it is gone; broken with it where its cause is still there.

        Raises:
            CallError: E_ACCESSDENIED, E_ROBOTISBUSY; that, too, while slave mode is on.
        """
        self._require(operator)
        if self.slave.on or self._change is not None:
            raise _busy(tr("slave mode is on"))
        return self._begin(OperationKind.CLEAR_ERROR)

    def change_mode(self, operator: Operator, mode: int) -> Deferred[None] | None:
        """Enter slave mode, or leave it; ``None`` where that is done at once, else kept when it is.

        Where it is on, it is left after its last set-point; an arm that moves then brakes. Where another client is in it,
        leaving it ends that at once: a client that has died on a serial line does not keep the arm.

        Raises:
            CallError: E_ACCESSDENIED, E_ROBOTISBUSY; to enter it, the error that it is in, E_FAIL without motor.
                The promise is broken with ROBOT_RUNNING when the arm does not stand after :data:`LONGEST_WAIT`.
        """
        self._require(operator, no_error=mode != OFF, stops=mode == OFF)
        if mode == OFF:
            self._overrule(operator)
        if self._change is not None:
            raise _busy()
        if mode != OFF and not self.motor_on:
            raise error_for(hresult.E_FAIL, tr("the motor is off (Motor 1)"))
        self._leave()
        change = _Change(operator, mode)
        if self.standing and not self.slave.on:
            self._finish(change)
            return None
        self._change = change
        self._cycles.wake()
        return change.done

    def move(self, operator: Operator, read: Callable[[], Joints]) -> Value | Deferred[Value]:
        """Take a set-point of slave mode; the answer is :meth:`angles`.

        Args:
            operator: whose.
            read: gives it, deg; what it raises is the answer.

        Raises:
            CallError: E_ACCESSDENIED, E_ROBOTISBUSY; the error that it is in; E_FAIL, slave mode is off. OUT_OF_RANGE_AXISn
                is the error from then on.
        """
        self._require(operator, no_error=True)
        if self._change is not None:
            raise _busy()
        if not self.slave.on:
            raise error_for(
                hresult.E_FAIL,
                tr("slave mode is off (slvChangeMode)"),
            )
        joints = read()
        index = self._beyond(joints)
        if index is not None:
            axis = self.model.axes[index]
            given, lower, upper = f"{joints[index]:.6g}", f"{axis.lower:g}", f"{axis.upper:g}"
            detail = tr("{given} deg; {lower} to {upper}", given=given, lower=lower, upper=upper)
            self.fail(OUT_OF_RANGE_AXIS1 + index, detail)
            raise refusal(OUT_OF_RANGE_AXIS1 + index, detail)
        return self.slave.put(joints)

    def forget(self, operator: Operator) -> None:
        """A client has gone: what it moves is brought to rest."""
        if self._change is not None and self._change.operator is operator:
            self._break_change(hresult.E_ABORT)
        if self.slave.owner is operator:
            self.stop(hresult.E_ABORT)

    # --- what stops it ------------------------------------------------------------------------------------------

    def stop(self, code: int) -> None:
        """Leave slave mode and brake; a slvMove that waits is answered with a code."""
        if self.slave.on:
            self.slave.end(code)
        if self.queue.moving:
            self.queue.halt()
            self._cycles.wake()

    def fail(self, code: int, detail: str = "") -> None:
        """Be in an error from now on; the arm brakes, slave mode is off."""
        if self.error == hresult.S_OK:
            self.error = code
            logger.warning("%s", refusal(code, detail))
        self._break_change(code)
        self.stop(code)

    def press_emergency(self) -> None:
        """Press the emergency stop: the arm brakes, then the motor goes off at once."""
        self.emergency = True
        self.fail(EMERGENCY_STOP)
        if self._job is not None and self._job.work is OperationKind.MOTOR_ON:
            job, self._job = self._job, None
            job.done.set_exception(refusal(EMERGENCY_STOP))
        self._cut = True
        if self.standing:
            self._cut_off()
        self._cycles.wake()

    def close(self) -> None:
        """The controller is switched off: whoever waits for anything is told that it will not come."""
        self.slave.end(hresult.E_ABORT)
        self._break_change(hresult.E_ABORT)
        if self._job is not None:
            job, self._job = self._job, None
            job.done.set_exception(error_for(hresult.E_ABORT))
        self.motor_on = False
        self.queue = MotionQueue(self.model, self.queue.joints)  # the brakes hold it where it is

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Do one cycle; returns whether there is more to do."""
        if self.slave.on:
            self.slave.step()
        self.queue.step()
        self._following = self.servo.step(self.queue.joints)
        if self.slave.on:
            self.slave.settle()
        if self.standing:
            self._cut_off()
            self._work()
        if self._change is not None:
            self._leave()
            self._wait(self._change)
        return not self.standing or self._job is not None or self._change is not None or self.slave.pending

    def _cut_off(self) -> None:
        if self._cut:
            self._cut = self.motor_on = False

    def _work(self) -> None:
        job = self._job
        if job is None:
            return
        if job.work is OperationKind.MOTOR_OFF:
            self.motor_on = False
        job.cycles -= 1
        if job.cycles > 0:
            return
        self._job = None
        if job.work is OperationKind.CLEAR_ERROR and self.emergency:
            self.error = EMERGENCY_STOP
            job.done.set_exception(refusal(EMERGENCY_STOP, tr("release it first")))
            return
        if job.work is OperationKind.CLEAR_ERROR:
            self.error = hresult.S_OK
        elif job.work is OperationKind.MOTOR_ON:
            self.motor_on = True
        job.done.set_result()

    def _leave(self) -> None:
        if self.slave.on and self.slave.empty:
            self.stop(hresult.E_ABORT)

    def _wait(self, change: _Change) -> None:
        change.cycles += 1
        if self.standing and not self.slave.on:
            self._change = None
            self._finish(change)
            change.done.set_result()
        elif change.cycles * PERIOD > LONGEST_WAIT:
            self._break_change(ROBOT_RUNNING)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _beyond(self, joints: Joints) -> int | None:
        """Return the first axis that a set-point has out of range, counted from 0; ``None`` for none.

        One that is out there already, because the arm braked, may be led back and held where it is.
        """
        exceeded = self.exceeded(joints)
        for index, (wanted, command, axis) in enumerate(zip(joints, self.queue.joints, self.model.axes, strict=True)):
            there = (command, *_SINGLE.unpack(_SINGLE.pack(command)))  # what a client is told is an R4 number
            if (
                exceeded >> index & 1
                and not axis.upper < wanted <= max(there)
                and not axis.lower > wanted >= min(there)
            ):
                return index
        return None

    def _require(self, operator: Operator, *, no_error: bool = False, stops: bool = False) -> None:
        """Check what every command needs: that nobody else moves the arm, but to stop it; that nothing else is being done."""
        self._cycles.require_open()
        if not stops and self._owner not in (None, operator):
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr("another client is in slave mode"),
            )
        if self._job is not None:
            raise _busy(tr("Motor or ClearError is at work"))
        if no_error and self.error != hresult.S_OK:
            raise refusal(self.error, tr("clear it first (ClearError)"))

    @property
    def _owner(self) -> Operator | None:
        return self._change.operator if self._change is not None else self.slave.owner

    def _overrule(self, operator: Operator) -> None:
        """Stop what another client does, if it is not being stopped already."""
        if self._owner not in (None, operator) and (self._change is None or self._change.mode != OFF):
            self._break_change(hresult.E_ABORT)
            self.stop(hresult.E_ABORT)

    def _begin(self, work: OperationKind) -> Deferred[None]:
        self._job = job = _Operation(work, math.ceil(self._seconds[work] / PERIOD - 1e-9))
        self._cycles.wake()
        return job.done

    def _finish(self, change: _Change) -> None:
        if change.mode != OFF:
            self.slave.begin(change.operator, change.mode, change.operator.drain_input)

    def _break_change(self, code: int) -> None:
        change, self._change = self._change, None
        if change is not None:
            change.done.set_exception(refusal(code))


def _busy(detail: str = "") -> CallError:
    return error_for(hresult.E_ROBOTISBUSY, detail)
