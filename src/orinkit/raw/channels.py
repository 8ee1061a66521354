"""The links of the raw roles in asyncio: they carry bytes of any kind, and report where they came from."""

from __future__ import annotations

import asyncio
from typing import Any, Final, Protocol, TypeAlias, cast

from orinkit.core.errors import ConnectFailed, ConnectionLost, OrinError
from orinkit.core.i18n import tr
from orinkit.raw.options import RawOptions, Role
from orinkit.transport.address import Address
from orinkit.transport.aio_links import open_link
from orinkit.transport.link_errors import lost
from orinkit.transport.registry import LinkOptions
from orinkit.transport.runner import AsyncLink

_CHUNK: Final = 65536
_POLL: Final = 3600.0  # s; a link that receives nothing is asked again

Peer: TypeAlias = str
"""``HOST:PORT`` of the other side, or the address of the controller."""


class Receiver(Protocol):
    """Receives the events of a channel."""

    def received(self, peer: Peer, data: bytes) -> None:
        """Handle received bytes; a datagram is one piece."""

    def connected(self, peer: Peer) -> None:
        """Handle a new peer."""

    def disconnected(self, peer: Peer, error: OrinError | None) -> None:
        """Handle the end of a connection; ``error`` is the reason if it was not closed regularly."""


class Channel(Protocol):
    """A link, or a listener with its clients.

    Attributes:
        url: Address of the controller, or the address that a server listens on.
    """

    url: str

    async def send(self, peer: Peer, data: bytes) -> None:
        """Send bytes to a peer.

        Raises:
            TransportError: If the connection to the peer is lost.
        """

    async def close(self) -> None:
        """Close all connections."""


async def open_channel(options: RawOptions, receiver: Receiver) -> Channel:
    """Open the link or the listener.

    Raises:
        ConnectFailed: If it cannot be opened.
        MissingExtra: If the package for serial ports is not installed.
    """
    match options.role:
        case Role.TCP_SERVER:
            return await TcpServerChannel.open(options, receiver)
        case Role.UDP_SERVER:
            return await UdpServerChannel.open(options, receiver)
    link = await open_link(options.address, LinkOptions(options.timeout))
    return ClientChannel(link, str(options.address), receiver)


class ClientChannel:
    """A link to a controller: TCP, UDP or a serial line."""

    def __init__(self, link: AsyncLink, url: str, receiver: Receiver) -> None:
        self.url = url
        self._link = link
        self._receiver = receiver
        receiver.connected(url)
        self._task = asyncio.create_task(self._pump())

    async def _pump(self) -> None:
        error: OrinError | None = None
        try:
            while True:
                data = await self._link.receive(_POLL)
                if data == b"":
                    break
                if data:
                    self._receiver.received(self.url, data)
        except OrinError as reason:
            error = reason
        self._link.close()
        self._receiver.disconnected(self.url, error)

    async def send(self, peer: Peer, data: bytes) -> None:
        """Send bytes to the controller."""
        self._link.send(data)
        await asyncio.sleep(0)

    async def close(self) -> None:
        """Close the link."""
        self._link.close()
        self._task.cancel()
        await asyncio.wait([self._task])


class TcpServerChannel:
    """A TCP server with a limited number of clients."""

    def __init__(self, options: RawOptions, receiver: Receiver) -> None:
        self.url = ""
        self._receiver = receiver
        self._most = options.clients
        self._timeout = options.timeout
        self._server: asyncio.Server | None = None
        self._clients: dict[Peer, asyncio.StreamWriter] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    @classmethod
    async def open(cls, options: RawOptions, receiver: Receiver) -> TcpServerChannel:
        """Listen on the address of the options."""
        channel = cls(options, receiver)
        address = cast("Address", options.address)
        try:
            channel._server = await asyncio.start_server(channel._serve, address.host, address.port)
        except OSError as error:
            raise _listen_failed(options, error) from error
        channel.url = _url("tcp", channel._server.sockets[0].getsockname())
        return channel

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = cast("asyncio.Task[None]", asyncio.current_task())
        self._tasks.add(task)
        peer = _place(writer.get_extra_info("peername"))
        try:
            if len(self._clients) < self._most:
                self._clients[peer] = writer
                self._receiver.connected(peer)
                await self._read(peer, reader)
        except asyncio.CancelledError:
            pass  # close() ends the tasks
        finally:
            self._clients.pop(peer, None)
            self._tasks.discard(task)
            writer.transport.abort()

    async def _read(self, peer: Peer, reader: asyncio.StreamReader) -> None:
        error: OrinError | None = None
        try:
            while data := await reader.read(_CHUNK):
                self._receiver.received(peer, data)
        except OSError as reason:
            error = lost(reason)
        self._receiver.disconnected(peer, error)

    async def send(self, peer: Peer, data: bytes) -> None:
        """Send bytes to a client; a client that does not read them within the time-out is disconnected."""
        writer = self._clients.get(peer)
        if writer is None:
            raise lost(tr("the client {peer} has disconnected", peer=peer))
        try:
            writer.write(data)
            async with asyncio.timeout(self._timeout):
                await writer.drain()
        except OSError as error:  # TimeoutError is an OSError
            writer.transport.abort()
            raise lost(error if str(error) else tr("the peer does not read the data sent to it")) from error

    async def close(self) -> None:
        """Stop listening and disconnect all clients."""
        assert self._server is not None
        self._server.close()
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._server.wait_closed()


class UdpServerChannel(asyncio.DatagramProtocol):
    """A UDP socket that receives datagrams from any sender."""

    def __init__(self, receiver: Receiver) -> None:
        self.url = ""
        self._receiver = receiver
        self._transport: asyncio.DatagramTransport | None = None
        self._known: tuple[Peer, Any] | None = None

    @classmethod
    async def open(cls, options: RawOptions, receiver: Receiver) -> UdpServerChannel:
        """Open a socket at the address of the options."""
        address = cast("Address", options.address)
        loop = asyncio.get_running_loop()
        try:
            _, channel = await loop.create_datagram_endpoint(
                lambda: cls(receiver), local_addr=(address.host, address.port)
            )
        except OSError as error:
            raise _listen_failed(options, error) from error
        return channel

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        self._transport = cast("asyncio.DatagramTransport", transport)
        self.url = _url("udp", transport.get_extra_info("sockname"))

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Report a datagram; the latest sender is the peer."""
        peer = _place(addr)
        if self._known is None or self._known[0] != peer:
            self._known = peer, addr
            self._receiver.connected(peer)
        if data:
            self._receiver.received(peer, data)

    def error_received(self, exc: Exception) -> None:
        """Ignore the error of one datagram: its receiver no longer listens."""

    async def send(self, peer: Peer, data: bytes) -> None:
        """Send a datagram to the latest sender."""
        if self._transport is None or self._transport.is_closing() or self._known is None or self._known[0] != peer:
            raise lost(tr("the client {peer} has disconnected", peer=peer))
        try:
            self._transport.sendto(data, self._known[1])
        except OSError as error:
            raise lost(error) from error
        await asyncio.sleep(0)

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()
        await asyncio.sleep(0)  # the event loop closes the socket


def no_peer() -> ConnectionLost:
    """Return the exception for a server without clients."""
    return ConnectionLost(tr("no client has connected yet. Try: wait for a client"))


def _place(address: Any) -> Peer:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _url(scheme: str, address: Any) -> str:
    return str(Address(scheme, *address[:2]))


def _listen_failed(options: RawOptions, error: OSError) -> ConnectFailed:
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {reason}. Try: another port, and an address of this machine",
            address=options.address,
            reason=error.strerror or error,
        )
    )
