"""The frames of the CAN bus: a list with a filter, and the fields of the selected frame."""

from __future__ import annotations

import asyncio
from typing import Any

from nicegui import ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.pages.abh3.frame_filters import FrameFilterBar
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.abh3.frame_filter import FrameFilter, FrameView
from orinkit.tester.state.abh3.frame_text import as_text, detail_of, row_of
from orinkit.tester.state.frame_log import LoggedFrame
from orinkit.tester.state.packet_text import time_text
from orinkit.tester.ui.clipboard import copy_text
from orinkit.tester.ui.entry_list import EntryList, RecordButtons
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.packet_bytes import PacketBytes
from orinkit.tester.ui.packet_list import ListTexts
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession

_COPIED = 1000  # frames that are copied at once: the newest ones


class FramesCard:
    """The list of frames, and the selected frame.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._session = session
        self._log, self._decoder = cell.connection.frames, cell.connection.decoder
        self._view = FrameView(self._log, FrameFilter(polled=False), self._decoder)
        self._selected = 0
        with ui.element("div").classes("ok-packet-parts ok-frames"):
            with ui.element("section").classes("ok-card"):
                self._build_head()
                FrameFilterBar(self._set_filter, self._view.condition)
                self._build_list()
            with ui.element("section").classes("ok-card").props("data-testid=frame-detail"):
                self._build_detail()

    def _build_head(self) -> None:
        with ui.element("div").classes("ok-row"):
            ui.label(tr("CAN frames")).classes("ok-card-title")
            ui.space()
            self._record = RecordButtons(self._session, self._log, lambda error: self._errors.show(error))
            copy = ui.button(tr("Copy list"), icon="content_copy").props("flat dense no-caps data-testid=copy-list")
            copy.tooltip(tr("The newest {most} frames of the list, as text", most=f"{_COPIED:,}"))
        self._errors = ErrorBox("error-frames")
        copy.on_click(reported(self._session, self._copy_list, self._errors.show))

    def _build_list(self) -> None:
        texts = ListTexts(
            tr("CAN frames"), tr("No frames. They appear here as soon as one is sent or received."),
            (tr("No."), tr("Time"), tr("CAN ID"), "", tr("Data"), tr("Meaning")), "frame",
        )  # fmt: skip
        self._list = EntryList(
            self._log, self._view, texts, self._row, self._select,
            lambda count, total: tr("{count} of {total} frames", count=count, total=total),
        )  # fmt: skip

    def _build_detail(self) -> None:
        self._hint = ui.label(tr("Select a frame to see its bytes and their meaning.")).classes("ok-dim")
        self._detail = ui.element("div").classes("ok-frame-detail")
        with self._detail:
            with ui.element("div").classes("ok-row"):
                self._title = ui.label().classes("ok-card-title").props("data-testid=frame-title")
                self._facts = ui.label().classes("ok-dim ok-packet-facts")
                ui.space()
                copy = ui.button(tr("Copy"), icon="content_copy").props("flat dense no-caps data-testid=copy-frame")
            self._bytes = PacketBytes("frame-bytes")
        self._detail.visible = False
        copy.on_click(reported(self._session, self._copy_selected, self._errors.show))

    def _row(self, entry: LoggedFrame, previous: LoggedFrame | None, mode: str) -> list[Any]:
        return row_of(entry, previous, mode, self._log.start_ns, self._decoder)

    def _set_filter(self, condition: FrameFilter) -> None:
        self._view = FrameView(self._log, condition, self._decoder)
        self._list.show_view(self._view)

    def _select(self, number: int) -> None:
        entry = self._log.get(number)
        if entry is None:
            return
        self._selected = number
        heading = self._decoder.decode(entry.frame).heading
        self._hint.visible, self._detail.visible = False, True
        self._title.text = f"#{number} {tr('sent') if entry.direction == '>' else tr('received')}: {heading}"
        self._facts.text = f"{time_text(entry.time_ns)} · {entry.frame}"
        self._bytes.show(detail_of(entry.frame, self._decoder))
        self._list.reveal(number)

    async def _copy_selected(self) -> None:
        entry = self._log.get(self._selected)
        if entry is None:
            raise InvalidValue(tr("the frame is not in the list any more"))
        await copy_text(as_text([entry], self._decoder))

    async def _copy_list(self) -> None:
        found = (self._log.get(number) for number in self._view.numbers()[-_COPIED:])
        entries = [entry for entry in found if entry is not None]
        if not entries:
            raise InvalidValue(tr("the list is empty"))
        text = []
        for at in range(0, len(entries), 50):  # in pieces that do not block the event loop
            text.append(as_text(entries[at : at + 50], self._decoder))
            await asyncio.sleep(0)
        await copy_text("\n".join(text))

    async def refresh(self) -> None:
        """Examine further frames and show what has changed."""
        self._record.refresh()
        await self._list.refresh()
