"""The teach pendant and the operator's panel of the virtual controller, operated by tests and by users."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import AT_COMMAND
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.engine.motion.planner import Rates
from orinkit.virtual.engine.motion.queue import Ticket, TicketState
from orinkit.virtual.rc8.robot.unit import RobotUnit
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.switches import ModeSwitch, SlaveLimit, Token
from orinkit.virtual.rc8.variables.types import CLASSES

_JOG_RATES: Final = Rates(0.1, 0.1, 0.1, None)
"""A tenth of the largest velocity, acceleration and deceleration: the limits of manual operation."""
_ENDED: Final = (TicketState.DONE, TicketState.STOPPED)


class Pendant:
    """The teach pendant and the operator's panel. Every method is thread-safe.

    If the state of the controller does not allow an operation, the method raises :class:`orinkit.CallError` with the
    code of the controller. If an argument is invalid, the method raises :class:`ValueError`.
    """

    def __init__(self, state: RC8State) -> None:
        self._state = state
        self._holder: object = None  # operator that has pressed the enable switch
        self._jog: tuple[object, Ticket] | None = None  # operator of the last jog, and its motion

    def mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        A change of the mode stops the arm and then switches the motor off.
        """
        self._state.set_mode(mode)

    def token(self, token: Token | str) -> None:
        """Assign the executable token (RC8 2.1): ``any``, ``tp``, ``io``, ``ethernet``, ``ethernet:192.168.0.7``."""
        self._state.set_token(token if isinstance(token, Token) else Token.parse(token))

    def emergency_stop(self, on: bool = True) -> None:
        """Press the emergency stop, or release it (``False``)."""
        self._state.emergency_stop(on)

    def protective_stop(self, on: bool = True) -> None:
        """Set the protective stop, or clear it (``False``)."""
        self._state.protective_stop(on)

    def auto_enable(self, on: bool = True) -> None:
        """Set the auto-enable input, or clear it (``False``)."""
        self._state.auto_enable(on)

    def deadman(self, on: bool = True, *, operator: object = None) -> None:
        """Hold or release the enable switch.

        Outside automatic mode, releasing it stops the arm and then switches the motor off.

        Args:
            on: True to hold the switch, False to release it.
            operator: Object that identifies the operator for :meth:`lose_operator`.
        """
        with self._state.cycles:
            self._state.switches.deadman = bool(on)
            self._holder = operator if on else None
            if not on and self._state.switches.mode is not ModeSwitch.AUTOMATIC:
                self._state.robots.stop_and_power_off(hresult.STOPPED_DURING_PC_MOTION)

    def motor(self, on: bool = True, *, robot: int | None = None) -> None:
        """Begin to switch the motor on, which takes about 1 s, or off, which takes about 0.3 s.

        Args:
            on: True to switch it on, False to switch it off.
            robot: Number of a robot; ``None`` for all robots.

        Raises:
            CallError: EMERGENCY_STOP_ON, PROTECTIVE_STOP_ON, ERROR_PRESENT, MOTOR_SWITCHING_OFF,
                MOTOR_OFF_WHILE_MOVING; outside automatic mode, E_ACCESSDENIED if the enable switch is not held.
            ValueError: If the robot does not exist.
        """
        arms = [each.arm for each in self._state.robots] if robot is None else [self._robot(robot).arm]
        with self._state.cycles:
            if on:
                self._require_safe()
                self._require_enabled()
            elif any(arm.busy for arm in arms):
                raise error_for(hresult.MOTOR_OFF_WHILE_MOVING)
            for arm in arms:
                arm.switch_motor(on)

    def jog(self, axis: int, distance: float, *, operator: object = None, robot: int = 0) -> Ticket:
        """Move one axis at a tenth of its largest velocity, in manual or teach-check mode with the enable switch held.

        Args:
            axis: Number of the axis, from 1.
            distance: Distance, deg; mm for a linear axis.
            operator: Object that identifies the operator for :meth:`lose_operator`.
            robot: Number of the robot.

        Returns:
            The ticket of the motion; ``ticket.state`` is the progress of the motion.

        Raises:
            CallError: REFUSED_IN_AUTO_MODE; EMERGENCY_STOP_ON, PROTECTIVE_STOP_ON, ERROR_PRESENT; E_ACCESSDENIED if the
                enable switch is not held; MOTOR_NOT_ON; ROBOT_PAUSED; ROBOT_MOVING; MANUAL_SOFT_LIMIT_AXISn if the
                target is outside the soft limits of axis n.
            ValueError: If the axis or the robot does not exist.
        """
        arm = self._robot(robot).arm
        with self._state.cycles:
            if not 1 <= axis <= len(arm.model.axes):
                count = len(arm.model.axes)
                raise ValueError(tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=axis, count=count))
            if self._state.switches.mode is ModeSwitch.AUTOMATIC:
                raise error_for(hresult.REFUSED_IN_AUTO_MODE)
            self._require_safe()
            self._require_enabled()
            if not arm.motor.on:
                raise error_for(hresult.MOTOR_NOT_ON)
            if arm.held:
                raise error_for(hresult.ROBOT_PAUSED)
            if arm.busy:
                raise error_for(hresult.ROBOT_MOVING)
            start = arm.queue.end_joints
            end = tuple(joint + distance * (number == axis) for number, joint in enumerate(start, 1))
            limits = arm.model.axes[axis - 1]
            if not limits.lower <= end[axis - 1] <= limits.upper:
                raise error_for(hresult.MANUAL_SOFT_LIMIT_AXIS1 + axis - 1)
            ticket = arm.enqueue(planner.plan_ptp(arm.space.kinematics, start, end, _JOG_RATES, AT_COMMAND))
            self._jog = operator, ticket
            return ticket

    def is_jogging(self, operator: object) -> bool:
        """Return True if a jog of an operator is in progress."""
        with self._state.cycles:
            return self._jog is not None and self._jog[0] is operator and self._jog[1].state not in _ENDED

    def lose_operator(self, operator: object) -> None:
        """Release the enable switch if a lost operator holds it or jogs; a jog stops, and the motor is switched off."""
        with self._state.cycles:
            if self._holder is operator or self.is_jogging(operator):
                self.deadman(False)

    def teach(self, kind: str, index: int, values: Sequence[float]) -> None:
        """Write a pose or a vector to a global variable: P (7 numbers), J (8), T (10) or V (3).

        Raises:
            CallError: VARIABLE_INDEX_INVALID; E_INVALIDARG if the number of values does not match the pose type.
            ValueError: If the pose type is not P, J, T or V.
        """
        if kind not in ("P", "J", "T", "V"):
            raise ValueError(tr("{kind!r} is not P, J, T or V", kind=kind))
        with self._state.cycles:
            self._state.variables.write(CLASSES[kind], index, Variant(int(VarType.R8) | ARRAY, list(values)))

    def speed(self, percent: float, *, robot: int = 0) -> None:
        """Set the external speed in %, and external acceleration and deceleration to the default (speed squared / 100).

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
            ValueError: If the robot does not exist.
        """
        arm = self._robot(robot).arm
        with self._state.cycles:
            arm.speeds.set_external(percent)

    def slave_limit(self, number: int) -> None:
        """Set the parameter "153: b-CAP Slave speed setting" (RC8 4.8): the limit of commands in slave mode.

        The command limit is the limit of the arm model. The servo limit is
        :data:`~orinkit.virtual.engine.set_point_buffer.SERVO_LIMIT` times as large.

        Args:
            number: 0 servo limit, 1 servo limit x external speed, 2 command limit, 3 command limit x external speed.

        Raises:
            ValueError: If the number is not 0 to 3.
        """
        limit = SlaveLimit.read(number)
        with self._state.cycles:
            self._state.switches.slave_limit = limit

    def set_time(self, moment: datetime) -> None:
        """Set the local date and time of the controller, years 1980 to 2099.

        Raises:
            CallError: E_INVALIDARG if the controller cannot represent the time.
        """
        self._state.set_time(moment)

    def machine_lock(self, on: bool = True) -> None:
        """Set or clear the machine lock: while it is set, motions are executed, but the arm does not move.

        Raises:
            CallError: MOTOR_IS_ON.
        """
        self._state.machine_lock(on)

    def raise_error(self, code: int | str, message: str | None = None) -> None:
        """Raise an error in the controller, given by its code or its name (:mod:`orinkit.core.hresult`).

        Raises:
            ValueError: If the name does not exist, or if the code has more than 32 bits.
        """
        self._state.raise_error(hresult.by_name(code).value if isinstance(code, str) else code, message)

    def clear_errors(self) -> None:
        """Clear the errors.

        Raises:
            CallError: FATAL_ERROR_BEFORE if an error requires a restart.
        """
        self._state.clear_errors()

    def restart(self) -> None:
        """Reset errors, motor, motions and programs, as if the controller were switched off and on.

        The connections of all clients are closed.
        """
        self._state.restart()

    def status(self, *, robot: int = 0) -> Mapping[str, object]:
        """Return the state of switches, arm and programs as a mapping that can be converted to JSON.

        Args:
            robot: Number of the robot to which the items of the arm belong.

        Raises:
            ValueError: If the robot does not exist.
        """
        arm = self._robot(robot).arm
        with self._state.cycles:
            switches = self._state.switches
            return {
                "mode": switches.mode.name.lower(),
                "token": str(switches.token),
                "emergency_stop": switches.emergency_stop,
                "protective_stop": switches.protective_stop,
                "auto_enable": switches.auto_enable,
                "deadman": switches.deadman,
                "machine_lock": switches.machine_lock,
                "motor": arm.motor.state.value,
                "moving": arm.busy,
                "held": arm.held,
                "arm_holder": "" if arm.holder is None else str(arm.holder),
                "error": f"{self._state.faults.code:08X}" if self._state.faults.code else "",
                "joints": [round(joint, 6) for joint in arm.servo.encoder],
                "programs": self._state.tasks.running,
                "supervisory": self._state.tasks.supervisors_running,
                "slave_mode": arm.slave.mode.number if arm.slave.mode else 0,
                "slave_limit": int(switches.slave_limit),
            }

    def _robot(self, number: int) -> RobotUnit:
        count = len(self._state.robots)
        if not 0 <= number < count:
            raise ValueError(tr("robot {number} does not exist; robots: 0 to {last}", number=number, last=count - 1))
        return self._state.robots[number]

    def _require_enabled(self) -> None:
        """Raise E_ACCESSDENIED if the mode is not automatic and the enable switch is not held."""
        switches = self._state.switches
        if switches.mode is not ModeSwitch.AUTOMATIC and not switches.deadman:
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr("the enable switch is not held. Try: deadman on"),
            )

    def _require_safe(self) -> None:
        switches = self._state.switches
        for active, code in (
            (switches.emergency_stop, hresult.EMERGENCY_STOP_ON),
            (switches.protective_stop, hresult.PROTECTIVE_STOP_ON),
            (self._state.faults.code, hresult.ERROR_PRESENT),
        ):
            if active:
                raise error_for(code)
