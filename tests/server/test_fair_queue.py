"""The queue that shares the time of an event loop between clients, with a clock that only the steps advance."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from orinkit.server.fair_queue import BUDGET, SLICE, FairQueue, QueuedClient, queue_of

MS = 0.001


class Client(QueuedClient):
    """A client whose steps take a given time; records the number of each step."""

    def __init__(self, world: World, name: str, cost: float, steps: int = 10**9, *, precedence: bool = False) -> None:
        self._world = world
        self.has_precedence = precedence
        self.name = name
        self.cost = cost
        self.left = steps
        self.used = 0.0
        self.aborted = False

    def step(self) -> bool:
        self.left -= 1
        self.used += self.cost
        self._world.now += self.cost
        self._world.done.append(self.name)
        return self.left > 0

    def abort(self) -> None:
        self.aborted = True

    def serve(self, expected: float = 0.0) -> None:
        self._world.queue.serve(self, expected)


class World:
    """A queue and its clock.

    Attributes:
        done: names of the clients whose steps have been performed.
    """

    def __init__(self) -> None:
        self.now = 100.0
        self.done: list[str] = []
        self.queue = FairQueue(lambda: self.now)

    def client(self, name: str, cost: float, steps: int = 10**9, *, precedence: bool = False) -> Client:
        return Client(self, name, cost, steps, precedence=precedence)

    async def turn(self, others: float = 0.0) -> list[str]:
        """Wait for a turn of the loop, in which other work takes ``others`` s; return the steps of this turn."""
        before = len(self.done)
        self.now += others
        await asyncio.sleep(0)
        return self.done[before:]


def in_a_loop(test: Callable[[World], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    def run() -> None:
        asyncio.run(test(World()))

    run.__name__ = test.__name__
    return run


@in_a_loop
async def test_a_client_with_one_request_is_served_immediately(world: World) -> None:
    for _ in range(1000):
        client = world.client("one", 0.1 * MS, 1)
        client.serve()
        assert not client.is_queued
        assert client.left == 0
        await world.turn(0.1 * MS)


@in_a_loop
async def test_a_client_with_many_requests_waits_after_one_slice(world: World) -> None:
    client = world.client("many", 0.1 * MS)
    client.serve()
    assert client.is_queued
    assert len(world.done) == pytest.approx(SLICE / (0.1 * MS), abs=1)
    client.serve()
    assert len(world.done) == pytest.approx(SLICE / (0.1 * MS), abs=1)


@in_a_loop
async def test_a_turn_serves_at_most_the_budget(world: World) -> None:
    clients = [world.client(f"{number}", 1 * MS, 1) for number in range(100)]
    for client in clients:
        client.serve()
    most = round(BUDGET / MS)
    assert len(world.done) == most
    while any(client.is_queued for client in clients):
        assert 1 <= len(await world.turn()) <= most
    assert world.done == [client.name for client in clients]


@in_a_loop
async def test_single_requests_are_served_immediately_until_the_budget_is_used(world: World) -> None:
    for _ in range(100):
        world.client("short", 0.1 * MS, 1).serve()
    assert len(world.done) == pytest.approx(BUDGET / (0.1 * MS), abs=1)
    before = len(world.done)
    await world.turn()
    assert before < len(world.done) <= 2 * before


@in_a_loop
async def test_single_requests_in_short_turns_are_never_queued(world: World) -> None:
    clients = [world.client(f"{number}", 0.03 * MS) for number in range(50)]
    for _ in range(100):
        for client in clients:
            client.left = 1
            client.serve()
            assert not client.is_queued
        await world.turn()


@in_a_loop
async def test_other_work_of_the_loop_counts_up_to_half_of_the_budget(world: World) -> None:
    world.client("many", 0.5 * MS).serve()
    await world.turn()
    assert len(await world.turn()) == pytest.approx(BUDGET / (0.5 * MS), abs=1)
    assert len(await world.turn(50 * MS)) == pytest.approx(BUDGET / 2 / (0.5 * MS), abs=1)


@in_a_loop
async def test_the_time_is_shared_not_the_number_of_steps(world: World) -> None:
    clients = [world.client("heavy", 3 * MS), world.client("light", 0.05 * MS), world.client("medium", 0.4 * MS)]
    for client in clients:
        client.serve()
    for _ in range(1000):
        await world.turn()
    total = sum(client.used for client in clients)
    for client in clients:
        assert client.used == pytest.approx(total / 3, rel=0.02)


@in_a_loop
async def test_a_stall_of_the_machine_during_a_step_does_not_starve_the_client(world: World) -> None:
    crowd = [world.client("crowd", 0.5 * MS) for _ in range(10)]
    for client in crowd:
        client.serve()
    stalled = world.client("stalled", 1.0, 2)
    stalled.serve()
    while stalled.left:
        await world.turn()
    assert world.done[::-1].index("stalled", 1) <= 2 * len(crowd) * BUDGET / (0.5 * MS)


@in_a_loop
async def test_a_new_client_does_not_wait_for_the_heavy_work_of_many(world: World) -> None:
    crowd = [world.client("heavy", 5 * MS, 3) for _ in range(200)]
    for client in crowd:
        client.serve(5 * MS)
    for _ in range(50):
        await world.turn()
    new = world.client("new", 0.05 * MS, 1)
    new.serve(0.01 * MS)
    await world.turn()
    await world.turn()
    assert new.left == 0
    assert sum(client.left for client in crowd) > 400


@in_a_loop
async def test_a_client_that_has_used_much_time_waits_for_the_others_only_as_long(world: World) -> None:
    """Idle time is not saved: a client cannot use the time that it has not used before at once."""
    late, busy = world.client("late", 0.5 * MS), world.client("busy", 0.5 * MS)
    busy.serve()
    for _ in range(1000):
        await world.turn()
    late.serve()
    before = busy.used
    for _ in range(100):
        await world.turn()
    assert busy.used - before == pytest.approx(late.used, rel=0.05)


@in_a_loop
async def test_expected_heavy_work_is_not_postponed_forever(world: World) -> None:
    heavy = world.client("heavy", 0.1 * MS, 1)
    world.client("many", 1 * MS).serve()
    heavy.serve(1 * MS)
    for _ in range(20):
        for number in range(20):
            world.client(f"new {number}", 0.3 * MS, 1).serve()
        await world.turn()
    assert heavy.left == 0


@in_a_loop
async def test_a_client_with_precedence_is_served_first_and_does_not_stop_the_others(world: World) -> None:
    for _ in range(50):
        world.client("crowd", 1 * MS).serve()
    first = world.client("first", 1 * MS, 1, precedence=True)
    first.serve(1 * MS)
    assert first.left == 0  # although the budget of this turn is used
    world.client("operator", 1 * MS, precedence=True).serve()
    for _ in range(20):
        await world.turn()
    assert world.done[-100:].count("operator") >= 40
    assert world.done[-100:].count("crowd") >= 20


@in_a_loop
async def test_an_exception_ends_only_the_client_that_caused_it(world: World) -> None:
    class Broken(Client):
        def step(self) -> bool:
            raise RuntimeError("broken")

    broken, queued = Broken(world, "broken", 0.0), Broken(world, "queued", 0.0)
    broken.serve()
    assert broken.aborted
    assert not broken.is_queued
    many = world.client("many", 1 * MS, 20)
    many.serve()
    queued.serve(1.0)
    while many.is_queued or queued.is_queued:
        await world.turn()
    assert queued.aborted
    assert many.left == 0


@in_a_loop
async def test_a_client_may_continue_after_it_was_served(world: World) -> None:
    client = world.client("again", 0.4 * MS, 3)
    for number in range(20):
        client.left = 3
        client.serve()
        while client.is_queued:
            await world.turn()
        assert len(world.done) == 3 * (number + 1)


def test_all_servers_of_a_loop_share_a_queue() -> None:
    async def own() -> FairQueue:
        loop = asyncio.get_running_loop()
        assert queue_of(loop) is queue_of(loop)
        return queue_of(loop)

    assert asyncio.run(own()) is not asyncio.run(own())
