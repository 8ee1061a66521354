"""Performance, as ratios measured in one run: ``make bench``.

Absolute times vary between machines and over time. Therefore each measurement alternates with a bare reference in the
same run: a plain socket or port that sends and receives the same number of bytes, or one ``struct`` call for a whole
packet.
"""

from __future__ import annotations

import argparse
import os
import struct
import time
from collections.abc import Callable
from pathlib import Path

import virtual as bench_virtual
from abh3 import abh3
from arms import arms
from ecap import ecap
from gateway import gateway
from measuring import RECORDED, alternate, each_us, in_turn, line, on_core
from natural import natural
from orinkit import functions
from orinkit.bcap import packet
from orinkit.bcap.client import BcapConversation
from orinkit.values import codec as variant_bytes
from packets import ARGUMENTS, POSE, REPLY, encode_request
from plot import plot
from results import BUILD, Results
from round_trips import round_trips
from server_load import server_load
from stalls import watched
from start_up import start_up


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


def virtual(count: int) -> None:
    """Measure the virtual RC8: the cost of a cycle, and the speed of programs."""
    run = bench_virtual.statements()
    ours, bare, ratio = alternate(run, bench_virtual.plain_statements, 3)
    line("PacScript in the controller, statements/s", ours, bare, ratio, "/s", "aim >= 10,000 /s")
    line("8 ms cycle with the arm moving", *in_turn(bench_virtual.cycle(), bench_virtual.sines, count), "us")
    for what, action in bench_virtual.kinematics().items():
        line(f"{what}, VS-050", *in_turn(action, bench_virtual.sines, count), "us")


def noise(when: str, seconds: float, results: Results) -> None:
    """State how often the machine stalls while nothing else runs."""
    if not hasattr(os, "sched_getaffinity"):
        print("Stalls of the machine are not measured on this system.")
        return
    with watched() as stalls:
        begin = time.monotonic()
        time.sleep(seconds)
        found = stalls.between(begin, time.monotonic(), 0.0)
    priority = "" if stalls.real_time else "without real-time priority, so other programs count, too"
    longest = max((stall.end - stall.begin for stall in found), default=0.0)
    results.limited(
        f"the machine, {when}: longest stall", longest * 1e3, "ms", None, f"{len(found)} in {seconds:.0f} s {priority}"
    )


def users(scale: float, results: Results) -> None:
    """Measure what users call: round trips, the server, many arms, start-up."""
    noise("before", 10.0 * scale, results)
    # many short rounds: the speed of the machine changes within seconds
    natural(max(8, round(40 * scale)), 60, 6, results)
    server_load(2.0 * scale, results)
    arms(100, 10.0 * scale, results)
    start_up(max(3, round(15 * scale)), results)
    noise("after", 10.0 * scale, results)


def others(scale: int) -> None:
    """Measure the other transports and packages, as ratios."""
    round_trips(3000 // scale)
    codec(20_000 // scale)
    ecap(500 // scale, 2.0 / scale)
    gateway(500 // scale)
    virtual(500 // scale)
    abh3(800 // scale, 20.0 / scale)


def main() -> None:
    """Run all measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="do less: what users call, in about a minute")
    parser.add_argument(
        "--check", action="store_true", help="do a tenth of the work of everything, to check that it runs"
    )
    parser.add_argument("--csv", type=Path, default=BUILD / "bench.csv", help="file for the results")
    parser.add_argument("--plot", type=Path, help="picture of the round trips (requires the extra plot)")
    arguments = parser.parse_args()
    on_core(0)
    print("Ratios against a bare reference in the same run; absolute values vary between machines.")
    results = Results()
    users(0.3 if arguments.quick else 0.1 if arguments.check else 1.0, results)
    if not arguments.quick:
        others(10 if arguments.check else 1)
    results.rows += RECORDED
    results.write(arguments.csv)
    if arguments.plot:
        plot(results.rows, arguments.plot)
    results.goals()
    print(f"Results: {arguments.csv}")


if __name__ == "__main__":
    main()
