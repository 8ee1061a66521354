"""b-CAP server on a serial line: a serial port or a pseudo-terminal."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Final, Self, cast

from orinkit.bcap.actions import Action
from orinkit.bcap.profiles import LINE, SILENCE
from orinkit.cao.provider import ClientInfo
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.server.connectionless import ConnectionlessClient
from orinkit.server.context import ServerContext
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.serial.address import PtyAddress, SerialAddress
from orinkit.transport.serial.settings import open_failed, settings

if TYPE_CHECKING:
    from orinkit.server.pseudo_terminal import PseudoTerminal

logger = logging.getLogger("orinkit.server")

REOPENED_EVERY: Final = 1.0
"""Seconds between attempts to reopen a port that has failed."""

_MAX_UNSENT: Final = 16384  # bytes of unsent replies above which further replies are dropped


class SerialClient(ConnectionlessClient, asyncio.Protocol):
    """The client at the other end of a serial line; after it has disconnected, another client may use the line.

    Args:
        context: the state shared by all clients of the server.
        loop: the event loop of the line.
        path: path of the line, for the provider and the log.
        lost: callback invoked with the error when the line has failed, or with ``None`` when the line has been closed.
    """

    def __init__(
        self,
        context: ServerContext,
        loop: asyncio.AbstractEventLoop,
        path: str,
        lost: Callable[[Exception | None], None] | None = None,
    ) -> None:
        super().__init__(context, loop, context.line)
        self._name = self._host = path
        self._lost = lost
        self._full = False
        self.default_silence_limit = context.alive
        self._silence: asyncio.TimerHandle | None = None

    # --- the transport calls these ------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Handle the opening of the line."""
        self._transport = transport = cast(
            "asyncio.Transport", transport
        )  # the classes of some transports are not subclasses of it
        self._is_closing = transport.is_closing
        transport.set_write_buffer_limits(_MAX_UNSENT)
        self._context.all.add(self)
        if self._context.closing:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Process received bytes, packets or noise: now, or when it is the client's turn; until then, stop reading."""
        self._process(data, self._loop.time())
        if self._waiting:
            self._transport.pause_reading()

    def _on_processed(self) -> None:
        if self._silence is None and self._conversation.discardable_bytes and not self._is_closing():
            # The silence begins now: if reading was paused, the rest of the packet may have been received meanwhile.
            self._silence = self._loop.call_later(SILENCE, self._on_silence)
        self._transport.resume_reading()

    def pause_writing(self) -> None:
        """Drop further replies, because the client does not read them or the line is slow.

        The client repeats its requests.
        """
        self._full = True
        logger.debug("%s does not read its replies", self._name)

    def resume_writing(self) -> None:
        """Send replies again."""
        self._full = False

    def connection_lost(self, exc: Exception | None) -> None:
        """Release the client's objects after the line has failed or has been closed."""
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        self._waiting.clear()
        self._leave(exc)
        self._context.discard(self)
        if self._lost is not None:
            self._lost(exc)

    # --- methods of Peer ------------------------------------------------------------------------------------------

    def _send(self, data: bytes | bytearray) -> None:
        if not self._full and not self._transport.is_closing():
            self._transport.write(data)

    def _on_silence(self) -> None:
        """Discard an incomplete packet, unless more of it has been received meanwhile."""
        self._silence = None
        if self._is_closing() or self._waiting or not self._conversation.discardable_bytes:
            return  # if bytes are waiting, the timer starts again after they are processed
        now = self._loop.time()
        if now < self._heard + SILENCE:
            self._silence = self._loop.call_at(self._heard + SILENCE, self._on_silence)
            return
        self._waiting.append(self._discard_incomplete(now))
        self._continue()

    def _discard_incomplete(self, now: float) -> Iterator[Action]:
        """Yield the actions for the packets that follow an incomplete one.

        Noise may be followed by several complete packets; all of them must be found now, without further bytes.
        """
        while self._conversation.discardable_bytes:
            yield from self._conversation.discard_incomplete(now)

    def _about(self) -> ClientInfo:
        return ClientInfo(self._name, LINE.name, 0, self.when_input_processed, disconnect=self.disconnect)

    def _end_session(self, reason: object = None) -> None:
        """Close the session and drop unsent replies, which the next client must not receive."""
        super()._end_session(reason)
        self._drop_unsent()

    def _end_served_session(self, reason: object = None) -> None:
        super()._end_session(reason)

    def give_up(self, reason: str) -> None:
        """Close the session of an unreachable client; the line stays open."""
        logger.warning("%s: %s", self._name, reason)
        self._conversation.abandon()
        self._end_session(reason)

    def close(self) -> None:
        """Close the line after pending data has been sent."""
        self._transport.close()

    def abort(self) -> None:
        """Close the line immediately."""
        self._drop_unsent()  # unsent data would delay the closing of the port
        self._transport.abort()

    def _drop_unsent(self) -> None:
        port = self._transport.get_extra_info("serial")
        try:
            port.reset_write_buffer()
        except OSError:  # the port has failed
            pass


class PortListener:
    """Serves a serial port; if the port fails, for example because it was unplugged, reopens it.

    Args:
        address: the port.
        context: the state shared by all clients of the server.
        loop: the event loop of the port.

    Attributes:
        url: the URL of the port, with the settings that differ from the defaults.
    """

    def __init__(self, address: SerialAddress, context: ServerContext, loop: asyncio.AbstractEventLoop) -> None:
        self._address = address
        self._context = context
        self._loop = loop
        self._closed = False
        self._reopening: asyncio.Task[None] | None = None
        self._transport: asyncio.BaseTransport | None = None
        keep_from_children(self)
        self.url = _url(address)

    @classmethod
    async def open(cls, address: SerialAddress, context: ServerContext) -> Self:
        """Open the port.

        Raises:
            ConnectFailed: If the port cannot be opened.
            MissingExtra: If serialx is not installed.
        """
        listener = cls(address, context, asyncio.get_running_loop())
        await listener._open_port()
        return listener

    async def _open_port(self) -> None:
        chosen = settings(self._address)
        import serialx

        try:
            self._transport, _ = await serialx.create_serial_connection(
                self._loop,
                lambda: SerialClient(self._context, self._loop, self._address.path, self._lost),
                self._address.path,
                transport_cls=serialx.SerialTransport,
                **chosen,
            )
        except (OSError, ValueError, RuntimeError, serialx.SerialException) as error:
            raise open_failed(self._address, error) from error

    def _lost(self, error: Exception | None) -> None:
        if not self._closed:
            logger.warning("%s: lost: %s; trying to reopen the port", self.url, error)
            self._reopening = self._loop.create_task(self._reopen())

    async def _reopen(self) -> None:
        while True:
            await asyncio.sleep(REOPENED_EVERY)
            try:
                await self._open_port()
            except ConnectFailed as error:
                logger.debug("%s: %s", self.url, error)
            else:
                logger.info("%s: reopened", self.url)
                return

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptor that a forked child replaces by the null device."""
        return () if self._transport is None else (self._transport.get_extra_info("serial").fileno(),)

    async def close(self) -> None:
        """Stop reopening the port; :class:`SerialClient` closes the port."""
        self._closed = True
        if self._reopening is not None:
            self._reopening.cancel()
            await asyncio.wait([self._reopening])


class PtyListener:
    """Serves a pseudo-terminal.

    Attributes:
        url: the URL for clients.
    """

    def __init__(self, terminal: PseudoTerminal) -> None:
        self.url = _url(SerialAddress(terminal.path))

    @classmethod
    async def open(cls, address: PtyAddress, context: ServerContext) -> Self:
        """Open a pair of pseudo-terminals.

        Raises:
            ConnectFailed: If no pseudo-terminal is available.
        """
        loop = asyncio.get_running_loop()
        try:
            from orinkit.server.pseudo_terminal import PseudoTerminal

            return cls(PseudoTerminal(loop, lambda path: SerialClient(context, loop, path)))
        except (ImportError, OSError) as error:
            raise ConnectFailed(
                tr(
                    "cannot open {address}: {error}. Try: on Windows use a serial port; "
                    "pseudo-terminals exist only on Linux and macOS",
                    address=address,
                    error=error,
                )
            ) from error

    async def close(self) -> None:
        """Do nothing, because :class:`SerialClient` closes the pseudo-terminal."""


def _url(address: SerialAddress) -> str:
    whole = str(address)
    return whole.partition("?")[0] if address == SerialAddress(address.path) else whole
