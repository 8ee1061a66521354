"""Information on a client, which a provider receives when the client connects."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


def _no_description(code: int) -> str:  # noqa: ARG001 - the signature of ClientInfo.describe_error
    return ""


class ClientInfo(NamedTuple):
    """Information on a client.

    Attributes:
        address: host address of the client, ``"127.0.0.1"``; on a serial line the path of the port.
        transport: ``"tcp"``, ``"udp"``, ``"serial"``, ``"http"`` or ``"memory"``.
        port: the client's port number, 0 if there is none.
        when_input_processed: function that invokes a callback after the server has processed all data received from
            this client so far. The function itself returns immediately and may be called from any thread. Real-time
            devices use it, because the server may read data late. ``None`` if received data is always processed
            immediately.
        provider: the provider name that the client has requested, as sent.
        describe_error: returns the description of the client's last error with a given return code; ``""`` if unknown.
        is_unnamed: True if the client has sent no name for its controller, so that the server has chosen one.
        disconnect: function that closes the client's connection for a given reason; without a connection, it ends the
            client's session. It may be called from any thread. ``None`` if there is no connection.
    """

    address: str = ""
    transport: str = "memory"
    port: int = 0
    when_input_processed: Callable[[Callable[[], None]], None] | None = None
    provider: str = ""
    describe_error: Callable[[int], str] = _no_description
    is_unnamed: bool = False
    disconnect: Callable[[str], None] | None = None
