"""Files, errors in programs and running tasks of the page Programs."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

import orinkit
from orinkit.client._shared.common import ErrorInfo
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.rc8.task_modes import TaskMode, TaskStatus
from orinkit.tester.state import file_store
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.file_store import MAX_EDITED, text_file
from orinkit.tester.state.program_errors import ProgramProblem, problem_of_run, problem_of_start
from orinkit.tester.state.running_task import RunningTask
from orinkit.tester.state.workspace import Workspace
from orinkit.virtual.rc8 import VirtualRC8
from support.in_thread import run_in_thread
from support.waiting import PATIENCE

ENDLESS = "Sub Main\n  Do While True\n    I1 = I1 + 1\n    Delay 10\n  Loop\nEnd Sub\n"


def test_a_text_is_written_back_in_its_encoding_with_its_line_ends():
    file = text_file("a.pcs", "' 動作\r\nSub Main\r\n".encode("cp932"))
    assert (file.text, file.encoding, file.newline) == ("' 動作\nSub Main\n", "cp932", "\r\n")
    assert file.content("' 停止\n") == "' 停止\r\n".encode("cp932")
    with pytest.raises(InvalidValue, match="line 2"):
        file.content("a\n\U0001f600")


def test_a_byte_order_mark_is_kept_and_text_remains_text():
    marked = text_file("a.pcs", b"\xef\xbb\xbfa\n")
    assert marked.content(marked.text) == b"\xef\xbb\xbfa\n"
    plain = text_file("a.pcs", "x\n")
    assert plain.content("y\n") == "y\n"


@pytest.mark.parametrize("content", [b"\x00\x01", b"a\x81", "a\0b", 5, "x" * (MAX_EDITED + 1)])
def test_a_content_that_cannot_be_edited_is_refused(content):
    with pytest.raises(InvalidValue):
        text_file("a.bin", content)


def test_the_line_of_a_refused_start_is_in_the_detail_of_the_error():
    error = error_for(hresult.SYNTAX_ERROR, "dir\\Wrong.pcs:3:5: Suspend is not supported")
    assert problem_of_start(error, "dir\\Wrong", []) == ProgramProblem(3, "Suspend is not supported", error.code)
    assert problem_of_start(error, "Other", []) is None


def test_the_line_of_an_error_is_in_the_errors_of_the_controller():
    present = [ErrorInfo(0x83500040, "out of range", (0, 0, "Fault", 7, 1)), ErrorInfo(1, "", (0, 0, "Fault", 2, 1))]
    assert problem_of_run("fault", present) == ProgramProblem(7, "out of range", 0x83500040)
    assert problem_of_run("other", present) is None


def with_connection(test: Callable[[Workspace, ControllerConnection], Awaitable[None]], device: VirtualRC8) -> None:
    async def run(url: str) -> None:
        workspace = Workspace()
        connection = workspace.add(ConnectionSpec("rc8", url))
        assert isinstance(connection, ControllerConnection)
        await connection.open()
        try:
            async with asyncio.timeout(PATIENCE):
                await test(workspace, connection)
        finally:
            await workspace.close()

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        run_in_thread(run(server.url))


def test_files_are_created_listed_and_written():
    device = VirtualRC8()

    async def test(_: Workspace, connection: ControllerConnection) -> None:
        controller = connection.controller
        await file_store.create(controller, "jobs", folder=True)
        path = file_store.joined("jobs", "a.pcs")
        await file_store.create(controller, path, "Sub Main\nEnd Sub\n")
        with pytest.raises(InvalidValue, match="exists"):
            await file_store.create(controller, path)
        names = [(each.name, each.is_folder) for each in await file_store.entries(controller, "")]
        assert names[0] == ("jobs", True)
        assert [each.path for each in await file_store.entries(controller, "jobs")] == [path]
        assert (await file_store.read_text(controller, path)).text == "Sub Main\nEnd Sub\n"
        await file_store.write(controller, "data.bin", b"\0\1")
        assert await file_store.read_data(controller, "data.bin") == b"\0\1"
        assert device.state.files.read("data.bin") == b"\0\1"

    with_connection(test, device)


def status(device: VirtualRC8, name: str) -> TaskStatus:
    return device.state.tasks.get_or_create(name).status


def test_a_started_program_is_a_motion_until_it_is_stopped():
    device = VirtualRC8(motor=True)

    async def test(workspace: Workspace, connection: ControllerConnection) -> None:
        await file_store.create(connection.controller, "Endless.pcs", ENDLESS)
        running = RunningTask(connection, "Endless", workspace.motions)
        await running.start(TaskMode.CYCLE)
        assert running in workspace.motions
        assert status(device, "Endless") is TaskStatus.RUNNING
        assert await workspace.stop_all("test") == []
        assert status(device, "Endless") is not TaskStatus.RUNNING
        assert running.finished.is_set()
        assert not workspace.motions

    with_connection(test, device)


def test_a_program_that_ends_by_itself_is_no_longer_a_motion():
    device = VirtualRC8()

    async def test(workspace: Workspace, connection: ControllerConnection) -> None:
        await file_store.create(connection.controller, "Once.pcs", "Sub Main\n  I1 = 5\nEnd Sub\n")
        running = RunningTask(connection, "Once", workspace.motions)
        await running.start(TaskMode.CYCLE)
        await running.finished.wait()
        assert not workspace.motions

    with_connection(test, device)


def test_a_refused_start_is_no_motion():
    device = VirtualRC8()

    async def test(workspace: Workspace, connection: ControllerConnection) -> None:
        await file_store.create(connection.controller, "Wrong.pcs", "Sub Main\n  Suspend\nEnd Sub\n")
        running = RunningTask(connection, "Wrong", workspace.motions)
        with pytest.raises(CallError) as caught:
            await running.start(TaskMode.CYCLE)
        assert problem_of_start(caught.value, "Wrong", []).line == 2
        assert not workspace.motions

    with_connection(test, device)


@pytest.mark.parametrize("wanted", [True, False])
def test_a_program_stops_when_the_user_leaves_if_this_was_chosen(wanted):
    device = VirtualRC8(motor=True)

    async def test(workspace: Workspace, connection: ControllerConnection) -> None:
        await file_store.create(connection.controller, "Endless.pcs", ENDLESS)
        running = RunningTask(connection, "Endless", workspace.motions)
        await running.start(TaskMode.CONTINUOUS)
        gone = asyncio.Event()

        async def lost() -> str:
            await gone.wait()
            return "the page was closed"

        asked = asyncio.Event()

        def choice() -> bool:
            asked.set()
            return wanted

        running.stop_when(lost, choice)
        gone.set()
        await asked.wait()
        if wanted:
            await running.finished.wait()
            assert status(device, "Endless") is not TaskStatus.RUNNING
        else:
            assert running in workspace.motions
            assert status(device, "Endless") is TaskStatus.RUNNING

    with_connection(test, device)
