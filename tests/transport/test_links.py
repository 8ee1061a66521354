"""UDP and serial ports, synchronous and in asyncio: one test body for all."""

from __future__ import annotations

import asyncio
import errno
import gc
import os
import select
import socket
import termios
import threading
import time
import tty
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest

from orinkit.core.errors import (
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    InvalidAddress,
    MissingExtra,
    TransportError,
)
from orinkit.transport import aio_links, links
from orinkit.transport.address import Address
from orinkit.transport.registry import LinkOptions
from orinkit.transport.serial.address import PtyAddress, SerialAddress
from orinkit.transport.serial.aio_windows import AsyncPortLink
from orinkit.transport.serial.settings import open_port
from orinkit.transport.serial.windows import PortLink
from support.both import Both

PATIENT = 20.0  # s: a time-out that no test may reach
SHORT = 0.05  # s: a time-out that is expected to pass


Openers = tuple[Callable[[Any, LinkOptions], Any], Callable[[Any, LinkOptions], Any]]


class UdpPeer:
    """A peer over UDP."""

    kind = "udp"
    openers: Openers = (links.open_link, aio_links.open_link)

    def __init__(self) -> None:
        self._socket = socket.socket(type=socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(PATIENT)
        self._client: tuple[str, int] | None = None
        self.address = Address("udp", *self._socket.getsockname())

    def receive(self, count: int) -> bytes:
        data, self._client = self._socket.recvfrom(65536)
        return data

    def send(self, data: bytes) -> None:
        assert self._client is not None
        self._socket.sendto(data, self._client)

    def send_from_elsewhere(self, data: bytes) -> None:
        assert self._client is not None
        with socket.socket(type=socket.SOCK_DGRAM) as other:
            other.sendto(data, self._client)

    def close(self) -> None:
        self._socket.close()


class SerialPeer:
    """A peer over a pair of pseudo-terminals."""

    kind = "serial"
    openers: Openers = (links.open_link, aio_links.open_link)

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.address = SerialAddress(os.ttyname(self._slave), 115200)

    def receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            assert select.select([self._master], [], [], PATIENT)[0]
            data += os.read(self._master, count - len(data))
        return data

    def send(self, data: bytes) -> None:
        os.write(self._master, data)

    def pull_out(self) -> None:
        os.close(self._master)
        os.close(self._slave)
        self._master = -1

    def close(self) -> None:
        if self._master >= 0:
            self.pull_out()


class PortPeer(SerialPeer):
    """A peer for the links of Windows, with the serialx of this system."""

    openers = (
        lambda address, _: PortLink(open_port(address)),
        lambda address, opening: AsyncPortLink.open(address, opening.seconds),
    )


PEERS = [UdpPeer, SerialPeer, PortPeer]
PORTS = [SerialPeer, PortPeer]


class Way:
    """A link to a peer, synchronous or asynchronous."""

    def __init__(self, both: Both, peer: Any) -> None:
        self._both = both
        self.peer = peer
        self.link = self.open(peer.address)

    def do(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the asynchronous link in the event loop."""

        async def body() -> Any:
            result = function(*arguments)
            return await result if asyncio.iscoroutine(result) else result

        return function(*arguments) if self._both.loop is None else self._both.run(body())

    def open(self, address: Any) -> Any:
        return self.do(self.peer.openers[self._both.loop is not None], address, LinkOptions(PATIENT))

    def send(self, data: bytes) -> None:
        self.do(self.link.send, data, *((PATIENT,) if self._both.loop is None else ()))

    def receive(self, seconds: float = PATIENT) -> bytes | None:
        result: bytes | None = self.do(self.link.receive, seconds)
        return result

    def hello(self) -> None:
        """Send a packet to the peer, so that each side has received or sent something."""
        self.send(b"hello")
        assert self.peer.receive(5) == b"hello"

    def close(self) -> None:
        self.do(self.link.close)
        self.peer.close()
        if self._both.loop is not None:  # serialx closes ports in a task
            self._both.loop.run_until_complete(_settled())
            self._both.loop.run_until_complete(self._both.loop.shutdown_default_executor())


async def _settled() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    await asyncio.wait_for(asyncio.gather(*others), PATIENT)


@pytest.fixture(params=PEERS)
def way(request: pytest.FixtureRequest, both: Both) -> Iterator[Way]:
    made = Way(both, request.param())
    yield made
    made.close()


@pytest.fixture
def udp(both: Both) -> Iterator[Way]:
    made = Way(both, UdpPeer())
    yield made
    made.close()


@pytest.fixture(params=PORTS)
def serial(request: pytest.FixtureRequest, both: Both) -> Iterator[Way]:
    made = Way(both, request.param())
    yield made
    made.close()


# --- all links ------------------------------------------------------------------------------------------------------


def test_there_and_back(way: Way) -> None:
    every_byte = bytes(range(256))  # no byte has a special meaning for a terminal in raw mode
    for data in (b"\x00", every_byte, b"\x11\x13\x03\x04\r\n", bytes(488)):
        way.send(data)
        assert way.peer.receive(len(data)) == data
        way.peer.send(data)
        received = b""
        while len(received) < len(data):
            received += way.receive() or b""
        assert received == data


def test_nothing_comes(way: Way) -> None:
    began = time.monotonic()
    assert way.receive(SHORT) is None
    assert time.monotonic() - began >= SHORT * 0.9
    way.hello()
    way.peer.send(b"late")
    assert way.receive() == b"late"


def test_a_link_that_was_closed(way: Way) -> None:
    way.do(way.link.close)
    way.do(way.link.close)
    for call in (lambda: way.send(b"x"), lambda: way.receive(SHORT), lambda: way.do(way.link.fileno)):
        with pytest.raises(ConnectionClosed):
            call()


@pytest.mark.parametrize("peer", PEERS)
def test_closing_from_another_thread_ends_a_receive(peer: Any) -> None:
    way = Way(Both("sync"), peer())
    closer = threading.Timer(SHORT, way.link.close)
    closer.start()
    began = time.monotonic()
    with pytest.raises(ConnectionClosed):
        way.receive()
    assert time.monotonic() - began < PATIENT / 2
    closer.join()
    way.close()


@pytest.mark.parametrize("peer", PEERS)
def test_a_receive_in_another_thread_does_not_delay_a_send(peer: Any) -> None:
    way = Way(Both("sync"), peer())
    way.hello()
    ended = threading.Event()

    def wait() -> None:
        with suppress(ConnectionClosed):
            way.receive()
        ended.set()

    receiver = threading.Thread(target=wait)
    receiver.start()
    time.sleep(SHORT)
    way.send(b"bye")
    assert way.peer.receive(3) == b"bye"
    assert not ended.is_set()
    way.close()
    receiver.join()


@pytest.mark.parametrize("peer", PEERS)
def test_many_threads_close_a_link(peer: Any) -> None:
    way = Way(Both("sync"), peer())
    closers = [threading.Timer(SHORT, way.link.close) for _ in range(8)]
    for closer in closers:
        closer.start()
    with pytest.raises(ConnectionClosed):
        way.receive()
    for closer in closers:
        closer.join()
    way.close()


@pytest.mark.parametrize("peer", PEERS)
def test_closing_from_another_task_ends_a_receive(peer: Any) -> None:
    both = Both("async")
    way = Way(both, peer())

    async def body() -> None:
        waiting = asyncio.ensure_future(way.link.receive(PATIENT))
        await asyncio.sleep(0)
        way.link.close()
        way.link.close()
        with pytest.raises(ConnectionClosed):
            await waiting

    both.run(body())
    way.close()
    both.close()


@pytest.mark.parametrize("peer", PEERS)
def test_a_cancelled_receive_leaves_the_link_as_it_was(peer: Any) -> None:
    both = Both("async")
    way = Way(both, peer())
    way.hello()

    async def body() -> None:
        waiting = asyncio.ensure_future(way.link.receive(PATIENT))
        await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting

    both.run(body())
    way.peer.send(b"after")
    assert way.receive() == b"after"
    way.close()
    both.close()


def test_another_process_takes_the_link_over(way: Way) -> None:
    """Return the link that another process would have, over a copy of the descriptor."""
    way.hello()
    theirs = links.adopt(way.peer.kind, os.dup(way.do(way.link.fileno)))
    theirs.send(b"set-point", PATIENT)
    assert way.peer.receive(9) == b"set-point"
    way.peer.send(b"answer")
    if way._both.loop is not None:
        way.do(asyncio.sleep, SHORT)  # the event loop has time to read it, but must not
    assert theirs.receive(PATIENT) == b"answer"
    assert theirs.receive(SHORT) is None
    theirs.close_local()
    way.peer.send(b"back")
    assert way.receive() == b"back"


def test_another_process_keeps_the_link(way: Way) -> None:
    way.hello()
    theirs = links.adopt(way.peer.kind, os.dup(way.do(way.link.fileno)))
    way.do(way.link.close_local)
    if way._both.loop is not None:
        way._both.run(_settled())
    way.peer.send(b"answer")
    assert theirs.receive(PATIENT) == b"answer"
    theirs.send(b"set-point", PATIENT)
    assert way.peer.receive(9) == b"set-point"
    theirs.close()


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
@pytest.mark.parametrize("peer", [UdpPeer, SerialPeer])
def test_a_link_is_closed_with_its_last_reference(peer: Any) -> None:
    other = peer()
    link = links.open_link(other.address, LinkOptions(PATIENT))
    number = link.fileno()
    opened = os.fstat(number)
    del link
    gc.collect()
    with suppress(OSError):  # closed
        assert not os.path.samestat(os.fstat(number), opened)  # the number belongs to another file
    other.close()


def test_pseudo_terminals_are_for_servers(both: Both) -> None:
    opening = links.open_link if both.loop is None else aio_links.open_link
    with pytest.raises(InvalidAddress, match="for servers"):
        both.run(opening(PtyAddress(), LinkOptions(PATIENT)))


# --- UDP ------------------------------------------------------------------------------------------------------------


def test_empty_datagrams_are_passed_over(udp: Way) -> None:
    udp.hello()
    for data in (b"", b"", b"one", b"", b"two", b""):
        udp.peer.send(data)
    assert [udp.receive(), udp.receive(), udp.receive(SHORT)] == [b"one", b"two", None]


def test_one_datagram_at_a_time(udp: Way) -> None:
    udp.hello()
    sent = [bytes([number]) * number for number in range(1, 60)]
    for data in sent:
        udp.peer.send(data)
    assert [udp.receive() for _ in sent] == sent


def test_other_addresses_are_not_heard(udp: Way) -> None:
    udp.hello()
    udp.peer.send_from_elsewhere(b"foreign")
    udp.peer.send(b"right")
    udp.peer.send_from_elsewhere(b"foreign")
    assert [udp.receive(), udp.receive(SHORT)] == [b"right", None]


def test_nobody_listens(udp: Way) -> None:
    udp.peer.close()
    with pytest.raises(ConnectFailed, match="no program listens at this address") as caught:
        for _ in range(100):  # the system reports it a little later
            udp.send(b"x")
            udp.receive(SHORT)
    assert str(udp.peer.address) in str(caught.value)
    with pytest.raises(ConnectionClosed):
        udp.send(b"x")


def test_nobody_listens_any_more(udp: Way) -> None:
    udp.hello()
    udp.peer.send(b"answer")
    assert udp.receive() == b"answer"
    udp.peer.close()
    with pytest.raises(ConnectionLost, match="has stopped listening"):
        for _ in range(100):
            udp.send(b"x")
            udp.receive(SHORT)


def test_a_host_that_is_not_known(both: Both) -> None:
    opening = links.open_link if both.loop is None else aio_links.open_link
    with pytest.raises(ConnectFailed, match=r"udp://robot\.invalid:5007"):
        both.run(opening(Address("udp", "robot.invalid", 5007), LinkOptions(PATIENT)))
    if both.loop is not None:
        both.run(both.loop.shutdown_default_executor())


def test_a_flood_of_empty_datagrams_does_not_prolong_a_receive(both: Both) -> None:
    udp = Way(both, UdpPeer())
    udp.hello()
    stop = threading.Event()

    def flood() -> None:
        while not stop.is_set():
            udp.peer.send(b"")

    flooding = threading.Thread(target=flood)
    flooding.start()
    try:
        began = time.monotonic()
        assert udp.receive(SHORT * 4) is None
        assert time.monotonic() - began < PATIENT / 2
    finally:
        stop.set()
        flooding.join()
        udp.close()


def test_datagrams_that_are_there_do_not_keep_other_tasks_from_running() -> None:
    async def body() -> None:
        peer = UdpPeer()
        link: Any = await aio_links.open_link(peer.address, LinkOptions(PATIENT))
        turns = 0

        async def other() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        link.send(b"hello")
        peer.receive(5)
        for number in range(100):
            peer.send(bytes([number]))
        task = asyncio.create_task(other())
        assert [await link.receive(PATIENT) for _ in range(100)] == [bytes([number]) for number in range(100)]
        assert turns >= 10
        task.cancel()
        link.close()
        peer.close()

    asyncio.run(body())


# --- serial ports ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["waiting", "between"])
def test_a_port_that_is_pulled_out(serial: Way, how: str) -> None:
    serial.hello()
    pulling = threading.Timer(SHORT if how == "waiting" else 0.0, serial.peer.pull_out)
    pulling.start()
    if how == "between":
        pulling.join()
    with pytest.raises(ConnectionLost):
        serial.receive()
    with pytest.raises(TransportError):
        serial.send(b"x")
    pulling.join()


def test_a_port_that_another_program_configures(both: Both) -> None:
    """With VMIN = 0, reading a port returns b"" if no byte is available, which is not a removed port."""
    way = Way(both, SerialPeer())
    settings = termios.tcgetattr(way.do(way.link.fileno))
    settings[6][termios.VMIN] = 0
    termios.tcsetattr(way.do(way.link.fileno), termios.TCSANOW, settings)
    assert way.receive(SHORT) is None
    way.peer.send(b"late")
    assert way.receive() == b"late"
    way.close()


def test_writing_to_a_port_that_is_pulled_out(serial: Way) -> None:
    serial.hello()
    serial.peer.pull_out()
    with pytest.raises(ConnectionLost):
        serial.send(b"x")
        serial.receive()


@pytest.mark.parametrize("kind", PORTS)
def test_what_came_before_is_thrown_away(both: Both, kind: Any) -> None:
    peer = kind()
    peer.send(b"of another program")
    serial = Way(both, peer)
    serial.hello()
    peer.send(b"new")
    assert serial.receive() == b"new"
    serial.close()


def test_a_port_is_for_one_program(serial: Way) -> None:
    with pytest.raises(ConnectFailed, match="close the program that uses it"):
        serial.open(serial.peer.address)
    serial.hello()  # the first one still has it


def test_a_port_is_free_again(serial: Way) -> None:
    serial.hello()
    serial.do(serial.link.close)
    if serial._both.loop is not None:
        serial._both.run(_settled())
    serial.link = serial.open(serial.peer.address)
    serial.hello()


def test_an_open_that_was_cancelled_leaves_no_port_open(monkeypatch: pytest.MonkeyPatch) -> None:
    peer = SerialPeer()
    begun, go_on, duplicate = threading.Event(), threading.Event(), os.dup
    opened: list[int] = []

    def slowly(descriptor: int) -> int:
        begun.set()
        assert go_on.wait(PATIENT)
        opened.append(duplicate(descriptor))
        return opened[-1]

    async def body() -> None:
        task = asyncio.create_task(aio_links.open_link(peer.address, LinkOptions(PATIENT)))
        await asyncio.to_thread(begun.wait, PATIENT)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        go_on.set()

    monkeypatch.setattr(os, "dup", slowly)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        asyncio.run(body())  # waits for the thread
    assert [str(each.message) for each in said] == []
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(opened[0])
    peer.close()


@pytest.mark.parametrize(
    ("path", "advice"),
    [
        ("/dev/there-is-no-such-port", "check that it is plugged in"),
        ("/dev/null", "check that it is a serial port"),
        ("/dev", "check that it is a serial port"),
        ("/dev/null/x", "check that it is a serial port"),
    ],
)
def test_ports_that_cannot_be_opened(both: Both, path: str, advice: str) -> None:
    opening = links.open_link if both.loop is None else aio_links.open_link
    with pytest.raises(ConnectFailed, match=advice) as caught:
        both.run(opening(SerialAddress(path), LinkOptions(PATIENT)))
    assert path in str(caught.value)
    if both.loop is not None:
        both.run(both.loop.shutdown_default_executor())


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.EACCES, "dialout"), (errno.EBUSY, "close the program"), (errno.EIO, "check that it is a serial port")],
)
def test_what_to_try(number: int, advice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ConnectFailed, match=advice):
        links.open_link(SerialAddress("/dev/ttyUSB0"), LinkOptions(PATIENT))


@pytest.mark.parametrize("change", [{"baudrate": 12_345_678}, {"flow": 2}, {"flow": 1}, {"parity": "M"}, {"bits": 5}])
def test_settings_are_taken(both: Both, change: dict[str, Any]) -> None:
    """A pseudo-terminal accepts settings that it does not use."""
    peer = SerialPeer()
    peer.address = replace(peer.address, **change)
    serial = Way(both, peer)
    serial.send(b"\x15")
    assert peer.receive(1) == b"\x15"
    serial.close()


def test_settings_that_the_system_does_not_have(both: Both) -> None:
    peer = SerialPeer()
    peer.address = replace(peer.address, stop=1.5)
    with pytest.raises(ConnectFailed, match=r"supports these settings: .*stop=1\.5"):
        Way(both, peer)
    peer.close()
    if both.loop is not None:
        both.run(both.loop.shutdown_default_executor())


def test_without_serialx(both: Both, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.core.optional_deps.find_spec", lambda name: None)
    opening = links.open_link if both.loop is None else aio_links.open_link
    with pytest.raises(MissingExtra, match=r"orinkit\[serial\]"):
        both.run(opening(SerialAddress("/dev/ttyS0"), LinkOptions(PATIENT)))


def test_a_line_that_takes_nothing_does_not_keep_a_program(serial: Way) -> None:
    """Data that cannot be sent in time is lost: a request is sent again, a call ends with its time-out."""
    if serial._both.loop is None:
        began = time.monotonic()
        serial.link.send(bytes(200_000), SHORT)
        assert SHORT * 0.9 <= time.monotonic() - began < PATIENT / 2
    else:
        for _ in range(20):
            serial.send(bytes(200_000))
    assert serial.receive(SHORT) is None


def test_many_bytes_go_out_in_pieces(serial: Way) -> None:
    data = bytes(range(256)) * 256
    taken: list[bytes] = []
    taking = threading.Thread(target=lambda: taken.append(serial.peer.receive(len(data))))
    taking.start()
    serial.send(data)
    while taking.is_alive():
        serial.receive(SHORT)
    assert taken == [data]


def test_a_port_that_is_pulled_out_while_bytes_wait(serial: Way) -> None:
    if serial._both.loop is not None:
        serial.send(bytes(200_000))
    pulling = threading.Timer(SHORT, serial.peer.pull_out)
    pulling.start()
    with pytest.raises(ConnectionLost):
        if serial._both.loop is None:
            serial.send(bytes(200_000))
        serial.receive()
    pulling.join()
