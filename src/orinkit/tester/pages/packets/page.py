"""The contents of the page Packets: :class:`PacketsPage`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.packets.detail import DetailCard
from orinkit.tester.pages.packets.exports import PageExports
from orinkit.tester.pages.packets.filters import FilterBar
from orinkit.tester.pages.packets.last import LastPackets
from orinkit.tester.state.packet_facts import Summaries
from orinkit.tester.state.packet_filter import LastPairs, PacketFilter, PacketView
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.tester.state.packet_rows import row_of
from orinkit.tester.ui.entry_list import EntryList, RecordButtons
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.immediate import show_chosen_part
from orinkit.tester.ui.packet_list import ListTexts
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.25  # s
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
        self._list_part = ui.element("div").classes("ok-packet-parts").props("data-testid=all-packets")
        with self._list_part:
            with ui.element("section").classes("ok-card"):
                yield from self._build_list()
            yield
            self._detail = DetailCard(self._log, _SUMMARIES, self._select)
        yield
        self._last = LastPackets(self._log, _SUMMARIES)
        show_chosen_part(self._tab, {"all": self._list_part, "last": self._last.element})
        self._tab.on_value_change(self._show_newest)

    def _build_actions(self) -> None:
        self._record = RecordButtons(self._session, self._log, lambda error: self._errors.show(error))
        with ui.button(tr("Save"), icon="download").props("flat dense no-caps data-testid=save"), ui.menu():
            for kind, text in (("pcapng", tr("for Wireshark (pcapng)")), ("txt", tr("as text"))):
                item = ui.menu_item(text, on_click=lambda kind=kind: self._exports.start(kind))
                item.props(f"data-testid=save-{kind}")

    def _build_list(self) -> Iterator[None]:
        self._filter = FilterBar(self._set_filter)
        yield
        texts = ListTexts(
            tr("Packets"), tr("No packets. They appear here as soon as a connection sends or receives one."),
            (tr("No."), tr("Time"), tr("Connection"), "", tr("Bytes"), tr("Packet")), "packet",
        )  # fmt: skip
        self._list = EntryList(
            self._log, self._view, texts, self._row, self._select,
            lambda count, total: tr("{count} of {total} packets", count=count, total=total), self._build_overwrite,
        )  # fmt: skip

    def _build_overwrite(self) -> None:
        self._overwrite = ui.switch(tr("Overwrite"), on_change=self._renew).props("dense data-testid=overwrite")
        self._overwrite.tooltip(tr("Show only the last packet sent and the last one received"))

    def _row(self, packet: LoggedPacket, previous: LoggedPacket | None, mode: str) -> list[Any]:
        return row_of(packet, previous, mode, self._log.start_ns, self._summary)

    def _show_newest(self) -> None:
        if self._tab.value == "last":
            self._last.refresh()
        else:
            self._list.show()

    def _set_filter(self, condition: PacketFilter) -> None:
        self._renew(condition=condition)

    def _renew(self, *_: object, condition: PacketFilter | None = None) -> None:
        kind = LastPairs if self._overwrite.value else PacketView
        self._view = kind(self._log, condition or self._view.condition, self._summary)
        self._list.show_view(self._view)

    def _select(self, number: int) -> None:
        packet = self._log.get(number)
        if packet is not None:
            self._detail.show(packet)
            self._list.reveal(number)

    async def refresh(self) -> None:
        """Examine further packets and show what has changed."""
        self._record.refresh()
        if self._tab.value == "last":
            self._last.refresh()
            return
        open_ones = [each.name for each in self._session.workspace]
        self._filter.set_connections(list(dict.fromkeys([*open_ones, *self._log.connections])))
        self._detail.refresh()
        await self._list.refresh()
