"""Synchronous serial ports for clients; the asynchronous counterpart is :mod:`orinkit.transport.serial.aio_port`.

serialx opens and configures a port (:mod:`orinkit.transport.serial.settings`). Bytes are then read and written through
the descriptor, so that another thread can end a wait and another process can take over the port. On Windows, where a
port has no such descriptor, they go through serialx (:mod:`orinkit.transport.serial.windows`).
"""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterable
from io import FileIO
from time import monotonic

from orinkit.core.errors import ConnectionLost
from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.serial.settings import CHUNK, gone, is_gone


class SerialLink(ProcessBound):
    """A serial port, used from the caller's thread.

    Args:
        port: The non-blocking port; the link owns it.
    """

    def __init__(self, port: FileIO) -> None:
        self._port = port
        self._woken, self._wake = (FileIO(end, mode) for end, mode in zip(os.pipe(), "rw", strict=True))
        self._open = True
        self._closing = threading.Lock()  # acquired by the first call of close() and never released
        # one lock for each direction, so that a receive in progress does not delay the Service_Stop of a closing client
        self._sending, self._receiving = threading.RLock(), threading.RLock()
        self._reading = self._poll(select.POLLIN)
        keep_from_children(self)

    def _poll(self, event: int) -> select.poll:
        poll = select.poll()
        poll.register(self._woken, select.POLLIN)
        poll.register(self._port, event)
        return poll

    def fileno(self) -> int:
        """Return the port's descriptor, so that another process can take it over.

        Raises:
            ConnectionClosed: If the link is closed.
        """
        self._check()
        return self._port.fileno()

    def send(self, data: bytes, seconds: float) -> None:
        """Send all bytes; bytes that the line does not accept in time are dropped, as if they were lost on the line.

        Raises:
            ConnectionLost: If the port was removed or failed.
            ConnectionClosed: If the link is closed.
        """
        end = monotonic() + seconds
        with self._sending:
            while data:
                self._check()
                try:
                    data = data[self._port.write(data) or 0 :]
                except OSError as error:
                    raise self._gone(error) from error
                if data and not self._poll(select.POLLOUT).poll(_milliseconds(end)):
                    return

    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, or ``None`` if the time has passed.

        Raises:
            ConnectionLost, ConnectionClosed: As for :meth:`send`.
        """
        end = monotonic() + seconds
        with self._receiving:
            while True:
                self._check()
                if not self._reading.poll(_milliseconds(end)):
                    return None
                self._check()
                try:
                    data = self._port.read(CHUNK)
                except OSError as error:
                    raise self._gone(error) from error
                if data:
                    return data
                if data is not None and is_gone(self._port):
                    raise self._gone(tr("it was unplugged"))

    def _check(self) -> None:
        if not self._open:
            raise self._unusable()

    def _gone(self, reason: object) -> ConnectionLost:
        self.close()
        return gone(reason)

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the port and the wake-up pipe stay open in the parent."""
        self._open, self._left = False, True
        self._closing, self._sending, self._receiving = threading.Lock(), threading.RLock(), threading.RLock()
        files = (self._port, self._woken, self._wake)
        return [] if self._port.closed else [file.fileno() for file in files]

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""
        self.close()

    def close(self) -> None:
        """Close the link; a send or receive pending in another thread ends immediately."""
        if self._closing.acquire(blocking=False):
            self._open = False
            self._wake.write(b"\0")
            with self._sending, self._receiving:
                for file in (self._port, self._woken, self._wake):
                    file.close()


def _milliseconds(end: float) -> float:
    return max(0.0, end - monotonic()) * 1e3
