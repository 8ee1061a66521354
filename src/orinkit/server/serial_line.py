"""b-CAP clients on a serial line, server side: on a serial port, or on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, Self, cast

from orinkit.bcap.profiles import LINE, SILENCE
from orinkit.cao.provider import ClientInfo
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.server.context import ServerContext
from orinkit.server.peer import ConnectionlessClient
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.serial.address import PtyAddress, SerialAddress
from orinkit.transport.serial.settings import open_failed, settings

if TYPE_CHECKING:
    from orinkit.server.pseudo_terminal import PseudoTerminal

logger = logging.getLogger("orinkit.server")

REOPENED_EVERY: Final = 1.0
"""Seconds from one try to the next to open a port again that has broken."""

_MOST_WAITING: Final = 16384  # bytes of answers that wait to be sent; those that follow are dropped


class SerialClient(ConnectionlessClient, asyncio.Protocol):
    """Whoever is at the other end of a serial line, one client after the other.

    Args:
        shared: what all clients of the server share.
        loop: the event loop that it lives in.
        path: of the line, for the device and the log.
        lost: is called when the line has broken or has been closed.
    """

    def __init__(
        self,
        shared: ServerContext,
        loop: asyncio.AbstractEventLoop,
        path: str,
        lost: Callable[[Exception | None], None] | None = None,
    ) -> None:
        super().__init__(shared, loop, LINE)
        self._name = self._host = path
        self._lost = lost
        self._full = False
        self.patience = shared.alive
        self._silence: asyncio.TimerHandle | None = None

    # --- the transport calls these ------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The line is open."""
        self._transport = transport = cast("asyncio.WriteTransport", transport)  # some are one by their methods only
        self._is_gone = transport.is_closing
        transport.set_write_buffer_limits(_MOST_WAITING)
        self._shared.all.add(self)
        if self._shared.closing:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Bytes have come, of a client or from nowhere."""
        self._heard = now = self._loop.time()
        self._act(self._conversation.receive(data, now))
        if self._silence is None and self._conversation.pending:
            self._silence = self._loop.call_at(now + SILENCE, self._fallen_silent)

    def pause_writing(self) -> None:
        """Nobody reads, or the line is slow: drop the answers that follow, they are asked for again."""
        self._full = True
        logger.debug("%s does not take its answers", self._name)

    def resume_writing(self) -> None:
        """It takes them again."""
        self._full = False

    def connection_lost(self, exc: Exception | None) -> None:
        """The line has broken, or has been closed: whatever the client held is released."""
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        self._leave(exc)
        self._shared.discard(self)
        if self._lost is not None:
            self._lost(exc)

    # --- the shell ------------------------------------------------------------------------------------------------

    def _send(self, data: bytes | bytearray) -> None:
        if not self._full and not self._transport.is_closing():
            self._transport.write(data)

    def _fallen_silent(self) -> None:
        """A packet has begun; give it up, unless more of it has come meanwhile."""
        self._silence = None
        if self._is_gone() or not self._conversation.pending:
            return
        now = self._loop.time()
        if now < self._heard + SILENCE:
            self._silence = self._loop.call_at(self._heard + SILENCE, self._fallen_silent)
            return
        while self._conversation.pending and not self._is_gone():
            # a packet behind a packet behind noise: none may wait for more bytes
            self._act(self._conversation.timeout(now))

    def _about(self) -> ClientInfo:
        return ClientInfo(self._name, LINE.name, 0, self.drain_input)

    def _rest(self, reason: object = None) -> None:
        """The client has gone: what it has not read is not for the next one."""
        super()._rest(reason)
        self._forget_unsent()

    def give_up(self, reason: str) -> None:
        """The client is taken to have gone; the line goes on."""
        logger.warning("%s: %s", self._name, reason)
        self._conversation.abandon()
        self._rest(reason)

    def close(self) -> None:
        """Close the line once what was written has been taken."""
        self._transport.close()

    def abort(self) -> None:
        """Close the line at once."""
        self._forget_unsent()  # closing a port waits for what it has not sent yet
        self._transport.abort()

    def _forget_unsent(self) -> None:
        port = self._transport.get_extra_info("serial")
        try:
            port.reset_write_buffer()
        except OSError:  # it is broken
            pass


class PortListener:
    """Takes clients on a serial port; one that breaks, as it does when it is pulled out, is opened again.

    Args:
        address: the port.
        shared: what all clients of the server share.
        loop: the event loop that it lives in.

    Attributes:
        url: of the port; a setting is shown if it is not the usual one.
    """

    def __init__(self, address: SerialAddress, shared: ServerContext, loop: asyncio.AbstractEventLoop) -> None:
        self._address = address
        self._shared = shared
        self._loop = loop
        self._closed = False
        self._reopening: asyncio.Task[None] | None = None
        self._transport: asyncio.BaseTransport | None = None
        keep_from_children(self)
        self.url = _url(address)

    @classmethod
    async def open(cls, address: SerialAddress, shared: ServerContext) -> Self:
        """Open the port.

        Raises:
            ConnectFailed: it cannot be opened.
            MissingExtra: serialx is missing.
        """
        listener = cls(address, shared, asyncio.get_running_loop())
        await listener._open_port()
        return listener

    async def _open_port(self) -> None:
        chosen = settings(self._address)
        import serialx

        try:
            self._transport, _ = await serialx.create_serial_connection(
                self._loop,
                lambda: SerialClient(self._shared, self._loop, self._address.path, self._lost),
                self._address.path,
                transport_cls=serialx.SerialTransport,
                **chosen,
            )
        except (OSError, ValueError, RuntimeError, serialx.SerialException) as error:
            raise open_failed(self._address, error) from error

    def _lost(self, error: Exception | None) -> None:
        if not self._closed:
            logger.warning("%s: lost: %s; it is tried to open it again", self.url, error)
            self._reopening = self._loop.create_task(self._open_again())

    async def _open_again(self) -> None:
        while True:
            await asyncio.sleep(REOPENED_EVERY)
            try:
                await self._open_port()
            except ConnectFailed as error:
                logger.debug("%s: %s", self.url, error)
            else:
                logger.info("%s: open again", self.url)
                return

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return () if self._transport is None else (self._transport.get_extra_info("serial").fileno(),)

    async def close(self) -> None:
        """Open the port no more; :class:`SerialClient` closes it."""
        self._closed = True
        if self._reopening is not None:
            self._reopening.cancel()
            await asyncio.wait([self._reopening])


class PtyListener:
    """Takes clients on a pseudo-terminal.

    Attributes:
        url: for clients.
    """

    def __init__(self, terminal: PseudoTerminal) -> None:
        self.url = _url(SerialAddress(terminal.path))

    @classmethod
    async def open(cls, address: PtyAddress, shared: ServerContext) -> Self:
        """Open a pair of pseudo-terminals.

        Raises:
            ConnectFailed: there is none to be had.
        """
        loop = asyncio.get_running_loop()
        try:
            from orinkit.server.pseudo_terminal import PseudoTerminal

            return cls(PseudoTerminal(loop, lambda path: SerialClient(shared, loop, path)))
        except (ImportError, OSError) as error:
            raise ConnectFailed(
                tr(
                    "cannot open {address}: {error}. Try: pseudo-terminals are a thing of Linux and macOS; "
                    "in Windows use a serial port",
                    address=address,
                    error=error,
                )
            ) from error

    async def close(self) -> None:
        """Do nothing: :class:`SerialClient` closes it."""


def _url(address: SerialAddress) -> str:
    whole = str(address)
    return whole.partition("?")[0] if address == SerialAddress(address.path) else whole
