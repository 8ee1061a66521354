"""Use of links by clients: time-outs, tries, errors."""

from __future__ import annotations

import os
import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.core.errors import (
    CallTimeout,
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    InvalidAddress,
    InvalidValue,
)
from orinkit.core.validation import brief
from support.both import Both
from support.peers import BadPeer, Line, reply
from support.waiting import TooSlow, with_longer_times

SHORT = 0.05
PATIENT = 20.0


@contextmanager
def datagrams(answer: Callable[[packet.Packet, int], bytes | None]) -> Iterator[tuple[str, list[packet.Packet]]]:
    """Run a scripted UDP server; yield its URL and the requests received.

    The script receives a request and the number of earlier requests.
    """
    came: list[packet.Packet] = []
    with socket.socket(type=socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(PATIENT)

        def serve() -> None:
            while True:
                data, client = server.recvfrom(65536)
                if not data:
                    return
                request = packet.decode(data)
                if request.code == f.service_stop.id:  # the client closes
                    continue
                came.append(request)
                answered = answer(came[-1], len(came) - 1)
                if answered is not None:
                    server.sendto(answered, client)

        serving = threading.Thread(target=serve)
        serving.start()
        try:
            yield f"udp://127.0.0.1:{server.getsockname()[1]}", came
        finally:
            with socket.socket(type=socket.SOCK_DGRAM) as end:
                end.sendto(b"", server.getsockname())
            serving.join()


# --- time-outs and tries --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tries", "sent"), [(-5, 1), (0, 1), (1, 1), (2, 2), (5, 5), (7, 7), (8, 7), (10**30, 7)])
def test_how_often_a_request_is_sent(both: Both, tries: int, sent: int) -> None:
    with datagrams(lambda request, count: None) as (url, came):
        client = both.client(url, timeout=0.01, tries=tries)
        assert client.tries == sent
        with pytest.raises(CallTimeout) as caught:
            both.run(client.call(f.service_start))
        both.run(client.close())
    assert caught.value.seconds == pytest.approx(0.01 * sent)
    assert [request.serial for request in came] == list(range(1, sent + 1))
    assert {request.reserved for request in came} == {1}


@pytest.mark.parametrize("tries", [2.0, "5", None, True, float("nan"), [1], [10**5000]], ids=brief)
def test_tries_that_are_no_number(both: Both, tries: Any) -> None:
    for url in ("udp://127.0.0.1:1", "tcp://127.0.0.1:1"):
        with pytest.raises(InvalidValue, match="tries must be an integer"):
            both.client(url, tries=tries)


@pytest.mark.parametrize("seconds", [0, -1, float("nan"), float("inf"), "1", 10**5000, [10**5000]], ids=brief)
def test_timeouts_that_cannot_be(both: Both, seconds: Any) -> None:
    for url in ("udp://127.0.0.1:1", "tcp://127.0.0.1:1"):
        with pytest.raises(InvalidValue, match="timeout must be a number of seconds above 0"):
            both.client(url, timeout=seconds)


@pytest.mark.parametrize("name", [10**5000, "x" * 100_000], ids=["number", "long"])
def test_dialects_that_are_none_are_told_shortly(both: Both, name: Any) -> None:
    with pytest.raises(InvalidValue, match="rc8, ve026a") as caught:
        both.connect("udp://127.0.0.1:1", dialect=name)
    assert len(str(caught.value)) < 200


def test_tries_and_timeout_may_be_changed(both: Both) -> None:
    with datagrams(lambda request, count: None) as (url, came):
        client = both.client(url)
        assert (client.timeout, client.tries, client.profile.name) == (0.5, 5, "udp")
        client.timeout, client.tries = 0.01, 2
        with pytest.raises(CallTimeout):
            both.run(client.call(f.service_start))
        with pytest.raises(CallTimeout):
            both.run(client.request(f.service_start, timeout=0.02))
        with pytest.raises(InvalidValue):
            client.tries = 1.5
        both.run(client.close())
    assert [request.reserved for request in came] == [1, 1, 3, 3]


def test_what_is_usual_with_tcp(both: Both) -> None:
    with BadPeer(lambda line: line.wait_for_end()) as peer:
        client = both.client(peer.url)
        assert (client.timeout, client.profile.name) == (3.0, "tcp")
        both.run(client.close())


def test_nothing_is_sent_twice_with_tcp(both: Both) -> None:
    came: list[packet.Packet] = []

    def script(line: Line) -> None:
        while True:
            came.append(line.request())

    with BadPeer(script) as peer:
        client = both.client(peer.url, tries=7)
        client.timeout = SHORT
        with pytest.raises(CallTimeout) as caught:
            both.run(client.call(f.service_start))
        both.run(client.close())
        assert peer.ended.acquire(timeout=PATIENT)  # it has read everything
    assert caught.value.seconds == SHORT
    assert [(request.serial, request.reserved) for request in came] == [(1, 0)]


@with_longer_times(SHORT, 1.0, PATIENT)
def test_an_answer_to_a_later_try(both: Both, short: float) -> None:
    with datagrams(lambda request, count: reply(request, f"try {count + 1}") if count >= 2 else None) as (url, came):
        client = both.client(url, timeout=short)
        try:
            answer = both.run(client.call(f.controller_execute, 1, "Echo", None))
        except CallTimeout:
            answer = None
        both.run(client.close())
    if len(came) > 3:  # the reply to the third try did not arrive in time
        raise TooSlow
    assert answer == "try 3"
    assert len(came) == 3


def test_a_packet_that_is_too_long_for_a_datagram(both: Both) -> None:
    with datagrams(lambda request, count: reply(request, None)) as (url, came):
        client = both.client(url)
        with pytest.raises(InvalidValue, match="exceeds the limit of 503 bytes"):
            both.run(client.call(f.controller_execute, 1, "Echo", bytes(500)))
        both.run(client.call(f.controller_execute, 1, "Echo", bytes(400)))
        both.run(client.close())
    assert len(came) == 1


def test_nobody_listens(both: Both) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(ConnectFailed, match="no program listens at this address"):
        both.connect(url)
    client = both.client(url)
    with pytest.raises(ConnectFailed):
        both.run(client.call(f.service_start))
    with pytest.raises(ConnectionClosed):
        both.run(client.call(f.service_start))


def test_nobody_answers(both: Both) -> None:
    with (
        datagrams(lambda request, count: None) as (url, _),
        pytest.raises(CallTimeout, match="that the controller is on") as caught,
    ):
        both.connect(url, timeout=0.02, tries=3)
    assert (caught.value.function, caught.value.seconds) == ("Service_Start", pytest.approx(0.06))


def test_nobody_answers_on_a_serial_line(both: Both) -> None:
    master, slave = os.openpty()
    try:
        with pytest.raises(CallTimeout) as caught:
            both.connect(f"serial://{os.ttyname(slave)}", timeout=0.02, tries=3)
        assert caught.value.seconds == pytest.approx(0.06)
        with pytest.raises(CallTimeout):  # it has been closed, so it can be opened again
            both.connect(f"serial://{os.ttyname(slave)}", timeout=0.02, tries=1)
    finally:
        os.close(master)
        os.close(slave)


def test_a_port_that_is_pulled_out_ends_a_call(both: Both) -> None:
    master, slave = os.openpty()
    client = both.client(f"serial://{os.ttyname(slave)}", timeout=PATIENT)

    def pull_out() -> None:
        select.select([master], [], [], PATIENT)
        os.close(slave)
        os.close(master)

    pulling = threading.Thread(target=pull_out)
    pulling.start()
    with pytest.raises(ConnectionLost):
        both.run(client.call(f.service_start))
    pulling.join()
    with pytest.raises(ConnectionClosed):
        both.run(client.call(f.service_start))


@pytest.mark.parametrize("url", ["pty://", "serial://", "udp://"])
def test_addresses_that_no_client_can_use(both: Both, url: str) -> None:
    with pytest.raises(InvalidAddress):
        both.client(url)
