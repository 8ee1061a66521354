"""The contents of the page Raw packets."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.raw.assembler import AssemblerCard
from orinkit.tester.pages.raw.connection import ConnectionCard
from orinkit.tester.pages.raw.receive import ReceiveCard
from orinkit.tester.pages.raw.transmit import TransmitCard
from orinkit.tester.state.raw.link import RawLink
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.15  # s


def build(session: PageSession) -> None:
    """Build the contents."""
    ui.label(tr("Raw packets")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(
        tr(
            "Sends packets in hex exactly as they are typed. A packet may start a motion. If you close this page, give up "
            "the controls or press STOP, the raw connection is closed, so that the controller stops the motion."
        )
    ).classes("ok-page-hint")
    link = RawLink(session.workspace, lambda: _absent(session))
    connection = ConnectionCard(session, link)
    with ui.element("div").classes("ok-raw"):
        with ui.element("div").classes("ok-raw-column"):
            transmit = TransmitCard(session, link)
            AssemblerCard(session, connection, transmit)
        receive = ReceiveCard(link)
    connection.on_role(transmit.set_role)
    connection.on_role(receive.set_role)

    def refresh() -> None:
        connection.refresh()
        transmit.refresh()
        receive.refresh()

    connection.announce()
    refresh()
    ui.timer(_REFRESH, refresh)


def _absent(session: PageSession) -> str:
    """Return why the raw connection must be closed; ``""`` if it may remain open."""
    if not session.is_present or session.client.is_deleted:
        return tr("the page was closed, or the browser cannot be reached")
    return "" if session.in_control else tr("the controls were given up")
