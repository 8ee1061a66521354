"""Filtering and searching the packets."""

from __future__ import annotations

import asyncio
import itertools
import json
from time import thread_time

import pytest

from orinkit.bcap import packet as bcap
from orinkit.cao.functions import controller_get_variable, variable_get_value
from orinkit.core import hresult
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_facts import Summaries, facts_of, summary
from orinkit.tester.state.packet_filter import LONGEST_TEXT, LastPairs, PacketFilter, PacketView, check_text, read_bytes
from orinkit.tester.state.packet_log import PacketLog
from orinkit.values.variant import Variant, VarType
from support import paths

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
GET = bcap.encode(bcap.Packet(7, variable_get_value.id, [3]))
LARGE = Variant(VarType.ARRAY | VarType.UI1, bytes(16 * 1024 * 1024))


def printed_log(count: int) -> PacketLog:
    log = PacketLog()
    for each in itertools.islice(itertools.cycle(PRINTED), count):
        scheme = each["transport"] if each["transport"] in ("tcp", "udp") else "serial"
        log.add(scheme, scheme, ">" if each["kind"] == "request" else "<", bytes.fromhex(each["hex"]))
    return log


def found(log: PacketLog, **conditions) -> list[int]:
    view = PacketView(log, PacketFilter(**conditions), summary)
    while view.advance():
        pass
    return list(view.numbers())


def test_conditions():
    log = printed_log(3 * len(PRINTED))
    packets = {each.number: each for each in log}
    assert found(log) == list(packets)
    assert found(log, direction=">") == [number for number, each in packets.items() if each.direction == ">"]
    assert found(log, connection="udp") == [number for number, each in packets.items() if each.connection == "udp"]
    io150 = [number for number, each in packets.items() if "IO150".encode("utf-16-le") in each.data]
    assert io150
    assert found(log, text="io150") == io150
    assert found(log, data=bytes.fromhex("49 00 4f 00 31 00 35")) == io150
    calls = found(log, function=controller_get_variable.id)
    assert {packets[number].direction for number in calls} == {">", "<"}
    assert found(log, text="io150", connection="tcp", direction="<") == []


def test_errors_only():
    log = PacketLog()
    log.add("a", "tcp", ">", GET)
    log.add("a", "tcp", "<", bcap.encode(bcap.Packet(7, hresult.S_EXECUTING)))
    log.add("a", "tcp", "<", bcap.encode(bcap.Packet(7, 0x80070006)))
    log.add("a", "tcp", "<", b"\x01garbage")
    log.add("a", "http", ">", b"Func=101,Arg1=3")
    log.add("a", "http", "<", b"0x80070006")
    log.add("a", "http", "<", b"0x00000000,3,1")
    log.add("a", "http", "<", b"<html>")
    log.add("a", "can", "<", bytes(8))
    assert found(log, errors=True) == [3, 4, 6, 8]
    assert found(log, errors=True, function=101) == [3, 6, 8]
    assert [facts_of(each).executing for each in log][:3] == [False, True, False]


def test_retries_and_the_crc_of_a_serial_line():
    log = PacketLog()
    for serial, reserved in ((7, 7), (8, 7), (9, 0)):
        log.add("a", "udp", ">", bcap.encode(bcap.Packet(serial, 101, [3], reserved)))
    assert [facts_of(each).retry for each in log] == [False, True, False]
    right = bcap.encode(bcap.Packet(7, 101, [3], 7), crc=True)
    assert not facts_of(log.add("a", "serial", ">", right)).malformed
    assert facts_of(log.add("a", "serial", ">", right[:-2] + bytes([right[-2] ^ 1]) + right[-1:])).malformed


def test_a_reply_belongs_to_the_request_with_its_serial():
    log = PacketLog()
    first = log.add("a", "udp", ">", bcap.encode(bcap.Packet(7, 101, [3], 7)))
    second = log.add("a", "udp", ">", bcap.encode(bcap.Packet(8, 102, [3, 1], 8)))
    late = log.add("a", "udp", "<", bcap.encode(bcap.Packet(7, 0, [1])))
    log.add("a", "udp", "<", bcap.encode(bcap.Packet(8, hresult.S_EXECUTING)))
    done = log.add("a", "udp", "<", bcap.encode(bcap.Packet(8, 0)))
    assert (late.request_number, late.request) == (first.number, first.data)
    assert log.reply_number(first.number) == late.number
    assert log.reply_number(second.number) == done.number
    assert log.reply_number(late.number) == 0


def test_new_packets_are_examined_and_old_ones_forgotten():
    log = PacketLog(capacity=20)
    view = PacketView(log, PacketFilter(direction=">"), summary)
    for number in range(100):
        log.add("a", "tcp", ">" if number % 2 else "<", GET)
        view.advance()
    assert [each.number for each in view.window(view.first, 100)] == list(range(82, 101, 2))
    assert (view.first, view.end, len(view), view.behind) == (40, 50, 10, 0)
    assert view.number(view.position(90)) == 90
    assert (view.position(80), view.position(91), view.number(39), view.number(50)) == (-1, -1, 0, 0)
    log.clear()
    assert (len(view), list(view.window(view.first, 10))) == (0, [])
    log.add("a", "tcp", ">", GET)
    assert view.behind == 1
    view.advance()
    assert [each.number for each in view.window(view.first, 10)] == [101]


def test_the_last_pairs():
    log = PacketLog()
    for _ in range(3):
        for name in "ab":
            log.add(name, "tcp", ">", GET)
            log.add(name, "tcp", "<", bcap.encode(bcap.Packet(7, 0)))
    view = LastPairs(log, PacketFilter(), summary)
    assert list(view.numbers()) == [9, 10, 11, 12]
    assert (view.position(10), view.number(1), view.position(8)) == (1, 10, -1)
    assert LastPairs(log, PacketFilter(connection="a", direction="<"), summary).numbers() == [10]


def test_a_search_is_divided_into_slices():
    log = printed_log(5000)

    async def search() -> tuple[int, int]:
        view, turns = PacketView(log, PacketFilter(text="ClearError"), Summaries().of), 0

        async def count() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(count())
        await view.catch_up()
        task.cancel()
        return len(view), turns

    matches, turns = asyncio.run(search())
    assert matches == sum("ClearError" in summary(each) for each in log)
    assert turns > 3


def test_a_search_ends_if_it_is_no_longer_current():
    log = printed_log(5000)
    view = PacketView(log, PacketFilter(text="x"), summary)
    asyncio.run(view.catch_up(lambda: False))
    assert view.behind == 5000


@pytest.mark.soak
@pytest.mark.parametrize("condition", [
    {"text": "io150"}, {"data": b"\0W"}, {"errors": True}, {"function": 72}, {"direction": "<", "text": "s_ok"},
])  # fmt: skip
def test_the_event_loop_is_hardly_delayed_by_100000_packets(condition):
    log = printed_log(99_990)
    log.add("a", "tcp", ">", bcap.encode(bcap.Packet(9, 102, [Variant(VarType.I4, 3), LARGE])))
    view = PacketView(log, PacketFilter(**condition), Summaries().of)

    async def search() -> float:
        longest, done = 0.0, asyncio.create_task(view.catch_up())
        while not done.done():
            start = thread_time()
            await asyncio.sleep(0)
            longest = max(longest, thread_time() - start)
        return longest

    assert asyncio.run(search()) < 0.05  # s of processor time
    assert view.behind == 0
    assert list(view.numbers()) == [each.number for each in log if view.condition.matches(each, summary)]


def test_bytes_across_the_parts_of_a_large_packet_are_found():
    data = bytearray(1024 * 1024)
    data[256 * 1024 - 3 : 256 * 1024 + 3] = "abc".encode("utf-16-le")
    log = PacketLog()
    log.add("a", "tcp", ">", bytes(data))
    assert found(log, text="abc") == found(log, data=b"b\0c") == [1]
    assert found(log, text="abd") == []


def test_summaries_are_kept():
    calls = Summaries(capacity=2)
    log = printed_log(3)
    texts = [calls.of(each) for each in log]
    assert texts == [summary(each) for each in log]
    assert calls.of(log.get(1)) == texts[0]


@pytest.mark.parametrize(("text", "expected"), [
    ("", b""), ("01 10", b"\x01\x10"), ("0x01,0x10", b"\x01\x10"), ("01-10:04", b"\x01\x10\x04"), ("aBcD", b"\xab\xcd"),
])  # fmt: skip
def test_bytes_to_search_for(text, expected):
    assert read_bytes(text) == expected


@pytest.mark.parametrize(
    ("text", "part"), [("0", "odd"), ("01 1", "odd"), ("xy", "not hex"), ("01" * 257, "256"), ("0" * 10_000_000, "256")]
)
def test_invalid_bytes(text, part):
    with pytest.raises(InvalidValue, match=tr(part)):
        read_bytes(text)


def test_long_texts_are_refused():
    assert check_text(" x ") == "x"
    with pytest.raises(InvalidValue):
        check_text("x" * (LONGEST_TEXT + 1))
