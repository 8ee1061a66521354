"""The measurements of a Slave Move: commands and actual values, errors, buffer, cycle times, result, recordings."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.slave_move import charts
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_move import SlaveMove
from orinkit.tester.ui.session import PageSession

_REFRESH: Final = 0.1  # s
_SLOW: Final = 10  # refreshes between two updates of the histogram


class LiveCard:
    """The cards of the measurements; they show the latest Slave Move of the connection."""

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self._session = session
        self._connection = connection
        self._shown: tuple[object, ...] = ()
        self._ticks = 0
        dark = session.dark
        self._place = ui.element("div").classes("ok-sm-stack").props("data-testid=slave-live")
        self._place.visible = False
        with self._place:
            with ui.element("section").classes("ok-card"):
                ui.label(tr("Command (dashed) and actual value")).classes("ok-card-title")
                self._values = charts.chart(
                    charts.base_options(dark, "deg"), tr("Command and actual value over time"), "live-chart"
                )
            with ui.element("div").classes("ok-grid"):
                with ui.element("section").classes("ok-card"):
                    ui.label(tr("Error: command minus actual value")).classes("ok-card-title")
                    self._errors = charts.chart(charts.base_options(dark, "deg"), tr("Error over time"), "error-chart")
                    self._largest = ui.label("").classes("ok-dim").props("data-testid=largest-error")
                with ui.element("section").classes("ok-card"):
                    ui.label(tr("Time between two set-points")).classes("ok-card-title")
                    self._histogram = charts.chart(
                        charts.histogram_options(dark), tr("Histogram of the cycle time"), "histogram"
                    )
                    self._timing = ui.label("").classes("ok-dim").props("data-testid=timing")
            self._build_results()
        ui.timer(_REFRESH, self._refresh)

    def _build_results(self) -> None:
        with ui.element("section").classes("ok-card"):
            ui.label(tr("Buffer and result")).classes("ok-card-title")
            self._buffer = ui.label("").classes("ok-dim").props("data-testid=buffer")
            self._result = ui.label("").classes("ok-sm-result").props("data-testid=result role=status")
            self._problem = ui.label("").classes("ok-dim").props("role=alert")
            with ui.element("div").classes("ok-row"):
                self._downloads = {
                    suffix: ui.button(
                        tr("Recording as {format}", format=suffix.upper()), icon="download",
                        on_click=lambda suffix=suffix: self._download(suffix),
                    )
                    .props("outline no-caps")
                    .props(f"data-testid=download-{suffix}")
                    for suffix in ("csv", "mcap")
                }  # fmt: skip
        for button in self._downloads.values():
            button.visible = False

    def _download(self, suffix: str) -> None:
        move = self._session.workspace.slave_moves.get(self._connection.name)
        if move is not None:
            for path in move.trace.recordings:
                if path.suffix == f".{suffix}" and path.exists():
                    ui.download.file(path, path.name)

    def _refresh(self) -> None:
        move = self._session.workspace.slave_moves.get(self._connection.name)
        if move is None or (move, move.trace.count, move.finished) == self._shown:
            return
        self._shown = (move, move.trace.count, move.finished)
        self._place.visible = move.trace.count > 0
        points = move.trace.whole() if move.finished else move.trace.recent()
        charts.show(self._values, {"series": charts.live_series(move.trace.kind, points)})
        charts.show(self._errors, {"series": charts.error_series(move.trace.kind, points)})
        self._ticks += 1
        if move.finished or self._ticks % _SLOW == 1:
            charts.show(self._histogram, charts.histogram_patch(move.trace.histogram()))
        self._show_texts(move)

    def _show_texts(self, move: SlaveMove) -> None:
        trace = move.trace
        names = charts.names_of(trace.kind, min(6, len(trace.command) or 6))
        errors = ", ".join(f"{name} {value:.3f}" for name, value in zip(names, trace.largest_error, strict=False))
        self._largest.text = tr("Largest: {errors}. The actual value lags behind the command.", errors=errors)
        self._timing.text = tr(
            "Late (more than 1.5 cycles): {late}; longest: {longest:.1f} ms",
            late=trace.late_gaps,
            longest=trace.longest_gap * 1000,
        )
        self._buffer.text = tr(
            "Waiting in the streaming process: {queued} set-points; buffer of the controller full: {full:.0%} of the time",
            queued=trace.queued,
            full=trace.buffer_full,
        )
        self._result.text = f"{move.result}" if move.result is not None else ""
        self._problem.text = f"{trace.problem}"
        for suffix, button in self._downloads.items():
            button.visible = move.finished and any(path.suffix == f".{suffix}" for path in trace.recordings)
