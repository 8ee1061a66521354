"""The raw connection of a page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.profiles import LINE
from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, InvalidValue
from orinkit.raw.exchange import ALL, RawExchange
from orinkit.raw.options import RawOptions
from orinkit.raw.packets import assemble, assemble_reply
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.packet_facts import summary
from orinkit.tester.state.raw.link import MOST_ROUNDS, SHOWN_PACKETS, RawLink
from orinkit.tester.state.workspace import Workspace
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.peers import BadPeer, Line, reply
from support.waiting import PATIENCE

START = assemble("Service_Start")


class Bench:
    """A link in a workspace, and whether its user is present."""

    def __init__(self, folder: Path) -> None:
        self.workspace = Workspace(folder / "connections.json")
        self.reason = ""
        self.link = RawLink(self.workspace, lambda: self.reason)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(motor=True)
    yield device
    device.close()


def options(url: str, timeout: float = PATIENCE) -> RawOptions:
    return replace(RawOptions.parse(url), timeout=timeout)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - there is no event
            await asyncio.sleep(0.005)


def test_packets_are_sent_counted_and_explained(bench, rc8):
    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        assert link in bench.workspace.motions
        packets = [START, assemble("Controller_Connect", ["", "CaoProv.DENSO.VRC", "localhost", ""], 2)]
        done = await link.send(packets)
        assert (done.sent, done.replies, link.sent, link.received) == (2, 2, 2, 2)
        entry = link.last_received
        assert entry.request == packets[1]
        assert summary(entry.logged(link.scheme)) == "S_OK -> 2"
        assert [each.is_sent for each in link.latest] == [True, False, True, False]
        assert [each.data for each in bench.workspace.packets][::2] == packets  # the page Packets
        await link.close()
        assert (link.state, link.notice, bench.workspace.motions) == (ConnectionState.CLOSED, "", set())
        with pytest.raises(InvalidValue, match="not open"):
            await link.send([START])
        await link.open(options(url))
        assert (link.sent, link.received, list(link.latest)) == (0, 0, [])
        await link.close()

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))


def test_the_motion_of_a_packet_is_stopped_if_the_user_is_absent(bench, rc8):
    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        calls = [
            ("Service_Start", []),
            ("Controller_Connect", ["", "CaoProv.DENSO.VRC", "localhost", ""]),
            ("Controller_GetRobot", ["2", "Arm", ""]),
            ("Robot_Execute", ["3", "TakeArm", "8195,0,1"]),
            ("Robot_Move", ["3", "1", "8,@E J(90,0,90,0,90,0)", "SPEED=1,NEXT"]),
        ]
        done = await link.send([assemble(name, values, serial) for serial, (name, values) in enumerate(calls, 1)])
        assert summary(link.last_received.logged("tcp")) == "S_OK"
        assert done.replies == 5
        await until(lambda: rc8.state.arm.busy)
        bench.reason = "the page was closed"
        await until(lambda: not link.is_open)
        assert (link.state, link.notice) == (ConnectionState.CLOSED, "the page was closed")
        await until(lambda: not rc8.state.arm.busy)
        assert bench.workspace.motions == set()

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))


def test_the_stop_button_closes_the_connection_and_ends_a_loop(bench):
    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        sending = asyncio.create_task(link.send([START], MOST_ROUNDS))
        await until(lambda: link.received > 5)
        assert await bench.workspace.stop_all("the stop button was pressed") == []
        (outcome,) = await asyncio.gather(sending, return_exceptions=True)
        assert isinstance(outcome, ConnectionClosed) or outcome.stopped  # it may have waited for a reply
        assert (link.is_open, link.is_sending, link.notice) == (False, False, "the stop button was pressed")

    with BadPeer(lambda line: line.serve(reply)) as peer:
        asyncio.run(body(peer.url))


def test_a_loop_stops_if_nobody_attends_it_and_never_restarts(bench):
    async def body(url: str) -> None:
        link, reasons = bench.link, [""]
        await link.open(options(url))
        sending = asyncio.create_task(link.send([START], MOST_ROUNDS, unattended=lambda: reasons[0]))
        await until(lambda: link.received > 5)
        with pytest.raises(InvalidValue, match="being sent"):
            await link.send([START])
        reasons[0] = "the page is hidden"
        done = await sending
        assert done.stopped
        assert (link.interruption, link.is_open) == ("the page is hidden", True)
        reasons[0] = ""
        sent = link.sent
        await asyncio.sleep(0.1)  # a loop would have continued
        assert link.sent == sent
        assert (await link.send([START])).replies == 1
        await link.close()

    with BadPeer(lambda line: line.serve(reply)) as peer:
        asyncio.run(body(peer.url))


def test_stop_ends_the_wait_for_a_reply(bench):
    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url, 3600.0))
        sending = asyncio.create_task(link.send([START], 10))
        await until(lambda: link.sent == 1)
        link.stop_sending("the button Stop was pressed")
        done = await sending
        assert (done.sent, done.replies, done.stopped, link.interruption) == (1, 0, True, "the button Stop was pressed")
        await link.close()

    with BadPeer(Line.wait_for_end) as peer:
        asyncio.run(body(peer.url))


def test_a_lost_connection(bench):
    def script(line: Line) -> None:
        line.request()
        line.close()

    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        with pytest.raises(ConnectionLost, match="closed by the peer"):
            await link.send([START], 100)
        await until(lambda: link.state is ConnectionState.LOST)
        assert isinstance(link.error, ConnectionLost)
        assert bench.workspace.motions == set()

    with BadPeer(script) as peer:
        asyncio.run(body(peer.url))


def test_connecting_fails_or_is_cancelled(bench, rc8):
    async def body(url: str) -> None:
        link = bench.link
        connecting = asyncio.create_task(link.open(options(url)))
        await asyncio.sleep(0)
        assert link.state is ConnectionState.CONNECTING
        await link.close()
        with pytest.raises(ConnectionClosed):
            await connecting
        assert (link.state, bench.workspace.motions) == (ConnectionState.CLOSED, set())
        await link.open(options(url))
        with pytest.raises(InvalidValue, match="is open"):
            await link.open(options(url))
        for count in (0, MOST_ROUNDS + 1):
            with pytest.raises(InvalidValue, match="count"):
                await link.send([START], count)
        await link.close()

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))
    with pytest.raises(ConnectFailed):
        asyncio.run(bench.link.open(options(server.url)))
    assert isinstance(bench.link.error, ConnectFailed)


@pytest.mark.parametrize("role", [1, 3])
def test_a_server_shows_requests_and_assigns_its_replies_to_them(bench, role):
    async def body() -> None:
        link = bench.link
        await link.open(RawOptions.parse(f"Conn=eth:127.0.0.1:0, EtherOpt={role}"))
        async with await RawExchange.open(options(link.url)) as client:
            asking = asyncio.create_task(client.send(START))
            await until(lambda: link.received)
            assert (link.last_received.is_request, link.last_received.packet.data) == (True, START)
            assert summary(link.last_received.logged(link.scheme)) == "Service_Start()"
            (peer,) = link.peers
            answer = assemble_reply(0x80004001, (), 1)
            assert (await link.send([answer], peer=peer)).replies == 0  # a server does not wait
            assert await asking == answer
            assert link.latest[-1].request == START
            assert len(bench.workspace.packets) == 0
        await link.close()

    asyncio.run(body())


def test_a_server_sends_to_all_clients(bench):
    async def body() -> None:
        link = bench.link
        await link.open(RawOptions.parse("Conn=eth:127.0.0.1:0, EtherOpt=1:2"))
        with pytest.raises(ConnectionLost, match="no client"):
            await link.send([START], peer=ALL)
        async with (
            await RawExchange.open(options(link.url)) as first,
            await RawExchange.open(options(link.url)) as second,
        ):
            await until(lambda: len(link.peers) == 2)
            await link.send([START, START], 3, ALL)
            for client in (first, second):
                got = [await client.receive(PATIENCE) for _ in range(6)]
                assert [each.data for each in got] == [START] * 6
            assert link.sent == 12
        await until(lambda: not link.peers)
        assert link.is_open
        await link.close()

    asyncio.run(body())


def test_the_latest_packets_are_bounded_and_can_be_cleared(bench, rc8):
    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        await link.send([START], 50)
        assert (len(link.latest), link.sent, link.received) == (SHOWN_PACKETS, 50, 50)
        link.clear()
        assert (list(link.latest), link.last_received, link.sent, link.received) == ([], None, 0, 0)
        await link.close()

    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(body(server.url))


def test_a_serial_line_and_one_that_the_tester_uses(bench):
    arm = VirtualVE026A()

    async def body(url: str) -> None:
        link = bench.link
        await link.open(options(url))
        await link.send([assemble("Service_Start", [], 1, LINE)])
        assert packet.decode(link.last_received.packet.data, crc=True).code == 0
        await link.close()
        connection = bench.workspace.add(ConnectionSpec("arm", url))
        await connection.open()
        with pytest.raises(InvalidValue, match="arm uses this serial line"):
            await link.open(options(url))
        await bench.workspace.close()

    with orinkit.serve(arm, "pty://") as server:
        asyncio.run(body(server.url))
    arm.close()
