"""Driving the motors of an ABH3 while a button is held: :class:`Drive`.

While driving is enabled, the current commands and inputs are repeated every 0.1 s (keep-alive). The keep-alive ends, and
the motors stop, if the Tester is blocked. If the Tester is killed, the driver stops the motors by itself, because it
receives no commands (parameter 4117, usually 500 ms).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.table.signals import CURRENT, VELOCITY, Quantity
from orinkit.core.errors import ConnectionClosed, DriverTimeout, InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.held_motion import HEARTBEAT, IDLE, HeldMotion, MotionState

if TYPE_CHECKING:
    from orinkit.tester.state.workspace import ActiveMotion

AXES: Final = ("ay", "bx")
"""The names of the axes A/Y and B/X."""
_TICK: Final = 0.02  # s
_PERIOD: Final = 0.1  # s between two commands
_STANDSTILL: Final = 10.0  # s


@dataclass(frozen=True, slots=True)
class DriveRequest:
    """The axes to drive with their set-points, in min^-1, or in % in torque mode; ``None`` for an axis at rest.

    Attributes:
        ay: Set-point of A/Y.
        bx: Set-point of B/X.
    """

    ay: float | None = None
    bx: float | None = None


class Drive(HeldMotion[DriveRequest]):
    """The motors of a driver, for all pages.

    Args:
        connection: The connection.
        motions: The running motions of the workspace.
    """

    def __init__(self, connection: DriverConnection, motions: set[ActiveMotion]) -> None:
        super().__init__(connection, motions)
        self._connection = connection
        self._applied: DriveRequest | None = None
        self._woken = asyncio.Event()

    @property
    def driving(self) -> bool:
        """True while a button is held, or the stop after its release has not been confirmed."""
        return self._request is not None or self._applied is not None

    @property
    def inputs(self) -> int:
        """The inputs that were sent last; 0 if the connection is closed."""
        try:
            return int(self._connection.driver.inputs)
        except ConnectionClosed:
            return 0

    def quantity(self, axis: str) -> Quantity:
        """Return the quantity of the set-point of an axis: velocity, or current in torque mode."""
        torque = self._connection.dialect.inputs.masks[f"{axis}_torque"]
        return CURRENT if self.inputs & torque else VELOCITY

    def start(self, request: DriveRequest, absent: Callable[[], str]) -> None:
        """Send set-points, and switch start on for their axes.

        Args:
            request: What to drive.
            absent: Function that returns why the user counts as gone; ``""`` if the user is present.

        Raises:
            InvalidValue: If a set-point is out of range, or driving is not enabled.
        """
        for axis in AXES:
            value = getattr(request, axis)
            if value is not None:
                self.quantity(axis).encode(value)
        if not self.usable:
            raise InvalidValue(tr("driving is not enabled. Try: Enable driving"))
        self._request, self._absent = request, absent
        self._tell("")
        self._wake()

    def release(self) -> None:
        """Set the commands to 0 and switch start off; the servo stays on."""
        if self._request is not None:
            self._halt("")

    async def set_input(self, number: int, value: int) -> None:
        """Set an input of the driver.

        Args:
            number: Number of the input.
            value: 0 or 1.

        Raises:
            InvalidValue: If driving is not enabled, a button is held, or the input is one of those that start a motion.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        if not self.usable:
            raise InvalidValue(tr("inputs can be switched only while driving is enabled. Try: Enable driving"))
        if self.driving:
            raise InvalidValue(tr("inputs cannot be switched while a motor is driven. Try: let the button go first"))
        if self.is_start(number):
            raise InvalidValue(tr("start is on only while a button is held. Try: hold a button for driving"))
        await self._connection.driver.set_input(number, value)
        self._used = monotonic()

    def is_start(self, number: int) -> bool:
        """Return True for the inputs that start a motion."""
        return bool(self._connection.dialect.inputs.masks["start"] >> number & 1)

    # --- the task ------------------------------------------------------------------------------------------------

    async def _operate(self) -> None:
        driver = self._connection.driver
        try:
            await driver.reset_errors()
            await driver.set_input("servo_on", True)
            await driver.keep_alive(_PERIOD, patience=HEARTBEAT, idle=HEARTBEAT)
            self._used = monotonic()
            self._set(MotionState.READY)
            await self._follow(driver)
        finally:
            self._set(MotionState.ENDING)
            if self._connection.is_open:
                await self._end(driver)

    async def _follow(self, driver: AsyncDriver[Any, Any]) -> None:
        """Carry out the requests until the end of the operation."""
        while not self._ending:
            if not self._connection.is_open:
                self._tell(tr("the connection was closed"))
                return
            self._check_presence()
            if self._request != self._applied:
                await self._apply(driver, self._request)
                continue
            if self._request is not None:
                self._used = monotonic()
            elif self._unused:
                self._tell(tr("driving was not used for {seconds:g} s, so it was disabled", seconds=IDLE))
                return
            if not driver.kept_alive:  # the driver does not reply, or this program was suspended
                await driver.command()  # raises the reason
                raise DriverTimeout("keep_alive", HEARTBEAT, driver.address)
            driver.restart_idle_time()
            await self._pause()

    async def _apply(self, driver: AsyncDriver[Any, Any], request: DriveRequest | None) -> None:
        masks = self._connection.dialect.inputs.masks
        if request is None:
            await driver.stop()
            self._applied = None
            self._set(MotionState.READY)
            return
        axes = {axis: getattr(request, axis) for axis in AXES}
        self._applied = request
        self._set(MotionState.MOVING)
        await driver.command(**{axis: value or 0.0 for axis, value in axes.items()})
        if self._request is request:  # otherwise the button has been released meanwhile
            start = sum(masks[f"{axis}_start"] for axis, value in axes.items() if value is not None)
            await driver.set_inputs(start, masks["start"])

    async def _end(self, driver: AsyncDriver[Any, Any]) -> None:
        """Decelerate to standstill, switch the servo off, and end the keep-alive.

        If the motors may still turn, :attr:`error` contains the reason, even if the user has ended the operation.
        """
        try:
            await driver.stop_and_wait(_STANDSTILL)
            driver.end_keep_alive()
            await driver.init()
        except (OrinError, OSError) as error:
            driver.end_keep_alive()
            self.error = error

    async def _pause(self) -> None:
        try:
            await asyncio.wait_for(self._woken.wait(), _TICK)
        except TimeoutError:
            return
        self._woken.clear()

    def _wake(self) -> None:
        self._woken.set()

    def _halt(self, message: str) -> None:
        self._request = None
        self._tell(message)
        self._wake()

    def _leave_text(self, reason: str) -> str:
        return tr("stopped, and driving was disabled: {reason}", reason=reason)

    def _forget(self) -> None:
        self._applied = None
        self._woken.clear()
