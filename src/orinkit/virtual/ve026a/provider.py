"""The virtual VE026A as a provider, and what a person, a test or a program outside can see of it and do to it."""

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
from orinkit.virtual.ve026a.objects import HANDLES, VE026AController, plain_name

_LONGEST: Final = 3600.0


class VirtualVE026A(Provider):
    """A virtual VE026A: an arm of seven axes (the seventh is its hand) that moves in slave mode only.

    Args:
        clock: its clock; real time, if not given.
        joints: where the arm stands, J1 to J6 or J1 to J7 in degrees; its home pose if not given.
        motor: whether the motor is on from the beginning.
        motor_seconds: how long the command Motor takes, s; the document says about 3.
        clear_seconds: how long the command ClearError takes, s; the document says about 1.
        model: an arm of seven axes with other frames or limits; that of the published model, if not given.
        strict_time: in synchronous slave mode a cycle without a set-point is an error at once, as on a real VE026A.
            Otherwise the controller's time stands still until it comes, for 250 ms at most, and :attr:`lateness` counts it.

    Raises:
        ValueError: joints that the arm cannot take; seconds that are none; a model of another number of axes.
    """

    provider_names: Sequence[str] = ("", "*")  # "not used" (VE026A 5.2.1): every name is its own
    dialect: Dialect = VE026A
    functions: frozenset[int] | None = frozenset({1, 2, 3, 4, 7, 9, 17, 62, 64, 84, 101, 111})
    fixed_handles: bool = True

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
                tr("a VE026A has {axes} axes, {name} has {count}", axes=AXES, name=arm.name, count=len(arm.axes))
            )  # fmt: skip
        for seconds in (motor_seconds, clear_seconds):
            if not 0.0 <= seconds <= _LONGEST:
                raise ValueError(tr("0 to {longest:g} s, not {seconds}", longest=_LONGEST, seconds=seconds))
        self._cycles = ControlLoop(clock or Clock())
        self._arm = VE026AArm(arm, self._cycles, arm.home, motor_seconds, clear_seconds, strict_time=strict_time)
        if joints is not None:
            self._arm.place(_checked(self._arm, joints))
        self._arm.motor_on = bool(motor)
        self._cycles.add(self._arm, failed=lambda error: self._arm.fail(hresult.E_UNEXPECTED, f"{error}"))
        self.guard = self._cycles

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> VE026AController:  # noqa: ARG002
        """Return the controller object for one client; names, machine and option are not used (VE026A 5.2.1)."""
        return VE026AController(self._arm, Operator(client.drain_input), name)

    def handle_of(self, interface: str, name: str) -> int:
        """Return the handle of an object, the same for every client.

        Args:
            interface: ``"Controller"``, ``"Robot"`` or ``"Variable"``.
            name: of a variable; that of others does not matter.
        """
        return HANDLES[interface, plain_name(name) if interface == "Variable" else ""]

    def close(self) -> None:
        """Switch it off: what moves stops where it is, the motor is off; closing twice is no error."""
        self._cycles.close()
        with self.guard:
            self._arm.close()

    # --- what can be seen and done beside the line ---------------------------------------------------------------

    @property
    def joints(self) -> Joints:
        """Where the encoders are, J1 to J7, deg."""
        with self.guard:
            return self._arm.servo.encoder

    @property
    def position(self) -> tuple[float, ...]:
        """Where the tip of the tool is: X, Y, Z in mm, RX, RY, RZ in deg."""
        return tuple(frames.position_of_matrix(self._arm.kinematics.forward(self.joints)).tolist())

    @property
    def servo_on(self) -> bool:
        """Whether the motor is on."""
        with self.guard:
            return self._arm.motor_on

    @property
    def slave_mode(self) -> int:
        """0x002 synchronous, 0x102 asynchronous, 0 off."""
        with self.guard:
            return self._arm.slave.mode

    @property
    def lateness(self) -> Lateness:
        """How late the set-points of the present stream in slave mode are, or those of the last one were."""
        with self.guard:
            return self._arm.slave.lateness(0)

    @property
    def error(self) -> int:
        """Code of the error that it is in, 0 for none."""
        with self.guard:
            return self._arm.error

    @property
    def error_text(self) -> str:
        """What the error is, in the language in force; empty for none."""
        code = self.error
        if code == hresult.S_OK:
            return ""
        return CODES[code].text if code in CODES else hresult.lookup(code).text

    def emergency_stop(self) -> None:
        """Press the emergency stop: the arm brakes, the motor goes off, slave mode too; an error until ClearError."""
        with self.guard:
            self._arm.press_emergency()

    def release_emergency_stop(self) -> None:
        """Release the emergency stop; the error is there until ClearError."""
        with self.guard:
            self._arm.emergency = False


def _checked(arm: VE026AArm, joints: Sequence[float]) -> Joints:
    wanted = (*map(float, joints), *arm.model.home[len(joints) :])
    if len(joints) < AXES - 1 or len(wanted) != AXES or not all(map(math.isfinite, wanted)) or arm.exceeded(wanted):
        given = ", ".join(f"{value:g}" for value in joints)
        raise ValueError(tr("{name} cannot stand at {given}", name=arm.model.name, given=given))
    return wanted
