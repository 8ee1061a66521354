"""Prepared calls, shared by the asynchronous and the synchronous client; no I/O."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

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
        varies: True if the last argument is not one of the constants.

    Attributes:
        function: Function of CAO.
        template: The template of the packets.
    """

    __slots__ = ("_constants", "_varies", "function", "template")

    def __init__(
        self,
        function: Function[..., Any],
        constants: tuple[Any, ...],
        template: RequestTemplate | None = None,
        *,
        varies: bool = False,
    ) -> None:
        self.function = function
        self.template = template
        self._constants = constants
        self._varies = varies

    def arguments(self, value: Any) -> tuple[Any, ...]:
        """Return all arguments of a call with this value of the varying argument."""
        return (*self._constants, value) if self._varies else self._constants

    @property
    def handle(self) -> int:
        """Handle of the object whose function is called."""
        handle: int = self._constants[0]
        return handle


class PreparedCommand(PreparedFunction):
    """An extended command of an object, with its parameter as the varying argument.

    Args:
        function: The Execute function of the object type.
        constants: Handle of the object, and name of the command.
        template: The template of its packets.
        before: Callback invoked before each call; ``None`` for none.
        convert: Callback that converts parameters for which the template has no layout; ``None`` for none.

    Attributes:
        before: Callback invoked before each call.
        dialect: Dialect for which ``is_long`` is valid; ``None`` before the first call.
        is_long: True if the dialect has a time-out for this command.
    """

    __slots__ = ("_convert", "before", "dialect", "is_long")

    def __init__(
        self,
        function: Function[..., Any],
        constants: tuple[int, str],
        template: RequestTemplate | None,
        before: Callable[[], None] | None = None,
        convert: Callable[[Any], Any] | None = None,
    ) -> None:
        super().__init__(function, constants, template, varies=True)
        self._convert = convert
        self.before = before
        self.dialect: Dialect | None = None
        self.is_long = False

    @property
    def command(self) -> str:
        """Name of the command."""
        name: str = self._constants[1]
        return name

    def arguments(self, value: Any) -> tuple[Any, ...]:
        """Return all arguments of a call with this parameter."""
        return (*self._constants, value if self._convert is None else self._convert(value))


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
