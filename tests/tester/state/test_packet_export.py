"""Saving packets as text and as pcapng."""

from __future__ import annotations

import asyncio
import itertools
import json
import shutil
import subprocess
from time import thread_time

import pytest

from orinkit.bcap import packet as bcap
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.packet_export import capture_places, export_pcapng, export_text
from orinkit.tester.state.packet_facts import summary
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.workspace import Workspace
from orinkit.values.variant import Variant, VarType
from support import paths
from support.waiting import PATIENCE

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
TSHARK = shutil.which("tshark")


def filled(count: int) -> PacketLog:
    log = PacketLog()
    for each in itertools.islice(itertools.cycle(PRINTED), count):
        scheme = each["transport"] if each["transport"] in ("tcp", "udp") else "serial"
        log.add(scheme, scheme, ">" if each["kind"] == "request" else "<", bytes.fromhex(each["hex"]))
    return log


async def collected(pieces) -> bytes:
    return b"".join([each async for each in pieces])


async def places(tmp_path):
    workspace = Workspace(tmp_path / "connections.json")
    workspace.add(ConnectionSpec("tcp", "tcp://127.0.0.1:5007"))
    workspace.add(ConnectionSpec("udp", "udp://127.0.0.1:5007"))
    return await capture_places(workspace)


def test_text():
    log = filled(300)
    text = asyncio.run(collected(export_text(log, [each.number for each in log], summary))).decode()
    heads = [line for line in text.splitlines() if line.startswith("#")]
    assert len(heads) == 300
    assert all(head.endswith(summary(each)) for head, each in zip(heads, log, strict=True))
    rows = "".join(line for line in text.splitlines() if line.startswith("    "))
    assert bytes.fromhex(rows) == b"".join(each.data for each in log)


def test_packets_that_were_discarded_meanwhile_are_left_out(tmp_path):
    log = PacketLog(capacity=5)
    for _ in range(8):
        log.add("a", "tcp", ">", bcap.encode(bcap.Packet(7, 101, [3])))

    text = asyncio.run(collected(export_text(log, range(1, 12), summary))).decode()
    assert [line.split()[0] for line in text.splitlines() if line.startswith("#")] == ["#4", "#5", "#6", "#7", "#8"]
    data = asyncio.run(collected(export_pcapng(log, range(1, 12), {})))
    assert data.count(bcap.encode(bcap.Packet(7, 101, [3]))) == 5


def test_pcapng_contains_the_packets(tmp_path):
    log = filled(300)

    async def save() -> bytes:
        return await collected(export_pcapng(log, [each.number for each in log], await places(tmp_path)))

    data = asyncio.run(save())
    assert data.startswith(bytes.fromhex("0a0d0d0a"))
    position = 0
    for each in log:
        position = data.index(each.data, position) + len(each.data)


@pytest.mark.soak
@pytest.mark.skipif(TSHARK is None, reason="requires tshark (Debian, Ubuntu: apt-get install tshark)")
def test_tshark_reads_the_pcapng_file(tmp_path):
    log = filled(2000)
    log.add(
        "tcp", "tcp", ">", bcap.encode(bcap.Packet(9, 102, [3, Variant(VarType.ARRAY | VarType.UI1, bytes(300_000))]))
    )

    async def save() -> bytes:
        return await collected(export_pcapng(log, [each.number for each in log], await places(tmp_path)))

    path = tmp_path / "packets.pcapng"
    path.write_bytes(asyncio.run(save()))
    fields = ["-e", "ip.checksum.status", "-e", "tcp.payload", "-e", "udp.payload", "-e", "_ws.malformed"]
    done = subprocess.run(
        [TSHARK, "-n", "-r", path, "-T", "fields", "-o", "ip.check_checksum:TRUE", "-o", "tcp.check_checksum:TRUE", *fields],
        capture_output=True, text=True, timeout=PATIENCE, check=True,
    )  # fmt: skip
    lines = [line.split("\t") for line in done.stdout.splitlines()]
    payload = "".join(line[1] + line[2] for line in lines)
    assert payload == b"".join(each.data for each in log).hex()
    assert {line[0] for line in lines} == {"1"}
    assert {line[3] for line in lines} == {""}


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["txt", "pcapng"])
def test_saving_100000_packets_hardly_delays_the_event_loop(tmp_path, kind):
    log = filled(99_999)
    large = Variant(VarType.ARRAY | VarType.UI1, bytes(16 * 1024 * 1024 - 100))
    log.add("tcp", "tcp", ">", bcap.encode(bcap.Packet(9, 102, [3, large])))
    size = 0

    async def save() -> float:
        nonlocal size
        longest, numbers = 0.0, [each.number for each in log]
        pieces = (
            export_text(log, numbers, summary) if kind == "txt" else export_pcapng(log, numbers, await places(tmp_path))
        )

        async def consume() -> None:
            nonlocal size
            async for each in pieces:
                size += len(each)

        task = asyncio.create_task(consume())
        while not task.done():
            start = thread_time()
            await asyncio.sleep(0)
            longest = max(longest, thread_time() - start)
        await task
        return longest

    assert asyncio.run(save()) < 0.05  # s of processor time
    assert size > sum(len(each.data) for each in log)
