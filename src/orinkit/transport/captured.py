"""Connections as captures describe them: :func:`connection_of`."""

from __future__ import annotations

import socket
from ipaddress import ip_address
from typing import Final

from orinkit.bcap.pcapng import SERIAL_LINE, CaptureConnection
from orinkit.transport.address import Address, HttpAddress, is_loopback
from orinkit.transport.registry import AnyAddress

LOCAL_PORT: Final = 49152
"""The port under which packets of this program are written, because the real one is not known to a trace callback."""

_LOOPBACK: Final = {4: "127.0.0.1", 6: "::1"}
_UNKNOWN_LOCAL: Final = {4: "192.0.2.1", 6: "2001:db8::1"}  # addresses for documentation: RFC 5737, RFC 3849
_UNKNOWN_REMOTE: Final = "192.0.2.2"


def connection_of(address: AnyAddress) -> CaptureConnection:
    """Return the connection under which the packets of an address are written.

    The local address and port are placeholders. Packets of a serial line are written as :data:`~.pcapng.SERIAL_LINE`.
    """
    if not isinstance(address, Address | HttpAddress):
        return SERIAL_LINE
    host = _resolved(address.host)
    version = ip_address(host).version
    local = (_LOOPBACK if is_loopback(host) else _UNKNOWN_LOCAL)[version]
    return CaptureConnection("udp" if address.scheme == "udp" else "tcp", (local, LOCAL_PORT), (host, address.port))


def _resolved(host: str) -> str:
    """Return the first IP address of a host; a placeholder if the name is unknown, because no packet is sent then."""
    try:
        return str(socket.getaddrinfo(host, None)[0][4][0])
    except (OSError, UnicodeError):
        return _UNKNOWN_REMOTE
