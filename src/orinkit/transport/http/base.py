"""Base class of the synchronous and the asynchronous link over HTTP."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from math import inf
from typing import Self

from orinkit.core.errors import StreamError
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.http.connection import context_of, url_of
from orinkit.transport.http.response import MOST, HttpServerInfo
from orinkit.transport.http.single_connection import KnownServer
from orinkit.transport.links import no_slave_mode
from orinkit.transport.tcp_keepalive import DEAD_AFTER


class HttpLinkBase(ProcessBound, ABC):
    """Base class of the two links to an e-CAP server; the first request opens the connection.

    Args:
        address: The address of the server.
        access: The client's credentials.
        most: The largest number of bytes of a reply.
        known: Properties of the server, shared with the other links of the session; ``None`` for the first link.
        dead_after: Time in s after which a connection is considered lost if the server's machine does not respond.

    Raises:
        InvalidValue: If the token cannot be sent in a header, or the file ``access.cafile`` contains no certificates.
    """

    def __init__(
        self, address: HttpAddress, access: Credentials = NOTHING, most: int = MOST, *, known: KnownServer | None =
        None,
        dead_after: float = DEAD_AFTER,
    ) -> None:  # fmt: skip
        if known is None:
            known = KnownServer(HttpServerInfo(address, access, most), context_of(address, access), dead_after)
        self._known = known
        self._contact = known.contact
        self._url = url_of(known.contact)
        self._open = True
        self._longest = inf  # limit on the extended time-out of the next request, s
        self._begin()
        keep_from_children(self)

    @abstractmethod
    def _begin(self) -> None:
        """Create the HTTP client, and the rest of the state of an idle link."""

    @property
    def reports_executing(self) -> bool | None:
        """True if the server is one that reports that a call is still executing; ``None`` if that is not known yet."""
        return self._contact.reports_executing

    @property
    def patience(self) -> float:
        """Time-out of a call, s, for a server that does not report that the call is still executing; writable."""
        return self._contact.patience

    @patience.setter
    def patience(self, seconds: float) -> None:
        self._contact.patience = seconds

    def limit_patience(self, seconds: float) -> None:
        """Limit the extended time-out (:attr:`patience`) of the next request, s."""
        self._longest = seconds

    def _wait(self, request: bytes, seconds: float) -> float:
        """Return the time to wait for the reply to a request with the time-out ``seconds``, s."""
        longest, self._longest = self._longest, inf
        return max(seconds, min(self._contact.wait(request, seconds), longest))

    def fileno(self) -> int:
        """Raise StreamError, because another process cannot take over an HTTP connection.

        Raises:
            StreamError: If the link is open.
            ConnectionClosed: If the link is closed.
        """
        if not self._open:
            raise self._unusable()
        raise StreamError(no_slave_mode("http"))

    def another(self) -> Self:
        """Return a new, idle link to the same server, in the same session.

        If the server has never replied, there is no session; the returned link is then already closed.
        """
        made = type(self)(self._contact.address, known=self._known)
        if self.reports_executing is None:
            made.close()
        return made

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the connection stays open in the parent."""
        self._open, self._left = False, True
        return ()

    def close_local(self) -> None:
        """Close the link; no other process can have it."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Close the link; a pending receive ends immediately."""
