"""Faults of the virtual ABH3: time-outs, errors, the reset."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.abh3.table.ids import pgn, request
from orinkit.abh3.table.signals import V1
from orinkit.can.frame import CanFrame
from support.abh3_cell import GO, MS, Abh3Cell

BOTH = pytest.mark.parametrize("dialect", ["v1", "v2"])
CAN = 0x00400000
FAULTS = [bit.name for bit in V1.errors.bits]


def wrong(cell: Abh3Cell) -> tuple[bool, bool]:
    """Return error and warning of CAN communication from the state of the device."""
    state = cell.device.state()
    return "can_communication" in state.errors, "can_communication" in state.warnings


# --- time-outs ----------------------------------------------------------------------------------------------------------


@BOTH
def test_time_outs_run_from_power_on(dialect):
    cell = Abh3Cell(dialect=dialect)
    cell.wait(0.499)
    assert wrong(cell) == (False, False)
    cell.wait(MS)
    assert wrong(cell) == (False, True)
    cell.wait(0.499)
    assert wrong(cell) == (False, True)
    cell.wait(MS)
    assert wrong(cell) == (True, True)


def test_words_of_v1_after_silence():
    cell = Abh3Cell(model="travel")
    cell.wait(0.5)
    assert (cell.br0().errors.value, cell.br0().warnings.value) == (0, CAN)
    assert cell.br1().io.value == 0b10
    cell.wait(2)
    assert (cell.br0().errors.value, cell.br0().warnings.value) == (CAN, CAN)
    assert (cell.br1().control.value, cell.br1().io.value) == (0x08070070, 0x000000C3)


def test_words_of_v2_after_silence():
    cell = Abh3Cell(dialect="v2")
    cell.wait(2)
    assert (cell.br0().errors.value, cell.br0().warnings.value) == (CAN | 3 << 28, CAN | 3 << 28)
    assert cell.put().control.value == 0x80000000
    assert cell.br1_v2().io.value == 0


def test_nothing_but_a_command_of_the_host_restarts_them():
    cell = Abh3Cell()
    for _ in range(20):
        cell.wait(0.05)
        cell.device.receive(CanFrame(request(1, 2), pgn(0xEF, 0)))
        cell.device.receive(CanFrame(request(0xFF, 2), pgn(0xFF, 0x28)))
        cell.device.receive(cell.frame(host=3))
        cell.device.receive(cell.frame()._replace(data=bytes(7)))
        cell.device.receive(CanFrame(0x01EF0102, b""))
        cell.device.advance()
    assert wrong(cell) == (True, True)


def test_commands_in_time_keep_it_going():
    cell = Abh3Cell()
    for _ in range(20):
        cell.wait(0.499)
        cell.put(1000, 0, *GO)
    assert wrong(cell) == (False, False)
    assert cell.device.state().ay_velocity == 200


@pytest.mark.parametrize(("command", "error"), [(0, 0), (200, 0), (0, 200), (300, 200), (10_000, 10_000)])
def test_time_outs_of_the_parameters(command, error):
    cell = Abh3Cell(command_timeout=command, error_timeout=error)
    cell.wait(0.1)
    cell.put()
    cell.wait(0.2)
    assert wrong(cell) == (error == 200, command == 200)
    cell.wait(20)
    assert wrong(cell) == (error > 0, command > 0)


def test_a_time_out_is_never_early():
    cell = Abh3Cell(command_timeout=100)
    cell.wait(0.0104)
    cell.put()
    cell.wait(0.1)
    assert wrong(cell) == (False, False)
    cell.wait(MS)
    assert wrong(cell) == (False, True)


def test_silence_stops_the_motors_with_the_servo_on():
    cell = Abh3Cell()
    cell.put(5000, 0, *GO)
    cell.wait(0.5)
    assert cell.device.state().ay_velocity == 1000
    cell.wait(50 * MS)
    state = cell.device.state()
    assert (state.ay_velocity, state.ay_velocity_command, state.ay_servo) == (700, 0, True)
    assert "ay_start" in state.control
    assert "ay_busy" not in state.io
    cell.wait(0.2)
    assert (cell.device.state().ay_velocity, cell.device.state().ay_servo) == (0, True)
    cell.wait(1)
    assert (cell.device.state().ay_velocity, cell.device.state().ay_servo) == (0, False)


def test_a_warning_alone_ends_with_the_next_command():
    cell = Abh3Cell()
    cell.put(5000, 0, *GO)
    cell.wait(0.55)
    assert wrong(cell) == (False, True)
    cell.put(5000, 0, *GO)
    assert wrong(cell) == (False, False)
    cell.wait(MS)
    assert cell.device.state().ay_velocity == 706


def test_an_error_stays_until_it_is_reset():
    cell = Abh3Cell()
    cell.hold(1, 5000, 0, *GO)
    cell.wait(5)
    cell.hold(1, 5000, 0, *GO)
    assert wrong(cell) == (True, True)
    state = cell.device.state()
    assert (state.moving, state.ay_servo) == (False, False)
    cell.reset()
    assert wrong(cell) == (False, False)
    cell.hold(1, 5000, 0, *GO)
    assert cell.device.state().ay_velocity == 1000


@given(
    st.sampled_from(["v1", "v2"]),
    st.lists(
        st.tuples(st.integers(-32768, 32767), st.integers(0, 0xFFFFFFFF), st.floats(0, 3)), min_size=1, max_size=6
    ),
    st.floats(0, 20),
)
@settings(deadline=None)
def test_no_motion_is_left_after_the_time_outs(dialect, commands, later):
    cell = Abh3Cell(dialect=dialect)
    for code, inputs, seconds in commands:
        cell.device.receive(cell.frame(code, -code // 3, inputs))
        cell.wait(seconds)
    cell.wait(6)  # 0.5 s, and 5 s of coasting at most
    before = cell.device.state()
    assert not before.moving
    assert wrong(cell) == (True, True)
    cell.wait(later)
    after = cell.device.state()
    assert (after.a_pulses, after.b_pulses, after.moving) == (before.a_pulses, before.b_pulses, False)


# --- the reset ----------------------------------------------------------------------------------------------------------


@BOTH
def test_a_reset_takes_effect_a_little_later(dialect):
    cell = Abh3Cell(dialect=dialect)
    cell.wait(3)
    cell.put(0, 0, "error_reset")
    assert (cell.br0().errors.value & CAN, cell.br0().warnings.value & CAN) == (CAN, CAN)
    cell.wait(0.9 * MS)
    assert cell.br0().errors.value & CAN
    cell.wait(0.1 * MS)
    assert (cell.br0().errors.value, cell.br0().warnings.value) == (0, 0)


def test_a_reset_within_a_cycle_takes_effect_no_earlier():
    cell = Abh3Cell()
    cell.wait(3.0007)
    cell.put(0, 0, "error_reset")
    cell.wait(0.9 * MS)
    assert wrong(cell) == (True, True)
    cell.wait(MS)
    assert wrong(cell) == (False, False)


def test_only_the_edge_resets():
    cell = Abh3Cell()
    cell.hold(0.1, 0, 0, "error_reset")
    cell.device.inject("overheat")
    cell.hold(0.3, 0, 0, "error_reset")
    assert list(cell.br0().errors) == ["overheat"]
    cell.hold(0.1)
    assert list(cell.br0().errors) == ["overheat"]
    cell.reset()
    assert list(cell.br0().errors) == []


def test_a_bit_that_was_on_for_less_than_a_cycle_resets_too():
    cell = Abh3Cell()
    cell.wait(3)
    cell.put(0, 0, "error_reset")
    cell.wait(0.2 * MS)
    cell.put()
    cell.put(0, 0, "error_reset")
    cell.put()
    assert wrong(cell) == (True, True)
    cell.wait(MS)
    assert wrong(cell) == (False, False)


def test_the_servo_is_off_while_the_reset_is_on():
    cell = Abh3Cell()
    cell.hold(1, 1000, 0, *GO, "error_reset")
    state = cell.device.state()
    assert (state.ay_servo, state.moving) == (False, False)
    assert "ay_servo_on" in state.control
    cell.hold(1, 1000, 0, *GO)
    assert cell.device.state().ay_velocity == 200


def test_the_terminal_resets_only_errors_without_a_cause():
    cell = Abh3Cell()
    cell.wait(3)
    cell.device.set_terminal("error_reset", True)
    cell.wait(1)
    assert wrong(cell) == (True, True)  # the host is still silent
    cell.device.set_terminal("error_reset", False)
    cell.put()
    cell.device.set_terminal("error_reset", True)
    cell.wait(2 * MS)
    assert wrong(cell) == (False, False)


def test_a_reset_during_a_warning_does_not_end_silence():
    cell = Abh3Cell()
    cell.wait(0.6)
    cell.device.set_terminal("error_reset", True)
    cell.wait(0.1)
    assert wrong(cell) == (False, True)


# --- other faults -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", FAULTS)
@BOTH
def test_an_error_stops_the_motors_and_is_latched(dialect, fault):
    cell = Abh3Cell(dialect=dialect)
    cell.hold(1, 5000, 0, *GO)
    cell.device.inject(fault)
    state = cell.device.state()
    assert state.errors.value & 0xFFFFFF == V1.errors.mask(fault)
    code = 3 if fault == "can_communication" else 15
    assert state.errors.value >> 28 == (code if dialect == "v2" else 0)
    assert (state.io.value & 0x3C1 == code << 6 | 1) == (dialect == "v1")
    assert (state.ay_velocity, state.ay_servo) == (1000, True)
    cell.hold(0.1, 5000, 0, *GO)
    assert cell.device.state().ay_velocity == 400
    cell.hold(0.5, 5000, 0, *GO)
    state = cell.device.state()
    assert (state.ay_velocity, state.ay_servo, state.errors.value == 0) == (0, False, False)
    cell.reset()
    assert cell.br0().errors.value == 0
    cell.hold(1, 5000, 0, *GO)
    assert cell.device.state().ay_velocity == 1000


def test_a_fault_of_both_axes():
    cell = Abh3Cell()
    cell.device.inject("overspeed")
    assert list(cell.br0().errors) == ["a_overspeed", "b_overspeed"]


def test_an_error_whose_cause_remains_cannot_be_reset():
    cell = Abh3Cell()
    cell.put()
    cell.device.inject("main_undervoltage", stays=True)
    cell.device.inject("a_resolver")
    cell.reset()
    assert list(cell.br0().errors) == ["main_undervoltage"]
    cell.device.repair("main_undervoltage")
    assert list(cell.br0().errors) == ["main_undervoltage"]
    cell.reset()
    assert list(cell.br0().errors) == []


def test_an_axis_that_coasts_gets_no_servo_during_an_error():
    cell = Abh3Cell()
    cell.hold(1, 5000, 0, *GO)
    cell.put()
    cell.device.inject("overheat")
    cell.put(5000, 0, *GO)
    cell.wait(0.1)
    state = cell.device.state()
    assert (state.ay_servo, state.ay_velocity) == (False, 940)


def test_the_servo_can_be_switched_off_during_an_error():
    cell = Abh3Cell()
    cell.hold(1, 5000, 0, *GO)
    cell.device.inject("overheat")
    cell.put(5000, 0)
    assert not cell.device.state().ay_servo
    cell.put(5000, 0, *GO)
    assert not cell.device.state().ay_servo
