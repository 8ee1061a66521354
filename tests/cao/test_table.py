"""The function table: complete, spelled as in the documents, and used by everything built on it."""

# No "from __future__ import annotations" here: entries are read from annotations.
import ast
import doctest
import inspect
import json
import re
from pathlib import Path
from typing import Annotated, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao import functions, provider, table
from orinkit.cao.functions import BY_NAME, FUNCTIONS, find
from orinkit.cao.table import Argument, Function, snake_case
from orinkit.client._async import controller, file, motion, objects, robot, task
from orinkit.core import i18n
from orinkit.rc8.task_modes import StopMode, StopName, TaskMode, TaskName, TaskStatus
from orinkit.values.variant import VarType
from support.paths import VECTORS

pytestmark = pytest.mark.core

SPEC = json.loads((VECTORS / "functions.json").read_text())
ENTRIES = list(FUNCTIONS.values())
BY_ENTRY = pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
JAPANESE = re.compile("[぀-ヿ一-鿿]")


def python_name(entry: Function) -> str:
    """Return the Python name: ``Controller_GetID`` is ``controller_get_id``."""
    interface, _, method = entry.name.partition("_")
    return f"{interface.lower()}_{re.sub('(?<=[a-z])(?=[A-Z])', '_', method).lower()}"


# --- against the documents --------------------------------------------------------------------------------------------


def test_ids_names_and_cao_names_are_those_of_the_documents():
    """RC8 appendix A; e-CAP 3.3 has the same ids and names."""
    assert [row["id"] for row in SPEC] == list(range(1, 138))
    assert [{"id": entry.id, "name": entry.name, "cao": entry.cao} for entry in ENTRIES] == SPEC


def test_keys_and_entries_agree():
    assert list(FUNCTIONS) == list(range(1, 138))
    assert all(entry.id == number for number, entry in FUNCTIONS.items())
    assert dict(BY_NAME) == {entry.name: entry for entry in ENTRIES}
    assert len(BY_NAME) == 137


def test_the_table_cannot_be_changed_by_accident():
    with pytest.raises(TypeError):
        FUNCTIONS[138] = FUNCTIONS[1]
    with pytest.raises(AttributeError):
        FUNCTIONS[1].name = "x"


@BY_ENTRY
def test_names_follow_the_rule(entry):
    assert getattr(functions, python_name(entry)) is entry
    interface, _, method = entry.name.partition("_")
    assert entry.interface == interface
    assert interface in table.INTERFACES
    assert python_name(entry) == f"{interface.lower()}_{entry.method}"
    assert snake_case(method) == entry.method


@BY_ENTRY
def test_section_and_texts(entry):
    assert re.fullmatch(r"RC8 (A|\d\.\d\.\d)|VE026A \d\.\d\.\d|e-CAP \d\.\d", entry.section)
    assert re.fullmatch(r"[A-Z].*\.", entry.en)
    assert "\n" not in entry.en + entry.ja
    assert not JAPANESE.search(entry.en)
    assert JAPANESE.search(entry.ja)
    assert entry.ja.endswith("。")
    assert entry.text == entry.en
    i18n.use("ja")
    assert entry.text == entry.ja


def test_the_texts_of_functions_differ():
    assert len({entry.en for entry in ENTRIES}) == 137
    assert len({entry.ja for entry in ENTRIES}) == 137


# --- arguments and results --------------------------------------------------------------------------------------------


@BY_ENTRY
def test_arguments(entry):
    without_handle = {"Service_Start", "Service_Stop", "Controller_Connect"}
    handles = [argument.is_handle for argument in entry.arguments]
    assert handles == ([] if entry.name in without_handle else [True]) + [False] * (
        len(handles) - (entry.name not in without_handle)
    )
    optional = [argument.optional for argument in entry.arguments]
    assert optional == sorted(optional), "an optional argument is followed by a required one"
    assert entry.required == optional.count(False)
    assert len({argument.name for argument in entry.arguments}) == len(entry.arguments)
    for argument in entry.arguments:
        assert argument.vt in (VarType.I4, VarType.R4, VarType.BSTR, VarType.VARIANT)
        assert argument.name.isidentifier()
        if argument.is_handle:
            assert (argument.name, argument.vt, argument.optional) == ("handle", VarType.I4, False)
    if entry.name.endswith("_Execute") and entry.interface != "Command":
        assert [argument.name for argument in entry.arguments] == ["handle", "command", "parameter"]


@BY_ENTRY
def test_results(entry):
    verb = entry.name.partition("_")[2]
    if verb.startswith(("Put", "Release", "Disconnect", "Start", "Stop", "Move", "Delete", "Copy")):
        assert entry.result is None
    elif verb.startswith("Get") or verb == "Execute":
        assert entry.result is not None or entry.name == "Command_Execute"
    assert entry.result in (None, VarType.I4, VarType.BSTR, VarType.VARIANT)


def test_only_the_service_option_is_omitted_from_the_packet():
    unsent = [
        (entry.name, argument.name) for entry in ENTRIES for argument in entry.arguments if argument.omitted_by_default
    ]
    assert unsent == [("Service_Start", "option")]


@BY_ENTRY
def test_created_objects_can_be_released(entry):
    creates = bool(re.search(r"_Get(Extension|File|Robot|Task|Variable|Command|Message)$|_Connect$", entry.name))
    assert bool(entry.creates) == bool(entry.released_by) == creates
    if creates:
        release = BY_NAME[entry.released_by]
        assert release.releases
        assert release.interface == entry.creates
        assert entry.result is VarType.I4
        kind = entry.name.partition("_Get")[2] or "Controller"
        assert entry.creates == kind


@BY_ENTRY
def test_releasing_functions(entry):
    assert entry.releases == (entry.name == "Controller_Disconnect" or entry.name.endswith("_Release"))
    if entry.releases:
        assert [argument.name for argument in entry.arguments] == ["handle"]
        assert entry.result is None
        assert any(other.released_by == entry.name for other in ENTRIES)


def test_every_interface_has_the_common_functions():
    common = ["GetAttribute", "GetHelp", "GetName", "GetTag", "PutTag", "GetID", "PutID"]
    for interface in table.INTERFACES[1:]:
        names = {entry.name.partition("_")[2] for entry in ENTRIES if entry.interface == interface}
        assert names.issuperset(common) == (interface != "Message")


# --- users of the table -----------------------------------------------------------------------------------------------


@BY_ENTRY
def test_the_provider_has_a_method(entry):
    if entry.interface == "Service":
        return  # handled by the session, not by a device
    if entry.name == "Controller_Connect":
        assert list(inspect.signature(provider.Provider.connect).parameters)[1:] == [
            "name",
            "machine",
            "option",
            "client",
        ]
        return
    served = getattr(provider, f"{entry.interface}Object")
    method = getattr(served, "release" if entry.releases else entry.method)
    parameters = list(inspect.signature(method).parameters)[1:]
    assert parameters == [argument.name for argument in entry.arguments[1:]]
    assert method.__doc__


def test_the_provider_has_no_other_methods():
    by_interface: dict[str, set[str]] = {}
    for entry in ENTRIES:
        by_interface.setdefault(entry.interface, set()).add("release" if entry.releases else entry.method)
    for interface in table.INTERFACES[1:]:
        served = getattr(provider, f"{interface}Object")
        public = {name for name, _ in inspect.getmembers(served, inspect.isfunction) if not name.startswith("_")}
        allowed = by_interface[interface] - {"connect"}
        inherited = {name for name, _ in inspect.getmembers(provider.CaoObject, inspect.isfunction)}
        of_the_server = {"is_moving", "stop_moving", "connection_lost"} if interface == "Controller" else set()
        assert allowed <= public
        assert public - allowed <= inherited | of_the_server


def test_the_client_uses_every_entry():
    modules = (controller, file, motion, objects, robot, task)
    trees = [ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")) for module in modules]
    used = {
        node.attr
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "f"
    }
    assert {python_name(entry) for entry in ENTRIES} == used


def test_the_examples_in_the_docstring():
    assert doctest.testmod(functions) == (0, 1)


# --- bind -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "arguments", "named", "bound"),
    [
        (functions.robot_move, (3, 1, "P1", "NEXT"), {}, (3, 1, "P1", "NEXT")),
        (functions.robot_move, (3, 1, "P1"), {}, (3, 1, "P1", "")),
        (functions.robot_move, (3,), {"pose": "P1", "interpolation": 2}, (3, 2, "P1", "")),
        (functions.robot_move, (), {"handle": 3, "pose": None, "interpolation": 2, "option": "x"}, (3, 2, None, "x")),
        (functions.robot_execute, (3, "CurPos"), {}, (3, "CurPos", None)),
        (functions.robot_execute, (3, "CurPos", None), {}, (3, "CurPos", None)),
        (functions.variable_put_value, (3, None), {}, (3, None)),
        (functions.command_execute, (3,), {}, (3, 0)),
        (functions.service_stop, (), {}, ()),
        (functions.service_start, (), {}, ()),
        (functions.service_start, (None,), {}, ()),
        (functions.service_start, (), {"option": None}, ()),
        (functions.service_start, ("",), {}, ("",)),
        (functions.service_start, ("WDT=400",), {}, ("WDT=400",)),
        (functions.service_start, (), {"option": "WDT=400"}, ("WDT=400",)),
    ],
)
def test_bind(entry, arguments, named, bound):
    assert entry.bind(arguments, named) == bound


@pytest.mark.parametrize(
    ("entry", "arguments", "named", "english", "japanese"),
    [
        (functions.robot_move, (3, 1), {}, "Robot_Move requires the argument 'pose'", "引数 'pose' が必要です"),
        (functions.robot_move, (), {}, "Robot_Move requires the argument 'handle'", "引数 'handle' が必要です"),
        (functions.robot_move, (1, 2, 3, 4, 5), {}, "Robot_Move takes 4 arguments, got 5", "4 個ですが 5 個"),
        (functions.service_stop, (1,), {}, "Service_Stop takes 0 arguments, got 1", "0 個ですが 1 個"),
        (
            functions.robot_halt,
            (3,),
            {"speed": 1},
            "Robot_Halt got an unknown or repeated argument 'speed'",
            "引数 'speed' は存在しない",
        ),
        (
            functions.robot_halt,
            (3, ""),
            {"option": ""},
            "Robot_Halt got an unknown or repeated argument 'option'",
            "二重に指定",
        ),
        (
            functions.service_start,
            (),
            {"option": None, "x": 1},
            "Service_Start got an unknown or repeated argument 'x'",
            "引数 'x' は存在しない",
        ),
    ],
)
def test_bind_refuses(entry, arguments, named, english, japanese):
    with pytest.raises(TypeError, match=english):
        entry.bind(arguments, named)
    i18n.use("ja")
    with pytest.raises(TypeError, match=japanese):
        entry.bind(arguments, named)


@given(st.sampled_from(ENTRIES), st.data())
def test_positional_and_named_arguments_are_equivalent(entry, data):
    values = [object() for _ in entry.arguments]
    given = data.draw(st.integers(0, len(values)))
    named = {argument.name: value for argument, value in zip(entry.arguments[given:], values[given:], strict=True)}
    assert entry.bind(tuple(values[:given]), named) == tuple(values)


def test_the_position_of_an_argument_in_errors():
    assert functions.robot_move.where(1) == "Robot_Move, argument 1 (handle): "
    assert functions.robot_move.where(3) == "Robot_Move, argument 3 (pose): "
    i18n.use("ja")
    assert functions.robot_move.where(4) == "Robot_Move の第 4 引数 (option): "


# --- find -------------------------------------------------------------------------------------------------------------


@BY_ENTRY
def test_find_by_id_and_by_either_spelling(entry):
    for name in (
        entry.id,
        str(entry.id),
        entry.name,
        entry.name.upper(),
        python_name(entry),
        python_name(entry).upper(),
    ):
        assert find(name) is entry


def test_find_names_the_nearest():
    with pytest.raises(KeyError, match=r"unknown function 'Robot_Mov'; did you mean Robot_Move"):
        find("Robot_Mov")
    for nothing in (0, 138, "138", "", "xyzzyqqq", -1):
        with pytest.raises(KeyError, match="ids are 1 to 137"):
            find(nothing)
    i18n.use("ja")
    with pytest.raises(KeyError, match=r"候補: Robot_Move"):
        find("Robot_Mov")
    with pytest.raises(KeyError, match=r"1～137"):
        find(138)


# --- reading of signatures --------------------------------------------------------------------------------------------


def test_an_entry_is_read_from_its_signature(monkeypatch):
    monkeypatch.setattr(table, "ENTRIES", {})

    @table.function(200, "Thing_GetURLName", "CThing::URL", "here", en="Thing.", ja="物。")
    def thing(
        handle: table.Handle, size: table.R4, text: table.Bstr = "x", more: table.Bstr | None = None
    ) -> table.I4: ...

    assert list(table.ENTRIES.items()) == [(200, thing)]
    assert thing.arguments == (
        Argument("handle", VarType.I4, is_handle=True),
        Argument("size", VarType.R4),
        Argument("text", VarType.BSTR, optional=True, default="x"),
        Argument("more", VarType.BSTR, optional=True, default=None),
    )
    assert [argument.omitted_by_default for argument in thing.arguments] == [False, False, False, True]
    assert (thing.result, thing.required, thing.creates, thing.releases) == (VarType.I4, 2, "", False)


@pytest.mark.parametrize("hint", [int, Annotated[int, "no type"], int | None])
def test_an_annotation_without_a_type_is_refused(hint):
    def thing(handle) -> None: ...

    thing.__annotations__ = {"handle": hint, "return": None}
    with pytest.raises(TypeError, match="is not an argument type of the table"):
        table.function(201, "Thing_X", "", "here", en="", ja="")(thing)
    assert 201 not in FUNCTIONS


def test_the_names_of_task_modes_and_status():
    """Functions from :mod:`orinkit.rc8.task_modes`."""
    assert [str(mode) for mode in (*TaskMode, *TaskStatus)][:6] == [
        "cycle",
        "continuous",
        "step",
        "step_back",
        "non_existent",
        "suspended",
    ]
    assert (f"{StopMode.INITIALIZE}", int(StopMode.INITIALIZE)) == ("initialize", 4)
    assert (get_args(TaskName), get_args(StopName)) == (tuple(map(str, TaskMode)), tuple(map(str, StopMode)))
