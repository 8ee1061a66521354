"""The connections of the Tester: :class:`Connection` is the base class."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from typing import Final

from orinkit.core.errors import CallError, ConnectFailed, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.simulators import Simulator

logger = logging.getLogger("orinkit.tester")

_WATCH: Final = 1.0  # s between two checks whether an idle connection still exists


class ConnectionState(Enum):
    """State of a connection."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    OPEN = "open"
    LOST = "lost"


class Connection(ABC):
    """A connection to a controller or a motor driver, which all pages share.

    Args:
        spec: The parameters.
        packets: The log of all packets.

    Attributes:
        spec: The parameters.
        state: The state.
        error: Why connecting failed, or the connection was lost; otherwise ``None``.
        version: Counts the changes of the state, so that a page can detect them.
        simulator: The virtual controller that the Tester has started for this connection; ``None`` if there is none.
    """

    def __init__(self, spec: ConnectionSpec, packets: PacketLog) -> None:
        self.spec = spec
        self.state = ConnectionState.CLOSED
        self.error: Exception | None = None
        self.version = 0
        self.simulator: Simulator | None = None
        self._packets = packets
        self._watcher: asyncio.Task[None] | None = None
        self._changes: list[Callable[[], None]] = []

    @property
    def name(self) -> str:
        """The name of the connection."""
        return self.spec.name

    @property
    def is_open(self) -> bool:
        """True if the connection is open."""
        return self.state is ConnectionState.OPEN

    async def open(self) -> None:
        """Connect; disconnect first if the connection is open.

        Raises:
            OrinError: If connecting fails; :attr:`error` is then the exception.
        """
        await self.close()
        self._set(ConnectionState.CONNECTING)
        try:
            self._check_simulator()
            await self._open()
        except BaseException as error:
            self._set(ConnectionState.CLOSED, error if isinstance(error, Exception) else None)
            raise
        self._set(ConnectionState.OPEN)
        self._watcher = asyncio.create_task(self._watch())

    async def close(self) -> None:
        """Disconnect; do nothing if the connection is closed."""
        watcher, self._watcher = self._watcher, None
        if watcher is not None and watcher is not asyncio.current_task():
            watcher.cancel()
        await self._close()
        if self.state is not ConnectionState.CLOSED:
            self._set(ConnectionState.CLOSED)

    def on_change(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Register a callback for changes of the state; return a function that removes it."""
        self._changes.append(callback)
        return lambda: self._changes.remove(callback)

    def _check_simulator(self) -> None:
        """Check that the virtual controller still runs; another program may have got its address meanwhile.

        Raises:
            ConnectFailed: If it has ended.
        """
        if self.simulator is not None and not self.simulator.running:
            raise ConnectFailed(tr("{name} has ended. Try: start another virtual controller", name=self.name))

    @abstractmethod
    async def stop_motion(self) -> None:
        """Stop the robot or the motors of this connection.

        Raises:
            OrinError: If it may not have stopped.
        """

    @abstractmethod
    async def _open(self) -> None: ...

    @abstractmethod
    async def _close(self) -> None: ...

    @abstractmethod
    async def _check(self) -> None:
        """Raise an exception if the connection is lost."""

    async def _watch(self) -> None:
        """Detect the loss of an idle connection."""
        while True:
            await asyncio.sleep(_WATCH)
            try:
                await self._check()
            except CallError:
                continue
            except (OrinError, OSError) as error:
                logger.warning("%s: connection lost: %s", self.name, error)
                await self.close()
                self._set(ConnectionState.LOST, error)
                return

    def _set(self, state: ConnectionState, error: Exception | None = None) -> None:
        self.state, self.error = state, error
        self.version += 1
        for callback in list(self._changes):
            callback()
