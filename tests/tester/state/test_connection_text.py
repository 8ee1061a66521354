"""Connection strings of the form, and the strings that were used before."""

from __future__ import annotations

from dataclasses import replace

import pytest

from orinkit import ConnectionString
from orinkit.client._shared.connection_string import OPTIONS
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.connection_text import LONGEST_STRING, MAX_STRINGS, StringHistory, spec_of_string, string_of
from orinkit.transport.address import parse_address

DENSO = (
    "Server=192.168.0.1:5007, UDP=False, Timeout=800, TORetry=1, Provider=CaoProv.DENSO.VRC, Machine=192.168.0.1, "
    'Option="@EventDisable=False,Wpj=*", Message=False, Debug=True'
)
BASE = ConnectionSpec("cell", "tcp://10.0.0.1:5007", token="secret", driver=3)


def test_all_options_of_the_string_are_adopted_and_the_rest_remains():
    spec = spec_of_string(DENSO, BASE)
    assert spec == ConnectionSpec(
        "cell", "tcp://192.168.0.1:5007", "CaoProv.DENSO.VRC", "192.168.0.1", "@EventDisable=False,Wpj=*", messages=False,
        timeout=800, tries=1, debug=True, token="secret", driver=3,
    )  # fmt: skip
    assert string_of(spec) == DENSO


@pytest.mark.parametrize(
    "url", ["tcp://a:1", "udp://[::1]:5007", "serial:///dev/ttyUSB0?baudrate=38400", "http://a:8080/x", "https://a:443"]
)
def test_a_string_represents_the_connection_of_every_transport(url):
    spec = ConnectionSpec("a", url, "", "host", 'it\'s, "quoted"', messages=False, timeout=700, tries=2, debug=True)
    again = spec_of_string(string_of(spec), replace(BASE, token=""))
    assert again == replace(spec, name="cell", driver=3, url=str(parse_address(url)))


@pytest.mark.parametrize(("url", "timeout"), [("tcp://a:1", 3000), ("udp://a:1", 500), ("nothing://a", 500)])
def test_the_default_time_out_is_written_as_a_number(url, timeout):
    assert f"Timeout={timeout}," in string_of(ConnectionSpec("a", url))


def test_omitted_options_have_the_defaults_of_the_table():
    spec = spec_of_string("Server=192.168.0.1", replace(BASE, debug=True, messages=False, tries=1, option="x"))
    assert (spec.timeout, spec.tries, spec.messages, spec.debug, spec.option) == (500, 5, True, False, "")
    assert ConnectionString.parse(string_of(spec)) == ConnectionString(server="192.168.0.1:5007")


@pytest.mark.parametrize(
    "text", ["", "Server=", "Server=a, Speed=1", "Timeout=1", "Server=can://socketcan/can0", "Server=a, UDP=2"]
)
def test_an_invalid_string_names_the_option(text):
    with pytest.raises(InvalidAddress):
        spec_of_string(text, BASE)


def test_a_time_out_beyond_the_limit_of_the_tester_is_refused():
    with pytest.raises(InvalidValue, match="3,600,000"):
        spec_of_string("Server=a, Timeout=2000000000", BASE)


@pytest.mark.parametrize("url", ["", "can://socketcan/can0", "tcp://"])
def test_without_an_address_and_for_can_there_is_no_string(url):
    assert string_of(ConnectionSpec("a", url)) == ""


def test_every_option_of_the_table_is_written():
    text = string_of(ConnectionSpec("a", "tcp://a:1"))
    assert [part.partition("=")[0] for part in text.split(", ")] == [option.name for option in OPTIONS]


def test_the_newest_string_is_first_and_the_number_is_limited(tmp_path):
    history = StringHistory(tmp_path / "strings.json")
    for number in range(MAX_STRINGS + 5):
        history.add(f"Server=a{number}")
    history.add("Server=a20")
    history.add("")
    history.add("x" * (LONGEST_STRING + 1))
    again = list(StringHistory(tmp_path / "strings.json"))
    assert again == list(history)
    assert again[:2] == ["Server=a20", f"Server=a{MAX_STRINGS + 4}"]
    assert len(again) == len(set(again)) == MAX_STRINGS
    history.clear()
    assert list(StringHistory(tmp_path / "strings.json")) == []


@pytest.mark.parametrize("content", ["", "{}", "[1]", '"a"', "[" * 100_000])
def test_a_damaged_file_of_strings_is_kept(tmp_path, content):
    path = tmp_path / "strings.json"
    path.write_text(content)
    history = StringHistory(path)
    assert list(history) == []
    history.add("Server=a")
    assert path.with_suffix(".json.bak").read_text() == content
