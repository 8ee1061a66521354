"""The virtual VE026A over a serial line: the packets of the document, and other packets."""

from __future__ import annotations

import json
import struct
from typing import Any

import pytest

from orinkit.bcap import packet, profiles
from orinkit.bcap.actions import Close, EndSession, Execute, Send
from orinkit.bcap.packet import Packet
from orinkit.bcap.server import ServerConversation
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.outcomes import Pending
from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.ve026a import VirtualVE026A
from orinkit.virtual.ve026a.codes import OUT_OF_RANGE_AXIS1, SET_POINT_MISSED
from support import paths
from support.ve_cell import ASYNC, SYNC

VECTORS = paths.VECTORS / "bcap-packets.json"
PRINTED = [each for each in json.loads(VECTORS.read_text("utf-8")) if each["document"] == "bcap-ve026a.en.txt"]
ROBOT, CONTROLLER = 1, 1
R4_ARRAY = "VT_R4|VT_ARRAY"
PLACE = (0.0, 30.0, 120.0, 0.0, 30.0, 0.0, 25.0)


class Line:
    """A client at the other end of a line to a virtual VE026A, whose clock it moves while it waits."""

    def __init__(self, kind: profiles.BcapProfile = profiles.LINE, **options: Any) -> None:
        self.clock = ManualClock()
        self.arm = VirtualVE026A(clock=self.clock, **options)
        self.host = ProviderRegistry(self.arm)
        self.kind = kind
        self.conversation = ServerConversation(profile=kind, dialect=self.arm.dialect)
        self.session = Session(self.host, ClientInfo("/dev/ttyUSB0", "serial"))
        self.serial = 0
        self.waited = 0.0
        self.closed = False

    def exchange(self, data: bytes) -> bytes:
        """Send bytes; return all bytes received."""
        answers = b""
        for action in self.conversation.receive(data, self.clock.now()):
            if isinstance(action, Send):
                answers += action.data
            elif isinstance(action, Execute):
                reply = self._done(self.session.invoke(action.function_id, action.arguments))
                answers += self.conversation.finish(action, reply.code, reply.result)
            elif isinstance(action, EndSession):
                self.session.close()
                self.session = Session(self.host, ClientInfo("/dev/ttyUSB0", "serial"))
            else:
                assert isinstance(action, Close)
                self.session.close()
                self.closed = True
        return answers

    def _done(self, outcome: Any) -> Any:
        self.waited = 0.0
        if not isinstance(outcome, Pending):
            return outcome
        promise = outcome.work
        assert isinstance(promise, Deferred)
        while not promise.done():
            self.clock.advance(PERIOD)
            self.waited += PERIOD
            assert self.waited < 10.0
        try:
            return self.session.complete(outcome, promise.result())
        except CallError as error:
            return self.session.fail(outcome, error)

    def call(self, function: int, *arguments: Any) -> Packet:
        """Call a function; return the reply."""
        self.serial += 1
        request = Packet(self.serial, function, list(arguments), self.serial)
        answer = packet.decode(self.exchange(packet.encode(request, crc=self.kind.crc)), exact=True, crc=self.kind.crc)
        assert (answer.serial, answer.reserved) == (self.serial, self.serial)
        return answer

    def connect(self) -> Line:
        """Get the controller and the robot."""
        for function, *arguments in ((1,), (3, "", "", "", ""), (7, CONTROLLER, "VE026A", "")):
            assert self.call(function, *arguments).code == 0
        return self


def pairs():
    """Return the printed requests with their replies, in an order in which they can be executed."""
    found = list(zip(PRINTED[::2], PRINTED[1::2], strict=True))
    assert all(a["kind"] == "request" and b["kind"] == "response" and a["serial"] == b["serial"] for a, b in found)
    order = [1, 3, 9, 11, 16, 19, 22, 23, 70, 71, 5, 7]
    return sorted(found, key=lambda pair: order.index(pair[0]["serial"]))


def test_the_document_is_there():
    assert len(PRINTED) == 24
    assert {each["function_id"] for each in PRINTED} == {1, 2, 3, 4, 7, 9, 17, 62, 64, 101}


def test_the_printed_packets_are_answered_as_printed():
    line = Line(joints=PLACE)
    for request, printed in pairs():
        answer = line.exchange(bytes.fromhex(request["hex"]))
        if printed["arguments"] and printed["arguments"][0]["type"] == R4_ARRAY:
            assert len(answer) == len(printed["hex"]) // 2
            mine, theirs = (
                packet.decode(answer, exact=True, crc=True),
                packet.decode(bytes.fromhex(printed["hex"]), exact=True, crc=True),
            )
            assert mine.arguments[0].type == theirs.arguments[0].type
            assert mine.arguments[0].value == pytest.approx(
                theirs.arguments[0].value, abs=1.0
            )  # with gravity at this pose
            mine.arguments[:] = theirs.arguments
            answer = packet.encode(mine, crc=True)
        assert answer.hex() == printed["hex"], f"line {printed['line']}"
    assert line.arm.error == 0
    assert not len(line.session)


def test_the_slow_commands_of_the_document_take_their_time():
    line = Line().connect()
    assert line.call(64, ROBOT, "Motor", Variant(VarType.I2, 1)).code == 0
    assert line.waited == pytest.approx(3.0)
    assert line.call(17, CONTROLLER, "ClearError", Variant(VarType.I2, 0)) == Packet(line.serial, 0, [], line.serial)
    assert line.waited == pytest.approx(1.0)


def test_the_sample_works_in_synchronous_mode_too():
    line = Line(joints=PLACE, motor=True, strict_time=True).connect()
    assert line.call(64, ROBOT, "slvChangeMode", SYNC).arguments == []
    for number in range(20):
        answer = line.call(64, ROBOT, "slvMove", Variant(0x2004, [*PLACE, 0.0]))
        assert (answer.code, answer.arguments) == (0, [Variant(0x2004, [*PLACE, 0.0])])
        assert line.waited == pytest.approx(PERIOD if number else 0.0)
    line.clock.advance(3 * PERIOD)
    assert line.call(64, ROBOT, "slvMove", Variant(0x2004, [*PLACE, 0.0])).code & 0xFFFFFFFF == SET_POINT_MISSED


@pytest.mark.parametrize(
    "function", [number for number in (*FUNCTIONS, 138, 255, 256) if number not in VirtualVE026A.functions]
)
def test_other_functions_are_not_implemented(function):
    answer = Line().connect().call(function)
    assert (answer.code & 0xFFFFFFFF, answer.arguments) == (hresult.E_NOTIMPL, [])


@pytest.mark.parametrize("name", ["", "CaoProv.DENSO.VRC", "CaoProv.DENSO.NetwoRC", "anything"])
def test_any_provider_and_controller_name_is_accepted(name):
    line = Line()
    line.call(1)
    assert line.call(3, name, name, name, name).arguments == [variant(1)]


def test_handles_are_counted_for_each_kind_of_object():
    line = Line().connect()
    variables = {"@CURRENT_ANGLE": 1, "@SERVO_ON": 2, "@TYPE": 3}
    for _ in range(2):  # the same again
        assert {name: line.call(62, ROBOT, name, "").arguments[0].value for name in variables} == variables
        assert line.call(9, CONTROLLER, "@VERSION", "").arguments == [variant(4)]
        assert line.call(7, CONTROLLER, "", "").arguments == [variant(1)]
    assert line.call(101, 2).arguments == [Variant(VarType.I2, 0)]
    assert line.call(101, 3).arguments == [Variant(VarType.I4, 0)]
    assert line.call(101, 4).arguments[0].value.startswith("VE026A")
    assert line.call(111, 2).code == 0
    assert line.call(101, 2).code & 0xFFFFFFFF == hresult.E_HANDLE
    assert line.call(101, 3).code == 0


def test_an_error_is_answered_without_an_argument():
    line = Line(motor=True).connect()
    line.call(64, ROBOT, "slvChangeMode", ASYNC)
    answer = line.call(64, ROBOT, "slvMove", "200,0,0,0,0,0,0")
    assert (answer.code & 0xFFFFFFFF, answer.arguments) == (OUT_OF_RANGE_AXIS1, [])
    answer = line.call(64, ROBOT, "slvMode", ASYNC)
    assert (answer.code & 0xFFFFFFFF, answer.arguments) == (hresult.E_INVALIDCOMMAND, [])


@pytest.mark.parametrize(("function", "handle"), [(2, ()), (84, (ROBOT,)), (4, (CONTROLLER,))])
def test_the_end_of_a_client_ends_its_slave_mode(function, handle):
    line = Line(motor=True).connect()
    line.call(64, ROBOT, "slvChangeMode", ASYNC)
    assert line.arm.slave_mode == ASYNC
    assert line.call(function, *handle).code == 0
    assert line.arm.slave_mode == 0
    assert line.arm.servo_on


def test_getting_the_robot_again_leaves_slave_mode_alone():
    line = Line(motor=True).connect()
    line.call(64, ROBOT, "slvChangeMode", ASYNC)
    line.call(7, CONTROLLER, "", "")
    assert line.arm.slave_mode == ASYNC


def test_a_new_client_on_the_line_finds_the_arm_free():
    line = Line(motor=True).connect()
    line.call(64, ROBOT, "slvChangeMode", ASYNC)
    line.serial = 100
    line.connect()
    assert line.arm.slave_mode == 0
    assert line.call(64, ROBOT, "slvChangeMode", ASYNC).code == 0


def test_a_packet_that_cannot_be_read_ends_the_connection():
    line = Line(profiles.STREAM, motor=True).connect()
    line.call(64, ROBOT, "slvChangeMode", ASYNC)
    data = struct.pack("<BIHHiH", 1, 20, 9, 9, 64, 1) + b"\xff\xff\xff\xff\x04"
    answer = packet.decode(line.exchange(data))
    assert answer.code & 0xFFFFFFFF == hresult.E_INVALIDRCVPACKET
    assert line.closed
    assert line.arm.slave_mode == 0
