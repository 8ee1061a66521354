"""An additional transport, Unix domain sockets: ``unix:///run/controller``; requires one module and one table row."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import dataclass, replace
from typing import ClassVar

from orinkit.bcap.profiles import STREAM
from orinkit.server.accepting import ONE_AT_A_TIME, start
from orinkit.server.context import ServerContext
from orinkit.server.tcp import TcpConnection, TcpListener
from orinkit.transport.address import bad_address
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.registry import LinkOptions, ServeOption, SplitAddress, Transport
from orinkit.transport.sockets.aio_tcp import AsyncTcpLink
from orinkit.transport.sockets.socket_link import SocketLink

CARRIER = replace(STREAM, name="unix")


@dataclass(frozen=True)
class UnixAddress:
    scheme: ClassVar[str] = "unix"
    path: str

    def __str__(self) -> str:
        return f"unix://{self.path}"


def parse(given: SplitAddress) -> UnixAddress:
    if not given.rest.startswith("/"):
        raise bad_address(given.text, "an absolute path is needed", given.scheme)
    return UnixAddress(given.rest)


def open_link(address: UnixAddress, opening: LinkOptions) -> SocketLink:
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.settimeout(opening.seconds)
        connection.connect(address.path)
    except OSError as error:
        connection.close()
        raise connect_failed(address, error) from error
    return SocketLink(connection)


async def open_aio_link(address: UnixAddress, opening: LinkOptions) -> AsyncTcpLink:
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(opening.seconds):
            _, link = await loop.create_unix_connection(lambda: AsyncTcpLink(opening.dead_after), address.path)
    except OSError as error:
        raise connect_failed(address, error) from error
    return link


def adopt(descriptor: int) -> SocketLink:
    return SocketLink(socket.socket(fileno=descriptor))


async def listen(address: UnixAddress, context: ServerContext) -> TcpListener:
    loop = asyncio.get_running_loop()
    server = await loop.create_unix_server(
        lambda: TcpConnection(context, loop, CARRIER), address.path, backlog=ONE_AT_A_TIME, start_serving=False
    )
    await start(server)
    return TcpListener(server, str(address))


HERE = "support.unix_transport"
UNIX = Transport(
    "unix",
    parse=f"{HERE}:parse",
    example="unix:///run/controller",
    profile=f"{HERE}:CARRIER",
    link=f"{HERE}:open_link",
    aio_link=f"{HERE}:open_aio_link",
    adopt=f"{HERE}:adopt",
    listener=f"{HERE}:listen",
    option=ServeOption("Path of a Unix domain socket to listen on."),
)
