"""The field for the whole connection string (RC8 table 5-1), with the strings that were used before."""

from __future__ import annotations

import logging
from collections.abc import Callable

from nicegui import ui

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_text import LONGEST_STRING, StringHistory
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession

logger = logging.getLogger("orinkit.tester")


class StringField:
    """The field.

    Args:
        session: The page.
        entered: Callback invoked with a string that the user has entered or chosen. It raises InvalidAddress or
            InvalidValue if the string is not valid.
        problem: Function that displays an exception, or with ``None`` removes it.
    """

    def __init__(
        self, session: PageSession, entered: Callable[[str], None], problem: Callable[[Exception | None], None]
    ) -> None:
        self._session, self._entered, self._problem = session, entered, problem
        self._history: StringHistory = session.workspace.strings
        self._error: InvalidAddress | InvalidValue | None = None
        self._showing = False
        self.input = ui.textarea(tr("Connection string"), placeholder="Server=192.168.0.1, UDP=False, Timeout=500")
        self.input.without_auto_validation()  # which would remove the errors that _changed displays
        # one character more than allowed, so that a pasted text that is too long is detected
        self.input.props(f"outlined dense autogrow debounce=250 maxlength={LONGEST_STRING + 1} rows=1 spellcheck=false")
        self.input.props("data-testid=string autocomplete=off").classes("ok-mono ok-string")
        with self.input.add_slot("append"):
            self._button = ui.button(icon="history").props("flat dense round data-testid=string-history")
            self._button.props["aria-label"] = tr("Earlier connection strings")
            with self._button:
                ui.tooltip(tr("Earlier connection strings"))
                self._menu = ui.menu().props("auto-close").classes("ok-strings")
        self.input.on_value_change(self._changed)
        self.offer()

    def show(self, text: str) -> None:
        """Display the string of the other fields."""
        self._error = None
        self._showing = True
        try:
            self.input.value = text
        finally:
            self._showing = False
        self.input.error = None

    def check(self) -> None:
        """Raise the error of the entered string, if there is one.

        Raises:
            InvalidAddress, InvalidValue: If the string is not valid.
        """
        if self._error is not None:
            raise self._error

    def remember(self, text: str) -> None:
        """Offer a string again later; if its file cannot be written, this is reported in the log."""
        try:
            self._history.add(text)
        except OSError as error:
            logger.warning("cannot save the connection string: %s", error)
        self.offer()

    def offer(self) -> None:
        """Update the list of earlier strings."""
        strings = list(self._history)
        self._button.visible = bool(strings)
        self._menu.clear()
        with self._menu:
            for number, text in enumerate(strings):
                item = ui.menu_item(text, on_click=lambda text=text: self._choose(text))
                item.props(f"data-testid=string-{number}").classes("ok-mono")
            ui.separator()
            forget = ui.menu_item(tr("Clear the list"), on_click=reported(self._session, self._forget, self._problem))
            forget.props("data-testid=string-clear")

    def _forget(self) -> None:
        self._history.clear()
        self.offer()

    def _choose(self, text: str) -> None:
        if text == self.input.value:
            self._changed()
        self.input.value = text

    def _changed(self) -> None:
        if self._showing:
            return
        self._error = None
        text = (self.input.value or "").strip()
        try:
            if text:
                self._entered(text)
        except (InvalidAddress, InvalidValue) as error:
            self._error = error
        self.input.error = f"{self._error}" if self._error else None
