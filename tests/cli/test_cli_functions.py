"""functions: the table as a list, as details of one function, and as JSON."""

from __future__ import annotations

import pytest

from orinkit.cao.functions import FUNCTIONS
from orinkit.cli._shared.signature import signature
from orinkit.core import i18n


def test_the_list_has_every_function(run):
    lines = run("functions").out.splitlines()
    assert [int(line.split()[0]) for line in lines] == list(range(1, 138))
    assert lines[8].split(maxsplit=2) == ["9", "Controller_GetVariable", FUNCTIONS[9].en]


@pytest.mark.parametrize("text", ["slave mode of nothing", "Zzz"])
def test_nothing_found(refused, text):
    assert refused("functions", text) == f"no function contains {text!r}"


@pytest.mark.parametrize(("text", "name"), [("halt", "Robot_Halt"), ("get_mess", "Controller_GetMessage"), ("home pose", "Robot_GoHome"), ("変数の値", "Variable_GetValue")])  # fmt: skip
def test_a_filter_searches_names_and_texts(run, text, name):
    assert name in run("functions", text).out
    assert "Service_Start" not in run("functions", text).out


@pytest.mark.parametrize("text", ["72", "Robot_Move", "robot_move"])
def test_one_function_is_shown_in_detail(run, text):
    lines = run("functions", text).out.splitlines()
    assert lines[0] == 'Robot_Move(handle, interpolation: VT_I4, pose: VARIANT, option: VT_BSTR = "")'
    assert lines[3:] == [
        "id       72",
        "Python   orinkit.functions.robot_move",
        "CAO      CCaoRobot::Move",
        "section  RC8 3.3.4",
    ]


def test_the_details_show_the_function_that_releases_a_handle(run):
    out = run("functions", "Controller_GetRobot").out
    assert "-> Robot handle" in out
    assert "handle released by  Robot_Release" in out


def test_json_contains_all_details(run):
    table = run("functions", "--json").json
    assert [entry["id"] for entry in table] == list(range(1, 138))
    assert table[71]["arguments"][3] == {
        "name": "option", "type": "VT_BSTR", "handle": False, "optional": True, "default": "",
    }  # fmt: skip
    assert table[6]["released_by"] == "Robot_Release"
    assert [entry["name"] for entry in run("functions", "72", "--json").json] == ["Robot_Move"]


def test_in_japanese(run):
    i18n.use("ja")
    assert FUNCTIONS[1].ja in run("functions").out
    assert "仕様書" in run("functions", "1").out


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (1, "Service_Start([option: VT_BSTR])"),
        (2, "Service_Stop()"),
        (17, "Controller_Execute(handle, command: VT_BSTR, parameter: VARIANT = VT_EMPTY) -> VARIANT"),
        (101, "Variable_GetValue(handle) -> VARIANT"),
    ],
)
def test_signatures(number, text):
    assert signature(FUNCTIONS[number]) == text
