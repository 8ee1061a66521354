"""The direct path of the server side: the same calls, replies and state as the path of all other packets.

Each request is given to two conversations: one takes it directly if it can, the other one does not.
"""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import example, given, reject
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.actions import Execute
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE
from orinkit.bcap.server import ServerConversation
from orinkit.cao import functions as f
from orinkit.cao.dialect import RC8, VE026A, Dialect
from orinkit.core import hresult
from orinkit.core.errors import InvalidValue
from orinkit.values import codec
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import R8_ARRAY, Variant, VarType, variant
from support.strategies import variants

pytestmark = pytest.mark.core

NOW = 1000.0
GET, PUT, EXECUTE = f.variable_get_value.id, f.variable_put_value.id, f.robot_execute.id


def request(serial: int, function_id: int, *arguments: Any, reserved: int = 0) -> bytes:
    return packet.encode(Packet(serial, function_id, list(arguments), reserved))


def started(option: str = "", **parameters: Any) -> ServerConversation:
    """Return a conversation that has replied to Service_Start."""
    server = ServerConversation(**parameters)
    (call,) = server.receive(request(1, 1, option), NOW)
    assert isinstance(call, Execute)
    server.finish(call, 0, None)
    return server


def state(server: ServerConversation) -> tuple[Any, ...]:
    """Return all that the owner of a conversation can observe."""
    return (
        server.packets, server.calls, server.busy, server.has_queued, server.stopped, server.incomplete_bytes,
        server.last_request_at, server.last_reply_at, server.next_time(),
    )  # fmt: skip


def usual(server: ServerConversation, data: bytes, code: int, result: Variant | None, now: float) -> tuple[Any, bytes]:
    """Return the only call in the data, and the reply."""
    (call,) = server.receive(data, now)
    assert isinstance(call, Execute)
    return call, bytes(server.finish(call, code, result))


def direct(server: ServerConversation, data: bytes, code: int, result: Variant | None, now: float) -> tuple[Any, bytes]:
    """Return the same, taken directly."""
    taken = server.take_directly(data, now)
    assert taken is not None
    serial, _, function_id, given = taken
    arguments = [Variant(VarType.I4, given)] if isinstance(given, int) else given
    reply = server.reply_directly(taken, code, result)
    if reply is None:
        reply = bytes(server.finish(server.continue_call(taken), code, result))
    return Execute(serial, function_id, arguments), reply


ARGUMENTS = st.one_of(
    st.tuples(st.integers(-(2**31), 2**31 - 1)),
    st.tuples(st.just(3), st.sampled_from(["slvMove", "座標", ""]), variants()),
    st.lists(variants(), max_size=3).map(tuple),
)
OUTCOMES = st.one_of(
    st.tuples(st.sampled_from([0, 0, 0, hresult.S_BUF_FULL]), st.one_of(st.none(), variants())),
    st.tuples(st.sampled_from([hresult.E_HANDLE, hresult.E_ABORT, 0x83500001]), st.none()),
)
LONG = Variant(R8_ARRAY, [0.5] * 100)


@given(
    st.integers(0, 0xFFFF),
    st.sampled_from([GET, PUT, EXECUTE, 0, 999, 2**31]),
    ARGUMENTS,
    OUTCOMES,
    st.sampled_from([RC8, VE026A]),
    st.sampled_from([0, 77]),
)
@example(7, GET, (3,), (0, variant(1.5)), RC8, 0)
@example(7, GET, (3,), (0, LONG), RC8, 0)
@example(7, GET, (3,), (hresult.E_HANDLE, None), RC8, 0)
@example(7, GET, (3,), (hresult.E_HANDLE, None), VE026A, 77)
@example(7, EXECUTE, (3, "slvMove", variant([0.5] * 8)), (hresult.S_BUF_FULL, variant([0.5] * 8)), RC8, 0)
def test_a_request_has_the_same_call_and_reply_on_both_paths(
    serial: int, function_id: int, arguments: Any, outcome: tuple[int, Variant | None], dialect: Dialect, reserved: int
) -> None:
    limits = PacketLimits(vt_error_size=dialect.vt_error_size)
    try:
        body = b"".join(codec.encode_variant(variant(each), limits.vt_error_size) for each in arguments)
    except InvalidValue:  # a VT_ERROR that does not fit into the two bytes of a VE026A
        reject()
    data = packet.pack(serial, function_id, len(arguments), body, reserved)
    servers = [started("WDT=400,InvokeTimeout=2000", dialect=dialect) for _ in range(2)]
    assert repr(direct(servers[0], data, *outcome, NOW + 5)) == repr(usual(servers[1], data, *outcome, NOW + 5))
    assert state(servers[0]) == state(servers[1])


def test_a_request_with_one_handle_is_taken_with_the_handle_itself() -> None:
    server = started()
    assert server.take_directly(request(9, GET, 3), NOW + 1) == (9, 0, GET, 3)
    assert server.take_directly(request(10, PUT, 3, 0.5), NOW + 2) == (10, 0, PUT, [variant(3), variant(0.5)])
    assert (server.last_request_at, server.packets, server.calls) == (NOW + 2, 3, 3)
    assert not server.busy


TWO_IN_ONE = request(2, GET, 3) + request(3, GET, 3)
MANY = len(max(f.FUNCTIONS.values(), key=lambda each: len(each.arguments)).arguments) + 1
NOT_USUAL = {
    "nothing": b"",
    "a part of a packet": request(2, GET, 3)[:-1],
    "two packets": TWO_IN_ONE,
    "a wrong terminator": request(2, GET, 3)[:-1] + b"\5",
    "Service_Start": request(2, 1, "WDT=400"),
    "Service_Start with a number": request(2, 1, 5),
    "Service_Stop": request(2, 2),
    "a long packet": request(2, PUT, 3, bytes(5000)),
    "too many arguments": request(2, PUT, *[None] * MANY),
    "a malformed argument": packet.pack(2, PUT, 1, b"\0" * 14),
    "fewer arguments than counted": packet.pack(2, PUT, 2, codec.encode(3)),
}


@pytest.mark.parametrize("data", NOT_USUAL.values(), ids=NOT_USUAL)
def test_data_that_is_not_one_usual_packet_is_left_to_the_other_path(data: bytes) -> None:
    server, other = started(), started()
    before = state(server)
    assert server.take_directly(data, NOW + 1) is None
    assert state(server) == before
    assert repr(list(server.receive(data, NOW + 1))) == repr(list(other.receive(data, NOW + 1)))


def test_nothing_is_taken_while_a_call_is_in_progress_or_a_packet_is_incomplete() -> None:
    server = started()
    call = server.continue_call((2, 0, EXECUTE, [variant(3)]))
    assert server.take_directly(request(3, GET, 3), NOW) is None
    server.finish(call, 0, None)
    assert server.take_directly(request(3, GET, 3), NOW) is not None
    assert list(server.receive(request(4, GET, 3)[:9], NOW)) == []
    assert server.take_directly(request(5, GET, 3), NOW) is None


@pytest.mark.parametrize("profile", [DATAGRAM, LINE])
def test_unreliable_transports_have_no_direct_path(profile: Any) -> None:
    """Their duplicates must be found."""
    server = ServerConversation(profile=profile)
    data = packet.encode(Packet(2, GET, [3], 2), crc=profile.crc)
    assert server.take_directly(data, NOW) is None
    assert server.packets == 0


def test_a_request_cancels_the_state_after_service_stop() -> None:
    server = started()
    (stop,) = server.receive(request(2, 2), NOW)
    assert isinstance(stop, Execute)
    server.finish(stop, 0, None)
    assert server.stopped
    assert server.take_directly(request(3, GET, 3), NOW) is not None
    assert not server.stopped


@pytest.mark.parametrize(
    ("code", "result"),
    [(hresult.S_BUF_FULL, variant(1.5)), (0, Variant(VarType.EMPTY)), (0, LONG), (0, variant(["a"]))],
)
def test_a_result_that_is_not_simple_is_sent_on_the_other_path(code: int, result: Variant) -> None:
    server = started()
    taken = server.take_directly(request(2, GET, 3), NOW + 1)
    assert taken is not None
    assert server.reply_directly(taken, code, result) is None
    call = server.continue_call(taken)
    assert server.busy
    assert packet.decode(bytes(server.finish(call, code, result)), exact=True) == Packet(2, code, [result])


def test_a_reply_beyond_the_limit_of_the_client_is_refused_on_the_other_path() -> None:
    server = started(limits=PacketLimits(packet=60))
    taken = server.take_directly(request(2, GET, 3), NOW)
    assert taken is not None
    result = variant("x" * 50)
    assert server.reply_directly(taken, 0, result) is None
    assert packet.decode(bytes(server.finish(server.continue_call(taken), 0, result))).code == hresult.E_TOO_MUCH_DATA


def test_a_result_that_its_device_has_damaged_is_logged_on_the_other_path(caplog: pytest.LogCaptureFixture) -> None:
    server = started()
    taken = server.take_directly(request(2, GET, 3), NOW)
    assert taken is not None
    result = variant([0.5])
    result.value.append("text")
    with pytest.raises(struct.error):
        packet.pack_reply(2, 0, result)
    assert server.reply_directly(taken, 0, result) is None
    assert packet.decode(bytes(server.finish(server.continue_call(taken), 0, result))).code == hresult.E_FAIL
    assert "cannot encode the result of function 101" in caplog.text


def test_a_call_that_continues_has_the_times_of_its_client() -> None:
    """S_EXECUTING and E_TIMEOUT are sent for it, and a late result is dropped."""
    server = started("WDT=400,InvokeTimeout=1000")
    taken = server.take_directly(request(2, EXECUTE, 3, "Delay", None), NOW)
    assert taken is not None
    call = server.continue_call(taken)
    assert call.arguments == [variant(3), variant("Delay"), variant(None)]
    assert server.next_time() == NOW + 0.4
    assert packet.decode(server.tick(NOW + 0.4)).code == hresult.S_EXECUTING
    assert not server.gave_up(call)
    assert not server.timed_out
    assert packet.decode(server.tick(NOW + 1.0)).code == hresult.E_TIMEOUT
    assert server.gave_up(call)
    assert server.timed_out
    assert server.finish(call, 0, None) == b""
    assert not server.gave_up(call)
