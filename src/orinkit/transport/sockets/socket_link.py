"""What TCP and UDP have in common on the caller's own thread."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterable
from typing import Final

from orinkit.core.errors import TransportError
from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import lost

CHUNK: Final = 65536


class SocketLink(ProcessBound):
    """A socket that is connected, used by the thread that calls.

    Args:
        connection: is this link's from then on.

    Attributes:
        datagrams: what is sent arrives whole or not at all.
    """

    datagrams = False

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._open = True
        self._seconds = -1.0
        self._sendall: Callable[[bytes], object] = connection.sendall
        self._recv = connection.recv
        self._sending: threading.Lock | None = None
        keep_from_children(self)

    def fileno(self) -> int:
        """Descriptor of the connection, to be lent to another process.

        Raises:
            ConnectionClosed: it has been closed.
        """
        if not self._open:
            raise self._unusable()
        return self._socket.fileno()

    def send(self, data: bytes, seconds: float) -> None:
        """Send all of the bytes; if that does not succeed, the link is closed, because the stream would have a torn packet.

        An exception from outside, such as KeyboardInterrupt, leaves a socket of datagrams open: a goodbye can follow.

        Raises:
            ConnectionLost: the link broke, or the other side did not take the bytes within the seconds.
            ConnectionClosed: the link was closed before.
        """
        try:
            self._set_timeout(seconds)
            self._sendall(data)
        except BaseException as error:
            if self.datagrams and not isinstance(error, Exception):
                raise
            was_open = self._open
            self.close()
            if not was_open:
                raise self._unusable() from error
            if isinstance(error, TimeoutError):
                raise lost(
                    tr(
                        "the other side did not take {count} bytes within {seconds:g} s",
                        count=len(data),
                        seconds=seconds,
                    )
                ) from error
            if isinstance(error, OSError):
                raise self._broken(error) from error
            raise

    def share(self) -> None:
        """Have :meth:`beside` used from now on; nothing is being sent."""
        lock = self._sending = threading.Lock()
        whole = self._sendall

        def sendall(data: bytes) -> None:
            with lock:
                whole(data)

        self._sendall = sendall

    def beside(self, data: bytes) -> None:
        """Send a few bytes from another thread than the one that waits in :meth:`receive`, unless something is being sent.

        What goes wrong is for that thread to find out.
        """
        if not self._open or self._sending is None or not self._sending.acquire(blocking=False):
            return
        try:
            sent = self._socket.send(data)
        except OSError:
            return
        finally:
            self._sending.release()
        if sent < len(data):  # the stream has a torn packet
            self.close()

    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, ``None`` when the seconds have passed.

        Raises:
            ConnectionLost: the link broke.
            ConnectionClosed: the link was closed before.
        """
        try:
            self._set_timeout(seconds)
            data = self._recv(CHUNK)
        except TimeoutError:
            return None
        except OSError as error:
            was_open = self._open
            self.close()
            raise (self._broken(error) if was_open else self._unusable()) from error
        if not data and not self._open:  # the end of the stream is another thread's close()
            raise self._unusable()
        return data

    def _set_timeout(self, seconds: float) -> None:
        if seconds != self._seconds:  # a system call each time
            self._socket.settimeout(seconds)
            self._seconds = seconds

    def _broken(self, error: OSError) -> TransportError:
        """Return the exception for what the system says."""
        return lost(error)

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the connection goes on in its parent."""
        self._open, self._left = False, True
        return (self._socket.fileno(),)

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""
        self._open = False
        self._socket.close()

    def close(self) -> None:
        """Close; a receive that another thread is in ends at once."""
        if self._open:
            self._open = False
            try:
                self._socket.shutdown(socket.SHUT_RDWR)
            except OSError:  # the other side may have gone first
                pass
            self._socket.close()
