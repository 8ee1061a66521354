"""A connection to an ABH3 motor driver on a CAN bus: :class:`DriverConnection`."""

from __future__ import annotations

import logging
from time import monotonic
from typing import Any, Final

from orinkit.abh3 import aio as abh3
from orinkit.abh3.aio import AsyncDriver, AsyncMotorBus
from orinkit.abh3.api.common import HostSettings
from orinkit.abh3.table import ids
from orinkit.abh3.table.decoder import DP0R, Decoder
from orinkit.abh3.table.ids import FrameId
from orinkit.abh3.table.signals import Dialect, dialect_of
from orinkit.can.aio_shared_bus import AsyncCanReceiver
from orinkit.can.frame import CanFrame
from orinkit.core.errors import ConnectionClosed, DriverTimeout, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.driver_monitor import DriverMonitor
from orinkit.tester.state.frame_log import EchoFilter, FrameLog
from orinkit.tester.state.packet_log import PacketLog
from orinkit.transport.address import CanAddress, parse_address

logger = logging.getLogger("orinkit.tester")

_STANDSTILL: Final = 10.0  # s
_TRIES: Final = 2  # requests without reply after which a driver counts as lost
_HEARD: Final = 1.0  # s since the latest frame of the driver during which it is not asked
_ECHOING: Final = ("udp_multicast",)  # interfaces that return the frames that are sent
_FEEDBACK: Final = ids.pgn(ids.SINGLE, 0)


class DriverConnection(Connection):
    """A connection to an ABH3 motor driver.

    Attributes:
        frames: All frames that were sent and received.
        decoder: Decoder of these frames.
        monitor: The values of the driver, for all pages.
    """

    def __init__(self, spec: ConnectionSpec, packets: PacketLog) -> None:
        super().__init__(spec, packets)
        self._bus: AsyncMotorBus | None = None
        self._driver: AsyncDriver[Any, Any] | None = None
        self._port: AsyncCanReceiver | None = None
        self._polling: set[bytes] = set()
        self._silent = 0
        address = parse_address(spec.url)
        self._echoes = EchoFilter() if isinstance(address, CanAddress) and address.interface in _ECHOING else None
        self.frames = FrameLog()
        self.decoder = Decoder(spec.dialect)
        self.monitor = DriverMonitor(self)

    @property
    def dialect(self) -> Dialect:
        """The dialect of the driver."""
        return dialect_of(self.spec.dialect)

    @property
    def driver(self) -> AsyncDriver[Any, Any]:
        """The driver object.

        Raises:
            ConnectionClosed: If the connection is not open.
        """
        if self._driver is None:
            raise ConnectionClosed(tr("{name} is not connected. Try: Connect on the page Connections", name=self.name))
        return self._driver

    async def request(self, name: str) -> None:
        """Request a frame of the driver, and wait for it; :attr:`monitor` then has its values.

        A request for a broadcast does not wait for the calls of users, and they do not wait for it.

        Args:
            name: Name of the frame: ``"DP0R"``, or ``"BR0"`` to ``"BR6"``.

        Raises:
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        driver, port = self.driver, self._port
        assert port is not None
        layout = self.dialect.layouts[name]
        group = driver.host.group
        pgn = _FEEDBACK if name == DP0R else ids.pgn(ids.BROADCAST, ids.broadcast_number(layout.broadcast, group))
        self._polling.add(pgn)
        try:
            if layout.broadcast is None:
                await driver.request_single(0)  # one after the other with commands, because the reply is the same
            else:
                await driver.bus.run(driver.host.request(layout.broadcast), port, revive=False)
        finally:
            self._polling.discard(pgn)

    async def stop_motion(self) -> None:
        """Decelerate to standstill, then switch all inputs off.

        Raises:
            OrinError: If the driver does not reply, or the motors still turn after 10 s; their servo is then still on.
        """
        driver = self.driver
        await driver.stop_and_wait(_STANDSTILL)
        await driver.init()

    async def _open(self) -> None:
        spec = self.spec
        self._silent = 0
        self._bus = await abh3.open_bus(spec.url)
        self._bus.trace = self._trace
        try:
            settings: HostSettings = {"address": spec.driver}
            if spec.timeout:
                settings["timeout"] = spec.timeout / 1000
            self._driver = self._bus.driver(dialect=spec.dialect, **settings)
            self._port = self._bus.port_for(self._driver.host)
            await self._driver.init()
        except BaseException:
            await self._close()
            raise

    async def _close(self) -> None:
        bus, self._bus, self._driver, self._port = self._bus, None, None, None
        if bus is not None:
            try:
                await bus.close()  # stops the driver if it may be moving
            except (OrinError, OSError) as error:
                logger.debug("%s: closing failed: %s", self.name, error)
        self.monitor.forget()

    async def _check(self) -> None:
        """Raise an exception if the bus is lost, or the driver has not replied repeatedly."""
        if monotonic() - self.monitor.heard < _HEARD:
            self._silent = 0
            return
        try:
            await self.request(DP0R)
            self._silent = 0
        except DriverTimeout:
            self._silent += 1
            if self._silent >= _TRIES:
                raise

    def _trace(self, direction: str, frame: CanFrame) -> None:
        if direction == ">":
            if self._echoes is not None:
                self._echoes.sent(frame)
            self.frames.add(">", frame, polled=self._is_request(frame))
            self.decoder.decode(frame)  # requests show which node is the host
            return
        if self._echoes is not None and self._echoes.is_echo(frame):
            return
        decoded = self.decoder.decode(frame)
        if self._driver is not None and decoded.source == self._driver.address:
            self.frames.add("<", frame, polled=self._is_reply(frame))
            self.monitor.note(decoded)
        else:
            self.frames.add("<", frame)

    def _is_request(self, frame: CanFrame) -> bool:
        return frame.id >> 16 & 0xFF == ids.REQUEST and frame.data in self._polling

    def _is_reply(self, frame: CanFrame) -> bool:
        parts = FrameId.parse(frame.id)
        return ids.pgn(parts.pf, parts.ps if parts.pf == ids.BROADCAST else 0) in self._polling
