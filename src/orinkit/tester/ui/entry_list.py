"""A list of the packets or frames of a log, with its scrolling, following and selection: :class:`EntryList`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any, Final, Generic, Protocol, TypeVar

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.entry_view import PAUSE
from orinkit.tester.state.packet_rows import TIME_MODES
from orinkit.tester.ui.packet_list import ListTexts, PacketList
from orinkit.tester.ui.session import PageSession

_SEARCH: Final = 0.15  # s of searching between two updates of the page


class ListedEntry(Protocol):
    """An entry of a log."""

    @property
    def number(self) -> int:
        """Number of the entry, from 1."""


E = TypeVar("E", bound=ListedEntry)
E_co = TypeVar("E_co", bound=ListedEntry, covariant=True)


class ListedLog(Protocol):
    """A log that users can pause and clear."""

    recording: bool

    @property
    def cleared(self) -> int:
        """Number of times that the log was cleared."""

    def __len__(self) -> int: ...

    def clear(self) -> None:
        """Discard all entries."""


class ListedView(Protocol[E_co]):
    """The entries that a list shows; :class:`~orinkit.tester.state.entry_view.EntryView` describes the members."""

    @property
    def behind(self) -> int:
        """Number of entries that have not been examined yet."""

    @property
    def first(self) -> int:
        """Position of the first entry."""

    @property
    def end(self) -> int:
        """Position after the last entry."""

    def __len__(self) -> int: ...

    def position(self, number: int) -> int:
        """Return the position of an entry; -1 if it is not shown."""

    def number(self, position: int) -> int:
        """Return the number of the entry at a position; 0 if there is none."""

    def window(self, position: int, count: int) -> Sequence[E_co]:
        """Return up to ``count`` entries from a position."""

    def advance(self) -> bool:
        """Examine further entries for a limited time; return True if some are left."""


class EntryList(Generic[E]):
    """A list of which only the visible rows exist in the browser.

    Args:
        log: The log.
        view: The entries to show.
        texts: The texts of the list; the ``data-testid`` of its parts begin with their marker.
        row: Function that returns the row of an entry from the entry, the previous one, and the time mode.
        select: Callback invoked with the number of an entry that the user selects; it calls :meth:`reveal`.
        count: Function that returns the text for the number of shown and of all entries.
        extra: Function that builds further controls.
    """

    def __init__(
        self,
        log: ListedLog,
        view: ListedView[E],
        texts: ListTexts,
        row: Callable[[E, E | None, str], list[Any]],
        select: Callable[[int], None],
        count: Callable[[str, str], str],
        extra: Callable[[], object] = lambda: None,
    ) -> None:
        self._log, self._view, self._row, self._select, self._count_text = log, view, row, select, count
        self._views = 0
        self._follow = True
        self._mode = "time"
        self._window = (0, 40)
        self._selected = 0
        self._reveal = 0
        self._shown: object = None
        with ui.element("div").classes("ok-row"):
            self._count = ui.label().classes("ok-dim ok-packet-facts").props("role=status")
            self._count.props(f"data-testid={texts.marker}-count")
            ui.space()
            modes = {key: tr(text) for key, text in TIME_MODES.items()}
            time = ui.select(modes, value=self._mode, label=tr("Time"), on_change=self._set_mode)
            time.props("dense outlined options-dense data-testid=time-mode").classes("ok-packet-time")
            extra()
            self._follow_switch = ui.switch(tr("Follow"), value=True, on_change=self._switch_follow)
            self._follow_switch.props("dense data-testid=follow").tooltip(tr("Always show the newest entry"))
        self._list = PacketList(
            texts, on_window=self._set_window, on_pick=select, on_move=self._move, on_follow=self._set_follow
        )

    @property
    def view(self) -> ListedView[E]:
        """The entries that are shown."""
        return self._view

    def show_view(self, view: ListedView[E]) -> None:
        """Show other entries of the log."""
        self._view = view
        self._views += 1
        self._reveal += 1
        self._window = (view.first, self._window[1])
        self.show()

    def reveal(self, number: int) -> None:
        """Mark an entry as selected, and scroll to it."""
        self._selected = number
        self._reveal += 1
        self._follow = self._follow_switch.value = False
        self.show()

    async def refresh(self) -> None:
        """Examine further entries and show what has changed."""
        view, stop = self._view, perf_counter() + _SEARCH
        while view.advance() and view is self._view and perf_counter() < stop:  # noqa: ASYNC110 - divides work
            await asyncio.sleep(PAUSE)
        self.show()

    def show(self) -> None:
        """Show the current entries, if they have changed."""
        view, log = self._view, self._log
        self._show_count()
        first, end = view.first, view.end
        start, size = self._window
        start = max(end - size, first) if self._follow else min(max(start, first), max(end - 1, first))
        entries = view.window(start, size)
        position = view.position(self._selected)
        key = (self._views, first, end, start, size, self._follow, self._selected, self._reveal, self._mode, log.cleared,
               [each.number for each in entries])  # fmt: skip
        if key == self._shown:
            return
        self._shown = key
        before = view.window(start - 1, 1) if start > first else ()
        rows, previous = [], before[0] if before else None
        for each in entries:
            rows.append(self._row(each, previous, self._mode))
            previous = each
        self._list.show({
            "view": self._views, "first": first, "end": end, "start": start, "rows": rows, "follow": self._follow,
            "selected": self._selected, "position": position, "reveal": self._reveal,
        })  # fmt: skip

    def _show_count(self) -> None:
        view, total = self._view, len(self._log)
        text = self._count_text(f"{len(view):,}", f"{total:,}")
        if view.behind:
            text += " · " + tr("searching: {percent} %", percent=100 * (total - view.behind) // max(total, 1))
        if self._count.text != text:
            self._count.text = text

    def _set_mode(self, event: Any) -> None:
        self._mode = event.value
        self.show()

    def _set_window(self, start: int, size: int) -> None:
        self._window = (start, size)
        self.show()

    def _switch_follow(self) -> None:
        self._set_follow(bool(self._follow_switch.value))

    def _set_follow(self, follow: bool) -> None:
        if follow != self._follow:
            self._follow = self._follow_switch.value = follow
            self.show()

    def _move(self, step: int | str) -> None:
        view = self._view
        if not len(view):
            return
        last = view.end - 1
        current = view.position(self._selected)
        if isinstance(step, str):
            target = view.first if step == "first" else last
        else:
            target = last if current < 0 else current + step
        self._select(view.number(max(view.first, min(target, last))))


class RecordButtons:
    """The buttons that pause and clear a log, for all pages and users; they require the controls.

    Args:
        session: The page.
        log: The log.
        problem: Function that displays an exception, or with ``None`` removes it.
    """

    def __init__(self, session: PageSession, log: ListedLog, problem: Callable[[Exception | None], None]) -> None:
        self._log = log
        self._record = ui.button(on_click=session.guarded(self._toggle, problem))
        self._record.props("flat dense no-caps data-testid=record")
        clear = ui.button(tr("Clear"), icon="delete_sweep", on_click=session.guarded(log.clear, problem))
        clear.props("flat dense no-caps data-testid=clear")
        self.refresh()

    def refresh(self) -> None:
        """Show whether the log records."""
        recording = self._log.recording
        text, icon = (tr("Pause recording"), "pause") if recording else (tr("Record"), "fiber_manual_record")
        if self._record.text != text:
            self._record.text = text
            self._record.props(f"icon={icon} color={'primary' if recording else 'negative'}")

    def _toggle(self) -> None:
        self._log.recording = not self._log.recording
        self.refresh()
