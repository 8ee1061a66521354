"""The files and folders of the controller."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import events, ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state import file_store
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.file_store import MAX_TRANSFERRED, PROGRAM, Entry
from orinkit.tester.ui.dialogs import ask, ask_text
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession, notify

_SHOWN = 200
_NEW_PROGRAM = "Sub Main\n\nEnd Sub\n"


class FileCard:
    """The card with the contents of one folder.

    Attributes:
        on_open: Callback that opens a file in the editor.
        may_replace: Callback that asks whether unsaved changes may be discarded.
        on_delete: Callback invoked with the path of a deleted file.
        on_change: Callback invoked after files have been created, renamed or deleted.
    """

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self._session, self._connection = session, connection
        self._folder = ""
        self._entries: list[Entry] = []
        self._selected: Entry | None = None
        self.on_open: Callable[[str], Awaitable[None]] | None = None
        self.may_replace: Callable[[], Awaitable[bool]] | None = None
        self.on_delete: Callable[[str], None] | None = None
        self.on_change: Callable[[], Awaitable[None]] | None = None
        with ui.element("section").classes("ok-card ok-files").props("data-testid=file-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Files")).classes("ok-card-title")
                ui.space()
                self._button("note_add", tr("New file"), "new-file", self._new_file)
                self._button("create_new_folder", tr("New folder"), "new-folder", self._new_folder)
                upload_button = ui.button(icon="upload").props("flat dense round size=sm data-testid=upload-button")
                upload_button.props["aria-label"] = tr("Upload")
                upload_button.tooltip(tr("Upload"))
                self._refresh_button = ui.button(icon="refresh").props("flat dense round size=sm")
                self._refresh_button.props["aria-label"] = tr("Read again")
            self._path = ui.label().classes("ok-mono ok-dim")
            self._filter = ui.input(placeholder=tr("Filter"), on_change=self._show).props("outlined dense clearable")
            self._filter.props("maxlength=100").props["aria-label"] = tr("Filter")
            self._errors = ErrorBox("error-files")
            self._list = ui.element("div").classes("ok-file-list").props("role=group data-testid=file-list")
            self._list.props["aria-label"] = tr("Files")
            with ui.element("div").classes("ok-row ok-file-actions"):
                self._actions = [
                    self._button("drive_file_rename_outline", tr("Rename"), "rename", self._rename),
                    self._button("content_copy", tr("Copy"), "copy", self._copy),
                    self._button("download", tr("Download"), "download", self._download, guarded=False),
                    self._button("delete_outline", tr("Delete"), "delete", self._delete),
                ]
            self._upload = ui.upload(
                on_upload=self._uploaded, on_rejected=self._rejected, max_file_size=MAX_TRANSFERRED, multiple=True, auto_upload=True
            ).classes("hidden").props("data-testid=upload").style("display: none")  # fmt: skip
        upload_button.on_click(lambda: self._upload.run_method("pickFiles"))
        self._refresh_button.on_click(self.refresh)

    def _button(
        self, icon: str, text: str, marker: str, handler: Callable[[], Awaitable[None]], *, guarded: bool = True
    ) -> ui.button:
        button = ui.button(icon=icon).props(f"flat dense round size=sm data-testid={marker}").tooltip(text)
        button.props["aria-label"] = text

        async def click() -> None:
            wrapped = self._session.guarded if guarded else None
            run = (
                wrapped(handler, self._errors.show) if wrapped else reported(self._session, handler, self._errors.show)
            )
            await run()

        button.on_click(click)
        return button

    async def refresh(self) -> None:
        """Read the folder again."""
        await reported(self._session, self._read, self._errors.show)()

    async def _read(self) -> None:
        self._entries = await file_store.entries(self._connection.controller, self._folder)
        if self._selected is not None and self._selected not in self._entries:
            self._selected = None
        self._show()

    def _show(self) -> None:
        self._path.text = f"{file_store.SEPARATOR}{self._folder}"
        words = (self._filter.value or "").casefold()
        found = [each for each in self._entries if words in each.name.casefold()]
        self._list.clear()
        with self._list:
            if self._folder:
                self._row("arrow_back", "..", self._up)
            for entry in found[:_SHOWN]:
                self._entry_row(entry)
            if len(found) > _SHOWN:
                ui.label(tr("{count} more. Try: filter", count=len(found) - _SHOWN)).classes("ok-dim")
            if not found and not self._folder:
                ui.label(tr("no files")).classes("ok-dim")
        for button in self._actions:
            button.set_enabled(self._selected is not None)

    def _entry_row(self, entry: Entry) -> None:
        is_program = bool(file_store.task_of(entry.path)) and not entry.is_folder
        icon = "folder" if entry.is_folder else "code" if is_program else "description"
        button = self._row(icon, entry.name, lambda: self._choose(entry))
        button.props["data-testid"] = f"file-{entry.name}"
        if entry.is_folder:
            button.on("dblclick", lambda: self._enter(entry))
        if self._selected == entry:
            button.classes("ok-selected").props("aria-current=true")

    def _row(self, icon: str, name: str, handler: Callable[[], Awaitable[None]]) -> ui.element:
        button = ui.element("button").classes("ok-file").props("type=button")
        with button:
            ui.icon(icon)
            ui.label(name)
        button.on("click", reported(self._session, handler, self._errors.show))
        return button

    async def _choose(self, entry: Entry) -> None:
        if entry.is_folder and self._selected == entry:
            await self._enter(entry)
            return
        if not entry.is_folder and self.on_open is not None:
            await self.on_open(entry.path)  # which calls select(), unless the user keeps the present file
            return
        self._selected = entry
        self._show()

    def select(self, path: str) -> None:
        """Select the file that has been opened in the editor, if this folder contains it."""
        self._selected = next((each for each in self._entries if each.path.casefold() == path.casefold()), None)
        self._show()

    async def _enter(self, entry: Entry) -> None:
        self._folder, self._selected = entry.path, None
        await self._read()

    async def _up(self) -> None:
        self._folder, self._selected = file_store.parent_of(self._folder), None
        await self._read()

    async def _changed(self, path: str = "") -> None:
        await self._read()
        self._selected = next((each for each in self._entries if each.path == path), self._selected)
        self._show()
        if self.on_change is not None:
            await self.on_change()

    async def _new_file(self) -> None:
        name = await ask_text(self._session, tr("New file"), tr("Name"), f"Program1{PROGRAM}")
        if not name:
            return
        path = file_store.joined(self._folder, name)
        text = _NEW_PROGRAM if file_store.task_of(path) else ""
        await file_store.create(self._connection.controller, path, text)
        await self._changed(path)
        if self.on_open is not None:
            await self.on_open(path)

    async def _new_folder(self) -> None:
        name = await ask_text(self._session, tr("New folder"), tr("Name"))
        if name:
            path = file_store.joined(self._folder, name)
            await file_store.create(self._connection.controller, path, folder=True)
            await self._changed(path)

    async def _rename(self) -> None:
        entry = self._selected
        if entry is None or (self.may_replace and not await self.may_replace()):
            return
        name = await ask_text(self._session, tr("Rename {name}", name=entry.name), tr("New name"), entry.name)
        if name and name != entry.name:
            path = file_store.joined(self._folder, name)
            async with await self._connection.controller.file(entry.path) as file:
                await file.move(path)
            await self._changed(path)
            if not entry.is_folder and self.on_open is not None:
                await self.on_open(path)

    async def _copy(self) -> None:
        entry = self._selected
        if entry is None:
            return
        name = await ask_text(
            self._session, tr("Copy {name}", name=entry.name), tr("Name of the copy"), f"Copy_{entry.name}"
        )
        if name:
            path = file_store.joined(self._folder, name)
            async with await self._connection.controller.file(entry.path) as file:
                await file.copy(path)
            await self._changed(path)

    async def _delete(self) -> None:
        entry = self._selected
        if entry is None:
            return
        text = tr("The folder {path} and everything in it is deleted on the controller.", path=entry.path)
        if not entry.is_folder:
            text = tr("The file {path} is deleted on the controller.", path=entry.path)
        if await ask(self._session, tr("Delete {name}?", name=entry.name), text, {"delete": tr("Delete")}, "delete"):
            async with await self._connection.controller.file(entry.path) as file:
                await file.delete("@Recursive=1" if entry.is_folder else "")
            if self.on_delete is not None:
                self.on_delete(entry.path)
            await self._changed()

    async def _download(self) -> None:
        entry = self._selected
        if entry is None or entry.is_folder:
            raise InvalidValue(tr("only a file can be downloaded. Try: choose a file"))
        ui.download.content(await file_store.read_data(self._connection.controller, entry.path), entry.name)

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        data, name = await event.file.read(), event.file.name

        async def store() -> None:
            path = file_store.joined(self._folder, name)
            if any(each.name.casefold() == name.casefold() for each in self._entries):
                text = tr("{path} exists on the controller.", path=path)
                if not await ask(
                    self._session, tr("Replace {name}?", name=name), text, {"replace": tr("Replace")}, "replace"
                ):
                    return
            await file_store.write(self._connection.controller, path, data)
            await self._changed(path)
            notify(tr("{path} is saved", path=path), "positive")

        await self._session.guarded(store, self._errors.show)()
        self._upload.reset()

    def _rejected(self) -> None:
        self._errors.show_text(tr("the file is too large; at most {most} MB", most=MAX_TRANSFERRED // 1024**2))
