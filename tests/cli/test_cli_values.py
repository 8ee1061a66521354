"""get, put and info against a virtual RC8."""

from __future__ import annotations

import math
from datetime import datetime
from decimal import Decimal

import pytest

import orinkit
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cli._shared.output import jsonable, text
from orinkit.cli.commands.put import read_values
from orinkit.core import i18n
from orinkit.core.hresult import MOTOR_NOT_ON
from orinkit.values.variant import ARRAY, R8_ARRAY, Variant, VarType

# --- get and put ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "words", "shown"),
    [
        ("I1", ["100"], "100"),
        ("I1", ["-5"], "-5"),
        ("F1", ["0.1"], "0.1"),
        ("D1", ["2.5e3"], "2500"),
        ("IO150", ["true"], "true"),
        ("IO150", ["3,-1"], "true"),
        ("S1", ["Hello, 世界"], "Hello, 世界"),
        ("S1", ["8,100"], "100"),
        ("S1", ["--", "-x"], "-x"),
        ("P1", ["400", "0", "-300.5", "180", "0", "180", "5"], "400 0 -300.5 180 0 180 5"),
        ("P1", ["8197,1,2,3,4,5,6,5"], "1 2 3 4 5 6 5"),
    ],
)
def test_get_returns_the_value_put(run, url, name, words, shown):
    put = run("put", url, name, *words)
    assert (put.code, put.err) == (0, "")
    assert put.out.startswith(f"{name} = ")
    assert run("get", url, name) == (0, f"{shown}\n", "")


def test_get_as_json(run, url):
    run("put", url, "V3", "1", "2.5", "-3")
    assert run("get", url, "V3", "--json").json == {
        "name": "V3", "type": "VT_R4|VT_ARRAY", "value": [1.0, 2.5, -3.0], "notation": "8196,1,2.5,-3",
    }  # fmt: skip
    assert run("get", url, "@CURRENT_TIME", "--json").json["type"] == "VT_DATE"


def test_put_as_json_shows_the_value_sent(run, url):
    done = run("put", url, "I1", "2,7", "--json")
    assert done.json == {"name": "I1", "type": "VT_I2", "value": 7, "notation": "2,7"}


def test_the_address_may_be_only_a_host_and_a_port(run, url):
    assert run("get", url.removeprefix("tcp://"), "I1").out == "0\n"


@pytest.mark.parametrize("kind", ["robot", "task", "extension", "file"])
def test_a_variable_of_another_object(run, recorder, recorder_url, kind):
    recorder.calls.clear()
    done = run("put", recorder_url, "@X", "5", f"--{kind}", "Name", "--provider", "Test.Recorder")
    assert done == (0, "@X = 5\n", "")
    made = [call for call in recorder.calls if call.function == "Variable_PutValue"]
    assert [(call.path.split("/")[1:], call.arguments) for call in made] == [(["Name", "@X"], (5,))]


def test_trace_shows_every_packet_on_stderr(run, url):
    done = run("get", url, "I1", "--trace")
    assert done.out == "0\n"
    assert '→ Service_Start("WDT=400")' in done.err
    assert "← S_OK -> 0" in done.err
    assert "01 10 00 00 00" in done.err


def test_an_error_of_the_controller_is_reported_in_one_line(refused, url):
    assert refused("get", url, "I100") == (
        "Controller_GetVariable(2, 'I100', ''): 0x81500053 VARIABLE_INDEX_INVALID: Variable index out of range. "
        "Try: Use a number that exists on the controller."
    )
    assert "0x80020005 DISP_E_TYPEMISMATCH" in refused("put", url, "I1", "abc")
    assert "E_CAO_PROV_INVALID" in refused("get", url, "I1", "--provider", "CaoProv.Nobody")


def test_no_server(refused):
    assert "cannot connect to tcp://127.0.0.1:1" in refused("get", "127.0.0.1:1", "I1")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["get", "ftp://x", "I1"], "invalid address 'ftp://x': unknown transport 'ftp'"),
        (["get", "127.0.0.1:1", "I1", "--timeout", "0"], "timeout must be a number of seconds above 0"),
        (["get", "127.0.0.1:1", "I1", "--robot", "a", "--task", "b"], "give only one of --robot --task"),
        (["put", "127.0.0.1:1", "I1", "99999999999"], "column 1: expected a whole number"),
        (["put", "127.0.0.1:1", "I1", "8197,1,x"], "column 8: expected a number"),
        (["put", "127.0.0.1:1", "I1"], "VALUE is missing (see orinkit put --help)"),
    ],
)
def test_a_command_line_that_cannot_be_used(refused, url, argv, message):
    argv = [url if word == "127.0.0.1:1" else word for word in argv]
    assert message in refused(*argv, code=2)


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["5"], Variant(VarType.I4, 5)),
        (["5", "6"], Variant(R8_ARRAY, [5.0, 6.0])),
        (["5", "2,6", "1e3"], Variant(R8_ARRAY, [5.0, 6.0, 1000.0])),
        (["a", "b"], Variant(VarType.BSTR | ARRAY, ["a", "b"])),
        (["a", "8,5"], Variant(VarType.BSTR | ARRAY, ["a", "5"])),
        (["a", "2,5"], Variant(VarType.VARIANT | ARRAY, [Variant(VarType.BSTR, "a"), Variant(VarType.I2, 5)])),
        (
            ["true", "1"],
            Variant(VarType.VARIANT | ARRAY, [Variant(VarType.BOOL, True), Variant(VarType.I4, 1)]),
        ),
    ],
)
def test_several_words_are_one_array(words, value):
    assert read_values(tuple(words)) == value


# --- formats of values ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (Variant(VarType.EMPTY), "VT_EMPTY"),
        (Variant(VarType.NULL), "VT_NULL"),
        (Variant(VarType.BOOL, False), "false"),
        (Variant(VarType.BOOL | ARRAY, [True, False]), "true false"),
        (Variant(VarType.BSTR, " a,b "), " a,b "),
        (Variant(VarType.BSTR | ARRAY, ["I1", "I2"]), "I1\nI2"),
        (Variant(VarType.R4, 0.1), "0.1"),
        (Variant(VarType.UI1 | ARRAY, b"\x01\xff"), "1 255"),
        (Variant(VarType.VARIANT | ARRAY, [1, "a"]), "(3,1),(8,a)"),
        (Variant(VarType.I4 | ARRAY, []), ""),
    ],
)
def test_values_as_text(value, shown):
    assert text(value) == shown


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (b"\x01\xff", "01ff"),
        (datetime(2026, 11, 21, 10, 0, 0, 500000), "2026-11-21T10:00:00.500000"),
        (Decimal("1.5000"), "1.5000"),
        (math.nan, "NaN"),
        (math.inf, "Infinity"),
        (-math.inf, "-Infinity"),
        ([1, [None, True], (2.5,)], [1, [None, True], [2.5]]),
        (Variant(VarType.I2, 3), 3),
    ],
)
def test_values_as_json(value, expected):
    assert jsonable(value) == expected


def test_a_lone_surrogate_is_valid_in_json(run, url, rc8):
    with orinkit.connect(url) as controller:
        controller.variable("S1").value = "a\ud800"
    assert run("get", url, "S1", "--json").json["value"] == "a\ud800"
    assert run("get", url, "S1").code == 0


# --- info -------------------------------------------------------------------------------------------------------------


def test_info(run, url, rc8):
    rc8.raise_error(MOTOR_NOT_ON)
    done = run("info", url)
    assert done.code == 0
    lines = dict(line.split("  ", 1) for line in done.out.splitlines() if not line.startswith(" "))
    facts = {label.strip(): value.strip() for label, value in lines.items()}
    assert facts["controller"] == url
    assert facts["type"] == "RC8 Controller"
    assert facts["serial number"] == "SN-42"
    assert facts["mode"] == "3 automatic"
    assert facts["emergency stop"] == "released"
    assert facts["current errors"] == "0x81501003 The motor must be on"
    assert "I 100" in facts["variable counts"]
    assert "@MODE" in facts["variables"]


def test_info_as_json(run, url, rc8):
    rc8.raise_error(MOTOR_NOT_ON)
    facts = run("info", url, "--json").json
    assert facts["mode"] == 3
    assert facts["errors"] == [{"code": "0x81501003", "message": "The motor must be on"}]
    assert facts["variables"]["IO"] == 512
    assert "@MODE" in facts["names"]["variables"]
    assert datetime.fromisoformat(facts["time"])


class Silent(Provider):
    """A device with a controller object that implements no functions."""

    provider_names = ("Test.Silent",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        return ControllerObject(name)


def test_info_of_a_controller_without_functions(run):
    with orinkit.serve(Silent(), "tcp://127.0.0.1:0") as server:
        done = run("info", server.url, "--provider", "Test.Silent")
        facts = run("info", server.url, "--provider", "Test.Silent", "--json").json
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines()[0].split() == ["controller", server.url]
    assert "variable counts  -" in done.out
    assert facts["type"] is None
    assert facts["names"]["robots"] == []


def test_info_of_a_controller_with_invalid_replies(run, recorder_url):
    facts = run("info", recorder_url, "--provider", "Test.Recorder", "--json").json
    assert facts["errors"] is None


def test_info_in_japanese(run, url, rc8):
    i18n.use("ja")
    rc8.emergency_stop(True)
    rc8.set_mode(1)
    out = run("info", url).out
    assert "1 手動" in out
    assert "非常停止      ON" in out
    assert "エラー" in out
