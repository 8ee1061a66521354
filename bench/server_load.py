"""The server under load, beside a bare echo in asyncio: requests per second, and 100 clients at 125 Hz.

Both servers run in separate processes on the last core; the clients are plain sockets in this process.
"""

from __future__ import annotations

import asyncio
import multiprocessing.connection
import os
import selectors
import socket
import statistics
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import orinkit
from measuring import on_core, process
from orinkit import functions
from orinkit.bcap import packet
from packets import encode_request
from results import Results
from served import PROVIDER, BenchProvider

SETUP = (
    encode_request(functions.service_start, (), 1),
    encode_request(functions.controller_connect, ("", PROVIDER, "localhost", ""), 2),
    encode_request(functions.controller_get_variable, (2, "D1", ""), 3),
)
GET = encode_request(functions.variable_get_value, (3,), 4)
LATE = 0.008  # s
TIMEOUT = struct.pack(
    "ll", 20, 0
)  # s, us: of the kernel, because a time-out of Python adds a system call to each recv()
CLIENTS, RATE = 100, 125.0
RATE_GOALS = {1: 25_000, 50: 60_000}
CPU_GOAL = 40.0  # % of a core
ROUNDS = 3
MOST_SKIPPED = 0.02  # share of the requests that may be skipped if the CPU time is to count


def server(pipe: multiprocessing.connection.Connection) -> None:
    """Serve the provider; send the process ID and the port."""
    on_core(-1)
    with orinkit.serve(BenchProvider(), "tcp://127.0.0.1:0", per_address=344) as running:
        pipe.send(f"{os.getpid()} {running.url.rpartition(':')[2]}")
        pipe.recv()


class _Echo(asyncio.Protocol):
    """Reply to all data with the same data."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.data_received = transport.write  # type: ignore[method-assign]  # the echo needs nothing else


def echo(pipe: multiprocessing.connection.Connection) -> None:
    """Run a bare echo; send the process ID and the port."""
    on_core(-1)

    async def serve() -> None:
        listening = await asyncio.get_running_loop().create_server(_Echo, "127.0.0.1", 0)
        pipe.send(f"{os.getpid()} {listening.sockets[0].getsockname()[1]}")
        await listening.serve_forever()

    asyncio.run(serve())


@contextmanager
def peer_of(target: Callable[[multiprocessing.connection.Connection], None]) -> Iterator[tuple[int, int]]:
    """Run a server in a separate process; yield its process ID and port."""
    with process(target) as text:
        pid, port = text.split()
        yield int(pid), int(port)


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process in s (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def opened(ports: Sequence[int], setup: Sequence[bytes] = ()) -> Iterator[list[socket.socket]]:
    """Yield a connection to each port, after the requests of ``setup`` have been answered.

    Raises:
        RuntimeError: If the server answered one of them with an error.
        BlockingIOError: If the server does not reply within 20 s; ``recv`` of the connections raises it, too.
    """
    peers: list[socket.socket] = []
    try:
        for port in ports:
            peers.append(socket.create_connection(("127.0.0.1", port)))
            peers[-1].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            peers[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, TIMEOUT)
            for request in setup:
                peers[-1].sendall(request)
                code = packet.decode(peers[-1].recv(65536)).code
                if code & 0x8000_0000:
                    raise RuntimeError(f"the server returned 0x{code & 0xFFFF_FFFF:08X}")
        yield peers
    finally:
        for peer in peers:
            peer.close()


def rate(port: int, connections: int, seconds: float, setup: Sequence[bytes]) -> float:
    """Keep one request in progress on each connection; return the replies per second."""
    with opened([port] * connections, setup) as peers:
        done, begin = 0, time.perf_counter()
        while time.perf_counter() - begin < seconds:
            for peer in peers:
                peer.sendall(GET)
            for peer in peers:
                peer.recv(65536)
            done += connections
        return done / (time.perf_counter() - begin)


@dataclass(frozen=True, slots=True)
class Polled:
    """Result of clients that poll.

    Attributes:
        delays: Time of each reply after its request, s.
        share: CPU time of the server, % of a core.
        skipped: Number of requests that were not sent, because the previous reply had not arrived.
    """

    delays: list[float]
    share: float
    skipped: int

    @property
    def late(self) -> int:
        """The number of replies that were later than 8 ms, and of requests that were not sent."""
        return sum(delay > LATE for delay in self.delays) + self.skipped

    @property
    def complete(self) -> bool:
        """True if nearly all requests were answered; otherwise, the CPU time is that of less work."""
        return self.skipped <= MOST_SKIPPED * len(self.delays)

    def note(self) -> str:
        """Return the delays as text."""
        times = sorted(self.delays)
        unanswered = "" if self.complete else f", {self.skipped} requests were not sent or answered"
        return f"{len(times)} replies{unanswered}, p50 {times[len(times) // 2] * 1e3:.2f}, longest {times[-1] * 1e3:.2f} ms"


def poll(peers: list[socket.socket], pid: int, frequency: float, seconds: float, request: bytes = GET) -> Polled:
    """Send requests on all connections at a fixed frequency, one connection after the other within each period."""
    clock, count = time.perf_counter, len(peers)
    waiting: dict[socket.socket, float] = {}
    delays: list[float] = []
    skipped = 0
    with selectors.DefaultSelector() as selector:
        for peer in peers:
            selector.register(peer, selectors.EVENT_READ, peer)
        before, begin, number = cpu_seconds(pid), clock(), 0
        total = round(frequency * seconds * count)
        while number < total or (waiting and clock() < begin + seconds + 1):
            due = begin + number / (frequency * count)
            if number < total and clock() >= due:
                peer = peers[number % count]
                number += 1
                if peer in waiting:
                    skipped += 1
                else:
                    waiting[peer] = clock()
                    peer.send(request)
            for key, _ in selector.select(0):
                key.data.recv(65536)
                delays.append(clock() - waiting.pop(key.data))
        share = (cpu_seconds(pid) - before) / (clock() - begin) * 100
    return Polled(delays, share, skipped + len(waiting))


def rates(seconds: float, results: Results) -> None:
    """Measure the requests per second on one connection and on fifty."""
    with peer_of(server) as (_, ours), peer_of(echo) as (_, bare):
        for connections, goal in RATE_GOALS.items():
            pairs = [
                (rate(ours, connections, seconds, SETUP), rate(bare, connections, seconds, ())) for _ in range(ROUNDS)
            ]
            mine, other = (statistics.median(column) for column in zip(*pairs, strict=True))
            results.compared(
                f"server, requests/s, connections: {connections}", mine, other, "/s",
                goal=f">= {goal:,} /s or half the echo", met=mine >= min(goal, other / 2),
            )  # fmt: skip


def crowd(seconds: float, results: Results) -> None:
    """Measure 100 clients at 125 Hz: the CPU time of the server, and late replies."""
    found: dict[str, Polled] = {}
    for name, target, setup in (("server", server, SETUP), ("bare echo", echo, ())):
        with peer_of(target) as (pid, port), opened([port] * CLIENTS, setup) as peers:
            found[name] = poll(peers, pid, RATE, seconds)
    ours, bare = found["server"], found["bare echo"]
    what = f"{CLIENTS} clients at {RATE:.0f} Hz"
    results.compared(f"{what}: CPU of the server", ours.share, bare.share, "% of a core", goal=f"<= {CPU_GOAL:.0f} %, all requests sent",
                     met=ours.complete and ours.share <= CPU_GOAL, note=ours.note())  # fmt: skip
    results.compared(f"{what}: replies later than 8 ms", ours.late, bare.late, "", goal="0, unless the echo is late too",
                     met=not ours.late or bare.late > 0, note=f"echo: {bare.note()}")  # fmt: skip


def server_load(seconds: float, results: Results) -> None:
    """Run all measurements of the server."""
    rates(seconds, results)
    if Path("/proc/self/stat").exists():
        crowd(seconds * 3, results)
    else:
        print("100 clients at 125 Hz: not measured, because this system has no /proc.")
