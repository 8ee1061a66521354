"""Non-blocking log output on stderr.

A program that serves a robot must continue even if its stderr is not read. If stderr is a pipe, it is full after 64
KiB. The next write then blocks and, with it, the event loop, the motions and the emergency stop. Use :func:`to_stderr`
instead of :func:`logging.basicConfig`::

    from orinkit import serve
    from orinkit.core import logs

    logs.to_stderr()
    with serve(MyDevice()) as server:
        server.wait()

``orinkit serve`` and ``orinkit gateway`` also use :func:`to_stderr`.
"""

from __future__ import annotations

import copy
import logging
import sys
from typing import Any, Final, TextIO

from orinkit.core.background_writer import BackgroundWriter
from orinkit.core.i18n import tr, visible

LONGEST: Final = 8192
"""Maximum number of characters of a record. The middle of a longer record, such as a deep traceback, is omitted."""
FORMAT: Final = "%(asctime)s %(levelname)s %(name)s: %(message)s"
"""Format of the records that :func:`to_stderr` writes."""

_LONGEST_ARGUMENT: Final = 2048
_CLOSE_TIMEOUT: Final = 1.0  # s


class BoundedQueueHandler(logging.Handler):
    """Writes records from its own thread; the queue holds at most 1,000 records.

    If the queue is full, further records are dropped; their number is logged as soon as the queue has room again.
    Control characters are escaped, so that a record cannot control the terminal that displays it. :meth:`close` and the
    end of the program wait up to 1 s for queued records.

    Args:
        stream: Output stream, stderr by default. A stream without a file descriptor, such as ``io.StringIO``, is
            written to synchronously.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        super().__init__()
        self._writer = BackgroundWriter(sys.stderr if stream is None else stream, _notice)

    @property
    def dropped(self) -> int:
        """The number of dropped records."""
        return self._writer.dropped

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record for writing; return immediately."""
        try:
            text = self.format(_bounded(record))
        except Exception as error:  # noqa: BLE001 - logging would write it to stderr directly
            text = f"{record.name}: {record.msg!s:.200}: {type(error).__name__}"
        if len(text) > LONGEST:
            text = f"{text[: LONGEST // 2]}\n...\n{text[-LONGEST // 2 :]}"
        self._writer.write("\n".join(map(visible, text.split("\n"))) + "\n")

    def close(self) -> None:
        """Wait up to 1 s for queued records, then stop writing."""
        self._writer.close(_CLOSE_TIMEOUT)
        super().close()


def to_stderr(level: int = logging.INFO) -> None:
    """Write the program's log to stderr through a :class:`BoundedQueueHandler`, unless the root logger has a handler.

    Args:
        level: Minimum level of the records.
    """
    root = logging.getLogger()
    if root.handlers:
        return
    handler = BoundedQueueHandler()
    handler.setFormatter(logging.Formatter(FORMAT))
    root.addHandler(handler)
    root.setLevel(level)


def _notice(count: int) -> str:
    return tr("orinkit: {count:,} log records were dropped because stderr was not read fast enough\n", count=count)


def _bounded(record: logging.LogRecord) -> logging.LogRecord:
    """Return a record whose text arguments are shortened, because formatting megabytes of text takes seconds."""
    original = record.args
    arguments = original if isinstance(original, tuple) else ()
    if not any(type(each) is str and len(each) > _LONGEST_ARGUMENT for each in arguments):
        return record
    bounded = copy.copy(record)
    bounded.args = tuple(map(_cut, arguments))
    return bounded


def _cut(argument: Any) -> Any:
    return argument[:_LONGEST_ARGUMENT] if type(argument) is str else argument
