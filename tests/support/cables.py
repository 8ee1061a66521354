"""Links between clients and a server that a test cuts, like a cable."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from typing import Self

from support.bad_links import BadUdp, as_it_is, lose

_RESET = struct.pack("ii", 1, 0)  # closing sends RST instead of FIN


class TcpCable:
    """A relay for TCP; :meth:`cut` resets all connections, and later clients can connect again.

    Args:
        url: Address of the server, with any scheme.

    Attributes:
        url: Address for clients, with the same scheme.
    """

    def __init__(self, url: str) -> None:
        scheme, _, rest = url.partition("://")
        place, slash, path = rest.partition("/")
        self._to = ("127.0.0.1", int(place.rpartition(":")[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._ends: list[socket.socket] = []
        self.url = f"{scheme}://127.0.0.1:{self._listener.getsockname()[1]}{slash}{path}"
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Reset all connections."""
        ends, self._ends = self._ends, []
        for each in ends:
            with contextlib.suppress(OSError):
                each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
                each.shutdown(socket.SHUT_RD)  # wakes the thread that reads
            each.close()

    def mend(self) -> None:
        """Let clients connect again; a TCP cable is always ready."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(self._to)
            except OSError:
                near.close()
                continue
            for each in (near, far):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._ends += [near, far]
            for source, goal in ((near, far), (far, near)):
                threading.Thread(target=self._forward, args=(source, goal), daemon=True).start()

    @staticmethod
    def _forward(source: socket.socket, goal: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                goal.sendall(data)
        with contextlib.suppress(OSError):
            goal.shutdown(socket.SHUT_WR)


class UdpCable:
    """A relay for UDP; between :meth:`cut` and :meth:`mend`, it loses every packet."""

    def __init__(self, url: str) -> None:
        self._lost = False
        self._link = BadUdp(url, lambda _: lambda data: lose(data) if self._lost else as_it_is(data))
        self.url = self._link.url

    def cut(self) -> None:
        """Lose every packet."""
        self._lost = True

    def mend(self) -> None:
        """Carry packets again."""
        self._lost = False

    def __enter__(self) -> Self:
        self._link.__enter__()
        return self

    def __exit__(self, *given: object) -> None:
        self._link.__exit__(*given)


def cable(url: str) -> TcpCable | UdpCable:
    """Return a cable to a server."""
    return UdpCable(url) if url.startswith("udp") else TcpCable(url)
