"""The asyncio server: :class:`AsyncServer`."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from types import TracebackType
from typing import Final, Self

from orinkit.cao.provider import Provider
from orinkit.cao.session import ProviderRegistry
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.server.alive_option import ALIVE
from orinkit.server.capacity import DEFAULT_CLIENTS
from orinkit.server.context import Listener, ServerContext
from orinkit.server.http.options import DEFAULT_HTTP, HttpOptions
from orinkit.server.log_limiter import LOG_LIMITER
from orinkit.transport.address import parse_address
from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, resolve, row_of
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

logger = logging.getLogger("orinkit.server")

DEFAULT_URL: Final = "tcp://127.0.0.1:5007"

_GRACE: Final = 1.0  # s for clients to read their last replies and for handlers to end


class AsyncServer:
    """Serves providers on one or several addresses.

    Args:
        providers: one provider or several; clients select one by its provider name.
        urls: addresses to listen at: ``tcp://HOST:PORT``, ``udp://HOST:PORT``, ``serial:///dev/ttyUSB0?baudrate=38400``, or
            ``pty://``, which opens a pair of pseudo-terminals; ``http://HOST:PORT`` or ``https://HOST:PORT`` for e-CAP.
            The default is port 5007 on TCP, on the loopback interface; port 0 selects a free port.
        clients: maximum number of clients. A further client is refused, unless an idle client that holds no object can be
            disconnected.
        per_address: maximum number of clients from one address; by default three quarters of ``clients``, rounded up. All
            addresses of this machine count as one, and so do those of one /64 network of IPv6.
        objects: maximum number of objects of one client.
        limits: bounds on packets.
        invoke_timeout: default limit on the duration of a call, s; a client can set another one.
        dead_after: seconds without a reply from a client's machine after which its TCP connection counts as lost
            (cable pulled, machine off): 2 to 7,200.
        alive: seconds that a client on UDP, on a serial line, or over HTTP without a persistent connection may be silent
            while its motions run and it has no call in progress: 0.5 to 3,600. After that it is disconnected.
        http: access control for HTTP, and the server's certificate for https.

    Use it with ``async with``, or call :meth:`start` and :meth:`close`.

    Attributes:
        urls: every address of the server, with its actual port or path.
    """

    def __init__(
        self,
        providers: Provider | Iterable[Provider],
        *urls: str,
        clients: int = DEFAULT_CLIENTS,
        per_address: int | None = None,
        objects: int = 1000,
        limits: PacketLimits = DEFAULT_LIMITS,
        invoke_timeout: float = 180.0,
        dead_after: float = DEAD_AFTER,
        alive: float = ALIVE,
        http: HttpOptions = DEFAULT_HTTP,
    ) -> None:
        self._http = http
        self._addresses = [_parse_listen_address(url) for url in urls or (DEFAULT_URL,)]
        self._host = ProviderRegistry(providers, objects)
        self._context = ServerContext(self._host, limits, clients, invoke_timeout, dead_after, per_address, alive)
        self._listeners: list[Listener] = []
        self.urls: list[str] = []

    @property
    def url(self) -> str:
        """The first address of the server, with its actual port or path."""
        return self.urls[0]

    @property
    def clients(self) -> int:
        """The number of connected clients."""
        return len(self._context.open)

    async def start(self) -> None:
        """Open every address.

        Raises:
            ConnectFailed: If an address cannot be opened; then none stays open.
            MissingExtra: If a package that serial ports or HTTP require is not installed.
        """
        for address in self._addresses:
            try:
                listener = await _listen(address, self._context, self._http)
            except BaseException:
                await self._stop()  # not close(): the providers may be in use by another server
                raise
            self._listeners.append(listener)
            self.urls.append(listener.url)
            logger.info("listening on %s", listener.url)

    async def close(self) -> None:
        """Stop listening, disconnect all clients, and close the providers."""
        await self._stop()
        for provider in self._host.providers:
            ending = provider.close()
            if ending is not None:
                await ending

    async def _stop(self) -> None:
        self._context.closing = True
        for listener in self._listeners:
            await listener.close()
        self._listeners.clear()
        await self._context.close(_GRACE)
        LOG_LIMITER.report()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


def _parse_listen_address(url: str) -> AnyAddress:
    """Parse an address to listen at.

    Raises:
        InvalidAddress: If it is not an address, or if no server can listen at it (such as a CAN bus).
    """
    address = parse_address(url)
    if not row_of(address).listener:
        raise refused(address)
    return address


async def _listen(address: AnyAddress, context: ServerContext, http: HttpOptions) -> Listener:
    """Open one address."""
    row = row_of(address)
    opened = resolve(row.listener)(address, context, *((http,) if row.http else ()))
    try:
        listener: Listener = await opened
    except ConnectFailed:  # already has its own hint
        raise
    except (OSError, ValueError) as error:
        raise _listen_failed(address, error) from error
    return listener


def _listen_failed(address: AnyAddress, error: Exception) -> ConnectFailed:
    if not hasattr(address, "port"):
        return ConnectFailed(tr("cannot listen on {address}: {error}", address=address, error=error))
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {error}. Try: use another port, or port 0 for a free one",
            address=address,
            error=error,
        )
    )
