"""Messages between a program and its streaming process: one line of JSON each, over a socket pair."""

from __future__ import annotations

import json
import socket
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, OrinError, ProtocolError, StreamError, error_for

_CHUNK: Final = 65536


class Channel:
    """One end of the channel between a program and its streaming process.

    Attributes:
        open: True while the other end is open.
    """

    def __init__(self, end: socket.socket) -> None:
        self._socket = end
        self._received = b""
        self.open = True

    def send(self, message: dict[str, Any]) -> None:
        """Send a message; it is dropped if the other end is closed."""
        try:
            self._socket.settimeout(None)
            self._socket.sendall(json.dumps(message).encode() + b"\n")
        except OSError:
            self.open = False

    def receive(self, seconds: float) -> dict[str, Any] | None:
        """Return the next message; ``None`` if no message arrives in time, or the other end is closed."""
        while b"\n" not in self._received:
            try:
                self._socket.settimeout(seconds)
                data = self._socket.recv(_CHUNK)
            except (BlockingIOError, TimeoutError):
                return None
            except OSError:
                data = b""
            if not data:
                self.open = False
                return None
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        message: dict[str, Any] = json.loads(line)
        return message

    def close(self) -> None:
        """Close this end."""
        self.open = False
        self._socket.close()


_ERRORS: Final[dict[str, type[OrinError]]] = {
    kind.__name__: kind for kind in (ConnectionLost, ProtocolError, StreamError)
}


def encode_error(error: Exception) -> dict[str, Any]:
    """Return the message that represents an error."""
    if isinstance(error, CallError):
        return {"kind": "CallError", "code": error.code, "detail": error.detail, "function": error.function}
    if isinstance(error, CallTimeout):
        return {"kind": "CallTimeout", "function": error.function, "seconds": error.seconds, "tries": error.tries}
    known = next((name for name, kind in _ERRORS.items() if isinstance(error, kind)), "")
    return {"kind": known or "StreamError", "text": str(error) if known else f"{type(error).__name__}: {error}"}


def decode_error(message: dict[str, Any]) -> OrinError:
    """Return the error that a message represents."""
    kind = message.get("kind")
    if kind == "CallError":
        return error_for(hresult.unsigned(message["code"]), message["detail"], message["function"])
    if kind == "CallTimeout":
        return CallTimeout(message["function"], message["seconds"], message["tries"])
    return _ERRORS.get(str(kind), StreamError)(message.get("text", ""))
