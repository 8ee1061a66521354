"""The session of one client: handles, dispatch of all functions, error codes, and release of objects."""

from __future__ import annotations

import logging
from datetime import datetime
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao import provider as p
from orinkit.cao import session as session_module
from orinkit.cao.arguments import read_arguments
from orinkit.cao.dialect import VE026A
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import (
    BlockingCall,
    ClientInfo,
    ControllerObject,
    FileObject,
    Provider,
    ResultWithCode,
    VariableObject,
)
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, error_for
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.strategies import same, variants

pytestmark = pytest.mark.core

PROVIDER = "CaoProv.Test"


class Memory(VariableObject):
    """A variable; its release is recorded in ``log``."""

    def __init__(self, name: str, log: list[str]) -> None:
        super().__init__(name, attribute=3, help="a variable")
        self.log = log
        self.value = Variant(VarType.I4, 0)

    def get_value(self):
        return self.value

    def put_value(self, value):
        self.value = value

    def release(self):
        self.log.append(self.name)


class Folder(FileObject):
    def __init__(self, name: str, log: list[str]) -> None:
        super().__init__(name)
        self.log = log

    def get_file(self, name, option):
        return Folder(name, self.log)

    def get_variable(self, name, option):
        return Memory(name, self.log)

    def release(self):
        self.log.append(self.name)


class Trouble(Exception):
    def __str__(self) -> str:
        raise ArithmeticError("not even a text")


class Controller(ControllerObject):
    def __init__(self, name: str, log: list[str], option: str = "") -> None:
        super().__init__(name)
        self.log = log
        self.option = option

    def get_variable(self, name, option):
        if name == "nothing":
            raise p.not_found(name)
        return Memory(name, self.log)

    def get_file(self, name, option):
        return Folder(name, self.log)

    def get_robot(self, name, option):
        return p.RobotObject(name)

    def get_task(self, name, option):
        async def later():
            return p.TaskObject(name)

        return later()

    def get_extension(self, name, option):
        return BlockingCall(lambda: p.ExtensionObject(name))

    def get_command(self, name, option):
        return ResultWithCode(hresult.S_FALSE, p.CommandObject(name))

    def get_message(self):
        return p.MessageObject("event")

    def execute(self, command, parameter):
        return COMMANDS[command](parameter)

    def get_name(self):
        return COMMANDS.get(self.name, lambda _: self.name)(None)

    def get_attribute(self):
        return COMMANDS.get(self.name, lambda _: 7)(None)

    def put_id(self, id):  # noqa: A002 - the documents' word
        self.id = id
        return COMMANDS.get(self.name, lambda _: None)(id)

    def release(self):
        self.log.append(self.name)


def fails(error):
    def command(_parameter):
        raise error

    return command


COMMANDS = {
    "echo": lambda parameter: parameter,
    "none": lambda _: None,
    "coded": lambda _: ResultWithCode(hresult.S_BUF_FULL, [1.0]),
    "coded signed": lambda _: ResultWithCode(-2147467259, "still said"),
    "coded wrong": lambda _: ResultWithCode(2**32, 1),
    "dict": lambda _: {"a": 1},
    "text": lambda _: "P1",
    "huge": lambda _: 2**40,
    "call error": fails(error_for(0x83501032, "in slave mode")),
    "signed": fails(CallError(-2147467263)),
    "value error": fails(ValueError("five")),
    "recursion": fails(RecursionError("deep")),
    "trouble": fails(Trouble()),
    "stop": fails(StopIteration(1)),
    "too wide": lambda parameter: Variant(VarType.I2, parameter.value),
    "blocking": lambda parameter: BlockingCall(lambda: parameter),
}


class Device(Provider):
    provider_names = (PROVIDER, "CaoProv.Second")

    def __init__(self, kind=Controller) -> None:
        self.log: list[str] = []
        self.calls: list[tuple] = []
        self.kind = kind

    def connect(self, name, machine, option, client):
        self.calls.append((name, machine, option, client))
        if machine == "refused":
            raise error_for(hresult.E_ACCESSDENIED)
        return self.kind(name, self.log)


@pytest.fixture
def device():
    return Device()


@pytest.fixture
def session(device):
    return Session(ProviderRegistry(device))


def call(session, name, *arguments):
    return session.invoke(BY_NAME[name].id, [variant(argument) for argument in arguments])


def value(session, name, *arguments):
    reply = call(session, name, *arguments)
    assert isinstance(reply, CallReply), reply
    assert reply.code == hresult.S_OK, reply
    return None if reply.result is None else reply.result.plain


def code(session, name, *arguments):
    reply = call(session, name, *arguments)
    assert isinstance(reply, CallReply)
    assert reply.result is None
    return reply.code


def connect(session, name="", option=""):
    return value(session, "Controller_Connect", name, PROVIDER, "localhost", option)


# --- handles ----------------------------------------------------------------------------------------------------------


def test_handles_count_up_from_two_for_all_interfaces(session):
    """As in the documents' samples: controller 2, variable 3 (RC8 3.1.2)."""
    assert value(session, "Service_Start", "WDT=400") is None
    controller = connect(session)
    assert controller == 2
    assert value(session, "Controller_GetVariable", controller, "IO150", "") == 3
    assert value(session, "Controller_GetRobot", controller, "Arm", "") == 4
    assert value(session, "Controller_GetMessage", controller) == 5
    assert len(session) == 4


def test_a_handle_is_returned_as_vt_i4(session):
    reply = call(session, "Controller_Connect", "", PROVIDER, "localhost", "")
    assert reply == CallReply(0, Variant(VarType.I4, 2))


def test_a_released_handle_is_not_reused_immediately(session):
    controller = connect(session)
    first = value(session, "Controller_GetVariable", controller, "I1", "")
    assert value(session, "Variable_Release", first) is None
    assert value(session, "Controller_GetVariable", controller, "I1", "") == first + 1


def test_handles_wrap_around_and_skip_those_in_use(session):
    controller = connect(session)
    variable = value(session, "Controller_GetVariable", controller, "I1", "")
    session._handles._next = 0x7FFF_FFFF
    assert value(session, "Controller_GetVariable", controller, "I2", "") == 0x7FFF_FFFF
    assert (controller, variable) == (2, 3)
    assert value(session, "Controller_GetVariable", controller, "I3", "") == 4
    session._handles._next = 0x7FFF_FFFF
    assert value(session, "Controller_GetVariable", controller, "I4", "") == 5


def test_a_handle_that_is_not_in_use(session):
    controller = connect(session)
    for handle in (0, 1, 3, -1, 2**31 - 1, -(2**31)):
        reply = call(session, "Variable_GetValue", handle)
        assert (reply.code, reply.detail) == (hresult.E_HANDLE, f"handle {handle} does not exist")
        assert code(session, "Variable_Release", handle) == hresult.E_HANDLE
    assert value(session, "Controller_Disconnect", controller) is None
    assert code(session, "Controller_Disconnect", controller) == hresult.E_HANDLE
    i18n.use("ja")
    assert call(session, "Variable_GetValue", 9).detail == "ハンドル 9 は存在しません"


def test_a_handle_of_another_interface(session):
    controller = connect(session)
    variable = value(session, "Controller_GetVariable", controller, "I1", "")
    reply = call(session, "Robot_Execute", variable, "CurPos")
    assert reply.code == hresult.E_HANDLE
    assert reply.detail == f"handle {variable} is a Variable, Robot_Execute requires a Robot"
    assert code(session, "Robot_Release", variable) == hresult.E_HANDLE
    assert code(session, "Variable_Release", controller) == hresult.E_HANDLE
    assert value(session, "Variable_GetValue", variable) == 0
    i18n.use("ja")
    assert "Robot が必要" in call(session, "Robot_Execute", variable, "CurPos").detail


def test_a_handle_of_another_client(device):
    host = ProviderRegistry(device)
    one, other = Session(host), Session(host)
    connect(one)
    variable = value(one, "Controller_GetVariable", 2, "I1", "")
    assert code(other, "Variable_GetValue", variable) == hresult.E_HANDLE
    connect(other)
    other.close()
    assert value(one, "Variable_GetValue", variable) == 0


@pytest.mark.parametrize("vt", [VarType.I4, VarType.UI4, VarType.I2, VarType.UI2])
def test_a_handle_of_any_integer_type(session, vt):
    controller = connect(session)
    assert value(session, "Controller_GetName", Variant(vt, controller)) == "Controller1"


@pytest.mark.parametrize("handle", ["2", 2.0, None, True, [2]])
def test_invalid_handles(session, handle):
    connect(session)
    assert code(session, "Controller_GetName", handle) == hresult.E_INVALIDARGTYPE


ON_HANDLE = [each.id for each in FUNCTIONS.values() if [argument.is_handle for argument in each.arguments] == [True]]


def test_a_call_on_a_handle_alone_is_the_usual_call():
    """``invoke_on_handle`` returns what ``invoke`` returns, for all objects, and handles that do not exist."""
    outcomes = []
    for on_handle in (False, True):
        results = []
        for function_id in ON_HANDLE:
            device = Device()
            session = Session(ProviderRegistry(device))
            connect(session)
            handles = [value(session, f"Controller_Get{kind}", 2, kind, "") for kind in ("Variable", "File", "Robot")]
            for handle in (*handles, 2, 99, -1):
                call_it = session.invoke_on_handle if on_handle else session.invoke
                results.append(repr(call_it(function_id, handle if on_handle else [Variant(VarType.I4, handle)])))
            results.append(repr((device.log, len(session))))
        outcomes.append(results)
    assert outcomes[0] == outcomes[1]
    assert len(set(outcomes[0])) > 30


def test_an_error_of_a_call_on_a_handle_alone_becomes_a_reply(session):
    controller = connect(session, "value error")
    for call_it in (session.invoke_on_handle, lambda *both: session.invoke(both[0], [variant(both[1])])):
        reply = call_it(BY_NAME["Controller_GetName"].id, controller)
        assert (reply.code, reply.detail) == (hresult.E_FAIL, "ValueError: five")


def test_other_functions_cannot_be_called_on_a_handle_alone(session):
    controller = connect(session)
    assert session.invoke_on_handle(BY_NAME["Controller_GetVariable"].id, controller).code == hresult.E_INVALIDARG
    assert session.invoke_on_handle(999, controller).code == hresult.E_NOTIMPL


def test_a_result_that_is_a_plain_number(session):
    """The variable returns a ``float``, not a Variant."""

    class Sensor(VariableObject):
        def get_value(self):
            return 0.5

    class Sensors(Controller):
        def get_variable(self, name, option):
            return Sensor(name)

    session = Session(ProviderRegistry(Device(Sensors)))
    variable = value(session, "Controller_GetVariable", connect(session), "S1", "")
    for reply in (session.invoke_on_handle(101, variable), call(session, "Variable_GetValue", variable)):
        assert reply == CallReply(hresult.S_OK, Variant(VarType.R8, 0.5))


# --- Controller_Connect -----------------------------------------------------------------------------------------------


def test_the_provider_receives_name_machine_option_and_client(device):
    client = ClientInfo("192.168.0.7", "tcp", 50000)
    session = Session(ProviderRegistry(device), client)
    value(session, "Controller_Connect", "b-CAP", PROVIDER, "192.168.0.1", "Interval=8")
    ((*received, who),) = device.calls
    assert received == ["b-CAP", "192.168.0.1", "Interval=8"]
    assert who == client._replace(provider=PROVIDER, describe_error=session.client.describe_error)
    assert Session(ProviderRegistry(device)).client[:3] == ("", "memory", 0)


def test_an_empty_name_is_replaced(session, device):
    assert connect(session) != connect(session)
    assert [name for name, *_ in device.calls] == ["Controller1", "Controller2"]


def test_the_option_may_be_omitted(session, device):
    assert value(session, "Controller_Connect", "x", PROVIDER, "") == 2
    assert device.calls[0][2] == ""


def test_a_name_in_use_is_already_registered(session, device):
    handle = connect(session, "b-CAP")
    reply = call(session, "Controller_Connect", "B-cap", PROVIDER, "localhost", "")
    assert (reply.code, reply.detail) == (0x80000205, "B-cap")
    assert code(session, "Controller_Connect", "b-CAP", "CaoProv.Second", "", "@IfNotMember=False") == 0x80000205
    assert len(device.calls) == 1
    value(session, "Controller_Disconnect", handle)
    assert connect(session, "b-CAP") == handle + 1


@pytest.mark.parametrize("option", ["@IfNotMember", ",@ifnotmember=True", "Interval=8, @IfNotMember"])
def test_if_not_member_returns_the_existing_object(session, device, option):
    handle = connect(session, "b-CAP", option)
    assert connect(session, "B-CAP", option) == handle
    assert len(device.calls) == 1
    assert connect(session, "", option) != handle, "an object without a name cannot be found"
    assert connect(session, "", option) != handle


def test_if_not_member_of_objects_below(session):
    controller = connect(session)
    other = connect(session)
    variable = value(session, "Controller_GetVariable", controller, "I1", "@IfNotMember")
    assert value(session, "Controller_GetVariable", controller, "i1", "@IfNotMember") == variable
    assert value(session, "Controller_GetVariable", controller, "I2", "@IfNotMember") != variable
    assert value(session, "Controller_GetVariable", other, "I1", "@IfNotMember") != variable
    assert value(session, "Controller_GetFile", controller, "I1", "@IfNotMember") != variable
    assert value(session, "Controller_GetVariable", controller, "I1", "") != variable
    assert value(session, "Controller_GetVariable", controller, "", "@IfNotMember") != value(
        session, "Controller_GetVariable", controller, "", "@IfNotMember"
    )


def test_an_unknown_provider_is_reported_with_the_available_ones(session):
    reply = call(session, "Controller_Connect", "", "CaoProv.DENSO.RC8", "", "")
    assert reply.code == hresult.E_CAO_PROV_INVALID
    assert reply.detail == "unknown provider 'CaoProv.DENSO.RC8'; available: CaoProv.Test, CaoProv.Second"
    i18n.use("ja")
    assert "提供中" in call(session, "Controller_Connect", "", "x", "", "").detail


@pytest.mark.parametrize("name", [PROVIDER.upper(), " caoprov.test ", "CAOPROV.SECOND"])
def test_provider_names_are_case_insensitive(session, name):
    assert value(session, "Controller_Connect", "", name, "", "") == 2


def test_several_providers_and_the_one_for_any_name():
    first, second, any_name = Device(), Device(), Device()
    second.provider_names = (PROVIDER, "Second")
    any_name.provider_names = ("*",)
    host = ProviderRegistry([first, second, any_name])
    assert host.find(PROVIDER) is first
    assert host.find("second") is second
    assert host.find("unknown") is any_name
    assert host.find("") is any_name
    with pytest.raises(CallError, match="E_CAO_PROV_INVALID"):
        ProviderRegistry([first, second]).find("unknown")


def test_a_provider_refuses_a_client(session):
    assert code(session, "Controller_Connect", "", PROVIDER, "refused", "") == hresult.E_ACCESSDENIED
    assert len(session) == 0


def test_a_provider_without_a_device():
    session = Session(ProviderRegistry(Provider()))
    assert code(session, "Controller_Connect", "", "x", "", "") == hresult.E_CAO_PROV_INVALID
    bare = Provider()
    bare.provider_names = ("x",)
    assert code(Session(ProviderRegistry(bare)), "Controller_Connect", "", "x", "", "") == hresult.E_NOTIMPL
    bare.close()


def test_an_object_created_too_late_is_released(session):
    released = []

    class Late(VariableObject):
        def release(self):
            released.append(self.name)

    controller = connect(session)
    before = len(session)
    pending = Pending(FUNCTIONS[9], controller, "I1", BlockingCall(lambda: None))
    reply = session.complete(pending, Late("I1"), client_waits=False)
    assert (reply.code, released, len(session)) == (hresult.E_ABORT, ["I1"], before)
    assert session.complete(Pending(FUNCTIONS[101], controller, "", None), 5, client_waits=False).code == hresult.S_OK


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ([], ValueError, "no provider to serve"),
        (Device, TypeError, "pass an instance"),
        ("Foo", TypeError, "'F'"),
        (5, TypeError, "5"),
        ([Device(), None], TypeError, "None"),
    ],
)
def test_invalid_providers(wrong, error, said):
    with pytest.raises(error, match=said):
        ProviderRegistry(wrong)


def test_provider_names_are_a_tuple_of_names(caplog):
    device = Device()
    for names in ("Foo", (1,)):
        device.provider_names = names
        with pytest.raises(TypeError, match="provider_names"):
            ProviderRegistry(device)
    device.provider_names = ()
    ProviderRegistry(device)
    assert "clients cannot connect" in caplog.text


# --- limits -----------------------------------------------------------------------------------------------------------


def test_the_object_limit(device):
    session = Session(ProviderRegistry(device, objects=3))
    controller = connect(session, "one")
    variable = value(session, "Controller_GetVariable", controller, "I1", "")
    value(session, "Controller_GetVariable", controller, "I2", "")
    reply = call(session, "Controller_GetVariable", controller, "I3", "")
    assert (reply.code, reply.detail) == (hresult.E_MAX_OBJECT, "the limit is 3 objects per client")
    assert code(session, "Controller_GetMessage", controller) == hresult.E_MAX_OBJECT
    assert code(session, "Controller_Connect", "two", PROVIDER, "", "") == hresult.E_MAX_OBJECT
    assert code(session, "Controller_Connect", "", PROVIDER, "", "") == hresult.E_MAX_OBJECT
    assert len(device.calls) == 1
    assert value(session, "Controller_GetVariable", controller, "I1", "@IfNotMember") == variable
    assert connect(session, "one", "@IfNotMember") == controller
    value(session, "Variable_Release", variable)
    value(session, "Controller_GetVariable", controller, "I3", "")
    i18n.use("ja")
    assert "3 個まで" in call(session, "Controller_GetMessage", controller).detail


def test_a_thousand_objects_by_default(session):
    controller = connect(session)
    for _ in range(999):
        value(session, "Controller_GetVariable", controller, "I1", "")
    assert code(session, "Controller_GetVariable", controller, "I1", "") == hresult.E_MAX_OBJECT


# --- release ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def tree(session):
    """Two controllers; below the first a file with a variable and another file in it, and a variable."""
    controller = connect(session, "C")
    outer = value(session, "Controller_GetFile", controller, "outer", "")
    value(session, "Controller_GetVariable", controller, "I1", "")
    inner = value(session, "File_GetFile", outer, "inner", "")
    value(session, "File_GetVariable", inner, "v1", "")
    other = connect(session, "D")
    value(session, "Controller_GetVariable", other, "I2", "")
    value(session, "File_GetVariable", outer, "v2", "")
    return controller, outer, inner


def test_an_object_goes_with_all_below_it_newest_first(session, device, tree):
    _, outer, inner = tree
    assert value(session, "File_Release", outer) is None
    assert device.log == ["v2", "v1", "inner", "outer"]
    assert code(session, "File_GetPath", inner) == hresult.E_HANDLE
    assert len(session) == 4


def test_a_controller_goes_with_all_below_it(session, device, tree):
    assert value(session, "Controller_Disconnect", tree[0]) is None
    assert device.log == ["v2", "v1", "inner", "I1", "outer", "C"]
    assert len(session) == 2


@pytest.mark.parametrize("how", [lambda session: value(session, "Service_Stop"), Session.close])
def test_stopping_and_closing_release_everything_newest_first(session, device, tree, how):
    how(session)
    assert device.log == ["v2", "I2", "D", "v1", "inner", "I1", "outer", "C"]
    assert len(session) == 0
    how(session)
    assert len(device.log) == 8


def test_after_service_stop_the_client_may_continue(session):
    connect(session)
    value(session, "Service_Stop")
    assert value(session, "Service_Start") is None
    assert connect(session) == 3


def test_a_thousand_files_one_below_the_other_are_released(session, device):
    """A client can create many levels; releasing them must not recurse a thousand times."""
    handle = value(session, "Controller_GetFile", connect(session, "C"), "0", "")
    top = handle
    for number in range(1, 999):
        handle = value(session, "File_GetFile", handle, str(number), "")
    assert value(session, "File_Release", top) is None
    assert device.log == [str(number) for number in range(998, -1, -1)]
    assert len(session) == 1


def test_a_release_that_fails_is_logged_and_the_others_are_executed(session, device, caplog):
    class Stubborn(Controller):
        def release(self):
            super().release()
            raise OSError("stuck")

    device.kind = Stubborn
    first, second = connect(session, "first"), connect(session, "second")
    assert value(session, "Controller_Disconnect", first) is None
    assert code(session, "Controller_GetName", first) == hresult.E_HANDLE
    assert value(session, "Controller_GetName", second) == "second"
    session.close()
    assert device.log == ["first", "second"]
    assert caplog.text.count("OSError: stuck") == 2


# --- results and what a device does -----------------------------------------------------------------------------------


def test_results_of_every_type(session):
    controller = connect(session, "C")
    execute = BY_NAME["Controller_Execute"].id
    assert call(session, "Controller_GetAttribute", controller) == CallReply(0, Variant(VarType.I4, 7))
    assert call(session, "Controller_GetName", controller) == CallReply(0, Variant(VarType.BSTR, "C"))
    assert call(session, "Controller_PutID", controller, 5) == CallReply(0, None)
    assert call(session, "Controller_Execute", controller, "none") == CallReply(0, Variant(VarType.EMPTY))
    kept = Variant(VarType.UI2, 5)
    assert session.invoke(execute, [variant(controller), variant("echo"), kept]).result is kept


def test_an_argument_of_type_variant_keeps_its_type(session):
    controller = connect(session)
    variable = value(session, "Controller_GetVariable", controller, "I1", "")
    for item in (Variant(VarType.I2, 1), Variant(VarType.R4 | ARRAY, [1.0]), Variant(VarType.NULL), variant(b"ab")):
        assert value(session, "Variable_PutValue", variable, item) is None
        assert same(call(session, "Variable_GetValue", variable).result, item)


@given(variants())
def test_any_value_passes_through_unchanged(item):
    session = Session(ProviderRegistry(Device()))
    connect(session)
    assert value(session, "Controller_PutTag", 2, item) is None
    assert same(call(session, "Controller_GetTag", 2).result, item)


def test_tag_and_id_belong_to_one_handle(session):
    controller = connect(session)
    one = value(session, "Controller_GetVariable", controller, "I1", "")
    other = value(session, "Controller_GetVariable", controller, "I1", "")
    assert value(session, "Variable_GetTag", one) is None
    assert value(session, "Variable_GetID", one) is None
    value(session, "Variable_PutTag", one, "mine")
    value(session, "Variable_PutID", one, 5)
    assert value(session, "Variable_GetTag", one) == "mine"
    assert value(session, "Variable_GetID", one) == 5
    assert value(session, "Variable_GetTag", other) is None
    assert value(session, "Variable_GetAttribute", one) == 3
    assert value(session, "Variable_GetHelp", one) == "a variable"


def test_success_codes_beside_the_result(session):
    controller = connect(session, "coded signed")
    assert call(session, "Controller_Execute", controller, "coded") == CallReply(0x0F200501, variant([1.0]))
    assert call(session, "Controller_PutID", controller, 1) == CallReply(0x80004005, None)
    assert call(session, "Controller_GetName", controller) == CallReply(0x80004005, variant("still said"))
    command = call(session, "Controller_GetCommand", controller, "x", "")
    assert command == CallReply(hresult.S_FALSE, Variant(VarType.I4, controller + 1))
    assert code(session, "Command_Execute", controller + 1) == hresult.E_NOTIMPL


@pytest.mark.parametrize(
    ("command", "expected", "detail"),
    [
        ("call error", 0x83501032, "in slave mode"),
        ("signed", hresult.E_NOTIMPL, ""),
        ("value error", hresult.E_FAIL, "ValueError: five"),
        ("recursion", hresult.E_FAIL, "RecursionError: deep"),
        ("trouble", hresult.E_FAIL, "Trouble: <exception str() failed>"),
        ("stop", hresult.E_FAIL, "StopIteration: 1"),
        ("no such command", hresult.E_FAIL, "KeyError: 'no such command'"),
        ("dict", hresult.E_FAIL, "Controller_Execute cannot return dict"),
        ("huge", hresult.E_FAIL, "does not fit VT_I4"),
        ("coded wrong", hresult.E_FAIL, "does not fit into 32 bits"),
        ("too wide", hresult.E_FAIL, "70000 does not fit VT_I2"),
    ],
)
def test_an_exception_of_a_device_becomes_a_reply(session, command, expected, detail, caplog):
    controller = connect(session)
    reply = call(session, "Controller_Execute", controller, command, 70000)
    assert (reply.code, reply.result) == (expected, None)
    assert detail in reply.detail
    unexpected = expected == hresult.E_FAIL
    assert ("Controller_Execute: the device raised an exception" in caplog.text) == unexpected
    assert value(session, "Controller_Execute", controller, "echo", 5) == 5
    assert len(session) == 1


@pytest.mark.parametrize("name", ["huge", "text", "none", "dict"])
def test_a_device_that_returns_the_wrong_type(session, name):
    controller = connect(session, name)
    assert code(session, "Controller_GetAttribute", controller) == hresult.E_FAIL
    if name != "text":
        assert code(session, "Controller_GetName", controller) == hresult.E_FAIL
    assert value(session, "Controller_PutID", controller, 1) is None, "the result of a function without one is ignored"


def test_errors_that_a_device_raises_on_purpose_are_not_logged_as_errors(session, caplog):
    controller = connect(session)
    caplog.set_level(logging.DEBUG, "orinkit.session")
    reply = call(session, "Controller_GetVariable", controller, "nothing", "")
    assert (reply.code, reply.detail) == (hresult.E_CAO_OBJECT_NOTFOUND, "nothing")
    (record,) = caplog.records
    assert record.levelno < logging.WARNING
    assert record.exc_info is None
    assert record.getMessage().startswith("Controller_GetVariable: 0x80000204")
    assert "nothing" in record.getMessage()


@pytest.mark.parametrize("made", [None, 5, "x", p.CaoObject])
def test_a_device_that_returns_no_object(session, device, made):
    device.kind = lambda name, log: made
    reply = call(session, "Controller_Connect", "", PROVIDER, "", "")
    assert reply.code == hresult.E_FAIL
    assert "instead of a Controller" in reply.detail
    assert len(session) == 0


# --- all functions ----------------------------------------------------------------------------------------------------

BARE = {
    "Controller": ControllerObject, "Extension": p.ExtensionObject, "File": p.FileObject, "Robot": p.RobotObject,
    "Task": p.TaskObject, "Variable": p.VariableObject, "Command": p.CommandObject, "Message": p.MessageObject,
}  # fmt: skip
PLAIN = {VarType.I4: 1, VarType.R4: 1.5, VarType.BSTR: "x", VarType.VARIANT: [1.0]}


@pytest.mark.parametrize("entry", FUNCTIONS.values(), ids=lambda entry: entry.name)
def test_every_function_reaches_its_object(session, entry):
    """A minimal object: names are empty, the common properties work, everything else is not implemented."""
    handle = session._add(
        entry.interface, BARE.get(entry.interface, p.CaoObject)("it", attribute=2, help="h"), 0, "it", p.Provider()
    )
    arguments = [variant(handle if each.is_handle else PLAIN[each.vt]) for each in entry.arguments]
    if entry.name == "Controller_Connect":
        arguments[1] = variant(PROVIDER)
    reply = session.invoke(entry.id, arguments)
    verb = entry.name.partition("_")[2]
    expected = {
        "GetAttribute": Variant(VarType.I4, 2), "GetHelp": variant("h"), "GetName": variant("it"),
        "GetTag": Variant(VarType.EMPTY), "GetID": Variant(VarType.EMPTY), "PutTag": None, "PutID": None,
    }  # fmt: skip
    if verb in expected:
        assert reply == CallReply(0, expected[verb])
    elif verb.endswith("Names"):
        assert reply == CallReply(0, Variant(VarType.BSTR | ARRAY, []))
    elif entry.releases or entry.interface == "Service":
        assert reply == CallReply(0, None)
        assert len(session) == (entry.name == "Service_Start")
    elif entry.name == "Controller_Connect":
        assert reply.code == 0
    elif entry.name == "Controller_GetMessage":
        assert reply.code == hresult.E_CAO_OBJECT_NOTFOUND
    else:
        assert reply.code == (hresult.E_CAO_NOT_WRITABLE if entry.name == "Variable_PutValue" else hresult.E_NOTIMPL)


@pytest.mark.parametrize("number", [0, 138, 255, 256, 2**32 - 1, -1])
def test_an_unknown_function(session, number):
    reply = session.invoke(number, [])
    assert (reply.code, reply.detail) == (hresult.E_NOTIMPL, f"unknown function {number}")
    i18n.use("ja")
    assert session.invoke(number, [variant(1)]).detail == f"関数 {number} はありません"


@given(st.integers(0, 140), st.lists(variants(), max_size=6))
def test_invoke_never_raises(number, arguments):
    session = Session(ProviderRegistry(Device()))
    connect(session)
    outcome = session.invoke(number, arguments)
    if isinstance(outcome, Pending):
        if not isinstance(outcome.work, BlockingCall):
            outcome.work.close()
        outcome = session.fail(outcome, error_for(hresult.E_ABORT))
    assert isinstance(outcome, CallReply)
    assert 0 <= outcome.code < 2**32
    session.close()


# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", FUNCTIONS.values(), ids=lambda entry: entry.name)
def test_the_number_of_arguments(session, entry):
    wanted = len(entry.arguments)
    for count in range(wanted + 3):
        given = [variant(1 if each.vt is not VarType.BSTR else "x") for each in entry.arguments[:count]]
        given += [variant(1)] * (count - len(given))
        if entry.required <= count <= wanted:
            assert len(read_arguments(entry, given)) == wanted
        else:
            reply = session.invoke(entry.id, given)
            assert reply.code == hresult.E_INVALIDARG
            assert reply.detail == f"got {count} arguments, expected {wanted} for {entry.name}"


def test_omitted_optional_arguments_have_their_defaults():
    assert read_arguments(BY_NAME["Service_Start"], []) == [""]
    assert read_arguments(BY_NAME["Robot_Move"], [variant(3), variant(1), variant("P1")])[3] == ""
    assert read_arguments(BY_NAME["Robot_Execute"], [variant(3), variant("x")])[2] == Variant(VarType.EMPTY)
    assert read_arguments(BY_NAME["Command_Execute"], [variant(3)]) == [3, 0]


def test_arguments_in_all_the_forms_that_clients_send():
    drive = BY_NAME["Robot_Drive"]
    given = [Variant(VarType.UI4, 3), Variant(VarType.R8, 2.0), variant("1.5"), Variant(VarType.EMPTY)]
    assert read_arguments(drive, given) == [3, 2, 1.5, ""]
    assert read_arguments(drive, [variant(3), variant(["2"]), variant([1]), variant(["@0"])]) == [3, 2, 1.0, "@0"]


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("Robot_Drive", (3, "x", 1.0, ""), hresult.E_INVALIDARGTYPE),
        ("Robot_Drive", (3, 1, [1.0, 2.0], ""), hresult.E_INVALIDARGTYPE),
        ("Robot_Drive", (3, 1.5, 1.0, ""), hresult.E_INVALIDARG),
        ("Robot_Drive", (3, 1, float("nan"), ""), hresult.E_INVALIDARG),
        ("Robot_Drive", (3, 1, 1.0, 5), hresult.E_INVALIDARGTYPE),
        ("Robot_Drive", (3, 1, "9" * 400, ""), hresult.E_INVALIDARG),
        ("Robot_Drive", (3, "9" * 400, 1.0, ""), hresult.E_INVALIDARG),
        ("Controller_Connect", (1, "x", "", ""), hresult.E_INVALIDARGTYPE),
    ],
)
def test_arguments_of_the_wrong_type(session, name, arguments, expected, caplog):
    assert code(session, name, *arguments) == expected
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_messages_about_arguments_in_japanese(session):
    i18n.use("ja")
    reply = call(session, "Robot_Drive", 3)
    assert reply.detail == "引数が 1 個あります (Robot_Drive は 4 個)"


# --- methods that wait ------------------------------------------------------------------------------------------------


def drive(awaitable):
    """Run an awaitable that never suspends."""
    try:
        awaitable.send(None)
    except StopIteration as stop:
        return stop.value
    raise AssertionError("it waits")


def test_an_awaitable_and_its_result(session):
    controller = connect(session)
    pending = call(session, "Controller_GetTask", controller, "Pro1", "")
    assert isinstance(pending, Pending)
    assert (pending.function.name, pending.handle, pending.label) == ("Controller_GetTask", controller, "Pro1")
    assert len(session) == 1
    assert session.complete(pending, drive(pending.work)) == CallReply(0, Variant(VarType.I4, 3))
    assert value(session, "Task_GetName", 3) == "Pro1"
    assert value(session, "Controller_GetVariable", controller, "Pro1", "@IfNotMember") == 4


def test_a_blocking_call_and_its_result(session):
    controller = connect(session)
    pending = call(session, "Controller_GetExtension", controller, "Hand0", "")
    assert isinstance(pending, Pending)
    assert isinstance(pending.work, BlockingCall)
    assert session.complete(pending, pending.work.run()) == CallReply(0, Variant(VarType.I4, 3))
    pending = call(session, "Controller_Execute", controller, "blocking", 5)
    assert session.complete(pending, pending.work.run()) == CallReply(0, variant(5))


def test_a_pending_call_that_fails(session, caplog):
    controller = connect(session)
    pending = call(session, "Controller_GetExtension", controller, "Hand0", "")
    assert session.fail(pending, error_for(0x80020005, "why")) == CallReply(0x80020005, detail="why")
    assert session.fail(pending, OSError("gone")) == CallReply(hresult.E_FAIL, detail="OSError: gone")
    assert session.complete(pending, "no object").code == hresult.E_FAIL
    pending = call(session, "Controller_Execute", controller, "blocking", 5)
    assert session.complete(pending, {}).code == hresult.E_FAIL
    assert len(session) == 1


@pytest.mark.parametrize("gone", [Session.close, lambda session: value(session, "Controller_Disconnect", 2)])
def test_an_object_created_after_the_client_has_disconnected_is_released(session, device, gone):
    controller = connect(session, "C")
    pending = call(session, "Controller_GetExtension", controller, "Hand0", "")
    gone(session)
    late = Memory("late", device.log)
    assert session.complete(pending, late) == CallReply(hresult.E_ABORT, detail="Hand0")
    assert device.log == ["C", "late"]
    assert len(session) == 0


def test_a_value_after_the_client_has_disconnected_is_ignored(session):
    pending = call(session, "Controller_Execute", connect(session), "blocking", 5)
    session.close()
    assert session.complete(pending, 5) == CallReply(0, variant(5))


def test_a_closed_session_creates_no_controller(session, device):
    session.close()
    assert code(session, "Controller_Connect", "C", PROVIDER, "", "") == hresult.E_ABORT
    assert device.log == ["C"]


# --- the rest ---------------------------------------------------------------------------------------------------------


def test_special_functions_concern_handles_or_the_service():
    special = set(session_module._SPECIAL)
    assert special == {1, 2, 3} | {entry.id for entry in FUNCTIONS.values() if entry.releases}


def test_results_of_dates_and_money(session):
    controller = connect(session)
    for item in (datetime(2026, 11, 21, 10), Decimal("1.5")):
        assert value(session, "Controller_Execute", controller, "echo", item) == item


# --- results that come later, and locks ------------------------------------------------------------------------------


class _Lock:
    """Counts how often it is entered, and how deep."""

    def __init__(self) -> None:
        self.entered = 0
        self.held = 0

    def __enter__(self) -> None:
        self.entered += 1
        self.held += 1

    def __exit__(self, *_: object) -> None:
        self.held -= 1


class _Guarded(p.Provider):
    provider_names = ("Guarded",)

    def __init__(self) -> None:
        self.guard = _Lock()
        self.deferred = p.Deferred[int]()
        self.seen: list[int] = []

    def connect(self, name, machine, option, client):
        self.seen.append(self.guard.held)
        return _GuardedController(self)


class _GuardedController(p.ControllerObject):
    def __init__(self, provider: _Guarded) -> None:
        super().__init__()
        self._provider = provider

    def get_task(self, name, option):
        self._provider.seen.append(self._provider.guard.held)
        return p.TaskObject(name)

    def execute(self, command, parameter):
        self._provider.seen.append(self._provider.guard.held)
        return self._provider.deferred

    def release(self):
        self._provider.seen.append(self._provider.guard.held)


def _execute(session, handle):
    return session.invoke(17, [Variant(VarType.I4, handle), Variant(VarType.BSTR, "x"), Variant(VarType.EMPTY)])


def _connected(provider):
    session = Session(ProviderRegistry(provider))
    texts = [Variant(VarType.BSTR, text) for text in ("", "Guarded", "", "")]
    return session, session.invoke(3, texts).result.value


def test_methods_and_releases_run_inside_the_guard():
    provider = _Guarded()
    session, handle = _connected(provider)
    _execute(session, handle)
    task = session.invoke(8, [Variant(VarType.I4, handle), Variant(VarType.BSTR, "t"), Variant(VarType.BSTR, "")])
    assert task.code == 0
    session.close()
    assert provider.seen == [1, 1, 1, 1]
    assert provider.guard.held == 0


def test_a_deferred_result_is_pending_until_it_is_set():
    provider = _Guarded()
    session, handle = _connected(provider)
    pending = _execute(session, handle)
    assert isinstance(pending, Pending)
    assert pending.work is provider.deferred
    called = []
    provider.deferred.add_done_callback(lambda: called.append(1))
    assert called == []
    provider.deferred.set_result(7)
    provider.deferred.set_result(8)
    provider.deferred.set_exception(ValueError("late"))
    assert called == [1]
    assert session.complete(pending, provider.deferred.result()).result == Variant(VarType.I4, 7)


def test_a_deferred_result_that_is_already_set():
    provider = _Guarded()
    session, handle = _connected(provider)
    provider.deferred.set_result(7)
    assert _execute(session, handle).result == Variant(VarType.I4, 7)


def test_a_deferred_exception_that_is_already_set():
    provider = _Guarded()
    session, handle = _connected(provider)
    provider.deferred.set_exception(CallError(0x83500076))
    assert _execute(session, handle).code == 0x83500076
    called = []
    provider.deferred.add_done_callback(lambda: called.append(1))
    assert called == [1]


def test_only_a_revocable_result_is_abandoned_with_its_client():
    for revocable in (False, True):
        deferred = p.Deferred[int](revocable=revocable)
        deferred.abandon()
        assert deferred.done() is revocable
        deferred.set_result(7)
        if revocable:
            with pytest.raises(CallError, match="no longer waits") as caught:
                deferred.result()
            assert caught.value.code == hresult.E_ABORT
        else:
            deferred.abandon()
            assert deferred.result() == 7


def test_two_threads_share_the_callbacks_of_a_deferred_result():
    """A callback that the other thread has removed is not invoked again."""
    deferred = p.Deferred[int]()
    called = []

    def steal():
        deferred._callbacks.clear()
        called.append("first")

    class Emptied(list):
        def __bool__(self) -> bool:  # as if another thread removed the last one between the check and the pop
            return True

    deferred._callbacks = Emptied([lambda: called.append("second"), steal])
    deferred.set_result()
    assert called == ["first"]


# --- devices with another dialect -------------------------------------------------------------------------------------


class SmallController(ControllerObject):
    def __init__(self, log: list[str]) -> None:
        super().__init__("small")
        self.log = log

    def get_variable(self, name, option):
        return Memory(name, self.log)

    def get_robot(self, name, option):
        return p.RobotObject(name)

    def execute(self, command, parameter):
        return None


class SmallProvider(Provider):
    """A provider with few functions, fixed handles, and another dialect."""

    provider_names = ("*",)
    dialect = VE026A
    functions = frozenset({1, 2, 3, 4, 7, 9, 17, 64, 101, 111})
    fixed_handles = True

    def __init__(self) -> None:
        self.log: list[str] = []

    def connect(self, name, machine, option, client):
        return SmallController(self.log)

    def handle_of(self, interface, name):
        return {"@A": 1, "@B": 4}.get(name.upper(), 1)


def small(session, name, *arguments):
    return session.invoke(BY_NAME[name].id, [variant(value) for value in arguments])


def test_fixed_handles_of_a_device():
    provider = SmallProvider()
    session = Session(ProviderRegistry(provider))
    assert small(session, "Controller_Connect", "", "", "", "").result == Variant(VarType.I4, 1)
    assert small(session, "Controller_Connect", "", "", "", "").result.value == 1
    assert small(session, "Controller_Connect", "Controller1", "", "", "").result.value == 1
    assert len(session) == 1
    assert small(session, "Controller_GetVariable", 1, "@B", "").result.value == 4
    assert small(session, "Controller_GetRobot", 1, "r", "").result.value == 1
    assert small(session, "Controller_GetVariable", 1, "@A", "").result.value == 1
    assert len(session) == 4
    assert small(session, "Controller_GetVariable", 1, "@a", "").result.value == 1
    assert small(session, "Controller_GetVariable", 1, "@a", "@IfNotMember").result.value == 1
    assert len(session) == 4, "the client already had the object"
    assert small(session, "Variable_GetValue", 4).result.value == 0
    assert small(session, "Variable_Release", 1).code == 0
    assert small(session, "Variable_GetValue", 1).code == hresult.E_HANDLE
    assert small(session, "Variable_GetValue", -5).code == hresult.E_HANDLE
    assert small(session, "Robot_Execute", 1, "x", 0).code == hresult.E_NOTIMPL, "the robot still exists"
    assert small(session, "Controller_Disconnect", 1).code == 0
    assert len(session) == 0
    assert provider.log == ["@a", "@A", "@B"]


def test_functions_that_a_device_does_not_have():
    session = Session(ProviderRegistry(SmallProvider()))
    assert small(session, "Controller_GetTask", 1, 2, 3, 4, 5, 6).code == hresult.E_NOTIMPL
    assert session.invoke(138, []).code == hresult.E_NOTIMPL


def test_an_execute_without_a_result_has_no_argument():
    session = Session(ProviderRegistry(SmallProvider()))
    small(session, "Controller_Connect", "", "", "", "")
    assert small(session, "Controller_Execute", 1, "ClearError", 0) == CallReply(0)


def test_dialects_do_not_mix():
    class Other(Provider):
        provider_names = ("Other",)

    with pytest.raises(ValueError, match="SmallProvider and Other"):
        ProviderRegistry([SmallProvider(), Other()])
    assert Provider().handle_of("Robot", "Arm") == 1
