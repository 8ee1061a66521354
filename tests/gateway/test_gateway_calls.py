"""Calls through a gateway: all functions, handles, return codes, disconnecting clients."""

from __future__ import annotations

import asyncio
import http.client
import itertools
import logging
import threading
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit.cao import functions as f
from orinkit.cao.dialect import VE026A
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, ResultWithCode, RobotObject, VariableObject
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidAddress, InvalidArgument, InvalidValue
from orinkit.gateway import RemoteProvider, Upstream
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.devices import Call, Recorder, Workshop
from support.gateways import HTTP, LISTEN, PATIENCE, chain, gateway, hurry
from support.peers import RawClient
from support.waiting import until

RELEASES = {entry.interface: entry for entry in FUNCTIONS.values() if entry.releases}
SAMPLES = {VarType.I4: -7, VarType.R4: 0.375, VarType.BSTR: "名前", VarType.VARIANT: [1, "two", 3.5]}
BUFFER_FULL = 0x0F200501


# --- all functions ----------------------------------------------------------------------------------------------------


def arguments(function: Function[..., Any]) -> list[Any]:
    return [SAMPLES[argument.vt] for argument in function.arguments if not argument.is_handle]


def walk(url: str, recorder: Recorder) -> list[tuple[str, int, Any]]:
    """Call all functions of the table; return the results, except handles."""
    answers = []
    with orinkit.open_client(url) as client:
        client.call(f.service_start, "WDT=400")
        handles = {"Controller": client.call(f.controller_connect, "cell", "Test.Recorder", "machine", "option=1")}
        paths = {"Controller": "cell"}
        for entry in FUNCTIONS.values():
            if entry.creates and entry.creates not in handles:
                handles[entry.creates] = client.call(entry, handles[entry.interface], *arguments(entry))
                paths[entry.creates] = recorder.made[-1]
        for entry in FUNCTIONS.values():
            if entry.interface != "Service" and entry.creates != "Controller" and not entry.releases:
                reply = client.request(entry, handles[entry.interface], *arguments(entry), exact=True)
                answers.append((entry.name, reply.code, None if entry.creates else reply.value))
        for interface in reversed(handles):
            client.call(RELEASES[interface], handles[interface])
            assert recorder.wait_for(Call(RELEASES[interface].name, paths[interface], ()))
        client.call(f.service_stop)
    return answers


class NumberingRecorder(Recorder):
    """A recorder that numbers its objects, and stores the provider that each client requested."""

    provider_names = ("*",)

    def __init__(self) -> None:
        super().__init__()
        self.made: list[str] = []
        self.asked: list[str] = []

    def make(self, interface: str, path: str) -> Any:
        self.made.append(f"{path}#{len(self.made)}")
        return super().make(interface, self.made[-1]) if self.made[1:] else super().make(interface, path)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        self.asked.append(client.provider)
        return super().connect(name, machine, option, client)


@pytest.mark.parametrize(("gateways", "between"), [(1, LISTEN), (2, LISTEN), (1, HTTP), (2, HTTP)])
def test_every_function_is_forwarded_unchanged(gateways: int, between: str) -> None:
    direct, behind = NumberingRecorder(), NumberingRecorder()
    with orinkit.serve(direct, LISTEN) as server:
        wanted = walk(server.url, direct)
    with chain(behind, gateways, between) as url:
        assert walk(url, behind) == wanted
    assert behind.calls == direct.calls
    assert (
        len({call.function for call in behind.calls}) == len(FUNCTIONS) - 2
    )  # all except Service_Start and Service_Stop
    assert behind.asked == ["Test.Recorder"]


def test_a_client_sees_no_difference(both: Any) -> None:
    recorder = Recorder()
    recorder.provider_names = ("*",)
    with chain(recorder) as url:
        rc8 = both.connect(url, provider="Prov", name="cell")
        robot = both.run(rc8.robot("Arm"))
        assert both.run(robot.execute("Any", [1])) == ["Robot_Execute|cell/Arm|['Any', [1]]", 35.0, True]
        both.run(rc8.close())
        assert recorder.wait_for(Call("Controller_Disconnect", "cell", ()))


# --- codes ------------------------------------------------------------------------------------------------------------


class Full(RobotObject):
    def execute(self, command: str, parameter: Variant) -> Any:
        return ResultWithCode(BUFFER_FULL, parameter)

    def get_variable(self, name: str, option: str) -> Any:
        return ResultWithCode(hresult.S_FALSE, VariableObject(name))

    def hold(self, option: str) -> Any:
        return ResultWithCode(hresult.S_FALSE)

    def get_name(self) -> Any:
        return ResultWithCode(hresult.S_FALSE, "名前")

    def get_attribute(self) -> Any:
        return -1


class Codes(ControllerObject):
    def get_robot(self, name: str, option: str) -> Any:
        return Full(name)


class Coder(Provider):
    provider_names = ("*",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        if option == "refuse":
            raise orinkit.CallError(0x80040201)
        return Codes()


@pytest.mark.parametrize(("gateways", "between"), [(1, LISTEN), (2, LISTEN), (2, HTTP)])
def test_success_codes(gateways: int, between: str) -> None:
    with chain(Coder(), gateways, between) as url, orinkit.connect(url) as rc8:
        robot, client = rc8.robot(), rc8.client
        exact = Variant(VarType.R4, 0.5)
        assert client.request(f.robot_execute, robot.handle, "slvMove", exact, exact=True) == (BUFFER_FULL, exact)
        assert client.request(f.robot_hold, robot.handle, "").code == hresult.S_FALSE
        assert client.request(f.robot_get_name, robot.handle) == (hresult.S_FALSE, "名前")
        code, handle = client.request(f.robot_get_variable, robot.handle, "v", "")
        assert code == hresult.S_FALSE
        assert client.call(f.variable_get_name, handle) == "v"
        assert client.call(f.robot_get_attribute, robot.handle) == -1


def test_error_codes() -> None:
    with chain(Workshop(), 2) as url, orinkit.connect(url, provider="Test.Workshop") as shop:
        for code in (0x83501024, 0x80020005, 0x80040201, 0xFFFFFFFF, hresult.E_HANDLE):
            with pytest.raises(CallError) as failed:
                shop.execute("Fail", code - 2**32)
            assert failed.value.code == code
        assert shop.execute("Echo", "still there") == "still there"


def test_a_device_that_raises(caplog: pytest.LogCaptureFixture) -> None:
    with chain(Workshop(), 2) as url, orinkit.connect(url, provider="Test.Workshop") as shop:
        with pytest.raises(CallError) as failed:
            shop.execute("Crash")
        assert failed.value.code == hresult.E_FAIL
        assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == [
            "Controller_Execute: the device raised an exception"  # logged by the device only, not by the gateway
        ]
        caplog.clear()
        assert shop.execute("Echo", "still there") == "still there"


def test_a_controller_that_refuses() -> None:
    with chain(Coder()) as url, pytest.raises(CallError) as failed:
        orinkit.connect(url, option="refuse")
    assert failed.value.code == 0x80040201


def test_an_unknown_provider_of_the_controller() -> None:
    with chain(Workshop()) as url, pytest.raises(CallError) as failed:
        orinkit.connect(url, provider="Mine")
    assert failed.value.code == hresult.E_CAO_PROV_INVALID


# --- clients ----------------------------------------------------------------------------------------------------------


def test_clients_are_separate() -> None:
    recorder = Recorder()
    with chain(recorder) as url, orinkit.open_client(url) as one, orinkit.open_client(url) as two:
        controllers = [c.call(f.controller_connect, n, "Test.Recorder", "", "") for n, c in (("1", one), ("2", two))]
        variables = [
            [client.call(f.controller_get_variable, controller, f"v{number}", "") for number in range(50)]
            for client, controller in zip((one, two), controllers, strict=True)
        ]
        assert variables[0] == variables[1]  # handles are valid in one connection only
        for name, client, handles in (("1", one, variables[0]), ("2", two, variables[1])):
            for number, handle in enumerate(handles):
                assert client.call(f.variable_get_name, handle) == f"Variable_GetName|{name}/v{number}|[]"


def test_two_controllers_of_one_client() -> None:
    recorder = Recorder()
    with chain(recorder) as url, orinkit.open_client(url) as client:
        first, second = (client.call(f.controller_connect, n, "Test.Recorder", "", "") for n in ("1", "2"))
        one = client.call(f.controller_get_variable, first, "v", "")
        two = client.call(f.controller_get_variable, second, "v", "")
        client.call(f.controller_disconnect, first)
        assert recorder.wait_for(Call("Controller_Disconnect", "1", ()))
        with pytest.raises(CallError) as failed:
            client.call(f.variable_get_value, one)
        assert failed.value.code == hresult.E_HANDLE
        assert client.call(f.variable_get_name, two) == "Variable_GetName|2/v|[]"


@pytest.mark.parametrize("ending", ["closes", "stops", "is cut"])
@pytest.mark.parametrize(("gateways", "between"), [(1, LISTEN), (2, LISTEN), (2, HTTP)])
def test_a_client_that_disconnects(ending: str, gateways: int, between: str) -> None:
    recorder = Recorder()
    with chain(recorder, gateways, between) as url, RawClient(url) as client:
        controller = client.ask(3, "cell", "Test.Recorder", "", "")
        robot = client.ask(7, controller, "Arm", "")
        client.ask(62, robot, "v", "")
        if ending == "stops":
            assert client.ask(2) is None
        elif ending == "closes":
            client.close()
        else:
            client.socket.shutdown(2)
        assert recorder.wait_for(Call("Controller_Disconnect", "cell", ()))
    assert [call.path for call in recorder.calls[-3:]] == ["cell/Arm/v", "cell/Arm", "cell"]


def test_releases_are_sent_before_further_calls() -> None:
    recorder = Recorder()
    with chain(recorder) as url, orinkit.open_client(url) as client:
        controller = client.call(f.controller_connect, "cell", "Test.Recorder", "", "")
        for number in range(30):
            handle = client.call(f.controller_get_robot, controller, f"r{number}", "")
            client.call(f.robot_release, handle)
        client.call(f.controller_get_name, controller)
        names = [call.function for call in recorder.calls[1:]]
    assert names[:60] == ["Controller_GetRobot", "Robot_Release"] * 30


def test_nothing_is_left_when_a_gateway_is_closed() -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, LISTEN) as server:
        with gateway(server.url) as url:
            clients = [orinkit.connect(url, provider="Test.Recorder", name=f"{number}") for number in range(5)]
            for client in clients:
                client.robot()
            assert server.clients == 5
        until(lambda: server.clients == 0)
        assert sum(call.function == "Robot_Release" for call in recorder.calls) == 5
        for client in clients:
            client.close()


# --- long calls -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gateways", "between"), [(1, LISTEN), (2, LISTEN), (2, HTTP)])
def test_a_call_that_takes_longer_than_all_time_outs(gateways: int, between: str) -> None:
    shop = Workshop()
    made: list[RemoteProvider] = []
    with (
        chain(shop, gateways, between, made, service="WDT=100") as url,
        orinkit.connect(url, provider="Test.Workshop", service="WDT=100") as client,
    ):
        hurry(made, 1.0)
        client.client.timeout = 1.0
        opening = threading.Timer(1.3, shop.gate.set)
        opening.start()
        assert client.execute("Wait", "done") == "done"
        assert client.execute("Block", [1.5]) == [1.5]
        opening.join()


def test_a_controller_that_does_not_report_executing() -> None:
    shop = Workshop()
    made: list[RemoteProvider] = []
    with chain(shop, made=made, service="") as url, orinkit.connect(url, provider="Test.Workshop") as client:
        hurry(made, 0.2)
        with pytest.raises(CallError) as failed:
            client.execute("Wait", 1)
        assert failed.value.code == hresult.E_TIMEOUT
        hurry(made, PATIENCE)
        opening = threading.Timer(0.1, shop.gate.set)
        opening.start()
        assert client.execute("Echo", 2) == 2  # after the first call, which the controller is still executing
        opening.join()
    assert shop.at_work.acquire(timeout=0)
    assert not shop.at_work.acquire(timeout=0)  # once


def test_an_abandoned_call() -> None:
    shop = Workshop()

    async def main(url: str) -> None:
        async with await aio.connect(url, provider="Test.Workshop") as client:
            work = asyncio.create_task(client.execute("Wait", 1))
            assert await asyncio.to_thread(shop.at_work.acquire, timeout=PATIENCE)
            work.cancel()
            with pytest.raises(asyncio.CancelledError):
                await work
            following = asyncio.create_task(client.execute("Echo", 2))
            await asyncio.sleep(0)
            shop.gate.set()
            assert await following == 2, "it has waited for the abandoned call"
            assert await client.execute("Echo", 3) == 3

    with chain(shop) as url:
        asyncio.run(main(url))


@pytest.mark.parametrize(("gateways", "between"), [(1, LISTEN), (2, LISTEN), (2, HTTP)])
def test_a_client_that_disconnects_during_its_call(gateways: int, between: str) -> None:
    shop = Workshop()
    with chain(shop, gateways, between) as url, RawClient(url) as client:
        controller = client.ask(3, "", "Test.Workshop", "", "")
        client.ask(9, controller, "v", "")
        client.request(17, controller, "Wait", 1)
        assert shop.at_work.acquire(timeout=PATIENCE)
        client.close()
        assert shop.cancelled.acquire(timeout=PATIENCE)
        until(lambda: shop.released == ["v", "Controller"])


def test_other_clients_do_not_wait() -> None:
    shop = Workshop()
    with chain(shop) as url, RawClient(url) as waiting:
        controller = waiting.ask(3, "", "Test.Workshop", "", "")
        waiting.request(17, controller, "Block", 1)
        assert shop.at_work.acquire(timeout=PATIENCE)
        with orinkit.connect(url, provider="Test.Workshop") as client:
            assert client.execute("Echo", 2) == 2
        shop.gate.set()
        assert waiting.packet().arguments == [1]


# --- controllers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("between", [LISTEN, HTTP])
def test_the_arm_of_a_client_whose_connection_breaks(between: str) -> None:
    device = VirtualRC8(clock=Clock(), motor=True, joints=(-60, 45, 90, 0, 45, 0))
    arm = device.state.arm
    with chain(device, 2, between) as url:
        rc8 = orinkit.connect(url)
        robot = rc8.robot()
        with device.state.cycles:
            arm.log.running = True
            device.state.cycles.wake()
        robot.execute("TakeArm")
        robot.execute("ExtSpeed", 60)
        robot.move(1, "@P J(120,45,90,0,45,0)", "NEXT")
        until(lambda: arm.servo.command[0] > -40)
        rc8.client._link.close()
        until(lambda: arm.holder is None and not arm.busy)
        with device.state.cycles:
            path = [arm.log.record(index)[0] for index in range(len(arm.log))]
    speeds = [(b - a) / PERIOD for a, b in itertools.pairwise(path)]
    braking = [(b - a) / PERIOD for a, b in itertools.pairwise(speeds)]
    assert path[-1] < 100  # the arm did not reach the end
    assert abs(speeds[-1]) < 1e-6
    assert max(map(abs, braking)) <= arm.model.axes[0].acceleration * 1.000001


@pytest.mark.parametrize("listen", [LISTEN, "udp://127.0.0.1:0", "pty://", HTTP])
def test_an_rc8_over_all_transports(listen: str) -> None:
    with orinkit.serve(VirtualRC8(), listen) as server, gateway(server.url) as url, orinkit.connect(url) as rc8:
        rc8.variable("I7").value = 42
        assert rc8.variable("I7").value == 42
        with rc8.variable("F1") as variable:
            variable.put_value(Variant(VarType.R4, 0.1))
            assert rc8.client.request(f.variable_get_value, variable.handle, exact=True).value.type == VarType.R4
        assert rc8.execute("GetCurErrorCount") == 0
        with pytest.raises(CallError) as failed:
            rc8.execute("Nonsense")
        assert failed.value.code == hresult.E_INVALID_CMD_NAME
    # the gateway has released the objects that the client did not release
    assert server.clients == 0


@pytest.mark.parametrize("listen", ["tcp://127.0.0.1:0", "pty://"])
def test_a_ve026a(listen: str) -> None:
    device = VirtualVE026A(motor_seconds=0.6, clear_seconds=0.05)
    with orinkit.serve(device, listen) as server:
        provider = RemoteProvider(Upstream(server.url, dialect="ve026a"))
        assert provider.dialect is VE026A
        with orinkit.serve(provider, "tcp://127.0.0.1:0", "pty://") as gate:
            for url in gate.urls:
                with orinkit.connect(url, provider="") as controller:
                    assert controller.client.dialect is VE026A
                    robot = controller.robot()
                    before = controller.client.timeout
                    hurry([provider], 0.2)  # the gateway waits for a command that is known to take longer
                    controller.client.timeout = 0.2
                    robot.execute("Motor", Variant(VarType.I2, 1))
                    assert device.servo_on
                    hurry([provider], before)
                    controller.client.timeout = before
                    controller.execute("ClearError", Variant(VarType.I2, 0))
                    with robot.variable("@CURRENT_ANGLE") as one, robot.variable("@CURRENT_ANGLE") as two:
                        assert one.value == two.value
                        one.close()  # the controller has one handle for both objects
                        assert len(two.value) == 8
                    with pytest.raises(CallError) as failed:
                        robot.execute("TakeArm")
                    assert failed.value.code == hresult.E_INVALIDCOMMAND
                    robot.execute("Motor", Variant(VarType.I2, 0))


def test_a_long_argument_cannot_be_sent_over_udp() -> None:
    with (
        orinkit.serve(Workshop(), "udp://127.0.0.1:0") as server,
        gateway(server.url) as url,
        orinkit.connect(url, provider="Test.Workshop") as client,
    ):
        with pytest.raises(InvalidArgument):
            client.execute("Echo", "x" * 1000)
        assert client.execute("Echo", "short") == "short"
        with pytest.raises(CallError) as failed:
            client.execute("Large", 1000)
        assert failed.value.code == hresult.E_TOO_MUCH_DATA


# --- several controllers ----------------------------------------------------------------------------------------------


def test_several_controllers_by_name() -> None:
    first, second = Recorder(), Recorder()
    with orinkit.serve(first, LISTEN) as one, orinkit.serve(second, "tcp://localhost:0") as two:
        provider = RemoteProvider({"Cell1": one.url, "Cell2": Upstream(two.url, machine="there")})
        with orinkit.serve(provider, LISTEN) as server:
            for machine in (
                "cell1",
                " CELL1 ",
                "127.0.0.1",
                one.url.removeprefix("tcp://"),
                "Cell2",
                two.url.removeprefix("tcp://"),
            ):
                with orinkit.connect(server.url, provider="Test.Recorder", machine=machine) as controller:
                    assert controller.name.startswith("Controller_GetName")
            for machine in ("", "localhost", "cell3", "10.0.0.1", "x" * 100_000):
                with pytest.raises(InvalidArgument):
                    orinkit.connect(server.url, provider="Test.Recorder", machine=machine)
    machines = [[c.arguments[1] for c in d.calls if c.function == "Controller_Connect"] for d in (first, second)]
    assert machines == [["localhost", "localhost", "127.0.0.1", one.url.removeprefix("tcp://")], ["there", "there"]]


def test_one_controller_with_a_name_is_not_another_one() -> None:
    provider = RemoteProvider({"left": "tcp://10.0.0.1:5007"})
    for machine in ("left", " LEFT ", "10.0.0.1", "10.0.0.1:5007", "", "localhost"):
        assert provider._choose(machine)[0].url == "tcp://10.0.0.1:5007"
    for machine in ("right", "10.0.0.2"):
        with pytest.raises(InvalidArgument, match="left"):
            provider._choose(machine)
    assert RemoteProvider("tcp://10.0.0.1")._choose("any machine")[1] == "any machine"


def test_hosts_of_ipv6() -> None:
    provider = RemoteProvider({"a": "tcp://[fd00::1]:5007", "b": "tcp://[fd00::2]:5007"})
    for machine in ("fd00::2", "[FD00::2]", "[fd00::2]:5007"):
        assert provider._choose(machine)[0].url == "tcp://[fd00::2]:5007"


@pytest.mark.parametrize(
    "names",
    [
        {"a": "tcp://h1", " A ": "tcp://h2"}, {"": "tcp://h1", "b": "tcp://h2"}, {"localhost": "tcp://h1", "b": "tcp://h2"},
        {"h2": "tcp://h1", "b": "tcp://h2"}, {"h1:5007": "tcp://h1", "b": "tcp://h2"},
    ],
)  # fmt: skip
def test_ambiguous_names_are_refused(names: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="needs a unique name"):
        RemoteProvider(names)


def test_one_provider_in_two_servers() -> None:
    workshop = Workshop()
    with orinkit.serve(workshop, LISTEN) as device:
        remote = RemoteProvider(device.url)
        with orinkit.serve(remote, LISTEN) as first, orinkit.connect(first.url, provider="Test.Workshop") as shop:
            with (
                orinkit.serve(remote, LISTEN) as second,
                orinkit.connect(second.url, provider="Test.Workshop") as other,
            ):
                assert other.execute("Echo", 1) == 1
            assert shop.execute("Echo", 2) == 2


def test_a_call_whose_client_no_longer_waits_is_not_sent() -> None:
    """The call was waiting for another one; over e-CAP, a client may make several calls at the same time."""
    workshop = Workshop()
    with orinkit.serve(workshop, LISTEN) as device, gateway(device.url, HTTP) as url:
        handle = post(url, "Func=3,Arg1=,Arg2=Test.Workshop").rpartition(",")[2]
        assert post(url, "Func=1,Arg1=InvokeTimeout=200") == "0x00000000"
        late = f"0x{hresult.E_TIMEOUT:08X}"
        assert post(url, f"Func=17,Arg1={handle},Arg2=Wait") == late
        assert post(url, f"Func=9,Arg1={handle},Arg2=never") == late
        with pytest.raises(TimeoutError):
            post(url, f"Func=9,Arg1={handle},Arg2=nor this", seconds=0.05)
        workshop.gate.set()
        assert post(url, "Func=1,Arg1=InvokeTimeout=20000") == "0x00000000"
        assert post(url, f"Func=9,Arg1={handle},Arg2=after").startswith("0x00000000")
    assert workshop.made == ["after"]


def post(url: str, body: str, seconds: float = PATIENCE) -> str:
    """Send a request like a plain HTTP client; return the reply."""
    connection = http.client.HTTPConnection(url.partition("//")[2], timeout=seconds)
    try:
        connection.request("POST", "/", body, {"Content-Type": "application/x-www-form-urlencoded"})
        return connection.getresponse().read().decode()
    finally:
        connection.close()


def test_a_host_of_two_controllers_selects_neither() -> None:
    provider = RemoteProvider({"a": "tcp://10.0.0.1:5007", "b": "tcp://10.0.0.1:5008"})
    with pytest.raises(InvalidArgument, match=r"machines behind this gateway: a, b"):
        provider._choose("10.0.0.1")


def test_a_gateway_together_with_other_providers() -> None:
    with orinkit.serve(Recorder(), LISTEN) as server:
        with orinkit.serve([Workshop(), RemoteProvider(server.url)], LISTEN) as gate:
            with orinkit.connect(gate.url, provider="Test.Workshop") as mine:
                assert mine.execute("Echo", 1) == 1
            with orinkit.connect(gate.url, provider="Test.Recorder") as theirs:
                assert theirs.name.startswith("Controller_GetName")
        with orinkit.serve(RemoteProvider(server.url, names=("Test.Recorder",)), LISTEN) as gate:
            with pytest.raises(CallError) as failed:
                orinkit.connect(gate.url, provider="Other")
            assert failed.value.code == hresult.E_CAO_PROV_INVALID


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"url": "can://x"}, InvalidAddress),
        ({"url": "pty://"}, InvalidAddress),
        ({"url": ""}, InvalidAddress),
        ({"url": "tcp://h", "timeout": 0}, InvalidValue),
        ({"url": "tcp://h", "timeout": float("nan")}, InvalidValue),
        ({"url": "tcp://h", "tries": "x"}, InvalidValue),
        ({"url": "tcp://h", "dialect": "rc7"}, InvalidValue),
        ({"url": "tcp://h", "retry": -1}, InvalidValue),
        ({"url": "tcp://h", "retry": float("nan")}, InvalidValue),
        ({"url": "tcp://h", "keep_alive": float("inf")}, InvalidValue),
        ({"url": "tcp://h", "keep_alive": "x"}, InvalidValue),
        ({"url": "tcp://h", "token": "secret"}, InvalidValue),
    ],
)
def test_invalid_upstreams(arguments: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        Upstream(**arguments)


@pytest.mark.parametrize(
    "upstreams",
    [{}, {"a": "tcp://h", "A": "tcp://i"}, {"a": "tcp://h", "b": Upstream("tcp://i", dialect="ve026a")}],
)
def test_invalid_sets_of_upstreams(upstreams: Any) -> None:
    with pytest.raises(ValueError):
        RemoteProvider(upstreams)


def test_a_token_is_not_shown() -> None:
    assert "secret" not in repr(Upstream("http://h", token="secret"))
