"""The scripted peers of :mod:`peers` as e-CAP servers, running the same scripts, which use packets of b-CAP over TCP.

A request is translated to a packet, with a serial counted by the peer. A reply packet is translated to an HTTP reply,
S_EXECUTING to a line feed before it. A second reply is sent after the first; a reply without a request is dropped. Bytes
that are not a packet are sent unchanged, over the connection of the request that the script took last.

One script handles all connections of a client, because a client opens a new one after a call that has timed out. The first
request after the end of a script starts the next script.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cao.functions import service_stop
from orinkit.core import hresult
from orinkit.ecap.message import read_request, write_reply
from support import http_peers, wired_peers
from support.http_peers import CHUNKED, WORKING, HttpLine, Post, chunks, head
from support.peers import PATIENCE, BadPeer, Gone, Line, Script, reply
from support.wired_peers import parts


def ecap(body: bytes) -> bytes:
    """Return an HTTP reply with this body."""
    return http_peers.reply(body, "200 OK", WORKING)


def on_the_wire(line: Line, answer: bytes) -> bytes:
    """Return a reply packet in the encoding of a line."""
    return ecap(_body(packet.decode(answer, exact=True))) if isinstance(line, EcapLine) else answer


def _body(answer: Packet) -> bytes:
    return write_reply(answer.code, answer.arguments[0] if answer.arguments else None)


@dataclass
class Asked:
    """A request: its connection, and the progress of its reply."""

    connection: HttpLine
    body: bytes
    begun: bool = False
    answered: bool = False

    def reply(self, answer: Packet) -> bytes:
        """Return the bytes of the HTTP reply for a packet."""
        if answer.code == hresult.S_EXECUTING:
            if self.answered:
                return b""
            beginning = b"" if self.begun else head("200 OK", CHUNKED, WORKING)
            self.begun = True
            return beginning + chunks(b"\n", end=False)
        in_chunks = self.begun and not self.answered
        self.answered = True
        return chunks(_body(answer)) if in_chunks else ecap(_body(answer))


class EcapLine(Line):
    """All connections of one client, as used by a script."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._open: list[HttpLine] = []
        self._asked: list[Asked] = []  # the first has serial 1
        self._requests: deque[Packet] = deque()
        self._taken = 0  # number of requests taken by the script
        self._over = False  # the client has called Service_Stop
        self._closed = False

    # --- from the connections -----------------------------------------------------------------------------------

    def take(self, asked: Asked) -> bool:
        """Queue a request; return False if the line has been closed."""
        request = read_request(asked.body)
        arguments = list(request.function.bind(tuple(request.arguments), {}))
        with self._changed:
            if self._closed:
                return False
            if asked.connection not in self._open:
                self._open.append(asked.connection)
            self._asked.append(asked)
            frame = packet.encode(Packet(len(self._asked), request.function.id, arguments))
            self._requests.append(packet.decode(frame))
            self._over = request.function is service_stop
            self._changed.notify_all()
            return True

    def left(self, connection: HttpLine) -> None:
        """Remove a connection that has ended, if it belongs to this line."""
        with self._changed:
            if connection in self._open:
                self._open.remove(connection)
                self._changed.notify_all()

    # --- for the script -----------------------------------------------------------------------------------------

    def request(self) -> Packet:
        """Return the client's next request.

        Raises:
            Gone: If the client has called Service_Stop and has closed all connections.
        """
        with self._changed:
            self._wait_for(lambda: self._requests or (self._over and not self._open))
            if not self._requests:
                raise Gone
            self._taken += 1
            return self._requests.popleft()

    def wait_for_end(self) -> None:
        """Wait until the client has closed all connections; reply only to Service_Stop."""
        try:
            while True:
                with self._changed:
                    self._wait_for(lambda: self._requests or not self._open)
                    if not self._requests:
                        return
                    request = self.request()
                if request.code == service_stop.id:
                    self.send(reply(request))
        except Gone:
            pass

    def _wait_for(self, condition: Callable[[], object]) -> None:
        if not self._changed.wait_for(lambda: self._closed or condition(), PATIENCE) or self._closed:
            raise Gone

    def send(self, data: bytes) -> None:
        """Send translated packets, except on connections that the client has closed after a time-out."""
        for connection, translated in self._translated(data):
            try:
                connection.send(translated)
            except Gone:
                pass

    def send_in_pieces(self, *pieces: bytes) -> None:
        """Send translated packets in the same number of pieces, cut at about the same positions."""
        whole = b"".join(pieces)
        for connection, translated in self._translated(whole):
            places = [place * len(translated) // len(whole) for place in accumulate(map(len, pieces))]
            try:
                connection.send(*(translated[begin:end] for begin, end in pairwise([0, *places])))
            except Gone:
                pass

    def _translated(self, data: bytes) -> list[tuple[HttpLine, bytes]]:
        """Return the translated bytes for each connection."""
        with self._changed:
            if self._closed:
                raise Gone
            made: dict[int, tuple[HttpLine, bytes]] = {}
            for part in parts(data):
                asked, translated = self._translate(part)
                if asked is not None:
                    _, before = made.get(id(asked.connection), (None, b""))
                    made[id(asked.connection)] = asked.connection, before + translated
            return list(made.values())

    def _translate(self, part: bytes) -> tuple[Asked | None, bytes]:
        if not packet.is_whole(part):
            return self._asked[self._taken - 1], part
        answer = packet.decode(part, exact=True)
        asked = self._asked[answer.serial - 1] if 0 < answer.serial <= len(self._asked) else None
        return asked, b"" if asked is None else asked.reply(answer)

    def shut(self) -> None:
        """Shut down all connections; the peer closes them."""
        for connection in self._shut():
            connection.shut()

    close = shut

    def end(self) -> list[Asked]:
        """End the connections of the requests that the script has taken; return the requests that it has not taken."""
        with self._changed:
            untaken = self._asked[self._taken :] if self._taken else []
            for asked in untaken:
                if asked.connection in self._open:
                    self._open.remove(asked.connection)
            self.shut()
        return untaken

    def reset(self) -> None:
        """Reset all connections."""
        for connection in self._shut():
            broken = connection.line._socket
            try:
                broken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                broken.shutdown(socket.SHUT_RD)  # wakes the reading thread; invisible to the client
                with self._changed:
                    self._changed.wait_for(lambda: connection not in self._open, PATIENCE)  # noqa: B023 - called in this iteration
                connection.reset()
            except OSError:  # already closed by the client or the test
                pass

    def _shut(self) -> list[HttpLine]:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            return list(self._open)


class EcapPeer(BadPeer):
    """An e-CAP server that runs scripts."""

    def __init__(self, *scripts: Script) -> None:
        super().__init__(*scripts)
        self.posts: list[Post] = []
        self._turn = threading.Lock()
        self._accepted: list[HttpLine] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def _accept(self) -> None:
        while True:
            try:
                accepted, _ = self._listener.accept()
            except OSError:  # shut down by __exit__
                return
            connection = HttpLine(Line(accepted), self)
            self._accepted.append(connection)
            self._start(self._read, connection)
            if self.stopping.is_set():  # __exit__ may have missed this connection
                connection.shut()

    def _read(self, connection: HttpLine) -> None:
        try:
            while True:
                self._take(Asked(connection, connection.post().body))
        except Gone:
            for line in list(self._lines):
                line.left(connection)

    def _take(self, asked: Asked) -> None:
        """Pass a request to the running script, or start the next one."""
        with self._turn:
            if self._lines and self._lines[-1].take(asked):
                return
            line = EcapLine()
            line.take(asked)
            self._lines.append(line)
            self._start(self._run, self._scripts[min(len(self._lines), len(self._scripts)) - 1], line)
            if self.stopping.is_set():
                line.shut()

    def _run(self, script: Script, line: EcapLine) -> None:
        try:
            script(line)
        except Gone:
            pass
        except Exception as error:  # noqa: BLE001 - raised by __exit__
            self._errors.append(error)
        finally:
            untaken = line.end()
            self.ended.release()
            for asked in untaken:
                self._take(asked)

    def __exit__(self, *error: object) -> None:
        self.stopping.set()
        for connection in list(self._accepted):
            connection.shut()
        try:
            super().__exit__(*error)
        finally:
            for connection in self._accepted:
                connection.close()


PEERS: Final[dict[str, type[BadPeer]]] = {**wired_peers.PEERS, "http": EcapPeer}
"""Peers by the scheme of the listen address of a server."""
