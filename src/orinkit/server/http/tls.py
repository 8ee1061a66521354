"""A connection over HTTPS before it is one of TLS: bounded like all others, as a handshake may never end."""

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
    """A connection that is yet to become one of TLS. Counted too, as the handshake may never end.

    Args:
        guard: counts it.
        context: with the certificate.
        make: makes the protocol that follows.
    """

    def __init__(self, guard: ConnectionLimiter, context: ssl.SSLContext, make: Callable[[], LimitedProtocol]) -> None:
        self._guard = guard
        self._context = context
        self._make = make
        self._transport: asyncio.Transport | None = None
        self._early = bytearray()
        self.network = ""

    at_work = False

    def data_received(self, data: bytes) -> None:
        """The handshake has begun sooner than this side of it."""
        self._early += data

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self._transport = transport = cast("asyncio.Transport", transport)  # uvloop's are none by their class
        keep_from_children(self)
        self.network = network_of(str((transport.get_extra_info("peername") or ("",))[0]))
        shared = self._guard.shared
        shared.opening -= 1
        if shared.closing or not self._guard.admit(self):
            transport.abort()
            return
        transport.pause_reading()  # uvloop begins to read behind this method, and passes over it
        shared.all.add(self)
        self._task = asyncio.get_running_loop().create_task(self._shake_hands(transport))
        shared.tasks.add(self._task)
        self._task.add_done_callback(shared.tasks.discard)

    async def _shake_hands(self, transport: asyncio.Transport) -> None:
        protocol = self._make()
        secured = None
        transport.pause_reading()
        loop = asyncio.get_running_loop()
        securing = loop.create_task(
            loop.start_tls(
                transport,
                protocol,
                self._context,
                server_side=True,
                ssl_handshake_timeout=_HANDSHAKE_TIMEOUT,
                ssl_shutdown_timeout=_SHUTDOWN_TIMEOUT,
            )
        )
        try:
            await asyncio.sleep(0)  # start_tls has the loop introduce TLS to the connection and read on
            await asyncio.sleep(0)  # that is done; nothing has been read yet
            self._hand_over(transport)
            secured = await securing
        except OSError as error:  # TimeoutError and SSLError are some
            logger.debug("TLS: %s", error)
        finally:
            securing.cancel()
            self._guard.discard(self)
            if secured is None:
                transport.abort()
            else:
                protocol.connection_made(secured)
            self._guard.shared.discard(self)

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    def _hand_over(self, transport: asyncio.Transport) -> None:
        """Give TLS what came before it was there."""
        tls = cast("asyncio.BufferedProtocol", transport.get_protocol())
        early, self._early = memoryview(self._early), bytearray()
        while early and not transport.is_closing():
            room = memoryview(tls.get_buffer(len(early)))[: len(early)]
            room[:] = early[: len(room)]
            tls.buffer_updated(len(room))
            early = early[len(room) :]

    def close(self) -> None:
        """Close it."""
        self.abort()

    def abort(self) -> None:
        """Close it at once."""
        self._task.cancel()
        if self._transport is not None:  # a task that has not begun yet does nothing more, and would leave it open
            self._transport.abort()
        self._guard.discard(self)
        self._guard.shared.discard(self)
