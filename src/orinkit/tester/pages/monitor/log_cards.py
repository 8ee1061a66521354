"""The errors and events of the controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core import hresult
from orinkit.core.errors import OrinError
from orinkit.core.i18n import cut, tr, visible
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.controller_log import LogEntry
from orinkit.tester.ui.errors import ErrorBox, error_text
from orinkit.tester.ui.session import PageSession, notify

_SHOWN = 200  # rows
_SHOWN_CURRENT = 5
_LONGEST = 500  # characters
_SEVERITY_SLOT = (
    """<q-td :props="props"><span :class="'ok-chip ok-' + props.row.tone">{{ props.value }}</span></q-td>"""
)
_TEXT_SLOT = """<q-td :props="props">{{ props.value }}<div class="ok-log-note">{{ props.row.note }}</div></q-td>"""


class _LogTable:
    """A table of log entries with a filter.

    Args:
        marker: Value of ``data-testid``.
        source: Function that returns the entries, newest first.
        empty: Text that is displayed without entries.
        connection: The connection, for the details of an entry.
    """

    def __init__(
        self, marker: str, source: Callable[[], Iterable[LogEntry]], empty: str, connection: ControllerConnection
    ) -> None:
        self._source, self._empty, self._connection = source, empty, connection
        self._shown: list[LogEntry] = []
        self._state: object = None
        with ui.element("div").classes("ok-row"):
            self._words = (
                ui.input(placeholder=tr("Filter")).props("outlined dense clearable maxlength=200").classes("ok-grow")
            )
            self._words.props(f"data-testid={marker}-filter").props["aria-label"] = tr("Filter")
            severities = {0: tr("All"), 1: tr("Errors"), 3: tr("Level 3 or higher")}
            self._least = ui.select(severities, value=0).props("outlined dense options-dense").classes("ok-window")
            self._least.props(f"data-testid={marker}-severity").props["aria-label"] = tr("Severity")
        columns = (
            ("severity", tr("Severity")), ("time", tr("Time")), ("code", tr("Code")), ("text", tr("Text")),
        )  # fmt: skip
        self._table = ui.table(
            columns=[{"name": name, "label": label, "field": name, "align": "left"} for name, label in columns],
            rows=[], row_key="key",
        )  # fmt: skip
        self._table.props(f"dense flat wrap-cells hide-bottom virtual-scroll data-testid={marker}").classes("ok-log")
        self._table.props(":rows-per-page-options=[0]")
        self._table.add_slot("body-cell-severity", _SEVERITY_SLOT)
        self._table.add_slot("body-cell-text", _TEXT_SLOT)
        self._table.on("row-click", self._open, [[], ["key"], []])
        self._none = ui.label().classes("ok-dim").props(f"data-testid={marker}-empty")

    def refresh(self, version: int) -> None:
        """Display the entries if they, or the filter, have changed."""
        words, least = self._words.value or "", self._least.value or 0
        if (version, words, least) == self._state:
            return
        self._state = version, words, least
        self._shown = [each for each in self._source() if each.matches(words, least)][:_SHOWN]
        self._table.rows = [_row(key, entry) for key, entry in enumerate(self._shown)]
        self._none.text = tr("No entry matches the filter.") if words or least else self._empty
        self._none.visible = not self._shown

    async def _open(self, event: GenericEventArguments) -> None:
        key = event.args[1]["key"]
        if 0 <= key < len(self._shown):
            await _show_details(self._shown[key], self._connection)


def _row(key: int, entry: LogEntry) -> dict[str, Any]:
    return {
        "key": key,
        "severity": _severity_text(entry.severity),
        "tone": "bad" if entry.severity >= 3 else "warn" if entry.severity else "info",
        "time": entry.time.isoformat(" ", "milliseconds")[5:23] if entry.time else "",
        "code": f"{entry.code:08X}" if entry.name else f"{entry.code}",
        "text": _safe(entry.text),
        "note": " · ".join(filter(None, (entry.name, _safe(entry.place)))),
    }


def _severity_text(severity: int) -> str:
    return tr("Level {level}", level=severity) if severity else tr("Info")


def _safe(text: str) -> str:
    return visible(cut(text, _LONGEST))


async def _show_details(entry: LogEntry, connection: ControllerConnection) -> None:
    """Show an entry with the remedy, and with the controller's own text."""
    info = hresult.lookup(entry.code) if entry.name else None
    with ui.dialog() as dialog, ui.element("div").classes("ok-card ok-dialog").props("data-testid=log-details"):
        ui.label(
            f"0x{entry.code:08X} {entry.name}" if entry.name else tr("Message {number}", number=entry.code)
        ).classes("ok-card-title ok-mono")
        with ui.element("div").classes("ok-row"):
            ui.label(_severity_text(entry.severity)).classes("ok-chip")
            if entry.time:
                ui.label(f"{entry.time:%Y-%m-%d %H:%M:%S}").classes("ok-dim")
            if entry.place:
                ui.label(_safe(entry.place)).classes("ok-dim ok-mono")
        ui.label(_safe(entry.text))
        own = None
        if info is not None:
            if info.hint:
                ui.label(tr("Remedy")).classes("ok-dim")
                ui.label(info.hint).props("data-testid=remedy")
            ui.label(tr("Description by the controller")).classes("ok-dim")
            own = ui.label("…").props("data-testid=description")
        ui.button(tr("Close"), on_click=dialog.close).props("flat no-caps")
    dialog.on("hide", dialog.delete)
    dialog.open()
    if own is not None:
        try:
            text = await (await connection.monitor()).error_description(entry.code)
        except (OrinError, OSError) as error:
            text = error_text(error)
        if not own.is_deleted:
            own.text = _safe(text)


class ErrorCard:
    """The card with the current errors and the error log."""

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self._connection = connection
        self._version = -1
        with ui.element("section").classes("ok-card").props("data-testid=error-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Errors")).classes("ok-card-title")
                self._count = ui.label().classes("ok-chip").props("role=status data-testid=error-count")
                ui.space()
                clear = ui.button(tr("Clear errors"), icon="task_alt").props(
                    "flat no-caps dense data-testid=clear-errors"
                )
            errors = ErrorBox("error-errors")
            self._current = ui.element("div").classes("ok-current-errors").props("data-testid=current-errors")
            self._problem = ErrorBox("error-log-problem")
            self._table = _LogTable(
                "error-log", lambda: connection.log.logged, tr("The error log is empty."), connection
            )

        async def clear_errors() -> None:
            await connection.controller.clear_error()
            connection.log.refresh()
            notify(tr("The errors are cleared"), "positive")

        clear.on_click(session.guarded(clear_errors, errors.show))

    def refresh(self) -> None:
        """Display the errors if they have changed."""
        log = self._connection.log
        self._table.refresh(log.version)
        if log.version == self._version:
            return
        self._version = log.version
        self._problem.show(log.problems.get("current") or log.problems.get("logged"))
        count = len(log.current)
        unknown = "current" in log.problems
        self._count.text = (
            tr("unknown") if unknown else tr("{count} present", count=count) if count else tr("none present")
        )
        self._count.classes(replace=f"ok-chip {'' if unknown else 'ok-bad' if count else 'ok-good'}")
        self._current.clear()
        with self._current:
            for each in () if unknown else log.current[:_SHOWN_CURRENT]:
                info = hresult.lookup(each.code)
                with ui.element("div").classes("ok-error"), ui.element("div"):
                    ui.label(f"0x{each.code:08X} {info.name}").classes("ok-error-code")
                    place = f"{each.program}:{each.line} " if each.program else ""
                    ui.label(_safe(f"{place}{each.message or info.text}"))
                    if info.hint:
                        ui.label(tr("Try: {remedy}", remedy=info.hint)).classes("ok-remedy")


class EventCard:
    """The card with the events that the controller has reported (Controller_GetMessage)."""

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self._log = connection.log
        self._version = -1
        self._session = session
        with ui.element("section").classes("ok-card").props("data-testid=event-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Messages")).classes("ok-card-title")
                ui.space()
                clear = ui.button(tr("Clear list"), icon="clear_all").props("flat no-caps dense")
            if not self._log.fetches_events:
                ui.label(tr("This connection does not fetch messages (Message=False).")).classes("ok-dim").props(
                    "data-testid=no-events"
                )
            self._problem = ErrorBox("event-problem")
            self._table = _LogTable(
                "event-log", lambda: self._log.events, tr("No message has been received."), connection
            )
        clear.on_click(session.guarded(self._log.clear_events, self._problem.show))

    def refresh(self) -> None:
        """Display the events if they have changed."""
        self._table.refresh(self._log.version)
        if self._log.version != self._version:
            self._version = self._log.version
            self._problem.show(self._log.problems.get("events"))
