"""Debug mode and disabled messages (RC8 table 5-1), compared with the bytes that the server received and sent."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import pytest

import orinkit
from orinkit import Variant, VarType
from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.bcap.server import ServerConversation
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.core.errors import CaoError, InvalidHandle, MessagesDisabled, ObjectNotFound
from orinkit.server.http import app
from orinkit.server.threaded import Server
from orinkit.values.types import ARRAY
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.peers import reply
from support.waiting import until

PATIENT = 20.0  # a time-out that must not expire: nothing is sent twice
SENT, RECEIVED = "$LAST_SEND_PACKET$", "$LAST_RECEIVE_PACKET$"


class Seen:
    """The bytes that the server has received, and the replies that it has sent."""

    def __init__(self) -> None:
        self.received = b""
        self.replies: list[bytes] = []


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Seen:
    """Record the bytes in the server, without changing them."""
    seen = Seen()
    receive, finish, read, write = (
        ServerConversation.receive, ServerConversation.finish, app.read_request, app.write_reply,
    )  # fmt: skip
    take_directly, reply_directly = ServerConversation.take_directly, ServerConversation.reply_directly

    def received(self: ServerConversation, data: bytes, now: float) -> Any:
        seen.received += data
        return receive(self, data, now)

    def finished(self: ServerConversation, *args: Any) -> Any:
        data = finish(self, *args)
        seen.replies.append(bytes(data))
        return data

    def taken(self: ServerConversation, data: bytes, now: float) -> Any:
        call = take_directly(self, data, now)
        if call is not None:
            seen.received += data
        return call

    def replied(self: ServerConversation, *args: Any) -> Any:
        data = reply_directly(self, *args)
        if data is not None:
            seen.replies.append(bytes(data))
        return data

    def was_read(body: bytes, *args: Any) -> Any:
        seen.received += body
        return read(body, *args)

    def written(*args: Any) -> bytes:
        seen.replies.append(write(*args))
        return seen.replies[-1]

    monkeypatch.setattr(ServerConversation, "receive", received)
    monkeypatch.setattr(ServerConversation, "finish", finished)
    monkeypatch.setattr(ServerConversation, "take_directly", taken)
    monkeypatch.setattr(ServerConversation, "reply_directly", replied)
    monkeypatch.setattr(app, "read_request", was_read)
    monkeypatch.setattr(app, "write_reply", written)
    return seen


@pytest.fixture
def server(listen_at: str) -> Iterator[Server]:
    with orinkit.serve(VirtualRC8(), listen_at) as served:
        yield served


# --- debug mode -------------------------------------------------------------------------------------------------------


def test_the_last_packets_are_those_of_the_server(both: Both, server: Server, seen: Seen) -> None:
    rc8 = both.connect(server.url, debug=True, timeout=PATIENT)
    sent, received = (both.run(rc8.variable(name)) for name in (SENT, RECEIVED))
    number = both.run(rc8.variable("I1"))
    before = len(seen.received)
    for value in (41, 42):
        both.run(number.put_value(value))
    assert both.run(number.get_value()) == 42
    requests = seen.received[before:]
    last = both.run(sent.get_value())
    assert isinstance(last, bytes)
    assert len(last) < len(requests)
    assert requests.endswith(last)
    assert both.run(received.get_value()) == seen.replies[-1]
    assert both.run(sent.get_value()) == last  # reading the variables sends nothing
    assert seen.received[before:] == requests

    both.run(number.put_value(7))
    assert both.run(sent.get_value()) != last
    assert seen.received.endswith(both.run(sent.get_value()))
    assert both.run(received.get_value()) == seen.replies[-1]
    count = len(seen.received)
    both.run(sent.close())
    both.run(received.close())
    assert len(seen.received) == count
    both.run(rc8.close())


@only("tcp", because="the variables do not depend on the transport")
def test_properties_of_the_variables(both: Both, server: Server) -> None:
    rc8 = both.connect(server.url, debug=True, timeout=PATIENT)
    sent = both.run(rc8.variable("$Last_Send_Packet$"))
    assert both.run(sent.get_name()) == SENT
    assert both.run(sent.get_help()) == "bytes of the last packet sent"
    assert both.run(sent.get_attribute()) == 1
    moment = both.run(sent.get_date_time())
    assert isinstance(moment, datetime)
    assert both.run(sent.get_microsecond()) == moment.microsecond
    assert (both.run(sent.get_tag()), both.run(sent.get_id())) == (None, None)
    both.run(sent.put_tag("mine"))
    both.run(sent.put_id(3))
    assert (both.run(sent.get_tag()), both.run(sent.get_id())) == ("mine", 3)
    other = both.run(rc8.variable(SENT))
    assert both.run(other.get_tag()) is None
    with pytest.raises(CaoError, match=r"Variable_PutValue.*E_CAO_NOT_WRITABLE") as caught:
        both.run(sent.put_value(b"x"))
    assert caught.value.code == hresult.E_CAO_NOT_WRITABLE
    both.run(rc8.close())


@only("tcp", because="the calls do not depend on the transport")
def test_raw_calls(both: Both, server: Server, seen: Seen) -> None:
    client = both.client(server.url, debug=True, timeout=PATIENT)
    both.run(client.call(f.service_start))
    owner = both.run(client.call(f.controller_connect, "", "CaoProv.DENSO.VRC", "localhost", ""))
    count = len(seen.received)
    made = both.run(client.request(f.controller_get_variable, owner, RECEIVED, exact=True))
    assert (made.code, made.value.type) == (hresult.S_OK, VarType.I4)
    handle = made.value.value
    found = both.run(client.request(f.variable_get_value, handle, exact=True))
    assert found == (hresult.S_OK, Variant(VarType.UI1 | ARRAY, seen.replies[-1]))
    assert both.run(client.call(f.variable_release, handle)) is None
    for function in (f.variable_get_value, f.variable_release):
        with pytest.raises(InvalidHandle):
            both.run(client.call(function, handle))
    kept = both.run(client.call(f.controller_get_variable, owner, SENT))
    with pytest.raises(InvalidHandle, match="Robot_Halt"):
        both.run(client.call(f.robot_halt, kept))
    assert len(seen.received) == count
    both.run(client.call(f.controller_disconnect, owner))
    with pytest.raises(InvalidHandle):
        both.run(client.call(f.variable_get_value, kept))
    both.run(client.close())


@only("tcp", because="the names do not depend on the transport")
def test_without_debug_mode_the_names_go_to_the_controller(both: Both, server: Server, seen: Seen) -> None:
    rc8 = both.connect(server.url, timeout=PATIENT)
    for name in (SENT, RECEIVED):
        with pytest.raises(ObjectNotFound):
            both.run(rc8.variable(name))
        assert name.encode("utf-16-le") in seen.received
    both.run(rc8.close())


@only("tcp", because="the names do not depend on the transport")
def test_only_the_controller_has_the_variables(both: Both, server: Server) -> None:
    rc8 = both.connect(server.url, debug=True, timeout=PATIENT)
    robot = both.run(rc8.robot("Arm0"))
    with pytest.raises(ObjectNotFound):
        both.run(robot.variable(SENT))
    assert SENT not in both.run(rc8.variable_names())
    both.run(rc8.close())


@only("tcp", because="every transport uses the same callback")
def test_debug_mode_and_trace_together(both: Both, server: Server) -> None:
    packets: list[tuple[str, bytes]] = []
    rc8 = both.connect(
        server.url, debug=True, timeout=PATIENT, trace=lambda mark, data: packets.append((mark, bytes(data)))
    )
    sent, received = (both.run(rc8.variable(name)) for name in (SENT, RECEIVED))
    assert [(">", both.run(sent.get_value())), ("<", both.run(received.get_value()))] == packets[-2:]
    both.run(rc8.close())


def test_a_repeated_request_is_the_last_packet_sent(both: Both) -> None:
    """The peer ignores the first attempt; the last packet is the attempt that was sent last."""
    attempts: list[bytes] = []

    def answer(line: socket.socket) -> None:
        while data := line.recvfrom(1000):
            if data[0] == b"end":
                return
            attempts.append(data[0])
            if len(attempts) > 1:
                line.sendto(reply(packet.decode(data[0])), data[1])

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        thread = threading.Thread(target=answer, args=(line,))
        thread.start()
        try:
            client = both.client(f"Server=127.0.0.1:{line.getsockname()[1]}, UDP, Timeout=400, TORetry=7, Debug")
            both.run(client.call(f.service_start))
            handle = both.run(client.call(f.controller_get_variable, 1, SENT))
            last = both.run(client.call(f.variable_get_value, handle))
            until(lambda: attempts[-1] == last)
            assert len(attempts) > 1
            assert (packet.decode(last).reserved, packet.decode(last).serial) != (0, packet.decode(attempts[0]).serial)
            assert packet.decode(last).reserved == packet.decode(attempts[0]).serial
        finally:
            line.sendto(b"end", line.getsockname())
            thread.join()
        both.run(client.close())


# --- messages ---------------------------------------------------------------------------------------------------------


def test_disabled_messages_are_not_fetched(both: Both, server: Server, seen: Seen) -> None:
    rc8 = both.connect(server.url, messages=False, timeout=PATIENT)
    count = len(seen.received)
    with pytest.raises(MessagesDisabled, match=r"Controller_GetMessage was not sent: messages are disabled"):
        both.run(rc8.message())
    assert len(seen.received) == count
    assert both.run(rc8.get_name()) == "Controller1"
    assert len(seen.received) > count
    both.run(rc8.close())


@only("tcp", because="the functions do not depend on the transport")
def test_every_function_of_messages_is_refused(both: Both, server: Server, seen: Seen) -> None:
    client = both.client(server.url, messages=False, timeout=PATIENT)
    refused = [
        entry for entry in FUNCTIONS.values() if entry.interface == "Message" or entry is f.controller_get_message
    ]
    assert sorted(entry.id for entry in refused) == [18, *range(128, 138)]
    for entry in refused:
        for call in (client.call, client.request):
            with pytest.raises(MessagesDisabled, match=entry.name):
                both.run(call(entry, *([1] * len(entry.arguments))))
    assert not seen.received
    both.run(client.close())


@only("tcp", because="the events do not depend on the transport")
def test_messages_are_fetched_by_default(both: Both, server: Server) -> None:
    rc8 = both.connect(server.url, debug=True, timeout=PATIENT)
    assert both.run(rc8.message()) is None
    both.run(rc8.close())
