"""What both links over HTTP show of their server."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Self

from orinkit.core.errors import StreamError
from orinkit.core.i18n import tr
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.http.connection import KnownServer, context_of
from orinkit.transport.http.response import MOST, HttpServerInfo
from orinkit.transport.registry import rows
from orinkit.transport.tcp_keepalive import DEAD_AFTER


class HttpLinkBase(ProcessBound, ABC):
    """What both links show of their server.

    Args:
        address: of the server.
        access: what lets a client in.
        most: bytes of a reply.
        known: what is known of the server already, ``None`` for nothing.
        dead_after: seconds without an answer from its machine after which a connection is given up.

    Raises:
        InvalidValue: the token cannot be sent, or there are no certificates in the file.
    """

    def __init__(
        self, address: HttpAddress, access: Credentials = NOTHING, most: int = MOST, *, known: KnownServer | None = None,
        dead_after: float = DEAD_AFTER,
    ) -> None:  # fmt: skip
        if known is None:
            known = KnownServer(HttpServerInfo(address, access, most), context_of(address, access), dead_after)
        self._known = known
        self._contact = known.contact
        self._open = True
        keep_from_children(self)

    @property
    def tells(self) -> bool | None:
        """Whether the server says that it is at work on a call; ``None`` where that is not known yet."""
        return self._contact.tells

    @property
    def patience(self) -> float:
        """Seconds that a server gets for a call that cannot say that it is at work; may be set."""
        return self._contact.patience

    @patience.setter
    def patience(self, seconds: float) -> None:
        self._contact.patience = seconds

    def fileno(self) -> int:
        """Refuse.

        Raises:
            StreamError: a connection over HTTP cannot be lent.
            ConnectionClosed: the link has been closed.
        """
        if not self._open:
            raise self._unusable()
        raise _not_to_be_lent()

    def another(self) -> Self:
        """Return a link to the same server, for the same client, over which nothing is under way.

        It is closed where the server has never answered, and so knows nothing of this client.
        """
        made = type(self)(self._contact.address, known=self._known)
        if self.tells is None:
            made.close()
        return made

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the connection goes on in its parent."""
        self._open, self._left = False, True
        return ()

    def release(self) -> None:
        """Close, as nobody else can have it."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Close; a receive that is waiting ends at once."""


def _not_to_be_lent() -> StreamError:
    """Return the exception for a connection that another process is to have."""
    return StreamError(
        tr(
            "a connection over HTTP cannot be lent to another process. Try: slave mode with set-points over {others}",
            others=", ".join(f"{row.scheme}://" for row in rows() if row.adopt),
        )
    )
