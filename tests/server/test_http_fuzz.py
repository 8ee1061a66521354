"""Thousands of invalid requests to an e-CAP server, and hundreds of clients that never finish theirs; others are served.

Each reply is checked (``http_judge.py``): the correct status; the correct code if the body cannot be decoded; otherwise a
valid e-CAP reply; never a 5xx. Two normal clients, over HTTP and over TCP, receive correct values throughout. Afterwards
all objects of the invalid clients have been released, and the arm has not moved.
"""

from __future__ import annotations

import http.client
import logging
import random
import resource
import socket
import ssl
import threading
from collections import Counter
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.stage import Stage
from orinkit.values.codec import PacketLimits
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Recorder, Workshop
from support.http_beside import IDLE, Breaks, Crowd, Guest, Neighbour, Served, place, quiet, settled
from support.http_garbage import FORM, OPENINGS, Garbage
from support.http_judge import Broken, converse, cut_off, expected, judge
from support.http_peers import CERTIFICATE, KEY

pytestmark = pytest.mark.slow

REQUESTS = 1_000
LIMITS = PacketLimits(packet=4 << 20)
RELEASES = {entry.name for entry in FUNCTIONS.values() if entry.releases}
MAKES = {entry.name for entry in FUNCTIONS.values() if entry.creates}
CROWDED = 300
TURNS = 300


@pytest.fixture
def served() -> Iterator[Served]:
    rc8, recorder, workshop = VirtualRC8(), Recorder(), Workshop()
    with orinkit.serve(
        [rc8, recorder, workshop],
        "http://127.0.0.1:0",
        "tcp://127.0.0.1:0",
        limits=LIMITS,
        invoke_timeout=5.0,
        http=HttpOptions(idle=IDLE),
    ) as server:
        yield Served(server, rc8, recorder, workshop)


def fuzz(served: Served, seed: int, requests: int) -> tuple[Counter[int], Counter[int]]:
    """Send streams and check the replies; return the number of replies of each status and of each return code."""
    garbage = Garbage(seed)
    chance = garbage.chance
    statuses: Counter[int] = Counter()
    codes: Counter[int] = Counter()
    sent = missing = 0
    guest: Guest | None = None
    while sent < requests:
        if guest is None or chance.random() < 0.3:
            guest = Guest(served.address, keeps_cookie=chance.random() < 0.8)
        stream = garbage.stream(guest.handles, guest.cookie)
        if stream.cut is not None:
            sent += 1
            cut_off(served.address, stream.data[: stream.cut], hard=chance.random() < 0.5)
            continue
        wanted = expected(stream.data)
        try:
            answers, reset = converse(served.address, stream.data, wanted, LIMITS)
            judge(wanted, answers, LIMITS, reset=reset)
        except Broken as error:
            raise AssertionError(f"seed {seed}, request {sent}: {error}\n{stream.data[:6000]!r}") from error
        sent += len(answers)
        missing += max(0, wanted.answers(LIMITS) - len(answers)) if reset else 0
        statuses.update(answer.status for answer in answers)
        codes.update(int(answer.body.strip()[:10], 16) for answer in answers if answer.status == 200)
    assert missing <= requests / 20  # otherwise too few replies would be checked
    return statuses, codes


@pytest.fixture
def breaks() -> Iterator[Breaks]:
    """Keep the exceptions of the workshop out of the log, and count them."""
    session = logging.getLogger("orinkit.session")
    kept = Breaks()
    session.filters.insert(0, kept)  # before the rate limit, which would suppress other errors of the device too
    yield kept
    session.removeFilter(kept)


# --- invalid requests -------------------------------------------------------------------------------------------------


def garbage_beside_others(
    served: Served, caplog: pytest.LogCaptureFixture, breaks: Breaks, seed: int, requests: int
) -> tuple[Counter[int], Counter[int]]:
    """Fuzz a server while two other clients make calls, and check that nothing is left behind."""
    caplog.set_level(logging.ERROR)
    arm = served.rc8.state.arm
    joints = tuple(arm.queue.joints)
    fuzz(served, seed + 1, 60)  # fills caches and pools
    before, numbers = quiet(served.server)
    made = len(served.recorder.calls)
    with Neighbour(served.server.urls[0], "S77") as web, Neighbour(served.server.urls[1], "S88") as tcp:
        statuses, codes = fuzz(served, seed, requests)
    for neighbour in (web, tcp):
        assert neighbour.error is None
        assert neighbour.turns > 100
    assert [f"{record.name}: {record.getMessage()}" for record in caplog.records] == []
    assert breaks.count > 0
    left, now = settled(served.server, before, numbers)
    assert left == []
    assert now == numbers
    calls = Counter(
        call.function in RELEASES for call in served.recorder.calls[made:] if call.function in RELEASES | MAKES
    )
    assert calls[True] == calls[False] > 0  # every object was released
    assert tuple(arm.queue.joints) == joints
    return statuses, codes


@pytest.mark.timeout(180)
def test_invalid_requests(served: Served, caplog: pytest.LogCaptureFixture, breaks: Breaks) -> None:
    statuses, codes = garbage_beside_others(served, caplog, breaks, 2024, REQUESTS)
    # all kinds of replies occurred: the requests are neither all completely invalid nor all nearly valid
    assert set(statuses) >= {200, 400, 403, 405, 413, 415, 421}
    for code in (
        hresult.S_OK,
        hresult.E_NOTIMPL,
        hresult.E_HANDLE,
        hresult.E_INVALIDARG,
        hresult.E_FAIL,
        hresult.E_TIMEOUT,
    ):
        assert codes[code] > 0, hresult.lookup(code).name


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_many_more_invalid_requests(served: Served, caplog: pytest.LogCaptureFixture, breaks: Breaks) -> None:
    garbage_beside_others(served, caplog, breaks, 7, 20 * REQUESTS)


def client_hello(context: ssl.SSLContext) -> bytes:
    """Return the first bytes that a TLS client sends."""
    received, sent = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        context.wrap_bio(received, sent, server_hostname="localhost").do_handshake()
    except ssl.SSLWantReadError:
        pass
    return sent.read()


def test_garbage_instead_of_tls(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    chance, context = random.Random(5), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    options = HttpOptions(cert=str(CERTIFICATE), key=str(KEY), idle=IDLE)
    with orinkit.serve(VirtualRC8(), "https://127.0.0.1:0", http=options) as server:
        with Neighbour(server.url, "S77", cafile=str(CERTIFICATE)):
            pass  # everything that is loaded only once is loaded now
        before, numbers = quiet(server)
        connections, pause = 0, threading.Event()
        with Neighbour(server.url, "S77", cafile=str(CERTIFICATE)) as web:
            while connections < 300 or (web.turns < 50 and web.error is None):
                connections += 1
                hello = bytearray(client_hello(context))
                for _ in range(chance.choice([0, 0, 1, 5])):
                    hello[chance.randrange(len(hello))] ^= 1 << chance.randrange(8)
                sent = chance.choice([*OPENINGS, bytes(hello), bytes(hello)])
                cut_off(place(server), sent[: chance.randrange(len(sent) + 1)], hard=chance.random() < 0.5)
                pause.wait(0.003)
        assert web.error is None
        left, now = settled(server, before, numbers)
        assert left == []
        assert now == numbers
    assert [f"{record.name}: {record.getMessage()}" for record in caplog.records] == []


# --- clients that never finish their requests -------------------------------------------------------------------------


@pytest.fixture
def room() -> Iterator[None]:
    """Allow enough descriptors for both ends of all connections."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = 4096 if before[1] == resource.RLIM_INFINITY else min(4096, before[1])
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(before[0], limit), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def ask(connection: http.client.HTTPConnection) -> bytes:
    """Make a call that changes nothing."""
    connection.request("POST", "/", "Func=101,Arg1=0", {"Content-Type": FORM.decode()})
    return connection.getresponse().read()


def test_connections_without_a_request_do_not_displace_others(served: Served, room: None) -> None:
    """A connection that is idle between two calls outlives any number of connections without a request."""
    idle = http.client.HTTPConnection(*served.address, timeout=20.0)
    silent: list[socket.socket] = []
    try:
        assert ask(idle) == b"0x80070006"
        silent += [socket.create_connection(served.address, 20.0) for _ in range(1300)]  # 512 are accepted, 512 wait
        assert ask(idle) == b"0x80070006"  # over the same connection: http.client opens no other
    finally:
        idle.close()
        for connection in silent:
            connection.close()


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_burst_of_connections(scheme: str) -> None:
    """More connections at once than the limit allows: those closed before their handshake leave nothing behind."""
    options = HttpOptions(cert=str(CERTIFICATE), key=str(KEY), idle=IDLE)
    with orinkit.serve(Workshop(), f"{scheme}://127.0.0.1:0", clients=1, http=options) as server:
        before, numbers = quiet(server)
        go = threading.Event()
        server._loop.call_soon_threadsafe(go.wait, 20.0)
        burst = [socket.create_connection(place(server), 20.0) for _ in range(300)]
        go.set()
        for connection in burst:
            connection.close()
        left, now = settled(server, before, numbers)
        assert left == []
        assert now == numbers


@pytest.mark.timeout(180)
@pytest.mark.parametrize("pace", [0.2, pytest.param(1.0, marks=pytest.mark.soak)])
def test_crowd(
    served: Served,
    caplog: pytest.LogCaptureFixture,
    breaks: Breaks,
    room: None,
    monkeypatch: pytest.MonkeyPatch,
    pace: float,
) -> None:
    """450 clients that never finish, more than the limit allows, and invalid requests; others make all their calls."""
    caplog.set_level(logging.ERROR)
    for stage in (Stage.NEW, Stage.HEADER, Stage.BODY):
        monkeypatch.setattr(stage, "seconds", pace * stage.seconds)
    fuzz(served, 1, 60)
    before, numbers = quiet(served.server)
    with Crowd(served.address) as crowd:
        crowd.wait(lambda: crowd.there >= CROWDED)
        with Neighbour(served.server.urls[0], "S77") as web, Neighbour(served.server.urls[1], "S88") as tcp:
            fuzz(served, 2, 200)
            crowd.wait(lambda: min(web.turns, tcp.turns) >= TURNS or bool(web.error or tcp.error))
        assert (web.error, tcp.error) == (None, None)
        crowd.wait(lambda: crowd.there >= CROWDED)  # they were connected all the time
        for number in range(20):  # there is always room for a new client
            with orinkit.connect(served.server.urls[0], timeout=20.0) as controller:
                controller.variable("I9").value = number
                assert controller.variable("I9").value == number
    assert crowd.there == 0
    assert crowd.closed["HTTP/1.1 408 Request Timeout"] >= CROWDED / 3
    assert set(crowd.closed) == {"", "HTTP/1.1 408 Request Timeout"}
    assert [f"{record.name}: {record.getMessage()}" for record in caplog.records] == []
    left, now = settled(served.server, before, numbers)
    assert left == []
    assert now == numbers
