"""What is told of a stream when it is over: for people, and as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from orinkit.cli._stream_trace import Trace
from orinkit.language import pick
from orinkit.slave.realtime import RealTime
from orinkit.streaming import StreamResult, Timing

_BAR: Final = 30  # columns of the longest bar of the histogram
_BARS: Final = 12
_WIDTH: Final = 0.001  # s of a class of the histogram


@dataclass(frozen=True, slots=True)
class Report:
    """What became of a stream.

    Attributes:
        result: set-points, underflows, gaps.
        real_time: what the system granted.
        trace: command and feedback.
        record: file that was written, if any.
    """

    result: StreamResult
    real_time: RealTime
    trace: Trace
    record: str | None = None

    @property
    def seconds(self) -> float:
        """From the first set-point to the last one, as they were sent."""
        samples = self.result.samples
        return samples[-1].sent - samples[0].sent if samples else 0.0

    def lines(self) -> list[str]:
        """Return it for people."""
        from orinkit.cli._output import table

        result, timing = self.result, self.result.timing
        rows = [
            (pick("set-points", "位置指令"), pick(f"{result.sent}", f"{result.sent} 個")),
            (pick("time", "時間"), pick(f"{self.seconds:.2f} s", f"{self.seconds:.2f} 秒")),
            (pick("underflows", "アンダーフロー"), pick(f"{result.underflows}", f"{result.underflows} 回")),
            (pick("gaps", "送信間隔"), "\n".join((_gaps(timing), *histogram(timing)))),
            (pick("real time", "リアルタイム"), str(self.real_time)),
            (pick("largest deviation", "最大偏差"), self._deviations()),
        ]
        if result.late.count:  # a real controller does not tell
            real = pick("a real controller would have stopped the arm", "実機ではアームが停止していました")
            rows.insert(3, (pick("late", "遅延"), f"{result.late}\n({real})"))
        if self.record is not None:
            rows.append((pick("record", "記録"), self.record))
        return table(rows)

    def document(self) -> dict[str, Any]:
        """Return it for JSON; seconds, degrees and mm."""
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
            "largest_deviation": {name: trace.largest(place) for place, name in enumerate(trace.names)}
            if trace.actual
            else None,
            "record": self.record,
        }

    def _deviations(self) -> str:
        trace = self.trace
        if not trace.actual:
            return pick("nothing came back", "フィードバックなし")
        parts = [
            f"{name} {trace.largest(place):.3f}{_unit(trace.unit(place))}" for place, name in enumerate(trace.names)
        ]
        late = pick("what comes back is some cycles behind the command", "フィードバックは指令より数周期遅れます")
        return "  ".join(parts) + f"\n({late})"


def histogram(timing: Timing) -> list[str]:
    """Return the gaps as lines of text, one for each millisecond in which there are any; those beyond are one line."""
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
    return pick(f"p50 {p50}, p99 {p99}, max {most}", f"p50 {p50}、p99 {p99}、最大 {most}")


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""
