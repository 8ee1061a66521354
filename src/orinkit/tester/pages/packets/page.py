"""The contents of the page Packets: :class:`PacketsPage`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from time import perf_counter
from typing import Any

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.packets.detail import DetailCard
from orinkit.tester.pages.packets.elements import PacketList
from orinkit.tester.pages.packets.exports import PageExports
from orinkit.tester.pages.packets.filters import FilterBar
from orinkit.tester.pages.packets.last import LastPackets
from orinkit.tester.state.packet_facts import Summaries
from orinkit.tester.state.packet_filter import PAUSE, LastPairs, PacketFilter, PacketView
from orinkit.tester.state.packet_rows import TIME_MODES, row_of
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.15  # s
_SEARCH = 0.15  # s of searching between two updates of the page
_SUMMARIES = Summaries()


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Packets")).classes("ok-page-title").props("role=heading aria-level=1")
    page = PacketsPage(session)
    yield from page.build()
    ui.timer(_REFRESH, page.refresh)


class PacketsPage:
    """The list of packets with its filter, the selected packet, and the last packets of each connection.

    Args:
        session: The page.
    """

    def __init__(self, session: PageSession) -> None:
        self._session = session
        self._log = session.workspace.packets
        self._summary = _SUMMARIES.in_language(session.language)
        self._view: PacketView | LastPairs = PacketView(self._log, PacketFilter(), self._summary)
        self._views = 0
        self._follow = True
        self._mode = "time"
        self._window = (0, 40)
        self._selected = 0
        self._reveal = 0
        self._shown: object = None
        self._exports = PageExports(
            session.workspace, session.client.id, lambda: self._view.numbers(), _SUMMARIES.in_language("en")
        )
        session.client.on_delete(self._exports.close)

    def build(self) -> Iterator[None]:
        """Build the elements in several parts."""
        with ui.element("div").classes("ok-row ok-packet-bar"):
            self._tab = ui.toggle({"all": tr("All packets"), "last": tr("Last sent and received")}, value="all")
            self._tab.props("no-caps unelevated dense data-testid=packet-tabs")
            ui.space()
            self._build_actions()
        yield
        self._errors = ErrorBox("error-packets")
        self._list_part = ui.element("div").classes("ok-packet-parts")
        with self._list_part:
            with ui.element("section").classes("ok-card"):
                yield from self._build_list()
            yield
            self._detail = DetailCard(self._log, _SUMMARIES, self._select)
        yield
        self._last = LastPackets(self._log, _SUMMARIES)
        self._last_part = self._last.element
        self._last_part.visible = False
        self._tab.on_value_change(self._change_tab)

    def _build_actions(self) -> None:
        def guarded(handler: Callable[[], None]) -> Callable[..., Any]:
            return self._session.guarded(handler, lambda error: self._errors.show(error))

        self._record = ui.button(on_click=guarded(self._toggle_recording))
        self._record.props("flat dense no-caps data-testid=record")
        clear = ui.button(tr("Clear"), icon="delete_sweep", on_click=guarded(self._clear))
        clear.props("flat dense no-caps data-testid=clear")
        with ui.button(tr("Save"), icon="download").props("flat dense no-caps data-testid=save"), ui.menu():
            for kind, text in (("pcapng", tr("for Wireshark (pcapng)")), ("txt", tr("as text"))):
                item = ui.menu_item(text, on_click=lambda kind=kind: self._exports.start(kind))
                item.props(f"data-testid=save-{kind}")
        self._show_recording()

    def _build_list(self) -> Iterator[None]:
        self._filter = FilterBar(self._set_filter)
        yield
        with ui.element("div").classes("ok-row"):
            self._count = ui.label().classes("ok-dim ok-packet-facts").props("role=status data-testid=packet-count")
            ui.space()
            modes = {key: tr(text) for key, text in TIME_MODES.items()}
            time = ui.select(modes, value=self._mode, label=tr("Time"), on_change=self._set_mode)
            time.props("dense outlined options-dense data-testid=time-mode").classes("ok-packet-time")
            self._overwrite = ui.switch(tr("Overwrite"), on_change=self._renew).props("dense data-testid=overwrite")
            self._overwrite.tooltip(tr("Show only the last packet sent and the last one received"))
            self._follow_switch = ui.switch(tr("Follow"), value=True, on_change=self._switch_follow)
            self._follow_switch.props("dense data-testid=follow")
            self._follow_switch.tooltip(tr("Always show the newest packet"))
        self._list = PacketList(
            on_window=self._set_window, on_pick=self._select, on_move=self._move, on_follow=self._set_follow
        )

    # --- what the user does

    def _change_tab(self) -> None:
        self._list_part.visible = self._tab.value == "all"
        self._last_part.visible = self._tab.value == "last"

    def _toggle_recording(self) -> None:
        self._log.recording = not self._log.recording
        self._show_recording()

    def _show_recording(self) -> None:
        recording = self._log.recording
        text, icon = (tr("Pause recording"), "pause") if recording else (tr("Record"), "fiber_manual_record")
        if self._record.text != text:
            self._record.text = text
            self._record.props(f"icon={icon} color={'primary' if recording else 'negative'}")

    def _clear(self) -> None:
        self._log.clear()

    def _set_filter(self, condition: PacketFilter) -> None:
        self._renew(condition=condition)

    def _renew(self, *_: object, condition: PacketFilter | None = None) -> None:
        kind = LastPairs if self._overwrite.value else PacketView
        self._view = kind(self._log, condition or self._view.condition, self._summary)
        self._views += 1
        self._reveal += 1
        self._window = (self._view.first, self._window[1])
        self._show()

    def _set_mode(self, event: Any) -> None:
        self._mode = event.value
        self._show()

    def _set_window(self, start: int, size: int) -> None:
        self._window = (start, size)
        self._show()

    def _switch_follow(self) -> None:
        self._set_follow(bool(self._follow_switch.value))

    def _set_follow(self, follow: bool) -> None:
        if follow != self._follow:
            self._follow = self._follow_switch.value = follow
            self._show()

    def _move(self, step: int | str) -> None:
        view = self._view
        if not len(view):
            return
        last = view.end - 1
        current = view.position(self._selected)
        if isinstance(step, str):
            target = view.first if step == "first" else last
        else:
            target = last if current < 0 else current + step
        self._select(view.number(max(view.first, min(target, last))))

    def _select(self, number: int) -> None:
        packet = self._log.get(number)
        if packet is None:
            return
        self._selected = number
        self._reveal += 1
        self._follow = self._follow_switch.value = False
        self._detail.show(packet)
        self._show()

    # --- what the page shows

    async def refresh(self) -> None:
        """Examine further packets and show what has changed."""
        view, stop = self._view, perf_counter() + _SEARCH
        while view.advance() and view is self._view and perf_counter() < stop:  # noqa: ASYNC110 - divides work
            await asyncio.sleep(PAUSE)
        self._show_recording()
        if self._tab.value == "last":
            self._last.refresh()
            return
        open_ones = [each.name for each in self._session.workspace]
        self._filter.set_connections(list(dict.fromkeys([*open_ones, *self._log.connections])))
        self._detail.refresh()
        self._show()

    def _show(self) -> None:
        view, log = self._view, self._log
        self._show_count()
        first, end = view.first, view.end
        start, size = self._window
        start = max(end - size, first) if self._follow else min(max(start, first), max(end - 1, first))
        packets = view.window(start, size)
        position = view.position(self._selected)
        key = (self._views, first, end, start, size, self._follow, self._selected, self._reveal, self._mode, log.cleared,
               [each.number for each in packets])  # fmt: skip
        if key == self._shown:
            return
        self._shown = key
        before = view.window(start - 1, 1) if start > first else ()
        rows, previous = [], before[0] if before else None
        for each in packets:
            rows.append(row_of(each, previous, self._mode, log.start_ns, self._summary))
            previous = each
        self._list.show({
            "view": self._views, "first": first, "end": end, "start": start, "rows": rows, "follow": self._follow,
            "selected": self._selected, "position": position, "reveal": self._reveal,
        })  # fmt: skip

    def _show_count(self) -> None:
        view, total = self._view, len(self._log)
        text = tr("{count} of {total} packets", count=f"{len(view):,}", total=f"{total:,}")
        if view.behind:
            text += " · " + tr("searching: {percent} %", percent=100 * (total - view.behind) // max(total, 1))
        if self._count.text != text:
            self._count.text = text
