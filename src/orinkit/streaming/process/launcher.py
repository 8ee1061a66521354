"""Starting a streaming process, and what a program has of it."""

from __future__ import annotations

import fcntl
import os
import socket
import subprocess
import sys
import threading
from time import monotonic
from typing import Any, Final

from orinkit.core.errors import OrinError, StreamError
from orinkit.core.i18n import tr
from orinkit.streaming.planning.jerk_limited import load_ruckig
from orinkit.streaming.process.channel import Channel, rebuild
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.realtime import RealTime
from orinkit.streaming.process.shared_memory import StreamMemory
from orinkit.transport.links import lendable
from orinkit.transport.registry import Transport

_START: Final = """
import sys
sys.path[:] = {path!r}
from orinkit.streaming.process.main import main
main({channel}, {link}, {memory}, {adopt!r}, {profile!r})
"""
_PATIENCE: Final = 15.0  # s; a call of the streaming process is over by then, whatever the controller does
_LET_GO: Final = 5.0  # s that a process which has nothing more to do may take to end


class StreamerProcess:
    """A streaming process.

    Args:
        link: descriptor of the connection that it is to have.
        kind: of the connection: the name of its profile.

    Attributes:
        shared: memory that it reads and writes.
        real_time: what it obtained; ``None`` until it is ready.
        began: whether it has been given the connection.
        streaming: whether it is in slave mode.
        ended: whether it has given the connection back.
        reason: why it ended.
        error: what it failed with.
        serial: of the next packet, once it has ended.

    Raises:
        StreamError: it cannot be started.
        MissingExtra: a package is missing.
    """

    def __init__(self, link: int, kind: str) -> None:
        row = lendable(kind)
        load_ruckig()  # what the process is going to import; said here, where somebody reads it
        if os.name != "posix" or not sys.executable or hasattr(sys, "frozen"):
            raise StreamError(
                tr("streaming in slave mode needs Linux or another POSIX system, and a Python that can be started")
            )
        self.shared = StreamMemory.make()
        self.real_time: RealTime | None = None
        self.began = False
        self.streaming = False
        self.ended = False
        self.reason = ""
        self.error: OrinError | None = None
        self.serial = 1
        self._lock = threading.Lock()
        self._seen: tuple[object, ...] = ()
        self._since = monotonic()
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours)
        try:
            self._process = _start(theirs.fileno(), link, self.shared.descriptor, row)
        except OSError as error:
            self._channel.close()
            self.shared.close()
            raise StreamError(
                tr("the streaming process cannot be started: {error}", error=error)
            ) from error  # fmt: skip
        finally:
            theirs.close()

    def begin(self, setup: StreamerConfig) -> None:
        """Have it enter slave mode and stream."""
        self.began = True
        self._channel.send(setup.to_message())

    def look(self) -> None:
        """Take note of what it has said, without waiting; one that does not go on any more is ended."""
        with self._lock:  # several threads may look
            self._look()
            if not self.ended and self._stuck():
                self._process.kill()
                self.ended = True
                self.reason = "died"
                self.error = StreamError(
                    tr(
                        "the streaming process has done nothing for {seconds:g} s; it was killed, the "
                        "connection given up",
                        seconds=_PATIENCE,
                    )
                )

    def _stuck(self) -> bool:
        state = (self.real_time, self.began, self.streaming, self.shared.samples)
        if state != self._seen:
            self._seen, self._since = state, monotonic()
        waits_for_us = self.real_time is not None and not self.began
        return not waits_for_us and monotonic() - self._since > _PATIENCE

    def _look(self) -> None:
        while not self.ended:
            message = self._channel.receive(0)
            if message is not None:
                self._note(message)
            elif self._channel.open:
                return
            else:
                self.ended = True
                self.reason = "died"
                self.error = StreamError(
                    tr(
                        "the streaming process ended unexpectedly (exit code {exit_code}); the connection was given up",
                        exit_code=self._exit_code(),
                    )
                )

    def _note(self, message: dict[str, Any]) -> None:
        if "ready" in message:
            self.real_time = RealTime(message["priority"], message["locked"])
        elif "streaming" in message:
            self.streaming = True
        elif "ended" in message:
            self.ended, self.streaming = True, False
            self.reason, self.serial = message["reason"], message["serial"]
            self.error = rebuild(message["error"]) if message["error"] else None

    def _exit_code(self) -> int | None:
        try:
            return self._process.wait(_LET_GO)
        except subprocess.TimeoutExpired:
            return None

    def close(self) -> None:
        """Let go of it: it ends by itself, at once if it has ended streaming; does nothing the second time."""
        self._channel.close()
        if self.ended or not self.began:
            end = monotonic() + _LET_GO
            while self._process.poll() is None:
                try:
                    self._process.wait(max(0.01, end - monotonic()))
                except subprocess.TimeoutExpired:
                    self._process.kill()
        self.shared.close()


def _start(channel: int, link: int, memory: int, row: Transport) -> subprocess.Popen[bytes]:
    """Start a process that has these descriptors.

    Raises:
        OSError: it cannot be started.
    """
    numbers: list[int] = []
    try:
        # where a standard stream is closed, one of these may have its number, which the new process needs for that
        numbers.extend(fcntl.fcntl(each, fcntl.F_DUPFD_CLOEXEC, 3) for each in (channel, link, memory))
        path = [str(place) for place in sys.path]
        program = _START.format(
            path=path, channel=numbers[0], link=numbers[1], memory=numbers[2], adopt=row.adopt, profile=row.profile
        )
        return subprocess.Popen(  # noqa: S603 - this very Python
            [sys.executable, "-c", program],
            stdin=subprocess.DEVNULL,
            pass_fds=numbers,
            start_new_session=True,  # Ctrl-C at the terminal is for the program
        )
    finally:
        for number in numbers:
            os.close(number)
