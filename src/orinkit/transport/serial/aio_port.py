"""Serial ports for clients in asyncio; the synchronous twin is :mod:`orinkit.transport.serial.port`.

Bytes are taken from the port when they are wanted, so that none is lost when another process has it.
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
from orinkit.transport.serial.settings import CHUNK, gone, open_file

_UNSENT: Final = 1024 * 1024
"""How many bytes of earlier calls may wait to be sent; more are dropped, as if lost on the way."""


class AsyncSerialLink(ProcessBound):
    """A serial port in asyncio; :meth:`open` makes one.

    Args:
        port: does not block, and is this link's from then on.
    """

    def __init__(self, port: FileIO) -> None:
        self._port = port
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._failure: ConnectionLost | None = None  # that nobody has been told yet
        self._unsent = bytearray()
        self._waiter: asyncio.Future[None] | None = None
        keep_from_children(self)

    @classmethod
    async def open(cls, address: SerialAddress) -> Self:
        """Open a serial port, for this program alone; what waits in it from before is thrown away.

        Raises:
            ConnectFailed: it is not there, may not be used, is in use, or cannot be set like this.
            MissingExtra: serialx is missing.
        """
        opening = _Opening()
        try:
            return cls(await asyncio.to_thread(opening.open, address))
        except BaseException:
            opening.give_up()
            raise

    def send(self, data: bytes) -> None:
        """Queue all of the bytes.

        Raises:
            ConnectionLost: the port is gone.
            ConnectionClosed: the link was closed before.
            TransportError: it is used in another event loop than the one it was opened in.
        """
        self._check()
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()
        if len(self._unsent) < _UNSENT:
            self._unsent += data
            self._write()
            self._check()

    def _write(self) -> None:
        """Write what there is room for."""
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
        """Return the next bytes, ``None`` when the seconds have passed.

        Raises:
            ConnectionLost: the port is gone.
            ConnectionClosed: the link was closed before.
        """
        self._check()
        loop = asyncio.get_running_loop()
        self._waiter = loop.create_future()
        alarm = loop.call_later(seconds, self._wake)
        loop.add_reader(self._port.fileno(), self._wake)
        try:
            await self._waiter
        finally:
            alarm.cancel()
            self._waiter = None
            if self._open:
                loop.remove_reader(self._port.fileno())
        self._check()
        try:
            data: bytes | None = self._port.read(CHUNK)
        except OSError as error:
            self._give_up(error)
        else:
            if data != b"":
                return data
            self._give_up(tr("it was pulled out"))
        self._check()
        return None

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _give_up(self, reason: object) -> None:
        self._failure = gone(reason)
        self.close()

    def _check(self) -> None:
        if not self._open:
            failure, self._failure = self._failure, None
            raise failure or self._unusable()

    def fileno(self) -> int:
        """Descriptor of the port, to be lent to another process; nothing is received here until the next call.

        Raises:
            ConnectionClosed: it has been closed.
        """
        self._check()
        return self._port.fileno()

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the port stays in its parent."""
        self._open, self._left = False, True
        return () if self._port.closed else (self._port.fileno(),)

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""
        self.close()

    def close(self) -> None:
        """Close; a receive that is waiting ends at once."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._port.fileno())
            self._loop.remove_writer(self._port.fileno())
            self._port.close()
            self._wake()


class _Opening:
    """A port that a thread opens; one that nobody waits for any more is closed."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._port: FileIO | None = None
        self._wanted = True

    def open(self, address: SerialAddress) -> FileIO:
        """Open it; to be called in the thread."""
        port = open_file(address)
        with self._lock:
            self._port = port
            if not self._wanted:
                port.close()
        return port

    def give_up(self) -> None:
        """Close it, now or as soon as it is open."""
        with self._lock:
            self._wanted = False
            if self._port is not None:
                self._port.close()
