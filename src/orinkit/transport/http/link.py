"""Synchronous e-CAP over HTTP for clients; the asynchronous counterpart is :mod:`orinkit.transport.http.aio_link`.

A call is one POST over a persistent connection (:mod:`orinkit.transport.http.connection`).
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Final, Self

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require
from orinkit.transport.address import HttpAddress
from orinkit.transport.http.body import Body
from orinkit.transport.http.response import NEED, SHOWING, SHOWN
from orinkit.transport.link_errors import closed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.runner import Deadline

require(tr(NEED), "http", "httpx2")

import httpcore2  # noqa: E402 - report a missing package first
import httpx2  # noqa: E402 - as above

from orinkit.transport.http.base import HttpLinkBase  # noqa: E402 - as above
from orinkit.transport.http.connection import HttpConnection  # noqa: E402 - as above

_OK: Final = 200
_SIGN: Final = b"\n"


class HttpLink(HttpLinkBase):
    """A link to an e-CAP server, used by one thread at a time."""

    def _begin(self) -> None:
        self._transport = HttpConnection(self._known, self._url)
        self._client = httpx2.Client(transport=self._transport, trust_env=False)
        self._busy = threading.Lock()
        self._owner = 0  # the thread that sent the request
        self._request: bytes | None = None  # not posted yet
        self._body: Body | None = None
        self._pieces: Iterator[bytes] = iter(())

    @classmethod
    def open(cls, address: HttpAddress, opening: LinkOptions) -> Self:
        """Create a link, as :func:`orinkit.transport.links.open_link`; the first request opens the connection."""
        return cls(address, opening.access, opening.most, dead_after=opening.dead_after)

    def send(self, data: bytes, seconds: float) -> None:
        """Store the body of a request, which :meth:`receive` posts.

        An earlier request without a reply is cancelled, and its connection closed. If the calling thread is closing the
        link, another thread may still wait for the earlier reply. The :meth:`receive` of the other thread then ends as
        if the link were closed.

        Raises:
            ConnectionClosed: If the link is closed, or the other thread still waits after ``seconds``.
        """
        if not self._open:
            raise self._unusable()
        if not self._busy.acquire(blocking=False):
            self._transport.interrupt()
            if not self._busy.acquire(timeout=seconds):
                raise closed()
        try:
            self._transport.interrupted = False
            self._drop()
            self._request = data
            self._owner = threading.get_ident()
        finally:
            self._busy.release()
            if self._transport.closed:
                self._close_idle()

    def receive(self, seconds: float) -> bytes | None:
        """Post the request, if it is not posted yet, and return the received data.

        Args:
            seconds: Time-out, s; extended to :attr:`patience` if the server does not report that a call is executing.

        Returns:
            The complete reply; a line feed if the server reports that the call is executing; ``b""`` if the server has
            closed the connection without a reply; ``None`` if the time has passed. In the last case the request is
            cancelled, and nothing more is received until the next request.

        Raises:
            ConnectFailed: If the server cannot be reached, or rejects this client.
            ConnectionLost: If the connection was lost, or the session has ended.
            TransportError: If the server has not executed the call.
            ProtocolError: If the data received is not an e-CAP reply.
            LimitExceeded: If the reply is too long.
            ConnectionClosed: If the link is closed, before or during the call.
        """
        if not self._open:
            raise self._unusable()
        try:
            with self._busy:
                return self._received(seconds)
        finally:
            if self._transport.closed:
                self._close_idle()

    def _received(self, seconds: float) -> bytes | None:
        if self._owner not in (0, threading.get_ident()):
            raise closed()  # another thread is closing the link, and has sent a request to do so
        try:
            data = self._go_on(seconds)
        except (OrinError, httpcore2.TimeoutException, httpcore2.ProtocolError) as error:
            self._drop()
            if self._transport.stopped:
                raise closed() from error
            if isinstance(error, httpcore2.TimeoutException):
                return None
            if isinstance(error, OrinError):
                raise
            if self._transport.closed_without_reply:
                self._contact.check_closed()
                return b""
            raise self._contact.broken(error, ended=self._transport.ended) from error
        if self._transport.closed:
            raise closed()
        return data

    def _go_on(self, seconds: float) -> bytes | None:
        self._transport.deadline = Deadline(seconds)
        if self._request is not None:
            request, self._request = self._request, None  # the request is cleared first, so that it is posted only once
            self._post(request, seconds)
        if self._body is None:
            return None
        for piece in self._pieces:
            if self._body.add(piece):
                return _SIGN
        body, self._body = self._body, None
        return body.whole()

    def _post(self, data: bytes, seconds: float) -> None:
        self._transport.connect()
        longer = self._wait(data, seconds)
        if longer > seconds:
            self._transport.deadline = Deadline(longer)
        request = httpx2.Request("POST", self._url, headers=self._contact.fields(seconds), content=data)
        response = self._client.send(request, stream=True)
        headers = response.headers.multi_items()
        if response.status_code != _OK:
            raise self._contact.refusal(response.status_code, headers, self._shown(response), len(data))
        self._body = self._contact.accept(headers)
        self._pieces = response.iter_raw()

    def _shown(self, response: httpx2.Response) -> bytes:
        """Return the part of the body of an error response that arrives within 1 s and before the call's deadline."""
        self._transport.deadline = Deadline(min(self._transport.deadline.left, SHOWING))
        shown = b""
        try:
            for piece in response.iter_raw():
                shown += piece
                if len(shown) >= SHOWN:
                    break
        except (OrinError, httpcore2.TimeoutException, httpcore2.ProtocolError):
            pass  # the status is sufficient
        return shown[:SHOWN]

    def _drop(self) -> None:
        """Cancel the request in progress, if any."""
        self._request = self._body = None
        self._pieces = iter(())
        self._transport.close_unless_idle()

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the connection stays open in the parent."""
        super().after_fork_in_child()
        self._busy = threading.Lock()
        return self._transport.after_fork_in_child()

    def close(self) -> None:
        """Close the link; a receive pending in another thread ends immediately."""
        self._open = False
        self._transport.close()
        self._close_idle()

    def _close_idle(self) -> None:
        """Close the descriptor of the connection, unless a thread is in :meth:`receive`.

        In that case the descriptor stays open: if it were closed, its number could be reused before that thread has
        returned.
        """
        if self._busy.acquire(blocking=False):
            try:
                self._transport.close_idle()
            finally:
                self._busy.release()
