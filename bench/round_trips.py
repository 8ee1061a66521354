"""Round trips over TCP, UDP and a pseudo-terminal: a client against a bare socket or a bare port. Part of ``make bench``.

The peers always send the same reply. The client and the bare reference each have their own peer, in a separate process.
"""

from __future__ import annotations

import asyncio
import binascii
import multiprocessing.connection
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import orinkit
from measuring import ROUNDS, in_turn, line, medians, middle, on_core, process
from orinkit import aio, functions
from orinkit.bcap import packet
from orinkit.bcap.requests import encode_request
from orinkit.values import codec

POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]
ARGUMENTS = (3, "slvMove", POSE)
REQUEST = encode_request(functions.robot_execute, ARGUMENTS, 1)
REPLY = packet.pack(1, 0, 1, codec.encode(POSE))
LINE_REQUEST = encode_request(functions.robot_execute, ARGUMENTS, 1, 1, crc=True)
LINE_REPLY = packet.pack(1, 0, 1, codec.encode(POSE), crc=True)
SERIAL = slice(5, 7)


# --- minimal peers ----------------------------------------------------------------------------------------------------


def tcp_peer(pipe: multiprocessing.connection.Connection) -> None:
    """Reply to all data over TCP with the same reply; only the serial number is copied from the request."""
    on_core(-1)
    head, tail = REPLY[: SERIAL.start], REPLY[SERIAL.stop :]
    with socket.create_server(("127.0.0.1", 0)) as listener:
        pipe.send(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        while True:
            peer, _ = listener.accept()
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with peer:
                while data := peer.recv(65536):
                    peer.sendall(head + data[SERIAL] + tail)


def udp_peer(pipe: multiprocessing.connection.Connection) -> None:
    """Reply to all datagrams with the same reply; only the serial number is copied from the request."""
    on_core(-1)
    head, tail = REPLY[: SERIAL.start], REPLY[SERIAL.stop :]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        pipe.send(f"udp://127.0.0.1:{peer.getsockname()[1]}")
        while True:
            data, place = peer.recvfrom(65536)
            peer.sendto(head + data[SERIAL] + tail, place)


def pty_peer(pipe: multiprocessing.connection.Connection) -> None:
    """Reply to all data at one end of a pseudo-terminal with the same reply.

    Only the serial number is copied from the request, and the CRC is computed. The address that is sent to the pipe
    contains the path of the other end.
    """
    import tty  # imported here, because Windows does not have it

    on_core(-1)
    head, tail = LINE_REPLY[1 : SERIAL.start], LINE_REPLY[SERIAL.stop : -3]
    ending = struct.Struct("<HB").pack
    peer, other_end = os.openpty()
    tty.setraw(other_end)
    pipe.send(f"serial://{os.ttyname(other_end)}")  # other_end stays open, so that the line exists without users, too
    while True:
        data = os.read(peer, 4096)
        while len(data) < len(LINE_REQUEST):
            data += os.read(peer, 4096)
        body = head + data[SERIAL] + tail
        os.write(peer, b"\x01" + body + ending(binascii.crc_hqx(body, 0xFFFF), packet.EOT))


# --- the bare references: one exchange of packets of the same sizes ---------------------------------------------------


@contextmanager
def tcp_exchange(url: str, request: bytes = REQUEST) -> Iterator[Callable[[], object]]:
    """Yield an exchange over a plain socket, connected to a peer."""
    host, port = url.removeprefix("tcp://").split(":")
    with socket.create_connection((host, int(port))) as ours:
        ours.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def exchange() -> None:
            ours.sendall(request)
            ours.recv(65536)

        yield exchange


@contextmanager
def udp_exchange(url: str) -> Iterator[Callable[[], object]]:
    """Yield an exchange over a plain datagram socket, connected to a peer."""
    host, port = url.removeprefix("udp://").split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.connect((host, int(port)))

        def exchange() -> None:
            ours.send(REQUEST)
            ours.recv(65536)

        yield exchange


@contextmanager
def pty_exchange(url: str) -> Iterator[Callable[[], object]]:
    """Yield an exchange over a plain port, opened by its path; the peer has set it to raw mode."""
    ours = os.open(url.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY)

    def exchange() -> None:
        os.write(ours, LINE_REQUEST)
        missing = len(LINE_REPLY)
        while missing:  # a reply may arrive in several pieces
            missing -= len(os.read(ours, 4096))

    try:
        yield exchange
    finally:
        os.close(ours)


# --- measuring --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Route:
    """A transport to measure.

    Attributes:
        name: Name of the transport.
        peer: Function that runs the peer; it sends the address of the peer first.
        exchange: Context manager that yields a bare exchange with such a peer.
        aim: Target ratio of the synchronous client, as text.
    """

    name: str
    peer: Callable[[multiprocessing.connection.Connection], None]
    exchange: Callable[[str], AbstractContextManager[Callable[[], object]]]
    aim: str = ""


ROUTES = (
    Route("TCP", tcp_peer, tcp_exchange, "aim <= 1.1"),
    Route("UDP", udp_peer, udp_exchange),
    Route("pty", pty_peer, pty_exchange),
)


def round_trips(count: int) -> None:
    """Measure Robot_Execute with 8 doubles each way, over all transports that this system supports."""
    for route in ROUTES:
        if route.peer is not pty_peer or hasattr(os, "openpty"):
            with process(route.peer) as url, process(route.peer) as bare_url, route.exchange(bare_url) as bare:
                results = [synchronous(url, bare, count) for _ in range(ROUNDS)]
                line(f"{route.name} round trip, 8 doubles each way, sync client", *middle(results), "us", route.aim)
                results = [asyncio.run(asynchronous(url, bare, count)) for _ in range(ROUNDS)]
                line(f"{route.name} round trip, 8 doubles each way, async client", *middle(results), "us")


def synchronous(url: str, bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Alternate calls and bare exchanges; return both medians and their ratio."""
    with orinkit.open_client(url) as client:
        call = client.call
        return in_turn(lambda: call(functions.robot_execute, *ARGUMENTS), bare, count)


async def asynchronous(url: str, bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Alternate calls in asyncio and bare exchanges; return both medians and their ratio."""
    async with aio.open_client(url) as client:
        ours, other = [], []
        for _ in range(count):
            begin = time.perf_counter()
            await client.call(functions.robot_execute, *ARGUMENTS)
            between = time.perf_counter()
            bare()
            ours.append(between - begin)
            other.append(time.perf_counter() - between)
        return medians(ours, other)
