"""Base of the servers that run in a thread of their own."""

from __future__ import annotations

import threading

from orinkit.core.closing import Closing


class ThreadServer(Closing):
    """A server that runs in a background thread, which the subclass starts."""

    _thread: threading.Thread

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the server is closed by another thread, the time has passed, or Ctrl-C is pressed.

        Ctrl-C ends the wait without an exception, so that ``with serve(...) as server: server.wait()`` is a complete
        program.

        Args:
            seconds: maximum time to wait, s; ``None`` for no limit.
        """
        try:
            self._thread.join(seconds)
        except KeyboardInterrupt:
            pass
