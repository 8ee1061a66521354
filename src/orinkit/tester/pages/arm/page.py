"""The contents of the page Arm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.arm.controls import ArmControls
from orinkit.tester.pages.arm.jog import JogCard
from orinkit.tester.pages.arm.pendant import PendantCard
from orinkit.tester.pages.arm.poses import PosesCard
from orinkit.tester.pages.arm.readout import JointBars, PositionReadout, StatusChips
from orinkit.tester.pages.arm.view import ArmView
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.ui.reporting import show_no_controller
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.05  # s
_SLOW_REFRESH = 0.5  # s


def build(session: PageSession) -> Iterator[None]:
    """Build the contents; build them again if the connection changes."""
    ui.label(tr("Arm")).classes("ok-page-title").props("role=heading aria-level=1")
    holder = ui.element("div").classes("ok-arm")
    shown: list[object] = []
    pages: list[ArmPage] = []

    def parts() -> Iterator[None]:
        connection = session.connection
        state = [connection, connection.is_open if connection else False]
        if state == shown:
            return
        shown[:] = state
        holder.clear()
        for page in pages:
            page.close()
        pages.clear()
        with holder:
            if isinstance(connection, ControllerConnection) and connection.is_open:
                page = ArmPage(session, ArmCell.of(session.workspace, connection))
                yield from page.build()
                pages.append(page)
                if session.is_present:
                    page.poll()
            else:
                show_no_controller(session)

    async def refresh() -> None:
        for _ in parts():
            await asyncio.sleep(0)

    def enter() -> None:
        for page in pages:
            page.poll()

    def leave() -> None:
        for page in pages:
            page.pause()

    yield from parts()
    ui.timer(_SLOW_REFRESH, refresh)
    session.while_connected(enter, leave)


class ArmPage:
    """The elements for one connection; they are updated while the browser is connected.

    Args:
        session: The page.
        cell: The arm.
    """

    def __init__(self, session: PageSession, cell: ArmCell) -> None:
        self._session, self._monitor = session, cell.monitor
        self._detach: Callable[[], None] = lambda: None
        self._version = -1
        self._tick = 0
        self._cell = cell

    def build(self) -> Iterator[None]:
        """Build the elements in several parts."""
        session, cell = self._session, self._cell
        with ui.element("div").classes("ok-arm-grid"):
            with ui.element("div").classes("ok-arm-column"):
                self._view = ArmView(session, cell.monitor)
                with ui.element("div").classes("ok-arm-halves ok-fourth"):
                    self._bars = JointBars(cell.monitor)
                    self._position = PositionReadout(cell.monitor)
                yield
                if cell.pendant is not None:
                    PendantCard(session, cell.pendant)
                    yield
            with ui.element("div").classes("ok-arm-column"):
                with ui.element("section").classes("ok-card ok-second"):
                    self._chips = StatusChips(cell)
                    ArmControls(session, cell)
                yield
                self._jog = JogCard(session, cell)
                yield
                PosesCard(session, cell)
                yield
        self._update()
        ui.timer(_REFRESH, self._update)

    def poll(self) -> None:
        """Start polling for this page."""
        self.pause()
        self._detach = self._monitor.attach()

    def pause(self) -> None:
        """Stop polling for this page."""
        self._detach()

    def close(self) -> None:
        """Stop polling for this page, and the motion that it has started."""
        self.pause()
        self._jog.close()

    def _update(self) -> None:
        if not self._session.client.has_socket_connection or self._monitor.version == self._version:
            return
        self._version = self._monitor.version
        self._tick += 1
        self._view.update()
        if self._tick % 2:  # texts that change faster cannot be read
            self._bars.update()
            self._position.update()
            self._chips.update()
