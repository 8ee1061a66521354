"""The last packet received with its explanation, the counters, and the latest packets of both directions."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.raw.options import Role
from orinkit.tester.state.packet_detail import detail_of
from orinkit.tester.state.packet_facts import summary
from orinkit.tester.state.packet_text import time_text
from orinkit.tester.state.raw.link import SHOWN_PACKETS, RawEntry, RawLink
from orinkit.tester.ui.packet_bytes import PacketBytes


class ReceiveCard:
    """The card.

    Args:
        link: The raw connection.
    """

    def __init__(self, link: RawLink) -> None:
        self._link = link
        self._shown = -1
        self._entry: RawEntry | None = None
        self._listed: dict[int, int] = {}
        with ui.element("section").classes("ok-card").props("data-testid=raw-receive"):
            with ui.element("div").classes("ok-row"):
                self._title = ui.label().classes("ok-card-title")
                ui.space()
                self._sent = _counter(tr("Sent"), "raw-sent")
                self._received = _counter(tr("Received"), "raw-received")
                clear = ui.button(icon="delete_sweep", on_click=link.clear).props(
                    "flat dense round data-testid=raw-clear"
                )
                clear.props(f'aria-label="{tr("Clear")}"').tooltip(tr("Clear"))
            self._summary = ui.label().classes("ok-mono ok-packet-summary").props("data-testid=raw-reply")
            self._facts = ui.label().classes("ok-dim ok-packet-facts")
            self._bytes = PacketBytes("raw-rx-bytes")
            ui.label(tr("Latest packets")).classes("ok-raw-subtitle")
            self._empty = ui.label(tr("No packets yet.")).classes("ok-dim")
            with ui.element("div").classes("ok-raw-latest").props("data-testid=raw-latest"):
                self._rows = [_Row() for _ in range(SHOWN_PACKETS)]

    def set_role(self, role: Role) -> None:
        """Show the direction of a role."""
        self._title.text = tr("RX (client → server)") if role.serves else tr("RX (server → client)")

    def refresh(self) -> None:
        """Show the current packets."""
        link = self._link
        if link.version == self._shown:
            return
        self._shown = link.version
        self._sent.text, self._received.text = f"{link.sent:,}", f"{link.received:,}"
        self._show_last(link.last_received)
        self._empty.visible = not link.latest
        latest = list(reversed(link.latest))
        for row, entry in zip(self._rows, latest + [None] * (SHOWN_PACKETS - len(latest)), strict=True):
            row.show(entry, link)

    def _show_last(self, entry: RawEntry | None) -> None:
        if entry is self._entry:
            return
        self._entry = entry
        if entry is None:
            self._summary.text = self._facts.text = ""
            self._bytes.show(None)
            return
        logged = entry.logged(self._link.scheme)
        self._summary.text = summary(logged)
        size = tr("{count} bytes", count=f"{len(logged.data):,}")
        self._facts.text = f"{time_text(logged.time_ns)} · {entry.packet.peer} · {size}"
        self._bytes.show(detail_of(logged))


class _Row:
    """A row of the latest packets."""

    def __init__(self) -> None:
        self._entry: RawEntry | None = None
        self._element = ui.element("div").classes("ok-raw-row")
        with self._element:
            self._time = ui.label()
            self._arrow = ui.label()
            self._peer = ui.label().classes("ok-raw-peer")
            self._text = ui.label().classes("ok-raw-summary")
        self._element.visible = False

    def show(self, entry: RawEntry | None, link: RawLink) -> None:
        if entry is self._entry:
            return
        self._entry = entry
        self._element.visible = entry is not None
        if entry is None:
            return
        logged = entry.logged(link.scheme)
        self._time.text = time_text(logged.time_ns)
        self._arrow.text = "→" if entry.is_sent else "←"
        self._arrow.classes(replace="ok-sent" if entry.is_sent else "ok-received")
        self._arrow.props(f'aria-label="{tr("sent") if entry.is_sent else tr("received")}"')
        self._peer.text = entry.packet.peer if link.serves else ""
        self._peer.visible = link.serves
        self._text.text = summary(logged)


def _counter(text: str, marker: str) -> ui.label:
    with ui.element("span").classes("ok-chip"):
        ui.label(text)
        return ui.label("0").classes("ok-value-small").props(f"data-testid={marker}")
