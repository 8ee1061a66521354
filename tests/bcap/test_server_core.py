"""The server side of the conversation, driven step by step on a manual clock: calls, replies, and their times."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.actions import Close, Decode, Encoded, Execute, Send
from orinkit.bcap.call_queue import MOST_BESIDE, MOST_BYTES, MOST_WAITING
from orinkit.bcap.client import sign_of_life
from orinkit.bcap.packet import Packet
from orinkit.bcap.server import LARGE, ServerConversation
from orinkit.cao.dialect import RC8_STRICT
from orinkit.cao.functions import (
    command_cancel,
    controller_execute,
    extension_execute,
    robot_execute,
    robot_halt,
    robot_hold,
    task_stop,
)
from orinkit.core import hresult
from orinkit.values.codec import PacketLimits, encode
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant

pytestmark = pytest.mark.core

NOW = 1000.0


def request(serial, function_id, *arguments, reserved=0):
    return packet.encode(Packet(serial, function_id, list(arguments), reserved))


def actions(server, data, now=NOW):
    """Return the actions; large packets are decoded immediately."""
    for action in server.receive(data, now):
        yield from server.decoded(action, action.read(), now) if isinstance(action, Decode) else [action]


def executed(server, data, now=NOW):
    """Return the only action: a call to execute."""
    (action,) = actions(server, data, now)
    assert isinstance(action, Execute)
    return action


def answered(server, data, now=NOW):
    """Return the only action: a reply."""
    (action,) = actions(server, data, now)
    assert isinstance(action, Send)
    return packet.decode(action.data)


def start(option=None, now=NOW, **parameters):
    """Return a conversation started with an option, and the reply to Service_Start."""
    server = ServerConversation(**parameters)
    call = executed(server, request(1, 1) if option is None else request(1, 1, option), now)
    assert packet.decode(server.finish(call, 0, None)) == Packet(1, 0)
    return server


def test_a_start_without_options_restores_the_defaults():
    server = start("WDT=100,InvokeTimeout=1000")
    assert (server.wdt, server.invoke_timeout) == (0.1, 1.0)
    server.finish(executed(server, request(2, 1)), 0, None)
    assert (server.wdt, server.invoke_timeout) == (None, 180.0)


# --- a call and its reply ---------------------------------------------------------------------------------------------


def test_a_call_is_executed_and_answered():
    server = ServerConversation()
    assert not server.busy
    call = executed(server, request(7, 101, 3))
    assert call == Execute(7, 101, [variant(3)])
    assert server.busy
    assert packet.decode(server.finish(call, 0, variant(True))) == Packet(7, 0, [True])
    assert not server.busy


def test_the_exchange_of_the_document_byte_by_byte():
    """RC8 3.1.3: Variable_GetValue of IO150."""
    server = ServerConversation()
    call = executed(
        server, bytes.fromhex("011e0000000400000065000000010 00a00000003000100000003000000 04".replace(" ", ""))
    )
    assert server.finish(call, 0, Variant(VarType.BOOL, False)).hex() == (
        "011c00000004000000" + "00000000" + "0100" + "080000000b00010000000000" + "04"
    )


def test_arguments_have_their_exact_types():
    server = ServerConversation()
    given = [
        Variant(VarType.UI4, 3),
        Variant(VarType.R4 | ARRAY, [1.0]),
        Variant(VARIANT_ARRAY, [Variant(VarType.NULL)]),
    ]
    assert executed(server, request(1, 102, *given)).arguments == given


def test_results_of_every_kind():
    server = ServerConversation()
    for code, result, arguments in [
        (0, None, []),
        (0, Variant(VarType.EMPTY), [None]),
        (hresult.S_BUF_FULL, variant([1.0]), [[1.0]]),
        (hresult.E_HANDLE, None, [None]),
    ]:
        call = executed(server, request(9, 64, 3, "x", None))
        assert packet.decode(server.finish(call, code, result)) == Packet(9, code, arguments)


def test_a_call_is_answered_once():
    server = ServerConversation()
    call = executed(server, request(9, 2))
    assert server.finish(call, 0, None)
    assert server.finish(call, 0, None) == b""
    other = executed(server, request(10, 2))
    assert server.finish(call, 0, None) == b""
    assert packet.decode(server.finish(other, 0, None)).serial == 10


def test_the_serial_is_returned_and_reserved_is_zero():
    server = ServerConversation()
    for serial in (0, 1, 65535):
        call = executed(server, request(serial, 2, reserved=5))
        assert packet.decode(server.finish(call, 0, None)) == Packet(serial, 0, [], 0)


@pytest.mark.parametrize("function_id", [0, 138, 255, 256, 2**32 - 1])
def test_unknown_functions_are_left_to_the_session(function_id):
    assert executed(ServerConversation(), request(1, function_id)).function_id == function_id


def test_a_trailer_is_ignored():
    """VE026A 3.1: there may be a reserved area after the arguments."""
    data = packet.encode(Packet(1, 101, [3], trailer=b"\1\2\3"))
    assert executed(ServerConversation(), data).arguments == [variant(3)]


def test_one_byte_at_a_time():
    server = ServerConversation()
    data = request(7, 101, 3)
    for position in range(len(data) - 1):
        assert list(server.receive(data[position : position + 1], NOW)) == []
    assert executed(server, data[-1:]).serial == 7


def test_packets_and_calls_are_counted():
    server = ServerConversation()
    assert (server.packets, server.calls, server.incomplete_bytes) == (0, 0, 0)
    answered(server, packet.pack(1, 1, 2, b""))
    assert (server.packets, server.calls, server.incomplete_bytes) == (1, 0, 0)
    server.finish(executed(server, request(2, 2) + request(3, 2)[:7]), 0, None)
    assert (server.packets, server.calls, server.incomplete_bytes) == (2, 1, 7)


def test_the_refusal_of_a_packet():
    assert packet.decode(ServerConversation().packet_too_long_reply()) == Packet(0, hresult.E_PACKETSIZEOVER, [None])


def test_several_requests_at_once_are_executed_in_order():
    server = ServerConversation()
    seen = []
    for action in server.receive(request(1, 2) + request(2, 2) + request(3, 2), NOW):
        seen.append(action.serial)
        assert packet.decode(server.finish(action, 0, None)).serial == action.serial
    assert seen == [1, 2, 3]


def test_a_client_that_stops_reading_loses_no_request():
    server = ServerConversation()
    actions = server.receive(request(1, 2) + request(2, 2), NOW)
    server.finish(next(actions), 0, None)
    actions.close()
    assert executed(server, b"").serial == 2


# --- busy -------------------------------------------------------------------------------------------------------------


def finished(server, call, result=None):
    """Finish a call; return its reply, and the calls that have waited for it."""
    return packet.decode(server.finish(call, 0, result)), list(server.resume(NOW))


@pytest.mark.guide("App. C two calls of one connection at a time")
def test_calls_are_executed_in_their_order():
    server = ServerConversation()
    first = executed(server, request(1, 72, 3, 1, "P1", ""))
    assert list(server.receive(request(2, 101, 3), NOW)) == []
    assert list(server.receive(request(3, 1, "WDT=400"), NOW)) == []
    assert server.wdt is None
    assert server.has_queued
    reply, (second,) = finished(server, first)
    assert (reply, second.serial) == (Packet(1, 0), 2)
    reply, (third,) = finished(server, second, variant(5))
    assert (reply, third.serial) == (Packet(2, 0, [5]), 3)
    assert server.wdt == 0.4
    assert finished(server, third) == (Packet(3, 0), [])
    assert not server.busy
    assert not server.has_queued
    assert executed(server, request(4, 101, 3)).serial == 4


def test_a_call_that_arrives_before_the_waiting_ones_are_executed_waits_too():
    server = ServerConversation()
    first = executed(server, request(1, 72, 3, 1, "P1", ""))
    assert list(server.receive(request(2, 101, 3), NOW)) == []
    server.finish(first, 0, None)
    assert list(server.receive(request(3, 101, 3), NOW)) == []
    (second,) = server.resume(NOW)
    assert second.serial == 2
    _, (third,) = finished(server, second, variant(1))
    assert third.serial == 3


def test_the_waiting_requests_are_limited():
    server = ServerConversation()
    executed(server, request(1, 72, 3, 1, "P1", ""))
    waiting = b"".join(request(serial, 101, 3) for serial in range(2, 2 + MOST_WAITING))
    assert list(server.receive(waiting, NOW)) == []
    assert answered(server, request(99, 101, 3)) == Packet(99, hresult.E_BUSY_PROC, [None])


def test_the_bytes_of_waiting_requests_are_limited():
    server = ServerConversation()
    executed(server, request(1, 72, 3, 1, "P1", ""))
    assert answered(server, request(2, 102, 3, bytes(MOST_BYTES))) == Packet(2, hresult.E_BUSY_PROC, [None])
    assert list(server.receive(request(3, 102, 3, bytes(1000)), NOW)) == []


@pytest.mark.guide("App. C two calls of one connection at a time")
@pytest.mark.parametrize(
    "stop",
    [
        (robot_halt.id, 4),
        (robot_hold.id, 4, ""),
        (task_stop.id, 4, 1, ""),
        (command_cancel.id, 4),
        (controller_execute.id, 4, "KillAll", [0]),
        (robot_execute.id, 4, "MotionSkip"),
        (extension_execute.id, 4, "stop"),
    ],
    ids=str,
)
def test_a_stop_does_not_wait(stop):
    server = start("WDT=100")
    move = executed(server, request(1, 72, 3, 1, "P1", ""))
    halt = executed(server, request(2, *stop))
    assert server.is_stop(halt)
    assert not server.is_stop(move)
    assert {packet.decode(server.tick(NOW + 0.1)).serial for _ in range(2)} == {1, 2}
    assert server.tick(NOW + 0.1) == b""
    assert packet.decode(server.finish(halt, 0, None)) == Packet(2, 0)
    assert server.busy
    assert packet.decode(server.finish(move, 0, None)) == Packet(1, 0)


def test_a_stop_refuses_the_motions_that_wait():
    """They would otherwise begin after the stop."""
    server = ServerConversation()
    move = executed(server, request(1, 72, 3, 1, "P1", ""))
    for serial, call in enumerate(((72, 3, 1, "P2", ""), (101, 5), (64, 3, "Draw", [1, "V1"]), (64, 3, "CurPos")), 2):
        assert list(server.receive(request(serial, *call), NOW)) == []
    *refused, halt = server.receive(request(6, robot_halt.id, 3), NOW)
    assert [packet.decode(each.data) for each in refused] == [Packet(n, hresult.E_ABORT, [None]) for n in (2, 4)]
    server.finish(halt, 0, None)
    _, (value,) = finished(server, move)
    assert value.serial == 3
    _, (position,) = finished(server, value, variant(1))
    assert position.serial == 5


def test_stops_at_the_same_time_are_limited():
    server = ServerConversation()
    executed(server, request(1, 72, 3, 1, "P1", ""))
    for serial in range(2, 2 + MOST_BESIDE):
        executed(server, request(serial, robot_halt.id, 3))
    assert answered(server, request(9, robot_halt.id, 3)) == Packet(9, hresult.E_BUSY_PROC, [None])


def test_a_sign_of_life_does_not_wait():
    server = ServerConversation()
    executed(server, request(1, 72, 3, 1, "P1", ""))
    (reply,) = server.receive(sign_of_life(3), NOW)
    assert packet.decode(reply.data) == Packet(0, hresult.E_BUSY_PROC, [None])


def test_waiting_requests_are_reported_and_time_out():
    server = start("WDT=400,InvokeTimeout=1000")
    executed(server, request(2, 72, 3, 1, "P1", ""))
    assert list(server.receive(request(3, 101, 3), NOW + 0.2)) == []
    assert server.next_time() == NOW + 0.4
    assert packet.decode(server.tick(NOW + 0.6)) == Packet(2, hresult.S_EXECUTING)
    assert packet.decode(server.tick(NOW + 0.6)) == Packet(3, hresult.S_EXECUTING)
    assert packet.decode(server.tick(NOW + 1.0)).code == hresult.E_TIMEOUT
    assert packet.decode(server.tick(NOW + 1.2)) == Packet(3, hresult.E_TIMEOUT, [None])
    assert not server.has_queued
    assert server.next_time() is None


# --- Service_Start ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "wdt", "timeout"),
    [
        (None, None, 180.0),
        ("", None, 180.0),
        ("WDT=400", 0.4, 180.0),
        ("wdt=81", 0.081, 180.0),
        ("WDT=80", 0.08, 180.0),
        ("WDT=x", None, 180.0),
        ("WDT=", None, 180.0),
        ("WDT,InvokeTimeout=infinite", None, 180.0),
        (",WDT=400,InvokeTimeout=180000", 0.4, 180.0),
        ("InvokeTimeout=500", None, 0.5),
        ("InvokeTimeout=80", None, 0.08),
        ("WDT=2147483647,InvokeTimeout=2147483647", 2147483.647, 2147483.647),
        ("Other=1", None, 180.0),
    ],
)
@pytest.mark.field("4.6")
def test_options(option, wdt, timeout):
    server = start(option)
    assert (server.wdt, server.invoke_timeout) == (wdt, timeout)


@pytest.mark.parametrize(
    "option",
    ["WDT=79", "WDT=0", "WDT=-400", "WDT=2147483648", "InvokeTimeout=79",
     "InvokeTimeout=0", "InvokeTimeout=2147483648", "InvokeTimeout=1" + "0" * 400,
     "WDT=1" + "0" * 400, "WDT=" + "9" * 5000, "WDT=400,InvokeTimeout=1",
     "WDT=400," + "x" * 65536],
)  # fmt: skip
def test_refused_options_change_nothing(option):
    """RC8 table 3-1: more than 80 ms."""
    server = start("WDT=400,InvokeTimeout=5000")
    assert answered(server, request(2, 1, option)) == Packet(2, hresult.E_INVALIDARG, [None])
    assert (server.wdt, server.invoke_timeout, server.busy) == (0.4, 5.0, False)


@pytest.mark.field("4.6")
@pytest.mark.parametrize("option", ["WDT=80", "WDT=x", "WDT=", "InvokeTimeout=x"])
def test_options_that_the_document_does_not_permit(option):
    """RC8 table 3-1: more than 80 ms."""
    server = ServerConversation(dialect=RC8_STRICT)
    assert answered(server, request(2, 1, option)) == Packet(2, hresult.E_INVALIDARG, [None])


def test_a_new_start_sets_all_options():
    server = start("WDT=400,InvokeTimeout=5000", invoke_timeout=60.0)
    server.finish(executed(server, request(2, 1, "")), 0, None)
    assert (server.wdt, server.invoke_timeout) == (None, 60.0)


def test_a_delayed_call_has_its_full_time():
    server = ServerConversation(invoke_timeout=5.0)
    actions = server.receive(request(1, 72, 1, 1, "P1") + request(2, 72, 1, 1, "P2"), 100.0)
    server.finish(next(actions), 0, None)
    server.update_time(1000.0)
    assert next(actions).serial == 2
    assert server.next_time() == 1005.0


def test_options_may_come_in_a_one_element_array():
    server = ServerConversation()
    assert executed(server, request(1, 1, ["WDT=400"])).function_id == 1
    assert server.wdt == 0.4


@pytest.mark.parametrize("arguments", [(5,), (None,), ("WDT=400", 1)])
def test_an_option_of_another_type_is_left_to_the_session(arguments):
    server = ServerConversation()
    assert executed(server, request(1, 1, *arguments)).function_id == 1
    assert server.wdt is None


@pytest.mark.parametrize(("function_id", "code"), [(72, hresult.E_INVALIDARG), (138, hresult.E_NOTIMPL)])
def test_too_many_arguments_are_refused_without_decoding(function_id, code):
    server = ServerConversation()
    unread = b"".join(encode(Variant(VarType.I4, 1))[:4] + b"\xff" * 10 for _ in range(6))
    frame = packet.pack(9, function_id, 6, unread)
    assert answered(server, frame) == Packet(9, code, [None])


def test_only_service_start_sets_options():
    server = ServerConversation()
    executed(server, request(1, 2, "WDT=400"))
    assert server.wdt is None


# --- time -------------------------------------------------------------------------------------------------------------


def test_nothing_is_due_while_nothing_is_executed():
    server = start("WDT=400")
    assert server.next_time() is None
    assert server.tick(NOW + 1e6) == b""


def test_executing_is_reported_every_wdt():
    server = start("WDT=400")
    call = executed(server, request(2, 72, 3, 1, "P1", ""))
    assert server.next_time() == NOW + 0.4
    assert server.tick(NOW + 0.399) == b""
    for late in (0.4, 0.85, 1.25):
        assert packet.decode(server.tick(NOW + late)) == Packet(2, hresult.S_EXECUTING)
        assert server.tick(NOW + late) == b"", "it is sent once"
        assert server.next_time() == pytest.approx(NOW + late + 0.4)
    assert packet.decode(server.finish(call, 0, None)) == Packet(2, 0)
    assert server.next_time() is None
    assert server.tick(NOW + 100) == b""


def test_without_wdt_nothing_is_sent_until_the_time_out():
    server = start("InvokeTimeout=500")
    executed(server, request(2, 101, 3))
    assert server.next_time() == NOW + 0.5
    assert server.tick(NOW + 0.499) == b""
    assert packet.decode(server.tick(NOW + 0.5)) == Packet(2, hresult.E_TIMEOUT, [None])


def test_after_e_timeout_calls_are_busy_until_the_device_has_finished():
    server = start("WDT=400,InvokeTimeout=1000")
    call = executed(server, request(2, 72, 3, 1, "P1", ""))
    assert packet.decode(server.tick(NOW + 0.9)) == Packet(2, hresult.S_EXECUTING)
    assert server.next_time() == NOW + 1.0
    assert packet.decode(server.tick(NOW + 1.0)) == Packet(2, hresult.E_TIMEOUT, [None])
    assert server.next_time() is None
    assert server.tick(NOW + 5.0) == b""
    assert server.busy
    assert answered(server, request(3, 101, 3), NOW + 5) == Packet(3, hresult.E_BUSY_PROC, [None])
    assert server.finish(call, 0, variant(5)) == b"", "a reply has been sent"
    assert not server.busy
    after = executed(server, request(4, 101, 3), NOW + 6)
    assert server.next_time() == NOW + 6.4
    assert packet.decode(server.finish(after, 0, variant(5))) == Packet(4, 0, [5])


def test_both_due_at_once_is_a_time_out():
    server = start("WDT=400,InvokeTimeout=500")
    executed(server, request(2, 101, 3))
    assert packet.decode(server.tick(NOW + 10)) == Packet(2, hresult.E_TIMEOUT, [None])


def test_each_call_has_its_own_time():
    server = start("WDT=400,InvokeTimeout=1000")
    server.finish(executed(server, request(2, 101, 3), NOW), 0, None)
    executed(server, request(3, 101, 3), NOW + 50)
    assert server.next_time() == NOW + 50.4
    assert server.tick(NOW + 50.3) == b""


# --- results that cannot be sent --------------------------------------------------------------------------------------


def test_too_big_a_result():
    server = ServerConversation(PacketLimits(packet=200))
    fits = variant(bytes(200 - packet.OVERHEAD - 10))
    assert len(server.finish(executed(server, request(1, 101, 3)), 0, fits)) == 200
    over = variant(bytes(201 - packet.OVERHEAD - 10))
    call = executed(server, request(2, 101, 3))
    assert packet.decode(server.finish(call, 0, over)) == Packet(2, hresult.E_TOO_MUCH_DATA, [None])
    assert not server.busy


def test_a_result_that_cannot_be_encoded(caplog):
    deep = Variant(VarType.EMPTY)
    for _ in range(5000):
        deep = Variant(VARIANT_ARRAY, [deep])
    changed = Variant(VarType.I4 | ARRAY, [1])
    changed.value.append("no number")
    for result in (deep, changed):
        server = ServerConversation()
        call = executed(server, request(1, 101, 3))
        assert packet.decode(server.finish(call, 0, result)) == Packet(1, hresult.E_FAIL, [None])
        assert not server.busy
        assert "cannot encode the result of function 101" in caplog.text
        caplog.clear()


# --- bad packets ------------------------------------------------------------------------------------------------------

ARGUMENT = bytes.fromhex("0a000000 0300 01000000 02000000")


@pytest.mark.parametrize(
    ("count", "body", "code"),
    [
        (2, ARGUMENT, hresult.E_INVALIDRCVPACKET),
        (65535, ARGUMENT, hresult.E_INVALIDRCVPACKET),
        (1, b"\xff" + ARGUMENT[1:], hresult.E_INVALIDRCVPACKET),
        (1, ARGUMENT[:6] + b"\2" + ARGUMENT[7:], hresult.E_INVALIDRCVPACKET),
        (1, ARGUMENT[:4] + b"\x63" + ARGUMENT[5:], hresult.E_INVALIDARGTYPE),
        (1, b"\xff\xff\xff\xff" + ARGUMENT[4:], hresult.E_ARGSIZEOVER),
        (1, encode([Variant(VARIANT_ARRAY, [None]) for _ in range(3)]), None),
    ],
)
def test_invalid_arguments_are_answered_and_the_connection_stays_open(count, body, code):
    server = ServerConversation()
    data = packet.pack(5, 101, count, body)
    if code is None:
        assert executed(server, data).serial == 5
        return
    assert answered(server, data) == Packet(5, code, [None])
    assert not server.busy
    assert executed(server, request(6, 101, 3)).serial == 6


@pytest.mark.parametrize(
    ("limits", "value", "code"),
    [
        (PacketLimits(depth=2), [[[1, None], None], None], hresult.E_INVALIDARGTYPE),
        (PacketLimits(variants=2), ["a", "b", "c"], hresult.E_ARGSIZEOVER),
    ],
)
def test_limits_inside_a_packet(limits, value, code):
    server = ServerConversation(limits)
    assert answered(server, request(5, 102, 3, value)) == Packet(5, code, [None])
    assert executed(server, request(6, 101, 3)).serial == 6


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"\1\0\0\0\0", hresult.E_INVALIDRCVPACKET),
        (b"\1\x0f\0\0\0", hresult.E_INVALIDRCVPACKET),
        (b"\1\xff\xff\xff\xff", hresult.E_PACKETSIZEOVER),
        (b"\1" + struct.pack("<I", 2**24 + 1), hresult.E_PACKETSIZEOVER),
        (request(1, 2)[:-1] + b"\5", hresult.E_INVALIDRCVPACKET),
    ],
)
def test_an_invalid_stream_is_answered_and_closed(data, code):
    """VE026A table 3-5: the robot disconnects the client after such a packet."""
    server = ServerConversation()
    send, close = list(server.receive(data, NOW))
    assert packet.decode(send.data) == Packet(0, code, [None])
    assert isinstance(close, Close)
    assert "packet" in close.reason
    again = list(server.receive(request(1, 2), NOW))
    assert [type(action) for action in again] == [Send, Close]


def test_packets_before_an_error_in_the_stream_are_executed():
    server = ServerConversation()
    execute, send, close = list(server.receive(request(1, 2) + b"\1\0\0\0\0", NOW))
    assert (type(execute), type(send), type(close)) == (Execute, Send, Close)


@given(st.lists(st.binary(max_size=60) | st.sampled_from([request(1, 2), request(2, 1, "WDT=400")]), max_size=8))
def test_any_stream_gives_actions_only(chunks):
    server = ServerConversation()
    for now, chunk in enumerate(chunks):
        for action in server.receive(chunk, float(now)):
            assert isinstance(action, Send | Execute | Close)
            if isinstance(action, Execute) and now % 2:
                packet.decode(server.finish(action, 0, None))
        data = server.tick(now + 0.5)
        assert not data or packet.decode(data).code in (hresult.S_EXECUTING, hresult.E_TIMEOUT)


@given(st.text() | st.text(st.sampled_from("WDTwdt=,InvokeTimeout0123456789x()\"' -")))
def test_any_option_is_accepted_or_refused(option):
    server = ServerConversation()
    (action,) = list(server.receive(request(1, 1, option), NOW))
    if isinstance(action, Send):
        assert packet.decode(action.data) == Packet(1, hresult.E_INVALIDARG, [None])
    assert server.wdt is None or 0.08 < server.wdt <= 2147483.647
    assert 0.08 <= server.invoke_timeout <= 2147483.647


# --- large packets and results ----------------------------------------------------------------------------------------


LONG = "x" * LARGE


def decoding(server, data, now=NOW):
    (action,) = list(server.receive(data, now))
    assert isinstance(action, Decode)
    return action


def test_a_large_packet_is_decoded_by_the_caller():
    server = ServerConversation()
    decode = decoding(server, request(3, 102, 5, LONG))
    assert (decode.serial, decode.function_id, server.busy) == (3, 102, True)
    assert list(server.receive(request(4, 2), NOW)) == [], "it waits"
    (call,) = server.decoded(decode, decode.read(), NOW)
    assert call == Execute(3, 102, [variant(5), variant(LONG)])
    assert packet.decode(server.finish(call, 0, None)) == Packet(3, 0)


def answered_data(server, data):
    (action,) = list(server.receive(data, NOW))
    return action.data


def test_a_small_packet_is_decoded_immediately():
    server = ServerConversation()
    assert isinstance(next(server.receive(request(3, 102, 5, "x" * 100), NOW)), Execute)


def test_an_invalid_large_packet_is_refused_after_decoding():
    server = ServerConversation()
    data = bytearray(request(3, 102, 5, LONG))
    data[39:43] = struct.pack("<I", 2 * LARGE + 2)  # bytes of the text
    decode = decoding(server, bytes(data))
    (answer,) = server.decoded(decode, decode.read(), NOW)
    assert packet.decode(answer.data) == Packet(3, hresult.E_INVALIDRCVPACKET, [None])
    assert not server.busy


def test_a_large_packet_that_takes_long_is_reported_and_not_executed_after_its_time_out():
    server = start("WDT=100,InvokeTimeout=1000")
    decode = decoding(server, request(3, 102, 5, LONG))
    assert server.next_time() == pytest.approx(NOW + 0.1)
    assert packet.decode(server.tick(NOW + 0.1)).code == hresult.S_EXECUTING
    assert packet.decode(server.tick(NOW + 1.0)).code == hresult.E_TIMEOUT
    assert list(server.decoded(decode, decode.read(), NOW + 2)) == []
    assert not server.busy
    assert list(server.decoded(decode, decode.read(), NOW + 3)) == []  # the call is dropped
    executed(server, request(4, 2))


def test_a_large_result_is_encoded_by_the_caller():
    server = ServerConversation(PacketLimits(packet=100_000))
    call = executed(server, request(3, 101, 5))
    encoded = server.encode(call, variant(LONG))
    assert packet.decode(server.finish(call, 0, encoded)) == Packet(3, 0, [LONG])
    call = executed(server, request(4, 101, 5))
    encoded = server.encode(call, variant(bytes(100_000)))
    assert encoded == Encoded(hresult.E_TOO_MUCH_DATA)
    assert packet.decode(server.finish(call, 0, encoded)) == Packet(4, hresult.E_TOO_MUCH_DATA, [None])
