"""Controls that the browser changes without waiting for the Tester: :class:`StateButton`, :func:`show_chosen_part`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

from nicegui import ui


class StateButton(ui.element, component="state_button.js"):
    """A button with two states, off and on.

    Args:
        icons: Icons of the states.
        labels: Texts for screen readers: what a click does in each state.
        marker: Value of ``data-testid``.
        on_change: Callback invoked with the new state after a click.
    """

    def __init__(
        self, icons: tuple[str, str], labels: tuple[str, str], marker: str, on_change: Callable[[bool], None]
    ) -> None:
        super().__init__()
        self._props.update(value=False, icons=icons, labels=labels)
        self._props["data-testid"] = marker
        self.on("change", lambda event: on_change(bool(event.args)))


def show_chosen_part(toggle: ui.toggle, parts: Mapping[str, ui.element]) -> None:
    """Display one of several parts of a page: that of the option that is chosen.

    Args:
        toggle: The control with the options.
        parts: The part of each option.
    """
    chosen = [parts[option] for option in toggle.options]

    def show() -> None:
        for option, part in parts.items():
            part.visible = option == toggle.value

    ids = json.dumps([part.html_id for part in chosen])
    toggle.on(
        "update:model-value",
        js_handler=f"(chosen) => {ids}.forEach("
        "(id, index) => document.getElementById(id)?.classList.toggle('hidden', index !== chosen))",
    )
    toggle.on_value_change(show)
    show()
