"""TCP for clients, on the caller's own thread; the asynchronous twin is :mod:`orinkit.transport.aio_tcp`."""

from __future__ import annotations

import socket
from typing import Final

from orinkit.errors import ConnectFailed, ConnectionClosed, ConnectionLost
from orinkit.language import pick
from orinkit.transport.address import Address

CHUNK: Final = 65536


def lost(reason: object) -> ConnectionLost:
    """Return the exception for a link that broke."""
    return ConnectionLost(pick(f"the connection broke: {reason}", f"接続が切れました: {reason}"))


def closed() -> ConnectionClosed:
    """Return the exception for a link that was closed here."""
    return ConnectionClosed(
        pick("the connection is closed; connect again", "接続は閉じられています。接続し直してください")
    )


def connect_failed(address: Address, error: BaseException) -> ConnectFailed:
    """Return the exception for a link that could not be opened."""
    reason = str(error) or type(error).__name__
    return ConnectFailed(
        pick(
            f"cannot connect to {address}: {reason}. Try: is the controller on, the address right, the port open?",
            f"{address} に接続できません: {reason}。対処: コントローラの電源、アドレス、ポートを確認してください",
        )
    )


class TcpLink:
    """A TCP connection used by the thread that calls."""

    def __init__(self, address: Address, seconds: float) -> None:
        """Connect.

        Raises:
            ConnectFailed: it could not be done within ``seconds``.
        """
        try:
            connection = socket.create_connection((address.host, address.port), seconds)
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._use(connection)

    def _use(self, connection: socket.socket) -> None:
        self._socket = connection
        self._open = True
        self._seconds = -1.0
        self._sendall = connection.sendall
        self._recv = connection.recv

    def fileno(self) -> int:
        """Descriptor of the connection, to be lent to another process.

        Raises:
            ConnectionClosed: it has been closed.
        """
        if not self._open:
            raise closed()
        return self._socket.fileno()

    def send(self, data: bytes, seconds: float) -> None:
        """Send all of the bytes; if that does not succeed the link is closed, for the stream would have a torn packet.

        Raises:
            ConnectionLost: the link broke, or the other side did not take the bytes within the seconds.
            ConnectionClosed: the link was closed before.
        """
        try:
            self._set_timeout(seconds)
            self._sendall(data)
        except BaseException as error:
            was_open = self._open
            self.close()
            if not was_open:
                raise closed() from error
            if isinstance(error, TimeoutError):
                raise lost(
                    pick(
                        f"the other side did not take {len(data)} bytes within {seconds:g} s",
                        f"相手が {len(data)} バイトを {seconds:g} 秒以内に受信しませんでした",
                    )
                ) from error
            if isinstance(error, OSError):
                raise lost(error) from error
            raise

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
            raise self._end(error) from error
        if not data and not self._open:  # the end of the stream is another thread's close()
            raise closed()
        return data

    def _set_timeout(self, seconds: float) -> None:
        if seconds != self._seconds:  # a system call each time
            self._socket.settimeout(seconds)
            self._seconds = seconds

    def _end(self, error: OSError) -> ConnectionLost | ConnectionClosed:
        was_open = self._open
        self.close()
        return lost(error) if was_open else closed()

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


class AdoptedTcpLink(TcpLink):
    """A TCP connection that is there already: another process has made it."""

    def __init__(self, descriptor: int) -> None:
        """Use a connection by its descriptor, which is this link's from then on."""
        self._use(socket.socket(fileno=descriptor))
