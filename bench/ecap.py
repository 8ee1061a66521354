"""e-CAP: a round trip, and 50 clients at once, against a bare starlette echo and bare httpx2. Part of ``make bench``.

Both servers are processes of their own and have the same uvicorn; the call is Variable_GetValue, over connections that are
kept.
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
    """Answer every request with its own body."""

    async def echo(request: Request) -> PlainTextResponse:
        return PlainTextResponse(await request.body())

    on_core(-1)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listener:
        # the protocol is named, as asyncio sends replies at once (TCP_NODELAY) only where it is
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
    """Run both servers; yields the addresses over b-CAP and over e-CAP, and that of the echo."""
    with process(both_servers) as urls, process(echo_server) as echo:
        tcp, http = urls.split()
        yield tcp, http, echo


def ecap(count: int, seconds: float) -> None:
    """Everything that is measured of e-CAP.

    Args:
        count: calls of each round.
        seconds: of each round with many clients.
    """
    with served() as (tcp, http, echo):
        sync = choose("e-CAP round trip, sync client", "e-CAP 往復, 同期クライアント")
        line(sync, *middle([synchronous(http, echo, count) for _ in range(ROUNDS)]), "us", AIM)
        asynchronous_ = choose("e-CAP round trip, async client", "e-CAP 往復, 非同期クライアント")
        line(asynchronous_, *middle([asyncio.run(asynchronous(http, echo, count)) for _ in range(ROUNDS)]), "us", AIM)
        asyncio.run(together(tcp, http, echo, seconds))


def synchronous(url: str, echo: str, count: int) -> tuple[float, float, float]:
    """Call and post by turns; returns both medians and their ratio."""
    with orinkit.open_client(url) as client, httpx2.Client(trust_env=False, headers=FORM) as bare:
        handle = client.call(functions.controller_connect, "", PROVIDER, "localhost", "")
        variable = client.call(functions.controller_get_variable, handle, "D1", "")
        call, post = client.call, bare.post
        return in_turn(
            lambda: call(functions.variable_get_value, variable), lambda: post(echo, content=BODY).content, count
        )


async def asynchronous(url: str, echo: str, count: int) -> tuple[float, float, float]:
    """The same in asyncio."""
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
    """Return what gets the value of a variable."""
    await client.call(functions.service_start, "")
    handle = await client.call(functions.controller_connect, "", PROVIDER, "localhost", "")
    variable = await client.call(functions.controller_get_variable, handle, "D1", "")
    return lambda: client.call(functions.variable_get_value, variable)


# --- many at once -----------------------------------------------------------------------------------------------------


class Crowd(NamedTuple):
    """What many clients at once did.

    Attributes:
        rate: calls per second of all together.
        p50: ms.
        p99: ms.
        share: calls of the client that made fewest, as a part of the mean.
    """

    rate: float
    p50: float
    p99: float
    share: float


async def all_at_once(calls: list[Callable[[], Awaitable[object]]], seconds: float) -> Crowd:
    """Have each client call as fast as it can."""
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
    """50 clients at once: over e-CAP, over b-CAP, and bare ones, by turns."""
    async with AsyncExitStack() as stack:

        async def clients(url: str) -> list[Callable[[], Awaitable[object]]]:
            opened = [await stack.enter_async_context(aio.open_client(url)) for _ in range(CLIENTS)]
            return [await caller(client) for client in opened]

        def poster(client: httpx2.AsyncClient) -> Callable[[], Awaitable[object]]:
            return lambda: client.post(echo, content=BODY)

        bare = [
            await stack.enter_async_context(httpx2.AsyncClient(trust_env=False, headers=FORM)) for _ in range(CLIENTS)
        ]
        ways = {"e-CAP": await clients(http), "b-CAP TCP": await clients(tcp), "httpx2": list(map(poster, bare))}
        results: dict[str, list[Crowd]] = {name: [] for name in ways}
        for _ in range(CLIENT_ROUNDS):
            for name, calls in ways.items():
                results[name].append(await all_at_once(calls, seconds))
    reference = middle_of(results["httpx2"])
    for name in ("e-CAP", "b-CAP TCP"):
        crowd = middle_of(results[name])
        ratio = statistics.median(
            ours.rate / other.rate for ours, other in zip(results[name], results["httpx2"], strict=True)
        )
        what = choose(f"{CLIENTS} clients at once, {name}, calls/s", f"同時 {CLIENTS} クライアント, {name}, 呼び出し/s")
        line(what, crowd.rate, reference.rate, ratio, "/s", told(crowd, reference))


def middle_of(crowds: list[Crowd]) -> Crowd:
    """Return the median of each figure."""
    columns: Any = zip(*crowds, strict=True)
    return Crowd(*map(statistics.median, columns))


def told(crowd: Crowd, bare: Crowd) -> str:
    """Return what else there is to say."""
    return choose(
        f"p50 {crowd.p50:.1f} p99 {crowd.p99:.1f} ms (bare {bare.p50:.1f}, {bare.p99:.1f}), "
        f"slowest client {crowd.share:.2f} of the mean (bare {bare.share:.2f})",
        f"p50 {crowd.p50:.1f} p99 {crowd.p99:.1f} ms (素の実装 {bare.p50:.1f}, {bare.p99:.1f}), "
        f"最も遅いクライアントは平均の {crowd.share:.2f} 倍 (素の実装 {bare.share:.2f})",
    )
