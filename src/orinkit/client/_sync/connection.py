"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``connection.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from orinkit.bcap.client import BcapConversation
from orinkit.cao.table import Function
from orinkit.core.closing import Closing
from orinkit.core.errors import ConnectFailed, ConnectionLost, OrinError, ProtocolError
from orinkit.transport.direct import Unfinished, break_off, call
from orinkit.transport.runner import DetachedLink, Link, Operation, run

if TYPE_CHECKING:
    from orinkit.client._shared.endpoint import AnyConversation

R = TypeVar("R")


class Connection(Closing):
    """A link to a controller, and the state of its protocol.

    Another process can take the connection over: :meth:`_detach`, :meth:`_reattach`, :meth:`_forfeit`.

    Args:
        link: Link to the controller.
        conversation: Client side of the protocol, without input and output.
    """

    __slots__ = ("_conversation", "_link")

    def __init__(self, link: Link, conversation: AnyConversation) -> None:
        self._link: Link = link
        self._conversation = conversation

    def _run(self, operation: Operation[R], end: float | None = None) -> R:
        """Run an operation; close the link if the connection cannot be used any more.

        Args:
            operation: The operation.
            end: End of the current wait (``time.monotonic``), if the operation continues a direct call.
        """
        try:
            return run(operation, self._link, self._conversation.close_sequence, end)
        except OrinError as error:
            self._close_if_lost(error)
            raise

    def _call_directly(
        self,
        conversation: BcapConversation,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
    ) -> tuple[int, Any]:
        """Make a call on the direct path (:mod:`orinkit.transport.direct`).

        Args:
            conversation: State of the protocol.
            function: Function of CAO.
            arguments: All arguments.
            seconds: Time-out, s.
            exact: True to return the result as a Variant.

        Returns:
            Return code and result.
        """
        link: Any = self._link  # of the type that directly_usable() has checked
        serial = conversation.serial
        try:
            outcome = call(conversation, link, function, arguments, seconds, exact)
            if isinstance(outcome, Unfinished):
                return self._resume(function, arguments, seconds, outcome, exact)
        except BaseException as error:
            self._break_off(error, serial)
            raise
        return outcome

    def _resume(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        unfinished: Unfinished,
        exact: bool = False,
    ) -> tuple[int, Any]:
        """Continue a call that the direct path has not finished."""
        conversation: Any = self._conversation  # of the type that directly_usable() has checked
        operation: Operation[tuple[int, Any]] = conversation.resume(
            unfinished.serial, function, arguments, seconds, unfinished.received, exact=exact
        )
        return self._run(operation, unfinished.end)

    def _break_off(self, error: BaseException, serial: int) -> None:
        """Close the link after a failed direct call if the connection cannot be used any more.

        Args:
            error: The exception with which the call failed.
            serial: Serial number of the next request before the call; it is unchanged if nothing was sent.
        """
        if isinstance(error, OrinError):
            self._close_if_lost(error)
        elif self._conversation.serial != serial:
            link: Any = self._link
            break_off(link)

    def _close_if_lost(self, error: OrinError) -> None:
        """Close the link if the connection cannot be used any more after an error."""
        if isinstance(error, ConnectFailed | ConnectionLost) or (isinstance(error, ProtocolError) and error.fatal):
            self._link.close()

    def _fileno(self) -> int:
        """Return the file descriptor of the connection, for another process."""
        return self._link.fileno()

    def _detach(self, closing: Callable[[], None]) -> int:
        """Hand the connection over to another process; all calls are refused until the connection is reattached.

        Args:
            closing: Callback invoked if this process closes the connection before the connection is reattached.

        Returns:
            Serial number of the next request.
        """
        self._link.fileno()  # from now on, the other process receives the data
        self._link = DetachedLink(self._link, closing)
        return self._conversation.serial

    def _reattach(self, serial: int) -> None:
        """Take the connection back from the other process.

        Args:
            serial: Serial number of the next request.
        """
        if isinstance(self._link, DetachedLink):
            self._link = self._link.link
        self._conversation.serial = serial

    def _forfeit(self) -> None:
        """Close the connection in this process only; the other process keeps it."""
        if isinstance(self._link, DetachedLink):
            self._link = self._link.link
        self._link.close_local()

    @property
    def stray_replies(self) -> int:
        """The number of replies that were late, repeated, or matched no request."""
        return self._conversation.stray_replies
