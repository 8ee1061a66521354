"""Command and feedback of a stream, value by value over time: what reports and pictures are made of."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from orinkit.core.errors import MissingExtra
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require
from orinkit.rc8.slave_formats import PoseKind
from orinkit.values.pose_numbers import FIELDS

if TYPE_CHECKING:
    from orinkit.streaming.recording.samples import Sample

_ROBOT_AXES: Final = 6
_TURN: Final = 360.0
_STILL: Final = 1e-3  # less is no motion: deg, mm
_ROTATIONS: Final = ("RX", "RY", "RZ")
_FIGURE: Final = "Fig"
_FEEDBACK: Final[dict[PoseKind, str]] = {"J": "joints", "P": "position", "T": "trans"}
_KINDS: Final[dict[str, PoseKind]] = {"J": "J", "P": "P", "T": "T"}
_SENT: Final = "sent_s"  # a column that only a stream's recording has
_LONGEST_HEADER: Final = 10_000  # characters
_LARGEST_RECORD: Final = 1 << 26  # bytes
_MOST_ROWS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class StreamTrace:
    """What was commanded and what the arm did.

    Attributes:
        times: seconds since the first set-point, as the controller takes one each period.
        names: of the values: ``J1`` ..., or ``X``, ``Y``, ``Z``, ``RX`` ...; no figure.
        command: for each time, what was commanded: deg, or mm.
        actual: the same of what came back; empty where nothing did.
    """

    times: Sequence[float]
    names: Sequence[str]
    command: Sequence[Sequence[float]]
    actual: Sequence[Sequence[float]]

    def unit(self, place: int) -> str:
        """Return the unit of a value; of joints 7 and 8 it is not known."""
        name = self.names[place]
        if name in _ROTATIONS or (name[0] == "J" and int(name[1:]) <= _ROBOT_AXES):
            return "deg"
        return "mm" if name in ("X", "Y", "Z") else ""

    def deviations(self, place: int) -> list[float]:
        """Return by how much the arm was off the command, for each time; of angles that turn round, the shorter way."""
        off = [actual[place] - command[place] for command, actual in zip(self.command, self.actual, strict=True)]
        if self.names[place] in _ROTATIONS:
            return [(value + _TURN / 2) % _TURN - _TURN / 2 for value in off]
        return off

    def largest(self, place: int) -> float:
        """Return the largest deviation of a value; 0 where nothing came back."""
        return max(map(abs, self.deviations(place)), default=0.0) if self.actual else 0.0

    def moving(self) -> list[int]:
        """Return the places of the values that change."""
        columns = list(zip(*self.command, strict=True))
        return [place for place, column in enumerate(columns) if max(column) - min(column) > _STILL]


def trace_of(samples: Iterable[Sample], kind: PoseKind, period: float) -> StreamTrace:
    """Return the trace of what a stream answered with.

    Args:
        samples: in their order.
        kind: of the set-points.
        period: seconds between two of them.
    """
    name = _FEEDBACK[kind]
    rows = [_TraceRow(sample.number, sample.command, getattr(sample, name)) for sample in samples]
    return _trace_of(rows, kind, period)


class _TraceRow(NamedTuple):
    """A set-point, its number, and what came back."""

    number: int
    command: Sequence[float]
    actual: Sequence[float] | None


def _trace_of(rows: Sequence[_TraceRow], kind: PoseKind, period: float) -> StreamTrace:
    names = [name.upper() for name in FIELDS[kind] if name != _FIGURE.lower()]
    size = min([len(names), *(len(row.command) for row in rows)])
    actual = [tuple(row.actual)[:size] for row in rows if row.actual is not None and len(row.actual) >= size]
    return StreamTrace(
        [(row.number - rows[0].number) * period for row in rows],
        names[:size],
        [row.command[:size] for row in rows],
        actual if len(actual) == len(rows) else [],
    )


# --- from files -------------------------------------------------------------------------------------------------------


def is_recording(path: Path) -> bool:
    """Tell whether a file is what a stream has recorded; one that cannot be read is none."""
    if path.suffix.lower() == ".mcap":
        return True
    try:
        with path.open(encoding="utf-8-sig") as file:
            return _SENT in file.readline(_LONGEST_HEADER).rstrip("\n").split(",")
    except (OSError, ValueError):
        return False


def read_trace(path: Path) -> StreamTrace:
    """Read what a stream has recorded.

    Raises:
        InvalidValue: the file cannot be used.
        MissingExtra: for MCAP, the package ``mcap`` is not installed.
    """
    from orinkit.streaming.trajectory.csv_file import wrong

    trace = _from_mcap(path) if path.suffix.lower() == ".mcap" else _from_csv(path)
    if len(trace.times) < 2:
        raise wrong(path, 0, tr("{count} set-points of two or more that are wanted", count=len(trace.times)))  # fmt: skip
    return trace


def _from_csv(path: Path) -> StreamTrace:
    from orinkit.streaming.trajectory.csv_file import COMMAND, ENCODER, TIME, CsvTable, numbers, wrong

    rows = CsvTable(path).rows()
    header = next(rows).cells
    names = [name.removesuffix(COMMAND) for name in header if name.endswith(COMMAND) and name != _FIGURE + COMMAND]
    if not names or TIME not in header:
        columns = f"{TIME}, J1{COMMAND}, ..."
        raise wrong(path, 1, tr("the columns {columns} are wanted", columns=columns))
    suffix = ENCODER if names[0].startswith("J") else ""
    returned = [header.index(f"{name}{suffix}") for name in names if f"{name}{suffix}" in header]
    wanted = [header.index(TIME), *(header.index(f"{name}{COMMAND}") for name in names), *returned]
    values = [numbers(path, row, len(header), wanted) for row in rows]
    count = len(names) + 1
    has_all = len(returned) == len(names)
    return StreamTrace(
        [row[0] for row in values], names, [row[1:count] for row in values],
        [row[count:] for row in values] if has_all else [],
    )  # fmt: skip


def _from_mcap(path: Path) -> StreamTrace:
    from orinkit.streaming.trajectory.csv_file import wrong

    try:
        with path.open("rb") as file:
            return _trace_of(*_messages(file))
    except OSError as error:
        raise wrong(path, 0, tr("cannot be read: {reason}", reason=error.strerror)) from None
    except MissingExtra:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a broken file does to the reader
        raise wrong(path, 0, tr("it is no recording of a stream ({error})", error=error)) from None


def _messages(file: IO[bytes]) -> tuple[list[_TraceRow], PoseKind, float]:
    from orinkit.streaming.recording.recorder import INFO_TOPIC

    kind: PoseKind | None = None
    period = 0.0
    rows: list[_TraceRow] = []
    for topic, data in _until_cut(file):
        found = json.loads(data)
        if topic == INFO_TOPIC:
            kind, period = _KINDS[found["kind"]], float(found["period"])
        elif kind is not None and len(rows) < _MOST_ROWS:
            actual = found.get(_FEEDBACK[kind])
            command = _finite(found["command"])
            rows.append(_TraceRow(int(found["number"]), command, None if actual is None else _finite(actual)))
    if kind is None:
        raise ValueError(INFO_TOPIC)
    return rows, kind, period


def _until_cut(file: IO[bytes]) -> Iterator[tuple[str, bytes]]:
    """Yield topic and content of the messages of an MCAP file, up to where it was cut off, if whoever wrote it was killed."""
    require(tr("reading MCAP"), "log", "mcap")
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    from orinkit.streaming.recording.recorder import INFO_TOPIC, SAMPLE_TOPIC

    messages = NonSeekingReader(file, record_size_limit=_LARGEST_RECORD).iter_messages(
        [INFO_TOPIC, SAMPLE_TOPIC], log_time_order=False
    )
    while True:
        try:
            _, channel, message = next(messages)
        except (StopIteration, EndOfFile, struct.error):
            return
        yield channel.topic, message.data


def _finite(values: Any) -> list[float]:
    numbers = list(map(float, values))
    if not all(map(math.isfinite, numbers)):
        raise ValueError(str(numbers))
    return numbers
