"""The layout of plots of values over time, for ECharts."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from orinkit.tester.state.history import History

POINTS = 400
"""Maximum number of points of a line."""


def time_layout(dark: bool) -> dict[str, Any]:
    """Return the options of a plot whose horizontal axis is the time of day.

    Args:
        dark: True for dark mode.
    """
    dim, line = ("#94a3b3", "#28323d") if dark else ("#5b6875", "#dfe4ea")
    grid_line = {"show": True, "lineStyle": {"color": line}}
    label = {"color": dim, "fontSize": 11}
    return {
        "animation": False,
        "backgroundColor": "transparent",
        "color": ["#0891b2", "#ea580c", "#7c3aed", "#16a34a", "#db2777", "#ca8a04", "#2563eb", "#64748b"],
        "grid": {"left": 16, "right": 28, "top": 34, "bottom": 4, "containLabel": True},
        "legend": {"type": "scroll", "top": 0, "textStyle": label, "icon": "roundRect", "itemHeight": 4},
        "tooltip": {"trigger": "axis", "confine": True, "transitionDuration": 0},
        "xAxis": {"type": "time", "axisLabel": {**label, "hideOverlap": True}, "axisLine": {"lineStyle": {"color": line}}, "splitLine": {**grid_line, "showMinLine": False, "showMaxLine": False}},
        "yAxis": {"type": "value", "scale": True, "axisLabel": label, "splitLine": grid_line},
        "series": [],
    }  # fmt: skip


def time_patch(
    lines: Iterable[tuple[str, History, int]], since: float, end: float, dashed: Collection[str] = ()
) -> dict[str, Any]:
    """Return the new data of a plot.

    Args:
        lines: The lines: label, history, and number of the column.
        since: Beginning of the plot, s since 1970.
        end: End of the plot, s since 1970.
        dashed: Labels of the lines that are dashed and above the others.
    """
    series = [
        {
            "type": "line", "name": label, "id": label, "showSymbol": False, "animation": False, "lineStyle": {"width": 1.8, "type": "dashed" if label in dashed else "solid"}, "z": 3 if label in dashed else 2,
            "data": [(round(at * 1000), value) for at, value in history.plot(column, since, POINTS) if at <= end],
        }
        for label, history, column in lines
    ]  # fmt: skip
    return {"xAxis": {"min": round(since * 1000), "max": round(end * 1000)}, "series": series}
