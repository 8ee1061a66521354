"""The buttons of the controller: what a person presses, for tests and for people without a cabinet in front of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import AT_COMMAND
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.engine.motion.planner import Rates
from orinkit.virtual.engine.motion.queue import Ticket
from orinkit.virtual.rc8.state import RC8State
from orinkit.virtual.rc8.switches import ModeSwitch, SlaveLimit, Token
from orinkit.virtual.rc8.variables.types import CLASSES

_JOG_RATES: Final = Rates(0.1, 0.1, 0.1, None)
"""A tenth of the largest speed: what hand operation has at most."""


class Pendant:
    """The teach pendant and the operator's panel. Every method may be called from any thread.

    A press that the state of the controller does not allow raises :class:`orinkit.CallError` with the controller's
    code; an argument that cannot be is a :class:`ValueError`.
    """

    def __init__(self, state: RC8State) -> None:
        self._state = state

    def mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic. What moves is stopped, the motor goes off."""
        self._state.set_mode(mode)

    def token(self, token: Token | str) -> None:
        """Give the executable token (RC8 2.1): ``any``, ``tp``, ``io``, ``ethernet``, ``ethernet:192.168.0.7``."""
        self._state.set_token(token if isinstance(token, Token) else Token.parse(token))

    def emergency_stop(self, on: bool = True) -> None:
        """Press the emergency stop, or with ``False`` release it."""
        self._state.emergency_stop(on)

    def protective_stop(self, on: bool = True) -> None:
        """Set the protective stop, or take it away."""
        self._state.protective_stop(on)

    def auto_enable(self, on: bool = True) -> None:
        """Set the auto-enable input."""
        self._state.auto_enable(on)

    def deadman(self, on: bool = True) -> None:
        """Hold the enable switch, or let it go: outside automatic mode what moves stops, and the motor goes off."""
        with self._state.cycles:
            self._state.switches.deadman = bool(on)
            if not on and self._state.switches.mode is not ModeSwitch.AUTOMATIC:
                self._state.arm.cut(hresult.STOPPED_DURING_PC_MOTION)

    def motor(self, on: bool = True) -> None:
        """Switch the motor; it takes about a second.

        Raises:
            CallError: EMERGENCY_STOP_ON, PROTECTIVE_STOP_ON, ERROR_PRESENT, MOTOR_SWITCHING_OFF; E_ACCESSDENIED,
                the enable switch is not held outside automatic mode; MOTOR_OFF_WHILE_MOVING.
        """
        with self._state.cycles:
            if on:
                self._require_safe()
                self._require_enabled()
            elif self._state.arm.busy:
                raise error_for(hresult.MOTOR_OFF_WHILE_MOVING)
            self._state.arm.switch_motor(on)

    def jog(self, axis: int, distance: float) -> Ticket:
        """Move one axis by degrees (mm) at a tenth of its speed, in manual mode with the enable switch held.

        Args:
            axis: number from 1.
            distance: degrees, or mm of a linear axis.

        Returns:
            the motion's ticket; ``ticket.state`` tells how far it is.

        Raises:
            CallError: REFUSED_IN_AUTO_MODE; E_ACCESSDENIED, the enable switch is not held; MOTOR_NOT_ON; ROBOT_MOVING; a limit of the axis.
            ValueError: no such axis.
        """
        with self._state.cycles:
            arm = self._state.arm
            if not 1 <= axis <= len(arm.model.axes):
                count = len(arm.model.axes)
                raise ValueError(tr("no axis {axis}; 1 to {count}", axis=axis, count=count))
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
            return arm.begin(planner.plan_ptp(arm.space.kinematics, start, end, _JOG_RATES, AT_COMMAND))

    def teach(self, kind: str, index: int, values: Sequence[float]) -> None:
        """Write a pose into a global variable: P (7 numbers), J (8), T (10) or V (3).

        Raises:
            CallError: VARIABLE_INDEX_INVALID; E_INVALIDARG, another number of values.
            ValueError: another kind.
        """
        if kind not in ("P", "J", "T", "V"):
            raise ValueError(tr("{kind!r} is none of P, J, T, V", kind=kind))
        with self._state.cycles:
            self._state.variables.write(CLASSES[kind], index, Variant(int(VarType.R8) | ARRAY, list(values)))

    def speed(self, percent: float) -> None:
        """Set the external speed, and accelerations as it has them by default (speed squared / 100).

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        with self._state.cycles:
            self._state.arm.speeds.set_external(percent)

    def slave_limit(self, number: int) -> None:
        """Set "153: b-CAP Slave speed setting" (RC8 4.8): what commands in slave mode are limited to.

        Args:
            number: 0 servo limit, 1 servo limit x external speed, 2 command limit, 3 command limit x external speed.

        Raises:
            ValueError: another number.
        """
        wanted = SlaveLimit.read(number)
        with self._state.cycles:
            self._state.switches.slave_limit = wanted

    def machine_lock(self, on: bool = True) -> None:
        """Set the machine lock: motions run, the arm stays.

        Raises:
            CallError: MOTOR_IS_ON.
        """
        self._state.machine_lock(on)

    def raise_error(self, code: int | str, message: str | None = None) -> None:
        """Raise an error: a code, or the name of one (:mod:`orinkit.core.hresult`).

        Raises:
            ValueError: no such name.
        """
        self._state.raise_error(hresult.by_name(code).value if isinstance(code, str) else code, message)

    def clear_errors(self) -> None:
        """Clear the errors.

        Raises:
            CallError: FATAL_ERROR_BEFORE, one needs a restart.
        """
        self._state.clear_errors()

    def restart(self) -> None:
        """Switch the controller off and on, as far as errors, motor, motions and programs go."""
        self._state.restart()

    def status(self) -> Mapping[str, object]:
        """Return how everything stands: plain values by name."""
        with self._state.cycles:
            switches, arm = self._state.switches, self._state.arm
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
                "slave_mode": arm.slave.mode.number if arm.slave.mode else 0,
                "slave_limit": int(switches.slave_limit),
            }

    def _require_enabled(self) -> None:
        """Outside automatic mode the enable switch has to be held."""
        switches = self._state.switches
        if switches.mode is not ModeSwitch.AUTOMATIC and not switches.deadman:
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr("hold the enable switch first (deadman on)"),
            )

    def _require_safe(self) -> None:
        switches = self._state.switches
        for wrong, code in (
            (switches.emergency_stop, hresult.EMERGENCY_STOP_ON),
            (switches.protective_stop, hresult.PROTECTIVE_STOP_ON),
            (self._state.faults.code, hresult.ERROR_PRESENT),
        ):
            if wrong:
                raise error_for(code)
