"""The client side of e-CAP, without I/O: requests, waiting times, and processing of replies."""

from __future__ import annotations

from typing import Any

import pytest

from orinkit import functions as f
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, InvalidValue, ProtocolError
from orinkit.ecap.client import HTTP, EcapConversation
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import Variant, VarType

pytestmark = pytest.mark.core


def result_of(operation: Any, *received: bytes | None) -> Any:
    """Feed a call with received data and return its outcome."""
    next(operation)
    for data in received[:-1]:
        assert operation.send(data) == (b"", 3.0)
    with pytest.raises(StopIteration) as stop:
        operation.send(received[-1])
    return stop.value.value


def failure_of(operation: Any, received: bytes | None) -> BaseException:
    next(operation)
    with pytest.raises(Exception) as caught:
        operation.send(received)
    return caught.value


def test_a_call() -> None:
    trace: list[tuple[str, bytes]] = []
    conversation = EcapConversation(trace=lambda mark, data: trace.append((mark, data)))
    operation = conversation.call(f.controller_get_variable, (2, "I1", ""), 3.0)
    request, seconds = next(operation)
    assert seconds == 3.0
    assert request.startswith(b"Func=9,Arg1=2,Arg2=I1,Arg3=")
    with pytest.raises(StopIteration) as stop:
        operation.send(b"0x00000000,3,5")
    assert stop.value.value == (0, 5)
    assert trace == [(">", request), ("<", b"0x00000000,3,5")]


def test_every_line_feed_restarts_the_time_out() -> None:
    call = EcapConversation().call(f.variable_get_value, (3,), 3.0)
    assert result_of(call, b"\n", b"\n\n", b"0x00000000,4,0.5") == (0, 0.5)


@pytest.mark.parametrize(
    ("function", "arguments", "received", "value"),
    [
        (f.variable_get_value, (3,), b"0x00000000", None),
        (f.variable_get_value, (3,), b"0x00000000,8,a,b", "a,b"),
        (f.controller_get_name, (2,), b"0x00000000", ""),
        (f.variable_put_value, (3, 1), b"0x00000000", None),
        (f.variable_put_value, (3, 1), b"0x00000000,3,1", None),  # ignored: a result that was not requested
    ],
)
def test_results(function: Any, arguments: Any, received: bytes, value: Any) -> None:
    assert result_of(EcapConversation().call(function, arguments, 3.0), received) == (0, value)


def test_exact_results_and_success_codes() -> None:
    call = EcapConversation().call(f.robot_execute, (3, "slvMove", None), 3.0, exact=True)
    assert result_of(call, b"0x0F200501") == (hresult.S_BUF_FULL, Variant(VarType.EMPTY))
    call = EcapConversation().call(f.variable_get_value, (3,), 3.0, exact=True)
    assert result_of(call, b"0x00000000,4,0.5") == (0, Variant(VarType.R4, 0.5))


def test_failures() -> None:
    error = failure_of(EcapConversation().call(f.variable_get_value, (9,), 3.0), b"0x80070006")
    assert isinstance(error, CallError)
    assert (error.code, error.function) == (hresult.E_HANDLE, "Variable_GetValue")
    assert error.detail == ""
    error = failure_of(
        EcapConversation().call(f.variable_get_value, (9,), 3.0), "0x80070006,handle 9\n は使われていません".encode()
    )
    assert isinstance(error, CallError)
    assert error.detail == "handle 9 は使われていません"
    assert isinstance(failure_of(EcapConversation().call(f.service_start, ("",), 3.0), None), CallTimeout)
    assert isinstance(failure_of(EcapConversation().call(f.service_start, ("",), 3.0), b""), ConnectionLost)
    assert isinstance(failure_of(EcapConversation().call(f.service_start, ("",), 3.0), b"<html>"), ProtocolError)
    assert isinstance(
        failure_of(EcapConversation().call(f.controller_get_robot, (2, "", ""), 3.0), b"0,8,x"), ProtocolError
    )
    small = EcapConversation(PacketLimits(packet=40))
    assert isinstance(
        failure_of(small.call(f.variable_get_value, (9,), 3.0), b"0x00000000,8," + b"x" * 40), ProtocolError
    )


def test_an_invalid_request_is_not_sent() -> None:
    with pytest.raises(InvalidValue, match="Variable_GetValue"):
        next(EcapConversation().call(f.variable_get_value, (2**40,), 3.0))
    with pytest.raises(InvalidValue, match="exceeds the limit of 1000"):
        next(EcapConversation(PacketLimits(packet=1000)).call(f.variable_put_value, (3, "x" * 1000), 3.0))


def test_the_close_sequence_is_sent_once() -> None:
    conversation = EcapConversation()
    assert conversation.close_sequence() == []
    result_of(conversation.call(f.service_start, ("",), 3.0), b"0x00000000")
    ((request, seconds),) = conversation.close_sequence()
    assert request.startswith(b"Func=2")
    assert 0 < seconds <= 1.0
    assert conversation.close_sequence() == []
    result_of(conversation.call(f.service_start, ("",), 3.0), b"0x00000000")
    result_of(conversation.call(f.service_stop, (), 3.0), b"0x00000000")
    assert conversation.close_sequence() == []


def test_it_is_http() -> None:
    assert EcapConversation().profile is HTTP
    assert not HTTP.lossy
