"""Starting a streaming process, and the program's interface to it."""

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
from orinkit.streaming.process.channel import Channel, decode_error
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.realtime import RealTime
from orinkit.streaming.process.shared_memory import StreamMemory
from orinkit.transport.links import require_handover
from orinkit.transport.registry import Transport

_START: Final = """
import sys
sys.path[:] = {path!r}
from orinkit.streaming.process.main import main
main({channel}, {link}, {memory}, {adopt!r}, {profile!r})
"""
_HANG_TIMEOUT: Final = (
    15.0  # s; each call of the streaming process ends within this time, even if the controller does not reply
)
_EXIT_TIMEOUT: Final = 5.0  # s in which an idle process must exit


class StreamerProcess:
    """The program's interface to a streaming process.

    Args:
        link: Descriptor of the connection that the process takes over.
        kind: Name of the transport profile of the connection.

    Attributes:
        shared: Shared memory of the two processes.
        real_time: Real-time properties of the process; ``None`` until the process is ready.
        began: True after :meth:`begin`. From this time on, the process uses the connection.
        streaming: True while the process has slave mode turned on.
        ended: True after streaming has ended: the process does not use the connection any more.
        reason: Reason why streaming ended: a value of :data:`~orinkit.streaming.process.streamer.Reason`; ``"died"`` if
            the process ended unexpectedly or was killed; ``""`` while it has not ended.
        error: Error with which streaming ended; ``None`` if there was none.
        serial: Serial number of the next packet, after streaming has ended.

    Raises:
        StreamError: If the process cannot be started.
        MissingExtra: If ruckig is not installed.
    """

    def __init__(self, link: int, kind: str) -> None:
        row = require_handover(kind)
        load_ruckig()  # the process will import ruckig; if it is missing, the program receives the error here
        if os.name != "posix" or not sys.executable or hasattr(sys, "frozen"):
            raise StreamError(
                tr(
                    "streaming in slave mode requires a POSIX system such as Linux, and a Python interpreter that "
                    "can be started (not a frozen program)"
                )
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
                tr("cannot start the streaming process: {error}", error=error)
            ) from error  # fmt: skip
        finally:
            theirs.close()

    def begin(self, setup: StreamerConfig) -> None:
        """Make the process turn slave mode on and send set-points."""
        self.began = True
        self._channel.send(setup.to_message())

    def poll(self) -> None:
        """Process the messages received so far, without waiting; kill the process if it hangs."""
        with self._lock:  # several threads may call this method
            self._read_messages()
            if not self.ended and self._hangs():
                self._process.kill()
                self.ended = True
                self.reason = "died"
                self.error = StreamError(
                    tr(
                        "the streaming process made no progress for {seconds:g} s; it was killed, and the "
                        "connection is closed",
                        seconds=_HANG_TIMEOUT,
                    )
                )

    def _hangs(self) -> bool:
        state = (self.real_time, self.began, self.streaming, self.shared.samples)
        if state != self._seen:
            self._seen, self._since = state, monotonic()
        waits_for_us = self.real_time is not None and not self.began
        return not waits_for_us and monotonic() - self._since > _HANG_TIMEOUT

    def _read_messages(self) -> None:
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
                        "the streaming process ended unexpectedly (exit code {exit_code}); the connection is closed",
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
            self.error = decode_error(message["error"]) if message["error"] else None

    def _exit_code(self) -> int | None:
        try:
            return self._process.wait(_EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            return None

    def close(self) -> None:
        """Close the channel and the shared memory; further calls have no effect.

        The process then exits by itself. If it is not streaming, wait for its exit.
        """
        self._channel.close()
        if self.ended or not self.began:
            end = monotonic() + _EXIT_TIMEOUT
            while self._process.poll() is None:
                try:
                    self._process.wait(max(0.01, end - monotonic()))
                except subprocess.TimeoutExpired:
                    self._process.kill()
        self.shared.close()


def _start(channel: int, link: int, memory: int, row: Transport) -> subprocess.Popen[bytes]:
    """Start a streaming process that inherits the descriptors ``channel``, ``link`` and ``memory``.

    Raises:
        OSError: If the process cannot be started.
    """
    numbers: list[int] = []
    try:
        # If a standard stream of this process is closed, a descriptor may have the number 0, 1 or 2. The new process
        # uses these numbers for its own standard streams. Therefore the descriptors are duplicated with higher numbers.
        numbers.extend(fcntl.fcntl(each, fcntl.F_DUPFD_CLOEXEC, 3) for each in (channel, link, memory))
        path = [str(place) for place in sys.path]
        program = _START.format(
            path=path, channel=numbers[0], link=numbers[1], memory=numbers[2], adopt=row.adopt, profile=row.profile
        )
        return subprocess.Popen(  # noqa: S603 - the running interpreter
            [sys.executable, "-c", program],
            stdin=subprocess.DEVNULL,
            pass_fds=numbers,
            start_new_session=True,  # the program handles Ctrl-C at the terminal
        )
    finally:
        for number in numbers:
            os.close(number)
