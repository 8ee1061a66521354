"""A virtual ABH3 of this process that records what it receives, and a Tester's connection to it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

from orinkit.abh3.table import ids
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import DP0S
from orinkit.can.frame import CanFrame
from orinkit.can.server import PSEUDO_TERMINAL, serve_can
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.packet_log import PacketLog
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.in_thread import run_in_thread
from support.waiting import PATIENCE


class RecordedDriver(VirtualABH3):
    """A virtual driver that keeps the frames that it receives.

    Attributes:
        received: The frames.
        mute: True if the driver neither receives nor sends.
    """

    def __init__(self, **parameters: Any) -> None:
        super().__init__(Parameters(**parameters))
        self._codec = Codec()
        self.received: list[CanFrame] = []
        self.mute = False

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        if self.mute:
            return []
        self.received.append(frame)
        return super().receive(frame)

    @property
    def commands(self) -> list[DP0S]:
        """The commands that were received (dialect v1)."""
        frames = [frame for frame in list(self.received) if frame.id >> 16 & 0xFF == ids.SINGLE]
        return [self._codec.read(DP0S, "DP0S", frame.data) for frame in frames]

    @property
    def requests(self) -> list[bytes]:
        """The PGNs that were requested."""
        return [bytes(frame.data) for frame in list(self.received) if frame.id >> 16 & 0xFF == ids.REQUEST]

    @property
    def stopped(self) -> bool:
        """True if the latest command is 0, start and servo are off, and the motors stand still."""
        state = self.state()
        last = self.commands[-1]
        return (last.ay_command, last.bx_command, last.inputs.value) == (0, 0, 0) and not state.moving


@contextmanager
def served_driver(**parameters: Any) -> Iterator[tuple[RecordedDriver, str]]:
    """Serve a driver on a bus of its own; yield it with the address of the bus."""
    driver = RecordedDriver(**parameters)
    with serve_can(driver, at=PSEUDO_TERMINAL) as server:
        yield driver, server.url


async def soon(condition: Callable[[], object]) -> None:
    """Wait until a condition is true."""
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - the condition has no event
            await asyncio.sleep(0.005)


def with_connection(url: str, test: Callable[[DriverConnection], Awaitable[None]], **settings: Any) -> None:
    """Run a test with an open connection of a Tester."""

    async def run() -> None:
        connection = DriverConnection(ConnectionSpec("abh3", url, timeout=10_000, **settings), PacketLog())
        await connection.open()
        try:
            await test(connection)
        finally:
            await connection.close()

    run_in_thread(run())
