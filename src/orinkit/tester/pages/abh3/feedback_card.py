"""The numbers that the driver reports, and their history."""

from __future__ import annotations

from time import monotonic, time

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.abh3.set_point import unit_text
from orinkit.tester.state.driver_monitor import ReportedValue
from orinkit.tester.ui.chart import Chart
from orinkit.tester.ui.plots import time_layout, time_patch
from orinkit.tester.ui.session import PageSession

_DRAWN = 0.25  # s between two drawings
_SHOWN = 0.15  # s between two changes of the texts
_WINDOWS = (10, 30, 60, 300, 600)  # s
_PLOTTED = "BR2"  # velocities
_UNKNOWN = "–"


class FeedbackCard:
    """The plot of the values of one frame.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._monitor = cell.connection.monitor
        self._layouts = cell.connection.dialect.layouts
        self._paused_at = 0.0
        self._drawn_at = 0.0
        self._key: object = None
        names = dict.fromkeys(each.frame for each in self._monitor.values)
        windows = {each: f"{each} s" if each < 60 else tr("{minutes} min", minutes=each // 60) for each in _WINDOWS}
        with ui.element("section").classes("ok-card ok-second").props("data-testid=feedback-plot"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("History")).classes("ok-card-title")
                ui.space()
                self._frame = ui.select({name: self._title(name) for name in names}, value=_PLOTTED, label=tr("Values"))
                self._frame.props("outlined dense options-dense data-testid=plot-frame").classes("ok-plot-frame")
                self._window = ui.select(windows, value=30, label=tr("Time span"))
                self._window.props("outlined dense options-dense data-testid=plot-window").classes("ok-window")
                self._pause = ui.button(icon="pause", on_click=self._toggle_pause)
                self._pause.props("flat dense round data-testid=plot-pause")
            self._chart = Chart(time_layout(session.dark)).classes("ok-plot")
            self._chart.props("role=img data-testid=plot").props["aria-label"] = tr("History of the feedback")
        self._show_pause()

    def _title(self, name: str) -> str:
        numbers = [each for each in self._monitor.values if each.frame == name]
        units = ", ".join(dict.fromkeys(unit_text(each.unit) for each in numbers if each.unit))
        title = tr(self._layouts[name].title)
        return f"{title} [{units}]" if units else title

    def _toggle_pause(self) -> None:
        self._paused_at = 0.0 if self._paused_at else time()
        self._show_pause()

    def _show_pause(self) -> None:
        self._pause.props["icon"] = "play_arrow" if self._paused_at else "pause"
        self._pause.props["aria-label"] = tr("Continue") if self._paused_at else tr("Pause")
        self._pause.update()

    def refresh(self) -> None:
        """Draw the current values, at most four times per second."""
        if monotonic() - self._drawn_at < _DRAWN:
            return
        self._drawn_at = monotonic()
        name, window = str(self._frame.value or _PLOTTED), float(self._window.value or 30)
        key = name, window, self._paused_at
        if self._paused_at and key == self._key:
            return
        self._key = key
        history = self._monitor.histories[name]
        values = [each for each in self._monitor.values if each.frame == name] if len(history) else []
        lines = [(tr(each.field.title), history, each.column) for each in values]
        end = self._paused_at or time()
        commands = [tr(each.field.title) for each in values if each.field.name.endswith("_command")]
        patch = time_patch(lines, end - window, end, commands)
        self._chart.change(patch, ["series"])


class ValuesCard:
    """The numbers as text.

    Args:
        cell: The driver.
    """

    def __init__(self, cell: DriverCell) -> None:
        self._monitor = cell.connection.monitor
        self._labels: list[tuple[ReportedValue, ui.label]] = []
        self._version = -1
        self._shown_at = 0.0
        with ui.element("section").classes("ok-card ok-fourth").props("data-testid=values"):
            ui.label(tr("Feedback")).classes("ok-card-title")
            with ui.element("div").classes("ok-figures ok-drive-values"):
                for value in self._monitor.values:
                    self._build_value(value)
        self.refresh()

    def _build_value(self, value: ReportedValue) -> None:
        with ui.element("div").classes("ok-drive-value"):
            ui.label(tr(value.field.title)).classes("ok-dim")
            with ui.element("div"):
                label = ui.label(_UNKNOWN).classes("ok-value")
                label.props(f"data-testid=value-{value.frame}-{value.field.name}")
                ui.label(unit_text(value.unit)).classes("ok-unit")
        self._labels.append((value, label))

    def refresh(self) -> None:
        """Show the latest numbers, but not more often than they can be read."""
        if monotonic() - self._shown_at < _SHOWN or self._monitor.version == self._version:
            return
        self._shown_at, self._version = monotonic(), self._monitor.version
        for value, label in self._labels:
            text = _text(self._monitor.number(value), value.digits)
            if label.text != text:
                label.text = text


def _text(number: float | None, digits: int | None) -> str:
    if number is None:
        return _UNKNOWN
    return f"{number:.6g}" if digits is None else f"{number:.{digits}f}"
