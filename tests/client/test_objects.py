"""The objects of both clients against a served device that has all 137 functions."""

from __future__ import annotations

import asyncio
import copy
import gc
import pickle
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.cao.table import Argument, Function
from orinkit.core import hresult, i18n
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectFailed,
    ConnectionClosed,
    InvalidAddress,
    InvalidHandle,
    InvalidValue,
    NotImplementedCall,
    ObjectReleased,
    OrinError,
    ProtocolError,
)
from orinkit.ecap.message import read_reply, read_request
from orinkit.server.threaded import Server
from orinkit.values.variant import VarType
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.devices import Call, Recorder, Workshop, answer

PROVIDER = "Test.Recorder"
PATIENT = 20.0  # a time-out that must not expire: nothing is sent twice


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


@pytest.fixture
def server(listen_at: str, recorder: Recorder) -> Iterator[Server]:
    with orinkit.serve([recorder, VirtualRC8(), Workshop()], listen_at) as served:
        yield served


class Wire:
    """A trace that records the functions in requests and replies."""

    def __init__(self) -> None:
        self.sent: list[int] = []
        self.codes: list[int] = []

    def __call__(self, direction: str, data: bytes) -> None:
        if data[0] == packet.SOH:
            code = packet.decode(data).code
        else:
            code = read_request(data).function.id if direction == ">" else read_reply(data)[0]
        (self.sent if direction == ">" else self.codes).append(code)


# --- all 137 functions ----------------------------------------------------------------------------------------------

SAMPLES = {VarType.I4: 7, VarType.R4: 1.5, VarType.BSTR: "名前 ä", VarType.VARIANT: [1.0, -2.5]}
WHERE = {  # how to get an object of each interface, from the controller
    "Extension": ("extension", "Hand0"),
    "File": ("file", "プログラム.pcs"),
    "Robot": ("robot", "Arm"),
    "Task": ("task", "Pro1"),
    "Variable": ("variable", "IO150"),
    "Command": ("command", "Cmd"),
    "Message": ("message",),
}


def sample(argument: Argument) -> Any:
    return SAMPLES[argument.vt]


def natural_name(function: Function[..., Any]) -> str:
    """Return the method of an object that calls a function."""
    if function.creates or function.name.endswith("Names"):
        return function.method.removeprefix("get_")
    return "close" if function.releases else function.method


def open_object(both: Both, controller: Any, interface: str) -> Any:
    if interface == "Controller":
        return controller
    method, *arguments = WHERE[interface]
    return both.run(getattr(controller, method)(*arguments))


def path_of(interface: str) -> str:
    return "RC" if interface == "Controller" else f"RC/{(*WHERE[interface], 'message')[1]}"


def test_every_function_is_reached_by_a_natural_method(both: Both, server: Server, recorder: Recorder) -> None:
    wire = Wire()
    controller = both.connect(
        server.url, provider=PROVIDER, name="RC", option="MyOption=1", trace=wire, timeout=PATIENT
    )
    assert recorder.calls == [Call("Controller_Connect", "", ("RC", "localhost", "MyOption=1"))]
    objects = {interface: open_object(both, controller, interface) for interface in ("Controller", *WHERE)}
    for function in FUNCTIONS.values():
        if function.interface == "Service" or function.releases or function is f.controller_connect:
            continue
        values = [sample(argument) for argument in function.arguments[1:]]
        del recorder.calls[:]
        result = both.run(getattr(objects[function.interface], natural_name(function))(*values))
        path = path_of(function.interface)
        assert recorder.calls == [Call(function.name, path, tuple(values))]
        if function.creates:
            assert type(result).__name__.removeprefix("Async") == function.creates
            assert both.run(result.client.call(BY_NAME[f"{function.creates}_Release"], result.handle)) is None
            assert recorder.calls[1:] == [
                Call(f"{function.creates}_Release", f"{path}/{values[0] if values else 'message'}", ())
            ]
            result._open = False  # it has already been released
        elif natural_name(function).endswith("names"):
            assert result == [str(item) for item in answer(function, path, values)]
        else:
            assert result == answer(function, path, values)
    del recorder.calls[:]
    for interface, thing in reversed(objects.items()):
        both.run(thing.close())
        assert recorder.calls[-1].path == path_of(interface)
    assert [call.function for call in recorder.calls] == [
        "Message_Release", "Command_Release", "Variable_Release", "Task_Release", "Robot_Release", "File_Release",
        "Extension_Release", "Controller_Disconnect",
    ]  # fmt: skip
    assert set(wire.sent) == set(range(1, 138))
    assert set(wire.codes) == {hresult.S_OK}
    assert len(wire.codes) == len(wire.sent)


def test_every_function_is_reached_by_a_raw_call(both: Both, server: Server, recorder: Recorder) -> None:
    wire = Wire()
    client = both.client(server.url, trace=wire, timeout=PATIENT)

    def call(function: Any, *arguments: Any) -> Any:
        return both.run(client.call(function, *arguments))

    assert call(f.service_start) is None
    handles = {"Controller": call(f.controller_connect, "RC", PROVIDER, "localhost", "")}
    for interface, (method, *names) in WHERE.items():
        handles[interface] = call(BY_NAME[f"Controller_Get{method.capitalize()}"], handles["Controller"], *names)
    assert sorted(handles.values()) == list(range(2, 10))  # handles count up from 2 (RC8 3.1.2)
    last: Any = None
    for function in FUNCTIONS.values():
        if function.interface == "Service" or function.releases or function is f.controller_connect:
            continue
        values = [sample(argument) for argument in function.arguments[1:]]
        del recorder.calls[:]
        result = call(function, handles[function.interface], *values)
        assert recorder.calls == [Call(function.name, path_of(function.interface), tuple(values))]
        if function.creates:
            last = result
            assert call(BY_NAME[f"{function.creates}_Release"], result) is None
        else:
            assert result == answer(function, path_of(function.interface), values)
            named = {argument.name: sample(argument) for argument in function.arguments[1:]}
            assert both.run(client.call(function, handle=handles[function.interface], **named)) == result
    with pytest.raises(InvalidHandle):
        call(f.variable_get_value, last)
    for interface, handle in reversed(handles.items()):
        release = next(entry for entry in FUNCTIONS.values() if entry.interface == interface and entry.releases)
        assert call(release, handle) is None
        with pytest.raises(InvalidHandle):
            call(release, handle)
    assert call(f.service_stop) is None
    assert set(wire.sent) == set(range(1, 138))
    both.run(client.close())


@pytest.mark.parametrize(
    ("interface", "use", "arrives"),
    [
        ("Controller", lambda o: o.execute("ClearError"), Call("Controller_Execute", "RC", ("ClearError", None))),
        ("Controller", lambda o: o.variable("V"), Call("Controller_GetVariable", "RC", ("V", ""))),
        ("Controller", lambda o: o.robot(), Call("Controller_GetRobot", "RC", ("Arm", ""))),
        ("Controller", lambda o: o.variable_names(), Call("Controller_GetVariableNames", "RC", ("",))),
        ("Robot", lambda o: o.move(1, "@E P1"), Call("Robot_Move", "RC/Arm", (1, "@E P1", ""))),
        ("Robot", lambda o: o.halt(), Call("Robot_Halt", "RC/Arm", ("",))),
        ("Robot", lambda o: o.execute("Motor", [1, 0]), Call("Robot_Execute", "RC/Arm", ("Motor", [1, 0]))),
        ("Robot", lambda o: o.speed(-1, 50), Call("Robot_Speed", "RC/Arm", (-1, 50.0))),
        ("Task", lambda o: o.start(), Call("Task_Start", "RC/Pro1", (1, ""))),
        ("Task", lambda o: o.stop(), Call("Task_Stop", "RC/Pro1", (0, ""))),
        ("Command", lambda o: o.execute(), Call("Command_Execute", "RC/Cmd", (0,))),
        ("Message", lambda o: o.reply(), Call("Message_Reply", "RC/message", (None,))),
        ("File", lambda o: o.copy("b.pcs"), Call("File_Copy", "RC/プログラム.pcs", ("b.pcs", ""))),
        ("Variable", lambda o: o.put_value(True), Call("Variable_PutValue", "RC/IO150", (True,))),
        ("Variable", lambda o: o.put_id(5), Call("Variable_PutID", "RC/IO150", (5,))),
    ],
)
def test_optional_arguments(
    both: Both, server: Server, recorder: Recorder, interface: str, use: Callable[[Any], Any], arrives: Call
) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    thing = open_object(both, controller, interface)
    both.run(use(thing))
    assert recorder.calls[-1] == arrives
    both.run(controller.close())


def test_properties_of_the_synchronous_client(server: Server, recorder: Recorder) -> None:
    """On all objects, reading ``x`` calls ``get_x``, and setting it calls ``put_x``."""
    with orinkit.connect(server.url, provider=PROVIDER, name="RC") as controller:
        both, checked = Both("sync"), 0
        for interface in ("Controller", *WHERE):
            thing = open_object(both, controller, interface)
            for function in FUNCTIONS.values():
                getter = function.interface == interface and function.method.startswith("get_")
                if getter and not function.creates and not function.name.endswith("Names"):
                    name = function.method.removeprefix("get_")
                    assert getattr(thing, name) == answer(function, path_of(interface), ())
                    checked += 1
                    setter = next(
                        (e for e in FUNCTIONS.values() if e.method == f"put_{name}" and e.interface == interface), None
                    )
                    if setter is not None:
                        value = sample(setter.arguments[1])
                        setattr(thing, name, value)
                        assert recorder.calls[-1] == Call(setter.name, path_of(interface), (value,))
                    else:
                        with pytest.raises(AttributeError):
                            setattr(thing, name, 1)
        assert checked == 57


# --- release --------------------------------------------------------------------------------------------------------


def releases(recorder: Recorder) -> list[str]:
    return [call.path for call in recorder.calls if call.function.endswith(("Release", "Disconnect"))]


def test_the_controller_releases_everything_newest_first(both: Both, server: Server, recorder: Recorder) -> None:
    wire = Wire()
    controller = both.connect(server.url, provider=PROVIDER, name="RC", trace=wire, timeout=PATIENT)
    first = both.run(controller.variable("a"))
    robot = both.run(controller.robot("Arm"))
    below = both.run(robot.variable("b"))
    task = both.run(controller.task("Pro1"))
    both.run(controller.close())
    assert releases(recorder) == ["RC/Pro1", "RC/Arm/b", "RC/Arm", "RC/a", "RC"]
    assert wire.sent[-6:] == [99, 111, 84, 111, 4, 2]  # one call each, Service_Stop last
    assert all("closed" in repr(thing) for thing in (first, robot, below, task, controller))


def test_closing_twice_is_no_error_and_releases_once(both: Both, server: Server, recorder: Recorder) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(controller.variable("a"))
    for _ in range(3):
        both.run(variable.close())
    assert releases(recorder) == ["RC/a"]
    for _ in range(3):
        both.run(controller.close())
    both.run(variable.close())
    assert releases(recorder) == ["RC/a", "RC"]
    with pytest.raises(ObjectReleased, match="closed"):
        both.run(controller.execute("x"))


def test_a_closed_parent_closes_its_children(both: Both, server: Server, recorder: Recorder) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    robot = both.run(controller.robot("Arm"))
    variable = both.run(robot.variable("b"))
    both.run(robot.close())
    assert releases(recorder) == ["RC/Arm/b", "RC/Arm"]
    with pytest.raises(ObjectReleased):
        both.run(variable.get_value())
    with pytest.raises(ObjectReleased):
        both.run(robot.variable("c"))
    assert "Variable_GetValue" not in [call.function for call in recorder.calls]
    both.run(variable.close())
    assert releases(recorder) == ["RC/Arm/b", "RC/Arm"]
    both.run(controller.close())


def test_an_object_is_not_copied(both: Both, server: Server) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(controller.variable("a"))
    for copier in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="cannot be copied"):
            copier(variable)
    both.run(controller.close())


def test_a_misspelt_attribute_is_an_error(both: Both, server: Server) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(controller.variable("a"))
    for name in ("Value", "valeu"):
        with pytest.raises(AttributeError):
            setattr(variable, name, 5)
    both.run(controller.close())


def test_with_releases(both: Both, server: Server, recorder: Recorder) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(controller.variable("a"))
    both.within(variable, lambda entered: both.run(entered.put_value(1)))
    assert releases(recorder) == ["RC/a"]

    class Trouble(Exception):
        pass

    def fail(_: Any) -> None:
        raise Trouble

    with pytest.raises(Trouble):
        both.within(both.run(controller.robot("Arm")), fail)
    assert releases(recorder) == ["RC/a", "RC/Arm"]
    with pytest.raises(Trouble):
        both.within(controller, fail)
    assert releases(recorder) == ["RC/a", "RC/Arm", "RC"]
    with pytest.raises(ConnectionClosed):
        both.run(controller.client.call(f.service_start))


def test_async_with_opens_and_closes(server: Server, recorder: Recorder) -> None:
    async def body() -> None:
        async with aio.connect(server.url, provider=PROVIDER, name="RC", dialect="rc8") as controller:
            async with await controller.variable("a") as variable:
                await variable.put_value(1)
            assert releases(recorder) == ["RC/a"]
        assert releases(recorder) == ["RC/a", "RC"]
        async with aio.open_client(server.url) as client:
            assert await client.call(f.service_start) is None
        with pytest.raises(ConnectionClosed):
            await client.call(f.service_start)

    asyncio.run(body())


def test_a_broken_connection_does_not_disturb_closing(both: Both, server: Server, recorder: Recorder) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(controller.variable("a"))
    both.run(controller.client.close())
    both.run(variable.close())
    both.run(controller.close())
    assert recorder.wait_for(Call("Controller_Disconnect", "RC", ()))
    assert releases(recorder) == ["RC/a", "RC"]  # by the server, after the client has disconnected


def test_deleted_objects_are_released_before_the_next_one_is_created(
    both: Both, server: Server, recorder: Recorder
) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    for name in ("a", "b", "c"):
        both.run(controller.variable(name))
        gc.collect()
    assert releases(recorder) == ["RC/a", "RC/b"]
    both.run(controller.close())
    assert releases(recorder) == ["RC/a", "RC/b", "RC/c", "RC"]


def test_a_parent_lives_as_long_as_its_children(both: Both, server: Server, recorder: Recorder) -> None:
    controller = both.connect(server.url, provider=PROVIDER, name="RC")
    variable = both.run(both.run(controller.robot("Arm")).variable("b"))
    gc.collect()
    both.run(controller.variable("c"))
    assert releases(recorder) == []
    assert both.run(variable.get_value()) == answer(f.variable_get_value, "RC/Arm/b", ())
    both.run(controller.close())


@only("tcp", because="the count of objects is independent of the transport")
def test_three_thousand_writes_in_a_row_do_not_hit_the_object_limit(both: Both, server: Server) -> None:
    controller = both.connect(server.url)
    for number in range(3000):
        if both.kind == "sync":
            controller.variable("IO150").value = number % 2 == 0
        else:
            both.run(both.run(controller.variable("IO150")).put_value(number % 2 == 0))
    assert both.run(both.run(controller.variable("IO150")).get_value()) is False
    both.run(controller.close())


def test_the_object_limit_is_reported_and_the_connection_stays_usable(
    both: Both, listen_at: str, recorder: Recorder
) -> None:
    with orinkit.serve(recorder, listen_at, objects=10) as server:
        controller = both.connect(server.url, provider=PROVIDER, name="RC")
        kept = [both.run(controller.variable(f"v{number}")) for number in range(9)]
        with pytest.raises(CallError) as caught:
            both.run(controller.variable("one more"))
        assert caught.value.code == hresult.E_MAX_OBJECT
        both.run(kept.pop().close())
        both.run(controller.variable("one more"))
        both.run(controller.close())


# --- addresses ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("listen_at", "form"),
    [("tcp", "tcp://127.0.0.1:{}"), ("tcp", "tcp:127.0.0.1:{}"), ("tcp", "127.0.0.1:{}"), ("tcp", "TCP://localhost:{}/"),
     ("tcp", " tcp:127.0.0.1:{} "), ("http", "http://127.0.0.1:{}/"), ("http", "http://127.0.0.1:{}/any/path?x=1"),
     ("http", "HTTP://localhost:{}"), ("http", " http://127.0.0.1:{} ")],
    indirect=["listen_at"],
)  # fmt: skip
def test_connection_strings(both: Both, server: Server, form: str) -> None:
    port = server.url.rpartition(":")[2]
    controller = both.connect(form.format(port), provider=PROVIDER)
    assert isinstance(both.run(controller.get_name()), str)
    both.run(controller.close())


@pytest.mark.parametrize(
    "url",
    ["", "tcp://", "tcp:", "tcp://:5007", "tcp://127.0.0.1:notaport", "tcp://127.0.0.1:65536", "tcp://127.0.0.1:-1",
     "udp://", "com:", "pty://", "gopher://127.0.0.1", "tcp://127.0.0.1:5007/path", "tcp://[::1", "tcp://a b:c:d",
     "http://", "https:", "http://:8080", "http://127.0.0.1:notaport", "https://127.0.0.1:65536", "http://[::1"],
)  # fmt: skip
def test_wrong_connection_strings(both: Both, url: str) -> None:
    with pytest.raises(InvalidAddress) as caught:
        both.connect(url)
    assert repr(url) in str(caught.value)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("scheme", ["tcp", "http"])
def test_a_name_that_does_not_exist(both: Both, scheme: str) -> None:
    with pytest.raises(ConnectFailed, match=r"robot\.invalid"):
        both.connect(f"{scheme}://robot.invalid:5007", timeout=20)


@pytest.mark.parametrize("scheme", ["tcp", "http"])
def test_ipv6(both: Both, recorder: Recorder, scheme: str) -> None:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        pytest.skip("this machine has no IPv6")
    with orinkit.serve(recorder, f"{scheme}://[::1]:0") as server:
        assert server.url.startswith(f"{scheme}://[::1]:")
        controller = both.connect(server.url, provider=PROVIDER)
        both.run(controller.close())


@pytest.mark.parametrize("timeout", [0, -1, float("inf"), float("nan"), 1e300])
@only("tcp", because="it is the same check")
def test_wrong_timeouts(both: Both, server: Server, timeout: float) -> None:
    with pytest.raises(InvalidValue, match="timeout"):
        both.connect(server.url, timeout=timeout)
    client = both.client(server.url)
    with pytest.raises(InvalidValue, match="timeout"):
        both.run(client.request(f.service_start, timeout=timeout))
    both.run(client.close())


# --- trace, requests with code, errors ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("listen_at", "sent", "answered"),
    [
        (
            "tcp",
            bytes.fromhex("012c00000001000000010000000100180000000800010000000e0000005700440054003d0034003000300004"),
            bytes.fromhex("01100000000100000000000000000004"),
        ),
        ("http", b"Func=1,Arg1=WDT%3D400,Arg2=,Arg3=,Arg4=,Arg5=", b"0x00000000"),
    ],
    indirect=["listen_at"],
    ids=["tcp", "http"],
)
def test_trace_shows_every_packet(both: Both, server: Server, sent: bytes, answered: bytes) -> None:
    """For the bytes on UDP and serial lines, see tests/bcap."""
    seen: list[tuple[str, bytes]] = []
    client = both.client(server.url, trace=lambda direction, data: seen.append((direction, data)))
    both.run(client.call(f.service_start, "WDT=400"))
    assert seen == [(">", sent), ("<", answered)]
    both.run(client.close())


def test_request_returns_code_and_exact_type(both: Both, server: Server) -> None:
    client = both.client(server.url)
    controller = both.run(client.call(f.controller_connect, "", orinkit.client._shared.common.RC8, "localhost"))
    variable = both.run(client.call(f.controller_get_variable, controller, "IO150"))
    reply = both.run(client.request(f.variable_get_value, variable, exact=True))
    assert (reply.code, reply.value) == (0, orinkit.Variant(VarType.BOOL, False))
    assert both.run(client.request(f.variable_get_value, variable)) == (0, False)
    both.run(client.close())


def test_an_error_has_all_details(both: Both, server: Server) -> None:
    controller = both.connect(server.url, provider="Test.Workshop")
    with pytest.raises(CallError) as caught:
        both.run(controller.execute("Fail", hresult.signed(hresult.E_ACCESSDENIED)))
    error = caught.value
    assert (error.function, error.code) == ("Controller_Execute", hresult.E_ACCESSDENIED)
    assert error.arguments == (controller.handle, "Fail", hresult.signed(hresult.E_ACCESSDENIED))
    for part in ("Controller_Execute(", "'Fail'", "0x80070005", "E_ACCESSDENIED", error.info.text, error.info.hint):
        assert part in str(error)
    english = str(error)
    i18n.use("ja")
    assert str(error) != english
    assert error.info.text in str(error)
    assert any("ぁ" <= sign <= "ヿ" or "一" <= sign <= "鿿" for sign in str(error))
    i18n.use("en")
    with pytest.raises(NotImplementedCall):
        both.run(controller.execute("no such command"))
    for command in ("Crash", "CrashLater", "CrashBlocking"):
        with pytest.raises(CallError) as caught:
            both.run(controller.execute(command))
        assert caught.value.code == hresult.E_FAIL
    assert both.run(controller.execute("Echo", "still there")) == "still there"
    both.run(controller.close())


@pytest.mark.parametrize(
    ("function", "arguments", "error", "words"),
    [
        (f.controller_execute, (1, "x", 2**40), InvalidValue, "Controller_Execute"),
        (f.controller_execute, (1, "x", object()), InvalidValue, "object"),
        (f.controller_execute, (1, 5, None), InvalidValue, "command"),
        (f.controller_execute, ("1", "x", None), InvalidValue, "handle"),
        (f.controller_execute, (2**31, "x", None), InvalidValue, "handle"),
        (f.robot_speed, (1, 1, "fast"), InvalidValue, "speed"),
        (f.robot_speed, (1, 1, 1e39), InvalidValue, "speed"),
        (f.robot_speed, (1, 1.5, 1), InvalidValue, "axis"),
        (f.controller_execute, (1,), TypeError, "command"),
        (f.controller_execute, (1, "x", None, "more"), TypeError, "4"),
    ],
)
def test_a_bad_argument_is_refused_before_anything_is_sent(
    both: Both, server: Server, function: Any, arguments: tuple[Any, ...], error: type[Exception], words: str
) -> None:
    sent = []
    client = both.client(server.url, trace=lambda direction, _: sent.append(direction))
    with pytest.raises(error, match=words):
        both.run(client.call(function, *arguments))
    assert sent == []
    assert both.run(client.call(f.service_start)) is None
    both.run(client.close())


def test_an_unknown_named_argument(both: Both, server: Server) -> None:
    client = both.client(server.url)
    with pytest.raises(TypeError, match="colour"):
        both.run(client.call(f.controller_execute, handle=1, command="x", colour="red"))
    with pytest.raises(TypeError, match="command"):
        both.run(client.call(f.controller_execute, 1, "x", command="y"))
    both.run(client.close())


@only("tcp", "http", because="other transports report S_EXECUTING to repeated requests, so the call does not time out")
def test_errors_survive_pickling(both: Both, server: Server) -> None:
    caught: list[Exception] = []
    controller = both.connect(server.url, provider="Test.Workshop", timeout=20)
    for call in (
        lambda: controller.execute("Fail", hresult.signed(0x83500121)),
        lambda: controller.client.call(f.variable_get_value, 999),
        lambda: controller.client.request(f.controller_execute, controller.handle, "Wait", timeout=0.05),
    ):
        with pytest.raises(OrinError) as info:
            both.run(call())
        caught.append(info.value)
    both.run(controller.close(deadline=0.5))  # the server still executes Wait
    with pytest.raises(OrinError) as info:
        both.run(controller.execute("Echo"))
    caught += [info.value, ProtocolError("no packet", 0x80010000, fatal=True), InvalidValue("no"), InvalidAddress("no")]
    for error in caught:
        copy = pickle.loads(pickle.dumps(error))
        assert type(copy) is type(error)
        assert (str(copy), vars(copy)) == (str(error), vars(error))
    assert [type(error) for error in caught[:4]] == [
        orinkit.core.errors.ProgramError,
        InvalidHandle,
        CallTimeout,
        ObjectReleased,
    ]


def test_errors_that_are_cleared_concurrently_end_the_list(both: Both, listen_at: str) -> None:
    class Shrinking(VirtualRC8):
        def connect(self, *arguments: Any) -> Any:
            made = super().connect(*arguments)
            execute = made.execute

            def clear_after_count(command: str, parameter: Any) -> Any:
                answer = execute(command, parameter)
                if command == "GetCurErrorCount":
                    self.clear_errors()
                return answer

            made.execute = clear_after_count
            return made

    virtual = Shrinking()
    with orinkit.serve(virtual, listen_at) as server:
        controller = both.connect(server.url)
        virtual.raise_error(0x83500121)
        assert both.run(controller.errors()) == []
        both.run(controller.close())


def test_errors_and_clear_error_of_the_virtual_rc8(both: Both, listen_at: str) -> None:
    virtual = VirtualRC8()
    with orinkit.serve(virtual, listen_at) as server:
        controller = both.connect(server.url)
        assert both.run(controller.errors()) == []
        virtual.raise_error(0x83500121)
        errors = both.run(controller.errors())
        assert [error.code for error in errors] == [0x83500121]
        assert "0x83500121" in str(errors[0])
        assert both.run(controller.error_description(0x83500121))
        message = both.run(controller.message())
        assert message is not None
        assert both.run(message.get_description())
        both.run(controller.clear_error())
        assert both.run(controller.errors()) == []
        while (message := both.run(controller.message())) is not None:
            both.run(message.close())
        both.run(controller.close())
