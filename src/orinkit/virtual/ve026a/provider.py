"""The virtual VE026A as a provider, with properties and methods for programs and tests that run it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from orinkit.arms import ArmModel, frames, load_model
from orinkit.cao.dialect import VE026A, Dialect
from orinkit.cao.provider import ClientInfo, Provider
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.ve026a.arm import VE026AArm
from orinkit.virtual.ve026a.arm_owner import Operator
from orinkit.virtual.ve026a.codes import AXES, CODES
from orinkit.virtual.ve026a.objects import HANDLES, VE026AController, name_key

_LONGEST: Final = 3600.0


class VirtualVE026A(Provider):
    """A virtual VE026A: an arm of seven axes (the seventh is its hand) that moves in slave mode only.

    Args:
        clock: Clock of the controller; real time by default.
        joints: Initial joints, J1 to J6 or J1 to J7, deg; the home position by default.
        motor: True if the motor is initially on.
        motor_seconds: Duration of the command Motor, s; about 3 according to the document.
        clear_seconds: Duration of the command ClearError, s; about 1 according to the document.
        model: An arm of seven axes with other frames or limits; the published model by default.
        strict_time: If True, a cycle without a set-point in synchronous slave mode is an error immediately, as on a
            real VE026A. Otherwise the controller's time stops until the set-point arrives, for 250 ms at most, and
            :attr:`set_point_lateness` counts the late set-point.

    Raises:
        ValueError: If the joints are out of range, a duration is not 0 to 3600 s, or the model does not have seven
            axes.
    """

    provider_names: Sequence[str] = ("", "*")  # "not used" (VE026A 5.2.1): any name is accepted
    dialect: Dialect = VE026A
    functions: frozenset[int] | None = frozenset({1, 2, 3, 4, 7, 9, 17, 62, 64, 84, 101, 111})
    fixed_handles: bool = True
    unwraps_variants: bool = True

    def __init__(
        self,
        *,
        clock: Clock | None = None,
        joints: Sequence[float] | None = None,
        motor: bool = False,
        motor_seconds: float = 3.0,
        clear_seconds: float = 1.0,
        model: ArmModel | None = None,
        strict_time: bool = False,
    ) -> None:
        arm = model or load_model("VE026A")
        if len(arm.axes) != AXES:
            raise ValueError(
                tr("the model must have {axes} axes; {name} has {count}", axes=AXES, name=arm.name, count=len(arm.axes))
            )  # fmt: skip
        for seconds in (motor_seconds, clear_seconds):
            if not 0.0 <= seconds <= _LONGEST:
                raise ValueError(
                    tr("a duration must be 0 to {longest:g} s, not {seconds}", longest=_LONGEST, seconds=seconds)
                )
        self._cycles = ControlLoop(clock or Clock())
        self._arm = VE026AArm(arm, self._cycles, arm.home, motor_seconds, clear_seconds, strict_time=strict_time)
        if joints is not None:
            self._arm.place(_checked(self._arm, joints))
        self._arm.motor_on = bool(motor)
        self._cycles.add(self._arm, on_error=lambda error: self._arm.fail(hresult.E_UNEXPECTED, f"{error}"))
        self.guard = self._cycles

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> VE026AController:
        """Return the controller object for one client; machine and option are not used (VE026A 5.2.1)."""
        return VE026AController(self._arm, Operator(client.when_input_processed), name)

    def handle_of(self, interface: str, name: str) -> int:
        """Return the handle of an object, the same for every client.

        Args:
            interface: ``"Controller"``, ``"Robot"`` or ``"Variable"``.
            name: Name of a variable; ignored for the other interfaces.
        """
        return HANDLES[interface, name_key(name) if interface == "Variable" else ""]

    def close(self) -> None:
        """Switch the controller off: the arm stops where it is, and the motor is off. May be called repeatedly."""
        self._cycles.close()
        with self.guard:
            self._arm.close()

    # --- access from outside b-CAP -------------------------------------------------------------------------------

    @property
    def joints(self) -> Joints:
        """Encoder values of J1 to J7, deg."""
        with self.guard:
            return self._arm.servo.encoder

    @property
    def position(self) -> tuple[float, ...]:
        """Position of the tool's tip: X, Y, Z in mm, RX, RY, RZ in deg."""
        return tuple(frames.position_of_matrix(self._arm.kinematics.forward(self.joints)).tolist())

    @property
    def servo_on(self) -> bool:
        """True if the motor is on."""
        with self.guard:
            return self._arm.motor_on

    @property
    def slave_mode(self) -> int:
        """The slave mode: 0x002 synchronous, 0x102 asynchronous, 0 off."""
        with self.guard:
            return self._arm.slave.mode

    @property
    def set_point_lateness(self) -> Lateness:
        """Lateness of the set-points of the present or last stream in slave mode."""
        with self.guard:
            return self._arm.slave.lateness(0)

    @property
    def error(self) -> int:
        """Code of the present error, 0 for none."""
        with self.guard:
            return self._arm.error

    @property
    def error_text(self) -> str:
        """Text of the present error in the current language; empty for none."""
        code = self.error
        if code == hresult.S_OK:
            return ""
        return CODES[code].text if code in CODES else hresult.lookup(code).text

    def emergency_stop(self) -> None:
        """Press the emergency stop: the arm brakes, motor and slave mode are switched off.

        The error lasts until ClearError.
        """
        with self.guard:
            self._arm.press_emergency()

    def release_emergency_stop(self) -> None:
        """Release the emergency stop; the error lasts until ClearError."""
        with self.guard:
            self._arm.emergency = False


def _checked(arm: VE026AArm, joints: Sequence[float]) -> Joints:
    completed = (*map(float, joints), *arm.model.home[len(joints) :])
    if (
        len(joints) < AXES - 1
        or len(completed) != AXES
        or not all(map(math.isfinite, completed))
        or arm.exceeded(completed)
    ):
        given = ", ".join(f"{value:g}" for value in joints)
        raise ValueError(
            tr(
                "joint position {joints} is not valid for {name}. Try: {count} joints within their limits",
                name=arm.model.name,
                joints=given,
                count=f"{AXES - 1}-{AXES}",
            )
        )
    return completed
