"""Raw peers for tests: :class:`RawClient`, and :class:`BadPeer`, a server that misbehaves by script.

::

    def answers_twice(line: Line) -> None:
        request = line.request()
        line.send(reply(request, "one") * 2)

    with BadPeer(answers_twice) as peer:
        ...  # connect to peer.url

Every connection runs the next script (further ones the last script) in a separate thread. Every wait of a script is
bounded, and leaving the ``with`` block closes all sockets, so no script can leave resources behind.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.packet import Framer, Packet
from orinkit.core import hresult

PATIENCE = 20.0  # s, time-out of every wait of a script


class Gone(Exception):
    """The client has disconnected; ends a script that does not catch it."""


def reply(request: Packet, *values: Any, code: int = hresult.S_OK, serial: int | None = None) -> bytes:
    """Return the reply to a request, or one with another serial."""
    return packet.encode(Packet(request.serial if serial is None else serial, code, list(values)))


def executing(request: Packet, serial: int | None = None) -> bytes:
    """Return a packet that reports that a request is still executing."""
    return reply(request, code=hresult.S_EXECUTING, serial=serial)


class Line:
    """One connection, as used by a script."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._framer = Framer()
        connection.settimeout(PATIENCE)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def request(self) -> Packet:
        """Return the client's next packet."""
        frame = self._framer.next_frame()
        while frame is None:
            frame = self._framer.feed(self._receive())
        return packet.decode(frame)

    def _receive(self) -> bytes:
        try:
            data = self._socket.recv(65536)
        except OSError as error:
            raise Gone from error
        if not data:
            raise Gone
        return data

    def send(self, data: bytes) -> None:
        """Send bytes unchanged."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise Gone from error

    def send_in_pieces(self, *pieces: bytes) -> None:
        """Send bytes so that the client most likely receives them piece by piece."""
        for piece in pieces:
            self.send(piece)
            time.sleep(0.001)  # there is no sign that the client has received a piece

    def serve(self, answer: Callable[[Packet], bytes]) -> None:
        """Reply to requests until the client disconnects."""
        while True:
            self.send(answer(self.request()))

    def wait_for_end(self) -> None:
        """Wait until the client has closed the connection; discard what it sends meanwhile."""
        try:
            while True:
                self._receive()
        except Gone:
            pass

    def shut(self) -> None:
        """End the connection gracefully, and wake a thread that waits on it.

        The descriptor stays open: a thread that is about to wait could otherwise wait on another file with the same number.
        """
        try:
            socket.socket.shutdown(self._socket, socket.SHUT_RDWR)  # SSLSocket.shutdown() would continue without TLS
        except OSError:
            pass

    def close(self) -> None:
        """Close the connection gracefully: the client reads an end of stream."""
        self.shut()
        self._socket.close()

    def reset(self) -> None:
        """Reset the connection: the client gets ECONNRESET."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._socket.close()


Script: TypeAlias = Callable[[Line], None]


class BadPeer:
    """A TCP server that runs scripts; an error of a script is raised when the ``with`` block is left."""

    def __init__(self, *scripts: Script) -> None:
        self._scripts = scripts
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._threads: list[threading.Thread] = []
        self._lines: list[Line] = []
        self._errors: list[Exception] = []
        self.ended = threading.Semaphore(0)
        """Released once for every script that has ended."""
        self.stopping = threading.Event()
        """Set when the ``with`` block is left; for scripts that would run forever."""

    @property
    def port(self) -> int:
        return int(self._listener.getsockname()[1])

    @property
    def url(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    @property
    def connections(self) -> int:
        """The number of clients that have connected so far."""
        return len(self._lines)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # shut down by __exit__
                return
            line = Line(connection)
            script = self._scripts[min(len(self._lines), len(self._scripts) - 1)]
            self._lines.append(line)
            self._start(self._run, script, line)
            if self.stopping.is_set():  # __exit__ may have missed this connection
                line.shut()

    def _run(self, script: Script, line: Line) -> None:
        try:
            script(line)
        except Gone:
            pass
        except Exception as error:  # noqa: BLE001 - raised by __exit__
            self._errors.append(error)
        finally:
            line.close()
            self.ended.release()

    def _start(self, target: Callable[..., None], *args: Any) -> None:
        thread = threading.Thread(target=target, args=args, name="bad-peer", daemon=True)
        self._threads.append(thread)
        thread.start()

    def __enter__(self) -> Self:
        self._start(self._accept)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stopping.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        for line in list(self._lines):
            line.shut()
        for thread in self._threads:  # an ending thread may start another one
            thread.join(PATIENCE)
        self._listener.close()
        if error is None and self._errors:
            raise self._errors[0]


class RawClient:
    """A client that sends given bytes and returns received packets."""

    def __init__(self, url: str, *, receive_buffer: int = 0, source: str = "") -> None:
        host, _, port = url.rpartition("/")[2].rpartition(":")
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        if source:
            self.socket.bind((source, 0))
        self.socket.settimeout(PATIENCE)
        self.socket.connect((host, int(port)))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._framer = Framer()
        self._serial = 0

    def send(self, data: bytes) -> None:
        """Send bytes unchanged."""
        self.socket.sendall(data)

    def request(self, function: int, *arguments: Any, serial: int | None = None) -> int:
        """Send a request and return its serial."""
        self._serial = self._serial % 0xFFFF + 1 if serial is None else serial
        self.send(packet.encode(Packet(self._serial, function, list(arguments))))
        return self._serial

    def frame(self) -> bytes:
        """Return the next packet as bytes; raises :class:`Gone` at the end of the stream."""
        frame = self._framer.next_frame()
        while frame is None:
            data = self.socket.recv(65536)
            if not data:
                raise Gone
            frame = self._framer.feed(data)
        return frame

    def packet(self) -> Packet:
        """Return the next packet."""
        return packet.decode(self.frame())

    def ask(self, function: int, *arguments: Any) -> Any:
        """Send a request and return the result of the reply; the return code unless it is S_OK."""
        serial = self.request(function, *arguments)
        answer = self.packet()
        assert answer.serial == serial
        if answer.code:
            return answer.code
        return answer.arguments[0] if answer.arguments else None

    def ended(self) -> bool:
        """Return True if the stream has ended, False if data has arrived."""
        try:
            return self.socket.recv(1) == b""
        except ConnectionError:
            return True

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
