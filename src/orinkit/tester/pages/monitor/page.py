"""The contents of the page Monitor."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.monitor.log_cards import ErrorCard, EventCard
from orinkit.tester.pages.monitor.plot_card import PlotCard
from orinkit.tester.pages.monitor.watch_card import WatchCard
from orinkit.tester.pages.monitor.watches import Watches
from orinkit.tester.ui.reporting import chosen_controller
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.25  # s


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Monitor")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(tr("Live values of variables with their history, and the errors and messages of the controller.")).classes(
        "ok-page-hint"
    )
    connection = chosen_controller(session)
    if connection is None:
        return
    watches = Watches(connection.poller, connection.watch_lists.of(session.user))
    with ui.element("div").classes("ok-monitor"):
        values = WatchCard(session, connection, watches)
        yield
        plot = PlotCard(session, watches)
        yield
        with ui.element("div").classes("ok-grid"):
            errors = ErrorCard(session, connection)
            yield
            events = EventCard(session, connection)

    def enter() -> None:
        watches.resume()
        connection.log.begin()

    def leave() -> None:
        watches.pause()
        connection.log.end()

    session.while_connected(enter, leave)

    def refresh() -> None:
        values.refresh()
        plot.refresh()
        errors.refresh()
        events.refresh()

    ui.timer(_REFRESH, refresh)
