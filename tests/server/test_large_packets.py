"""No packet blocks the event loop, regardless of its content: other clients, motions and the emergency stop continue."""

from __future__ import annotations

import asyncio
import http.client
import threading
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.core import hresult
from orinkit.server.capacity import CallMemory, MemoryBudget
from orinkit.server.http.exchange import PIECE, Exchange
from orinkit.server.threaded import Server
from orinkit.values.variant import ARRAY, VarType
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.objects.controller_commands import COMMANDS
from orinkit.virtual.rc8.objects.robot_commands import ROBOT_COMMANDS
from support.devices import Workshop
from support.large_values import MOST, argument, arrays, ask, text, texts
from support.peers import RawClient
from support.waiting import PATIENCE
from support.watching import watched

VALUES = dict([*texts(), *arrays()])
FEW = ("text of control characters", "text of surrogates", "VT_UI1", "I2", "DATE", "texts", "nothings", "deep")


@pytest.fixture
def server() -> Iterator[Server]:
    with orinkit.serve(VirtualRC8(motor=True, language="en"), "tcp://127.0.0.1:0", "http://127.0.0.1:0") as server:
        yield server


@pytest.fixture
def client(server) -> Iterator[RawClient]:
    with RawClient(server.urls[0]) as client:
        yield client


def call(name: str) -> int:
    return BY_NAME[name].id


def connect(client: RawClient) -> int:
    return int(client.ask(call("Controller_Connect"), "", "CaoProv.DENSO.VRC", "", ""))


@pytest.mark.parametrize("name", FEW)
def test_a_large_value_does_not_block_the_server(server, client, name):
    handle = connect(client)
    variable = client.ask(call("Controller_GetVariable"), handle, "S1", "")
    robot = client.ask(call("Controller_GetRobot"), handle, "Arm0", "")
    value = VALUES[name]
    with watched(server) as watch:
        for watch.label, function, *arguments in (
            ("tag", "Controller_PutTag", handle, value),
            ("tag read", "Controller_GetTag", handle),
            ("tag forgotten", "Controller_PutTag", handle, None),
            ("variable", "Variable_PutValue", variable, value),
            ("move", "Robot_Move", robot, 1, value, ""),
            ("command", "Controller_Execute", handle, "GetErrorDescription", value),
        ):
            ask(client, call(function), *arguments)
    watch.check()


@pytest.mark.parametrize(
    "name", ["text of control characters", pytest.param("text of surrogates", marks=pytest.mark.soak)]
)
def test_a_name_or_option_of_megabytes_is_rejected_immediately(server, client, name):
    handle = connect(client)
    long = VALUES[name]
    with watched(server) as watch:
        for watch.label, function, *arguments in (
            ("option", "Service_Start", long),
            ("name", "Controller_Connect", long, "CaoProv.DENSO.VRC", "", ""),
            ("provider", "Controller_Connect", "x", long, "", ""),
            ("machine", "Controller_Connect", "x", "CaoProv.DENSO.VRC", long, ""),
            ("name of a variable", "Controller_GetVariable", handle, long, ""),
            ("option of a variable", "Controller_GetVariable", handle, "I1", long),
            ("command", "Controller_Execute", handle, long, None),
        ):
            assert ask(client, call(function), *arguments) == hresult.E_INVALIDARG
    watch.check()


def test_the_longest_name_and_the_longest_option(client):
    handle = connect(client)
    find = call("Controller_GetVariable")
    assert client.ask(find, handle, "x" * 1024, "") == hresult.E_CAO_OBJECT_NOTFOUND
    assert client.ask(find, handle, "x" * 1025, "") == hresult.E_INVALIDARG
    assert client.ask(find, handle, "I1", "x" * 4096) < 0x8000_0000
    assert client.ask(find, handle, "I1", "x" * 4097) == hresult.E_INVALIDARG


def test_a_large_result_does_not_block_the_server(server, client):
    handle = connect(client)
    file = client.ask(call("Controller_GetFile"), handle, "large.txt", "@Create=1")
    content = "text, " * 500_000
    with watched(server) as watch:
        assert client.ask(call("File_PutValue"), file, content) is None
        for _ in range(3):
            assert client.ask(call("File_GetValue"), file) == content
    watch.check()


@pytest.mark.parametrize(
    ("scheme", "value"), [("tcp", "\ud800" * 3_000_000), ("http", [1.5] * 700_000)], ids=["tcp", "http"]
)
def test_a_result_that_is_slow_to_encode_does_not_block_the_server(scheme, value):
    with (
        orinkit.serve(Workshop(), f"{scheme}://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Workshop", timeout=PATIENCE) as workshop,
        watched(server) as watch,
    ):
        assert workshop.execute("Echo", value) == value
    watch.check()


def test_a_large_body_is_sent_in_pieces():
    sent = []

    async def send(message):
        sent.append(message.get("body", b""))

    exchange = Exchange({"headers": [], "state": {"connection": None}}, None, send, CallMemory(MemoryBudget()))
    body = bytes(range(256)) * 20_000
    asyncio.run(exchange.answer(body, 0, ""))
    assert b"".join(sent) == body
    assert max(map(len, sent)) <= PIECE


def test_requests_after_a_large_one_are_answered_in_order(client):
    handle = connect(client)
    large = "x" * 20_000
    for _ in range(20):
        client.request(call("Controller_PutTag"), handle, large)
        client.request(call("Controller_GetTag"), handle)
    for _ in range(20):
        assert client.packet().arguments == []
        assert client.packet().arguments == [large]


def test_a_client_that_disconnects_while_its_packet_is_decoded(server):
    for _ in range(5):
        with RawClient(server.urls[0]) as leaving:
            handle = connect(leaving)
            leaving.request(call("Controller_PutTag"), handle, ["text"] * 40_000)
    with RawClient(server.urls[0]) as client:
        assert client.ask(call("Controller_PutTag"), connect(client), "x" * 10_000) is None


@pytest.mark.parametrize(
    "body",
    [
        b"," * MOST, b"8197" + b",1" * 700_000, b"8199" + b",2026-11-21 10:00:00.5" * 49_000, b"8,%1b" * 3_000_000,
        b'8204,(8,"' + b'""' * 4_000_000 + b'")', b"8200" + b',"a,b"' * 49_000,
        b"8204" + (b",(8204" * 14 + b",(3,1)" + b")" * 14) * 3_300,
    ],
    ids=["commas", "numbers", "dates", "escapes", "quotes", "texts", "deep"],
)  # fmt: skip
def test_a_large_body_over_http_does_not_block_the_server(server, body):
    place = server.urls[1].partition("//")[2].strip("/")
    connection = http.client.HTTPConnection(place, timeout=PATIENCE)
    headers = {"Content-Type": "application/x-www-form-urlencoded"}

    def post(data: bytes) -> bytes:
        connection.request("POST", "/", data, headers)
        answer = connection.getresponse()
        cookie = answer.getheader("set-cookie")
        if cookie:
            headers["Cookie"] = cookie.partition(";")[0]
        return answer.read()

    handle = post(b"Func=3,Arg1=,Arg2=CaoProv.DENSO.VRC,Arg3=,Arg4=").rpartition(b",")[2]
    with watched(server) as watch:
        for watch.label in ("whole", "tag", "tag read", "name", "command"):
            post(
                {
                    "whole": body,
                    "tag": b"Func=%d,Arg1=%b,Arg2=%b" % (call("Controller_PutTag"), handle, body),
                    "tag read": b"Func=%d,Arg1=%b" % (call("Controller_GetTag"), handle),
                    "name": b"Func=%d,Arg1=%b,Arg2=%b" % (call("Controller_GetVariable"), handle, body),
                    "command": b"Func=%d,Arg1=%b,Arg2=GetErrorDescription,Arg3=%b"
                    % (call("Controller_Execute"), handle, body),
                }[watch.label]
            )
    connection.close()
    watch.check()


def attack(url: str, stopped: threading.Event) -> None:
    name, dates = text("\x1b", 6_000_000), VALUES["DATE"]  # eight of them are within the server's memory budget
    with RawClient(url) as client:
        handle = connect(client)
        while not stopped.is_set():
            ask(client, call("Controller_GetVariable"), handle, name, "")
            ask(client, call("Controller_PutTag"), handle, dates)


def test_the_emergency_stop_while_eight_clients_send_large_packets():
    from orinkit.virtual.rc8.control import PROVIDER_NAME, ControlProvider

    rc8 = VirtualRC8(motor=True, language="en")
    stopped = threading.Event()
    buttons = ControlProvider(rc8)
    option = f"Secret={buttons.secret}"
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
        orinkit.serve(buttons, "tcp://127.0.0.1:0") as control,
        orinkit.connect(control.url, provider=PROVIDER_NAME, option=option, timeout=PATIENCE) as pendant,
    ):
        attackers = [threading.Thread(target=attack, args=(server.url, stopped)) for _ in range(8)]
        for each in attackers:
            each.start()
        try:
            with watched(server) as watch:
                for on in (True, False) * 5:
                    pendant.execute("EmergencyStop", on)
        finally:
            stopped.set()
            for each in attackers:
                each.join()
    watch.check()


# --- all functions and commands (make soak) ---------------------------------------------------------------------------


@pytest.mark.soak
@pytest.mark.parametrize("name", list(VALUES))
def test_no_value_of_any_argument_blocks_the_server(server, client, name):
    handle = connect(client)
    objects = {
        "Controller": handle,
        "Robot": client.ask(call("Controller_GetRobot"), handle, "Arm0", ""),
        "Variable": client.ask(call("Controller_GetVariable"), handle, "S1", ""),
        "File": client.ask(call("Controller_GetFile"), handle, "large.pcs", "@Create=1"),
        "Task": client.ask(call("Controller_GetTask"), handle, "large", ""),
        "Extension": client.ask(call("Controller_GetExtension"), handle, "Hand0", ""),
        "Command": client.ask(call("Controller_GetCommand"), handle, "Robot.Motor", ""),
    }
    commands = {"Controller": list(COMMANDS), "Robot": list(ROBOT_COMMANDS)}
    with watched(server, strict=True) as watch:
        for function in FUNCTIONS.values():
            positions = [number for number, each in enumerate(function.arguments) if each.vt is VarType.VARIANT]
            if not positions or function.interface not in objects:
                continue
            for command in commands.get(function.interface, ["x"]) if function.name.endswith("_Execute") else [""]:
                watch.label = f"{function.name} {command}"
                given = [command or "" if each.vt is VarType.BSTR else 1 for each in function.arguments]
                given[0] = objects[function.interface]
                ask(client, function.id, *given[: positions[0]], VALUES[name], *given[positions[0] + 1 :])
    watch.check()


CONTENTS = {
    "large.txt of UTF-8": "あ".encode() * (MOST // 3),
    "large.txt of Shift_JIS": "あ".encode("cp932") * (MOST // 2),
    "large.bin of zeros": bytes(MOST),
}


@pytest.mark.soak
@pytest.mark.parametrize("name", list(CONTENTS))
def test_no_file_blocks_the_server(server, client, name):
    handle = connect(client)
    file = client.ask(call("Controller_GetFile"), handle, name.split()[0], "@Create=1")
    content = CONTENTS[name]
    with watched(server, strict=True) as watch:
        for watch.label, function, *arguments in (
            ("write", "File_PutValue", argument(VarType.UI1 | ARRAY, len(content), content)),
            ("read", "File_GetValue"),
            ("copy", "File_Copy", "copy.txt", ""),
        ):
            assert ask(client, call(function), file, *arguments) in (hresult.S_OK, hresult.E_TOO_MUCH_DATA)
    watch.check()


def test_the_encoding_of_an_argument():
    assert argument(VarType.I4, 1, b"\5\0\0\0") == orinkit.values.codec.encode(5)
