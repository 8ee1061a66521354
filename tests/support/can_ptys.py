"""A serial cable without hardware: two pseudo-terminals that forward bytes to each other."""

from __future__ import annotations

import os
import select
import tempfile
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_CHUNK = 4096


@contextmanager
def reserved_name(url: str) -> Iterator[None]:
    """Keep the name of a pseudo-terminal in use, so that no other test gets it after its server has ended.

    A call of a driver reopens a lost bus by its name, and would then take the bytes of the other test.
    """
    end = os.open(url.removeprefix("can://slcan/").partition("?")[0], os.O_RDWR | os.O_NOCTTY)
    try:
        yield
    finally:
        os.close(end)


class CrossedPtys:
    """Two ends of a cable; bytes written to one end can be read at the other.

    Attributes:
        left: path of one end, which may be opened and closed any number of times; a link to ``/dev/pts/3`` or similar.
        right: path of the other end.
    """

    def __init__(self) -> None:
        self._woken, self._wake = os.pipe()
        self._thread: threading.Thread | None = None
        self._directory = tempfile.TemporaryDirectory(prefix="ptys")
        self._ends = [Path(self._directory.name, name) for name in ("left", "right")]
        self.left, self.right = map(str, self._ends)
        self._plug()

    def _plug(self) -> None:
        self._masters: list[int] = []
        self._slaves: list[int] = []  # kept open: a master fails when the last descriptor of its slave is closed
        for link in self._ends:
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._masters.append(master)
            self._slaves.append(slave)
            link.symlink_to(os.ttyname(slave))
        self.go_on()

    def _copy(self, one: int, other: int) -> None:
        poll = select.poll()
        for end in (one, other, self._woken):
            poll.register(end, select.POLLIN)
        while True:
            for end, _ in poll.poll():
                if end == self._woken:
                    os.read(self._woken, 1)
                    return
                self._pass(end, other if end == one else one)

    def _pass(self, source: int, sink: int) -> None:
        data = os.read(source, _CHUNK)
        for _ in range(100):
            try:
                data = data[os.write(sink, data) :]
            except BlockingIOError:
                pass
            if not data:
                return
            room = select.poll()
            room.register(sink, select.POLLOUT)
            room.poll(10)  # the buffer is full: after 1 s the rest is lost, as on a cable

    def write(self, end: str, data: bytes) -> None:
        """Inject bytes at an end."""
        master = self._masters[(self.left, self.right).index(end)]
        os.write(master, data)

    def stall(self) -> None:
        """Stop forwarding in both directions, as an adapter that hangs; may be called again."""
        if self._thread is not None:
            os.write(self._wake, b"\0")
            self._thread.join()
            self._thread = None

    def go_on(self) -> None:
        """Resume forwarding, beginning with the bytes that have been waiting."""
        self._thread = threading.Thread(target=self._copy, args=self._masters, name="crossed ptys", daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Unplug the adapters: reading and writing fail, and the ports do not exist; may be called again."""
        if self._masters:
            self.stall()
            for end in (*self._masters, *self._slaves):
                os.close(end)
            for link in self._ends:
                link.unlink()
            self._masters, self._slaves = [], []

    def restore(self) -> None:
        """Plug the adapters in again, with the same paths."""
        self.cut()
        self._plug()

    def close(self) -> None:
        """Unplug the adapters and release all resources."""
        self.cut()
        os.close(self._wake)
        os.close(self._woken)
        self._directory.cleanup()


@contextmanager
def crossed_ptys() -> Iterator[CrossedPtys]:
    """Provide a cable for the duration of a test."""
    cable = CrossedPtys()
    try:
        yield cable
    finally:
        cable.close()
