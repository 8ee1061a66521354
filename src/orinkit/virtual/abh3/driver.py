"""Model of the driver without frames: it computes the motion of the motors and the flags from commands and terminals.

Times are in cycles of 1 ms.
"""

from __future__ import annotations

from typing import Final

from orinkit.abh3.table.records import DP0S, Flags
from orinkit.abh3.table.signals import VELOCITY, dialect_of
from orinkit.virtual.abh3.axis import FINE, AxisMode, MotorAxis
from orinkit.virtual.abh3.drive import AXES, MOTORS, Drive
from orinkit.virtual.abh3.fault_monitor import FaultMonitor
from orinkit.virtual.abh3.flags import Inputs, bits_of, code_of, of_states, with_code
from orinkit.virtual.abh3.parameters import Parameters
from orinkit.virtual.abh3.state import DriverState

CYCLES: Final = 1000
"""Cycles per second."""
CURRENT_CODES: Final = 100
"""Number of codes of a current per 1 %; the code is the whole number that a frame contains."""
OUTPUTS: Final = 8
"""Number of digital outputs."""

_STEP: Final = FINE // VELOCITY.steps


class DriverModel:
    """A driver and its two axes.

    Args:
        parameters: Parameters of the driver.

    Attributes:
        parameters: The present parameters.
        inputs: Inputs from host and terminals.
        drive: The axes and motors.
        watch: Errors and warnings.
        analog: The analog inputs, V.
        monitors: For each monitor the name of a quantity of :class:`DriverState`, or a number.
        outputs: The digital outputs as bits; bit 0 is output 0.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.dialect = dialect_of(parameters.dialect)
        self.inputs = Inputs(self.dialect)
        self.drive = Drive(parameters)
        self.watch = FaultMonitor(parameters)
        self.analog = [0.0, 0.0]
        self.monitors: list[str | float] = ["ay_velocity", "bx_velocity"]
        self.outputs = 0
        self._commands = dict.fromkeys(AXES, 0)
        self._cycle = 0

    def set(self, parameters: Parameters) -> None:
        """Replace the parameters; only those of the communication and the data sets may have changed."""
        self.parameters = parameters
        self.watch.set(parameters)
        self._apply()

    def run(self, cycle: int) -> None:
        """Run until the end of cycle number ``cycle``; process the time-outs and resets that are due by then."""
        event = self.watch.next()
        while event is not None and event <= cycle:
            self._run(event)
            self.watch.advance(max(event, self._cycle))
            self._apply()
            event = self.watch.next()
        self._run(cycle)

    def command(self, given: DP0S, cycle: int) -> None:
        """Accept a command of the host.

        Args:
            given: The decoded command.
            cycle: Number of the next cycle, from which the time-outs are counted.
        """
        self.watch.feed(cycle)
        for name, code in zip(AXES, given.codes, strict=False):  # the first codes are those of the commands
            self._commands[name] = int(code)
        before = self.inputs.control
        self.inputs.can = given.inputs.value
        self._process_edges(before, cycle)

    def set_terminal(self, name: str, on: bool, cycle: int) -> None:
        """Switch a terminal on or off; ``cycle`` is the number of the next cycle.

        Raises:
            InvalidValue: If there is no such terminal.
        """
        before = self.inputs.control
        self.inputs.set_terminal(name, on)
        self._process_edges(before, cycle)

    def fail(self, faults: int, *, stays: bool) -> None:
        """Raise the errors whose bits ``faults`` contains; ``stays`` is True if their cause remains."""
        self.watch.errors |= faults
        self.watch.causes |= faults if stays else 0
        self._apply()

    def _process_edges(self, before: int, cycle: int) -> None:
        """Process rising edges of the control flags, then apply the flags.

        ``before`` contains the control flags before the change; ``cycle`` is the number of the next cycle.
        """
        rising = self.inputs.control & ~before
        masks = self.dialect.inputs.masks
        for motor in MOTORS:
            if rising & masks[f"{motor}_pulse_clear"]:
                self.drive.clear(motor)
        if rising & masks["error_reset"]:
            self.watch.reset(cycle)
        self._apply()

    def _run(self, cycle: int) -> None:
        self.drive.run(cycle - self._cycle)
        self._cycle = max(cycle, self._cycle)
        if self.watch.errors:  # switch off the servo of an axis that has come to rest
            self._apply()

    def _apply(self) -> None:
        """Apply flags, errors and warnings to the axes."""
        held_off = self.inputs.has("error_reset")
        for name, axis in self.drive.axes.items():
            enabled = self.inputs.has(f"{name}_servo_on") and not held_off
            stopping = axis.servo and axis.velocity != 0
            axis.servo = enabled and (stopping or not self.watch.errors)
            axis.order(*self._order(name, axis))

    def _order(self, name: str, axis: MotorAxis) -> tuple[AxisMode, int]:
        if not axis.servo:
            return AxisMode.OFF, 0
        if self.watch.errors or self.watch.late or not self.inputs.has(f"{name}_start"):
            return AxisMode.STOP, 0
        chosen = getattr(self.parameters, f"{name}_sets")[self.inputs.data_set(name)]
        sign = -1 if self.inputs.has(f"{name}_polarity") else 1
        code = self._commands[name]
        if self.inputs.has(f"{name}_torque"):
            return AxisMode.TORQUE, sign * (code if chosen.source == "can" else round(chosen.current * CURRENT_CODES))
        return AxisMode.SPEED, sign * (code * _STEP if chosen.source == "can" else round(chosen.velocity * FINE))

    # --- state --------------------------------------------------------------------------------------------------

    def state(self) -> DriverState:
        """Return the present state."""
        dialect, parameters = self.dialect, self.parameters
        ay, bx = self.drive.axes["ay"], self.drive.axes["bx"]
        a, b = self.drive.velocities()
        a_pulses, b_pulses = self.drive.pulses()
        a_load, b_load = self.drive.loads()
        values = {
            "ay_velocity_command": ay.velocity_command / FINE,
            "bx_velocity_command": bx.velocity_command / FINE,
            "ay_velocity": ay.velocity / FINE,
            "bx_velocity": bx.velocity / FINE,
            "a_velocity": a / FINE,
            "b_velocity": b / FINE,
            "y_velocity": (a + b) / (2 * FINE),
            "x_velocity": (a - b) / (2 * FINE),
            "ay_current_command": ay.current / CURRENT_CODES,
            "bx_current_command": bx.current / CURRENT_CODES,
            "a_load": a_load,
            "b_load": b_load,
            "analog_0": self.analog[0],
            "analog_1": self.analog[1],
            "main_voltage": parameters.main_voltage,
            "control_voltage": parameters.control_voltage,
        }
        pulses = {"a_pulses": a_pulses, "b_pulses": b_pulses}
        known: dict[str, float] = {**values, **pulses}
        monitors = [known[source] if isinstance(source, str) else source for source in self.monitors]
        states = self._states()
        errors, warnings = self.watch.errors, self.watch.warnings
        return DriverState(
            time=self._cycle / CYCLES,
            **values,
            a_pulses=a_pulses,
            b_pulses=b_pulses,
            monitor_0=monitors[0],
            monitor_1=monitors[1],
            inputs=Flags(self.inputs.can, dialect.inputs),
            external=Flags(self.inputs.external, dialect.inputs),
            control=Flags(self.inputs.control | of_states(dialect.control, states), dialect.control),
            io=Flags(self._io(states), dialect.io),
            errors=Flags(with_code(dialect.errors, "error_code", errors), dialect.errors),
            warnings=Flags(with_code(dialect.warnings, "alarm_code", warnings), dialect.warnings),
            ay_servo=ay.servo,
            bx_servo=bx.servo,
            ay_set=self.inputs.data_set("ay"),
            bx_set=self.inputs.data_set("bx"),
        )

    def _states(self) -> dict[str, bool]:
        """Return the states contained in flag words, by the names of their bits."""
        axes = self.drive.axes
        return {
            **{f"{name}_ready": axis.servo for name, axis in axes.items()},
            **{f"{name}_busy": axis.servo and axis.command != 0 for name, axis in axes.items()},
            **{f"do_{n}": bool(self.outputs >> n & 1) for n in range(OUTPUTS)},
            "error": self.watch.errors != 0,
            "alarm": self.watch.warnings != 0,
            "brake_released": self.inputs.has("brake_release") or any(axis.servo for axis in axes.values()),
            "travel_model": self.parameters.model == "travel",
            "error_reset_input": self.inputs.external & self.dialect.inputs.masks["error_reset"] != 0,
        }

    def _io(self, states: dict[str, bool]) -> int:
        word = self.dialect.io
        return of_states(word, states) | bits_of(word, "error_code", code_of(self.watch.errors)) | self.inputs.terminals
