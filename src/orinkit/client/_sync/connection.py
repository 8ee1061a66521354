"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``connection.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from orinkit.bcap.client import BcapConversation
from orinkit.client._shared.prepared import PreparedFunction
from orinkit.core.closing import Closing
from orinkit.core.errors import ConnectFailed, ConnectionLost, OrinError, ProtocolError
from orinkit.transport.direct import Outcome, Unfinished, break_off, call, call_prepared
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
        prepared: PreparedFunction,
        value: Any,
        seconds: float,
        *,
        exact: bool = False,
    ) -> tuple[int, Any] | None:
        """Make a call on the direct path (:mod:`orinkit.transport.direct`).

        Args:
            conversation: State of the protocol.
            prepared: The call.
            value: Its varying argument.
            seconds: Time-out, s.
            exact: True to return the result as a Variant.

        Returns:
            Return code and result; ``None`` if the template of the call has no layout for the value, so that nothing
            was sent.
        """
        link: Any = self._link  # of the type that directly_usable() has checked
        serial = conversation.serial
        function, template = prepared.function, prepared.template
        outcome: Outcome | None
        try:
            if template is None:
                outcome = call(conversation, link, function, prepared.arguments(value), seconds, exact)
            else:
                outcome = call_prepared(conversation, link, function, template, value, seconds)
            if isinstance(outcome, Unfinished):
                operation = conversation.resume(
                    outcome.serial, function, prepared.arguments(value), seconds, outcome.received, exact=exact
                )
                return self._run(operation, outcome.end)
        except OrinError as error:
            self._close_if_lost(error)
            raise
        except BaseException:
            if conversation.serial != serial:  # the request was sent
                break_off(link)
            raise
        return outcome

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
