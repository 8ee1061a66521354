"""The live table of ``orinkit abh3 monitor``: a row for each message type, sender and destination."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from orinkit.abh3.table.decoder import DecodedFrame
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from rich.table import Table

_MAX_ROWS: Final = 200
_WINDOW: Final = 1.0  # s over which frames are counted for their rate
_REFRESH: Final = 0.2  # s
_STALE: Final = 2.0  # s without a frame after which the rate is shown as 0


@dataclass(slots=True)
class FrameRow:
    """Statistics of the frames of one message type from one sender to one destination.

    Attributes:
        last: The latest frame.
        at: Time of arrival of the latest frame in s.
        count: Number of frames.
        rate: Frames per s in the previous interval; ``None`` in the first interval.
        since: Start, in s, of the current interval; the rate is measured in successive intervals of about 1 s.
        counted: Number of frames in the current interval.
    """

    last: DecodedFrame
    at: float
    count: int
    rate: float | None
    since: float
    counted: int

    def add(self, decoded: DecodedFrame, now: float) -> None:
        """Count a frame."""
        self.last, self.at = decoded, now
        self.count += 1
        self.counted += 1
        if now - self.since >= _WINDOW:
            self.rate = self.counted / (now - self.since)
            self.since, self.counted = now, 0


class FrameRows:
    """All rows, at most 200; a further row replaces the one whose latest frame is oldest.

    Args:
        clock: Returns a monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._rows: dict[tuple[str, int, int | None], FrameRow] = {}

    def add(self, decoded: DecodedFrame) -> None:
        """Count a frame."""
        now = self._clock()
        name = decoded.name or f"{decoded.frame.id:08X}"
        key = (name, decoded.source, decoded.destination)
        row = self._rows.get(key)
        if row is not None:
            row.add(decoded, now)
            return
        if len(self._rows) >= _MAX_ROWS:
            del self._rows[min(self._rows, key=lambda key: self._rows[key].at)]
        self._rows[key] = FrameRow(decoded, now, 1, None, now, 0)

    def lines(self) -> list[tuple[str, str, str, str, str]]:
        """Return for each row: frame, rate in 1/s, age of the latest frame in s, count, and content of that frame."""
        now = self._clock()
        found = []
        for key in sorted(self._rows, key=lambda key: (key[1], key[0], -1 if key[2] is None else key[2])):
            row = self._rows[key]
            age = now - row.at
            rate = 0.0 if age > _STALE else row.rate
            found.append(
                (row.last.heading, "-" if rate is None else f"{rate:.1f}", f"{age:.1f}", str(row.count), row.last.content)
            )  # fmt: skip
        return found


class LiveTable:
    """The rows on a terminal, until the ``with`` statement ends."""

    def __init__(self) -> None:
        from rich.live import Live

        self._rows = FrameRows()
        self._live = Live(self._table(), auto_refresh=False, vertical_overflow="crop")
        self._shown = monotonic()

    def add(self, decoded: DecodedFrame) -> None:
        """Count a frame."""
        self._rows.add(decoded)

    def refresh(self) -> None:
        """Update the table, at most a few times per second."""
        if monotonic() - self._shown >= _REFRESH:
            self._show()

    def _show(self) -> None:
        self._live.update(self._table(), refresh=True)
        self._shown = monotonic()

    def _table(self) -> Table:
        from rich.table import Table
        from rich.text import Text

        table = Table(expand=True)
        table.add_column(tr("frame"))
        for title in ("1/s", tr("age [s]"), tr("count")):
            table.add_column(title, justify="right")
        table.add_column(tr("content"), ratio=1)
        for cells in self._rows.lines():
            table.add_row(*(Text(cell) for cell in cells))
        return table

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._show()
        self._live.stop()
