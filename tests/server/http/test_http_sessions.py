"""Identification of clients over HTTP: cookies, addresses, idle time."""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.core import hresult
from orinkit.server.context import ServerContext
from orinkit.server.http import sessions as http_sessions
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.sessions import HttpSessions
from orinkit.server.threaded import Server
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Call, Recorder, Workshop
from support.leaping import going, leap, see_broken, take_turns
from support.waiting import PATIENCE, until
from support.web import EXECUTE, FORM, GET, GET_VARIABLE, OK, PUT, Web, connect, curl, request

EXECUTING = {"Orinkit_Executing": "400"}
STILL = 0.25  # s during which nothing must happen
IDLE = HttpOptions(idle=1000.0)


@pytest.fixture(autouse=True)
def _all_are_closed(no_errors_are_logged: None) -> Iterator[None]:
    yield
    Web.close_all()


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, "http://127.0.0.1:0") as served:
        yield served


def echo(web: Web, handle: int) -> int:
    """Return the code of a call with a handle: 0, or E_HANDLE if it belongs to another client."""
    return web.call(EXECUTE, handle, "Echo", "3,1").code


def curl_echo(server: Server, handle: int) -> int:
    return curl(server.url, EXECUTE, handle, "Echo", "3,1").code


# --- cookies ----------------------------------------------------------------------------------------------------------


def test_a_cookie_is_set_once_and_deleted_at_the_end(server: Server) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        assert "set-cookie" in web.call(1).headers
        name, _, key = web.cookie.partition("=")
        handle = connect(web)
        for _ in range(3):
            assert "set-cookie" not in web.call(EXECUTE, handle, "Echo", "").headers
        answer = web.call(2)
        assert answer.body == OK
        assert answer.headers["set-cookie"] == f"{name}=; Max-Age=0; HttpOnly; SameSite=Strict; Path=/".replace(
            "Max-Age=0; HttpOnly; SameSite=Strict; Path=/", "HttpOnly; SameSite=Strict; Path=/; Max-Age=0"
        )
        assert server.clients == 0
        web.cookie = f"{name}={key}"
        again = web.call(EXECUTE, handle, "Echo", "")
        assert again.code == hresult.E_HANDLE
        assert web.cookie != f"{name}={key}"  # an ended session is not resumed


@pytest.mark.parametrize("value", ["x", "", '"', "a" * 3000, "\xff", "../..", "None"])
def test_an_unknown_cookie_is_replaced(server: Server, value: str) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        port = web.place.rpartition(":")[2]
        web.cookie = f"other=1; orinkit-{port}={value}; orinkit-1=2"
        assert web.call(1).body == OK
        assert web.cookie.startswith(f"orinkit-{port}=")
        assert web.cookie.partition("=")[2] != value
        first = web.cookie
        assert echo(web, connect(web)) == 0
        assert web.cookie == first


def test_cookies_of_other_servers_are_ignored(server: Server) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        ours = web.cookie
        for cookies in (f"a=1;{ours}", f"a; {ours} ;b=2", f"{ours};", f"  {ours}  "):
            web.cookie = cookies
            assert echo(web, handle) == 0


def test_two_clients_with_cookies_begin_at_the_same_time(server: Server) -> None:
    with Web(server.url, keeps_cookies=True) as one, Web(server.url, keeps_cookies=True) as two:
        for web in (one, two):
            assert web.call(1).body == OK
        handles = connect(one), connect(two)
        assert handles == (2, 3)
        assert (echo(one, 2), echo(two, 3)) == (0, 0)
        assert (echo(one, 3), echo(two, 2)) == (hresult.E_HANDLE, hresult.E_HANDLE)
        assert server.clients == 2


def test_fifty_clients_with_cookies_begin_at_the_same_time(server: Server) -> None:
    clients = [Web(server.url, keeps_cookies=True) for _ in range(50)]
    for order in (clients, reversed(clients)):
        for web in order:
            body = "Func=1" if not web.cookie else request(3, "", "Test.Workshop", "", "")
            web.send(web.head(body, **(EXECUTING if clients.index(web) % 2 else {})) + body.encode())
        for web in clients:
            assert web.answer().code == 0
    assert server.clients == 50
    assert len({web.cookie for web in clients}) == 50
    for web in clients:
        web.close()


@pytest.mark.parametrize("first", ["cookies", "none"])
def test_a_client_with_cookies_beside_one_without(server: Server, first: str) -> None:
    """At the same address, in either order, each client finds its objects at each step."""
    with Web(server.url, keeps_cookies=True) as web:
        mine = theirs = 0
        for step in range(4):
            for name in ("cookies", "none") if first == "cookies" else ("none", "cookies"):
                if step == 0:
                    answer = web.call(1) if name == "cookies" else curl(server.url, 1)
                    assert answer.body == OK
                elif step == 1:
                    call = (3, "", "Test.Workshop", "", "")
                    if name == "cookies":
                        mine = web.call(*call).handle
                    else:
                        theirs = curl(server.url, *call).handle
                else:
                    code = echo(web, mine) if name == "cookies" else curl_echo(server, theirs)
                    assert code == 0, (step, name)
        assert (echo(web, theirs), curl_echo(server, mine)) == (hresult.E_HANDLE, hresult.E_HANDLE)
        assert web.call(2).body == OK
        assert curl_echo(server, theirs) == 0


def test_a_client_with_cookies_begins_during_the_session_of_one_without(server: Server) -> None:
    assert curl(server.url, 1).body == OK
    theirs = curl(server.url, 3, "", "Test.Workshop", "", "").handle
    with Web(server.url, keeps_cookies=True) as web:
        assert web.call(1).body == OK
        mine = connect(web)
        for _ in range(3):
            assert (echo(web, mine), curl_echo(server, theirs)) == (0, 0)
        assert (echo(web, theirs), curl_echo(server, mine)) == (hresult.E_HANDLE, hresult.E_HANDLE)


def test_orinkit_clients_do_not_affect_a_client_without_cookies(server: Server) -> None:
    theirs = curl(server.url, 3, "", "Test.Workshop", "", "").handle
    with Web(server.url, keeps_cookies=True) as web:
        assert "set-cookie" in web.ask("Func=1", **EXECUTING).headers
        mine = web.ask(request(3, "", "Test.Workshop", "", ""), **EXECUTING).handle
        assert (echo(web, mine), curl_echo(server, theirs)) == (0, 0)


# --- addresses --------------------------------------------------------------------------------------------------------


def test_a_client_without_cookies_is_identified_by_its_address(server: Server) -> None:
    assert "set-cookie" in curl(server.url, 1).headers
    controller = curl(server.url, 3, "", "Test.Workshop", "", "").handle
    variable = curl(server.url, GET_VARIABLE, controller, "v", "").handle
    assert curl(server.url, PUT, variable, "8,kept").body == OK
    assert curl(server.url, GET, variable).result == "8,kept"
    assert server.clients == 1
    assert curl(server.url, 2).body == OK
    assert server.clients == 0
    assert curl(server.url, GET, variable).code == hresult.E_HANDLE


def test_a_client_without_cookies_that_begins_again(server: Server, workshop: Workshop) -> None:
    """If it was killed, its objects still exist; only Service_Stop releases them."""
    handle = connect_by_curl(server)
    assert curl(server.url, 1, "InvokeTimeout=100").body == OK
    assert curl_echo(server, handle) == 0
    assert (
        curl(server.url, EXECUTE, handle, "Wait", "").code == hresult.E_TIMEOUT
    )  # the time-out set by the same client
    workshop.gate.set()
    assert curl(server.url, 2).body == OK
    assert workshop.released == ["Controller"]
    assert curl(server.url, 1).body == OK
    assert curl_echo(server, handle) == hresult.E_HANDLE
    assert curl_echo(server, connect_by_curl(server)) == 0


def connect_by_curl(server: Server) -> int:
    return curl(server.url, 3, "", "Test.Workshop", "", "").handle


def test_other_addresses_are_other_clients(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "http://localhost:0") as server:
        port = server.url.rpartition(":")[2]
        mine = curl(f"http://127.0.0.1:{port}", 3, "", "Test.Workshop", "", "").handle
        with Web(f"http://127.0.0.1:{port}") as web:
            assert echo(web, mine) == 0
        import socket

        with socket.create_connection(("127.0.0.1", int(port)), PATIENCE, ("127.0.0.2", 0)) as other:
            body = request(EXECUTE, mine, "Echo", "").encode()
            head = f"POST / HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 127.0.0.1\r\nContent-Type: {FORM}\r\n"
            other.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
            assert b"0x80070006" in other.recv(4096)
        assert server.clients == 2


def test_invalid_requests_and_service_stop_create_no_client(server: Server) -> None:
    with Web(server.url) as web:
        for body in ("", "Func=x", "Func=999"):
            assert "set-cookie" not in web.ask(body).headers
        assert web.call(2).body == OK
        assert web.call(2, "x").code == hresult.E_INVALIDARG
        assert web.ask("Func=1", Content_Type="text/plain").status == 415
        assert server.clients == 0
        web.cookie = "orinkit-" + web.place.rpartition(":")[2] + "=gone"
        answer = web.call(2)
        assert (answer.body, "Max-Age=0" in answer.headers["set-cookie"]) == (OK, True)
        assert server.clients == 0


def test_a_stop_that_is_refused_ends_nothing(server: Server) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        assert web.call(2, "8,x").code == hresult.E_INVALIDARG
        web.keeps_cookies = False
        assert echo(web, handle) == 0


# --- limits on clients ------------------------------------------------------------------------------------------------


def test_one_client_too_many_receives_a_code(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "http://127.0.0.1:0", "tcp://127.0.0.1:0", clients=3) as server:
        clients = [Web(server.url, keeps_cookies=True) for _ in range(3)]
        handles = [client.call(1) and connect(client) for client in clients]
        with Web(server.url) as extra:
            for _ in range(3):
                answer = extra.call(1)
                assert answer.code == hresult.E_MAX_CONNECT
                assert "3 clients" in answer.detail
                assert "set-cookie" not in answer.headers
            assert extra.call(2).body == OK
        with pytest.raises(orinkit.CallError) as caught:
            orinkit.connect(server.urls[1], provider="Test.Workshop")
        assert caught.value.code == hresult.E_MAX_CONNECT
        assert [echo(*pair) for pair in zip(clients, handles, strict=True)] == [0, 0, 0]
        assert clients[0].call(2).body == OK
        with Web(server.url, keeps_cookies=True) as late:
            assert echo(late, connect(late)) == 0
        for client in clients:
            client.close()


def test_unused_sessions_do_not_keep_clients_out(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script repeatedly sends Service_Start, and never uses the sessions that this creates."""
    monkeypatch.setattr(http_sessions, "_YOUNG", 0.0)
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", clients=5) as server,
        Web(server.url, keeps_cookies=True) as web,
    ):
        handle = connect(web)
        for _ in range(20):
            assert curl(server.url, 1).body == OK
            assert echo(web, handle) == 0
        theirs = connect_by_curl(server)
        for _ in range(20):
            assert curl(server.url, 1).body == OK
        assert (echo(web, handle), curl_echo(server, theirs)) == (0, 0)
        assert server.clients <= 5


def test_a_client_without_cookies_may_begin_again_at_the_limit(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "http://127.0.0.1:0", clients=1) as server:
        handle = connect_by_curl(server)
        answer = curl(server.url, 1)
        assert answer.body == OK
        assert "set-cookie" not in answer.headers
        assert curl_echo(server, handle) == 0


# --- handles ----------------------------------------------------------------------------------------------------------


def test_handles_of_disconnected_clients_are_not_reused(server: Server) -> None:
    seen = set()
    for _ in range(10):
        handle = connect_by_curl(server)
        assert handle not in seen
        seen.add(handle)
        assert curl(server.url, 2).body == OK
    with Web(server.url, keeps_cookies=True) as web:
        handles = {connect(web) for _ in range(5)}
        assert not handles & seen
        assert [echo(web, handle) for handle in seen] == [hresult.E_HANDLE] * 10


# --- idle time --------------------------------------------------------------------------------------------------------


def test_objects_are_released_newest_first_after_the_idle_time() -> None:
    recorder = Recorder()
    with (
        orinkit.serve(recorder, "http://127.0.0.1:0") as server,
        Web(server.url, keeps_cookies=True) as web,
    ):
        web.call(1)
        controller = web.call(3, "RC", "Test.Recorder", "", "").handle
        robot = web.call(7, controller, "Arm", "").handle
        web.call(GET_VARIABLE, controller, "a", "")
        web.call(62, robot, "b", "")
        leap(server, 60.0)
        assert recorder.wait_for(Call("Controller_Disconnect", "RC", ()))
        assert [call.path for call in recorder.calls[-4:]] == ["RC/Arm/b", "RC/a", "RC/Arm", "RC"]
        until(lambda: server.clients == 0)
        cookie = web.cookie
        assert web.call(7, controller, "Arm", "").code == hresult.E_HANDLE
        assert web.cookie != cookie


def test_clients_that_make_calls_are_not_dropped(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0", invoke_timeout=1e6, http=IDLE) as server,
        Web(server.url, keeps_cookies=True) as first,
        Web(server.url, keeps_cookies=True) as waiting,
    ):
        handle = connect(first)
        body = request(EXECUTE, connect(waiting), "Wait", "8,done")
        waiting.send(waiting.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        for _ in range(10):
            leap(server, IDLE.idle / 2)
            with Web(server.url) as web:
                web.cookie = first.cookie
                assert echo(web, handle) == 0
        assert workshop.released == []  # a client with a call in progress is not idle either
        assert server.clients == 2
        workshop.gate.set()
        assert waiting.answer().result == "8,done"


def test_a_client_whose_connection_breaks_in_a_call_is_dropped_sooner(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_sessions, "IDLE_TIMEOUT", 100.0)
    with orinkit.serve(workshop, "http://127.0.0.1:0", http=IDLE) as server:
        web = Web(server.url, keeps_cookies=True)
        handle = connect(web)
        web.call(GET_VARIABLE, handle, "v", "")
        body = request(EXECUTE, handle, "Wait", "")
        web.send(web.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        web.reset()
        see_broken(server)
        leap(server, 100.0 - PATIENCE)
        assert not workshop.cancelled.acquire(blocking=False)  # it may reconnect
        leap(server, PATIENCE)
        assert workshop.cancelled.acquire(timeout=PATIENCE)
        assert workshop.let_go.acquire(timeout=PATIENCE)
        until(lambda: server.clients == 0)


@pytest.mark.parametrize("how", ["close", "reset", "half closed"])
def test_a_call_continues_when_the_connection_breaks(server: Server, workshop: Workshop, how: str) -> None:
    web = Web(server.url, keeps_cookies=True)
    handle = connect(web)
    kept = web.call(GET_VARIABLE, handle, "kept", "").handle
    body = request(GET_VARIABLE, handle, "slow", "")
    web.send(web.head(body) + body.encode())
    assert workshop.at_work.acquire(timeout=PATIENCE)
    if how == "half closed":
        import socket

        web.socket.shutdown(socket.SHUT_WR)
        assert web.ended()
    elif how == "reset":
        web.reset()
    web.close()
    with Web(server.url) as again:
        again.cookie = web.cookie
        assert again.call(GET, kept).code == 0  # so it has reconnected, and keeps its objects
        assert not workshop.let_go.acquire(blocking=False)
        workshop.gate.set()
        assert workshop.let_go.acquire(timeout=PATIENCE)  # the object whose handle was never sent
        assert (workshop.made, workshop.released) == (["kept", "slow"], ["slow"])
        assert again.call(GET, kept).code == 0


def test_an_async_handler_continues_when_the_connection_breaks_and_ends_with_the_session(
    server: Server, workshop: Workshop
) -> None:
    web = Web(server.url, keeps_cookies=True)
    handle = connect(web)
    for command in ("Wait", "Tidy"):
        body = request(EXECUTE, handle, command, "")
        with Web(server.url) as other:
            other.cookie = web.cookie
            other.send(other.head(body) + body.encode())
            assert workshop.at_work.acquire(timeout=PATIENCE)
    assert echo(web, handle) == 0
    assert not workshop.cancelled.acquire(timeout=STILL)
    assert web.call(2).body == OK
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    web.close()


@pytest.mark.parametrize("command", ["Wait", "Block"])
def test_service_stop_ends_calls_on_other_connections(server: Server, workshop: Workshop, command: str) -> None:
    with Web(server.url, keeps_cookies=True) as web, Web(server.url) as other:
        handle = connect(web)
        other.cookie = web.cookie
        body = request(EXECUTE, handle, command, "")
        other.send(other.head(body) + body.encode())
        assert workshop.at_work.acquire(timeout=PATIENCE)
        assert web.call(2).body == OK
        answer = other.answer()
        assert (answer.code, answer.detail) == (hresult.E_ABORT, "the session has ended")
        workshop.gate.set()


def test_service_stop_during_the_maximum_number_of_calls(server: Server, workshop: Workshop) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        handle = connect(web)
        body = request(EXECUTE, handle, "Wait", "")
        others = [Web(server.url) for _ in range(8)]
        for other in others:
            other.cookie = web.cookie
            other.send(other.head(body) + body.encode())
            assert workshop.at_work.acquire(timeout=PATIENCE)
        assert echo(web, handle) == hresult.E_BUSY_PROC
        for stop in (70, 71, 89):  # Robot_Halt, Robot_Hold, Task_Stop are accepted, but the handle is a controller's
            assert web.call(stop, handle, *([0] if stop == 89 else []), "").code == hresult.E_HANDLE
        assert web.call(2).body == OK
        assert web.call(EXECUTE, connect(web), "Echo", "").code == 0
        for other in others:
            other.close()


def test_timed_out_calls_do_not_count_towards_the_limit(server: Server, workshop: Workshop) -> None:
    with Web(server.url, keeps_cookies=True) as web:
        assert web.call(1, "InvokeTimeout=80").body == OK
        handle = connect(web)
        for _ in range(10):
            assert web.call(EXECUTE, handle, "Wait", "").code == hresult.E_TIMEOUT
        assert echo(web, handle) == 0


@pytest.mark.parametrize("how", ["silence", "broken", "broken with another request begun"])
def test_the_arm_of_a_disconnected_client_stops_within_its_limits(how: str) -> None:
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with (
        orinkit.serve(device, "http://127.0.0.1:0", "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.urls[1], timeout=PATIENCE) as watcher,
    ):
        arm = device.state.arm
        watching = watcher.robot("Arm")
        watching.execute("StartLog")
        web = Web(server.url, keeps_cookies=True)
        controller = web.call(3, "", "CaoProv.DENSO.VRC", "", "").handle
        robot = web.call(7, controller, "Arm", "").handle
        assert web.call(64, robot, "TakeArm", "8195,0,0").code == 0
        move = request(72, robot, 1, "8,J(150, 45, 90, 0, 45, 0)", "SPEED=30" + (",NEXT" if how == "silence" else ""))
        web.send(web.head(move) + move.encode())
        if how == "silence":
            assert web.answer().code == 0
        until(lambda: arm.busy)
        while arm.queue.joints[0] <= 5:
            clock.advance(PERIOD)
        with pytest.raises(orinkit.CallError) as caught:
            watching.execute("TakeArm", [0, 0])
        assert caught.value.code == hresult.ARM_NOT_TAKEN
        if how == "broken with another request begun":
            web.send(b"POST /")
        if how == "silence":
            leap(server, HttpOptions().idle)
        else:
            web.close()
            see_broken(server)
            leap(server, http_sessions.IDLE_TIMEOUT)
        until(lambda: server.clients == 1)
        take_turns(server)
        while arm.busy:
            clock.advance(PERIOD)
        watching.execute("StopLog")
        assert 5 < arm.queue.joints[0] < 149
        check_limits(device)
        watching.execute("TakeArm", [0, 0])
        web.close()


def check_limits(device: VirtualRC8) -> None:
    log = device.state.arm.log
    samples = np.array([log.record(index)[0:24:4] for index in range(len(log))])
    velocity = np.diff(samples, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    assert np.abs(velocity).max() > 1
    for axis, limits in enumerate(device.state.arm.model.axes):
        assert np.abs(velocity[:, axis]).max() <= limits.velocity * 0.3 * 1.001
        assert np.abs(acceleration[:, axis]).max() <= limits.acceleration * 1.001


def test_a_motion_may_take_longer_than_the_idle_time() -> None:
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with orinkit.serve(device, "http://127.0.0.1:0", invoke_timeout=1e6) as server, Web(server.url) as web:
        web.keeps_cookies = True
        robot = web.call(7, web.call(3, "", "CaoProv.DENSO.VRC", "", "").handle, "Arm", "").handle
        assert web.call(64, robot, "TakeArm", "8195,0,0").code == 0
        move = request(72, robot, 1, "8,J(100, 45, 90, 0, 45, 0)", "SPEED=3")
        web.send(web.head(move) + move.encode())
        until(lambda: device.state.arm.busy)
        for _ in range(10):
            clock.advance(0.5)
            leap(server, HttpOptions().idle)
        assert server.clients == 1
        assert device.state.arm.busy
        with going(clock, 0.5):
            assert web.answer().body == OK
        assert device.state.arm.queue.joints[0] == pytest.approx(100)


# --- logs, leaks ------------------------------------------------------------------------------------------------------


def test_clients_are_logged(workshop: Workshop, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "orinkit.server")
    with (
        orinkit.serve(workshop, "http://127.0.0.1:0") as server,
        Web(server.url, keeps_cookies=True) as web,
    ):
        host, port = web.socket.getsockname()
        connect(web)
        leap(server, HttpOptions().idle)
        until(lambda: server.clients == 0)
        web.call(1)
        web.call(2)
    logged = [record.getMessage() for record in caplog.records]
    name = f"{host}:{port}/http"
    assert [line for line in logged if line.startswith(name)] == [
        f"{name} connected", f"{name} disconnected: nothing received", f"{name} connected", f"{name} disconnected",
    ]  # fmt: skip


def test_the_secret_of_a_cookie_is_not_logged(workshop: Workshop, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    with orinkit.serve(workshop, "http://127.0.0.1:0") as server, Web(server.url, keeps_cookies=True) as web:
        connect(web)
        web.call(EXECUTE, 99, "Echo", "")
        key = web.cookie.partition("=")[2]
    assert key
    assert key not in caplog.text


def test_ended_sessions_leave_nothing_behind() -> None:
    async def sessions() -> weakref.ref[Any]:
        context = ServerContext(ProviderRegistry(Workshop()), DEFAULT_LIMITS, 10, 180.0)
        table = HttpSessions(context, 60.0)
        made = table.for_service_start("192.168.0.1", 5)
        assert made is not None
        second = table.for_service_start("192.168.0.1", 6)
        assert second is not made
        assert table.by_address("192.168.0.1") is second
        assert table.by_key(made.key) is made
        for each in (made, second):
            assert each is not None
            each.close()
        assert (context.open, context.all, table.by_address("192.168.0.1"), table.by_key(made.key)) == (
            set(),
            set(),
            None,
            None,
        )
        return weakref.ref(made)

    async def run() -> None:
        found = await sessions()
        await asyncio.sleep(0)
        gc.collect()
        assert found() is None

    asyncio.run(run())


def test_many_clients_at_once(server: Server, workshop: Workshop) -> None:
    errors: list[BaseException] = []

    def client(number: int) -> None:
        try:
            for _ in range(5):
                with Web(server.url, keeps_cookies=True) as web:
                    web.ask("Func=1", **EXECUTING)
                    handle = connect(web)
                    for turn in range(10):
                        value = f"8204,(3,{number * 100 + turn}),(3,{turn % 3})"
                        assert web.call(EXECUTE, handle, "EchoLater", value).result == f"3,{number * 100 + turn}"
                    assert web.call(2).body == OK
        except BaseException as error:  # noqa: BLE001 - checked by the test
            errors.append(error)

    threads = [threading.Thread(target=client, args=(number,)) for number in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert errors == []
    assert server.clients == 0
    assert workshop.released == ["Controller"] * 100
