"""The client side of the conversation, driven step by step: packets sent, replies accepted, packets dropped."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet, requests
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.packet import Packet
from orinkit.bcap.requests import encode_request
from orinkit.cao import functions as f
from orinkit.cao.replies import Reply
from orinkit.core import hresult, i18n
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectionLost,
    InvalidHandle,
    InvalidValue,
    LimitExceeded,
    ProtocolError,
)
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import ARRAY, Variant, VarType, variant

pytestmark = pytest.mark.core


def reply(serial, *arguments, code=0):
    return packet.encode(Packet(serial, code, list(arguments)))


def executing(serial):
    return reply(serial, code=hresult.S_EXECUTING)


class Call:
    """A call in progress; received data is fed to it."""

    def __init__(self, conversation, function, *arguments, seconds=3.0, exact=False):
        self.operation = conversation.call(function, arguments, seconds, exact=exact)
        self.request, self.seconds = next(self.operation)
        self.sent = packet.decode(self.request)
        self.serial = self.sent.serial

    def feed(self, received):
        """Feed received data; return the next waiting time. A result ends the call with StopIteration."""
        return self.operation.send(received)

    def result(self, received):
        with pytest.raises(StopIteration) as ended:
            self.operation.send(received)
        return ended.value.value

    def error(self, kind, received, match=None):
        with pytest.raises(kind, match=match) as caught:
            self.operation.send(received)
        return caught.value


@pytest.fixture
def conversation():
    return BcapConversation()


# --- requests ---------------------------------------------------------------------------------------------------------


def test_the_request_of_the_document(conversation):
    """RC8 3.1.2: Controller_GetVariable of IO150."""
    conversation.serial = 3
    call = Call(conversation, f.controller_get_variable, 2, "IO150", "", seconds=2.5)
    assert call.request.hex(" ").startswith("01 44 00 00 00 03 00 00 00 09 00 00 00 03 00")
    assert call.seconds == 2.5
    assert call.sent == Packet(3, 9, [2, "IO150", ""])


def test_arguments_are_sent_by_the_types_of_the_table():
    data = encode_request(f.robot_rotate, (3, [1.0, 2.0], 5, "P1", "@0"), 7)
    read = packet.decode(data, exact=True)
    assert [item.type for item in read.arguments] == [
        VarType.I4, VarType.R8 | ARRAY, VarType.R4, VarType.BSTR, VarType.BSTR,
    ]  # fmt: skip
    assert read.arguments[2].value == 5.0
    assert (read.serial, read.code, read.reserved) == (7, 73, 0)
    assert packet.decode(encode_request(f.service_stop, (), 7, reserved=5)) == Packet(7, 2, [], 5)


def test_an_argument_of_type_variant_is_sent_as_it_is_given():
    for value in (Variant(VarType.I2, 5), np.float32(0.5), [1, "x"], None, b"ab", datetime(2026, 1, 1)):
        data = encode_request(f.variable_put_value, (3, value), 1)
        assert packet.decode(data, exact=True).arguments[1] == variant(value)


def test_optional_arguments_that_are_not_given_are_not_sent():
    assert packet.decode(encode_request(f.service_start, (), 1)).arguments == []
    assert packet.decode(encode_request(f.service_start, ("WDT=400",), 1)).arguments == ["WDT=400"]


def test_serials_count_from_1_and_start_again_after_65535(conversation):
    seen = [Call(conversation, f.service_stop).serial for _ in range(65536)]
    assert seen[:2] == [1, 2]
    assert seen[-2:] == [65535, 1]
    assert len(set(seen)) == 65535
    assert Call(conversation, f.service_stop).serial == 2


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (f.robot_move, (3, 2**31, "P1", ""), "Robot_Move, argument 2 (interpolation): 2147483648 does not fit VT_I4"),
        (
            f.robot_move,
            (3, 1.5, "P1", ""),
            "Robot_Move, argument 2 (interpolation): 1.5 is not a valid value for VT_I4",
        ),
        (f.robot_move, (3, 1, {}, ""), "Robot_Move, argument 3 (pose): a dict cannot be converted to a VARIANT"),
        (f.robot_move, (3, 1, [2**40], ""), "Robot_Move, argument 3 (pose): 1099511627776 does not fit VT_I4"),
        (f.robot_move, (3, 1, "P1", None), "Robot_Move, argument 4 (option): None is not a valid value for VT_BSTR"),
        (f.robot_move, (3, 1, "P1", 5), "Robot_Move, argument 4 (option): 5 is not a valid value for VT_BSTR"),
        (f.robot_move, ("3", 1, "P1", ""), "Robot_Move, argument 1 (handle): '3' is not a valid value for VT_I4"),
        (f.robot_move, ([3], 1, "P1", ""), "Robot_Move, argument 1 (handle): [3] is not a valid value for VT_I4"),
        (
            f.robot_move,
            (np.array([3, 4]), 1, "P1", ""),
            "Robot_Move, argument 1 (handle): array([3, 4]) is not a valid value",
        ),
        (f.robot_move, (10**5000, 1, "P1", ""), "Robot_Move, argument 1 (handle): <int> does not fit VT_I4"),
        (f.robot_speed, (3, 1, "fast"), "Robot_Speed, argument 3 (speed): 'fast' is not a valid value for VT_R4"),
        (f.robot_speed, (3, 1, 1e39), "Robot_Speed, argument 3 (speed): 1e+39 is not a valid value for VT_R4"),
        (f.service_start, (400,), "Service_Start, argument 1 (option): 400 is not a valid value for VT_BSTR"),
    ],
)
def test_a_bad_argument_is_named_and_nothing_is_sent(conversation, function, arguments, message):
    operation = conversation.call(function, arguments, 3.0)
    with pytest.raises(InvalidValue) as caught:
        next(operation)
    assert str(caught.value).startswith(message)
    assert caught.value.__cause__ is None
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=f"{function.name} の第 . 引数"):
        next(conversation.call(function, arguments, 3.0))
    assert Call(conversation, f.service_stop).sent.code == 2, "the conversation stays usable"


def test_a_value_whose_own_code_fails_is_reported_with_the_function():
    class Odd(list):
        def __iter__(self):
            raise TypeError("not to be read")

    with pytest.raises(InvalidValue, match=r"Variable_PutValue, argument 2 \(value\): not to be read"):
        encode_request(f.variable_put_value, (3, Odd([1])), 1)
    with pytest.raises(InvalidValue, match="Robot_Unhold: unhashable type"):
        encode_request(f.robot_unhold, (np.array(3), ""), 1)


def test_a_request_beyond_the_limit_is_refused_here(conversation):
    """The server would close the connection for it (VE026A table 3-5)."""
    size = 2**24 - packet.OVERHEAD - 14 - 10
    assert len(Call(conversation, f.variable_put_value, 3, bytes(size)).request) == 2**24
    with pytest.raises(InvalidValue, match="Variable_PutValue: the packet of 16777217 bytes exceeds the limit of"):
        Call(conversation, f.variable_put_value, 3, bytes(size + 1))
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="パケットが 16777217 バイト"):
        Call(conversation, f.variable_put_value, 3, bytes(size + 1))


# --- replies ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "arguments", "answered", "value"),
    [
        (f.controller_connect, ("", "x", "", ""), [2], 2),
        (f.controller_connect, ("", "x", "", ""), [Variant(VarType.UI4, 2)], 2),
        (f.robot_get_name, (3,), ["Arm"], "Arm"),
        (f.robot_get_name, (3,), [None], ""),
        (f.robot_get_name, (3,), [], ""),
        (f.variable_get_value, (3,), [[1.0, 2.0]], [1.0, 2.0]),
        (f.variable_get_value, (3,), [True], True),
        (f.variable_get_value, (3,), [None], None),
        (f.variable_get_value, (3,), [], None),
        (f.variable_get_value, (3,), ["first", "second"], "first"),
        (f.robot_move, (3, 1, "P1", ""), [], None),
        (f.robot_move, (3, 1, "P1", ""), [None], None),
        (f.robot_move, (3, 1, "P1", ""), ["not expected"], None),
    ],
)
def test_results_plain_and_exact(conversation, function, arguments, answered, value):
    call = Call(conversation, function, *arguments)
    assert call.result(reply(call.serial, *answered)) == (0, value)
    call = Call(conversation, function, *arguments, exact=True)
    _, exact = call.result(reply(call.serial, *answered))
    if function.result is None:
        assert exact is None
    else:
        assert isinstance(exact, Variant)
        assert exact.plain == value
        if answered and answered != [None]:
            assert exact == variant(answered[0])


def test_the_type_of_an_exact_result(conversation):
    call = Call(conversation, f.variable_get_value, 3, exact=True)
    assert call.result(reply(call.serial, Variant(VarType.NULL))) == (0, Variant(VarType.NULL))
    call = Call(conversation, f.robot_get_name, 3, exact=True)
    assert call.result(reply(call.serial, None)) == (0, Variant(VarType.BSTR, ""))


@pytest.mark.parametrize("code", [0, 1, hresult.S_BUF_FULL, 0x7FFFFFFF])
def test_success_codes_come_with_the_result(conversation, code):
    call = Call(conversation, f.robot_execute, 3, "slvMove", None)
    assert Reply(*call.result(reply(call.serial, [1.0], code=code))) == Reply(code=code, value=[1.0])


@pytest.mark.parametrize(
    ("function", "arguments", "answered", "match"),
    [
        (f.controller_connect, ("", "x", "", ""), [], "Controller_Connect returned None, expected VT_I4"),
        (f.controller_connect, ("", "x", "", ""), [None], "returned None, expected VT_I4"),
        (f.controller_connect, ("", "x", "", ""), ["2"], "returned '2', expected VT_I4"),
        (f.controller_connect, ("", "x", "", ""), [2.0], "returned 2.0, expected VT_I4"),
        (f.controller_connect, ("", "x", "", ""), [True], "returned True, expected VT_I4"),
        (f.controller_connect, ("", "x", "", ""), [[2]], r"returned \[2\], expected VT_I4"),
        (f.robot_get_attribute, (3,), [], "Robot_GetAttribute returned None, expected VT_I4"),
        (f.robot_get_name, (3,), [5], "Robot_GetName returned 5, expected VT_BSTR"),
        (f.robot_get_name, (3,), [["a" * 1000]], "expected VT_BSTR"),
    ],
)
@pytest.mark.parametrize("exact", [False, True])
def test_results_of_the_wrong_type(conversation, function, arguments, answered, match, exact):
    call = Call(conversation, function, *arguments, exact=exact)
    error = call.error(ProtocolError, reply(call.serial, *answered), match)
    assert not error.fatal
    assert len(str(error)) < 200
    i18n.use("ja")
    call = Call(conversation, function, *arguments, exact=exact)
    call.error(ProtocolError, reply(call.serial, *answered), "の応答が VT_")


def test_the_connection_stays_usable_after_an_invalid_result(conversation):
    call = Call(conversation, f.variable_get_value, 3)
    body = bytes.fromhex("0a000000 6300 01000000 00000000")
    error = call.error(ProtocolError, packet.pack(call.serial, 0, 1, body), "unknown type VT_99")
    assert not error.fatal
    call = Call(conversation, f.variable_get_value, 3)
    assert call.result(reply(call.serial, 5)) == (0, 5)


def test_error_codes_are_raised_with_function_and_arguments(conversation):
    call = Call(conversation, f.variable_get_value, 9)
    error = call.error(CallError, reply(call.serial, code=hresult.E_HANDLE), r"Variable_GetValue\(9\): 0x80070006")
    assert isinstance(error, InvalidHandle)
    assert (error.code, error.function, error.arguments) == (hresult.E_HANDLE, "Variable_GetValue", (9,))
    call = Call(conversation, f.variable_get_value, 9)
    # DENSO's own server adds a VT_EMPTY to the error reply of a function with a result.
    assert call.error(CallError, reply(call.serial, None, code=0x80000000)).code == 0x80000000


# --- waiting ----------------------------------------------------------------------------------------------------------


def test_a_time_out(conversation):
    call = Call(conversation, f.robot_move, 3, 1, "P1", "", seconds=0.5)
    error = call.error(CallTimeout, None, "Robot_Move: no reply within 0.5 s")
    assert (error.function, error.seconds) == ("Robot_Move", 0.5)


def test_the_peer_closes_the_connection(conversation):
    call = Call(conversation, f.robot_move, 3, 1, "P1", "")
    call.error(ConnectionLost, b"", "Robot_Move: the peer closed the connection before a reply was received")
    i18n.use("ja")
    call = Call(conversation, f.robot_move, 3, 1, "P1", "")
    call.feed(reply(call.serial)[:7])
    call.error(ConnectionLost, b"", "応答の前に相手が接続を閉じました")


def test_executing_restarts_the_time_out(conversation):
    call = Call(conversation, f.robot_move, 3, 1, "P1", "", seconds=0.5)
    for _ in range(3):
        assert call.feed(executing(call.serial)) == (b"", 0.5)
    assert call.feed(executing(call.serial) * 2 + executing(call.serial)[:4]) == (b"", 0.5)
    assert call.feed(executing(call.serial)[4:] + executing(call.serial)) == (b"", 0.5)
    assert call.result(executing(call.serial) + reply(call.serial)) == (0, None)
    assert conversation.stray_replies == 0


def test_other_packets_do_not_restart_the_time_out(conversation):
    call = Call(conversation, f.variable_get_value, 3)
    answer = reply(call.serial, 5)
    assert call.feed(reply(call.serial + 1, 6)) == (b"", None)
    assert call.feed(executing(call.serial + 1)) == (b"", None)
    for position in range(len(answer) - 1):
        assert call.feed(answer[position : position + 1]) == (b"", None)
    assert call.result(answer[-1:]) == (0, 5)
    assert (conversation.stray_replies, conversation.skipped_bytes) == (2, 0)


@pytest.mark.parametrize("junk", [b"\0", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_invalid_bytes_before_the_reply_end_the_call(conversation, junk):
    call = Call(conversation, f.variable_get_value, 3)
    with pytest.raises(ProtocolError, match="is not b-CAP") as caught:
        call.feed(junk + reply(call.serial, 5))
    assert caught.value.fatal


# --- replies to other calls -------------------------------------------------------------------------------------------


def test_a_late_reply_is_not_assigned_to_the_next_call(conversation):
    first = Call(conversation, f.variable_get_value, 3)
    first.error(CallTimeout, None)
    second = Call(conversation, f.variable_get_value, 4)
    assert second.feed(reply(first.serial, "late")) == (b"", None)
    assert second.result(reply(second.serial, "right")) == (0, "right")
    assert conversation.stray_replies == 1


def test_a_late_reply_and_the_expected_one_together(conversation):
    first = Call(conversation, f.variable_get_value, 3)
    first.error(CallTimeout, None)
    second = Call(conversation, f.variable_get_value, 4)
    assert second.result(reply(first.serial, "late") + reply(second.serial, "right")) == (0, "right")
    assert conversation.stray_replies == 1


def test_a_duplicate_reply(conversation):
    first = Call(conversation, f.variable_get_value, 3)
    answer = reply(first.serial, "one")
    assert first.result(answer * 2 + answer[:5]) == (0, "one")
    assert conversation.stray_replies == 0, "the second reply is not processed before the next call"
    second = Call(conversation, f.variable_get_value, 4)
    assert second.result(answer[5:] + reply(second.serial, "two")) == (0, "two")
    assert conversation.stray_replies == 2


def test_a_late_error_is_not_raised(conversation):
    first = Call(conversation, f.variable_get_value, 3)
    first.error(CallTimeout, None)
    second = Call(conversation, f.variable_get_value, 4)
    assert second.feed(reply(first.serial, code=hresult.E_FAIL)) == (b"", None)
    assert second.feed(reply(0, code=hresult.E_FAIL)) == (b"", None)
    assert second.result(reply(second.serial, 5)) == (0, 5)


def test_a_call_that_was_cancelled_during_its_reply(conversation):
    first = Call(conversation, f.variable_get_value, 3)
    answer = reply(first.serial, "late")
    first.feed(answer[:20])
    first.operation.close()
    second = Call(conversation, f.variable_get_value, 4)
    assert second.feed(answer[20:]) == (b"", None)
    assert second.result(reply(second.serial, "right")) == (0, "right")
    assert conversation.stray_replies == 1


def test_what_is_not_b_cap_is_fatal(conversation):
    call = Call(conversation, f.variable_get_value, 3)
    error = call.error(
        ProtocolError, b"\1\0\0\0\0HTTP/1.1 400 Bad Request", "packet of 0 bytes is below the minimum of 16 bytes"
    )
    assert error.fatal
    again = Call(conversation, f.variable_get_value, 3)
    assert again.error(ProtocolError, reply(again.serial, 5)).fatal


def test_limits_on_received_packets():
    conversation = BcapConversation(PacketLimits(packet=100, depth=1))
    call = Call(conversation, f.variable_get_value, 3)
    error = call.error(LimitExceeded, reply(call.serial, "x" * 100), "packet of 230 bytes exceeds the limit of 100")
    assert error.fatal
    conversation = BcapConversation(PacketLimits(depth=1))
    call = Call(conversation, f.variable_get_value, 3)
    assert not call.error(LimitExceeded, reply(call.serial, [[None]])).fatal


def test_every_packet_is_passed_to_trace():
    seen = []
    conversation = BcapConversation(trace=lambda way, data: seen.append((way, data)))
    call = Call(conversation, f.variable_get_value, 3)
    packets = [executing(call.serial), reply(99, 1), reply(call.serial, 5)]
    call.result(b"".join(packets))
    assert seen == [(">", call.request), *(("<", each) for each in packets)]
    assert [type(data) for _, data in seen] == [bytes] * 4


SCRIPT = st.lists(st.sampled_from(["late", "executing", "foreign executing", "error of another", "twice"]), max_size=6)


@given(st.lists(st.tuples(SCRIPT, st.integers(1, 40)), min_size=1, max_size=6))
def test_each_call_receives_its_own_reply(scripts):
    """Calls whose replies are split into pieces of any size, between packets that are not the reply."""
    conversation, last = BcapConversation(), 0
    for number, (script, size) in enumerate(scripts):
        call = Call(conversation, f.variable_get_value, 3)
        pieces = {
            "late": reply(last, "wrong"), "executing": executing(call.serial), "foreign executing": executing(last),
            "error of another": reply(last, code=hresult.E_FAIL), "twice": reply(last, "wrong") * 2,
        }  # fmt: skip
        stream = b"".join(pieces[step] for step in script) + reply(call.serial, number)
        result = None
        for start in range(0, len(stream), size):
            try:
                call.feed(stream[start : start + size])
            except StopIteration as ended:
                result = ended.value
                rest = stream[start + size :]
                assert not rest
        assert result == (0, number)
        last = call.serial


def test_the_encoders_of_a_function_are_cached():
    encode_request(f.robot_unhold, (3, ""), 1)
    assert requests._ENCODERS[f.robot_unhold.id]


def test_serials_continue_after_those_of_another_process():
    conversation = BcapConversation()
    conversation.serial = 0xFFFF
    assert Call(conversation, f.controller_get_name, 1).serial == 0xFFFF
    assert conversation.serial == 1
