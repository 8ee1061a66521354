"""Serving providers in asyncio: :class:`AsyncServer`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from types import TracebackType
from typing import Final, Self

from orinkit.cao.provider import Provider
from orinkit.cao.session import Host
from orinkit.errors import ConnectFailed
from orinkit.language import pick
from orinkit.server.tcp import Connections
from orinkit.transport.address import Address, parse_address
from orinkit.variant_bytes import DEFAULT_LIMITS, Limits

logger = logging.getLogger("orinkit.server")

DEFAULT_URL: Final = "tcp://127.0.0.1:5007"
_BACKLOG: Final = 512
_GRACE: Final = 1.0  # seconds for clients to take their last answers and for handlers to end


class AsyncServer:
    """Serves providers on one or several addresses.

    Args:
        providers: one provider or several; each is reached by its provider names.
        urls: where to listen; loopback and port 5007 unless told otherwise; port 0 takes a free one.
        clients: how many clients at a time.
        objects: how many objects one client may hold.
        limits: bounds on packets.
        invoke_timeout: seconds that a call may take unless the client says otherwise.

    Use it with ``async with``, or call :meth:`start` and :meth:`close`.
    """

    def __init__(
        self,
        providers: Provider | Iterable[Provider],
        *urls: str,
        clients: int = 256,
        objects: int = 1000,
        limits: Limits = DEFAULT_LIMITS,
        invoke_timeout: float = 180.0,
    ) -> None:
        self._addresses = [parse_address(url) for url in urls or (DEFAULT_URL,)]
        self._host = Host(providers, objects)
        self._connections = Connections(self._host, limits, clients, invoke_timeout)
        self._servers: list[asyncio.Server] = []
        self.urls: list[str] = []

    @property
    def url(self) -> str:
        """The first address that is served, with its real port."""
        return self.urls[0]

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._connections.open)

    async def start(self) -> None:
        """Open every address.

        Raises:
            ConnectFailed: one cannot be opened; none is then.
        """
        for address in self._addresses:
            try:
                await self._listen(address)
            except BaseException:
                await self._stop()  # the providers stay as they are: they may be served elsewhere
                raise

    async def _listen(self, address: Address) -> None:
        loop = asyncio.get_running_loop()
        try:
            server = await loop.create_server(
                self._connections.make, address.host, address.port, backlog=_BACKLOG, reuse_address=True
            )
        except (OSError, ValueError) as error:
            raise ConnectFailed(
                pick(
                    f"cannot listen on {address}: {error}. Try: another port, or port 0 for a free one",
                    f"{address} で待ち受けできません: {error}。対処: 別のポートか、空きポートを選ぶ 0 を指定してください",
                )
            ) from error
        self._servers.append(server)
        port = server.sockets[0].getsockname()[1]
        self.urls.append(str(Address(address.scheme, address.host, port)))
        logger.info("listening on %s", self.urls[-1])

    async def close(self) -> None:
        """Stop listening, let every client go, close the providers."""
        await self._stop()
        for provider in self._host.providers:
            provider.close()

    async def _stop(self) -> None:
        await self._connections.refuse()
        for server in self._servers:
            server.close()
        self._servers.clear()
        await self._connections.close(_GRACE)

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
