"""The poller of variables: one read of each variable per cycle, errors, and a vanished controller."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator

import pytest

import orinkit
from orinkit.core.errors import InvalidValue, ObjectNotFound
from orinkit.tester.state import poller as polling
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.poller import VariableRef, Watch
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.objects.variables import UserVariable
from support.in_thread import run_in_thread
from support.waiting import PATIENCE

I1, I2 = VariableRef("controller", "", "I1"), VariableRef("controller", "", "I2")


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the reads of user variables that the virtual RC8 executes."""
    counts: Counter[str] = Counter()
    read = UserVariable.get_value

    def counted(self: UserVariable) -> object:
        counts[self.name] += 1
        return read(self)

    monkeypatch.setattr(UserVariable, "get_value", counted)
    return counts


@pytest.fixture
def server() -> Iterator[orinkit.Server]:
    with orinkit.serve(VirtualRC8(motor=True), "tcp://127.0.0.1:0") as opened:
        yield opened


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - the condition has no event
            await asyncio.sleep(0.005)


def connected(server: orinkit.Server, test: Callable[[ControllerConnection], Awaitable[None]]) -> None:
    async def run() -> None:
        connection = ControllerConnection(ConnectionSpec("rc8", server.url), PacketLog())
        await connection.open()
        try:
            await test(connection)
        finally:
            await connection.close()

    run_in_thread(run())


def value(watch: Watch) -> object:
    return watch.reading.value.value if watch.reading.value else None


def test_each_variable_is_read_once_per_cycle_for_all_watchers(server, reads):
    async def test(connection: ControllerConnection) -> None:
        poller = connection.poller
        watches = [poller.watch(ref) for ref in (I1, I2, I1, I1, I2)]
        await until(lambda: poller.cycles >= 4)
        assert reads["I1"] in (poller.cycles, poller.cycles + 1)  # the cycle in progress may have read it already
        assert abs(reads["I1"] - reads["I2"]) <= 1
        assert [value(each) for each in watches] == [0] * 5
        for each in watches:
            each.close()
            each.close()
        assert not poller.polling

    connected(server, test)


def test_polling_ends_with_the_last_watcher_and_begins_again(server, reads):
    async def test(connection: ControllerConnection) -> None:
        poller = connection.poller
        first, second = poller.watch(I1), poller.watch(I1)
        await until(lambda: value(first) is not None)
        first.close()
        before = poller.cycles
        await until(lambda: poller.cycles > before + 1)  # the second one is still reading
        second.close()
        await until(lambda: poller._task is None or poller._task.done())
        count = reads["I1"]
        third = poller.watch(I1)
        await until(lambda: reads["I1"] > count)
        third.close()

    connected(server, test)


def test_packets_of_the_poller_are_not_in_the_log(server):
    async def test(connection: ControllerConnection) -> None:
        total = connection._packets.total
        watch = connection.poller.watch(I1)
        await until(lambda: connection.poller.cycles >= 2)
        watch.close()
        assert connection._packets.total == total

    connected(server, test)


def test_an_error_of_a_variable_does_not_stop_the_others(server):
    async def test(connection: ControllerConnection) -> None:
        poller = connection.poller
        bad = poller.watch(VariableRef("controller", "", "NOPE"))
        good, task = poller.watch(I1), poller.watch(VariableRef("task", "Pro1", "@STATUS"))
        robot = poller.watch(VariableRef("robot", "", "@SERVO_ON"))
        await until(lambda: bad.reading.error and None not in (value(good), value(task), value(robot)))
        assert isinstance(bad.reading.error, ObjectNotFound)
        assert (value(task), value(robot), good.reading.error) == (2, True, None)
        for each in (bad, good, task, robot):
            each.close()

    connected(server, test)


def test_lowest_and_highest_value_belong_to_a_watcher(server):
    async def test(connection: ControllerConnection) -> None:
        watch = connection.poller.watch(I1)
        async with await connection.controller.variable("I1") as variable:
            for number in (5, -3, 2):
                await variable.put_value(number)
                await until(lambda number=number: value(watch) == number)
        assert (watch.low, watch.high) in ((-3, 5), (-3.0, 5.0))
        later = connection.poller.watch(I1)
        before = connection.poller.cycles
        await until(lambda: connection.poller.cycles > before + 1)
        assert (later.low, later.high) == (2, 2)
        watch.reset()
        assert watch.low is None
        watch.close()
        later.close()

    connected(server, test)


def test_too_many_variables_are_refused(server, monkeypatch):
    monkeypatch.setattr(polling, "MAX_VARIABLES", 2)

    async def test(connection: ControllerConnection) -> None:
        watches = [connection.poller.watch(ref) for ref in (I1, I2, I2)]
        with pytest.raises(InvalidValue, match="at most 2 variables"):
            connection.poller.watch(VariableRef("controller", "", "I3"))
        watches.pop(0).close()
        watches.append(connection.poller.watch(VariableRef("controller", "", "I3")))
        for each in watches:
            each.close()

    connected(server, test)


def test_a_vanished_controller_is_an_error_of_each_variable_and_its_return_ends_it():
    device = VirtualRC8()
    server = orinkit.serve(device, "tcp://127.0.0.1:0")

    async def test(connection: ControllerConnection) -> None:
        watches = [connection.poller.watch(ref) for ref in (I1, I2)]
        await until(lambda: None not in map(value, watches))
        await asyncio.to_thread(server.close)
        await until(lambda: all(each.reading.error for each in watches))
        with orinkit.serve(VirtualRC8(), server.url):
            await connection.open()
            await until(lambda: not any(each.reading.error for each in watches))
        for each in watches:
            each.close()

    connected(server, test)
    server.close()


def test_errors_and_events_of_the_controller_are_fetched_while_a_page_uses_them():
    device = VirtualRC8()

    async def test(connection: ControllerConnection) -> None:
        log = connection.log
        log.begin()
        await until(lambda: not log.problems and connection._second is not None)
        await asyncio.to_thread(device.raise_error, 0x83204071)
        await until(lambda: log.current and log.logged and log.events)
        entry, event = log.logged[0], log.events[0]
        assert (entry.code, entry.name, entry.severity) == (0x83204071, "SOFT_LIMIT_OVER_AXIS1", 3)
        assert (event.code, event.severity) == (entry.code, 3)
        assert entry.matches("soft axis1", 3)
        assert not entry.matches("soft", 4)
        before = len(log.logged)
        await asyncio.to_thread(device.raise_error, 0x83500008)
        await until(lambda: len(log.logged) > before)
        assert [each.code for each in log.logged[:2]] == [0x83500008, 0x83204071]
        await connection.controller.clear_error()
        await until(lambda: not log.current)
        log.end()

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        connected(server, test)


def test_without_messages_no_event_is_fetched():
    device = VirtualRC8()

    async def run(url: str) -> None:
        connection = ControllerConnection(ConnectionSpec("rc8", url, messages=False), PacketLog())
        await connection.open()
        connection.log.begin()
        await until(lambda: connection._second is not None)
        await asyncio.to_thread(device.raise_error, 0x83204071)
        await until(lambda: connection.log.logged)
        version = connection.log.version
        await asyncio.to_thread(device.raise_error, 0x83500008)
        await until(lambda: connection.log.version > version)
        assert not connection.log.events
        connection.log.end()
        await connection.close()

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        run_in_thread(run(server.url))
