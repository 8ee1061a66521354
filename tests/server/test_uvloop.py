"""Servers and asyncio clients on uvloop, whose transports are not asyncio's, and which reads in a different order.

Every event loop created by a test here is uvloop's: that of the server thread, and that of the client.
"""

from __future__ import annotations

import asyncio
import gc
import socket
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit import J, aio
from orinkit.core.errors import CallTimeout, ConnectFailed, ConnectionLost
from orinkit.server.http.flow_control import HELD
from orinkit.server.http.limits import LimitedProtocol
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.devices import Workshop
from support.waiting import until
from support.web import (
    EXECUTE,
    GARBAGE,
    OK,
    PATIENCE,
    Web,
    connect,
    request,
)

uvloop = pytest.importorskip("uvloop")

READ = 256 * 1024
"""Maximum number of bytes that uvloop reads at once."""


@pytest.fixture(autouse=True)
def _every_loop_is_uvloops(monkeypatch: pytest.MonkeyPatch, no_errors_are_logged: None) -> Iterator[None]:
    for module in (asyncio, asyncio.events):
        monkeypatch.setattr(module, "new_event_loop", uvloop.new_event_loop)
    yield
    Web.close_all()


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def web_server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, "http://127.0.0.1:0") as served:
        assert isinstance(served._loop, uvloop.Loop)
        yield served


# --- clients and servers over every transport -------------------------------------------------------------------------


def test_a_program_over_each_transport(both: Both, listen_at: str) -> None:
    assert both.loop is None or isinstance(both.loop, uvloop.Loop)
    with orinkit.serve(VirtualRC8(clock=Clock(20.0)), listen_at) as server:
        rc8 = both.connect(server.url)
        variable = both.run(rc8.variable("S10"))
        for text in ("", "text", "日本語"):
            both.run(variable.put_value(text) if both.kind == "async" else setattr(variable, "value", text))
            assert both.run(variable.get_value()) == text
        robot = both.run(rc8.robot())

        def moves(_motor: object) -> None:
            both.run(robot.move(J(10, 20, 70, 0, 90, 0)))

        both.within(robot.arm(), lambda _arm: both.within(robot.motor(), moves))
        both.run(rc8.close())
        until(lambda: server.clients == 0)


def test_many_clients_at_a_time(listen_at: str, workshop: Workshop) -> None:
    several = 1 if listen_at.startswith("pty") else 8
    with orinkit.serve(workshop, listen_at) as server:

        async def one(number: int) -> None:
            async with aio.connect(server.url, provider="Test.Workshop", dialect="rc8") as controller:
                for turn in range(10):
                    assert await controller.execute("EchoLater", [f"{number} {turn}", turn % 3]) == f"{number} {turn}"

        async def main() -> None:
            async with asyncio.TaskGroup() as group:
                for number in range(several):
                    group.create_task(one(number))

        asyncio.run(main())


def test_a_cancelled_call_leaves_the_connection_in_step(listen_at: str, workshop: Workshop) -> None:
    with orinkit.serve(workshop, listen_at) as server:

        async def main() -> None:
            async with aio.connect(server.url, provider="Test.Workshop", dialect="rc8") as controller:
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.1):
                        await controller.execute("Wait", "late")
                workshop.gate.set()
                while True:
                    try:
                        assert await controller.execute("Echo", "mine") == "mine"
                    except orinkit.CallError as busy:  # until the first call has ended
                        if busy.code != orinkit.core.hresult.E_BUSY_PROC:
                            raise
                    else:
                        break

        asyncio.run(main())


def test_time_outs_and_ends(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0") as server:

        async def main() -> None:
            controller = await aio.connect(server.url, provider="Test.Workshop", service="", timeout=1.0)
            with pytest.raises(CallTimeout):
                await controller.execute("Wait", 1)
            await asyncio.to_thread(server.close)
            with pytest.raises(ConnectionLost):
                await controller.execute("Echo", 1)

        asyncio.run(main())


@pytest.mark.parametrize("wire", ["tcp://127.0.0.1:0", "pty://"])
def test_a_stream_and_back(wire: str) -> None:
    """The streaming process takes over the descriptor of the connection, and the client takes it back."""
    with orinkit.serve(VirtualRC8(), wire) as server:

        async def main() -> None:
            async with (
                aio.connect(server.url, dialect="rc8") as rc8,
                await rc8.robot() as robot,
                robot.arm(),
                robot.motor(),
            ):
                start = await robot.execute("CurJnt")
                async with robot.slave_mode() as stream:
                    stream.target = J(start[0] + 2, *start[1:6])
                    await stream.wait()
                assert (await robot.execute("CurJnt"))[0] == pytest.approx(start[0] + 2, abs=0.01)

        asyncio.run(main())


@pytest.mark.parametrize("scheme", ["tcp", "udp", "http"])
def test_a_port_in_use_is_reported_and_nothing_stays_open(workshop: Workshop, scheme: str) -> None:
    with orinkit.serve(workshop, f"{scheme}://127.0.0.1:0") as server:
        with pytest.raises(ConnectFailed, match="in use"):
            orinkit.serve(Workshop(), server.url)
        gc.collect()  # an open socket causes a warning, which is an error


# --- HTTP -------------------------------------------------------------------------------------------------------------


def test_handshakes_that_begin_before_the_server_is_ready(workshop: Workshop, certificate: tuple[Path, Path]) -> None:
    """uvloop reads received bytes before the connection is passed to TLS."""
    cert, key = certificate
    context = ssl.create_default_context(cafile=str(cert))
    with orinkit.serve(workshop, "https://127.0.0.1:0", http=HttpOptions(cert=str(cert), key=str(key))) as server:
        for _ in range(20):
            with Web(server.url, context=context) as web:
                assert web.call(1).body == OK

        async def main() -> None:
            for _ in range(10):
                async with aio.connect(server.url, provider="Test.Workshop", cafile=str(cert)) as controller:
                    assert await controller.execute("Echo", "x" * 100_000) == "x" * 100_000

        asyncio.run(main())


def test_a_client_that_half_closes_is_answered(web_server: Server) -> None:
    """uvloop detects the end of the client's stream before the last request has been answered."""
    for _ in range(20):
        with Web(web_server.url) as web:
            web.send((web.head("Func=1") + b"Func=1") * 5)
            web.socket.shutdown(socket.SHUT_WR)
            assert web.rest().count(b"HTTP/1.1 200") == 5


def test_a_client_that_half_closes_during_a_slow_call_is_disconnected(web_server: Server, workshop: Workshop) -> None:
    with Web(web_server.url, keeps_cookies=True) as web:
        body = request(EXECUTE, connect(web), "Wait", "3,1")
        web.send(web.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        web.socket.shutdown(socket.SHUT_WR)
        assert web.ended()


def test_a_long_header_is_refused(web_server: Server) -> None:
    with Web(web_server.url) as web:
        web.send(GARBAGE["a long header"])
        assert web.answer().status == 431
        assert web.ended()


def test_a_flood_of_requests_during_a_call_is_bounded(
    web_server: Server, workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffered = [0]

    receive = LimitedProtocol.data_received

    def received(connection: LimitedProtocol, data: bytes) -> None:
        receive(connection, data)
        buffered.append(connection._held())

    monkeypatch.setattr(LimitedProtocol, "data_received", received)
    texts = [f"{number} " + "x" * (30_000 if number % 3 else 100_000) for number in range(60)]
    with Web(web_server.url, keeps_cookies=True) as web:
        handle = connect(web)
        bodies = [request(EXECUTE, handle, "Wait", "8,first")]
        bodies += [request(EXECUTE, handle, "Echo", f"8,{text}") for text in texts]
        web.socket.settimeout(3 * PATIENCE)
        flood = b"".join(web.head(body) + body.encode() for body in bodies)
        sender = threading.Thread(target=web.send, args=(flood,))
        sender.start()
        assert workshop.at_work.acquire(timeout=PATIENCE)
        until(lambda: max(buffered) >= HELD)
        workshop.gate.set()
        assert [web.answer().result for _ in bodies] == ["8,first", *(f"8,{text}" for text in texts)]
        sender.join(3 * PATIENCE)
    assert max(buffered) < HELD + READ + len(bodies[1])
