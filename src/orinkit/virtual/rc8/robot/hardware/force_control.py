"""Force sensor and force control: the arm yields to the force on its tool, within its limits.

In each cycle, the displacement x of the tool follows ``mass x'' + damping x' + spring x = force`` in each of the six
directions of the control frame. It is added to the commanded pose, and converted to joints with the Jacobian. The
displacement of each joint is limited so that the velocity and acceleration limits and the soft limits of the arm apply
to the sum of command and displacement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final, Protocol

import numpy as np

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.dynamics import GRAVITY, Payload, Vector, Wrench
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.servo import Servo
from orinkit.virtual.rc8.robot.hardware.contact import Matrix, Surfaces
from orinkit.virtual.rc8.robot.hardware.force_parameters import (
    COMPLIANCE,
    SENSOR,
    TOOL,
    WORK,
    ForceParameters,
    ForceTables,
    Six,
)
from orinkit.virtual.rc8.robot.target import FrameContext

Joints = tuple[float, ...]

PULSES_PER_NEWTON: Final = 20.0
"""Resolution of the sensor, pulses for each N (an assumption of this project)."""
PULSES_PER_NEWTON_METRE: Final = 1000.0
"""Resolution of the sensor, pulses for each N m (an assumption of this project)."""

FASTEST: Final = 0.5
"""Largest speed of a motion that is commanded while force control is on, as a fraction of the full speed."""

_DEGREE: Final = math.pi / 180.0
_METRE: Final = 1000.0
_SHARP: Final = 3.0  # mm for each rad, damping of the inverse Jacobian near singular points
_LEVER: Final = 300.0  # mm; a rotation by 1 rad counts as much as this way
_BACK: Final = 0.2  # of the remaining displacement in a cycle, when force control has been switched off
_GONE: Final = 1e-4  # deg or mm
_ROUNDING: Final = 1 + 1e-9
_STILL: Final = 1e-9  # deg or mm; less is standstill, so that a motion with @E ends although the displacement converges
_ZERO: Final[Six] = (0.0,) * 6
_FORCE, _COMMAND, _ENCODER, _DEVIATION = 0, 1, 2, 3
_QUANTITIES: Final = 4


class ControlledArm(Protocol):
    """The arm whose tool measures a force."""

    @property
    def model(self) -> ArmModel:
        """The arm model."""

    @property
    def space(self) -> FrameContext:
        """Frames and kinematics."""

    @property
    def servo(self) -> Servo:
        """Encoders and loads."""


class ForceControl:
    """The force sensor and the force control of one arm.

    Args:
        arm: The arm.
        surfaces: What the tool can touch.
        seconds: Callback that returns the time since the controller was switched on, s.

    Attributes:
        surfaces: What the tool can touch.
        tables: The parameter tables.
        on: True while force control is on.
        sensor_payload: Load of the sensor whose weight is compensated (ForceSensorPayLoad).
        started: Time at which force control was last switched on, s.
    """

    def __init__(self, arm: ControlledArm, surfaces: Surfaces, seconds: Callable[[], float]) -> None:
        self.surfaces = surfaces
        self.tables = ForceTables()
        self.on = False
        self.sensor_payload = Payload()
        self.started = 0.0
        self._arm = arm
        self._seconds = seconds
        self._parameters = ForceParameters()
        self._displacement = np.zeros(6)  # mm, deg, in the control frame
        self._rate = np.zeros(6)  # mm/s, deg/s
        self._shift: Joints = ()  # displacement of the joints, deg
        self._staying = False  # the displacement neither grows nor goes back
        self._frame = np.eye(3)  # axes of the control frame, for base and work
        self._zero = np.zeros(6)  # reading of the sensor at its last reset, tool frame
        self._start: tuple[Matrix, Matrix] | None = None  # tips by command and by encoder at the start of control
        self._peaks = [(np.zeros(6), np.zeros(6)) for _ in range(_QUANTITIES)]

    @property
    def displacing(self) -> bool:
        """True while force control is on, or its displacement has not yet gone back to zero."""
        return self.on or bool(self._shift)

    @property
    def parameters(self) -> ForceParameters:
        """The parameters of the control that is, or was last, on."""
        return self._parameters

    # --- functions ----------------------------------------------------------------------------------------------

    def switch_on(self, number: int, mode: int | None) -> None:
        """Switch force control on with a parameter table.

        Args:
            number: Number of the table, 1 to 10.
            mode: 0 compliance, 1 force sensor, 2 following; ``None`` for the mode of the table.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        parameters = self.tables.table(number)
        if mode is not None:
            parameters = replace(parameters, mode=mode)
        self._parameters = parameters
        self._displacement, self._rate = np.zeros(6), np.zeros(6)
        self._shift = self._shift or (0.0,) * len(self._arm.model.axes)
        self._take_start()
        self._peaks = [(np.zeros(6), np.zeros(6)) for _ in range(_QUANTITIES)]
        self.started = self._seconds()
        self._limit_currents(parameters)
        self.on, self._staying = True, False

    def switch_off(self, *, stay: bool = False) -> None:
        """Switch force control off; the arm returns smoothly to its commanded pose.

        Args:
            stay: True to keep the displacement until :meth:`settle`, because nobody commands the arm any more.
        """
        self._staying = self._staying or (stay and self.displacing)
        if self.on:
            self.on = False
            self._arm.servo.loads.force_limits.clear()

    @property
    def staying(self) -> bool:
        """True if the displacement is kept until :meth:`settle`."""
        return self._staying

    def settle(self) -> None:
        """Drop the displacement, after the command position has been set to the last displaced one.

        The arm comes to rest there within its limits.
        """
        self.forget()
        self._shift = (0.0,) * len(self._arm.model.axes)

    def change_table(self, number: int) -> None:
        """Continue with the parameters of another table.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; E_FAIL if force control is off.
        """
        parameters = self.tables.table(number)
        if not self.on:
            raise error_for(hresult.E_FAIL, tr("force control is off. Try: ForceCtrl"))
        self._parameters = replace(parameters, mode=self._parameters.mode)
        self._limit_currents(self._parameters)

    def reset_sensor(self) -> None:
        """Make the present reading of the sensor its zero."""
        self._zero = self._reading(*self._contact())

    def forget(self) -> None:
        """Drop the displacement, after the command position has been set to the present one."""
        self._shift, self._staying = (), False
        self._displacement, self._rate = np.zeros(6), np.zeros(6)

    def require_slow(self, motions: Iterable[Motion]) -> None:
        """Raise an exception if force control is on and a motion is too fast, also because of its option SPEED.

        Raises:
            CallError: FORCE_CONTROL_TOO_FAST.
        """
        if self.on:
            require_speed(motions)

    # --- values -------------------------------------------------------------------------------------------------

    def sensed(self) -> Six:
        """Return force and moment in the tool frame, N and N m."""
        return _six(self._reading(*self._contact()) - self._zero)

    def pulses(self) -> Six:
        """Return the reading of the sensor in pulses."""
        scale = np.array([PULSES_PER_NEWTON] * 3 + [PULSES_PER_NEWTON_METRE] * 3)
        return _six(np.rint(self._reading(*self._contact()) * scale))

    def force(self) -> Six:
        """Return force and moment on the tool in the control frame, N and N m."""
        return _six(self._in_control(*self._contact()))

    def travel(self) -> Six:
        """Return the way of the tip since the start of control, by encoder, in the control frame, mm and deg."""
        return _six(self._travelled(_ENCODER))

    def value(self, quantity: int) -> Six:
        """Return a quantity: 0 force, 1 travel by command, 2 travel by encoder, 3 deviation."""
        return self.force() if quantity == _FORCE else _six(self._travelled(quantity))

    def peak(self, quantity: int, *, positive: bool, reset: bool) -> Six:
        """Return the positive or the negative peak of a quantity; with ``reset``, begin a new one."""
        self._note_peak(quantity, np.array(self.value(quantity)))
        high, low = self._peaks[quantity]
        wanted = high if positive else low
        found = _six(wanted)
        if reset:
            wanted[:] = 0.0
        return found

    # --- a cycle ------------------------------------------------------------------------------------------------

    def command(self, joints: Joints) -> Joints:
        """Return the command position of this cycle: that of the motion, displaced by force control."""
        wanted = self._wanted(joints)
        shift = tuple([a - b for a, b in zip(self._within_limits(wanted), joints, strict=True)])
        if any(abs(a - b) > _STILL for a, b in zip(shift, self._shift, strict=True)):
            self._shift = shift
        if not (self.on or self._staying) and all(abs(shift) < _GONE for shift in self._shift):
            self._shift = ()
            self._displacement = np.zeros(6)
            return joints
        return tuple([a + b for a, b in zip(joints, self._shift, strict=True)])

    def measure(self) -> Wrench | None:
        """Measure the force on the tool at the encoders' position and note peaks; return it in the base frame."""
        tip, wrench = self._contact()
        self._note_peak(_FORCE, self._in_control(tip, wrench))
        if self.on:
            command = self._arm.space.tcp(self._arm.servo.command)
            for quantity in (_COMMAND, _ENCODER, _DEVIATION):
                self._note_peak(quantity, self._way(quantity, command, tip))
        return wrench

    def violation(self) -> int:
        """Return the error code of a displacement beyond its limits, 0 if it is within them."""
        if not self.on:
            return 0
        axes = range(self._arm.model.robot_axes)
        largest = 0 if not self._shift else max(axes, key=lambda index: abs(self._shift[index]))
        for value, limit in zip(self._displacement, self._parameters.position_deviation, strict=True):
            if abs(value) > limit:
                return hresult.POSITION_DEVIATION_AXIS1 + largest
        for index, (shift, limit) in enumerate(zip(self._shift, self._parameters.axis_deviation, strict=False)):
            if abs(shift) > limit:
                return hresult.POSITION_DEVIATION_AXIS1 + index
        return 0

    # --- displacement -------------------------------------------------------------------------------------------

    def _wanted(self, joints: Joints) -> Joints:
        """Return the joints at which the tool has the pose that the force wants."""
        shift = self._shift
        if not self.on:
            kept = 1.0 if self._staying else 1 - _BACK
            return tuple([joint + kept * each for joint, each in zip(joints, shift, strict=True)])
        space = self._arm.space
        nominal = space.tcp(joints)
        present = tuple([joint + each for joint, each in zip(joints, shift, strict=True)])
        tip = space.tcp(present)
        axes = self._axes(nominal)
        self._yield(tip, axes)
        goal = nominal.copy()
        goal[:3, 3] += axes @ self._displacement[:3]
        goal[:3, :3] = _turn(axes @ self._displacement[3:]) @ nominal[:3, :3]
        error = np.concatenate((goal[:3, 3] - tip[:3, 3], _turn_between(tip[:3, :3], goal[:3, :3])))
        units = self._units
        jacobian = self._jacobian(present, tip)
        weights = np.array([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER])
        scaled = jacobian * weights[:, None]
        square = scaled @ scaled.T + (_SHARP**2) * np.eye(6)
        step = scaled.T @ np.linalg.solve(square, error * weights)
        moved = [float(joint + turn * unit) for joint, turn, unit in zip(present, step, units, strict=False)]
        return (*moved, *present[len(moved) :])

    def _yield(self, tip: Matrix, axes: Matrix) -> None:
        """Integrate the displacement by one cycle; the plates' stiffness is taken at the end of the cycle."""
        parameters = self._parameters
        wrench = self.surfaces.wrench(tip, _vector(axes @ self._rate[:3]))
        outer = np.zeros(6) if wrench is None else np.array([*wrench.force, *wrench.moment])
        force = np.concatenate((axes.T @ outer[:3], axes.T @ outer[3:])) + np.array(parameters.offset)
        limits = [parameters.translation] * 3 + [parameters.rotation] * 3
        stiffness = max((plate.stiffness for _, plate in self.surfaces), default=0.0) if wrench is not None else 0.0
        for index in range(6):
            effective = _effective(parameters, index, float(force[index]))
            if effective is None:
                self._rate[index] = 0.0
                continue
            inertia = parameters.mass[index] * (1 / _METRE if index < 3 else _DEGREE)
            spring = parameters.spring[index]
            outside = (stiffness if index < 3 else 0.0) * (1.0 if effective else 0.0)
            resistance = inertia / PERIOD + parameters.resistance(index) + (spring + outside) * PERIOD
            push = inertia / PERIOD * self._rate[index] + effective - spring * self._displacement[index]
            rate = min(max(push / resistance, -limits[index]), limits[index])
            self._rate[index] = rate
            self._displacement[index] += rate * PERIOD

    def _within_limits(self, wanted: Joints) -> Joints:
        """Return joints as near to ``wanted`` as the limits of the axes permit."""
        servo = self._arm.servo
        last, before = servo.command, servo.earlier_command
        found = []
        for axis, goal, b, a in zip(self._arm.model.axes, wanted, last, before, strict=True):
            fastest = axis.velocity * PERIOD
            change = axis.acceleration * PERIOD * PERIOD
            step = b - a
            low, high = max(-fastest, step - change), min(fastest, step + change)
            brake = math.sqrt(2 * axis.acceleration * max(0.0, axis.upper - b)) * PERIOD
            high = max(low, min(high, brake, axis.upper - b))
            brake = math.sqrt(2 * axis.acceleration * max(0.0, b - axis.lower)) * PERIOD
            low = min(high, max(low, -brake, axis.lower - b))
            found.append(b + min(max(goal - b, low), high))
        return tuple(found)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _limit_currents(self, parameters: ForceParameters) -> None:
        limits = self._arm.servo.loads.force_limits
        limits.clear()
        if parameters.mode == COMPLIANCE:
            limits_of_axes = parameters.current_limit[: self._arm.model.robot_axes]
            limits.update({index: limit for index, limit in enumerate(limits_of_axes) if limit < 100.0})

    def _take_start(self) -> None:
        servo, space = self._arm.servo, self._arm.space
        self._start = (space.tcp(servo.command), space.tcp(servo.encoder))
        self._frame = space.works.matrix()[:3, :3] if self._parameters.coordinates == WORK else np.eye(3)

    def _axes(self, tip: Matrix) -> Matrix:
        return np.asarray(tip[:3, :3] if self._parameters.coordinates == TOOL else self._frame)

    def _contact(self) -> tuple[Matrix, Wrench | None]:
        """Return the tip by encoder, and force and moment on it in the base frame."""
        space, servo = self._arm.space, self._arm.servo
        tip = space.tcp(servo.encoder)
        if not len(self.surfaces):
            return tip, None
        before = tip if servo.earlier_encoder == servo.encoder else space.tcp(servo.earlier_encoder)
        return tip, self.surfaces.wrench(tip, _vector((tip[:3, 3] - before[:3, 3]) / PERIOD))

    def _reading(self, tip: Matrix, wrench: Wrench | None) -> Matrix:
        """Return the reading of the sensor in the tool frame: contact and weight of the load, without compensation."""
        weight = self._arm.servo.loads.dynamics.payload.mass - self.sensor_payload.mass
        force, moment = np.array([0.0, 0.0, -GRAVITY * weight]), np.zeros(3)
        if wrench is not None:
            force, moment = force + np.array(wrench.force), np.array(wrench.moment)
        axes = tip[:3, :3]
        return np.concatenate((axes.T @ force, axes.T @ moment))

    def _in_control(self, tip: Matrix, wrench: Wrench | None) -> Matrix:
        reading = self._reading(tip, wrench) - self._zero
        turn = self._axes(tip).T @ tip[:3, :3]
        return np.concatenate((turn @ reading[:3], turn @ reading[3:]))

    def _travelled(self, quantity: int) -> Matrix:
        servo, space = self._arm.servo, self._arm.space
        return self._way(quantity, space.tcp(servo.command), space.tcp(servo.encoder))

    def _way(self, quantity: int, command: Matrix, encoder: Matrix) -> Matrix:
        """Return a way of the tool in the control frame, mm and deg; the tips are those of this cycle."""
        if self._start is None:
            self._take_start()
        assert self._start is not None
        if quantity == _DEVIATION:
            first, last = encoder, command
        elif quantity == _COMMAND:
            first, last = self._start[0], command
        else:
            first, last = self._start[1], encoder
        axes = self._axes(first)
        way, turn = last[:3, 3] - first[:3, 3], _turn_between(first[:3, :3], last[:3, :3]) / _DEGREE
        return np.concatenate((axes.T @ way, axes.T @ turn))

    def _note_peak(self, quantity: int, value: Matrix) -> None:
        high, low = self._peaks[quantity]
        np.maximum(high, value, out=high)
        np.minimum(low, value, out=low)

    def _jacobian(self, joints: Joints, tip: Matrix) -> Matrix:
        """Return the Jacobian of the tip, mm and rad for each unit of the robot axes."""
        kinematics = self._arm.space.kinematics
        jacobian = np.array(kinematics.jacobian(joints)) * self._units
        jacobian[3:] *= _DEGREE
        x, y, z = tip[:3, 3] - kinematics.forward(joints)[:3, 3]
        jacobian[:3] -= np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))) @ jacobian[3:]
        return jacobian

    @property
    def _units(self) -> Matrix:
        """The units in which axes are compared: 1 rad in deg; for a linear axis, the way in mm that counts as much."""
        axes = self._arm.model.axes[: self._arm.model.robot_axes]
        return np.array([_LEVER if axis.linear else 1 / _DEGREE for axis in axes])


def require_speed(motions: Iterable[Motion]) -> None:
    """Raise an exception if a motion is too fast for force control.

    Raises:
        CallError: FORCE_CONTROL_TOO_FAST.
    """
    fastest = max((motion.rates.speed for motion in motions), default=0.0)
    if fastest > FASTEST * _ROUNDING:
        raise error_for(
            hresult.FORCE_CONTROL_TOO_FAST,
            tr(
                "the speed of a motion ({speed:.3g} %) exceeds the limit during force control ({most:g} %)",
                speed=100 * fastest,
                most=100 * FASTEST,
            ),
        )


def _effective(parameters: ForceParameters, index: int, force: float) -> float | None:
    """Return the force that moves the tool in a direction; ``None`` if the arm is rigid in this direction."""
    if parameters.mode == COMPLIANCE:
        return math.copysign(max(0.0, abs(force) - abs(parameters.force[index])), force)
    share = parameters.rate[index] / 100.0
    if not share:
        return None
    return share * (force + (parameters.force[index] if parameters.mode == SENSOR else 0.0))


def _turn(vector: Matrix) -> Matrix:
    """Return the rotation by a vector in deg."""
    angle = float(np.linalg.norm(vector)) * _DEGREE
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector * (_DEGREE / angle)
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross))


def _turn_between(first: Matrix, second: Matrix) -> Matrix:
    """Return the rotation from one orientation to another as a vector in rad."""
    turn = second @ first.T
    vector = np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])) / 2
    sine, cosine = float(np.linalg.norm(vector)), float((np.trace(turn) - 1) / 2)
    return np.asarray(vector * (math.atan2(sine, cosine) / sine)) if sine > 1e-12 else vector


def _six(values: Matrix) -> Six:
    a, b, c, d, e, f = (float(value) for value in values)
    return (a, b, c, d, e, f)


def _vector(values: Matrix) -> Vector:
    x, y, z = values.tolist()
    return (x, y, z)
