"""The body of a reply over HTTP, as it comes."""

from __future__ import annotations

from collections.abc import Callable

from orinkit.core.errors import LimitExceeded, ProtocolError
from orinkit.core.i18n import tr


class Body:
    """The body of a reply, as it comes.

    Args:
        most: bytes that it may have.
        too_long: makes the exception for more.
        strange: makes the exception for what cannot be, given what it is.
        detail: what the reply's header says of a failure, which is put behind the return code: it has no other place there.
    """

    def __init__(
        self,
        most: int,
        too_long: Callable[[], LimitExceeded],
        strange: Callable[[str], ProtocolError],
        detail: bytes = b"",
    ) -> None:
        self._detail = detail
        self._most = most
        self._too_long = too_long
        self._strange = strange
        self._data = bytearray()

    def add(self, piece: bytes) -> bool:
        """Take the next bytes; returns True for blank lines ahead of the answer: the server is at work.

        Raises:
            LimitExceeded: there are more than allowed.
        """
        if not self._data:
            piece = piece.lstrip()
            if not piece:
                return True
        if len(self._data) + len(piece) > self._most:
            raise self._too_long()
        self._data += piece
        return False

    def whole(self) -> bytes:
        """Return the answer, which is complete.

        Raises:
            ProtocolError: there is none.
        """
        if not self._data:
            raise self._strange(tr("an empty answer"))
        if self._detail and b"," not in self._data:
            self._data += b"," + self._detail
        return bytes(self._data)
