"""Many clients at once, and one after the other: no reply is lost or mixed up, and nothing is left behind."""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import orinkit
from orinkit import aio
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cao.provider import Provider
from orinkit.cao.session import Session
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Workshop
from support.leaping import settle
from support.peers import RawClient

PATIENT = 60.0
CLIENTS = 200
DESCRIPTORS = Path("/proc/self/fd")


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    providers: list[Provider] = [VirtualRC8(counts={"I": CLIENTS, "S": CLIENTS}), workshop]
    with orinkit.serve(providers, "tcp://127.0.0.1:0") as served:
        yield served


def test_two_hundred_threads_at_once(server: Server) -> None:
    """Each thread has its own connection and variables, and all are connected at the same time."""
    together = threading.Barrier(CLIENTS)

    def work(number: int) -> int:
        with orinkit.connect(server.url, timeout=PATIENT) as controller:
            together.wait(PATIENT)
            whole, text = controller.variable(f"I{number}"), controller.variable(f"S{number}")
            for turn in range(20):
                whole.value = number * 1000 + turn
                text.value = f"client {number} turn {turn}"
                assert whole.value == number * 1000 + turn
                assert text.value == f"client {number} turn {turn}"
            assert controller.client.stray_replies == 0
            together.wait(PATIENT)
        return turn + 1

    with ThreadPoolExecutor(CLIENTS) as pool:
        assert sum(pool.map(work, range(CLIENTS))) == 20 * CLIENTS


def test_two_hundred_tasks_at_once(server: Server) -> None:
    async def body() -> None:
        connected = 0
        all_connected = asyncio.Event()

        async def work(number: int) -> int:
            nonlocal connected
            async with aio.connect(server.url, timeout=PATIENT) as controller:
                connected += 1
                if connected == CLIENTS:
                    assert server.clients == CLIENTS
                    all_connected.set()
                await all_connected.wait()
                variable = await controller.variable(f"I{number}")
                for turn in range(20):
                    await variable.put_value(number * 1000 + turn)
                    assert await variable.get_value() == number * 1000 + turn
                assert controller.client.stray_replies == 0
            return turn + 1

        assert sum(await asyncio.gather(*map(work, range(CLIENTS)))) == 20 * CLIENTS

    asyncio.run(body())


def test_two_hundred_clients_write_one_variable(server: Server) -> None:
    """All clients write the same variable, each with its own text: a value read is always one of those written."""

    async def body() -> None:
        async def work(number: int) -> None:
            async with aio.connect(server.url, timeout=PATIENT) as controller:
                shared, own = await controller.variable("S0"), await controller.variable(f"I{number}")
                await own.put_value(-number)
                for turn in range(5):
                    await shared.put_value(f"{number}:{turn}:{number}")
                    first, _, last = (await shared.get_value()).split(":")
                    assert first == last

        await asyncio.gather(*map(work, range(CLIENTS)))
        async with aio.connect(server.url, timeout=PATIENT) as controller:
            for number in range(CLIENTS):
                assert await (await controller.variable(f"I{number}")).get_value() == -number

    asyncio.run(body())


# --- connecting and disconnecting repeatedly --------------------------------------------------------------------------


def properly(server: Server) -> None:
    with orinkit.connect(server.url, timeout=PATIENT) as controller:
        controller.variable("I1").value = 1


def without_notice(server: Server) -> None:
    """Disconnect without releasing objects, and during a call."""
    with RawClient(server.url) as raw:
        handle = raw.ask(3, "", "Test.Workshop", "", "")
        for _ in range(5):
            raw.ask(9, handle, "v", "")
        raw.request(17, handle, "Wait", None)


def in_the_middle_of_a_packet(server: Server) -> None:
    with RawClient(server.url) as raw:
        raw.ask(1)
        raw.send(packet.encode(Packet(2, 3, ["x" * 100, "", "", ""]))[:50])


def with_invalid_bytes(server: Server) -> None:
    with RawClient(server.url) as raw:
        raw.send(b"\x01\x00\x00\x00\x00nonsense")
        raw.packet()


def without_reading(server: Server) -> None:
    with RawClient(server.url, receive_buffer=4096) as raw:
        handle = raw.ask(3, "", "Test.Workshop", "", "")
        raw.send(packet.encode(Packet(1, 17, [handle, "Large", 50_000])) * 20)


def one_of_each(server: Server) -> None:
    for disconnect in DISCONNECTIONS:
        disconnect(server)


DISCONNECTIONS: list[Callable[[Server], None]] = [
    properly,
    without_notice,
    in_the_middle_of_a_packet,
    with_invalid_bytes,
    without_reading,
]


def left_over() -> dict[str, int]:
    """Return the number of each kind of object that a connection leaves behind if it is not cleaned up."""
    gc.collect()
    return {
        "descriptors": len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.exists() else 0,
        "threads": threading.active_count(),
        "tasks": sum(isinstance(thing, asyncio.Task) and not thing.done() for thing in gc.get_objects()),
        "sessions": sum(isinstance(thing, Session) for thing in gc.get_objects()),
    }


@pytest.mark.parametrize("rounds", [40, pytest.param(150, marks=pytest.mark.soak)])
def test_many_connections_leave_nothing_behind(
    server: Server, workshop: Workshop, caplog: pytest.LogCaptureFixture, rounds: int
) -> None:
    """Hundreds of clients, of which a fifth disconnect properly and the others in various improper ways."""
    caplog.set_level(logging.ERROR, "orinkit")  # pytest stores every record that is logged
    for _ in range(20):  # fills caches and pools
        one_of_each(server)
    settle(server)
    before = left_over()
    tracemalloc.start()
    try:
        for _ in range(30):
            one_of_each(server)
        settle(server)
        gc.collect()
        middle, _ = tracemalloc.get_traced_memory()
        for _ in range(rounds):
            one_of_each(server)
        settle(server)
        gc.collect()
        end, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert left_over() == before
    assert workshop.made == ["v"] * 5 * (50 + rounds)
    assert workshop.released.count("v") == 5 * (50 + rounds)  # every object of every client, however it disconnected
    assert workshop.released.count("Controller") == 2 * (50 + rounds)
    assert end - middle < 1_000 * rounds  # bytes; a round has five connections, and a session has thousands
    assert caplog.records == []  # not even from asyncio


@pytest.mark.parametrize("count", [300, pytest.param(1000, marks=pytest.mark.soak)])
def test_many_connections_of_the_asynchronous_client(server: Server, count: int) -> None:
    async def body() -> None:
        async def visit(number: int) -> None:
            async with aio.connect(server.url, timeout=PATIENT) as controller:
                variable = await controller.variable(f"I{number % CLIENTS}")
                await variable.put_value(number)

        async def visits(count: int) -> None:
            for begin in range(0, count, 10):
                await asyncio.gather(*map(visit, range(begin, begin + 10)))

        await visits(100)
        settle(server)
        before = left_over()
        await visits(count)
        settle(server)
        await asyncio.sleep(0)
        assert left_over() == before

    asyncio.run(body())


def test_released_objects_do_not_count_towards_the_limit(server: Server) -> None:
    """The client creates and releases ten times as many objects as it may have at the same time."""
    with orinkit.connect(server.url, timeout=PATIENT) as controller:
        for _ in range(5000):
            controller.variable("I1").close()
        for _ in range(5000):
            controller.variable("I1")
        assert controller.variable("I1").value == 0
