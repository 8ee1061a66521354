"""The CAN buses shared by the clients of one provider."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final, TypeAlias

from orinkit.abh3.aio import AsyncMotorBus, open_bus
from orinkit.abh3.provider.options import BusKey, DriverSelection
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can

Key: TypeAlias = BusKey | None
PATIENCE: Final = 10.0
"""Time-out for opening a bus, in s."""


class SharedBus:
    """A bus that is open or being opened, with the number of clients that use it."""

    def __init__(self, key: Key, opening: asyncio.Task[AsyncMotorBus]) -> None:
        self.key = key
        self.users = 0
        self._opening = opening

    @property
    def bus(self) -> AsyncMotorBus:
        """The bus, which must be open."""
        return self._opening.result()

    async def wait_opened(self) -> None:
        """Wait until the bus is open.

        If the client disconnects during this wait, the bus is still opened for the other clients that wait for it.
        """
        await asyncio.shield(self._opening)

    async def close(self) -> None:
        """Close the bus, or cancel its opening."""
        self._opening.cancel()
        if self._opening.done() and not self._opening.cancelled() and self._opening.exception() is None:
            await self.bus.close()


class Buses:
    """The open buses of a provider, by their keys.

    All spellings of the address of a bus have the same key, so that clients with different spellings share the bus.

    Args:
        given: The only bus of the server; ``None`` if clients select buses.
    """

    def __init__(self, given: str | can.BusABC | None) -> None:
        self._given = given
        self._buses: dict[Key, SharedBus] = {}
        self._closing: dict[Key, asyncio.Task[None]] = {}

    async def enter(self, wanted: DriverSelection) -> SharedBus:
        """Return the bus that a client selected; the caller must release it with :meth:`leave`.

        Raises:
            CallError: E_CAO_REMOTE_PROVIDER: If the bus does not open within :data:`PATIENCE`.
            OrinError: If the bus cannot be opened.
        """
        key = wanted.bus_key
        try:
            async with asyncio.timeout(PATIENCE):
                if key in self._closing:
                    await asyncio.shield(self._closing[key])
                shared = self._buses.get(key)
                if shared is None:
                    task = asyncio.create_task(_opened(str(wanted.bus) if self._given is None else self._given))
                    shared = self._buses[key] = SharedBus(key, task)
                shared.users += 1
                try:
                    await shared.wait_opened()
                except BaseException:
                    self._drop(shared)
                    raise
        except TimeoutError:
            raise error_for(
                hresult.E_CAO_REMOTE_PROVIDER,
                tr("the bus did not open within {patience:g} s: {bus}", patience=PATIENCE, bus=wanted.bus),
            ) from None
        return shared

    def leave(self, shared: SharedBus) -> None:
        """Release a bus. After the last client has released it, a task closes it."""
        self._drop(shared)

    def _drop(self, shared: SharedBus) -> None:
        shared.users -= 1
        if shared.users > 0 or self._buses.get(shared.key) is not shared:
            return
        del self._buses[shared.key]
        task = self._closing[shared.key] = asyncio.get_running_loop().create_task(shared.close())
        task.add_done_callback(lambda _: self._closing.pop(shared.key, None))

    async def close(self) -> None:
        """Wait until every unused bus is closed."""
        if self._closing:
            await asyncio.wait(list(self._closing.values()))


async def _opened(at: str | can.BusABC) -> AsyncMotorBus:
    return await open_bus(at)
