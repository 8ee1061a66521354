"""Serial ports for clients in asyncio; the synchronous counterpart is :mod:`orinkit.transport.serial.port`.

Bytes are read from the port only on demand, so that no byte is lost when another process takes over the port.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from io import FileIO
from threading import Lock
from typing import Final, Self

from orinkit.core.errors import ConnectionLost
from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import other_loop
from orinkit.transport.serial.address import SerialAddress
from orinkit.transport.serial.settings import CHUNK, gone, is_gone, open_file
from orinkit.transport.waiter import AsyncWaiter

_UNSENT: Final = 1024 * 1024
"""Maximum number of bytes that earlier calls of ``send`` left unsent; if there are more, a call drops its data."""


class AsyncSerialLink(ProcessBound):
    """A serial port in asyncio; created by :meth:`open`.

    Args:
        port: The non-blocking port; the link owns it.
    """

    def __init__(self, port: FileIO) -> None:
        self._port = port
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._failure: ConnectionLost | None = None  # an exception that has not been raised yet
        self._unsent = bytearray()
        self._waiter = AsyncWaiter()
        keep_from_children(self)

    @classmethod
    async def open(cls, address: SerialAddress) -> Self:
        """Open a serial port for exclusive use; bytes received before are discarded.

        Raises:
            ConnectFailed: If the port does not exist, access is denied, it is in use, or it does not support the
                settings.
            MissingExtra: If serialx is not installed.
        """
        opening = _Opening()
        try:
            return cls(await asyncio.to_thread(opening.open, address))
        except BaseException:
            opening.give_up()
            raise

    def send(self, data: bytes) -> None:
        """Queue all bytes for sending; drop them if the port has not accepted 1 MiB of earlier bytes yet.

        Raises:
            ConnectionLost: If the port was removed or failed.
            ConnectionClosed: If the link is closed.
            TransportError: If the link was opened in another event loop.
        """
        self._check()
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()
        if len(self._unsent) < _UNSENT:
            self._unsent += data
            self._write()
            self._check()

    def _write(self) -> None:
        """Write as many bytes as the port accepts."""
        try:
            del self._unsent[: self._port.write(self._unsent) or 0]
        except OSError as error:
            self._give_up(error)
            return
        if self._unsent:
            self._loop.add_writer(self._port.fileno(), self._write)
        else:
            self._loop.remove_writer(self._port.fileno())

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, or ``None`` if the time has passed.

        Raises:
            ConnectionLost: If the port was removed or failed.
            ConnectionClosed: If the link is closed.
        """
        self._check()
        loop = asyncio.get_running_loop()
        loop.add_reader(self._port.fileno(), self._waiter.wake)
        try:
            await self._waiter.wait(seconds)
        finally:
            if self._open:
                loop.remove_reader(self._port.fileno())
        self._check()
        try:
            data: bytes | None = self._port.read(CHUNK)
        except OSError as error:
            self._give_up(error)
        else:
            if data or not is_gone(self._port):
                return data or None
            self._give_up(tr("it was unplugged"))
        self._check()
        return None

    def _give_up(self, reason: object) -> None:
        self._failure = gone(reason)
        self.close()

    def _check(self) -> None:
        if not self._open:
            failure, self._failure = self._failure, None
            raise failure or self._unusable()

    def fileno(self) -> int:
        """Return the port's descriptor, so that another process can take it over.

        Until the next call of :meth:`receive`, this process reads nothing from the port.

        Raises:
            ConnectionClosed: If the link is closed.
        """
        self._check()
        return self._port.fileno()

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the port stays open in the parent."""
        self._open, self._left = False, True
        return () if self._port.closed else (self._port.fileno(),)

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""
        self.close()

    def close(self) -> None:
        """Close the link; a pending receive ends immediately."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._port.fileno())
            self._loop.remove_writer(self._port.fileno())
            self._port.close()
            self._waiter.wake()


class _Opening:
    """A port that a thread opens; if the caller has been cancelled meanwhile, the port is closed."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._port: FileIO | None = None
        self._wanted = True

    def open(self, address: SerialAddress) -> FileIO:
        """Open the port; called in the thread."""
        port = open_file(address)
        with self._lock:
            self._port = port
            if not self._wanted:
                port.close()
        return port

    def give_up(self) -> None:
        """Close the port immediately, or as soon as the thread has opened it."""
        with self._lock:
            self._wanted = False
            if self._port is not None:
                self._port.close()
