"""The flags that the driver reports, as lamps with text."""

from __future__ import annotations

from nicegui import ui

from orinkit.abh3.table.signals import Word
from orinkit.core.i18n import tr
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.ui.bits import BitLamps, BitText
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_TONES = {"errors": "bad", "warnings": "warn"}  # of words
_BIT_TONES = {"error": "bad", "error_code": "bad", "alarm": "warn", "alarm_code": "warn"}  # without the number


class FlagsCard:
    """The card with the lamps, and the button that resets errors.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._lamps: list[tuple[str, Word, BitLamps, ui.label]] = []
        self._monitor = cell.connection.monitor
        with ui.element("section").classes("ok-card ok-fifth").props("data-testid=flags"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Flags")).classes("ok-card-title")
                ui.space()
                reset = ui.button(tr("Reset errors"), icon="restart_alt")
                reset.props("outline dense no-caps data-testid=reset-errors").classes("ok-action")
            errors = ErrorBox("error-flags")
            with ui.element("div").classes("ok-flag-groups"):
                for frame, word in self._monitor.words:
                    self._build_word(frame, word)
        reset.on_click(session.guarded(cell.reset_errors, errors.show))
        self.refresh()

    def _build_word(self, frame: str, word: Word) -> None:
        title = tr(word.title)
        with ui.element("div").classes("ok-bit-group"):
            with ui.element("div").classes("ok-row"):
                ui.label(title).classes("ok-dim")
                ui.space()
                value = ui.label().classes("ok-value ok-value-small").props(f"data-testid=word-{word.name}")
            bits = [
                BitText(bit.number, bit.text, tone=_BIT_TONES.get(bit.name.rstrip("_0123456789"), ""))
                for bit in sorted(word.bits, key=lambda each: each.number)
            ]
            lamps = BitLamps(title, f"flag-{word.name}", bits, tone=_TONES.get(word.name, "good"))
        self._lamps.append((frame, word, lamps, value))

    def refresh(self) -> None:
        """Show the latest flags."""
        for frame, word, lamps, label in self._lamps:
            flags = self._monitor.flags(frame, word)
            lamps.show(None if flags is None else flags.value)
            text = "–" if flags is None else f"0x{flags.value:08X}"
            if label.text != text:
                label.text = text
