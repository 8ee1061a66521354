"""Devices on a CAN bus: replies, periodic frames, echoes, failing devices and buses."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from itertools import count

import pytest

import can
from orinkit.can.frame import CanFrame
from orinkit.can.server import CanServer, serve_can
from orinkit.core import i18n
from orinkit.core.errors import ConnectFailed, InvalidAddress, InvalidValue
from orinkit.virtual.clock import Clock, ManualClock
from support import multicast
from support.multicast import GROUP, free_port
from support.waiting import until

CHANNELS = count()
PORT = free_port()
BY_MULTICAST = multicast.bus(PORT)


class Device:
    """Replies to single packets for its address, and sends a frame every period."""

    def __init__(self, address: int = 1, *, clock: Clock | None = None, period: float | None = None) -> None:
        self.address = address
        self.clock: Clock = clock or Clock()
        self.period = period
        self.next = 0.0
        self.received: list[CanFrame] = []
        self.advanced = 0
        self.closed = 0
        self.threads: set[int] = set()
        self.fails_at = ""

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        self.threads.add(threading.get_ident())
        self.received.append(frame)
        if self.fails_at == "receive":
            raise ZeroDivisionError("a bug of the device")
        if frame.id >> 8 & 0xFFFF == 0xEF00 | self.address:
            return [CanFrame(0xEF0000 | (frame.id & 0xFF) << 8 | self.address, frame.data)]
        return []

    def advance(self) -> list[CanFrame]:
        self.threads.add(threading.get_ident())
        self.advanced += 1
        if self.fails_at == "advance":
            raise ZeroDivisionError("a bug of the device")
        if self.period is None or self.clock.now() < self.next:
            return []
        self.next += self.period
        return [CanFrame(0xFF2A00 | self.address, bytes(8))]

    def due(self) -> float | None:
        if self.fails_at == "due":
            raise ZeroDivisionError("a bug of the device")
        return None if self.period is None else self.next

    def close(self) -> None:
        self.closed += 1


class Broken(can.BusABC):
    """A bus whose operations fail as the test sets."""

    def __init__(self, channel: str = "") -> None:
        super().__init__(channel)
        self.channel_info = "a broken bus"
        self.receiving: Exception | None = None
        self.sending: Exception | None = None
        self.tries = 0
        self.sent: list[can.Message] = []
        self.shut = 0

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.tries += 1
        if self.receiving is not None:
            raise self.receiving
        time.sleep(min(timeout or 0, 0.01))
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.sending is not None:
            raise self.sending
        self.sent.append(msg)

    def shutdown(self) -> None:
        super().shutdown()
        self.shut += 1


def message(number: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=number, data=data)


def answer(bus: can.BusABC, number: int, seconds: float = 30) -> can.Message:
    """Return the next frame with an identifier."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        found = bus.recv(left)
        if found is not None and found.arbitration_id == number:
            return found
    raise AssertionError("no answer")


@pytest.fixture
def url() -> str:
    return f"can://virtual/server-{next(CHANNELS)}"


@pytest.fixture
def peer(url) -> Iterator[can.BusABC]:
    """Another node of the bus."""
    with can.Bus(interface="virtual", channel=url.rpartition("/")[2], ignore_config=True) as bus:
        yield bus


@pytest.fixture
def device() -> Device:
    return Device()


def test_a_device_answers(url, peer, device):
    with serve_can(device, at=url) as server:
        assert server.url == url
        for number in range(20):
            peer.send(message(0xEF0102, bytes([number])))
            assert answer(peer, 0xEF0201).data == bytes([number])
    assert [frame.id for frame in device.received] == [0xEF0102] * 20
    assert (device.closed, len(device.threads)) == (1, 1)


def test_every_device_gets_every_frame(url, peer):
    devices = [Device(1), Device(3), Device(7)]
    with serve_can(*devices, at=url):
        peer.send(message(0xEF0302, b"x"))
        assert answer(peer, 0xEF0203).data == b"x"
        until(lambda: all(len(device.received) == 1 for device in devices))
    assert [device.closed for device in devices] == [1, 1, 1]


def test_due_frames_are_sent(url, peer):
    with serve_can(Device(period=0.01), at=url):
        for _ in range(5):
            answer(peer, 0xFF2A01)


def test_a_clock_that_is_faster(url, peer):
    began = time.monotonic()
    with serve_can(Device(period=100.0, clock=Clock(10_000)), at=url):
        for _ in range(5):
            answer(peer, 0xFF2A01)
    assert time.monotonic() - began < 60  # 500 s of the device


def test_a_clock_that_is_slower(url, peer):
    device = Device(period=0.1, clock=Clock(0.001))
    began = time.monotonic()
    with serve_can(device, at=url):
        answer(peer, 0xFF2A01)
        assert peer.recv(0.3) is None  # the next one is 100 s away
        advanced = device.advanced
        assert advanced < 10 + 40 * (time.monotonic() - began)  # it is not polled all the time


def test_an_idle_device_is_advanced(url, device):
    """Its backlog is small when a frame arrives."""
    with serve_can(device, at=url):
        until(lambda: device.advanced > 3)


def test_a_clock_that_is_moved_by_hand(url, peer):
    clock = ManualClock()
    device = Device(period=5.0, clock=clock)
    with serve_can(device, at=url):
        answer(peer, 0xFF2A01)
        assert peer.recv(0.2) is None
        clock.advance(5.0)
        answer(peer, 0xFF2A01)


def test_a_device_that_is_always_due_does_not_starve_others(url, peer):
    greedy, device = Device(3, period=0.0), Device(1)
    with serve_can(greedy, device, at=url):
        peer.send(message(0xEF0102, b"!"))
        assert answer(peer, 0xEF0201).data == b"!"
        until(lambda: greedy.advanced > 10)


def test_a_device_does_not_receive_its_own_frames():
    """udp_multicast returns the frames that were sent."""
    devices = [Device(1), Device(3)]
    with (
        serve_can(*devices, at=BY_MULTICAST) as server,
        can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, ignore_config=True) as peer,
    ):
        assert server.url == BY_MULTICAST
        for device in devices:
            peer.send(message(0xEF0002 | device.address << 8, b"hello"))
            answer(peer, 0xEF0200 | device.address)
        until(
            lambda: any(frame.id == 0xEF0203 for frame in devices[0].received)
        )  # that of the other one is passed to it
        assert all(frame.id & 0xFF != device.address for device in devices for frame in device.received)


def test_two_devices_with_one_address(url):
    with pytest.raises(InvalidValue, match="address 1"):
        serve_can(Device(1), Device(1), at=url)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="アドレス 1"):
        serve_can(Device(1), Device(1), at=url)


@pytest.mark.parametrize("at", ["tcp://127.0.0.1:5007", "can://nothing/like-that", "can://udp_multicast/no-address"])
def test_an_invalid_address(at, device):
    with pytest.raises((InvalidAddress, ConnectFailed)):
        serve_can(device, at=at)
    assert threading.active_count() >= 1
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("orinkit-can")]


@pytest.mark.parametrize("where", ["receive", "advance", "due"])
def test_a_failing_device_is_logged_and_still_served(url, peer, caplog, where):
    bad, good = Device(3, period=0.01), Device(1)
    bad.fails_at = where
    with caplog.at_level(logging.ERROR, "orinkit.server"), serve_can(bad, good, at=url):
        for _ in range(50):
            peer.send(message(0xEF0102, b"!"))
            answer(peer, 0xEF0201)
        until(lambda: caplog.records)
        bad.fails_at = ""
        peer.send(message(0xEF0302, b"?"))
        assert answer(peer, 0xEF0203).data == b"?"
    assert bad.closed == 1
    assert caplog.records[0].exc_info
    assert len(caplog.records) < 30  # not one for each frame


def test_invalid_frames_are_not_sent(url, peer, caplog, device):
    device.receive = lambda frame: [
        CanFrame(1 << 40, b""),
        CanFrame(0xEF0201, b"123456789"),
        None,
        CanFrame(0xEF0201, b"!"),
    ]
    with serve_can(device, at=url):
        for _ in range(20):
            peer.send(message(0xEF0102))
            assert answer(peer, 0xEF0201).data == b"!"
    messages = [record.getMessage() for record in caplog.records if record.name == "orinkit.server"]
    assert "which is not a CAN frame" in messages[0]
    assert len(messages) < 20


def test_foreign_frames_by_the_thousand(url, peer, device):
    """Replies arrive between thousands of frames for others."""
    ending = threading.Event()

    def flood() -> None:
        with can.Bus(interface="virtual", channel=url.rpartition("/")[2], ignore_config=True) as bus:
            while not ending.wait(0.01):
                for number in range(20):
                    bus.send(message(0x18FEF100 | number))

    with serve_can(device, at=url):
        thread = threading.Thread(target=flood)
        thread.start()
        asked = 0
        try:
            while len(device.received) - asked < 2000:
                peer.send(message(0xEF0102, bytes([asked & 0xFF])))
                assert answer(peer, 0xEF0201).data == bytes([asked & 0xFF])
                asked += 1
        finally:
            ending.set()
            thread.join()
    assert asked > 0


def test_a_bus_of_the_caller(device):
    with can.Bus(interface="virtual", channel="callers", ignore_config=True) as bus:
        with serve_can(device, at=bus) as server:
            assert server.url == "can://virtual/callers"
            with can.Bus(interface="virtual", channel="callers", ignore_config=True) as peer:
                peer.send(message(0xEF0102, b"!"))
                assert answer(peer, 0xEF0201).data == b"!"
        bus.send(message(1))  # it is still open


def test_a_bus_that_is_lost_and_recovers(caplog):
    bus, device = Broken(), Device(period=0.02)
    bus.receiving = can.CanOperationError("the cable was pulled")
    with caplog.at_level(logging.INFO, "orinkit.server"), serve_can(device, at=bus):
        until(lambda: bus.tries >= 2)  # it is retried
        advanced = device.advanced
        until(lambda: device.advanced > advanced + 5)  # while the device continues
        assert len(caplog.records) == 1
        bus.receiving = None
        until(lambda: bus.sent)
        until(lambda: len(caplog.records) == 2)
    first, second = (record.getMessage() for record in caplog.records)
    assert "the cable was pulled" in first
    assert "back" in second
    assert bus.shut == 0
    bus.shutdown()


def test_a_bus_that_is_reopened(monkeypatch, caplog):
    made: list[Broken] = []

    def opened(address: object) -> can.BusABC:
        if len(made) == 1 and not made[0].shut:
            raise AssertionError("two at a time")
        made.append(Broken())
        return made[-1]

    monkeypatch.setattr("orinkit.can.bus.open_bus", opened)
    device = Device(period=0.02)
    with caplog.at_level(logging.WARNING, "orinkit.server"), serve_can(device, at="can://socketcan/can0") as server:
        assert server.url == "can://socketcan/can0"
        until(lambda: made[0].sent)
        made[0].sending = OSError("no such device")
        until(lambda: len(made) == 2 and made[1].sent)
        assert len(caplog.records) == 1
    assert [bus.shut > 0 for bus in made] == [True, True]


def test_closing_while_a_bus_is_being_opened(monkeypatch):
    made, opening, let = [], threading.Event(), threading.Event()

    def opened(address: object) -> can.BusABC:
        if made:
            opening.set()
            let.wait(30)
        made.append(Broken())
        return made[-1]

    monkeypatch.setattr("orinkit.can.bus.open_bus", opened)
    server = serve_can(Device(), at="can://socketcan/can0")
    made[0].receiving = OSError("gone")
    until(opening.is_set)
    closer = threading.Thread(target=server.close)
    closer.start()
    let.set()
    closer.join(30)
    assert not closer.is_alive()
    until(lambda: all(bus.shut for bus in made))


def test_frames_that_are_not_accepted(caplog):
    bus, device = Broken(), Device(period=0.005)
    bus.sending = can.CanTimeoutError("nobody acknowledges")
    with caplog.at_level(logging.WARNING, "orinkit.server"), serve_can(device, at=bus):
        until(lambda: device.advanced > 20)
        assert len(caplog.records) == 1
        assert bus.sent == []
        bus.sending = None
        until(lambda: bus.sent)
    bus.shutdown()


def closes(server: CanServer) -> bool:
    thread = threading.Thread(target=server.close)
    thread.start()
    thread.join(30)
    return not thread.is_alive()


def test_closing_twice_and_by_another_thread(url, device):
    server = serve_can(device, at=url)
    waiter = threading.Thread(target=server.wait)
    waiter.start()
    server.wait(0.01)
    assert closes(server)
    assert closes(server)
    waiter.join(30)
    assert not waiter.is_alive()
    assert device.closed == 1
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("orinkit-can")]


def test_a_device_that_closes_its_server(url, peer, device):
    server = serve_can(device, at=url)
    device.receive = lambda frame: server.close()
    peer.send(message(0xEF0102))
    until(lambda: device.closed == 1)
    server.wait(30)
    server.close()
