"""Sliders for percentages: :func:`percent_slider`."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files

from nicegui import ui


def percent_slider(label: str, marker: str, value: int) -> ui.slider:
    """Build a slider from 1 to 100 %.

    Args:
        label: Text for screen readers.
        marker: Value of ``data-testid``.
        value: Initial value in %.
    """
    slider = ui.slider(min=1, max=100, step=1, value=value).props(f"data-testid={marker}")
    slider.props["aria-label"] = label
    ui.run_javascript(f"({_script()})({json.dumps(slider.html_id)})")
    return slider


@cache
def _script() -> str:
    return (files("orinkit.tester") / "static" / "slider.js").read_text("utf-8").strip()
