"""The direct path of a call on a stream: one send, one receive, without the generator of the conversation.

:func:`call` and :func:`call_prepared` make the whole exchange of one call of the synchronous client; :func:`acall` and
:func:`acall_prepared` do the same in asyncio. The caller holds the lock of the connection, and has checked that
``conversation.direct`` is True, that neither a trace nor a deadline nor signs of life are required, and that the link
is a :class:`DirectLink`.

Each function has one of three results:

* ``(code, value)``: the reply had a success code. ``value`` is what ``BcapConversation.call`` would return.
* :class:`Unfinished`: the request was sent, but what was received is not exactly this reply: an error code, S_EXECUTING,
  a part of a packet, several packets, another serial, other data, the end of the stream, or a time-out. The caller runs
  ``conversation.resume(...)``, with the same bytes and the same end of the wait. No received byte has been consumed.
* ``None`` (prepared calls only): the template has no layout for the value. Nothing was sent, and no serial was used.

An exception leaves the link as ``send`` and ``receive`` leave it; an exception other than ``OrinError`` means that
received bytes may be lost, so that the caller closes the link (:func:`break_off`).

The extension in C (:mod:`orinkit.core.speedups`) replaces :func:`call` and :func:`call_prepared` if the link has the
attribute ``kernel_seconds``, and calls the functions here for other links. With the other paths, it shares
``conversation.serial`` (1 to 65535, incremented once per request, before sending), and the socket of the link.
"""

from __future__ import annotations

from time import monotonic
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from orinkit.bcap.client import BcapConversation
from orinkit.bcap.direct import RequestTemplate
from orinkit.cao.table import Function
from orinkit.core.errors import OrinError
from orinkit.core.speedups import EXTENSION, replaced_in_c
from orinkit.transport.runner import Link, run
from orinkit.values.types import VarType


class DirectLink(Protocol):
    """A link over a stream that can send and receive in one step."""

    def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Send all bytes, then return the next received bytes, as ``send`` and ``receive`` do."""

    def close(self) -> None:
        """Close the link."""


@runtime_checkable
class SyncDirectLink(Link, DirectLink, Protocol):
    """A :class:`DirectLink` with all methods of a link."""


class AsyncDirectLink(Protocol):
    """A link over a stream that can send and receive in one step, in asyncio."""

    async def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Queue all bytes for sending, then return the next received bytes, as ``send`` and ``receive`` do."""

    def close(self) -> None:
        """Close the link."""


class Unfinished(NamedTuple):
    """A call whose request was sent, and which has to be continued by ``BcapConversation.resume``.

    Attributes:
        serial: Serial of the request.
        received: The received bytes, ``b""`` at the end of the stream, ``None`` after a time-out.
        end: End of the wait for the reply (``time.monotonic``), s.
    """

    serial: int
    received: bytes | None
    end: float


Outcome: TypeAlias = tuple[int, Any] | Unfinished


if hasattr(EXTENSION, "set_exchange"):
    EXTENSION.set_exchange(Unfinished, VarType.VARIANT, VarType.I4, VarType.BSTR)


@replaced_in_c
def call(
    conversation: BcapConversation,
    link: DirectLink,
    function: Function[..., Any],
    arguments: tuple[Any, ...],
    seconds: float,
    exact: bool,
) -> Outcome:
    """Make a call; see the docstring of the module for the result.

    Args:
        conversation: State of the protocol.
        link: Link to the controller.
        function: Function of CAO.
        arguments: The result of :meth:`~orinkit.cao.table.Function.bind`.
        seconds: Time-out, s.
        exact: True to return the result as a :class:`~orinkit.values.variant.Variant`.

    Raises:
        InvalidValue: If an argument does not fit its type; nothing was sent.
        ConnectionLost: If the connection failed.
        ProtocolError: If the result is invalid.
    """
    serial, request = conversation.begin(function, arguments)
    end = monotonic() + seconds
    received = link.exchange(request, seconds)
    return conversation.finish(function, serial, received, exact) or Unfinished(serial, received, end)


@replaced_in_c
def call_prepared(
    conversation: BcapConversation,
    link: DirectLink,
    function: Function[..., Any],
    template: RequestTemplate,
    value: Any,
    seconds: float,
) -> Outcome | None:
    """Make a prepared call; see the docstring of the module for the result.

    Args:
        conversation: State of the protocol.
        link: Link to the controller.
        function: Function of CAO.
        template: Result of :meth:`~orinkit.bcap.client.BcapConversation.template`.
        value: The varying argument, ``None`` if there is none.
        seconds: Time-out, s.

    Raises:
        ConnectionLost: If the connection failed.
        ProtocolError: If the result is invalid.
    """
    begun = conversation.begin_prepared(template, value)
    if begun is None:
        return None
    serial, request = begun
    end = monotonic() + seconds
    received = link.exchange(request, seconds)
    return conversation.finish(function, serial, received) or Unfinished(serial, received, end)


def run_prepared(
    conversation: BcapConversation,
    link: SyncDirectLink,
    function: Function[..., Any],
    template: RequestTemplate,
    value: Any,
    arguments: tuple[Any, ...],
    seconds: float,
) -> tuple[int, Any] | None:
    """Make a prepared call, and continue it with ``resume`` if necessary.

    Args:
        conversation: State of the protocol.
        link: Link to the controller.
        function: Function of CAO.
        template: Result of :meth:`~orinkit.bcap.client.BcapConversation.template`.
        value: The varying argument.
        arguments: All arguments, for the message of an error.
        seconds: Time-out, s.

    Returns:
        Return code and result; ``None`` if the template has no layout for the value, so that nothing was sent.

    Raises:
        CallError: If the controller returned an error code.
        CallTimeout: If there was no reply in time.
        ConnectionLost: If the connection failed.
        ProtocolError: If the reply is invalid.
    """
    serial = conversation.serial
    try:
        outcome = call_prepared(conversation, link, function, template, value, seconds)
        if isinstance(outcome, Unfinished):
            operation = conversation.resume(outcome.serial, function, arguments, seconds, outcome.received)
            outcome = run(operation, link, end=outcome.end)
    except OrinError:
        raise
    except BaseException:
        if conversation.serial != serial:  # the request was sent
            break_off(link)
        raise
    return outcome


def break_off(link: DirectLink) -> None:
    """Close the link of a call that an exception such as KeyboardInterrupt has interrupted."""
    link.close()


async def acall(
    conversation: BcapConversation,
    link: AsyncDirectLink,
    function: Function[..., Any],
    arguments: tuple[Any, ...],
    seconds: float,
    exact: bool,
) -> Outcome:
    """Make a call, as :func:`call`, in asyncio."""
    serial, request = conversation.begin(function, arguments)
    end = monotonic() + seconds
    received = await link.exchange(request, seconds)
    return conversation.finish(function, serial, received, exact) or Unfinished(serial, received, end)


async def acall_prepared(
    conversation: BcapConversation,
    link: AsyncDirectLink,
    function: Function[..., Any],
    template: RequestTemplate,
    value: Any,
    seconds: float,
) -> Outcome | None:
    """Make a prepared call, as :func:`call_prepared`, in asyncio."""
    begun = conversation.begin_prepared(template, value)
    if begun is None:
        return None
    serial, request = begun
    end = monotonic() + seconds
    received = await link.exchange(request, seconds)
    return conversation.finish(function, serial, received) or Unfinished(serial, received, end)


def abreak_off(link: AsyncDirectLink) -> None:
    """Do nothing: in asyncio, a cancelled call leaves the link open, because no received bytes are lost."""
