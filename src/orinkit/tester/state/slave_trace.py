"""The measurements of a Slave Move, in bounded memory: :class:`SlaveTrace`."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from time import time_ns
from typing import Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import MissingExtra, OrinError
from orinkit.rc8.slave_formats import PoseKind
from orinkit.streaming.recording.recorder import Recorder, open_recorder
from orinkit.streaming.recording.samples import Sample

BIN: Final = 0.0005
"""Width of the bars of the histogram of cycle times, s."""
MOST_RECORDED: Final = 1_000_000
"""The largest number of set-points in a recording."""

_LAST_BIN: Final = 60  # longer cycles are counted in this bar
_KEPT: Final = 1200
_RECENT: Final = 125
_EVERY: Final = 10  # of the samples of the last seconds, every tenth one is kept
_BUFFER: Final = 125  # set-points over which the state of the controller's buffer is averaged, 1 s
_VALUES: Final = 8
_LATE: Final = 1.5  # periods


class TracePoint(NamedTuple):
    """A point of the plots: time in s, command, and actual values."""

    time: float
    command: tuple[float, ...]
    actual: tuple[float, ...]


class SlaveTrace:
    """Commands and actual values, timing, and recordings of a Slave Move.

    Args:
        kind: Pose type of the set-points.
        period: Time between two set-points, s.

    Attributes:
        count: Number of set-points.
        command: The latest set-point.
        largest_error: For each value, the largest difference of command and actual value.
        late_gaps: Number of times between two set-points that were longer than 1.5 periods.
        longest_gap: The longest time between two set-points, s.
        queued: Number of set-points that wait in the streaming process.
        missed: True if a sample was overwritten before it was read.
        recordings: Files of the recordings.
        problem: Why the recording ended or was not possible; ``""`` if there is no problem.
    """

    def __init__(self, kind: PoseKind, period: float) -> None:
        self.kind = kind
        self.period = period
        self.count = 0
        self.command: tuple[float, ...] = ()
        self.largest_error: list[float] = [0.0] * _VALUES
        self.late_gaps = 0
        self.longest_gap = 0.0
        self.queued = 0
        self.missed = False
        self.recordings: list[Path] = []
        self.problem: Exception | str = ""
        self._histogram: Counter[int] = Counter()
        self._points: list[TracePoint] = []
        self._recent: deque[TracePoint] = deque(maxlen=_RECENT)
        self._codes: deque[bool] = deque(maxlen=_BUFFER)
        self._stride = 1
        self._last: Sample | None = None
        self._recorders: list[Recorder] = []

    def record(self, folder: Path) -> None:
        """Begin recordings in CSV and MCAP; a recording that is not possible is reported in ``problem``."""
        for suffix in (".csv", ".mcap"):
            path = folder / f"slave-move{suffix}"
            try:
                recorder = open_recorder(path, kind=self.kind, period=self.period, start_ns=time_ns())
            except (OrinError, MissingExtra) as error:
                self.problem = error
                continue
            self._recorders.append(recorder)
            self.recordings.append(path)

    def add(self, samples: Iterable[Sample]) -> None:
        """Add samples."""
        for sample in samples:
            self._add(sample)
        for recorder in self._recorders:
            self.problem = self.problem or recorder.error or ""

    def _add(self, sample: Sample) -> None:
        before, self._last = self._last, sample
        if before is not None and sample.number == before.number + 1:
            self._time(sample.sent - before.sent)
        elif before is not None:
            self.missed = True
        actual = tuple(sample.joints or ()) if self.kind == "J" else tuple(sample.position or sample.trans or ())
        point = TracePoint(sample.sent, sample.command, actual)
        self.command = sample.command
        for place, (wanted, found) in enumerate(zip(point.command, actual, strict=False)):
            if place < _VALUES:
                self.largest_error[place] = max(self.largest_error[place], abs(wanted - found))
        self._codes.append(sample.code == hresult.S_BUF_FULL)
        if self.count % _EVERY == 0:
            self._recent.append(point)
        if self.count % self._stride == 0:
            self._points.append(point)
            if len(self._points) >= _KEPT:
                self._points, self._stride = self._points[::2], self._stride * 2
        self.count += 1
        if self.count <= MOST_RECORDED:
            for recorder in self._recorders:
                recorder.write(sample)

    def _time(self, gap: float) -> None:
        self._histogram[min(int(gap / BIN), _LAST_BIN)] += 1
        self.longest_gap = max(self.longest_gap, gap)
        self.late_gaps += gap > _LATE * self.period

    def recent(self) -> Sequence[TracePoint]:
        """Return the points of the last seconds."""
        return list(self._recent)

    def whole(self) -> Sequence[TracePoint]:
        """Return points of the whole stream, at most 1200."""
        return list(self._points)

    def histogram(self) -> list[tuple[float, int]]:
        """Return the times between two set-points, in s, and how often each occurred."""
        if not self._histogram:
            return []
        first, last = min(self._histogram), max(self._histogram)
        return [(place * BIN, self._histogram[place]) for place in range(first, last + 1)]

    @property
    def buffer_full(self) -> float:
        """Part of the latest set-points, 0 to 1, after which the buffer of the controller was full (S_BUF_FULL)."""
        return sum(self._codes) / len(self._codes) if self._codes else 0.0

    def close(self) -> None:
        """Complete the recordings."""
        for recorder in self._recorders:
            recorder.close()
            self.problem = self.problem or recorder.error or ""
        self._recorders = []
