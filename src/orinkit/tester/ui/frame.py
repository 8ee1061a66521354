"""The frame of every page: header with connection and stop button, navigation, preferences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from functools import cache
from html import escape
from importlib.resources import files
from typing import Protocol

from nicegui import Client, ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.ui.session import CONNECTION_COOKIE, DARK_COOKIE, LANGUAGE_COOKIE, PageSession, notify

_REFRESH = 0.5  # s
STATE_TEXTS = {
    ConnectionState.CLOSED: N_("not connected"),
    ConnectionState.CONNECTING: N_("connecting"),
    ConnectionState.OPEN: N_("connected"),
    ConnectionState.LOST: N_("connection lost"),
}


class PageRow(Protocol):
    """A row of the table of pages, as the navigation uses it."""

    @property
    def path(self) -> str:
        """Path of the page."""

    @property
    def title(self) -> str:
        """Title, in English."""

    @property
    def icon(self) -> str:
        """Name of the Material icon."""


@contextmanager
def frame(session: PageSession, current: PageRow, rows: Sequence[PageRow]) -> Iterator[None]:
    """Build the frame; the contents of the page are built inside the ``with`` block."""
    _set_dark(session.client, session.dark)
    ui.colors(primary="#0e7490", positive="#15803d", negative="#c81e1e", warning="#b45309", dark="#10161d")
    ui.add_css(_css(), shared=False)
    ui.page_title(f"{tr(current.title)} - orinkit")
    ui.add_body_html(_placeholder(session, tr(current.title)))
    drawer = ui.left_drawer(value=None, bordered=True).classes("ok-drawer").props("width=216 breakpoint=900")
    with ui.header().classes("ok-header"):
        ui.button(icon="menu", on_click=drawer.toggle).props(f'flat dense aria-label="{tr("Menu")}"').classes("ok-menu")
        ui.label("orinkit").classes("ok-logo")
        _connection_chooser(session)
        ui.space()
        _stop_button(session)
    with drawer:
        _navigation(current, rows)
        ui.space()
        _controls(session)
        _preferences(session)
    with ui.element("main").classes("ok-main"):
        yield


def _set_dark(client: Client, dark: bool) -> None:
    """Choose light or dark mode before the page is sent.

    The element ``ui.dark_mode`` sets the mode again at each change of the page, and then the browser computes the styles
    of all elements again.
    """
    client.page = copy(client.page)  # one object for all users
    client.page.dark = dark


def _placeholder(session: PageSession, title: str) -> str:
    """Return what the browser displays until it has loaded the scripts: header, navigation and title without contents."""
    return (
        f'<div class="ok-placeholder{" body--dark" if session.dark else ""}" aria-hidden="true"><div class="ok-bar">'
        f'<span class="ok-logo">orinkit</span></div><div class="ok-side"></div><div class="ok-title">{escape(title)}</div></div>'
    )


@cache
def _css() -> str:
    return (files("orinkit.tester") / "static" / "tester.css").read_text("utf-8")


def _navigation(current: PageRow, rows: Sequence[PageRow]) -> None:
    with ui.element("nav").props(f'aria-label="{tr("Pages")}"').classes("ok-nav"):
        for row in rows:
            link = ui.link(target=row.path).classes("ok-nav-link")
            if row is current:
                link.classes("ok-current").props("aria-current=page")
            with link:
                ui.icon(row.icon)
                ui.label(tr(row.title))


def _connection_chooser(session: PageSession) -> None:
    with ui.row().classes("ok-chooser"):
        lamp = ui.element("span").classes("ok-lamp")
        chooser = (
            ui.select({})
            .props(f'dense options-dense borderless aria-label="{tr("Connection")}"')
            .props("data-testid=chooser")
        )

    def choose() -> None:
        session.chosen = chooser.value or ""
        session.set_cookie(CONNECTION_COOKIE, session.chosen)
        ui.navigate.reload()

    shown: list[object] = []

    def refresh() -> None:
        connection = session.connection
        state = [(each.name, each.state) for each in session.workspace] + [connection]
        if state == shown:
            return
        shown[:] = state
        names = {each.name: each.name for each in session.workspace}
        chooser.set_options(names, value=connection.name if connection else None)
        chooser.visible = bool(names)
        lamp.classes(replace=f"ok-lamp ok-{connection.state.value if connection else 'closed'}")
        lamp.props(f'role=img aria-label="{tr(STATE_TEXTS[connection.state]) if connection else ""}"')

    refresh()
    chooser.on("update:model-value", choose)
    ui.timer(_REFRESH, refresh)


def _stop_button(session: PageSession) -> None:
    """Everybody may stop: the button does not require the controls."""

    async def stop() -> None:
        problems = await session.workspace.stop_all(tr("the stop button was pressed"))
        if problems:
            notify(tr("not everything could be stopped: {problems}", problems="; ".join(problems)), "negative")
        else:
            notify(tr("all motions are stopped"), "positive")

    button = (
        ui.button(tr("STOP"), icon="pan_tool", on_click=stop, color="negative")
        .classes("ok-stop")
        .props("data-testid=stop-all")
    )
    button.props(f'unelevated aria-label="{tr("Stop all motions")}" aria-keyshortcuts="Escape"')
    button.tooltip(tr("Stop all motions (Esc)"))
    ui.keyboard(on_key=lambda event: stop() if event.key.escape and event.action.keydown else None, ignore=[])


def _controls(session: PageSession) -> None:
    with ui.element("div").classes("ok-controls"):
        text = ui.label().props("data-testid=controls").props("role=status")
        button = ui.button().props("flat dense no-caps")

    def press() -> None:
        controls = session.workspace.controls
        if session.in_control:
            controls.give_up(session.user)
        elif not controls.holder:
            controls.take(session.user)
        refresh()

    def refresh() -> None:
        holder = session.workspace.controls.holder
        button.visible = session.in_control or not holder
        if session.in_control:
            text.text, button.text = tr("You hold the controls"), tr("Give up")
        elif holder:
            text.text = tr("Watching: another user holds the controls")
        else:
            text.text, button.text = tr("The controls are free"), tr("Take")

    button.on_click(press)
    refresh()
    ui.timer(_REFRESH, refresh)


def _preferences(session: PageSession) -> None:
    def set_language(language: str) -> None:
        session.set_cookie(LANGUAGE_COOKIE, language)
        ui.navigate.to(session.client.page.path)

    def toggle_dark() -> None:
        session.set_cookie(DARK_COOKIE, "0" if session.dark else "1")
        ui.navigate.to(session.client.page.path)

    other = "en" if session.language == "ja" else "ja"
    with ui.row().classes("ok-preferences"):
        ui.button(
            "English" if other == "en" else "日本語", icon="translate", on_click=lambda: set_language(other)
        ).props(f"flat dense no-caps lang={other}").props("data-testid=language")
        ui.button(icon="light_mode" if session.dark else "dark_mode", on_click=toggle_dark).props(
            f'flat dense round aria-label="{tr("Light or dark colours")}"'
        ).props("data-testid=dark")
