"""The report about a finished stream, as text and as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from orinkit import StreamResult, Timing
from orinkit.cli._shared.stream_trace import StreamTrace
from orinkit.core.i18n import tr
from orinkit.streaming.process.realtime import RealTime

_BAR: Final = 30  # columns of the longest bar of the histogram
_BARS: Final = 12
_WIDTH: Final = 0.001  # width of a class of the histogram in s


@dataclass(frozen=True, slots=True)
class StreamReport:
    """Result of a stream.

    Attributes:
        result: Number of set-points, number of underflows, and the gaps (times) between set-points.
        real_time: Real-time scheduling and memory locking as granted by the operating system.
        trace: Command and feedback.
        record: File to which the stream was recorded; ``None`` if there is no file.
    """

    result: StreamResult
    real_time: RealTime
    trace: StreamTrace
    record: str | None = None

    @property
    def seconds(self) -> float:
        """Time between sending the first and the last set-point, in s."""
        samples = self.result.samples
        return samples[-1].sent - samples[0].sent if samples else 0.0

    def lines(self) -> list[str]:
        """Return the report for people."""
        from orinkit.cli._shared.output import table

        result, timing = self.result, self.result.timing
        rows = [
            (tr("set-points"), tr("{sent}", sent=result.sent)),
            (tr("time"), tr("{seconds:.2f} s", seconds=self.seconds)),
            (tr("underflows"), tr("{underflows}", underflows=result.underflows)),
            (tr("gaps"), "\n".join((_gaps(timing), *histogram(timing)))),
            (tr("real time"), str(self.real_time)),
            (tr("largest deviation"), self._deviations()),
        ]
        if result.late.count:  # reported by virtual controllers only
            real = tr("a real controller would have stopped the arm")
            rows.insert(3, (tr("late"), f"{result.late}\n({real})"))
        if self.record is not None:
            rows.append((tr("record"), self.record))
        return table(rows)

    def document(self) -> dict[str, Any]:
        """Return the report for JSON, in seconds, degrees and mm."""
        result, timing, trace = self.result, self.result.timing, self.trace
        return {
            "set_points": result.sent,
            "seconds": self.seconds,
            "underflows": result.underflows,
            "late": {"count": result.late.count, "longest": result.late.longest, "total": result.late.total},
            "gaps": {
                "count": len(timing.gaps),
                "p50": timing.p50,
                "p99": timing.p99,
                "max": timing.max,
                "histogram_ms": {str(place): count for place, count in timing.histogram(_WIDTH).items()},
            },
            "real_time": {"priority": self.real_time.priority, "memory_locked": self.real_time.locked},
            "largest_deviation": {name: trace.largest_deviation(index) for index, name in enumerate(trace.names)}
            if trace.actual
            else None,
            "record": self.record,
        }

    def _deviations(self) -> str:
        trace = self.trace
        if not trace.actual:
            return tr("no feedback")
        parts = [
            f"{name} {trace.largest_deviation(index):.3f}{_unit(trace.unit(index))}"
            for index, name in enumerate(trace.names)
        ]
        late = tr("the feedback lags the command by some cycles")
        return "  ".join(parts) + f"\n({late})"


def histogram(timing: Timing) -> list[str]:
    """Return a histogram of the gaps (times between set-points): a line for each range of 1 ms that contains a gap.

    There are at most 12 lines. If there are more ranges, the last line covers all further ranges.
    """
    counts = timing.histogram(_WIDTH)
    places = sorted(counts)
    bars = [(f"{place}-{place + 1} ms", counts[place]) for place in places[:_BARS]]
    if len(places) > _BARS:
        last, *others = places[_BARS - 1 :]
        bars[-1] = (f"{last}-... ms", sum(counts[place] for place in (last, *others)))
    most = max((count for _, count in bars), default=1)
    widest = max((len(label) for label, _ in bars), default=0)
    return [f"{label:>{widest}} {count:6} {'#' * max(1, round(count / most * _BAR))}" for label, count in bars]


def _gaps(timing: Timing) -> str:
    p50, p99, most = (f"{seconds * 1e3:.2f} ms" for seconds in (timing.p50, timing.p99, timing.max))
    return tr("p50 {p50}, p99 {p99}, max {most}", p50=p50, p99=p99, most=most)


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""
