"""Questions to the user: :func:`ask`, :func:`ask_text`."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.ui.session import PageSession


async def ask(session: PageSession, title: str, text: str, choices: Mapping[str, str], danger: str = "") -> str:
    """Ask the user to choose.

    Args:
        session: The page.
        title: Title of the dialog.
        text: The question.
        choices: Labels of the choices, by key.
        danger: Key of a choice that destroys something.

    Returns:
        The key; ``""`` if the user has cancelled.
    """
    with session.client, ui.dialog() as dialog, ui.element("div").classes("ok-card ok-dialog"):
        dialog.props("data-testid=dialog")
        ui.label(title).classes("ok-card-title")
        ui.label(text).style("overflow-wrap: anywhere")
        with ui.element("div").classes("ok-row ok-end"):
            ui.button(tr("Cancel"), on_click=lambda: dialog.submit("")).props("flat no-caps data-testid=cancel")
            for key, label in choices.items():
                button = ui.button(label, on_click=lambda _, key=key: dialog.submit(key))
                button.props(f"unelevated no-caps data-testid=choose-{key}")
                if key == danger:
                    button.props("color=negative")
    answer = await dialog
    dialog.delete()
    return answer or ""


async def ask_text(session: PageSession, title: str, label: str, value: str = "") -> str:
    """Ask the user for a text; return ``""`` if the user has cancelled."""
    with session.client, ui.dialog() as dialog, ui.element("div").classes("ok-card ok-dialog"):
        ui.label(title).classes("ok-card-title")
        form = ui.element("form")
        with form:
            field = ui.input(label, value=value).props("outlined dense autofocus maxlength=255 data-testid=dialog-text")
            with ui.element("div").classes("ok-row ok-end ok-gap"):
                ui.button(tr("Cancel"), on_click=lambda: dialog.submit("")).props("flat no-caps")
                ui.button(tr("OK")).props("unelevated no-caps type=submit data-testid=dialog-ok")
    form.on("submit.prevent", lambda: dialog.submit(field.value))
    answer = await dialog
    dialog.delete()
    return (answer or "").strip()
