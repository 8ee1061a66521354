"""The contents of the page Connections."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.connections.form import ConnectionForm
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.simulators import KINDS
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.frame import STATE_TEXTS
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.5  # s
_ICONS = {"rc8": "precision_manufacturing", "ve026a": "school", "abh3": "electrical_services"}


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Connections")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(
        tr(
            "Connect to a controller, or start a virtual one on this computer. No hardware is required to try everything."
        )
    ).classes("ok-page-hint")
    with ui.element("div").classes("ok-grid ok-simulators"):
        for key in KINDS:
            _simulator_card(session, key)
    yield
    ui.element("div").style("height: 16px")
    with ui.element("div").classes("ok-columns ok-even"):
        with ui.element("section").classes("ok-card"):
            ui.label(tr("Open connections")).classes("ok-card-title")
            _connection_list(session)
        yield
        yield from ConnectionForm(session).build()


def _simulator_card(session: PageSession, key: str) -> None:
    kind = KINDS[key]
    with ui.element("section").classes("ok-card"):
        with ui.element("div").classes("ok-row"):
            ui.icon(_ICONS[key], size="26px", color="primary")
            ui.label(tr(kind.label)).classes("ok-card-title")
            ui.space()
            button = (
                ui.button(tr("Start"), icon="play_arrow")
                .props("unelevated no-caps")
                .props(f'data-testid="start-{key}"')
            )
        ui.label(tr(kind.hint)).classes("ok-dim")
        errors = ErrorBox(f"error-{key}")

    async def start() -> None:
        button.props("loading")
        try:
            connection = await session.workspace.start_simulator(key)
            session.choose(connection)
        finally:
            button.props(remove="loading")

    button.on_click(session.guarded(start, errors.show))


def _connection_list(session: PageSession) -> None:
    holder = ui.element("div").style("display: contents")
    errors = ErrorBox("error-list")
    shown: list[object] = []

    def refresh() -> None:
        state = [(each.name, each.version) for each in session.workspace] + [session.connection]
        if state == shown:
            return
        shown[:] = state
        holder.clear()
        with holder:
            connections = list(session.workspace)
            if not connections:
                with ui.element("div").classes("ok-empty"):
                    ui.icon("cable")
                    ui.label(tr("No connection yet. Start a virtual controller above, or fill in the form."))
            for each in connections:
                _row(session, each, errors)

    refresh()
    ui.timer(_REFRESH, refresh)


def _row(session: PageSession, connection: Connection, errors: ErrorBox) -> None:
    async def connect() -> None:
        await connection.open()
        session.choose(connection)

    async def remove() -> None:
        await session.workspace.remove(connection)

    row = ui.element("div").classes("ok-connection")
    row.props["data-testid"] = f"connection-{connection.name}"  # not a string of props: users choose the name
    with row:
        with ui.element("div").classes("ok-row ok-nowrap"):
            ui.element("span").classes(f"ok-lamp ok-{connection.state.value}").props("aria-hidden=true")
            with ui.element("div").classes("ok-row ok-grow ok-connection-name"):
                ui.label(connection.name)
                ui.label(tr(STATE_TEXTS[connection.state])).classes("ok-chip").props("data-testid=state")
            if connection.is_open:
                _action("link_off", tr("Disconnect"), session.guarded(connection.close, errors.show))
            else:
                _action("link", tr("Connect"), session.guarded(connect, errors.show))
            save = session.guarded(lambda: session.workspace.profiles.save(connection.spec), errors.show)
            _action("bookmark_add", tr("Save"), save)
            _action("delete_outline", tr("Remove"), session.guarded(remove, errors.show))
        ui.label(connection.spec.url).classes("ok-mono ok-dim").style("overflow-wrap: anywhere")
        if connection.error is not None:
            ErrorBox("connection-error").show(connection.error)


def _action(icon: str, text: str, handler: object) -> None:
    ui.button(icon=icon, on_click=handler).props(f'flat dense round aria-label="{text}"').tooltip(text)  # type: ignore[arg-type]  # a handler
