"""Performance, as ratios measured in one run: ``make bench``.

Absolute times vary between machines and over time. Therefore each measurement alternates with a bare reference in the
same run: a plain socket or port that sends and receives the same number of bytes, or one ``struct`` call for a whole
packet.
"""

from __future__ import annotations

import argparse
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable

import virtual as bench_virtual
from abh3 import abh3
from ecap import ecap
from gateway import gateway
from measuring import alternate, each_us, in_turn, line, on_core, process
from orinkit import functions
from orinkit.bcap import packet
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.requests import encode_request
from orinkit.values import codec as variant_bytes
from round_trips import ARGUMENTS, POSE, REPLY, round_trips, tcp_exchange, tcp_peer
from served import PROVIDER, tcp_server


def codec(count: int) -> None:
    """Measure encoding a request and decoding its reply; the reference is one struct call for the same bytes."""
    whole = struct.Struct("<BIHHIHIHIiIHII14sIHI8dB")
    name = "slvMove".encode("utf-16-le")
    bare_pack = whole.pack
    answer = struct.Struct("<BIHHIHIHI8dB").unpack

    def pack() -> bytes:
        return bare_pack(1, 124, 1, 0, 64, 3, 10, 3, 1, 3, 24, 8, 1, 14, name, 70, 0x2005, 8, *POSE, 4)

    framer = packet.Framer()

    def decode() -> object:  # does the same as the client: extract the packet, read its header, decode the result
        frame = framer.feed(REPLY)
        assert frame is not None
        packet.HEADER.unpack_from(frame)
        return variant_bytes.decode(frame, packet.HEADER.size, len(frame) - 1)

    conversation = BcapConversation()

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
    """Measure requests per second of the server: Variable_GetValue on one and on 50 connections."""
    get = encode_request(functions.variable_get_value, (3,), 1)

    def open_variable(url: str) -> socket.socket:
        host, port = url.removeprefix("tcp://").split(":")
        peer = socket.create_connection((host, int(port)))
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for function, arguments in (
            (functions.service_start, ()),
            (functions.controller_connect, ("", PROVIDER, "localhost", "")),
            (functions.controller_get_variable, (2, "D1", "")),
        ):
            peer.sendall(encode_request(function, arguments, 1))
            peer.recv(65536)
        return peer

    def rate(url: str, connections: int) -> float:
        """Keep one request in progress on each connection; return the replies per second."""
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
        with process(tcp_peer) as url, tcp_exchange(url, get) as exchange:
            return 1e6 / each_us(exchange, int(seconds * 10_000))

    with process(tcp_server) as url:
        one, echo, ratio = alternate(lambda: rate(url, 1), bare_rate, 3)
        line("server, requests/s on one connection", one, echo, ratio, "/s", "aim >= 10,000 /s")
        many, echo, ratio = alternate(lambda: rate(url, 50), bare_rate, 3)
        line("server, requests/s on 50 connections", many, echo, ratio, "/s")


def virtual(count: int) -> None:
    """Measure the virtual RC8: the cost of a cycle, and the speed of programs."""
    run = bench_virtual.statements()
    ours, bare, ratio = alternate(run, bench_virtual.plain_statements, 3)
    line("PacScript in the controller, statements/s", ours, bare, ratio, "/s", "aim >= 10,000 /s")
    line("8 ms cycle with the arm moving", *in_turn(bench_virtual.cycle(), bench_virtual.sines, count), "us")
    for what, action in bench_virtual.kinematics().items():
        line(f"{what}, VS-050", *in_turn(action, bench_virtual.sines, count), "us")


def start_up(runs: int) -> None:
    """Measure importing the package and showing the help of the command line; the reference is a bare interpreter."""

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
    """Run all measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="do a tenth of the work, to check that it runs")
    scale = 10 if parser.parse_args().quick else 1
    on_core(0)
    print("Ratios against a bare reference in the same run; absolute values vary between machines.")
    round_trips(3000 // scale)
    codec(20_000 // scale)
    server(2.0 / scale)
    ecap(500 // scale, 2.0 / scale)
    gateway(500 // scale)
    virtual(500 // scale)
    abh3(800 // scale, 20.0 / scale)
    start_up(15 // scale or 1)


if __name__ == "__main__":
    main()
