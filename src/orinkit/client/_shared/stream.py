"""What both clients' streams share: formats, results, samples. Plain data, no calls."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from threading import Event, Thread
from time import time_ns
from typing import Any, Final, NamedTuple

from orinkit.client._shared.stream_options import StreamOptions
from orinkit.core.errors import StreamError
from orinkit.core.i18n import tr
from orinkit.rc8.slave_fields import POSES, PoseKind
from orinkit.rc8.slave_lateness import Lateness
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.process.shared_memory import SAMPLE_ROOM, RawSample, SetPointSource, StreamMemory
from orinkit.streaming.recording.samples import OWN, Sample
from orinkit.values.poses import J, P, T

POLL: Final = 0.002
"""Seconds between two looks at what the streaming process has done."""
LOOK_NS: Final = 10_000_000
"""Nanoseconds that a trajectory may be queued for until others have their turn."""
SETTLE: Final = 2.0
"""Seconds that the arm may take to stand still before slave mode begins."""
PREFETCH: Final = 25
"""Set-points of an iterator that are there before the first one is sent."""
TRIES: Final = 3
"""How often recovering is tried (reference: recovery that users implemented)."""

POSE_TYPES: Final[dict[PoseKind, type[J | P | T]]] = {"J": J, "P": P, "T": T}
"""The values of each kind of pose."""

_LONGEST_SLEEP: Final = 0.05


class Progress(NamedTuple):
    """How far a trajectory is.

    Attributes:
        sent: set-points that have been sent.
        total: how many there are; ``None`` where nobody knows.
    """

    sent: int
    total: int | None


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds between one set-point and the next, as they were sent.

    Attributes:
        gaps: each of them.
    """

    gaps: tuple[float, ...] = ()

    def part(self, part: float) -> float:
        """Return the gap that this part of all gaps, 0 to 1, do not exceed, s."""
        ordered = sorted(self.gaps)
        return ordered[min(len(ordered) - 1, int(part * len(ordered)))] if ordered else 0.0

    @property
    def p50(self) -> float:
        """The middle one, s."""
        return self.part(0.5)

    @property
    def p99(self) -> float:
        """What 99 of 100 do not exceed, s."""
        return self.part(0.99)

    @property
    def max(self) -> float:
        """The longest, s."""
        return max(self.gaps, default=0.0)

    def histogram(self, width: float = 0.001) -> dict[int, int]:
        """Return how many gaps there are of each length: 7 counts those from 7 to below 8 widths."""
        counts: dict[int, int] = {}
        for gap in self.gaps:
            place = int(gap / width)
            counts[place] = counts.get(place, 0) + 1
        return dict(sorted(counts.items()))

    def __str__(self) -> str:
        return tr(
            "{count} gaps, p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {max:.2f} ms",
            count=len(self.gaps),
            p50=self.p50 * 1000.0,
            p99=self.p99 * 1000.0,
            max=self.max * 1000.0,
        )


@dataclass(frozen=True, slots=True)
class StreamResult:
    """What became of a trajectory.

    Attributes:
        sent: set-points of it that were sent.
        underflows: how often they came too late, so that the arm was brought to rest; 0 for a sequence.
        samples: what came back, from the first set-point to the arm's rest.
        missed: samples that nobody read in time.
        timing: seconds between the set-points.
        late: set-points that a virtual controller waited for, or, with strict time in mode 1, stopped in place for. Real ones do not
            count them: they stop the arm.
    """

    sent: int
    underflows: int
    samples: tuple[Sample, ...]
    missed: int
    timing: Timing
    late: Lateness = field(default_factory=Lateness)

    def __str__(self) -> str:
        text = tr(
            "{sent} set-points, {underflows} underflows; {timing}",
            sent=self.sent,
            underflows=self.underflows,
            timing=self.timing,
        )
        return f"{text}; {self.late}" if self.late.count else text


def timing_of(samples: Iterable[Sample]) -> Timing:
    """Return the gaps between samples; what nobody has read leaves none."""
    return Timing(tuple(b.sent - a.sent for a, b in pairwise(samples) if b.number == a.number + 1))


def ended_because(reason: str, idle: float | None) -> StreamError:
    """Return the exception for a stream that has ended without an error."""
    texts = {
        "stopped": tr(
            "this program was stopped (SIGSTOP): the arm was brought to rest and slave mode was left. Try: recover()"
        ),
        "idle": tr(
            "no set-point came for {idle} s: slave mode was left. Try: recover(), or slave_mode(idle=None)", idle=idle
        ),
        "terminated": tr(
            "the streaming process was told to end (SIGTERM): the arm was brought to rest and slave mode was left"
        ),
    }
    return StreamError(texts.get(reason) or tr("slave mode is off: a stream is used inside its block"))


def with_limits(joints: tuple[float, ...], limits: Limits) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the joints that there are limits for, and the others.

    Raises:
        StreamError: one of the others is used: it would be moved without limits.
    """
    count = len(limits.lower)
    for axis, joint in enumerate(joints[count:], count + 1):
        if joint:
            raise StreamError(
                tr(
                    "limits for {count} axes, but axis {axis} stands at {joint:g}: give limits for it too",
                    count=count,
                    axis=axis,
                    joint=joint,
                )
            )
    return joints[:count], joints[count:]


def broken_off(sent: int) -> StreamError:
    """Return the exception for a trajectory that something else has ended."""
    return StreamError(
        tr("the trajectory was broken off after {sent} set-points: stop() was called, or a target was set", sent=sent)
    )


# --- samples ----------------------------------------------------------------------------------------------------------


def sample_of(raw: RawSample, began_ns: int) -> Sample:
    """Return a sample as users see it."""
    own: dict[str, Any] = {}
    more: dict[str, Any] = {}
    for name, value in raw.values.items():
        make = _POSES.get(name)
        (own if name in OWN else more)[name] = value if make is None else make(value)
    return Sample(
        raw.number,
        (raw.sent_ns - began_ns) / 1e9,
        raw.command,
        raw.code,
        **own,
        delay=raw.delay_ns / 1e9 if raw.delay_ns >= 0 else None,
        answered=(raw.answered_ns - began_ns) / 1e9,
        more=more,
    )


_POSES: Final = {row.name: POSE_TYPES[kind].of for kind, row in POSES.items()}


@dataclass(slots=True)
class SampleReader:
    """Reads samples in their order.

    Attributes:
        next: number of the next one.
        period: seconds of a cycle; with it numbers go on from ``began_ns``, another stream's beginning.
        began_ns: when time began; 0 for when this stream did.
        missed: how many were overwritten before they were read.
    """

    shared: StreamMemory
    next: int = 0
    missed: int = field(default=0)
    period: float = 0.0
    began_ns: int = 0

    def new(self) -> Iterator[Sample]:
        """Give every sample that has been written since the last call."""
        if self.shared.closed:
            return
        count = self.shared.samples
        began = self.began_ns or self.shared.began_ns
        offset = round((self.shared.began_ns - began) / 1e9 / self.period) if self.period else 0
        if count - self.next > SAMPLE_ROOM:
            self.missed += count - SAMPLE_ROOM - self.next
            self.next = count - SAMPLE_ROOM
        while self.next < count and not self.shared.closed:
            raw = self.shared.sample(self.next)
            self.next += 1
            if raw is None:
                self.missed += 1
            else:
                raw.number += offset
                yield sample_of(raw, began)


class TrajectoryRun:
    """A trajectory under way.

    Args:
        shared: that it is queued in.
        total: how many set-points it has; ``None`` where nobody knows.
        progress: is told how many have been sent.
    """

    def __init__(self, shared: StreamMemory, total: int | None, progress: Callable[[Progress], object] | None) -> None:
        self.shared = shared
        self._total = total
        self._progress = progress
        self._reader = SampleReader(shared, shared.samples)
        self._samples: list[Sample] = []
        self._before, self._dry, self._first = shared.sent, shared.dry, shared.written
        self._late_before = self._late_seen = shared.lateness
        self._latest = 0.0  # s, the longest lateness of its set-points
        self._started = False
        self._broken_off = False

    @property
    def sent(self) -> int:
        """Set-points of it that have been sent."""
        return self.shared.sent - self._before

    def start(self) -> None:
        """Have what is queued sent."""
        if not self._started:
            self._started = True
            self.shared.feed_queue()

    def look(self) -> None:
        """Read what came back.

        Raises:
            StreamError: something else has ended it.
        """
        self._read()
        if self._progress is not None:
            self._progress(Progress(self.sent, self._total))
        fed = not self._started or self.shared.feed is SetPointSource.QUEUE
        if not fed or self.shared.forgotten > self._first:
            self._broken_off = True
            raise broken_off(self.sent)

    def give_up(self) -> None:
        """It ends with an exception: the arm comes to rest, unless something else moves it now."""
        if not self._broken_off and not self.shared.closed:
            self.shared.forget()
            self.shared.hold()

    def result(self, sent: int) -> StreamResult:
        """Return what has become of it; it is over."""
        self.shared.hold()
        self._read()
        if self._progress is not None:
            self._progress(Progress(sent, self._total))
        samples, missed, late, before = tuple(self._samples), self._reader.missed, self._late_seen, self._late_before
        lateness = Lateness(late.count - before.count, self._latest, late.total - before.total)
        return StreamResult(sent, self.shared.dry - self._dry, samples, missed, timing_of(samples), lateness)

    def _read(self) -> None:
        self._samples.extend(self._reader.new())
        late = self.shared.lateness
        if late.count != self._late_seen.count:
            self._late_seen, self._latest = late, max(self._latest, late.longest)


class SampleRecording:
    """Writes every sample to a file, in a thread, as they come.

    Args:
        path: of the file.
        shared: where they come from.
        options: of the stream.
    """

    def __init__(self, path: Path, options: StreamOptions) -> None:
        from orinkit.streaming.recording.recorder import open_recorder  # most streams are not recorded

        self._recorder = open_recorder(path, kind=options.mode.kind, period=options.period, start_ns=time_ns())
        self._period = options.period
        self._began_ns = 0  # of the first stream: one that was recovered goes on
        self._end = Event()
        self._threads: list[Thread] = []

    def follow(self, shared: StreamMemory) -> None:
        """Begin to write what a streaming process sends."""
        self._end.clear()
        self._began_ns = self._began_ns or shared.began_ns
        reader = SampleReader(shared, period=self._period, began_ns=self._began_ns)
        thread = Thread(target=self._write, args=(reader,), name="orinkit-record", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _write(self, reader: SampleReader) -> None:
        last = False
        while not last:
            last = self._end.wait(_LONGEST_SLEEP)
            for sample in reader.new():
                self._recorder.write(sample)

    def pause(self) -> None:
        """Write what is there, and stop following."""
        self._end.set()
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def close(self) -> None:
        """Finish the file.

        Raises:
            StreamError: it could not be written.
        """
        self.pause()
        self._recorder.close()
        if self._recorder.error is not None:
            raise StreamError(self._recorder.error)
