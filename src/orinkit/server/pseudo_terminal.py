"""A pair of pseudo-terminals as an asyncio transport: a serial line without hardware (POSIX)."""

from __future__ import annotations

import asyncio
import os
import termios
import tty
from collections.abc import Callable, Iterable
from typing import Final

from orinkit.transport.fork_safety import keep_from_children

_CHUNK: Final = 65536
_HIGH: Final = 65536


class PseudoTerminal(asyncio.Transport):
    """The server's end of a pair of pseudo-terminals; clients open the other end by its path.

    The server itself keeps the other end open too, so that the line stays usable after a client has closed that end.

    Args:
        loop: the event loop.
        protocol: factory of the protocol, which is called with the path.

    Attributes:
        path: path of the other end, such as ``/dev/pts/3``.

    Raises:
        OSError: If no pseudo-terminal is available.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, protocol: Callable[[str], asyncio.Protocol]) -> None:
        super().__init__({"serial": self})
        self._loop = loop
        self._waiting = bytearray()
        self._high = _HIGH
        self._paused = False  # writing of the protocol
        self._is_reading = True
        self._closing = False
        self._closed = False
        self._end, self._other_end = os.openpty()
        try:
            tty.setraw(self._other_end)
            os.set_blocking(self._end, False)
            self.path = os.ttyname(self._other_end)
        except BaseException:
            self._close_both()
            raise
        self._protocol = protocol(self.path)
        keep_from_children(self)
        loop.add_reader(self._end, self._readable)
        self._protocol.connection_made(self)

    def _readable(self) -> None:
        try:
            data = os.read(self._end, _CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._finish(error)
            return
        self._protocol.data_received(data)

    def _writable(self) -> None:
        sent = self._write_some(self._waiting)
        del self._waiting[:sent]
        if self._waiting or self._closed:
            return
        self._loop.remove_writer(self._end)
        if self._closing:
            self._finish(None)
        elif self._paused:
            self._paused = False
            self._protocol.resume_writing()

    def _write_some(self, data: bytes | bytearray | memoryview) -> int:
        """Write as much as possible without blocking; return the number of bytes written."""
        try:
            return os.write(self._end, data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            self._finish(error)
            return 0

    def _finish(self, error: OSError | None) -> None:
        if self._closed:
            return
        self._closing = self._closed = True
        self._loop.remove_reader(self._end)
        self._loop.remove_writer(self._end)
        self._waiting.clear()
        self._close_both()
        self._loop.call_soon(self._protocol.connection_lost, error)

    def _close_both(self) -> None:
        os.close(self._end)
        os.close(self._other_end)

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptors that a forked child replaces by the null device."""
        return () if self._closed else (self._end, self._other_end)

    # --- asyncio.Transport ------------------------------------------------------------------------------------------

    def is_reading(self) -> bool:
        """Return True if the protocol receives data."""
        return self._is_reading and not self._closing

    def pause_reading(self) -> None:
        """Stop reading."""
        if self._is_reading and not self._closing:
            self._is_reading = False
            self._loop.remove_reader(self._end)

    def resume_reading(self) -> None:
        """Read again."""
        if not self._is_reading and not self._closing:
            self._is_reading = True
            self._loop.add_reader(self._end, self._readable)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send as much data as possible now, and the rest as soon as the line accepts it."""
        if self._closing:
            return
        if not self._waiting:
            data = data[self._write_some(data) :]
            if not data or self._closed:
                return
            self._loop.add_writer(self._end, self._writable)
        self._waiting += data
        if len(self._waiting) > self._high and not self._paused:
            self._paused = True
            self._protocol.pause_writing()

    def reset_write_buffer(self) -> None:
        """Drop unsent data in this object and in the operating system; serial ports have a method of the same name."""
        self._waiting.clear()
        if not self._closed:
            termios.tcflush(self._other_end, termios.TCIFLUSH)
            if not self._closing:
                self._loop.remove_writer(self._end)
                if self._paused:
                    self._paused = False
                    self._protocol.resume_writing()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Set ``high``, the number of unsent bytes above which the protocol is paused; ``low`` has no effect."""
        self._high = _HIGH if high is None else high

    def get_write_buffer_size(self) -> int:
        """Return the number of unsent bytes."""
        return len(self._waiting)

    def is_closing(self) -> bool:
        """Return True if the transport is closing or closed."""
        return self._closing

    def close(self) -> None:
        """Close the transport after pending data has been sent."""
        if not self._closing:
            self._closing = True
            self._loop.remove_reader(self._end)
            if not self._waiting:
                self._finish(None)

    def abort(self) -> None:
        """Close the transport immediately."""
        self._finish(None)
