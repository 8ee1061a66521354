"""Clients over HTTP: sessions, closing, tokens and late errors."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit import HttpOptions, aio
from orinkit import functions as f
from orinkit.core import hresult
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    StreamError,
    error_for,
)
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.devices import Call, Recorder, Workshop
from support.http_wired import EcapPeer
from support.peers import Line, reply
from support.waiting import until

ANYWHERE = "http://127.0.0.1:0"
PATIENCE = 30.0  # less than the time after which a server forgets a client that was not closed
PROVIDER = "Test.Workshop"


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, ANYWHERE) as served:
        yield served


# --- the end of a client ----------------------------------------------------------------------------------------------


def forget_clients(server: Server) -> None:
    """Make a server forget its clients, as after a long idle period."""

    def look() -> None:
        for session in list(server._server._context.open):
            sessions = session._sessions
            usual, sessions.idle = sessions.idle, 0.0
            session._check_idle_time()
            sessions.idle = usual

    server._loop.call_soon_threadsafe(look)
    until(lambda: server.clients == 0)


def test_a_client_that_was_idle_for_too_long_gets_an_error(both: Both) -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, ANYWHERE) as server:
        controller = both.connect(server.url, provider="Test.Recorder", name="RC")
        forget_clients(server)
        assert recorder.wait_for(Call("Controller_Disconnect", "RC", ()))
        with pytest.raises(ConnectionLost, match="the session has ended"):
            both.run(controller.get_name())
        with pytest.raises(ConnectionClosed):
            both.run(controller.get_name())
        both.run(controller.close())
        controller = both.connect(server.url, provider="Test.Recorder", name="RC")
        assert "Controller_GetName" in both.run(controller.get_name())
        both.run(controller.close())


def test_a_restarted_server_does_not_know_the_session(both: Both, workshop: Workshop) -> None:
    with orinkit.serve(workshop, ANYWHERE) as server:
        url = server.url
        controller = both.connect(url, provider=PROVIDER)
    with orinkit.serve(Workshop(), url):
        with pytest.raises(ConnectionLost, match="the session has ended"):
            both.run(controller.execute("Echo", 1))
        both.run(controller.close())


def test_a_client_that_is_closed_during_a_call_ends_its_session(server: Server, workshop: Workshop) -> None:
    """If another thread closes it, the call ends, and the server releases everything immediately."""
    client = orinkit.connect(server.url, provider=PROVIDER).client

    def close() -> None:
        assert workshop.at_work.acquire(timeout=PATIENCE)
        client.close()

    closer = threading.Thread(target=close)
    closer.start()
    with pytest.raises(ConnectionClosed):
        client.call(f.controller_execute, 2, "Wait", 1)
    closer.join()
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    assert workshop.released == ["Controller"]


def test_a_client_that_is_closed_while_threads_call_ends_its_session(server: Server, workshop: Workshop) -> None:
    for turn in range(1, 16):
        client = orinkit.connect(server.url, provider=PROVIDER).client
        handle = client.call(f.controller_connect, "", PROVIDER, "localhost", "")
        begun = threading.Semaphore(0)

        def work(client: orinkit.Client = client, handle: int = handle, begun: Any = begun) -> None:
            try:
                while True:
                    assert client.call(f.controller_execute, handle, "Echo", "mine") == "mine"
                    begun.release()
            except ConnectionClosed:
                pass

        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        assert begun.acquire(timeout=PATIENCE)
        client.close()
        for thread in threads:
            thread.join(PATIENCE)
            assert not thread.is_alive()
        until(lambda turn=turn: len(workshop.released) == 2 * turn, PATIENCE)


def test_a_client_that_is_closed_while_tasks_call_ends_its_session(server: Server, workshop: Workshop) -> None:
    async def body(turns: int) -> None:
        client = (await aio.connect(server.url, provider=PROVIDER)).client

        async def work() -> None:
            with pytest.raises(ConnectionClosed):
                while True:
                    assert await client.call(f.controller_execute, handle, "EchoLater", ["mine", 1]) == "mine"

        handle = await client.call(f.controller_connect, "", PROVIDER, "localhost", "")
        tasks = [asyncio.ensure_future(work()) for _ in range(4)]
        for _ in range(turns):
            await asyncio.sleep(0)
        await client.close()
        await asyncio.gather(*tasks)

    for turns in range(1, 16):
        asyncio.run(body(turns))
        until(lambda turns=turns: len(workshop.released) == 2 * turns, PATIENCE)


def test_a_client_whose_connection_broke_ends_its_session_over_another_one(both: Both) -> None:
    def breaks(line: Line) -> None:
        line.send(reply(line.request()))
        line.request()

    with EcapPeer(breaks, lambda line: line.serve(reply)) as peer:
        client = both.client(peer.url)
        both.run(client.call(f.service_start))
        with pytest.raises(ConnectionLost):
            both.run(client.call(f.controller_execute, 2, "Echo", 1))
        both.run(client.close())
        both.run(client.close())
        assert [post.body.partition(b",")[0] for post in peer.posts] == [b"Func=1", b"Func=17", b"Func=2"]


def test_closing_with_an_unresponsive_server_takes_one_second_at_most(both: Both) -> None:
    def script(line: Line) -> None:
        line.send(reply(line.request()))
        while True:
            line.request()

    with EcapPeer(script) as peer:
        client = both.client(peer.url, timeout=3 * PATIENCE)
        both.run(client.call(f.service_start))
        began = time.monotonic()
        both.run(client.close())
        assert time.monotonic() - began < PATIENCE  # the time-out has not expired
        with pytest.raises(ConnectionClosed):
            both.run(client.call(f.service_start))


def test_a_cancelled_close_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.ecap.client._STOP_TIMEOUT", PATIENCE)

    def script(line: Line) -> None:
        line.send(reply(line.request()))
        while True:
            line.request()

    async def body() -> None:
        client = await aio.open_client(peer.url)
        await client.call(f.service_start)
        closing = asyncio.create_task(client.close())
        while len(peer.posts) < 2:  # noqa: ASYNC110 - a thread takes them
            await asyncio.sleep(0.002)
        closing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await closing
        with pytest.raises(ConnectionClosed):
            await client.call(f.service_start)
        await client.close()

    both = Both("async")
    with EcapPeer(script) as peer:
        both.run(body())
        both.close()
        assert [post.body[:7] for post in peer.posts] == [b"Func=1,", b"Func=2,"]


# --- errors -----------------------------------------------------------------------------------------------------------


def test_a_call_that_timed_out_does_not_keep_the_next_one_waiting(
    both: Both, server: Server, workshop: Workshop
) -> None:
    controller = both.connect(server.url, provider=PROVIDER)
    for number in range(3):
        with pytest.raises(CallTimeout):
            both.run(controller.client.request(f.controller_execute, controller.handle, "Wait", number, timeout=0.05))
        assert both.run(controller.execute("Echo", number)) == number
    workshop.gate.set()
    both.run(controller.close())
    assert workshop.released == ["Controller"]


def test_a_server_that_requires_a_token(both: Both, workshop: Workshop) -> None:
    with orinkit.serve(workshop, ANYWHERE, http=HttpOptions(token="s3cret")) as server:
        for options in ({}, {"token": "other"}):
            with pytest.raises(ConnectFailed, match="token"):
                both.connect(server.url, provider=PROVIDER, **options)
        controller = both.connect(server.url, provider=PROVIDER, token="s3cret")
        assert both.run(controller.execute("Echo", 1)) == 1
        both.run(controller.close())


def test_a_stream_of_set_points_needs_b_cap() -> None:
    with (
        orinkit.serve(VirtualRC8(motor=True), ANYWHERE) as server,
        orinkit.connect(server.url) as controller,
        controller.robot() as robot,
        robot.arm(),
    ):
        with pytest.raises(StreamError, match=r"requires b-CAP; http:// uses e-CAP\. Try: tcp://"):
            robot.slave_mode()  # before anything is sent
        assert robot.joints  # the connection stays usable


def test_any_call_of_a_forgotten_client_reports_it(both: Both) -> None:
    with orinkit.serve(Recorder(), ANYWHERE) as server:
        controller = both.connect(server.url, provider="Test.Recorder")
        forget_clients(server)
        with pytest.raises((CallTimeout, ConnectionLost)):
            both.run(controller.client.request(f.controller_get_name, controller.handle, timeout=0.0001))
        contact = controller.client._link._contact
        while both.loop is not None and not contact._session_ended:
            both.run(asyncio.sleep(0.002))  # the reply is dropped
        with pytest.raises((ConnectionLost, ConnectionClosed)):
            both.run(controller.get_name())
        both.run(controller.close())


def test_an_error_contains_the_detail_from_the_server(both: Both, server: Server) -> None:
    controller = both.connect(server.url, provider=PROVIDER)
    with pytest.raises(CallError) as caught:
        both.run(controller.execute("Crash"))
    assert caught.value.detail == "RuntimeError: the device is broken"
    both.run(controller.close())


class Late(orinkit.Device):
    """A device that fails after reports of S_EXECUTING have been sent."""

    provider_names = ("Test.Late",)

    @orinkit.command("Fail")
    def fail(self) -> None:
        time.sleep(0.3)
        raise error_for(hresult.E_TIMEOUT, "the lamp, which  is\nof 60 W, is not lit: 電球")


def test_the_detail_of_a_late_failure_is_received(both: Both, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.transport.http.response._SIGNS", 80)  # ms
    with orinkit.serve(Late(), ANYWHERE) as server:
        controller = both.connect(server.url, provider="Test.Late")
        with pytest.raises(CallError) as caught:
            both.run(controller.execute("Fail"))
        assert (caught.value.code, caught.value.detail) == (
            hresult.E_TIMEOUT,
            "the lamp, which is of 60 W, is not lit: 電球",
        )
        both.run(controller.close())
