"""Captures of packets in pcapng files (``--capture``)."""

from __future__ import annotations

import os
import time
import weakref
from io import FileIO

from orinkit import __version__
from orinkit.bcap.pcapng import PcapngWriter
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.i18n import tr
from orinkit.transport.captured import connection_of
from orinkit.transport.registry import AnyAddress


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
