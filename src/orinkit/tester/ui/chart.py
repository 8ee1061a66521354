"""Plots: :class:`Chart`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import nicegui.elements.echart  # noqa: F401 - registers ECharts, which chart.js imports
from nicegui import ui


class Chart(ui.element, component="chart.js", default_classes="nicegui-echart"):
    """A plot that is drawn by ECharts.

    In contrast to ``ui.echart``, the browser displays the page before it loads the library.

    Args:
        options: Options of ECharts.
    """

    def __init__(self, options: dict[str, Any]) -> None:
        super().__init__()
        self._props["options"] = options

    def change(self, patch: dict[str, Any], replaced: Sequence[str] = ()) -> None:
        """Change options; the other ones remain.

        Args:
            patch: The new options.
            replaced: Names of the components that ``patch`` replaces as a whole, for example ``"series"``.
        """
        self.run_method("change", patch, list(replaced))
