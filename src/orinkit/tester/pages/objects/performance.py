"""The panel [Performance] of a variable: repeated access, with statistics."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.pages.objects.context import ObjectContext
from orinkit.tester.state.performance import BINS, Performance, PerformanceReport
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.fields import NumberField, read_fields
from orinkit.values.variant import VarType

_REFRESH = 0.3  # s


def build_performance(context: ObjectContext) -> None:
    """Build the panel; a measurement ends if its page is closed."""
    ui.label(tr("Reads the value again and again, until a limit is reached.")).classes("ok-dim")
    with ui.element("div").classes("ok-form"):
        calls = NumberField(tr("Calls"), "performance-calls", VarType.I4, "10000")
        seconds = NumberField(tr("Longest duration (s)"), "performance-seconds", VarType.R4, "5")
    errors = ErrorBox("performance-error")
    running: list[Performance] = []
    with ui.element("div").classes("ok-row"):
        start = ui.button(tr("Start"), icon="speed").props("unelevated no-caps data-testid=performance-start")
        stop = ui.button(tr("Stop"), icon="stop", on_click=lambda: _stop(running))
        stop.props("outline no-caps data-testid=performance-stop").disable()
    figures = _Figures()

    async def measure() -> None:
        values = await read_fields([calls, seconds])
        if values is None or running:
            return
        measurement = Performance(context.connection.objects, context.target, *values)
        running.append(measurement)
        start.disable()
        stop.enable()
        timer = ui.timer(_REFRESH, lambda: figures.show(measurement.report()))
        try:
            await measurement.run()
        finally:
            running.clear()
            timer.cancel()
            if not context.session.client.is_deleted:
                start.enable()
                stop.disable()
                figures.show(measurement.report())

    start.on_click(context.session.guarded(measure, errors.show))
    context.session.client.on_delete(lambda: _stop(running))


def _stop(running: list[Performance]) -> None:
    for each in running:
        each.stop()


class _Figures:
    """The statistics: a row of numbers and a histogram."""

    def __init__(self) -> None:
        self._numbers = ui.element("div").classes("ok-figures").props("role=status data-testid=performance-figures")
        self._shown: dict[str, ui.label] = {}
        self._bars: list[tuple[ui.element, ui.label]] = []
        with ui.element("div").classes("ok-histogram").props("data-testid=performance-histogram") as self._chart:
            for bound in (*BINS, None):
                self._bar(f"≤ {bound:g}" if bound is not None else f"> {BINS[-1]:g}")
        self._chart.visible = False

    def _bar(self, text: str) -> None:
        with ui.element("div").classes("ok-histogram-row"):
            ui.label(f"{text} ms").classes("ok-dim")
            with ui.element("div").classes("ok-histogram-track"):
                bar = ui.element("div").classes("ok-histogram-bar")
            self._bars.append((bar, ui.label().classes("ok-dim ok-mono")))

    def show(self, report: PerformanceReport) -> None:
        """Show a report."""
        texts = {
            tr("calls"): f"{report.calls}",
            tr("calls/s"): f"{report.rate:.0f}",
            tr("mean"): f"{report.mean:.2f} ms",
            **{f"{percent:g} %": f"{value:.2f} ms" for percent, value in report.percentiles.items()},
            tr("longest"): f"{report.largest:.2f} ms",
        }
        for name, text in texts.items():
            if name not in self._shown:
                with self._numbers, ui.element("div").classes("ok-figure"):
                    ui.label(name).classes("ok-dim")
                    self._shown[name] = ui.label().classes("ok-value")
            self._shown[name].text = text
        most = max(report.histogram) or 1
        for (bar, label), count in zip(self._bars, report.histogram, strict=True):
            bar.style(f"width: {100 * count / most:.1f}%")
            label.text = f"{count}" if count else ""
        self._chart.visible = report.calls > 0
