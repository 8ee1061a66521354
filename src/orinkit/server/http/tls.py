"""The TLS handshake of an HTTPS connection.

During the handshake, the connection counts towards the limits, because a client may never complete the handshake.
"""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Callable, Iterable
from typing import Final, cast

from orinkit.server.http.limits import ConnectionLimiter, LimitedProtocol
from orinkit.transport.address import network_of
from orinkit.transport.fork_safety import keep_from_children

logger = logging.getLogger("orinkit.server")

_HANDSHAKE_TIMEOUT: Final = 10.0  # s
_SHUTDOWN_TIMEOUT: Final = 2.0  # s


class TlsAcceptor(asyncio.Protocol):
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
        self.network = ""

    has_call = False

    def data_received(self, data: bytes) -> None:
        """Buffer data that arrives before the server begins the handshake."""
        self._early += data

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
        transport.pause_reading()  # has no effect with uvloop, which starts reading after this method
        context.all.add(self)
        self._task = asyncio.get_running_loop().create_task(self._handshake(transport))
        context.tasks.add(self._task)
        self._task.add_done_callback(context.tasks.discard)

    async def _handshake(self, transport: asyncio.Transport) -> None:
        protocol = self._make()
        secured = None
        transport.pause_reading()
        loop = asyncio.get_running_loop()
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
            self._hand_over(transport)
            secured = await securing
        except OSError as error:  # includes TimeoutError and SSLError
            logger.debug("TLS: %s", error)
        finally:
            securing.cancel()
            self._guard.discard(self)
            if secured is None:
                transport.abort()
            else:
                protocol.connection_made(secured)
            self._guard.context.discard(self)

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
