"""Tasks: starting, all ways to stop, their effect on the arm, faults, and their state as read by clients."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.rc8.task_modes import TaskMode
from orinkit.values.variant import ARRAY, VarType, variant
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.tasks import ALL_STATEMENTS, MOST_RUNNING, STATEMENTS
from support.cell import Cell
from support.waiting import until

READY, RUNNING, SUSPENDED, STEP_STOPPED = 2, 3, 1, 4
ONE_CYCLE, CONTINUOUS, STEP = 1, 2, 3

COUNT = "Sub Main\n  I1 = I1 + 1\n  Delay 100\n  I2 = I2 + 1\nEnd Sub\n"
FOREVER = "Sub Main\n  Do\n    I1 = I1 + 1\n  Loop\nEnd Sub\n"
MOVE = """Sub Main
  Takearm
  Move P, J(60, 45, 90, 0, 45, 0), Speed = 20
  Move P, J(0, 45, 90, 0, 45, 0), Speed = 20
  Givearm
  I1 = I1 + 1
End Sub
"""


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell(samples=False)
    yield made
    made.close()


def task(cell: Cell, program: str, name: str = "Test") -> Any:
    cell.rc8.state.files.write(f"{name}.pcs", program.encode())
    return cell.controller.get_task(name, "")


def status(served: Any) -> int:
    return served.execute("GetStatus", variant(None))


def value(cell: Cell, name: str) -> Any:
    return cell.controller.get_variable(name, "").get_value().plain


def test_one_cycle(cell):
    served = task(cell, COUNT)
    assert status(served) == READY
    served.start(ONE_CYCLE, "")
    assert status(served) == RUNNING
    cell.clock.advance(0.05)
    assert (value(cell, "I1"), value(cell, "I2")) == (1, 0)
    assert served.get_variable("@LINE_NO", "").get_value().value[0] == 3
    cell.clock.advance(0.2)
    assert (value(cell, "I1"), value(cell, "I2")) == (1, 1)
    assert status(served) == READY
    assert cell.rc8.state.tasks.cycle_complete
    assert 100 <= served.get_variable("@CYCLE_TIME", "").get_value().plain <= 140


def test_continuous_until_a_cycle_stop(cell):
    served = task(cell, COUNT)
    served.start(CONTINUOUS, "")
    cell.clock.advance(1.0)
    assert status(served) == RUNNING
    before = value(cell, "I2")
    assert before >= 5
    served.stop(3, "")
    assert status(served) == RUNNING
    cell.clock.advance(0.3)
    assert status(served) == READY
    assert value(cell, "I1") == value(cell, "I2") <= before + 1


def test_steps(cell):
    served = task(cell, "Sub Main\n  I1 = 1\n  I2 = 2\n  I3 = 3\nEnd Sub\n")
    seen = []
    for _ in range(3):
        served.start(STEP, "")
        cell.clock.advance(PERIOD)
        seen.append((value(cell, "I1"), value(cell, "I2"), value(cell, "I3"), status(served)))
    assert seen[:2] == [(1, 0, 0, STEP_STOPPED), (1, 2, 0, STEP_STOPPED)]
    assert seen[2][:3] == (1, 2, 3)
    served.start(STEP, "")
    cell.clock.advance(PERIOD)
    assert status(served) in (READY, STEP_STOPPED)


def test_a_step_is_over_when_its_statement_is(cell):
    served = task(cell, COUNT)
    served.start(STEP, "")
    cell.clock.advance(PERIOD)
    served.start(STEP, "")
    cell.clock.advance(PERIOD * 3)
    assert status(served) == RUNNING
    assert value(cell, "I2") == 0
    cell.clock.advance(0.2)
    assert status(served) == STEP_STOPPED
    assert value(cell, "I2") == 0


def test_a_step_stop_ends_after_the_statement(cell):
    served = task(cell, FOREVER)
    served.start(CONTINUOUS, "")
    cell.clock.advance(0.1)
    served.stop(2, "")
    cell.clock.advance(PERIOD * 2)
    assert status(served) == STEP_STOPPED
    before = value(cell, "I1")
    cell.clock.advance(1.0)
    assert value(cell, "I1") == before
    served.start(CONTINUOUS, "")
    cell.clock.advance(0.1)
    assert value(cell, "I1") > before


def test_an_instant_stop_pauses_the_motion_and_a_start_continues(cell):
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    assert cell.arm.busy
    served.stop(1, "")
    cell.clock.advance(1.0)
    held = cell.arm.queue.joints
    assert 0 < held[0] < 60
    assert status(served) == SUSPENDED
    cell.clock.advance(5.0)
    assert cell.arm.queue.joints == held
    served.start(ONE_CYCLE, "")
    cell.clock.advance(20.0)
    assert status(served) == READY
    assert value(cell, "I1") == 1
    assert cell.arm.queue.joints == (0, 45, 90, 0, 45, 0)


def test_initialize_drops_the_motion_and_restarts(cell):
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    served.stop(4, "")
    cell.clock.advance(1.0)
    assert not cell.arm.busy
    assert status(served) == READY
    assert cell.arm.holder is None
    assert 0 < cell.arm.queue.joints[0] < 60
    cell.take()


def test_a_program_holds_the_arm_while_it_moves(cell):
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    assert cell.code_of(lambda: cell.execute("TakeArm", [0, 0])) == hresult.ARM_TAKEN_BY_PACSCRIPT
    assert cell.code_of(lambda: cell.execute("ExtSpeed", [50])) == hresult.ARM_TAKEN_BY_PACSCRIPT
    assert cell.code_of(lambda: cell.move(1, "J(1, 45, 90, 0, 45, 0)")) == hresult.ARM_NOT_TAKEN


def test_a_client_may_pause_a_program_and_have_it_go_on(cell):
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    cell.run(cell.robot.hold(""))
    cell.clock.advance(3.0)
    assert status(served) == RUNNING
    assert value(cell, "I1") == 0
    cell.robot.unhold("")
    cell.clock.advance(20.0)
    assert value(cell, "I1") == 1


@pytest.mark.parametrize(
    ("stop", "code"),
    [
        (lambda cell: cell.rc8.pendant.emergency_stop(), 0),
        (lambda cell: cell.rc8.pendant.mode(1), 0),
        (lambda cell: cell.rc8.pendant.raise_error(0x84204041), 0x84204041),
    ],
)
def test_what_stops_the_robot_stops_programs_for_good(cell, stop, code):
    served = task(cell, MOVE)
    served.start(CONTINUOUS, "")
    cell.clock.advance(0.3)
    stop(cell)
    cell.clock.advance(1.0)
    assert status(served) == READY
    assert cell.arm.holder is None
    assert not cell.arm.busy
    assert cell.rc8.state.faults.code == code


def test_halt_of_a_programs_motion_is_its_fault(cell):
    """The program cannot know the position of the arm: it ends with the code of the stop and its line."""
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    assert cell.code(cell.robot.halt("")) == hresult.ARM_TAKEN_BY_PACSCRIPT
    cell.clock.advance(1.0)
    assert status(served) == READY
    record = cell.rc8.state.faults.current.newest
    assert (record.code, record.program, record.line) == (hresult.STOPPED_DURING_PC_MOTION, "Test", 3)


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("I[100000] = 1", hresult.GLOBAL_VARIABLE_OUT_OF_RANGE),
        ("Move P, J(0, 45, 90, 0, 45, 0)", hresult.ARM_NOT_TAKEN),
        ('S1 = "' + "x" * 300 + '"', hresult.STRING_TOO_LONG),
    ],
)
def test_a_run_time_error_stops_the_task_with_code_and_line(cell, statement, code):
    served = task(cell, f"Sub Main\n  I1 = 1\n  {statement}\n  I2 = 2\nEnd Sub\n")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    assert status(served) == READY
    assert (value(cell, "I1"), value(cell, "I2")) == (1, 0)
    record = cell.rc8.state.faults.current.newest
    assert (record.code, record.program, record.line) == (code, "Test", 3)
    assert cell.code_of(lambda: served.start(ONE_CYCLE, "")) == hresult.ERROR_PRESENT
    cell.controller.execute("ClearError", variant(None))
    served.start(ONE_CYCLE, "")


def test_a_motor_that_is_off_is_the_programs_fault(cell):
    cell.execute("Motor", [0, 0])
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    assert cell.rc8.state.faults.code == hresult.MOTOR_NOT_ON
    assert cell.arm.holder is None


def test_a_syntax_error_is_refused_at_the_start_and_logged(cell):
    served = task(cell, "Sub Main\n  I1 = = 2\nEnd Sub\n")
    assert cell.code_of(lambda: served.start(ONE_CYCLE, "")) == hresult.SYNTAX_ERROR
    assert status(served) == READY
    assert cell.rc8.state.faults.code == 0
    record = cell.rc8.state.faults.log.newest
    assert record.code == hresult.SYNTAX_ERROR
    assert "Test.pcs:2:" in record.message


def test_a_changed_program_is_loaded_at_the_next_start(cell):
    served = task(cell, "Sub Main\n  I1 = 1\nEnd Sub\n")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    task(cell, "Sub Main\n  I1 = 2\nEnd Sub\n")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    assert value(cell, "I1") == 2


def test_names_are_found_in_any_case_with_folder_and_suffix(cell):
    cell.rc8.state.files.make_folder("dir")
    task(cell, COUNT, "dir/Pro9")
    for name in ("dir\\Pro9", "DIR/pro9", "dir\\pro9.pcs"):
        assert cell.controller.get_task(name, "").get_file_name() == "dir\\Pro9.pcs"
    assert cell.controller.get_task_names("") == ["dir\\Pro9"]
    for name in ("", "Pro10", "..\\x", "dir", "a:b"):
        assert cell.code_of(lambda name=name: cell.controller.get_task(name, "")) == hresult.E_CAO_OBJECT_NOTFOUND


def test_a_deleted_task_does_not_exist(cell):
    served = task(cell, FOREVER)
    served.start(CONTINUOUS, "")
    assert cell.code_of(lambda: served.delete("")) == hresult.PROGRAM_RUNNING
    served.stop(4, "")
    served.delete("")
    assert status(served) == 0
    assert cell.code_of(lambda: served.start(ONE_CYCLE, "")) == hresult.E_CAO_OBJECT_NOTFOUND
    assert cell.controller.get_task_names("") == []


def test_starting_twice_and_too_many(cell):
    first = task(cell, FOREVER, "P0")
    first.start(CONTINUOUS, "")
    assert cell.code_of(lambda: first.start(CONTINUOUS, "")) == hresult.PROGRAM_RUNNING
    for number in range(1, MOST_RUNNING):
        task(cell, FOREVER, f"P{number}").start(CONTINUOUS, "")
    last = task(cell, FOREVER, "Last")
    assert cell.code_of(lambda: last.start(CONTINUOUS, "")) == hresult.TASKS_TOO_MANY
    assert cell.rc8.state.running_programs == MOST_RUNNING


@pytest.mark.parametrize("mode", [0, 5, -1, 99])
def test_invalid_start_modes(cell, mode):
    assert cell.code_of(lambda: task(cell, COUNT).start(mode, "")) == hresult.E_INVALIDARG


@pytest.mark.parametrize("mode", [5, -1, 99])
def test_invalid_stop_modes(cell, mode):
    assert cell.code_of(lambda: task(cell, COUNT).stop(mode, "")) == hresult.E_INVALIDARG


@pytest.mark.parametrize("mode", range(5))
def test_stopping_an_idle_task_is_no_error(cell, mode):
    task(cell, COUNT).stop(mode, "")


def test_statements_per_cycle_are_limited(cell):
    """25,000 statements per second of controller time, however long the program could run."""
    served = task(cell, FOREVER)
    served.start(CONTINUOUS, "")
    cell.clock.advance(1.0)
    done = value(cell, "I1")
    assert 10_000 <= done <= STATEMENTS * 125
    served.stop(4, "")


def test_many_programs_share_the_cycle(cell):
    """All tasks get the same share, and together they leave enough time for the arm and for clients."""
    for number in range(MOST_RUNNING):
        program = FOREVER.replace("I1 = I1", f"I{number} = I{number}")
        task(cell, program, f"P{number}").start(CONTINUOUS, "")
    cell.clock.advance(1.0)
    done = [value(cell, f"I{number}") for number in range(MOST_RUNNING)]
    assert max(done) - min(done) <= 1
    assert sum(done) <= ALL_STATEMENTS * 125


def test_printed_texts_are_events_and_log_lines(cell):
    served = task(cell, 'Sub Main\n  PrintMsg "hello", 0, "title"\n  PrintDbg "debug"\nEnd Sub\n')
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    message = cell.controller.get_message()
    assert (message.get_number(), message.get_description()) == (4, "Test: title: hello")
    texts = [cell.rc8.state.operations.at(index).text for index in range(2)]
    assert texts[0].startswith("Test: debug")


def test_file_run_starts_one_cycle(cell):
    task(cell, COUNT, "Run")
    file = cell.controller.get_file("Run.pcs", "")
    assert file.run("") == "Run"
    cell.clock.advance(1.0)
    assert (value(cell, "I1"), value(cell, "I2")) == (1, 1)


def test_the_tables_of_variables(cell):
    served = task(cell, COUNT)
    names = served.get_variable_names("")
    unreadable = {"@PRIORITY", "@START", "@STOP"}
    values = {name: served.get_variable(name.lower(), "").get_value() for name in names if name not in unreadable}
    assert unreadable < set(names)
    assert {name: value.type for name, value in values.items()} == {
        "@STATUS": VarType.I4, "@STATUS_DETAILS": VarType.I4, "@LINE_NO": VarType.I4 | ARRAY, "@CYCLE_TIME": VarType.I4,
        "@ELAPSED_TIME": VarType.I4, "@FILE_NAME": VarType.BSTR,
    }  # fmt: skip
    assert values["@FILE_NAME"].value == "Test.pcs"
    assert cell.code_of(lambda: served.get_variable("@NONE", "")) == hresult.E_CAO_OBJECT_NOTFOUND
    assert cell.code_of(lambda: served.execute("Other", variant(None))) == hresult.E_INVALID_CMD_NAME


@pytest.mark.parametrize(("name", "check"), [("Pro1", "I10"), ("Pro2", "S1"), ("Pro3", "")])
def test_the_samples_run(name, check):
    cell = Cell()
    served = cell.controller.get_task(name, "")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(60.0)
    assert cell.rc8.state.faults.code == 0
    assert status(served) == READY
    if check:
        assert value(cell, check)
    cell.close()


def test_a_program_that_holds_is_suspended_until_it_is_started_again(cell):
    served = task(cell, "Sub Main\n  I1 = 1\n  Hold\n  I1 = 2\nEnd Sub\n")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(1.0)
    assert (status(served), value(cell, "I1")) == (SUSPENDED, 1)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    assert (status(served), value(cell, "I1")) == (READY, 2)


def test_a_program_is_loaded_in_a_thread():
    """Conditions that become false meanwhile are checked at the end."""
    cell = Cell(samples=False)
    state = cell.rc8.state
    state.compiling = Lane("test", Clock())
    served = task(cell, "Sub Main\n  I1 = I1 + 1\nEnd Sub\n")
    folder = cell.controller.get_file("", "")

    def begun(call: Callable[[], Any]) -> Deferred[Any]:
        going.clear()
        state.compiling.submit(going.wait, Deferred())
        return call()

    def code(call: Callable[[], Any], meanwhile: Callable[[], Any] = lambda: None) -> int:
        loading = begun(call)
        meanwhile()
        going.set()
        until(loading.done)
        return cell.code(loading)

    going = threading.Event()
    start = lambda: served.start(ONE_CYCLE, "")  # noqa: E731 - a name for one call
    for call in (start, lambda: folder.get_file("Test.pcs", "").run("")):
        assert code(call, lambda: cell.rc8.pendant.token("tp")) == hresult.START_RIGHT_NOT_ETHERNET
        cell.rc8.pendant.token("any")
    assert code(start, lambda: state.files.delete("Test.pcs")) == hresult.E_CAO_OBJECT_NOTFOUND
    assert code(lambda: task(cell, "x").start(ONE_CYCLE, "")) == hresult.SYNTAX_ERROR
    cell.clock.advance(0.1)
    assert value(cell, "I1") == 0
    task(cell, "Sub Main\n  I1 = I1 + 1\nEnd Sub\n")
    assert code(start) == 0
    cell.clock.advance(0.1)
    assert value(cell, "I1") == 1
    loading = begun(start)
    cell.close()
    assert cell.code(loading) == hresult.E_ABORT
    going.set()


def test_a_suspended_program_whose_file_is_deleted_releases_the_arm(cell):
    served = task(cell, MOVE)
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.3)
    served.stop(1, "")
    cell.clock.advance(0.5)
    assert cell.arm.holder is not None
    cell.rc8.state.files.delete("Test.pcs")
    cell.clock.advance(0.5)
    assert cell.arm.holder is None
    assert not cell.arm.busy
    assert status(served) == 0
    cell.take()


def test_the_error_of_a_program_is_stored_for_the_second_start(cell):
    task(cell, "x")
    for _ in range(2):
        assert cell.code_of(lambda: cell.controller.get_file("Test.pcs", "").run("")) == hresult.SYNTAX_ERROR


def test_deleted_programs_are_released_from_memory(cell):
    """Neither the programs nor their compiled form stay in memory."""
    tasks = cell.rc8.state.tasks
    for number in range(100):
        served = task(cell, FOREVER, f"P{number}")
        served.start(ONE_CYCLE, "")
        served.stop(4, "")
    assert len(tasks._programs) <= 32
    for number in range(100):
        cell.rc8.state.files.delete(f"P{number}.pcs")
    assert (len(tasks._programs), len(tasks._tasks)) == (0, 0)
    task(cell, COUNT, "Running").start(ONE_CYCLE, "")
    cell.rc8.state.files.delete("Running.pcs")
    cell.clock.advance(1.0)
    assert value(cell, "I2") == 1  # it ran to its end
    assert not tasks._tasks


def test_a_recreated_program_belongs_to_the_same_task_object(cell):
    served = task(cell, "Sub Main\n  I1 = 1\nEnd Sub\n")
    cell.rc8.state.files.delete("Test.pcs")
    assert status(served) == 0
    cell.rc8.state.files.write("Test.pcs", b"Sub Main\n  I1 = 2\nEnd Sub\n")
    served.start(ONE_CYCLE, "")
    cell.clock.advance(0.1)
    assert (status(served), value(cell, "I1")) == (READY, 2)


def test_long_statements_end_a_cycle_early():
    """In real time, if statements take long, a cycle executes so few that there is time for everything else."""
    rc8 = VirtualRC8(clock=Clock(), samples=False)
    rc8.state.files.write("Slow.pcs", b"Sub Main\n  Do\n    I1 = I1 + OutRange(J1) * 0 + 1\n  Loop\nEnd Sub\n")
    with rc8.state.cycles:
        served = rc8.state.tasks.find("Slow")
        rc8.state.tasks.start(served, rc8.state.tasks.load(served), TaskMode.CONTINUOUS)
        machine = served._machine
    counted = []
    original = machine.run

    def run(budget, tired):
        counted.append(original(budget, tired))
        return counted[-1]

    machine.run = run
    end = time.monotonic() + 20
    while len(counted) < 20 and time.monotonic() < end:
        time.sleep(0.01)
    rc8.close()
    assert len(counted) >= 20
    assert max(counted) < STATEMENTS
