"""Prepared calls, shared by the asynchronous and the synchronous client; no I/O."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol

from orinkit.bcap.client import BcapConversation
from orinkit.bcap.direct import RequestTemplate
from orinkit.cao.table import Function

if TYPE_CHECKING:
    from orinkit.cao.dialect import Dialect
    from orinkit.client._shared.endpoint import AnyConversation
    from orinkit.client._shared.local_calls import LocalCalls

MOST_COMMANDS: Final = 64
"""Largest number of commands that an object keeps prepared."""


class PreparedFunction:
    """A call of a function, with all arguments except for at most the last one.

    Args:
        function: Function of CAO.
        constants: All arguments, or all but the last one.
        template: The template of its packets; ``None`` if each call encodes all arguments.
        subject: Name of the object whose function is called, for the messages of errors.
        varies: True if the last argument is not one of the constants.

    Attributes:
        function: Function of CAO.
        constants: The constant arguments.
        template: The template of the packets.
        native: The template for the extension in C; ``None`` without the extension, or without a template.
        subject: Name of the object.
    """

    __slots__ = ("_varies", "constants", "function", "native", "subject", "template")

    def __init__(
        self,
        function: Function[..., Any],
        constants: tuple[Any, ...],
        template: RequestTemplate | None = None,
        subject: str = "",
        *,
        varies: bool = False,
    ) -> None:
        self.function = function
        self.subject = subject
        self.template = template
        self.native = None if template is None else template.native
        self.constants = constants
        self._varies = varies

    def arguments(self, value: Any) -> tuple[Any, ...]:
        """Return all arguments of a call with this value of the varying argument."""
        return (*self.constants, value) if self._varies else self.constants

    @property
    def handle(self) -> int:
        """Handle of the object whose function is called."""
        handle: int = self.constants[0]
        return handle


class Knowledge(Protocol):
    """Knowledge of a client about an object; a command may invalidate it.

    Attributes:
        forgotten: True if there is none since the last :meth:`forget`.
    """

    forgotten: bool

    def forget(self) -> None:
        """Record that a command may have changed the object."""


class PreparedCommand(PreparedFunction):
    """An extended command of an object, with its parameter as the varying argument.

    Args:
        prepared: The call of the Execute function of the object; its constants are the handle, and the name of the command.
        changes: Knowledge that each call invalidates; ``None`` for none.
        convert: Callback that converts parameters for which the template has no layout; ``None`` for none.

    Attributes:
        changes: Knowledge that each call invalidates.
        short_in: Dialect in which the time-out of the client is sufficient; ``None`` before the first call, or if the
            command requires a time-out of its own.
    """

    __slots__ = ("_convert", "changes", "short_in")

    def __init__(
        self,
        prepared: PreparedFunction,
        changes: Knowledge | None = None,
        convert: Callable[[Any], Any] | None = None,
    ) -> None:
        super().__init__(prepared.function, prepared.constants, prepared.template, prepared.subject, varies=True)
        self._convert = convert
        self.changes = changes
        self.short_in: Dialect | None = None

    @property
    def command(self) -> str:
        """Name of the command."""
        name: str = self.constants[1]
        return name

    def arguments(self, value: Any) -> tuple[Any, ...]:
        """Return all arguments of a call with this parameter."""
        return (*self.constants, value if self._convert is None else self._convert(value))


def directly_usable(
    conversation: AnyConversation, link: object, local: LocalCalls | None, *, signs: bool
) -> BcapConversation | None:
    """Return the conversation if its calls may be direct (:mod:`orinkit.transport.direct`), otherwise ``None``.

    Args:
        conversation: State of the protocol.
        link: Link to the controller.
        local: The calls that the client serves itself.
        signs: True if the client sends signs of life.
    """
    if isinstance(conversation, BcapConversation) and conversation.direct and local is None and not signs:
        return conversation if hasattr(link, "exchange") else None
    return None
