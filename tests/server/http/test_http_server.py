"""The e-CAP server over HTTP, tested with raw bytes."""

from __future__ import annotations

import asyncio
import logging
import re
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit.bcap.server import LARGE
from orinkit.core import hresult, i18n
from orinkit.core.errors import ConnectFailed, InvalidValue
from orinkit.ecap.message import EcapRequest, read_request
from orinkit.server import aio_server
from orinkit.server.http import app
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server
from orinkit.values.codec import PacketLimits
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Recorder, Workshop
from support.leaping import leap
from support.waiting import PATIENCE, until
from support.web import (
    EXECUTE,
    FORM,
    GARBAGE,
    GET,
    GET_VARIABLE,
    OK,
    PUT,
    Web,
    connect,
    request,
)


@pytest.fixture(autouse=True)
def _all_are_closed(no_errors_are_logged: None) -> Iterator[None]:
    yield
    Web.close_all()


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve([workshop, VirtualRC8()], "http://127.0.0.1:0") as served:
        yield served


@pytest.fixture
def web(server: Server) -> Iterator[Web]:
    with Web(server.url, keeps_cookies=True) as client:
        yield client


# --- calls ------------------------------------------------------------------------------------------------------------


def test_a_conversation_over_one_connection(web: Web) -> None:
    answer = web.call(1)
    assert (answer.status, answer.body) == (200, OK)
    assert answer.headers["content-type"] == "text/plain; charset=utf-8"
    assert re.fullmatch(
        rf"orinkit-{web.place.rpartition(':')[2]}=[\w-]{{20,}}; HttpOnly; SameSite=Strict; Path=/",
        answer.headers["set-cookie"],
    )
    assert web.call(3, "", "CaoProv.DENSO.VRC", "localhost", "").body == b"0x00000000,3,2"
    assert web.call(GET_VARIABLE, 2, "I1", "").body == b"0x00000000,3,3"
    assert web.call(PUT, 3, "3,1234").body == OK
    answer = web.call(GET, 3)
    assert answer.body == b"0x00000000,3,1234"
    assert "set-cookie" not in answer.headers
    assert web.call(111, 3).body == OK
    assert web.call(GET, 3).body == b"0x80070006"
    assert web.call(2).body == OK


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ("Func=17,Arg1={h},Arg2=Echo,Arg3=8,日本語", "8,日本語"),
        ("Func=17&Arg1={h}&Arg2=Echo&Arg3=8%2C%E6%97%A5%e6%9c%ac", "8,日本"),
        ("func = 17 , arg3=3%2C5,ARG2=Echo,Arg1=0x{h:x}", "3,5"),
        ("Func=17,Arg1=3%2C{h},Arg2=Echo,Arg3=8,a,b&Arg4=", "8,a,b"),
        ("\ufeffFunc=17,Arg1={h},Arg2=Echo,Arg3=\r\n", ""),
        ("Func=17%2CArg1%3D{h}%2CArg2%3DEcho%2CArg3%3D2%2C7", "2,7"),
    ],
)
def test_bodies_as_clients_write_them(web: Web, body: str, wanted: str) -> None:
    handle = connect(web)
    assert web.ask(body.format(h=handle)).result == wanted


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("", hresult.E_INVALIDARG),
        ("Func=", hresult.E_INVALIDARG),
        ("Func=x", hresult.E_INVALIDARG),
        ("Func=1&Func=1", hresult.E_INVALIDARG),
        ("Func=1&What=1", hresult.E_INVALIDARG),
        ("Func=9,Arg1=%zz,Arg2=I1", hresult.E_INVALIDARG),
        (b"Func=1,Arg1=\x93\xfa", hresult.E_INVALIDARG),
        ("Func=0", hresult.E_NOTIMPL),
        ("Func=138", hresult.E_NOTIMPL),
        ("Func=-1", hresult.E_NOTIMPL),
        ("Func=101,Arg1=77", hresult.E_HANDLE),
        ("Func=101,Arg1=x", hresult.E_INVALIDARG),
        ("Func=1,Arg1=WDT=5", hresult.E_INVALIDARG),
        ("Func=3,Arg2=Nobody", hresult.E_CAO_PROV_INVALID),
    ],
)
def test_invalid_requests_return_a_code_and_a_message(web: Web, body: str | bytes, code: int) -> None:
    answer = web.ask(body)
    assert (answer.code, answer.body) == (code, b"0x%08X" % code)
    assert answer.detail
    assert answer.headers["orinkit-detail"].isascii()
    assert web.call(1).body == OK


def test_the_detail_is_translated_and_short(web: Web) -> None:
    assert not {"orinkit-detail", "orinkit-error"} & set(web.call(1).headers)
    assert web.ask("Func=200").headers["orinkit-error"].startswith("0x80004001 E_NOTIMPL: ")
    assert web.ask("Func=x").headers["orinkit-detail"] == "Func: 'x' is not a number. Try: Func=3"
    i18n.use("ja")
    answer = web.ask("Func=x")
    assert "数値ではありません" in answer.detail
    assert "%E6%95%B0%E5%80%A4" in answer.headers["orinkit-detail"]
    handle = connect(web)
    assert len(web.call(GET_VARIABLE, handle, "\n100%").headers.get("orinkit-detail", "")) == 0
    long = web.call(3, "", "x" * 5000, "", "")
    assert len(long.detail) <= 500


@pytest.mark.parametrize("text", ["100%", "a\r\nSet-Cookie: x=1", "\ud800", "\0\x7f"])
def test_no_text_corrupts_the_header(web: Web, text: str) -> None:
    body = b"Func=3,Arg2=" + text.encode("utf-8", "surrogatepass").replace(b"%", b"%25")
    answer = web.ask(body)
    assert answer.code == hresult.E_CAO_PROV_INVALID
    assert "set-cookie" not in answer.headers or answer.headers["set-cookie"].startswith("orinkit-")
    assert web.call(1).body == OK


def test_an_exception_in_the_device_returns_e_fail_and_its_message(web: Web, caplog: pytest.LogCaptureFixture) -> None:
    handle = connect(web)
    for command in ("Crash", "CrashLater"):
        answer = web.call(EXECUTE, handle, command, "")
        assert (answer.code, answer.detail) == (hresult.E_FAIL, "RuntimeError: the device is broken")
    assert web.call(EXECUTE, handle, "CrashBlocking", "").code == hresult.E_FAIL
    answer = web.call(EXECUTE, handle, "Fail", f"3,{hresult.TARGET_OUT_OF_RANGE - 2**32}")
    assert answer.code == hresult.TARGET_OUT_OF_RANGE
    assert web.call(EXECUTE, handle, "Echo", "3,1").result == "3,1"
    assert len([record for record in caplog.records if record.levelno >= logging.ERROR]) == 3
    caplog.clear()


def test_results_of_other_types_are_returned_unchanged(web: Web) -> None:
    handle = connect(web)
    for text in ("4,0.1", "17,255", "8197,", "1,", "8204,(4,0.5),(8204,(8,x))", "7,2026-11-21 10:00:00"):
        assert web.call(EXECUTE, handle, "Echo", text).result == text


# --- HTTP -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method", ["GET", "HEAD", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "post", "X"]
)
def test_other_methods(web: Web, method: str) -> None:
    answer = web.ask("", method)
    assert (answer.status, answer.headers["allow"]) == (405, "POST")
    if method == "GET":
        assert answer.body.isascii() is False
        assert b"curl" in answer.body
    if method == "CONNECT":
        assert web.ended()
    else:
        assert web.call(1).body == OK


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        ("", 200),
        (FORM, 200),
        ("APPLICATION/X-WWW-Form-Urlencoded", 200),
        (f"{FORM}; charset=utf-8", 200),
        (f'{FORM} ; Charset="UTF-8"', 200),
        (f"{FORM};boundary=x", 200),
        (f"{FORM}; charset=Shift_JIS", 200),
        (f"{FORM}; charset=euc-jp", 415),
        ("text/plain", 415),
        ("application/json", 415),
        ("multipart/form-data; boundary=x", 415),
        (";", 415),
        (f"{FORM}x", 415),
    ],
)
def test_content_types(web: Web, kind: str, status: int) -> None:
    for _ in range(2):  # the second time from the cache
        assert web.ask("Func=1", Content_Type=kind).status == status
    assert web.call(1).body == OK


def test_an_encoded_body_is_refused(web: Web) -> None:
    assert web.ask("Func=1", Content_Encoding="gzip").status == 415
    assert web.ask("Func=1", Content_Encoding="identity").status == 200


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1", 200),
        ("127.0.0.1:1", 200),
        ("[::1]:8080", 200),
        ("[::1]", 200),
        ("192.168.0.1:8080", 200),
        ("localhost", 200),
        ("LocalHost:80", 200),
        ("robot.localhost:8080", 200),
        ("localhost.:80", 200),
        (socket.gethostname(), 200),
        ("cell-7.example:80", 200),
        ("CELL-7.EXAMPLE", 200),
        ("evil.example", 421),
        ("evil.example:80", 421),
        ("127.0.0.1.evil.example", 421),
        ("localhost.evil.example", 421),
        ("evil-localhost", 421),
        ("::1", 421),
        ("[127.0.0.1]", 421),
        ("[evil.example]", 421),
        ("[::1]evil.example", 421),
        ("[::1]evil.example:80", 421),
        ("127.1", 421),
        ("a b", 421),
        ("]", 421),
        ("[", 421),
        (":", 421),
        ("\xe6\x97\xa5", 421),
    ],
)
def test_hosts(workshop: Workshop, host: str, status: int) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", http=HttpOptions(hosts=("Cell-7.example.",))) as server,
        Web(server.url) as web,
    ):
        for _ in range(2):
            assert web.ask("Func=1", Host=host).status == status


@pytest.mark.parametrize(
    ("origin", "host", "status"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", 200),
        ("http://LOCALHOST:8080", "localhost:8080", 200),
        ("http://localhost", "localhost", 200),
        ("http://localhost:80", "localhost", 200),
        ("http://localhost", "localhost:80", 200),
        ("https://localhost", "localhost", 200),  # a proxy that terminates TLS
        ("http://[::1]:8080", "[::1]:8080", 200),
        ("null", "localhost", 403),
        ("http://localhost:8081", "localhost:8080", 403),
        ("http://evil.example", "localhost", 403),
        ("http://127.0.0.1.evil.example:8080", "127.0.0.1:8080", 403),
        ("http://localhost", "127.0.0.1", 403),
        ("localhost", "localhost", 403),
        ("http://", "localhost", 403),
        ("file://", "localhost", 403),
        ("chrome-extension://abcdef", "localhost", 403),
    ],
)
def test_web_pages_of_other_sites_are_refused(web: Web, origin: str, host: str, status: int) -> None:
    answer = web.ask("Func=1", Origin=origin, Host=host)
    assert answer.status == status
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_a_preflight_of_another_site_is_refused(web: Web) -> None:
    answer = web.ask("", "OPTIONS", Origin="http://evil.example", Access_Control_Request_Method="POST")
    assert answer.status == 403
    assert not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize(
    ("shown", "status"),
    [
        ("", 401),
        ("Bearer", 401),
        ("Bearer secre", 401),
        ("Bearer secrets", 401),
        ("Bearer Secret", 401),
        ("Basic secret", 401),
        ("secret", 401),
        ("Bearer s\xe9cret", 401),
        ("Bearer secret", 200),
        ("bearer  secret", 200),
    ],
)
def test_tokens(workshop: Workshop, shown: str, status: int) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", http=HttpOptions(token="secret")) as server,
        Web(server.url) as web,
    ):
        answer = web.ask("Func=1", Authorization=shown)
        assert answer.status == status
        if status == 401:
            assert answer.headers["www-authenticate"] == "Bearer"
            assert b"secret" not in answer.body
            assert server.clients == 0
        assert web.ask("Func=1", Authorization="Bearer secret").status == 200


def test_error_statuses_have_one_translated_line(web: Web) -> None:
    for lang in ("en", "ja"):
        i18n.use("ja" if lang == "ja" else "en")
        for answer in (
            web.ask("Func=1", Content_Type="text/plain"),
            web.ask("Func=1", Host="evil.example"),
            web.ask("Func=1", Origin="null"),
            web.ask("", "PUT"),
        ):
            assert answer.headers["content-type"] == "text/plain; charset=utf-8"
            assert answer.body.endswith(b"\n")
            assert answer.body.count(b"\n") == 1
            assert answer.body.isascii() is (lang == "en")


def test_bodies_of_any_length_up_to_the_limit(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", limits=PacketLimits(packet=5000)) as server,
        Web(server.url, keeps_cookies=True) as web,
    ):
        handle = connect(web)
        body = request(EXECUTE, handle, "Echo", "8,")
        whole = body + "x" * (5000 - len(body))
        assert web.ask(whole).code == 0
        assert web.ask(whole + "x").status == 413
        assert web.ask("x" * 9_900).status == 413
        assert web.ask("Func=1").body == OK  # the body that was too long has been read
        assert web.ask("Func=1" + "x" * 20_000).status == 413
        assert web.ended()


def chunked(*chunks: bytes) -> bytes:
    return b"".join(b"%x\r\n%s\r\n" % (len(chunk), chunk) for chunk in (*chunks, b""))


def test_chunked_bodies(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", limits=PacketLimits(packet=5000)) as server,
        Web(server.url) as web,
    ):
        head = web.head(Content_Length="", Transfer_Encoding="chunked")
        web.send(head + chunked(b"Fu", b"nc=", b"1"))
        assert web.answer().body == OK
        web.send(head + b"2;ext=1\r\nFu\r\n4\r\nnc=1\r\n0\r\nTrailer: x\r\n\r\n")
        assert web.answer().body == OK
        for byte in head + chunked(b"Func", b"=1"):
            web.send(bytes([byte]))
        assert web.answer().body == OK
        web.send(head + chunked(*[b"x" * 100] * 60))
        assert web.answer().status == 413
        web.send(head + chunked(b"Func=1"))
        assert web.answer().body == OK
        web.send(head + chunked(*[b"x" * 50_000] * 4))
        assert web.answer().status == 413
        assert web.ended()


def test_expect_100_continue(server: Server, web: Web) -> None:
    web.send(web.head("Func=1", Expect="100-continue"))
    assert web.answer().status == 100
    web.send(b"Func=1")
    assert web.answer().body == OK
    web.send(web.head("Func=1", Expect="100-continue") + b"Func=1")  # a client that does not wait
    assert web.answer().status == 100
    assert web.answer().body == OK
    with Web(server.url) as refused:
        refused.send(refused.head("Func=1", Expect="100-continue", Content_Type="text/plain"))
        assert refused.answer().status == 415  # sent before the body
        assert refused.ended()
    with Web(server.url) as long:
        long.send(long.head(Content_Length="99999999", Expect="100-continue"))
        assert long.answer().status == 413
        assert long.ended()


def test_http_1_0_without_a_host(web: Web) -> None:
    web.send(b"POST / HTTP/1.0\r\nContent-Length: 6\r\n\r\nFunc=1")
    answer = web.answer()
    assert (answer.body, answer.headers["connection"]) == (OK, "close")
    assert web.ended()


@pytest.mark.parametrize(
    "head",
    [
        "POST http://127.0.0.1:8080/a/b?c HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        "POST * HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        "POST /%zz%00?%ff#x HTTP/1.1\r\nhOST:127.0.0.1\r\n",
        "POST //../.. HTTP/1.1\r\nHOST:    127.0.0.1   \r\n",
        "POST / HTTP/1.1\nHost: 127.0.0.1\n",
        "POST / HTTP/1.1\r\nHost:\r\n",
        "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: a\r\n b\r\n",
        "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: x\r\n",
    ],
)
def test_forms_of_a_header(web: Web, head: str) -> None:
    end = "\n" if head.endswith("1\n") else "\r\n"
    for _ in range(2):
        web.send(f"{head}CONTENT-type: {FORM.upper()}{end}content-LENGTH: 6{end}{end}Func=1".encode())
        assert web.answer().body == OK


def test_a_websocket_is_refused(web: Web) -> None:
    answer = web.ask("", "GET", Connection="Upgrade", Upgrade="websocket", Sec_WebSocket_Version="13")
    assert answer.status == 405


def test_connection_close_is_answered_before_closing(server: Server) -> None:
    with Web(server.url) as web:
        web.send(web.head("Func=1", Connection="close") + b"Func=1")
        assert web.answer().headers["connection"] == "close"
        assert web.ended()


def test_pipelined_requests_are_answered_in_order(web: Web) -> None:
    handle = connect(web)
    bodies = [request(EXECUTE, handle, "EchoLater", f"8204,(3,{n}),(3,{n % 3})").encode() for n in range(300)]
    web.send(b"".join(web.head(body) + body for body in bodies))
    assert [web.answer().result for _ in bodies] == [f"3,{n}" for n in range(300)]


@pytest.mark.parametrize("kind", list(GARBAGE))
def test_invalid_requests_do_not_affect_other_clients(server: Server, web: Web, kind: str) -> None:
    handle = connect(web)
    for pause in (False, True):
        with Web(server.url) as bad:
            data = GARBAGE[kind]
            try:
                for piece in (data[: len(data) // 2], data[len(data) // 2 :]) if pause else (data,):
                    bad.send(piece)
                bad.socket.shutdown(socket.SHUT_WR)
                answered = bad.rest()
            except OSError:  # answered and closed while it was sending
                answered = b""
        for status in re.findall(rb"HTTP/1.1 (\d+)", answered):
            assert 100 < int(status) < 500
        assert b"Traceback" not in answered
        assert web.call(EXECUTE, handle, "Echo", "3,1").result == "3,1"


def test_statuses_of_invalid_requests(server: Server) -> None:
    for kind, status in (("no host", 400), ("noise", 400), ("a long header", 431), ("no chunk", 400), ("version", 200)):
        with Web(server.url) as bad:
            data = GARBAGE[kind]
            if kind == "version":
                data = data.removesuffix(b"\r\n") + b"Content-Length: 6\r\n\r\nFunc=1"
            try:
                bad.send(data)
            except OSError:  # answered and closed while it was sending
                pass
            answer = bad.answer()
            assert answer.status == status
            if status != 200:
                assert answer.headers["connection"] == "close"
                assert bad.ended()


def test_the_length_of_a_header(server: Server) -> None:
    for size, status in ((30_000, 200), (32_700, 431), (60_000, 431)):
        with Web(server.url) as web:
            web.send(web.head("Func=1", X_Filler="x" * size) + b"Func=1")
            assert web.answer().status == status


# --- large bodies -----------------------------------------------------------------------------------------------------


def test_large_bodies_and_results(web: Web) -> None:
    handle = connect(web)
    text = "日本語 abc," * 100_000
    assert web.call(EXECUTE, handle, "Echo", f"8,{text}").result == f"8,{text}"
    numbers = "8197," + ",".join(map(str, range(200_000)))
    assert web.call(EXECUTE, handle, "Echo", numbers).result == numbers
    strings = "8200," + ",".join(["a" * 100] * 10_000)
    assert web.call(EXECUTE, handle, "Echo", strings).result == strings
    assert web.call(EXECUTE, handle, "Large", "3,100000").result == "8209" + ",0" * 100_000


def test_a_reply_that_is_too_long(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", limits=PacketLimits(packet=100_000)) as server,
        Web(server.url) as web,
    ):
        handle = connect(web)
        assert web.call(EXECUTE, handle, "Large", "3,49000").code == 0
        assert web.call(EXECUTE, handle, "Large", "3,51000").code == hresult.E_TOO_MUCH_DATA
        assert web.call(EXECUTE, handle, "Large", "3,10").code == 0


def test_a_body_that_takes_long_to_decode_does_not_block_the_server(
    server: Server, web: Web, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread decodes it, so the event loop stays free: quick calls are answered meanwhile."""
    go = threading.Event()

    def read(body: bytes, limits: PacketLimits, *more: Any) -> EcapRequest:
        if len(body) > LARGE:
            assert go.wait(PATIENCE)
        return read_request(body, limits, *more)

    monkeypatch.setattr(app, "read_request", read)
    handle = connect(web)
    body = request(EXECUTE, handle, "Echo", "8197," + ",".join(map(str, range(600_000))))
    done = threading.Event()

    def send() -> None:
        with Web(server.url, keeps_cookies=True) as slow:
            slow.cookie = web.cookie
            slow.socket.settimeout(3 * PATIENCE)
            assert slow.ask(body).code == 0
            done.set()

    sender = threading.Thread(target=send)
    sender.start()
    count = 0
    while not done.is_set() and sender.is_alive():
        assert web.call(EXECUTE, handle, "Echo", "3,1").result == "3,1"
        count += 1
        if count == 100:
            assert not done.is_set()
            go.set()
    sender.join(3 * PATIENCE)
    assert done.is_set()
    assert count > 105  # also while it is decoded, which takes a second


# --- long calls -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["Wait", "Block"])
def test_line_feeds_during_a_call(web: Web, workshop: Workshop, command: str) -> None:
    handle = connect(web)
    body = request(EXECUTE, handle, command, "8,done")
    web.send(web.head(body, Orinkit_Executing="80") + body.encode())
    assert web.line() == b"HTTP/1.1 200 OK"
    headers = {}
    while line := web.line():
        name, _, value = line.decode().partition(": ")
        headers[name.lower()] = value
    assert headers["orinkit-executing"] == "80"
    pieces = web.pieces(headers)
    assert [next(pieces) for _ in range(3)] == [b"\n"] * 3
    workshop.gate.set()
    assert b"".join(pieces).lstrip(b"\n") == OK + b",8,done"
    assert web.call(EXECUTE, handle, "Echo", "3,1").result == "3,1"


def test_calls_that_end_immediately_have_details_and_no_line_feeds(web: Web) -> None:
    handle = connect(web)
    for command, code in (("Echo", 0), ("EchoLater", 0), ("Nothing", hresult.E_NOTIMPL)):
        answer = web.ask(request(EXECUTE, handle, command, "8204,(3,1),(3,1)"), Orinkit_Executing="60000")
        assert (answer.code, answer.headers["orinkit-executing"]) == (code, "60000")
        assert int(answer.headers["content-length"]) == len(answer.body)
        assert not answer.body.startswith(b"\n")
    assert web.ask("Func=x", Orinkit_Executing="400").headers["orinkit-detail"]


@pytest.mark.parametrize("given", ["79", "60001", "x", "-400", "4e2", "9" * 30, "\xb2"])
def test_invalid_intervals_of_line_feeds_are_ignored(web: Web, given: str) -> None:
    assert "orinkit-executing" not in web.ask("Func=1", Orinkit_Executing=given).headers


def test_a_call_that_takes_too_long(web: Web, workshop: Workshop) -> None:
    assert web.call(1, "InvokeTimeout=100").body == OK
    handle = connect(web)
    answer = web.call(EXECUTE, handle, "Wait", "8,late")
    assert answer.code == hresult.E_TIMEOUT
    assert answer.detail == "not completed within 0.1 s"
    answer = web.call(GET_VARIABLE, handle, "slow one")
    assert answer.code == hresult.E_TIMEOUT
    assert not workshop.cancelled.acquire(blocking=False)  # the call continues
    workshop.gate.set()
    assert workshop.let_go.acquire(timeout=PATIENCE)  # its handle was never sent
    assert (workshop.made, workshop.released) == (["slow one"], ["slow one"])
    assert web.call(1).body == OK  # back to the server's own time limit
    assert web.call(GET_VARIABLE, handle, "slow two").code == 0


def test_the_servers_time_out(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "http://127.0.0.1:0", invoke_timeout=1000.0) as server, Web(server.url) as web:
        body = request(EXECUTE, connect(web), "Wait", "")
        web.send(web.head(body, Orinkit_Executing="80") + body.encode())
        while web.line():  # the header is sent with the first line feed
            pass
        assert [web.line() for _ in range(6)] == [b"1", b"", b""] * 2
        leap(server, 900.0)
        assert [web.line() for _ in range(6)] == [b"1", b"", b""] * 2
        leap(server, 100.0)
        rest = b"".join(web.pieces({"transfer-encoding": "chunked"}))
        assert rest.lstrip(b"\n") == b"0x80000900,not completed within 1000 s"


def test_a_client_may_make_eight_calls_at_a_time(server: Server, workshop: Workshop) -> None:
    first = Web(server.url, keeps_cookies=True)
    handle = connect(first)
    others = []
    for number in range(8):
        other = Web(server.url)
        other.cookie = first.cookie
        body = request(EXECUTE, handle, "Wait", f"3,{number}")
        other.send(other.head(body) + body.encode())
        others.append(other)
        assert workshop.at_work.acquire(timeout=PATIENCE)
    answer = first.call(EXECUTE, handle, "Echo", "3,1")
    assert answer.code == hresult.E_BUSY_PROC
    assert "8 calls" in answer.detail
    with Web(server.url) as another:  # another client is not affected
        assert another.call(EXECUTE, connect(another), "Echo", "3,1").code == 0
    workshop.gate.set()
    assert [other.answer().result for other in others] == [f"3,{number}" for number in range(8)]
    assert first.call(EXECUTE, handle, "Echo", "3,1").result == "3,1"
    for each in (first, *others):
        each.close()


# --- start and end of a server ----------------------------------------------------------------------------------------


def test_a_closing_server_answers_the_calls_in_progress(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aio_server, "_GRACE", PATIENCE)
    server = orinkit.serve(workshop, "http://127.0.0.1:0")
    busy, idle, half = (Web(server.url, keeps_cookies=True) for _ in range(3))
    handle = connect(busy)
    connect(idle)
    body = request(EXECUTE, handle, "Wait", "8,done")
    busy.send(busy.head(body) + body.encode())
    assert workshop.at_work.acquire(timeout=PATIENCE)
    half_known = Web(server.url)
    half_known.cookie = busy.cookie
    for each in (half, half_known):
        each.send(each.head("Func=1", Expect="100-continue"))
        assert each.answer().status == 100  # its body is being read
    closing = threading.Thread(target=server.close)
    closing.start()
    assert idle.ended()
    for each in (half, half_known):
        answer = each.answer()
        assert (answer.status, answer.body) == (503, b"the server is closing\n")
    workshop.gate.set()
    assert busy.answer().result == "8,done"
    assert busy.ended()
    closing.join(PATIENCE)
    assert not closing.is_alive()
    assert workshop.released.count("Controller") == 2
    for each in (busy, idle, half, half_known):
        each.close()


def test_a_closing_server_waits_for_a_limited_time(workshop: Workshop) -> None:
    server = orinkit.serve(workshop, "http://127.0.0.1:0")
    clients = [Web(server.url, keeps_cookies=True) for _ in range(3)]
    for client, command in zip(clients, ("Wait", "Block", "Tidy"), strict=True):
        body = request(EXECUTE, connect(client), command, "")
        client.send(client.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
    server.close()
    assert all(client.ended() for client in clients)
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    assert workshop.released.count("Controller") == 3
    for client in clients:
        client.close()


def test_a_closed_server_leaves_nothing_behind(workshop: Workshop) -> None:
    async def session() -> None:
        async with aio.AsyncServer(workshop, "http://127.0.0.1:0") as server:

            def talk() -> None:
                with Web(server.url, keeps_cookies=True) as web:
                    handle = connect(web)
                    body = request(EXECUTE, handle, "Wait", "")
                    web.send(web.head(body) + body.encode())
                    assert workshop.at_work.acquire(timeout=PATIENCE)

            await asyncio.to_thread(talk)
            assert server.clients == 1
        assert server.clients == 0
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        assert not tasks

    asyncio.run(session())


def test_several_listeners_of_one_server(workshop: Workshop) -> None:
    urls = ("http://127.0.0.1:0", "http://127.0.0.1:0/robot", "tcp://127.0.0.1:0")
    with orinkit.serve(workshop, *urls) as server:
        assert server.urls[1].endswith("/robot")
        with Web(server.urls[0]) as one, Web(server.urls[1]) as two:
            assert {connect(one), connect(two)} == {2, 3}  # a handle belongs to one client only
            assert one.call(EXECUTE, 3, "Echo", "").code == hresult.E_HANDLE
            assert server.clients == 2
            with orinkit.connect(server.urls[2], provider="Test.Workshop") as rc:
                assert rc.execute("Echo", 1) == 1


def test_an_address_that_cannot_be_opened(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0") as server,
        pytest.raises(ConnectFailed, match=r"cannot listen on http://127\.0\.0\.1:"),
    ):
        orinkit.serve(workshop, server.url)


@pytest.mark.parametrize(
    "options",
    [
        {"token": "a b"},
        {"token": "日本"},
        {"idle": float("nan")},
        {"idle": 0.0},
        {"idle": 1e9},
        {"hosts": ("",)},
        {"hosts": ("a:80",)},
        {"hosts": ("http://a",)},
        {"hosts": "robot"},
    ],
)
def test_invalid_options(options: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue):
        HttpOptions(**options)


# --- TLS --------------------------------------------------------------------------------------------------------------


def test_https(workshop: Workshop, certificate: tuple[Path, Path]) -> None:
    cert, key = certificate
    options = HttpOptions(cert=str(cert), key=str(key))
    trusting = ssl.create_default_context(cafile=str(cert))
    with orinkit.serve(workshop, "https://127.0.0.1:0", "http://127.0.0.1:0", http=options) as server:
        assert server.url.startswith("https://127.0.0.1:")
        with Web(server.url, keeps_cookies=True, context=trusting) as web:
            assert web.call(1).headers["set-cookie"].endswith("; Path=/; Secure")
            handle = connect(web)
            text = "8," + "x" * 3_000_000
            assert web.call(EXECUTE, handle, "Echo", text).result == text
            for number in range(20):
                assert web.call(EXECUTE, handle, "EchoLater", f"8204,(3,{number}),(3,1)").result == f"3,{number}"
        with Web(server.url) as plain:  # HTTP on the port of HTTPS
            plain.send(plain.head("Func=1") + b"Func=1")
            assert not plain.rest().startswith(b"HTTP/1.1 200")
        with Web(server.urls[1]) as web:
            assert "Secure" not in web.call(1).headers["set-cookie"]


def test_certificates_that_cannot_be_used(workshop: Workshop, certificate: tuple[Path, Path], tmp_path: Path) -> None:
    cert, key = map(str, certificate)
    both = tmp_path / "both.pem"
    both.write_text(Path(cert).read_text() + Path(key).read_text())
    locked = tmp_path / "locked.pem"
    subprocess.run(
        ["openssl", "ec", "-in", key, "-aes128", "-passout", "pass:x", "-out", locked], check=True, capture_output=True
    )
    noise = tmp_path / "noise.pem"
    noise.write_bytes(b"noise")
    for options, found in (
        (HttpOptions(), "requires a certificate"),
        (HttpOptions(cert=cert), "cert.pem"),
        (HttpOptions(cert=key, key=cert), "cert.pem"),
        (HttpOptions(cert=cert, key=str(locked)), "protected by a password"),
        (HttpOptions(cert=str(noise), key=key), "noise.pem"),
        (HttpOptions(cert=str(tmp_path / "none.pem")), "none.pem"),
    ):
        with pytest.raises(ConnectFailed, match=found):
            orinkit.serve(workshop, "https://127.0.0.1:0", http=options)
    with orinkit.serve(workshop, "https://127.0.0.1:0", http=HttpOptions(cert=str(both))) as server:
        assert server.url.startswith("https")


# --- devices ----------------------------------------------------------------------------------------------------------


def test_every_device_function_is_reached() -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, "http://127.0.0.1:0") as server, Web(server.url) as web:
        controller = web.call(3, "RC", "Test.Recorder", "m", "o").handle
        robot = web.call(7, controller, "Arm", "").handle
        assert web.call(72, robot, 1, "8,@P P(1,2,3)", "NEXT").body == OK
        assert recorder.calls[-1].arguments == (1, "@P P(1,2,3)", "NEXT")
        assert web.call(74, robot, -1, "12.5").body == OK
        assert recorder.calls[-1].arguments == (-1, 12.5)
        assert web.call(71, robot, "").code == 0
    until(lambda: recorder.calls[-1].function == "Controller_Disconnect")
