"""A connection to a robot controller over b-CAP or e-CAP: :class:`ControllerConnection`."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Any, Final

from orinkit import aio
from orinkit.client._async.controller import AsyncController
from orinkit.client._async.robot import AsyncRobot
from orinkit.core.errors import ConnectionClosed, NotImplementedCall, ObjectNotFound, OrinError, StreamError
from orinkit.core.i18n import tr
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_log import ControllerLog
from orinkit.tester.state.objects import ObjectRegistry
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.poller import VariablePoller
from orinkit.tester.state.watch_list import WatchLists
from orinkit.transport.address import parse_address
from orinkit.transport.serial.address import SerialAddress

logger = logging.getLogger("orinkit.tester")

_CLOSE_TIMEOUT: Final = 2.0  # s
_SECONDARY: Final = ("tcp", "udp", "http", "https")  # transports over which a controller accepts several connections


class ControllerConnection(Connection):
    """A connection to a robot controller.

    The calls of the user are executed one at a time. If the transport allows it, a second connection reads the values
    that the pages display, and stops the robot, so that a stop need not wait for a call in progress.

    Attributes:
        lent: True while slave mode uses the only connection, so that no calls are possible.
        objects: The objects that pages have created over the connection of the user.
        poller: The values of variables, for all pages.
        log: The errors and events of the controller, for all pages.
        watch_lists: The variables that users have chosen on the page Monitor.
    """

    def __init__(self, spec: ConnectionSpec, packets: PacketLog) -> None:
        super().__init__(spec, packets)
        self._controller: AsyncController | None = None
        self._robot: AsyncRobot | None = None
        self._second: AsyncController | None = None
        self._second_robot: AsyncRobot | None = None
        self._lock = asyncio.Lock()
        self.lent = False
        self.objects = ObjectRegistry()
        self.poller = VariablePoller(self)
        self.log = ControllerLog(self, fetches_events=spec.messages)
        self.watch_lists = WatchLists()

    @property
    def controller(self) -> AsyncController:
        """The controller object.

        Raises:
            ConnectionClosed: If the connection is not open.
        """
        if self._controller is None:
            raise ConnectionClosed(tr("{name} is not connected. Try: Connect on the page Connections", name=self.name))
        return self._controller

    @property
    def robot_name(self) -> str:
        """The name of the robot in Controller_GetRobot."""
        return "VE" if self.controller.client.dialect.name == "ve026a" else "Arm"

    @property
    def allows_second(self) -> bool:
        """True if a controller accepts several connections over this transport."""
        return self.spec.scheme in _SECONDARY

    async def robot(self) -> AsyncRobot:
        """Return the robot object; connect to it first if necessary.

        Raises:
            OrinError: If the connection is not open, or the controller has no robot.
        """
        controller = self.controller
        async with self._lock:
            if self._robot is None:
                self._robot = await self.robot_of(controller)
            return self._robot

    async def robot_of(self, controller: AsyncController) -> AsyncRobot:
        """Return a new object for the robot of this connection, over another connection to the same controller.

        Raises:
            OrinError: If the controller does not have the robot.
        """
        option = f"ID={self.spec.robot}" if self.spec.robot else ""
        return await controller.robot(self.robot_name, option)

    async def connect_another(self, *, trace: bool = False, **options: Any) -> AsyncController:
        """Open a further connection to the same controller, with the same parameters.

        Args:
            trace: True to add its packets to the log.
            **options: Further arguments of :func:`orinkit.aio.connect`.

        Raises:
            OrinError: If connecting fails.
        """
        spec = self.spec
        return await aio.connect(
            spec.url,
            provider=spec.provider,
            machine=spec.machine or "localhost",
            option=spec.option,
            timeout=spec.timeout / 1000 if spec.timeout else None,
            tries=spec.tries,
            messages=spec.messages,
            debug=spec.debug,
            token=spec.token,
            trace=self._packets.tracer(spec.name, spec.scheme) if trace else None,
            **options,
        )

    async def monitor(self) -> AsyncController:
        """Return the controller object for polling: of the second connection, if there is one.

        Its packets are not in the log, and its calls do not wait for those of the user.

        Raises:
            OrinError: If the connection is not open, or the second connection cannot be opened.
        """
        controller = self.controller
        if not self.allows_second:
            return controller
        async with self._lock:
            if self._second is None:
                self._second = await self.connect_another()
            return self._second

    async def monitored_robot(self) -> AsyncRobot:
        """Return the robot object of :meth:`monitor`.

        Raises:
            OrinError: As :meth:`monitor`; CallError if the controller has no robot.
        """
        if not self.allows_second:
            return await self.robot()
        controller = await self.monitor()
        async with self._lock:
            if self._second_robot is None:
                self._second_robot = await self.robot_of(controller)
            return self._second_robot

    async def stop_motion(self) -> None:
        """Stop the robot (Robot_Halt), even during another call if the transport allows it.

        Raises:
            OrinError: If the robot may not have stopped.
        """
        if self.lent:  # the motion in slave mode is stopped by its owner in Workspace.motions
            return
        try:
            await (await self.monitored_robot()).halt()
        except (NotImplementedCall, ObjectNotFound) as error:
            logger.debug("%s: no robot to stop: %s", self.name, error)
        except StreamError as error:  # slave mode uses the serial line; the motion that entered it is stopped, too
            logger.debug("%s: %s", self.name, error)

    async def _open(self) -> None:
        self._controller = await self.connect_another(trace=True)
        self.objects.begin(self._controller.client, self._controller.handle, self.name)

    async def _close(self) -> None:
        self.objects.end()
        controllers = self._second, self._controller
        self._second = self._second_robot = self._controller = self._robot = None
        for controller in controllers:
            if controller is not None:
                try:
                    await controller.close(deadline=_CLOSE_TIMEOUT)
                except (OrinError, OSError) as error:
                    logger.debug("%s: closing failed: %s", self.name, error)

    async def _check(self) -> None:
        if self.allows_second:
            await (await self.monitor()).get_name()
            return
        # a call would be a packet among those of the user
        path = await asyncio.to_thread(_missing_port, self.spec.url)
        if path:
            raise ConnectionClosed(
                tr(
                    "{path} does not exist any more. Try: plug in the adapter of the serial line, then Connect",
                    path=path,
                )
            )


def _missing_port(url: str) -> str:
    """Return the path of a serial port that does not exist; otherwise ``""``."""
    address = parse_address(url)
    if isinstance(address, SerialAddress) and "/" in address.path and not Path(address.path).exists():
        return address.path
    return ""
