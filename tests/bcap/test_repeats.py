"""Unreliable transports: a duplicate request receives the same reply and is not executed again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from orinkit.bcap import packet
from orinkit.bcap.actions import Close, EndSession, Execute, Send
from orinkit.bcap.duplicate_filter import MEMORY
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM
from orinkit.bcap.server import ServerConversation
from orinkit.cao.dialect import VE026A
from orinkit.cao.functions import robot_halt
from orinkit.core import hresult
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core

NOW = 1000.0
CALL = 101  # Variable_GetValue


class Line:
    """A conversation, and packets of a client with or without a CRC."""

    def __init__(self, profile=DATAGRAM, **parameters):
        self.wire = profile
        self.now = NOW
        self.server = ServerConversation(profile=profile, **parameters)

    def data(self, serial, reserved=0, function=CALL, *arguments):
        return packet.encode(Packet(serial, function, list(arguments), reserved), crc=self.wire.crc)

    def ask(self, serial, reserved=0, function=CALL, *arguments):
        return list(self.server.receive(self.data(serial, reserved, function, *arguments), self.now))

    def read(self, data):
        return packet.decode(data, crc=self.wire.crc)

    def execute(self, serial, reserved=0, function=CALL, *arguments):
        """Return the only action: a call."""
        (action,) = self.ask(serial, reserved, function, *arguments)
        assert isinstance(action, Execute)
        return action

    def executed(self, serial, reserved=0, function=CALL, *arguments, result=42):
        """Execute the call and return the reply."""
        call = self.execute(serial, reserved, function, *arguments)
        return self.read(self.server.finish(call, 0, None if result is None else variant(result)))

    def reply(self, serial, reserved=0, function=CALL, *arguments):
        """Return the only action: a reply."""
        (action,) = self.ask(serial, reserved, function, *arguments)
        assert isinstance(action, Send)
        return self.read(action.data)

    def finish(self, call, result=1):
        """Finish a call; return its reply, and the calls that have waited for it."""
        reply = self.read(self.server.finish(call, 0, variant(result)))
        return reply, list(self.server.resume(self.now))


@pytest.fixture(params=[DATAGRAM, LINE], ids=["udp", "serial"])
def line(request):
    return Line(request.param)


# --- duplicates -------------------------------------------------------------------------------------------------------


def test_a_retry_receives_the_stored_reply(line):
    assert line.executed(5, 5, CALL, 3) == Packet(5, 0, [42])
    assert line.reply(6, 5, CALL, 3) == Packet(6, 0, [42])
    assert line.reply(7, 5, CALL, 3) == Packet(7, 0, [42])
    assert line.reply(5, 5, CALL, 3) == Packet(5, 0, [42])
    assert line.executed(8, 8, CALL, 3, result=43).arguments == [43]


def test_a_retry_of_an_old_client_with_reserved_field_0(line):
    """The serial is the number in that case; the same packet again is the same request."""
    assert line.executed(5, 0, CALL, 3) == Packet(5, 0, [42])
    assert line.reply(5, 0, CALL, 3) == Packet(5, 0, [42])
    assert line.executed(7, 0, CALL, 3, result=43) == Packet(7, 0, [43])
    assert line.executed(5, 0, CALL, 3, result=44).arguments == [44], "not the newest request, so it is executed"


def test_serial_0_is_a_valid_number(line):
    """RC8 3.1 prints packets with serial 0 and the reserved field 0."""
    assert line.executed(0, 0, CALL, 3) == Packet(0, 0, [42])
    assert line.reply(0, 0, CALL, 3) == Packet(0, 0, [42])
    assert line.executed(1, 0, CALL, 3, result=43) == Packet(1, 0, [43])
    call = line.execute(0, 0, CALL, 4)
    assert line.reply(0, 0, CALL, 4) == Packet(0, hresult.S_EXECUTING)
    assert line.ask(1, 1, CALL, 5) == []
    reply, (waited,) = line.finish(call)
    assert reply == Packet(0, 0, [1])
    assert line.finish(waited, 2) == (Packet(1, 0, [2]), [])


def test_the_first_service_start_has_serial_0(line):
    assert line.executed(0, 0, 1, result=None) == Packet(0, 0)
    assert line.reply(0, 0, 1) == Packet(0, 0)
    assert line.reply(0, 0, 1) == Packet(0, 0)


def test_a_retry_during_the_call(line):
    call = line.execute(5, 5, CALL, 3)
    assert line.reply(6, 5, CALL, 3) == Packet(6, hresult.S_EXECUTING)
    assert line.ask(9, 9, CALL, 4) == [], "it waits"
    assert line.reply(10, 9, CALL, 4) == Packet(10, hresult.S_EXECUTING)
    reply, (waited,) = line.finish(call)
    assert reply == Packet(6, 0, [1]), "the reply has the serial of the latest attempt"
    assert line.finish(waited, 2) == (Packet(10, 0, [2]), [])
    assert line.reply(11, 9, CALL, 4) == Packet(11, 0, [2])
    assert line.executed(12, 12, CALL, 4, result=2) == Packet(12, 0, [2])


def test_requests_of_a_lossy_transport_wait_in_order(line):
    call = line.execute(5, 5, CALL, 3)
    assert [line.ask(serial, serial, CALL, serial) for serial in (6, 7)] == [[], []]
    assert line.reply(8, 6, CALL, 6) == Packet(8, hresult.S_EXECUTING)
    _, (second,) = line.finish(call)
    assert second.arguments == [variant(6)]
    assert line.reply(9, 7, CALL, 7) == Packet(9, hresult.S_EXECUTING)
    reply, (third,) = line.finish(second)
    assert reply.serial == 8
    assert third.arguments == [variant(7)]
    assert line.finish(third) == (Packet(9, 0, [1]), [])


def test_a_stop_over_a_lossy_transport_does_not_wait(line):
    call = line.execute(5, 5, CALL, 3)
    stop = line.execute(6, 6, robot_halt.id, 3)
    assert line.reply(7, 6, robot_halt.id, 3) == Packet(7, hresult.S_EXECUTING)
    assert line.read(line.server.finish(stop, 0, None)) == Packet(7, 0)
    assert line.reply(8, 6, robot_halt.id, 3) == Packet(8, 0)
    assert line.finish(call) == (Packet(5, 0, [1]), [])


@pytest.mark.parametrize("number", [5, 0])
def test_another_request_with_the_number_of_the_call_in_progress(line, number):
    """It is refused, and not confused with the request in progress."""
    call = line.execute(number, number, CALL, 3)
    assert line.reply(number, number, CALL, 4) == Packet(number, hresult.E_BUSY_PROC, [None])
    assert line.reply(number, number, CALL, 4) == Packet(number, hresult.E_BUSY_PROC, [None])
    assert line.reply(number, number, CALL, 3) == Packet(number, hresult.S_EXECUTING)
    assert line.read(line.server.finish(call, 0, variant(1))) == Packet(number, 0, [1])
    assert line.reply(number, number, CALL, 3) == Packet(number, 0, [1])
    assert line.executed(number, number, CALL, 4, result=2) == Packet(number, 0, [2]), (
        "it may be repeated after the call"
    )
    assert line.reply(number, number, CALL, 4) == Packet(number, 0, [2])


def test_an_error_reply_is_stored_too(line):
    call = line.execute(5, 5, CALL, 3)
    line.server.finish(call, 0x80070006, None)
    assert line.reply(6, 5, CALL, 3) == Packet(6, 0x80070006, [None])


@pytest.mark.parametrize("body", [{"function": 7}, {"arguments": (4,)}])
def test_the_same_number_with_another_content_is_another_request(line, body):
    line.executed(5, 5, CALL, 3)
    assert line.executed(5, 5, body.get("function", CALL), *body.get("arguments", (3,)), result=7).arguments == [7]


def test_old_requests_are_dropped(line):
    line.executed(5, 5, CALL, 3)
    line.now += MEMORY
    assert line.executed(5, 5, CALL, 3, result=43).arguments == [43]


def test_the_age_of_a_reply_counts_from_its_time(line):
    """The lifetime does not begin with the last packet received before."""
    call = line.execute(5, 0, CALL, 3)
    line.now += MEMORY
    line.server.update_time(line.now)
    assert line.read(line.server.finish(call, 0, variant(1))) == Packet(5, 0, [1])
    line.now += MEMORY - 1
    assert line.reply(5, 0, CALL, 3) == Packet(5, 0, [1])
    line.now += 1
    assert line.executed(5, 0, CALL, 3, result=2) == Packet(5, 0, [2])


def test_the_age_of_a_time_out_counts_from_its_reply(line):
    line = Line(line.wire, invoke_timeout=MEMORY)
    call = line.execute(5, 0, CALL, 3)
    line.now += MEMORY
    assert line.read(line.server.tick(line.now)) == Packet(5, hresult.E_TIMEOUT, [None])
    assert line.server.finish(call, 0, variant(1)) == b""
    line.now += MEMORY - 1
    assert line.reply(5, 0, CALL, 3) == Packet(5, hresult.E_TIMEOUT, [None])


def test_a_retry_after_a_time_out_of_the_server():
    line = Line(invoke_timeout=1.0)
    line.execute(5, 5, CALL, 3)
    assert line.read(line.server.tick(NOW + 1.0)).code == hresult.E_TIMEOUT
    assert line.reply(6, 5, CALL, 3).code == hresult.E_TIMEOUT
    assert line.reply(7, 7, CALL, 3).code == hresult.E_BUSY_PROC


def test_the_watchdog_uses_the_latest_serial(line):
    line.executed(1, 1, 1, "WDT=100", result=None)
    line.execute(5, 5, CALL, 3)
    line.reply(6, 5, CALL, 3)
    assert line.read(line.server.tick(NOW + 0.1)) == Packet(6, hresult.S_EXECUTING)


def test_a_refused_request_is_refused_again(line):
    assert line.reply(5, 5, CALL, *[1] * 9).code == hresult.E_INVALIDARG
    assert line.reply(6, 5, CALL, *[1] * 9) == Packet(6, hresult.E_INVALIDARG, [None])
    assert line.reply(7, 7, 200, *[1] * 9).code == hresult.E_NOTIMPL


# --- late packets -----------------------------------------------------------------------------------------------------


def test_a_late_datagram_is_not_executed_again(line):
    line.executed(5, 5, CALL, 3)
    line.executed(6, 6, CALL, 3, result=43)
    assert line.reply(5, 5, CALL, 3) == Packet(5, 0, [42]), "the stored reply, which no client waits for"
    assert line.executed(7, 7, CALL, 3, result=44).arguments == [44]


def test_a_request_that_arrives_after_its_client_gave_it_up(line):
    line.executed(5, 5, CALL, 3)
    line.executed(9, 9, CALL, 3)
    assert line.ask(7, 6, CALL, 3) == []
    assert line.ask(6, 6, CALL, 3) == []


def test_a_late_request_during_a_call(line):
    line.executed(5, 5, CALL, 3)
    call = line.execute(9, 9, CALL, 3)
    assert line.ask(7, 6, CALL, 3) == []
    assert line.reply(5, 5, CALL, 3).arguments == [42]
    assert line.read(line.server.finish(call, 0, variant(1))) == Packet(9, 0, [1])


@pytest.mark.parametrize("behind", [1, 64, 5000, 32767])
def test_lower_numbers_are_late(line, behind):
    line.executed(40000, 40000, CALL, 3)
    assert line.ask(40000 - behind, 40000 - behind, CALL, 3) == []
    line.now += MEMORY
    assert line.executed(40000 - behind, 40000 - behind, CALL, 3, result=43).arguments == [43]


def test_higher_numbers_are_new(line):
    line.executed(40000, 40000, CALL, 3)
    assert line.executed(50000, 50000, CALL, 3, result=43).arguments == [43]
    assert line.executed(10, 10, CALL, 3, result=44).arguments == [44]


def test_a_call_in_progress_is_never_dropped(line):
    call = line.execute(5, 5, CALL, 3)
    line.now += 5 * MEMORY
    assert line.reply(6, 5, CALL, 3) == Packet(6, hresult.S_EXECUTING)
    line.server.tick(line.now)
    assert line.read(line.server.finish(call, 0, variant(1))) == Packet(6, 0, [1])
    line.now += 5 * MEMORY
    assert line.reply(7, 5, CALL, 3) == Packet(7, 0, [1]), "the reserved field marks it as another attempt"


def test_old_clients_may_use_serials_in_any_order(line):
    """The printed samples, for instance: reserved 0 before serial 9."""
    line.executed(70, 70, CALL, 3)
    assert line.executed(5, 0, CALL, 3).arguments == [42]
    assert line.executed(3, 3, CALL, 3).arguments == [42], "the newest request has no number to compare with"


def test_serials_wrap_around(line):
    line.executed(65534, 65534, CALL, 3)
    line.executed(65535, 65535, CALL, 3)
    assert line.executed(1, 1, CALL, 3, result=1).arguments == [1]
    assert line.reply(65535, 65535, CALL, 3).arguments == [42]
    assert line.ask(65533, 65533, CALL, 3) == []


def test_the_number_of_stored_replies_is_limited(line):
    for number in range(1, 101):
        line.executed(number, number, CALL, 3, result=number)
    assert line.reply(100, 100, CALL, 3).arguments == [100]
    assert line.reply(60, 60, CALL, 3).arguments == [60]
    assert line.ask(36, 36, CALL, 3) == []
    assert line.reply(41, 40, CALL, 3).arguments == [40]


# --- successive clients -----------------------------------------------------------------------------------------------


def test_after_service_stop_everything_is_new(line):
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, CALL, 3)
    assert not line.server.stopped
    line.executed(3, 3, 2, result=None)
    assert line.server.stopped
    assert line.reply(4, 3, 2) == Packet(4, 0), "this reply may be lost too"
    assert line.executed(1, 1, 1, result=None).code == 0
    assert not line.server.stopped
    assert line.executed(2, 2, CALL, 3, result=43).arguments == [43]


def test_a_new_client_on_a_serial_line():
    """The previous client was killed; there is no other sign of its end."""
    line = Line(LINE)
    assert line.executed(1, 1, 1, result=None).code == 0
    call = line.execute(2, 2, CALL, 3)
    line.now += 2.0
    reset, start = line.ask(1, 1, 1)
    assert isinstance(reset, EndSession)
    assert isinstance(start, Execute)
    assert line.read(line.server.finish(start, 0, None)) == Packet(1, 0)
    assert line.server.finish(call, 0, variant(1)) == b"", "the call belongs to the previous client"
    assert line.executed(2, 2, CALL, 3, result=43).arguments == [43]


def test_a_client_that_restarts_immediately():
    """Its first packets are considered late; one second after the previous Service_Start they are not."""
    line = Line(LINE)
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, CALL, 3)
    assert line.ask(1, 1, 1) == []
    assert line.ask(2, 1, 1) == []
    line.now += 1.0
    reset, _ = line.ask(3, 1, 1)
    assert isinstance(reset, EndSession)


@pytest.mark.parametrize("old", [True, False])
def test_a_client_that_restarts_on_the_same_port(old):
    """UDP, with a fixed port: Service_Start has a lower number, and no older Service_Start can still be in transit."""
    line = Line(DATAGRAM)
    line.executed(1, 0 if old else 1, 1, result=None)
    line.execute(9, 9, CALL, 3)
    line.now += MEMORY
    reset, start = line.ask(1, 0 if old else 1, 1)
    assert isinstance(reset, EndSession)
    assert isinstance(start, Execute)


def test_a_late_attempt_of_service_start(line):
    """The server has seen other ones since; they are not forgotten."""
    line.executed(2, 1, 1, result=None)
    line.executed(3, 3, CALL, 3)
    line.now += 0.9
    assert line.ask(1, 1, 1) == []
    assert line.reply(4, 3, CALL, 3).arguments == [42]


def test_a_late_service_start_ends_nothing(line):
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, CALL, 3)
    assert line.ask(1, 1, 1) == []
    assert line.reply(2, 2, CALL, 3).arguments == [42]


def test_an_immediate_service_start_with_other_options(line):
    """The same number less than 1 s later: not considered another client's."""
    line.executed(1, 1, 1, "WDT=100", result=None)
    line.executed(2, 2, CALL, 3)
    assert line.ask(1, 1, 1, "WDT=200") == []


def test_a_service_start_in_between_over_udp():
    line = Line(DATAGRAM)
    line.executed(1, 1, 1, result=None)
    call = line.execute(2, 2, CALL, 3)
    assert line.ask(3, 3, 1) == []
    _, (start,) = line.finish(call)
    assert start.function_id == 1


def test_a_service_start_with_the_number_of_the_call_in_progress():
    """An old client on UDP whose numbers do not increase: refused when busy, and executed when repeated."""
    line = Line(DATAGRAM)
    call = line.execute(70, 0, CALL, 3)
    assert line.ask(3, 0, CALL, 4) == []
    assert line.reply(70, 0, 1) == Packet(70, hresult.E_BUSY_PROC, [None])
    reply, (waited,) = line.finish(call)
    assert reply == Packet(70, 0, [1])
    line.finish(waited)
    assert line.executed(70, 0, 1, result=None) == Packet(70, 0)


def test_a_refused_service_start_does_not_start_a_session_later():
    line = Line(DATAGRAM, invoke_timeout=1.0)
    line.executed(1, 1, 1, result=None)
    call = line.execute(2, 2, CALL, 3)
    assert line.read(line.server.tick(line.now + 1.0)).code == hresult.E_TIMEOUT
    assert line.reply(3, 3, 1).code == hresult.E_BUSY_PROC
    assert line.ask(3, 3, 1, "WDT=100") == []
    assert line.server.finish(call, 0, variant(1)) == b""


def test_late_packets_after_service_stop_create_no_client(line):
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, 3, "", "", "", "")
    line.executed(3, 3, 2, result=None)
    assert line.reply(2, 2, 3, "", "", "", "").arguments == [42]
    assert line.ask(5, 2, 7) == []
    assert line.server.stopped


def test_replies_are_not_answered(line):
    """An echo of the line, or a forged datagram: replying could cause an endless loop."""
    for code in (0, 0x80004001, 0x8000FFFF):
        assert line.ask(5, 5, code) == []
    line.execute(6, 6, 0x900)  # S_EXECUTING looks like a function id; there is no reply to that reply


def test_no_reset_after_service_stop():
    line = Line(LINE)
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, 2, result=None)
    line.now += 2.0
    assert line.executed(1, 1, 1, result=None).code == 0


def test_a_service_start_over_udp_resets_nothing():
    line = Line(DATAGRAM)
    line.executed(1, 1, 1, result=None)
    line.executed(2, 2, CALL, 3)
    line.now += 2.0
    assert line.executed(3, 3, 1, result=None).code == 0


# --- sizes, checksums, dialect ----------------------------------------------------------------------------------------


def test_a_datagram_that_is_too_long_is_refused():
    line = Line(DATAGRAM)
    assert line.reply(5, 5, 111, "x" * 400) == Packet(5, hresult.E_PACKETSIZEOVER, [None])


def test_a_reply_that_is_too_long_for_a_datagram():
    line = Line(DATAGRAM)
    body = 487 - 14  # UTF-16 text without its length fields
    assert len(line.executed(5, 5, CALL, 3, result="x" * (body // 2)).arguments[0]) == body // 2
    assert line.executed(6, 6, CALL, 3, result="x" * (body // 2 + 1)) == Packet(6, hresult.E_TOO_MUCH_DATA, [None])


def test_a_wrong_checksum_on_a_serial_line():
    line = Line(LINE, limits=PacketLimits(packet=200))
    assert line.executed(5, 5, CALL, 3, result="x" * 84).arguments == ["x" * 84]
    assert line.executed(6, 6, CALL, 3, result="x" * 85) == Packet(6, hresult.E_TOO_MUCH_DATA, [None])


def test_an_announced_request_that_is_too_long():
    line = Line(LINE)
    (action,) = list(line.server.receive(packet.HEADER.pack(1, 1 << 24, 5, 5, 64, 3), NOW))
    assert line.read(action.data) == Packet(0, hresult.E_PACKETSIZEOVER, [None])
    assert line.executed(6, 6, CALL, 3).arguments == [42]


def test_silence_on_a_line():
    line = Line(LINE)
    half = line.data(5, 5, CALL, 3)[:10]
    assert list(line.server.receive(half, NOW)) == []
    assert line.server.discardable_bytes == 10
    assert list(line.server.discard_incomplete(NOW)) == []
    assert line.server.discardable_bytes == 0
    noise = b"\x01\x00\x10\x00\x00"
    assert list(line.server.receive(noise + line.data(5, 5, CALL, 3) + line.data(6, 6, CALL, 3), NOW)) == []
    actions = line.server.discard_incomplete(NOW)
    call = next(actions)
    assert isinstance(call, Execute)
    line.server.finish(call, 0, None)
    assert isinstance(next(actions), Execute)


def test_a_packet_after_a_header_caused_by_noise():
    """The line is never silent, and more bytes are announced than will ever arrive."""
    line = Line(LINE)
    assert list(line.server.receive(b"\x01\x00\xf0\x00\x00", line.now)) == []
    for _ in range(20):
        line.now += 0.03
        actions = list(line.server.receive(b"\xaa" + line.data(5, 5, CALL, 3) + b"\x01\x01", line.now))
        if actions:
            break
    assert isinstance(actions[0], Execute)
    assert line.now == pytest.approx(NOW + 0.51, abs=0.04)
    line.server.finish(actions[0], 0, variant(1))
    line.now += 1.0
    more = list(line.server.receive(b"\xaa", line.now))
    assert all(isinstance(action, Send) for action in more)


def test_no_packet_inside_an_incomplete_one():
    line = Line(LINE)
    good = line.data(5, 5, CALL, 3)
    broken = good[:-2] + bytes([good[-2] ^ 1]) + good[-1:]
    list(line.server.receive(b"\x01\x00\xf0\x00\x00" + broken + b"\x01\x12\x00\x00\x00", line.now))
    line.now += 1.0
    assert list(line.server.receive(b"\xaa" * 40, line.now)) == []
    assert line.server.discardable_bytes > 0
    assert STREAM.framer(PacketLimits()).resync() is None
    assert DATAGRAM.framer(PacketLimits()).resync() is None


def test_only_a_shared_line_is_searched():
    """On other transports, a header is not considered noise, regardless of how long the rest takes."""
    line = Line(replace(LINE, shared=False))
    assert list(line.server.receive(b"\x01\x00\xf0\x00\x00", line.now)) == []
    line.now += 1.0
    assert list(line.server.receive(line.data(5, 5, CALL, 3), line.now)) == []
    line.now += 1.0
    assert list(line.server.receive(b"\xaa", line.now)) == []


def test_a_stream_has_no_pending_bytes():
    server = ServerConversation()
    list(server.receive(b"\x01\x20", NOW))
    assert server.discardable_bytes == 0


def test_the_ve026a_echoes_the_reserved_field():
    line = Line(LINE, dialect=VE026A)
    call = line.execute(5, 4, CALL, 3)
    assert line.read(line.server.finish(call, 0, None)) == Packet(5, 0, [], 4)
    assert line.reply(6, 4, CALL, 3) == Packet(6, 0, [], 4)
    line.execute(7, 7, CALL, 4)
    assert line.reply(8, 8, CALL, 3) == Packet(8, hresult.E_ROBOTISBUSY, [], 8)


def test_the_ve026a_has_no_options():
    line = Line(LINE, dialect=VE026A)
    line.execute(1, 1, 1, "WDT=1")
    assert line.server.wdt is None


@pytest.mark.parametrize(("wire", "kind"), [(STREAM, Close), (LINE, EndSession), (DATAGRAM, EndSession)])
def test_the_ve026a_drops_a_client_that_sends_invalid_packets(wire, kind):
    """VE026A table 3-5: 0x80010001."""
    line = Line(wire, dialect=VE026A)
    data = packet.pack(5, CALL, 3, b"\x00" * 12, 5, crc=wire.crc)
    reply, end = list(line.server.receive(data, NOW))
    assert line.read(reply.data) == Packet(5, hresult.E_INVALIDRCVPACKET, [], 5)
    assert type(end) is kind


def test_a_short_error_as_argument_and_result():
    line = Line(LINE, dialect=VE026A)
    code = Variant(VarType.ERROR, 0x600B)
    data = packet.pack(5, 17, 1, b"\x08\x00\x00\x00\x0a\x00\x01\x00\x00\x00\x0b\x60", 5, crc=True)
    (call,) = list(line.server.receive(data, NOW))
    assert call.arguments == [code]
    answer = line.server.finish(call, 0, code)
    assert packet.decode(answer, PacketLimits(vt_error_size=2), exact=True, crc=True).arguments == [code]


def test_a_call_whose_client_is_unreachable_is_forgotten(line):
    """Its duplicates are dropped, because there will be no reply; a new request is executed."""
    call = line.execute(5, 5, CALL, 3)
    assert line.reply(6, 5, CALL, 3).code == hresult.S_EXECUTING
    line.server.abandon()
    assert not line.server.busy
    assert line.server.finish(call, 0, variant(1)) == b""
    assert line.ask(7, 5, CALL, 3) == []
    assert line.executed(8, 8, CALL, 3) == Packet(8, 0, [42])


def test_over_tcp_calls_are_abandoned_too():
    line = Line(STREAM)
    call = line.execute(5, 0, CALL, 3)
    line.server.max_silence = 1.0
    line.server.abandon()
    assert line.server.max_silence is None
    assert line.server.finish(call, 0, variant(1)) == b""
    assert line.executed(6, 0, CALL, 3) == Packet(6, 0, [42])
