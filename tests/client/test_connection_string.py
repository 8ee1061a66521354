"""Connection strings of RC8 table 5-1: each option, round trips, and what ``connect`` makes of them."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import orinkit
from orinkit import ConnectionString
from orinkit import functions as f
from orinkit.client._shared.connection_string import OPTIONS, ConnectArguments, evaluate, is_connection_string
from orinkit.core import i18n
from orinkit.core.errors import InvalidAddress, InvalidValue
from support.both import Both
from support.devices import Recorder

DENSO = (
    "Server=192.168.0.1, UDP=0, Timeout=800, TORetry=1, Provider=CaoProv.DENSO.VRC, Machine=192.168.0.1, Option=0, "
    "Message=False, Debug=True"
)
HOSTS = ["192.168.0.1", "robot", "robot:5007", "[fe80::1]", "[::1]:80"]
LINES = ["COM3", "com:3:38400:N:8:1:0", "/dev/ttyUSB0", "serial:///dev/ttyUSB0?baudrate=115200"]
WEB = ["http://robot:8080/path", "https://robot"]

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=60)
PARSED = st.one_of(
    st.builds(ConnectionString, server=st.sampled_from(HOSTS), udp=st.booleans()),
    st.builds(
        ConnectionString,
        server=st.sampled_from(HOSTS + LINES + WEB),
        timeout_ms=st.integers(1, 2_000_000_000),
        tries=st.integers(),
        provider=TEXTS,
        machine=TEXTS,
        option=TEXTS,
        messages=st.booleans(),
        debug=st.booleans(),
    ),
)


def parse(options: str) -> ConnectionString:
    return ConnectionString.parse(f"Server=robot, {options}")


# --- the table --------------------------------------------------------------------------------------------------------


def test_the_string_of_the_tester() -> None:
    parsed = ConnectionString.parse(DENSO)
    assert parsed == ConnectionString(
        server="192.168.0.1", udp=False, timeout_ms=800, tries=1, provider="CaoProv.DENSO.VRC", machine="192.168.0.1",
        option="0", messages=False, debug=True,
    )  # fmt: skip
    assert str(parsed) == DENSO.replace("UDP=0", "UDP=False")
    assert parsed.url == "tcp://192.168.0.1:5007"
    assert parsed.timeout == 0.8
    assert parsed.arguments == {
        "timeout": 0.8, "tries": 1, "provider": "CaoProv.DENSO.VRC", "machine": "192.168.0.1", "option": "0",
        "messages": False, "debug": True,
    }  # fmt: skip


def test_the_defaults_of_the_table() -> None:
    assert parse("") == ConnectionString(
        server="robot", udp=False, timeout_ms=500, tries=5, provider="CaoProv.DENSO.VRC", machine="localhost",
        option="", messages=True, debug=False,
    )  # fmt: skip


@given(PARSED)
@example(ConnectionString(server="robot", option='@EventDisable=False,Wpj="*"'))
@example(ConnectionString(server="robot", option="it's (open"))
@example(ConnectionString(server="robot", option='"quoted"', machine=" "))
def test_round_trip(parsed: ConnectionString) -> None:
    text = str(parsed)
    assert ConnectionString.parse(text) == parsed
    assert is_connection_string(text)


@given(PARSED, st.randoms(use_true_random=False), st.sampled_from(["", " ", "\t ", " \n"]))
def test_order_case_and_blanks_do_not_matter(parsed: ConnectionString, random: Any, blank: str) -> None:
    written = [option.write(getattr(parsed, option.parameter)) for option in OPTIONS]
    random.shuffle(written)
    parts = []
    for part in written:
        name, _, value = part.partition("=")
        parts.append(f"{blank}{random.choice([name.lower(), name.upper()])}{blank}={blank}{value}{blank}")
    assert ConnectionString.parse(",".join(parts)) == parsed


@given(PARSED, st.sets(st.sampled_from([option.parameter for option in OPTIONS if option.default is not None])))
def test_an_omitted_option_has_its_default(parsed: ConnectionString, omitted: set[str]) -> None:
    text = ", ".join(
        option.write(getattr(parsed, option.parameter)) for option in OPTIONS if option.parameter not in omitted
    )
    result = ConnectionString.parse(text)
    for option in OPTIONS:
        expected = option.default if option.parameter in omitted else getattr(parsed, option.parameter)
        assert getattr(result, option.parameter) == expected


@given(st.integers())
@example(10**400)
def test_a_number_of_tries_outside_1_to_7_counts_as_the_nearest(number: int) -> None:
    assert parse(f"TORetry={number}").tries == min(max(number, 1), 7)


@given(st.integers())
def test_every_time_out_is_a_number_of_milliseconds(number: int) -> None:
    if 1 <= number <= 2_000_000_000:
        assert parse(f"Timeout={number}").timeout == number / 1000
    else:
        with pytest.raises(InvalidAddress, match=rf"Timeout cannot be '{number}'"):
            parse(f"Timeout={number}")


@pytest.mark.parametrize(("name", "parameter"), [("UDP", "udp"), ("Message", "messages"), ("Debug", "debug")])
def test_flags(name: str, parameter: str) -> None:
    for text, value in (("True", True), ("1", True), ("false", False), ("0", False)):
        assert getattr(parse(f"{name}={text}"), parameter) is value
    assert getattr(parse(name), parameter) is True


def test_an_option_string_with_commas_is_quoted() -> None:
    assert parse('Option="@EventDisable=False,Wpj=*", UDP=1').option == "@EventDisable=False,Wpj=*"
    assert parse("Option='a,b'").option == "a,b"
    assert parse("Option={a,b}").option == "{a,b}"
    assert parse('Option="a""b"').option == 'a"b'
    assert parse("Option").option == parse("Option=").option == ""


# --- addresses --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("Server=192.168.0.1", "tcp://192.168.0.1:5007"),
        ("Server=192.168.0.1:5008, UDP=True", "udp://192.168.0.1:5008"),
        ("Server=[::1], UDP", "udp://[::1]:5007"),
        ("Server=http://robot:8080/path", "http://robot:8080/path"),
        ("Server=/dev/ttyUSB0", "serial:///dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0"),
    ],
)
def test_addresses(text: str, url: str) -> None:
    assert ConnectionString.parse(text).url == url


@pytest.mark.skipif(os.name == "nt", reason="paths of Linux")
def test_com_ports() -> None:
    assert ConnectionString.parse("Server=COM3").url.startswith("serial:///dev/ttyS2?baudrate=38400")
    assert ConnectionString.parse("Server=com4:115200").url.startswith("serial:///dev/ttyS3?baudrate=115200")
    assert ConnectionString.parse("Server=com:5:9600:E").url.endswith(
        "ttyS4?baudrate=9600&parity=E&bits=8&stop=1&flow=0"
    )


# --- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("UDP=1", "Server is missing. Try: Server=192.168.0.1"),
        ("Server=a, Frob=1", "unknown option 'Frob=1'; known options: Server, UDP, Timeout, TORetry, Provider"),
        ("Server=a, =1", "unknown option '=1'"),
        ("Server=a, server=b", "Server is given twice"),
        ("Server=", "Server cannot be ''; expected: HOST, HOST:PORT, COM1"),
        ("Server=a:99999", "Server cannot be 'a:99999'; expected: HOST"),
        ("Server=tcp://a", "Server cannot be 'tcp://a'; expected: HOST"),
        ("Server=udp:a", "Server cannot be 'udp:a'; expected: HOST"),
        ("Server=COM0", "Server cannot be 'COM0'"),
        ("Server=frob://a", "Server cannot be 'frob://a'"),
        ("Server=a, Timeout", "Timeout requires a value; expected: a number of ms from 1 to 2,000,000,000"),
        ("Server=a, Timeout=0.5", "Timeout cannot be '0.5'; expected: a number of ms"),
        ("Server=a, TORetry=many", "TORetry cannot be 'many'; expected: a number from 1 to 7"),
        ("Server=a, TORetry=2²", "TORetry cannot be '2²'"),
        ("Server=a, UDP=2", "UDP cannot be '2'; expected: True or False"),
        ("Server=a, Message=", "Message cannot be ''; expected: True or False"),
        ("Server=a, Debug=on", "Debug cannot be 'on'; expected: True or False"),
        ("Server=COM3, UDP=True", "UDP cannot be 'True'; expected: True or False; True requires Server=HOST:PORT"),
        ("Server=http://a, UDP=True", "UDP cannot be 'True'"),
        ('Server=a, Option="x', '" is missing after'),
        ("Server=a, Option=(x, UDP=1", ") is missing after"),
        ("Server=a, Option=" + "x" * 4096, "exceeds the limit of 4096 characters"),
    ],
)
def test_errors_name_option_value_and_what_is_allowed(both: Both, text: str, reason: str) -> None:
    for attempt in (ConnectionString.parse, both.connect, both.client):
        if attempt is ConnectionString.parse or is_connection_string(text):
            with pytest.raises(InvalidAddress) as caught:
                attempt(text)
            assert reason in str(caught.value)


def test_errors_in_japanese() -> None:
    i18n.use("ja")
    with pytest.raises(InvalidAddress, match=r"TORetry に 'x' は指定できません \(指定できる値: 1～7 の整数\)"):
        parse("TORetry=x")


@pytest.mark.parametrize(
    "field", [{"timeout_ms": 0.5}, {"timeout_ms": True}, {"tries": "5"}, {"udp": 1}, {"option": None}]
)
def test_values_of_the_wrong_type(field: dict[str, Any]) -> None:
    with pytest.raises(InvalidAddress):
        ConnectionString(server="robot", **field)


@pytest.mark.parametrize(
    "text", ["robot", "tcp://robot:5007", "serial:///dev/tty?baudrate=9600", "http://a/?Server=b", 5]
)
def test_other_addresses_are_no_connection_strings(text: Any) -> None:
    assert not is_connection_string(text)
    assert evaluate(ConnectArguments(text)) == ConnectArguments(text)


# --- together with arguments ------------------------------------------------------------------------------------------


def test_arguments_apply_to_options_that_the_string_does_not_contain() -> None:
    found = evaluate(ConnectArguments("Server=robot, TORetry=2", provider="X", timeout=3.0, debug=True))
    assert found == ConnectArguments("tcp://robot:5007", provider="X", timeout=3.0, tries=2, debug=True)
    assert evaluate(ConnectArguments("Server=robot")).timeout == 0.5
    same = evaluate(ConnectArguments("Server=robot, Timeout=800, Debug=True", timeout=0.8, debug=True))
    assert (same.timeout, same.debug) == (0.8, True)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("Timeout=800", "timeout", 3.0),
        ("TORetry=2", "tries", 3),
        ("Provider=X", "provider", "Y"),
        ("Machine=X", "machine", "Y"),
        ("Option=X", "option", "Y"),
        ("Message=True", "messages", False),
        ("Debug=False", "debug", True),
    ],
)
def test_an_argument_that_contradicts_the_string(both: Both, text: str, name: str, value: Any) -> None:
    with pytest.raises(InvalidValue, match=f"{text} in the connection string contradicts {name}="):
        both.connect(f"Server=127.0.0.1:1, {text}", **{name: value})


def test_connect(both: Both, listen_at: str) -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, listen_at) as server:
        scheme, _, place = server.url.partition("://")
        kept = server.url if scheme in ("serial", "http") else place
        options = {"dialect": "rc8"} if scheme == "serial" else {}
        controller = both.connect(
            f"Server={kept}, UDP={scheme == 'udp'}, Timeout=20000, TORetry=2, Provider=Test.Recorder, "
            'Machine=10.0.0.1, Option="A=1,B=(2)"',
            **options,
        )
        assert (controller.client.timeout, controller.client.tries) == (20.0, 2)
        both.run(controller.close())
        made = next(call for call in recorder.calls if call.function == "Controller_Connect")
        assert made.arguments[1:] == ("10.0.0.1", "A=1,B=(2)")

        client = both.client(f"Server={kept}, UDP={scheme == 'udp'}, Timeout=20000, Debug")
        assert both.run(client.call(f.service_start)) is None
        assert client.timeout == 20.0
        both.run(client.close())
