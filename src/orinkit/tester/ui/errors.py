"""Errors beside the element that they concern: :class:`ErrorBox`."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, OrinError
from orinkit.core.i18n import tr


class ErrorBox:
    """A box for the latest error of a form or card; it takes no space while there is none.

    Screen readers announce each error (``role=alert``). For an error of the controller, the box shows the code, its name
    and the remedy. :meth:`show` has the form that ``PageSession.guarded`` requires.

    Args:
        marker: Value of ``data-testid``, by which tests find the box.
    """

    def __init__(self, marker: str = "error") -> None:
        self._box = ui.element("div").classes("ok-error").props("role=alert").props(f"data-testid={marker}")
        self._box.visible = False

    def show(self, error: Exception | None) -> None:
        """Show an exception; with ``None``, remove the previous one."""
        self._box.clear()
        self._box.visible = error is not None
        if error is None:
            return
        with self._box:
            ui.icon("error_outline")
            with ui.element("div"):
                if isinstance(error, CallError):
                    info = hresult.lookup(error.code)
                    ui.label(f"0x{error.code & 0xFFFFFFFF:08X} {info.name}").classes("ok-error-code")
                ui.label(error_text(error)).classes("ok-error-text")

    def show_text(self, text: str) -> None:
        """Show a message that is not an exception."""
        self.show(OrinError(text) if text else None)


def error_text(error: Exception) -> str:
    """Return the text of an exception for users."""
    return f"{error}" if isinstance(error, OrinError) else tr("{kind}: {error}", kind=type(error).__name__, error=error)


def problem_text(check: Callable[[str], object], text: str | None) -> str | None:
    """Return why an entry is not valid, for the argument ``validation`` of a field; ``None`` if it is valid.

    Args:
        check: Function that raises :class:`InvalidValue` if the entry is not valid.
        text: The entry.
    """
    try:
        check(text or "")
    except InvalidValue as error:
        return f"{error}"
    return None
