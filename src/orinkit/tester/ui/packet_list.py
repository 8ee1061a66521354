"""A list of packets or frames of which only the visible rows exist: :class:`PacketList`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core.i18n import tr

LARGEST_WINDOW = 200
"""Maximum number of rows that are sent at once."""


@dataclass(frozen=True, slots=True)
class ListTexts:
    """The texts of a list.

    Attributes:
        title: Text for screen readers.
        empty: Text that is shown while the list is empty.
        columns: Titles of the six columns; the fourth one is the direction.
        marker: Beginning of the values of ``data-testid``; the list has ``MARKER-list``.
    """

    title: str
    empty: str
    columns: tuple[str, str, str, str, str, str]
    marker: str


class PacketList(ui.element, component="packet_list.js"):
    """A list of packets.

    Args:
        texts: The texts of the list.
        on_window: Callback invoked with the position and number of the rows to supply.
        on_pick: Callback invoked with the number of the packet that the user has clicked.
        on_move: Callback invoked with a number of rows, ``"first"`` or ``"last"`` if the user moves the selection.
        on_follow: Callback invoked with True or False if the user scrolls to the end, or away from it.
    """

    def __init__(
        self,
        texts: ListTexts,
        *,
        on_window: Callable[[int, int], None],
        on_pick: Callable[[int], None],
        on_move: Callable[[int | str], None],
        on_follow: Callable[[bool], None],
    ) -> None:
        super().__init__()
        self._props["labels"] = {
            "list": texts.title, "sent": tr("sent"), "received": tr("received"), "empty": texts.empty,
            "columns": texts.columns, "marker": texts.marker,
        }  # fmt: skip
        self._props["state"] = {"view": 0, "first": 0, "end": 0, "start": 0, "rows": [], "follow": True}
        self.on("window", lambda event: _window(event, on_window))
        self.on("pick", lambda event: on_pick(int(event.args)))
        self.on("move", lambda event: on_move(event.args if isinstance(event.args, str) else int(event.args)))
        self.on("follow", lambda event: on_follow(bool(event.args)))

    def show(self, state: dict[str, Any]) -> None:
        """Show rows; packet_list.js lists the keys of ``state``."""
        self._props["state"] = state
        self.update()


def _window(event: GenericEventArguments, supply: Callable[[int, int], None]) -> None:
    start, size = int(event.args["start"]), int(event.args["size"])
    supply(max(start, 0), max(min(size, LARGEST_WINDOW), 1))
