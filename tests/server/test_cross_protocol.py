"""Bytes of another protocol on a b-CAP port: nothing that a web page can make a browser send is executed."""

from __future__ import annotations

import logging
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

import orinkit
from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.gateway import RemoteProvider
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider
from support.peers import RawClient
from support.waiting import PATIENCE, until

FLOOD = 64 * 1024 * 1024


def packets(*calls: tuple[Function[..., Any], *tuple[Any, ...]]) -> bytes:
    """Return the packets of calls; handles are known in advance, as they count up from 2."""
    return b"".join(
        packet.encode(Packet(serial, function.id, list(arguments)))
        for serial, (function, *arguments) in enumerate(calls, 1)
    )


ROBOT = packets(
    (f.service_start, ""),
    (f.controller_connect, "", "CaoProv.DENSO.VRC", "localhost", ""),  # 2
    (f.controller_get_variable, 2, "IO128", ""),  # 3
    (f.variable_put_value, 3, True),
    (f.controller_get_robot, 2, "Arm", ""),  # 4
    (f.robot_execute, 4, "Takearm", [0, 0]),
    (f.robot_execute, 4, "Motor", [1, 0]),
)
PENDANT = packets(
    (f.service_start, ""),
    (f.controller_connect, "", "CaoProv.orinkit.Pendant", "localhost", ""),
    (f.controller_execute, 2, "EmergencyStop", True),
    (f.controller_execute, 2, "Mode", "manual"),
)


def post(body: bytes, *, port: int, method: str = "POST") -> bytes:
    """Return the request of Chromium for ``fetch(url, {method: "POST", mode: "no-cors", body: new Blob([...])})``."""
    return (
        f"{method} / HTTP/1.1\r\n"
        f"Host: 127.0.0.1:{port}\r\n"
        "Connection: keep-alive\r\n"
        f"Content-Length: {len(body)}\r\n"
        'sec-ch-ua-platform: "Linux"\r\n'
        "User-Agent: Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/140.0.0.0 Safari/537.36\r\n"
        'sec-ch-ua: "Chromium";v="140", "Not=A?Brand";v="24"\r\n'
        "Content-Type: text/plain\r\n"
        "sec-ch-ua-mobile: ?0\r\n"
        "Accept: */*\r\n"
        "Origin: http://evil.example\r\n"
        "Sec-Fetch-Site: cross-site\r\n"
        "Sec-Fetch-Mode: no-cors\r\n"
        "Sec-Fetch-Dest: empty\r\n"
        "Referer: http://evil.example/\r\n"
        "Accept-Encoding: gzip, deflate, br, zstd\r\n"
        "Accept-Language: en-US,en;q=0.9\r\n"
        "\r\n"
    ).encode() + body


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8()
    yield device
    device.close()


@contextmanager
def served(kind: str, rc8: VirtualRC8) -> Iterator[Server]:
    """Serve b-CAP by a controller, a gateway or a pendant."""
    if kind == "server":
        with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
            yield server
    elif kind == "pendant":
        with orinkit.serve(ControlProvider(rc8), "tcp://127.0.0.1:0") as server:
            yield server
    else:
        with (
            orinkit.serve(rc8, "tcp://127.0.0.1:0") as behind,
            orinkit.serve(RemoteProvider(behind.url), "tcp://127.0.0.1:0") as server,
        ):
            yield server


def port_of(server: Server) -> int:
    return int(server.url.rpartition(":")[2])


def state_of(rc8: VirtualRC8) -> dict[str, Any]:
    """Return the state that an attack could change."""
    return {**rc8.pendant.status(), "io": rc8.state.variables.points(128, 8)}


def end_of(client: RawClient) -> bytes:
    """Return the bytes that a server sends before it closes the connection."""
    received = b""
    try:
        while data := client.socket.recv(65536):
            received += data
    except ConnectionError:  # closed by the server before it has read all bytes
        pass
    return received


def test_the_attack_would_work(rc8: VirtualRC8) -> None:
    """The packets are valid: without the HTTP header before them they are executed."""
    with served("server", rc8) as server, RawClient(server.url) as raw:
        raw.send(ROBOT)
        assert [raw.packet().code for _ in range(7)] == [hresult.S_OK] * 7
        assert state_of(rc8)["io"] == 1
        assert state_of(rc8)["arm_holder"]


def test_the_pendant_requires_its_secret_too(rc8: VirtualRC8) -> None:
    """A program of another account on the same machine can send valid packets to it, but press no button."""
    with served("pendant", rc8) as server, RawClient(server.url) as raw:
        before = state_of(rc8)
        raw.send(PENDANT)
        assert [raw.packet().code for _ in range(4)] == [
            hresult.S_OK, hresult.E_ACCESSDENIED, hresult.E_HANDLE, hresult.E_HANDLE
        ]  # fmt: skip
        assert state_of(rc8) == before


@pytest.mark.parametrize("method", ["POST", "OPTIONS", "PUT"])
@pytest.mark.parametrize("kind", ["server", "gateway", "pendant"])
def test_a_web_page_cannot_call_anything(
    rc8: VirtualRC8, caplog: pytest.LogCaptureFixture, kind: str, method: str
) -> None:
    caplog.set_level(logging.INFO, "orinkit.server")
    with served(kind, rc8) as server:
        before = state_of(rc8)
        with RawClient(server.url) as browser:
            browser.send(post(PENDANT if kind == "pendant" else ROBOT, port=port_of(server), method=method))
            received = end_of(browser)
        assert received in (b"", packet.encode(Packet(0, hresult.E_INVALIDRCVPACKET, [None])))
        until(lambda: server.clients == 0)
        assert state_of(rc8) == before
        warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
        assert len(warnings) == 1
        assert f"'{method} / HTTP/1.1\\r\\n" in warnings[0]
        assert "This is HTTP" in warnings[0]
        with RawClient(server.url) as other:
            assert other.ask(f.service_start.id, "") is None


@pytest.mark.parametrize("size", [1, 100, 1000])
def test_a_request_in_pieces_cannot_call_anything(rc8: VirtualRC8, size: int) -> None:
    data = post(ROBOT, port=5007)
    with served("server", rc8) as server:
        before = state_of(rc8)
        with RawClient(server.url) as browser:
            try:
                for begin in range(0, len(data), size):
                    browser.send(data[begin : begin + size])
            except ConnectionError:
                pass
            end_of(browser)
        until(lambda: server.clients == 0)
        assert state_of(rc8) == before


def test_packets_after_an_invalid_byte_are_not_executed(rc8: VirtualRC8) -> None:
    """A connection with valid packets has lost the packet boundary."""
    with served("server", rc8) as server, RawClient(server.url) as raw:
        assert raw.ask(f.service_start.id, "") is None
        before = state_of(rc8)
        raw.send(b"\0" + ROBOT)
        end_of(raw)
        until(lambda: server.clients == 0)
        assert state_of(rc8) == before


def test_a_flood_of_invalid_bytes_is_not_read(rc8: VirtualRC8) -> None:
    """A client of another protocol can send no more than the kernel's buffers hold."""
    with served("server", rc8) as server, RawClient(server.url) as raw:
        sent = 0
        with pytest.raises((ConnectionError, TimeoutError)):
            while sent < FLOOD:
                raw.send(bytes(65536))
                sent += 65536
        assert sent < FLOOD
        until(lambda: server.clients == 0)


def test_many_clients_of_another_protocol_cause_one_warning(rc8: VirtualRC8, caplog: pytest.LogCaptureFixture) -> None:
    """One warning in 10 s; each further connection is logged at the level DEBUG, at most once."""
    caplog.set_level(logging.DEBUG, "orinkit.server")
    with served("server", rc8) as server:
        for _ in range(20):
            with RawClient(server.url) as raw:
                raw.send(post(ROBOT, port=5007) * 3)
                end_of(raw)
        until(lambda: server.clients == 0)
    logged = [record for record in caplog.records if "This is HTTP" in record.getMessage()]
    assert len(logged) <= 20
    assert sum(record.levelno == logging.WARNING for record in logged) == 1


# A page in a real Chromium: tests/attacks/test_web_page.py


@contextmanager
def all_ports(rc8: VirtualRC8) -> Iterator[dict[int, bytes]]:
    """Serve a controller, a gateway to it and its pendant; yield the packets to send to each port."""
    with ExitStack() as stack:
        ports = {}
        for kind in ("server", "gateway", "pendant"):
            server = stack.enter_context(served(kind, rc8))
            ports[port_of(server)] = PENDANT if kind == "pendant" else ROBOT
        yield ports


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_curl_cannot_call_anything(rc8: VirtualRC8) -> None:
    with all_ports(rc8) as ports:
        before = state_of(rc8)
        for port, body in ports.items():
            done = subprocess.run(
                ["curl", "--silent", "--max-time", f"{PATIENCE:.0f}", "--header", "Content-Type: text/plain",
                 "--data-binary", "@-", f"http://127.0.0.1:{port}/"],
                input=body, capture_output=True, check=False,
            )  # fmt: skip
            assert done.returncode not in (0, 28), done  # neither an HTTP response nor a time-out
        assert state_of(rc8) == before
