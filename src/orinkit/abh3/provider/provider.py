"""ABH3 motor drivers as a CAO provider, ``CaoProv.Waco.ABH3``, for b-CAP and e-CAP clients.

A client selects the driver by the option string of Controller_Connect::

    Interface=socketcan, Channel=can0, Bitrate=500000, Address=1, Host=2, Group=5

Several clients may read one driver. The first client that writes gets the right to command the driver. It has this
right until it releases the right, disconnects, or makes no call for its idle time (option ``Idle``).
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.api.names import make_host
from orinkit.abh3.provider.buses import Buses, Key
from orinkit.abh3.provider.controller import ABH3Controller
from orinkit.abh3.provider.errors import map_errors
from orinkit.abh3.provider.options import parse_selection
from orinkit.abh3.provider.variables import Motor
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can


class ABH3Provider(Provider):
    """Serves ABH3 drivers to CAO clients; a provider belongs to one server at a time.

    Args:
        bus: URL of the only bus that clients can use, or a python-can bus. With ``None``, each client selects a bus, so
            every client of the server can open every CAN interface of this computer.
        **defaults: Settings for options that a client omits: ``dialect``, and those of
            :class:`orinkit.abh3.api.names.HostSettings`.
    """

    provider_names: Sequence[str] = ("CaoProv.Waco.ABH3",)
    unwraps_variants: bool = True

    def __init__(self, bus: str | can.BusABC | None = None, **defaults: Any) -> None:
        self._own_bus: str | bool = bus if isinstance(bus, str) else bus is not None
        self._defaults = defaults
        self._buses = Buses(bus)
        self._owners: dict[tuple[Key, int], ABH3Controller] = {}
        self._clients: set[ABH3Controller] = set()
        self._closing: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def connect(
        self,
        name: str,
        machine: str,
        option: str,
        client: ClientInfo,
    ) -> ControllerObject:
        """Return the controller object through which one client uses a driver.

        To check that the driver replies, its error flags are requested. No command is sent.

        Raises:
            CallError: E_INVALIDARG: If the option string is not valid; E_CAO_REMOTE_PROVIDER: If the bus cannot be
                opened; E_TIMEOUT: If the driver does not reply.
        """
        self._bind()
        with map_errors():
            known = parse_selection(option, self._defaults, own_bus=self._own_bus)
            host = make_host(known.dialect, known.settings)
            shared = await self._buses.enter(known)
            motor: Motor = AsyncDriver(shared.bus, host)
            controller = await self._checked(ABH3Controller(name, self, shared, motor, known, client.describe_error))
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
        """Stop all motors and close every bus."""
        if self._loop is not asyncio.get_running_loop():  # called by a server that does not own this provider
            return
        for controller in list(self._clients):
            controller.release()
        if self._closing:
            await asyncio.wait(list(self._closing))
        await self._buses.close()
        self._loop = None

    def _bind(self) -> None:
        """Bind the provider to the running event loop, because its buses and drivers can be used in one loop only.

        Raises:
            CallError: E_FAIL: If another server uses this provider.
        """
        loop = asyncio.get_running_loop()
        if self._loop is None or self._loop.is_closed():
            self._loop = loop
        elif self._loop is not loop:
            raise error_for(
                hresult.E_FAIL,
                tr("another server uses this provider. Try: create one ABH3Provider for each server"),
            )

    # --- for controllers ----------------------------------------------------------------------------------------------

    def acquire(self, controller: ABH3Controller) -> None:
        """Give the client of a controller object the right to command its driver.

        Raises:
            CallError: E_ACCESSDENIED: If another client has this right.
        """
        owner = self._owners.setdefault(controller.key, controller)
        if owner is controller:
            return
        if owner.holding:
            address = controller.motor.address
            raise error_for(
                hresult.E_ACCESSDENIED,
                tr(
                    "another client commands ABH3 {address}. Try: repeat the call after that client has called Release "
                    "or disconnected; Stop is always executed",
                    address=address,
                ),
            )
        owner.motor.relinquish()  # so that no stop is sent when the previous owner disconnects
        self._owners[controller.key] = controller

    def owns(self, controller: ABH3Controller) -> bool:
        """Return True if the client of a controller object has the right to command its driver."""
        return self._owners.get(controller.key) is controller

    def owner(self, controller: ABH3Controller) -> ABH3Controller | None:
        """Return the controller object that commands the driver of ``controller``; ``None`` if there is none."""
        owner = self._owners.get(controller.key)
        return owner if owner is not None and owner.holding else None

    def release(self, controller: ABH3Controller) -> None:
        """Withdraw the right to command from a client, if the client has this right."""
        if self.owns(controller):
            del self._owners[controller.key]

    def disconnect(self, controller: ABH3Controller) -> None:
        """Remove a client: stop the motor if this client commands it, and close the bus after the last client."""
        self._clients.discard(controller)
        task = asyncio.get_running_loop().create_task(self._leave(controller))
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)

    async def _leave(self, controller: ABH3Controller) -> None:
        try:
            if not self.owns(controller):
                controller.motor.relinquish()
            await controller.motor.close()
        finally:
            self.release(controller)
            self._buses.leave(controller.shared)
