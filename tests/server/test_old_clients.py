"""The behaviour of existing clients (reference: rc8 4.4), reproduced byte by byte over every transport."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import orinkit
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import STREAM
from orinkit.core import hresult
from orinkit.server.threaded import Server
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.both import LISTEN_AT, only
from support.callers import (
    CONNECT,
    EXECUTE,
    GET,
    GET_VARIABLE,
    PATIENCE,
    START,
    STOP,
    Counting,
    RawCaller,
    SerialRaw,
    UdpRaw,
)  # fmt: skip
from support.waiting import until

DISCONNECT, GET_ROBOT, ROBOT_EXECUTE, ROBOT_MOVE, ROBOT_RELEASE, RELEASE = 4, 7, 64, 72, 84, 111
HOME = [0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0]
LOSSY = only("udp", "serial", because="over TCP nothing is sent twice")


class TcpRaw(RawCaller):
    """A raw client on TCP."""

    wire = STREAM

    def __init__(self, url: str) -> None:
        super().__init__()
        self.socket = socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])))

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self, seconds: float) -> bytes | None:
        self.socket.settimeout(max(seconds, 0.001))
        try:
            return self.socket.recv(65536)
        except TimeoutError:
            return None

    def close(self) -> None:
        self.socket.close()


CALLERS: dict[str, Callable[[str], RawCaller]] = {"tcp": TcpRaw, "udp": UdpRaw, "serial": SerialRaw}


def caller(url: str) -> RawCaller:
    return CALLERS[url.partition(":")[0]](url)


def serial_and_code(answer: Packet) -> tuple[int, int]:
    return answer.serial, answer.code


class OldClient:
    """b-Cap.c before 1.4: serials in steps of 2, reserved field 0, no support for S_EXECUTING, all values as text.

    If a reply does not arrive in time, it sends the identical packet again.
    """

    def __init__(self, url: str, *, patience: float = PATIENCE, tries: int = 3) -> None:
        self.raw = caller(url)
        self.serial = -1
        self.patience = patience
        self.tries = tries
        self.notices = 0

    def call(self, function: int, *arguments: Any) -> Packet:
        """Make a call and return its reply."""
        self.serial = (self.serial + 2) % 0x10000
        data = self.raw.encode(self.serial, function, *arguments)
        if self.raw.wire.crc:
            assert data[7:9] == b"\0\0"
        for _ in range(self.tries):
            self.raw.send(data)
            answer = self._answer()
            if answer is not None:
                return answer
        raise TimeoutError(f"function {function}, serial {self.serial}: no answer")

    def _answer(self) -> Packet | None:
        end = time.monotonic() + self.patience
        while (left := end - time.monotonic()) > 0:
            try:
                answer = self.raw.packet(left)
            except AssertionError:
                return None
            if answer.code == hresult.S_EXECUTING:
                self.notices += 1
            elif answer.serial == self.serial:
                assert answer.reserved == 0
                return answer
        return None

    def ask(self, function: int, *arguments: Any) -> Any:
        """Make a call that succeeds and return its result."""
        answer = self.call(function, *arguments)
        assert answer.code == hresult.S_OK, f"{answer.code:#x}"
        return answer.arguments[0] if answer.arguments else None

    def connect(self, provider: str) -> Any:
        """Call Service_Start without an argument, and connect."""
        self.ask(START)
        return self.ask(CONNECT, "", provider, "localhost", "")

    def close(self) -> None:
        self.raw.close()


@pytest.fixture(params=["tcp", "udp", "serial"])
def listen_at(request: pytest.FixtureRequest) -> str:
    """Return an address of each transport with packets; for e-CAP, see test_ecap_document.py."""
    return LISTEN_AT[request.param]


@pytest.fixture
def shop() -> Counting:
    return Counting()


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(joints=tuple(HOME[:6]), clock=Clock(20))
    yield device
    device.close()


@pytest.fixture
def server(listen_at: str, shop: Counting, rc8: VirtualRC8) -> Iterator[Server]:
    with orinkit.serve([shop, rc8], listen_at) as served:
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[RawCaller]:
    with caller(server.url) as client:
        yield client


@pytest.fixture
def old(server: Server) -> Iterator[OldClient]:
    client = OldClient(server.url)
    yield client
    client.close()


# --- old programs -------------------------------------------------------------------------------------------------------


def singles(values: list[float]) -> Variant:
    return Variant(ARRAY | VarType.R4, values)


def test_a_program_of_the_first_client_for_the_rc8(old: OldClient, rc8: VirtualRC8) -> None:
    """Every parameter is text, and poses are arrays of VT_R4 (sas, jsk, quangounet)."""
    controller = old.connect("CaoProv.DENSO.VRC")
    robot = old.ask(GET_ROBOT, controller, "Arm", "")
    variable = old.ask(GET_VARIABLE, controller, "I1", "")

    def execute(command: str, parameter: Any = "") -> Any:
        return old.ask(ROBOT_EXECUTE, robot, command, parameter)

    old.ask(102, variable, "42")
    assert old.ask(GET, variable) == 42
    assert old.ask(EXECUTE, controller, "ClearError", "") is None
    execute("Takearm")
    execute("Motor", "1")
    execute("ExtSpeed", "50")
    assert execute("slvGetMode") == 0
    execute("slvChangeMode", "514")
    assert execute("slvGetMode") == 514
    for _ in range(10):
        assert execute("slvMove", singles(HOME)) == pytest.approx(HOME, abs=1e-3)
    assert execute("slvMove", singles(HOME[:7]))[:6] == pytest.approx(HOME[:6], abs=1e-3)
    assert (
        old.call(ROBOT_EXECUTE, robot, "slvMode", singles(HOME)).code >= 0x80000000
    )  # a misspelt command of one of these programs
    execute("slvChangeMode", "0")
    assert execute("slvGetMode") == 0
    execute("Motor", "0")
    execute("Givearm")
    for handle, release in ((variable, RELEASE), (robot, ROBOT_RELEASE), (controller, DISCONNECT)):
        old.ask(release, handle)
    old.ask(STOP)
    assert old.serial > 50


def test_recovery_from_an_error(old: OldClient, rc8: VirtualRC8) -> None:
    """Slave mode without the motor is refused, with the same code over every transport."""
    robot = old.ask(GET_ROBOT, old.connect("caoprov.denso.vrc"), "", "")
    old.ask(ROBOT_EXECUTE, robot, "TakeArm", "")
    refused = old.call(ROBOT_EXECUTE, robot, "slvChangeMode", "514")
    assert refused.code >= 0x80000000
    old.ask(ROBOT_EXECUTE, robot, "Motor", "1")
    old.ask(ROBOT_EXECUTE, robot, "slvChangeMode", "514")


# --- serial numbers and the reserved field --------------------------------------------------------------------------------


def test_serials_in_steps_of_two_wrap_around(old: OldClient, shop: Counting) -> None:
    """Odd serials up to 65535, and again from 1: each packet is a separate call, although all calls are identical."""
    controller = old.connect("Test.Workshop")
    old.serial = 65525
    assert [old.ask(EXECUTE, controller, "Count", "same") for _ in range(12)] == list(range(1, 13))
    assert old.serial == 65549 % 65536
    assert shop.counts == ["same"] * 12


@LOSSY
def test_even_serials_and_zero(old: OldClient, shop: Counting) -> None:
    """A client that begins with serial 0 reaches 0 again: it is a serial like any other."""
    old.serial = 65533 - 6
    controller = old.connect("Test.Workshop")
    old.serial = 65530
    assert [old.ask(EXECUTE, controller, "Count", "same") for _ in range(6)] == list(range(1, 7))


@LOSSY
def test_the_identical_packet_again(raw: RawCaller, shop: Counting) -> None:
    """With reserved field 0, the reply is sent again with the same serial."""
    handle = raw.open_workshop()
    for serial, count in ((101, 1), (101, 1), (101, 1), (103, 2), (103, 2), (105, 3)):
        raw.request(EXECUTE, handle, "Count", "same", serial=serial)
        answer = raw.packet()
        assert (answer.serial, answer.code, answer.arguments) == (serial, 0, [count])
    assert shop.counts == ["same"] * 3


@LOSSY
@pytest.mark.parametrize("first", [0, 200])
def test_a_new_serial_with_the_first_one_in_the_reserved_field(raw: RawCaller, shop: Counting, first: int) -> None:
    """DENSO's rule: the stored reply, with the new serial. The reserved field of the first attempt may have been 0."""
    handle = raw.open_workshop()
    for serial, reserved in ((200, first), (201, 200), (202, 200), (65535, 200)):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=reserved)
        answer = raw.packet()
        assert (answer.serial, answer.reserved, answer.code, answer.arguments) == (serial, 0, 0, [1])
    raw.request(EXECUTE, handle, "Count", "a", serial=204, reserved=0)
    assert raw.packet().arguments == [2]


@LOSSY
def test_an_error_reply_is_stored_too(raw: RawCaller, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (200, 201, 202):
        raw.request(EXECUTE, handle, "Fail", hresult.signed(hresult.E_ACCESSDENIED), serial=serial, reserved=200)
        assert serial_and_code(raw.packet()) == (serial, hresult.E_ACCESSDENIED)


@only("tcp", because="on the others that field identifies a call")
def test_the_reserved_field_is_ignored_over_tcp(raw: RawCaller, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (200, 201, 201, 200):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=200)
        assert raw.packet().serial == serial
    assert shop.counts == ["a"] * 4


# --- S_EXECUTING ------------------------------------------------------------------------------------------------------


@LOSSY
def test_a_client_that_ignores_s_executing(server: Server, shop: Counting) -> None:
    """It sends the request repeatedly; the call is executed once."""
    old = OldClient(server.url)
    controller = old.connect("Test.Workshop")
    old.patience, old.tries = 0.02, 2000
    at_work = shop.at_work.acquire

    def finish() -> None:
        assert at_work(timeout=PATIENCE)
        until(lambda: old.notices > 3)
        shop.gate.set()

    waiting = threading.Thread(target=finish)
    waiting.start()
    assert old.ask(EXECUTE, controller, "CountLater", 7) == 1
    waiting.join()
    old.patience = PATIENCE
    assert old.ask(EXECUTE, controller, "Count", 8) == 2
    assert shop.counts == [7, 8]
    old.close()


def test_a_client_that_takes_s_executing_for_the_reply(raw: RawCaller, shop: Counting) -> None:
    """Its next call waits for the end of the first one."""
    raw.ask(START, ",WDT=100")
    handle = raw.open_workshop()
    serial = raw.request(EXECUTE, handle, "CountLater", 1)
    assert serial_and_code(raw.packet()) == (serial, hresult.S_EXECUTING)
    following = raw.request(EXECUTE, handle, "Count", 2)
    while (answer := raw.packet()).serial == serial:
        assert answer.code == hresult.S_EXECUTING
    assert serial_and_code(answer) == (following, hresult.S_EXECUTING)
    shop.gate.set()
    while (answer := raw.packet()).code == hresult.S_EXECUTING:
        pass
    assert (answer.serial, answer.arguments) == (serial, [1])
    while (answer := raw.packet()).code == hresult.S_EXECUTING:
        pass
    assert (answer.serial, answer.arguments) == (following, [2])
    assert raw.ask(EXECUTE, handle, "Count", 3) == 3
    assert shop.counts == [1, 2, 3]


# --- other peculiarities ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("option", [",WDT=400,InvokeTimeout=180000", ",WDT=400", "WDT=400", "", ","])
def test_options_with_a_leading_comma(raw: RawCaller, option: str) -> None:
    """This is how ROS sends them."""
    assert raw.ask(START, option) is None
    assert raw.ask(EXECUTE, raw.open_workshop(), "Echo", option) == option


def test_the_option_after_a_leading_comma_takes_effect(raw: RawCaller, shop: Counting) -> None:
    assert raw.ask(START, ",WDT=100") is None
    serial = raw.request(EXECUTE, raw.open_workshop(), "Wait", 1)
    assert serial_and_code(raw.packet()) == (serial, hresult.S_EXECUTING)
    shop.gate.set()


@pytest.mark.parametrize("type_", [VarType.UI4, VarType.I2, VarType.UI2])
def test_handles_of_other_types(raw: RawCaller, shop: Counting, type_: VarType) -> None:
    """Clients of ROS's bcap_service send VT_UI4."""
    controller = Variant(type_, raw.open_workshop())
    variable = Variant(type_, raw.ask(GET_VARIABLE, controller, "v", ""))
    assert raw.ask(102, variable, 5) is None
    assert raw.ask(GET, variable) == 5
    assert raw.ask(RELEASE, variable) is None
    assert raw.ask(DISCONNECT, controller) is None
    assert shop.released == ["v", "Controller"]


# --- one client after the other ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stops", [True, False])
def test_one_old_client_after_the_other(server: Server, shop: Counting, stops: bool) -> None:
    """Each begins with the same serials; on a serial line, only that shows that the previous client has gone."""
    kept = []  # on UDP: the next client might get a port that is free again
    repeats = server.url.startswith("serial") and not stops  # within 1 s, a Service_Start is taken for a late packet
    for number in range(4):
        old = OldClient(server.url, **({"patience": 0.3, "tries": 100} if repeats else {}))
        controller = old.connect("Test.Workshop")
        assert controller == 2
        old.ask(GET_VARIABLE, controller, f"v{number}", "")
        assert old.ask(EXECUTE, controller, "Count", "same") == number + 1
        if stops:
            old.ask(STOP)
        if server.url.startswith("udp"):
            kept.append(old)
        else:
            old.close()
    if stops or not server.url.startswith("udp"):  # on UDP, clients are dropped after 10 s
        last = 4 if stops or server.url.startswith("tcp") else 3
        until(lambda: len(shop.released) == 2 * last)
        assert shop.released == [name for number in range(last) for name in (f"v{number}", "Controller")]
    for old in kept:
        old.close()


@only("serial", because="a line has one client at a time")
def test_a_call_of_the_previous_client_is_cancelled(server: Server, shop: Counting) -> None:
    with SerialRaw(server.url) as previous:
        handle = previous.open_workshop()
        previous.request(EXECUTE, handle, "CountLater", 1, serial=7)
        assert shop.at_work.acquire(timeout=PATIENCE)
    old = OldClient(server.url)
    controller = old.connect("Test.Workshop")
    assert shop.cancelled.acquire(timeout=PATIENCE)
    assert shop.released == ["Controller"]
    assert old.ask(EXECUTE, controller, "Count", 2) == 2
    old.close()
