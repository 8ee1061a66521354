"""What clients do that are about in the world (reference: rc8 4.4), byte by byte as they do it, over every kind of wire."""

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
LOSSY = only("udp", "serial", because="with TCP nothing is sent twice")


class TcpRaw(RawCaller):
    """On TCP."""

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


def told(answer: Packet) -> tuple[int, int]:
    return answer.serial, answer.code


class OldClient:
    """b-Cap.c before 1.4: serials in steps of 2, the reserved field 0, nothing known of S_EXECUTING, texts for all values.

    Where an answer does not come in time it sends the very same packet again.
    """

    def __init__(self, url: str, *, patience: float = PATIENCE, tries: int = 3) -> None:
        self.raw = caller(url)
        self.serial = -1
        self.patience = patience
        self.tries = tries
        self.notices = 0

    def call(self, function: int, *arguments: Any) -> Packet:
        """Make a call and return its answer."""
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
        """Begin, without an argument, and connect."""
        self.ask(START)
        return self.ask(CONNECT, "", provider, "localhost", "")

    def close(self) -> None:
        self.raw.close()


@pytest.fixture(params=["tcp", "udp", "serial"])
def listen_at(request: pytest.FixtureRequest) -> str:
    """All that is here are packets; programs of e-CAP: test_ecap_document.py."""
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


# --- a program of those days --------------------------------------------------------------------------------------------


def singles(values: list[float]) -> Variant:
    return Variant(ARRAY | VarType.R4, values)


def test_a_program_of_the_first_client_for_the_rc8(old: OldClient, rc8: VirtualRC8) -> None:
    """Every parameter is a text, the poses are of VT_R4 (sas, jsk, quangounet)."""
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
    assert old.call(ROBOT_EXECUTE, robot, "slvMode", singles(HOME)).code >= 0x80000000  # a typo that somebody made
    execute("slvChangeMode", "0")
    assert execute("slvGetMode") == 0
    execute("Motor", "0")
    execute("Givearm")
    for handle, release in ((variable, RELEASE), (robot, ROBOT_RELEASE), (controller, DISCONNECT)):
        old.ask(release, handle)
    old.ask(STOP)
    assert old.serial > 50


def test_an_error_in_the_middle_and_on_again(old: OldClient, rc8: VirtualRC8) -> None:
    """Slave mode without a motor is refused, with the same code over every wire."""
    robot = old.ask(GET_ROBOT, old.connect("caoprov.denso.vrc"), "", "")
    old.ask(ROBOT_EXECUTE, robot, "TakeArm", "")
    refused = old.call(ROBOT_EXECUTE, robot, "slvChangeMode", "514")
    assert refused.code >= 0x80000000
    old.ask(ROBOT_EXECUTE, robot, "Motor", "1")
    old.ask(ROBOT_EXECUTE, robot, "slvChangeMode", "514")


# --- serial numbers and the reserved field --------------------------------------------------------------------------------


def test_serials_in_steps_of_two_up_to_the_end_and_round(old: OldClient, shop: Counting) -> None:
    """From 1 on up to 65535, and again: each is a call of its own, though all are the same."""
    controller = old.connect("Test.Workshop")
    old.serial = 65525
    assert [old.ask(EXECUTE, controller, "Count", "same") for _ in range(12)] == list(range(1, 13))
    assert old.serial == 65549 % 65536
    assert shop.counts == ["same"] * 12


@LOSSY
def test_even_serials_and_zero(old: OldClient, shop: Counting) -> None:
    """Who begins with 0 comes to 0 again: it is a number as any other."""
    old.serial = 65533 - 6
    controller = old.connect("Test.Workshop")
    old.serial = 65530
    assert [old.ask(EXECUTE, controller, "Count", "same") for _ in range(6)] == list(range(1, 7))


@LOSSY
def test_the_same_packet_again(raw: RawCaller, shop: Counting) -> None:
    """Of a client that leaves the reserved field 0: the answer again, under the same serial."""
    handle = raw.open_workshop()
    for serial, count in ((101, 1), (101, 1), (101, 1), (103, 2), (103, 2), (105, 3)):
        raw.request(EXECUTE, handle, "Count", "same", serial=serial)
        answer = raw.packet()
        assert (answer.serial, answer.code, answer.arguments) == (serial, 0, [count])
    assert shop.counts == ["same"] * 3


@LOSSY
@pytest.mark.parametrize("first", [0, 200])
def test_a_new_serial_with_the_first_one_in_the_reserved_field(raw: RawCaller, shop: Counting, first: int) -> None:
    """DENSO's rule: the stored answer, under the new serial. The first try may have had 0 there."""
    handle = raw.open_workshop()
    for serial, reserved in ((200, first), (201, 200), (202, 200), (65535, 200)):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=reserved)
        answer = raw.packet()
        assert (answer.serial, answer.reserved, answer.code, answer.arguments) == (serial, 0, 0, [1])
    raw.request(EXECUTE, handle, "Count", "a", serial=204, reserved=0)
    assert raw.packet().arguments == [2]


@LOSSY
def test_an_answer_that_is_an_error_is_kept_too(raw: RawCaller, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (200, 201, 202):
        raw.request(EXECUTE, handle, "Fail", hresult.signed(hresult.E_ACCESSDENIED), serial=serial, reserved=200)
        assert told(raw.packet()) == (serial, hresult.E_ACCESSDENIED)


@only("tcp", because="on the others that field tells one call from another")
def test_with_tcp_the_reserved_field_means_nothing(raw: RawCaller, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (200, 201, 201, 200):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=200)
        assert raw.packet().serial == serial
    assert shop.counts == ["a"] * 4


# --- S_EXECUTING ------------------------------------------------------------------------------------------------------


@LOSSY
def test_a_client_that_ignores_that_its_call_is_at_work(server: Server, shop: Counting) -> None:
    """It sends it again and again; it is carried out once."""
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


def test_a_client_that_takes_it_for_the_answer(raw: RawCaller, shop: Counting) -> None:
    """It goes on, and is told that the controller is busy; when the call is done all is well."""
    raw.ask(START, ",WDT=100")
    handle = raw.open_workshop()
    serial = raw.request(EXECUTE, handle, "CountLater", 1)
    assert told(raw.packet()) == (serial, hresult.S_EXECUTING)
    following = raw.request(EXECUTE, handle, "Count", 2)
    while (answer := raw.packet()).serial == serial:
        assert answer.code == hresult.S_EXECUTING
    assert told(answer) == (following, hresult.E_BUSY_PROC)
    shop.gate.set()
    while (answer := raw.packet()).code == hresult.S_EXECUTING:
        pass
    assert (answer.serial, answer.arguments) == (serial, [1])
    assert raw.ask(EXECUTE, handle, "Count", 3) == 2
    assert shop.counts == [1, 3]


# --- other habits -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("option", [",WDT=400,InvokeTimeout=180000", ",WDT=400", "WDT=400", "", ","])
def test_options_with_a_leading_comma(raw: RawCaller, option: str) -> None:
    """As ROS sends them."""
    assert raw.ask(START, option) is None
    assert raw.ask(EXECUTE, raw.open_workshop(), "Echo", option) == option


def test_the_option_behind_a_leading_comma_counts(raw: RawCaller, shop: Counting) -> None:
    assert raw.ask(START, ",WDT=100") is None
    serial = raw.request(EXECUTE, raw.open_workshop(), "Wait", 1)
    assert told(raw.packet()) == (serial, hresult.S_EXECUTING)
    shop.gate.set()


@pytest.mark.parametrize("type_", [VarType.UI4, VarType.I2, VarType.UI2])
def test_handles_of_other_types(raw: RawCaller, shop: Counting, type_: VarType) -> None:
    """VT_UI4 from callers of ROS's bcap_service."""
    controller = Variant(type_, raw.open_workshop())
    variable = Variant(type_, raw.ask(GET_VARIABLE, controller, "v", ""))
    assert raw.ask(102, variable, 5) is None
    assert raw.ask(GET, variable) == 5
    assert raw.ask(RELEASE, variable) is None
    assert raw.ask(DISCONNECT, controller) is None
    assert shop.released == ["v", "Controller"]


# --- one client after the other ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("goodbye", [True, False])
def test_one_old_client_after_the_other(server: Server, shop: Counting, goodbye: bool) -> None:
    """Each begins with the same serials; on a serial line nothing but that tells that the one before has gone."""
    kept = []  # on UDP: a port that is free again may be the next client's
    repeats = server.url.startswith("serial") and not goodbye  # a beginning is taken for a late packet within a second
    for number in range(4):
        old = OldClient(server.url, **({"patience": 0.3, "tries": 100} if repeats else {}))
        controller = old.connect("Test.Workshop")
        assert controller == 2
        old.ask(GET_VARIABLE, controller, f"v{number}", "")
        assert old.ask(EXECUTE, controller, "Count", "same") == number + 1
        if goodbye:
            old.ask(STOP)
        if server.url.startswith("udp"):
            kept.append(old)
        else:
            old.close()
    if goodbye or not server.url.startswith("udp"):  # there they are forgotten after ten seconds
        last = 4 if goodbye or server.url.startswith("tcp") else 3
        until(lambda: len(shop.released) == 2 * last)
        assert shop.released == [name for number in range(last) for name in (f"v{number}", "Controller")]
    for old in kept:
        old.close()


@only("serial", because="a line has one client at a time")
def test_a_call_that_is_at_work_is_not_the_next_clients(server: Server, shop: Counting) -> None:
    with SerialRaw(server.url) as gone:
        handle = gone.open_workshop()
        gone.request(EXECUTE, handle, "CountLater", 1, serial=7)
        assert shop.at_work.acquire(timeout=PATIENCE)
    old = OldClient(server.url)
    controller = old.connect("Test.Workshop")
    assert shop.cancelled.acquire(timeout=PATIENCE)
    assert shop.released == ["Controller"]
    assert old.ask(EXECUTE, controller, "Count", 2) == 2
    old.close()
