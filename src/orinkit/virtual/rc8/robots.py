"""All robots of one controller, and what acts on all of them: stops, the motor supply, the lock, power-on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.motor import MotorState
from orinkit.virtual.rc8.robot.unit import RobotUnit


class Robots:
    """The robots of one controller.

    An emergency stop, an error, a change of the mode and a restart concern the controller. They therefore act on every
    arm. The methods must be called inside the lock of the controller.

    Args:
        units: The robots, in the order of their numbers; at least one.
    """

    def __init__(self, units: Sequence[RobotUnit]) -> None:
        self._units = tuple(units)

    def __iter__(self) -> Iterator[RobotUnit]:
        return iter(self._units)

    def __len__(self) -> int:
        return len(self._units)

    def __getitem__(self, number: int) -> RobotUnit:
        return self._units[number]

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """True if an arm moves, or has motions that are queued or paused."""
        return any(unit.arm.busy for unit in self._units)

    @property
    def stopping(self) -> bool:
        """True if an arm is being stopped."""
        return any(unit.arm.stopping for unit in self._units)

    @property
    def settled(self) -> bool:
        """True if the encoders of all arms have reached their command positions."""
        return all(unit.arm.settled for unit in self._units)

    @property
    def motors_on(self) -> bool:
        """True if the motors of all arms are on."""
        return all(unit.arm.motor.on for unit in self._units)

    @property
    def motor_on(self) -> bool:
        """True if the motor of an arm is on."""
        return any(unit.arm.motor.on for unit in self._units)

    @property
    def calibrated(self) -> bool:
        """True if the reference positions of the encoders of all arms are known."""
        return all(unit.arm.hardware.calibrated for unit in self._units)

    def activity(self) -> tuple[Callable[[], bool], Callable[[], bool]]:
        """Return functions for :attr:`busy` and :attr:`motor_on`, which every cycle calls; with one arm, they are direct."""
        if len(self) > 1:
            return (lambda: self.busy), (lambda: self.motor_on)
        arm = self._units[0].arm
        return (lambda: arm.busy), (lambda: arm.motor.on)

    # --- operations ---------------------------------------------------------------------------------------------

    def stop(self, code: int) -> None:
        """Stop every arm within its limits; calls that wait fail with the code."""
        self._for_each(lambda arm: arm.stop(code))

    def stop_and_power_off(self, code: int) -> None:
        """Stop every arm, and then switch its motor off."""
        self._for_each(lambda arm: arm.stop_and_power_off(code))

    def power_on(self) -> None:
        """Put every arm into its state after power-on, after :meth:`stop_and_power_off`."""
        self._for_each(RC8Arm.power_on)

    def lock(self, on: bool) -> None:
        """Set or clear the machine lock of every arm."""
        self._for_each(lambda arm: arm.lock(on))

    def require_motors_off(self) -> None:
        """Raise an exception unless all motors are off.

        Raises:
            CallError: MOTOR_IS_ON.
        """
        if any(unit.arm.motor.state is not MotorState.OFF for unit in self._units):
            raise error_for(hresult.MOTOR_IS_ON)

    def close(self) -> None:
        """Switch every arm off, because the controller is switched off."""
        self._for_each(RC8Arm.close)

    def _for_each(self, act: Callable[[RC8Arm], None]) -> None:
        """Act on every arm, also if this fails for another one; then raise the first exception."""
        errors = []
        for unit in self._units:
            try:
                act(unit.arm)
            except Exception as error:  # noqa: BLE001 - a defect at one arm must not keep the others moving
                errors.append(error)
        if errors:
            raise errors[0]
