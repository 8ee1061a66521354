"""The plot of watched variables, and their export as CSV."""

from __future__ import annotations

import asyncio
from time import monotonic, time

from nicegui import ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.pages.monitor.watches import MAX_PLOTTED, Watches, csv_text
from orinkit.tester.ui.chart import Chart
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.immediate import StateButton
from orinkit.tester.ui.plots import time_layout, time_patch
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession

_PERIOD = 0.5  # s
_WINDOWS = (10, 30, 60, 300, 600)  # s


class PlotCard:
    """The card with the plot.

    Args:
        session: The page.
        watches: The watched variables of the page.
    """

    def __init__(self, session: PageSession, watches: Watches) -> None:
        self._watches = watches
        self._paused_at = 0.0
        self._drawn_at = 0.0
        self._labels: list[str] = []
        self._options: list[str] = []
        chosen = watches.chosen
        windows = {each: f"{each} s" if each < 60 else tr("{minutes} min", minutes=each // 60) for each in _WINDOWS}
        with ui.element("section").classes("ok-card").props("data-testid=plot-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("History")).classes("ok-card-title")
                ui.space()
                self._series = ui.select([], multiple=True, label=tr("Lines"), on_change=self._choose)
                self._series.props("outlined dense options-dense use-chips data-testid=plot-lines").classes("ok-lines")
                window = ui.select(windows, value=chosen.window, label=tr("Time span"))
                window.props("outlined dense options-dense data-testid=plot-window").classes("ok-window")
                window.on_value_change(lambda event: setattr(chosen, "window", event.value))
                StateButton(("pause", "play_arrow"), (tr("Pause"), tr("Continue")), "pause", self._set_paused)
                export = ui.button("CSV", icon="download").props("flat no-caps dense data-testid=csv")
                export.tooltip(tr("All watched numbers of the latest 10 minutes"))
            errors = ErrorBox("error-plot")
            self._hint = ui.label(tr("Choose the variables to plot with the chart button of the watch list.")).classes(
                "ok-dim"
            )
            self._chart = Chart(time_layout(session.dark)).classes("ok-plot").props("data-testid=plot role=img")
            self._chart.props["aria-label"] = tr("History of the chosen variables")
        export.on_click(reported(session, self._export, errors.show))

    def _choose(self) -> None:
        self._watches.chosen.plotted = list(self._series.value or [])[-MAX_PLOTTED:]

    def _set_paused(self, paused: bool) -> None:
        self._paused_at = time() if paused else 0.0

    async def _export(self) -> None:
        histories = self._watches.snapshot()
        if not histories:
            raise InvalidValue(tr("no watched variable has a number yet. Try: add variables to the watch list"))
        text = await asyncio.to_thread(csv_text, histories)
        ui.download.content(text.encode("utf-8-sig"), "orinkit-monitor.csv", "text/csv")

    def refresh(self) -> None:
        """Draw the current values, at most twice per second."""
        if monotonic() - self._drawn_at < _PERIOD:
            return
        self._drawn_at = monotonic()
        columns = {each.label: each for each in self._watches.columns()}
        plotted = [each for each in self._watches.chosen.plotted if each in columns]
        if (list(columns), plotted) != (self._options, self._labels):
            self._options, self._labels = list(columns), plotted
            self._series.set_options(self._options, value=plotted)
        self._hint.visible = not plotted
        end = self._paused_at or time()
        since = end - self._watches.chosen.window
        lines = [(label, columns[label].history, columns[label].index) for label in plotted]
        self._chart.change(time_patch(lines, since, end), ["series"])
