"""Clients against a misbehaving server: correct errors, no wrong replies, and no loss of synchronization."""

from __future__ import annotations

import asyncio
import itertools
import random
import threading
import time
from typing import Any

import pytest

from orinkit import aio
from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.core import hresult
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    GeneralError,
    LimitExceeded,
    OrinError,
    ProtocolError,
    TransportError,
)
from orinkit.values.variant import Variant, VarType
from support.both import LISTEN_AT, Both, only
from support.http_wired import PEERS, ecap, on_the_wire
from support.peers import BadPeer, Line, executing, reply
from support.waiting import TooSlow, with_longer_times

pytestmark = pytest.mark.slow

PATIENT = 20.0  # a time-out that must not expire
SHORT = 0.15  # a time-out that is expected to expire
HELLO = "hello"  # has an immediate reply
PIECES = only("tcp", "serial", "http", because="a datagram comes whole")
PACKETS = only(
    "tcp", "udp", "serial", because="it is about packets; what is between the replies of HTTP: tests/transport"
)
CONNECTIONS = only("tcp", "http", because="the others have no connection")


@pytest.fixture
def peer_class(listen_at: str) -> type[BadPeer]:
    """Return the class of a peer for each transport. Its clients send each request once; repetitions: tests/bcap/test_lossy.py."""
    return PEERS[listen_at.partition(":")[0]]


def echo(request: Packet) -> bytes:
    """Return the correct reply, the last argument; closing requests have none."""
    return reply(request, *request.arguments[-1:])


def stray_replies(client: Any, number: int) -> int:
    """Return the number of dropped replies; none on HTTP, because a late reply no longer has a connection."""
    return 0 if client.profile.name == "http" else number


def ask(both: Both, client: Any, token: object, **options: Any) -> Any:
    """Make a call whose correct reply is the token."""
    return both.run(client.request(f.controller_execute, 1, "Echo", token, **options)).value


def ask_in_vain(both: Both, client: Any, token: object) -> CallTimeout:
    """Make a call that times out soon. On HTTP, connect first, because connecting takes time, too."""
    if client.profile.name == "http":
        assert ask(both, client, HELLO) == HELLO
    with pytest.raises(CallTimeout) as caught:
        ask(both, client, token, timeout=SHORT)
    return caught.value


def request_of(line: Line) -> Packet:
    """Return the next request other than hello."""
    while (request := line.request()).arguments[-1:] == [HELLO]:
        line.send(echo(request))
    return request


def requests_up_to(line: Line, last: object) -> list[Packet]:
    """Yield the requests up to the one with a token; on HTTP, a request that timed out may not have been sent."""
    requests = [request_of(line)]
    while requests[-1].arguments[-1] != last:
        requests.append(request_of(line))
    return requests


# --- serial numbers: late, repeated and foreign replies -------------------------------------------------------------


def test_a_late_answer_does_not_answer_the_next_call(both: Both, peer_class: type[BadPeer]) -> None:
    def script(line: Line) -> None:
        for request in requests_up_to(line, "second"):
            line.send(echo(request))
        line.serve(echo)

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        late = ask_in_vain(both, client, "first")
        assert (late.function, late.seconds) == ("Controller_Execute", SHORT)
        assert ask(both, client, "second") == "second"
        assert client.stray_replies == stray_replies(client, 1)
        assert ask(both, client, "third") == "third"
        assert client.stray_replies == stray_replies(client, 1)
        both.run(client.close())


def test_many_late_answers_are_all_dropped(both: Both, peer_class: type[BadPeer]) -> None:
    def script(line: Line) -> None:
        line.send(b"".join(map(echo, requests_up_to(line, 5))))
        line.serve(echo)

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        for number in range(5):
            ask_in_vain(both, client, number)
        assert ask(both, client, 5) == 5
        assert client.stray_replies == stray_replies(client, 5)
        both.run(client.close())


@PACKETS
def test_an_answer_that_comes_twice_counts_once(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class(lambda line: line.serve(lambda request: echo(request) * 2)) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        for number in range(20):
            assert ask(both, client, number) == number
        assert client.stray_replies == 19  # the copy of the last reply has not been read
        both.run(client.close())


@PACKETS
def test_an_answer_with_another_serial_is_not_the_answer(both: Both, peer_class: type[BadPeer]) -> None:
    def script(line: Line) -> None:
        request = line.request()
        for serial in (0, request.serial + 1, request.serial - 1 & 0xFFFF, 0xFFFF):
            line.send(reply(request, "foreign", serial=serial))
            line.send(reply(request, code=hresult.E_FAIL, serial=serial))
        line.send(echo(request))
        request = line.request()
        line.send(reply(request, "foreign", serial=request.serial ^ 0x0100))
        line.serve(echo)

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        assert ask(both, client, "mine") == "mine"
        assert client.stray_replies == 8
        ask_in_vain(both, client, "nobody answers this")
        assert ask(both, client, "next") == "next"
        assert client.stray_replies == 9
        both.run(client.close())


@PACKETS
def test_a_flood_of_foreign_answers_neither_answers_nor_prolongs_a_call(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class() as peer:

        def flood(line: Line) -> None:
            request = line.request()
            swarm = (executing(request, serial=7777) + reply(request, "foreign", serial=8888)) * 500
            while not peer.stopping.is_set():
                line.send(swarm)

        peer._scripts = (flood,)
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        while client.stray_replies == 0:  # wait for the beginning of the flood
            with pytest.raises(
                (CallTimeout, ProtocolError), match=r"no reply within|but not the reply"
            ):  # the client closes the connection if the flood is fast enough
                ask(both, client, "mine", timeout=SHORT)
        both.run(client.close())


@PACKETS
def test_serials_wrap_without_mixing_up_replies(both: Both, peer_class: type[BadPeer]) -> None:
    serials: list[int] = []

    def script(line: Line) -> None:
        while True:
            request = line.request()
            serials.append(request.serial)
            line.send(echo(request))

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        client._conversation.serial = 0xFFF0
        for number in range(40):
            assert ask(both, client, number) == number
        both.run(client.close())
    assert serials[:40] == [*range(0xFFF0, 0x10000), *range(1, 25)]


# --- pieces ---------------------------------------------------------------------------------------------------------


@PIECES
def test_answers_byte_by_byte(both: Both, peer_class: type[BadPeer]) -> None:
    def script(line: Line) -> None:
        while True:
            line.send_in_pieces(*(bytes([byte]) for byte in echo(line.request())))

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        for token in ("ab", [1.5, 2.5], None, True):
            assert ask(both, client, token) == token
        assert client.stray_replies == 0
        both.run(client.close())


@PIECES
def test_answers_split_at_every_point(both: Both, peer_class: type[BadPeer]) -> None:
    whole = echo(Packet(1, 17, [[1, 2, 3]]))

    def script(line: Line) -> None:
        for cut in itertools.count(1):
            answer = echo(line.request())
            line.send_in_pieces(answer[:cut], answer[cut:])

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        for number in range(1, len(whole)):
            assert ask(both, client, [number, 2, 3]) == [number, 2, 3]
        both.run(client.close())


@only("tcp", "serial", because="one packet follows the other")
def test_an_answer_split_across_other_packets(both: Both, peer_class: type[BadPeer]) -> None:
    """The end of one packet and the beginning of the next arrive together."""

    def script(line: Line) -> None:
        while True:
            request = line.request()
            stream = reply(request, "foreign", serial=999) + executing(request) + echo(request) + echo(request)
            third = len(stream) // 3
            line.send_in_pieces(stream[:third], stream[third : 2 * third], stream[2 * third :])

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        for number in range(20):
            assert ask(both, client, number) == number
        both.run(client.close())


@only("tcp", "http", because="a datagram has few bytes, and a line takes its time")
def test_a_large_answer(both: Both, peer_class: type[BadPeer]) -> None:
    content = bytes(range(256)) * 1024 * (32 if peer_class is BadPeer else 1)  # text is longer
    with peer_class(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        assert ask(both, client, content) == content
        both.run(client.close())


# --- the connection ends --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sent", ["nothing", "one byte", "half a header", "header", "all but EOT", "executing", "foreign"]
)
@pytest.mark.parametrize("how", ["close", "reset"])
@CONNECTIONS
def test_the_peer_disconnects_during_a_call(both: Both, peer_class: type[BadPeer], sent: str, how: str) -> None:
    def script(line: Line) -> None:
        request = line.request()
        answer = on_the_wire(line, echo(request))
        line.send(
            {
                "nothing": b"",
                "one byte": answer[:1],
                "half a header": answer[:7],
                "header": answer[:15],
                "all but EOT": answer[:-1],
                "executing": executing(request),
                "foreign": reply(request, "foreign", serial=99),
            }[sent]
        )
        if how == "close":
            line.close()
        else:
            line.reset()

    with peer_class(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        with pytest.raises(ConnectionLost):
            ask(both, client, "token")
        with pytest.raises(ConnectionClosed):  # raised immediately, nothing is sent
            ask(both, client, "token")
        assert peer.connections == 1
        both.run(client.close())


def test_the_peer_closes_between_two_calls(both: Both) -> None:
    with BadPeer(lambda line: line.send(echo(line.request()))) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        assert ask(both, client, 1) == 1
        assert peer.ended.acquire(timeout=PATIENT)
        with pytest.raises(ConnectionLost):
            ask(both, client, 2)
        with pytest.raises(ConnectionClosed):
            ask(both, client, 3)
        both.run(client.close())


@CONNECTIONS
def test_a_reply_before_the_end_of_the_stream_is_accepted(both: Both, peer_class: type[BadPeer]) -> None:
    """If the reply and the end of the stream arrive together, the call succeeds."""
    with peer_class(lambda line: line.send(echo(line.request()))) as peer:
        for number in range(20):
            client = both.client(peer.url, timeout=PATIENT)
            assert ask(both, client, number) == number
            both.run(client.close())


@CONNECTIONS
def test_nobody_listens(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class() as peer:
        url = peer.url
    with pytest.raises(ConnectFailed, match=r"127\.0\.0\.1") as caught:
        ask(both, both.client(url), "token")
    assert isinstance(caught.value, ConnectionError)
    with pytest.raises(ConnectFailed):
        both.connect(url)


@CONNECTIONS
def test_connect_to_a_peer_that_hangs_up(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class(lambda line: line.close()) as peer, pytest.raises(TransportError):
        both.connect(peer.url, timeout=PATIENT)


@pytest.mark.parametrize("refused", [f.service_start, f.controller_connect])
@CONNECTIONS
def test_a_refused_connect_closes_the_connection(both: Both, peer_class: type[BadPeer], refused: Any) -> None:
    def script(line: Line) -> None:
        while (request := line.request()).code != refused.id:
            line.send(reply(request))
        line.send(reply(request, code=hresult.E_MAX_CONNECT))
        line.wait_for_end()

    with peer_class(script) as peer:
        with pytest.raises(CallError) as caught:
            both.connect(peer.url, timeout=PATIENT)
        assert (caught.value.code, caught.value.function) == (hresult.E_MAX_CONNECT, refused.name)
        both.run(asyncio.sleep(0) if both.kind == "async" else None)
        assert peer.ended.acquire(timeout=PATIENT)  # the peer has seen the end of the stream


@CONNECTIONS
def test_closing_from_elsewhere_ends_a_call(peer_class: type[BadPeer]) -> None:
    at_work = threading.Event()

    def script(line: Line) -> None:
        line.request()
        at_work.set()
        line.wait_for_end()

    both = Both("sync")
    with peer_class(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        closer = threading.Thread(target=lambda: (at_work.wait(PATIENT), client.close()))
        closer.start()
        with pytest.raises(ConnectionClosed):
            ask(both, client, "token")
        closer.join()


@CONNECTIONS
def test_closing_from_another_task_ends_a_call(peer_class: type[BadPeer]) -> None:
    both = Both("async")
    with peer_class(lambda line: line.wait_for_end()) as peer:
        client = both.client(peer.url, timeout=PATIENT)

        async def body() -> None:
            call = asyncio.ensure_future(client.call(f.controller_execute, 1, "Echo", 1))
            await asyncio.sleep(0)
            await client.close()
            with pytest.raises(ConnectionClosed):
                await call

        both.run(body())
        both.close()


@CONNECTIONS
@with_longer_times(SHORT, 1.0, PATIENT)
def test_closing_a_controller_that_is_silent_takes_one_timeout(
    both: Both, peer_class: type[BadPeer], short: float
) -> None:
    """One time-out in all, not one per object: a ``with`` block must end after the cable has been pulled."""
    asked: list[int] = []

    def script(line: Line) -> None:
        asked.clear()
        for handle in range(2, 25):
            line.send(reply(line.request(), handle))
        while True:
            asked.append(line.request().code)

    with peer_class(script) as peer:
        controller = both.connect(peer.url, tries=1, timeout=PATIENT)
        kept = [both.run(controller.variable(f"I{number}")) for number in range(20)]
        kept.append(both.run(controller.robot()))
        controller.client.timeout = short
        both.run(controller.close())
        with pytest.raises(ConnectionClosed):
            both.run(kept[0].get_value())
        assert peer.ended.acquire(timeout=PATIENT)
        goodbye = [f.service_stop.id] if peer.url.startswith("http") else []
        if asked == goodbye != []:
            raise TooSlow
        assert asked == [f.robot_release.id, *goodbye]


@CONNECTIONS
def test_a_cancelled_close_closes_the_connection(peer_class: type[BadPeer]) -> None:
    both = Both("async")

    def script(line: Line) -> None:
        for _ in range(2):
            line.send(reply(line.request(), 2))
        line.wait_for_end()

    async def body() -> None:
        controller = await aio.connect(peer.url, timeout=PATIENT)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(SHORT):
                await controller.close()
        with pytest.raises(ConnectionClosed):
            await controller.client.call(f.service_stop)

    with peer_class(script) as peer:
        both.run(body())
        both.close()


# --- not b-CAP ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("begin", [b"\x01", b"\x01\x10\x20\x00\x00", b"\x01\x00\x01\x00\x00"])
def test_garbage_that_looks_like_a_long_packet_finally_closes_the_connection(both: Both, begin: bytes) -> None:
    """The apparent packet absorbs replies: calls time out, without wrong results, until the connection is closed."""

    def script(line: Line) -> None:
        line.send(begin)
        line.serve(echo)

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        ask_in_vain(both, client, "first")
        with pytest.raises(ProtocolError):
            ask(both, client, bytes(70_000))
        with pytest.raises(ConnectionClosed):
            ask(both, client, "third")


@pytest.mark.parametrize(
    "garbage", [b"\x00", b"\x04\x04\x04", b"HTTP/1.1 400 Bad Request\r\n\r\n", bytes(range(2, 256)) * 40]
)
@PACKETS
def test_junk_before_the_answer_ends_the_connection(both: Both, peer_class: type[BadPeer], garbage: bytes) -> None:
    """This applies to streams. Junk between packets of a serial line, and invalid datagrams, are skipped."""

    def script(line: Line) -> None:
        while True:
            line.send(garbage + echo(line.request()))

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        if peer_class is BadPeer:
            with pytest.raises(ProtocolError, match="is not b-CAP") as caught:
                ask(both, client, 0)
            assert caught.value.fatal
            with pytest.raises(ConnectionClosed):
                ask(both, client, 1)
        else:
            for number in range(3):
                assert ask(both, client, number) == number
        both.run(client.close())


def corrupt(answer: bytes, *, length: int | None = None, end: int | None = None) -> bytes:
    """Return a packet with a wrong length field or a wrong last byte."""
    if length is not None:
        answer = answer[:1] + packet.LENGTH.pack(length) + answer[5:]
    return answer if end is None else answer[:-1] + bytes([end])


@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda answer: corrupt(answer, length=0), ProtocolError),
        (lambda answer: corrupt(answer, length=15), ProtocolError),
        (lambda answer: corrupt(answer, length=len(answer) - 1), ProtocolError),
        (lambda answer: corrupt(answer, length=16 * 1024 * 1024 + 1), LimitExceeded),
        (lambda answer: corrupt(answer, length=0xFFFFFFFF), LimitExceeded),
        (lambda answer: corrupt(answer, end=0x00), ProtocolError),
        (lambda answer: corrupt(answer, end=0x01), ProtocolError),
        (lambda answer: b"\x01\x02\x03\x04\x05" + answer, LimitExceeded),
        (lambda answer: b"\x01\x14\x00\x00\x00" + answer, ProtocolError),  # absorbs the beginning of the reply
    ],
    ids=["no length", "length 15", "short by 1", "17 MiB", "4 GiB", "EOT 00", "EOT 01", "SOH before", "swallow"],
)
def test_a_stream_without_packet_boundaries_is_closed(both: Both, spoil: Any, error: type[ProtocolError]) -> None:
    def script(line: Line) -> None:
        line.send(spoil(echo(line.request())))
        line.wait_for_end()

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        with pytest.raises(ProtocolError) as caught:
            ask(both, client, "token")
        assert type(caught.value) is error
        assert caught.value.fatal
        with pytest.raises(ConnectionClosed):
            ask(both, client, "token")
        both.run(asyncio.sleep(0) if both.kind == "async" else None)
        assert peer.ended.acquire(timeout=PATIENT)  # the client closed the connection


def test_a_length_longer_than_the_packet_ends_with_a_timeout_or_an_error(both: Both) -> None:
    """The client waits for bytes of the next reply; it must not accept either packet as a reply."""
    with BadPeer(
        lambda line: line.serve(lambda request: corrupt(echo(request), length=len(echo(request)) + 4))
    ) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        ask_in_vain(both, client, "first")
        with pytest.raises(ProtocolError):
            ask(both, client, "second")
        with pytest.raises(ConnectionClosed):
            ask(both, client, "third")


def frame(request: Packet, count: int, body: bytes) -> bytes:
    return packet.pack(request.serial, 0, count, body)


WRONG = {
    "text for VT_I4": (f.variable_get_attribute, lambda r: reply(r, "text")),
    "VT_R8 for VT_I4": (f.variable_get_attribute, lambda r: reply(r, 1.5)),
    "VT_BOOL for VT_I4": (f.variable_get_attribute, lambda r: reply(r, True)),
    "array for VT_I4": (f.variable_get_attribute, lambda r: reply(r, [1])),
    "VT_I4 for text": (f.variable_get_name, lambda r: reply(r, 5)),
    "text for a handle": (f.controller_get_variable, lambda r: reply(r, "two")),
    "nothing for a handle": (f.controller_get_variable, lambda r: reply(r)),
    "VT_EMPTY for a handle": (f.controller_get_variable, lambda r: reply(r, None)),
}
WRONG_PACKETS = {
    "count without bytes": "",
    "VT_I4 of 3 bytes": "0a000000030001000000050000",
    "argument of 2 GiB": "ffffff7f03000100000005000000",
    "4 G elements": "0a0000000300ffffffff05000000",
    "unknown type": "0a00000063000100000005000000",
    "text of 2 GiB": "0a000000080001000000ffffff7f",
    "nonsense": "06000000ffff05000000",
}
WRONG_BODIES = {
    "a comma only": b"0x00000000,x",
    "no value": b"0x00000000,3,",
    "VT_I4 that is not a number": b"0x00000000,3,five",
    "VT_I4 that is too large": b"0x00000000,3,2147483648",
    "unknown type": b"0x00000000,99,5",
    "text without its end": b"0x00000000,8204,(8,a(b)",
    "too many brackets": b"0x00000000,8204," + b"(" * 100_000,
    "no UTF-8": b"0x00000000,8,\xff",
    "no code": b"good morning",
    "too large a code": b"0x100000000",
}


def wrong_answers() -> list[Any]:
    """Yield wrong replies for a transport: invalid packets, or invalid bodies of HTTP responses."""
    packets = {name: lambda r, body=body: frame(r, 1, bytes.fromhex(body)) for name, body in WRONG_PACKETS.items()}
    bodies = {name: lambda r, body=body: ecap(body) for name, body in WRONG_BODIES.items()}
    rows = [(wire, name, *row) for wire in LISTEN_AT for name, row in WRONG.items()]
    for wire in LISTEN_AT:
        own = bodies if wire == "http" else packets
        rows += [(wire, name, f.variable_get_value, answer) for name, answer in own.items()]
    return [pytest.param(wire, function, answer, id=f"{wire}-{name}") for wire, name, function, answer in rows]


@pytest.mark.parametrize(("listen_at", "function", "answer"), wrong_answers(), indirect=["listen_at"])
def test_a_wrong_result_is_refused_and_the_connection_stays_usable(
    both: Both, peer_class: type[BadPeer], function: Any, answer: Any
) -> None:
    def script(line: Line) -> None:
        line.send(answer(line.request()))
        line.serve(echo)

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        with pytest.raises(ProtocolError) as caught:
            both.run(client.call(function, 1, *["IO150"] * function.creates.startswith("V")))
        assert not caught.value.fatal
        assert str(caught.value)
        assert ask(both, client, "next") == "next"
        both.run(client.close())


def test_other_integer_types_and_a_missing_result_are_tolerated(both: Both, peer_class: type[BadPeer]) -> None:
    answers = iter([[Variant(VarType.UI4, 7)], [Variant(VarType.I2, 8)], [], [1, "more", "than", "asked"]])
    with peer_class(lambda line: line.serve(lambda request: reply(request, *next(answers, [])))) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        assert both.run(client.call(f.variable_get_attribute, 1)) == 7
        assert both.run(client.call(f.variable_get_attribute, 1)) == 8
        assert both.run(client.call(f.variable_get_value, 1)) is None
        assert both.run(client.call(f.variable_get_value, 1)) == 1
        both.run(client.close())


def test_an_error_code_with_a_result_is_an_error(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class(lambda line: line.serve(lambda request: reply(request, "ignored", code=0x83500121))) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        with pytest.raises(CallError) as caught:
            ask(both, client, "token")
        assert caught.value.code == 0x83500121
        both.run(client.close())


# --- S_EXECUTING ----------------------------------------------------------------------------------------------------


def test_executing_prolongs_the_wait(both: Both, peer_class: type[BadPeer]) -> None:
    """Six reports at intervals of 0.3 s take 1.8 s, longer than the time-out of 1.6 s: each restarts it."""
    with peer_class() as peer:

        def script(line: Line) -> None:
            request = line.request()
            for _ in range(6):
                peer.stopping.wait(0.3)
                line.send(executing(request))
            line.send(echo(request))
            line.wait_for_end()

        peer._scripts = (script,)
        client = both.client(peer.url, tries=1, timeout=1.6)
        assert ask(both, client, "long") == "long"
        assert client.stray_replies == 0
        both.run(client.close())


def test_executing_and_then_silence_is_a_timeout(both: Both, peer_class: type[BadPeer]) -> None:
    def script(line: Line) -> None:
        while (request := request_of(line)).arguments[-1] == "token":
            line.send(executing(request) * 3)
        line.send(echo(request))
        line.serve(echo)

    with peer_class(script) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        ask_in_vain(both, client, "token")
        assert ask(both, client, "next") == "next"
        both.run(client.close())


@PACKETS
def test_executing_for_another_call_does_not_prolong_the_wait(both: Both, peer_class: type[BadPeer]) -> None:
    with peer_class() as peer:

        def script(line: Line) -> None:
            request = line.request()
            while not peer.stopping.wait(0.02):
                line.send(executing(request, serial=request.serial + 1))

        peer._scripts = (script,)
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        ask_in_vain(both, client, "token")
        both.run(client.close())


def executing_for_ever(peer: BadPeer, started: threading.Event) -> Any:
    def script(line: Line) -> None:
        request = line.request()
        while not peer.stopping.wait(0.01):
            line.send(executing(request))
            started.set()

    return script


@CONNECTIONS
def test_executing_for_ever_can_be_ended_by_closing(peer_class: type[BadPeer]) -> None:
    both, started = Both("sync"), threading.Event()
    with peer_class() as peer:
        peer._scripts = (executing_for_ever(peer, started),)
        client = both.client(peer.url, timeout=PATIENT)
        closer = threading.Thread(target=lambda: (started.wait(PATIENT), client.close()))
        closer.start()
        with pytest.raises(ConnectionClosed):
            ask(both, client, "token")
        closer.join()


@CONNECTIONS
def test_executing_for_ever_can_be_cancelled(peer_class: type[BadPeer]) -> None:
    both, started = Both("async"), threading.Event()
    with peer_class() as peer:
        peer._scripts = (executing_for_ever(peer, started),)
        client = both.client(peer.url, timeout=PATIENT)

        async def body() -> None:
            call = asyncio.ensure_future(client.call(f.controller_execute, 1, "Echo", 1))
            await asyncio.to_thread(started.wait, PATIENT)
            call.cancel()
            with pytest.raises(asyncio.CancelledError):
                await call
            await client.close()

        both.run(body())
        both.close()


# --- a peer that never reads ----------------------------------------------------------------------------------------


def test_a_peer_that_never_reads(both: Both) -> None:
    """The client does not hang, and does not accumulate requests in memory."""
    with BadPeer() as peer:
        peer._scripts = (lambda line: peer.stopping.wait(PATIENT) and None,)
        client = both.client(peer.url, timeout=PATIENT)
        client.timeout = 0.3
        content = bytes(4 * 1024 * 1024)
        errors: list[type[Exception]] = []
        for _ in range(12):
            try:
                ask(both, client, content)
            except OrinError as error:
                errors.append(type(error))
        assert len(errors) == 12
        assert set(errors) <= {CallTimeout, ConnectionLost, ConnectionClosed}
        assert errors[-1] is ConnectionClosed  # the client has closed the connection
        both.run(client.close())


# --- random faults --------------------------------------------------------------------------------------------------


TRICKS = 14
NO_ANSWER, GARBAGE, WRONG_LENGTH = 0, 6, 7  # faults after which no reply may arrive, for the last two for a long time


class Chaos:
    """A script with random faults; a reply with the serial number of a call is always the reply to that call.

    A token begins with the number of the fault in the reply to its call.
    """

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.late: list[bytes] = []

    def script(self, line: Line) -> None:
        self.late.clear()  # a new connection
        while True:
            request = line.request()
            answer = echo(request)
            if request.code == f.service_stop.id:  # on HTTP, a client waits briefly for the reply
                line.send(answer)
                continue
            trick = int(request.arguments[-1].partition(":")[0])
            foreign = reply(request, "foreign", serial=self.random.choice([0, request.serial ^ 0x8000, 65535]))
            if trick == NO_ANSWER:
                self.late.append(answer)
            elif trick == 1:
                line.send(answer * self.random.randrange(2, 4))
            elif trick == 2:
                line.send(foreign * self.random.randrange(1, 50) + answer + foreign)
            elif trick == 3:
                line.send(executing(request) * self.random.randrange(1, 4) + answer)
            elif trick == 4:
                cut = self.random.randrange(1, len(answer))
                line.send_in_pieces(answer[:cut], answer[cut:])
            elif trick == 5:
                whole = on_the_wire(line, answer)
                line.send(whole[: self.random.randrange(len(whole))])
                return
            elif trick == GARBAGE:
                line.send(self.random.randbytes(self.random.randrange(1, 40)) + answer)
            elif trick == WRONG_LENGTH:
                line.send(
                    corrupt(answer, length=self.random.choice([0, 9, len(answer) - 3, len(answer) + 3, 2**32 - 1]))
                )
            elif trick == 8:
                line.send(corrupt(answer, end=self.random.choice([0, 1, 5])))
            elif trick == 9:
                line.send(reply(request, code=hresult.E_FAIL))
            elif trick == 10:
                line.send(b"".join(self.late) + answer)
                self.late.clear()
            else:
                line.send(answer)


@pytest.mark.parametrize("seed", range(2))
@CONNECTIONS
def test_random_faults_cause_no_wrong_result(both: Both, peer_class: type[BadPeer], seed: int) -> None:
    chance = random.Random(seed)
    right = refused = 0
    swallows = False  # the received bytes may be the beginning of a packet that absorbs the next replies
    with peer_class(Chaos(seed).script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        for number in range(200):
            trick = chance.randrange(TRICKS)
            token = f"{trick}:{number}:{chance.random()}"
            may_be_in_vain = swallows or trick in (NO_ANSWER, GARBAGE, WRONG_LENGTH)
            try:
                assert ask(both, client, token, timeout=0.1 if may_be_in_vain else PATIENT) == token
                right += 1
                swallows = False
            except CallTimeout:
                assert may_be_in_vain
                swallows = swallows or trick != NO_ANSWER
            except GeneralError:
                refused += 1
            except (TransportError, ProtocolError):
                both.run(client.close())
                client = both.client(peer.url, timeout=PATIENT)
                swallows = False
        both.run(client.close())
    assert right > 70
    assert refused > 3


def test_a_call_on_a_closed_client_fails_immediately(both: Both, peer_class: type[BadPeer]) -> None:
    """The error does not wait for the time-out."""
    with peer_class(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, tries=1, timeout=PATIENT)
        both.run(client.close())
        both.run(client.close())
        before = time.monotonic()
        with pytest.raises(ConnectionClosed):
            ask(both, client, 1)
        assert time.monotonic() - before < PATIENT
