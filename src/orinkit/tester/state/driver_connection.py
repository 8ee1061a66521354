"""A connection to an ABH3 motor driver on a CAN bus: :class:`DriverConnection`."""

from __future__ import annotations

from typing import Any

from orinkit.abh3 import aio as abh3
from orinkit.abh3.api._async.driver import AsyncDriver
from orinkit.core.errors import ConnectionClosed
from orinkit.core.i18n import tr
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.packet_log import PacketLog


class DriverConnection(Connection):
    """A connection to an ABH3 motor driver."""

    def __init__(self, spec: ConnectionSpec, packets: PacketLog) -> None:
        super().__init__(spec, packets)
        self._driver: AsyncDriver[Any, Any] | None = None

    @property
    def driver(self) -> AsyncDriver[Any, Any]:
        """The driver object.

        Raises:
            ConnectionClosed: If the connection is not open.
        """
        if self._driver is None:
            raise ConnectionClosed(tr("{name} is not connected. Try: Connect on the page Connections", name=self.name))
        return self._driver

    async def stop_motion(self) -> None:
        """Set the commands and inputs of the driver to 0.

        Raises:
            OrinError: If the driver does not reply.
        """
        await self.driver.init()

    async def _open(self) -> None:
        self._driver = await abh3.connect(self.spec.url, dialect=self.spec.dialect, address=self.spec.driver)

    async def _close(self) -> None:
        driver, self._driver = self._driver, None
        if driver is not None:
            await driver.close()

    async def _check(self) -> None:
        """Do nothing: the page polls the driver while it is displayed."""
