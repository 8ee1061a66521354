"""Raw links: clients and servers that send and receive any bytes."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.dissect import one_line
from orinkit.bcap.profiles import LINE
from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, InvalidValue, LimitExceeded
from orinkit.raw.exchange import ALL, PacketLog, RawExchange, RawPacket
from orinkit.raw.options import RawOptions, Role
from orinkit.raw.packets import assemble
from orinkit.raw.pieces import MOST_BYTES, PieceFramer
from orinkit.transport.address import Address, parse_address
from orinkit.transport.serial.address import SerialAddress
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support import paths
from support.peers import BadPeer, Line, executing, reply

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
PATIENCE = 30.0
START = assemble("Service_Start")


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8()
    yield device
    device.close()


def options(url: str, timeout: float = PATIENCE, **more) -> RawOptions:
    address = parse_address(url)
    assert isinstance(address, Address | SerialAddress)
    role = {"tcp": Role.TCP_CLIENT, "udp": Role.UDP_CLIENT, "serial": Role.SERIAL}[address.scheme]
    return RawOptions(address, **{"role": role, "timeout": timeout, **more})


def serving(role: Role, **more) -> RawOptions:
    scheme = "udp" if role is Role.UDP_SERVER else "tcp"
    return RawOptions(Address(scheme, "127.0.0.1", 0), role, PATIENCE, **more)


async def until(condition) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - there is no event
            await asyncio.sleep(0.005)


@pytest.mark.parametrize("where", ["tcp://127.0.0.1:0", "udp://127.0.0.1:0"])
def test_a_virtual_rc8_is_controlled_by_raw_packets(rc8, where):
    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            profile = raw.options.role.profile
            calls = [
                ("Service_Start", []),
                ("Controller_Connect", ["", "CaoProv.DENSO.VRC", "localhost", ""]),
                ("Controller_GetVariable", ["2", "I7", ""]),
                ("Variable_PutValue", ["3", "3,42"]),
                ("Service_Stop", []),
            ]
            for serial, (name, arguments) in enumerate(calls, 1):
                answer = await raw.send(assemble(name, arguments, serial, profile))
                assert answer is not None
                assert one_line(answer, START).startswith("S_OK")
            assert [each.direction for each in raw.log] == [">", "<"] * 5

    with orinkit.serve(rc8, where) as server:
        asyncio.run(body(server.url))
        with orinkit.connect(server.url) as controller:
            assert controller.variable("I7").value == 42


def test_a_ve026a_on_a_serial_line():
    arm = VirtualVE026A()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            answer = await raw.send(assemble("Service_Start", [], 1, LINE))
            assert answer is not None
            assert packet.decode(answer, crc=True).code == 0
            wrong = bytearray(assemble("Service_Start", [], 2, LINE))
            wrong[-2] ^= 1
        async with await RawExchange.open(options(url, 0.3)) as raw:
            assert await raw.send(bytes(wrong)) is None  # a wrong CRC is noise

    with orinkit.serve(arm, "pty://") as server:
        asyncio.run(body(server.url))
    arm.close()


def test_printed_packets_arrive_unchanged_and_have_replies(rc8):
    printed = [
        bytes.fromhex(each["hex"]) for each in PRINTED if each["transport"] == "tcp" and each["kind"] == "request"
    ]

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            for data in printed:
                answer = await raw.send(data)
                assert answer is not None
                assert packet.is_whole(answer)
                assert answer[5:7] == data[5:7]

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))


def test_a_malformed_packet_is_sent_unchanged():
    got: list[bytes] = []

    def script(line: Line) -> None:
        got.append(line._receive())
        line.send(b"what?")
        line.wait_for_end()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            assert await raw.send(b"\x01\x02 broken") == b"what?"

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))
    assert got == [b"\x01\x02 broken"]


def test_late_replies_and_s_executing_are_not_the_reply():
    def script(line: Line) -> None:
        request = line.request()
        line.send(reply(request, "late", serial=99) + executing(request) + reply(request, "right"))
        line.wait_for_end()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            answer = await raw.send(START)
            assert answer is not None
            assert packet.decode(answer).arguments == ["right"]
            assert len(raw.log) == 4  # all packets are logged

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_a_reply_in_pieces():
    def script(line: Line) -> None:
        line.send_in_pieces(*(bytes([byte]) for byte in reply(line.request(), "abc")))
        line.wait_for_end()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            answer = await raw.send(START)
            assert packet.decode(answer or b"").arguments == ["abc"]

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


@pytest.mark.parametrize("flood", [executing, lambda request: reply(request, serial=9)], ids=["executing", "others"])
def test_a_flood_does_not_prevent_the_end(flood, monkeypatch):
    monkeypatch.setattr("orinkit.raw.exchange.LONGEST_WAIT", 0.3)

    def script(line: Line) -> None:
        request = line.request()
        while not peer.stopping.is_set():
            line.send(flood(request) * 10)

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            answer = await raw.send(START)
            assert answer is None or not packet.is_whole(answer)  # the beginning of a packet may have arrived

    with BadPeer(script) as peer:
        asyncio.run(asyncio.wait_for(body(peer.url), PATIENCE))


def test_no_reply_and_an_incomplete_reply():
    def script(line: Line) -> None:
        line.request()
        line.request()
        line.send(b"\x01\xff\x00\x00\x00 incomplete")
        line.wait_for_end()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url, 0.3)) as raw:
            assert await raw.send(START) is None
            answer = await raw.send(START)
            assert answer is None or answer.startswith(b"\x01\xff")  # None on a machine that stalled
            assert raw.is_open

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_the_peer_closes_the_connection():
    def script(line: Line) -> None:
        line.request()
        line.close()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            with pytest.raises(ConnectionLost, match="closed by the peer"):
                await raw.send(START)
            assert not raw.is_open
            assert isinstance(raw.error, ConnectionLost)
            with pytest.raises(ConnectionLost):
                await raw.send(START)
            with pytest.raises(ConnectionLost):
                await raw.receive(PATIENCE)

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]

    async def body() -> None:
        with pytest.raises(ConnectFailed, match="cannot connect"):
            await RawExchange.open(options(f"tcp://127.0.0.1:{port}"))
        async with await RawExchange.open(options(f"udp://127.0.0.1:{port}")) as raw:
            with pytest.raises((ConnectFailed, ConnectionLost)):
                await raw.send(START)

    asyncio.run(body())


@pytest.mark.parametrize("role", [Role.TCP_SERVER, Role.UDP_SERVER])
def test_a_server_talks_to_a_client(role):
    async def body() -> None:
        async with await RawExchange.open(serving(role)) as server:
            assert server.url.startswith(("tcp://127.0.0.1:", "udp://127.0.0.1:"))
            with pytest.raises(ConnectionLost, match="no client has connected"):
                await server.send(b"x")
            async with await RawExchange.open(options(server.url)) as client:
                pending = asyncio.create_task(client.send(START))
                got = await server.receive(PATIENCE)
                assert got is not None
                assert (got.direction, got.data) == ("<", START)
                assert await server.send(reply(packet.decode(START)), got.peer, wait=False) is None
                assert packet.decode(await pending or b"").code == 0

    asyncio.run(body())


def test_a_server_waits_for_the_next_request():
    async def body() -> None:
        async with (
            await RawExchange.open(serving(Role.TCP_SERVER)) as server,
            await RawExchange.open(options(server.url, sync=False)) as client,
        ):
            await until(lambda: server.peers)
            pending = asyncio.create_task(server.send(b"go"))
            assert (await client.receive(PATIENCE) or RawPacket(0, "<", "", b"")).data == b"go"
            await client.send(START)
            assert await pending == START

    asyncio.run(body())


def test_a_server_sends_to_all_clients():
    async def body() -> None:
        async with await RawExchange.open(serving(Role.TCP_SERVER)) as server:
            with pytest.raises(ConnectionLost, match="no client has connected"):
                await server.send(START, ALL)
            async with (
                await RawExchange.open(options(server.url)) as first,
                await RawExchange.open(options(server.url)) as second,
            ):
                await until(lambda: len(server.peers) == 2)
                assert await server.send(START, ALL) is None
                done = await server.loop([START], 2, peer=ALL, wait=False)
                assert (done.sent, done.replies) == (2, 0)
                for client in (first, second):
                    assert [(await client.receive(PATIENCE) or server.log[0]).direction for _ in range(3)] == ["<"] * 3
            assert [each.data for each in server.log] == [START] * 6

    asyncio.run(body())


def test_the_number_of_clients_is_limited():
    async def body() -> None:
        async with await RawExchange.open(serving(Role.TCP_SERVER, clients=1)) as server:
            async with await RawExchange.open(options(server.url)) as first:
                await until(lambda: server.peers)
                async with await RawExchange.open(options(server.url)) as second:
                    await until(lambda: not second.is_open)
                assert first.is_open
                assert len(server.peers) == 1
            await until(lambda: not server.peers)
            assert server.is_open
            async with await RawExchange.open(options(server.url)):
                await until(lambda: server.peers)

    asyncio.run(body())


def test_a_port_that_is_in_use():
    async def body() -> None:
        async with await RawExchange.open(serving(Role.TCP_SERVER)) as server:
            taken = parse_address(server.url)
            assert isinstance(taken, Address)
            with pytest.raises(ConnectFailed, match="cannot listen on"):
                await RawExchange.open(RawOptions(taken, Role.TCP_SERVER))

    asyncio.run(body())


def test_a_loop_counts_packets_and_replies(rc8):
    seen = []

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            done = await raw.loop([START, START], 20, seen.append)
            assert (done.rounds, done.count, done.sent, done.replies, done.stopped) == (20, 20, 40, 40, False)
            assert done.reply is not None
            assert done.rate > 0
            with pytest.raises(InvalidValue):
                await raw.loop([START], 0)
            with pytest.raises(InvalidValue):
                await raw.loop([], 1)

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))
    assert [each.rounds for each in seen] == list(range(1, 21))


def test_a_loop_is_stopped():
    def script(line: Line) -> None:
        line.serve(reply)

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            done = await raw.loop([START], 1_000_000, lambda state: raw.stop() if state.rounds == 5 else None)
            assert (done.rounds, done.sent, done.stopped) == (5, 5, True)
            assert (await raw.send(START)) is not None  # it can be used again

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_stop_ends_the_wait_for_a_reply():
    async def body(url: str) -> None:
        async with await RawExchange.open(options(url, 3600.0)) as raw:
            loop = asyncio.create_task(raw.loop([START], 10))
            await until(lambda: len(raw.log) == 1)
            raw.stop()
            done = await loop
            assert (done.sent, done.replies, done.stopped) == (1, 0, True)

    with BadPeer(Line.wait_for_end) as peer:
        asyncio.run(asyncio.wait_for(body(peer.url), PATIENCE))


def test_a_cancelled_send_leaves_the_link_usable():
    def script(line: Line) -> None:
        line.request()
        request = line.request()
        line.send(reply(request, "second"))
        line.wait_for_end()

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            first = asyncio.create_task(raw.send(START))
            await until(lambda: len(raw.log) == 1)
            first.cancel()
            answer = await raw.send(assemble("Service_Start", [], 2))
            assert packet.decode(answer or b"").arguments == ["second"]

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_close_ends_a_pending_send():
    async def body(url: str) -> None:
        raw = await RawExchange.open(options(url))
        pending = asyncio.create_task(raw.send(START))
        await until(lambda: len(raw.log) == 1)
        await raw.close()
        await raw.close()
        with pytest.raises(ConnectionClosed):
            await pending
        with pytest.raises(ConnectionClosed):
            await raw.send(START)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    with BadPeer(Line.wait_for_end) as peer:
        asyncio.run(body(peer.url))


def test_a_large_packet_and_the_limit():
    large = packet.encode(packet.Packet(1, 17, [1, "Do", "x" * 4_000_000]))

    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            answer = await raw.send(large)
            assert packet.decode(answer or b"").arguments == ["x" * 4_000_000]
            with pytest.raises(LimitExceeded):
                await raw.send(bytes(MOST_BYTES + 1))

    def script(line: Line) -> None:
        line.serve(lambda request: reply(request, request.arguments[2]))

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_a_datagram_has_a_limit(rc8):
    async def body(url: str) -> None:
        async with await RawExchange.open(options(url)) as raw:
            with pytest.raises(LimitExceeded):
                await raw.send(bytes(70_000))

    with orinkit.serve(rc8, "udp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))


def test_the_log_is_bounded():
    log = PacketLog(3)
    for number in range(5):
        log.append(RawPacket(0.0, ">", "", bytes([number])))
    assert ([each.data for each in log], log.dropped) == ([b"\x02", b"\x03", b"\x04"], 2)
    log.append(RawPacket(0.0, ">", "", bytes(MOST_BYTES)))
    assert (len(log), log.dropped) == (1, 5)
    log.clear()
    assert len(log) == 0


def test_pieces():
    whole = START
    assert PieceFramer().feed(b"noise" + whole + whole) == [b"noise", whole, whole]
    framer = PieceFramer()
    assert framer.feed(whole[:7]) == []
    assert framer.pending == 7
    assert framer.feed(whole[7:]) == [whole]
    assert framer.feed(b"\x01" * 100) == [b"\x01" * 96]  # the last bytes may be the beginning of a packet
    assert framer.flush() == b"\x01" * 4
    assert framer.feed(b"\x01\xff\xff\xff\xff" + whole) == [b"\x01\xff\xff\xff\xff", whole]
