"""The virtual ABH3 and TelABH3: parameters, monitors and identifications in multi-packet messages."""

from __future__ import annotations

from collections import deque

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.abh3.session import telabh3
from orinkit.abh3.session.multipacket import exchange
from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS, TelReply
from orinkit.abh3.table.ids import CONTROL, FrameId, pgn, request, single
from orinkit.can.frame import CanFrame
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.virtual.abh3 import DataSet, Parameters
from support.abh3_cell import GO, MS, Abh3Cell

FOREVER = {"command_timeout": 0, "error_timeout": 0}


class Host:
    """Sends messages to a device and receives its replies."""

    def __init__(self, cell: Abh3Cell, host: int = 2) -> None:
        self.cell = cell
        self.host = host

    def talk(self, message: bytes) -> bytes:
        """Complete an exchange with the clock of the cell."""
        device, clock = self.cell.device, self.cell.clock
        operation = exchange(message, host=self.host, driver=device.address)
        coming: deque[CanFrame] = deque()
        given: CanFrame | None = None
        try:
            turn = next(operation)
            while True:
                for frame in turn.frames:
                    coming += device.receive(frame)
                if not coming:
                    clock.advance(turn.seconds or 0.0)
                    coming += device.advance()
                given = coming.popleft() if coming else None
                turn = operation.send(given)
        except StopIteration as end:
            answer: bytes = end.value
            return answer

    def _asked(self, message: bytes) -> TelReply:
        return telabh3.parse_reply(self.talk(message))

    def read(self, address: int) -> float:
        return PARAMETERS[address].decode(self._asked(telabh3.read_parameter(address)).word)

    def write(self, address: int, value: float) -> bool:
        """Return True if the value was accepted."""
        return not self._asked(telabh3.write_parameter(address, PARAMETERS[address].encode(value))).refused

    def monitor(self, address: int) -> float:
        return MONITORS[address].decode(self._asked(telabh3.read_monitor(address)).word)

    def refused(self, message: bytes) -> bool:
        return self._asked(message).refused


@pytest.fixture
def cell():
    return Abh3Cell(**FOREVER)


@pytest.fixture
def host(cell):
    return Host(cell)


# --- parameters ---------------------------------------------------------------------------------------------------------

VALUES = {
    0x4100: 2,
    0x4102: 1,
    0x4103: 2,
    0x4105: -1,
    0x4107: 5,
    **{0x4108 + n: 0 for n in range(8)},
    **{0x4110 + n: 0 for n in range(4)},
    0x4114: 3,
    0x4115: 4,
    0x4116: 6,
    0x4117: 0,
    0x4118: 0,
    0x4119: 0,
    0x411A: 0,
    0x6180: 0xEF,
}


def test_the_parameters_of_can():
    host = Host(Abh3Cell(single_priority=3, multi_priority=4, broadcast_priority=6, **FOREVER))
    assert {address: host.read(address) for address in VALUES} == VALUES
    assert {address for address in PARAMETERS if address < 0x5000} - set(VALUES) == {0x4101}  # it has no bit rate


@pytest.mark.parametrize(
    ("address", "value", "name"),
    [
        (0x4105, 0, "single_mode"),
        (0x4107, 31, "group"),
        (0x4114, 7, "single_priority"),
        (0x4115, 1, "multi_priority"),
        (0x4116, 2, "broadcast_priority"),
        (0x4117, 10_000, "command_timeout"),
        (0x4118, 1, "error_timeout"),
    ],
)
def test_parameters_that_are_written_take_effect(cell, host, address, value, name):
    assert host.write(address, value)
    assert getattr(cell.device.parameters, name) == value
    assert host.read(address) == value


@pytest.mark.parametrize(
    ("address", "value"),
    [
        (0x4100, 0),
        (0x4101, 250_000),
        (0x4102, 254),
        (0x4102, -1),
        (0x4102, 2),  # the host's
        (0x4103, -2),
        (0x4105, 1001),
        (0x4105, -2),
        (0x4107, 32),
        (0x4108, -1),
        (0x410F, 1001),
        (0x4110, 3),
        (0x4114, 8),
        (0x4117, 10_001),
        (0x4119, 1),
        (0x411A, 1),
        (0x5000, 6553.5),
        (0x5010, -328.0),
        (0x5020, 1.0),
        (0x5090, 25.0),
        (0x50E0, 1),
        (0x5100, 1),
        (0x5060, 1.0),  # gains are not simulated
        (0x5180, 1),
        (0x6180, 0xEE),
    ],
)
def test_invalid_writes_are_refused(cell, host, address, value):
    before = cell.device.parameters
    state = cell.device.state()
    assert not host.write(address, value)
    assert cell.device.parameters == before
    assert cell.device.state().external == state.external


def test_fixed_parameters_may_be_written_with_their_value(host):
    for address in (0x4100, 0x4110, 0x4119, 0x411A, 0x6180, 0x5020, 0x5087, 0x50A0, 0x5030, 0x50B7):
        assert host.write(address, host.read(address))


def test_another_address(cell, host):
    assert host.write(0x4102, 77)  # the answer still comes from address 1
    assert cell.device.address == 77
    assert cell.device.receive(CanFrame(single(1, 2), bytes(8))) == []
    assert cell.device.receive(CanFrame(single(77, 2), bytes(8)))[0].id == single(2, 77)
    assert host.read(0x4102) == 77


def test_another_host(cell, host):
    assert host.write(0x4103, 9)
    assert cell.device.receive(cell.frame()) == []
    assert len(cell.device.receive(cell.frame(host=9))) == 1
    third = Host(cell, 9)
    assert third.write(0x4103, -1)
    assert cell.device.parameters.host is None
    assert Host(cell, 200).read(0x4103) == -1


def test_another_group(cell, host):
    assert host.write(0x4107, 16)
    (answer,) = cell.device.receive(CanFrame(request(1, 2), pgn(0xFF, 0x80)))
    assert answer.id == 0x00FF8001


def test_periods_begin_when_they_are_written(cell, host):
    cell.wait(0.333)
    assert host.write(0x410A, 50)
    assert cell.device.parameters.broadcast_modes == (0, 0, 50, 0, 0, 0, 0, 0)
    began = cell.clock.now()
    assert cell.device.due() == pytest.approx(began + 0.05)
    cell.wait(0.05)
    assert [frame.id for frame in cell.device.advance()] == [0x00FF2A01]
    assert host.write(0x4107, 5)  # others are unchanged
    assert cell.device.due() == pytest.approx(began + 0.1)
    assert host.write(0x410A, 0)
    assert cell.device.due() is None


def test_a_shorter_time_out_takes_effect_at_once(cell, host):
    cell.wait(5)
    assert host.write(0x4118, 100)
    assert "can_communication" in cell.br0().errors


def test_data_sets(cell, host):
    for address, value in ((0x5003, 123.5), (0x500B, -7.0), (0x5013, 12.5), (0x501B, -1.0), (0x50E3, 0), (0x50F3, 0)):
        assert host.write(address, value)
        assert host.read(address) == value
    assert cell.device.parameters.ay_sets[3] == DataSet("internal", 123.5, 12.5)
    assert cell.device.parameters.bx_sets[3] == DataSet("internal", -7.0, -1.0)
    assert (host.read(0x50E0), host.read(0x50F7)) == (2, 2)
    cell.put(0, 0, *GO, sel=3)
    cell.wait(1)
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity) == (123.5, -7)
    assert host.write(0x50E3, 2)
    cell.wait(1)
    assert cell.device.state().ay_velocity == 0


def test_times_of_data_sets_are_those_of_the_parameters():
    host = Host(Abh3Cell(acceleration_time=1.5, deceleration_time=0.5, **FOREVER))
    assert [host.read(address) for address in (0x5020, 0x5087, 0x5040, 0x50A7, 0x5030, 0x50B0)] == [
        1.5,
        1.5,
        0.5,
        0.5,
        0,
        0,
    ]


def test_switches_are_terminals(cell, host):
    cell.put(500, 500, *GO)
    cell.wait(1)
    assert (host.read(0x5100), host.read(0x5127)) == (telabh3.ON, telabh3.ON)
    assert host.write(0x5121, telabh3.OFF)
    assert host.read(0x5121) == telabh3.OFF
    cell.wait(1)
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity, state.bx_servo) == (100, 0, True)
    assert host.write(0x5107, telabh3.OFF)
    assert cell.device.state().ay_set == 1
    assert host.write(0x5107, telabh3.ON)
    assert cell.device.state().ay_set == 0


# --- monitors -----------------------------------------------------------------------------------------------------------


def test_monitors_agree_with_the_broadcasts():
    cell = Abh3Cell(model="travel", main_voltage=23.5, **FOREVER)
    host = Host(cell)
    cell.put(500, 100, *GO)
    cell.wait(0.5)
    cell.device.set_terminal("di_12", True)
    read = {address: host.monitor(address) for address in MONITORS}
    state = cell.device.state()
    assert read == {
        0x0000: state.errors.value,
        0x0001: state.warnings.value,
        0x0002: 1 << 12,
        0x0003: state.control.value,
        0x0004: 0,
        0x0005: state.io.value,
        0x1004: 23.5,
        0x1005: 24,
        0x1012: state.ay_velocity,
        0x1022: state.bx_velocity,
        0x1031: pytest.approx(10),
        0x103B: pytest.approx(10),
        0x1041: pytest.approx(0),
        0x104B: pytest.approx(0),
        0x1054: pytest.approx(state.a_pulses, abs=100),  # it turns during the request
        0x1064: pytest.approx(state.b_pulses, abs=100),
    }
    assert state.ay_velocity == 100
    cell.device.inject("overheat")
    assert host.monitor(0) == cell.device.state().errors.value == 4


def test_digital_outputs():
    cell = Abh3Cell(dialect="v2", **FOREVER)
    host = Host(cell)
    assert host.write(0x5182, 0xFFFFFFFF)
    assert host.write(0x5187, 0xFFFFFFFF)
    assert (host.read(0x5182), host.read(0x5183)) == (0xFFFFFFFF, 0)
    assert host.monitor(0x0004) == 0x84000000
    assert list(cell.br1_v2().io) == ["do_2", "do_7"]
    assert host.write(0x5182, 0)
    assert list(cell.br1_v2().io) == ["do_7"]


# --- the rest -----------------------------------------------------------------------------------------------------------


def test_identifications(host):
    texts = [telabh3.parse_reply(host.talk(telabh3.read_identification(n))).confirmed() for n in (0, telabh3.VERSION)]
    assert texts == ["ABH3", "orinkit virtual ABH3"]


@pytest.mark.parametrize(
    "message",
    [
        telabh3.read_parameter(0x7001),
        telabh3.read_parameter(0x4101),
        telabh3.write_parameter(0x7001, 1),
        telabh3.read_monitor(0x9999),
        telabh3.read_identification(99),
        b"CP000000",
        b"hello",
        b"\xff" * 1785,
    ],
    ids=repr,
)
def test_unknown_addresses_are_refused(host, message):
    assert host.refused(message)


def test_every_address_that_is_known_is_answered(cell, host):
    answered = {address for address in PARAMETERS if not host.refused(telabh3.read_parameter(address))}
    gains = {address for address in PARAMETERS if "gain" in PARAMETERS[address].english}
    assert set(PARAMETERS) - answered == gains | {0x4101}
    for address in MONITORS:
        assert not host.refused(telabh3.read_monitor(address))


def test_other_hosts_are_not_served(cell):
    rts = CanFrame(int(FrameId(CONTROL, 1, 3)), bytes.fromhex("10090002ff00ef00"))
    assert cell.device.receive(rts) == []
    assert len(cell.device.receive(rts._replace(id=int(FrameId(CONTROL, 1, 2))))) == 1


def test_a_silent_host_is_notified_and_then_forgotten(cell):
    rts = CanFrame(int(FrameId(CONTROL, 1, 2)), bytes.fromhex("10090002ff00ef00"))
    assert cell.device.receive(rts)
    frames = []
    for _ in range(10):
        due = cell.device.due()
        if due is None:
            break
        cell.wait(due - cell.clock.now() + 0.1 * MS)
        frames += cell.device.advance()
    assert cell.device.due() is None
    assert frames[-1].data[0] == 0xFF
    assert cell.clock.now() < 5


def test_written_parameters_take_effect_even_if_the_reply_is_not_read(cell):
    message = telabh3.write_parameter(0x4107, 9)
    frames = [CanFrame(int(FrameId(CONTROL, 1, 2)), bytes((0x10, len(message), 0, 3, 0xFF, 0, 0xEF, 0)))]
    padded = message.ljust(21, b"\xff")
    frames += [CanFrame(int(FrameId(0xEB, 1, 2)), bytes((n + 1,)) + padded[7 * n : 7 * n + 7]) for n in range(3)]
    for frame in frames:
        cell.device.receive(frame)
    assert cell.device.parameters.group == 5
    cell.wait(10)
    cell.device.advance()
    assert cell.device.parameters.group == 9


def test_multi_packet_messages_do_not_keep_it_going():
    cell = Abh3Cell()
    host = Host(cell)
    for _ in range(12):
        cell.wait(0.1)
        host.read(0x4102)
    assert "can_communication" in cell.br0().errors


WORDS = st.one_of(st.integers(0, 300), st.integers(0, 0xFFFFFFFF), st.sampled_from([0x8000, 0xFFFFFFFF]))


@given(st.lists(st.tuples(st.sampled_from(sorted(PARAMETERS)), WORDS), max_size=8))
@settings(deadline=None)
def test_random_writes_do_no_harm(writes):
    cell = Abh3Cell()
    for address, word in writes:
        for message in (telabh3.write_parameter(address, word), telabh3.read_parameter(address)):
            given_host = cell.device.parameters.host
            Host(cell, 253 - cell.device.address if given_host is None else given_host).talk(message)
        assert not cell.device.state().moving


def test_texts_are_in_both_languages(cell):
    before = i18n.current()
    i18n.use("ja")
    try:
        for call in (
            lambda: cell.device.inject("x"),
            lambda: Parameters(group=99),
            lambda: cell.device.set_analog(2, 0),
        ):
            with pytest.raises(InvalidValue, match=r"[ぁ-ん]"):
                call()
    finally:
        i18n.use(before)
