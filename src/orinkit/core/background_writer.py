"""Writing without waiting: what drives a robot or a motor must not be held up by a reader that does not read."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable
from threading import Condition, Thread
from typing import Final, TextIO

_MOST: Final = 1000  # texts that wait for the reader
_PATIENCE: Final = 1.0  # s without any progress after which a reader is given up


class BackgroundWriter:
    """Writes texts to a stream from a thread of its own. Those that find too many before them are dropped, and counted.

    It takes the place of a file where only ``write`` and ``flush`` are called. A stream without a descriptor, as a text in
    memory, is written to at once.

    Args:
        stream: stdout or stderr; ``None`` where it is closed: nothing is written then.
        notice: makes a text of the number of texts that were dropped; it is written as soon as there is room again. Without
            it nothing is.

    Attributes:
        dropped: how many texts nobody has read.
        error: what has ended the writing, ``None`` as long as nothing has.
    """

    def __init__(self, stream: TextIO | None, notice: Callable[[int], str] | None = None) -> None:
        self.dropped = 0
        self._notice = notice
        self._untold = 0  # texts dropped of which no notice tells yet
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
        """The stream's."""
        return "utf-8" if self._stream is None else self._stream.encoding

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream is not None and self._stream.isatty()

    def write(self, text: str) -> int:
        """Have a text written; returns at once, and says nothing of errors."""
        if self._thread is None:
            self._write_now(text)
            return len(text)
        with self._changed:
            if self.error is None and len(self._texts) < _MOST:
                self._tell()
                self._texts.append(text)
                self._changed.notify_all()
            else:
                self.dropped += 1
                self._untold += 1
        return len(text)

    def flush(self) -> None:
        """Nothing: texts are written as soon as they can be."""

    def check(self) -> None:
        """Raise the error that has ended the writing, if there was one."""
        if self.error is not None:
            raise self.error

    def close(self, seconds: float = float("inf")) -> None:
        """Wait until all is written, no reader has taken anything for a second, or the seconds have passed."""
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

    def _tell(self) -> None:
        """Put the notice of what was dropped behind what was not."""
        if self._notice is not None and self._untold:
            self._texts.append(self._notice(self._untold))
        self._untold = 0

    def _next(self) -> str | None:
        with self._changed:
            if not self._texts:
                self._tell()
            self._changed.wait_for(lambda: self._texts or self._ended)
            return self._texts.popleft() if self._texts else None


def _copy_of(stream: TextIO) -> TextIO | None:
    """Return a stream to the same place; ``None`` where it has no descriptor.

    Writing to the stream itself would hold its lock, which the end of the program needs.
    """
    try:
        stream.flush()
        number = os.dup(stream.fileno())
    except (OSError, ValueError):
        return None
    return os.fdopen(number, "w", encoding=stream.encoding, errors=stream.errors)
