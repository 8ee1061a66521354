"""The contents of the page Slave Move."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.slave_move.live import LiveCard
from orinkit.tester.pages.slave_move.preview import TrajectoryCard
from orinkit.tester.pages.slave_move.run import RunCard
from orinkit.tester.pages.slave_move.source import SourceCard
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.ui.reporting import show_no_controller
from orinkit.tester.ui.session import PageSession


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Slave Move")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(
        tr(
            "Sends a set-point in each cycle of the controller (slave mode). The trajectory is checked before anything "
            "moves. Stay on this page while the arm moves: if it is closed or hidden, the arm stops."
        )
    ).classes("ok-page-hint")
    connection = session.connection
    if not isinstance(connection, ControllerConnection) or not connection.is_open:
        _empty(session)
        return
    with ui.element("div").classes("ok-columns"):
        with ui.element("div").classes("ok-sm-stack"):
            source_place = ui.element("div").classes("ok-sm-stack")
            trajectory = TrajectoryCard(session, connection)
            yield
            live_place = ui.element("div").classes("ok-sm-stack")
        with ui.element("div").classes("ok-sm-stack ok-sm-side"):
            run = RunCard(session, connection, trajectory)
    yield
    with source_place:
        SourceCard(session, connection, trajectory)
    yield
    with live_place:
        LiveCard(session, connection)
    trajectory.on_options(run.limits_of_run)


def _empty(session: PageSession) -> None:
    """Build the page without a controller; it is built again when there is one."""

    def look() -> None:
        connection = session.connection
        if isinstance(connection, ControllerConnection) and connection.is_open:
            ui.navigate.reload()

    ui.timer(1.0, look)
    show_no_controller(session)
