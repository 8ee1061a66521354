"""A CAN bus shared by several receivers, in threads and in asyncio: over python-can buses, and over a faulty one."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from inspect import isawaitable
from itertools import count
from time import monotonic, process_time, sleep
from typing import Any

import pytest

import can
from orinkit.can.aio_shared_bus import AsyncSharedCanBus, arun_can
from orinkit.can.bus import Bus, open_bus, to_frame, to_message
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.can.shared_bus import SharedCanBus, run_can
from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, InvalidValue, OrinError, TransportError
from orinkit.transport.address import CanAddress, parse_address
from support import multicast
from support.both import Both
from support.can_ptys import CrossedPtys, crossed_ptys
from support.waiting import PATIENCE, interrupted_at, until

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")
KINDS = ["virtual", "udp_multicast", *(["slcan", "serial"] if os.name != "nt" else [])]
REQUEST, ANSWER, OTHER = 0x18EF0102, 0x18EF0201, 0x18FF5501
GROUP = (multicast.GROUP, multicast.free_port())
_numbers = count()


def frame(number: int = ANSWER, data: bytes = b"12345678") -> CanFrame:
    return CanFrame(number, data)


def address_of(text: str) -> CanAddress:
    address = parse_address(text)
    assert isinstance(address, CanAddress)
    return address


def addresses(kind: str, cable: CrossedPtys | None) -> tuple[CanAddress, CanAddress]:
    """Return two addresses of the same bus."""
    if cable is not None:
        return CanAddress(kind, cable.left), CanAddress(kind, cable.right)
    if kind == "virtual":
        address = CanAddress(kind, f"lines-{next(_numbers)}")
    else:
        address = CanAddress(kind, GROUP[0], None, (("port", GROUP[1]),))
    return address, address


class Lines:
    """Shared buses of either kind, and calls on them, made in the event loop in asyncio."""

    def __init__(self, both: Both) -> None:
        self.both = both
        self._open: list[Any] = []

    def line(self, bus: can.BusABC | CanAddress, *, own: bool = True) -> Any:
        wrapped = Bus.open(bus) if isinstance(bus, CanAddress) else Bus(bus, own=own)
        line = self.do(SharedCanBus if self.both.loop is None else AsyncSharedCanBus, wrapped)
        self._open.append(line)
        return line

    def do(self, call: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Return the result of a call, made in the event loop if there is one."""

        async def body() -> Any:
            result = call(*arguments, **options)
            return await result if isawaitable(result) else result

        return call(*arguments, **options) if self.both.loop is None else self.both.run(body())

    def run(self, operation: CanOperation[Any], port: Any) -> Any:
        return self.do(run_can if self.both.loop is None else arun_can, operation, port)

    async def now(self, result: Any) -> Any:
        return await self.both.now(result)

    def others_wait(self, line: Any, number: int) -> Any:
        """Wait until other callers wait on a shared bus; awaitable like the calls on it."""
        if self.both.loop is None:
            return until(lambda: (line._reader is not None) + len(line._waiting) == number)

        async def body() -> None:
            while sum(len(port._waiters) for port in line._ports) != number:  # noqa: ASYNC110 - cannot be awaited
                await asyncio.sleep(0.002)

        return body()

    def side_by_side(self, *bodies: Any) -> list[Any]:
        return self.both.side_by_side(*bodies)

    def close(self) -> None:
        for line in self._open:
            self.do(line.close)


@pytest.fixture
def lines(both: Both) -> Iterator[Lines]:
    before = threading.active_count()
    opened = Lines(both)
    yield opened
    opened.close()
    until(lambda: threading.active_count() <= before)  # a thread that opened a bus may still be ending


@pytest.fixture
def clears_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Raise the limits of clearing, which gives up while frames keep arriving."""
    for module in ("shared_bus", "aio_shared_bus"):
        monkeypatch.setattr(f"orinkit.can.{module}._GLANCES", 100_000)
    monkeypatch.setattr("orinkit.can.shared_bus._DRAIN_TIMEOUT", PATIENCE)


def ask(*, seconds: float = PATIENCE, answer: int = ANSWER, data: bytes = b"ask") -> CanOperation[CanFrame | None]:
    """Send one request and wait for its reply among other frames."""
    received = yield OperationStep((frame(REQUEST, data),), seconds, True)
    while received is not None and received.id != answer:
        received = yield OperationStep()
    return received


def everything(_frame: CanFrame) -> bool:
    return True


@contextmanager
def echo(bus: can.BusABC, answers: Callable[[CanFrame], list[CanFrame]]) -> Iterator[None]:
    """Reply to each frame, as a device does."""
    ending = threading.Event()
    wrapped = Bus(bus, own=False)

    def run() -> None:
        while not ending.is_set():
            got = wrapped.receive(0.05)
            for answer in answers(got) if got is not None else ():
                wrapped.send(answer, 1.0)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def answering(got: CanFrame) -> list[CanFrame]:
    if got.id & ~0xFF00 != REQUEST & ~0xFF00:
        return []
    return [CanFrame(ANSWER & ~0xFF | got.id >> 8 & 0xFF, got.data)]  # to the requesting host


def bytes_that_wait(line: Any) -> int:
    """Return the number of unread bytes of a serial port."""
    import fcntl
    import termios

    return int.from_bytes(fcntl.ioctl(line._bus.fileno(), termios.FIONREAD, bytes(4)), sys.byteorder)


@contextmanager
def all_arrives(line: Any, kind: str, bus: can.BusABC, frames: int) -> Iterator[None]:
    """Wait until all frames sent over a bus can be read by the shared bus.

    With slcan a part of the last frame may be missing, as a few bytes of opening the bus may be counted.

    Args:
        line: The shared bus; no call may be waiting on it.
        kind: Interface of the bus.
        bus: The bus that sends.
        frames: Number of frames for the shared bus.
    """
    written: list[int] = []
    serial = vars(bus).get("_ser") or vars(bus).get("serialPortOrig")  # of serial and of slcan
    if serial is not None:
        write = serial.write

        def count(data: bytes) -> Any:
            written.append(len(data))
            return write(data)

        serial.write = count
    with ExitStack() as stack:
        witness = stack.enter_context(open_bus(addresses(kind, None)[0])) if kind == "udp_multicast" else None
        yield
        reader = getattr(line, "_thread", None)
        if reader is not None:
            until(lambda: len(reader._frames) == frames)
        elif serial is not None:
            until(lambda: bytes_that_wait(line) >= sum(written))
        elif witness is not None:
            seen = Bus(witness, own=False)
            for _ in range(frames):
                assert seen.receive(PATIENCE)


@contextmanager
def two_places(kind: str) -> Iterator[tuple[CanAddress, can.BusABC]]:
    """Provide an address, and a python-can bus that is connected to it."""
    with ExitStack() as stack:
        if kind in ("slcan", "serial"):
            yield stack.enter_context(two_places_and_cable(kind))[:2]
            return
        mine, other = addresses(kind, None)
        yield mine, stack.enter_context(open_bus(other))


@contextmanager
def two_places_and_cable(kind: str) -> Iterator[tuple[CanAddress, can.BusABC, CrossedPtys]]:
    with crossed_ptys() as cable:
        mine, other = addresses(kind, cable)
        with open_bus(other) as bus:
            yield mine, bus, cable


# --- requests and replies ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_request_and_its_reply(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, other):
        port = lines.do(lines.line(mine).receiver, lambda got: got.id == ANSWER)
        with echo(other, answering):
            for number in range(20):
                answer = lines.run(ask(data=bytes([number] * (number % 9))), port)
                assert answer is None or answer.id == ANSWER
                assert answer is not None
                assert answer.data == bytes([number] * (number % 9))


@pytest.mark.parametrize("kind", KINDS)
def test_no_reply(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, _):
        port = lines.do(lines.line(mine).receiver, lambda got: got.id == ANSWER)
        begin = monotonic()
        assert lines.run(ask(seconds=0.2), port) is None
        assert 0.19 < monotonic() - begin < PATIENCE


@pytest.mark.parametrize("kind", KINDS)
def test_stale_replies_are_dropped(lines: Lines, kind: str, clears_all: None) -> None:
    with two_places(kind) as (mine, other):
        line = lines.line(mine)
        port = lines.do(line.receiver, lambda got: got.id == ANSWER)
        beside = lines.do(line.receiver, lambda got: got.id == OTHER)
        with all_arrives(line, kind, other, 100):
            for number in range(50):
                other.send(can.Message(arbitration_id=ANSWER, data=[number]), 1)
                other.send(can.Message(arbitration_id=0x123, is_extended_id=False), 1)
                if kind != "serial":  # it has no remote frames
                    other.send(can.Message(arbitration_id=ANSWER, is_remote_frame=True), 1)
                other.send(can.Message(arbitration_id=OTHER, data=[number]), 1)
        lines.do(port.clear)
        assert lines.do(port.receive, 0.05) is None
        got = [lines.do(beside.receive, 10.0) for _ in range(50)]
        assert [each.data for each in got] == [bytes([number]) for number in range(50)]
        with echo(other, answering):
            assert lines.run(ask(data=b"fresh"), port).data == b"fresh"


def test_stale_replies_behind_a_filter(lines: Lines, clears_all: None) -> None:
    mine, there = addresses("virtual", None)
    with open_bus(there) as other, open_bus(mine) as bus:
        bus.set_filters([{"can_id": ANSWER, "can_mask": 0x1FFFFFFF, "extended": True}])
        port = lines.do(lines.line(bus, own=False).receiver, everything)
        for _ in range(1000):
            other.send(can.Message(arbitration_id=OTHER))
        other.send(can.Message(arbitration_id=ANSWER, data=b"stale"))
        lines.do(port.clear)
        assert lines.do(port.receive, 0.1) is None


def test_acknowledgements_of_an_adapter_do_not_end_the_wait(lines: Lines, clears_all: None) -> None:
    with crossed_ptys() as cable:
        line = lines.line(CanAddress("slcan", cable.left))
        port = lines.do(line.receiver, everything)
        noise = b"".join(b"\rz\rT%08X1%02X\r\aZ\r" % (ANSWER, number) for number in range(30))
        cable.write(cable.left, noise)
        until(lambda: bytes_that_wait(line) == len(noise))
        lines.do(port.clear)
        assert lines.do(port.receive, 0.1) is None
        cable.write(cable.left, b"T%08X1" % ANSWER)  # in two pieces
        assert lines.do(port.receive, 0.05) is None
        cable.write(cable.left, b"AB\r")
        assert lines.do(port.receive, PATIENCE).data == b"\xab"


def test_every_receiver_gets_its_frames(lines: Lines) -> None:
    mine, there = addresses("virtual", None)
    with open_bus(there) as other:
        line = lines.line(mine)
        ports = [lines.do(line.receiver, accepts) for accepts in (everything, lambda got: got.id == OTHER, everything)]
        other.send(to_message(frame(OTHER)))
        other.send(to_message(frame(ANSWER)))
        assert [lines.do(ports[0].receive, 10.0).id for _ in range(2)] == [OTHER, ANSWER]
        assert lines.do(ports[1].receive, 10.0).id == OTHER
        assert lines.do(ports[1].receive, 0.05) is None
        assert [lines.do(ports[2].receive, 10.0).id for _ in range(2)] == [OTHER, ANSWER]


def test_the_oldest_frames_are_dropped(lines: Lines) -> None:
    mine, there = addresses("virtual", None)
    with open_bus(there) as other:
        line = lines.line(mine)
        small = lines.do(line.receiver, everything, size=3)
        beside = lines.do(line.receiver, everything)
        for number in range(10):
            other.send(to_message(frame(data=bytes([number]))))
        for _ in range(10):
            assert lines.do(beside.receive, 10.0)
        assert small.dropped == 7
        assert [lines.do(small.receive, 10.0).data for _ in range(3)] == [b"\7", b"\x08", b"\t"]
        assert beside.dropped == 0


# --- much traffic, many callers ---------------------------------------------------------------------------------------


@contextmanager
def foreign_traffic(address: CanAddress) -> Iterator[None]:
    """Send 2,000 frames per second on a bus."""
    ending = threading.Event()

    def run() -> None:
        with open_bus(address) as bus:
            while not ending.wait(0.01):
                for number in range(20):
                    bus.send(can.Message(arbitration_id=OTHER + number, data=b"foreign"), 0.5)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


@pytest.mark.parametrize("kind", ["virtual", "udp_multicast"])
def test_replies_are_found_in_heavy_traffic(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, other), foreign_traffic(mine), echo(other, answering):
        line = lines.line(mine)
        port = lines.do(line.receiver, everything, size=100_000)  # the operation gets every frame
        chosen = lines.do(line.receiver, lambda got: got.id == ANSWER)
        for number in range(50):
            data = b"ask %d" % number
            assert lines.run(ask(data=data), port if number % 2 else chosen).data == data


@pytest.mark.parametrize("kind", ["virtual", "udp_multicast"])
def test_heavy_traffic_prolongs_no_wait(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, _), foreign_traffic(mine):
        line = lines.line(mine)
        for accepts in (everything, lambda got: got.id == ANSWER):
            port = lines.do(line.receiver, accepts)
            begin = monotonic()
            assert lines.run(ask(seconds=0.3), port) is None
            assert 0.29 < monotonic() - begin < PATIENCE


@pytest.mark.parametrize("kind", KINDS)
def test_many_at_a_time(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, other), echo(other, answering):
        line = lines.line(mine)

        async def caller(host: int) -> int:
            port = line.receiver(lambda got: got.id == (ANSWER & ~0xFF | host))
            for number in range(30):
                data = bytes([host, number])

                def one(data: bytes = data) -> CanOperation[CanFrame | None]:
                    return (yield OperationStep((frame(REQUEST & ~0xFF00 | host << 8, data),), 10.0, True))

                answer = await lines.now((run_can if lines.both.loop is None else arun_can)(one(), port))
                assert answer is not None, (host, number)
                assert answer.data == data
            port.close()
            return host

        assert lines.side_by_side(*(caller(host) for host in range(0x10, 0x16))) == list(range(0x10, 0x16))


def test_taking_over_the_reading_prolongs_no_wait(lines: Lines, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.can.shared_bus._SLICE", 3 * PATIENCE)
    mine, there = addresses("virtual", None)
    line = lines.line(mine)

    async def waiting(seconds: float) -> float:
        port, begin = line.receiver(everything), monotonic()
        assert await lines.now(port.receive(seconds)) is None
        return monotonic() - begin - seconds

    with open_bus(there):
        assert max(lines.side_by_side(waiting(1.0), waiting(1.2), waiting(1.4))) < PATIENCE


# --- noise ------------------------------------------------------------------------------------------------------------


def test_messages_that_are_not_frames() -> None:
    good = to_message(frame(data=b"abc"))
    assert to_frame(good) == CanFrame(ANSWER, b"abc")
    assert to_frame(can.Message(arbitration_id=ANSWER, data=b"", timestamp=7.5)) == CanFrame(ANSWER, b"", 7.5)
    for wrong in (
        can.Message(arbitration_id=0x123, is_extended_id=False),
        can.Message(arbitration_id=ANSWER, is_remote_frame=True),
        can.Message(arbitration_id=ANSWER, is_error_frame=True),
        can.Message(arbitration_id=ANSWER, is_fd=True),
        can.Message(arbitration_id=ANSWER, data=bytes(12)),
        can.Message(arbitration_id=ANSWER, data=bytes(3), dlc=8),
        can.Message(arbitration_id=1 << 29),
    ):
        assert to_frame(wrong) is None
    odd = can.Message(arbitration_id=ANSWER)
    vars_of: Any = odd
    for number in (1.5, float("nan"), True, "1"):
        vars_of.arbitration_id = number
        assert to_frame(odd) is None


@pytest.mark.parametrize("wrong", [CanFrame(1 << 29, b""), CanFrame(-1, b""), CanFrame(1, bytes(9))])
def test_invalid_frames(lines: Lines, wrong: CanFrame) -> None:
    mine, there = addresses("virtual", None)
    with open_bus(there) as other:
        port = lines.do(lines.line(mine).receiver, everything)
        for frames in ([wrong], [frame(), wrong]):
            with pytest.raises(InvalidValue):
                lines.do(port.send, frames, 1.0)
        assert other.recv(0) is None  # not even the first


def test_garbage_in_the_group(lines: Lines) -> None:
    import msgpack

    with two_places("udp_multicast") as (mine, other), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as shouting:
        port = lines.do(lines.line(mine).receiver, everything)
        good = {"arbitration_id": ANSWER, "data": b"good"}
        garbage = [b"", b"\xc1", b"hello" * 100, bytes(4000), b"\x81" * 900, msgpack.packb(5), msgpack.packb({"x": 1})]
        garbage += [
            msgpack.packb({**good, **wrong})
            for wrong in (
                *({"arbitration_id": number} for number in (-1, 1 << 29, 1.5, "x", None, [1], {"a": 1})),
                *({"data": data} for data in ("text", 5, -5, [300], {"a": 1}, bytes(9))),
                *({"dlc": dlc} for dlc in (-1, 9, "x", 2.5)),
                {"is_fd": True},
                {"timestamp": "x", "is_remote_frame": 1},
            )
        ]
        for piece in garbage * 3:
            shouting.sendto(piece, GROUP)
        shouting.sendto(msgpack.packb(good), GROUP)
        got = [lines.do(port.receive, PATIENCE)]
        while got[-1] is not None and got[-1].data != b"good":
            got.append(lines.do(port.receive, PATIENCE))  # {"data": 5} is five bytes to python-can
        assert got[-1] is not None
        assert {each.data for each in got} <= {b"good", bytes(5)}
        with echo(other, answering):
            assert lines.run(ask(), port)


@pytest.mark.parametrize("kind", ["slcan", "serial"])
def test_noise_on_the_line_of_an_adapter(lines: Lines, kind: str) -> None:
    with crossed_ptys() as cable:
        mine, there = addresses(kind, cable)
        port = lines.do(lines.line(mine).receiver, everything)
        noise = [
            b"\xff\xfe\r",
            b"T123\r",
            b"TXXXXXXXXX\r",
            b"\xaa\x01\r",
            b"t12\r",
            b"\a\a\r\r",
            b"\xaa" + bytes(3),
            b"D\r",
        ]
        noise += [bytes(range(256)), b"\xbb\xaa" * 20, b"A" * 3000, b"\r", b"T1FFFFFFF8AABB\r", b"R%08X0\r" % ANSWER]
        begin = monotonic()
        for piece in noise:
            cable.write(cable.left, piece)
            lines.do(port.receive, 0.02)
        while lines.do(port.receive, 0.3) is not None:
            assert monotonic() - begin < 60
        cable.write(cable.left, b"\r")
        bus = open_bus(there)
        with echo(bus, answering):
            assert any(lines.run(ask(seconds=1.0), port) for _ in range(10))
        bus.shutdown()


def test_an_endless_slcan_line_is_bounded(lines: Lines) -> None:
    with crossed_ptys() as cable:
        bus = open_bus(CanAddress("slcan", cable.left))
        port = lines.do(lines.line(bus).receiver, everything)
        for _ in range(20):
            cable.write(cable.left, b"x" * 1000)
            lines.do(port.receive, 0.02)
        assert len(vars(bus)["_buffer"]) < 10_000
        cable.write(cable.left, b"\rT%08X0\r" % ANSWER)
        assert lines.do(port.receive, PATIENCE) == (ANSWER, b"", pytest.approx(0, abs=1e10))


class BadBus(can.BusABC):
    """A scripted bus: each reception returns, raises or calls the next item of a list, or returns nothing."""

    def __init__(self, *script: Any) -> None:
        self.script = list(script)
        self.for_ever: BaseException | None = None
        self.sending: BaseException | None = None
        self.sent: list[can.Message] = []
        self.calls = 0
        self.shut = False
        super().__init__("bad")
        self.channel_info = "a bad bus"

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.calls += 1
        if self.script:
            turn = self.script.pop(0)
            if isinstance(turn, BaseException):
                raise turn
            return turn() if callable(turn) else turn, True
        if self.for_ever is not None:
            raise self.for_ever
        assert timeout is not None  # no wait may be unlimited
        sleep(timeout)
        return None, True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert timeout is not None
        if self.sending is not None:
            raise self.sending
        self.sent.append(msg)

    def shutdown(self) -> None:
        super().shutdown()
        self.shut = True


NOISE = [
    can.CanOperationError("could not unpack received message"),
    can.CanOperationError("invalid delimiter byte while reading message: 7"),
    ValueError("invalid literal for int()"),
    IndexError("string index out of range"),
    TypeError("ord() expected a character"),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
    can.CanTimeoutError("nothing"),
    BlockingIOError(11, "would block"),
    TimeoutError("timed out"),
]
BROKEN = [
    can.CanOperationError("the device is gone"),
    can.CanError("?"),
    OSError(5, "Input/output error"),
    ConnectionResetError(104, "reset"),
    TimeoutError(110, "Connection timed out"),
    RuntimeError("of a driver"),
    NotImplementedError("Trying to read from a write only bus?"),
]


@pytest.mark.parametrize("error", NOISE, ids=repr)
def test_noise_is_skipped(lines: Lines, error: Exception) -> None:
    bus = BadBus(*[error] * 300, to_message(frame()))
    port = lines.do(lines.line(bus).receiver, everything)
    assert lines.do(port.receive, 10.0) is not None


def odd(**wrong: Any) -> can.Message:
    """Return a message as a faulty driver of an adapter may return it."""
    message = to_message(frame())
    for name, value in wrong.items():
        setattr(message, name, value)
    return message


class Raising:
    """An object that raises on every attribute access."""

    def __getattr__(self, name: str) -> Any:
        raise ZeroDivisionError(name)


GARBAGE = {
    "text": "garbage",
    "a tuple": (None, False),
    "a number": 7,
    "what raises": Raising(),
    "no identifier": odd(arbitration_id=None),
    "no data": odd(data=None),
    "data that is a number": odd(data=5),
    "data of 1 GB": odd(data=10**9),
    "data of text": odd(data="text"),
    "no length": odd(dlc=None),
    "no time": odd(timestamp=None),
    "no flag": odd(is_extended_id=None, is_fd=None),
    **{
        type(error).__name__: error
        for error in (
            MemoryError(),
            AttributeError("x"),
            AssertionError(),
            OverflowError("x"),
            StopIteration(),
            KeyError(1),
        )
    },
}


@pytest.mark.parametrize("name", GARBAGE)
def test_invalid_results_of_an_adapter(lines: Lines, name: str) -> None:
    """They are skipped, or the bus counts as lost: no other exception is raised, and no call waits forever."""
    bus = BadBus()
    line = lines.line(bus)
    port = lines.do(line.receiver, everything)
    begin = monotonic()
    bus.script = [GARBAGE[name], to_message(frame(data=b"good"))]
    try:
        got = lines.do(port.receive, 3 * PATIENCE)
        while got is not None and got.data != b"good":
            got = lines.do(port.receive, 3 * PATIENCE)
        assert got is not None
        assert not line.broken
    except ConnectionLost as error:
        assert "a bad bus" in str(error)  # noqa: PT017 - it may not be raised
        assert line.broken
        with pytest.raises(ConnectionLost):
            lines.do(port.clear)
    assert monotonic() - begin < PATIENCE


@pytest.mark.parametrize("error", NOISE, ids=repr)
def test_endless_noise_blocks_no_call(lines: Lines, error: Exception) -> None:
    bus = BadBus()
    bus.for_ever = error
    port = lines.do(lines.line(bus).receiver, everything)
    begin, spent = monotonic(), process_time()
    lines.do(port.clear)
    assert lines.do(port.receive, 0.5) is None
    assert 0.5 <= monotonic() - begin < PATIENCE
    assert bus.calls < 25_000  # clearing may read 10,000 of them at a time
    assert process_time() - spent < 8


@pytest.mark.parametrize("error", BROKEN, ids=repr)
def test_a_bus_that_breaks(lines: Lines, error: Exception) -> None:
    bus = BadBus(to_message(frame()), error)
    line = lines.line(bus)
    port = lines.do(line.receiver, lambda got: got.id == OTHER)
    beside = lines.do(line.receiver, everything)
    with pytest.raises(ConnectionLost, match="a bad bus: "):
        lines.do(port.receive, 5.0)
    assert line.broken
    calls = bus.calls
    for call, arguments in ((beside.receive, (5.0,)), (port.clear, ()), (port.send, ([frame()], 1.0))):
        with pytest.raises(ConnectionLost, match="a bad bus: "):  # at once, although a frame arrived before
            lines.do(call, *arguments)
    assert bus.calls == calls
    with pytest.raises(InvalidValue, match="only if it was opened by an address"):
        lines.do(line.reopen)


def test_a_bus_that_breaks_ends_every_wait(lines: Lines) -> None:
    bus = BadBus()
    line = lines.line(bus)

    async def waiting(number: int) -> str:
        port = line.receiver(lambda got: got.id == number)
        try:
            await lines.now(port.receive(60.0))
        except ConnectionLost as error:
            return str(error)
        return "?"

    async def breaking() -> str:
        await lines.now(lines.others_wait(line, 5))
        bus.script.append(OSError(5, "pulled out"))
        return ""

    outcomes = lines.side_by_side(*(waiting(number) for number in range(5)), breaking())
    assert all("pulled out" in outcome for outcome in outcomes[:-1]), outcomes


@pytest.mark.parametrize(
    "error",
    [can.CanTimeoutError("no"), can.CanOperationError("Transmit buffer full"), can.CanOperationError("Failed to transmit", 105)],
    ids=repr,
)  # fmt: skip
def test_no_acknowledgement(lines: Lines, error: Exception) -> None:
    bus = BadBus()
    port = lines.do(lines.line(bus).receiver, everything)
    bus.sending = error
    with pytest.raises(TransportError, match="check that another node acknowledges frames") as caught:
        lines.do(port.send, [frame()], 0.1)
    assert not isinstance(caught.value, ConnectionLost)
    bus.sending = None
    lines.do(port.send, [frame()] * 3, 0.1)
    assert len(bus.sent) == 3


def test_a_bus_that_cannot_send(lines: Lines) -> None:
    bus = BadBus()
    line = lines.line(bus)
    port = lines.do(line.receiver, everything)
    bus.sending = can.CanOperationError("Failed to transmit: Network is down", 100)
    with pytest.raises(ConnectionLost, match="Network is down"):
        lines.do(port.send, [frame()], 0.1)
    with pytest.raises(ConnectionLost, match="Network is down"):
        lines.do(port.receive, 5.0)


@pytest.mark.parametrize("kind", ["slcan", "serial"])
def test_an_adapter_that_hangs(lines: Lines, kind: str) -> None:
    with two_places_and_cable(kind) as (mine, other, cable):
        line = lines.line(mine)
        port = lines.do(line.receiver, everything)
        cable.stall()
        begin = monotonic()
        with pytest.raises(TransportError, match="check that another node acknowledges frames") as caught:
            for _ in range(10_000):
                lines.do(port.send, [frame(OTHER)], 0.1)
        assert not isinstance(caught.value, ConnectionLost)
        assert monotonic() - begin < 3 * PATIENCE
        cable.go_on()
        with echo(other, answering):
            assert any(lines.run(ask(seconds=1.0), port) for _ in range(10))


# --- ownership and closing --------------------------------------------------------------------------------------------


def test_a_bus_of_the_caller_stays_open(lines: Lines) -> None:
    given, own = BadBus(), BadBus()
    for bus in (given, own):
        line = lines.line(bus, own=bus is own)
        lines.do(line.receiver, everything)
        lines.do(line.close)
        lines.do(line.close)
    assert (given.shut, own.shut) == (False, True)
    given.shutdown()


@pytest.mark.parametrize("kind", KINDS)
def test_closing_ends_every_wait(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, _):
        line = lines.line(mine)

        async def waiting() -> str:
            port = line.receiver(everything)
            try:
                return str(await lines.now(port.receive(60.0)))
            except ConnectionClosed:
                return "closed"

        async def closing() -> str:
            await lines.now(lines.others_wait(line, 3))
            await lines.now(line.close())
            return ""

        begin = monotonic()
        assert lines.side_by_side(waiting(), waiting(), waiting(), closing()) == ["closed"] * 3 + [""]
        assert monotonic() - begin < PATIENCE
        port = lines.do(line.receiver, everything)
        for call, arguments in (
            (port.receive, (1.0,)),
            (port.clear, ()),
            (port.send, ([frame()], 1.0)),
            (line.reopen, ()),
        ):
            with pytest.raises(ConnectionClosed):
                lines.do(call, *arguments)


def test_closing_a_receiver(lines: Lines) -> None:
    mine, there = addresses("virtual", None)
    with open_bus(there) as other:
        line = lines.line(mine)
        port, stays = lines.do(line.receiver, everything), lines.do(line.receiver, everything)

        async def waiting(which: Any) -> CanFrame | str | None:
            try:
                return await lines.now(which.receive(60.0))
            except ConnectionClosed:
                return "closed"

        async def closing() -> None:
            await lines.now(lines.others_wait(line, 2))
            port.close()
            port.close()
            other.send(to_message(frame()))

        ended, got, _ = lines.side_by_side(waiting(port), waiting(stays), closing())
        assert ended == "closed"
        assert got.id == ANSWER
        with pytest.raises(ConnectionClosed):
            lines.do(port.receive, 1.0)


@pytest.mark.parametrize("kind", ["virtual", "udp_multicast", "slcan"])
def test_a_bus_that_its_owner_has_closed(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, _):
        bus = open_bus(mine)
        port = lines.do(lines.line(bus, own=False).receiver, everything)
        bus.shutdown()
        with pytest.raises(ConnectionLost):
            for _ in range(100):  # in asyncio a closed descriptor is no longer watched; sending raises
                lines.do(port.receive, 0.01)
                lines.do(port.send, [frame()], 0.1)


# --- opening again ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["slcan", "serial"])
def test_an_adapter_that_is_plugged_in_again(lines: Lines, kind: str) -> None:
    with crossed_ptys() as cable:
        mine, there = addresses(kind, cable)
        line = lines.line(mine)
        port, beside = lines.do(line.receiver, everything), lines.do(line.receiver, everything)
        cable.cut()
        with pytest.raises(ConnectionLost):
            lines.do(port.receive, 10.0)
        for _ in range(3):
            with pytest.raises(ConnectFailed, match="check that the adapter is plugged in"):
                lines.do(line.reopen)
            with pytest.raises(ConnectionLost):
                lines.do(beside.receive, 10.0)
        cable.restore()
        lines.do(line.reopen)
        lines.do(line.reopen)  # does nothing
        bus = open_bus(there)
        with echo(bus, answering):
            assert lines.run(ask(), port)
            assert lines.run(ask(), beside)
        bus.shutdown()


@pytest.mark.parametrize("kind", KINDS)
def test_reopening_empties_the_receivers(lines: Lines, kind: str) -> None:
    with two_places(kind) as (mine, other):
        line = lines.line(mine)
        port, beside = lines.do(line.receiver, everything), lines.do(line.receiver, lambda got: got.id == OTHER)
        for number in (OTHER, OTHER, ANSWER):
            other.send(to_message(frame(number)), 1.0)
        while lines.do(port.receive, 10.0).id != ANSWER:
            pass
        lines.do(line.reopen)  # the bus is not lost
        assert lines.do(beside.receive, 10.0).id == OTHER
        lines.do(line.reopen, force=True)
        assert lines.do(beside.receive, 0.1) is None
        with echo(other, answering):
            assert lines.run(ask(), port)


class Turnstile:
    """A lock that counts the callers that have to wait for it."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self.others = 0

    def acquire(self, blocking: bool = True) -> bool:
        taken = self._lock.acquire(blocking)
        self.others += not taken
        return taken

    def release(self) -> None:
        self._lock.release()


def test_several_callers_reopen_it(lines: Lines, monkeypatch: pytest.MonkeyPatch) -> None:
    mine, there = addresses("virtual", None)
    opened: list[CanAddress] = []

    def others() -> int:
        lock = line._reopening
        return lock.others if isinstance(lock, Turnstile) else len(lock._waiters or ())

    def opening(address: CanAddress) -> can.BusABC:
        opened.append(address)
        until(lambda: others() == 3)
        return open_bus(address)

    with open_bus(there) as other:
        line = lines.line(mine)
        if lines.both.loop is None:
            line._reopening = Turnstile()
        monkeypatch.setattr("orinkit.can.bus.open_bus", opening)

        async def again() -> None:
            await lines.now(line.reopen(force=True))

        lines.side_by_side(*(again() for _ in range(4)))
        assert len(opened) == 1
        port = lines.do(line.receiver, everything)
        with echo(other, answering):
            assert lines.run(ask(), port)


def test_reopening_ends_every_wait(lines: Lines) -> None:
    mine, _ = addresses("virtual", None)
    line = lines.line(mine)

    async def waiting() -> str:
        try:
            return str(await lines.now(line.receiver(everything).receive(60.0)))
        except ConnectionLost as error:
            return str(error)

    async def again() -> None:
        await lines.now(lines.others_wait(line, 2))
        await lines.now(line.reopen(force=True))

    outcomes = lines.side_by_side(waiting(), waiting(), again())
    assert all("being reopened" in outcome for outcome in outcomes[:2])


# --- buses that take long to open -------------------------------------------------------------------------------------


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[BadBus, threading.Event, threading.Event]]:
    """Return a bus, an event that is set while it is being opened, and one that lets the opening continue."""
    bus, begun, go_on = BadBus(), threading.Event(), threading.Event()

    def opening(_address: CanAddress) -> can.BusABC:
        begun.set()
        assert go_on.wait(60)
        return bus

    monkeypatch.setattr("orinkit.can.bus.open_bus", opening)
    yield bus, begun, go_on
    go_on.set()
    end = monotonic() + 20
    while any("opening" in thread.name for thread in threading.enumerate()) and monotonic() < end:
        sleep(0.01)
    bus.shutdown()


def test_a_bus_that_opens_after_its_loop_is_closed(slow: tuple[BadBus, threading.Event, threading.Event]) -> None:
    """Opening hangs; the loop does not wait for it when it ends, and a bus opened later is closed."""
    bus, begun, go_on = slow

    async def body() -> None:
        opening = asyncio.create_task(AsyncSharedCanBus.open(CanAddress("virtual")))
        while not begun.is_set():  # noqa: ASYNC110 - set by a thread
            await asyncio.sleep(0.001)
        assert [thread.daemon for thread in threading.enumerate() if "opening" in thread.name] == [True]
        assert not opening.done()

    begin = monotonic()
    asyncio.run(body())
    assert monotonic() - begin < PATIENCE  # half of the time of opening
    go_on.set()
    until(lambda: bus.shut)


def test_a_loop_runs_while_a_bus_opens(slow: tuple[BadBus, threading.Event, threading.Event]) -> None:
    bus, begun, go_on = slow

    async def body() -> None:
        opening = asyncio.create_task(AsyncSharedCanBus.open(CanAddress("virtual")))
        while not begun.is_set():  # noqa: ASYNC110 - set by a thread
            await asyncio.sleep(0.001)
        go_on.set()
        line = await opening
        assert not bus.shut
        await line.close()

    asyncio.run(body())
    assert bus.shut


PROGRAM = """
import asyncio, sys, time
from orinkit.can import bus as can_bus
from orinkit.transport.address import CanAddress
from orinkit.can.aio_shared_bus import AsyncSharedCanBus

can_bus.open_bus = lambda _address: time.sleep(1000)

async def main():
    try:
        async with asyncio.timeout(0.2):
            await AsyncSharedCanBus.open(CanAddress("virtual"))
    except TimeoutError:
        print("given up", flush=True)

asyncio.run(main())
"""


def test_a_program_ends_although_a_bus_does_not_open() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True, timeout=60, check=True)
    assert done.stdout == "given up\n"


# --- interruptions ----------------------------------------------------------------------------------------------------


def test_a_call_within_a_call_of_the_same_thread() -> None:
    """As in a signal handler that interrupts the thread while it reads the bus, sends, or clears."""
    bus = BadBus()
    line = SharedCanBus(Bus(bus))
    port, within = line.receiver(lambda got: got.id == OTHER), line.receiver(lambda got: got.id == ANSWER)
    answers: list[CanFrame | None] = []

    def handler() -> None:
        bus.script[:0] = [None, to_message(frame(data=b"within"))]  # clearing finds nothing
        answers.append(run_can(ask(), within))

    begin = monotonic()
    bus.script = [handler, to_message(frame(OTHER))]
    got = port.receive(PATIENCE)
    assert got is not None
    assert got.id == OTHER
    bus.script = [handler]
    port.clear()
    sending = bus.send

    def sends(msg: can.Message, timeout: float | None = None) -> None:
        vars(bus)["send"] = sending
        handler()
        sending(msg, timeout)

    vars(bus)["send"] = sends
    port.send([frame(OTHER)], 1.0)
    assert [each.data for each in answers if each is not None] == [b"within"] * 3
    assert [message.arbitration_id for message in bus.sent] == [REQUEST] * 3 + [OTHER]
    assert monotonic() - begin < PATIENCE / 2
    beside = threading.Thread(target=lambda: answers.append(run_can(ask(), within)))
    bus.script = [None, to_message(frame(data=b"beside"))]
    beside.start()  # no lock is held now
    beside.join(PATIENCE)
    assert answers[-1] is not None
    assert answers[-1].data == b"beside"
    line.close()


def test_ctrl_c_at_every_point_of_a_call() -> None:
    """At the points at which Python checks for signals: the start of a function, and after each call into C."""
    ours = ("orinkit/can/shared_bus.py", "orinkit/can/bus.py", "threading.py")
    bus = BadBus()
    line = SharedCanBus(Bus(bus))
    port, beside = line.receiver(lambda got: got.id == OTHER), line.receiver(lambda got: got.id == ANSWER)
    calls: list[Callable[[], object]] = [
        lambda: port.receive(0.01),
        lambda: port.send([frame(OTHER), frame(OTHER)], 0.2),
        port.clear,
        lambda: line.reopen(),
        lambda: run_can(ask(seconds=0.01), port),
    ]
    got: list[CanFrame | None] = []
    for call in calls:
        points = 0
        while interrupted_at(points + 1, call, ours):
            points += 1
            assert points < 500
            assert (line._reader, line._waiting) == (None, [])
            bus.script = [None, to_message(frame())]
            other = threading.Thread(target=lambda: got.append(run_can(ask(), beside)))
            other.start()
            other.join(2 * PATIENCE)
            assert not other.is_alive()
            assert got.pop() is not None
        assert points
    line.close()


def test_an_interrupted_reader_leaves_the_bus_to_others() -> None:
    bus = BadBus()
    line = SharedCanBus(Bus(bus))
    port, beside = line.receiver(lambda got: got.id == ANSWER), line.receiver(lambda got: got.id == OTHER)
    got: list[CanFrame | BaseException | None] = []

    def interrupted() -> None:
        try:
            port.receive(60.0)
        except KeyboardInterrupt as error:
            got.append(error)

    first = threading.Thread(target=interrupted)
    first.start()
    until(lambda: line._reader == first.ident)
    second = threading.Thread(target=lambda: got.append(beside.receive(60.0)))
    second.start()
    until(lambda: line._waiting)
    bus.script.append(KeyboardInterrupt())
    first.join(PATIENCE)
    bus.script.append(to_message(frame(OTHER)))
    second.join(PATIENCE)
    assert not first.is_alive()
    assert not second.is_alive()
    assert [type(each) for each in got] == [KeyboardInterrupt, CanFrame]
    bus.script.append(to_message(frame(ANSWER)))
    assert port.receive(PATIENCE) is not None
    for call in (lambda: port.receive(5.0), lambda: run_can(ask(), port)):
        bus.script.append(KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            call()
    bus.script.append(to_message(frame(ANSWER)))
    assert port.receive(PATIENCE) is not None
    line.close()


def test_an_operation_is_closed_when_it_is_interrupted(lines: Lines) -> None:
    ended: list[str] = []

    def operation() -> CanOperation[None]:
        try:
            yield OperationStep((), 5.0)
        finally:
            ended.append("closed")

    bus = BadBus()
    port = lines.do(lines.line(bus).receiver, everything)
    bus.script.append(OSError(5, "gone"))
    with pytest.raises(ConnectionLost):
        lines.run(operation(), port)
    assert ended == ["closed"]


def test_a_cancelled_task_loses_no_frame() -> None:
    async def body() -> None:
        mine, there = addresses("virtual", None)
        line = await AsyncSharedCanBus.open(mine)
        port = line.receiver(everything)
        with open_bus(there) as other:
            for number in range(200):
                task = asyncio.create_task(port.receive(60.0))
                await asyncio.sleep(0)
                other.send(to_message(frame(data=bytes([number]))))
                if number % 3:
                    await asyncio.sleep(0.001 * (number % 3 - 1))
                task.cancel()
                try:
                    got = await task
                except asyncio.CancelledError:
                    got = await port.receive(10.0)
                assert got is not None
                assert got.data == bytes([number])
        waits = asyncio.create_task(arun_can(ask(seconds=60.0), port))
        await asyncio.sleep(0.05)
        waits.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waits
        with open_bus(there) as other, echo(other, answering):
            assert await arun_can(ask(), port)
        await line.close()

    asyncio.run(body())


def test_a_shared_bus_belongs_to_its_loop() -> None:
    line = asyncio.run(_made())
    port = line.receiver(everything)

    async def elsewhere() -> None:
        for call in (lambda: port.receive(1.0), port.clear):
            with pytest.raises(TransportError, match="another event loop"):
                await call()
        with pytest.raises(TransportError, match="another event loop"):
            port.send([frame()], 1.0)
        await line.close()

    asyncio.run(elsewhere())


async def _made() -> AsyncSharedCanBus:
    return await AsyncSharedCanBus.open(address_of(multicast.bus()))


def test_opening_can_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    class Bus(BadBus):
        def shutdown(self) -> None:
            super().shutdown()
            gone.set()

    bus, gone, go_on = Bus(), asyncio.Event(), threading.Event()

    def slowly(_address: CanAddress) -> can.BusABC:
        assert go_on.wait(PATIENCE)
        return bus

    monkeypatch.setattr("orinkit.can.bus.open_bus", slowly)

    async def body() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await AsyncSharedCanBus.open(CanAddress("virtual"))
        go_on.set()
        async with asyncio.timeout(PATIENCE):
            await gone.wait()

    asyncio.run(body())


def test_a_closed_loop_ends_the_thread() -> None:
    before = threading.active_count()

    async def body() -> can.BusABC:
        bus = open_bus(addresses("virtual", None)[0])
        AsyncSharedCanBus(Bus(bus, own=False))  # which is not closed
        return bus

    bus = asyncio.run(body())
    other = can.Bus(interface="virtual", channel=vars(bus)["channel_id"], ignore_config=True)
    end = monotonic() + 20
    while threading.active_count() > before and monotonic() < end:
        other.send(to_message(frame()))
        sleep(0.05)
    assert threading.active_count() <= before
    bus.shutdown()
    other.shutdown()


def test_errors_are_those_of_orinkit(lines: Lines) -> None:
    for error in (*NOISE, *BROKEN):
        bus = BadBus()
        bus.sending = error
        port = lines.do(lines.line(bus).receiver, everything)
        with pytest.raises(OrinError):
            lines.do(port.send, [frame()], 0.1)
