"""Log records on stderr, without ever waiting for whoever reads them.

A program that serves a robot must go on when nobody reads its stderr: a pipe holds 64 KiB, then a write waits, and with it
the event loop, the motions and the emergency stop. :func:`to_stderr` takes the place of :func:`logging.basicConfig`::

    from orinkit import serve
    from orinkit.core import logs

    logs.to_stderr()
    with serve(MyDevice()) as server:
        server.wait()

``orinkit serve`` and ``orinkit gateway`` log this way.
"""

from __future__ import annotations

import copy
import logging
import sys
from typing import Any, Final, TextIO

from orinkit.core.background_writer import BackgroundWriter
from orinkit.core.i18n import tr, visible

LONGEST: Final = 8192
"""Characters of a record; of a longer one, such as a deep traceback, the middle is left out."""
FORMAT: Final = "%(asctime)s %(levelname)s %(name)s: %(message)s"
"""How :func:`to_stderr` writes a record."""

_LONGEST_ARGUMENT: Final = 2048
_AT_THE_END: Final = 1.0  # s that what has not been written gets when the program ends


class BoundedQueueHandler(logging.Handler):
    """Writes records from a thread of its own; at most 1,000 of them wait.

    Those that find no room are dropped. How many is written as soon as there is room again. Control characters are written
    as escapes, so that a record cannot steer the terminal that it is shown on. At the end of the program, or in
    :meth:`close`, the records that wait get one second.

    Args:
        stream: where to write; stderr by default. One without a file descriptor, as ``io.StringIO``, is written to at once.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        super().__init__()
        self._outlet = BackgroundWriter(sys.stderr if stream is None else stream, _notice)

    @property
    def dropped(self) -> int:
        """How many records have been dropped so far."""
        return self._outlet.dropped

    def emit(self, record: logging.LogRecord) -> None:
        """Have a record written; returns at once."""
        try:
            text = self.format(_bounded(record))
        except Exception as error:  # noqa: BLE001 - as logging does, but without its own way to stderr
            text = f"{record.name}: {record.msg!s:.200}: {type(error).__name__}"
        if len(text) > LONGEST:
            text = f"{text[: LONGEST // 2]}\n...\n{text[-LONGEST // 2 :]}"
        self._outlet.write("\n".join(map(visible, text.split("\n"))) + "\n")

    def close(self) -> None:
        """Give the records that wait one second, then write no more."""
        self._outlet.close(_AT_THE_END)
        super().close()


def to_stderr(level: int = logging.INFO) -> None:
    """Have the program's log written to stderr by a :class:`BoundedQueueHandler`, unless it has a handler already.

    Args:
        level: of the records that are written.
    """
    root = logging.getLogger()
    if root.handlers:
        return
    handler = BoundedQueueHandler()
    handler.setFormatter(logging.Formatter(FORMAT))
    root.addHandler(handler)
    root.setLevel(level)


def _notice(count: int) -> str:
    return tr("orinkit: {count:,} log records were dropped, as stderr was not read fast enough\n", count=count)


def _bounded(record: logging.LogRecord) -> logging.LogRecord:
    """Return a record whose texts are short enough to be formatted."""
    given = record.args
    arguments = given if isinstance(given, tuple) else ()
    if not any(type(each) is str and len(each) > _LONGEST_ARGUMENT for each in arguments):
        return record
    bounded = copy.copy(record)
    bounded.args = tuple(map(_cut, arguments))
    return bounded


def _cut(argument: Any) -> Any:
    return argument[:_LONGEST_ARGUMENT] if type(argument) is str else argument
