"""Frames from logs: what candump prints, and the files that python-can reads."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Final, TextIO

from orinkit.can_frame import MAX_DATA, MAX_ID, CanFrame
from orinkit.cli._errors import Failure, unusable
from orinkit.extra import require
from orinkit.language import pick

_OF_CANDUMP: Final = ("", ".log", ".txt", ".candump")
_LONGEST_LINE: Final = 4096
_SHOWN: Final = 60
_EXTENDED: Final = 8  # hex digits; a standard identifier has 3
# (time) can0 00EF0201#B6FF0000DBFFDBFF of -L; (time) can0  00EF0201   [8]  B6 FF ... of the others; time and name may be missing
_LINE: Final = re.compile(
    r"""\s*(?:\((?P<time>[^()]*)\)\s+)?
    (?:(?![0-9A-Fa-f]+(?:\#|\s+\[))(?P<bus>\S+)\s+)?(?:[RT]X\s+\S\s+\S\s+)?
    (?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})
    (?:\#(?P<packed>(?:[0-9A-Fa-f]{2})*|\#\S*|R\d?)(?:\s.*)?
      |\s+\[\s*(?P<length>\d+)\](?P<spaced>(?:\s+[0-9A-Fa-f]{2}(?!\S))*)(?P<rest>.*))\s*""",
    re.VERBOSE | re.DOTALL,
)


class Log:
    """The frames of a log, one by one.

    Args:
        name: of the file; ``-`` for lines of candump from stdin.

    Attributes:
        passed_over: frames that are no extended data frames of at most 8 bytes.
        wrong: lines that are no frames.
        first_wrong: the first of them: its number, from 1, and its text.

    Raises:
        Failure: the file cannot be read.
        MissingExtra: it needs python-can, which is not installed.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._suffix = Path(name).suffix.lower()
        self.passed_over = 0
        self.wrong = 0
        self.first_wrong = (0, "")
        if name != "-" and not Path(name).is_file():
            raise unusable(f"{name}: there is no such file", f"{name}: ファイルがありません")

    def __iter__(self) -> Iterator[CanFrame]:
        if self._name == "-":
            if hasattr(sys.stdin, "reconfigure"):
                sys.stdin.reconfigure(errors="replace")
            return self._lines(sys.stdin)
        return self._candump() if self._suffix in _OF_CANDUMP else self._messages()

    def check(self) -> None:
        """Tell whether all could be read.

        Raises:
            Failure: there were lines that are no frames.
        """
        if self.wrong:
            number, text = self.first_wrong
            raise Failure(
                pick(
                    f"{self.wrong} lines are no frames of candump; the first is line {number}: {text!r}",
                    f"candump のフレームではない行が {self.wrong} 行あります。最初は {number} 行目: {text!r}",
                )
            )

    # --- candump ------------------------------------------------------------------------------------------------------

    def _candump(self) -> Iterator[CanFrame]:
        try:
            with Path(self._name).open(encoding="utf-8", errors="replace") as file:
                yield from self._lines(file)
        except OSError as error:
            raise Failure(f"{self._name}: {error}", 2) from None

    def _lines(self, file: TextIO) -> Iterator[CanFrame]:
        number = 0
        while line := file.readline(_LONGEST_LINE):
            number += 1
            if not line.strip():
                continue
            try:
                frame = read_line(line)
            except ValueError:
                self.wrong += 1
                if self.wrong == 1:
                    self.first_wrong = (number, line.strip()[:_SHOWN])
                continue
            if frame is None:
                self.passed_over += 1
            else:
                yield frame

    # --- files of python-can ------------------------------------------------------------------------------------------

    def _messages(self) -> Iterator[CanFrame]:
        require((f"Logs as {self._suffix}", f"{self._suffix} のログ"), "can", "can")
        import can

        from orinkit.transport.can_bus import to_frame

        try:
            with can.LogReader(self._name) as reader:
                for message in reader:
                    frame = to_frame(message)
                    if frame is None:
                        self.passed_over += 1
                    else:
                        yield frame
        except GeneratorExit:
            raise
        except Exception as error:  # noqa: BLE001 - readers raise whatever a damaged file makes of them
            reason = str(error) or type(error).__name__
            raise unusable(
                f"{self._name}: it cannot be read ({reason}). Known: what candump prints (.log), .asc, .blf, .csv, .trc",
                f"{self._name}: 読み込めません ({reason})。対応形式: candump の出力 (.log)、.asc、.blf、.csv、.trc",
            ) from None


def read_line(line: str) -> CanFrame | None:
    """Read a line of candump; ``None`` of a frame that is no extended data frame of at most 8 bytes.

    Raises:
        ValueError: it is no frame.
    """
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(line)
    packed, number = match["packed"], int(match["id"], 16)
    if packed is None:
        data = bytes.fromhex(match["spaced"])[: int(match["length"])]
        other = "remote request" in match["rest"] or "ERRORFRAME" in match["rest"]
        if not other and len(data) < int(match["length"]):
            raise ValueError(line)
    else:
        other = packed[:1] in ("#", "R")
        data = b"" if other else bytes.fromhex(packed)
    if other or len(match["id"]) < _EXTENDED or number > MAX_ID or len(data) > MAX_DATA:
        return None
    return CanFrame(number, data, _time(match["time"]))


def _time(text: str | None) -> float:
    """Return the seconds that candump writes, or those of its date and time since 1970; 0 without any.

    Raises:
        ValueError: it is neither.
    """
    if text is None:
        return 0.0
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return datetime.fromisoformat(text.strip()).timestamp()
    except (OverflowError, OSError) as error:  # a year that this system has no seconds of
        raise ValueError(text) from error
