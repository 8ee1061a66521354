"""The editor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.programs.line_marks import mark_lines
from orinkit.tester.state import file_store
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.file_store import MAX_EDITED, TextFile
from orinkit.tester.state.program_errors import ProgramProblem
from orinkit.tester.ui.dialogs import ask
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession, notify

_WARN_SCRIPT = """
if (window.okUnsaved === undefined) {
  window.addEventListener('beforeunload', event => { if (window.okUnsaved) event.preventDefault(); });
}
window.okUnsaved = %s;
"""
_LANGUAGE: Final = "VB.NET"  # the most similar one to PacScript
_TOO_LONG = "ok-too-long"
_PASTE_SCRIPT = """(event) => {
  const text = event.clipboardData ? event.clipboardData.getData('text') : '';
  if (text.length > %d) { event.preventDefault(); event.stopPropagation(); emitEvent('%s', text.length); }
}"""


class EditorCard:
    """The card with the editor of one file.

    Attributes:
        on_opened: Callback invoked with the path of a file that has been opened.
    """

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self._session, self._connection = session, connection
        self._file: TextFile | None = None
        self._saved = ""
        self._line = 0
        self._problem: ProgramProblem | None = None
        self._shown: object = None
        self._marks: list[tuple[int, str, str]] = []
        self.on_opened: Callable[[str], None] | None = None
        with ui.element("section").classes("ok-card ok-editor-card").props("data-testid=editor-card"):
            with ui.element("div").classes("ok-row"):
                self._title = ui.label(tr("Editor")).classes("ok-card-title").props("data-testid=editor-title")
                self._dirty = (
                    ui.label(tr("not saved")).classes("ok-chip ok-warn").props("data-testid=unsaved role=status")
                )
                ui.space()
                self._info = ui.label().classes("ok-dim")
                self._save = ui.button(tr("Save"), icon="save").props("unelevated no-caps dense data-testid=save-file")
                self._save.tooltip(tr("Save (Ctrl+S)"))
            self._errors = ErrorBox("error-editor")
            self._mark = ui.label().classes("ok-error").props("role=alert data-testid=program-error")
            with ui.element("div").classes("ok-empty") as self._empty:
                ui.icon("description")
                ui.label(tr("Choose a file of the list."))
            save = session.guarded(self.save, self._errors.show)
            self._editor = ui.codemirror(
                "", language=_LANGUAGE, theme="vscodeDark" if session.dark else "vscodeLight", indent="  ",
                on_change=self._changed, keymap={"Mod-s": save},
            ).classes("ok-editor").props("data-testid=editor")  # fmt: skip
            self._editor.props["aria-label"] = tr("Editor")
            self._editor.on("paste.capture", js_handler=_PASTE_SCRIPT % (MAX_EDITED, _TOO_LONG))
        self._save.on_click(save)
        ui.on(_TOO_LONG, self._refuse_paste)
        self._show()

    @property
    def path(self) -> str:
        """Path of the open file; ``""`` if there is none."""
        return self._file.path if self._file else ""

    @property
    def task(self) -> str:
        """The task of the open program; ``""`` if there is none."""
        return file_store.task_of(self.path)

    @property
    def unsaved(self) -> bool:
        """True if the text has been changed since it was read or saved."""
        return self._file is not None and (self._editor.value or "") != self._saved

    async def open(self, path: str) -> None:
        """Open a file; ask first if the present one has not been saved."""
        if not await self.may_replace():
            return
        self._errors.show(None)
        controller = self._connection.controller
        async with await controller.file(path) as file:
            text = file_store.text_file(path, await file.get_value())
            info = await file_store.details(file)
        self._file, self._saved, self._info.text = text, text.text, info
        self._line, self._problem = 0, None
        self._marks = []
        mark_lines(self._editor, [])
        self._editor.value = text.text
        self._editor.props["language"] = _LANGUAGE if self.task else None
        self._show()
        if self.on_opened is not None:
            self.on_opened(path)

    def forget(self, path: str) -> None:
        """Close a file that has been deleted; unsaved changes remain in the editor."""
        if path != self.path or self.unsaved:
            return
        self._file, self._saved, self._info.text, self._line, self._problem = None, "", "", 0, None
        self._editor.value = ""
        self._show()

    async def may_replace(self) -> bool:
        """Return True if the text is saved, or the user agrees to discard it."""
        if not self.unsaved:
            return True
        question = tr("{path} has not been saved.", path=self.path)
        choices = {"discard": tr("Discard"), "save": tr("Save")}
        answer = await ask(self._session, tr("Unsaved changes"), question, choices, "discard")
        if answer == "save":
            self._session.workspace.controls.require(self._session.user)
            await self.save()
        return bool(answer)

    async def save(self) -> None:
        """Write the file to the controller.

        Raises:
            InvalidValue: If the text is too long, or cannot be encoded.
            OrinError: If the controller refuses, or does not reply.
        """
        if self._file is None:
            return
        text = self._editor.value or ""
        if len(text) > MAX_EDITED:
            self._refuse(len(text))
            return
        controller = self._connection.controller
        async with await controller.file(self._file.path) as file:
            await file.put_value(self._file.content(text))
            info = await file_store.details(file)
        self._saved, self._info.text, self._problem = text, info, None
        self._show()
        notify(tr("{path} is saved", path=self._file.path), "positive")

    def mark_problem(self, problem: ProgramProblem | None) -> None:
        """Mark the line of an error; with ``None``, remove the mark."""
        self._problem = problem
        self._show()
        if problem is not None and problem.line <= (self._editor.value or "").count("\n") + 1:
            self._editor.reveal_line(problem.line)

    def mark_line(self, line: int) -> None:
        """Mark the line that is executed next; 0 for none."""
        if line != self._line:
            self._line = line
            self._show()
            if line:
                self._editor.reveal_line(line)

    def _changed(self) -> None:
        self._show()

    def _refuse_paste(self, event: object) -> None:
        count = getattr(event, "args", 0)
        self._refuse(count if isinstance(count, int) else 0)

    def _refuse(self, count: int) -> None:
        self._errors.show_text(
            tr("the text has {count} characters; at most {most} can be edited", count=count, most=MAX_EDITED)
        )

    def _show(self) -> None:
        """Display the state if it has changed."""
        unsaved, problem = self.unsaved, self._problem
        state = (self.path, unsaved, problem, self._line)
        if state == self._shown:
            return
        was_unsaved = isinstance(self._shown, tuple) and self._shown[1]
        self._shown = state
        self._title.text = self.path or tr("Editor")
        self._title.classes(replace="ok-card-title ok-mono" if self.path else "ok-card-title")
        self._dirty.visible = unsaved
        self._save.visible = self._editor.visible = bool(self.path)
        self._empty.visible = not self.path
        self._mark.visible = problem is not None
        if problem is not None:
            self._mark.text = tr("Line {line}: {text}", line=problem.line, text=problem.text)
        lines = (self._editor.value or "").count("\n") + 1
        marks = []
        if 0 < self._line <= lines:
            marks.append((self._line, "ok-line-running", ""))
        if problem is not None and 0 < problem.line <= lines:
            marks.append((problem.line, "ok-line-error", problem.text))
        if marks != self._marks:
            self._marks = marks
            mark_lines(self._editor, marks)
        if unsaved != was_unsaved:
            self._session.client.run_javascript(_WARN_SCRIPT % ("true" if unsaved else "false"))
