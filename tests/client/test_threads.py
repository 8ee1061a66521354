"""One connection used by many threads or tasks, with cancelled and interrupted calls: replies reach the right call."""

from __future__ import annotations

import asyncio
import itertools
import os
import random
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import FrameType
from typing import Any, Self

import pytest

import orinkit
from orinkit import aio
from orinkit import functions as f
from orinkit.core.errors import BusyError, CallTimeout, InvalidValue, OrinError, ProtocolError, TransportError
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.both import LISTEN_AT
from support.devices import Workshop
from support.http_wired import PEERS, on_the_wire
from support.peers import BadPeer, Line, reply

PROVIDER = "Test.Workshop"
PATIENT = 30.0


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture(params=["tcp", "http"])
def listen_at(request: pytest.FixtureRequest) -> str:
    """Return a TCP address; threads and tasks are independent of the transport."""
    return LISTEN_AT[request.param]


@pytest.fixture
def server(listen_at: str, workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, listen_at) as served:
        yield served


@pytest.fixture
def web(listen_at: str) -> bool:
    """Return True for HTTP, where calls of one client may execute concurrently, and each takes longer."""
    return listen_at.startswith("http")


@pytest.fixture
def peer_class(listen_at: str) -> type[BadPeer]:
    return PEERS[listen_at.partition(":")[0]]


def test_eight_threads_on_one_connection(server: Server, web: bool) -> None:
    start, turns = threading.Barrier(8), 25 if web else 125
    with orinkit.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:

        def work(thread: int) -> int:
            start.wait(PATIENT)
            variable = controller.variable(f"v{thread}")
            for number in range(turns):
                token = [float(thread), float(number)]
                assert controller.execute("Echo", token) == token
                variable.value = f"{thread}/{number}"
                assert variable.value == f"{thread}/{number}"
                controller.variable("dropped at once")
            return number + 1

        with ThreadPoolExecutor(8) as pool:
            assert sum(pool.map(work, range(8))) == 8 * turns
        assert controller.client.stray_replies == 0


def test_threads_that_fail_do_not_disturb_the_others(server: Server) -> None:
    with orinkit.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:

        def work(thread: int) -> None:
            for number in range(100):
                if thread % 2:
                    with pytest.raises(orinkit.core.errors.NotImplementedCall):
                        controller.execute("no such command", number)
                else:
                    assert controller.execute("Echo", number) == number

        with ThreadPoolExecutor(6) as pool:
            list(pool.map(work, range(6)))


def test_closing_while_other_threads_call(server: Server) -> None:
    """Each call gets its own reply or an OrinError; nothing hangs."""
    for _ in range(5):
        controller = orinkit.connect(server.url, provider=PROVIDER, timeout=PATIENT)
        begun = threading.Semaphore(0)

        def work(thread: int, controller: orinkit.Controller = controller, begun: threading.Semaphore = begun) -> int:
            for number in itertools.count():
                try:
                    assert controller.execute("Echo", [thread, number]) == [thread, number]
                    controller.variable("x")
                except OrinError:
                    return number
                begun.release()
            raise AssertionError

        with ThreadPoolExecutor(4) as pool:
            results = [pool.submit(work, thread) for thread in range(4)]
            for _ in range(20):
                assert begun.acquire(timeout=PATIENT)
            controller.close()
            assert sum(result.result(PATIENT) for result in results) >= 10


def test_fifty_tasks_on_one_client(server: Server, web: bool) -> None:
    async def body() -> None:
        async with aio.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:

            async def work(task: int) -> None:
                variable = await controller.variable(f"v{task}")
                for number in range(4 if web else 20):
                    token = f"{task}:{number}"
                    assert await controller.execute("EchoLater", [token, number % 3]) == token
                    await variable.put_value(token)
                    assert await variable.get_value() == token

            await asyncio.gather(*map(work, range(50)))
            assert controller.client.stray_replies == 0

    asyncio.run(body())


@pytest.mark.parametrize("seed", range(4))
def test_calls_cancelled_at_random_moments(server: Server, web: bool, seed: int) -> None:
    """A call after a cancelled one gets its own reply, or an error that the controller is still busy."""

    async def body() -> None:
        chance = random.Random(seed)
        cancelled = right = 0
        async with aio.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:
            for number in range(150 if web else 400):
                token = f"{seed}:{number}"
                call = asyncio.ensure_future(controller.execute("EchoLater", [token, chance.randrange(4)]))
                for _ in range(chance.randrange(12)):
                    await asyncio.sleep(0)
                if chance.random() < 0.7:
                    call.cancel()
                try:
                    assert await call == token
                    right += 1
                except asyncio.CancelledError:
                    cancelled += 1
                except BusyError:
                    pass
            await _until_free(controller)
            assert controller.client.stray_replies <= cancelled + 1
        assert cancelled > 20
        assert right > 20

    asyncio.run(body())


@pytest.mark.parametrize("seed", range(3))
def test_tasks_cancelled_at_random_on_one_client(server: Server, seed: int) -> None:
    async def body() -> None:
        chance = random.Random(seed)
        async with aio.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:

            async def work(task: int) -> int:
                for number in range(10):
                    token = [task, number]
                    try:
                        assert await controller.execute("EchoLater", [token, 1]) == token
                    except BusyError:
                        await asyncio.sleep(0)
                return task

            tasks = [asyncio.ensure_future(work(task)) for task in range(50)]
            for _ in range(25):
                for _ in range(chance.randrange(40)):
                    await asyncio.sleep(0)
                chance.choice(tasks).cancel()
            results = await asyncio.gather(*tasks, return_exceptions=True)
            for task, result in enumerate(results):
                assert result == task or isinstance(result, asyncio.CancelledError)
            assert any(isinstance(result, asyncio.CancelledError) for result in results)
            await _until_free(controller)

    asyncio.run(body())


async def _until_free(controller: aio.AsyncController) -> None:
    answer = None
    while answer is None:
        try:
            answer = await controller.execute("Echo", "at last")
        except BusyError:
            await asyncio.sleep(0)
    assert answer == "at last"


def test_a_cancelled_connect_leaves_nothing_open(server: Server) -> None:
    async def body() -> None:
        for turns in range(30):
            connecting = asyncio.ensure_future(_connect(server.url))
            for _ in range(turns):
                await asyncio.sleep(0)
            connecting.cancel()
            try:
                await (await connecting).close()
            except asyncio.CancelledError:
                pass
            assert len(asyncio.all_tasks()) == 1

    asyncio.run(body())


async def _connect(url: str) -> aio.AsyncController:
    return await aio.connect(url, provider=PROVIDER)


def test_a_call_abandoned_during_execution_leaves_the_connection_usable(
    server: Server, workshop: Workshop, web: bool
) -> None:
    """asyncio.timeout ends a long call; the next call is executed, over b-CAP after the long one."""

    async def body() -> None:
        async with aio.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.05):
                    await controller.execute("Wait", "late")
            following = asyncio.create_task(controller.execute("Echo", 1))
            if web:
                assert await following == 1
            workshop.gate.set()
            assert await following == 1
            await _until_free(controller)
            assert controller.client.stray_replies == (not web)

    asyncio.run(body())


# --- an exception out of a signal handler -----------------------------------------------------------------------------


class Interrupt(BaseException):
    """An exception like KeyboardInterrupt, raised by a signal handler at an arbitrary point of the program."""


class Interrupter:
    """Raises :class:`Interrupt` in the main thread, once each time it is armed."""

    def __init__(self) -> None:
        self.armed = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.armed:
            self.armed = False
            raise Interrupt

    def _run(self) -> None:
        chance = random.Random(1)
        while not self._stop.wait(chance.random() * 0.002):
            os.kill(os.getpid(), signal.SIGUSR1)

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGUSR1, self._handle)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.armed = False
        self._stop.set()
        self._thread.join()
        signal.signal(signal.SIGUSR1, self._before)


def _in_pieces(line: Line) -> None:
    chance = random.Random(2)
    while True:
        request = line.request()
        answer = on_the_wire(line, reply(request, *request.arguments[-1:]))
        cuts = sorted(chance.randrange(len(answer)) for _ in range(3))
        for begin, end in itertools.pairwise([0, *cuts, len(answer)]):
            line.send(answer[begin:end])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # raised in a callback without a caller
@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="this system has no such signals")
def test_an_interrupted_call_leaves_the_connection_usable_or_closed(peer_class: type[BadPeer], web: bool) -> None:
    interrupted = right = closed = 0
    with peer_class(_in_pieces) as peer:
        client = _connected(peer)
        with Interrupter() as interrupter:
            for number in itertools.count():
                if right > (100 if web else 500) and interrupted > (30 if web else 150):
                    break
                try:
                    try:
                        interrupter.armed = True
                        value: Any = client.call(f.controller_execute, 1, "Echo", number)
                    finally:
                        interrupter.armed = False
                    assert value == number
                    right += 1
                except Interrupt:
                    interrupted += 1
                except TransportError:
                    closed += 1
                    client.close()
                    client = _connected(peer)
        client.close()
    assert closed <= interrupted


def _connected(peer: BadPeer) -> orinkit.Client:
    """Return a client that has made a call, so that its HTTP connection is open and all imports are done."""
    client = orinkit.open_client(peer.url, timeout=PATIENT)
    assert client.call(f.controller_execute, 1, "Echo", "first") == "first"
    return client


def test_a_trace_that_raises_leaves_the_connection_usable_or_closed(peer_class: type[BadPeer]) -> None:
    """The same applies to an exception in the user's trace callback."""
    with peer_class(_in_pieces) as peer:
        chance = random.Random(3)

        def trace(direction: str, data: bytes) -> None:
            if chance.random() < 0.2:
                raise Interrupt

        client = orinkit.open_client(peer.url, timeout=PATIENT, trace=trace)
        right = 0
        for number in range(300):
            try:
                assert client.call(f.controller_execute, 1, "Echo", number) == number
                right += 1
            except Interrupt:
                pass
            except TransportError:
                with suppress(Interrupt):
                    client.close()
                client = orinkit.open_client(peer.url, timeout=PATIENT, trace=trace)
        with suppress(Interrupt):
            client.close()
    assert right > 50


def test_timeouts_of_several_threads_are_independent(server: Server, workshop: Workshop, web: bool) -> None:
    with orinkit.connect(server.url, provider=PROVIDER, timeout=PATIENT) as controller:
        with pytest.raises(CallTimeout):
            controller.client.request(f.controller_execute, controller.handle, "Wait", 1, timeout=0.05)
        if not web:  # over b-CAP, the calls wait for the one that has timed out
            threading.Timer(0.1, workshop.gate.set).start()
        with ThreadPoolExecutor(4) as pool:
            results = list(pool.map(lambda number: _outcome(controller, number), range(20)))
        assert set(results) == {"right"}
        workshop.gate.set()


def _outcome(controller: orinkit.Controller, number: int) -> str:
    try:
        assert controller.execute("Echo", number) == number
    except BusyError:
        return "busy"
    except ProtocolError:
        return "wrong"
    return "right"


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timers")
def test_signals_do_not_postpone_the_time_out(peer_class: type[BadPeer]) -> None:
    """An interrupted wait continues for the remaining time; the time-out does not restart."""
    ticks = []
    before = signal.signal(signal.SIGALRM, lambda *_: ticks.append(1))
    stop = threading.Event()

    def answers_once(line: Line) -> None:
        line.send(reply(line.request()))
        line.wait_for_end()

    with peer_class(answers_once) as peer, orinkit.open_client(peer.url, timeout=PATIENT) as client:
        client.call(orinkit.functions.service_start)  # opens the HTTP connection
        client.timeout = 0.5
        signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
        watch = threading.Timer(20.0, stop.set)
        watch.start()
        try:
            with pytest.raises(orinkit.CallTimeout):
                client.call(orinkit.functions.service_start)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
            watch.cancel()
    assert not stop.is_set()
    assert len(ticks) >= 2


def test_a_client_of_another_event_loop_is_refused_before_anything_is_sent(listen_at: str) -> None:
    rc8 = VirtualRC8()
    with orinkit.serve(rc8, listen_at) as server:

        async def begin() -> tuple[aio.AsyncController, aio.AsyncVariable]:
            controller = await aio.connect(server.url)
            return controller, await controller.variable("I1")

        async def go_on(variable: aio.AsyncVariable) -> None:
            with pytest.raises(OrinError, match="event loop"):
                await variable.put_value(9)

        first, second = asyncio.new_event_loop(), asyncio.new_event_loop()
        controller, variable = first.run_until_complete(begin())
        second.run_until_complete(go_on(variable))
        assert first.run_until_complete(variable.get_value()) == 0
        first.run_until_complete(controller.close())
        first.run_until_complete(asyncio.sleep(0.01))
        first.close()
        second.close()


@pytest.mark.parametrize("seconds", [0, -1, float("nan"), float("inf"), None, "3", 1e300])
def test_an_invalid_time_out_is_refused_when_it_is_set(seconds: object) -> None:
    with BadPeer(lambda line: line.wait_for_end()) as peer, orinkit.open_client(peer.url) as client:
        with pytest.raises(InvalidValue):
            client.timeout = seconds
        assert client.timeout == 3.0
