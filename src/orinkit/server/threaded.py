"""A server in a background thread: :func:`serve`. asyncio is imported only when a server is started."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING

from orinkit.bcap.profiles import LONGEST_ON_LINE
from orinkit.cao.provider import Provider
from orinkit.core.thread_server import ThreadServer
from orinkit.server.alive_option import ALIVE
from orinkit.server.capacity import DEFAULT_CLIENTS
from orinkit.server.http.options import DEFAULT_HTTP, HttpOptions
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

if TYPE_CHECKING:
    from typing import Unpack

    from orinkit.server.aio_group import AsyncServerGroup, ServerParameters
    from orinkit.server.aio_server import AsyncServer


class Server(ThreadServer):
    """A server that runs in a background thread; created by :func:`serve` or :func:`serve_many`."""

    def __init__(self, server: AsyncServer | AsyncServerGroup) -> None:
        import asyncio

        from orinkit.server.accepting import install_exception_handler

        self._asyncio = asyncio
        self._server = server
        self._loop = asyncio.new_event_loop()
        install_exception_handler(self._loop)
        self._thread = threading.Thread(target=self._run, name="orinkit-server", daemon=True)
        self._closed = False
        self._thread.start()
        try:
            self._asyncio.run_coroutine_threadsafe(server.start(), self._loop).result()
        except BaseException:
            self._stop()
            raise

    def _run(self) -> None:
        self._asyncio.set_event_loop(self._loop)
        self._loop.run_forever()
        self._loop.close()

    def _stop(self) -> None:
        self._closed = True
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    @property
    def url(self) -> str:
        """The first address of the server, with its actual port or path."""
        return self._server.url

    @property
    def urls(self) -> list[str]:
        """Every address of the server."""
        return list(self._server.urls)

    @property
    def clients(self) -> int:
        """The number of connected clients."""
        return self._server.clients

    def close(self) -> None:
        """Stop listening, disconnect all clients, and close the providers; further calls do nothing."""
        if not self._closed and self._thread.is_alive():
            self._asyncio.run_coroutine_threadsafe(self._server.close(), self._loop).result()
            self._stop()


def serve(
    # Also in server.aio_server: the parameters of public functions are written out, so that help() and editors show them.
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
) -> Server:
    """Serve providers in a background thread until the server is closed; use it in a ``with`` statement.

    The arguments are those of :class:`AsyncServer`.

    Raises:
        InvalidAddress: If a URL cannot be used.
        ConnectFailed: If an address cannot be opened; the addresses already opened are closed again.
        MissingExtra: If a package that serial ports or HTTP require is not installed.
    """
    from orinkit.server.aio_server import AsyncServer

    return Server(
        AsyncServer(
            providers,
            *urls,
            clients=clients,
            per_address=per_address,
            objects=objects,
            limits=limits,
            invoke_timeout=invoke_timeout,
            dead_after=dead_after,
            alive=alive,
            http=http,
            serial_packet=serial_packet,
        )
    )


def serve_many(
    providers: Iterable[Provider | Iterable[Provider]], *urls: str, **parameters: Unpack[ServerParameters]
) -> Server:
    """Serve each provider on its own port, in one background thread; use it in a ``with`` statement.

    The arguments are those of :class:`~orinkit.server.aio_group.AsyncServerGroup`: ``urls`` are the addresses of the
    first provider, and each further provider listens on the next port. ``urls`` of the server contains all addresses.

    Raises:
        InvalidAddress: If a URL cannot be used, has no port, or if the ports exceed 65,535.
        ConnectFailed: If an address cannot be opened; the addresses already opened are closed again.
        MissingExtra: If a package that HTTP requires is not installed.
        ValueError: If there is no provider.
    """
    from orinkit.server.aio_group import AsyncServerGroup

    return Server(AsyncServerGroup(providers, *urls, **parameters))
