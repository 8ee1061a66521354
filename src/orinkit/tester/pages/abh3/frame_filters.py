"""The filter of the list of frames."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.abh3.frame_filter import FrameFilter
from orinkit.tester.state.abh3.frame_text import KINDS
from orinkit.tester.state.packet_filter import LONGEST_HEX, LONGEST_TEXT, check_text, read_bytes
from orinkit.tester.ui.errors import problem_text

_ALL = ""


class FrameFilterBar:
    """The fields of the filter. An invalid entry has a message beside its field, and does not change the list.

    Args:
        changed: Callback invoked with each new filter.
        condition: The filter at the beginning.
    """

    def __init__(self, changed: Callable[[FrameFilter], None], condition: FrameFilter) -> None:
        self._changed = changed
        directions = {_ALL: tr("all"), ">": tr("sent"), "<": tr("received")}
        kinds = {_ALL: tr("all"), **{key: tr(text) for key, text in KINDS.items()}}
        with ui.element("div").classes("ok-packet-filter"):
            self._direction = ui.select(directions, value=condition.direction, label=tr("Direction"))
            self._kind = ui.select(kinds, value=condition.kind, label=tr("Kind"))
            self._text = ui.input(tr("Meaning or ID"), validation=lambda text: problem_text(check_text, text))
            self._data = ui.input(tr("Bytes in hex"), validation=lambda text: problem_text(read_bytes, text))
            self._polled = ui.checkbox(tr("Polling by this page"), value=condition.polled)
        for field, marker in (
            (self._direction, "direction"),
            (self._kind, "kind"),
            (self._text, "text"),
            (self._data, "hex"),
        ):
            field.props("outlined dense options-dense").props(f"data-testid=filter-{marker}")
        self._polled.props("dense data-testid=filter-polled")
        for entry, most in ((self._text, LONGEST_TEXT), (self._data, LONGEST_HEX)):
            # one more than allowed: pasted text is cut off by the browser, and the message appears
            entry.props(f"debounce=250 clearable autocomplete=off spellcheck=false maxlength={most + 1}")
        self._data.classes("ok-mono")
        for each in (self._direction, self._kind, self._text, self._data, self._polled):
            each.on_value_change(self._apply)

    def _apply(self) -> None:
        try:
            condition = FrameFilter(
                self._direction.value or "", self._kind.value or "", bool(self._polled.value),
                check_text(self._text.value or ""), read_bytes(self._data.value or ""),
            )  # fmt: skip
        except InvalidValue:
            return  # the field shows the message
        self._changed(condition)
