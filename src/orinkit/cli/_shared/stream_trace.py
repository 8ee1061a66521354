"""Command and feedback of a stream over time, value by value, for reports and pictures."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from orinkit.arms import joint_unit
from orinkit.core.errors import MissingExtra
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require
from orinkit.rc8.slave_formats import PoseKind
from orinkit.values.pose_numbers import FIELDS

if TYPE_CHECKING:
    from orinkit.streaming.recording.samples import Sample

_ROBOT_AXES: Final = 6
_TURN: Final = 360.0
_STILL: Final = 1e-3  # deg or mm; a smaller change is not a motion
_ROTATIONS: Final = ("RX", "RY", "RZ")
_FIGURE: Final = "Fig"
_FEEDBACK: Final[dict[PoseKind, str]] = {"J": "joints", "P": "position", "T": "trans"}
_POSE_TYPES: Final[dict[str, PoseKind]] = {"J": "J", "P": "P", "T": "T"}
_SENT: Final = "sent_s"  # a column that only recordings of streams have
_LONGEST_HEADER: Final = 10_000  # characters
_LARGEST_RECORD: Final = 1 << 26  # bytes
_MAX_ROWS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class StreamTrace:
    """Commanded and actual values of a stream.

    Attributes:
        times: Seconds since the first set-point; the controller takes one set-point each period.
        names: Names of the values: ``J1`` ..., or ``X``, ``Y``, ``Z``, ``RX`` ...; the figure is not included.
        command: For each time, the commanded values in deg or mm.
        actual: For each time, the values of the feedback in deg or mm; empty if there is no feedback.
    """

    times: Sequence[float]
    names: Sequence[str]
    command: Sequence[Sequence[float]]
    actual: Sequence[Sequence[float]]

    def unit(self, index: int) -> str:
        """Return the unit of a value; ``""`` for joints 7 and 8, whose unit is unknown."""
        name = self.names[index]
        if name[0] == "J":
            joints = sum(each[0] == "J" for each in self.names)
            return joint_unit(index, joints) if int(name[1:]) <= _ROBOT_AXES else ""
        return "deg" if name in _ROTATIONS else "mm" if name in ("X", "Y", "Z") else ""

    def deviations(self, index: int) -> list[float]:
        """Return actual minus command of a value for each time; for RX, RY and RZ from -180 to 180 deg."""
        off = [actual[index] - command[index] for command, actual in zip(self.command, self.actual, strict=True)]
        if self.names[index] in _ROTATIONS:
            return [(value + _TURN / 2) % _TURN - _TURN / 2 for value in off]
        return off

    def largest_deviation(self, index: int) -> float:
        """Return the largest absolute deviation of a value; 0 if there is no feedback."""
        return max(map(abs, self.deviations(index)), default=0.0) if self.actual else 0.0

    def changing(self) -> list[int]:
        """Return the indices of the values that change."""
        columns = list(zip(*self.command, strict=True))
        return [index for index, column in enumerate(columns) if max(column) - min(column) > _STILL]


def trace_of(samples: Iterable[Sample], pose_type: PoseKind, period: float) -> StreamTrace:
    """Return the trace of the samples of a stream.

    Args:
        samples: The samples, in order.
        pose_type: Pose type of the set-points.
        period: Seconds between two set-points.
    """
    name = _FEEDBACK[pose_type]
    rows = [_TraceRow(sample.number, sample.command, getattr(sample, name)) for sample in samples]
    return _trace_of(rows, pose_type, period)


class _TraceRow(NamedTuple):
    """A set-point, its number, and its feedback."""

    number: int
    command: Sequence[float]
    actual: Sequence[float] | None


def _trace_of(rows: Sequence[_TraceRow], pose_type: PoseKind, period: float) -> StreamTrace:
    names = [name.upper() for name in FIELDS[pose_type] if name != _FIGURE.lower()]
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
    """Return True if a file is the recording of a stream; False if it cannot be read."""
    if path.suffix.lower() == ".mcap":
        return True
    try:
        with path.open(encoding="utf-8-sig") as file:
            return _SENT in file.readline(_LONGEST_HEADER).rstrip("\n").split(",")
    except (OSError, ValueError):
        return False


def read_trace(path: Path) -> StreamTrace:
    """Read the recording of a stream.

    Raises:
        InvalidValue: If the file is not a valid recording.
        MissingExtra: If it is an MCAP file and the package ``mcap`` is not installed.
    """
    from orinkit.streaming.trajectory.csv_file import wrong

    trace = _from_mcap(path) if path.suffix.lower() == ".mcap" else _from_csv(path)
    if len(trace.times) < 2:
        raise wrong(path, 0, tr("{count} set-points; at least 2 are required", count=len(trace.times)))  # fmt: skip
    return trace


def _from_csv(path: Path) -> StreamTrace:
    from orinkit.streaming.trajectory.csv_file import COMMAND, ENCODER, TIME, CsvTable, numbers, wrong

    rows = CsvTable(path).rows()
    header = next(rows).cells
    names = [name.removesuffix(COMMAND) for name in header if name.endswith(COMMAND) and name != _FIGURE + COMMAND]
    if not names or TIME not in header:
        columns = f"{TIME}, J1{COMMAND}, ..."
        raise wrong(path, 1, tr("the columns {columns} are required", columns=columns))
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
    except Exception as error:  # noqa: BLE001 - the reader may raise anything for a damaged file
        raise wrong(path, 0, tr("not a recording of a stream ({error})", error=error)) from None


def _messages(file: IO[bytes]) -> tuple[list[_TraceRow], PoseKind, float]:
    from orinkit.streaming.recording.recorder import INFO_TOPIC

    pose_type: PoseKind | None = None
    period = 0.0
    rows: list[_TraceRow] = []
    for topic, data in _until_cut(file):
        found = json.loads(data)
        if topic == INFO_TOPIC:
            pose_type, period = _POSE_TYPES[found["kind"]], float(found["period"])
        elif pose_type is not None and len(rows) < _MAX_ROWS:
            actual = found.get(_FEEDBACK[pose_type])
            command = _finite(found["command"])
            rows.append(_TraceRow(int(found["number"]), command, None if actual is None else _finite(actual)))
    if pose_type is None:
        raise ValueError(INFO_TOPIC)
    return rows, pose_type, period


def _until_cut(file: IO[bytes]) -> Iterator[tuple[str, bytes]]:
    """Yield topic and content of the messages of an MCAP file.

    If the file is truncated because its writer was killed, only the complete messages are yielded.
    """
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
