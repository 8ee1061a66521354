"""Hosts against peers whose replies are lost, duplicated, late, short, foreign or reordered."""

from __future__ import annotations

import errno
import termios
import threading
import time
from collections.abc import Callable
from itertools import count
from typing import Any

import pytest
import serial

import can
from orinkit.abh3.session.multipacket import exchange
from orinkit.can.receiving import SIZE
from orinkit.core.errors import DriverFault, DriverTimeout, ProtocolError, TransportError
from support.abh3_wires import (
    COMMAND,
    FEEDBACK,
    KINDS,
    PATIENCE,
    REQUEST,
    Hosts,
    Peer,
    Place,
    arrived,
    broadcast,
    feedback,
    message,
    obliging,
    only_on,
    raw_bus,
    wait,
)
from support.both import Both
from support.waiting import until

SHORT = 0.15
"""Time-out of calls that get no reply, in s."""
SIMILAR: dict[str, can.Message] = {
    "another driver": feedback(99.0, 0x00EF0207),
    "to another host": feedback(99.0, 0x00EF0301),
    "to all": feedback(99.0, 0x00EFFF01),
    "another page": feedback(99.0, 0x01EF0201),
    "the reserved bit": feedback(99.0, 0x02EF0201),
    "its own command": feedback(99.0, COMMAND),
    "another format": feedback(99.0, 0x00EE0201),
    "a broadcast": broadcast(2, 99, 99),
    "short": message(FEEDBACK, b"\x63\x00\x63\x00"),
    "empty": message(FEEDBACK, b""),
    "a standard frame": message(0x201, bytes(range(8)), is_extended_id=False),
    "a remote frame": message(FEEDBACK, b"", is_remote_frame=True),
}
"""Frames that resemble a reply to a command."""
NOT_BY_SERIAL = {
    "a standard frame",
    "a remote frame",
}  # this interface of python-can supports extended data frames only
OWN = {"its own command"}  # the peer would receive its own frame, and reply


def times_out(both: Both, driver: Any, call: Callable[[], Any], function: str) -> None:
    """Check that a call times out, and not too early."""
    began = time.monotonic()
    with Hosts.in_vain(driver, SHORT), pytest.raises(DriverTimeout, match=function) as caught:
        both.run(call())
    assert SHORT * 0.9 <= time.monotonic() - began < PATIENCE
    assert (caught.value.address, caught.value.seconds) == (1, SHORT)


@pytest.mark.parametrize("bare", [*KINDS], indirect=True)
def test_lost_replies(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """Commands are then 0 and start is off; the next call succeeds."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    both.run(driver.set_inputs(0x3003))
    both.run(driver.command(100.0, 50.0))
    peer.script = lambda _frame: []
    times_out(both, driver, lambda: driver.command(120.0), "abh3_can_cmdAY")
    assert driver.commands == (0, 0)
    assert int(driver.inputs) == 0x1001
    peer.script = obliging
    assert both.run(driver.command(bx=10.0)).a_velocity == 0
    assert peer.data[-2:] == ["00EF0102#58 02 fa 00 03 30 00 00", "00EF0102#00 00 32 00 01 10 00 00"]


@only_on("udp_multicast", because="what is not answered is the same everywhere")
def test_every_call_has_its_time_out(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    peer.script = lambda _frame: []
    for call, name in [
        (driver.init, "cmd_init"),
        (driver.command, "abh3_can_cmd"),
        (lambda: driver.set_inputs(0), "inSet"),
        (lambda: driver.set_input(0, 1), "inBitSet"),
        (driver.errors, "reqBRD"),
        (lambda: driver.request_broadcast(0, everyone=True), "reqBRDBRD"),
        (driver.request_single, "reqSNG"),
        (driver.stop, "abh3_can_cmd"),
        (driver.reset_errors, "inBitSet"),
    ]:
        times_out(both, driver, call, name)
    peer.script = obliging
    assert both.run(driver.command(1.0)).a_velocity == 1.0


@only_on("udp_multicast", because="what is not answered is the same everywhere")
def test_a_lost_request_keeps_the_commands(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = lambda frame: obliging(frame) if frame.arbitration_id == COMMAND else []
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    both.run(driver.command(100.0))
    with hosts.in_vain(driver, SHORT), pytest.raises(DriverTimeout):
        both.run(driver.pulses())
    assert driver.commands == (100.0, 0.0)


@only_on("virtual", "udp_multicast", because="the second copy has arrived when it was sent")
def test_duplicate_replies(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The second copy is not taken as the reply to the next call."""
    peer.script = lambda frame: obliging(frame) * 2
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    for number in range(1, 60):
        until(lambda: peer.served == len(peer.heard))
        assert both.run(driver.command(float(number))).a_velocity == number
        if number % 5 == 0:
            until(lambda: peer.served == len(peer.heard))
            assert both.run(driver.pulses()).a_pulses == 4


@pytest.mark.parametrize("bare", [*KINDS], indirect=True)
def test_late_replies(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A reply after the time-out is dropped: it is not taken as the reply to the next call."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    peer.script = lambda _frame: []
    for call in (lambda: driver.command(77.0), driver.pulses):
        with hosts.in_vain(driver, SHORT), pytest.raises(DriverTimeout):
            both.run(call())
    peer.send(feedback(77.0), broadcast(4, 77, 77), feedback(78.0))
    arrived(both, bare, driver, 3)
    peer.script = obliging
    assert both.run(driver.command(1.0)).a_velocity == 1.0
    assert both.run(driver.pulses()).a_pulses == 4


@only_on("virtual", "udp_multicast", because="they are the same everywhere")
def test_a_late_reply_within_the_next_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The late broadcast is not a reply to a request for another one, nor to a command."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    peer.script = lambda _frame: []
    with hosts.in_vain(driver, SHORT), pytest.raises(DriverTimeout):
        both.run(driver.pulses())
    peer.script = lambda frame: [broadcast(4, 77, 77), *obliging(frame)]
    assert both.run(driver.errors()).warnings.value == 0
    assert both.run(driver.command(3.0)).a_velocity == 3.0
    peer.script = lambda frame: [feedback(55.0), *obliging(frame)]
    assert int(both.run(driver.states()).io) == 1


@pytest.mark.parametrize("bare", [*KINDS], indirect=True)
def test_frames_that_resemble_a_reply(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """They are skipped: the reply after them is taken, and without one the call times out."""
    left_out = {"serial": NOT_BY_SERIAL, "udp_multicast": OWN}.get(bare.kind, set())
    similar = [frame for name, frame in SIMILAR.items() if name not in left_out]
    peer.script = lambda frame: [*similar, *obliging(frame)]
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    assert both.run(driver.command(5.0)).a_velocity == 5.0
    both.run(driver.close())
    driver = hosts.connect(bare.near, timeout=PATIENCE, init=False)
    peer.script = lambda _frame: similar
    times_out(both, driver, lambda: driver.command(5.0), "abh3_can_cmdAY")


def test_broadcasts_that_resemble_a_reply(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    wrong = [
        broadcast(3, 99, 99),
        broadcast(4, 99, 99, source=7),
        message(0x00FF3401, bytes(8)),  # of another group
        message(0x01FF2C01, bytes(8)),
        message(0x00FF2C01, bytes(7)),
        *(
            [] if bare.kind == "udp_multicast" else [message(REQUEST, b"\x2c\xff\x00")]
        ),  # the peer would receive its own frame
    ]
    peer.script = lambda frame: [*wrong, *obliging(frame)]
    driver = hosts.connect(bare.near, timeout=PATIENCE, init=False)
    found = both.run(driver.pulses())
    assert (found.a_pulses, found.b_pulses) == (4, 4)
    if bare.kind == "virtual":
        found = both.run(driver.bus.request_all(4, seconds=PATIENCE, count=2))
        assert {address: record.a_pulses for address, record in found.items()} == {7: 99, 1: 4}


@only_on("udp_multicast", because="it is the same everywhere")
def test_priorities_are_ignored(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """Frames of a driver may have any priority, independent of the host's."""
    priorities = count()

    def raised(frame: can.Message) -> list[can.Message]:
        assert frame.arbitration_id >> 26 == 3
        frame.arbitration_id &= 0x03FFFFFF
        answers = obliging(frame)
        for answer in answers:
            answer.arbitration_id |= (next(priorities) & 7) << 26
        return answers

    peer.script = raised
    driver = hosts.connect(bare.near, timeout=PATIENCE, priority=3)
    for number in range(56):
        assert both.run(driver.command(float(number))).a_velocity == number
        assert next(iter(both.run(driver.request_broadcast(number % 7)).raw_values.values())) is not None
    peer.script = lambda _frame: [broadcast(2, source=source, priority=source) for source in (1, 5, 7)]
    assert list(both.run(driver.bus.request_all(2, seconds=PATIENCE, count=3))) == [1, 5, 7]


@only_on("virtual", "udp_multicast", because="they are the same everywhere")
def test_reordered_replies(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """Two drivers are commanded at the same time; the peer replies in reverse order."""
    held: list[can.Message] = []

    def reversing(frame: can.Message) -> list[can.Message]:
        to = frame.arbitration_id >> 8 & 0xFF
        held.append(message(0x00EF0200 | to, bytes(frame.data[:2]) + bytes(6)))
        if len(held) < 2:
            return []
        answers, held[:] = held[::-1], []
        return answers

    peer.script = reversing
    bus = hosts.open_bus(bare.near)
    one, seven = (bus.driver(address=address, timeout=PATIENCE) for address in (1, 7))

    async def asks(driver: Any, first: int) -> bool:
        return all([(await both.now(driver.command(first + n))).a_velocity == first + n for n in range(100)])

    assert both.side_by_side(asks(one, 100), asks(seven, 300)) == [True, True]
    peer.script = obliging  # driver 7 does not reply now, so nothing may be sent to it at the end
    both.run(one.stop())
    seven.host.reset_commands()


@only_on("virtual", because="it is the same everywhere")
def test_unsolicited_frames_between_calls(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A driver also sends its feedback periodically: old feedback is not taken as the reply."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    for number in range(20):
        peer.send(*[feedback(99.0)] * 300)  # more than a receiver buffers
        if both.loop is not None:
            wait(both, lambda: len(driver._port.frames) == SIZE)
        assert both.run(driver.command(float(number))).a_velocity == number


@only_on("udp_multicast", because="it is the same everywhere")
def test_errors_that_remain(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    def faulty(frame: can.Message) -> list[can.Message]:
        return [broadcast(0, 0x40, 0)] if frame.arbitration_id == REQUEST else obliging(frame)

    peer.script = faulty
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    with pytest.raises(DriverFault) as caught:
        both.run(driver.reset_errors(tries=2))
    assert (caught.value.errors, caught.value.warnings) == (0x40, 0)
    resets = [frame.data[7] >> 7 for frame in peer.heard if frame.arbitration_id == COMMAND]
    assert resets == [0, 0, 1, 0, 0, 1, 0]  # init, then an edge in each attempt; the bit is cleared at the end
    assert int(driver.inputs) == 0


@only_on("udp_multicast", because="it is the same everywhere")
def test_interrupted_messages(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Multi-packet messages: an abort raises at once, a missing frame after a time-out; commands still work."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    peer.script = lambda frame: (
        [message(0x00EC0201, b"\xff\x02\xff\xff\xff\x00\xef\x00")]
        if frame.arbitration_id == 0x00EC0102
        else obliging(frame)
    )
    with pytest.raises(ProtocolError):
        both.run(driver.read_parameter(0x4102))
    peer.script = obliging
    for name in ("_sync", "_async"):
        monkeypatch.setattr(f"orinkit.abh3.api.{name}.shared.exchange", exchange)
    with pytest.raises(DriverTimeout):
        both.run(driver.read_parameter(0x4102))
    assert both.run(driver.command(4.0)).a_velocity == 4.0


# --- a program that is suspended --------------------------------------------------------------------------------------


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("virtual", "serial", because="a thread reads for the loop there")
def test_a_late_reply_that_the_thread_holds(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It arrived before the next call, which waits until the thread has passed it on, and drops it."""
    monkeypatch.setattr("orinkit.can.aio_shared_bus._GLANCES", 100_000)
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    bus = driver.bus._line._bus
    real, waiting = bus._bus.recv, bus.waiting
    taken = threading.Event()
    looks: list[None] = []

    def holds(seconds: float) -> can.Message | None:
        found = real(seconds)
        if found is not None and not taken.is_set():
            taken.set()
            until(lambda: len(looks) > 3)
        return found

    def looked() -> bool:
        looks.append(None)
        return waiting()

    monkeypatch.setattr(bus._bus, "recv", holds)
    peer.send(feedback(77.0))
    until(taken.is_set)
    monkeypatch.setattr(bus, "waiting", looked)
    assert both.run(driver.command(1.0)).a_velocity == 1.0


@only_on("slcan", "serial", because="others have no such time-out")
def test_a_frame_accepted_while_the_program_was_suspended(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pyserial reports a time-out, as it checks the time after writing. A port that accepts nothing raises."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    bus = vars(driver.bus._line._bus._bus)
    port = bus.get("serialPortOrig") or bus["_ser"]
    real = port.write

    def stands_still(data: bytes) -> None:
        real(data)
        raise serial.SerialTimeoutException("Write timeout")

    with monkeypatch.context() as patched:
        patched.setattr(port, "write", stands_still)
        assert both.run(driver.command(5.0)).a_velocity == 5.0
    termios.tcflow(port.fileno(), termios.TCOOFF)
    with hosts.in_vain(driver, SHORT), pytest.raises(TransportError, match="could not be sent"):
        both.run(driver.command(6.0))
    termios.tcflow(port.fileno(), termios.TCOON)
    assert both.run(driver.command(7.0)).a_velocity == 7.0


@only_on("slcan", because="it waits until a frame was sent")
def test_a_program_stopped_and_continued_while_sending(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python does not resume that wait; the frame has been accepted."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)

    def interrupted() -> None:
        raise termios.error(errno.EINTR, "Interrupted system call")

    with monkeypatch.context() as patched:
        patched.setattr(driver.bus._line._bus._bus.serialPortOrig, "flush", interrupted)
        assert both.run(driver.command(5.0)).a_velocity == 5.0
    assert both.run(driver.command(7.0)).a_velocity == 7.0


# --- other traffic ----------------------------------------------------------------------------------------------------

RATE = 2000


class Traffic:
    """Other nodes on the bus, with about 2,000 frames of all kinds per second."""

    def __init__(self, bus: can.BusABC) -> None:
        self.sent = 0
        self._bus = bus
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="traffic", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        numbers = count()
        began = time.monotonic()
        while not self._ending.wait(0.01):
            due = min((time.monotonic() - began) * RATE, self.sent + RATE / 10)
            while self.sent < due:
                self._bus.send(self._frame(next(numbers)))
                self.sent += 1

    @staticmethod
    def _frame(number: int) -> can.Message:
        data = number.to_bytes(8, "little")
        kinds = (
            message(0x18FEF100 | number & 0xFF, data),
            message(number % 0x800, data, is_extended_id=False),
            message(FEEDBACK, b"", is_remote_frame=True),
            message(0x00EF0103, data),  # another host
            message(0x00EF0301, data),  # and the frames for it
            message(0x00EF0207, data),  # another driver
            message(FEEDBACK, data[:4]),
            message(0x00FF2A07, data),
            message(0x00FF2C01, data[:5]),
        )
        return kinds[number % len(kinds)]

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._bus.shutdown()


@only_on("virtual", "udp_multicast", because="others are on the same bus")
def test_foreign_traffic(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer._is_for_me = lambda found: found.arbitration_id in (COMMAND, REQUEST)
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    traffic = Traffic(raw_bus(bare.near))
    try:
        until(lambda: traffic.sent > 100)
        for number in range(200):
            assert both.run(driver.command(float(number))).a_velocity == number
            if number % 4 == 0:
                assert both.run(driver.pulses()).a_pulses == 4
        peer.script = lambda _frame: []
        for _ in range(10):
            before = traffic.sent
            times_out(both, driver, lambda: driver.command(1.0), "abh3_can_cmdAY")
            if traffic.sent - before > RATE * SHORT / 10:  # the traffic did not stop
                break
        else:
            pytest.fail("there was no traffic")
        peer.script = obliging
        assert both.run(driver.command(2.0)).a_velocity == 2.0
    finally:
        traffic.close()
