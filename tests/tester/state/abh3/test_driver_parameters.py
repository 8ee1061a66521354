"""The parameters of a driver: reading, writing, and entries of users."""

from __future__ import annotations

import asyncio

import pytest

from orinkit.abh3.session.parameter_value import monitor, parameter
from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS
from orinkit.core.errors import InvalidValue, ParameterRefused
from orinkit.tester.state.abh3.parameters import (
    GROUPS,
    LONGEST_ENTRY,
    ROWS,
    ParameterStore,
    choices_of,
    hint_of,
    parse_value,
    unit_of,
    value_text,
)
from orinkit.tester.state.driver_connection import DriverConnection
from support.drivers import served_driver, soon, with_connection


def test_every_parameter_and_monitor_belongs_to_a_group():
    assert set(ROWS) == set(PARAMETERS) | set(MONITORS)
    assert {each.group for each in ROWS.values()} == set(GROUPS)
    assert all(each.writable == (each.group != "monitors") for each in ROWS.values())
    assert ROWS[0x5000].group == "ay"
    assert ROWS[0x5008].group == "bx"
    assert ROWS[0x5100].group == "io"
    assert ROWS[0x6180].concerns_bus
    assert all(hint_of(each.item) for each in ROWS.values())


def test_values_are_read_and_written():
    with served_driver() as (driver, url):

        async def test(connection: DriverConnection) -> None:
            store = ParameterStore(connection)
            await store.read([0x4102, 0x4117, 0x1004, 0x5000])
            values = [store.value(address) for address in (0x4102, 0x4117, 0x1004)]
            assert [value_text(each) for each in values if each] == ["1", "500", "24"]
            await store.write(0x4117, " 400 ")
            assert driver.parameters.command_timeout == 400
            written = store.value(0x4117)
            assert written is not None
            assert value_text(written) == "400"
            with pytest.raises(InvalidValue):
                await store.write(0x1004, "1")
            with pytest.raises(ParameterRefused):
                await store.write(0x4117, "-1")
            assert driver.parameters.command_timeout == 400

        with_connection(url, test)


def test_a_refused_parameter_does_not_end_the_reading():
    with served_driver() as (_, url):

        async def test(connection: DriverConnection) -> None:
            store = ParameterStore(connection)
            wanted = (0x4101, 0x4102, 0x4114, 0x5060, 0x1004)
            await store.read(wanted)
            assert store.pending == 0
            assert all(store.value(each) or isinstance(store.problem(each), ParameterRefused) for each in wanted)
            assert store.value(0x4102)
            assert any(store.problem(each) for each in wanted)

        with_connection(url, test)


def test_reading_can_be_cancelled():
    with served_driver() as (_, url):

        async def test(connection: DriverConnection) -> None:
            store = ParameterStore(connection)
            rows = list(ROWS) * 1000  # far more than are read before a stall of this machine ends
            reading = asyncio.create_task(store.read(rows))
            await soon(lambda: store.version)
            store.cancel()
            await reading
            assert store.version < len(rows)

        with_connection(url, test)


@pytest.mark.parametrize(("address", "text", "value"), [
    (0x4102, "5", 5), (0x4102, "0x10", 16), (0x4103, "-1", -1), (0x5000, "1.5", 1.5), (0x5000, "-2e3", -2000.0),
    (0x5100, "0x8000", 0x8000), (0x5100, "32768", 0x8000), (0x5180, "0xFFFFFFFF", 0xFFFFFFFF), (0x4102, "010", 10),
])  # fmt: skip
def test_an_entry(address, text, value):
    assert parse_value(PARAMETERS[address], text) == value


@pytest.mark.parametrize(("address", "text"), [
    (0x4102, ""), (0x4102, "1.5"), (0x4102, "x"), (0x4102, "0x"), (0x5000, "nan"), (0x5000, "0x10"), (0x5000, "1e99"),
    (0x5100, "1"), (0x5180, "1"), (0x4102, "9" * 12), (0x4102, "1" * (LONGEST_ENTRY + 1)), (0x4102, "1" * 10_000_000),
])  # fmt: skip
def test_an_invalid_entry(address, text):
    with pytest.raises(InvalidValue):
        parse_value(PARAMETERS[address], text)


def test_values_as_text():
    assert value_text(parameter(0x5100, 0x8000)) == "0x8000"
    assert value_text(parameter(0x5180, 0xFFFFFFFF)) == "0xFFFFFFFF"
    assert value_text(parameter(0x4103, 0xFFFFFFFF)) == "-1"
    assert value_text(monitor(0x0000, 5)) == "0x00000005"
    for address in (0x5100, 0x5180):
        assert choices_of(PARAMETERS[address])
        assert unit_of(PARAMETERS[address]) == ""
        assert [parse_value(PARAMETERS[address], each) for each in choices_of(PARAMETERS[address])]
