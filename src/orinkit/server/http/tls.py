"""The TLS handshake of an HTTPS connection.

During the handshake, the connection counts towards the limits, because a client may never complete the handshake. The
expensive part of the handshake, which follows from the first data of the client, is a step of the loop's
:class:`~orinkit.server.fair_queue.FairQueue`.
"""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Callable, Iterable
from typing import Final, cast

from orinkit.server.fair_queue import QueuedClient, queue_of
from orinkit.server.http.connection_limiter import ConnectionLimiter
from orinkit.server.http.limits import LimitedProtocol
from orinkit.transport.address import network_of
from orinkit.transport.fork_safety import keep_from_children

logger = logging.getLogger("orinkit.server")

_HANDSHAKE_TIMEOUT: Final = 10.0  # s
_COST: Final = 0.001  # s; a rough upper limit of the time that the expensive part takes
_SHUTDOWN_TIMEOUT: Final = 2.0  # s


class TlsAcceptor(QueuedClient, asyncio.Protocol):
    """A connection during the TLS handshake.

    Args:
        guard: the connection limiter.
        tls_context: the TLS context, with the certificate.
        make: factory of the protocol that is used after the handshake.
    """

    def __init__(
        self, guard: ConnectionLimiter, tls_context: ssl.SSLContext, make: Callable[[], LimitedProtocol]
    ) -> None:
        self._guard = guard
        self._tls_context = tls_context
        self._make = make
        self._transport: asyncio.Transport | None = None
        self._early = bytearray()
        self._begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.network = ""

    has_call = False

    def data_received(self, data: bytes) -> None:
        """Buffer data that arrives before the server begins the handshake."""
        self._early += data
        if not self._begun.done():
            self._begun.set_result(None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Handle that the client has disconnected without sending any data."""
        if not self._begun.done():
            self._begun.set_result(None)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the handshake, or refuse the connection."""
        self._transport = transport = cast("asyncio.Transport", transport)  # uvloop's class is not a subclass of it
        keep_from_children(self)
        self.network = network_of(str((transport.get_extra_info("peername") or ("",))[0]))
        context = self._guard.context
        context.opening -= 1
        if context.closing or not self._guard.admit(self):
            transport.abort()
            return
        context.all.add(self)
        self._task = asyncio.get_running_loop().create_task(self._handshake(transport))
        context.tasks.add(self._task)
        self._task.add_done_callback(context.tasks.discard)

    async def _handshake(self, transport: asyncio.Transport) -> None:
        protocol = self._make()
        secured = None
        try:
            async with asyncio.timeout(_HANDSHAKE_TIMEOUT):
                await self._begun
            if not transport.is_closing():
                secured = await self._secure(transport, protocol)
        except OSError as error:  # includes TimeoutError and SSLError
            logger.debug("TLS: %s", error)
        finally:
            self._guard.discard(self)
            if secured is None:
                transport.abort()
            else:
                protocol.connection_made(secured)
            self._guard.context.discard(self)

    async def _secure(self, transport: asyncio.Transport, protocol: LimitedProtocol) -> asyncio.Transport | None:
        """Install the TLS protocol, pass it the first data when it is the client's turn, and complete the handshake."""
        loop = asyncio.get_running_loop()
        transport.pause_reading()
        securing = loop.create_task(
            loop.start_tls(
                transport,
                protocol,
                self._tls_context,
                server_side=True,
                ssl_handshake_timeout=_HANDSHAKE_TIMEOUT,
                ssl_shutdown_timeout=_SHUTDOWN_TIMEOUT,
            )
        )
        try:
            await asyncio.sleep(0)  # start_tls schedules connection_made of the TLS protocol, and resume_reading
            await asyncio.sleep(0)  # now both have run, and nothing has been read yet
            transport.pause_reading()  # further data must follow the first data
            queue_of(loop).serve(self, _COST)
            return await securing
        finally:
            securing.cancel()

    def step(self) -> bool:
        """Pass the first data of the client to the TLS protocol."""
        assert self._transport is not None
        self._hand_over(self._transport)
        self._transport.resume_reading()
        return False

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptor that a forked child replaces by the null device."""
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    def _hand_over(self, transport: asyncio.Transport) -> None:
        """Pass the data that was received before the handshake to the TLS protocol."""
        tls = cast("asyncio.BufferedProtocol", transport.get_protocol())
        early, self._early = memoryview(self._early), bytearray()
        while early and not transport.is_closing():
            room = memoryview(tls.get_buffer(len(early)))[: len(early)]
            room[:] = early[: len(room)]
            tls.buffer_updated(len(room))
            early = early[len(room) :]

    def close(self) -> None:
        """Close the connection."""
        self.abort()

    def abort(self) -> None:
        """Close the connection immediately."""
        self._task.cancel()
        if self._transport is not None:  # a task that is cancelled before it begins does not close the transport
            self._transport.abort()
        self._guard.discard(self)
        self._guard.context.discard(self)
