"""e-CAP: a round trip, and 50 concurrent clients, against a bare starlette echo and bare httpx2. Part of ``make bench``.

Both servers run in separate processes with the same uvicorn; the call is Variable_GetValue over persistent connections.
"""

from __future__ import annotations

import asyncio
import multiprocessing.connection
import socket
import statistics
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, contextmanager
from typing import Any, NamedTuple

import httpx2
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

import orinkit
from measuring import ROUNDS, in_turn, line, medians, middle, on_core, process
from orinkit import aio, functions
from orinkit.core.i18n import choose
from orinkit.ecap.message import write_request
from served import PROVIDER, both_servers

CLIENTS = 50
CLIENT_ROUNDS = 3
AIM = "aim <= 1.2"
BODY = write_request(functions.variable_get_value, (3,))
FORM = {"Content-Type": "application/x-www-form-urlencoded"}


def echo_server(pipe: multiprocessing.connection.Connection) -> None:
    """Reply to every request with the body of the request."""

    async def echo(request: Request) -> PlainTextResponse:
        return PlainTextResponse(await request.body())

    on_core(-1)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listener:
        # The socket is created with IPPROTO_TCP, because asyncio sets TCP_NODELAY only on such sockets.
        listener.bind(("127.0.0.1", 0))
        listener.listen(512)
        pipe.send(f"http://127.0.0.1:{listener.getsockname()[1]}/")
        app = Starlette(routes=[Route("/", echo, methods=["POST"])])
        config = uvicorn.Config(
            app, http="h11", loop="asyncio", lifespan="off", log_level="critical", access_log=False, date_header=False
        )
        uvicorn.Server(config).run(sockets=[listener])


@contextmanager
def served() -> Iterator[tuple[str, str, str]]:
    """Run both servers; yield the addresses of b-CAP, of e-CAP and of the echo."""
    with process(both_servers) as urls, process(echo_server) as echo:
        tcp, http = urls.split()
        yield tcp, http, echo


def ecap(count: int, seconds: float) -> None:
    """Run all measurements of e-CAP.

    Args:
        count: Number of calls per round.
        seconds: Duration of each round with many clients, s.
    """
    with served() as (tcp, http, echo):
        sync = choose("e-CAP round trip, sync client", "e-CAP 往復, 同期クライアント")
        line(sync, *middle([synchronous(http, echo, count) for _ in range(ROUNDS)]), "us", AIM)
        asynchronous_ = choose("e-CAP round trip, async client", "e-CAP 往復, 非同期クライアント")
        line(asynchronous_, *middle([asyncio.run(asynchronous(http, echo, count)) for _ in range(ROUNDS)]), "us", AIM)
        asyncio.run(together(tcp, http, echo, seconds))


def synchronous(url: str, echo: str, count: int) -> tuple[float, float, float]:
    """Alternate calls and bare posts; return both medians and their ratio."""
    with orinkit.open_client(url) as client, httpx2.Client(trust_env=False, headers=FORM) as bare:
        handle = client.call(functions.controller_connect, "", PROVIDER, "localhost", "")
        variable = client.call(functions.controller_get_variable, handle, "D1", "")
        call, post = client.call, bare.post
        return in_turn(
            lambda: call(functions.variable_get_value, variable), lambda: post(echo, content=BODY).content, count
        )


async def asynchronous(url: str, echo: str, count: int) -> tuple[float, float, float]:
    """Alternate calls and bare posts in asyncio; return both medians and their ratio."""
    async with aio.open_client(url) as client, httpx2.AsyncClient(trust_env=False, headers=FORM) as bare:
        call = await caller(client)
        ours, other = [], []
        for number in range(count + count // 10):
            begin = time.perf_counter()
            await call()
            between = time.perf_counter()
            await bare.post(echo, content=BODY)
            if number >= count // 10:
                ours.append(between - begin)
                other.append(time.perf_counter() - between)
        return medians(ours, other)


async def caller(client: aio.AsyncClient) -> Callable[[], Awaitable[object]]:
    """Return a function that reads a variable."""
    await client.call(functions.service_start, "")
    handle = await client.call(functions.controller_connect, "", PROVIDER, "localhost", "")
    variable = await client.call(functions.controller_get_variable, handle, "D1", "")
    return lambda: client.call(functions.variable_get_value, variable)


# --- many concurrent clients ------------------------------------------------------------------------------------------


class Crowd(NamedTuple):
    """Result for many concurrent clients.

    Attributes:
        rate: Calls per second of all clients together.
        p50: Median duration of a call, ms.
        p99: 99th percentile of the duration of a call, ms.
        share: Number of calls of the slowest client, as a fraction of the mean.
    """

    rate: float
    p50: float
    p99: float
    share: float


async def all_at_once(calls: list[Callable[[], Awaitable[object]]], seconds: float) -> Crowd:
    """Run all clients at the same time; each calls as fast as possible."""
    clock = time.perf_counter
    begin = clock()
    end = begin + seconds

    async def work(call: Callable[[], Awaitable[object]]) -> list[float]:
        times = []
        now = clock()
        while now < end:
            await call()
            times.append(clock() - now)
            now = clock()
        return times

    each = await asyncio.gather(*map(work, calls))
    elapsed = clock() - begin
    spent = sorted(took for times in each for took in times)
    fewest, mean = min(map(len, each)), len(spent) / len(each)
    return Crowd(len(spent) / elapsed, spent[len(spent) // 2] * 1e3, spent[len(spent) * 99 // 100] * 1e3, fewest / mean)


async def together(tcp: str, http: str, echo: str, seconds: float) -> None:
    """Measure 50 concurrent clients, alternately over e-CAP, over b-CAP and with bare httpx2."""
    async with AsyncExitStack() as stack:

        async def clients(url: str) -> list[Callable[[], Awaitable[object]]]:
            opened = [await stack.enter_async_context(aio.open_client(url)) for _ in range(CLIENTS)]
            return [await caller(client) for client in opened]

        def poster(client: httpx2.AsyncClient) -> Callable[[], Awaitable[object]]:
            return lambda: client.post(echo, content=BODY)

        bare = [
            await stack.enter_async_context(httpx2.AsyncClient(trust_env=False, headers=FORM)) for _ in range(CLIENTS)
        ]
        crowds = {"e-CAP": await clients(http), "b-CAP TCP": await clients(tcp), "httpx2": list(map(poster, bare))}
        results: dict[str, list[Crowd]] = {name: [] for name in crowds}
        for _ in range(CLIENT_ROUNDS):
            for name, calls in crowds.items():
                results[name].append(await all_at_once(calls, seconds))
    reference = middle_of(results["httpx2"])
    for name in ("e-CAP", "b-CAP TCP"):
        crowd = middle_of(results[name])
        ratio = statistics.median(
            ours.rate / other.rate for ours, other in zip(results[name], results["httpx2"], strict=True)
        )
        what = choose(
            f"{CLIENTS} concurrent clients, {name}, calls/s", f"同時 {CLIENTS} クライアント, {name}, 呼び出し/s"
        )
        line(what, crowd.rate, reference.rate, ratio, "/s", details(crowd, reference))


def middle_of(crowds: list[Crowd]) -> Crowd:
    """Return the median of each value."""
    columns: Any = zip(*crowds, strict=True)
    return Crowd(*map(statistics.median, columns))


def details(crowd: Crowd, bare: Crowd) -> str:
    """Return the durations of calls and the share of the slowest client as text."""
    return choose(
        f"p50 {crowd.p50:.1f} p99 {crowd.p99:.1f} ms (bare {bare.p50:.1f}, {bare.p99:.1f}), "
        f"slowest client {crowd.share:.2f} of the mean (bare {bare.share:.2f})",
        f"p50 {crowd.p50:.1f} p99 {crowd.p99:.1f} ms (素の実装 {bare.p50:.1f}, {bare.p99:.1f}), "
        f"最も遅いクライアントは平均の {crowd.share:.2f} 倍 (素の実装 {bare.share:.2f})",
    )
