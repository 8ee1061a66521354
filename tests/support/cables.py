"""Links between clients and a server that a test cuts, like a cable."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import threading
from abc import abstractmethod
from collections.abc import Callable
from typing import Self

from support.bad_links import BadSerial, BadUdp, Piece, Spoil, as_it_is, lose

_RESET = struct.pack("ii", 1, 0)  # closing sends RST instead of FIN
_PATIENCE = 30.0  # s for a thread to end, and for a peer to take data


class _Connection:
    """A relayed connection; its thread alone uses and closes both sockets, so no descriptor is closed under a reader."""

    def __init__(self, near: socket.socket, far: socket.socket) -> None:
        self._goals = {near: far, far: near}
        self._woken, self._wake = socket.socketpair()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Reset both sides, and wait until it is done."""
        with contextlib.suppress(OSError):  # both sides had ended already
            self._wake.send(b"\0")
        self._thread.join(_PATIENCE)
        assert not self._thread.is_alive()
        self._wake.close()

    def _run(self) -> None:
        with contextlib.suppress(OSError), selectors.DefaultSelector() as selector:
            for each in self._goals:
                each.settimeout(_PATIENCE)
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                selector.register(each, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while len(selector.get_map()) > 1 and not self._forward(selector):
                pass
        for each in self._goals:
            each.close()
        self._woken.close()

    def _forward(self, selector: selectors.BaseSelector) -> bool:
        """Forward what has arrived; return True if the connection has been cut."""
        ready = [key.fileobj for key, _ in selector.select()]
        if self._woken in ready:
            for each in self._goals:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            return True
        for source in ready:
            goal = self._goals[source]
            if data := source.recv(65536):
                goal.sendall(data)
            else:
                selector.unregister(source)
                goal.shutdown(socket.SHUT_WR)
        return False


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
        self._connections: list[_Connection] = []
        self._changing = threading.Lock()
        self.url = f"{scheme}://127.0.0.1:{self._listener.getsockname()[1]}{slash}{path}"
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Reset all connections."""
        with self._changing:
            connections, self._connections = self._connections, []
        for each in connections:
            each.cut()

    def mend(self) -> None:
        """Let clients connect again; a TCP cable is always ready."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)  # ends the wait of its thread
        self.cut()

    def _accept(self) -> None:
        with self._listener:
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
                with self._changing:
                    self._connections.append(_Connection(near, far))


class _LossyCable:
    """A relay without connections; between :meth:`cut` and :meth:`mend`, it loses everything.

    Attributes:
        url: Address for clients.
    """

    def __init__(self) -> None:
        self._lost = False
        self._link = self._relay(lambda _: self._carry)
        self.url = self._link.url

    @abstractmethod
    def _relay(self, spoiled: Callable[[str], Spoil]) -> BadUdp | BadSerial: ...

    def _carry(self, data: bytes) -> list[Piece]:
        return lose(data) if self._lost else as_it_is(data)

    def cut(self) -> None:
        """Lose everything."""
        self._lost = True

    def mend(self) -> None:
        """Carry data again."""
        self._lost = False

    def __enter__(self) -> Self:
        self._link.__enter__()
        return self

    def __exit__(self, *given: object) -> None:
        self._link.__exit__(*given)


class UdpCable(_LossyCable):
    """A relay for UDP."""

    def __init__(self, url: str) -> None:
        self._server = url
        super().__init__()

    def _relay(self, spoiled: Callable[[str], Spoil]) -> BadUdp:
        return BadUdp(self._server, spoiled)


class SerialCable(_LossyCable):
    """A relay for the pseudo-terminal of a server."""

    def __init__(self, url: str) -> None:
        self._server = url
        super().__init__()

    def _relay(self, spoiled: Callable[[str], Spoil]) -> BadSerial:
        return BadSerial([self._server], spoiled)


def cable(url: str) -> TcpCable | UdpCable | SerialCable:
    """Return a cable to a server."""
    if url.startswith("udp"):
        return UdpCable(url)
    return SerialCable(url) if url.startswith("serial") else TcpCable(url)
