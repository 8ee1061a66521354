"""A TCP relay that records what passes through it."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from typing import Self

from support.waiting import PATIENCE


class Relay:
    """Forwards one connection after another to a server.

    Args:
        port: Port of the server on 127.0.0.1.

    Attributes:
        url: Address to connect to.
        streams: For each connection, all bytes that the client has sent, and all that it has received.
    """

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self.streams: list[tuple[bytearray, bytearray]] = []
        self._sockets: list[socket.socket] = [self._listener]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
                self._sockets += [client, server]
                streams = bytearray(), bytearray()
                self.streams.append(streams)
                for source, target, record in ((client, server, streams[0]), (server, client, streams[1])):
                    thread = threading.Thread(target=_forward, args=(source, target, record), daemon=True)
                    self._threads.append(thread)
                    thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join(PATIENCE)


def _forward(source: socket.socket, target: socket.socket, record: bytearray) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            record += data
            target.sendall(data)
        target.shutdown(socket.SHUT_WR)
