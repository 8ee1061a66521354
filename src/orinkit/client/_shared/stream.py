"""Results and samples of streams, shared by the asynchronous and the synchronous client; no network I/O."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from time import time_ns
from typing import Any, Final, NamedTuple

from orinkit.client._shared.stream_options import StreamOptions
from orinkit.core.errors import StreamError
from orinkit.core.i18n import tr
from orinkit.core.public_name import public
from orinkit.rc8.slave_fields import POSES, PoseKind
from orinkit.rc8.slave_lateness import Lateness
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.process.shared_memory import SAMPLE_ROOM, RawSample, SetPointSource, StreamMemory
from orinkit.streaming.recording.samples import OWN, Sample
from orinkit.values.poses import J, P, T

POLL: Final = 0.002
"""Polling interval of the streaming process in s."""
LOOK_NS: Final = 10_000_000
"""Maximum time in ns for which set-points are queued without yielding to other tasks."""
SETTLE: Final = 2.0
"""Maximum time in s to wait for standstill of the arm before slave mode begins."""
PREFETCH: Final = 25
"""Number of set-points that are read from an iterator before the first one is sent."""
TRIES: Final = 3
"""Maximum number of attempts to recover after an error. Existing programs of users make as many attempts."""

POSE_TYPES: Final[dict[PoseKind, type[J | P | T]]] = {"J": J, "P": P, "T": T}
"""Python class for the poses of each pose type."""

_RECORD_INTERVAL: Final = 0.05  # s


@public("orinkit")
class Progress(NamedTuple):
    """Progress of a trajectory.

    Attributes:
        sent: Number of set-points that have been sent.
        total: Number of set-points of the trajectory; ``None`` if unknown.
    """

    sent: int
    total: int | None


@public("orinkit")
@dataclass(frozen=True, slots=True)
class Timing:
    """Statistics of the time between the sending of successive set-points.

    Attributes:
        gaps: Times in s from the sending of each set-point to the sending of the next one.
    """

    gaps: tuple[float, ...] = ()

    def quantile(self, q: float) -> float:
        """Return a quantile of the gaps in s; ``q`` is from 0 to 1. Without gaps, the result is 0."""
        ordered = sorted(self.gaps)
        return ordered[min(len(ordered) - 1, int(q * len(ordered)))] if ordered else 0.0

    @property
    def p50(self) -> float:
        """The median gap in s."""
        return self.quantile(0.5)

    @property
    def p99(self) -> float:
        """The 99th percentile of the gaps in s."""
        return self.quantile(0.99)

    @property
    def max(self) -> float:
        """The longest gap in s."""
        return max(self.gaps, default=0.0)

    def histogram(self, width: float = 0.001) -> dict[int, int]:
        """Return a histogram of the gaps: key n counts the gaps from n * width to below (n + 1) * width (in s)."""
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


@public("orinkit")
@dataclass(frozen=True, slots=True)
class StreamResult:
    """Result of streaming a trajectory.

    Attributes:
        sent: Number of set-points of the trajectory that were sent.
        underflows: Number of times that the queue of set-points was empty while the arm moved, so that the arm was
            stopped. This is possible only if the set-points come from an iterator, or with ``ahead``.
        samples: Set-points and feedback, from the first set-point to standstill of the arm; empty with
            ``keep_samples=False``.
        missed: Number of samples that were overwritten before they were read.
        timing: Statistics of the time between successive set-points.
        late: Late set-points, counted by virtual controllers only. For each late set-point, the virtual controller
            waited or, with strict time in mode 1, stopped the arm in place. Real controllers stop the arm and do not
            count late set-points.
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
        return tr("{first}; {second}", first=text, second=self.late) if self.late.count else text


def ended_because(reason: str, idle: float | None) -> StreamError:
    """Create the exception for a stream that ended for another reason than an error.

    Args:
        reason: Reason that the streaming process reported; ``""`` if slave mode is off.
        idle: Time in s without a set-point after which slave mode is left.
    """
    texts = {
        "stopped": tr(
            "this program was stopped (SIGSTOP), so the arm was stopped and slave mode was ended. Try: recover()"
        ),
        "idle": tr(
            "no set-point for {idle} s, so slave mode was ended. Try: recover(), or slave_mode(idle=None)", idle=idle
        ),
        "terminated": tr(
            "the streaming process was terminated (SIGTERM), so the arm was stopped and slave mode was ended"
        ),
    }
    text = texts.get(reason) or tr("slave mode is off. Try: use the stream inside its with block")
    return StreamError(text, reason)


def split_by_limits(joints: tuple[float, ...], limits: Limits) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Split the joints of an arm into those for which there are limits and the others.

    Raises:
        StreamError: If a joint without limits is not 0, because it would move without limits.
    """
    count = len(limits.lower)
    for axis, joint in enumerate(joints[count:], count + 1):
        if joint:
            raise StreamError(
                tr(
                    "limits are given for {count} axes only, but axis {axis} is not at 0 (it is at {joint:g}). "
                    "Try: pass limits for this axis, too",
                    count=count,
                    axis=axis,
                    joint=joint,
                )
            )
    return joints[:count], joints[count:]


def broken_off(sent: int) -> StreamError:
    """Create the exception for a trajectory that another call interrupted."""
    return StreamError(
        tr("the trajectory was interrupted after {sent} set-points: stop() was called, or a target was set", sent=sent)
    )


# --- samples ----------------------------------------------------------------------------------------------------------


def sample_of(raw: RawSample, began_ns: int) -> Sample:
    """Convert a sample of the streaming process to a :class:`Sample`, with times in s since ``began_ns``."""
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
        replied=(raw.replied_ns - began_ns) / 1e9,
        more=more,
    )


_POSES: Final = {row.name: POSE_TYPES[kind].of for kind, row in POSES.items()}


@dataclass(slots=True)
class SampleReader:
    """Reads the samples of a streaming process in order.

    Attributes:
        shared: Memory shared with the streaming process.
        next: Number of the next sample.
        missed: Number of samples that were overwritten before they were read.
        period: Cycle time in s, for numbering the samples from ``began_ns``; 0 to number them from the start of this
            stream.
        began_ns: Origin of the times in ns: the start of an earlier stream; 0 for the start of this stream.
    """

    shared: StreamMemory
    next: int = 0
    missed: int = field(default=0)
    period: float = 0.0
    began_ns: int = 0

    def new(self) -> Iterator[Sample]:
        """Yield the samples that were written since the last call."""
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
    """The execution of one trajectory.

    Args:
        shared: Memory that contains the queue of set-points.
        total: Number of set-points; ``None`` if unknown.
        progress: Callback invoked with the progress.
        keep_samples: False if the result does not contain the samples.
    """

    def __init__(
        self,
        shared: StreamMemory,
        total: int | None,
        progress: Callable[[Progress], object] | None,
        *,
        keep_samples: bool = True,
    ) -> None:
        self.shared = shared
        self._total = total
        self._progress = progress
        self._reader = SampleReader(shared, shared.samples)
        self._keeps = keep_samples
        self._samples: list[Sample] = []
        self._latest: Sample | None = None
        self._gaps = array("d")  # s; if samples were overwritten unread, the gap is omitted
        self._before, self._dry, self._first = shared.taken, shared.underflows, shared.written
        self._late_before = self._late_seen = shared.lateness
        self._max_lateness = 0.0  # s
        self._started = False
        self._broken_off = False

    @property
    def sent(self) -> int:
        """The number of set-points of the trajectory that have been sent."""
        return self.shared.taken - self._before

    def start(self) -> None:
        """Start sending the queued set-points."""
        if not self._started:
            self._started = True
            self.shared.select_queue()

    def look(self) -> None:
        """Read new samples and report the progress.

        Raises:
            StreamError: If another call interrupted the trajectory.
        """
        self._read()
        if self._progress is not None:
            self._progress(Progress(self.sent, self._total))
        fed = not self._started or self.shared.source is SetPointSource.QUEUE
        if not fed or self.shared.discarded_until > self._first:
            self._broken_off = True
            raise broken_off(self.sent)

    def give_up(self) -> None:
        """Stop the arm after an exception, unless another call has taken over the arm."""
        if not self._broken_off and not self.shared.closed:
            self.shared.clear_queue()
            self.shared.hold()

    def result(self, sent: int) -> StreamResult:
        """Return the result of the trajectory, all ``sent`` set-points of which have been sent."""
        self.shared.hold()
        self._read()
        if self._progress is not None:
            self._progress(Progress(sent, self._total))
        samples, missed, late, before = tuple(self._samples), self._reader.missed, self._late_seen, self._late_before
        lateness = Lateness(late.count - before.count, self._max_lateness, late.total - before.total)
        return StreamResult(
            sent, self.shared.underflows - self._dry, samples, missed, Timing(tuple(self._gaps)), lateness
        )

    def _read(self) -> None:
        for sample in self._reader.new():
            before, self._latest = self._latest, sample
            if before is not None and sample.number == before.number + 1:
                self._gaps.append(sample.sent - before.sent)
            if self._keeps:
                self._samples.append(sample)
        late = self.shared.lateness
        if late.count != self._late_seen.count:
            self._late_seen, self._max_lateness = late, max(self._max_lateness, late.longest)


class SampleRecording:
    """Writes all samples to a file, from its own thread.

    Args:
        path: Path of the file.
        options: Options of the stream.
    """

    def __init__(self, path: Path, options: StreamOptions) -> None:
        from orinkit.streaming.recording.recorder import open_recorder  # most streams are not recorded

        self._recorder = open_recorder(path, kind=options.mode.kind, period=options.period, start_ns=time_ns())
        self._period = options.period
        self._began_ns = 0  # start of the first stream; the times of streams after recover() refer to it
        self._end = Event()
        self._threads: list[Thread] = []

    def follow(self, shared: StreamMemory) -> None:
        """Start recording the samples of a streaming process."""
        self._end.clear()
        self._began_ns = self._began_ns or shared.began_ns
        reader = SampleReader(shared, period=self._period, began_ns=self._began_ns)
        thread = Thread(target=self._write, args=(reader,), name="orinkit-record", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _write(self, reader: SampleReader) -> None:
        last = False
        while not last:
            last = self._end.wait(_RECORD_INTERVAL)
            for sample in reader.new():
                self._recorder.write(sample)

    def pause(self) -> None:
        """Write the remaining samples and stop recording."""
        self._end.set()
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def close(self) -> None:
        """Stop recording and close the file.

        Raises:
            StreamError: If the file could not be written.
        """
        self.pause()
        self._recorder.close()
        if self._recorder.error is not None:
            raise StreamError(self._recorder.error)
