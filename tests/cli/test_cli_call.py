"""call: every function of the table, on its object."""

from __future__ import annotations

import pytest

from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Argument
from orinkit.core import i18n
from orinkit.core.hresult import MOTOR_NOT_ON
from orinkit.values.variant import VarType

OBJECTS = {
    "Variable": ["--variable", "I1"],
    "Command": ["--command", "Do"],
    "Robot": ["--robot", "Arm"],
    "Task": ["--task", "Pro1"],
    "Extension": ["--extension", "Hand0"],
    "File": ["--file", "a.pcs"],
}
PATHS = {
    "Variable": "/I1", "Command": "/Do", "Robot": "/Arm", "Task": "/Pro1", "Extension": "/Hand0", "File": "/a.pcs",
    "Message": "/message", "Controller": "",
}  # fmt: skip
WORDS = {VarType.I4: ("7", 7), VarType.R4: ("2.5", 2.5), VarType.BSTR: ("text", "text"), VarType.VARIANT: ("2,9", 9)}
REACHED = [entry for entry in FUNCTIONS.values() if entry.interface != "Service" and entry.name != "Controller_Connect"]


@pytest.fixture
def call(run, recorder_url):
    return lambda *argv: run("call", recorder_url, *argv, "--provider", "Test.Recorder")


@pytest.mark.parametrize("entry", REACHED, ids=lambda entry: entry.name)
def test_every_function_reaches_its_object(call, recorder, entry):
    recorder.calls.clear()
    words = [WORDS[argument.vt] for argument in entry.arguments[1:]]
    done = call(entry.name, *[word for word, _ in words], *OBJECTS.get(entry.interface, []), "--json")
    assert (done.code, done.err) == (0, "")
    made = [made for made in recorder.calls if made.function == entry.name]
    assert made[0].path.endswith(PATHS[entry.interface])
    assert made[0].arguments == tuple(value for _, value in words)
    output = done.json
    assert (output["function"], output["id"], output["code_name"]) == (entry.name, entry.id, "S_OK")
    assert (output["result"] is None) == (entry.result is None)
    assert output["arguments"][1:] == [value for _, value in words]


@pytest.mark.parametrize("name", ["17", "Controller_Execute", "controller_execute", "CONTROLLER_EXECUTE"])
def test_a_function_by_id_name_or_python_name(run, url, name):
    assert run("call", url, name, "GetCurErrorCount") == (0, "0\n", "")


def test_a_call_without_a_result_shows_the_return_code(call):
    assert call("Variable_PutValue", "5", "--variable", "I1").out == "S_OK\n"


def test_a_list_of_names_has_one_line_each(run, url):
    assert "@MODE\n" in run("call", url, "Controller_GetVariableNames").out


@pytest.mark.parametrize("code", ["0x81501003", "-2125459453"])
def test_a_return_code_may_be_written_in_hex(run, url, code):
    assert run("call", url, "Controller_Execute", "GetErrorDescription", code).out == "The motor must be on\n"


def test_a_text_argument_is_passed_unchanged(call, recorder):
    for word, sent in (("100", "100"), ("8,100", "100"), ("2,5", "2,5"), ("8197,x", "8197,x"), ("true", "true")):
        recorder.calls.clear()
        assert call("Robot_Halt", word, "--robot", "Arm").code == 0
        assert recorder.calls[2].arguments == (sent,)


def test_a_robot_must_be_named_to_move_it(call, recorder, refused, url):
    recorder.calls.clear()
    refused("call", url, "Robot_Move", "1", "@E P1", code=2)
    assert "Robot_Move" not in [call.function for call in recorder.calls]
    recorder.calls.clear()
    call("Robot_Move", "1", "@E P1", "--robot", "Arm")
    assert recorder.calls[1].arguments == ("Arm", "")
    assert recorder.calls[2].arguments == (1, "@E P1", "")


def test_a_variable_of_a_robot(call, recorder):
    recorder.calls.clear()
    call("Variable_GetValue", "--robot", "Arm", "--variable", "@CURRENT_ANGLE")
    assert [made.function for made in recorder.calls[:3]] == [
        "Controller_Connect", "Controller_GetRobot", "Robot_GetVariable",
    ]  # fmt: skip


def test_no_message_is_pending(refused, url):
    assert refused("call", url, "Message_GetNumber") == "the controller has no message"


def test_services_and_connecting(run, url):
    assert run("call", url, "Service_Start").out == "S_OK\n"
    assert run("call", url, "Service_Start", "WDT=500").out == "S_OK\n"
    assert run("call", url, "Service_Stop").out == "S_OK\n"
    assert int(run("call", url, "Controller_Connect").out) > 0
    assert int(run("call", url, "Controller_Connect", "c", "CaoProv.DENSO.VRC", "localhost").out) > 0


def test_a_function_that_releases_its_own_object(run, url):
    assert run("call", url, "Controller_Disconnect") == (0, "S_OK\n", "")
    assert run("call", url, "Variable_Release", "--variable", "I1") == (0, "S_OK\n", "")


def test_a_given_handle(refused, url):
    assert "Controller_GetName(99): 0x80070006 E_HANDLE" in refused("call", url, "Controller_GetName", "--handle", "99")


@pytest.mark.parametrize(
    ("argv", "output"),
    [
        (["Robot_Moove"], "unknown function 'Robot_Moove'; did you mean Robot_Move"),
        (["138"], "unknown function '138'"),
        (["Variable_GetValue"], "Variable_GetValue requires a variable. Try: --variable NAME"),
        (["Task_Start"], "0 arguments given, 1-2 expected for Task_Start(handle, mode: VT_I4, option"),
        (["Task_Start", "1"], "Task_Start requires a task. Try: --task NAME"),
        (["Extension_GetName"], "Try: --extension NAME"),
        (["File_GetName"], "Try: --file NAME"),
        (["Command_GetName"], "Try: --command NAME"),
        (["Controller_GetName", "1"], "1 arguments given, 0 expected for Controller_GetName(handle)"),
        (["Robot_Move", "fast", "P1"], "'fast' is not a valid number for the argument interpolation (VT_I4)"),
        (["Robot_Move", "1.5", "P1"], "'1.5' is not a valid number for the argument interpolation (VT_I4)"),
        (["Robot_Speed", "1", "true"], "'true' is not a valid number for the argument speed (VT_R4)"),
        (["Robot_Move", "1", "8197,x"], "column 6: expected a number"),
    ],
)
def test_an_invalid_call(refused, url, argv, output):
    assert output in refused("call", url, *argv, code=2)


def test_in_japanese(refused, url):
    i18n.use("ja")
    assert (
        refused("call", url, "Variable_GetValue", code=2)
        == "Variable_GetValue には variable が必要です。対処: --variable 名前"
    )
    assert "ハンドルは自動で補われます" in refused("call", url, "Controller_GetName", "1", code=2)


def test_every_argument_type_of_the_table_can_be_given():
    assert {argument.vt for entry in REACHED for argument in entry.arguments[1:]} <= set(WORDS)
    assert isinstance(FUNCTIONS[1].arguments[0], Argument)


def test_the_current_error_can_be_read(run, url, rc8):
    rc8.raise_error(MOTOR_NOT_ON)
    info = run("call", url, "17", "GetCurErrorInfo", "0", "--json").json["result"]
    assert info["type"] == "VT_VARIANT|VT_ARRAY"
    assert info["value"][:2] == [-2125459453, "The motor must be on"]
