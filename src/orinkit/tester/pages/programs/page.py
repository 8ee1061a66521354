"""The contents of the page Programs."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.programs.editor_card import EditorCard
from orinkit.tester.pages.programs.file_card import FileCard
from orinkit.tester.pages.programs.task_card import TaskCard
from orinkit.tester.ui.reporting import chosen_controller
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.2  # s


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Programs")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(tr("The files of the controller, and the programs that it runs.")).classes("ok-page-hint")
    connection = chosen_controller(session)
    if connection is None:
        return
    with ui.element("div").classes("ok-programs"):
        files = FileCard(session, connection)
        yield
        editor = EditorCard(session, connection)
        yield
        tasks = TaskCard(session, connection, editor)
    files.on_open = editor.open
    files.may_replace = editor.may_replace
    editor.on_opened = files.select
    files.on_delete = editor.forget
    files.on_change = tasks.load

    async def enter() -> None:
        await files.refresh()
        await tasks.load()

    session.while_connected(enter, tasks.pause)
    ui.timer(_REFRESH, tasks.refresh)
