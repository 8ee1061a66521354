"""Raw bytes on the connection of a client conversation."""

from __future__ import annotations

import pytest

from orinkit.bcap import packet
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import LINE
from orinkit.bcap.requests import encode_request
from orinkit.cao.functions import controller_get_name, service_start
from orinkit.core.errors import ConnectionLost, ProtocolError
from orinkit.core.hresult import S_EXECUTING

pytestmark = pytest.mark.core

START = encode_request(service_start, (), 7)


def answer(serial: int, code: int = 0) -> bytes:
    return packet.encode(Packet(serial, code))


def run(operation, *received):
    """Pass received data to an operation; return what it has sent, its waits, and its result."""
    sent, waits = [], []
    try:
        data, wait = next(operation)
        for each in received:
            sent.append(data)
            waits.append(wait)
            data, wait = operation.send(each)
    except StopIteration as end:
        return sent, waits, end.value
    raise AssertionError("the operation has not ended")


def test_the_packet_with_the_same_serial_is_the_reply():
    trace = []
    conversation = BcapConversation(trace=lambda way, data: trace.append((way, data)))
    reply = answer(7, 0x80004001)
    sent, waits, result = run(conversation.raw(START, 2.0), answer(3), answer(7, S_EXECUTING), reply[:5], reply[5:])
    assert result == reply
    assert sent == [START, b"", b"", b""]
    assert waits == [2.0, None, 2.0, None]
    assert trace == [(">", START), ("<", answer(3)), ("<", answer(7, S_EXECUTING)), ("<", reply)]


def test_a_time_out_and_the_next_request():
    conversation = BcapConversation()
    assert run(conversation.raw(START, 2.0), None)[2] is None
    assert conversation.serial == 8  # a late reply does not match the next request
    assert next(conversation.call(controller_get_name, (2,), 1.0))[0][5:7] == b"\x08\x00"


@pytest.mark.parametrize(("data", "serial"), [(b"\x01\x02", 99), (START, 0)])
def test_a_packet_without_a_serial(data, serial):
    conversation = BcapConversation()
    assert run(conversation.raw(data, 1.0), answer(serial))[2] == answer(serial)


def test_the_peer_closes_the_connection():
    with pytest.raises(ConnectionLost, match="raw: the peer closed"):
        run(BcapConversation().raw(START, 1.0), b"")


def test_a_reply_that_is_not_b_cap():
    with pytest.raises(ProtocolError, match="not b-CAP"):
        run(BcapConversation().raw(START, 1.0), b"hello")


def test_a_flood_ends_the_wait():
    with pytest.raises(ProtocolError, match="packets per second"):
        run(BcapConversation().raw(START, 1.0), *[answer(3) * 1000] * 1000)


def test_a_serial_line_is_released_afterwards():
    conversation = BcapConversation(profile=LINE)
    assert run(conversation.raw(b"x", 1.0), None)[2] is None
    assert conversation.close_sequence()  # Service_Stop: the raw packet may have been Service_Start
