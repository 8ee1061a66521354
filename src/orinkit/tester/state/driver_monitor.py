"""The values of a driver, polled once for all pages: :class:`DriverMonitor`."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from time import monotonic, time
from typing import Final, NamedTuple, Protocol

from orinkit.abh3.table.decoder import DecodedFrame
from orinkit.abh3.table.records import Flags
from orinkit.abh3.table.signals import Dialect, FrameLayout, SignalField, Word
from orinkit.core.errors import DriverTimeout, OrinError
from orinkit.tester.state.history import History
from orinkit.tester.state.shared_poll import SharedPoll

logger = logging.getLogger("orinkit.tester")

PERIOD: Final = 0.1
"""Time in s between two cycles."""
_FRESH: Final = 0.8 * PERIOD  # age in s up to which a value is not requested again
_DENSEST: Final = 0.04  # s between two values of a history
_RETRY: Final = 0.5  # s after which a driver that does not reply is asked again
_UNANSWERED: Final = 30.0  # s after which a broadcast without reply is requested again


class DriverSource(Protocol):
    """The connection to poll."""

    @property
    def name(self) -> str:
        """The name of the connection."""

    @property
    def dialect(self) -> Dialect:
        """The dialect of the driver."""

    async def request(self, name: str) -> None:
        """Request a frame of the driver by its name, and wait for it."""


class ReportedValue(NamedTuple):
    """A number that the driver reports.

    Attributes:
        frame: Name of the frame that contains it.
        field: The field of the frame.
        column: Number of its column in the history of the frame.
    """

    frame: str
    field: SignalField
    column: int

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return self.field.quantity.unit if self.field.quantity else ""

    @property
    def digits(self) -> int | None:
        """Decimal places; ``None`` for a single-precision float."""
        quantity = self.field.quantity
        return quantity.digits if quantity and quantity.steps else None


class DriverMonitor(SharedPoll):
    """The latest values of a driver, from all frames that it sends.

    A cycle requests each frame that the driver has not sent in the last 0.1 s, no matter how many pages display its
    values. A frame that a driver sends periodically, or in reply to commands, is therefore not requested.

    Args:
        source: The connection.

    Attributes:
        histories: The past numbers of each frame, by the frame's name.
        error: Why the driver could not be read in the latest cycle; otherwise ``None``.
        version: Counts the frames that were taken into account, and the changes of :attr:`error`.
        cycles: Number of complete cycles.
    """

    def __init__(self, source: DriverSource) -> None:
        super().__init__()
        self._source = source
        layouts = [each for each in source.dialect.layouts.values() if not each.from_host and not each.undocumented]
        self._layouts: Mapping[str, FrameLayout] = {each.name: each for each in layouts}
        self._frames: dict[str, DecodedFrame] = {}
        self._received: dict[str, float] = {}
        self._retry_at: dict[str, float] = {}
        self._added: dict[str, float] = {}  # times of the newest values of the histories
        self.histories = {name: History() for name in self._layouts}
        self.error: Exception | None = None
        self.version = 0
        self.cycles = 0

    @property
    def values(self) -> Iterator[ReportedValue]:
        """The numbers that drivers of this dialect report, in order."""
        for name, layout in self._layouts.items():
            numbers = [field for field in layout.fields if field.quantity is not None]
            yield from (ReportedValue(name, field, column) for column, field in enumerate(numbers))

    @property
    def words(self) -> Iterator[tuple[str, Word]]:
        """The flag words that drivers of this dialect report: the name of the frame, and the word."""
        for name, layout in self._layouts.items():
            yield from ((name, field.word) for field in layout.fields if field.word is not None)

    def number(self, value: ReportedValue) -> float | None:
        """Return the latest number; ``None`` if it is unknown."""
        found = self._content(value.frame, value.field.name)
        return found if isinstance(found, int | float) else None

    def flags(self, frame: str, word: Word) -> Flags | None:
        """Return the latest flags; ``None`` if they are unknown."""
        found = self._content(frame, word.name)
        return found if isinstance(found, Flags) else None

    @property
    def heard(self) -> float:
        """Time of the monotonic clock at which the latest frame was received, s; 0 if there was none."""
        return max(self._received.values(), default=0.0)

    def note(self, decoded: DecodedFrame) -> None:
        """Take a frame of the driver into account."""
        layout = self._layouts.get(decoded.name)
        if layout is None or decoded.fault is not None:
            return
        now = monotonic()
        self._frames[decoded.name] = decoded
        self._received[decoded.name] = now
        self._retry_at.pop(decoded.name, None)
        self.version += 1
        numbers = [value.content for value in decoded.values if isinstance(value.content, int | float)]
        if numbers and now - self._added.get(decoded.name, 0.0) >= _DENSEST:
            self._added[decoded.name] = now
            self.histories[decoded.name].add(time(), numbers)

    def forget(self) -> None:
        """Forget the latest values, because the connection was closed or lost; the histories remain."""
        self._frames.clear()
        self._received.clear()
        self._retry_at.clear()
        self.version += 1

    def _content(self, frame: str, name: str) -> object:
        decoded = self._frames.get(frame)
        values = decoded.values if decoded else ()
        return next((value.content for value in values if value.name == name), None)

    async def _cycle(self) -> float:
        started = monotonic()
        try:
            await self._read_all(started)
        except (OrinError, OSError) as error:
            logger.debug("%s: polling: %s", self._source.name, error)
            self._report(error)
            return _RETRY
        self._report(None)
        self.cycles += 1
        return max(PERIOD - (monotonic() - started), PERIOD / 5)

    async def _read_all(self, started: float) -> None:
        """Request every frame that is due.

        Raises:
            OrinError: If the driver does not reply twice in succession, or the bus is lost.
        """
        failed: DriverTimeout | None = None
        for name in self._layouts:
            now = monotonic()
            if now - self._received.get(name, 0.0) < _FRESH or now < self._retry_at.get(name, 0.0):
                continue
            try:
                await self._source.request(name)
                failed = None
            except DriverTimeout as error:
                if self.heard >= started:  # the driver replies, but not with this frame
                    self._retry_at[name] = monotonic() + _UNANSWERED
                if failed is not None:
                    raise
                failed = error
        if failed is not None and self.heard < started:
            raise failed

    def _report(self, error: Exception | None) -> None:
        if error is not self.error:
            self.error = error
            self.version += 1
