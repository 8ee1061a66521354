"""ABH3 motor drivers as a CAO provider, ``CaoProv.Waco.ABH3``: every b-CAP and e-CAP client can turn a motor.

A client says in the option of Controller_Connect which driver it wants::

    Interface=socketcan, Channel=can0, Bitrate=500000, Address=1, Host=2, Group=5

Several clients may read one driver; the first that writes has the command, until it lets go, leaves, or is silent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.api.names import host_of
from orinkit.abh3.provider.buses import Buses, Key
from orinkit.abh3.provider.controller import ABH3Controller
from orinkit.abh3.provider.errors import map_errors
from orinkit.abh3.provider.options import wanted
from orinkit.abh3.provider.variables import Motor
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can


class ABH3Provider(Provider):
    """ABH3 drivers for CAO clients; one server at a time has it.

    Args:
        bus: URL of the only bus that clients get, or a bus of python-can; ``None``: each client says which. Whoever can
            connect to the server can then open every CAN interface of this computer.
        **defaults: what holds where a client says nothing: ``dialect``, and as of :class:`orinkit.abh3.api.names.HostSettings`.
    """

    provider_names: Sequence[str] = ("CaoProv.Waco.ABH3",)

    def __init__(self, bus: str | can.BusABC | None = None, **defaults: Any) -> None:
        self._own_bus: str | bool = bus if isinstance(bus, str) else bus is not None
        self._defaults = defaults
        self._buses = Buses(bus)
        self._holders: dict[tuple[Key, int], ABH3Controller] = {}
        self._clients: set[ABH3Controller] = set()
        self._parting: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def connect(
        self,
        name: str,
        machine: str,  # noqa: ARG002 - declared by the base
        option: str,
        client: ClientInfo,
    ) -> ControllerObject:
        """Return a driver for one client; it is asked whether it is there, and not commanded.

        Raises:
            CallError: E_INVALIDARG: the option cannot be used; E_CAO_REMOTE_PROVIDER: the bus cannot be opened; E_TIMEOUT: the
                driver does not answer.
        """
        self._bind()
        with map_errors():
            known = wanted(option, self._defaults, own_bus=self._own_bus)
            host = host_of(known.dialect, known.settings)
            shared = await self._buses.enter(known)
            motor: Motor = AsyncDriver(shared.bus, host)
            controller = await self._checked(ABH3Controller(name, self, shared, motor, known, client.reason))
        self._clients.add(controller)
        return controller

    async def _checked(self, controller: ABH3Controller) -> ABH3Controller:
        try:
            await controller.motor.errors()
        except BaseException:
            await self._leave(controller)
            raise
        return controller

    async def close(self) -> None:
        """Stop what moves and close every bus."""
        if self._loop is not asyncio.get_running_loop():  # of a server that was refused it
            return
        for controller in list(self._clients):
            controller.release()
        if self._parting:
            await asyncio.wait(list(self._parting))
        await self._buses.close()
        self._loop = None

    def _bind(self) -> None:
        """Be served by one event loop only: buses and motors belong to it.

        Raises:
            CallError: E_FAIL: another server has this provider.
        """
        loop = asyncio.get_running_loop()
        if self._loop is None or self._loop.is_closed():
            self._loop = loop
        elif self._loop is not loop:
            raise error_for(
                hresult.E_FAIL,
                tr("another server has this provider. Try: an ABH3Provider of its own for each server"),
            )

    # --- for controllers ----------------------------------------------------------------------------------------------

    def acquire(self, controller: ABH3Controller) -> None:
        """Give a client the command of its driver.

        Raises:
            CallError: E_ACCESSDENIED: another client has it.
        """
        owner = self._holders.setdefault(controller.key, controller)
        if owner is controller:
            return
        if owner.holding:
            address = controller.motor.address
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr(
                    "another client commands ABH3 {address}. Try: again when that one has said Release, or "
                    "has gone. Stop is carried out all the same",
                    address=address,
                ),
            )
        owner.motor.abandon()  # what it has asked for is not asked for any more, when it goes neither
        self._holders[controller.key] = controller

    def owns(self, controller: ABH3Controller) -> bool:
        """Whether a client has the command of its driver."""
        return self._holders.get(controller.key) is controller

    def owner(self, controller: ABH3Controller) -> ABH3Controller | None:
        """Return the client that has the command of a client's driver now, ``None`` where nobody does."""
        owner = self._holders.get(controller.key)
        return owner if owner is not None and owner.holding else None

    def release(self, controller: ABH3Controller) -> None:
        """Take the command back from a client, if it has it."""
        if self.owns(controller):
            del self._holders[controller.key]

    def disconnect(self, controller: ABH3Controller) -> None:
        """A client has gone: stop its motor if it commands it, close the bus when nobody is left."""
        self._clients.discard(controller)
        task = asyncio.get_running_loop().create_task(self._leave(controller))
        self._parting.add(task)
        task.add_done_callback(self._parting.discard)

    async def _leave(self, controller: ABH3Controller) -> None:
        try:
            if not self.owns(controller):
                controller.motor.abandon()
            await controller.motor.close()
        finally:
            self.release(controller)
            self._buses.leave(controller.shared)
