"""Starts of programs that wait for their turn to be loaded: stops, lost clients, limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.rc8.starts import START_LIMITS
from orinkit.virtual.rc8.state import Operation
from support.busy import BusyCell, BusyServer, finish, occupy
from support.cell import Cell
from support.waiting import until
from support.web import Web, connect, request

SOURCE = "Sub Main\n  TakeArm\n  I1 = 1\n  Move P, @E J(20, 45, 90, 0, 45, 0)\nEnd Sub\n"

KINDS = ["Task_Start", "File_Run"]


class LoadingCell(BusyCell):
    """A cell whose thread for loading programs is occupied until :meth:`load`."""

    def __init__(self) -> None:
        super().__init__()
        self.lane = self.rc8.state.compiling = Lane("test", Clock(), START_LIMITS)
        occupy(self.lane, self.going)

    def request(self, kind: str, name: str = "Test", controller: Any = None) -> Deferred[Any]:
        """Request the start of a program."""
        file = self.controller.get_file(f"{name}.pcs", "@Create=1")
        file.put_value(variant(SOURCE))
        controller = controller or self.controller
        served = (
            controller.get_task(f"{name}.pcs", "") if kind == "Task_Start" else controller.get_file(file.get_path(), "")
        )
        call = served.start(1, "") if kind == "Task_Start" else served.run("")
        assert isinstance(call, Deferred)
        return call

    def load(self) -> None:
        """Let the thread load all programs, and run some cycles."""
        finish(self.lane, self.going, "the last client")
        until(lambda: not self.lane._working)

    def moved(self) -> bool:
        """Load the programs; return True if a program has been executed."""
        self.load()
        return set(self.trace(20)) != {self.arm.model.home} or self.i1 != 0

    @property
    def i1(self) -> int:
        """The variable that the program sets."""
        return int(self.controller.get_variable("I1", "").get_value().value)

    def reset(self) -> None:
        """Release all buttons, clear the errors, and switch the motor on."""
        pendant = self.rc8.pendant
        pendant.emergency_stop(False)
        pendant.protective_stop(False)
        pendant.auto_enable(True)
        pendant.mode(3)
        pendant.clear_errors()
        pendant.motor(True)
        self.clock.advance(5.0)
        assert self.arm.motor.on


@pytest.fixture
def cell() -> Iterator[LoadingCell]:
    with closing(LoadingCell()) as made:
        yield made


def stop_task(mode: int) -> Callable[[LoadingCell], object]:
    """Return a function that stops the task for another client."""
    return lambda cell: cell.connect().get_task("TEST", "").stop(mode, "")


STOPS: dict[str, Callable[[LoadingCell], object]] = {
    "emergency stop": lambda cell: cell.rc8.pendant.emergency_stop(),
    "protective stop": lambda cell: cell.rc8.pendant.protective_stop(),
    "auto enable": lambda cell: cell.rc8.pendant.auto_enable(False),
    "mode": lambda cell: cell.rc8.pendant.mode(1),
    "restart": lambda cell: cell.rc8.pendant.restart(),
    "error of level 2": lambda cell: cell.rc8.pendant.raise_error(0x82204999),
    "error of level 4": lambda cell: cell.rc8.pendant.raise_error(0x84204999),
    "Task_Stop 0": stop_task(0),
    "Task_Stop 1": stop_task(1),
    "Task_Stop 2": stop_task(2),
    "Task_Stop 3": stop_task(3),
    "Task_Stop 4": stop_task(4),
    "Halt of another client": lambda cell: cell.connect().get_robot("", "").halt(""),
    "client disconnected": lambda cell: cell.controller.release(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_cancels_a_waiting_start(cell, kind, stop):
    """Nothing moves, even if the cause of the stop has ended before the program is loaded."""
    call = cell.request(kind)
    STOPS[stop](cell)
    cell.trace(5)
    cell.reset()
    assert call.done()
    assert cell.code(call) == hresult.E_CANCEL
    assert not cell.moved()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["Test", r"Folder\Test", "Test.pcs"])
def test_a_stop_of_another_program_does_not_cancel_the_start(cell, kind, name):
    calls = [cell.request(kind, each) for each in (name, "Other")]
    cell.connect().get_task(f"{name}.pcs", "").stop(4, "")
    cell.load()
    assert [cell.code(each) for each in calls] == [hresult.E_CANCEL, 0]
    assert cell.moved()


@pytest.mark.parametrize("kind", KINDS)
def test_the_state_is_checked_at_the_call(cell, kind):
    cell.rc8.pendant.mode(1)
    assert cell.code_of(lambda: cell.request(kind)) == hresult.AUTO_MODE_REQUIRED
    assert not cell.rc8.state.tasks.starts._starts


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_that_nobody_waits_for_is_not_executed(cell, kind):
    call = cell.request(kind)
    call.abandon()
    assert cell.code(call) == hresult.E_ABORT
    assert not cell.moved()
    assert not cell.rc8.state.tasks.starts._starts


def test_a_file_that_is_renamed_meanwhile_is_not_run(cell):
    call = cell.request("File_Run")
    cell.rc8.state.files.move("Test.pcs", "Other.pcs")
    cell.load()
    assert cell.code(call) == hresult.FILE_NOT_FOUND


@pytest.mark.parametrize("kind", KINDS)
def test_the_starts_that_wait_are_limited(cell, kind):
    for _ in range(START_LIMITS.of_client):
        cell.request(kind)
    assert cell.code_of(lambda: cell.request(kind)) == hresult.E_BUSY_PROC
    others = [cell.connect() for _ in range(START_LIMITS.jobs)]
    for other in others[START_LIMITS.of_client :]:
        cell.request(kind, controller=other)
    assert cell.code_of(lambda: cell.request(kind, controller=cell.connect())) == hresult.E_BUSY_PROC
    assert len(cell.rc8.state.tasks.starts._starts) == START_LIMITS.jobs
    others[-1].release()
    assert cell.request(kind, controller=cell.connect())


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_that_has_waited_too_long_is_refused(cell, kind, monkeypatch):
    call = cell.request(kind)
    monkeypatch.setattr("orinkit.virtual.engine.lane.monotonic", lambda: float("inf"))
    assert not cell.moved()
    assert cell.code(call) == hresult.E_BUSY_PROC


def test_a_source_that_is_too_large_does_not_discard_compiled_programs():
    cell = Cell(samples=False)
    for name, source in (("Small", SOURCE), ("Large", "'" * 1_100_000)):
        file = cell.controller.get_file(f"{name}.pcs", "@Create=1")
        file.put_value(variant(source))
    task = cell.controller.get_task("Small", "").task
    program = cell.rc8.state.tasks.load(task)
    assert cell.code_of(lambda: file.run("")) == hresult.SYNTAX_ERROR
    assert cell.rc8.state.tasks.load(task) is program
    cell.close()


# --- clients of a server ----------------------------------------------------------------------------------------------


class Served(BusyServer):
    """A server whose thread for loading programs is occupied until :attr:`going` is set."""

    def __init__(self) -> None:
        super().__init__("tcp://127.0.0.1:0", "http://127.0.0.1:0")
        self.state = self.rc8.state
        self.state.files.write("Test.pcs", SOURCE.encode())
        occupy(self.state.compiling, self.going)

    def request_start(self, kind: str, option: str = "") -> None:
        """Request the start of the program, and return as soon as the start waits."""
        self.ask("Service_Start", option)
        controller = self.ask("Controller_Connect", "", "CaoProv.DENSO.VRC", "", "")
        if kind == "Task_Start":
            self.request(kind, self.ask("Controller_GetTask", controller, "Test", ""), 1, "")
        else:
            self.request(kind, self.ask("Controller_GetFile", controller, "Test.pcs", ""), "")
        until(lambda: len(self.state.compiling._jobs) == 1)

    def started(self) -> bool:
        """Load the programs; return True if a program has been started."""
        finish(self.state.compiling, self.going, "the last client")
        with self.rc8.guard:
            i1 = self.rc8.connect("", "", "", ClientInfo()).get_variable("I1", "").get_value().value
            return bool(self.state.tasks._begun) or i1 != 0


@pytest.fixture
def served() -> Iterator[Served]:
    with closing(Served()) as made:
        yield made


@pytest.mark.parametrize("kind", KINDS)
def test_the_start_of_a_lost_client_is_not_executed(served, kind):
    served.request_start(kind)
    served.client.close()
    until(lambda: not served.state.tasks.starts._starts)
    served.going.set()
    until(lambda: served.state.operations.newest.code == Operation.DISCONNECT)
    assert not served.started()


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_after_the_time_limit_of_the_call_is_not_executed(served, kind):
    served.request_start(kind, "InvokeTimeout=100")
    assert served.client.packet().code == hresult.E_TIMEOUT
    assert not served.started()


@pytest.mark.parametrize("how", ["the connection breaks", "the session ends", "the call times out"])
def test_a_start_over_http_that_nobody_waits_for_is_not_executed(served, how):
    url = served.server.urls[1]
    with Web(url, keeps_cookies=True) as web:
        assert web.call(1, "InvokeTimeout=100" if how == "the call times out" else "").code == 0
        task = web.call(BY_NAME["Controller_GetTask"].id, connect(web, "CaoProv.DENSO.VRC"), "Test", "").handle
        body = request(BY_NAME["Task_Start"].id, task, 1, "")
        web.send(web.head(body) + body.encode())
        waiting = served.state.tasks.starts._starts
        if how == "the call times out":
            assert web.answer().code == hresult.E_TIMEOUT
        else:
            until(lambda: waiting)
        if how == "the session ends":
            with Web(url, keeps_cookies=True) as other:
                other.cookie = web.cookie
                assert other.call(2).code == 0
        elif how == "the connection breaks":
            web.close()
        until(lambda: not waiting)
        assert not served.started()
