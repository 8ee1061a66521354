"""Limits on the connections of slow, silent, greedy, and many clients."""

from __future__ import annotations

import logging
import random
import select
import socket
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.core import hresult
from orinkit.server import context as connections
from orinkit.server.http import sessions, tls
from orinkit.server.http.flow_control import HELD
from orinkit.server.http.limits import LimitedProtocol
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.stage import KEPT_ALIVE, Stage
from orinkit.server.threaded import Server
from support.devices import Workshop
from support.leaping import leap, see_broken, take_turns
from support.waiting import PATIENCE, until
from support.web import EXECUTE, GET_VARIABLE, OK, Web, connect, curl, request

DESCRIPTORS = Path("/proc/self/fd")
LONG = 1000.0  # s


@pytest.fixture(autouse=True)
def _all_are_closed(no_errors_are_logged: None) -> Iterator[None]:
    yield
    Web.close_all()


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, "http://127.0.0.1:0", clients=16) as served:
        yield served


def patience(monkeypatch: pytest.MonkeyPatch, stage: Stage) -> None:
    """Set a long time limit for a stage, which elapses only when a test advances the clock."""
    monkeypatch.setattr(stage, "seconds", LONG)


def end_of(server: Server, web: Web) -> LimitedProtocol:
    """Return the server's end of a connection, after it has read all bytes received."""
    name = "{}:{}/http".format(*web.socket.getsockname())

    def found() -> list[LimitedProtocol]:
        protocols = list(server._server._context.all)
        return [each for each in protocols if isinstance(each, LimitedProtocol) and each.name == name]

    until(found)
    take_turns(server)
    return found()[0]


def forget_broken(server: Server) -> None:
    """Let the server drop a client whose connection broke during a call, after it has detected that."""
    see_broken(server)
    leap(server, sessions.IDLE_TIMEOUT)


def still_open(web: Web) -> bool:
    """Return True if the server has not closed a connection without unread bytes."""
    web.socket.setblocking(False)
    try:
        return web.socket.recv(1) != b""
    except BlockingIOError:
        return True
    except ConnectionError:
        return False
    finally:
        web.socket.settimeout(PATIENCE)


def works(web: Web, handle: int, number: int) -> bool:
    return web.call(EXECUTE, handle, "Echo", f"3,{number}").result == f"3,{number}"


# --- many connections -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beginning", [b"", b"P", b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: a", "body"])
def test_300_slow_connections_do_not_keep_others_out(
    server: Server, beginning: bytes | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for stage in (Stage.NEW, Stage.HEADER, Stage.BODY):
        patience(monkeypatch, stage)
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        slow = []
        for number in range(300):
            one = Web(server.url)
            one.send(one.head("x" * 100) + b"Func=" if isinstance(beginning, str) else beginning)
            slow.append(one)
            if number % 10 == 0:
                assert works(web, handle, number)  # over the same connection all the time
        assert curl(server.url, 1).body == OK  # and over the newest connection
        for number in range(20):
            assert works(web, handle, number)
            for one in slow[-20:]:  # a byte from time to time, like slowloris
                one.send(b"a")
        assert sum(map(still_open, slow)) <= 64
        assert not any(map(still_open, slow[:200]))
        for one in slow:
            one.close()
        assert works(web, handle, 1)


def test_connections_with_calls_are_not_evicted(workshop: Workshop, server: Server) -> None:
    busy = []
    for _ in range(8):
        with Web(server.url, keeps_cookies=True) as first:
            handle = connect(first)
            for number in range(8):
                web = Web(server.url)
                web.cookie = first.cookie
                body = request(EXECUTE, handle, "Wait", f"3,{number}")
                web.send(web.head(body) + body.encode())
                assert workshop.at_work.acquire(timeout=PATIENCE)
                busy.append(web)
    with Web(server.url) as refused:  # 64 connections have calls in progress
        assert refused.ended()
    workshop.gate.set()
    assert [web.answer().result for web in busy] == [f"3,{number}" for number in range(8)] * 8
    with Web(server.url) as welcome:
        assert welcome.call(1).body == OK


def test_a_recently_used_connection_is_kept_longer_than_an_unused_one(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    patience(monkeypatch, Stage.NEW)
    with Web(server.url) as used:
        assert used.call(1).body == OK
        unused = [Web(server.url) for _ in range(62)]
        assert curl(server.url, 1).body == OK  # so these have been accepted
        assert used.call(1).body == OK
        late = [Web(server.url) for _ in range(30)]
        until(lambda: sum(map(still_open, [*unused, *late])) == 63)
        assert used.call(1).body == OK
        assert [still_open(web) for web in unused] == [False] * 29 + [True] * 33


# --- slow clients -----------------------------------------------------------------------------------------------------


def test_a_connection_without_requests(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    patience(monkeypatch, Stage.NEW)
    with Web(server.url) as web:
        end_of(server, web)
        leap(server, LONG - PATIENCE)
        assert still_open(web)
        leap(server, PATIENCE)
        assert web.ended()


def test_a_header_that_arrives_too_slowly(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    patience(monkeypatch, Stage.HEADER)
    with Web(server.url) as web:
        assert web.call(1).body == OK
        sent = 0
        with pytest.raises(OSError):
            for byte in web.head("Func=1")[:-1]:
                web.send(bytes([byte]))
                sent += 1
                take_turns(server)
                leap(server, LONG / 50)
        assert 40 < sent < 60
        assert web.answer().status == 408
        assert web.ended()


def test_a_body_that_arrives_too_slowly(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    patience(monkeypatch, Stage.BODY)
    with Web(server.url, keeps_cookies=True) as other, Web(server.url) as web:
        handle = connect(other)
        web.send(web.head("x" * 1000) + b"Func=1,")
        sent = 0
        with pytest.raises(OSError):
            while sent < 100:
                assert works(other, handle, 1)
                leap(server, LONG / 50)
                web.send(b"x")
                sent += 1
        assert 40 < sent < 60
        answer = web.answer()
        assert (answer.status, answer.headers["connection"]) == (408, "close")
        assert server.clients == 1


def test_a_refused_body_that_never_ends(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    patience(monkeypatch, Stage.BODY)
    with Web(server.url) as web:
        web.send(web.head("x" * 1000, Content_Type="text/plain") + b"Func=1,")
        end_of(server, web)
        leap(server, LONG - PATIENCE)
        assert still_open(web)
        leap(server, PATIENCE)
        assert web.answer().status == 408
        assert web.ended()


def test_an_idle_connection_is_closed_after_a_while(server: Server) -> None:
    with Web(server.url) as web:
        for _ in range(3):
            assert web.call(1).body == OK
            leap(server, KEPT_ALIVE / 2)
        leap(server, KEPT_ALIVE / 2)
        assert web.ended()


def test_calls_have_no_time_limit(server: Server, workshop: Workshop) -> None:
    with Web(server.url, keeps_cookies=True) as web, Web(server.url) as clock:
        body = request(EXECUTE, connect(web), "Wait", "8,done")
        web.send(web.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        end_of(server, clock)
        leap(server, max(stage.seconds for stage in Stage if stage is not Stage.WORK))
        assert clock.ended()
        assert still_open(web)
        workshop.gate.set()
        assert web.answer().result == "8,done"


def greedy(server: Server, result: int) -> Web:
    """Return a client that has requested a large result and does not read it."""
    web = Web(server.url, keeps_cookies=True)
    handle = connect(web)
    web.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 100_000)
    other_end = end_of(server, web).transport.get_extra_info("socket")
    other_end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 100_000)  # the kernel does not buffer the whole response
    body = request(EXECUTE, handle, "Large", f"3,{result}")
    web.send(web.head(body, Connection="close") + body.encode())
    return web


def test_a_response_that_is_not_read(server: Server) -> None:
    before = len(list(DESCRIPTORS.iterdir()))
    web = greedy(server, 6_000_000)
    select.select([web.socket], [], [], PATIENCE)  # the response has begun
    leap(server, Stage.LEAVING.seconds / 2)
    assert len(list(DESCRIPTORS.iterdir())) == before + 2

    def closed() -> bool:
        leap(server, Stage.LEAVING.seconds)
        return len(list(DESCRIPTORS.iterdir())) == before + 1  # only the client's end is left

    until(closed)
    with pytest.raises((EOFError, ConnectionError)):
        web.answer()  # it is too late to read the whole response


def test_a_response_that_is_read_slowly(server: Server) -> None:
    web = greedy(server, 6_000_000)
    taken = []
    while part := take(web, 2_000_000):
        taken.append(part)
        leap(server, Stage.LEAVING.seconds * 0.9)  # slightly less than the time limit
    assert sum(taken) > 12_000_000
    assert len(taken) > 4


def take(web: Web, count: int) -> int:
    """Receive at least so many bytes, or up to the end; return their number."""
    taken = 0
    while taken < count and (data := web.socket.recv(65536)):
        taken += len(data)
    return taken


# --- disconnected clients ---------------------------------------------------------------------------------------------


def test_clients_that_disconnect_at_any_point_leave_nothing_behind(server: Server, workshop: Workshop) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        before = len(list(DESCRIPTORS.iterdir()))
        dice = random.Random(7)
        bodies = [
            "Func=1",
            request(EXECUTE, handle, "Echo", "8," + "x" * 100_000),
            request(EXECUTE, handle, "Large", "3,500000"),
        ]
        bodies.append(request(EXECUTE, handle, "EchoLater", "8204,(3,1),(3,5)"))
        for number in range(200):
            one = Web(server.url)
            if dice.random() < 0.8:
                one.cookie = web.cookie
            body = dice.choice(bodies)
            data = one.head(body, **({"Orinkit_Executing": "80"} if dice.random() < 0.5 else {})) + body.encode()
            one.send(data[: dice.randrange(len(data) + 1)] if dice.random() < 0.7 else data * 2)
            if dice.random() < 0.3:
                one.socket.shutdown(socket.SHUT_WR)
            if dice.random() < 0.5:
                one.reset()
            one.close()
            if number % 20 == 0:
                assert works(web, handle, number)
        until(lambda: len(list(DESCRIPTORS.iterdir())) == before)
        assert works(web, handle, 1)


def test_a_client_that_half_closes_after_a_quick_request_is_answered(server: Server) -> None:
    for _ in range(20):
        with Web(server.url) as web:
            web.send(web.head("Func=1") + b"Func=1")
            web.socket.shutdown(socket.SHUT_WR)
            assert web.answer().body == OK
            assert web.ended()


# --- bytes after a request --------------------------------------------------------------------------------------------


def whole(web: Web, body: str) -> bytes:
    return web.head(body) + body.encode()


@pytest.mark.parametrize("secure", [False, True], ids=["http", "https"])
@pytest.mark.parametrize("later", [False, True], ids=["together", "later"])
@pytest.mark.parametrize(
    "behind", ["nothing", "a line end", "a letter", "a header", "a request", "40 requests", "60 KiB"]
)
def test_a_disconnection_is_detected_regardless_of_bytes_after_the_call(
    workshop: Workshop,
    certificate: tuple[Path, Path],
    behind: str,
    later: bool,
    secure: bool,
) -> None:
    cert, key = certificate
    options = HttpOptions(cert=str(cert), key=str(key)) if secure else HttpOptions()
    context = ssl.create_default_context(cafile=str(cert)) if secure else None
    with orinkit.serve(workshop, f"{'https' if secure else 'http'}://127.0.0.1:0", http=options) as server:
        web = Web(server.url, keeps_cookies=True, context=context)
        handle = connect(web)
        web.call(GET_VARIABLE, handle, "kept", "")
        call, next_one = (
            whole(web, request(*each)) for each in ((EXECUTE, handle, "Wait"), (GET_VARIABLE, handle, "v"))
        )
        more = {
            "nothing": b"",
            "a line end": b"\r\n",
            "a letter": b"P",
            "a header": next_one[:-10],
            "a request": next_one,
            "40 requests": next_one * 40,
            "60 KiB": web.head("x" * 60_000) + b"Func=1,Arg1=" + b"x" * 59_988,
        }[behind]
        web.send(call if later else call + more)
        assert workshop.at_work.acquire(timeout=PATIENCE)
        if later:
            for piece in (more[: len(more) // 2], more[len(more) // 2 :]):
                web.send(piece)
        web.close()
        forget_broken(server)
        assert workshop.cancelled.acquire(timeout=PATIENCE)
        until(lambda: server.clients == 0)
        assert (workshop.made, workshop.released) == (["kept"], ["kept", "Controller"])


def test_a_disconnection_is_detected_if_the_client_offers_http_2(server: Server, workshop: Workshop) -> None:
    """Java programs offer it with each request, and send header and body separately."""
    for number in range(5):
        web = Web(server.url, keeps_cookies=True)
        body = request(EXECUTE, connect(web), "Wait")
        web.send(web.head(body, Connection="Upgrade, HTTP2-Settings", Upgrade="h2c", HTTP2_Settings="AAEAAEAA"))
        with Web(server.url) as other:
            assert other.call(1).body == OK  # so the first header has been read
        web.send(body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        web.close()
        forget_broken(server)
        assert workshop.cancelled.acquire(timeout=PATIENCE), number


@pytest.mark.parametrize("behind", [b"\r\n", b"P", b"Func=1"])
def test_bytes_after_the_last_request_do_not_prevent_its_response(
    server: Server, workshop: Workshop, behind: bytes
) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        body = request(EXECUTE, connect(web), "Wait", "3,1")
        web.send(web.head(body, Connection="close") + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        for _ in range(3):
            web.send(behind)
        workshop.gate.set()
        assert web.answer().result == "3,1"
        assert web.ended()


def test_quick_requests_are_all_answered_if_the_client_half_closes(server: Server) -> None:
    for _ in range(20):
        with Web(server.url) as web:
            web.send(whole(web, "Func=1") * 5)
            web.socket.shutdown(socket.SHUT_WR)
            assert web.rest().count(b"HTTP/1.1 200") == 5


def echoes(web: Web, handle: int, texts: list[str]) -> bytes:
    """Return the concatenated requests for all texts."""
    return b"".join(whole(web, request(EXECUTE, handle, "Echo", f"8,{text}")) for text in texts)


@pytest.mark.parametrize("longest", [1, 7, 300, 5_000])
def test_requests_in_odd_pieces_are_answered_in_order(server: Server, workshop: Workshop, longest: int) -> None:
    texts = [str(number) * (number % 9) for number in range(20 * min(longest, 10))]
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        data = whole(web, request(EXECUTE, handle, "Wait", "8,first")) + echoes(web, handle, texts)
        dice = random.Random(7)

        def send() -> None:
            place = 0
            while place < len(data):
                count = dice.randint(1, longest)
                web.send(data[place : place + count])
                place += count

        sender = threading.Thread(target=send)
        sender.start()
        assert workshop.at_work.acquire(timeout=PATIENCE)
        if longest < 300:
            sender.join(PATIENCE)  # all requests arrive during the first call; otherwise some of them
        workshop.gate.set()
        assert [web.answer().result for _ in range(len(texts) + 1)] == ["8,first", *(f"8,{text}" for text in texts)]
        sender.join(PATIENCE)
        assert works(web, handle, 1)


def test_a_flood_of_requests_during_a_call_is_not_read_and_answered_afterwards(
    server: Server, workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffered = [0]

    receive = LimitedProtocol.data_received

    def received(connection: LimitedProtocol, data: bytes) -> None:
        receive(connection, data)
        buffered.append(connection._held())

    monkeypatch.setattr(LimitedProtocol, "data_received", received)
    texts = [f"{number} " + "x" * (30_000 if number % 3 else 100_000) for number in range(300)]
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        web.send(whole(web, request(EXECUTE, handle, "Wait", "8,first")))
        assert workshop.at_work.acquire(timeout=PATIENCE)
        web.socket.settimeout(3 * PATIENCE)  # for all requests together
        sender = threading.Thread(target=web.send, args=(echoes(web, handle, texts),))
        sender.start()
        until(lambda: max(buffered) >= HELD)
        assert server.clients == 1
        with Web(server.url) as other:  # other clients do not wait for that
            for _ in range(20):
                assert other.call(1).body == OK
        assert max(buffered) < HELD + 65536
        workshop.gate.set()
        assert web.answer().result == "8,first"
        for text in texts:
            assert web.answer().result == f"8,{text}"
        sender.join(3 * PATIENCE)
        assert max(buffered) < HELD + 2 * 65536
        assert works(web, handle, 1)


# --- TLS --------------------------------------------------------------------------------------------------------------


def test_incomplete_handshakes_do_not_keep_others_out(workshop: Workshop, certificate: tuple[Path, Path]) -> None:
    cert, key = certificate
    trusting = ssl.create_default_context(cafile=str(cert))
    options = HttpOptions(cert=str(cert), key=str(key))
    with orinkit.serve(workshop, "https://127.0.0.1:0", clients=16, http=options) as server:
        with Web(server.url, keeps_cookies=True, context=trusting) as web:
            handle = connect(web)
            slow = []
            for number in range(150):
                one = Web(server.url)
                one.send((b"", b"\x16", b"\x16\x03\x01\x02\x00\x01", b"\0\0")[number % 4])
                slow.append(one)
                if number % 10 == 0:
                    assert works(web, handle, number)
            with Web(server.url, context=trusting) as late:
                assert late.call(1).body == OK
            assert sum(map(still_open, slow)) <= 64
            with Web(server.url) as one:
                with Web(server.url, context=trusting) as later:
                    assert later.call(1).body == OK  # so the previous connection has been accepted
                assert still_open(one)
                leap(server, tls._HANDSHAKE_TIMEOUT)
                assert one.ended()
            assert works(web, handle, 1)
        one = Web(server.url)  # its handshake is incomplete when the server closes
        one.send(b"\x16\x03\x01")
    assert one.ended()


def test_tls_clients_that_disconnect(workshop: Workshop, certificate: tuple[Path, Path]) -> None:
    cert, key = certificate
    trusting = ssl.create_default_context(cafile=str(cert))
    options = HttpOptions(cert=str(cert), key=str(key))
    with orinkit.serve(workshop, "https://127.0.0.1:0", http=options) as server:
        before = len(list(DESCRIPTORS.iterdir()))
        dice = random.Random(7)
        for _ in range(60):
            one = Web(server.url, context=trusting if dice.random() < 0.7 else None)
            if dice.random() < 0.5:
                one.send(one.head("Func=1") + b"Func=1"[: dice.randrange(7)])
            if dice.random() < 0.5:
                one.reset()
            one.close()
        until(lambda: len(list(DESCRIPTORS.iterdir())) == before)
        with Web(server.url, context=trusting) as web:
            assert web.call(1).body == OK


# --- logs -------------------------------------------------------------------------------------------------------------


def test_a_flood_of_invalid_requests_causes_one_warning(
    server: Server, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "_QUIET", LONG)
    caplog.set_level(logging.INFO)
    for _ in range(30):
        with Web(server.url) as web:
            web.send(b"\0\0\0\r\n\r\n")
            assert web.answer().status == 400
    assert len([record for record in caplog.records if record.levelno >= logging.WARNING]) == 1


def test_calls_from_many_threads_over_connections_of_their_own(server: Server) -> None:
    codes: list[int] = []

    def client() -> None:
        codes.extend(curl(server.url, 1).code for _ in range(20))

    threads = [threading.Thread(target=client) for _ in range(10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert len(codes) == 200
    assert set(codes) <= {0, hresult.E_MAX_CONNECT}  # each client begins a session: the limit is 16
