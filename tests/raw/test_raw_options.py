"""The parameter string of table 5-2."""

from __future__ import annotations

import pytest

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.raw.options import MOST_CLIENTS, OPTIONS, PACKET_MODES, RawOptions, Role
from orinkit.transport.address import Address
from orinkit.transport.serial.address import SerialAddress

PRINTED = "Conn=eth:192.168.0.1:5007, Timeout=300, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True"


def test_the_printed_string():
    options = RawOptions.parse(PRINTED)
    assert options == RawOptions(Address("tcp", "192.168.0.1", 5007), Role.TCP_CLIENT, 0.3)
    assert str(options) == PRINTED


@pytest.mark.parametrize(
    ("text", "url", "role"),
    [
        ("Conn=eth:192.168.0.1", "tcp://192.168.0.1:5007", Role.TCP_CLIENT),
        ("conn = eth:[::1]:7 , ETHEROPT=2:0", "udp://[::1]:7", Role.UDP_CLIENT),
        ("Conn=eth:, EtherOpt=1", "tcp://127.0.0.1:5007", Role.TCP_SERVER),
        ("Conn=eth, EtherOpt=1:3", "tcp://127.0.0.1:5007", Role.TCP_SERVER),
        ("Conn=eth::5008, EtherOpt=3", "udp://127.0.0.1:5008", Role.UDP_SERVER),
        ("Conn=eth:0.0.0.0:5008, EtherOpt=1", "tcp://0.0.0.0:5008", Role.TCP_SERVER),
        ("tcp://robot", "tcp://robot:5007", Role.TCP_CLIENT),
        ("robot", "tcp://robot:5007", Role.TCP_CLIENT),
        ("udp://robot:9", "udp://robot:9", Role.UDP_CLIENT),
    ],
)
def test_addresses(text, url, role):
    options = RawOptions.parse(text)
    assert (str(options.address), options.role) == (url, role)
    assert RawOptions.parse(str(options)) == options


@pytest.mark.parametrize(
    "text",
    [
        "Conn=com:/dev/ttyS0:9600:E:7:2:1",
        "com:/dev/ttyS0:9600:E:7:2:1",
        "serial:///dev/ttyS0?baudrate=9600&parity=E&bits=7&stop=2&flow=1",
        "Conn=serial:///dev/ttyS0?baudrate=9600&parity=E&bits=7&stop=2&flow=1",
    ],
)
def test_serial_lines(text):
    options = RawOptions.parse(text)
    assert options.role is Role.SERIAL
    assert options.address == SerialAddress("/dev/ttyS0", 9600, "E", 7, 2.0, 1)
    assert RawOptions.parse(str(options)) == options
    assert options.role.profile.crc


def test_a_path_with_separators():
    options = RawOptions.parse("serial:///dev/by:path,1")
    assert RawOptions.parse(str(options)) == options


def test_defaults_of_the_table():
    options = RawOptions.parse("Conn=eth:h")
    assert (options.timeout, options.clients, options.sync) == (0.5, 5, True)
    assert [row.name for row in OPTIONS] == ["Conn", "Timeout", "PacketOpt", "EtherOpt", "Sync"]
    assert not RawOptions.parse("Conn=eth:h,Sync=FALSE").sync


@pytest.mark.parametrize("mode", PACKET_MODES, ids=lambda mode: mode.name)
def test_modes_for_other_data_are_refused_by_name(mode):
    with pytest.raises(
        InvalidValue, match=rf"the mode {mode.name} \({mode.value}\) does not apply here: .*PacketOpt=0:0:0"
    ):
        RawOptions.parse(f"Conn=eth:h, PacketOpt={mode.value}:0:0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Conn=eth:h, PacketOpt=0:1", "ENQ does not apply"),
        ("Conn=eth:h, PacketOpt=0:0:2", r"CR\+LF does not apply"),
        ("Conn=eth:h, PacketOpt=64", "0-63"),
        ("Conn=eth:h, PacketOpt=0:0:0:0", "PacketOpt cannot be"),
        ("Conn=eth:h, EtherOpt=4", "EtherOpt cannot be '4'; expected: 0-3"),
        (f"Conn=eth:h, EtherOpt=1:{MOST_CLIENTS + 1}", "EtherOpt cannot be"),
        ("Conn=com:1, EtherOpt=0:0", "EtherOpt does not apply to a serial line"),
        ("Conn=eth:", "Conn contains no address"),
        ("Timeout=300", "Conn cannot be ''"),
        ("Conn=usb:1", "Conn cannot be 'usb:1'"),
        ("Conn=eth:h, Timeout=0", "1-3600000 ms"),
        ("Conn=eth:h, Timeout=1.5", "Timeout cannot be '1.5'"),
        ("Conn=eth:h, Sync=maybe", "Sync cannot be 'maybe'"),
        ("Conn=eth:h, Retry=3", "unknown parameter 'retry'; available: Conn"),
        ("Conn=eth:h, conn=eth:h", "conn is given twice"),
        ("Conn=eth:h" + "," * 5000, "4096 characters"),
    ],
)
def test_invalid_parameters(text, message):
    with pytest.raises(InvalidValue, match=message):
        RawOptions.parse(text)


@pytest.mark.parametrize("text", ["http://h", "can://socketcan/can0", "pty://", "", "Conn=eth:h:99999"])
def test_addresses_without_packets_are_refused(text):
    with pytest.raises(InvalidAddress):
        RawOptions.parse(text)
