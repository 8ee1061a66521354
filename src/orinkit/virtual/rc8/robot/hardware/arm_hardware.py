"""The hardware of one arm, and its part of a control cycle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.motion.queue import MotionQueue, QueueState
from orinkit.virtual.engine.servo import ControlLog, ServoSample
from orinkit.virtual.rc8.robot.hardware.areas import Area, Areas, Fences
from orinkit.virtual.rc8.robot.hardware.contact import CompliantSurface, Surfaces
from orinkit.virtual.rc8.robot.hardware.force_control import ControlledArm, ForceControl
from orinkit.virtual.rc8.robot.hardware.force_waits import ForceWaits
from orinkit.virtual.rc8.robot.hardware.scenes import Scenes
from orinkit.virtual.rc8.robot.motor import Motor
from orinkit.virtual.rc8.robot.slave_mode.slave_mode import RC8SlaveMode
from orinkit.virtual.rc8.variables.table import VariableTable
from orinkit.virtual.rc8.variables.types import CLASSES

BUTTONS: Final = 3
"""Number of buttons on the arm of a COBOTTA."""
DEVIATION: Final = 10.0
"""Largest distance by which an axis may yield to a current limit before the servo reports an error, deg."""

_R8_ARRAY: Final = int(VarType.R8) | ARRAY


class HardwareArm(ControlledArm, Protocol):
    """The arm to which the hardware belongs."""

    @property
    def queue(self) -> MotionQueue:
        """Running and queued motions."""

    @property
    def motor(self) -> Motor:
        """Motor supply."""

    @property
    def busy(self) -> bool:
        """True while the arm moves or has motions queued."""

    @property
    def slave(self) -> RC8SlaveMode:
        """Slave mode."""

    def stop(self, code: int) -> None:
        """Stop within the limits; calls that wait fail with the code."""

    def skip(self) -> None:
        """Stop within the limits; calls that wait succeed."""


class ArmHardware:
    """Hardware around one arm: surfaces, force sensor, areas, fences, scenes, buttons.

    Args:
        arm: The arm.
        cycles: The control loop of the controller.
        variables: The variables of the controller.
        seconds: Callback that returns the time since the controller was switched on, s.
        fault: Callback that raises an error of the controller; invoked with code and detail.

    Attributes:
        active: False if :meth:`command` and :meth:`step` have nothing to do.
        force: Force sensor and force control.
        waits: Calls that wait for a force.
        areas: Areas that the controller watches.
        fences: Virtual fences.
        scenes: Sets of settings.
        buttons: Buttons on the arm that have been pressed since they were last cleared.
        servo_log: Servo log.
        calibrated: True if the reference positions of the encoders are known.
    """

    def __init__(
        self, arm: HardwareArm, cycles: ControlLoop, variables: VariableTable, seconds: Callable[[], float],
        fault: Callable[[int, str], None],
    ) -> None:  # fmt: skip
        self.active = False
        self.force = ForceControl(arm, Surfaces(), seconds)
        self.waits = ForceWaits(self._halt, lambda: not arm.busy)
        self.areas = Areas(self._set_io, self._store_position, fault)
        self.fences = Fences(fault)
        self.scenes = Scenes()
        self.buttons = [False] * BUTTONS
        self.servo_log = ControlLog()
        self.calibrated = True
        self._arm = arm
        self._cycles = cycles
        self._variables = variables
        self._seconds = seconds
        self._fault = fault
        self._reported = False

    # --- changes ------------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Run cycles because something has changed."""
        self.active = True
        self._cycles.wake()

    def place_surface(self, name: str, surface: CompliantSurface | None) -> None:
        """Place a surface, or remove it (``None``).

        Raises:
            ValueError: If there are too many surfaces, or none of this name.
        """
        if surface is None:
            self.force.surfaces.remove(name)
        else:
            self.force.surfaces.place(name, surface)
        self.wake()

    def define_area(self, number: int, area: Area) -> None:
        """Define an area.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; VARIABLE_INDEX_INVALID if the I/O point or the variable does not exist.
        """
        if area.io >= 0:
            self._variables.check(CLASSES["IO"], area.io)
        if area.variable >= 0:
            self._variables.check(CLASSES["P"], area.variable)
        self.areas.define(number, area)
        self.wake()

    def stopped(self, code: int) -> None:
        """Let calls that wait for a force fail, because the arm is being stopped."""
        if code != hresult.S_OK and len(self.waits):
            self.waits.cancel(code)

    def released(self) -> None:
        """End force control, because the arm has been released; the arm stays where the force has displaced it to."""
        self.force.switch_off(stay=True)
        self._stay()

    def close(self) -> None:
        """Let all calls that wait fail with E_ABORT."""
        self.waits.cancel(hresult.E_ABORT)
        self.force.switch_off()

    # --- a cycle ------------------------------------------------------------------------------------------------

    def command(self, joints: tuple[float, ...]) -> tuple[float, ...]:
        """Return the command position of this cycle, displaced by force control."""
        return self.force.command(joints) if self.active and self.force.displacing else joints

    def step(self) -> bool:
        """Execute one cycle after that of the servo; return True if another cycle is required."""
        if not self.active:
            return False
        self._measure()
        if self.areas.watching or len(self.fences):
            tip = self._arm.space.tcp(self._arm.servo.encoder)
            self.areas.step(tip)
            self.fences.step(tip)
        self._check_deviation()
        self._stay()
        if not self._arm.motor.on:
            self._rest()
        log = self.servo_log
        log.add(self._sample, self._cycles.number, self._arm.space.tools.current, self._arm.space.works.current)
        limiting = self._arm.servo.loads.limiting
        busy = self.force.displacing or bool(len(self.waits)) or limiting or self.areas.pending or log.running
        self.active = busy or bool(len(self.force.surfaces)) or self.areas.watching or bool(len(self.fences))
        return busy

    def _sample(self) -> ServoSample:
        return self._arm.servo.sample(self._arm.motor.on)

    def _measure(self) -> None:
        force, loads = self.force, self._arm.servo.loads
        if not (len(force.surfaces) or force.on or len(self.waits)):
            loads.contact = None
            return
        loads.contact = force.measure()
        if len(self.waits):
            now = self._seconds()
            self.waits.step(force.travel(), force.force(), now - force.started, now)

    def _check_deviation(self) -> None:
        code = self.force.violation()
        for index, gone in enumerate(self._arm.servo.loads.yielded):
            if abs(gone) > DEVIATION and not code:
                code = hresult.POSITION_DEVIATION_AXIS1 + index
        if code and not self._reported:
            self._fault(code, "")
        self._reported = bool(code)

    def _stay(self) -> None:
        """Make the displaced position the command position, as soon as no motion is in progress."""
        if self.force.staying and self._arm.queue.state is QueueState.IDLE:
            self._arm.queue.place(self._arm.servo.command)
            self.force.settle()

    def _rest(self) -> None:
        """End force control without power; the brakes hold the arm where it is."""
        self.force.switch_off()
        if self._arm.queue.state is not QueueState.IDLE:
            return
        if self.force.displacing or any(self._arm.servo.loads.yielded):
            place = self._arm.servo.encoder
            self._arm.queue.place(place)
            self._arm.servo.place(place)
            self.force.forget()

    def _halt(self, end: bool) -> None:
        if self._arm.slave.on:
            self._arm.stop(hresult.STOPPED_DURING_PC_MOTION)
        else:
            self._arm.skip()
        if end:
            self.force.switch_off()

    # --- variables ----------------------------------------------------------------------------------------------

    def _set_io(self, point: int, on: bool) -> None:
        self._variables.write(CLASSES["IO"], point, Variant(VarType.BOOL, on))

    def _store_position(self, index: int) -> None:
        position = self._arm.space.position(self._arm.servo.encoder)
        self._variables.write(CLASSES["P"], index, Variant(_R8_ARRAY, position))
