"""The contents of the page Raw packets."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.raw.assembler import AssemblerCard
from orinkit.tester.pages.raw.connection import ConnectionCard
from orinkit.tester.pages.raw.receive import ReceiveCard
from orinkit.tester.pages.raw.transmit import TransmitCard
from orinkit.tester.state.raw.link import RawLink
from orinkit.tester.ui.reporting import while_connected
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
    user = _User(session)
    link = RawLink(session.workspace, user.absent)
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


class _User:
    """The user of the page, who may leave it or lose the controls."""

    def __init__(self, session: PageSession) -> None:
        self._session = session
        self._is_gone = False
        while_connected(session, self._enter, self._leave)

    def _enter(self) -> None:
        self._is_gone = False

    def _leave(self) -> None:
        self._is_gone = True

    def absent(self) -> str:
        """Return why the raw connection must be closed; ``""`` if it may remain open."""
        if self._is_gone or self._session.client.is_deleted:
            return tr("the page was closed, or the browser cannot be reached")
        return "" if self._session.in_control else tr("the controls were given up")
