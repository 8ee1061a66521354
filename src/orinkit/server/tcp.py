"""A b-CAP client's TCP connection, server side, and the listener that takes them."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Final, Self, cast

from orinkit.bcap.server import Execute
from orinkit.bcap.wire import STREAM
from orinkit.cao.provider import ClientInfo
from orinkit.server.accepting import ONE_AT_A_TIME, deepen
from orinkit.server.connections import Connections
from orinkit.server.peer import Peer
from orinkit.transport.address import Address
from orinkit.transport.dead_peers import prepare
from orinkit.transport.forks import keep_from_children

_TO_BE_TOLD: Final = 5.0  # seconds in which one client too many may ask once and be told


class TcpConnection(Peer, asyncio.BufferedProtocol):
    """One client on TCP.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB, which costs
    more than everything else that is done for a call.
    """

    def __init__(self, shared: Connections, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(shared, loop, STREAM)
        shared.opening += 1

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self._transport = transport = cast("asyncio.Transport", transport)  # uvloop's are none by their class
        self._send = transport.write
        self._is_gone = transport.is_closing
        prepare(transport.get_extra_info("socket"), self._shared.dead_after)
        host, port = (transport.get_extra_info("peername") or ("", 0))[:2]
        self._place = (host, port)
        self._name = f"{host}:{port}"
        self._host = str(host)
        self._shared.opening -= 1
        keep_from_children(self)
        self._shared.all.add(self)
        if self._shared.closing:
            transport.abort()
        elif self._admit() is None:
            self._alarm = self._loop.call_later(_TO_BE_TOLD, transport.abort)

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - declared by the base
        """Where to put what comes next; all connections share it, for it is read at once."""
        return self._shared.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """The client has sent something."""
        self._act(self._conversation.receive(bytes(self._shared.view[:nbytes]), self._loop.time()))

    def pause_writing(self) -> None:
        """The client does not take its answers: stop listening to it."""
        self._slow = True
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        """It takes them again."""
        self._slow = False
        self._transport.resume_reading()
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._conversation.go_on(self._loop.time())
            self._act(waiting)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone: whatever it held is released."""
        self._leave(exc)
        self._shared.discard(self)

    # --- the shell ------------------------------------------------------------------------------------------------

    def _about(self) -> ClientInfo:
        host, port = self._place
        return ClientInfo(host, STREAM.name, port, self.look)

    def _refuse(self, call: Execute) -> None:
        super()._refuse(call)
        self._transport.close()

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return (self._transport.get_extra_info("socket").fileno(),)

    def close(self) -> None:
        """Close the connection from this side, once what was written has been sent."""
        self._transport.close()

    def abort(self) -> None:
        """Close the connection at once, whatever was to be sent."""
        self._transport.abort()


class TcpListener:
    """Takes clients at one address.

    Attributes:
        url: with the real port.
    """

    def __init__(self, server: asyncio.Server, url: str) -> None:
        self._server = server
        self.url = url
        keep_from_children(self)

    @classmethod
    async def open(cls, address: Address, shared: Connections) -> Self:
        """Listen.

        Raises:
            OSError: the address cannot be used.
            ValueError: the host is no host name.
        """
        loop = asyncio.get_running_loop()
        server = await loop.create_server(
            lambda: TcpConnection(shared, loop), address.host, address.port, backlog=ONE_AT_A_TIME, reuse_address=True
        )
        deepen(server)
        return cls(server, str(address._replace(port=server.sockets[0].getsockname()[1])))

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return [each.fileno() for each in self._server.sockets]

    async def close(self) -> None:
        """Take no more clients."""
        self._server.close()
