"""e-CAP over HTTP for clients, on the caller's own thread; the asynchronous twin is :mod:`orinkit.transport.http.aio_link`.

A call is one POST over a connection that is kept for the next one (:mod:`orinkit.transport.http.connection`).
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Final, Self

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.http.body import Body
from orinkit.transport.http.response import MOST, NEED, SHOWING, SHOWN
from orinkit.transport.link_errors import closed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.runner import Deadline
from orinkit.transport.tcp_keepalive import DEAD_AFTER

require(tr(NEED), "http", "httpx2")

import httpcore2  # noqa: E402 - what is missing is to be told first
import httpx2  # noqa: E402

from orinkit.transport.http.base import HttpLinkBase  # noqa: E402
from orinkit.transport.http.connection import HttpConnection, KnownServer, url_of  # noqa: E402

_OK: Final = 200
_SIGN: Final = b"\n"


class HttpLink(HttpLinkBase):
    """A server of e-CAP, used by one thread at a time; nothing is opened before the first request.

    Args:
        address: of the server.
        access: what lets a client in.
        most: bytes of a reply.
        known: what is known of the server already.
        dead_after: seconds without an answer from the server's machine after which a connection is given up.

    Raises:
        InvalidValue: the token cannot be sent, or there are no certificates in the file.
    """

    def __init__(
        self, address: HttpAddress, access: Credentials = NOTHING, most: int = MOST, *, known: KnownServer | None = None,
        dead_after: float = DEAD_AFTER,
    ) -> None:  # fmt: skip
        super().__init__(address, access, most, known=known, dead_after=dead_after)
        self._url = url_of(self._contact)
        self._transport = HttpConnection(self._known, self._url)
        self._client = httpx2.Client(transport=self._transport, trust_env=False)
        self._busy = threading.Lock()
        self._owner = 0  # the thread that the request is of
        self._request: bytes | None = None  # that has not been posted
        self._body: Body | None = None
        self._pieces: Iterator[bytes] = iter(())

    @classmethod
    def open(cls, address: HttpAddress, opening: LinkOptions) -> Self:
        """Make a link, as :func:`orinkit.transport.links.open_link`; the first request connects."""
        return cls(address, opening.access, opening.most, dead_after=opening.dead_after)

    def send(self, data: bytes, seconds: float) -> None:
        """Keep the body of a request, which :meth:`receive` posts.

        An earlier one that has not been answered is given up, and its connection closed. If another thread still waits
        for its answer, this one is about to close the link: the other's :meth:`receive` ends as if that had been done.

        Raises:
            ConnectionClosed: the link was closed before; or that other thread did not end within the seconds.
        """
        if not self._open:
            raise self._unusable()
        if not self._busy.acquire(blocking=False):
            self._transport.halt()
            if not self._busy.acquire(timeout=seconds):
                raise closed()
        try:
            self._transport.halted = False
            self._drop()
            self._request = data
            self._owner = threading.get_ident()
        finally:
            self._busy.release()
            if self._transport.closed:
                self._let_go()

    def receive(self, seconds: float) -> bytes | None:
        """Post the request, if that has not been done, and return what comes.

        Args:
            seconds: to wait; longer, :attr:`patience`, for a server that cannot say that it is at work.

        Returns:
            the whole answer; a line feed as a sign that the server is at work; ``b""`` if it has closed the connection
            without an answer; ``None`` when the seconds have passed. The request is then given up, and nothing more
            comes until the next one.

        Raises:
            ConnectFailed: nobody is there, or does not let this client in.
            ConnectionLost: the connection broke, or the session has ended.
            TransportError: the server has not carried out the call.
            ProtocolError: what came is no answer of e-CAP.
            LimitExceeded: it is too long.
            ConnectionClosed: the link was closed before, or is meanwhile.
        """
        if not self._open:
            raise self._unusable()
        try:
            with self._busy:
                return self._received(seconds)
        finally:
            if self._transport.closed:
                self._let_go()

    def _received(self, seconds: float) -> bytes | None:
        if self._owner not in (0, threading.get_ident()):
            raise closed()  # the link belongs to who closes it
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
            if self._transport.unanswered:
                return b""
            raise self._contact.broken(error, ended=self._transport.ended) from error
        if self._transport.closed:
            raise closed()
        return data

    def _go_on(self, seconds: float) -> bytes | None:
        self._transport.deadline = Deadline(seconds)
        if self._request is not None:
            request, self._request = self._request, None  # whatever happens, it is posted once
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
        longer = self._contact.wait(data, seconds)
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
        """Return as much of the body of an error as comes soon."""
        self._transport.deadline = Deadline(min(self._transport.deadline.left, SHOWING))
        shown = b""
        try:
            for piece in response.iter_raw():
                shown += piece
                if len(shown) >= SHOWN:
                    break
        except (OrinError, httpcore2.TimeoutException, httpcore2.ProtocolError):
            pass  # the status says enough
        return shown[:SHOWN]

    def _drop(self) -> None:
        """Give up the request that is under way, if there is one."""
        self._request = self._body = None
        self._pieces = iter(())
        self._transport.drop()

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the connection goes on in its parent."""
        super().left_behind()
        self._busy = threading.Lock()
        return self._transport.left_behind()

    def close(self) -> None:
        """Close; a receive that another thread is in ends at once."""
        self._open = False
        self._transport.close()
        self._let_go()

    def _let_go(self) -> None:
        """Give the descriptor back, unless a thread is in :meth:`receive`: it could be another file's before that has ended."""
        if self._busy.acquire(blocking=False):
            try:
                self._transport.let_go()
            finally:
                self._busy.release()
