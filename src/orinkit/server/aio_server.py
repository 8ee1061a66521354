"""The asyncio server: :class:`AsyncServer`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from errno import EADDRNOTAVAIL
from socket import gaierror
from typing import Final

from orinkit.bcap.profiles import LONGEST_ON_LINE
from orinkit.cao.provider import Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.server.alive_option import ALIVE
from orinkit.server.capacity import DEFAULT_CLIENTS
from orinkit.server.context import Listener, ServerContext
from orinkit.server.fair_queue import queue_of
from orinkit.server.http.options import DEFAULT_HTTP, HttpOptions
from orinkit.server.log_limiter import LOG_LIMITER
from orinkit.server.server_base import ServerBase
from orinkit.transport.address import parse_address
from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, resolve, row_of
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

logger = logging.getLogger("orinkit.server")

DEFAULT_URL: Final = "tcp://127.0.0.1:5007"

_GRACE: Final = 1.0  # s; time for clients to read their last replies, and for handlers to end


class AsyncServer(ServerBase):
    """Serves providers on one or several addresses.

    Args:
        providers: one provider or several; clients select one by its provider name. All servers in an event loop share
            its time fairly among their clients. If all providers of a server require a secret, its clients that have
            sent the secret are served first.
        urls: addresses to listen at. For b-CAP: ``tcp://HOST:PORT``, ``udp://HOST:PORT``,
            ``serial:///dev/ttyUSB0?baudrate=38400``, or ``pty://``, which opens a pair of pseudo-terminals. For e-CAP:
            ``http://HOST:PORT`` or ``https://HOST:PORT``. The default is port 5007 on TCP, on the loopback interface.
            Port 0 selects a free port.
        clients: maximum number of clients. If it is reached, an idle client that holds no object is disconnected to
            make room for a new client; if there is no such client, the new client is refused.
        per_address: maximum number of clients from one address; by default three quarters of ``clients``, rounded up.
            All addresses of this machine count as one address. All addresses of a /64 network of IPv6 also count as
            one.
        objects: maximum number of objects of one client.
        limits: limits on the size of received packets and on the values in them.
        invoke_timeout: default limit on the duration of a call, s; a client can set another one.
        dead_after: time in s after which a TCP connection counts as lost if the client's machine does not reply (cable
            unplugged, machine switched off): 2 to 7,200.
        alive: time in s during which a client without a persistent connection (UDP, serial line, or HTTP without
            keep-alive) may be silent while its motions run and it has no call in progress: 0.5 to 3,600. After this
            time, the client is disconnected.
        http: access control for HTTP, and the server's certificate for https.
        serial_packet: limit on the bytes of a packet on a serial line, 128 to 65,536. DENSO's libraries accept 503
            bytes, and drop longer replies. With this limit, a longer reply is E_TOO_MUCH_DATA.

    Use the server with ``async with``, or call :meth:`start` and :meth:`close`.

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
        serial_packet: int = LONGEST_ON_LINE,
    ) -> None:
        self._http = http
        self._addresses = [_parse_listen_address(url) for url in urls or (DEFAULT_URL,)]
        self._host = ProviderRegistry(providers, objects)
        self._context = ServerContext(
            self._host, limits, clients, invoke_timeout, dead_after, per_address, alive, serial_packet
        )
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
        """Listen at every address.

        Raises:
            ConnectFailed: If an address cannot be opened; the addresses already opened are closed again.
            MissingExtra: If a package that serial ports or HTTP require is not installed.
        """
        queue_of(asyncio.get_running_loop())  # not with the first client, so that clients leave no objects behind
        for address in self._addresses:
            try:
                listener = await _listen(address, self._context, self._http)
            except BaseException:
                await self.stop()  # not close(), because another server may use the providers
                raise
            self._listeners.append(listener)
            self.urls.append(listener.url)
            logger.info("listening on %s", listener.url)

    async def close(self) -> None:
        """Stop listening, disconnect all clients, and close the providers."""
        await self.stop()
        for provider in self._host.providers:
            ending = provider.close()
            if ending is not None:
                await ending

    async def stop(self) -> None:
        """Stop listening and disconnect all clients; the providers stay open."""
        self._context.closing = True
        for listener in self._listeners:
            await listener.close()
        self._listeners.clear()
        await self._context.close(_GRACE)
        LOG_LIMITER.report()


def _parse_listen_address(url: str) -> AnyAddress:
    """Parse an address to listen at.

    Raises:
        InvalidAddress: If the URL is not an address, or if no server can listen at the address (for example a CAN bus).
    """
    address = parse_address(url)
    if not row_of(address).listener:
        raise refused(address)
    return address


async def _listen(address: AnyAddress, context: ServerContext, http: HttpOptions) -> Listener:
    """Listen at one address, and return the listener."""
    row = row_of(address)
    opened = resolve(row.listener)(address, context, *((http,) if row.http else ()))
    try:
        listener: Listener = await opened
    except ConnectFailed:  # its message already contains a remedy
        raise
    except (OSError, ValueError) as error:
        raise _listen_failed(address, error) from error
    return listener


def _listen_failed(address: AnyAddress, error: Exception) -> ConnectFailed:
    if not hasattr(address, "port"):
        return ConnectFailed(tr("cannot listen on {address}: {error}", address=address, error=error))
    if isinstance(error, gaierror | ValueError) or (isinstance(error, OSError) and error.errno == EADDRNOTAVAIL):
        return ConnectFailed(
            tr(
                "cannot listen on {address}: {error}. Try: HOST:PORT with an address of this machine",
                address=address,
                error=error,
            )
        )
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {error}. Try: use another port, or port 0 for a free one",
            address=address,
            error=error,
        )
    )
