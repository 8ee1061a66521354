"""Captures of packets in pcapng files (``--capture``)."""

from __future__ import annotations

import os
import socket
import time
import weakref
from io import FileIO
from ipaddress import ip_address
from typing import Final

from orinkit import __version__
from orinkit.bcap.pcapng import SERIAL_LINE, CaptureConnection, PcapngWriter
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.i18n import tr
from orinkit.transport.address import Address, HttpAddress, is_loopback
from orinkit.transport.registry import AnyAddress

LOCAL_PORT: Final = 49152
"""The port under which packets of this program are written, because the real one is not known to a trace callback."""

_LOOPBACK: Final = {4: "127.0.0.1", 6: "::1"}
_UNKNOWN_LOCAL: Final = {4: "192.0.2.1", 6: "2001:db8::1"}  # addresses for documentation: RFC 5737, RFC 3849
_UNKNOWN_REMOTE: Final = "192.0.2.2"


class CaptureFile:
    """Writes every packet to a new pcapng file, as the ``trace=`` callback of a client.

    A packet is in the file as soon as the callback returns, so the file is complete if the program is interrupted.

    Args:
        path: File to create, with access for this account only.
        address: Address of the controller.

    Raises:
        CommandError: If the file exists, or cannot be created.
    """

    def __init__(self, path: str, address: AnyAddress) -> None:
        self._path = path
        self._connection = connection_of(address)
        try:
            self._file = FileIO(path, "x", opener=_private)  # unbuffered
        except FileExistsError:
            raise usage_error(tr("--capture {path}: the file exists. Try: another name", path=path)) from None
        except (OSError, ValueError) as error:
            raise CommandError(f"--capture {path}: {getattr(error, 'strerror', None) or error}", 2) from None
        weakref.finalize(self, self._file.close)
        self._writer = PcapngWriter(self._write, f"orinkit {__version__}")

    def __call__(self, direction: str, data: bytes) -> None:
        """Write a packet with the current time."""
        self._writer.packet(time.time_ns(), direction, data, connection=self._connection)

    def _write(self, data: bytes) -> None:
        try:
            while data:
                data = data[self._file.write(data) or 0 :]
        except OSError as error:
            raise CommandError(tr("cannot write {path}: {reason}", path=self._path, reason=error.strerror)) from None


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


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
