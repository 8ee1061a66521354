"""Multi-packet messages: a host's operations against a driver's responder, over a wire that loses, duplicates and reorders."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable
from typing import Literal, TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.session import multipacket
from orinkit.abh3.session.multipacket import Responder, exchange, receive_message, send_message
from orinkit.abh3.table.ids import CONTROL, TRANSFER, FrameId
from orinkit.can.frame import CanFrame, CanOperation, checked
from orinkit.core import i18n
from orinkit.core.errors import DriverTimeout, InvalidValue, OrinError, ProtocolError

pytestmark = pytest.mark.core

T = TypeVar("T")
Fate = Literal["arrives", "lost", "doubled", "late"]
HOST, DRIVER, OTHER = 2, 1, 3
PGN = bytes.fromhex("00EF00")
MESSAGES = st.binary(min_size=1, max_size=200)


def control(text: str, source: int = DRIVER, destination: int = HOST, priority: int = 0, pgn: bytes = PGN) -> CanFrame:
    """Return a control frame with these first bytes."""
    return CanFrame(
        int(FrameId(CONTROL, destination, source, 0, priority)), bytes.fromhex(text).ljust(5, b"\xff") + pgn
    )


def packet(number: int, data: bytes, source: int = DRIVER, destination: int = HOST) -> CanFrame:
    return CanFrame(int(FrameId(TRANSFER, destination, source)), bytes((number,)) + data.ljust(7, b"\xff"))


def from_host(text: str, source: int = HOST) -> CanFrame:
    return control(text, source, DRIVER)


def show(frames: Iterable[CanFrame]) -> list[str]:
    """Return a control frame as its first five bytes, a data packet as its number."""
    return [
        frame.data[:5].hex() if FrameId.parse(frame.id).pf == CONTROL else f"packet {frame.data[0]}"
        for frame in map(checked, frames)
    ]


class Wire:
    """A host and a driver with their own clock.

    Args:
        handler: Handler of the driver.
        fates: Fates of the frames, in the order in which they are sent; later frames arrive. A late frame arrives after the
            next one in the same direction.
    """

    def __init__(
        self, handler: Callable[[bytes, int], bytes | None], fates: Iterable[Fate] = (), **options: float
    ) -> None:
        self.now = 0.0
        self.log: list[str] = []
        self.asked: list[bytes] = []
        self._handler = handler
        self.driver = Responder(DRIVER, self._answer, **options)
        self._fates = iter(fates)
        self._to_host: deque[CanFrame] = deque()
        self._held: dict[bool, list[CanFrame]] = {True: [], False: []}

    def _answer(self, message: bytes, host: int) -> bytes | None:
        self.asked.append(message)
        return self._handler(message, host)

    def _carry(self, frames: Iterable[CanFrame], *, to_driver: bool) -> None:
        for frame in frames:
            self.log.append(f"{'>' if to_driver else '<'} {show([frame])[0]}")
            fate = next(self._fates, "arrives")
            held, self._held[to_driver] = self._held[to_driver], []
            if fate == "late":
                self._held[to_driver] = [frame]
            copies = {"arrives": 1, "doubled": 2}.get(fate, 0)
            for copy in [frame] * copies + held:
                if to_driver:
                    self._carry(self.driver.receive(copy, self.now), to_driver=False)
                else:
                    self._to_host.append(copy)

    def run(self, operation: CanOperation[T]) -> T:
        """Drive a host's operation."""
        deadline = 0.0
        try:
            turn = next(operation)
            for _ in range(20_000):
                if turn.fresh:
                    self._to_host.clear()
                self._carry(turn.frames, to_driver=True)
                if turn.seconds is not None:
                    deadline = self.now + turn.seconds
                turn = operation.send(self._next(deadline))
        except StopIteration as stop:
            return stop.value
        raise AssertionError("the operation does not end")

    def _next(self, deadline: float) -> CanFrame | None:
        while not self._to_host and (time := self.driver.next_time) is not None and time <= deadline:
            self.now = max(self.now, time)
            self._carry(self.driver.tick(self.now), to_driver=False)
        if self._to_host:
            return self._to_host.popleft()
        self.now = max(self.now, deadline)
        return None

    def mend(self) -> None:
        """Let every frame arrive from now on; wait until the driver has abandoned the previous message."""
        self._fates = iter(())
        self._held = {True: [], False: []}
        while (time := self.driver.next_time) is not None:
            self.now = max(self.now, time)
            self._carry(self.driver.tick(self.now), to_driver=False)

    def exchange(self, message: bytes) -> bytes:
        return self.run(exchange(message, host=HOST, driver=DRIVER, pause=0))


def echo(message: bytes, host: int) -> bytes:
    return bytes((host,)) + message[::-1]


def padded(message: bytes) -> bytes:
    return message.ljust(9, b"\x16")


def answer_to(message: bytes) -> bytes:
    return padded(echo(padded(message), HOST))


# --- frames on the wire ------------------------------------------------------------------------------------------------


def test_an_exchange_frame_by_frame() -> None:
    wire = Wire(lambda message, host: b"\x06OK00")
    assert wire.exchange(b"CP000095") == b"\x06OK00\x16\x16\x16\x16"
    assert wire.asked == [b"CP000095\x16"]
    assert wire.log == [
        "> 1009000202", "< 110201ffff", "> packet 1", "> packet 2", "< 13090002ff",
        "< 1009000202", "> 110201ffff", "< packet 1", "< packet 2", "> 13090002ff",
    ]  # fmt: skip
    assert wire.driver.next_time is None
    assert wire.now == 0.0


def test_the_longest_message() -> None:
    message = bytes(number % 251 for number in range(1785))
    wire = Wire(lambda got, host: got)
    assert wire.exchange(message) == message
    assert wire.log.count("< 111001ffff") == 1  # the driver asks for 16 packets at once
    assert wire.log.count("> 110ff1ffff") == 1  # and so does the host: the last 15
    assert [line for line in wire.log if line.startswith("> packet")] == [f"> packet {n}" for n in range(1, 256)]


@given(MESSAGES)
def test_every_message_arrives_whole(message: bytes) -> None:
    wire = Wire(echo)
    assert wire.exchange(message) == answer_to(message)
    assert wire.asked == [padded(message)]


@pytest.mark.parametrize("answer", [None, b""])
def test_a_message_without_an_answer(answer: bytes | None) -> None:
    wire = Wire(lambda message, host: answer)
    wire.run(send_message(b"BI0002FF", host=HOST, driver=DRIVER))
    assert wire.driver.next_time is None
    begun = wire.now
    with pytest.raises(DriverTimeout):
        wire.run(receive_message(host=HOST, driver=DRIVER))
    assert wire.now - begun == pytest.approx(1.25)
    assert wire.log[-1] == "> ff03ffffff"


def test_sending_and_receiving_one_after_the_other() -> None:
    wire = Wire(echo)
    wire.run(send_message(b"x" * 20, host=HOST, driver=DRIVER, priority=7))
    assert wire.run(receive_message(host=HOST, driver=DRIVER, priority=7)) == answer_to(b"x" * 20)


def test_priorities() -> None:
    turn = next(exchange(b"x", host=HOST, driver=DRIVER, afresh=True))
    assert show(turn.frames) == ["ff03ffffff", "1009000202"]  # the previous message is abandoned
    turn = next(exchange(b"x", host=HOST, driver=DRIVER, priority=6))
    assert [frame.id for frame in turn.frames] == [0x18EC0102]
    assert turn.fresh
    assert turn.seconds == 1.25
    driver = Responder(0x55, lambda message, host: None, priority=3)
    frames = driver.receive(control("1009000202", HOST, 0x55, priority=5), 0.0)
    assert [frame.id for frame in frames] == [0x0CEC0255]


def test_pauses_between_packets() -> None:
    wire = Wire(echo, pause=0.01)
    assert wire.run(exchange(b"x" * 70, host=HOST, driver=DRIVER, pause=0.1)) == answer_to(b"x" * 70)
    assert wire.now == pytest.approx(9 * 0.1 + 10 * 0.01)


@pytest.mark.parametrize("size", [0, 1786])
def test_invalid_messages(size: int) -> None:
    for function in (exchange, send_message):
        with pytest.raises(InvalidValue, match=f"1 to 1785 bytes, not {size}"):
            function(bytes(size), host=HOST, driver=DRIVER)
    wire = Wire(lambda message, host: bytes(1786))
    with pytest.raises(InvalidValue, match="1786"):
        wire.exchange(b"x")
    assert wire.driver.next_time is None


@pytest.mark.parametrize(("host", "driver", "priority"), [(254, 1, 0), (2, -1, 0), (2, 1, 8), (1, 1, 0)])
def test_invalid_addresses(host: int, driver: int, priority: int) -> None:
    with pytest.raises(InvalidValue):
        exchange(b"x", host=host, driver=driver, priority=priority)
    with pytest.raises(InvalidValue):
        receive_message(host=host, driver=driver, priority=priority)
    if host != driver:
        with pytest.raises(InvalidValue):
            Responder(host if host > 253 else driver, echo, priority=priority)


# --- a bad wire --------------------------------------------------------------------------------------------------------

MESSAGE = bytes(range(1, 141))  # 20 packets, and 21 of the reply


@pytest.mark.parametrize("fate", ["lost", "doubled", "late"])
def test_one_bad_frame_at_a_time(fate: Fate) -> None:
    clean = Wire(echo)
    clean.exchange(MESSAGE)
    for index, line in enumerate(clean.log):
        wire = Wire(echo, ["arrives"] * index + [fate])
        if fate != "doubled" and line[2:4] == "10":  # without an RTS the driver does not know of the message
            with pytest.raises((DriverTimeout, ProtocolError)):  # one of the two sides gives up first
                wire.exchange(MESSAGE)
            assert len(wire.asked) == (line[0] == "<")
        else:
            assert wire.exchange(MESSAGE) == answer_to(MESSAGE), (index, line, wire.log)
            assert wire.asked == [MESSAGE]


def test_duplicate_frames() -> None:
    wire = Wire(echo, ["doubled"] * 1000)
    assert wire.exchange(MESSAGE) == answer_to(MESSAGE)
    assert wire.asked == [MESSAGE]


def test_only_the_missing_packet_is_requested() -> None:
    wire = Wire(echo, [*["arrives"] * 4, "lost", "lost"])  # RTS, CTS, packets 1 and 2; not 3 and 4
    wire.exchange(MESSAGE)
    assert "< 110203ffff" in wire.log
    assert wire.now == 0.0


@given(
    st.binary(min_size=9, max_size=80), st.lists(st.sampled_from(["arrives", "lost", "doubled", "late"]), max_size=120)
)
def test_a_message_arrives_whole_or_not_at_all(message: bytes, fates: list[Fate]) -> None:
    wire = Wire(echo, fates)
    with contextlib.suppress(DriverTimeout, ProtocolError):
        assert wire.exchange(message) == answer_to(message)
    assert wire.asked in ([], [message])
    wire.mend()
    assert wire.exchange(message) == answer_to(message)  # nothing is left over once the wire works


# --- the host alone ----------------------------------------------------------------------------------------------------


def script(operation: CanOperation[T], *steps: tuple[CanFrame | None, list[str]]) -> CanOperation[T]:
    """Feed frames to an operation and check what it sends."""
    next(operation)
    for frame, sent in steps:
        assert show(operation.send(frame).frames) == sent
    return operation


def fails(operation: CanOperation[object], frame: CanFrame | None, sent: list[str]) -> OrinError:
    """Feed the frame that ends an operation; return the exception."""
    if sent:
        assert show(operation.send(frame).frames) == sent
        frame = None
    with pytest.raises(OrinError) as caught:
        operation.send(frame)
    return caught.value


def sending(message: bytes = b"x" * 21) -> CanOperation[None]:
    return send_message(message, host=HOST, driver=DRIVER)


def receiving() -> CanOperation[bytes]:
    return receive_message(host=HOST, driver=DRIVER)


FOREIGN = [
    CanFrame(0x00EF0201, bytes(8)),
    CanFrame(0x02EC0201, bytes.fromhex("1101010000") + PGN),  # the reserved bit
    CanFrame(0x01EC0201, bytes.fromhex("1101010000") + PGN),  # data page 1
    CanFrame(0x00EC0201, bytes.fromhex("1101010000")),
    control("ff01", OTHER),
    control("ff01", destination=OTHER),
    control("ff01", pgn=b"\x00\xfe\x00"),
    control("2009000202"),  # BAM
    packet(1, b"stray"),
    CanFrame(0x00EB0201, b"\x01"),
]


@pytest.mark.parametrize("frame", FOREIGN, ids=str)
def test_frames_that_change_nothing(frame: CanFrame) -> None:
    for operation in (sending(), receiving()):
        next(operation)
        turn = operation.send(frame)
        assert turn == ((), None, False)


@pytest.mark.parametrize("frame", [FOREIGN[0], packet(1, b"")])
def test_frames_between_packets_delay_nothing(frame: CanFrame) -> None:
    operation = script(
        send_message(b"x" * 21, host=HOST, driver=DRIVER, pause=0),
        (control("110301"), ["packet 1"]),
        (frame, ["packet 2"]),
        (frame, ["packet 3"]),
    )
    assert operation.send(frame) == ((), None, False)
    with pytest.raises(StopIteration):
        operation.send(control("13ffff99"))  # with any byte count


def test_frames_between_packets_with_a_pause() -> None:
    operation = send_message(b"x" * 21, host=HOST, driver=DRIVER, pause=0.5)
    next(operation)
    assert operation.send(control("110301")).seconds == 0.5
    assert operation.send(FOREIGN[0]) == ((), None, False)
    assert show(operation.send(None).frames) == ["packet 2"]


def test_the_driver_sets_the_size_of_a_burst() -> None:
    end = control("1315000300")
    operation = script(
        sending(),
        (control("110201"), ["packet 1"]),
        (None, ["packet 2"]),
        (end, []),  # too early
        (control("1100ff"), []),  # not yet
        (control("110102", priority=7), ["packet 2"]),
        (control("11ff03"), ["packet 3"]),
    )
    with pytest.raises(StopIteration):
        operation.send(end)


def test_the_driver_takes_too_long() -> None:
    error = fails(script(sending()), None, ["ff03ffffff"])
    assert isinstance(error, DriverTimeout)
    assert (error.function, error.seconds, error.address) == ("abh3_can_trans", 1.25, DRIVER)
    assert isinstance(fails(script(sending(), (control("1100ff"), [])), None, ["ff03ffffff"]), DriverTimeout)


REASONS = {
    1: "busy",
    2: "resources",
    3: "time-out",
    5: "too often",
    9: "too long",
    77: "unknown reason",
}


@pytest.mark.parametrize("reason", REASONS)
def test_the_driver_aborts_in_any_phase(reason: int) -> None:
    abort = control(f"ff{reason:02x}")
    asked = (control("110201"), ["packet 1"])
    told = (control("1015000303"), ["110301ffff"])
    operations: list[CanOperation[object]] = [
        script(sending()), script(sending(), asked), script(sending(), asked, (None, ["packet 2"])),
        script(receiving()), script(receiving(), told), script(receiving(), told, (packet(1, b"x"), [])),
    ]  # fmt: skip
    for operation in operations:
        error = fails(operation, abort, [])
        assert isinstance(error, ProtocolError)
        assert REASONS[reason] in str(error)
        assert f"(reason {reason})" in str(error)


def test_reasons_in_japanese() -> None:
    i18n.use("ja")
    assert "別のメッセージを処理中 (理由 1)" in str(fails(script(sending()), control("ff01"), []))


@pytest.mark.parametrize("asked", ["110100", "110104", "11ffff"])
def test_requests_for_packets_that_do_not_exist(asked: str) -> None:
    error = fails(script(sending()), control(asked), ["ff07ffffff"])
    assert isinstance(error, ProtocolError)
    number = int(asked[4:], 16)
    assert f"the peer requested packet {number}, which does not exist; the message has 3 packets" in str(error)


def test_the_driver_requests_packets_endlessly() -> None:
    operation = script(sending(), *[(control("1100ff"), [])] * 35)
    assert "too often" in str(fails(operation, control("1100ff"), ["ff05ffffff"]))


def test_a_message_of_the_driver_at_the_wrong_time() -> None:
    opening = control("1015000303")
    all_sent = [(control("110301"), ["packet 1"]), (None, ["packet 2"]), (None, ["packet 3"])]
    for operation in (
        script(sending()),
        script(sending(), *all_sent),
        script(exchange(b"x", host=HOST, driver=DRIVER)),
    ):
        assert "began a message" in str(fails(operation, opening, ["ff01ffffff"]))
    assert "began a message" in str(
        fails(script(receiving(), (opening, ["110301ffff"])), control("101600040f"), ["ff01ffffff"])
    )


def test_a_reply_acknowledges_the_message() -> None:
    operation = script(
        exchange(b"x", host=HOST, driver=DRIVER),
        (control("110201"), ["packet 1"]),
        (None, ["packet 2"]),
        (control("1009000202"), ["110201ffff"]),
        (control("1309000202"), []),  # late
        (packet(1, b"1234567"), []),
        (packet(2, b"89"), ["13090002ff"]),
    )
    with pytest.raises(StopIteration) as stop:
        operation.send(None)
    assert stop.value.value == b"123456789"


def test_an_invalid_reply_instead_of_an_end() -> None:
    operation = script(
        exchange(b"x", host=HOST, driver=DRIVER), (control("110201"), ["packet 1"]), (None, ["packet 2"])
    )
    assert "is not valid" in str(fails(operation, control("10080002ff"), ["ff02ffffff"]))


@pytest.mark.parametrize(
    "opening", ["1008000202", "10fa06ffff", "1009000102", "1009000302", "10ffffff02", "1000000002"]
)
def test_invalid_messages_of_the_driver(opening: str) -> None:
    error = fails(script(receiving()), control(opening), ["ff02ffffff"])
    assert isinstance(error, ProtocolError)


@pytest.mark.parametrize(("most", "asked"), [("02", "110201ffff"), ("ff", "111001ffff"), ("00", "110101ffff")])
def test_the_driver_limits_its_packets_per_burst(most: str, asked: str) -> None:
    script(receiving(), (control(f"10960016{most}"), [asked]))


def test_duplicate_late_and_reordered_packets() -> None:
    operation = script(
        receiving(),
        (control("1018000402"), ["110201ffff"]),
        (packet(0, b""), []),
        (packet(5, b""), []),
        (packet(2, b"8901234"), ["110101ffff"]),
        (packet(2, b"8901234"), []),
        (packet(1, b"1234567"), ["110203ffff"]),
        (packet(1, b"1234567"), []),
        (packet(4, b"234"), ["110103ffff"]),
        (packet(3, b"5678901"), ["13180004ff"]),
    )
    with pytest.raises(StopIteration) as stop:
        operation.send(None)
    assert stop.value.value == b"123456789012345678901234"


def test_the_driver_repeats_its_beginning() -> None:
    opening = control("1009000202")
    script(receiving(), (opening, ["110201ffff"]), (packet(1, b"1234567"), []), (opening, ["110201ffff"]))


def test_the_driver_never_sends_the_requested_packets() -> None:
    opening = control("1009000202")
    operation = script(
        receiving(), (opening, ["110201ffff"]), *[(packet(2, b""), ["110101ffff"])], *[(opening, ["110201ffff"])] * 15
    )
    assert "packets 1 to 2" in str(fails(operation, opening, ["ff05ffffff"]))


def test_packets_are_requested_again_once_before_the_time_out() -> None:
    operation = receiving()
    assert next(operation).seconds == 1.25
    assert operation.send(control("1009000202")).seconds == 0.75
    turn = operation.send(None)
    assert show(turn.frames) == ["110201ffff"]
    assert turn.seconds == pytest.approx(0.5)
    assert operation.send(packet(1, b"")).seconds == 0.75
    assert show(operation.send(None).frames) == ["110102ffff"]
    assert isinstance(fails(operation, None, ["ff03ffffff"]), DriverTimeout)


# --- the driver alone --------------------------------------------------------------------------------------------------


class Driver:
    """A responder, and the messages that it received."""

    def __init__(self, answer: bytes | None = b"answer...") -> None:
        self.asked: list[tuple[bytes, int]] = []
        self._answer = answer
        self.side = Responder(DRIVER, self._handle)

    def _handle(self, message: bytes, host: int) -> bytes | None:
        self.asked.append((message, host))
        return self._answer

    def tell(self, *frames: CanFrame, now: float = 0.0) -> list[str]:
        """Pass frames to the responder; return what it sends after the last one."""
        sent: list[CanFrame] = []
        for frame in frames:
            sent = self.side.receive(frame, now)
        return show(sent)


OPENING = from_host("1009000202")
ONE, TWO = (packet(n, bytes((n,)) * 7, HOST, DRIVER) for n in (1, 2))
ANSWERED = ["13090002ff", "1009000202"]


def test_a_request_and_its_reply() -> None:
    driver = Driver()
    assert driver.tell(OPENING) == ["110201ffff"]
    assert driver.tell(ONE) == []
    assert driver.tell(TWO) == ANSWERED
    assert driver.asked == [(b"\x01" * 7 + b"\x02" * 2, HOST)]
    assert driver.tell(from_host("110101")) == ["packet 1"]
    assert driver.tell(from_host("110502")) == ["packet 2"]
    assert driver.side.next_time == 1.25
    assert driver.tell(from_host("1309000202")) == []
    assert driver.side.next_time is None


@pytest.mark.parametrize(
    "frame",
    [
        *FOREIGN,
        from_host("ff01"),
        from_host("110101"),
        from_host("1309000202"),
        ONE,
        control("1009000202", HOST, 255),
        control("1009000202", DRIVER, DRIVER),
        control("1009000202", 255, DRIVER),
        control("2009000202", HOST, 255),
    ],
    ids=str,
)
def test_frames_that_a_driver_ignores(frame: CanFrame) -> None:
    driver = Driver()
    assert driver.tell(frame) == []
    assert driver.side.next_time is None
    assert driver.tell(OPENING, frame) in ([], ["110201ffff"])
    assert driver.side.tick(100.0) == [] or driver.side.next_time is not None


def test_another_host_has_to_wait() -> None:
    driver = Driver()
    driver.tell(OPENING)
    other = from_host("1009000202", OTHER)
    frames = driver.side.receive(other, 0.0)
    assert [(frame.id, frame.data[:2]) for frame in frames] == [(0x00EC0301, b"\xff\x01")]
    assert driver.tell(from_host("ff03", OTHER), packet(1, b"", OTHER, DRIVER)) == []
    assert driver.tell(ONE, TWO) == ANSWERED
    assert driver.tell(other) == ["ff01ffffff"]
    assert driver.tell(from_host("1309000202")) == []  # before the packets: too early
    assert driver.tell(from_host("110201"), from_host("1309000202"), other) == ["110201ffff"]


def test_the_same_host_starts_again() -> None:
    driver = Driver()
    driver.tell(OPENING, ONE)
    assert driver.tell(OPENING) == ["110201ffff"]  # it may be another message: what was received is dropped
    assert driver.tell(from_host("100a000202")) == ["110201ffff"]  # another message
    assert driver.tell(ONE, TWO) == ["130a0002ff", "1009000202"]
    assert driver.tell(OPENING) == ["110201ffff"]  # it no longer expects the reply
    assert driver.tell(ONE, TWO) == ANSWERED
    assert [len(message) for message, _ in driver.asked] == [10, 9]


def test_an_identical_rts_discards_the_abandoned_message() -> None:
    """A host that was killed cannot abort; the message of the next program has the same length."""
    driver = Driver()
    driver.tell(OPENING, packet(1, b"another", HOST, DRIVER))
    assert driver.tell(OPENING) == ["110201ffff"]
    assert driver.tell(TWO) == ["110101ffff"]  # the end of the burst, and the first packet is missing
    assert driver.tell(ONE) == ANSWERED
    assert driver.asked[0][0] == b"\x01" * 7 + b"\x02" * 2


def test_packets_of_a_host_are_requested_again_once_before_the_time_out() -> None:
    driver = Driver()
    driver.tell(OPENING, now=10.0)
    assert driver.side.next_time == 10.75
    assert driver.side.tick(10.7) == []
    assert show(driver.side.tick(10.8)) == ["110201ffff"]
    assert driver.side.next_time == pytest.approx(11.3)
    assert show(driver.side.tick(11.3)) == ["ff03ffffff"]
    assert driver.side.next_time is None
    assert driver.side.tick(99.0) == []
    driver.tell(OPENING, ONE, TWO, now=20.0)
    assert driver.side.next_time == 21.25
    assert show(driver.side.tick(21.25)) == ["ff03ffffff"]
    assert len(driver.asked) == 1


@pytest.mark.parametrize(
    "before", [[OPENING], [OPENING, ONE], [OPENING, ONE, TWO], [OPENING, ONE, TWO, from_host("110101")]]
)
def test_a_host_aborts_in_any_phase(before: list[CanFrame]) -> None:
    driver = Driver()
    driver.tell(*before)
    assert driver.side.next_time is not None
    assert driver.tell(from_host("ff03")) == []
    assert driver.side.next_time is None
    assert driver.tell(OPENING) == ["110201ffff"]


@pytest.mark.parametrize("opening", ["1008000202", "10fa06ffff"])
def test_a_message_that_is_too_long_or_too_short(opening: str) -> None:
    driver = Driver()
    assert driver.tell(from_host(opening)) == ["ff02ffffff"]
    assert driver.side.next_time is None


def test_a_device_that_fails() -> None:
    def broken(message: bytes, host: int) -> bytes:
        raise LookupError("no such address")

    wire = Wire(broken)
    with pytest.raises(LookupError):
        wire.exchange(b"x")
    assert wire.driver.next_time is None


@given(st.lists(st.tuples(st.binary(min_size=5, max_size=5), st.booleans(), st.floats(0, 2)), max_size=60))
def test_a_driver_survives_every_frame(frames: list[tuple[bytes, bool, float]]) -> None:
    driver = Responder(DRIVER, echo)
    now = 0.0
    for head, is_control, seconds in frames:
        now += seconds
        kind = b"\x10\x11\x13\xff"[head[0] % 4]
        data = bytes((kind,)) + head[1:] + PGN if is_control else head + b"abc"
        frame = CanFrame(int(FrameId(CONTROL if is_control else TRANSFER, DRIVER, HOST)), data)
        for sent in (*driver.tick(now), *driver.receive(frame, now)):
            checked(sent)
    for _ in range(40):
        if driver.next_time is None:
            break
        driver.tick(driver.next_time)
    assert driver.next_time is None


def test_constants() -> None:
    assert (multipacket.SHORTEST, multipacket.LONGEST, multipacket.SYN) == (9, 1785, b"\x16")
    assert (multipacket.TIMEOUT, multipacket.PAUSE) == (1.25, 0.001)


@pytest.mark.parametrize("message", ["text", None, 5, [1, 2], memoryview(b"x")])
def test_messages_that_are_not_bytes(message: bytes) -> None:
    for tongue, text in (("en", "must be bytes"), ("ja", "bytes が必要です")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            exchange(message, host=HOST, driver=DRIVER)
