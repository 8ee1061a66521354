"""URLs of CAN buses, and the errors if one cannot be used or opened."""

from __future__ import annotations

import os
import socket
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.can.bus import Bus, open_bus
from orinkit.core import i18n, optional_deps
from orinkit.core.errors import ConnectFailed, InvalidAddress, InvalidValue, MissingExtra
from orinkit.server.aio_server import AsyncServer
from orinkit.transport import aio_links, links
from orinkit.transport.address import CanAddress, parse_address
from orinkit.transport.registry import LinkOptions
from orinkit.virtual.rc8.provider import VirtualRC8
from support.both import Both
from support.can_ptys import crossed_ptys
from support.waiting import PATIENCE

POSIX = pytest.mark.skipif(os.name == "nt", reason="there are no pseudo-terminals")


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("can://socketcan/can0", CanAddress("socketcan", "can0")),
        ("CAN://socketcan/can0?", CanAddress("socketcan", "can0")),
        ("can:pcan/PCAN_USBBUS1?bitrate=250000", CanAddress("pcan", "PCAN_USBBUS1", 250000)),
        ("can://slcan//dev/ttyUSB0?bitrate=500000", CanAddress("slcan", "/dev/ttyUSB0", 500000)),
        ("can://slcan/COM3", CanAddress("slcan", "COM3")),
        ("can://slcan//dev/ttyUSB0@115200", CanAddress("slcan", "/dev/ttyUSB0@115200")),
        ("can://slcan//dev/a%20b%3F%2541", CanAddress("slcan", "/dev/a b?%41")),
        ("can://virtual/test", CanAddress("virtual", "test")),
        ("can://virtual", CanAddress("virtual")),
        ("can://udp_multicast/", CanAddress("udp_multicast")),
        (
            "can://udp_multicast/239.74.163.2?port=43113&hop_limit=2",
            CanAddress("udp_multicast", "239.74.163.2", None, (("port", 43113), ("hop_limit", 2))),
        ),
        ("can://udp_multicast/ff15::1", CanAddress("udp_multicast", "ff15::1")),
        ("can://udp_multicast/[ff15::1]", CanAddress("udp_multicast", "ff15::1")),
        (
            "can://x/y?a=1&b=-2&c=0.50&d=1e3&e=True&f=false&g=007&h=text%20here&i=&j=1e999&k=nan",
            CanAddress(
                "x",
                "y",
                None,
                (
                    *(("a", 1), ("b", -2), ("c", 0.5), ("d", 1000.0), ("e", True), ("f", False), ("g", "007")),
                    *(("h", "text here"), ("i", ""), ("j", "1e999"), ("k", "nan")),
                ),
            ),
        ),
    ],
)
def test_buses(text: str, address: CanAddress) -> None:
    assert parse_address(text) == address
    assert parse_address(str(address)) == address
    assert address.scheme == "can"


def test_types_of_options_survive() -> None:
    address = parse_address("can://x/y?a=1&b=1.0&c=true")
    assert isinstance(address, CanAddress)
    assert [type(value) for _, value in address.options] == [int, float, bool]
    again = parse_address(str(address))
    assert isinstance(again, CanAddress)
    assert [type(value) for _, value in again.options] == [int, float, bool]
    with pytest.raises(AttributeError):
        address.channel = "z"


def test_a_bus_as_text() -> None:
    address = CanAddress("slcan", "/dev/ttyUSB0", 500000, (("sleep_after_open", 0), ("rtscts", True)))
    assert str(address) == "can://slcan//dev/ttyUSB0?bitrate=500000&sleep_after_open=0&rtscts=true"
    assert str(CanAddress("udp_multicast", "ff15::1")) == "can://udp_multicast/ff15::1"


CHANNELS = st.text(st.characters(min_codepoint=32, exclude_categories=["Cs"]), max_size=30)
NAMES = st.from_regex(r"[a-z_][a-z0-9_]{0,10}", fullmatch=True).filter(
    lambda name: (
        name not in ("bitrate", "interface", "channel", "bustype", "context", "config_context", "ignore_config")
    )
)


@given(CHANNELS, st.none() | st.integers(1000, 1_000_000), st.dictionaries(NAMES, st.text(max_size=20), max_size=4))
def test_every_bus_survives_as_text(channel: str, bitrate: int | None, options: dict[str, str]) -> None:
    from urllib.parse import quote

    given_options = [f"{name}={quote(value, safe='')}" for name, value in options.items()]
    query = "&".join([*([f"bitrate={bitrate}"] if bitrate else []), *given_options])
    address = parse_address(f"can://virtual/{quote(channel, safe='')}?{query}")
    assert isinstance(address, CanAddress)
    assert (address.channel, address.bitrate) == (channel, bitrate)
    assert parse_address(str(address)) == address


@given(st.text(max_size=60))
def test_any_text_is_a_bus_or_refused(text: str) -> None:
    try:
        address = parse_address("can://" + text)
    except InvalidAddress:
        return
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("can://", "expected an interface of python-can"),
        ("can:///can0", "expected an interface of python-can"),
        ("can://5/x", "expected an interface of python-can"),
        ("can://a.b/x", "expected an interface of python-can"),
        ("can://日本/x", "expected an interface of python-can"),
        ("can://" + "a" * 81, "expected an interface of python-can"),
        ("can://slcan//dev/a%00b", "invalid channel"),
        ("can://slcan//dev/\ud800", "invalid channel"),
        ("can://slcan//dev/" + "a" * 5000, "invalid channel"),
        ("can://x/y?bitrate=fast", "bitrate cannot be 'fast'"),
        ("can://x/y?bitrate=0", "bitrate cannot be '0'"),
        ("can://x/y?bitrate=5000000", "bitrate cannot be '5000000'"),
        ("can://x/y?bitrate=true", "bitrate cannot be 'true'"),
        ("can://x/y?a=1&a=2", "a is given twice"),
        ("can://x/y?=1", "'' is not a valid option"),
        ("can://x/y?a-b=1", "'a-b' is not a valid option"),
        ("can://x/y?interface=z", "'interface' is not a valid option"),
        ("can://x/y?ignore_config=false", "'ignore_config' is not a valid option"),
    ],
)
def test_invalid_addresses(text: str, reason: str) -> None:
    with pytest.raises(InvalidAddress) as caught:
        parse_address(text)
    message = str(caught.value)
    assert reason in message
    assert len(message) < 600
    parse_address(message.partition("Example: ")[2])


# --- addresses for b-CAP ----------------------------------------------------------------------------------------------


def test_a_controller_is_not_on_a_can_bus(both: Both) -> None:
    for opening in (both.client, both.connect):
        with pytest.raises(InvalidAddress, match=r"does not carry b-CAP. For ABH3 drivers: orinkit\.abh3\.connect"):
            opening("can://virtual/x")
    address = parse_address("can://virtual/x")
    with pytest.raises(InvalidAddress, match="For ABH3 drivers"):
        both.run((links.open_link if both.loop is None else aio_links.open_link)(address, LinkOptions(1.0)))


def test_a_controller_is_not_served_on_a_can_bus() -> None:
    with pytest.raises(InvalidAddress, match="For ABH3 drivers"):
        AsyncServer(VirtualRC8(), "can://virtual/x")


# --- opening ----------------------------------------------------------------------------------------------------------


def address_of(text: str) -> CanAddress:
    address = parse_address(text)
    assert isinstance(address, CanAddress)
    return address


@pytest.mark.parametrize(
    ("text", "kind", "parts"),
    [
        ("can://can0", InvalidAddress, ["no interface 'can0'", "socketcan", "Example: can://socketcan/can0"]),
        ("can://udp_multicast/239.74.163.2?prt=5", InvalidAddress, ["udp_multicast", "239.74.163.2", "prt", "options"]),
        ("can://udp_multicast/239.74.163.2?port=99999", InvalidAddress, ["port", "udp_multicast"]),
        ("can://udp_multicast/239.74.163.2?port=x", InvalidAddress, ["port must be 1 to 65535, not 'x'"]),
        ("can://udp_multicast/127.0.0.1?port=43114", ConnectFailed, ["udp_multicast", "127.0.0.1", "Try: use a multicast address"]),
        ("can://udp_multicast/nowhere.invalid", ConnectFailed, ["udp_multicast", "nowhere.invalid", "Try: use a multicast address"]),
        ("can://virtual/x?can_filters=1", InvalidAddress, ["unknown option 'can_filters'; available: receive_own_messages"]),
        ("can://slcan", InvalidAddress, ["slcan", "channel"]),
        ("can://slcan//dev/nosuchport", ConnectFailed, ["slcan", "/dev/nosuchport", "plugged in"]),
        ("can://slcan//dev/null?sleep_after_open=0", ConnectFailed, ["slcan", "/dev/null", "Try:"]),
        ("can://serial//dev/nosuchport", ConnectFailed, ["serial", "/dev/nosuchport", "plugged in"]),
        ("can://socketcan/nocan99", ConnectFailed, ["socketcan", "nocan99", "Try:"]),
    ],
)  # fmt: skip
def test_buses_that_cannot_be_opened(text: str, kind: type[Exception], parts: list[str]) -> None:
    with pytest.raises(kind) as caught:
        open_bus(address_of(text))
    for part in parts:
        assert part in str(caught.value)
    assert len(str(caught.value)) < 900


@POSIX
def test_a_bit_rate_that_an_adapter_does_not_support() -> None:
    with crossed_ptys() as cable, pytest.raises(InvalidAddress, match="500000"):
        open_bus(CanAddress("slcan", cable.left, 300000))


@pytest.mark.parametrize("text", ["can://virtual/x", "can://udp_multicast/", "can://slcan/x", "can://serial/x"])
def test_a_missing_package(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = {"virtual": "can", "udp_multicast": "msgpack", "slcan": "serial", "serial": "serial"}
    address = address_of(text)
    name = missing[address.interface]
    found = optional_deps.find_spec
    monkeypatch.setattr(optional_deps, "find_spec", lambda package: None if package == name else found(package))
    with pytest.raises(MissingExtra, match=rf"{name}\. Try: pip install 'orinkit\[can\]'"):
        open_bus(address)


def test_a_missing_driver() -> None:
    with pytest.raises((ConnectFailed, MissingExtra), match=r"can://kvaser/0.*Try:"):
        open_bus(address_of("can://kvaser/0"))


def test_in_japanese() -> None:
    i18n.use("ja")
    with pytest.raises(ConnectFailed, match=r"開けません.*対処: "):
        open_bus(address_of("can://slcan//dev/nosuchport"))


def test_configuration_of_python_can_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_CHANNEL", "elsewhere")
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    with open_bus(address_of("can://virtual")) as bus:
        described: Any = vars(bus)
        assert (described["channel_id"], described["receive_own_messages"]) == ("channel-0", False)


def test_a_channel_that_is_a_number() -> None:
    with open_bus(address_of("can://virtual/7")) as bus:
        assert vars(bus)["channel_id"] == 7
    with open_bus(address_of("can://virtual/07")) as bus:
        assert vars(bus)["channel_id"] == "07"


def test_the_default_group() -> None:
    with open_bus(address_of("can://udp_multicast/?port=43115")) as bus:
        assert vars(vars(bus)["_multicast"])["group"] == "239.74.163.2"


@POSIX
@pytest.mark.parametrize(
    ("port", "query", "waited"), [("left", "", 0), ("left", "?sleep_after_open=0.01", 0.01), ("tty", "", 2)]
)
def test_the_wait_after_opening_an_adapter(
    port: str, query: str, waited: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    naps: list[float] = []
    monkeypatch.setattr("can.interfaces.slcan.time.sleep", naps.append)
    with crossed_ptys() as cable:
        if port == "tty":
            monkeypatch.setattr("orinkit.can.interfaces.os.path.realpath", lambda _path: "/dev/ttyUSB0")
        open_bus(address_of(f"can://slcan/{cable.left}{query}")).shutdown()
    assert naps == [waited]


def test_a_bus_of_the_caller_is_not_reopened() -> None:
    with open_bus(address_of("can://virtual/x")) as given_bus:
        bus = Bus(given_bus, own=False)
        with pytest.raises(InvalidValue, match="only if it was opened by an address"):
            bus.reopen()
        bus.close()
        given_bus.send(__import__("can").Message())  # it is still open


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can does not close its socket
def test_a_bus_that_cannot_be_opened_leaves_no_socket_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor() as threads:
        host, port = server.getsockname()
        opening = threads.submit(open_bus, address_of(f"can://socketcand/x?host={host}&port={port}"))
        peer, _ = server.accept()
        with peer:
            peer.settimeout(PATIENCE)
            peer.sendall(b"< wrong >")
            assert isinstance(opening.exception(PATIENCE), ConnectFailed)
            assert peer.recv(1) == b""  # even though the exception still exists
