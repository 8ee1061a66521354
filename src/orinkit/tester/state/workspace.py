"""Everything that the pages of the Tester share: :class:`Workspace`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Protocol

from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.connection_text import StringHistory
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.controls import Controls
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.profiles import ProfileStore
from orinkit.tester.state.simulators import Simulators
from orinkit.tester.state.slave_moves import SlaveMoves

logger = logging.getLogger("orinkit.tester")

MAX_CONNECTIONS: Final = 16


class ActiveMotion(Protocol):
    """A motion that a page has started: jogging, Slave Move, a running ABH3 driver."""

    async def stop(self, reason: str) -> None:
        """Decelerate within the limits and stop; return at standstill.

        Args:
            reason: Why, for the user.
        """


class Workspace:
    """The state of a running Tester.

    Attributes:
        packets: The packets of all connections.
        profiles: The saved connections.
        strings: The connection strings that were used.
        simulators: The virtual controllers that were started here.
        controls: Who may operate.
        motions: The motions that pages have started; a motion adds itself and removes itself at standstill.
        slave_moves: The latest Slave Move of each connection.
    """

    def __init__(self, profiles: Path | None = None) -> None:
        self.packets = PacketLog()
        self.profiles = ProfileStore(profiles)
        self.strings = StringHistory(self.profiles.path.with_name("connection-strings.json"))
        self.simulators = Simulators()
        self.controls = Controls()
        self.motions: set[ActiveMotion] = set()
        self.slave_moves = SlaveMoves(self.motions.add, self.motions.discard)
        self._connections: dict[str, Connection] = {}

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._connections.values()))

    def get(self, name: str) -> Connection | None:
        """Return the connection with a name, if there is one."""
        return self._connections.get(name)

    def add(self, spec: ConnectionSpec) -> Connection:
        """Add a connection, which is not opened yet.

        Raises:
            InvalidAddress, InvalidValue: If a parameter is invalid, the name exists, or there are too many connections.
        """
        spec.check()
        if spec.name in self._connections:
            raise InvalidValue(tr("a connection named {name} exists. Try: another name", name=spec.name))
        if len(self._connections) >= MAX_CONNECTIONS:
            raise InvalidValue(tr("at most {most} connections are possible. Try: remove one", most=MAX_CONNECTIONS))
        kind = DriverConnection if spec.is_can else ControllerConnection
        connection = self._connections[spec.name] = kind(spec, self.packets)
        return connection

    async def remove(self, connection: Connection) -> None:
        """Close and remove a connection."""
        self._connections.pop(connection.name, None)
        await connection.close()

    async def start_simulator(self, key: str, *options: str) -> Connection:
        """Start a virtual controller and connect to it.

        Raises:
            OrinError: If it does not start, or connecting fails.
        """
        simulator = await self.simulators.start(key, *options)
        name, number = simulator.spec.name, 1
        while name in self._connections:
            number += 1
            name = f"{simulator.spec.name} ({number})"
        connection = self.add(simulator.spec.renamed(name))
        connection.simulator = simulator
        await connection.open()
        return connection

    async def stop_all(self, reason: str) -> list[str]:
        """Stop all motions: those of the pages, and with Robot_Halt those of all connected robots.

        Args:
            reason: Why, for the user.

        Returns:
            One text for each stop that failed.
        """
        stops = [each.stop(reason) for each in list(self.motions)]
        halts = [each.stop_motion() for each in self if each.is_open]
        outcomes = await asyncio.gather(*stops, *halts, return_exceptions=True)
        problems = [f"{each}" for each in outcomes if isinstance(each, Exception)]
        for problem in problems:
            logger.warning("stop: %s", problem)
        return problems

    async def close(self) -> None:
        """Stop all motions, close all connections, and end the virtual controllers."""
        await asyncio.gather(*(each.stop(tr("the Tester ends")) for each in list(self.motions)), return_exceptions=True)
        for connection in self:
            try:
                await connection.close()
            except OrinError as error:
                logger.debug("closing %s failed: %s", connection.name, error)
        self.slave_moves.close()
        await self.simulators.stop_all()
