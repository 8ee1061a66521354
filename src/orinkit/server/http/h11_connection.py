"""The state of an HTTP/1.1 connection: h11 with two changes."""

from __future__ import annotations

from typing import Final

import h11

LONGEST_HEADER: Final = 32 * 1024
"""Limit on the request line and the headers, bytes."""


class StepwiseConnection(h11.Connection):
    """The state of an HTTP connection.

    It joins the header of a response with the data that follows, so that one packet is sent instead of two. It returns
    a limited number of events at a time, because each chunk of a body is an event, and received data may contain
    thousands of chunks.

    Attributes:
        events: number of events that :meth:`next_event` still returns.
        is_interrupted: True if :meth:`next_event` has not been able to return an event.
    """

    def __init__(self) -> None:
        super().__init__(h11.SERVER, LONGEST_HEADER)
        self.events = 0
        self.is_interrupted = False
        self._header: list[bytes] = []

    def next_event(self) -> type[h11.NEED_DATA | h11.PAUSED] | h11.Event:
        """Return the next event of the received data; NEED_DATA if no further events are allowed.

        Raises:
            h11.RemoteProtocolError: If the data is not HTTP/1.1, or the header is too long.
        """
        if not self.events:
            self.is_interrupted = True
            return h11.NEED_DATA
        self.events -= 1
        return super().next_event()

    def send_with_data_passthrough(self, event: h11.Event) -> list[bytes] | None:
        """Return the bytes to send for an event of h11; the bytes of a header are returned with the next event."""
        pieces = super().send_with_data_passthrough(event)
        if type(event) is h11.Response:
            self._header = pieces or []
            return []
        if self._header and pieces is not None:
            pieces = self._header + pieces
            self._header = []
        return pieces
