"""Trajectories in CSV files: recordings of ``orinkit move --record`` and of streams, and tables of other programs.

=======================================  ==================================================================
header                                   content of the rows
=======================================  ==================================================================
``time_s, J1_command, J2_command, ...``  the commands of a recording; encoders and other columns are ignored
``X_command, Y_command, ...``            the commands of a recording of positions or transformations
``j1, j2, ...``                          joints, degrees
``x, y, z, rx, ry, rz[, fig]``           positions, mm and degrees
``x, y, z, ox, ..., az[, fig]``          homogeneous transformations
none, 6 to 8 columns                     joints, degrees
=======================================  ==================================================================

Names are case-insensitive, named columns may be in any order, and columns with other names are ignored. A column
``time_s``, ``time`` or ``t`` contains the time, s. Values are separated by commas, semicolons, tabs or spaces. Empty
lines and lines that begin with ``#`` are skipped, but the last ``#`` line before the numbers may contain the header.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TextIO

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import FIELDS

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind

TIME: Final = "time_s"
"""Name of the column that contains the time, s."""
COMMAND: Final = "_command"
"""Suffix of the names of columns that contain commands: ``J1_command``, ``X_command``."""
ENCODER: Final = "_encoder"
"""Suffix of the names of columns that contain encoder values: ``J1_encoder``."""
MOST_ROWS: Final = 1_000_000
"""The largest number of rows of a file."""

_TIMES: Final = (TIME, "time", "t")
_JOINT: Final = re.compile(r"j([1-8])")
_KNOWN: Final = {*_TIMES, *map(str.lower, FIELDS["J"]), *FIELDS["P"], *FIELDS["T"]}
_FEWEST_TIMES: Final = 3
_FEWEST_JOINTS: Final = 6  # smallest number of columns of a table without names
_MOST_JOINTS: Final = 8
_UNUSED_JOINT: Final = 7  # a recording omits joint 7 if the only extended joint is joint 8
_LONGEST_LINE: Final = 100_000  # characters
_LONGEST_NAME: Final = 200
_UNEVEN: Final = 0.01  # permitted deviation of times from equal intervals, as a fraction of the period
_ROUNDING: Final = 2e-6  # s: times have six decimals
_LONGEST_PERIOD: Final = 10.0  # s
_SEPARATORS: Final = ";,\t"


class CsvRow(NamedTuple):
    """A row of a table.

    Attributes:
        line: Line number in the file, from 1.
        cells: Texts of the cells.
    """

    line: int
    cells: list[str]


class CsvTable:
    """A CSV file, read row by row.

    Args:
        path: Path of the file.

    Attributes:
        path: Path of the file.
        note: The comment read last, as a single cell, with its line number; ``None`` if there was no comment.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.note: CsvRow | None = None
        self._line = 0
        self._separator: str | None = None

    def rows(self) -> Iterator[CsvRow]:
        """Yield the rows, without empty lines and comments.

        Raises:
            InvalidValue: If the file cannot be read, is not a CSV file, or is too long.
        """
        count = 0
        try:
            with self.path.open(newline="", encoding="utf-8-sig") as file:
                for cells in self._cells(self._lines(file)):
                    if any(map(str.strip, cells)):
                        count += 1
                        if count > MOST_ROWS:
                            raise wrong(self.path, self._line, tr("more than {most} rows", most=MOST_ROWS))  # fmt: skip
                        yield CsvRow(self._line, [cell.strip() for cell in cells])
        except InvalidValue:
            raise
        except (UnicodeDecodeError, csv.Error) as error:
            raise wrong(self.path, 0, tr("not a CSV file in UTF-8 ({error})", error=error)) from None
        except (OSError, ValueError) as error:  # ValueError: the path contains a NUL character
            reason = error.strerror if isinstance(error, OSError) else error
            raise InvalidValue(tr("cannot read {path}: {reason}", path=_named(self.path), reason=reason)) from None

    def _lines(self, file: TextIO) -> Iterator[str]:
        while text := file.readline(_LONGEST_LINE + 1):
            self._line += 1
            if len(text) > _LONGEST_LINE:
                raise wrong(self.path, self._line, tr("not a CSV file: a line is too long"))  # fmt: skip
            content = text.strip()
            if content.startswith("#"):
                self.note = CsvRow(self._line, [content.lstrip("#").strip()])
            elif content:
                yield text

    def _cells(self, lines: Iterator[str]) -> Iterator[list[str]]:
        first = next(lines, "")
        self._separator = next((sign for sign in _SEPARATORS if sign in first), None)
        lines = chain([first], lines)
        if self._separator is None:
            return map(str.split, lines)
        return csv.reader(lines, delimiter=self._separator, skipinitialspace=True, strict=True)

    def noted(self) -> CsvRow | None:
        """Return the comment read last, split into cells at the separator of the rows; ``None`` if there was none."""
        if self.note is None:
            return None
        return CsvRow(self.note.line, [cell.strip() for cell in self.note.cells[0].split(self._separator)])


@dataclass(frozen=True, slots=True)
class _CsvLayout:
    """The columns of a CSV file that contain a trajectory.

    Attributes:
        kind: Pose type of the values.
        columns: For each value, the number of its column, from 0; ``None`` for a value without a column, which is 0 in
            all rows.
        time: Number of the column of the time; ``None`` if there is none.
    """

    kind: PoseKind
    columns: tuple[int | None, ...]
    time: int | None = None


def load_csv(path: Path) -> tuple[PoseKind, float | None, list[tuple[float, ...]]]:
    """Load a trajectory from a file; return its pose type, its period in s, and the rows.

    The period is ``None`` if the file has no times.

    Raises:
        InvalidValue: If the file cannot be read, or is not a trajectory; the message contains the name of the file, and
            the line.
    """
    if path.suffix.lower() == ".mcap":
        raise wrong(path, 0, tr("a trajectory must be a CSV file. Try: record the motion in a .csv file"))  # fmt: skip
    table = CsvTable(path)
    rows = table.rows()
    first = next(rows, None)
    if first is None:
        raise wrong(path, 0, tr("the file is empty"))
    has_names = not all(map(_is_number, first.cells))
    layout = _named_layout(path, first) if has_names else _unnamed_layout(table, first)
    if not has_names:
        rows = chain([first], rows)
    wanted = [column for column in (*layout.columns, layout.time) if column is not None]
    holes = [place for place, column in enumerate(layout.columns) if column is None]
    times: list[float] = []
    lines: list[int] = []
    points: list[tuple[float, ...]] = []
    for row in rows:
        values = numbers(path, row, len(first.cells), wanted)
        if layout.time is not None:
            times.append(values.pop())
            lines.append(row.line)
        for place in holes:
            values.insert(place, 0.0)
        points.append(tuple(values))
    if not points:
        raise wrong(path, first.line, tr("no rows after the header"))
    if not has_names and layout.time is None and layout.kind == "J":
        _refuse_times(path, points)
    return layout.kind, _period(path, times, lines), points


def _refuse_times(path: Path, points: Sequence[tuple[float, ...]]) -> None:
    """Raise InvalidValue if the first of more than six unnamed columns looks like a time, not like J1."""
    first = [point[0] for point in points]
    if len(points[0]) <= _FEWEST_JOINTS or len(first) < _FEWEST_TIMES or first[0] != 0.0:
        return
    step = first[-1] / (len(first) - 1)
    if 0.0 < step <= _LONGEST_PERIOD and all(
        abs(each - step * number) <= _UNEVEN * step for number, each in enumerate(first)
    ):
        raise wrong(
            path,
            1,
            tr(
                "the first of {count} columns without names looks like times at intervals of {step:g} s. Try: a "
                "header line such as time_s,j1,j2,j3,j4,j5,j6",
                count=len(points[0]),
                step=step,
            ),
        )


def numbers(path: Path, row: CsvRow, count: int, columns: Sequence[int]) -> list[float]:
    """Return the numbers in some columns of a row.

    Args:
        path: Path of the file, for error messages.
        row: A row, as :meth:`CsvTable.rows` yields it.
        count: Required number of cells of the row.
        columns: Numbers of the columns to return, from 0.

    Raises:
        InvalidValue: If the number of cells is not ``count``, or a cell in one of the columns is not a finite number.
    """
    if len(row.cells) != count:
        raise wrong(
            path,
            row.line,
            tr("got {count} values, expected {wanted}", count=len(row.cells), wanted=count),
        )
    try:
        values = [float(row.cells[column]) for column in columns]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        place = next(column for column in columns if not _is_finite(row.cells[column]))
        text = f"{row.cells[place]!r:.40}"
        raise wrong(
            path, row.line, tr("column {column}: {text} is not a finite number", column=place + 1, text=text)
        )  # fmt: skip
    return values


def _is_finite(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def wrong(path: Path, line: int, text: str) -> InvalidValue:
    """Return the error for a file that cannot be used.

    Args:
        path: Path of the file.
        line: Line number, 0 if the error concerns the whole file.
        text: The message, translated.
    """
    where = tr(", line {line}", line=line) if line else ""
    return InvalidValue(f"{_named(path)}{where}: {text}")


# --- columns ----------------------------------------------------------------------------------------------------------


def _unnamed_layout(table: CsvTable, first: CsvRow) -> _CsvLayout:
    """Return the layout of rows without a header: as the comment before them specifies, otherwise joints."""
    note = table.noted()
    if note is not None and len(note.cells) == len(first.cells):
        layout = _find(table.path, note)
        if layout is not None:
            return layout
    count = len(first.cells)
    if not _FEWEST_JOINTS <= count <= _MOST_JOINTS:
        raise wrong(
            table.path,
            first.line,
            tr(
                "{count} columns without names; only 6 to 8 can be read as joints. Try: a header line such as "
                "j1,j2,j3,j4,j5,j6 or x,y,z,rx,ry,rz",
                count=count,
            ),
        )
    return _CsvLayout("J", tuple(range(count)))


def _named_layout(path: Path, header: CsvRow) -> _CsvLayout:
    layout = _find(path, header)
    if layout is None:
        raise wrong(
            path,
            header.line,
            tr(
                "the header contains no columns of a trajectory. Try: the columns j1,j2,j3,j4,j5,j6 or "
                "x,y,z,rx,ry,rz, or a file written by orinkit move --record"
            ),
        )
    return layout


def _find(path: Path, header: CsvRow) -> _CsvLayout | None:
    names = [name.lower() for name in header.cells]
    known = [name for name in names if name.removesuffix(COMMAND) in _KNOWN]
    if len(set(known)) < len(known):
        raise wrong(path, header.line, tr("two columns have the same name"))
    places = {name: column for column, name in enumerate(names) if name}
    time = next((places[name] for name in _TIMES if name in places), None)
    for suffix in (COMMAND, ""):
        found = {name.removesuffix(suffix): column for name, column in places.items() if name.endswith(suffix)}
        joints = {int(match[1]): column for name, column in found.items() if (match := _JOINT.fullmatch(name))}
        space = all(name in found for name in "xyz")
        if joints and space:
            raise wrong(path, header.line, tr("the file has both joints and positions. Try: remove one of them"))  # fmt: skip
        if joints:
            return _CsvLayout("J", _joint_columns(path, header.line, joints), time)
        if space:
            return _in_space(path, header.line, found, time)
    return None


def _joint_columns(path: Path, line: int, joints: dict[int, int]) -> tuple[int | None, ...]:
    for joint in range(1, max(joints)):
        if joint not in joints and joint != _UNUSED_JOINT:
            raise wrong(path, line, tr("column J{joint} is missing", joint=joint))
    return tuple(joints.get(joint) for joint in range(1, max(joints) + 1))


def _in_space(path: Path, line: int, found: dict[str, int], time: int | None) -> _CsvLayout:
    kind: PoseKind = "T" if "ox" in found else "P"
    *needed, figure = FIELDS[kind]
    missing = [name for name in needed if name not in found]
    if missing:
        names = ", ".join(missing)
        raise wrong(path, line, tr("columns are missing: {names}", names=names))
    columns = [found[name] for name in needed]
    return _CsvLayout(kind, tuple([*columns, found[figure]] if figure in found else columns), time)


def _period(path: Path, times: Sequence[float], lines: Sequence[int]) -> float | None:
    if len(times) < 2:
        return None
    mean = (times[-1] - times[0]) / (len(times) - 1)
    allowed = max(_UNEVEN * mean, _ROUNDING)
    for place in range(1, len(times)):
        step = times[place] - times[place - 1]
        if not (step > 0.0 and abs(step - mean) <= allowed and mean <= _LONGEST_PERIOD):
            raise wrong(
                path,
                lines[place],
                tr(
                    "the interval to the row before is {step:g} s, the average is {mean:g} s; intervals must be "
                    "equal (within 1 %) and at most {longest:g} s. Try: remove the column of the "
                    "times",
                    step=step,
                    mean=mean,
                    longest=_LONGEST_PERIOD,
                ),
            )
    rounded = round(mean, 6)
    return rounded if abs(rounded - mean) * (len(times) - 1) <= _ROUNDING else mean


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _named(path: Path) -> str:
    text = str(path)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= _LONGEST_NAME else f"{text[:_LONGEST_NAME]}..."
