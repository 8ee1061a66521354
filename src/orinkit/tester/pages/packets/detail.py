"""The selected packet: :class:`DetailCard`."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_detail import detail_of
from orinkit.tester.state.packet_facts import Summaries
from orinkit.tester.state.packet_log import LoggedPacket, PacketLog
from orinkit.tester.state.packet_text import as_bytes_literal, as_c_array, as_call, as_hex, time_text
from orinkit.tester.ui.clipboard import copy_text
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.packet_bytes import PacketBytes


class DetailCard:
    """The selected packet: facts, buttons to copy it and to go to its request or reply, bytes and fields.

    Args:
        log: The log.
        summaries: The summaries of packets.
        select: Callback invoked with the number of a packet to select.
    """

    def __init__(self, log: PacketLog, summaries: Summaries, select: Callable[[int], None]) -> None:
        self._log, self._summaries, self._select = log, summaries, select
        self._packet: LoggedPacket | None = None
        self._partner = 0
        with ui.element("section").classes("ok-card").props("data-testid=packet-detail"):
            self._hint = ui.label(tr("Select a packet to see its bytes and their meaning.")).classes("ok-dim")
            self._body = ui.element("div").style("display: contents")
            with self._body:
                self._build()
        self._body.visible = False

    def _build(self) -> None:
        with ui.element("div").classes("ok-row"):
            self._title = ui.label().classes("ok-card-title").props("data-testid=packet-title")
            self._facts = ui.label().classes("ok-dim ok-packet-facts")
            ui.space()
            self._jump = ui.button(icon="sync_alt", on_click=lambda: self._select(self._partner))
            self._jump.props("flat dense no-caps data-testid=packet-partner")
        self._summary = ui.label().classes("ok-mono ok-packet-summary").props("data-testid=packet-summary")
        self._bytes = PacketBytes("packet-bytes")
        with ui.element("div").classes("ok-row"):
            ui.label(tr("Copy as")).classes("ok-dim")
            for marker, text, convert in (
                ("hex", tr("Hex"), as_hex),
                ("python", tr("Python bytes"), as_bytes_literal),
                ("call", tr("Python call"), self._call_text),
                ("c", tr("C array"), as_c_array),
            ):
                button = ui.button(text, icon="content_copy", on_click=lambda convert=convert: self._copy(convert))
                button.props(f"flat dense no-caps size=sm data-testid=copy-{marker}")
        self._errors = ErrorBox("error-copy")

    def show(self, packet: LoggedPacket) -> None:
        """Show a packet."""
        self._packet = packet
        self._body.visible, self._hint.visible = True, False
        self._errors.show(None)
        sent = packet.direction == ">"
        self._title.text = f"#{packet.number} {tr('sent') if sent else tr('received')}"
        self._facts.text = f"{packet.connection} · {packet.scheme} · {time_text(packet.time_ns)} · " + tr(
            "{count} bytes", count=f"{len(packet.data):,}"
        )
        self._summary.text = self._summaries.of(packet)
        self._bytes.show(detail_of(packet))
        self._partner = -1
        self.refresh()

    def refresh(self) -> None:
        """Show the link to the reply, if it has arrived meanwhile."""
        packet = self._packet
        if packet is None:
            return
        sent = packet.direction == ">"
        number = self._log.reply_number(packet.number) if sent else packet.request_number
        partner = self._log.get(number)
        if (number if partner else 0) == self._partner:
            return
        self._partner = number if partner else 0
        self._jump.visible = partner is not None
        if partner is not None:
            first, second = (packet, partner) if sent else (partner, packet)
            duration = f"{(second.time_ns - first.time_ns) / 1e6:.1f}"
            text = (
                tr("Reply #{number} after {duration} ms", number=number, duration=duration)
                if sent
                else tr("Request #{number}, {duration} ms before", number=number, duration=duration)
            )
            self._jump.text = text

    def _call_text(self, packet: LoggedPacket) -> str:
        if packet.direction == ">":
            return as_call(packet)
        request = self._log.get(packet.request_number)
        if request is None:
            raise InvalidValue(tr("the request of this reply is not in the list any more"))
        return as_call(request)

    async def _copy(self, convert: Callable[[LoggedPacket], str]) -> None:
        self._errors.show(None)
        if self._packet is None:
            return
        try:
            await copy_text(convert(self._packet))
        except OrinError as error:
            self._errors.show(error)
