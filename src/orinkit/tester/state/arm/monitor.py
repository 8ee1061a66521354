"""The live state of an arm, polled once for all pages: :class:`ArmMonitor`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit.arms import ArmModel, model_of_type
from orinkit.client._async.objects import AsyncObjectContainer, AsyncVariable
from orinkit.client._async.robot import AsyncRobot
from orinkit.core import hresult
from orinkit.core.errors import CallError, OrinError
from orinkit.tester.state.controller_connection import ControllerConnection

logger = logging.getLogger("orinkit.tester")

PERIOD: Final = 0.05
"""Time in s between two readings of the joints."""
_STATUS_EVERY: Final = 5  # readings of the joints per reading of the state
_RETRY: Final = 0.5  # s
_TOKEN: Final = 5  # bit of SysState: clients may start motions
_ARM_AXES: Final = 6

Reader = Callable[[], tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class ArmStatus:
    """The state of the controller, as far as it is known; ``None`` if the controller does not report it.

    Attributes:
        motor: True if the motor is on.
        moving: True if a motion is executing.
        mode: 1 manual, 2 teach check, 3 automatic.
        token: True if clients may start motions: automatic mode, and the executable token is not with the pendant.
        error: Code of the newest current error; 0 if there is none.
        slave: Number of the active slave mode; 0 if it is off.
        speed: External speed in %.
        tool: Number of the current tool.
        work: Number of the current work frame.
    """

    motor: bool | None = None
    moving: bool | None = None
    mode: int | None = None
    token: bool | None = None
    error: int = 0
    slave: int = 0
    speed: float | None = None
    tool: int | None = None
    work: int | None = None

    @property
    def error_text(self) -> str:
        """The code, name and text of the error; ``""`` if there is none."""
        if not self.error:
            return ""
        info = hresult.lookup(self.error)
        return f"{self.error & 0xFFFFFFFF:08X} {info.name}: {info.text}"


class ArmMonitor:
    """Polls an arm while at least one page displays it.

    Args:
        connection: The connection.

    Attributes:
        type_name: Type name of the arm that the controller reports; ``""`` if it is unknown.
        model: Model of the arm; ``None`` if there is none for this type.
        joints: Joint position, deg (mm for linear axes), one value per axis; empty if it is unknown.
        position: X, Y, Z in mm, RX, RY, RZ in deg, and the figure; empty if it is unknown.
        status: The state of the controller.
        error: Why the arm cannot be read; otherwise ``None``.
        version: Counts the readings.
        lent: Function that returns the joints while slave mode has the only connection; otherwise ``None``.
    """

    def __init__(self, connection: ControllerConnection) -> None:
        self._connection = connection
        self._users = 0
        self._task: asyncio.Task[None] | None = None
        self._robot: AsyncRobot | None = None
        self._variables: dict[tuple[bool, str], AsyncVariable | None] = {}
        self.type_name = ""
        self.model: ArmModel | None = None
        self.joints: tuple[float, ...] = ()
        self.position: tuple[float, ...] = ()
        self.status = ArmStatus()
        self.error: Exception | None = None
        self.version = 0
        self.lent: Reader | None = None

    def attach(self) -> Callable[[], None]:
        """Start polling for a page; return a function with which the page ends it. Calling it again has no effect."""
        self._users += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._poll())
        attached = [True]

        def detach() -> None:
            if attached:
                attached.clear()
                self._users -= 1

        return detach

    async def identify(self) -> ArmModel | None:
        """Return the model of the arm; ask the controller for its type if necessary.

        Raises:
            OrinError: If the connection is not open, or the controller has no robot.
        """
        robot = await self._connection.monitored_robot()
        if robot is not self._robot:
            dialect = robot.client.dialect
            type_name = dialect.name.upper()
            if dialect.slave_formats:
                try:
                    type_name = str(await robot.execute("GetRobotTypeName"))
                except CallError:
                    type_name = ""
            self.type_name, self.model = type_name, model_of_type(type_name)
            self._robot, self._variables = robot, {}
        return self.model

    async def _poll(self) -> None:
        cycle = 0
        while self._users:
            try:
                await self._read(cycle)
                self.error = None
            except (OrinError, OSError) as error:
                self.error = error
                self.joints, self.position, self.status = (), (), ArmStatus()
                logger.debug("%s: reading the arm failed: %s", self._connection.name, error)
            self.version += 1
            cycle = 0 if self.error else cycle + 1
            await asyncio.sleep(_RETRY if self.error else PERIOD)

    async def _read(self, cycle: int) -> None:
        if self.lent is not None:
            self.joints, self.position = self.lent(), ()
            return
        model = await self.identify()
        robot = self._robot
        assert robot is not None
        joints = tuple(await robot.get_joints())
        self.joints = joints[: len(model.axes)] if model else _used(joints)
        if robot.client.dialect.takes_arm:
            self.position = tuple(await robot.get_position())
        if cycle % _STATUS_EVERY == 0:
            self.status = await self._read_status(robot)

    async def _read_status(self, robot: AsyncRobot) -> ArmStatus:
        controller = await self._connection.monitor()
        motor = await self._value(robot, "@SERVO_ON")
        if not robot.client.dialect.takes_arm:
            return ArmStatus(None if motor is None else bool(motor))
        state = int(await controller.execute("SysState"))
        return ArmStatus(
            bool(motor),
            bool(await self._value(robot, "@BUSY_STATUS")),
            await self._value(controller, "@MODE"),
            bool(state >> _TOKEN & 1),
            int(await self._value(controller, "@ERROR_CODE") or 0),
            await _slave_mode(robot),
            await self._value(robot, "@EXTSPEED"),
            await self._value(robot, "@CURRENT_TOOL"),
            await self._value(robot, "@CURRENT_WORK"),
        )

    async def _value(self, owner: AsyncObjectContainer, name: str) -> Any:
        """Return the value of a variable; ``None`` if it does not exist. The variable object remains open."""
        key = owner is self._robot, name
        try:
            if key not in self._variables:
                self._variables[key] = await owner.variable(name)
            variable = self._variables[key]
            return None if variable is None else await variable.get_value()
        except CallError as error:
            logger.debug("%s: %s", name, error)
            self._variables[key] = None
            return None


async def _slave_mode(robot: AsyncRobot) -> int:
    try:
        return int(await robot.execute("slvGetMode") or 0)
    except CallError:
        return 0


def _used(joints: tuple[float, ...]) -> tuple[float, ...]:
    """Return the joints of an unknown arm: six, and further ones up to the last that is not 0."""
    count = len(joints)
    while count > _ARM_AXES and not joints[count - 1]:
        count -= 1
    return joints[:count]
