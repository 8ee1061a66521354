"""The last packet sent and the last one received, of each connection: :class:`LastPackets`."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.packet_detail import detail_of
from orinkit.tester.state.packet_facts import Summaries
from orinkit.tester.state.packet_log import Direction, PacketLog
from orinkit.tester.state.packet_text import time_text
from orinkit.tester.ui.packet_bytes import PacketBytes


class LastPackets:
    """SendData and ReceiveData of each connection, with the explanation.

    Args:
        log: The log.
        summaries: The summaries of packets.

    Attributes:
        element: The element that contains all.
    """

    def __init__(self, log: PacketLog, summaries: Summaries) -> None:
        self._log, self._summaries = log, summaries
        self._names: list[str] | None = None
        self._cards: dict[tuple[str, Direction], _LastPacket] = {}
        self.element = ui.element("div").classes("ok-last").props("data-testid=last-packets")

    def refresh(self) -> None:
        """Show the current packets."""
        names = self._log.connections
        if names != self._names:
            self._names = list(names)
            self._rebuild(names)
        for (name, direction), card in self._cards.items():
            card.refresh(self._log, self._summaries, name, direction)

    def _rebuild(self, names: list[str]) -> None:
        self.element.clear()
        self._cards.clear()
        with self.element:
            if not names:
                ui.label(tr("No packets yet.")).classes("ok-empty")
            for name in names:
                card = ui.element("section").classes("ok-card")
                card.props["data-testid"] = f"last-{name}"  # not a string of props: users choose the name
                with card:
                    ui.label(name).classes("ok-card-title")
                    with ui.element("div").classes("ok-last-pair"):
                        self._cards[name, ">"] = _LastPacket(tr("Last sent (SendData)"), "last-sent")
                        self._cards[name, "<"] = _LastPacket(tr("Last received (ReceiveData)"), "last-received")


class _LastPacket:
    def __init__(self, title: str, marker: str) -> None:
        self._number = 0
        with ui.element("div").classes("ok-last-packet"):
            with ui.element("div").classes("ok-row"):
                ui.label(title).style("font-weight: 600")
                self._facts = ui.label().classes("ok-dim ok-packet-facts")
            self._summary = ui.label().classes("ok-mono ok-packet-summary")
            self._bytes = PacketBytes(marker)

    def refresh(self, log: PacketLog, summaries: Summaries, name: str, direction: Direction) -> None:
        packet = log.last(name, direction)
        if packet is None or packet.number == self._number:
            return
        self._number = packet.number
        count = tr("{count} bytes", count=f"{len(packet.data):,}")
        self._facts.text = f"#{packet.number} · {time_text(packet.time_ns)} · {count}"
        self._summary.text = summaries.of(packet)
        self._bytes.show(detail_of(packet))
