"""The result of a call: value, type, time taken and return code."""

from __future__ import annotations

from nicegui import ui

from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.tester.state.objects import Outcome
from orinkit.tester.state.value_text import describe, value_text
from orinkit.tester.ui.errors import ErrorBox


class ResultBox:
    """Shows the result of the latest call, or its error.

    Args:
        marker: Beginning of the values of ``data-testid``.
    """

    def __init__(self, marker: str = "result") -> None:
        self._holder = ui.element("div").classes("ok-results")
        with self._holder:
            self._build(marker)

    def to_end(self) -> None:
        """Move the result below the elements that were built after it."""
        self._holder.move(target_index=-1)

    def _build(self, marker: str) -> None:
        self._errors = ErrorBox(f"{marker}-error")
        self._box = ui.element("div").classes("ok-result").props("role=status").props(f"data-testid={marker}")
        with self._box:
            with ui.element("div").classes("ok-row"):
                self._code = ui.label().classes("ok-chip ok-mono").props(f"data-testid={marker}-code")
                self._type = ui.label().classes("ok-chip").props(f"data-testid={marker}-type")
                self._time = ui.label().classes("ok-chip").props(f"data-testid={marker}-time")
                ui.space()
                self._copy = ui.button(icon="content_copy", on_click=self._to_clipboard).props("flat dense round")
                self._copy.props(f'aria-label="{tr("Copy the value")}"').tooltip(tr("Copy the value"))
            self._value = ui.label().classes("ok-value ok-result-value").props(f"data-testid={marker}-value")
        self._waiting = ui.element("div").classes("ok-row ok-dim").props("role=status")
        with self._waiting:
            ui.spinner(size="18px")
            ui.label(tr("The call is in progress. STOP stops the arm."))
        self._box.visible = self._waiting.visible = False

    def begin(self) -> None:
        """Show that a call is in progress."""
        self._errors.show(None)
        self._box.visible, self._waiting.visible = False, True

    def show(self, outcome: Outcome) -> None:
        """Show a result."""
        self._waiting.visible = False
        self._code.text = f"0x{outcome.code & 0xFFFFFFFF:08X} {hresult.lookup(outcome.code).name}"
        self._time.text = f"{outcome.seconds * 1000:.2f} ms"
        self._type.visible = self._copy.visible = outcome.value is not None
        if outcome.value is None:
            self._value.text = tr("no result")
        elif outcome.created is not None:
            self._type.text = describe(outcome.value)
            self._value.text = tr("handle {handle}", handle=outcome.created.handle)
        else:
            self._type.text, self._value.text = describe(outcome.value), value_text(outcome.value)
        self._box.visible = True

    def fail(self, error: Exception | None) -> None:
        """Show an exception; with ``None``, remove the previous one."""
        self._waiting.visible = False
        if error is not None:
            self._box.visible = False
        self._errors.show(error)

    def _to_clipboard(self) -> None:
        ui.clipboard.write(self._value.text)
