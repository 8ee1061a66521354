"""The scripted peers of :mod:`peers` as servers of e-CAP: the same scripts, in which packets are those of TCP.

A request becomes a packet, with a serial that the peer counts. A packet that answers it becomes its reply, S_EXECUTING a line
feed ahead of it. A second answer travels behind the first; one that answers nothing has nowhere to go. What is no packet
goes as it is, over the connection of the request that the script took last.

One script sees all connections, as a client makes a new one after a call that it has given up. When it has ended the next
request is for the next script.
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
    """Return a reply with this body."""
    return http_peers.reply(body, "200 OK", WORKING)


def on_the_wire(line: Line, answer: bytes) -> bytes:
    """Return a packet as it travels on a line."""
    return ecap(_body(packet.decode(answer, exact=True))) if isinstance(line, EcapLine) else answer


def _body(answer: Packet) -> bytes:
    return write_reply(answer.code, answer.arguments[0] if answer.arguments else None)


@dataclass
class Asked:
    """A request: where it came from, and how far its reply is."""

    connection: HttpLine
    body: bytes
    begun: bool = False
    answered: bool = False

    def reply(self, answer: Packet) -> bytes:
        """Return what a packet adds to the reply."""
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
    """All connections of one client, as a script sees them."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._open: list[HttpLine] = []
        self._asked: list[Asked] = []  # the first has serial 1
        self._requests: deque[Packet] = deque()
        self._taken = 0  # requests, by the script
        self._over = False  # the client has taken leave
        self._closed = False

    # --- from the connections -----------------------------------------------------------------------------------

    def take(self, asked: Asked) -> bool:
        """Take a request, unless the line has been closed."""
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
        """Take note of the end of a connection, if it is one of this line's."""
        with self._changed:
            if connection in self._open:
                self._open.remove(connection)
                self._changed.notify_all()

    # --- for the script -----------------------------------------------------------------------------------------

    def request(self) -> Packet:
        """Return the client's next request; it has left when it has said so and has no connection any more."""
        with self._changed:
            self._wait_for(lambda: self._requests or (self._over and not self._open))
            if not self._requests:
                raise Gone
            self._taken += 1
            return self._requests.popleft()

    def wait_for_end(self) -> None:
        """Wait until the client has no connection any more; it is answered when it takes leave."""
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
        """Send packets as what they are here; a client that has given up the call is not there any more."""
        for connection, translated in self._translated(data):
            try:
                connection.send(translated)
            except Gone:
                pass

    def send_in_pieces(self, *pieces: bytes) -> None:
        """Send packets in as many pieces, cut at about the same places."""
        whole = b"".join(pieces)
        for connection, translated in self._translated(whole):
            places = [place * len(translated) // len(whole) for place in accumulate(map(len, pieces))]
            try:
                connection.send(*(translated[begin:end] for begin, end in pairwise([0, *places])))
            except Gone:
                pass

    def _translated(self, data: bytes) -> list[tuple[HttpLine, bytes]]:
        """Return what goes over which connection, in one piece."""
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
        """End all connections; the peer closes them."""
        for connection in self._shut():
            connection.shut()

    close = shut

    def end(self) -> list[Asked]:
        """End the connections that the script has seen; returns the requests that it has not taken."""
        with self._changed:
            untaken = self._asked[self._taken :] if self._taken else []
            for asked in untaken:
                if asked.connection in self._open:
                    self._open.remove(asked.connection)
            self.shut()
        return untaken

    def reset(self) -> None:
        """Break all connections."""
        for connection in self._shut():
            broken = connection.line._socket
            try:
                broken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                broken.shutdown(socket.SHUT_RD)  # who reads from it ends; the client sees nothing of that
                with self._changed:
                    self._changed.wait_for(lambda: connection not in self._open, PATIENCE)  # noqa: B023
                connection.reset()
            except OSError:  # the client, or the test, has gone first
                pass

    def _shut(self) -> list[HttpLine]:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            return list(self._open)


class EcapPeer(BadPeer):
    """Runs scripts for clients of e-CAP."""

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
            if self.stopping.is_set():  # nobody ends it any more
                connection.shut()

    def _read(self, connection: HttpLine) -> None:
        try:
            while True:
                self._take(Asked(connection, connection.post().body))
        except Gone:
            for line in list(self._lines):
                line.left(connection)

    def _take(self, asked: Asked) -> None:
        """Give a request to the script that runs, or to the next one."""
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
        except Exception as error:  # noqa: BLE001 - is raised in the test itself
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
"""By the scheme of the address that a server would listen at."""
