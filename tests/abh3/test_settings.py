"""Settings of drivers and buses, and the errors for invalid ones."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any

import pytest

import can
from orinkit.abh3.api.common import (
    BusSettings,
    HostSettings,
    Settings,
    bus_address,
    bus_settings,
    check_names,
    check_seconds,
    given_bus,
    make_host,
)
from orinkit.abh3.table.signals import V1, V2
from orinkit.core import i18n
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.transport.address import CanAddress

pytestmark = pytest.mark.core


@pytest.mark.parametrize(
    ("at", "settings", "address"),
    [
        ("can://socketcan/can0", {}, CanAddress("socketcan", "can0")),
        ("can://slcan//dev/ttyACM0?bitrate=500000", {}, CanAddress("slcan", "/dev/ttyACM0", 500000)),
        ("can://virtual/x?fd=true", {}, CanAddress("virtual", "x", None, (("fd", True),))),
        (None, {"interface": "socketcan", "channel": "can0"}, CanAddress("socketcan", "can0")),
        (None, {"interface": "virtual"}, CanAddress("virtual", "")),
        (None, {"interface": "ixxat", "channel": 0, "bitrate": 250000}, CanAddress("ixxat", "0", 250000)),
        (
            None,
            {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1000000},
            CanAddress("slcan", "/dev/ttyACM0", 1000000),
        ),
        (None, {"interface": "slcan", "channel": "COM5"}, CanAddress("slcan", "COM5")),
        (None, {"interface": "virtual", "channel": "a b?c=d&é%41#"}, CanAddress("virtual", "a b?c=d&é%41#")),
        (None, {"interface": "udp_multicast", "channel": "ff15::1"}, CanAddress("udp_multicast", "ff15::1")),
    ],
)
def test_addresses_of_buses(at: str | None, settings: BusSettings, address: CanAddress) -> None:
    assert bus_address(at, settings) == address


@pytest.mark.parametrize(
    ("at", "settings"),
    [
        (None, {}),
        (None, {"channel": "can0"}),
        (None, {"bitrate": 500000}),
        ("socketcan/can0", {}),
        ("tcp://192.168.0.1", {}),
        ("can0", {}),
        ("serial:///dev/ttyUSB0", {}),
    ],
)
def test_a_bus_is_given_once(at: str | None, settings: BusSettings) -> None:
    for tongue, text in (("en", "a CAN bus is required"), ("ja", "CAN バスの指定が必要です")):
        i18n.use(tongue)
        with pytest.raises(InvalidAddress) as caught:
            bus_address(at, settings)
        for part in (text, at or "", "can://socketcan/can0?bitrate=500000", "interface="):
            assert part in str(caught.value)


@pytest.mark.parametrize(
    "settings",
    [{"interface": "socketcan"}, {"channel": "can1"}, {"bitrate": 500000}, {"interface": "virtual", "channel": 1}],
)
def test_a_url_excludes_settings_of_the_bus(settings: BusSettings) -> None:
    for tongue, text in (("en", "cannot be combined with the bus URL"), ("ja", "同時に指定できません")):
        i18n.use(tongue)
        with pytest.raises(InvalidAddress) as caught:
            bus_address("can://socketcan/can0", settings)
        for part in (text, "'can://socketcan/can0'", ", ".join(settings)):
            assert part in str(caught.value)


@pytest.mark.parametrize(
    ("at", "settings"),
    [
        ("can://", {}),
        ("", {}),
        ("can://socketcan/can0?bitrate=9600000", {}),
        (None, {"interface": ""}),
        (None, {"interface": "no interface"}),
        (None, {"interface": 5}),
        (None, {"interface": "slcan", "channel": "x", "bitrate": 0}),
        (None, {"interface": "slcan", "channel": "x", "bitrate": "fast"}),
        (None, {"interface": "slcan", "channel": "x", "bitrate": None}),
        (None, {"interface": "virtual", "channel": "a\nb"}),
        (None, {"interface": "virtual", "channel": "\ud800"}),
        (None, {"interface": "virtual", "channel": "a\udc80"}),
        (None, {"interface": "virtual", "channel": "x" * 5000}),
    ],
)
def test_invalid_addresses(at: str | None, settings: Any) -> None:
    with pytest.raises(InvalidAddress):
        bus_address(at, settings)


def test_a_bus_of_python_can() -> None:
    assert given_bus(None) is None
    assert given_bus("can://virtual/x") is None
    with can.Bus(interface="virtual", channel="orinkit-test-settings") as bus:
        assert given_bus(bus) is bus
    for wrong in (5, b"can://virtual/x", object, can.Bus, 10**5000):
        for tongue in ("en", "ja"):
            i18n.use(tongue)
            with pytest.raises(InvalidAddress, match="python-can"):
                given_bus(wrong)


def test_unknown_settings_are_refused_as_python_does() -> None:
    check_names({"interface": 1, "channel": 2, "bitrate": 3}, BusSettings)
    hosts = {"address": 1, "host": 2, "group": 3, "timeout": 4, "priority": 5, "load_unit": 6}
    check_names(hosts, HostSettings)
    check_names({**hosts, "interface": 1, "channel": 2, "bitrate": 3}, Settings)
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(TypeError, match=r"'bit_rate'.*interface, channel, bitrate"):
            check_names({"channel": "x", "bit_rate": 5}, BusSettings)
        with pytest.raises(TypeError, match="'address'"):
            check_names(hosts, BusSettings)
        with pytest.raises(TypeError, match=r"'interface'.*load_unit"):
            check_names({"interface": "x"}, HostSettings)
        with pytest.raises(TypeError, match=r"'adress'.*interface.*address|'adress'.*address.*interface"):
            check_names({"adress": 1}, Settings)


@pytest.mark.parametrize("seconds", [1e-9, 0.5, 1, 3600, 3600.0, Decimal("0.25")])
def test_seconds(seconds: Any) -> None:
    found = check_seconds("timeout", seconds)
    assert found == seconds
    assert isinstance(found, float)


@pytest.mark.parametrize(
    "seconds",
    [0, -1, 3600.1, math.nan, math.inf, 10**400, pytest.param(10**5000, id="great"), True, "1", None, [1]],
)
def test_invalid_seconds(seconds: Any) -> None:
    for tongue, text in (("en", "above 0 and up to 3600"), ("ja", "3600 以下の秒数")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text) as caught:
            check_seconds("timeout", seconds)
        assert str(caught.value).startswith("timeout ")
        assert len(str(caught.value)) < 120


def test_a_host_of_the_document() -> None:
    host = make_host("v1", {})
    assert host.dialect == V1
    assert (host.address, host.host, host.group, host.timeout, host.priority) == (1, 2, 5, 1.0, 0)


def test_a_host_of_settings() -> None:
    host = make_host(V2, {"address": 3, "host": 4, "group": 31, "timeout": 2, "priority": 7, "load_unit": 0.1})
    assert (host.address, host.host, host.group, host.timeout, host.priority) == (3, 4, 31, 2.0, 7)
    assert host.dialect == V2.with_load_unit(0.1) != V2
    both: Settings = {"interface": "virtual", "channel": "x", "bitrate": 1, "address": 9}
    assert make_host("v1", both).address == 9


@pytest.mark.parametrize(
    ("dialect", "settings"),
    [
        ("v3", {}),
        ("v1", {"address": 254}),
        ("v1", {"host": -1}),
        ("v1", {"address": 5, "host": 5}),
        ("v1", {"group": 32}),
        ("v1", {"timeout": 0}),
        ("v1", {"timeout": math.inf}),
        ("v1", {"priority": 8}),
        ("v1", {"load_unit": 10}),
    ],
)
def test_settings_out_of_range(dialect: str, settings: Any) -> None:
    with pytest.raises(InvalidValue):
        make_host(dialect, settings)


def test_settings_of_the_bus_among_others() -> None:
    assert bus_settings({}) == {}
    assert bus_settings({"address": 1, "timeout": 2}) == {}
    assert bus_settings({"interface": "virtual", "address": 1}) == {"interface": "virtual"}
    assert bus_settings({"channel": 0, "host": 1}) == {"channel": 0}
    assert bus_settings({"bitrate": 250000, "group": 1}) == {"bitrate": 250000}
    everything: Settings = {"interface": "slcan", "channel": "x", "bitrate": 5, "priority": 1, "load_unit": 0.1}
    assert bus_settings(everything) == {"interface": "slcan", "channel": "x", "bitrate": 5}
