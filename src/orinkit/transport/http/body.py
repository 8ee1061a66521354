"""Assembly of the body of a reply over HTTP."""

from __future__ import annotations

from collections.abc import Callable

from orinkit.core.errors import LimitExceeded, ProtocolError
from orinkit.core.i18n import tr


class Body:
    """The body of a reply, assembled from pieces.

    Args:
        most: The largest number of bytes.
        too_long: Callback that returns the exception for a longer body.
        strange: Callback that returns the exception for an invalid reply; its argument is a description of the reply.
        detail: Description of the call's error, which a header of the reply contained. It is appended to the return
            code, as if the server had sent it in the body. ``b""`` if there is none.
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
        """Add the next bytes of the body.

        Returns:
            True if the bytes are only line feeds before the reply, which report that the call is still executing.

        Raises:
            LimitExceeded: If the body is too long.
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
        """Return the complete reply.

        Raises:
            ProtocolError: If the body is empty.
        """
        if not self._data:
            raise self._strange(tr("it sent an empty reply"))
        if self._detail and b"," not in self._data:
            self._data += b"," + self._detail
        return bytes(self._data)
