"""Show the ways to a connection if there is none to a motor driver: :func:`show_missing`."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.connection import Connection, ConnectionState
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_KEY = "abh3"


def show_missing(session: PageSession) -> None:
    """Explain what is missing, and offer the ways to a connection."""
    connection = session.connection
    chosen = connection if isinstance(connection, DriverConnection) else None
    with (
        ui.element("section").classes("ok-card"),
        ui.element("div").classes("ok-empty ok-abh3-empty").props("data-testid=no-driver"),
    ):
        ui.icon("electrical_services")
        ui.label(_text(connection, chosen)).props("role=status data-testid=no-driver-text")
        errors = ErrorBox("error-connect")
        if chosen is not None and chosen.error is not None:
            errors.show(chosen.error)
        with ui.element("div").classes("ok-row ok-abh3-choices"):
            if chosen is not None and chosen.state is not ConnectionState.CONNECTING:
                _connect_button(session, chosen, errors)
            if chosen is None:
                for each in session.workspace:
                    if isinstance(each, DriverConnection):
                        _choose_button(session, each)
            _start_button(session, errors, primary=chosen is None)
        ui.link(tr("Open the page Connections"), "/")


def _text(connection: Connection | None, chosen: DriverConnection | None) -> str:
    if chosen is not None and chosen.state is ConnectionState.LOST:
        return tr("The driver does not reply any more: the connection {name} is lost.", name=chosen.name)
    if chosen is not None and chosen.state is ConnectionState.CONNECTING:
        return tr("Connecting to {name} …", name=chosen.name)
    if chosen is not None:
        return tr("{name} is not connected.", name=chosen.name)
    if connection is not None:
        return tr("{name} is a robot controller. This page requires a motor driver.", name=connection.name)
    return tr("No connection yet. Start a virtual motor driver here, or connect to a real one on the page Connections.")


def _connect_button(session: PageSession, connection: DriverConnection, errors: ErrorBox) -> None:
    button = ui.button(tr("Connect again"), icon="link").props("unelevated no-caps data-testid=connect-again")
    button.on_click(session.guarded(connection.open, errors.show))


def _choose_button(session: PageSession, connection: DriverConnection) -> None:
    button = ui.button(tr("Use {name}", name=connection.name), icon="check")
    button.props("unelevated no-caps data-testid=use-driver").on_click(lambda: session.choose(connection))


def _start_button(session: PageSession, errors: ErrorBox, *, primary: bool) -> None:
    async def start() -> None:
        button.props("loading")
        try:
            session.choose(await session.workspace.start_simulator(_KEY))
        finally:
            if not button.is_deleted:
                button.props(remove="loading")

    button = ui.button(tr("Start a virtual ABH3 here"), icon="play_arrow")
    button.props(f"{'unelevated' if primary else 'outline'} no-caps data-testid=start-abh3-here")
    button.on_click(session.guarded(start, errors.show))
