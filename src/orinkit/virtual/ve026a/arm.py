"""The arm of a virtual VE026A: motor, error state, operations that take time, and the client that moves it."""

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
from orinkit.core.validation import rounded_to_single
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.queue import MotionQueue
from orinkit.virtual.engine.servo import Servo
from orinkit.virtual.ve026a.arm_owner import Operator
from orinkit.virtual.ve026a.codes import EMERGENCY_STOP, OUT_OF_RANGE_AXIS1, ROBOT_RUNNING, device_error
from orinkit.virtual.ve026a.parameters import OFF, VALUES
from orinkit.virtual.ve026a.slave import VE026ASlaveMode

logger = logging.getLogger("orinkit.ve026a")

LONGEST_WAIT: Final = 0.5
"""Longest time that slvChangeMode waits for standstill, s (VE026A 2.2.1)."""

_R4_ARRAY: Final = int(VarType.R4) | ARRAY
_R4: Final = struct.Struct(f"<{VALUES}f")


class TimedOperation(Enum):
    """Operations of the controller that take time."""

    MOTOR_ON = "motor on"
    MOTOR_OFF = "motor off"
    CLEAR_ERROR = "clear error"


@dataclass(slots=True)
class _Operation:
    """An operation in progress: its kind, the remaining cycles, the deferred result."""

    work: TimedOperation
    cycles: int
    done: Deferred[None] = field(default_factory=Deferred)


@dataclass(slots=True)
class _Change:
    """A slvChangeMode that waits for standstill."""

    operator: Operator
    mode: int
    cycles: int = 0
    done: Deferred[None] = field(default_factory=Deferred)


class VE026AArm:
    """The arm with its motor, error state and slave mode.

    Args:
        model: The arm model.
        cycles: The control loop of the controller.
        joints: The initial joints, one for each axis, deg.
        motor_seconds: Duration of the command Motor, s.
        clear_seconds: Duration of the command ClearError, s.
        strict_time: True to report a late set-point as an error immediately, False to wait for it.

    Attributes:
        error: Code of the present error, 0 for none. It is the first error since the last ClearError.
        motor_on: True if the motor is on.
        emergency: True if the emergency stop is pressed.
        queue: The motion queue, which generates the command position.
        servo: The servo, with the encoders.
        slave: Slave mode.
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
            TimedOperation.MOTOR_ON: motor_seconds,
            TimedOperation.MOTOR_OFF: motor_seconds,
            TimedOperation.CLEAR_ERROR: clear_seconds,
        }
        self._operation: _Operation | None = None
        self._change: _Change | None = None
        self._motor_off_pending = False  # the motor is switched off at standstill
        self._following = False  # the encoders have not reached the command yet

    @property
    def standing(self) -> bool:
        """True if command position and encoders stand still."""
        return not self.queue.moving and self.queue.standing and not self._following

    def exceeded(self, joints: Joints) -> int:
        """Return the axes whose range is exceeded by joints (deg), as bits; J1 is bit 0."""
        return self.kinematics.limits_exceeded(joints)

    def place(self, joints: Joints) -> None:
        """Set the joints without a motion, before the controller runs."""
        self.queue.place(joints)
        self.servo.place(joints)

    def angles(self) -> Variant:
        """Return the encoder values: VT_R4 array of eight, deg; the last one is 0."""
        return Variant(_R4_ARRAY, list(_R4.unpack(_R4.pack(*self.servo.encoder, 0.0))))

    # --- commands of clients ------------------------------------------------------------------------------------

    def switch_motor(self, operator: Operator, on: bool) -> Deferred[None] | None:
        """Begin to switch the motor on or off. A moving arm brakes first; switching off ends slave mode of any client.

        Returns:
            The deferred result, or ``None`` if the motor is already in this state.

        Raises:
            CallError: E_ACCESSDENIED when switching on while another client is in slave mode; E_ROBOTISBUSY while an
                operation is in progress; the present error, when switching on.
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
        return self._begin(TimedOperation.MOTOR_ON if on else TimedOperation.MOTOR_OFF)

    def clear_error(self, operator: Operator) -> Deferred[None]:
        """Begin to clear the error.

        Returns:
            The deferred result; it fails with the code of the emergency stop if the emergency stop is still pressed.

        Raises:
            CallError: E_ACCESSDENIED if another client is in slave mode; E_ROBOTISBUSY while slave mode is on or an
                operation is in progress.
        """
        self._require(operator)
        if self.slave.on or self._change is not None:
            raise _busy(tr("slave mode is on"))
        return self._begin(TimedOperation.CLEAR_ERROR)

    def change_mode(self, operator: Operator, mode: int) -> Deferred[None] | None:
        """Enter or leave slave mode.

        If slave mode is on, it is left after the last set-point in the buffer. If the arm still moves then, it brakes.
        Mode 0 ends the slave mode of another client immediately, so that an unreachable client on a serial line does
        not block the arm.

        Returns:
            The deferred result, or ``None`` if the mode has already been changed. The result fails with ROBOT_RUNNING
            if the arm does not stand still after :data:`LONGEST_WAIT`.

        Raises:
            CallError: E_ROBOTISBUSY while an operation is in progress; when entering slave mode, also E_ACCESSDENIED if
                another client is in slave mode, the present error, or E_FAIL if the motor is off.
        """
        self._require(operator, no_error=mode != OFF, stops=mode == OFF)
        if mode == OFF:
            self._overrule(operator)
        if self._change is not None:
            raise _busy()
        if mode != OFF and not self.motor_on:
            raise error_for(hresult.E_FAIL, tr("the motor is off. Try: Motor 1"))
        self._leave_if_empty()
        change = _Change(operator, mode)
        if self.standing and not self.slave.on:
            self._finish(change)
            return None
        self._change = change
        self._cycles.wake()
        return change.done

    def put_set_point(self, operator: Operator, read: Callable[[], Joints]) -> Value | Deferred[Value]:
        """Accept a set-point of slave mode; the reply is :meth:`angles`.

        Args:
            operator: The client.
            read: Function that returns the set-point, deg; its exceptions are passed on.

        Raises:
            CallError: E_ACCESSDENIED if another client is in slave mode; E_ROBOTISBUSY while an operation is in
                progress; the present error; E_FAIL if slave mode is off; OUT_OF_RANGE_AXISn if the set-point is outside
                the range of axis n. This last error is also stored as the present error.
        """
        self._require(operator, no_error=True)
        if self._change is not None:
            raise _busy()
        if not self.slave.on:
            raise error_for(
                hresult.E_FAIL,
                tr("slave mode is off. Try: slvChangeMode"),
            )
        joints = read()
        index = self._beyond(joints)
        if index is not None:
            axis = self.model.axes[index]
            given, lower, upper = f"{joints[index]:.6g}", f"{axis.lower:g}", f"{axis.upper:g}"
            detail = tr(
                "{given} deg is outside the range of {lower} to {upper} deg", given=given, lower=lower, upper=upper
            )
            self.fail(OUT_OF_RANGE_AXIS1 + index, detail)
            raise device_error(OUT_OF_RANGE_AXIS1 + index, detail)
        return self.slave.put(joints)

    def forget(self, operator: Operator) -> None:
        """Stop the motion of a client that has disconnected."""
        if self._change is not None and self._change.operator is operator:
            self._fail_change(hresult.E_ABORT)
        if self.slave.owner is operator:
            self.stop(hresult.E_ABORT)

    # --- stops --------------------------------------------------------------------------------------------------

    def stop(self, code: int) -> None:
        """Leave slave mode and brake; a waiting slvMove fails with the code."""
        if self.slave.on:
            self.slave.end(code)
        if self.queue.moving:
            self.queue.halt()
            self._cycles.wake()

    def fail(self, code: int, detail: str = "") -> None:
        """Enter the error state, unless already in it; brake and leave slave mode."""
        if self.error == hresult.S_OK:
            self.error = code
            logger.warning("%s", device_error(code, detail))
        self._fail_change(code)
        self.stop(code)

    def press_emergency(self) -> None:
        """Press the emergency stop: the arm brakes, and the motor is switched off at standstill."""
        self.emergency = True
        self.fail(EMERGENCY_STOP)
        if self._operation is not None and self._operation.work is TimedOperation.MOTOR_ON:
            operation, self._operation = self._operation, None
            operation.done.set_exception(device_error(EMERGENCY_STOP))
        self._motor_off_pending = True
        if self.standing:
            self._apply_motor_off()
        self._cycles.wake()

    def close(self) -> None:
        """Switch the controller off; pending results fail with E_ABORT."""
        self.slave.end(hresult.E_ABORT)
        self._fail_change(hresult.E_ABORT)
        if self._operation is not None:
            operation, self._operation = self._operation, None
            operation.done.set_exception(error_for(hresult.E_ABORT))
        self.motor_on = False
        self.queue = MotionQueue(self.model, self.queue.joints)  # the brakes hold the arm

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Run one cycle; return True if the arm requires another cycle."""
        if self.slave.on:
            self.slave.step()
        self.queue.step()
        self._following = self.servo.step(self.queue.joints)
        if self.slave.on:
            self.slave.accept_waiting()
        if self.standing:
            self._apply_motor_off()
            self._step_operation()
        if self._change is not None:
            self._leave_if_empty()
            self._step_change(self._change)
        return not self.standing or self._operation is not None or self._change is not None or self.slave.has_work

    def _apply_motor_off(self) -> None:
        if self._motor_off_pending:
            self._motor_off_pending = self.motor_on = False

    def _step_operation(self) -> None:
        operation = self._operation
        if operation is None:
            return
        if operation.work is TimedOperation.MOTOR_OFF:
            self.motor_on = False
        operation.cycles -= 1
        if operation.cycles > 0:
            return
        self._operation = None
        if operation.work is TimedOperation.CLEAR_ERROR and self.emergency:
            self.error = EMERGENCY_STOP
            operation.done.set_exception(
                device_error(
                    EMERGENCY_STOP, tr("the emergency stop is still pressed. Try: release the emergency stop first")
                )
            )
            return
        if operation.work is TimedOperation.CLEAR_ERROR:
            self.error = hresult.S_OK
        elif operation.work is TimedOperation.MOTOR_ON:
            self.motor_on = True
        operation.done.set_result()

    def _leave_if_empty(self) -> None:
        if self.slave.on and self.slave.empty:
            self.stop(hresult.E_ABORT)

    def _step_change(self, change: _Change) -> None:
        change.cycles += 1
        if self.standing and not self.slave.on:
            self._change = None
            self._finish(change)
            change.done.set_result()
        elif change.cycles * PERIOD > LONGEST_WAIT:
            self._fail_change(ROBOT_RUNNING)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _beyond(self, joints: Joints) -> int | None:
        """Return the index, from 0, of the first axis that a set-point moves out of its range, or ``None``.

        An axis that is already out of range, because the arm braked, may stay where it is or move back.
        """
        exceeded = self.exceeded(joints)
        for index, (value, command, axis) in enumerate(zip(joints, self.queue.joints, self.model.axes, strict=True)):
            present = (command, rounded_to_single(command))  # clients receive joints that are rounded to R4
            if (
                exceeded >> index & 1
                and not axis.upper < value <= max(present)
                and not axis.lower > value >= min(present)
            ):
                return index
        return None

    def _require(self, operator: Operator, *, no_error: bool = False, stops: bool = False) -> None:
        """Check the preconditions of a command: no operation is in progress, and no other client is in slave mode.

        Args:
            operator: The client.
            no_error: True if there must be no present error.
            stops: True if the command stops the arm: it is accepted even if another client is in slave mode.
        """
        self._cycles.require_open()
        if not stops and self._owner not in (None, operator):
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr("another client is in slave mode"),
            )
        if self._operation is not None:
            raise _busy(tr("the command Motor or ClearError is in progress"))
        if no_error and self.error != hresult.S_OK:
            raise device_error(self.error, tr("the error has not been cleared. Try: ClearError"))

    @property
    def _owner(self) -> Operator | None:
        return self._change.operator if self._change is not None else self.slave.owner

    def _overrule(self, operator: Operator) -> None:
        """End the slave mode of another client, unless that client is already leaving it."""
        if self._owner not in (None, operator) and (self._change is None or self._change.mode != OFF):
            self._fail_change(hresult.E_ABORT)
            self.stop(hresult.E_ABORT)

    def _begin(self, work: TimedOperation) -> Deferred[None]:
        self._operation = operation = _Operation(work, math.ceil(self._seconds[work] / PERIOD - 1e-9))
        self._cycles.wake()
        return operation.done

    def _finish(self, change: _Change) -> None:
        if change.mode != OFF:
            self.slave.begin(change.operator, change.mode, change.operator.when_input_processed)

    def _fail_change(self, code: int) -> None:
        change, self._change = self._change, None
        if change is not None:
            change.done.set_exception(device_error(code))


def _busy(detail: str = "") -> CallError:
    return error_for(hresult.E_ROBOTISBUSY, detail)
