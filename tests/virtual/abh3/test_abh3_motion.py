"""The virtual ABH3 moves: control flags, data sets, ramps, torque, the travel model, pulses, loads."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.abh3.table.signals import DIALECTS, TerminalGate
from orinkit.virtual.abh3 import DataSet, Parameters
from orinkit.virtual.abh3.axis import FINE, AxisLimits, AxisMode, MotorAxis
from orinkit.virtual.abh3.drive import velocity, wrapped
from orinkit.virtual.abh3.flags import Inputs
from support.abh3_cell import GO, MS, Abh3Cell

BOTH = pytest.mark.parametrize("dialect", ["v1", "v2"])
FOREVER = {"command_timeout": 0, "error_timeout": 0}
STEP = 6.0  # min^-1 in 1 ms, if 3000 min^-1 take 0.5 s


# --- control flags ------------------------------------------------------------------------------------------------------


def test_no_input_at_all_is_data_set_7_in_v1():
    cell = Abh3Cell()
    assert cell.br1().control.value == 0x00070070
    assert Abh3Cell(model="travel").br1().control.value == 0x08070070


def test_no_input_at_all_is_nothing_in_v2():
    cell = Abh3Cell(dialect="v2")
    assert cell.device.receive(cell.frame())[0].data[4:] == bytes(4)
    travel = Abh3Cell(dialect="v2", model="travel")
    assert travel.device.receive(travel.frame())[0].data[4:] == bytes.fromhex("00000020")


@pytest.mark.parametrize("name", DIALECTS)
@given(can=st.integers(0, 0xFFFFFFFF), external=st.integers(0, 0xFFFFFFFF))
def test_control_flags_are_what_the_table_makes_of_input_and_terminal(name, can, external):
    dialect = DIALECTS[name]
    inputs = Inputs(dialect)
    inputs.can, inputs.external = can, external
    rules = {
        TerminalGate.AND: lambda a, b: a and b,
        TerminalGate.OR: lambda a, b: a or b,
        TerminalGate.NOT_AND: lambda a, b: not (a and b),
    }
    expected = 0
    for bit in dialect.inputs.bits:
        assert bit.gate is not None
        expected |= bool(rules[bit.gate](can >> bit.number & 1, external >> bit.number & 1)) << bit.number
    assert inputs.control == expected


@pytest.mark.parametrize("name", DIALECTS)
def test_terminals_are_at_first_as_can_alone_needs_them(name):
    inputs = Inputs(DIALECTS[name])
    for bit in DIALECTS[name].inputs.bits:
        assert bool(inputs.external >> bit.number & 1) == (bit.gate is not TerminalGate.OR)


@BOTH
def test_a_terminal_that_is_off_holds_its_axis(dialect):
    cell = Abh3Cell(dialect=dialect)
    cell.device.set_terminal("bx_servo_on", False)
    cell.hold(1, 1000, 1000, *GO)
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity) == (200, 0)
    assert (state.ay_servo, state.bx_servo) == (True, False)
    cell.device.set_terminal("bx_servo_on", True)
    cell.hold(1, 1000, 1000, *GO)
    assert cell.device.state().bx_velocity == 200
    cell.device.set_terminal("start", False)
    cell.hold(1, 1000, 1000, *GO)
    assert not cell.device.state().moving


@BOTH
def test_digital_inputs_are_shown(dialect):
    cell = Abh3Cell(dialect=dialect)
    for n in range(20):
        cell.device.set_terminal(f"di_{n}", True)
        assert list(cell.device.state().io) == [f"di_{n}"]
        cell.device.set_terminal(f"di_{n}", False)
    cell.device.set_terminal("error_reset", True)
    assert list(cell.device.state().io) == ["error_reset_input"]


def test_v2_shows_its_terminals_in_broadcast_1():
    cell = Abh3Cell(dialect="v2")
    assert cell.br1_v2().external.value == 0x000FFFFF
    cell.device.set_terminal("ay_polarity", False)
    cell.device.set_terminal("di_3", True)
    record = cell.br1_v2()
    assert record.external.value == 0x000FFFFB
    assert record.io.value == 1 << 11


def test_io_flags_of_v1_contain_ready_busy_and_brake():
    cell = Abh3Cell()
    assert cell.br1().io.value == 0
    cell.put(100, 0, "ay_servo_on")
    assert list(cell.br1().io) == ["ay_ready", "brake_released"]
    cell.put(100, 0, *GO)
    assert list(cell.br1().io) == ["ay_ready", "ay_busy", "bx_ready", "brake_released"]
    cell.put(0, 0, "brake_release")
    assert list(cell.br1().io) == ["brake_released"]


# --- data sets ----------------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("number", range(8))
def test_select_bits_choose_the_data_set(dialect, number):
    sets = [DataSet("internal", 10.0 * n) for n in range(8)]
    cell = Abh3Cell(dialect=dialect, ay_sets=sets)
    cell.hold(0.2, 500, 500, *GO, sel=number)
    state = cell.device.state()
    assert (state.ay_set, state.bx_set) == (number, number)
    assert (state.ay_velocity, state.bx_velocity) == (10.0 * number, 100)


def test_v1_inverts_select_bits_and_v2_does_not():
    for dialect, number in (("v1", 1), ("v2", 6)):
        cell = Abh3Cell(dialect=dialect)
        cell.device.receive(cell.frame(0, 0, cell.mask("select_1", "select_2")))
        assert cell.device.state().ay_set == number


def test_an_internal_current():
    cell = Abh3Cell(ay_sets=[DataSet("internal", 10.0, 50.0)] * 8)
    cell.put(0, 0, *GO, "torque")
    assert cell.br3().ay_current_command == 50


# --- ramps --------------------------------------------------------------------------------------------------------------


def test_it_accelerates_and_decelerates_according_to_its_parameters():
    cell = Abh3Cell(acceleration_time=1.0, deceleration_time=0.25)  # 3 and 12 min^-1 in 1 ms
    cell.put(15_000, -15_000, *GO)
    velocities = []
    for _ in range(400):
        cell.wait(MS)
        velocities.append(cell.device.state().ay_velocity)
    assert velocities == [3.0 * n for n in range(1, 401)]
    assert cell.device.state().bx_velocity == -1200
    cell.put(0, 0, *GO)
    cell.wait(50 * MS)
    assert cell.device.state().ay_velocity == 600
    cell.wait(51 * MS)
    assert cell.device.state().ay_velocity == 0


def test_it_turns_round_with_deceleration_first():
    cell = Abh3Cell(acceleration_time=1.0, deceleration_time=0.5, **FOREVER)
    cell.put(500, 0, *GO)
    cell.wait(1)
    cell.put(500, 0, *GO, "ay_polarity")
    found = []
    for _ in range(54):
        cell.wait(MS)
        found.append(cell.device.state().ay_velocity)
    assert found[:17] == [max(100.0 - 6 * n, 0) for n in range(1, 18)]
    assert found[17:] == [max(-3.0 * n, -100.0) for n in range(1, 38)]


def test_start_off_stops_with_the_servo_on():
    cell = Abh3Cell(**FOREVER)
    cell.put(5000, 0, *GO)
    cell.wait(1)
    cell.put(5000, 0, "servo_on")
    state = cell.device.state()
    assert (state.ay_velocity, state.ay_velocity_command, state.ay_servo) == (1000, 0, True)
    assert "ay_busy" not in state.io
    cell.wait(100 * MS)
    assert cell.device.state().ay_velocity == 400
    cell.wait(67 * MS)
    assert (cell.device.state().ay_velocity, cell.device.state().ay_servo) == (0, True)


@pytest.mark.parametrize("names", [(), ("servo_on", "start", "error_reset")])
def test_without_servo_it_coasts_until_friction_has_stopped_it(names):
    cell = Abh3Cell(friction=10.0, inertia=0.5, **FOREVER)  # 0.6 min^-1 in 1 ms
    cell.put(5000, 0, *GO)
    cell.wait(1)
    cell.put(5000, 0, *names)
    cell.wait(100 * MS)
    state = cell.device.state()
    assert state.ay_velocity == pytest.approx(940)
    assert (state.ay_servo, state.ay_current_command, state.a_load) == (False, 0, 0)
    cell.wait(2)
    assert not cell.device.state().moving


def test_the_speed_limit_holds():
    cell = Abh3Cell(speed_limit=800.0, **FOREVER)
    cell.put(32767, -32768, *GO)
    cell.wait(10)
    record = cell.br2()
    assert (record.ay_velocity, record.bx_velocity) == (800, -800)
    assert (record.ay_velocity_command, record.bx_velocity_command) == (800, -800)


def test_velocities_beyond_the_codes_are_held_at_the_last_one():
    cell = Abh3Cell(model="travel", rated_speed=6553.4, speed_limit=6553.4, **FOREVER)
    cell.put(32767, -32768, *GO)
    cell.wait(10)
    record = cell.codec.decode("DP0R", cell.device.receive(cell.frame(0, 0))[0].data)
    assert record.raw_values == {"a_velocity": 0, "b_velocity": 32767, "y_velocity": 32767, "x_velocity": -32767}


@given(
    st.sampled_from(["v1", "v2"]),
    st.lists(
        st.tuples(
            st.integers(-32768, 32767),
            st.integers(-32768, 32767),
            st.integers(0, 0xFFFFFFFF),
            st.integers(1, 400),
        ),
        max_size=12,
    ),
)
@settings(deadline=None, max_examples=40)
def test_velocities_never_change_faster_than_the_limits(dialect, commands):
    cell = Abh3Cell(dialect=dialect, acceleration_time=1.0, deceleration_time=0.5, inertia=0.25, current_limit=100.0)
    torque = 3000 / 250 * 1.05  # rated current and friction
    before = cell.device.state()
    for ay, bx, inputs, cycles in commands:
        cell.device.receive(cell.frame(ay, bx, inputs))
        names = before.control.word.masks
        for _ in range(cycles):
            cell.wait(MS)
            state = cell.device.state()
            for axis in ("ay", "bx"):
                was, now = getattr(before, f"{axis}_velocity"), getattr(state, f"{axis}_velocity")
                assert abs(now) <= 3000
                driven = state.control.value & names[f"{axis}_torque"]
                slower = abs(now) <= abs(was)
                limit = torque if driven else 6.0 if slower or was * now < 0 else 3.0
                assert abs(now - was) <= limit + 1e-6
            before = state


# --- torque -------------------------------------------------------------------------------------------------------------


def test_torque_beyond_friction_accelerates_to_the_speed_limit():
    cell = Abh3Cell(friction=5.0, inertia=0.5, speed_limit=2000.0, **FOREVER)
    cell.put(1500, 400, *GO, "torque")  # 15 %, and 4 %, which does not overcome friction
    record = cell.br3()
    assert (record.ay_current_command, record.bx_current_command) == (15, 4)
    assert cell.br2().ay_velocity_command == 0
    assert "ay_busy" in cell.br1().io
    cell.wait(1)
    state = cell.device.state()
    assert state.ay_velocity == pytest.approx(600)  # 10 % of 3000 min^-1 in 0.5 s
    assert state.bx_velocity == 0
    cell.wait(10)
    assert cell.device.state().ay_velocity == 2000
    cell.put(-1500, 0, *GO, "torque")
    cell.wait(1)
    assert cell.device.state().ay_velocity == pytest.approx(800)
    cell.wait(10)
    assert cell.device.state().ay_velocity == -2000


def test_friction_stops_what_torque_does_not_drive():
    cell = Abh3Cell(friction=5.0, inertia=0.5, **FOREVER)
    cell.put(1500, 0, *GO, "torque")
    cell.wait(1)
    cell.put(500, 0, *GO, "torque")  # equal to friction
    cell.wait(1)
    assert cell.device.state().ay_velocity == pytest.approx(600)
    cell.put(0, 0, *GO, "torque")
    cell.wait(1)
    assert cell.device.state().ay_velocity == pytest.approx(300)
    cell.wait(10)
    assert not cell.device.state().moving


def test_torque_of_one_axis_only_and_inverted():
    cell = Abh3Cell(**FOREVER)
    cell.put(5000, 5000, *GO, "bx_torque", "bx_polarity")
    cell.wait(5)
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity) == (1000, -3000)
    assert state.bx_current_command == -50


def test_what_is_faster_than_the_limit_is_slowed_down_in_torque_mode_too():
    axis = MotorAxis(AxisLimits(Parameters(speed_limit=100.0)))
    axis.velocity = 200 * FINE
    axis.order(AxisMode.TORQUE, 500)
    axis.run(1)
    assert axis.velocity == 194 * FINE
    axis.run(1000)
    assert axis.velocity == 100 * FINE


def test_the_current_limit_holds():
    cell = Abh3Cell(current_limit=80.0, inertia=10.0)
    cell.put(32767, 0, *GO, "ay_torque")
    cell.put(32767, 5000, *GO, "ay_torque")
    record = cell.br3()
    assert (record.ay_current_command, record.bx_current_command) == (80, 80)
    assert (record.a_load, record.b_load) == (80, 80)


# --- currents and loads -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "code"), [(1.0, 55), (0.1, 550)])
def test_current_and_load_follow_the_motion(unit, code):
    cell = Abh3Cell(load_unit=unit, **FOREVER)  # 0.25 s to the rated speed with 100 %: 0.5 s take 50 %
    cell.put(-15_000, 0, *GO)
    cell.wait(100 * MS)
    record = cell.br3()
    assert (record.ay_current_command, record.a_load, record.raw_values["a_load"]) == (-55, 55, code)
    cell.wait(10)
    assert (cell.br3().ay_current_command, cell.br3().a_load) == (-5, 5)
    cell.put(0, 0, *GO)
    cell.wait(100 * MS)
    assert cell.br3().ay_current_command == 45
    cell.wait(10)
    assert (cell.br3().ay_current_command, cell.br3().a_load) == (0, 0)


def test_a_load_from_outside_takes_current_and_drives_in_torque_mode():
    cell = Abh3Cell(**FOREVER)
    cell.device.set_load("ay", 20.0)
    assert cell.br3().ay_current_command == 0
    cell.put(0, 0, "servo_on")
    assert cell.br3().ay_current_command == 20
    cell.put(0, 0, *GO, "torque")
    cell.wait(0.1)
    state = cell.device.state()
    assert (state.ay_velocity < 0, state.bx_velocity) == (True, 0)


def test_loads_end_at_255():
    cell = Abh3Cell(model="travel", current_limit=300.0, inertia=100.0)
    cell.put(32767, 32767, *GO)
    assert (cell.br3().ay_current_command, cell.br3().a_load, cell.br3().b_load) == (300, 255, 0)


# --- models -------------------------------------------------------------------------------------------------------------


def test_the_motor_model_commands_motors():
    cell = Abh3Cell(**FOREVER)
    cell.put(100, -51, *GO)
    cell.wait(1)
    answer = cell.put(100, -51, *GO)
    assert answer.raw_values == {"a_velocity": 100, "b_velocity": -51, "y_velocity": 25, "x_velocity": 76}


@BOTH
def test_the_travel_model_commands_travel_and_turn(dialect):
    cell = Abh3Cell(model="travel", dialect=dialect, **FOREVER)
    cell.put(100, -51, *GO)
    cell.wait(1)
    state = cell.device.state()
    assert (state.a_velocity, state.b_velocity) == (pytest.approx(9.8), pytest.approx(30.2))
    assert (state.y_velocity, state.x_velocity) == (20, pytest.approx(-10.2))
    assert (cell.br2().raw_values["ay_velocity"], cell.br2().raw_values["bx_velocity"]) == (100, -51)
    assert "travel_model" in state.control
    cell.wait(59)
    pulses = cell.br4()
    assert (pulses.a_pulses, pulses.b_pulses) == (pytest.approx(9.8 * 256, abs=3), pytest.approx(30.2 * 256, abs=3))


def test_codes_are_the_nearest_halves_away_from_zero():
    assert [velocity(n * FINE // 10) for n in (1, -1, 0, 3, -3, 2)] == [0.2, -0.2, 0, 0.4, -0.4, 0.2]
    assert velocity(FINE // 10 - 1) == 0
    assert velocity(FINE // 5 - 1, 2) == 0


# --- pulses -------------------------------------------------------------------------------------------------------------


def test_pulses_count_revolutions():
    cell = Abh3Cell(pulses_per_revolution=1000, **FOREVER)
    cell.put(300, -300, *GO)  # 60 min^-1, a revolution in 1 s
    cell.wait(100.005)  # the ramp takes 10 ms
    assert cell.br4().a_pulses == 100_000
    assert cell.br4().b_pulses == -100_000


@given(st.integers(-(1 << 70), 1 << 70))
def test_pulses_wrap(count):
    assert -(1 << 31) <= wrapped(count) < 1 << 31
    assert (wrapped(count) - count) % (1 << 32) == 0


def test_the_count_wraps_in_motion():
    cell = Abh3Cell(pulses_per_revolution=65_536, **FOREVER)
    cell.put(15_000, -15_000, *GO)
    cell.wait(0.5)
    first = cell.br4().a_pulses
    rate = 50 * 65_536  # in 1 s
    for seconds in (600, 60, 700):
        cell.wait(seconds)
        first = wrapped(first + seconds * rate)
        record = cell.br4()
        assert record.a_pulses == first
        assert abs(record.b_pulses + first) <= 1 or abs(first) > (1 << 31) - 2


@BOTH
@pytest.mark.parametrize("model", ["motor", "travel"])
def test_the_edge_of_pulse_clear_clears_its_motor(dialect, model):
    cell = Abh3Cell(dialect=dialect, model=model, **FOREVER)
    cell.put(300, 100, *GO)
    cell.wait(10)
    b = cell.br4().b_pulses
    cell.put(300, 100, *GO, "a_pulse_clear")
    assert (cell.br4().a_pulses, cell.br4().b_pulses) == (0, b)
    cell.wait(10)
    a = cell.br4().a_pulses
    assert a > 1000
    cell.put(300, 100, *GO, "a_pulse_clear", "b_pulse_clear")  # no edge for A
    assert (cell.br4().a_pulses, cell.br4().b_pulses) == (a, 0)
    cell.put(300, 100, *GO)
    assert cell.br4().a_pulses == a
    cell.device.set_terminal("a_pulse_clear", True)
    assert cell.br4().a_pulses == 0


# --- time ---------------------------------------------------------------------------------------------------------------


def one_by_one(axis: MotorAxis, cycles: int) -> None:
    for _ in range(cycles):
        axis.run(1)


ORDERS = st.lists(
    st.tuples(st.sampled_from(list(AxisMode)), st.integers(-400, 400), st.integers(0, 1500), st.integers(-3000, 3000)),
    max_size=6,
)


@given(ORDERS, st.floats(0.01, 2), st.floats(0.1, 50))
@settings(deadline=None, max_examples=40)
def test_many_cycles_at_once_are_the_same_as_one_by_one(orders, seconds, friction):
    parameters = Parameters(
        acceleration_time=seconds, deceleration_time=seconds / 3, friction=friction, speed_limit=300.0
    )
    fast, slow = MotorAxis(AxisLimits(parameters)), MotorAxis(AxisLimits(parameters))
    for mode, command, cycles, load in orders:
        for axis in (fast, slow):
            axis.load = load
            axis.order(mode, command * FINE if mode is AxisMode.SPEED else command * 80)
        fast.run(cycles)
        one_by_one(slow, cycles)
        assert (fast.velocity, fast.travelled) == (slow.velocity, slow.travelled)


@given(
    st.sampled_from(["v1", "v2"]),
    st.lists(
        st.tuples(st.integers(-32768, 32767), st.integers(0, 0xFFFFFFFF), st.integers(0, 1500)),
        max_size=8,
    ),
    st.integers(1, 40),
)
@settings(deadline=None, max_examples=40)
def test_reading_the_state_has_no_effect(dialect, commands, often):
    often_looked, never = Abh3Cell(dialect=dialect, model="travel"), Abh3Cell(dialect=dialect, model="travel")
    for ay, inputs, ms in commands:
        for cell in (often_looked, never):
            cell.device.receive(cell.frame(ay, -ay // 2, inputs))
        for start in range(0, ms, often):
            often_looked.wait(min(often, ms - start) * MS)
            often_looked.device.advance()
            often_looked.device.state()
        never.wait(ms * MS)
    assert often_looked.device.state() == never.device.state()


def test_hours_pass_in_a_moment():
    cell = Abh3Cell(inertia=100.0, **FOREVER)
    cell.put(501, 1000, *GO, "ay_torque")  # hardly more than friction: it takes very long
    for _ in range(50):
        cell.wait(1_000_000)
        assert cell.device.advance() == []
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity) == (3000, 200)


def test_commands_within_a_cycle_are_taken_from_the_next_one():
    cell = Abh3Cell()
    cell.wait(0.4 * MS)
    cell.put(1000, 0, *GO)
    cell.wait(0.4 * MS)
    assert cell.device.state().ay_velocity == 0
    cell.wait(0.4 * MS)
    assert cell.device.state().ay_velocity == STEP


def test_moving_is_true_if_a_motor_turns():
    cell = Abh3Cell()
    assert not cell.device.state().moving
    cell.put(0, 10, *GO)
    cell.wait(MS)
    assert cell.device.state().moving


def test_every_combination_of_modes_reaches_a_steady_state():
    limits = AxisLimits(Parameters(speed_limit=0.0))
    for mode, command, load in itertools.product(AxisMode, (-1, 0, 1), (-5000, 0, 5000)):
        axis = MotorAxis(limits)
        axis.load = load
        axis.order(mode, command)
        axis.run(10**9)
        assert axis.velocity == 0
