"""Tasks and files of both clients against the virtual RC8."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from typing import Any

import pytest

import orinkit
from orinkit.client._shared.common import ErrorInfo, file_text, is_program, logged_message, parse_date
from orinkit.core import i18n
from orinkit.core.errors import CallError, InvalidArgument, InvalidValue, ObjectNotFound, ObjectReleased, ProtocolError
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.devices import Call, Recorder
from support.waiting import until

PATIENCE = 20.0
COUNTING = "Sub Main\n  I[1] = I[1] + 1\nEnd Sub\n"
ENDLESS = "Sub Main\n  Do\n    I[2] = I[2] + 1\n  Loop\nEnd Sub\n"
FAULTY = "Sub Main\n  I[1] = 1\n  I[2] = 1 / (I[1] - 1)\nEnd Sub\n"


@pytest.fixture
def controller(both: Both, listen_at: str) -> Iterator[Any]:
    device = VirtualRC8(clock=Clock(20), language="en")
    with orinkit.serve(device, listen_at) as server:
        made = both.connect(server.url, timeout=PATIENCE)  # the first start of a program builds the compiler
        yield made
        both.run(made.close())
    device.close()


def store(both: Both, controller: Any, name: str, text: str) -> Any:
    file = both.run(controller.file(name, create=True))
    both.run(file.put_text(text))
    return file


def task_of(both: Both, controller: Any, text: str) -> Any:
    store(both, controller, "Job.pcs", text)
    return both.run(controller.task("Job"))


def integer(both: Both, controller: Any, index: int) -> Any:
    return both.run(both.run(controller.variable(f"I{index}")).get_value())


# --- tasks ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [(), ("cycle",), ("Cycle ",), (1,)])
def test_one_cycle(both: Both, controller: Any, mode: tuple[Any, ...]) -> None:
    task = task_of(both, controller, COUNTING)
    assert both.run(task.get_status()) is TaskStatus.READY
    assert both.run(task.get_running()) is False
    both.run(task.start(*mode))
    assert both.run(task.wait()) is TaskStatus.READY
    assert integer(both, controller, 1) == 1
    both.run(task.start(*mode))
    both.run(task.wait(PATIENCE))
    assert integer(both, controller, 1) == 2


def test_continuous_execution_until_it_is_stopped(both: Both, controller: Any) -> None:
    task = task_of(both, controller, COUNTING)
    both.run(task.start("continuous"))
    until(lambda: integer(both, controller, 1) > 3)
    assert both.run(task.get_running()) is True
    both.run(task.stop("cycle"))
    assert both.run(task.wait(PATIENCE)) is TaskStatus.READY


def test_a_program_continues_without_the_client_that_has_started_it(both: Both, listen_at: str) -> None:
    """As on a real controller; docs/howto/lost-clients.md warns of it."""
    device = VirtualRC8(clock=Clock(20), language="en")
    with orinkit.serve(device, listen_at) as server:
        lost = both.connect(server.url, timeout=PATIENCE)
        both.run(task_of(both, lost, ENDLESS).start())
        both.run(lost.client.close())
        until(lambda: server.clients == 0)
        assert device.state.tasks.running == 1
        with device.state.cycles:
            before = device.state.cycles.number
        until(lambda: device.state.cycles.number > before + 100)
        assert device.state.tasks.running == 1
    device.close()


def test_single_steps(both: Both, controller: Any) -> None:
    task = task_of(both, controller, "Sub Main\n  I[1] = 1\n  I[2] = 2\nEnd Sub\n")
    lines = []
    for _ in range(2):
        both.run(task.start("step"))
        assert both.run(task.wait(PATIENCE)) is TaskStatus.STEP_STOPPED
        lines.append(both.run(task.get_line()))
    assert lines == [3, 4]  # the next statement
    assert integer(both, controller, 2) == 2


@pytest.mark.parametrize(
    ("mode", "status"),
    [
        ("instant", TaskStatus.SUSPENDED),
        ("default", TaskStatus.SUSPENDED),
        (0, TaskStatus.SUSPENDED),
        ("step", TaskStatus.STEP_STOPPED),
        ("initialize", TaskStatus.READY),
    ],
)
def test_stopping(both: Both, controller: Any, mode: Any, status: TaskStatus) -> None:
    task = task_of(both, controller, ENDLESS)
    both.run(task.start())
    both.run(task.stop(mode))
    assert both.run(task.wait(PATIENCE)) is status


def test_waiting_for_a_task_has_a_limit(both: Both, controller: Any) -> None:
    task = task_of(both, controller, ENDLESS)
    both.run(task.start())
    with pytest.raises(TimeoutError, match=r"the task still runs after 0\.05 s"):
        both.run(task.wait(0.05))
    assert both.run(task.get_running()) is True
    both.run(task.stop())


def test_a_program_that_fails_is_over(both: Both, controller: Any) -> None:
    task = task_of(both, controller, FAULTY)
    both.run(task.start())
    assert both.run(task.wait(PATIENCE)) is TaskStatus.READY
    (error,) = both.run(controller.errors())
    assert "Job" in str(error.details)


def test_the_error_that_has_ended_a_program(both: Both, controller: Any) -> None:
    task = task_of(both, controller, FAULTY)
    both.run(task.start())
    with pytest.raises(CallError, match=r"Job, line 3: ") as caught:
        both.run(task.wait(PATIENCE, check=True))
    (info,) = both.run(controller.errors())
    assert (caught.value.code, caught.value.subject) == (info.code, "Job")
    assert (info.program, info.line) == ("Job", 3)
    store(both, controller, "Other.pcs", COUNTING)
    other = both.run(controller.task("Other"))
    assert both.run(other.wait(check=True)) is TaskStatus.READY  # the error belongs to another program
    both.run(controller.clear_error())
    assert both.run(task.wait(check=True)) is TaskStatus.READY


@pytest.mark.parametrize("details", [(), (0, 1), (0, 1, "", 5), (0, 1, 7, 5), (0, 1, "Job", "x")])
def test_errors_without_a_line(details: tuple[Any, ...]) -> None:
    info = ErrorInfo(1, "x", details)
    assert info.line == 0
    assert info.program in ("", "Job")


@pytest.mark.parametrize(
    ("program", "task", "same"),
    [
        ("Job", "Job", True),
        ("job.PCS", "Job", True),
        (r"a\Job", "a/Job.pcs", True),
        ("Job", "Jo", False),
        ("", "", False),
    ],
)
def test_the_program_of_an_error(program: str, task: str, same: bool) -> None:
    assert is_program(program, task) is same


def test_a_syntax_error_has_the_message_of_the_log(both: Both, controller: Any) -> None:
    task = task_of(both, controller, "Sub Main\n  I[1] = = 1\nEnd Sub\n")
    with pytest.raises(CallError, match="SYNTAX_ERROR") as caught:
        both.run(task.start())
    assert "2" in caught.value.detail
    assert "Job" in caught.value.detail


@pytest.mark.parametrize("answer", [None, 5, [], [1] * 13, ["x"] * 13, [5, *[""] * 12]])
def test_log_records_without_a_message(answer: Any) -> None:
    assert logged_message(answer, 5) == ""


def test_modes_and_status_are_written_by_name() -> None:
    assert [str(each) for each in TaskStatus] == ["non_existent", "suspended", "ready", "running", "step_stopped"]
    assert f"{TaskMode.CYCLE} {StopMode.INITIALIZE}" == "cycle initialize"
    assert int(TaskStatus.READY) == 2


@pytest.mark.parametrize("use", [lambda t: t.start("twice"), lambda t: t.stop("now"), lambda t: t.start("")])
def test_unknown_modes(both: Both, controller: Any, use: Callable[[Any], Any]) -> None:
    task = task_of(both, controller, COUNTING)
    with pytest.raises(InvalidValue, match=r'unknown mode .*"cycle"') as caught:
        both.run(use(task))
    english = str(caught.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as caught:
        both.run(use(task))
    assert str(caught.value) != english
    with pytest.raises(InvalidArgument):
        both.run(task.start(9))


def test_an_invalid_status(both: Both) -> None:
    with orinkit.serve(Recorder(), "tcp://127.0.0.1:0") as server:
        controller = both.connect(server.url, provider="Test.Recorder")
        task = both.run(controller.task("Pro1"))
        with pytest.raises(ProtocolError, match="GetStatus returned an unexpected value"):
            both.run(task.get_status())
        both.run(controller.close())


def test_a_task_that_does_not_exist(both: Both, controller: Any) -> None:
    with pytest.raises(ObjectNotFound):
        both.run(controller.task("Nobody"))


def test_a_file_runs_as_a_task(both: Both, controller: Any) -> None:
    name = both.run(store(both, controller, "Job.pcs", COUNTING).run())
    assert name == "Job"
    task = both.run(controller.task(name))
    assert both.run(task.wait(PATIENCE)) is TaskStatus.READY
    assert both.run(task.get_file_name()) == "Job.pcs"
    assert integer(both, controller, 1) == 1


# --- files ----------------------------------------------------------------------------------------------------------


def test_a_file_that_is_missing(both: Both, controller: Any) -> None:
    file = both.run(controller.file("a/note.txt"))
    assert not both.run(file.get_exists())
    for ask in (file.get_text, file.get_size, file.delete, file.run, lambda: file.execute("x")):
        with pytest.raises(CallError, match="FILE_NOT_FOUND") as caught:
            both.run(ask())
        assert caught.value.subject == "a/note.txt"
    assert both.run(controller.file_names()) == ["Pro1.pcs", "Pro2.pcs", "Pro3.pcs"]
    both.run(file.close())
    both.run(file.close())
    with pytest.raises(ObjectReleased):
        both.run(file.put_text("x"))
    file = both.run(controller.file("a/note.txt", create=True))
    assert both.run(file.get_exists())
    assert both.run(file.get_text()) == ""
    assert both.run(file.get_data()) == b""
    both.run(controller.file("a/note.txt"))  # it exists now
    assert both.run(both.run(controller.file("a")).get_names()) == ["note.txt"]


def test_commands_prepared_before_the_file_existed(both: Both, controller: Any) -> None:
    """They have the handle that the file has received since."""
    file = both.run(controller.file("a/note.txt"))
    prepared = file.prepare("x")
    for execute in (prepared, lambda: file.execute("x")):
        with pytest.raises(CallError, match="FILE_NOT_FOUND"):
            both.run(execute())
    both.run(file.put_text("first"))
    for execute in (lambda: file.execute("x"), prepared, lambda: file.execute("x"), prepared):
        with pytest.raises(CallError) as caught:
            both.run(execute())
        assert caught.value.arguments[0] == file.handle != 0


def test_a_missing_file_is_created_when_it_is_written(both: Both, controller: Any) -> None:
    file = both.run(controller.file("a/b/note.txt"))
    both.run(file.put_text("first"))
    assert both.run(file.get_text()) == "first"
    assert both.run(file.get_exists())
    other = both.run(controller.file("a/b/note.txt"))
    assert both.run(other.get_text()) == "first"
    late = both.run(both.run(controller.file("a")).file("late.txt"))
    both.run(both.run(controller.file("a/late.txt", create=True)).put_data(b"here"))
    assert both.run(late.get_data()) == b"here"  # another client has created it
    both.run(file.delete())
    with pytest.raises(CallError, match="FILE_NOT_FOUND"):
        both.run(file.get_text())


def test_an_invalid_name_is_refused_immediately(both: Both, controller: Any) -> None:
    with pytest.raises(CallError, match="E_INVALIDARG"):
        both.run(controller.file("../x"))


@pytest.mark.parametrize("text", ["", "I[1] = 1\r\n", "位置 äö \U0001f916", "\n" * 5000])
@only("tcp", "serial", "http", because="a datagram takes 487 bytes")
def test_text(both: Both, controller: Any, text: str) -> None:
    file = store(both, controller, "note.txt", text)
    assert both.run(file.get_text()) == text
    assert both.run(file.get_data()) == text.encode()
    assert both.run(both.run(controller.file("note.txt")).get_text()) == text


@pytest.mark.parametrize("data", [b"", b"\x00\xff\x81", bytes(range(256)) * 20, bytearray(b"\x00\x01")])
@only("tcp", "serial", "http", because="a datagram takes 487 bytes")
def test_bytes(both: Both, controller: Any, data: bytes) -> None:
    file = both.run(controller.file("data.bin", create=True))
    both.run(file.put_data(data))
    assert both.run(file.get_data()) == bytes(data)
    assert both.run(file.get_size()) == len(data)


def test_bytes_that_are_not_text(both: Both, controller: Any) -> None:
    file = both.run(controller.file("data.bin", create=True))
    both.run(file.put_data(b"\x81\x00\xff"))
    with pytest.raises(InvalidValue, match=r"not text. Try: \.data"):
        both.run(file.get_text())
    both.run(file.put_data("位置".encode("cp932")))
    assert both.run(file.get_text()) == "位置"


def test_content_of_the_wrong_type(both: Both, controller: Any) -> None:
    file = store(both, controller, "note.txt", "kept")
    for put, content in ((file.put_text, b"x"), (file.put_text, None), (file.put_data, "x"), (file.put_data, [1])):
        with pytest.raises(InvalidValue, match=r"\.text for str, \.data for bytes"):
            both.run(put(content))
    assert both.run(file.get_text()) == "kept"


def test_copying_moving_deleting(both: Both, controller: Any) -> None:
    file = store(both, controller, "one.txt", "1")
    both.run(file.copy("two.txt"))
    both.run(both.run(controller.file("two.txt")).put_text("2"))
    both.run(file.move("three.txt"))
    assert both.run(file.get_path()) == "three.txt"
    names = both.run(controller.file_names())
    assert {"two.txt", "three.txt"} <= set(names)
    assert "one.txt" not in names
    assert both.run(file.get_text()) == "1"
    both.run(file.delete())
    assert "three.txt" not in both.run(controller.file_names())


def test_files_in_a_folder(both: Both, controller: Any) -> None:
    folder = both.run(controller.file("jobs/", create=True))
    both.run(both.run(folder.file("a.txt", create=True)).put_text("a"))
    assert not both.run(both.run(folder.file("b.txt")).get_exists())
    assert both.run(both.run(folder.file("a.txt")).get_text()) == "a"
    assert both.run(folder.get_names()) == both.run(folder.file_names()) == ["a.txt"]


def test_options_are_combined_with_create(both: Both) -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, "tcp://127.0.0.1:0") as server:
        controller = both.connect(server.url, provider="Test.Recorder", name="RC")
        folder = both.run(controller.file("a", "@IfNotMember", create=True))
        kept = [both.run(folder.file("b", create=True)), both.run(folder.file("c", "@X=1"))]
        assert recorder.calls[1:] == [
            Call("Controller_GetFile", "RC", ("a", "@Create=1,@IfNotMember")),
            Call("File_GetFile", "RC/a", ("b", "@Create=1")),
            Call("File_GetFile", "RC/a", ("c", "@X=1")),
        ]
        del kept
        both.run(controller.close())


def test_dates(both: Both, controller: Any) -> None:
    before = both.run(both.run(controller.variable("@CURRENT_TIME")).get_value())
    file = store(both, controller, "note.txt", "x")
    for ask in (file.get_date_created, file.get_date_last_modified, file.get_date_last_accessed):
        date = both.run(ask())
        assert isinstance(date, datetime)
        assert date - before < timedelta(days=2)


@pytest.mark.parametrize(
    ("answer", "read"),
    [
        ("2024-04-01 09:00:00", datetime(2024, 4, 1, 9)),
        (" 2024-04-01 09:00:00 ", datetime(2024, 4, 1, 9)),
        ("2024-04-01", datetime(2024, 4, 1)),
        ("yesterday", "yesterday"),
        ("", ""),
        ("9" * 5000, "9" * 5000),
        (datetime(2024, 4, 1), datetime(2024, 4, 1)),
        (None, None),
        ([1], [1]),
    ],
)
def test_dates_that_cannot_be_parsed_are_unchanged(answer: Any, read: Any) -> None:
    assert parse_date(answer) == read


@pytest.mark.parametrize("content", [5, [1.0], True])
def test_contents_that_are_neither_text_nor_bytes(content: Any) -> None:
    with pytest.raises(InvalidValue, match=r"\.data|\.value"):
        file_text(content)


def test_properties_of_the_synchronous_client() -> None:
    with (
        orinkit.serve(VirtualRC8(clock=Clock(20)), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url) as controller,
    ):
        file = controller.file("Job.pcs", create=True)
        file.text = ENDLESS
        assert file.text == ENDLESS
        file.data = COUNTING.encode()
        assert file.data == COUNTING.encode()
        assert controller.file("").names == controller.file_names()
        assert isinstance(file.date_created, datetime)
        task = controller.task("Job")
        assert (task.status, task.running, task.line) == (TaskStatus.READY, False, 0)
        with pytest.raises(AttributeError):
            setattr(task, "status", TaskStatus.RUNNING)  # noqa: B010 - a type checker would see it
