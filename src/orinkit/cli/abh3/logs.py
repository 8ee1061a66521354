"""Frames from logs: output of candump and ``python -m can.logger``, and log files that python-can supports."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from orinkit.can.frame import MAX_DATA, MAX_ID, CanFrame
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

if TYPE_CHECKING:
    import can

_OF_CANDUMP: Final = ("", ".log", ".txt", ".candump")
_LONGEST_LINE: Final = 4096
_SHOWN: Final = 60
_EXTENDED: Final = 8  # hex digits of an extended identifier; a standard identifier has 3
# candump -L prints (time) can0 00EF0201#B6FF0000DBFFDBFF, candump alone prints (time) can0  00EF0201   [8]  B6 FF ...;
# the time and the name of the bus are optional
_LINE: Final = re.compile(
    r"""\s*(?:\((?P<time>[^()]*)\)\s+)?
    (?:(?![0-9A-Fa-f]+(?:\#|\s+\[))(?P<bus>\S+)\s+)?(?:[RT]X\s+\S\s+\S\s+)?
    (?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})
    (?:\#(?P<packed>(?:[0-9A-Fa-f]{2})*|\#\S*|R\d?)(?:\s.*)?
      |\s+\[\s*(?P<length>\d+)\](?P<spaced>(?:\s+[0-9A-Fa-f]{2}(?!\S))*)(?P<rest>.*))\s*""",
    re.VERBOSE | re.DOTALL,
)
# can.logger prints Timestamp: 123.400000    ID: 00ef0102    X Rx                DL:  8    00 00 ...    Channel: can0
_OF_LOGGER: Final = re.compile(
    r"""\s*Timestamp:\s*(?P<time>\S+)\s+ID:\s*(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})
    \s+[SX]\s+[RT]x(?P<kind>(?:\s+(?:E|R|F|BS|EI))*)
    \s+DL:\s*(?P<length>\d+)(?P<data>(?:\s+[0-9A-Fa-f]{2}(?!\S))*)(?:\s.*)?""",
    re.VERBOSE | re.DOTALL,
)
_HEAD: Final = ("Connected to ", "Can Logger (Started on ")  # beginnings of the first lines of can.logger


class FrameLog:
    """The frames of a log, one by one.

    Args:
        name: Name of the file, which may be a pipe; ``-`` for lines of candump from stdin.

    Attributes:
        skipped: Number of frames that are not extended data frames of at most 8 bytes.
        wrong: Number of lines that are not frames.
        first_wrong: Number (from 1) and text of the first line that is not a frame; ``(0, "")`` if there is none.

    Iteration raises CommandError if the file cannot be read, and MissingExtra if python-can is required to read the
    file and is not installed.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._suffix = Path(name).suffix.lower()
        self.skipped = 0
        self.wrong = 0
        self.first_wrong = (0, "")

    def __iter__(self) -> Iterator[CanFrame]:
        if self._name == "-":
            return self._stdin()
        return self._candump() if self._suffix in _OF_CANDUMP else self._messages()

    def raise_for_errors(self) -> None:
        """Check that all lines could be read.

        Raises:
            CommandError: If there were lines that are not frames.
        """
        if self.wrong:
            number, text = self.first_wrong
            raise CommandError(
                tr(
                    "{count} lines are not frames in the format of candump or can.logger; the first is line "
                    "{number}: {text!r}",
                    count=self.wrong,
                    number=number,
                    text=text,
                )
            )

    # --- candump ------------------------------------------------------------------------------------------------------

    def _stdin(self) -> Iterator[CanFrame]:
        if sys.stdin is None:  # None if the shell has closed it (<&-)
            raise usage_error(tr("-: stdin is closed"))
        if hasattr(sys.stdin, "reconfigure"):
            sys.stdin.reconfigure(errors="replace")
        yield from self._lines(sys.stdin)

    def _candump(self) -> Iterator[CanFrame]:
        try:
            file = Path(self._name).open(encoding="utf-8", errors="replace")  # noqa: SIM115 - closed below
        except (OSError, ValueError) as error:
            raise _unreadable(self._name, error) from None
        with file:
            yield from self._lines(file)

    def _lines(self, file: TextIO) -> Iterator[CanFrame]:
        number = 0
        while line := self._line(file):
            number += 1
            if not line.strip() or line.startswith(_HEAD):
                continue
            try:
                frame = read_line(line)
            except ValueError:
                self.wrong += 1
                if self.wrong == 1:
                    self.first_wrong = (number, line.strip()[:_SHOWN])
                continue
            if frame is None:
                self.skipped += 1
            else:
                yield frame

    def _line(self, file: TextIO) -> str:
        """Read a line. Only errors of reading are caught, not those of the code that processes the frames."""
        try:
            return file.readline(_LONGEST_LINE)
        except (OSError, ValueError) as error:
            raise _unreadable(self._name, error) from None

    # --- files of python-can ------------------------------------------------------------------------------------------

    def _messages(self) -> Iterator[CanFrame]:
        require(tr("reading {suffix} logs", suffix=self._suffix), "can", "can")
        import can
        from orinkit.can.bus import to_frame

        with ExitStack() as opened:
            try:
                messages = iter(opened.enter_context(can.LogReader(self._name)))
            except Exception as error:  # noqa: BLE001 - readers may raise anything for a damaged file
                raise _unreadable(self._name, error) from None
            while (message := self._message(messages)) is not None:
                frame = to_frame(message)
                if frame is None:
                    self.skipped += 1
                else:
                    yield frame

    def _message(self, messages: Iterator[can.Message]) -> can.Message | None:
        try:
            return next(messages, None)
        except Exception as error:  # noqa: BLE001 - as above
            raise _unreadable(self._name, error) from None


def _unreadable(name: str, error: Exception) -> CommandError:
    """Return the exception for a file that cannot be opened, or that is not a log."""
    if isinstance(error, FileNotFoundError):
        return usage_error(tr("{name}: no such file", name=name))
    if isinstance(error, IsADirectoryError):
        return usage_error(tr("{name}: is a directory", name=name))
    if isinstance(error, OSError) and error.strerror:
        return usage_error(tr("{name}: cannot be read: {reason}", name=name, reason=error.strerror))
    reason = str(error) or type(error).__name__
    return usage_error(
        tr(
            "{name}: cannot be read ({reason}). Supported: output of candump (.log), .asc, .blf, .csv, .trc",
            name=name,
            reason=reason,
        ),
    )


def read_line(line: str) -> CanFrame | None:
    """Parse a line of candump or can.logger; return ``None`` if it is not an extended data frame of at most 8 bytes.

    Raises:
        ValueError: If the line is not a frame.
    """
    match = _LINE.fullmatch(line)
    if match is None:
        match = _OF_LOGGER.fullmatch(line)
        if match is None:
            raise ValueError(line)
        other, data = bool(match["kind"].split()), _counted(match["data"], match["length"])
    elif match["packed"] is None:
        other = "remote request" in match["rest"] or "ERRORFRAME" in match["rest"]
        data = _counted(match["spaced"], match["length"])
    else:
        other = match["packed"][:1] in ("#", "R")
        data = b"" if other else bytes.fromhex(match["packed"])
    if not other and data is None:
        raise ValueError(line)
    number = int(match["id"], 16)
    if other or data is None or len(match["id"]) < _EXTENDED or number > MAX_ID or len(data) > MAX_DATA:
        return None
    return CanFrame(number, data, _time(match["time"]))


def _counted(spaced: str, length: str) -> bytes | None:
    """Return the first ``length`` bytes of a text in hex; ``None`` if it has fewer bytes."""
    data = bytes.fromhex(spaced)
    return data[: int(length)] if len(data) >= int(length) else None


def _time(text: str | None) -> float:
    """Return a time of candump in s; 0 if the time is missing.

    A number is returned unchanged. A date and time are converted to seconds since 1970.

    Raises:
        ValueError: If the text is not a valid time.
    """
    if text is None:
        return 0.0
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return datetime.fromisoformat(text.strip()).timestamp()
    except (OverflowError, OSError) as error:  # a year out of the range of this system
        raise ValueError(text) from error
