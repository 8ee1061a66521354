"""Base class of synchronous TCP and UDP links."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Iterable
from typing import Any, Final

from orinkit.core.errors import TransportError
from orinkit.core.i18n import tr
from orinkit.core.speedups import EXTENSION
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import lost

CHUNK: Final = 65536
_ENDING: Final = 1.0  # s to wait for the end of a call in another thread, which the shutdown of the socket ends


class SocketLink(ProcessBound):
    """A connected socket, used from the caller's thread.

    Args:
        connection: The connected socket; the link owns it.

    Attributes:
        datagrams: True if the socket is a datagram socket: a packet arrives as a whole or not at all.
        descriptor: Descriptor of the socket for the extension in C; -1 after the link was closed.
        kernel_seconds: Time-out that :meth:`use_kernel_timeout` has set, s; -1 if the socket is in another mode.
    """

    __slots__ = ("descriptor", "kernel_seconds")  # the extension in C reads slots faster than __dict__

    datagrams = False

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._open = True
        self._seconds = -1.0
        self.descriptor = connection.fileno()
        self.kernel_seconds = -1.0
        self._sendall: Callable[[bytes], object] = connection.sendall
        self._recv = connection.recv
        self._sending: threading.Lock | None = None
        self._calling: Any = None
        # for exchange(): another object for the same descriptor, which belongs to self._socket
        self._sender = socket.socket(connection.family, connection.type, connection.proto, connection.fileno())
        keep_from_children(self)

    def __del__(self) -> None:
        if hasattr(self, "_sender"):
            self._sender.detach()
            if not self._open:
                self._socket.close()

    def guard(self, lock: Any) -> None:
        """Let :meth:`close` wait until no other thread holds a lock, before the descriptor of a stream is closed.

        A system call of another thread has the number of the descriptor from the moment at which it releases the GIL.
        If this number already belonged to another file, a request could go to another robot.

        Args:
            lock: The ``threading.RLock`` that a thread holds during :meth:`exchange`, :meth:`send` and :meth:`receive`.
        """
        # the shutdown of a datagram socket does not end a receive in another thread; on Windows, no shutdown does
        if not self.datagrams and os.name != "nt":
            self._calling = lock

    def fileno(self) -> int:
        """Return the socket's descriptor, so that another process can take it over.

        Raises:
            ConnectionClosed: If the link is closed.
        """
        if not self._open:
            raise self._unusable()
        self._seconds = self.kernel_seconds = -1.0  # the other process may change the mode of the socket
        return self._socket.fileno()

    def send(self, data: bytes, seconds: float, start: int = 0) -> None:
        """Send all bytes; if that fails, close the link, because the stream would contain a truncated packet.

        An interrupting exception, such as KeyboardInterrupt, leaves a datagram socket open, so that packets that notify
        the peer of the end of the connection can still be sent.

        Args:
            data: The bytes.
            seconds: Time-out, s.
            start: Number of the bytes that have already been sent.

        Raises:
            ConnectionLost: If the connection failed, or the peer did not accept the bytes in time.
            ConnectionClosed: If the link is closed.
        """
        try:
            self._set_timeout(seconds)
            self._sendall(data[start:])
        except BaseException as error:
            failure = self._send_error(error, len(data), seconds)
            if failure is None:
                raise
            raise failure from error

    def _send_error(self, error: BaseException, count: int, seconds: float) -> TransportError | None:
        """Close the link after a failed send; return the exception to raise, ``None`` for ``error`` itself."""
        if self.datagrams and not isinstance(error, Exception):
            return None
        was_open = self._open
        self.close()
        if not was_open:
            return self._unusable()
        if isinstance(error, TimeoutError):
            return lost(tr("the peer did not accept {count} bytes within {seconds:g} s", count=count, seconds=seconds))
        return self._broken(error) if isinstance(error, OSError) else None

    def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Send all bytes, then return the next received bytes; the same as :meth:`send` and :meth:`receive`.

        Before each system call, a socket with a time-out waits until the system call cannot block. The socket object
        that sends has no time-out, which saves this wait.
        """
        try:
            if seconds != self._seconds:
                self._set_timeout(seconds)
            sent = self._sender.send(data)
        except BlockingIOError:  # the peer does not read
            sent = 0
        except BaseException as error:
            failure = self._send_error(error, len(data), seconds)
            if failure is None:
                raise
            raise failure from error
        if sent != len(data):
            self.send(data, seconds, sent)
        try:
            received = self._recv(CHUNK)
        except TimeoutError:
            return None
        except OSError as error:
            raise self._receive_error(error) from error
        if not received and not self._open:
            raise self._unusable()
        return received

    # --- for the extension in C ---------------------------------------------------------------------------------

    def use_kernel_timeout(self, seconds: float) -> None:
        """Put the socket into blocking mode with a time-out of the system for receiving.

        In this mode, a call does not require a system call that waits for the socket. Each method of this class that
        sends or receives ends this mode.

        Raises:
            ConnectionLost: If the connection failed.
            ConnectionClosed: If the link is closed.
        """
        try:
            self._seconds = -1.0
            self._socket.settimeout(None)
            assert EXTENSION is not None
            EXTENSION.set_timeout(self._socket.fileno(), seconds)
        except OSError as error:
            self.fail(error)
        self.kernel_seconds = seconds

    def finish_exchange(self, data: bytes, seconds: float, start: int) -> bytes | None:
        """Send the rest of the bytes of an exchange, from ``start``, then return the next received bytes."""
        self.send(data, seconds, start)
        return self.receive(seconds)

    def fail(self, error: OSError | None) -> None:
        """Raise the exception for a failed exchange.

        Args:
            error: Error of the system. ``None`` means the end of the stream; in this case, nothing is raised if the
                peer has closed the connection.

        Raises:
            ConnectionLost: If the connection failed.
            ConnectionClosed: If the link is closed.
        """
        if error is not None:
            raise self._receive_error(error) from error
        if not self._open:
            raise self._unusable()

    def enable_concurrent_send(self) -> None:
        """Prepare for calls of :meth:`send_concurrently`; do not call this method during a send."""
        lock = self._sending = threading.Lock()
        whole = self._sendall

        def sendall(data: bytes) -> None:
            with lock:
                whole(data)

        self._sendall = sendall

    def send_concurrently(self, data: bytes) -> None:
        """Send a few bytes while another thread waits in :meth:`receive`; do nothing if another thread is sending.

        If there is an error, :meth:`receive` raises an exception in that thread.
        """
        if not self._open or self._sending is None or not self._sending.acquire(blocking=False):
            return
        try:
            sent = self._socket.send(data)
        except OSError:
            return
        finally:
            self._sending.release()
        if sent < len(data):  # the stream contains a truncated packet
            self.close()

    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, or ``None`` if the time has passed.

        Raises:
            ConnectionLost: If the connection failed.
            ConnectionClosed: If the link is closed.
        """
        try:
            self._set_timeout(seconds)
            data = self._recv(CHUNK)
        except TimeoutError:
            return None
        except OSError as error:
            raise self._receive_error(error) from error
        if not data and not self._open:  # another thread's close() has ended the stream
            raise self._unusable()
        return data

    def _receive_error(self, error: OSError) -> TransportError:
        """Close the link after a failed receive, and return the exception to raise."""
        was_open = self._open
        self.close()
        return self._broken(error) if was_open else self._unusable()

    def _set_timeout(self, seconds: float) -> None:
        if seconds != self._seconds:  # saves a system call
            self.kernel_seconds = -1.0
            self._socket.settimeout(seconds)
            self._seconds = seconds

    def _broken(self, error: OSError) -> TransportError:
        """Return the exception for an error that the operating system reported."""
        return lost(error)

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the connection stays open in the parent."""
        self._open, self._left = False, True
        self.descriptor = -1
        return (self._socket.fileno(),)

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""
        self._open = False
        self.descriptor = -1
        self._sender.detach()
        self._socket.close()

    def close(self) -> None:
        """Close the link; a receive pending in another thread ends immediately."""
        if self._open:
            self._open = False
            self.descriptor = -1
            self._sender.detach()
            try:
                self._socket.shutdown(socket.SHUT_RDWR)
            except OSError:  # the peer may have closed first
                pass
            self._close_descriptor()

    def _close_descriptor(self) -> None:
        lock = self._calling
        if lock is None:
            self._socket.close()
        elif lock.acquire(timeout=_ENDING):
            try:
                self._socket.close()
            finally:
                lock.release()
        # otherwise, __del__ closes the socket: a thread that uses the descriptor has a reference to this link
