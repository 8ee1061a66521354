"""The scripted peers of :mod:`peers` on UDP and on a serial line, running the same scripts, which use packets for TCP.

A line converts the packets: on UDP each packet becomes a datagram, on a serial line a checksum is added. Bytes that are not
a packet are sent unchanged.
"""

from __future__ import annotations

import os
import select
import socket
import time
import tty
from collections.abc import Iterator
from types import TracebackType
from typing import Final, Self

from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE, BcapProfile
from orinkit.values.codec import DEFAULT_LIMITS
from support.peers import PATIENCE, BadPeer, Gone, Line, Script


def parts(data: bytes) -> Iterator[bytes]:
    """Yield the packets in some bytes, and the bytes between them."""
    between = 0
    place = 0
    while place < len(data):
        length = int.from_bytes(data[place + 1 : place + 5], "little")
        if data[place] == packet.SOH and packet.is_whole(data[place : place + length]):
            if between < place:
                yield data[between:place]
            yield data[place : place + length]
            place = between = place + length
        else:
            place += 1
    if between < place:
        yield data[between:]


class WiredLine(Line):
    """One client, as used by a script."""

    def __init__(self, wire: BcapProfile) -> None:
        self._wire = wire
        self._frames = wire.framer(wire.bound(DEFAULT_LIMITS))

    def request(self) -> Packet:
        """Return the client's next packet."""
        frame = self._frames.next_frame()
        while frame is None:
            frame = self._frames.feed(self._receive())
        return packet.decode(frame, crc=self._wire.crc)

    def reset(self) -> None:
        """Close the line: there is no connection to reset."""
        self.close()


class UdpLine(WiredLine):
    """A client on UDP: the sender of the latest datagram."""

    def __init__(self, connection: socket.socket) -> None:
        super().__init__(DATAGRAM)
        self._socket = connection
        self._client: tuple[str, int] | None = None
        self._over = False
        connection.settimeout(PATIENCE)

    def _receive(self) -> bytes:
        if self._over:
            raise Gone
        try:
            data, sender = self._socket.recvfrom(65536)
        except OSError as error:
            raise Gone from error
        if self._over:
            raise Gone
        self._client = sender
        return data

    def send(self, data: bytes) -> None:
        """Send each packet as a datagram."""
        try:
            for part in parts(data):
                self._socket.sendto(part, self._client or ("", 0))
        except OSError as error:
            raise Gone from error

    def shut(self) -> None:
        """Stop receiving; wake a waiting thread with a datagram, because a UDP socket has no end of stream."""
        self._over = True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
            try:
                waker.sendto(b"\0", self._socket.getsockname())
            except OSError:  # the socket is closed
                pass

    def close(self) -> None:
        """Close the socket."""
        self._over = True
        self._socket.close()


class SerialLine(WiredLine):
    """A client on a serial line."""

    def __init__(self, descriptor: int, stopped: int) -> None:
        super().__init__(LINE)
        self._descriptor = descriptor
        self._stopped = stopped

    def _receive(self) -> bytes:
        readable, _, _ = select.select([self._descriptor, self._stopped], [], [], PATIENCE)
        if self._descriptor not in readable:
            raise Gone
        return os.read(self._descriptor, 65536)

    def send(self, data: bytes) -> None:
        """Send bytes; a checksum is added to each packet."""
        self._write(b"".join(map(_with_checksum, parts(data))))

    def _write(self, data: bytes) -> None:
        while data:
            stopped, writable, _ = select.select([self._stopped], [self._descriptor], [], PATIENCE)
            if stopped or not writable:
                raise Gone
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:
                continue

    def send_in_pieces(self, *pieces: bytes) -> None:
        """Send bytes piece by piece; the last piece contains the checksum."""
        whole = b"".join(map(_with_checksum, parts(b"".join(pieces))))
        for piece in pieces[:-1]:
            self._write(whole[: len(piece)])
            whole = whole[len(piece) :]
            time.sleep(0.001)
        self._write(whole)

    def shut(self) -> None:
        """Do nothing: the peer wakes a waiting thread."""

    def close(self) -> None:
        """Do nothing: the peer closes the pseudo-terminal."""


def _with_checksum(part: bytes) -> bytes:
    if not packet.is_whole(part):
        return part
    _, _, serial, reserved, code, count = packet.HEADER.unpack_from(part)
    return packet.pack(serial, code, count, part[packet.HEADER.size : -1], reserved, crc=True)


class UdpPeer(BadPeer):
    """A UDP peer that runs one script, for the senders of datagrams."""

    def __init__(self, *scripts: Script) -> None:
        super().__init__(*scripts)
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._datagrams.bind(("127.0.0.1", 0))

    @property
    def url(self) -> str:
        return f"udp://127.0.0.1:{self._datagrams.getsockname()[1]}"

    def _accept(self) -> None:
        """Wait for the first datagram, because the script may be set after the peer has started."""
        self._datagrams.settimeout(PATIENCE)
        try:
            self._datagrams.recvfrom(1, socket.MSG_PEEK)
        except OSError:
            return
        line = UdpLine(self._datagrams)
        self._lines.append(line)
        if self.stopping.is_set():  # __exit__ may have missed this line
            line.shut()
        self._run(self._scripts[0], line)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
            self.stopping.set()
            try:
                waker.sendto(b"\0", self._datagrams.getsockname())
            except OSError:  # a script has closed it
                pass
        super().__exit__(kind, error, trace)
        self._datagrams.close()


class SerialPeer(BadPeer):
    """A peer on a serial line that runs one script, for the client that opens the line."""

    def __init__(self, *scripts: Script) -> None:
        super().__init__(*scripts)
        self._end, self._other_end = os.openpty()
        tty.setraw(self._other_end)
        os.set_blocking(self._end, False)
        self._woken, self._wake = os.pipe()

    @property
    def url(self) -> str:
        return f"serial://{os.ttyname(self._other_end)}"

    def _accept(self) -> None:
        select.select([self._end, self._woken], [], [], PATIENCE)
        line = SerialLine(self._end, self._woken)
        self._lines.append(line)
        self._run(self._scripts[0] if self._scripts else lambda _: None, line)

    def __enter__(self) -> Self:
        return super().__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._wake, b"\0")
        try:
            super().__exit__(kind, error, trace)
        finally:
            for end in (self._end, self._other_end, self._woken, self._wake):
                os.close(end)


PEERS: Final[dict[str, type[BadPeer]]] = {"tcp": BadPeer, "udp": UdpPeer, "pty": SerialPeer}
"""Peers by the scheme of the listen address of a server."""
