"""Errors of a gateway's clients after the loss of the controller, and reconnection."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import orinkit
from orinkit import functions
from orinkit.bcap.packet import Packet
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.gateway import RemoteProvider, Upstream
from orinkit.gateway.connection import UpstreamConnection
from orinkit.gateway.upstream import ConnectRequest
from orinkit.values.codec import PacketLimits
from orinkit.virtual.rc8 import VirtualRC8
from support.codes import code_of
from support.devices import Call, Recorder, Workshop
from support.gateways import HTTP, LISTEN, PATIENCE, gateway, hurry
from support.peers import BadPeer, Line, reply
from support.waiting import until

FIRST_HANDLE = 2
ATTRIBUTE = 19
AWAY = (hresult.E_CAO_REMOTE_PROVIDER, hresult.E_NOT_CONNECTED)


class RestartableServer:
    """A server that can be stopped and restarted at the same address."""

    def __init__(self, provider: Provider, listen: str) -> None:
        self.server = orinkit.serve(provider, listen)
        self.url = self.server.url

    def start(self, provider: Provider) -> None:
        self.server = orinkit.serve(provider, self.url)


@contextmanager
def controller(provider: Provider, listen: str = LISTEN) -> Iterator[RestartableServer]:
    made = RestartableServer(provider, listen)
    try:
        yield made
    finally:
        made.server.close()


def test_a_controller_that_is_restarted_between_two_calls() -> None:
    first, second = Recorder(), Recorder()
    with controller(first) as device, gateway(device.url, retry=0.02) as url:
        with orinkit.connect(url, provider="Test.Recorder", name="cell", option="mine") as rc8:
            robot = rc8.robot("Arm", "ID=1")
            variable = robot.variable("v")
            other = robot.variable("other")
            assert variable.value
            device.server.close()
            assert code_of(variable.get_value) == hresult.E_NOT_CONNECTED
            assert code_of(variable.get_value) == hresult.E_CAO_REMOTE_PROVIDER
            device.start(second)
            until(lambda: code_of(variable.get_value) == 0)
            assert other.name.startswith("Variable_GetName|cell/Arm/other")
            assert second.calls == [
                Call("Controller_Connect", "", ("cell", "localhost", "mine")),
                Call("Controller_GetRobot", "cell", ("Arm", "ID=1")),
                Call("Robot_GetVariable", "cell/Arm", ("v", "")),
                Call("Variable_GetValue", "cell/Arm/v", ()),
                Call("Robot_GetVariable", "cell/Arm", ("other", "")),
                Call("Variable_GetName", "cell/Arm/other", ()),
            ]
        assert second.wait_for(Call("Controller_Disconnect", "cell", ()))
        assert {call.path for call in second.calls if call.function.endswith("_Release")} == {
            "cell/Arm/other", "cell/Arm/v", "cell/Arm",
        }  # fmt: skip


def test_a_controller_over_http_that_is_restarted() -> None:
    first, second = Recorder(), Recorder()
    with (
        controller(first, HTTP) as device,
        gateway(device.url, retry=0.02) as url,
        orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8,
    ):
        variable = rc8.robot("Arm").variable("v")
        device.server.close()
        assert code_of(variable.get_value) in AWAY
        assert code_of(variable.get_value) == hresult.E_CAO_REMOTE_PROVIDER
        device.start(second)
        until(lambda: code_of(variable.get_value) == 0)
    assert [call.function for call in second.calls[:4]] == [
        "Controller_Connect", "Controller_GetRobot", "Robot_GetVariable", "Variable_GetValue",
    ]  # fmt: skip


def test_objects_that_were_not_restored_are_not_released() -> None:
    first, second = Recorder(), Recorder()
    with (
        controller(first) as device,
        gateway(device.url, retry=0.02) as url,
        orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8,
    ):
        gone, stays = rc8.variable("gone"), rc8.variable("stays")
        device.server.close()
        device.start(second)
        until(lambda: code_of(stays.get_value) == 0)
        gone.close()
        stays.close()
        assert rc8.name
    assert [call.function for call in second.calls if call.function != "Variable_GetValue"][1:] == [
        "Controller_GetVariable", "Variable_Release", "Controller_GetName", "Controller_Disconnect",
    ]  # fmt: skip


class Scripted:
    """A peer that replies like a controller, except to one selected call."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def answer(self, request: Packet) -> bytes:
        self.seen.append(functions.FUNCTIONS[request.code].name)
        creates = functions.FUNCTIONS[request.code].creates
        self.handle = getattr(self, "handle", FIRST_HANDLE) + 1
        if creates:
            return reply(request, self.handle)
        return reply(request, *([] if request.code in (1, 2, 102) else ["value"]))

    def until(self, function: str, bad: Any) -> Any:
        def script(line: Line) -> None:
            while True:
                request = line.request()
                if functions.FUNCTIONS[request.code].name == function:
                    self.seen.append(function)
                    bad(line)
                    return
                line.send(self.answer(request))

        return script

    def serve(self, line: Line) -> None:
        line.serve(self.answer)


@pytest.mark.parametrize("end", [Line.reset, Line.close, lambda line: line.send(b"\x01\xff\xff\xff\xff" + bytes(20))])
def test_the_interrupted_call_is_never_repeated(end: Any) -> None:
    script = Scripted()
    with (
        BadPeer(script.until("Variable_PutValue", end), script.serve) as peer,
        gateway(peer.url, retry=0.02) as url,
        orinkit.connect(url, name="cell") as rc8,
    ):
        variable = rc8.variable("v")
        with pytest.raises(CallError) as failed:
            variable.put_value(1)
        assert failed.value.code == hresult.E_NOT_CONNECTED
        assert script.seen.count("Variable_PutValue") == 1
        until(lambda: code_of(variable.get_value) == 0)
        assert script.seen.count("Variable_PutValue") == 1
        assert script.seen[-4:] == [
            "Service_Start",
            "Controller_Connect",
            "Controller_GetVariable",
            "Variable_GetValue",
        ]
        assert peer.connections == 2


def test_a_controller_that_is_stopped_during_a_call() -> None:
    first, second = Workshop(), Workshop()
    with (
        controller(first) as device,
        gateway(device.url, retry=0.02) as url,
        orinkit.connect(url, provider="Test.Workshop") as shop,
    ):
        codes: list[int] = []
        work = threading.Thread(target=lambda: codes.append(code_of(lambda: shop.execute("Wait", 1))))
        work.start()
        assert first.at_work.acquire(timeout=PATIENCE)
        device.server.close()
        work.join(PATIENCE)
        assert codes == [hresult.E_NOT_CONNECTED]
        device.start(second)
        until(lambda: code_of(lambda: shop.execute("Echo", 2)) == 0)
        assert not second.at_work.acquire(timeout=0)


def test_the_texts_of_the_errors(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "orinkit.session")
    script = Scripted()
    with BadPeer(script.until("Variable_PutValue", Line.reset)) as peer, gateway(peer.url, retry=60.0) as url:
        place = peer.url
        with orinkit.connect(url) as rc8:
            variable = rc8.variable("v")
            for _ in range(2):
                with pytest.raises(CallError):
                    variable.put_value(1)
    first, second = [record.getMessage() for record in caplog.records if record.name == "orinkit.session"]
    assert place in first
    assert "Variable_PutValue may or may not have been executed; it is not repeated" in first
    assert "The call was not sent" in second
    assert "connection" in second


def test_the_texts_in_japanese() -> None:
    i18n.use("ja")
    provider = RemoteProvider({"a": "tcp://h", "b": "tcp://i"})
    with pytest.raises(CallError, match="ゲートウェイの先にありません"):
        provider._choose("c")


# --- attempts to connect ----------------------------------------------------------------------------------------------


def test_calls_between_two_attempts_fail_immediately() -> None:
    def refuse(line: Line) -> None:
        line.close()

    with BadPeer(refuse) as peer, gateway(peer.url, retry=60.0) as url:
        codes = []
        client = None
        try:
            client = orinkit.connect(url)
            codes = [code_of(lambda: client.execute("Any")) for _ in range(20)]
        except CallError as error:
            codes = [error.code]
        finally:
            if client is not None:
                client.close()
        assert set(codes) == {hresult.E_CAO_REMOTE_PROVIDER}
        assert peer.connections == 1


def test_the_delay_between_attempts_increases_until_the_controller_is_back() -> None:
    """There is at most one attempt at a time; a success resets the delay."""
    device = Recorder()
    with (
        controller(device) as served,
        gateway(served.url, retry=0.01) as url,
        orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8,
    ):
        variable = rc8.variable("v")
        for _ in range(3):
            served.server.close()
            until(lambda: code_of(variable.get_value) == hresult.E_CAO_REMOTE_PROVIDER)
            served.start(device)
            until(lambda: code_of(variable.get_value) == 0)
    assert sum(call.function == "Controller_Connect" for call in device.calls) == 4


def test_a_controller_that_no_longer_replies() -> None:
    """After two calls without a reply, the connection is considered lost."""
    script = Scripted()
    made: list[RemoteProvider] = []

    def silent(line: Line) -> None:
        while True:
            request = line.request()
            if request.code not in (101, 102):
                line.send(script.answer(request))

    with (
        BadPeer(silent, script.serve) as peer,
        gateway(peer.url, made=made, retry=0.02) as url,
        orinkit.connect(url) as rc8,
    ):
        variable = rc8.variable("v")
        hurry(made, 0.1)
        assert code_of(lambda: variable.put_value(1)) == hresult.E_TIMEOUT
        assert peer.connections == 1
        assert code_of(lambda: variable.put_value(2)) == hresult.E_TIMEOUT
        until(lambda: code_of(variable.get_value) == 0)
    assert "Variable_PutValue" not in script.seen
    assert peer.connections == 2


class Refusing(Provider):
    provider_names = ("*",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        raise CallError(0x80040205)


class Empty(Provider):
    """A controller without any objects."""

    provider_names = ("*",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        return ControllerObject(name)


@pytest.mark.parametrize(("then", "code"), [(Refusing, 0x80040205), (Empty, hresult.E_NOTIMPL)])
def test_an_object_that_cannot_be_restored_returns_that_error(then: type[Provider], code: int) -> None:
    with (
        controller(Recorder()) as device,
        gateway(device.url, retry=0.02) as url,
        orinkit.connect(url, provider="Test.Recorder") as rc8,
    ):
        variable = rc8.robot().variable("v")
        device.server.close()
        device.start(then())
        until(lambda: code_of(variable.get_value) not in AWAY)
        assert code_of(variable.get_value) == code


def test_state_of_the_lost_connection() -> None:
    first, second = Recorder(), Recorder()
    with (
        controller(first) as device,
        gateway(device.url, retry=0.02) as url,
        orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8,
    ):
        plain, numbered, message, command = rc8.variable("I1"), rc8.variable("I*"), rc8.message(), rc8.command("c")
        assert message is not None
        numbered.id = 5
        command.parameters = [1]
        rc8.client.call(functions.controller_put_tag, rc8.handle, "tag")
        file = rc8.client.call(functions.controller_get_file, rc8.handle, "a.pcs", "@Create=1,x=2")
        plain.put_value(1)
        device.server.close()
        device.start(second)
        until(lambda: code_of(plain.get_value) == 0)
        for lost in (lambda: numbered.put_value(1), lambda: message.number, lambda: command.execute(1)):
            assert code_of(lost) == hresult.E_HANDLE
        assert rc8.client.call(functions.file_get_name, file)
    made = [call.arguments for call in second.calls if call.function.startswith("Controller_Get")]
    assert made == [("I1", ""), ("a.pcs", "x=2")]


def test_a_file_is_not_created_again() -> None:
    first, second = VirtualRC8(), VirtualRC8()
    with controller(first) as device, gateway(device.url, retry=0.02) as url, orinkit.connect(url) as rc8:
        file = rc8.client.call(functions.controller_get_file, rc8.handle, "a.txt", "@Create=1")
        rc8.client.call(functions.file_put_value, file, "text")
        device.server.close()
        device.start(second)
        read = lambda: rc8.client.call(functions.file_get_value, file)  # noqa: E731 - a name for one call
        until(lambda: code_of(read) not in AWAY)
        assert code_of(read) == hresult.FILE_NOT_FOUND
        assert "a.txt" not in rc8.file_names()


# --- transports without connections -----------------------------------------------------------------------------------


def test_a_controller_on_udp_that_is_restarted() -> None:
    first, second = VirtualRC8(), VirtualRC8()
    with (
        orinkit.serve(first, "udp://127.0.0.1:0") as server,
        gateway(server.url, retry=0.02) as url,
        orinkit.connect(url) as rc8,
    ):
        variable = rc8.variable("I1")
        variable.value = 7
        server.close()
        with orinkit.serve(second, server.url):
            codes = {code_of(variable.get_value) for _ in range(3)} - {0}
            assert codes <= set(AWAY)
            until(lambda: code_of(variable.get_value) == 0)
            assert variable.value == 0


def test_signs_of_life() -> None:
    device = Recorder()
    with controller(device) as served, gateway(served.url, keep_alive=0.02, retry=0.02) as url:
        with orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8:
            sign = Call("Controller_GetName", "cell", ())
            until(lambda: device.calls.count(sign) > 3)
            served.server.close()
            until(lambda: code_of(rc8.variable_names) == hresult.E_CAO_REMOTE_PROVIDER)
        count = len(device.calls)
    assert len(device.calls) == count


# --- the connection to the controller ---------------------------------------------------------------------------------


WANTED = ConnectRequest("", "", "", "")


def test_a_connection_that_is_lost_during_a_release() -> None:
    """The call that waits for the release is not sent."""
    script = Scripted()

    async def main(url: str) -> None:
        ended = asyncio.Event()
        connection = UpstreamConnection(Upstream(url, retry=60.0), WANTED, lambda _: ended.set())
        async with connection.turn:
            await connection.ensure_connected()
            for handle in (5, 6):
                connection.add_reference(functions.variable_release, handle)
                connection.release(functions.variable_release, handle, 1)
            with pytest.raises(CallError) as failed:
                await connection.ensure_connected()
        assert failed.value.code == hresult.E_CAO_REMOTE_PROVIDER
        connection.release(functions.variable_release, 7, 1)
        connection.close()
        await ended.wait()

    with BadPeer(script.until("Variable_Release", Line.reset)) as peer:
        asyncio.run(main(peer.url))
    assert script.seen.count("Variable_Release") == 1


def test_a_connection_that_is_closed() -> None:
    script = Scripted()

    async def main(url: str) -> None:
        ended = asyncio.Event()
        connection = UpstreamConnection(Upstream(url), WANTED, lambda _: ended.set())
        connection.close()
        connection.close()
        for _ in range(2):
            async with connection.turn:
                with pytest.raises(CallError) as failed:
                    await connection.ensure_connected()
            assert failed.value.code == hresult.E_ABORT
        await ended.wait()

    with BadPeer(script.serve) as peer:
        asyncio.run(main(peer.url))
    assert script.seen == []


def test_a_connection_that_is_closed_during_opening() -> None:
    script = Scripted()

    async def main(url: str, connecting: threading.Semaphore, answer: threading.Event) -> None:
        connection = UpstreamConnection(Upstream(url), WANTED, lambda _: None)
        async with connection.turn:
            opening = asyncio.create_task(connection.ensure_connected())
            await asyncio.to_thread(connecting.acquire)
            connection.close()
            answer.set()
            with pytest.raises(CallError) as failed:
                await opening
        assert failed.value.code == hresult.E_ABORT

    connecting, answer = threading.Semaphore(0), threading.Event()

    def slow(line: Line) -> None:
        line.send(script.answer(line.request()))
        request = line.request()
        connecting.release()
        assert answer.wait(PATIENCE)
        line.send(script.answer(request))
        line.wait_for_end()

    with BadPeer(slow) as peer:
        asyncio.run(main(peer.url, connecting, answer))
        assert peer.ended.acquire(timeout=PATIENCE)


@pytest.mark.parametrize(
    ("answer", "code"),
    [
        (lambda request: reply(request, "text"), hresult.E_FAIL),  # instead of an I4
        (lambda request: reply(request, code=0x80040299), 0x80040299),
    ],
)
def test_an_invalid_reply(answer: Any, code: int) -> None:
    script = Scripted()

    def odd(line: Line) -> None:
        line.serve(lambda request: answer(request) if request.code == ATTRIBUTE else script.answer(request))

    with BadPeer(odd) as peer, gateway(peer.url) as url, orinkit.connect(url) as rc8:
        assert code_of(lambda: rc8.attribute) == code
        assert rc8.name == "value"  # the connection stays usable
        assert peer.connections == 1


def test_a_reply_that_is_too_long() -> None:
    with (
        controller(Workshop()) as device,
        gateway(device.url, limits=PacketLimits(packet=10_000), retry=0.02) as url,
        orinkit.connect(url, provider="Test.Workshop") as shop,
    ):
        assert code_of(lambda: shop.execute("Large", 20_000)) in (hresult.E_TOO_MUCH_DATA, hresult.E_NOT_CONNECTED)
        until(lambda: code_of(lambda: shop.execute("Echo", 2)) == 0)


@pytest.mark.parametrize("listen", [HTTP, "udp://127.0.0.1:0"])
def test_a_handle_that_the_controller_refuses_does_not_end_the_connection(listen: str) -> None:
    """Only a controller that rejects all handles of this client has forgotten it."""
    first = Recorder()
    with (
        orinkit.serve(first, listen) as device,
        gateway(device.url) as near,
        gateway(near) as url,
        orinkit.connect(url, provider="Test.Recorder", name="cell") as rc8,
    ):
        robot, variable = rc8.robot("Arm"), rc8.variable("v")
        with pytest.raises(CallError) as refused:
            rc8.client.call(functions.variable_get_value, robot.handle)  # handle of another type of object
        assert refused.value.code == hresult.E_HANDLE
        assert variable.value
        assert robot.name.startswith("Robot_GetName")
    assert [call.function for call in first.calls].count("Controller_Connect") == 1


def test_objects_that_are_not_determined_by_their_names_are_not_restored() -> None:
    first, second = VirtualRC8(), VirtualRC8()
    with controller(first) as device, gateway(device.url, retry=0.02) as url, orinkit.connect(url) as rc8:
        plain, robot, file = rc8.variable("I1"), rc8.robot("Arm"), rc8.file("a.txt", create=True)
        file.text = "mine"
        file.move("b.txt")
        robot.execute("slvRecvFormat", 2)
        rc8.tag = "mine"
        device.server.close()
        device.start(second)
        until(lambda: code_of(plain.get_value) == 0)
        with orinkit.connect(device.url) as other:
            other.file("a.txt", create=True).text = "somebody else's"
        for lost in (file.get_text, file.delete, lambda: robot.execute("slvGetMode"), rc8.get_tag):
            assert code_of(lost) == hresult.E_HANDLE
        assert rc8.name
        assert rc8.robot("Arm").execute("slvGetMode") == 0
