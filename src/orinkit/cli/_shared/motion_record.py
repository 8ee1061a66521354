"""Recorded motions: read from the control log of the controller, written to and read from CSV files.

The file has a row for every 8 ms: ``time_s``, then ``J1_command``, ``J2_command`` ... and ``J1_encoder`` ... in degrees
(mm for linear joints).
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import orinkit
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.errors import InvalidValue, TransportError
from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.csv_file import COMMAND, ENCODER, TIME, CsvRow, CsvTable, numbers, wrong

PERIOD: Final = 0.008
"""Seconds between two records (RC8 4.1)."""

_AXES: Final = 8
_ALWAYS: Final = 6  # number of joints that are recorded even if they stay at 0
_COLUMNS: Final = 4  # values of each joint in a record: command, encoder, current, load


@dataclass(frozen=True, slots=True)
class MotionRecording:
    """Commanded and measured joint positions over time.

    Attributes:
        times: Times in seconds, increasing.
        joints: Numbers of the joints, from 1.
        command: For each time, the command of each joint in degrees or mm.
        encoder: For each time, the encoder value of each joint in degrees or mm; empty if there are none.
    """

    times: Sequence[float]
    joints: Sequence[int]
    command: Sequence[Sequence[float]]
    encoder: Sequence[Sequence[float]]


class ControlLogRecorder:
    """Records a motion in the control log of the controller, and writes it to a file when the ``with`` statement ends.

    The file is also written if an exception ends the ``with`` statement.

    Args:
        robot: The robot that moves.
        path: File to write.
        progress: Called with the number of records read and the total number.
    """

    def __init__(self, robot: orinkit.Robot, path: Path, progress: Callable[[int, int], None]) -> None:
        self._robot = robot
        self._path = path
        self._progress = progress
        self._running = False
        self._started = False

    def __enter__(self) -> Self:
        check_directory(self._path)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._started:
            return
        try:
            self.stop()
            write_csv(self._path, self._fetch())
        except TransportError:
            if error is None:
                raise

    def start(self) -> None:
        """Clear the log and start recording."""
        self._robot.execute("ClearLog")
        self._robot.execute("StartLog")
        self._running = self._started = True

    def stop(self) -> None:
        """Stop recording; further calls have no effect."""
        if self._running:
            self._running = False
            self._robot.execute("StopLog")

    def _fetch(self) -> MotionRecording:
        count = _whole(self._robot.execute("GetLogCount"))
        records = []
        for index in range(count):
            records.append(command_and_encoder(self._robot.execute("GetLogRecord", index)))
            self._progress(index + 1, count)
        return recording_of(records)


def check_directory(path: Path) -> None:
    """Check, before anything moves, that the directory of a file exists.

    Raises:
        CommandError: If the directory does not exist.
    """
    if not path.parent.is_dir():
        raise usage_error(tr("the directory {path} does not exist", path=path.parent))


def recording_of(records: Sequence[tuple[Sequence[float], Sequence[float]]]) -> MotionRecording:
    """Return a recording from pairs of command and encoder, 8 joints each; omit joint 7 or 8 if it is always 0."""
    used = [
        axis
        for axis in range(_AXES)
        if axis < _ALWAYS or any(command[axis] or encoder[axis] for command, encoder in records)
    ]
    return MotionRecording(
        [index * PERIOD for index in range(len(records))],
        [axis + 1 for axis in used],
        [[command[axis] for axis in used] for command, _ in records],
        [[encoder[axis] for axis in used] for _, encoder in records],
    )


def write_csv(path: Path, recording: MotionRecording) -> None:
    """Write a recording.

    Raises:
        CommandError: If the file cannot be written.
    """
    names = [f"J{joint}" for joint in recording.joints]
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([TIME, *(f"{name}{COMMAND}" for name in names), *(f"{name}{ENCODER}" for name in names)])
            for time, command, encoder in zip(recording.times, recording.command, recording.encoder, strict=True):
                writer.writerow([f"{time:.3f}", *(f"{value:.6f}" for value in (*command, *encoder))])
    except OSError as error:
        raise CommandError(tr("cannot write {path}: {reason}", path=path, reason=error.strerror)) from None


def read_csv(path: Path) -> MotionRecording:
    """Read a recording.

    Raises:
        CommandError: If the file cannot be read, or is not a recording.
    """
    try:
        return _read(path)
    except InvalidValue as error:
        raise CommandError(str(error), 2) from None


def _read(path: Path) -> MotionRecording:
    rows = CsvTable(path).rows()
    header = next(rows, CsvRow(1, []))
    names = header.cells
    commands, encoders = _columns(names, COMMAND), _columns(names, ENCODER)
    if TIME not in names or not commands or len(set(names)) < len(names):
        columns = f"{TIME}, J1{COMMAND}, J2{COMMAND}, ..."
        raise wrong(path, header.line, tr("the columns {columns} are required", columns=columns))
    if encoders and encoders.keys() != commands.keys():
        raise wrong(
            path,
            header.line,
            tr("the _command and _encoder columns have different joints"),
        )
    wanted_columns = [names.index(TIME), *commands.values(), *encoders.values()]
    values = [numbers(path, row, len(names), wanted_columns) for row in rows]
    times = [row[0] for row in values]
    if len(times) < 2:
        raise wrong(
            path,
            0,
            tr("{count} rows; at least 2 are required: the arm did not move", count=len(times)),
        )
    if any(after <= before for before, after in pairwise(times)):
        raise wrong(path, 0, tr("the times must be increasing"))
    joints = list(commands)
    return MotionRecording(
        times,
        joints,
        [row[1 : len(joints) + 1] for row in values],
        [row[len(joints) + 1 :] for row in values] if encoders else [],
    )


def _columns(header: Sequence[str], suffix: str) -> dict[int, int]:
    """Return the index of each column ``J<number><suffix>`` in the header, by joint number, in ascending order."""
    return {joint: header.index(name) for joint in range(1, _AXES + 1) if (name := f"J{joint}{suffix}") in header}


def command_and_encoder(record: Any) -> tuple[list[float], list[float]]:
    """Return the commands and encoder values of a record of the control log (RC8 provider guide, GetLogRecord)."""
    values = record[: _AXES * _COLUMNS] if isinstance(record, list) else []
    if len(values) < _AXES * _COLUMNS or not all(isinstance(value, int | float) for value in values):
        raise _unexpected_reply("GetLogRecord", record)
    return values[0::_COLUMNS], values[1::_COLUMNS]


def _whole(answer: Any) -> int:
    if not isinstance(answer, int):
        raise _unexpected_reply("GetLogCount", answer)
    return answer


def _unexpected_reply(command: str, answer: Any) -> CommandError:
    return CommandError(tr("unexpected reply to {command}: {answer!r:.80}", command=command, answer=answer))
