"""Filtering the frames of a connection: :class:`FrameFilter`, :class:`FrameView`."""

from __future__ import annotations

from dataclasses import dataclass

from orinkit.abh3.table.decoder import Decoder
from orinkit.tester.state.abh3.frame_text import kind_of
from orinkit.tester.state.entry_view import EntryView
from orinkit.tester.state.frame_log import FrameLog, LoggedFrame


@dataclass(frozen=True, slots=True)
class FrameFilter:
    """Which frames a list shows. All conditions must hold; a condition with its default always holds.

    Attributes:
        direction: ``">"`` sent, ``"<"`` received.
        kind: A key of :data:`~orinkit.tester.state.abh3.frame_text.KINDS`.
        polled: False to omit the frames with which the Tester reads the values that it displays.
        text: Text in the explanation or in the identifier, without regard to case.
        data: Bytes in the data.
    """

    direction: str = ""
    kind: str = ""
    polled: bool = True
    text: str = ""
    data: bytes = b""

    @property
    def accepts_all(self) -> bool:
        """True if every frame matches."""
        return self == FrameFilter()

    def matches(self, entry: LoggedFrame, decoder: Decoder) -> bool:
        """Return True if a frame matches."""
        if (self.direction and entry.direction != self.direction) or (entry.polled and not self.polled):
            return False
        if self.kind and kind_of(entry.frame) != self.kind:
            return False
        if self.data not in entry.frame.data:
            return False
        if not self.text:
            return True
        text = self.text.casefold()
        return text in f"{entry.frame.id:08x}" or text in decoder.decode(entry.frame).text.casefold()


class FrameView(EntryView[LoggedFrame]):
    """The frames of a log that match a filter, found incrementally.

    Args:
        log: The log.
        condition: The filter.
        decoder: The decoder of the connection.
    """

    def __init__(self, log: FrameLog, condition: FrameFilter, decoder: Decoder) -> None:
        super().__init__(log, accepts_all=condition.accepts_all)
        self.condition = condition
        self._decoder = decoder

    def _examine(self, entry: LoggedFrame) -> bool:
        return self.condition.matches(entry, self._decoder)
