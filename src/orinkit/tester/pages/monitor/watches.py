"""The variables that one page displays: :class:`Watches`. This module does not use NiceGUI."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from orinkit.core.errors import InvalidValue
from orinkit.tester.state.history import History, merged_rows
from orinkit.tester.state.poller import VariablePoller, VariableRef, Watch
from orinkit.tester.state.watch_list import WatchList

MAX_PLOTTED = 8
"""Number of lines in a plot."""


@dataclass(frozen=True, slots=True)
class Column:
    """A number that can be plotted: the value of a variable, or one element of an array."""

    label: str
    history: History
    index: int


class Watches:
    """The watched variables of one page, in the order of the user's list; they are read while the page is connected.

    Attributes:
        chosen: The user's list, which all pages of the user share.
    """

    def __init__(self, poller: VariablePoller, chosen: WatchList) -> None:
        self.chosen = chosen
        self._poller = poller
        self._watches: dict[VariableRef, Watch] = {}
        self._active = False

    def __iter__(self) -> Iterator[Watch]:
        return (self._watches[ref] for ref in self.chosen if ref in self._watches)

    def resume(self) -> None:
        """Begin to read the variables."""
        self._active = True
        self.follow()

    def pause(self) -> None:
        """Stop reading the variables."""
        self._active = False
        for watch in self._watches.values():
            watch.close()
        self._watches.clear()

    def follow(self) -> None:
        """Adapt to changes of the list.

        Raises:
            InvalidValue: If all pages together watch too many variables; the others are read.
        """
        wanted = list(self.chosen)
        for ref in [ref for ref in self._watches if ref not in wanted]:
            self._watches.pop(ref).close()
        problem: InvalidValue | None = None
        for ref in wanted if self._active else ():
            if ref not in self._watches:
                try:
                    self._watches[ref] = self._poller.watch(ref)
                except InvalidValue as error:
                    problem = error
        if problem is not None:
            raise problem

    def watch(self, ref: VariableRef) -> Watch | None:
        """Return the watch of a variable, if it is read."""
        return self._watches.get(ref)

    def reset(self) -> None:
        """Forget all lowest and highest values."""
        for watch in self._watches.values():
            watch.reset()

    def columns(self) -> list[Column]:
        """Return everything that can be plotted."""
        found = []
        for watch in self:
            history, label = watch.reading.history, watch.reading.ref.label
            count = len(history.columns)
            found += [Column(f"{label}[{index}]" if count > 1 else label, history, index) for index in range(count)]
        return found

    def labels_of(self, ref: VariableRef) -> list[str]:
        """Return the labels of the columns of a variable."""
        watch = self._watches.get(ref)
        history = watch.reading.history if watch else None
        return [each.label for each in self.columns() if each.history is history]

    def toggle(self, ref: VariableRef) -> None:
        """Plot a variable, or remove it from the plot; at most 8 lines are plotted, the latest ones."""
        labels, plotted = self.labels_of(ref), self.chosen.plotted
        if any(each in plotted for each in labels):
            self.chosen.plotted = [each for each in plotted if each not in labels]
        else:
            self.chosen.plotted = [*plotted, *labels][-MAX_PLOTTED:]

    def snapshot(self) -> list[tuple[str, History]]:
        """Return copies of all histories with the labels of the variables, for :func:`csv_text`."""
        return [(each.reading.ref.label, each.reading.history.copy()) for each in self if len(each.reading.history)]


def csv_text(histories: list[tuple[str, History]]) -> str:
    """Return the values of variables as CSV: local time, and one column for each number."""
    labels = []
    for label, history in histories:
        count = len(history.columns)
        labels += [f"{label}[{index}]" if count > 1 else label for index in range(count)]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["time", *labels])
    for row in merged_rows([history for _, history in histories]):
        time = datetime.fromtimestamp(row[0] or 0.0).isoformat(" ", "milliseconds")
        writer.writerow([time, *("" if value is None else f"{value:.10g}" for value in row[1:])])
    return text.getvalue()
