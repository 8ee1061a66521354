"""The bus of a CAN server behind a pseudo-terminal: a program opens it like a serial adapter with the slcan protocol.

The bus exists on this machine only, and only programs of the same user can open it. It has no network address, so that
several servers never share a bus by accident. One program at a time can use it.
"""

from __future__ import annotations

import os
import re
import select
from collections import deque
from collections.abc import Iterable
from typing import Final

from orinkit.can.frame import MAX_ID, CanFrame, checked
from orinkit.can.invalid_frames import InvalidFrameLog
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress

_CHUNK: Final = 4096
_LONGEST_LINE: Final = 64
_LONGEST_QUEUE: Final = 16 * 1024  # bytes that the program has not read; further frames are dropped
_END: Final = b"\r"
_FRAME: Final = re.compile(rb"T([0-9A-Fa-f]{8})([0-8])((?:[0-9A-Fa-f]{2})*)")


class SlcanPort:
    """The adapter's side of the slcan protocol (Lawicel), without I/O.

    The commands ``O`` and ``L`` open the channel, ``C`` closes it, ``T`` sends an extended frame. All other lines are
    ignored, because devices on this bus use extended frames only. No command is acknowledged.

    Attributes:
        is_open: True while the program has opened the channel; frames are sent only then.
        opened: Number of times that the channel was opened.
    """

    def __init__(self) -> None:
        self.is_open = False
        self.opened = 0
        self._line = bytearray()

    def feed(self, data: bytes) -> list[CanFrame]:
        """Process received bytes; return the frames that they contain."""
        self._line += data
        frames = []
        *lines, rest = bytes(self._line).split(_END)
        for line in lines:
            frame = self._process(line)
            if frame is not None:
                frames.append(frame)
        self._line = bytearray(rest[-_LONGEST_LINE:])
        return frames

    def _process(self, line: bytes) -> CanFrame | None:
        if line in (b"O", b"L"):
            self.is_open = True
            self.opened += 1
        elif line == b"C":
            self.is_open = False
        found = _FRAME.fullmatch(line)
        if not self.is_open or found is None:
            return None
        number, data = int(found[1], 16), bytes.fromhex(found[3].decode())
        return CanFrame(number, data) if number <= MAX_ID and len(data) == int(found[2]) else None

    @staticmethod
    def encode(frame: CanFrame) -> bytes:
        """Return the line of a received frame.

        Raises:
            InvalidValue: If the frame is not valid.
        """
        checked(frame)
        return f"T{frame.id:08X}{len(frame.data)}{frame.data.hex().upper()}\r".encode()


class PseudoTerminalBus:
    """The bus of a CAN server that a program opens as ``can://slcan//dev/pts/NUMBER``.

    All methods except :meth:`close` are called from one thread. The bus outlives the programs that use it, one after
    the other.

    Attributes:
        url: Address for the program, as for :func:`orinkit.can.bus.open_bus`.

    Raises:
        ConnectFailed: If this system has no pseudo-terminals.
    """

    def __init__(self) -> None:
        if not hasattr(os, "openpty"):
            raise ConnectFailed(tr("this system has no pseudo-terminals. Try: can://udp_multicast/239.74.163.2"))
        import tty

        # the other end stays open here, because this end fails whenever the last descriptor of the other one is closed
        self._end, self._other_end = os.openpty()
        tty.setraw(self._other_end)
        os.set_blocking(self._end, False)
        self.url = str(CanAddress("slcan", os.ttyname(self._other_end), options=(("sleep_after_open", 0),)))
        self._port = SlcanPort()
        self._frames: deque[CanFrame] = deque()
        self._queue = bytearray()
        self._invalid = InvalidFrameLog()

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` after a time-out."""
        if not self._frames:
            self._wait(seconds)
        return self._frames.popleft() if self._frames else None

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Send frames, in order; drop them if no program has opened the channel, or the program does not read them."""
        for frame in frames:
            if self._port.is_open and len(self._queue) < _LONGEST_QUEUE:
                try:
                    self._queue += SlcanPort.encode(frame)
                except Exception as error:  # noqa: BLE001 - caused by an invalid frame of a device
                    self._invalid.add(self.url, frame, error)
        self._flush()

    def close(self) -> None:
        """Close the pseudo-terminal; the program's bus is then lost. May be called again."""
        ends, self._end, self._other_end = (self._end, self._other_end), -1, -1
        for end in ends:
            if end >= 0:
                os.close(end)

    def _wait(self, seconds: float) -> None:
        poll = select.poll()
        poll.register(self._end, select.POLLIN | (select.POLLOUT if self._queue else 0))
        for _, event in poll.poll(max(0.0, seconds) * 1e3):
            if event & select.POLLOUT:
                self._flush()
            if event & select.POLLIN:
                self._read()

    def _read(self) -> None:
        try:
            data = os.read(self._end, _CHUNK)
        except BlockingIOError:
            return
        opened = self._port.opened
        self._frames.extend(self._port.feed(data))
        if not self._port.is_open or self._port.opened != opened:
            self._queue.clear()  # these frames are not for the next program

    def _flush(self) -> None:
        try:
            while self._queue:
                del self._queue[: os.write(self._end, self._queue)]
        except BlockingIOError:
            return
