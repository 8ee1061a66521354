"""The actions that a b-CAP conversation of a server yields (:mod:`orinkit.bcap.server`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from orinkit.core.errors import ProtocolError
from orinkit.core.record import record
from orinkit.values.variant import Variant


@record
class Send:
    """Send bytes."""

    data: bytes


@record
class Close:
    """Close the link after pending data has been sent; ``reason`` is for the log."""

    reason: str


@record
class EndSession:
    """Release the client's objects and cancel its call, as if the client had disconnected; the link stays open.

    Attributes:
        reason: for the log.
        keeps_replies: True if replies that have not been transmitted yet are for the client whose session ends.
    """

    reason: str
    keeps_replies: bool = False


@record
class Continue:
    """Do nothing; request the next action after serving other clients. The search for a packet in noise takes longer."""


@record
class Execute:
    """Execute a call, then pass this object and the result to :meth:`ServerConversation.finish`."""

    serial: int
    function_id: int
    arguments: list[Variant]


@record(eq=False)
class Decode:
    """Call ``read``, which decodes a large packet, in a worker thread, so that other clients are served meanwhile.

    Then pass this object and the result of ``read`` to :meth:`ServerConversation.decoded`. Until then, further calls of
    the client return E_BUSY_PROC.

    Attributes:
        size: number of bytes of the packet.
    """

    serial: int
    function_id: int
    size: int
    read: Callable[[], list[Variant] | ProtocolError]


class Encoded(NamedTuple):
    """An encoded result, or the error code if it cannot be sent.

    Attributes:
        code: the error code; ``None`` if the result can be sent.
        body: the result, encoded as one argument.
        room: for a large result, used instead of ``body``: a buffer with the encoded argument and room for the rest of
            the packet, so that the argument is not copied.
    """

    code: int | None
    body: bytes = b""
    room: bytearray | None = None


Action: TypeAlias = Send | Execute | Decode | Continue | Close | EndSession
