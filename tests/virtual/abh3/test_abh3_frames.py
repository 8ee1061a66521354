"""The virtual ABH3 on its bus: replies to hosts, and periodic frames."""

from __future__ import annotations

import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.abh3.table.ids import EVERYONE, FrameId, pgn, request, single
from orinkit.can.frame import CanFrame
from orinkit.core.errors import InvalidValue
from orinkit.virtual.abh3 import DataSet, Parameters, VirtualABH3
from orinkit.virtual.clock import Clock, ManualClock
from support.abh3_cell import GO, MS, Abh3Cell

BOTH = pytest.mark.parametrize("dialect", ["v1", "v2"])


def asks(cell: Abh3Cell, data: bytes, destination: int = 1, source: int = 2) -> list[CanFrame]:
    return cell.device.receive(CanFrame(request(destination, source), data))


# --- single packets -----------------------------------------------------------------------------------------------------


@BOTH
def test_a_command_is_answered_to_its_host(dialect):
    cell = Abh3Cell(dialect=dialect)
    (answer,) = cell.device.receive(cell.frame())
    assert answer.id == 0x00EF0201
    assert len(answer.data) == 8


def test_golden_answers_of_an_idle_driver():
    cell = Abh3Cell(model="travel", main_voltage=23.7, control_voltage=23.7)
    cell.device.set_analog(0, 0.21)
    cell.device.set_analog(1, 0.14)
    cell.wait(3)
    answers = [asks(cell, bytes((0x28 + n, 0xFF, 0)))[0] for n in range(7)]
    assert [answer.id for answer in answers] == [0x00FF2801 + 0x100 * n for n in range(7)]
    assert [answer.data.hex() for answer in answers] == [
        "0000400000004000",
        "70000708c3000000",
        "0000000000000000",
        "0000000000000000",
        "0000000000000000",
        "15000e00ed00ed00",
        "0000000000000000",
    ]


def test_the_answer_of_v2_has_what_the_command_did():
    cell = Abh3Cell(dialect="v2")
    answer = cell.put(100, 0, *GO)
    assert "servo_on" in answer.control
    shown = [name for name in answer.control if "ready" in name or "busy" in name]
    assert shown == ["ay_ready", "ay_busy", "bx_ready"]
    assert answer.ay_velocity == 0


@given(st.integers(0, 7))
def test_any_priority_is_accepted(priority):
    cell = Abh3Cell()
    frame = cell.frame()
    (answer,) = cell.device.receive(frame._replace(id=FrameId.parse(frame.id).with_priority(priority)))
    assert answer.id == 0x00EF0201


def test_answers_have_the_priorities_of_the_parameters():
    cell = Abh3Cell(single_priority=3, broadcast_priority=6)
    assert cell.device.receive(cell.frame())[0].id == single(2, 1, priority=3)
    assert asks(cell, bytes((0x2B, 0xFF, 0)))[0].id == 0x18FF2B01


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x00EF0102, bytes(7)),
        CanFrame(0x00EF0102, b""),
        CanFrame(0x00EF0102, bytes(9)),
        CanFrame(0x02EF0102, bytes(8)),  # R
        CanFrame(0x01EF0102, b""),  # DP1 is not disclosed
        CanFrame(0x01EF0102, bytes(8)),
        CanFrame(0x00EF0302, bytes(8)),  # another driver
        CanFrame(0x00EFFF02, bytes(8)),
        CanFrame(0x00EF0103, bytes(8)),  # another host
        CanFrame(0x00EF0201, bytes(8)),  # its own
        CanFrame(0x00EA0102, bytes((0x28, 0xFF))),
        CanFrame(0x00EA0102, bytes((0x2F, 0xFF, 0))),  # broadcast 7
        CanFrame(0x00EA0102, bytes((0x30, 0xFF, 0))),  # another group
        CanFrame(0x00EA0102, bytes((0x28, 0xFF, 1))),
        CanFrame(0x00EA0102, bytes((0x28, 0xFE, 0))),
        CanFrame(0x00EA0102, bytes((0, 0xEF, 1))),  # DP1
        CanFrame(0x00EA0102, bytes((1, 0xEF, 0))),
        CanFrame(0x00EA0302, bytes((0x28, 0xFF, 0))),
        CanFrame(0x00EA0103, bytes((0x28, 0xFF, 0))),
        CanFrame(0x01EA0102, bytes((0x28, 0xFF, 0))),
        CanFrame(0x00FF2803, bytes(8)),
        CanFrame(-1, bytes(8)),
        CanFrame(0x200EF0102, bytes(8)),
    ],
    ids=str,
)
@BOTH
def test_frames_that_are_not_for_it_are_ignored(dialect, frame):
    cell = Abh3Cell(dialect=dialect)
    before = cell.device.state()
    assert cell.device.receive(frame) == []
    assert cell.device.state() == before


@BOTH
def test_a_request_for_the_single_packet(dialect):
    cell = Abh3Cell(dialect=dialect)
    for data in (pgn(0xEF, 0), pgn(0xEF, 0) + bytes(5)):
        (answer,) = asks(cell, data)
        assert answer.id == 0x00EF0201


@BOTH
def test_requests_to_all_are_answered_too(dialect):
    cell = Abh3Cell(dialect=dialect, group=31, address=253, host=0)
    for number in range(7):
        cell.ask(number)
        cell.ask(number, everyone=True)


def test_any_host_is_answered_where_none_is_fixed():
    cell = Abh3Cell(host=None)
    for host in (0, 2, 9, 253):
        (answer,) = cell.device.receive(cell.frame(host=host))
        assert answer.id == single(host, 1)
    for host in (1, EVERYONE):
        assert cell.device.receive(cell.frame(host=host)) == []


@pytest.mark.parametrize(("mode", "answers"), [(None, 0), (-1, 1), (0, 1), (100, 1)])
def test_answering_modes(mode, answers):
    cell = Abh3Cell(single_mode=mode)
    assert len(cell.device.receive(cell.frame(1, 2, 3))) == answers
    assert len(asks(cell, pgn(0xEF, 0))) == answers
    assert cell.device.state().inputs.value == 3
    assert cell.br0().errors.value == 0


# --- unasked ------------------------------------------------------------------------------------------------------------


def test_periodic_frames():
    cell = Abh3Cell(single_mode=30, broadcast_modes=(20, 0, 0, 0, 0, 0, 0, 10), broadcast_priority=2)
    times: dict[int, list[int]] = {}
    for ms in range(1, 101):
        cell.wait(MS)
        for frame in cell.device.advance():
            times.setdefault(frame.id, []).append(ms)
    assert times == {0x00EF0201: [30, 60, 90], 0x08FF2801: [20, 40, 60, 80, 100]}


def test_due_is_the_time_of_the_next_frame():
    cell = Abh3Cell(broadcast_modes=(0, 0, 250, 0, 0, 0, 1000, 0))
    found = []
    for _ in range(8):
        due = cell.device.due()
        assert due is not None
        cell.wait(due - cell.clock.now())
        found.append([frame.id >> 8 & 7 for frame in cell.device.advance()])
    assert found == [[2], [2], [2], [2, 6], [2], [2], [2], [2, 6]]
    assert cell.clock.now() == pytest.approx(2)


def test_nothing_is_due_without_periodic_frames():
    cell = Abh3Cell()
    assert cell.device.due() is None
    cell.wait(10)
    assert cell.device.advance() == []


def test_a_late_call_makes_no_burst():
    cell = Abh3Cell(broadcast_modes=(1, 7, 0, 0, 0, 0, 0, 0), single_mode=100)
    cell.wait(3600.0005)
    assert [frame.id for frame in cell.device.advance()] == [0x00EF0201, 0x00FF2801, 0x00FF2901]
    assert cell.device.advance() == []
    assert cell.device.due() == pytest.approx(3600.001)


def test_periodic_frames_do_not_restart_anything():
    cell = Abh3Cell(broadcast_modes=(10,) * 8)
    for _ in range(200):
        cell.wait(0.01)
        cell.device.advance()
    assert "can_communication" in cell.br0().errors


# --- values -------------------------------------------------------------------------------------------------------------


def test_analog_inputs_supplies_and_monitors():
    cell = Abh3Cell(main_voltage=48.04, control_voltage=23.96)
    cell.device.set_analog(0, 1.234)
    cell.device.set_analog(1, -327.68)
    assert cell.br5().raw_values == {"analog_0": 123, "analog_1": -32768, "main_voltage": 480, "control_voltage": 240}
    cell.device.set_monitor(0, "main_voltage")
    cell.device.set_monitor(1, 0.25)
    assert (cell.br6().monitor_0, cell.br6().monitor_1) == (pytest.approx(48.04), 0.25)


def test_monitors_show_the_velocities_at_first():
    cell = Abh3Cell()
    cell.hold(1, 500, -250, *GO)
    assert (cell.br6().monitor_0, cell.br6().monitor_1) == (100, -50)


@pytest.mark.parametrize(
    ("call", "arguments", "expected"),
    [
        ("set_analog", (2, 0.0), "0 to 1"),
        ("set_analog", (0, 400.0), "327.67"),
        ("set_analog", (0, float("nan")), "nan"),
        ("set_monitor", (-1, 0.0), "0 to 1"),
        ("set_monitor", (1.0, 0.0), "0 to 1"),
        ("set_monitor", (0, "nothing"), "ay_velocity, bx_velocity"),
        ("set_monitor", (0, 1e39), "single-precision"),
        ("set_monitor", (0, float("inf")), "single-precision"),
        ("set_monitor", (0, None), "single-precision"),
        ("set_terminal", ("nothing", True), "ay_servo_on"),
        ("set_terminal", ("di_20", True), "di_19"),
        ("set_terminal", ("ay_ready", True), "ay_servo_on"),
        ("inject", ("nothing",), "a_overcurrent"),
        ("inject", (22,), "can_communication"),
        ("repair", ("error_code_0",), "a_overcurrent"),
        ("set_load", ("a", 1.0), "ay, bx"),
        ("set_load", ("ay", 400.0), "327.67"),
        ("set_load", ("ay", "1"), "327.67"),
    ],
)
def test_invalid_names_and_values(call, arguments, expected):
    cell = Abh3Cell()
    with pytest.raises(InvalidValue, match=expected):
        getattr(cell.device, call)(*arguments)
    assert cell.device.state() == Abh3Cell().device.state()


def test_a_closed_driver_is_silent_and_stays_as_it_is():
    cell = Abh3Cell(single_mode=10)
    cell.put(1000, 0, *GO)
    cell.wait(0.1)
    before = cell.device.state()
    cell.device.close()
    cell.device.close()
    cell.wait(10)
    assert cell.device.receive(cell.frame()) == []
    assert cell.device.advance() == []
    assert cell.device.due() is None
    assert cell.device.state() == before


def test_it_runs_in_real_time_by_default():
    device = VirtualABH3()
    assert device.parameters == Parameters()
    assert device.address == 1
    assert type(device.clock) is Clock
    assert device.state().time < 60


def test_its_time_begins_when_it_is_switched_on():
    clock = ManualClock()
    clock.advance(1000)
    device = VirtualABH3(Parameters(broadcast_modes=(100, 0, 0, 0, 0, 0, 0, 0)), clock=clock)
    assert device.state().time == 0
    assert device.due() == pytest.approx(1000.1)
    assert device.state().errors.value == 0


def test_threads_do_not_disturb_each_other():
    cell = Abh3Cell(single_mode=5, command_timeout=0, error_timeout=0)
    stop = threading.Event()
    failures: list[BaseException] = []

    def run(work):
        try:
            while not stop.is_set():
                work()
        except BaseException as error:  # noqa: BLE001 - expected by the test
            failures.append(error)

    go = cell.frame(1000, -1000, cell.mask(*GO) | cell._select(0))
    cell.device.receive(go)
    works = [cell.device.advance, cell.device.state, cell.device.due, lambda: cell.device.receive(go)]
    threads = [threading.Thread(target=run, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for _ in range(300):
        cell.wait(5 * MS)
    stop.set()
    for thread in threads:
        thread.join()
    assert failures == []
    state = cell.device.state()
    assert (state.ay_velocity, state.bx_velocity) == (200, -200)


# --- parameters ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("dialect", "v3"),
        ("dialect", None),
        ("address", 254),
        ("address", True),
        ("address", 1.0),
        ("host", 254),
        ("host", -1),
        ("host", 1),
        ("group", 32),
        ("single_priority", 8),
        ("multi_priority", -1),
        ("broadcast_priority", "0"),
        ("single_mode", -2),
        ("single_mode", 1001),
        ("broadcast_modes", (0,) * 7),
        ("broadcast_modes", "00000000"),
        ("broadcast_modes", 0),
        ("broadcast_modes", (0, 0, 0, -1, 0, 0, 0, 0)),
        ("broadcast_modes", (0, 0, 0, 1001, 0, 0, 0, 0)),
        ("command_timeout", 10_001),
        ("error_timeout", -1),
        ("load_unit", 0.5),
        ("load_unit", True),
        ("model", "car"),
        ("rated_speed", 0.0),
        ("acceleration_time", 0.0),
        ("deceleration_time", float("nan")),
        ("speed_limit", 6553.5),
        ("current_limit", -1.0),
        ("pulses_per_revolution", 0),
        ("inertia", float("inf")),
        ("friction", 0.0),
        ("ay_sets", ()),
        ("bx_sets", (0,) * 8),
        ("main_voltage", 6553.6),
        ("control_voltage", "24"),
    ],
)
def test_parameters_out_of_range(name, value):
    with pytest.raises(InvalidValue, match=name):
        Parameters(**{name: value})


@pytest.mark.parametrize(("name", "value"), [("source", "can0"), ("velocity", 7000.0), ("current", -400.0)])
def test_data_sets_out_of_range(name, value):
    with pytest.raises(InvalidValue, match=name):
        DataSet(**{name: value})


def test_periodic_single_packets_need_a_fixed_host():
    with pytest.raises(InvalidValue, match="single_mode"):
        Parameters(host=None, single_mode=10)


def test_lists_of_parameters_do_not_change_later():
    modes = [0] * 8
    parameters = Parameters(broadcast_modes=modes)
    modes[0] = 10
    assert parameters.broadcast_modes == (0,) * 8


# --- anything ----------------------------------------------------------------------------------------------------------

FRAMES = st.builds(
    CanFrame,
    st.one_of(
        st.integers(-1, 0x2FFFFFFF),
        st.sampled_from([0x00EF0102, 0x00EA0102, 0x00EAFF02, 0x01EF0102, 0x00EC0102, 0x00EB0102, 0x04EF0102]),
    ),
    st.one_of(
        st.binary(max_size=9),
        st.binary(min_size=8, max_size=8),
        st.tuples(st.integers(0x28, 0x2F)).map(lambda n: bytes((*n, 0xFF, 0))),
    ),
)


@given(
    st.sampled_from(["v1", "v2"]),
    st.sampled_from(["motor", "travel"]),
    st.lists(st.tuples(FRAMES, st.floats(0, 2)), max_size=30),
)
@settings(deadline=None)
def test_no_sequence_of_frames_raises_anything(dialect, model, sequence):
    cell = Abh3Cell(dialect=dialect, model=model, single_mode=50, broadcast_modes=(90,) * 8)
    for frame, seconds in sequence:
        cell.wait(seconds)
        for answer in cell.device.receive(frame) + cell.device.advance():
            assert 0 <= answer.id < 1 << 29
            assert len(answer.data) == 8
            assert answer.id & 0xFF == 1
