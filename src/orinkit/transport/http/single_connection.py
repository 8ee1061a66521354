"""Base class of the two HTTP connections of a client.

The two connections are in :mod:`orinkit.transport.http.connection` and, for asyncio, in
:mod:`orinkit.transport.http.aio_link`.
"""

from __future__ import annotations

import ssl
from abc import ABC, abstractmethod
from typing import Generic, NamedTuple, Protocol, TypeVar

import httpcore2
import httpx2

from orinkit.transport.http.response import BEGIN, HttpServerInfo


class KnownServer(NamedTuple):
    """Properties of a server that several links share.

    Attributes:
        contact: The state of the HTTP exchange with the server.
        context: TLS settings to verify the server's certificate; ``None`` without TLS.
        dead_after: Time in s after which a connection is considered lost if the server's machine does not respond.
    """

    contact: HttpServerInfo
    context: ssl.SSLContext | None
    dead_after: float


class StreamBuffers:
    """The buffers of a byte stream: the bytes to be sent, and the beginning of the reply.

    Attributes:
        unsent: Bytes that were written; they are sent by the next read.
        begin: The first bytes of the reply.
        ended: True if the server has closed the connection.
    """

    def __init__(self, contact: HttpServerInfo) -> None:
        self._contact = contact
        self.unsent = bytearray()
        self.begin = b""
        self.ended = False

    def _received(self, data: bytes) -> bytes:
        """Record received bytes, ``b""`` at the end of the stream, and return them."""
        self.ended = not data
        if len(self.begin) < BEGIN:
            self.begin += data[:BEGIN]
            self._contact.check_begin(self.begin)
        return data


class _Http11(Protocol):
    """The state of a connection of httpcore2."""

    def is_available(self) -> bool: ...
    def has_expired(self) -> bool: ...
    def is_idle(self) -> bool: ...


C = TypeVar("C", bound=_Http11)
S = TypeVar("S", bound=StreamBuffers)


class SingleConnection(ABC, Generic[C, S]):
    """A single connection to a server, opened on demand."""

    def __init__(self, known: KnownServer, url: httpx2.URL) -> None:
        self._known = known
        self._contact = known.contact
        self._url = httpcore2.URL(
            scheme=url.raw_scheme, host=url.raw_host, port=known.contact.address.port, target=url.raw_path
        )
        self._connection: C | None = None
        self._stream: S | None = None

    @property
    def ended(self) -> bool:
        """True if the server has closed the connection."""
        return self._stream is not None and self._stream.ended

    @property
    def closed_without_reply(self) -> bool:
        """True if the server has closed the connection without a byte of a reply."""
        return self._stream is not None and self._stream.ended and not self._stream.begin

    def _must_connect(self) -> bool:
        """Return False if there is an idle connection that the server has not closed.

        Otherwise close the connection, if there is one, and return True.
        """
        connection = self._connection
        if connection is not None and connection.is_available() and not connection.has_expired():
            return False
        self.abort()
        return True

    def _begin_exchange(self) -> tuple[C, S]:
        """Return the connection and its stream, ready for a request."""
        assert self._connection is not None
        assert self._stream is not None
        self._stream.begin = b""
        return self._connection, self._stream

    def _to_send(self, request: httpx2.Request) -> httpcore2.Request:
        """Return a request of httpx2 as a request of httpcore2."""
        assert isinstance(request.stream, httpx2.SyncByteStream | httpx2.AsyncByteStream)
        return httpcore2.Request(request.method, self._url, headers=request.headers.raw, content=request.stream)

    def close_unless_idle(self) -> None:
        """Close the connection unless it is idle."""
        if self._connection is not None and not self._connection.is_idle():
            self.abort()

    @abstractmethod
    def abort(self) -> None:
        """Close the connection immediately."""
