"""The values of a driver: one poll for all pages, periodic broadcasts, drivers that do not reply."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from orinkit.abh3.table import ids
from orinkit.core.errors import DriverTimeout
from orinkit.tester.state import connection as connections
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.driver_monitor import DriverMonitor, ReportedValue
from support import multicast
from support.can_ptys import reserved_name
from support.drivers import RecordedDriver, served_driver, soon, with_connection


def value(monitor: DriverMonitor, name: str) -> ReportedValue:
    return next(each for each in monitor.values if each.field.name == name)


@pytest.mark.parametrize("dialect", ["v1", "v2"])
def test_every_value_is_read_once_per_cycle_for_all_pages(dialect):
    with served_driver(dialect=dialect, command_timeout=0, error_timeout=0) as (driver, url):
        driver.set_analog(0, 1.25)

        async def test(connection: DriverConnection) -> None:
            monitor = connection.monitor
            for _ in range(3):
                monitor.begin()
            await soon(lambda: monitor.cycles >= 3)
            counts = Counter(driver.requests)
            assert len(counts) == 8  # DP0R and BR0 to BR6
            assert max(counts.values()) <= monitor.cycles + 1
            assert monitor.number(value(monitor, "analog_0")) == 1.25
            assert all(monitor.number(each) is not None for each in monitor.values)
            assert all(monitor.flags(*each) is not None for each in monitor.words)
            assert monitor.flags("BR0", connection.dialect.errors).value == 0  # type: ignore[union-attr]  # it exists here
            assert len(monitor.histories["BR2"]) >= 2
            for _ in range(3):
                monitor.end()
            await soon(lambda: not monitor.polling)

        with_connection(url, test, dialect=dialect)


def test_the_polled_frames_are_marked():
    with served_driver() as (_, url):

        async def test(connection: DriverConnection) -> None:
            connection.monitor.begin()
            await soon(lambda: connection.monitor.cycles)
            connection.monitor.end()
            before = connection.frames.total
            await connection.driver.command()
            await connection.driver.read_parameter(0x4102)
            later = connection.frames.newest(connection.frames.total - before)
            assert not any(each.polled for each in later if each.frame.id >> 16 & 0xFF != ids.BROADCAST)
            polled = [each for each in connection.frames if each.polled]
            assert len(polled) >= 14  # each broadcast and its request
            assert {each.direction for each in polled} == {">", "<"}
            assert [each.frame.id for each in connection.frames][:2] == [ids.single(1, 2), ids.single(2, 1)]

        with_connection(url, test)


def test_periodic_broadcasts_are_not_requested():
    with served_driver(broadcast_modes=(0, 0, 20, 0, 0, 0, 0, 0)) as (driver, url):

        async def test(connection: DriverConnection) -> None:
            monitor = connection.monitor
            monitor.begin()
            await soon(lambda: monitor.cycles >= 5)
            monitor.end()
            counts = Counter(driver.requests)
            assert counts[ids.pgn(ids.BROADCAST, 42)] < counts[ids.pgn(ids.BROADCAST, 41)]
            assert len(monitor.histories["BR2"]) >= 3

        with_connection(url, test)


def test_own_frames_are_listed_once_even_if_the_interface_returns_them():
    from orinkit.can.server import serve_can

    url = multicast.bus()
    driver = RecordedDriver()
    with serve_can(driver, at=url):

        async def test(connection: DriverConnection) -> None:
            for _ in range(5):
                await connection.driver.command()
            sent = [each for each in connection.frames if each.frame.id == ids.single(1, 2)]
            assert [each.direction for each in sent] == [">"] * 6
            assert len(driver.commands) == 6

        with_connection(url, test)


def test_a_silent_driver_is_reported_and_can_be_connected_again(monkeypatch):
    monkeypatch.setattr(connections, "_WATCH", 0.02)
    with served_driver() as (driver, url):

        async def test(connection: DriverConnection) -> None:
            connection.driver.host.timeout = 0.1
            connection.monitor.begin()
            await soon(lambda: connection.monitor.cycles)
            driver.mute = True
            await soon(lambda: isinstance(connection.monitor.error, DriverTimeout))
            await soon(lambda: connection.state is ConnectionState.LOST)
            assert isinstance(connection.error, DriverTimeout)
            assert connection.monitor.number(value(connection.monitor, "main_voltage")) is None
            driver.mute = False
            await connection.open()
            await soon(lambda: connection.monitor.error is None and connection.monitor.heard)
            assert connection.is_open
            connection.monitor.end()

        with_connection(url, test)


def test_a_broadcast_without_reply_does_not_stop_the_others():
    class Partial(RecordedDriver):
        def receive(self, frame: Any) -> Any:
            return [] if frame.data == ids.pgn(ids.BROADCAST, 44) else super().receive(frame)

    from orinkit.can.server import PSEUDO_TERMINAL, serve_can

    with serve_can(Partial(), at=PSEUDO_TERMINAL) as server:

        async def test(connection: DriverConnection) -> None:
            connection.driver.host.timeout = 0.2
            connection.monitor.begin()
            await soon(lambda: connection.monitor.cycles >= 2)
            connection.monitor.end()
            assert connection.monitor.error is None
            assert connection.monitor.number(value(connection.monitor, "main_voltage")) == 24
            assert (
                connection.monitor.number(ReportedValue("BR4", value(connection.monitor, "a_pulses").field, 0)) is None
            )

        with_connection(server.url, test)


def test_a_lost_bus_is_detected(monkeypatch):
    monkeypatch.setattr(connections, "_WATCH", 0.02)
    from orinkit.can.server import PSEUDO_TERMINAL, serve_can

    server = serve_can(RecordedDriver(), at=PSEUDO_TERMINAL)

    async def test(connection: DriverConnection) -> None:
        connection.monitor.begin()
        await soon(lambda: connection.monitor.cycles)
        server.close()
        await soon(lambda: connection.state is ConnectionState.LOST)
        connection.monitor.end()

    with reserved_name(server.url):
        with_connection(server.url, test)
