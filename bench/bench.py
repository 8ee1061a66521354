"""Speeds, as ratios measured in one run: ``make bench``.

Absolute times differ from machine to machine and from minute to minute; what is compared here ran alternately, in this
very run, against a bare reference: a plain socket that sends and receives the same numbers of bytes, or one
``struct`` call for a whole packet.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import multiprocessing.connection
import os
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import orinkit
import virtual as bench_virtual
from orinkit import aio, functions, variant_bytes
from orinkit.bcap import packet
from orinkit.bcap.client import Conversation, encode_request
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, VariableObject
from orinkit.variant import Value, Variant

POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]
ARGUMENTS = (3, "slvMove", POSE)
REQUEST = encode_request(functions.robot_execute, ARGUMENTS, 1)
REPLY = packet.pack(1, 0, 1, variant_bytes.encode(POSE))
ROUNDS = 9
CORES = range(os.cpu_count() or 1)


# --- the far sides ----------------------------------------------------------------------------------------------------


def on_core(number: int) -> None:
    """Stay on one core, where the system lets us: whether two processes share one decides more than all else."""
    if hasattr(os, "sched_setaffinity") and len(CORES) > 1:
        os.sched_setaffinity(0, {CORES[number]})


def echo_peer(pipe: multiprocessing.connection.Connection) -> None:
    """Answer every request of one size with a reply of the other, its serial copied: as little as a peer can do."""
    on_core(-1)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        pipe.send(listener.getsockname()[1])
        while True:
            peer, _ = listener.accept()
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with peer:
                head, tail = REPLY[:5], REPLY[7:]
                while data := peer.recv(65536):
                    peer.sendall(head + data[5:7] + tail)


class Cell(VariableObject):
    """A variable that keeps what is written."""

    value: Variant | float = 0.0

    def get_value(self) -> Value:
        """The value."""
        return self.value

    def put_value(self, value: Variant) -> None:
        """Set it."""
        self.value = value


class Bench(ControllerObject):
    """The least controller."""

    def get_variable(self, name: str, option: str) -> Cell:  # noqa: ARG002
        """Any name will do."""
        return Cell(name)


class BenchProvider(Provider):
    """Serves it."""

    provider_names = ("CaoProv.DENSO.VRC",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Bench:  # noqa: ARG002
        """Accept everyone."""
        return Bench(name)


def server_peer(pipe: multiprocessing.connection.Connection) -> None:
    """Serve until the parent goes."""
    on_core(-1)
    with orinkit.serve(BenchProvider(), "tcp://127.0.0.1:0") as server:
        pipe.send(server.url)
        pipe.recv()


@contextmanager
def process(target: Callable[[multiprocessing.connection.Connection], None]) -> Iterator[object]:
    """Run one far side in a process of its own, on another core; yields what it sends first."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    child = context.Process(target=target, args=(theirs,), daemon=True)
    child.start()
    try:
        yield ours.recv()
    finally:
        child.terminate()
        child.join()


# --- measuring --------------------------------------------------------------------------------------------------------


def each_us(action: Callable[[], object], count: int) -> float:
    """Return the mean time of one action in a tight loop, in microseconds."""
    begin = time.perf_counter()
    for _ in range(count):
        action()
    return (time.perf_counter() - begin) / count * 1e6


def alternate(ours: Callable[[], float], bare: Callable[[], float], rounds: int = ROUNDS) -> tuple[float, float, float]:
    """Measure two things in turn; returns the median of each and of the ratio, round by round."""
    pairs = [(ours(), bare()) for _ in range(rounds)]
    return (
        statistics.median(a for a, _ in pairs),
        statistics.median(b for _, b in pairs),
        statistics.median(a / b for a, b in pairs),
    )


def middle(results: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Return the median of each column."""
    ours, bare, ratio = (statistics.median(column) for column in zip(*results, strict=True))
    return ours, bare, ratio


def line(what: str, ours: float, bare: float, ratio: float, unit: str, aim: str = "") -> None:
    """Print one result."""
    print(f"{what:<58} {ours:>9.2f} {unit:<4} bare {bare:>8.2f} {unit:<4} ratio {ratio:>5.2f}  {aim}")


# --- the benchmarks ---------------------------------------------------------------------------------------------------


def in_turn(ours: Callable[[], object], bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Do two things by turns, one of each, so that both meet the same machine; returns both medians and their ratio."""
    clock = time.perf_counter
    times: tuple[list[float], list[float]] = ([], [])
    for number in range(count + count // 10):
        for action, kept in zip((ours, bare), times, strict=True):
            begin = clock()
            action()
            end = clock()
            if number >= count // 10:
                kept.append(end - begin)
    mine, other = (statistics.median(kept) * 1e6 for kept in times)
    return mine, other, mine / other


@contextmanager
def bare_round_trip() -> Iterator[Callable[[], object]]:
    """A plain socket and its peer; yields one exchange of the same sizes."""
    with process(echo_peer) as port, socket.create_connection(("127.0.0.1", port)) as peer:  # type: ignore[arg-type]
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def exchange() -> None:
            peer.sendall(REQUEST)
            peer.recv(65536)

        yield exchange


def round_trip(count: int) -> None:
    """Robot_Execute with 8 doubles each way, client against a bare socket of the same sizes."""
    execute = functions.robot_execute
    with process(echo_peer) as port, bare_round_trip() as bare:
        with orinkit.open_client(f"tcp://127.0.0.1:{port}") as client:
            call = client.call
            results = [in_turn(lambda: call(execute, *ARGUMENTS), bare, count) for _ in range(ROUNDS)]
        line("round trip, 8 doubles each way, sync client", *middle(results), "us", "aim <= 1.1")

        async def by_turns() -> tuple[float, float, float]:
            async with aio.open_client(f"tcp://127.0.0.1:{port}") as client:
                mine, other = [], []
                for _ in range(count):
                    begin = time.perf_counter()
                    await client.call(execute, *ARGUMENTS)
                    middle_time = time.perf_counter()
                    bare()
                    mine.append(middle_time - begin)
                    other.append(time.perf_counter() - middle_time)
                ours, reference = statistics.median(mine) * 1e6, statistics.median(other) * 1e6
                return ours, reference, ours / reference

        results = [asyncio.run(by_turns()) for _ in range(ROUNDS)]
        line("round trip, 8 doubles each way, async client", *middle(results), "us")


def codec(count: int) -> None:
    """Encode a request and decode its reply, against one struct call for the same bytes."""
    whole = struct.Struct("<BIHHIHIHIiIHII14sIHI8dB")
    name = "slvMove".encode("utf-16-le")
    bare_pack = whole.pack
    answer = struct.Struct("<BIHHIHIHI8dB").unpack

    def pack() -> bytes:
        return bare_pack(1, 124, 1, 0, 64, 3, 10, 3, 1, 3, 24, 8, 1, 14, name, 70, 0x2005, 8, *POSE, 4)

    framer = packet.Framer()

    def decode() -> object:  # what the client does with a reply: cut it out, look at its head, read its result
        frame = framer.take(REPLY)
        assert frame is not None
        packet.HEADER.unpack_from(frame)
        return variant_bytes.decode(frame, packet.HEADER.size, len(frame) - 1)

    conversation = Conversation()

    def both() -> None:
        operation = conversation.call(functions.robot_execute, ARGUMENTS, 3.0)
        request, _ = operation.send(None)
        try:
            operation.send(REPLY[:5] + request[5:7] + REPLY[7:])
        except StopIteration:
            pass

    def both_bare() -> None:
        pack()
        answer(REPLY)

    def turn(action: Callable[[], object]) -> Callable[[], float]:
        return lambda: each_us(action, count)

    encode = turn(lambda: encode_request(functions.robot_execute, ARGUMENTS, 1))
    line("encode a slvMove request", *alternate(encode, turn(pack)), "us", "aim <= 1.7 us")
    line(
        "decode its reply, as the client does",
        *alternate(turn(decode), turn(lambda: answer(REPLY))),
        "us",
        "aim <= 1.3 us",
    )
    whole_packet = turn(lambda: packet.decode(REPLY))
    line(
        "decode its reply into a Packet object",
        *alternate(whole_packet, turn(lambda: answer(REPLY))),
        "us",
        "aim <= 1.3 us",
    )
    line("a whole conversation: encode, match, decode", *alternate(turn(both), turn(both_bare)), "us")


def server(seconds: float) -> None:
    """Requests per second that the server answers: Variable_GetValue on one and on 50 connections."""
    get = encode_request(functions.variable_get_value, (3,), 1)

    def open_variable(url: str) -> socket.socket:
        host, port = url.removeprefix("tcp://").split(":")
        peer = socket.create_connection((host, int(port)))
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for function, arguments in (
            (functions.service_start, ()),
            (functions.controller_connect, ("", "CaoProv.DENSO.VRC", "localhost", "")),
            (functions.controller_get_variable, (2, "D1", "")),
        ):
            peer.sendall(encode_request(function, arguments, 1))
            peer.recv(65536)
        return peer

    def rate(url: str, connections: int) -> float:
        """Keep one request in flight on each connection; count the answers."""
        peers = [open_variable(url) for _ in range(connections)]
        done = 0
        stop = time.perf_counter() + seconds
        while time.perf_counter() < stop:
            for peer in peers:
                peer.sendall(get)
            for peer in peers:
                peer.recv(65536)
            done += connections
        elapsed = seconds + time.perf_counter() - stop
        for peer in peers:
            peer.close()
        return done / elapsed

    def bare_rate() -> float:
        with process(echo_peer) as port, socket.create_connection(("127.0.0.1", port)) as peer:  # type: ignore[arg-type]
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

            def action() -> None:
                peer.sendall(get)
                peer.recv(65536)

            return 1e6 / each_us(action, int(seconds * 10_000))

    with process(server_peer) as url:
        assert isinstance(url, str)
        one, echo, ratio = alternate(lambda: rate(url, 1), bare_rate, 3)
        line("server, requests/s on one connection", one, echo, ratio, "/s", "aim >= 10,000 /s")
        many, echo, ratio = alternate(lambda: rate(url, 50), bare_rate, 3)
        line("server, requests/s on 50 connections", many, echo, ratio, "/s")


def virtual(count: int) -> None:
    """The virtual RC8: what a cycle costs, and how fast programs are."""
    run = bench_virtual.statements()
    ours, bare, ratio = alternate(run, bench_virtual.plain_statements, 3)
    line("PacScript in the controller, statements/s", ours, bare, ratio, "/s", "aim >= 10,000 /s")
    line("8 ms cycle with the arm moving", *in_turn(bench_virtual.cycle(), bench_virtual.sines, count), "us")
    for what, action in bench_virtual.kinematics().items():
        line(f"{what}, VS-050", *in_turn(action, bench_virtual.sines, count), "us")


def start_up(runs: int) -> None:
    """How long it takes to import the package and to show the command line's help, against a bare interpreter."""

    def milliseconds(*arguments: str) -> Callable[[], float]:
        def run() -> float:
            begin = time.perf_counter()
            subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
            return (time.perf_counter() - begin) * 1e3

        return run

    bare = milliseconds("-c", "pass")
    line(
        "import orinkit, whole process",
        *alternate(milliseconds("-c", "import orinkit"), bare, runs),
        "ms",
        "aim < 60 ms",
    )
    line(
        "orinkit --help, whole process",
        *alternate(milliseconds("-m", "orinkit", "--help"), bare, runs),
        "ms",
        "aim < 250 ms",
    )


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the work, to see that it runs")
    scale = 10 if parser.parse_args().quick else 1
    on_core(0)
    print("Ratios against a bare reference in the same run; single figures differ from machine to machine.")
    round_trip(3000 // scale)
    codec(20_000 // scale)
    server(2.0 / scale)
    virtual(500 // scale)
    start_up(15 // scale or 1)


if __name__ == "__main__":
    main()
