"""Serving providers in asyncio: :class:`AsyncServer`."""

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
from orinkit.server.log_limiter import THROTTLE
from orinkit.transport.address import parse_address
from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, resolve, row_of
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

logger = logging.getLogger("orinkit.server")

DEFAULT_URL: Final = "tcp://127.0.0.1:5007"

_GRACE: Final = 1.0  # seconds for clients to take their last answers and for handlers to end


class AsyncServer:
    """Serves providers on one or several addresses.

    Args:
        providers: one provider or several; each is reached by its provider names.
        urls: where to listen: ``tcp://HOST:PORT``, ``udp://HOST:PORT``, ``serial:///dev/ttyUSB0?baudrate=38400``, or
            ``pty://``, which opens a pair of pseudo-terminals; ``http://HOST:PORT`` or ``https://HOST:PORT`` for e-CAP.
            Loopback and port 5007 on TCP unless told otherwise; port 0 takes a free one.
        clients: how many clients at a time. One more is refused, unless one makes way for it that is idle and holds nothing.
        per_address: how many of them from one address; three quarters by default, rounded up. All of this machine's count as
            one, and those of one /64 network of IPv6.
        objects: how many objects one client may hold.
        limits: bounds on packets.
        invoke_timeout: seconds that a call may take unless the client says otherwise.
        dead_after: seconds without an answer from a client's machine after which its TCP connection counts as lost
            (cable pulled, machine off): 2 to 7,200.
        alive: seconds that a client on UDP, on a serial line, or over HTTP without a connection that is kept may be silent
            while its motions run and no call of it is at work: 0.5 to 3,600. Then it is taken to have gone.
        http: who is let in over HTTP, and the server's certificate for https.

    Use it with ``async with``, or call :meth:`start` and :meth:`close`.

    Attributes:
        urls: every address that is served, with its real port or path.
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
        self._addresses = [_place(url) for url in urls or (DEFAULT_URL,)]
        self._host = ProviderRegistry(providers, objects)
        self._connections = ServerContext(self._host, limits, clients, invoke_timeout, dead_after, per_address, alive)
        self._listeners: list[Listener] = []
        self.urls: list[str] = []

    @property
    def url(self) -> str:
        """The first address that is served, with its real port or path."""
        return self.urls[0]

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._connections.open)

    async def start(self) -> None:
        """Open every address.

        Raises:
            ConnectFailed: one cannot be opened; none is then.
            MissingExtra: a package is not there that serial ports, or HTTP, need.
        """
        for address in self._addresses:
            try:
                listener = await _listen(address, self._connections, self._http)
            except BaseException:
                await self._stop()  # the providers stay as they are: they may be served elsewhere
                raise
            self._listeners.append(listener)
            self.urls.append(listener.url)
            logger.info("listening on %s", listener.url)

    async def close(self) -> None:
        """Stop listening, let every client go, close the providers."""
        await self._stop()
        for provider in self._host.providers:
            ending = provider.close()
            if ending is not None:
                await ending

    async def _stop(self) -> None:
        self._connections.closing = True
        for listener in self._listeners:
            await listener.close()
        self._listeners.clear()
        await self._connections.close(_GRACE)
        THROTTLE.report()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


def _place(url: str) -> AnyAddress:
    """Read where to listen.

    Raises:
        InvalidAddress: it is no address, or one where no server can listen, as a CAN bus.
    """
    address = parse_address(url)
    if not row_of(address).listener:
        raise refused(address)
    return address


async def _listen(address: AnyAddress, shared: ServerContext, http: HttpOptions) -> Listener:
    """Open one address."""
    row = row_of(address)
    opened = resolve(row.listener)(address, shared, *((http,) if row.http else ()))
    try:
        listener: Listener = await opened
    except ConnectFailed:  # it is not the port that is wrong
        raise
    except (OSError, ValueError) as error:
        raise _failed(address, error) from error
    return listener


def _failed(address: AnyAddress, error: Exception) -> ConnectFailed:
    if not hasattr(address, "port"):
        return ConnectFailed(tr("cannot listen on {address}: {error}", address=address, error=error))
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {error}. Try: another port, or port 0 for a free one",
            address=address,
            error=error,
        )
    )
