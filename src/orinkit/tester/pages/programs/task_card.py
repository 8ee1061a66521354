"""The tasks of the controller: status, current line, start and stop."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.errors import CallError, OrinError
from orinkit.core.i18n import N_, tr
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.tester.pages.programs.editor_card import EditorCard
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.file_store import PROGRAM
from orinkit.tester.state.poller import VariableRef, Watch
from orinkit.tester.state.program_errors import ProgramProblem, problem_of_run, problem_of_start
from orinkit.tester.state.running_task import RunningTask
from orinkit.tester.ui.dialogs import ask
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.presence import Presence
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession, notify

_SHOWN = 20
_ABSENT = 2.0  # s without a heartbeat
_START_MODES = {TaskMode.CYCLE: N_("One cycle"), TaskMode.CONTINUOUS: N_("Continuous"), TaskMode.STEP: N_("One step")}
_STOP_MODES = {
    StopMode.INSTANT: N_("Immediately"), StopMode.STEP: N_("After the step"), StopMode.CYCLE: N_("After the cycle"),
    StopMode.INITIALIZE: N_("Immediately, and reset"), StopMode.DEFAULT: N_("Default of the controller"),
}  # fmt: skip
_STATUS_TEXTS = {
    TaskStatus.NON_EXISTENT: N_("does not exist"), TaskStatus.SUSPENDED: N_("suspended"), TaskStatus.READY: N_("ready"),
    TaskStatus.RUNNING: N_("running"), TaskStatus.STEP_STOPPED: N_("step stopped"),
}  # fmt: skip
_AT_LINE = (TaskStatus.RUNNING, TaskStatus.SUSPENDED, TaskStatus.STEP_STOPPED)


class TaskCard:
    """The card with the tasks."""

    def __init__(self, session: PageSession, connection: ControllerConnection, editor: EditorCard) -> None:
        self._session, self._connection, self._editor = session, connection, editor
        self._names: list[str] = []
        self._rows: list[_Row] = []
        self._started: set[RunningTask] = set()
        self._presence = Presence(session, _ABSENT)
        with ui.element("section").classes("ok-card ok-tasks").props("data-testid=task-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Tasks")).classes("ok-card-title")
                ui.space()
                self._filter = ui.input(placeholder=tr("Filter"), on_change=self._build_rows).props(
                    "outlined dense clearable"
                )
                self._filter.props("maxlength=100").props["aria-label"] = tr("Filter")
            with ui.element("div").classes("ok-form"):
                self._start_mode = ui.select(
                    {int(key): tr(text) for key, text in _START_MODES.items()}, value=1, label=tr("Start")
                )
                self._start_mode.props("outlined dense options-dense data-testid=start-mode")
                self._stop_mode = ui.select(
                    {int(key): tr(text) for key, text in _STOP_MODES.items()}, value=1, label=tr("Stop")
                )
                self._stop_mode.props("outlined dense options-dense data-testid=stop-mode")
            self._leave = ui.checkbox(tr("Stop when I leave"), value=True).props("dense data-testid=stop-when-leaving")
            ui.label(
                tr(
                    "A program keeps running in the controller if you leave. With this setting, the Tester stops the programs "
                    "that you started here when this page is closed, hidden, or not heard for 2 s."
                )
            ).classes("ok-dim")
            self.errors = ErrorBox("error-tasks")
            clear = ui.button(tr("Clear errors"), icon="task_alt").props("flat no-caps dense data-testid=clear-errors")
            clear.classes("ok-start")
            clear.on_click(session.guarded(self._clear_errors, self.errors.show))
            self._list = ui.element("div").classes("ok-task-list").props("data-testid=task-list")

    async def _clear_errors(self) -> None:
        """Clear the errors of the controller; while an error is present, it starts no program."""
        await self._connection.controller.clear_error()
        self._editor.mark_problem(None)
        notify(tr("The errors are cleared"), "positive")

    async def load(self) -> None:
        """Read the names of the tasks."""
        await reported(self._session, self._load, self.errors.show)()

    async def _load(self) -> None:
        names = await (await self._connection.monitor()).task_names()
        if names != self._names or not self._rows:
            self._names = names
            self._build_rows()

    def pause(self) -> None:
        """Stop reading the status of the tasks."""
        for row in self._rows:
            row.close()
        self._rows = []

    def _build_rows(self) -> None:
        self.pause()
        words = (self._filter.value or "").casefold()
        found = [name for name in self._names if words in name.casefold()]
        self._list.clear()
        with self._list:
            for name in found[:_SHOWN]:
                self._rows.append(_Row(self, self._session, self._connection, name))
            if len(found) > _SHOWN:
                ui.label(tr("{count} more. Try: filter", count=len(found) - _SHOWN)).classes("ok-dim")
            if not self._names:
                ui.label(tr("no programs")).classes("ok-dim")

    async def refresh(self) -> None:
        """Display the status of the tasks, and mark the current line in the editor."""
        for row in self._rows:
            row.refresh()
            if row.name.casefold() == self._editor.task.casefold():
                self._editor.mark_line(row.line if row.status in _AT_LINE else 0)
            if row.has_ended:
                row.has_ended = False
                await self._show_problem_of_run(row.name)

    async def start(self, name: str) -> None:
        """Start a task; if its program has an error, mark the line in the editor.

        Raises:
            OrinError: If the controller refuses, or does not reply.
        """
        if not await self._is_saved(name):
            return
        self._editor.mark_problem(None)
        running = RunningTask(self._connection, name, self._session.workspace.motions)
        try:
            await running.start(TaskMode(self._start_mode.value))
        except CallError as error:
            present = await (await self._connection.monitor()).errors()
            await self._show_problem(name, problem_of_start(error, name, present))
            raise
        self._guard(running)

    async def stop(self, name: str) -> None:
        """Stop a task in the chosen mode.

        Raises:
            OrinError: If the controller refuses, or does not reply.
        """
        async with await (await self._connection.monitor()).task(name) as task:
            await task.stop(StopMode(self._stop_mode.value))

    async def open(self, name: str) -> None:
        """Open the program of a task in the editor."""
        await self._editor.open(name + PROGRAM)

    def _guard(self, running: RunningTask) -> None:
        """Stop a program when the user leaves, if the user has chosen this."""
        self._presence.begin()  # the user is present
        self._started = {each for each in self._started if not each.finished.is_set()} | {running}
        running.stop_when(self._presence.lost, lambda: bool(self._leave.value))

    async def _is_saved(self, name: str) -> bool:
        """Return False if the user does not start a program because it has not been saved."""
        if name.casefold() != self._editor.task.casefold() or not self._editor.unsaved:
            return True
        text = tr("{path} has not been saved. The controller runs the saved program.", path=self._editor.path)
        choices = {"start": tr("Start the saved program"), "save": tr("Save and start")}
        answer = await ask(self._session, tr("Unsaved changes"), text, choices)
        if answer == "save":
            await self._editor.save()
        return bool(answer)

    async def _show_problem_of_run(self, name: str) -> None:
        try:
            present = await (await self._connection.monitor()).errors()
            await self._show_problem(name, problem_of_run(name, present))
        except (OrinError, OSError) as error:
            self.errors.show(error)

    async def _show_problem(self, name: str, problem: ProgramProblem | None) -> None:
        if problem is None:
            return
        if self._editor.task.casefold() != name.casefold() and not self._editor.unsaved:
            await self.open(name)
        if self._editor.task.casefold() == name.casefold():
            self._editor.mark_problem(problem)


class _Row:
    """One task.

    Attributes:
        name: Name of the task.
        status: Its status.
        line: The line that is executed next.
        has_ended: True if it has ended since the page last looked.
    """

    def __init__(self, card: TaskCard, session: PageSession, connection: ControllerConnection, name: str) -> None:
        self.name = name
        self.status = TaskStatus.READY
        self.line = 0
        self.has_ended = False
        self._shown = ""
        poller = connection.poller
        self._status_watch = poller.watch(VariableRef("task", name, "@STATUS"))
        self._line_watch = poller.watch(VariableRef("task", name, "@LINE_NO"))
        with ui.element("div").classes("ok-task") as row:
            row.props["data-testid"] = f"task-{name}"
            title = ui.element("button").classes("ok-file").props("type=button")
            with title:
                ui.label(name)
            title.on("click", reported(session, lambda: card.open(name), card.errors.show))
            self._chip = ui.label().classes("ok-chip").props("data-testid=status")
            ui.space()
            for icon, text, marker, action in (
                ("play_arrow", tr("Start {name}", name=name), "start", card.start),
                ("stop", tr("Stop {name}", name=name), "stop", card.stop),
            ):
                button = ui.button(icon=icon).props(f"flat dense round data-testid={marker}").tooltip(text)
                button.props["aria-label"] = text
                button.on_click(session.guarded(lambda action=action: action(name), card.errors.show))

    def refresh(self) -> None:
        """Display the status."""
        status = _status(self._status_watch)
        value = self._line_watch.reading.value
        found = None if value is None else value.value
        line = found[0] if isinstance(found, list) and found else found  # line and file, or the line alone
        self.line = line if isinstance(line, int) else 0
        if status is None:
            text, tone = "–", ""
        else:
            self.has_ended |= self.status is TaskStatus.RUNNING and status is TaskStatus.READY
            self.status = status
            at = tr("line {line}", line=self.line) if status in _AT_LINE and self.line else ""
            text = " · ".join(filter(None, (tr(_STATUS_TEXTS[status]), at)))
            tone = "ok-good" if status is TaskStatus.RUNNING else "ok-warn" if status in _AT_LINE else ""
        if text != self._shown:
            self._shown = text
            self._chip.text = text
            self._chip.classes(replace=f"ok-chip {tone}")

    def close(self) -> None:
        """Stop reading the status."""
        self._status_watch.close()
        self._line_watch.close()


def _status(watch: Watch) -> TaskStatus | None:
    reading = watch.reading
    if reading.error is not None or reading.value is None:
        return None
    try:
        return TaskStatus(reading.value.value)
    except ValueError:
        return None
