"""Control logs of other programs, for example of WINCAPS: CSV files whose columns the user chooses.

The documents of DENSO describe neither the names nor the order of the columns. :meth:`ControlLog.guess` proposes the
columns of the command values; lines before the header are ignored. The encoding is UTF-8, UTF-16 or Shift_JIS.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.csv_file import MOST_ROWS, CsvRow, numbers, wrong

INTERVAL: Final = 0.008
"""Interval of a log without times, s: the shortest one of a controller."""
LARGEST_FILE: Final = 64 * 1024 * 1024
"""The largest size of a file, bytes."""

_SEPARATORS: Final = (",", "\t", ";")
_MOST_JOINTS: Final = 8
_FEWEST_JOINTS: Final = 6
_MOST_COLUMNS: Final = 1000
_HEADER_LINES: Final = 200  # lines in which the first row of numbers is searched
_JOINT: Final = re.compile(
    r"(?:^|[^A-Z0-9])(?:J|JNT|JOINT|AXIS|軸|関節|第)[\s_\[(#.-]*([1-8])(?!\d)|(?<!\d)([1-8])\s*軸"
)
_COMMAND: Final = re.compile(r"CMD|COMMAND|指令|REF|TARGET|DEST|目標")
_OTHER: Final = re.compile(r"ENC|ACT|CUR|FEEDBACK|FB|現在|実|エンコーダ|DEV|偏差|TORQUE|トルク|電流|VEL|SPEED|速度")
_TIME: Final = re.compile(r"^\W*(?:T|TIME|TIME_S|時間|時刻)\b|^TIME|^時間|^時刻")


@dataclass(frozen=True, slots=True)
class LogColumns:
    """The chosen columns of a control log, numbered from 0.

    Attributes:
        joints: For each joint, the column of its command; ``None`` for a joint that stays at 0.
        time: Column of the time; ``None`` for a fixed interval.
        time_unit: Unit of the time column in s.
        interval: Interval in s if there is no time column.
    """

    joints: tuple[int | None, ...]
    time: int | None = None
    time_unit: float = 1.0
    interval: float = INTERVAL


class ControlLog:
    """A control log.

    Attributes:
        path: Path of the file.
        names: Names of the columns.
        rows: The rows of numbers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = _text(path).splitlines()
        separator, first = _first_row(path, lines)
        before = [cells for cells in csv.reader(lines[:first], delimiter=separator) if any(map(str.strip, cells))]
        data = csv.reader(lines[first:], delimiter=separator)
        self.rows: list[CsvRow] = []
        try:
            for cells in data:
                if any(map(str.strip, cells)):
                    self.rows.append(CsvRow(first + data.line_num, [cell.strip() for cell in cells]))
                if len(self.rows) > MOST_ROWS:
                    raise wrong(path, first + data.line_num, tr("more than {most} rows", most=MOST_ROWS))
        except csv.Error as error:
            raise wrong(path, first + data.line_num, str(error)) from None
        count = len(self.rows[0].cells)
        header = next((cells for cells in reversed(before) if len(cells) == count), [])
        self.names = tuple(
            name.strip() or tr("column {column}", column=place + 1) for place, name in enumerate(header or [""] * count)
        )

    def guess(self) -> LogColumns:
        """Return the columns that probably contain the commands and the time; joints without a column are ``None``."""
        names = [name.upper() for name in self.names]
        joints: list[int | None] = [None] * _MOST_JOINTS
        for wanted in (lambda name: _COMMAND.search(name), lambda name: not _OTHER.search(name)):
            if any(column is not None for column in joints):
                break
            for column, name in enumerate(names):
                match = _JOINT.search(name)
                if match and wanted(name):
                    joint = int(match[1] or match[2]) - 1
                    joints[joint] = column if joints[joint] is None else joints[joint]
        used = max((joint + 1 for joint, column in enumerate(joints) if column is not None), default=0)
        time = next((column for column, name in enumerate(names) if _TIME.search(name)), None)
        milli = time is not None and ("MS" in names[time] or "ミリ" in names[time])
        return LogColumns(tuple(joints[: max(used, _FEWEST_JOINTS)]), time, 0.001 if milli else 1.0)

    def points(self, columns: LogColumns) -> tuple[list[tuple[float, ...]], float]:
        """Return the joint positions and their interval in s.

        Raises:
            InvalidValue: If a joint of the first six has no column, or a value is not a number; the message contains
                the line.
        """
        for joint, column in enumerate(columns.joints[:_FEWEST_JOINTS], start=1):
            if column is None:
                raise InvalidValue(tr("J{joint}: choose the column of its command values", joint=joint))
        if not 0.0005 <= columns.interval <= 1.0:
            raise InvalidValue(tr("the interval must be 0.5 to 1000 ms"))
        wanted = [column for column in columns.joints if column is not None]
        count = len(self.names)
        points: list[tuple[float, ...]] = []
        for row in self.rows:
            values = iter(numbers(self.path, row, count, wanted))
            points.append(tuple(0.0 if column is None else next(values) for column in columns.joints))
        return points, self._interval(columns)

    def _interval(self, columns: LogColumns) -> float:
        if columns.time is None or len(self.rows) < 2:
            return columns.interval
        count = len(self.names)
        first, last = (numbers(self.path, self.rows[place], count, [columns.time])[0] for place in (0, -1))
        mean = (last - first) / (len(self.rows) - 1) * columns.time_unit
        if not 0.0005 <= mean <= 1.0:
            raise InvalidValue(
                tr(
                    "the times increase by {mean:g} s per row, but 0.0005 s to 1 s are required. Try: another unit or "
                    "column of the time",
                    mean=mean,
                )
            )
        return mean


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise wrong(path, 0, tr("the file is larger than {most} MB", most=LARGEST_FILE // 2**20))
        data = path.read_bytes()
    except OSError as error:
        raise InvalidValue(tr("cannot read {path}: {reason}", path=path, reason=error.strerror)) from None
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings: tuple[str, ...] = ("utf-16",)
    else:
        encodings = ("utf-8-sig", "cp932")
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise wrong(path, 0, tr("not a text file in UTF-8, UTF-16 or Shift_JIS"))


def _first_row(path: Path, lines: Sequence[str]) -> tuple[str, int]:
    """Return the separator and the index of the first row that contains numbers for at least six joints."""
    for index, text in enumerate(lines[:_HEADER_LINES]):
        for separator in _SEPARATORS:
            cells = text.split(separator)
            if sum(map(_is_number, cells)) >= _FEWEST_JOINTS and len(cells) <= _MOST_COLUMNS:
                return separator, index
    raise wrong(
        path, 0, tr("no row with six or more numbers was found. Try: a CSV file with a column for each joint")
    )  # fmt: skip


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
