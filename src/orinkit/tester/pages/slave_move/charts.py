"""The plots of the page Slave Move: options and data of ECharts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.tester.state.slave_trace import TracePoint
from orinkit.tester.ui.chart import Chart
from orinkit.values.pose_numbers import FIELDS

COLOURS: Final = ("#0891b2", "#d97706", "#16a34a", "#dc2626", "#7c3aed", "#db2777", "#64748b", "#a16207")
_PLOTTED: Final = 600
_ROUNDED: Final = 4


def names_of(kind: str, count: int) -> list[str]:
    """Return the names of the plotted values of a pose type: without figure, and without vectors of orientation."""
    names = [name.upper() for name in FIELDS["J" if kind == "J" else "P"]]
    return names[: {"J": count, "P": 6, "T": 3}[kind]]


def base_options(dark: bool, y_name: str, x_name: str = "s") -> dict[str, Any]:
    """Return the options that all plots share."""
    text, line = ("#94a3b3", "#28323d") if dark else ("#5b6875", "#dfe4ea")
    axis = {
        "nameTextStyle": {"color": text}, "axisLabel": {"color": text}, "axisLine": {"lineStyle": {"color": line}},
        "splitLine": {"lineStyle": {"color": line}},
    }  # fmt: skip
    return {
        "animation": False,
        "backgroundColor": "transparent",
        "color": list(COLOURS),
        "grid": {"left": 48, "right": 26, "top": 34, "bottom": 28},
        "legend": {
            "top": 0,
            "right": 20,
            "left": 70,
            "textStyle": {"color": text},
            "icon": "roundRect",
            "itemHeight": 4,
            "itemWidth": 14,
        },
        "tooltip": {"trigger": "axis", "confine": True},
        "xAxis": {"type": "value", "name": x_name, "scale": True, **axis},
        "yAxis": {"type": "value", "name": y_name, "scale": True, **axis},
        "series": [],
    }


def line_series(
    name: str, colour: str, points: Sequence[tuple[float, float]], *, dashed: bool = False
) -> dict[str, Any]:
    """Return a curve."""
    return {
        "type": "line",
        "name": name,
        "showSymbol": False,
        "data": [(round(x, _ROUNDED), round(y, _ROUNDED)) for x, y in points],
        "lineStyle": {"width": 1.4 if dashed else 2, "type": "dashed" if dashed else "solid", "color": colour},
        "itemStyle": {"color": colour},
    }


def trajectory_series(
    kind: str, points: Sequence[Sequence[float]], period: float, marked: Sequence[float]
) -> list[dict[str, Any]]:
    """Return the curves of a trajectory, at most 600 points each, with red lines at the times ``marked``."""
    stride = max(1, len(points) // _PLOTTED)
    places = [*range(0, len(points) - 1, stride), len(points) - 1]
    series = [
        line_series(name, COLOURS[index], [(place * period, points[place][index]) for place in places])
        for index, name in enumerate(names_of(kind, len(points[0])))
    ]
    series[0]["markLine"] = {
        "silent": True, "symbol": "none", "label": {"show": False}, "lineStyle": {"color": "#dc2626", "width": 1.5},
        "data": [{"xAxis": round(time, _ROUNDED)} for time in marked],
    }  # fmt: skip
    return series


def live_series(kind: str, points: Sequence[TracePoint]) -> list[dict[str, Any]]:
    """Return the curves of commands (dashed) and actual values."""
    if not points:
        return []
    found = []
    for index, name in enumerate(names_of(kind, min(6, len(points[0].command)))):
        colour = COLOURS[index]
        actual = [(each.time, each.actual[index]) for each in points if index < len(each.actual)]
        found.append(line_series(name, colour, actual))
        command = [(each.time, each.command[index]) for each in points]
        found.append({**line_series(name, colour, command, dashed=True), "z": 3})
    return found


def error_series(kind: str, points: Sequence[TracePoint]) -> list[dict[str, Any]]:
    """Return the curves of the differences of command and actual value."""
    if not points:
        return []
    return [
        line_series(
            name,
            COLOURS[index],
            [(each.time, each.command[index] - each.actual[index]) for each in points if index < len(each.actual)],
        )
        for index, name in enumerate(names_of(kind, min(6, len(points[0].command))))
    ]


def histogram_options(dark: bool) -> dict[str, Any]:
    """Return the options of the histogram of cycle times."""
    options = base_options(dark, tr("number"), "ms")
    options["xAxis"] = {**options["xAxis"], "type": "category", "data": []}
    del options["legend"]
    options["series"] = [{"type": "bar", "data": [], "itemStyle": {"color": COLOURS[0]}, "barCategoryGap": "10%"}]
    return options


def histogram_patch(bars: Sequence[tuple[float, int]]) -> dict[str, Any]:
    """Return the new data of the histogram."""
    return {
        "xAxis": {"data": [f"{start * 1000:g}" for start, _ in bars]},
        "series": [{"data": [count for _, count in bars]}],
    }


def chart(options: dict[str, Any], label: str, marker: str) -> Chart:
    """Build a plot with a text for screen readers."""
    built = Chart(options).classes("ok-sm-chart")
    return built.props(f'role=img aria-label="{label}"').props(f"data-testid={marker}")


def show(target: Chart, patch: dict[str, Any]) -> None:
    """Send new data to a plot, without its other options."""
    target.change(patch, ["series"] if "xAxis" not in patch else [])
