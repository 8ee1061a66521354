"""The CAN frames of a connection, in memory: :class:`FrameLog`."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from time import time_ns
from typing import Final

from orinkit.can.frame import CanFrame
from orinkit.tester.state.packet_log import Direction

CAPACITY: Final = 50_000
"""Maximum number of frames that are kept; the oldest ones are discarded."""
_ECHOES: Final = 256  # sent frames whose echo may still arrive


@dataclass(frozen=True, slots=True)
class LoggedFrame:
    """A frame that was sent or received.

    Attributes:
        number: Number of the frame, from 1; numbers are never reused.
        time_ns: Time of day in ns since 1970.
        direction: ``">"`` sent, ``"<"`` received.
        frame: The frame.
        polled: True if the Tester itself has requested the frame, or sent this request, to display values.
    """

    number: int
    time_ns: int
    direction: Direction
    frame: CanFrame
    polled: bool = False


class FrameLog:
    """The latest frames of a connection. All methods must be called in the thread of the event loop.

    Args:
        capacity: Number of frames that are kept.

    Attributes:
        total: Number of frames since the start.
        cleared: Number of times that the log was cleared.
        start_ns: Time of the first frame since the log was cleared, in ns since 1970; 0 if there is none.
        recording: False while new frames are not added.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._frames: deque[LoggedFrame] = deque(maxlen=capacity)
        self.total = 0
        self.cleared = 0
        self.start_ns = 0
        self.recording = True

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[LoggedFrame]:
        return iter(self._frames)

    @property
    def first_number(self) -> int:
        """The number of the oldest frame that is kept; ``total + 1`` if there is none."""
        return self.total - len(self._frames) + 1

    def add(self, direction: Direction, frame: CanFrame, *, polled: bool = False) -> None:
        """Add a frame, unless recording is off."""
        if not self.recording:
            return
        self.total += 1
        now = time_ns()
        self.start_ns = self.start_ns or now
        self._frames.append(LoggedFrame(self.total, now, direction, frame, polled))

    def get(self, number: int) -> LoggedFrame | None:
        """Return the frame with a number; ``None`` if it has been discarded, or does not exist yet."""
        index = number - self.first_number
        return self._frames[index] if 0 <= index < len(self._frames) else None

    def newest(self, count: int) -> list[LoggedFrame]:
        """Return up to ``count`` frames, the newest ones, oldest first."""
        found = list(islice(reversed(self._frames), count))
        found.reverse()
        return found

    def clear(self) -> None:
        """Discard all frames; the numbers continue."""
        self._frames.clear()
        self.start_ns = 0
        self.cleared += 1


class EchoFilter:
    """Recognizes received frames that this program has sent itself: some interfaces (udp_multicast) return them."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, bytes]] = deque()
        self._counts: Counter[tuple[int, bytes]] = Counter()

    def sent(self, frame: CanFrame) -> None:
        """Note that a frame was sent."""
        key = frame.id, frame.data
        self._sent.append(key)
        self._counts[key] += 1
        if len(self._sent) > _ECHOES:
            self._drop(self._sent.popleft())

    def is_echo(self, frame: CanFrame) -> bool:
        """Return True if a received frame is the echo of a frame that was sent; each echo is recognized once."""
        key = frame.id, frame.data
        if not self._counts[key]:
            del self._counts[key]
            return False
        self._sent.remove(key)
        self._drop(key)
        return True

    def _drop(self, key: tuple[int, bytes]) -> None:
        self._counts[key] -= 1
        if self._counts[key] <= 0:
            del self._counts[key]
