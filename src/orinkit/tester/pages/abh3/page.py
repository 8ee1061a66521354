"""The contents of the page ABH3."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.abh3.drive_card import DriveCard
from orinkit.tester.pages.abh3.feedback_card import FeedbackCard, ValuesCard
from orinkit.tester.pages.abh3.flags_card import FlagsCard
from orinkit.tester.pages.abh3.frames import FramesCard
from orinkit.tester.pages.abh3.inputs_card import InputsCard
from orinkit.tester.pages.abh3.missing import show_missing
from orinkit.tester.pages.abh3.parameters import ParametersCard
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.immediate import show_chosen_part
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.1  # s
_SLOW_REFRESH = 0.5  # s


def build(session: PageSession) -> Iterator[None]:
    """Build the contents; build them again if the connection changes."""
    ui.label("ABH3").classes("ok-page-title").props("role=heading aria-level=1")
    view = _View(session)
    yield from view.parts()
    ui.timer(_SLOW_REFRESH, view.refresh)
    session.while_connected(view.resume, view.pause)
    session.client.on_delete(view.close)


class _View:
    """The contents for the chosen connection."""

    def __init__(self, session: PageSession) -> None:
        self._session = session
        self._holder = ui.element("div").classes("ok-abh3")
        self._shown: list[object] = []
        self._page: DriverPage | None = None

    async def refresh(self) -> None:
        """Build the contents again if the connection, or its state, has changed."""
        for _ in self.parts():
            await asyncio.sleep(0)

    def parts(self) -> Iterator[None]:
        """Build the contents in several parts, if the connection, or its state, has changed."""
        connection = self._session.connection
        others = [each.name for each in self._session.workspace if isinstance(each, DriverConnection)]
        state: list[object] = [connection, others]
        if isinstance(connection, DriverConnection):  # after a failed attempt, the buttons stay where they are
            state = [connection, connection.is_open, connection.state is ConnectionState.CONNECTING]
        if state == self._shown:
            return
        self._shown = state
        self.close()
        self._holder.clear()
        with self._holder:
            if isinstance(connection, DriverConnection) and connection.is_open:
                page = DriverPage(self._session, DriverCell.of(self._session.workspace, connection))
                yield from page.build()
                self._page = page
                if self._session.is_present:
                    page.resume()
            else:
                show_missing(self._session)

    def resume(self) -> None:
        """Begin to read the driver."""
        if self._page is not None:
            self._page.resume()

    def pause(self) -> None:
        """Stop reading the driver."""
        if self._page is not None:
            self._page.pause()

    def close(self) -> None:
        """Stop reading the driver, and the motion that this page has started."""
        page, self._page = self._page, None
        if page is not None:
            page.close()


class DriverPage:
    """The elements for one connection; they are updated while the browser is connected.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._session, self._cell, self._monitor = session, cell, cell.connection.monitor
        self._reading = False
        self._frames: FramesCard | None = None
        self._parameters: ParametersCard | None = None
        self._error_shown: Exception | None = None

    def build(self) -> Iterator[None]:
        """Build the elements in several parts."""
        self._build_head()
        self._errors = ErrorBox("error-driver")
        self._parts = {key: ui.element("div") for key in ("drive", "frames", "parameters")}
        yield
        with self._parts["drive"]:
            yield from self._build_drive()
        show_chosen_part(self._tab, self._parts)
        ui.timer(_REFRESH, self._refresh)

    def _build_head(self) -> None:
        tabs = {"drive": tr("Drive"), "frames": tr("CAN frames"), "parameters": tr("Parameters")}
        driver = self._cell.connection.driver
        with ui.element("div").classes("ok-row ok-packet-bar"):
            self._tab = ui.toggle(tabs, value="drive", on_change=self._build_tab)
            self._tab.props("no-caps unelevated dense data-testid=abh3-tabs")
            ui.space()
            ui.label(tr("driver {address}, group {group}", address=driver.address, group=driver.host.group)).classes(
                "ok-chip"
            )
            dialect = self._cell.connection.dialect
            ui.label(dialect.name).classes("ok-chip").tooltip(tr(dialect.title))
            self._faults = ui.label().classes("ok-chip").props("role=status data-testid=fault-chip")

    def _build_drive(self) -> Iterator[None]:
        session, cell = self._session, self._cell
        with ui.element("div").classes("ok-arm-grid"):
            with ui.element("div").classes("ok-arm-column"):
                self._plot = FeedbackCard(session, cell)
                yield
                self._values = ValuesCard(cell)
                yield
                self._flags = FlagsCard(session, cell)
                yield
            with ui.element("div").classes("ok-arm-column"):
                self._drive = DriveCard(session, cell)
                yield
                self._inputs = InputsCard(session, cell)

    def resume(self) -> None:
        """Begin to read the driver."""
        if not self._reading:
            self._reading = True
            self._monitor.begin()

    def pause(self) -> None:
        """Stop reading the driver."""
        if self._reading:
            self._reading = False
            self._monitor.end()

    def close(self) -> None:
        """Stop reading the driver, and the motion that this page has started."""
        self.pause()
        self._drive.close()

    def _build_tab(self) -> None:
        if self._tab.value == "frames" and self._frames is None:
            with self._parts["frames"]:
                self._frames = FramesCard(self._session, self._cell)
        if self._tab.value == "parameters" and self._parameters is None:
            with self._parts["parameters"]:
                self._parameters = ParametersCard(self._session, self._cell)

    async def _refresh(self) -> None:
        if not self._session.client.has_socket_connection:
            return
        self._show_faults()
        if self._tab.value == "frames" and self._frames is not None:
            await self._frames.refresh()
        elif self._tab.value == "parameters" and self._parameters is not None:
            self._parameters.refresh()
        elif self._tab.value == "drive":
            for part in (self._plot, self._values, self._flags, self._inputs):
                part.refresh()

    def _show_faults(self) -> None:
        if self._monitor.error is not self._error_shown:
            self._error_shown = self._monitor.error
            self._errors.show(self._error_shown)
        text, tone = _faults(self._cell)
        if self._faults.text != text:
            self._faults.text = text
            self._faults.classes(replace=f"ok-chip {tone}")


def _faults(cell: DriverCell) -> tuple[str, str]:
    """Return the text and the CSS class for the errors and warnings of the driver."""
    dialect, monitor = cell.connection.dialect, cell.connection.monitor
    errors, warnings = (monitor.flags("BR0", word) for word in (dialect.errors, dialect.warnings))
    if errors is None or warnings is None:
        return tr("state unknown"), ""
    if errors:
        return tr("error: {text}", text=", ".join(errors.texts[:2])), "ok-bad"
    if warnings:
        return tr("warning: {text}", text=", ".join(warnings.texts[:2])), "ok-warn"
    return tr("no errors"), "ok-good"
