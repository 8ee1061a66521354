"""The CAN buses that the clients of one provider share."""

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
"""Seconds that opening a bus may take."""


class SharedBus:
    """A bus that is open, or being opened, and how many clients use it."""

    def __init__(self, key: Key, opening: asyncio.Task[AsyncMotorBus]) -> None:
        self.key = key
        self.users = 0
        self._opening = opening

    @property
    def bus(self) -> AsyncMotorBus:
        """The bus; it is open."""
        return self._opening.result()

    async def opened(self) -> None:
        """Wait until it is open; a client that goes away does not keep others from it."""
        await asyncio.shield(self._opening)

    async def close(self) -> None:
        """Close it, or stop opening it."""
        self._opening.cancel()
        if self._opening.done() and not self._opening.cancelled() and self._opening.exception() is None:
            await self.bus.close()


class Buses:
    """Buses by what they are, however clients spell it.

    Args:
        given: the only one that there is; ``None`` where clients choose.
    """

    def __init__(self, given: str | can.BusABC | None) -> None:
        self._given = given
        self._buses: dict[Key, SharedBus] = {}
        self._closing: dict[Key, asyncio.Task[None]] = {}

    async def enter(self, wanted: DriverSelection) -> SharedBus:
        """Return the bus that a client wants, for :meth:`leave`.

        Raises:
            CallError: E_CAO_REMOTE_PROVIDER: it does not open in time.
            OrinError: it cannot be opened.
        """
        key = wanted.place
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
                    await shared.opened()
                except BaseException:
                    self._drop(shared)
                    raise
        except TimeoutError:
            raise error_for(
                hresult.E_CAO_REMOTE_PROVIDER,
                tr("the bus does not open within {patience:g} s: {bus}", patience=PATIENCE, bus=wanted.bus),
            ) from None
        return shared

    def leave(self, shared: SharedBus) -> None:
        """A client uses it no more; who is the last one closes it, in a task."""
        self._drop(shared)

    def _drop(self, shared: SharedBus) -> None:
        shared.users -= 1
        if shared.users > 0 or self._buses.get(shared.key) is not shared:
            return
        del self._buses[shared.key]
        task = self._closing[shared.key] = asyncio.get_running_loop().create_task(shared.close())
        task.add_done_callback(lambda _: self._closing.pop(shared.key, None))

    async def close(self) -> None:
        """Wait until every bus that nobody uses is closed."""
        if self._closing:
            await asyncio.wait(list(self._closing.values()))


async def _opened(at: str | can.BusABC) -> AsyncMotorBus:
    return await open_bus(at)
