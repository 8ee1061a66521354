"""Client and server conversations over an unreliable link, on a manual clock: each call is executed once, or fails."""

from __future__ import annotations

import heapq
import itertools
import random
from dataclasses import dataclass, field

import pytest

from orinkit.bcap import packet
from orinkit.bcap.actions import EndSession, Execute, Send
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.duplicate_filter import MEMORY
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE, SILENCE
from orinkit.bcap.server import ServerConversation
from orinkit.cao import functions as f
from orinkit.cao.dialect import VE026A
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, InvalidValue
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core

TRY = 0.5
TRIES = 5


# --- the client alone -------------------------------------------------------------------------------------------------


class Call:
    """A call in progress, driven step by step."""

    def __init__(
        self, conversation, *arguments, function=f.variable_get_value, tries=TRIES, exact=False, nothing=False
    ):
        self.wire = conversation.profile
        self.operation = conversation.call(
            function, arguments or (() if nothing else (3,)), TRY, tries=tries, exact=exact
        )
        self.wait(next(self.operation))

    def wait(self, exchange):
        data, self.seconds = exchange
        self.sent = packet.decode(data, crc=self.wire.crc) if data else None

    def feed(self, received):
        self.wait(self.operation.send(received))

    def reply(self, serial, *arguments, code=0):
        return packet.encode(Packet(serial, code, list(arguments)), crc=self.wire.crc)

    def result(self, received):
        with pytest.raises(StopIteration) as ended:
            self.operation.send(received)
        return ended.value.value[1]


@pytest.fixture(params=[DATAGRAM, LINE], ids=["udp", "serial"])
def conversation(request):
    return BcapConversation(profile=request.param)


def test_an_attempt_has_a_new_serial_and_the_first_one_in_the_reserved_field(conversation):
    call = Call(conversation)
    tries = [(call.sent.serial, call.sent.reserved)]
    for _ in range(TRIES - 1):
        assert call.seconds == TRY
        call.feed(None)
        tries.append((call.sent.serial, call.sent.reserved))
    assert tries == [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1)]
    with pytest.raises(CallTimeout) as caught:
        call.operation.send(None)
    assert caught.value.seconds == TRY * TRIES
    assert Call(conversation).sent.serial == 6


def test_a_reply_to_any_attempt_is_accepted(conversation):
    call = Call(conversation)
    call.feed(None)
    call.feed(None)
    call.feed(call.reply(7, 1))
    assert conversation.stray_replies == 1
    assert call.sent is None
    assert call.seconds is None
    assert call.result(call.reply(1, 42)) == 42
    again = Call(conversation)
    again.feed(again.reply(2, 42))
    assert conversation.stray_replies == 2
    assert again.result(again.reply(4, 43)) == 43


def test_executing_restarts_the_count_of_attempts(conversation):
    call = Call(conversation, tries=2)
    call.feed(None)
    call.feed(call.reply(2, code=hresult.S_EXECUTING))
    assert call.seconds == TRY
    call.feed(None)
    assert (call.sent.serial, call.sent.reserved) == (3, 1)
    with pytest.raises(CallTimeout):
        call.operation.send(None)


def test_a_ve026a_may_report_that_it_is_busy_with_the_first_attempt():
    """Table 3-5 of the VE026A: "wait for a while"; a busy reply to a first attempt has another reason."""
    conversation = BcapConversation(profile=LINE, dialect=VE026A)
    call = Call(conversation, tries=2)
    call.feed(None)
    call.feed(call.reply(2, code=hresult.E_ROBOTISBUSY))
    assert call.result(call.reply(1, 42)) == 42
    again = Call(conversation)
    with pytest.raises(CallError) as caught:
        again.operation.send(again.reply(3, code=hresult.E_ROBOTISBUSY))
    assert caught.value.code == hresult.E_ROBOTISBUSY


def test_a_ve026a_that_stays_busy_is_reported():
    conversation = BcapConversation(profile=LINE, dialect=VE026A)
    call = Call(conversation, tries=3)
    for serial in (2, 3):
        call.feed(None)
        call.feed(call.reply(serial, code=hresult.E_ROBOTISBUSY))
    with pytest.raises(CallError) as caught:
        call.operation.send(None)
    assert caught.value.code == hresult.E_ROBOTISBUSY


def test_a_line_that_echoes_the_requests(conversation):
    """A loopback plug or an RS-485 converter: the echo of a request is not a reply."""
    call = Call(conversation)
    call.feed(packet.encode(call.sent, crc=conversation.profile.crc))
    assert conversation.stray_replies == 1
    assert not conversation.echoes_reserved
    assert call.result(call.reply(1, 42)) == 42


def test_a_reply_shows_whether_the_reserved_field_is_echoed(conversation):
    call = Call(conversation)
    assert call.result(packet.encode(Packet(1, 0, [42], 1), crc=conversation.profile.crc)) == 42
    assert conversation.echoes_reserved


def test_a_foreign_packet_after_noise_costs_one_attempt():
    """Noise before a foreign packet: the end of that packet ends one attempt."""
    conversation = BcapConversation(profile=LINE)
    call = Call(conversation, tries=3)
    for number in (2, 3):
        call.feed(b"\x01\xf0\x00\x00\x00" + call.reply(99, 1))
        call.feed(None)
        assert call.sent.serial == number
    call.feed(b"\x01\xf0\x00\x00\x00" + call.reply(3, code=hresult.S_EXECUTING))
    call.feed(None)
    assert call.sent is None
    assert call.seconds == TRY


def test_later_attempts_may_wait_longer(conversation):
    operation = conversation.call(f.variable_get_value, (3,), TRY, tries=3, retry_timeout=2.0)
    assert next(operation)[1] == TRY
    assert operation.send(None)[1] == 2.0


def test_invalid_bytes_and_the_end_of_the_connection(conversation):
    call = Call(conversation)
    call.feed(b"rubbish")
    call.feed(call.reply(1, 42)[:-1] + b"\x05")
    assert conversation.skipped_bytes > 0
    with pytest.raises(ConnectionLost):
        call.operation.send(b"")


def test_a_reply_after_noise_is_found_when_the_line_is_silent():
    conversation = BcapConversation(profile=LINE)
    call = Call(conversation)
    call.feed(b"\x01\xf0\x00\x00\x00" + call.reply(1, 42))
    assert call.result(None) == 42


def test_a_long_reply_over_a_slow_line_is_waited_for():
    conversation = BcapConversation(profile=LINE)
    call = Call(conversation)
    answer = call.reply(1, "x" * 500)
    call.feed(answer[:10])
    call.feed(None)
    assert call.sent.serial == 2, "the serial has not been received"
    answer = call.reply(2, "x" * 500)
    call.feed(answer[:100])
    for begin in range(100, 1000, 100):
        call.feed(None)
        assert call.sent is None
        assert call.seconds == SILENCE
        call.feed(answer[begin : begin + 100])
    assert call.result(answer[1000:]) == "x" * 500
    again = Call(conversation)
    again.feed(again.reply(3, "x" * 500)[:100])
    again.feed(None)
    again.feed(None)
    assert again.sent.serial == 4, "no more bytes arrive"
    again.feed(again.reply(9, "x" * 500)[:100])
    again.feed(None)
    assert again.sent.serial == 5, "the serial is not that of the call"


def test_every_attempt_is_traced(conversation):
    traced = []
    conversation.trace = lambda sign, data: traced.append(
        (sign, packet.decode(data, crc=conversation.profile.crc).serial)
    )
    call = Call(conversation)
    call.feed(None)
    call.result(call.reply(2, 42))
    assert traced == [(">", 1), (">", 2), ("<", 2)]


def test_serials_wrap_around(conversation):
    conversation.serial = 0xFFFF
    call = Call(conversation)
    call.feed(None)
    assert (call.sent.serial, call.sent.reserved) == (1, 0xFFFF)


def test_a_packet_too_long_for_a_datagram_is_not_sent():
    conversation = BcapConversation(profile=DATAGRAM)
    text = "x" * ((487 - 14 - 14) // 2)
    assert Call(conversation, 3, text, function=f.variable_put_value).sent.arguments == [3, text]
    with pytest.raises(InvalidValue, match="exceeds the limit of 503"):
        Call(conversation, 3, text + "x", function=f.variable_put_value)


def test_a_dialect_that_is_known_later():
    conversation = BcapConversation(profile=LINE)
    code = Variant(VarType.ERROR, 0x600B)
    long = len(packet.encode(Packet(*_sent(conversation, code)), crc=True))
    conversation.dialect = VE026A
    assert conversation.dialect is VE026A
    conversation.dialect = VE026A
    call = Call.__new__(Call)
    call.operation = conversation.call(f.controller_execute, (1, "ClearError", code), TRY)
    data, _ = next(call.operation)
    assert len(data) == long - 2
    with pytest.raises(StopIteration) as ended:
        call.operation.send(packet.pack(2, 0, 1, b"\x08\x00\x00\x00\x0a\x00\x01\x00\x00\x00\x0b\x60", crc=True))
    assert ended.value.value[1] == 0x600B


def _sent(conversation, code):
    sent = Call(conversation, 1, "ClearError", code, function=f.controller_execute).sent
    return sent.serial, sent.code, [sent.arguments[0], sent.arguments[1], code], sent.reserved


# --- both, over a bad link --------------------------------------------------------------------------------------------


@dataclass
class Link:
    """One direction of a link that loses, duplicates, delays, reorders, corrupts and splits the data."""

    rng: random.Random
    loss: float = 0.2
    double: float = 0.05
    broken: float = 0.02
    cut: float = 0.02
    noise: float = 0.0
    delay: float = 0.08

    def carry(self, data):
        """Return the pieces of a packet that arrive, each with its delay."""
        arriving = []
        for _ in range(2 if self.rng.random() < self.double else 1):
            if self.rng.random() < self.loss:
                continue
            piece = bytearray(data)
            if self.rng.random() < self.broken:
                piece[0] ^= 0xFF  # UDP's own checksum drops a corrupted datagram
            if self.rng.random() < self.cut:
                del piece[self.rng.randrange(len(piece)) :]
            if piece:
                arriving.append((self.rng.random() ** 4 * self.delay, bytes(piece)))
        return arriving


@dataclass
class NoisyLine(Link):
    """The same for bytes: the CRC detects all corruption; the order is kept."""

    _last: float = 0.0

    def carry(self, data):
        arriving = []
        for delay, given in super().carry(data):
            piece = given
            if self.rng.random() < 0.03:
                place = self.rng.randrange(len(piece) + 1)
                piece = piece[:place] + self.rng.randbytes(self.rng.randrange(1, 9)) + piece[place:]
            arriving.append((delay, piece))
        if self.rng.random() < 0.05:
            arriving.append((0.0, self.rng.randbytes(self.rng.randrange(1, 30))))
        return arriving


@dataclass(order=True)
class Event:
    when: float
    number: int
    what: str = field(compare=False)
    data: bytes = field(compare=False, default=b"")


class World:
    """A client and a server with a counter, the link between them, and the clock."""

    def __init__(self, wire, link, seed, slow=0.0):
        self.rng = random.Random(seed)
        self.link = link(self.rng)
        self.wire = wire
        self.now = 0.0
        self.events = []
        self.numbers = itertools.count()
        self.client = BcapConversation(profile=wire)
        self.server = ServerConversation(profile=wire)
        self.executed = []  # arguments of every executed call
        self.heard = 0.0
        self.slow = slow

    def later(self, seconds, what, data=b""):
        heapq.heappush(self.events, Event(self.now + seconds, next(self.numbers), what, data))

    def send(self, way, data):
        for delay, piece in self.link.carry(data):
            self.later(delay, way, piece)

    def act(self, actions):
        for action in actions:
            if isinstance(action, Send):
                self.send("to client", action.data)
            elif isinstance(action, Execute):
                self.executed.append(action.arguments[1].value)
                if self.slow and self.rng.random() < 0.1:
                    self.busy = action
                    self.later(self.slow, "done")
                else:
                    self.answer(action)

    def answer(self, call):
        self.send("to client", self.server.finish(call, 0, variant(call.arguments[1].value + 1)))

    def step(self, until):
        """Advance the clock until the client receives data; return ``None`` after a time-out."""
        while self.events and self.events[0].when <= until:
            event = heapq.heappop(self.events)
            self.now = event.when
            if event.what == "to client":
                return event.data
            if event.what == "to server":
                self.act(self.server.receive(event.data, self.now))
                self.heard = self.now
            elif event.what == "done":
                self.answer(self.busy)
                self.act(self.server.resume(self.now))
            elif self.server.discardable_bytes and self.now - self.heard >= SILENCE:
                self.act(self.server.discard_incomplete(self.now))
            if self.server.discardable_bytes:
                self.later(SILENCE, "silence")
        self.now = until
        return None

    def call(self, number):
        """Send a number and expect its successor; return the result, or the error."""
        operation = self.client.call(f.variable_put_value, (2, number), TRY, tries=TRIES)
        end = 0.0
        received = None
        began = self.now
        try:
            while True:
                data, seconds = operation.send(received)
                if data:
                    self.send("to server", data)
                if seconds is not None:
                    end = self.now + seconds
                received = self.step(end)
        except StopIteration:
            return "done"
        except CallTimeout as error:
            assert self.now - began >= TRY * TRIES - 1e-9
            return error
        except CallError as error:
            return error.code


def check(world, calls):
    outcomes = {"done": 0, "timeout": 0, "busy": 0}
    for number in range(calls):
        outcome = world.call(number)
        times = world.executed.count(number) if number < 50 else world.executed[-50:].count(number)
        if outcome == "done":
            assert times == 1
            outcomes["done"] += 1
        else:
            assert isinstance(outcome, CallTimeout) or outcome == hresult.E_BUSY_PROC
            outcomes["timeout" if isinstance(outcome, CallTimeout) else "busy"] += 1
            assert times <= (1 if isinstance(outcome, CallTimeout) else 0)
    assert len(world.executed) == len(set(world.executed))
    assert world.executed == sorted(world.executed), "no call is executed after a later one"
    return outcomes


@pytest.mark.parametrize(("wire", "link", "calls"), [(DATAGRAM, Link, 10_000), (LINE, NoisyLine, 2_000)])
def test_every_call_is_executed_once(wire, link, calls):
    outcomes = check(World(wire, link, 1), calls)
    assert outcomes["timeout"] < calls / 50
    assert outcomes["busy"] == 0


@pytest.mark.parametrize(("wire", "link"), [(DATAGRAM, Link), (LINE, NoisyLine)])
@pytest.mark.parametrize("seed", range(2))
def test_calls_that_take_longer_than_an_attempt(wire, link, seed):
    """A call in progress is reported; a call of 1.2 s finally succeeds."""
    outcomes = check(World(wire, link, seed, slow=1.2), 300)
    assert outcomes["done"] > 250


@pytest.mark.parametrize("seed", range(3))
def test_datagrams_that_arrive_very_late(seed):
    """They arrive after the time-out of an attempt, during the following calls."""
    outcomes = check(World(DATAGRAM, lambda rng: Link(rng, delay=1.5, loss=0.1), seed), 1000)
    assert outcomes["done"] > 900


@pytest.mark.parametrize("seed", range(3))
def test_calls_that_take_longer_than_the_memory(seed):
    """The lifetime of a stored reply begins when it is sent."""
    outcomes = check(World(DATAGRAM, Link, seed, slow=MEMORY + 1.5), 60)
    assert outcomes["done"] > 30


def test_a_link_that_carries_nothing():
    world = World(DATAGRAM, lambda rng: Link(rng, loss=1.0), 1)
    assert isinstance(world.call(1), CallTimeout)
    assert world.now == pytest.approx(TRY * TRIES)
    assert world.executed == []


def test_the_close_sequence(conversation):
    """Service_Stop is sent three times, because there is no reply."""
    assert conversation.close_sequence() == [], "no request has been sent"
    Call(conversation)
    packets = [packet.decode(data, crc=conversation.profile.crc) for data, _ in conversation.close_sequence()]
    assert packets == [Packet(2, 2, [], 2), Packet(3, 2, [], 2), Packet(4, 2, [], 2)]
    assert conversation.close_sequence() == []
    stop = Call(conversation, function=f.service_stop, nothing=True)
    assert stop.result(stop.reply(5)) is None
    assert conversation.close_sequence() == [], "Service_Stop has been sent already"
    assert BcapConversation().close_sequence() == []


def test_the_close_sequence_ends_the_call_in_progress():
    client, server = BcapConversation(profile=DATAGRAM), ServerConversation(profile=DATAGRAM)
    operation = client.call(f.controller_execute, (2, "x", 0), TRY)
    (call,) = server.receive(next(operation)[0], 0.0)
    reset, stop = server.receive(client.close_sequence()[0][0], 0.0)
    assert isinstance(reset, EndSession)
    assert isinstance(stop, Execute)
    assert server.finish(call, 0, None) == b""
    server.finish(stop, 0, None)
    assert server.stopped
