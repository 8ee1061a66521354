"""A TCP relay between a browser and a Tester that can stop forwarding, like a failed network."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit


class Relay:
    """Forwards all connections to a server until :meth:`cut`; from then on, packets disappear.

    Args:
        url: Address of the server.

    Attributes:
        url: Address of the relay.
    """

    def __init__(self, url: str) -> None:
        self._to = urlsplit(url).hostname, urlsplit(url).port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = [self._listener]
        self._cut = threading.Event()
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Stop forwarding; all connections remain open."""
        self._cut.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._cut.set()
        for each in self._sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)  # ends the wait of its thread
            each.close()

    def _accept(self) -> None:
        while not self._cut.is_set():
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(self._to)
            except OSError:
                return
            self._sockets += [near, far]
            for source, goal in ((near, far), (far, near)):
                threading.Thread(target=self._forward, args=(source, goal), daemon=True).start()

    def _forward(self, source: socket.socket, goal: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                if self._cut.is_set():
                    continue
                goal.sendall(data)
            goal.shutdown(socket.SHUT_WR)
        except OSError:
            pass
