"""Non-blocking output: a program that controls a robot or motor must not block if the reader of its output is slow."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable
from threading import Condition, Thread
from typing import Final, TextIO

_MAX_QUEUED: Final = 1000  # texts
_PATIENCE: Final = 1.0  # s without progress after which close() stops waiting for the reader


class BackgroundWriter:
    """Writes texts to a stream from its own thread. If the queue is full, further texts are dropped and counted.

    It can replace a file for callers that use only ``write`` and ``flush``. A stream without a file descriptor, for
    example ``io.StringIO``, is written to synchronously.

    Args:
        stream: stdout or stderr; ``None`` if it is closed, in which case nothing is written.
        notice: Function that receives the number of dropped texts and returns a notice, which is written as soon as the
            queue has room again. Without this function, no notice is written.

    Attributes:
        dropped: Number of dropped texts.
        error: Error that ended the writing, or ``None``.
    """

    def __init__(self, stream: TextIO | None, notice: Callable[[int], str] | None = None) -> None:
        self.dropped = 0
        self._notice = notice
        self._unreported = 0  # dropped texts since the last notice
        self.error: OSError | None = None
        self._stream = stream
        self._texts: deque[str] = deque()
        self._changed = Condition()
        self._written = 0
        self._ended = False
        self._thread: Thread | None = None
        copy = None if stream is None else _copy_of(stream)
        if copy is not None:
            self._thread = Thread(target=self._work, args=(copy,), name="orinkit-outlet", daemon=True)
            self._thread.start()

    @property
    def encoding(self) -> str:
        """The encoding of the stream; ``"utf-8"`` if the stream is ``None``."""
        return "utf-8" if self._stream is None else self._stream.encoding

    def isatty(self) -> bool:
        """Return True if the stream is a terminal."""
        return self._stream is not None and self._stream.isatty()

    def write(self, text: str) -> int:
        """Queue a text for writing; return immediately. Errors are reported by :meth:`check` only."""
        if self._thread is None:
            self._write_now(text)
            return len(text)
        with self._changed:
            if self.error is None and len(self._texts) < _MAX_QUEUED:
                self._queue_notice()
                self._texts.append(text)
                self._changed.notify_all()
            else:
                self.dropped += 1
                self._unreported += 1
        return len(text)

    def flush(self) -> None:
        """Do nothing: texts are written as soon as possible."""

    def check(self) -> None:
        """Raise the error that ended the writing, if any."""
        if self.error is not None:
            raise self.error

    def close(self, seconds: float = float("inf")) -> None:
        """Write the queued texts, then stop writing.

        The method returns when the queue is empty, when the reader has read nothing for 1 s, or when the time is over.

        Args:
            seconds: Maximum time to wait in s.
        """
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        thread, written = self._thread, -1
        end = time.monotonic() + seconds
        while thread is not None and thread.is_alive() and written < self._written and time.monotonic() < end:
            written = self._written
            thread.join(min(_PATIENCE, max(0.0, end - time.monotonic())))
        with self._changed:
            self.dropped += len(self._texts)
            self._texts.clear()

    def _write_now(self, text: str) -> None:
        if self._stream is not None and self.error is None:
            try:
                self._stream.write(text)
                self._stream.flush()
            except OSError as error:
                self.error = error

    def _work(self, copy: TextIO) -> None:
        try:
            with copy:
                while (text := self._next()) is not None:
                    copy.write(text)
                    copy.flush()
                    self._written += 1
        except OSError as error:
            with self._changed:
                self.error = error

    def _queue_notice(self) -> None:
        """Queue a notice of the dropped texts, if there are any."""
        if self._notice is not None and self._unreported:
            self._texts.append(self._notice(self._unreported))
        self._unreported = 0

    def _next(self) -> str | None:
        with self._changed:
            if not self._texts:
                self._queue_notice()
            self._changed.wait_for(lambda: self._texts or self._ended)
            return self._texts.popleft() if self._texts else None


def _copy_of(stream: TextIO) -> TextIO | None:
    """Return a duplicate of a stream, or ``None`` if it has no file descriptor.

    A blocked write to the stream itself would hold its lock, and the interpreter needs that lock at exit.
    """
    try:
        stream.flush()
        number = os.dup(stream.fileno())
    except (OSError, ValueError):
        return None
    return os.fdopen(number, "w", encoding=stream.encoding, errors=stream.errors)
