"""The parameters of table 5-2 as a string and as form fields."""

from __future__ import annotations

from dataclasses import replace

import pytest

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.raw.options import RawOptions, Role
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.raw.fields import RawFields, checked_options, initial_fields, proposed_place

PRINTED = "Conn=eth:192.168.0.1:5007, Timeout=300, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True"


def test_the_string_of_the_document():
    fields = RawFields.parse(PRINTED)
    assert fields == RawFields(Role.TCP_CLIENT, "192.168.0.1:5007", "300")
    assert f"{fields}" == PRINTED


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (RawFields(), "Conn=eth:127.0.0.1:5007, Timeout=500, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True"),
        (
            RawFields(Role.TCP_SERVER, "127.0.0.1:5008", clients="3", sync=False),
            "Conn=eth:127.0.0.1:5008, Timeout=500, PacketOpt=0:0:0, EtherOpt=1:3, Sync=False",
        ),
        (
            RawFields(Role.UDP_CLIENT, "[::1]:5007"),
            "Conn=eth:[::1]:5007, Timeout=500, PacketOpt=0:0:0, EtherOpt=2:0, Sync=True",
        ),
        (
            RawFields(Role.UDP_SERVER, "localhost:0"),
            "Conn=eth:localhost:0, Timeout=500, PacketOpt=0:0:0, EtherOpt=3:0, Sync=True",
        ),
        (
            RawFields(Role.SERIAL, "/dev/ttyUSB0:38400:N:8:1:0"),
            "Conn=com:/dev/ttyUSB0:38400:N:8:1:0, Timeout=500, PacketOpt=0:0:0, Sync=True",
        ),
        (
            RawFields(Role.SERIAL, "serial:///dev/by:path?baudrate=9600&parity=N&bits=8&stop=1&flow=0"),
            'Conn="serial:///dev/by:path?baudrate=9600&parity=N&bits=8&stop=1&flow=0", Timeout=500, PacketOpt=0:0:0, Sync=True',
        ),
    ],
)
def test_the_fields_and_the_string_are_in_step(fields, text):
    assert f"{fields}" == text
    assert RawFields.parse(text) == fields
    assert f"{RawOptions.parse(text)}" == text
    assert fields.problems() == {}


@pytest.mark.parametrize(
    ("change", "name", "message"),
    [
        ({"place": ""}, "place", "no address"),
        ({"place": "127.0.0.1:99999"}, "place", "99999"),
        ({"place": "127.0.0.1, Sync=False"}, "place", "neither commas"),
        ({"place": "0.0.0.0:5008", "role": Role.TCP_SERVER}, "place", "not a loopback address"),
        ({"place": "example.org", "role": Role.UDP_SERVER}, "place", "not a loopback address"),
        ({"place": "", "role": Role.SERIAL}, "place", ""),
        ({"timeout": "0"}, "timeout", "Timeout cannot be '0'"),
        ({"timeout": "soon"}, "timeout", "Timeout cannot be 'soon'"),
        ({"packet_opt": "32:0:0"}, "packet_opt", "b-CAP"),
        ({"packet_opt": "0:1:0"}, "packet_opt", "ENQ"),
        ({"clients": "101", "role": Role.TCP_SERVER, "place": "127.0.0.1:0"}, "clients", "0-100"),
    ],
)
def test_an_invalid_field_is_named_and_invalidates_the_string(change, name, message):
    fields = replace(RawFields(), **change)
    assert list(fields.problems()) == [name]
    assert message in fields.problems()[name]
    if "Sync=False" not in fields.place:
        with pytest.raises((InvalidValue, InvalidAddress)):
            checked_options(f"{fields}")


def test_the_number_of_clients_matters_only_for_a_tcp_server():
    assert replace(RawFields(), clients="many").problems() == {}


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]", ""])
def test_a_server_listens_on_loopback(host):
    assert checked_options(f"Conn=eth:{host}:5008, EtherOpt=1:2").clients == 2


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("tcp://192.168.0.1:5007", RawFields(Role.TCP_CLIENT, "192.168.0.1:5007")),
        ("udp://192.168.0.1", RawFields(Role.UDP_CLIENT, "192.168.0.1:5007")),
        ("http://192.168.0.1:8080", RawFields(Role.TCP_CLIENT, "192.168.0.1:5007")),
        ("http://[fd00::1]:8080", RawFields(Role.TCP_CLIENT, "[fd00::1]:5007")),
        ("serial:///dev/ttyS1?baudrate=9600", RawFields(Role.SERIAL, "/dev/ttyS1:9600:N:8:1:0")),
        ("can://socketcan/can0", RawFields()),
    ],
)
def test_the_address_of_the_selected_connection_is_the_default(url, expected):
    assert initial_fields(ConnectionSpec("here", url)) == expected
    assert initial_fields(ConnectionSpec("here", url)).problems() == {}


def test_the_timeout_of_the_selected_connection_is_the_default():
    assert initial_fields(ConnectionSpec("here", "tcp://127.0.0.1", timeout=800)).timeout == "800"
    assert initial_fields(None) == RawFields()


def test_proposed_addresses():
    connection = ConnectionSpec("here", "tcp://192.168.0.1:5007")
    assert proposed_place(Role.UDP_CLIENT, connection) == "192.168.0.1:5007"
    assert proposed_place(Role.TCP_SERVER, connection) == "127.0.0.1:5008"
    assert proposed_place(Role.SERIAL, connection) == "/dev/ttyUSB0:38400:N:8:1:0"
    line = ConnectionSpec("line", "serial:///dev/ttyS1")
    assert proposed_place(Role.SERIAL, line) == "/dev/ttyS1:38400:N:8:1:0"
    assert proposed_place(Role.TCP_CLIENT, line) == "127.0.0.1:5007"
