"""Several servers in one event loop, on consecutive ports: :class:`AsyncServerGroup`."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import TypedDict, Unpack

from orinkit.cao.provider import Provider
from orinkit.core.i18n import tr
from orinkit.server.aio_server import DEFAULT_URL, AsyncServer
from orinkit.server.http.options import HttpOptions
from orinkit.server.server_base import ServerBase
from orinkit.transport.address import consecutive_addresses
from orinkit.values.codec import PacketLimits


class ServerParameters(TypedDict, total=False):
    """The keyword parameters of :class:`~orinkit.server.aio_server.AsyncServer`."""

    clients: int
    per_address: int | None
    objects: int
    limits: PacketLimits
    invoke_timeout: float
    dead_after: float
    alive: float
    http: HttpOptions
    serial_packet: int


class AsyncServerGroup(ServerBase):
    """Serves each of several providers on its own port, all in one event loop.

    Each provider has an :class:`~orinkit.server.aio_server.AsyncServer` of its own, with its own limits on clients. The
    clients of all servers share the time of the event loop fairly.

    For many virtual controllers in one process, also let them share the thread of their cycles::

        clock = SharedClock()  # orinkit.virtual.shared_clock
        arms = [VirtualRC8(clock=clock) for _ in range(100)]
        async with AsyncServerGroup(arms, "tcp://127.0.0.1:5007") as group:
            ...  # arm n listens at group.urls[n]: ports 5007 to 5106

    Args:
        providers: the providers, each in the form that ``AsyncServer`` accepts.
        urls: addresses of the first provider, as for ``AsyncServer``; they must have ports. Each further provider
            listens on the next port of each address. Port 0 selects a free port for each provider.
        parameters: further parameters of each ``AsyncServer``.

    Use the group with ``async with``, or call :meth:`start` and :meth:`close`.

    Attributes:
        servers: the servers, in the order of the providers.

    Raises:
        InvalidAddress: If an address is invalid, has no port, or if the ports exceed 65,535.
        ValueError: If there is no provider.
    """

    def __init__(
        self, providers: Iterable[Provider | Iterable[Provider]], *urls: str, **parameters: Unpack[ServerParameters]
    ) -> None:
        served = list(providers)
        if not served:
            raise ValueError(tr("there is no provider to serve"))
        addresses = zip(*(consecutive_addresses(url, len(served)) for url in urls or (DEFAULT_URL,)), strict=True)
        self.servers = [
            AsyncServer(provider, *own, **parameters) for provider, own in zip(served, addresses, strict=True)
        ]

    @property
    def url(self) -> str:
        """The first address of the first server, with its actual port."""
        return self.servers[0].url

    @property
    def urls(self) -> list[str]:
        """The addresses of all servers, with their actual ports, in the order of the providers."""
        return [url for server in self.servers for url in server.urls]

    @property
    def clients(self) -> int:
        """The number of connected clients of all servers."""
        return sum(server.clients for server in self.servers)

    async def start(self) -> None:
        """Listen at every address.

        Raises:
            ConnectFailed: If an address cannot be opened; the addresses already opened are closed again. The providers
                stay open.
            MissingExtra: If a package that HTTP requires is not installed.
        """
        started: list[AsyncServer] = []
        try:
            for server in self.servers:
                await server.start()
                started.append(server)
        except BaseException:
            await asyncio.gather(*(server.stop() for server in started))
            raise

    async def close(self) -> None:
        """Stop listening, disconnect all clients, and close the providers."""
        await asyncio.gather(*(server.close() for server in self.servers))
