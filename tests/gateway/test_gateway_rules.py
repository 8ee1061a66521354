"""Access rules: allowed and forbidden calls."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

import orinkit
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.cao.provider import (
    BlockingCall,
    ClientInfo,
    ControllerObject,
    Deferred,
    Provider,
    ResultWithCode,
    VariableObject,
)
from orinkit.core import hresult
from orinkit.core.errors import AccessDenied, CallError
from orinkit.gateway import AccessRules, RemoteProvider, RestrictedProvider
from orinkit.gateway.rules import READING
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.objects.controller_commands import COMMANDS
from orinkit.virtual.rc8.objects.extension import EXTENSION_COMMANDS
from orinkit.virtual.rc8.objects.robot_commands import ROBOT_COMMANDS
from orinkit.virtual.ve026a import VirtualVE026A, objects
from support.devices import Recorder, Workshop
from support.gateways import LISTEN

EMPTY = Variant(VarType.EMPTY)
REAL_CONTROLLERS = {
    "Controller": {"getautomode"},
    "Robot": {"curspeedmode", "getmotionpreparationstate"},
    "Task": {"getstatus", "getthreadpriority"},
}
SAMPLES = {VarType.I4: 1, VarType.R4: 1.0, VarType.BSTR: "x", VarType.VARIANT: EMPTY}


def allowed(rules: AccessRules, function: str, *arguments: Any) -> bool:
    entry = BY_NAME[function]
    given = arguments or [SAMPLES[argument.vt] for argument in entry.arguments if not argument.is_handle]
    try:
        rules.check(entry, given)
    except AccessDenied:
        return False
    return True


# --- reading ----------------------------------------------------------------------------------------------------------


def test_all_reading_commands_of_the_virtual_controllers_are_listed() -> None:
    tables = {
        "Controller": {name: not command.writes for name, command in COMMANDS.items()},
        "Robot": {name: command.reads for name, command in ROBOT_COMMANDS.items()},
        "Extension": {name: not command.writes for name, command in EXTENSION_COMMANDS.items()},
    }
    for interface, commands in READING.items():
        virtual = {name for name, reads in tables.get(interface, {}).items() if reads}
        assert commands == virtual | REAL_CONTROLLERS.get(interface, set()), interface
    for interface, table in tables.items():
        assert not READING[interface] & {name for name, reads in table.items() if not reads}


def test_no_documented_command_of_a_ve026a_only_reads() -> None:
    assert {"MOTOR", "SLVCHANGEMODE", "SLVMOVE", "SLVGETLATENESS"} == set(objects._ROBOT_COMMANDS)
    assert READING["Robot"] & {name.lower() for name in objects._ROBOT_COMMANDS} == {"slvgetlateness"}
    assert "clearerror" not in READING["Controller"]


def test_which_functions_read() -> None:
    rules = AccessRules(read_only=True)
    passed = {entry.name for entry in FUNCTIONS.values() if allowed(rules, entry.name)}
    releasing = {entry.name for entry in FUNCTIONS.values() if entry.releases}
    assert passed == {"Service_Start", "Service_Stop", "Controller_Connect"} | releasing | {
        entry.name for entry in FUNCTIONS.values() if "_Get" in entry.name
    }
    assert allowed(rules, "Command_GetState")
    for function in (
        "Command_Execute",
        "Variable_PutID",
        "Robot_PutTag",
        "File_Run",
        "Robot_Move",
        "Robot_Halt",
        "Task_Start",
    ):
        assert not allowed(rules, function)


@pytest.mark.parametrize(
    "option", ["@Create=1", " @create = True", "@CREATE", "x=(,@Create=1", "a,@Create=0x1", "@Create=no thing"]
)
def test_a_file_that_would_be_created(option: str) -> None:
    for function in ("Controller_GetFile", "File_GetFile"):
        assert not allowed(AccessRules(read_only=True), function, "a.txt", option)
        assert allowed(AccessRules(), function, "a.txt", option)


@pytest.mark.parametrize("option", ["", "@Create=0", "@Create=False", "x=1"])
def test_an_existing_file(option: str) -> None:
    assert allowed(AccessRules(read_only=True), "Controller_GetFile", "a.txt", option)


@pytest.mark.parametrize(
    ("function", "command", "reads"),
    [
        ("Robot_Execute", "CurPos", True),
        ("Robot_Execute", " CURPOS ", True),
        ("Robot_Execute", "TakeArm", False),
        ("Robot_Execute", "slvMove", False),
        ("Robot_Execute", "SysState", False),
        ("Robot_Execute", "", False),
        ("Robot_Execute", "CurPos\0", False),
        ("Robot_Execute", "x" * 1_000_000, False),
        ("Controller_Execute", "SysState", True),
        ("Controller_Execute", "ClearError", False),
        ("Extension_Execute", "CurPos", True),
        ("Extension_Execute", "Chuck", False),
        ("Task_Execute", "GetStatus", True),
        ("File_Execute", "GetStatus", False),
    ],
)
def test_which_commands_read(function: str, command: str, reads: bool) -> None:
    assert allowed(AccessRules(read_only=True), function, command, EMPTY) is reads


# --- lists ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("patterns", "function", "passes"),
    [
        (("Robot_*",), "Robot_Move", True),
        (("robot_MOVE",), "Robot_Move", True),
        (("Robot_Get*", "Variable_?etValue"), "Variable_GetValue", True),
        (("Robot_*",), "Variable_GetValue", False),
        (("Robot",), "Robot_Move", False),
        (("",), "Robot_Move", False),
        (("x",), "Service_Start", True),
        (("x",), "Controller_Connect", True),
        (("x",), "Controller_Disconnect", True),
        (("x",), "Robot_Release", True),
    ],
)
def test_lists_of_functions(patterns: tuple[str, ...], function: str, passes: bool) -> None:
    assert allowed(AccessRules(functions=patterns), function) is passes


@pytest.mark.parametrize(
    ("patterns", "name", "passes"),
    [
        (("I1?",), "I15", True),
        (("i1?",), " I15 ", True),
        (("I1?",), "I1", False),
        (("I1?",), "I*", False),
        (("I?",), "I*", False),
        (("I??",), "I*", False),
        (("I[0-9]*",), "I*", False),
        (("I[!0-4]*",), "I*", False),
        (("I??*",), "I*", False),
        (("I?[!0]*",), "I*", False),
        (("I[*]",), "I*", False),
        (("?*",), "I*", False),
        (("IO*",), "I*", False),
        (("I*",), "IO*", False),
        (("I*",), "I0*", False),
        (("i*",), " I* ", True),
        (("I*",), "I*", True),
        (("I[!1]*",), "I015", False),
        (("I[!1]*",), "I0005", True),
        (("I0*",), "I015", False),
        (("I0*",), "I000", True),
        (("IO15?",), "IO0150", True),
        (("IO[!1]*",), "IO0150", False),
        (("IOB[!1]*",), "IOB0150", False),
        (("I015",), "I15", True),
        (("Temp0?",), "Temp01", True),
        (("[!I]*",), "\u0131" + "5", False),
        (("[!I]*",), "\u0130" + "5", False),
        (("[!I]*",), "\uff29" + "5", False),
        (("[!S]*",), "\u017f" + "5", False),
        (("[!K]*",), "\u212a" + "5", False),
        (("I[!1]*",), "I\uff11" + "5", False),
        (("I*",), "\u0131*", False),
        (("I??*",), "I\uff0a", False),
        (("部品*",), "部品1", True),
        (("ﾜｰｸ?",), "ﾜｰｸ1", True),
        (("Stra\u00dfe",), "stra\u00dfe", True),
        (("[!a]*",), "\ufdfa" * 999, False),
        (("*",), "I*", True),
        (("I*", "@*"), "@MODE", True),
        (("I[12]",), "I2", True),
        (("I[12]",), "I3", False),
        (("IO150",), "io150", True),
        (("IO150",), "", False),
        (("",), "", True),
        (("*",), "x" * 100_000, False),
        (("*a*a*a*a*a*b",), "a" * 999, False),
        (("*",), "*" * 10_000_000, False),
    ],
)
def test_lists_of_variables(patterns: tuple[str, ...], name: str, passes: bool) -> None:
    for function in ("Controller_GetVariable", "Robot_GetVariable", "Task_GetVariable", "File_GetVariable"):
        assert allowed(AccessRules(variables=patterns), function, name, "") is passes
    assert allowed(AccessRules(variables=patterns), "Controller_GetFile", name[:10], "")


@pytest.mark.parametrize(
    ("patterns", "function", "command", "passes"),
    [
        (("Cur*",), "Robot_Execute", "CurPos", True),
        (("Cur*",), "Robot_Execute", "TakeArm", False),
        (("Cur*",), "Robot_Execute", "TakeArm.CurPos", False),
        (("Cur*",), "Controller_GetCommand", "CurPos", True),
        (("Cur*",), "Controller_GetCommand", "Robot.CurPos", True),
        (("Cur*",), "Controller_GetCommand", "Robot.TakeArm", False),
        (("Robot.*",), "Controller_GetCommand", "Robot.TakeArm", True),
        (("Robot.*",), "Controller_GetCommand", "Hand0.Chuck", False),
    ],
)
def test_lists_of_commands(patterns: tuple[str, ...], function: str, command: str, passes: bool) -> None:
    assert allowed(AccessRules(commands=patterns), function, command, "") is passes


def test_a_command_with_letters_like_ascii_ones() -> None:
    rules = AccessRules(commands=("[!K]*",))
    assert allowed(rules, "Robot_Execute", "Motor", EMPTY)
    assert not allowed(rules, "Robot_Execute", "\u212aill", EMPTY)


LISTED = AccessRules(variables=("S*", "P1", "IO1[0-9]", "F[!5]*"))


@pytest.mark.parametrize(
    ("given", "passes"),
    [
        ("P1", True),
        ("P01", True),
        ("P5", False),
        (" p 5", False),
        ("P[ 5 ]", False),
        ("P[I1]", False),
        ("@P P1", True),
        ("@PP1", True),
        ("@PP5", False),
        ("@E5", True),
        ("@1e1P5", False),
        ("@ P 10", True),
        ("@0 (1,10),(2,20)", True),
        ("P1, @E P5", False),
        ("P1 EX((7, 10))", True),
        ("\uff30\uff15", False),
        ("P(1, 2, 3, 0, 0, 0, 5)", True),
        ("IO15", True),
        ("IO150", False),
        ("IOB15", False),
        ("SPEED=F2", True),
        ("SPEED=F5", False),
        ("SPEED=50, NEXT", True),
        ("Tool5, 0xF5, 1D5", True),
        (["P1", "P5"], False),
        ([1, ["P1", 0], [[["J5"]]]], False),
        ([1, ["P1", 0], [[["S5"]]]], True),
        (Variant(VarType.BSTR | ARRAY, ["S1", "T5"]), False),
        ("P " * 500_000 + " " * 500_000, True),
        ("P" + "0" * 1_000_000 + "5", False),
        ([1.0, 2.0], True),
        (None, True),
    ],
)
def test_variables_in_parameters(given: Any, passes: bool) -> None:
    parameter = variant(given)
    for function in ("Robot_Execute", "Controller_Execute", "Task_Execute", "File_Execute", "Extension_Execute"):
        assert allowed(LISTED, function, "P2T", parameter) is passes
        assert allowed(AccessRules(), function, "P2T", parameter)
    assert allowed(LISTED, "Command_PutParameters", parameter) is passes
    assert allowed(LISTED, "Robot_Move", 1, parameter, "") is passes
    assert allowed(LISTED, "Robot_Rotate", parameter, 1.0, EMPTY, "") is passes
    assert allowed(LISTED, "Robot_Rotate", EMPTY, 1.0, parameter, "") is passes
    if isinstance(given, str):
        assert allowed(LISTED, "Robot_Drive", 1, 1.0, given) is passes
        assert allowed(LISTED, "Robot_Move", 1, EMPTY, given) is passes


@pytest.mark.parametrize(
    ("given", "passes"),
    [
        ([5, "P"], False),
        ([1, "P"], True),
        ([1, "J"], False),
        ([5.0, "P"], False),
        (Variant(VarType.UI1 | ARRAY, b"\x05\x00"), False),
        (Variant(VarType.UI1 | ARRAY, b"\x01\x00"), True),
        ([5, 0, -1], False),
        (Variant(VarType.I4 | ARRAY, [5, 0, -1]), False),
        (Variant(VarType.I4 | ARRAY, [1, 0, -1]), True),
        ([[5, "P"], 0, 0], False),
        ([1, [5, "P"], 10.0], False),
        ([1, [1, "P"], 10.0], True),
        ([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 5.0], "P", "@E"], True),
        ([float(number) for number in range(7)], True),
    ],
)
def test_variables_in_arrays(given: Any, passes: bool) -> None:
    parameter = variant(given)
    for command in ("P2T", " outrange ", "Approach", "Dev", "AddPathPoint"):
        assert allowed(LISTED, "Robot_Execute", command, parameter) is passes
    assert allowed(LISTED, "Robot_Execute", "Motor", parameter)
    assert allowed(LISTED, "Command_PutParameters", parameter) is passes
    assert allowed(LISTED, "Robot_Move", 1, parameter, "") is passes
    assert allowed(LISTED, "Robot_Rotate", parameter, 1.0, EMPTY, "") is passes


def test_numbers_of_other_commands_are_not_variables() -> None:
    assert allowed(LISTED, "Robot_Execute", "Motor", variant([0, 0]))
    assert not allowed(LISTED, "Robot_Execute", "addpathpo\u0131nt", variant([0, 0]))


def test_a_command_object_is_executed_once_it_is_allowed() -> None:
    assert allowed(AccessRules(commands=("x",)), "Command_Execute", 0)


def test_rules_add_up() -> None:
    rules = AccessRules(read_only=True, functions=("Robot_*",), commands=("*",))
    assert allowed(rules, "Robot_Execute", "CurPos", EMPTY)
    assert not allowed(rules, "Robot_Execute", "TakeArm", EMPTY)
    assert not allowed(rules, "Controller_Execute", "SysState", EMPTY)


@pytest.mark.parametrize("wrong", [{"functions": "Robot_*"}, {"variables": "I1"}, {"commands": [1]}])
def test_invalid_lists(wrong: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=next(iter(wrong))):
        AccessRules(**wrong)


# --- restricted providers ---------------------------------------------------------------------------------------------


def test_a_gateway_that_only_reads() -> None:
    device = VirtualRC8(motor=True)
    with orinkit.serve(device, LISTEN) as server:
        provider = RestrictedProvider(RemoteProvider(server.url), AccessRules(read_only=True))
        with orinkit.serve(provider, LISTEN) as gate, orinkit.connect(gate.url) as rc8:
            robot = rc8.robot()
            assert len(robot.execute("CurJnt")) == 8
            assert rc8.variable("I1").value == 0
            assert rc8.execute("SysState")
            for refused in (
                lambda: rc8.variable("I1").put_value(1),
                lambda: robot.execute("TakeArm"),
                lambda: robot.execute("Motor", [0, 0]),
                lambda: rc8.execute("ClearError"),
                lambda: rc8.command("Robot.Motor").execute(0),
                lambda: rc8.file("a.txt", create=True),
                lambda: robot.move(1, "P1"),
            ):
                with pytest.raises(AccessDenied):
                    refused()
            assert device.state.arm.holder is None


def test_variables_that_are_not_listed_stay_unread() -> None:
    with orinkit.serve(VirtualRC8(motor=True), LISTEN) as server:
        provider = RestrictedProvider(RemoteProvider(server.url), AccessRules(read_only=True, variables=("S*", "P1")))
        with orinkit.serve(provider, LISTEN) as gate, orinkit.connect(gate.url) as rc8:
            robot = rc8.robot()
            here = robot.execute("CurPos")
            assert robot.execute("P2J", here)
            assert robot.execute("OutRange", "P1") is not None
            zero = "P(0, 0, 0, 0, 0, 0, 0)"
            refused: list[tuple[str, Any]] = [
                ("P2T", "P5"),
                ("P2J", [5, "P"]),
                ("J2P", "J5"),
                ("T2P", "T5"),
                ("Dev", ["P5", zero]),
                ("Dev", f"P5, {zero}"),
                ("OutRange", [[5, "P"], 0, 0]),
            ]
            for command, parameter in refused:
                with pytest.raises(AccessDenied):
                    robot.execute(command, parameter)


def test_around_any_provider() -> None:
    recorder = Recorder()
    provider = RestrictedProvider(recorder, AccessRules(variables=("v*",)))
    with orinkit.serve(provider, LISTEN) as server, orinkit.connect(server.url, provider="Test.Recorder") as rc8:
        assert rc8.robot().variable("v1").value
        with pytest.raises(AccessDenied):
            rc8.robot().variable("w1")
    assert not any("w1" in str(call) for call in recorder.calls)
    assert recorder.calls[-1].function == "Controller_Disconnect"


def test_a_restricted_ve026a_keeps_its_dialect() -> None:
    with (
        orinkit.serve(RestrictedProvider(VirtualVE026A(), AccessRules(read_only=True)), LISTEN) as server,
        orinkit.connect(server.url, provider="") as controller,
    ):
        assert controller.handle == 1
        robot = controller.robot()
        assert len(robot.variable("@CURRENT_ANGLE").value) == 8
        with pytest.raises(AccessDenied):
            robot.execute("Motor", Variant(VarType.I2, 1))


class Slow(ControllerObject):
    """A controller that returns its variables immediately, deferred, awaitable or from a thread."""

    def get_variable(self, name: str, option: str) -> Any:
        made = VariableObject(name)
        if name == "coded":
            return ResultWithCode(hresult.S_FALSE, made)
        if name == "blocking":
            return BlockingCall(lambda: made)
        if name == "soon":
            return self._soon(made)
        deferred = Deferred[Any]()
        if name == "fails":
            deferred.set_exception(CallError(0x80040201))
        elif name == "later":
            asyncio.get_running_loop().call_later(0.01, deferred.set_result, made)
        else:
            deferred.set_result(made)
        return deferred

    async def _soon(self, made: VariableObject) -> VariableObject:
        await asyncio.sleep(0)
        return made

    def get_extension(self, name: str, option: str) -> Any:
        return "no object"


class SlowProvider(Provider):
    provider_names = ("*",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        return Slow()


def test_deferred_objects_are_restricted(caplog: pytest.LogCaptureFixture) -> None:
    provider = RestrictedProvider(
        SlowProvider(), AccessRules(functions=("*_GetVariable", "*_GetName", "*_GetExtension"))
    )
    with orinkit.serve(provider, LISTEN) as server, orinkit.connect(server.url) as rc8:
        for name in ("coded", "blocking", "soon", "later", "done"):
            variable = rc8.variable(name)
            assert variable.name == name
            with pytest.raises(AccessDenied):
                variable.get_value()
        with pytest.raises(CallError) as failed:
            rc8.variable("fails")
        assert failed.value.code == 0x80040201
        with pytest.raises(CallError) as failed:
            rc8.extension("x")
        assert failed.value.code == hresult.E_FAIL
    caplog.clear()  # a device that returns no object logs an error


def test_calls_in_threads_and_awaitables() -> None:
    shop = Workshop()
    with (
        orinkit.serve(RestrictedProvider(shop, AccessRules(commands=("B*", "Wait"))), LISTEN) as server,
        orinkit.connect(server.url, provider="Test.Workshop") as client,
    ):
        shop.gate.set()
        assert client.execute("Block", 1) == 1
        assert client.execute("Wait", 2) == 2
        with pytest.raises(AccessDenied):
            client.execute("Echo", 3)
    assert shop.closed == 1
