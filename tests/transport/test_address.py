"""URLs and connection strings."""

from __future__ import annotations

import os
from dataclasses import FrozenInstanceError
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import InvalidAddress
from orinkit.core.validation import brief
from orinkit.transport.address import Address, HttpAddress, network_of, parse_address
from orinkit.transport.serial.address import PtyAddress, SerialAddress

POSIX = pytest.mark.skipif(os.name == "nt", reason="names of ports are others in Windows")


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("tcp://192.168.0.1:5007", ("tcp", "192.168.0.1", 5007)),
        ("192.168.0.1", ("tcp", "192.168.0.1", 5007)),
        ("rc8.local:12", ("tcp", "rc8.local", 12)),
        ("tcp:192.168.0.1:5008", ("tcp", "192.168.0.1", 5008)),
        ("TCP://[::1]:1/", ("tcp", "::1", 1)),
        ("udp://192.168.0.1:5007", ("udp", "192.168.0.1", 5007)),
        ("udp://192.168.0.1", ("udp", "192.168.0.1", 5007)),
        ("udp:192.168.0.1:5007", ("udp", "192.168.0.1", 5007)),
        ("Udp:[::1]", ("udp", "::1", 5007)),
        (" udp://localhost:0/ ", ("udp", "localhost", 0)),
    ],
)
def test_hosts(text: str, address: tuple[str, str, int]) -> None:
    assert parse_address(text) == Address(*address)


@pytest.mark.parametrize(
    ("text", "address", "url"),
    [
        ("http://192.168.0.1:8080", ("http", "192.168.0.1", 8080), "http://192.168.0.1:8080"),
        ("HTTP://rc8.local/", ("http", "rc8.local", 80), "http://rc8.local:80"),
        ("https://rc8/ecap/1?cell=2", ("https", "rc8", 443, "/ecap/1?cell=2"), "https://rc8:443/ecap/1?cell=2"),
        ("http://[::1]:0/a%20b", ("http", "::1", 0, "/a%20b"), "http://[::1]:0/a%20b"),
        ("http:127.0.0.1:80", ("http", "127.0.0.1", 80), "http://127.0.0.1:80"),
    ],
)
def test_http(text: str, address: tuple[str, str, int], url: str) -> None:
    assert parse_address(text) == HttpAddress(*address)
    assert str(parse_address(text)) == url
    assert parse_address(url) == HttpAddress(*address)


@pytest.mark.parametrize(
    "text",
    ["http://", "http:///ecap", "http://a b/", "http://a:b:c/", "http://user:word@rc8/", "http://rc8/a b", "http://rc8/日本",
     "http://rc8/#top", "http://rc8?x=1", "http://rc8:65536/", "https://5/", "http://rc8/\r\nHost: x"],
)  # fmt: skip
def test_what_is_no_address_of_http(text: str) -> None:
    with pytest.raises(InvalidAddress, match="http"):
        parse_address(text)


@pytest.mark.parametrize("text", ["tcp://192.168.0.1:5007", "udp://[fe80::1]:5007", "udp://rc8:1"])
def test_a_host_as_text(text: str) -> None:
    assert str(parse_address(text)) == text


@POSIX
@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("serial:///dev/ttyUSB0", SerialAddress("/dev/ttyUSB0")),
        ("serial:///dev/ttyUSB0?", SerialAddress("/dev/ttyUSB0")),
        ("serial:/dev/ttyUSB0?baudrate=9600", SerialAddress("/dev/ttyUSB0", 9600)),
        (
            "serial:///dev/ttyUSB0?baudrate=115200&parity=e&bits=7&stop=2&flow=1",
            SerialAddress("/dev/ttyUSB0", 115200, "E", 7, 2.0, 1),
        ),
        ("serial:///dev/ttyS0?FLOW=2&stop=1.5&parity=M", SerialAddress("/dev/ttyS0", 38400, "M", 8, 1.5, 2)),
        ("serial://ttyACM0", SerialAddress("/dev/ttyACM0")),
        ("serial:///dev/a%20b%3F", SerialAddress("/dev/a b?")),
        ("serial:///dev/serial/by-path/pci-0:1:2?parity=S", SerialAddress("/dev/serial/by-path/pci-0:1:2", parity="S")),
        ("com:1:38400:N:8:1:0", SerialAddress("/dev/ttyS0")),
        ("COM:12:115200:O:7:1.5:2", SerialAddress("/dev/ttyS11", 115200, "O", 7, 1.5, 2)),
        ("com:2", SerialAddress("/dev/ttyS1")),
        ("com:1::e", SerialAddress("/dev/ttyS0", parity="E")),
        ("com:/dev/ttyUSB0:115200", SerialAddress("/dev/ttyUSB0", 115200)),
        ("com:ttyUSB0:115200", SerialAddress("/dev/ttyUSB0", 115200)),
    ],
)
def test_serial_ports(text: str, address: SerialAddress) -> None:
    assert parse_address(text) == address
    assert address.scheme == "serial"


def test_com_in_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.transport.serial.address.os.name", "nt")
    assert parse_address("com:3:9600") == SerialAddress("COM3", 9600)
    assert parse_address("com:COM7") == parse_address("serial://COM7") == SerialAddress("COM7")
    assert parse_address(r"serial://\\.\COM12") == SerialAddress(r"\\.\COM12")


def test_a_serial_port_as_text() -> None:
    address = SerialAddress("/dev/ttyUSB0", 115200, "E", 7, 1.5, 2)
    assert str(address) == "serial:///dev/ttyUSB0?baudrate=115200&parity=E&bits=7&stop=1.5&flow=2"
    with pytest.raises(FrozenInstanceError):
        address.baudrate = 1


@POSIX
@given(
    st.text(st.characters(min_codepoint=32, exclude_categories=["Cs"]), min_size=1, max_size=40),
    st.integers(50, 20_000_000),
    st.sampled_from("NEOMS"),
    st.integers(5, 8),
    st.sampled_from([1.0, 1.5, 2.0]),
    st.integers(0, 2),
)
def test_every_serial_port_comes_back_from_its_text(
    name: str, baudrate: int, parity: str, bits: int, stop: float, flow: int
) -> None:
    address = SerialAddress(f"/dev/{name}x", baudrate, parity, bits, stop, flow)
    assert parse_address(str(address)) == address


@given(st.text(max_size=60), st.sampled_from(["", "tcp:", "udp://", "serial:", "serial://", "com:", "com:1:", "pty:"]))
def test_any_text_is_an_address_or_refused(text: str, begin: str) -> None:
    try:
        address = parse_address(begin + text)
    except InvalidAddress:
        return
    assert parse_address(str(address)) == address


def test_pseudo_terminals() -> None:
    assert parse_address("pty://") == parse_address("pty:") == PtyAddress()
    assert str(PtyAddress()) == "pty://"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "expected HOST or HOST:PORT"),
        ("udp://", "expected HOST or HOST:PORT"),
        ("udp://:5007", "expected HOST or HOST:PORT"),
        ("[[]", "expected HOST or HOST:PORT"),
        ("udp://[[::1]]", "expected HOST or HOST:PORT"),
        ("tcp://a[b]:1", "expected HOST or HOST:PORT"),
        ("udp://a:b", "port 'b' is not 0 to 65535"),
        ("5008", "5008 is a port without a host. Example: tcp://127.0.0.1:5008"),
        ("udp://5007", "5007 is a port without a host. Example: udp://127.0.0.1:5007"),
        ("65536", "65536 is not a host"),
        ("5007:5007", "5007 is not a host"),
        ("can:", "expected an interface of python-can"),
        ("gopher://x", "unknown transport 'gopher'"),
        ("serial://", "a serial port is required"),
        ("serial://?baudrate=1", "a serial port is required"),
        ("serial:///dev/a\tb", "a serial port is required"),
        ("serial:///dev/a%00b", "a serial port is required"),
        ("serial:///dev/\ud800", "a serial port is required"),
        ("serial:///dev/" + "a" * 5000, "a serial port is required"),
        ("serial:///dev/ttyS0?baud=9600", "unknown setting 'baud'"),
        ("serial:///dev/ttyS0?bits=8&bits=8", "bits is given twice"),
        ("serial:///dev/ttyS0?baudrate=fast", "baudrate cannot be 'fast'"),
        ("serial:///dev/ttyS0?baudrate=", "baudrate cannot be ''"),
        ("serial:///dev/ttyS0?baudrate=0", "baudrate cannot be '0'"),
        ("serial:///dev/ttyS0?baudrate=99999999999999999999", "baudrate cannot be '9999"),
        ("serial:///dev/ttyS0?parity=NE", "parity cannot be 'NE'"),
        ("serial:///dev/ttyS0?parity=", "parity cannot be ''"),
        ("serial:///dev/ttyS0?bits=9", "bits cannot be '9'"),
        ("serial:///dev/ttyS0?stop=3", "stop cannot be '3'"),
        ("serial:///dev/ttyS0?flow=3", "flow cannot be '3'"),
        ("com:", "a serial port is required"),
        ("com:0", "COM ports are numbered from 1"),
        ("com:1:38400:N:8:1:0:7", "at most 5 settings may follow the port"),
        ("com:1:x", "baudrate cannot be 'x'"),
        ("com:1:9600:Q", "parity cannot be 'Q'"),
        ("com:1:9600:N:4", "bits cannot be '4'"),
        ("com:1:9600:N:8:0", "stop cannot be '0'"),
        ("com:1:9600:N:8:1:-1", "flow cannot be '-1'"),
        ("pty://x", "nothing may follow pty://"),
    ],
)
def test_what_is_no_address(text: str, reason: str) -> None:
    with pytest.raises(InvalidAddress) as caught:
        parse_address(text)
    message = str(caught.value)
    assert reason in message
    assert len(message) < 600
    example = message.partition("Example: ")[2]
    parse_address(example)  # the example must be valid itself


@pytest.mark.parametrize("value", [5007, None, b"tcp://a", 10**5000, [10**5000]], ids=brief)
def test_no_text(value: Any) -> None:
    with pytest.raises(InvalidAddress, match="expected a string"):
        parse_address(value)


def test_in_japanese() -> None:
    i18n.use("ja")
    with pytest.raises(InvalidAddress, match="parity に 'X' は指定できません") as caught:
        parse_address("serial:///dev/ttyS0?parity=X")
    assert "例: serial:///dev/ttyUSB0" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [("/dev/ttyUSB0", "requires the prefix serial://"), ("serial://dev/ttyUSB0", "must begin with a slash")],
)
def test_slips_with_ports(text: str, said: str) -> None:
    with pytest.raises(InvalidAddress, match=said) as caught:
        parse_address(text)
    assert "Example: serial:///dev/ttyUSB0" in str(caught.value)


@pytest.mark.parametrize(
    ("host", "network"),
    [
        ("192.168.0.7", "192.168.0.7"), ("127.0.0.1", "127.0.0.1"), ("127.200.3.4", "127.0.0.1"), ("::1", "127.0.0.1"),
        ("::ffff:192.168.0.7", "192.168.0.7"), ("::ffff:127.0.0.2", "127.0.0.1"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"), ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"), ("/dev/pts/3", "/dev/pts/3"), ("", ""),
    ],
)  # fmt: skip
def test_what_counts_as_one_place_of_origin(host, network):
    assert network_of(host) == network
