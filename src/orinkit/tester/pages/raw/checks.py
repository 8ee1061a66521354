"""The packets in the text with their explanation, and its problems with their places: :class:`CheckList`."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.packet_detail import detail_of
from orinkit.tester.state.raw.text import CheckedText, FoundPacket, FoundProblem, Place
from orinkit.tester.ui.packet_bytes import PacketBytes

_SELECT = """
(() => {{
  const area = getElement({id}).$el.querySelector('textarea');
  area.focus();
  area.setSelectionRange({start}, {end});
  const height = parseFloat(getComputedStyle(area).lineHeight) || 20;
  area.scrollTop = Math.max(0, ({line} - 3) * height);
}})()"""


class CheckList:
    """The list below a text area.

    Args:
        area: The text area; a click on an item selects its place there.
    """

    def __init__(self, area: ui.textarea) -> None:
        self._area = area
        self._found = CheckedText()
        self._chosen = 1
        with ui.element("div").classes("ok-raw-checks"):
            self._status = ui.label().classes("ok-raw-status").props("role=status data-testid=raw-status")
            self._problems = ui.element("div").classes("ok-raw-problems").props("role=alert data-testid=raw-problems")
            self._packets = ui.element("div").classes("ok-raw-packets").props("data-testid=raw-packets")
            self._explanation = ui.expansion(tr("Explanation")).props("dense data-testid=raw-explanation")
            with self._explanation:
                self._bytes = PacketBytes("raw-tx-bytes")

    def show(self, found: CheckedText, *, is_empty: bool) -> None:
        """Show what a text contains."""
        self._found = found
        self._status.text = "" if is_empty else _status(found)
        self._status.classes(replace=f"ok-raw-status {_class(found)}")
        self._problems.clear()
        with self._problems:
            for problem in found.problems if not is_empty else ():
                self._problem_row(problem)
        self._show_packets()

    def _show_packets(self) -> None:
        packets = self._found.packets
        if self._chosen not in [each.number for each in packets]:
            self._chosen = packets[0].number if packets else 1
        self._packets.clear()
        wrong = {each.number for each in self._found.problems}
        with self._packets:
            for each in packets:
                self._packet_row(each, is_wrong=each.number in wrong)
            if self._found.count > len(packets):
                ui.label(tr("and {count} more packets", count=self._found.count - len(packets))).classes("ok-dim")
        self._explanation.visible = bool(packets)
        chosen = [each for each in packets if each.number == self._chosen]
        self._bytes.show(detail_of(chosen[0].logged) if chosen else None)

    def _packet_row(self, packet: FoundPacket, *, is_wrong: bool) -> None:
        row = ui.button(on_click=lambda: self._choose(packet)).props("flat no-caps align=left dense")
        row.classes("ok-raw-packet").props(f"data-testid=raw-packet-{packet.number}")
        if packet.number == self._chosen:
            row.classes("ok-current").props("aria-current=true")
        with row:
            ui.icon("warning_amber" if is_wrong else "check_circle").classes(
                "ok-raw-wrong" if is_wrong else "ok-raw-right"
            )
            ui.label(f"{packet.number}").classes("ok-dim")
            ui.label(packet.summary).classes("ok-raw-summary")
            ui.label(tr("{count} bytes", count=f"{len(packet.logged.data):,}")).classes("ok-dim ok-nowrap")

    def _problem_row(self, problem: FoundProblem) -> None:
        with ui.button(on_click=lambda: self._select(problem.place)).props("flat no-caps align=left dense") as row:
            row.classes("ok-raw-problem")
            ui.label(
                tr("packet {number}, line {line}, column {column}", number=problem.number, line=problem.place.line,
                   column=problem.place.column)
            ).classes("ok-dim")  # fmt: skip
            ui.label(problem.text).classes("ok-raw-problem-text")

    def _choose(self, packet: FoundPacket) -> None:
        self._chosen = packet.number
        self._explanation.value = True
        self._show_packets()
        self._select(packet.place)

    def _select(self, place: Place) -> None:
        script = _SELECT.format(id=self._area.id, start=place.start, end=place.end, line=place.line)
        self._area.client.run_javascript(script)


def _status(found: CheckedText) -> str:
    if found.refusal:
        return found.refusal if not found.problems else tr("nothing can be sent before this is corrected")
    count = tr("1 packet") if found.count == 1 else tr("{count} packets", count=f"{found.count:,}")
    size = tr("{count} bytes", count=f"{found.size:,}")
    if found.malformed:
        return f"{count}, {size} · " + tr("malformed")
    return f"{count}, {size} · " + tr("valid")


def _class(found: CheckedText) -> str:
    if found.refusal:
        return "ok-bad"
    return "ok-warn" if found.malformed else "ok-good"
