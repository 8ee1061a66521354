"""The filter of the list of packets: :class:`FilterBar`."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from orinkit.cao.functions import FUNCTIONS
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_filter import LONGEST_HEX, LONGEST_TEXT, PacketFilter, check_text, read_bytes
from orinkit.tester.ui.errors import problem_text

_ALL = ""


class FilterBar:
    """The fields of the filter. An invalid field shows a message and leaves the list unchanged.

    Args:
        changed: Callback invoked with the new filter.
    """

    def __init__(self, changed: Callable[[PacketFilter], None]) -> None:
        self._changed = changed
        with ui.element("div").classes("ok-packet-filter").props(f'role=search aria-label="{tr("Filter")}"'):
            self._connection = ui.select({_ALL: tr("all")}, value=_ALL, label=tr("Connection"))
            self._direction = ui.select(
                {_ALL: tr("both"), ">": tr("sent"), "<": tr("received")}, value=_ALL, label=tr("Direction")
            )
            names = {each.id: f"{each.id} {each.name}" for each in FUNCTIONS.values()}
            self._function = ui.select(names, label=tr("Function"), with_input=True, clearable=True)
            self._text = ui.input(tr("Name or value"), validation=lambda text: problem_text(check_text, text))
            self._hex = ui.input(tr("Bytes in hex"), validation=lambda text: problem_text(read_bytes, text))
            self._errors = ui.checkbox(tr("Errors only"))
        for field, marker in (
            (self._connection, "connection"), (self._direction, "direction"), (self._function, "function"),
            (self._text, "text"), (self._hex, "hex"),
        ):  # fmt: skip
            field.props("outlined dense options-dense").props(f"data-testid=filter-{marker}")
        self._errors.props("dense data-testid=filter-errors")
        for entry, most in ((self._text, LONGEST_TEXT), (self._hex, LONGEST_HEX)):
            # one more than allowed: pasted text is cut off by the browser, and the message appears
            entry.props(f"debounce=250 clearable autocomplete=off spellcheck=false maxlength={most + 1}")
        self._hex.classes("ok-mono")
        for each in (self._connection, self._direction, self._function, self._text, self._hex, self._errors):
            each.on_value_change(self._apply)

    def set_connections(self, names: list[str]) -> None:
        """Offer connections; the one that is chosen remains."""
        chosen = self._connection.value or _ALL
        names = list(dict.fromkeys([*names, *([chosen] if chosen else [])]))
        if list(self._connection.options) != [_ALL, *names]:
            self._connection.set_options({_ALL: tr("all"), **{name: name for name in names}}, value=chosen)

    def _apply(self) -> None:
        try:
            condition = PacketFilter(
                self._connection.value or "",
                self._direction.value or "",
                int(self._function.value or 0),
                bool(self._errors.value),
                check_text(self._text.value or ""),
                read_bytes(self._hex.value or ""),
            )
        except InvalidValue:
            return  # the field shows the message
        self._changed(condition)
