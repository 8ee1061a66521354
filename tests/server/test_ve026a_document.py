"""The printed packets of the VE026A document (5.1 to 5.4) as raw bytes over a pseudo-terminal."""

from __future__ import annotations

import json
import os
import select
import time
import tty

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.virtual.ve026a import VirtualVE026A
from support.paths import VECTORS
from support.waiting import PATIENCE

PRINTED = [
    each
    for each in json.loads((VECTORS / "bcap-packets.json").read_text())
    if each["document"].startswith("bcap-ve026a")
]
REQUESTS = {each["serial"]: bytes.fromhex(each["hex"]) for each in PRINTED if each["kind"] == "request"}
ANSWERS = {each["serial"]: bytes.fromhex(each["hex"]) for each in PRINTED if each["kind"] == "response"}
ORDER = (
    1,
    3,
    9,
    11,
    16,
    19,
    22,
    23,
    70,
    71,
    5,
    7,
)  # the order in which a client sends them: start, connect, ..., disconnect, stop
MEASURED = (70, 71)  # these return the joint angles


def ask(line: int, data: bytes) -> bytes:
    """Send a packet and return the reply packet."""
    os.write(line, data)
    end = time.monotonic() + PATIENCE
    received = b""
    while len(received) < 5 or len(received) < int.from_bytes(received[1:5], "little"):
        ready, _, _ = select.select([line], [], [], end - time.monotonic())
        assert ready, f"no complete reply, but {received.hex(' ')}"
        received += os.read(line, 4096)
    return received


def test_all_printed_packets_are_used() -> None:
    assert sorted(ORDER) == sorted(REQUESTS) == sorted(ANSWERS)


@pytest.mark.parametrize("times", [1, 2])
def test_the_printed_packets_over_a_pseudo_terminal(times: int) -> None:
    device = VirtualVE026A(joints=(0, 30, 120, 0, 30, 0, 25), motor_seconds=0.05, clear_seconds=0.05)
    with orinkit.serve(device, "pty://") as server:
        line = os.open(server.url.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY)
        try:
            tty.setraw(line)
            for serial in ORDER * times:
                answer = ask(line, REQUESTS[serial])
                if serial not in MEASURED:
                    assert answer.hex(" ") == ANSWERS[serial].hex(" ")
                    continue
                answered, printed = packet.decode(answer, crc=True), packet.decode(ANSWERS[serial], crc=True)
                assert (answered.serial, answered.reserved, answered.code) == (
                    printed.serial,
                    printed.reserved,
                    printed.code,
                )
                assert answered.arguments[0] == pytest.approx(printed.arguments[0], abs=1.0)
                assert len(answer) == len(ANSWERS[serial])
        finally:
            os.close(line)
