"""Deadlines of calls, and floods of packets that are not the reply, without I/O and on a manual clock."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.bcap.client import BcapConversation as BcapConversation
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM, BcapProfile
from orinkit.cao.call_limits import AT_ONCE, PER_SECOND
from orinkit.cao.dialect import VE026A
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, ProtocolError
from orinkit.ecap.client import EcapConversation as EcapConversation

pytestmark = pytest.mark.core

WIRES = {"tcp": STREAM, "udp": DATAGRAM, "serial": LINE, "http": None}
SECONDS = 3.0


class TimedConversation:
    """A conversation with a manual clock."""

    def __init__(self, wire: BcapProfile | None) -> None:
        self.now = 100.0
        self.wire = wire
        clock = lambda: self.now  # noqa: E731 - a name for one call
        self.conversation: Any = (
            EcapConversation(clock=clock) if wire is None else BcapConversation(profile=wire, clock=clock)
        )

    def call(self, deadline: float | None, tries: int = 3) -> tuple[Any, float]:
        operation = self.conversation.call(f.variable_get_value, (3,), SECONDS, tries=tries, deadline=deadline)
        request, seconds = next(operation)
        self.serial = 0 if self.wire is None else int.from_bytes(request[5:7], "little")
        return operation, seconds

    def packet(self, serial: int, code: int) -> bytes:
        crc = self.wire is not None and self.wire.crc
        return packet.encode(Packet(serial, code, [], reserved=0), crc=crc)

    @property
    def executing(self) -> bytes:
        return b"\n" if self.wire is None else self.packet(self.serial, hresult.S_EXECUTING)

    @property
    def foreign(self) -> bytes:
        return self.packet(60_000, 0)


@pytest.fixture(params=WIRES)
def timed(request: pytest.FixtureRequest) -> TimedConversation:
    return TimedConversation(WIRES[request.param])


def test_s_executing_does_not_extend_a_deadline(timed: TimedConversation) -> None:
    operation, seconds = timed.call(deadline=10.0)
    assert seconds == SECONDS
    for passed, wait in ((2.0, 3.0), (4.0, 3.0), (8.0, 2.0), (9.5, 0.5)):
        timed.now = 100.0 + passed
        assert operation.send(timed.executing) == (b"", pytest.approx(wait))
    timed.now = 110.5
    assert operation.send(timed.executing) == (b"", 0.0)
    with pytest.raises(
        CallTimeout, match=r"deadline of 10 s; the controller reported that the call was still executing"
    ) as late:
        operation.send(None)
    assert (late.value.executing, late.value.seconds) == (True, 10.0)
    again = pickle.loads(pickle.dumps(late.value))
    assert (again.executing, str(again)) == (True, str(late.value))
    i18n.use("ja")
    assert "期限の 10 秒以内" in str(late.value)


def test_a_deadline_before_the_time_out(timed: TimedConversation) -> None:
    operation, seconds = timed.call(deadline=1.0)
    assert seconds == 1.0
    with pytest.raises(CallTimeout, match="no reply within 1 s") as late:
        operation.send(None)
    assert not late.value.executing


def test_a_time_out_before_the_deadline(timed: TimedConversation) -> None:
    operation, seconds = timed.call(deadline=100.0, tries=1)
    assert seconds == SECONDS
    with pytest.raises(CallTimeout, match="no reply within 3 s"):
        operation.send(None)


def test_the_end_of_the_connection_before_the_deadline(timed: TimedConversation) -> None:
    operation, _ = timed.call(deadline=1.0)
    with pytest.raises(ConnectionLost):
        operation.send(b"")


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_a_deadline_ends_the_attempts(kind: str) -> None:
    timed = TimedConversation(WIRES[kind])
    operation, _ = timed.call(deadline=4.0, tries=7)
    timed.now += 3.0
    data, seconds = operation.send(None)
    assert data
    assert seconds == pytest.approx(1.0)
    timed.now += 1.0
    with pytest.raises(CallTimeout, match="sent 2 times"):
        operation.send(None)


def test_a_busy_controller_is_reported_at_the_deadline() -> None:
    timed = TimedConversation(DATAGRAM)
    timed.conversation.dialect = VE026A
    operation, _ = timed.call(deadline=4.0, tries=7)
    timed.now += 3.0
    data, _ = operation.send(None)
    serial = int.from_bytes(data[5:7], "little")
    operation.send(timed.packet(serial, VE026A.busy_code))
    timed.now += 1.0
    with pytest.raises(CallError):
        operation.send(None)


def flood(timed: TimedConversation, operation: Any, data: bytes, count: int) -> None:
    for _ in range(count):
        operation.send(data)


@pytest.mark.parametrize("what", ["executing", "foreign"])
def test_a_flood_ends_the_call_and_the_connection(timed: TimedConversation, what: str) -> None:
    if what == "foreign" and timed.wire is None:
        return  # HTTP has no foreign packets
    operation, _ = timed.call(deadline=None)
    flood(timed, operation, getattr(timed, what), AT_ONCE)
    with pytest.raises(ProtocolError, match="packets per second, but not the reply") as error:
        operation.send(getattr(timed, what))
    assert error.value.fatal
    i18n.use("ja")
    with pytest.raises(ProtocolError, match="接続を閉じました"):
        operation, _ = timed.call(deadline=None)
        flood(timed, operation, getattr(timed, what), AT_ONCE + 1)


def test_a_moderate_rate_is_accepted(timed: TimedConversation) -> None:
    operation, _ = timed.call(deadline=None)
    for _ in range(20):
        flood(timed, operation, timed.executing, PER_SECOND)
        timed.now += 1.0
    flood(timed, operation, timed.executing, AT_ONCE)  # the program was suspended
    operation.close()


def test_invalid_datagrams_are_counted_and_bytes_on_a_serial_line_are_not() -> None:
    for wire, floods in ((DATAGRAM, True), (LINE, False)):
        timed = TimedConversation(wire)
        operation, _ = timed.call(deadline=None)
        if floods:
            with pytest.raises(ProtocolError, match="packets per second, but not the reply"):
                flood(timed, operation, b"junk", AT_ONCE + 1)
        else:
            flood(timed, operation, b"j", 2 * AT_ONCE)
            operation.close()
