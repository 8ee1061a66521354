"""The server on a serial line, tested with raw bytes: on its own pseudo-terminal, and on a port that serialx opens."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import random
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit import aio
from orinkit.bcap import packet
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import ConnectFailed, MissingExtra
from orinkit.server import serial_line
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.callers import CONNECT, EXECUTE, GET, GET_VARIABLE, PATIENCE, START, STOP, Counting, SerialRaw, UdpRaw
from support.devices import Recorder
from support.peers import RawClient
from support.waiting import until

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
DESCRIPTORS = Path("/proc/self/fd")

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals"),
    pytest.mark.usefixtures("no_errors_are_logged"),
]


@pytest.fixture
def shop() -> Counting:
    return Counting()


@pytest.fixture
def server(shop: Counting) -> Iterator[Server]:
    with orinkit.serve([shop, VirtualRC8()], "pty://", "tcp://127.0.0.1:0") as served:
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[SerialRaw]:
    with SerialRaw(server.url) as client:
        yield client


# --- requests and answers ---------------------------------------------------------------------------------------------


def test_the_conversation_of_section_3_1(raw: SerialRaw) -> None:
    """RC8 3.1.1 to 3.1.5 with checksums."""
    printed = {v["line"]: packet.decode(bytes.fromhex(v["hex"])) for v in VECTORS if v["document"] == "bcap-rc8.ja.txt"}
    results = []
    for line in (236, 251, 270, 291, 305, 324, 338, 354):
        raw.send(packet.encode(printed[line], crc=True))
        answer = raw.packet()
        assert (answer.serial, answer.reserved, answer.code) == (printed[line].serial, 0, 0)
        results.append(answer.arguments)
    assert results == [[], [2], [3], [False], [], [], [], []]


@pytest.mark.parametrize("size", [1, 2, 7, 30])
def test_requests_in_pieces(raw: SerialRaw, size: int) -> None:
    handle = raw.open_workshop()
    for number in range(5):
        request = raw.encode(100 + number, EXECUTE, handle, "Echo", number)
        for begin in range(0, len(request), size):
            raw.send(request[begin : begin + size])
        assert raw.packet().arguments == [number]


def test_a_retry_is_answered_with_the_stored_answer(raw: SerialRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (100, 100, 101, 102):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=100)
        answer = raw.packet()
        assert (answer.serial, answer.reserved, answer.code, answer.arguments) == (serial, 0, 0, [1])
    assert shop.counts == ["a"]


def test_a_retry_of_an_executing_call_returns_s_executing(raw: SerialRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    raw.request(EXECUTE, handle, "CountLater", 1, serial=100, reserved=100)
    assert shop.at_work.acquire(timeout=PATIENCE)
    raw.request(EXECUTE, handle, "CountLater", 1, serial=101, reserved=100)
    answer = raw.packet()
    assert (answer.serial, answer.code) == (101, hresult.S_EXECUTING)
    shop.gate.set()
    answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (101, 0, [1])
    assert shop.counts == [1]


def test_large_arguments_and_results(raw: SerialRaw) -> None:
    handle = raw.open_workshop()
    assert raw.ask(EXECUTE, handle, "Echo", "x" * 15_000) == "x" * 15_000
    assert raw.ask(EXECUTE, handle, "Large", 65_508) == bytes(65_508)
    assert raw.ask(EXECUTE, handle, "Large", 65_509) == hresult.E_TOO_MUCH_DATA


def test_the_device_receives_the_client_info(raw: SerialRaw, server: Server, shop: Counting) -> None:
    raw.open_workshop()
    (visitor,) = shop.visitors
    assert (visitor.transport, visitor.address, visitor.port) == ("serial", server.url.removeprefix("serial://"), 0)
    handled = threading.Event()
    assert visitor.when_input_processed is not None
    visitor.when_input_processed(handled.set)
    assert handled.wait(PATIENCE)


# --- noise --------------------------------------------------------------------------------------------------------------

NOISE = [
    b"\x00",
    b"\x01",
    b"\x04" * 10,
    b"\x01\x30\x00\x00\x00",  # the start of a packet of 48 bytes
    b"\x01\xff\xff\x00\x00" + bytes(3),  # of 65,535
    b"\x01\x02\x00\x00\x00",
    b"\xff" * 3000,
    packet.pack(9, EXECUTE, 0, b"", crc=True)[:-1],
    packet.pack(9, EXECUTE, 0, b"")[:10],
]


@pytest.mark.parametrize("noise", NOISE)
def test_noise_before_a_request(raw: SerialRaw, server: Server, noise: bytes) -> None:
    raw.send(noise)
    assert raw.ask(START) is None
    assert server.clients == 1


def test_noise_that_hides_a_request(raw: SerialRaw) -> None:
    """The noise may look like the start of a packet that is too long; the next attempt succeeds."""
    raw.send(b"\x01" * 300)
    serials = [raw.request(START, "", serial=serial, reserved=7) for serial in (7, 8)]
    answer = raw.packet()
    while answer.serial not in serials:
        assert (answer.serial, answer.code) == (0, hresult.E_PACKETSIZEOVER)
        answer = raw.packet()
    assert answer.code == 0


def test_noise_creates_no_client(raw: SerialRaw, server: Server) -> None:
    raw.send(b"".join(NOISE))
    assert raw.nothing_comes()
    assert server.clients == 0


@pytest.mark.parametrize("noise", NOISE)
def test_noise_after_a_request(raw: SerialRaw, noise: bytes) -> None:
    handle = raw.open_workshop()
    for number in range(3):
        raw.send(raw.encode(50 + number, EXECUTE, handle, "Echo", number) + noise)
        assert raw.packet().arguments == [number]


def test_a_corrupted_request_is_dropped_and_its_repetition_executed(raw: SerialRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    request = raw.encode(60, EXECUTE, handle, "Count", "x", reserved=60)
    for place in range(0, len(request), 7):
        raw.send(request[:place] + bytes([request[place] ^ 0x40]) + request[place + 1 :])
    raw.send(request[:20])
    raw.send(request[: len(request) // 2] + request[len(request) // 2 + 1 :])
    raw.send(request)
    assert raw.packet().arguments == [1]
    assert shop.counts == ["x"]


def test_many_requests_with_noise_between_them(raw: SerialRaw, shop: Counting) -> None:
    dice = random.Random(11)
    handle = raw.open_workshop()
    for number in range(200):
        raw.send(dice.randbytes(dice.randrange(60)))
        serial = 1000 + number
        raw.request(EXECUTE, handle, "Count", number, serial=serial, reserved=serial)
        assert raw.packet().arguments == [number + 1]
    assert shop.counts == list(range(200))


# --- clients that connect and disconnect --------------------------------------------------------------------------------


def test_a_new_client_has_a_new_session() -> None:
    """Only its Service_Start shows that the previous client has gone."""
    recorder = Recorder()
    with orinkit.serve(recorder, "pty://") as server:
        with SerialRaw(server.url) as first:
            assert first.ask(START) is None
            controller = first.ask(CONNECT, "RC", "Test.Recorder", "", "")
            first.ask(GET_VARIABLE, controller, "a", "")
        with SerialRaw(server.url) as second:
            second.request(START, "", serial=7, reserved=7)
            assert second.packet().code == 0
            assert [call.path for call in recorder.calls[-2:]] == ["RC/a", "RC"]
            assert second.ask(GET, 3) == hresult.E_HANDLE
            assert second.ask(CONNECT, "RC", "Test.Recorder", "", "") == 2
            assert server.clients == 1


@pytest.mark.parametrize("command", ["Wait", "Tidy", "Block"])
def test_a_new_client_does_not_wait_for_a_call_of_the_previous_one(
    server: Server, shop: Counting, command: str
) -> None:
    with SerialRaw(server.url) as first:
        assert first.ask(START) is None
        first.request(EXECUTE, first.open_workshop(), command, "old")
        assert shop.at_work.acquire(timeout=PATIENCE)
    with SerialRaw(server.url) as second:
        second.request(START, "", serial=700, reserved=700)
        assert second.packet().code == 0
        handle = second.open_workshop()
        assert second.ask(EXECUTE, handle, "Echo", "new") == "new"
        shop.gate.set()
        if command != "Block":
            assert shop.cancelled.acquire(timeout=PATIENCE)
        assert second.ask(EXECUTE, handle, "Block", "newer") == "newer"
        assert second.nothing_comes()  # the reply to the old call is never sent


def test_an_object_created_for_the_previous_client_is_released(server: Server, shop: Counting) -> None:
    with SerialRaw(server.url) as raw:
        assert raw.ask(START) is None
        raw.request(GET_VARIABLE, raw.open_workshop(), "slow", "")
        assert shop.at_work.acquire(timeout=PATIENCE)
        raw.request(START, "", serial=700, reserved=700)
        assert raw.packet().code == 0
        shop.gate.set()
        assert shop.let_go.acquire(timeout=PATIENCE)
        assert (shop.made, sorted(shop.released)) == (["slow"], ["Controller", "slow"])


def test_service_stop(server: Server, raw: SerialRaw, shop: Counting) -> None:
    raw.ask(GET_VARIABLE, raw.open_workshop(), "v", "")
    assert server.clients == 1
    for serial in (200, 201):
        raw.request(STOP, serial=serial, reserved=200)
        answer = raw.packet()
        assert (answer.serial, answer.code) == (serial, 0)
        assert server.clients == 0
    assert shop.released == ["v", "Controller"]
    assert raw.ask(GET, 3) == hresult.E_HANDLE
    assert server.clients == 1


def test_the_limit_on_clients_is_shared(shop: Counting) -> None:
    with orinkit.serve(shop, "pty://", "tcp://127.0.0.1:0", "udp://127.0.0.1:0", clients=2) as server:
        line, tcp, udp = server.urls
        with SerialRaw(line) as raw, RawClient(tcp) as one, UdpRaw(udp) as two:
            assert one.ask(CONNECT, "", "Test.Workshop", "", "") == 2
            two.open_workshop()
            assert raw.ask(START) == hresult.E_MAX_CONNECT
            assert two.ask(STOP) is None
            raw.open_workshop()
            assert two.ask(START) == hresult.E_MAX_CONNECT
            assert server.clients == 2


def test_replies_that_the_client_does_not_read(server: Server, shop: Counting) -> None:
    """They are dropped while the line is full; nothing waits for them, and the line works again after the client reads."""
    with SerialRaw(server.url) as greedy, RawClient(server.urls[1]) as other:
        theirs = greedy.open_workshop()
        mine = other.ask(CONNECT, "", "Test.Workshop", "", "")
        for number in range(100):
            greedy.request(EXECUTE, theirs, "Large", 60_000, serial=500 + number, reserved=500 + number)
            assert other.ask(EXECUTE, mine, "Echo", number) == number
        (line,) = (each for each in server._server._context.all if isinstance(each, serial_line.SerialClient))
        while (
            greedy.receive(0.2) is not None or line._transport.get_write_buffer_size()
        ):  # the bytes that the line has buffered
            pass
        assert greedy.ask(EXECUTE, theirs, "Echo", "read again") == "read again"


# --- start and end ------------------------------------------------------------------------------------------------------


def left_over() -> tuple[int, list[str], int]:
    """Return open descriptors, threads and sessions; threads of asyncio's executor end after their loop is closed."""
    gc.collect()
    for thread in threading.enumerate():
        if thread.name.startswith("asyncio"):
            thread.join(PATIENCE)
    return (
        len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.exists() else 0,
        sorted(thread.name for thread in threading.enumerate()),
        sum(isinstance(thing, Session) for thing in gc.get_objects()),
    )


def test_nothing_is_left_when_the_server_closes(shop: Counting) -> None:
    before = left_over()
    server = orinkit.serve(shop, "pty://", "pty://", "udp://127.0.0.1:0")
    assert len(set(server.urls)) == 3
    with SerialRaw(server.urls[0]) as raw, SerialRaw(server.urls[1]) as greedy:
        raw.ask(GET_VARIABLE, raw.open_workshop(), "v", "")
        raw.request(EXECUTE, 2, "Wait")
        handle = greedy.open_workshop()
        for number in range(20):
            greedy.request(EXECUTE, handle, "Large", 60_000, serial=500 + number, reserved=500 + number)
        assert shop.at_work.acquire(timeout=PATIENCE)
        server.close()
        assert shop.cancelled.acquire(timeout=PATIENCE)
        assert sorted(shop.released) == ["Controller", "Controller", "v"]
        assert shop.closed == 1
    assert left_over() == before


def test_the_async_server(shop: Counting) -> None:
    async def body() -> None:
        async with aio.serve(shop, "pty://") as server:
            with SerialRaw(server.url) as raw:
                assert await asyncio.to_thread(raw.ask, START) is None
                assert server.clients == 1
        assert shop.closed == 1
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(body())


# --- serial ports -------------------------------------------------------------------------------------------------------


class Cable:
    """A serial port that can be unplugged: a pseudo-terminal of the test, with a fixed name."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self.plug()

    def plug(self) -> None:
        far_end, near_end = os.openpty()
        tty.setraw(near_end)
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(os.ttyname(near_end))
        self._near_end = near_end
        self.raw = SerialRaw(far_end)

    def pull(self) -> None:
        self.raw.close()
        os.close(self._near_end)


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    pytest.importorskip("serialx")
    made = Cable(tmp_path / "port")
    yield made
    made.pull()


def test_a_serial_port(cable: Cable, shop: Counting) -> None:
    before = left_over()
    with orinkit.serve(shop, f"serial://{cable.name}") as server:
        assert server.url == f"serial://{cable.name}"
        handle = cable.raw.open_workshop()
        cable.raw.request(EXECUTE, handle, "Count", 1, serial=50, reserved=50)
        assert cable.raw.packet().arguments == [1]
        cable.raw.request(EXECUTE, handle, "Wait", 1, serial=51, reserved=51)
        assert shop.at_work.acquire(timeout=PATIENCE)
        assert shop.visitors[0].address == str(cable.name)
    assert shop.cancelled.acquire(timeout=PATIENCE)
    assert shop.released == ["Controller"]
    assert left_over() == before


def test_the_url_contains_unusual_settings(cable: Cable, shop: Counting) -> None:
    with orinkit.serve(shop, f"serial://{cable.name}?baudrate=115200&stop=2") as server:
        assert server.url.startswith(f"serial://{cable.name}?baudrate=115200&")
        assert cable.raw.ask(START) is None


def test_a_port_that_is_unplugged_is_reopened(
    cable: Cable, shop: Counting, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    monkeypatch.setattr(serial_line, "REOPENED_EVERY", 0.02)
    with orinkit.serve(shop, f"serial://{cable.name}") as server:
        for turn in range(3):
            cable.raw.ask(GET_VARIABLE, cable.raw.open_workshop(), "v", "")
            cable.raw.request(EXECUTE, 2, "Wait", 1)
            assert shop.at_work.acquire(timeout=PATIENCE)
            cable.pull()
            assert shop.cancelled.acquire(timeout=PATIENCE)
            until(lambda: server.clients == 0)
            assert shop.released == ["v", "Controller"] * (turn + 1)
            cable.plug()
            wait_for_reopening(cable)
        lost = [record.getMessage() for record in caplog.records if "lost" in record.getMessage()]
        assert len(lost) == 3
        assert all(text.startswith(f"serial://{cable.name}: lost") for text in lost)


def wait_for_reopening(cable: Cable) -> None:
    """Send requests until there is a reply: bytes that wait in a port are discarded when it is opened."""
    for serial in range(1, 300):
        cable.raw.request(START, "", serial=serial, reserved=1)
        if cable.raw.receive(0.1) is not None:
            break
    else:
        raise AssertionError("the port was not reopened")
    last = cable.raw.request(START, "", serial=serial + 1, reserved=1)
    while cable.raw.packet().serial != last:  # after the replies to earlier requests
        pass


def test_closing_while_a_port_is_missing(cable: Cable, shop: Counting, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_line, "REOPENED_EVERY", 0.01)
    before = left_over()
    for _ in range(5):
        with orinkit.serve(Counting(), f"serial://{cable.name}") as server:
            assert cable.raw.ask(START) is None
            cable.pull()
            until(lambda: server.clients == 0)
            cable.plug()
    assert left_over() == before


def test_a_port_that_is_in_use(cable: Cable, shop: Counting) -> None:
    with orinkit.serve(shop, f"serial://{cable.name}"):
        with pytest.raises(ConnectFailed, match=f"cannot open the serial port {cable.name}"):
            orinkit.serve(Counting(), f"serial://{cable.name}")
        assert cable.raw.ask(START) is None


@pytest.mark.parametrize("path", ["/dev/ttyThereIsNone", "/dev/null", "/dev", "/etc/hostname"])
def test_paths_that_are_not_serial_ports(path: str) -> None:
    before = left_over()
    with pytest.raises(ConnectFailed, match=f"cannot open the serial port {path}: "):
        orinkit.serve(Counting(), "tcp://127.0.0.1:0", "pty://", "udp://127.0.0.1:0", f"serial://{path}")
    assert left_over() == before


def test_a_package_that_is_missing(monkeypatch: pytest.MonkeyPatch, shop: Counting) -> None:
    monkeypatch.setattr("orinkit.core.optional_deps.find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"orinkit\[serial\]"):
        orinkit.serve(Counting(), "serial:///dev/ttyS0")
    with orinkit.serve(shop, "pty://") as server, SerialRaw(server.url) as raw:  # does not need the package
        assert raw.ask(START) is None


def test_no_pseudo_terminal_is_available(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> tuple[int, int]:
        raise OSError(28, "out of pty devices")

    monkeypatch.setattr(os, "openpty", fail)
    with pytest.raises(ConnectFailed, match=r"cannot open pty://: .*out of pty devices"):
        orinkit.serve(Counting(), "pty://")
