"""The Controller object of one client: the door to variables, commands and events."""

from __future__ import annotations

from collections.abc import Sequence

from orinkit.cao.options import Options
from orinkit.cao.provider import ControllerObject, MessageObject, VariableObject, not_found
from orinkit.variant import Value, Variant
from orinkit.virtual.rc8 import commands
from orinkit.virtual.rc8.caller import Caller
from orinkit.virtual.rc8.events import EventQueue
from orinkit.virtual.rc8.messages import EventMessage
from orinkit.virtual.rc8.state import Operation
from orinkit.virtual.rc8.variables import find_variable, variable_names


class RC8Controller(ControllerObject):
    """One client's view of the controller.

    Its attribute is what this client may do: bit 1 read, bit 2 write.

    Args:
        caller: the client.
        option: of Controller_Connect; ``@EventDisable=true`` means no events, others are passed over.

    Attributes:
        events: the events that wait for this client, ``None`` where it wants none.
    """

    def __init__(self, caller: Caller, option: str) -> None:
        state = caller.state
        text = state.say("Virtual RC8 robot controller", "仮想 RC8 ロボットコントローラ")
        super().__init__(caller.origin.caller, attribute=int(caller.access), help=text)
        self.events: EventQueue | None = None if Options(option).flag("@EventDisable") else state.events.subscribe()
        self._caller = caller
        self._connected = True
        state.log(Operation.CONNECT, state.say("Client connected", "クライアント接続"), caller.origin)

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002 - has none that matters
        """Connect to a variable.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; VARIABLE_INDEX_INVALID.
        """
        return find_variable(self._caller, name)

    def get_variable_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
        """Names of the system variables, and the pattern of each class of user variables (``I*``)."""
        return variable_names()

    def execute(self, command: str, parameter: Variant) -> Value:
        """Execute an extended command (:mod:`orinkit.virtual.rc8.commands`)."""
        return commands.execute(self._caller, command, parameter)

    def get_message(self) -> MessageObject:
        """Fetch the oldest waiting event.

        Raises:
            CallError: NO_READ_RIGHT; E_CAO_OBJECT_NOTFOUND, none waits.
        """
        self._caller.require_read()
        event = self.events.take() if self.events else None
        if event is None:
            raise not_found("Message")
        return EventMessage(event, self._caller.state.identity.type, self.name)

    def release(self) -> None:
        """Let go: no more events."""
        if not self._connected:
            return
        self._connected = False
        state = self._caller.state
        if self.events is not None:
            state.events.unsubscribe(self.events)
        state.log(Operation.DISCONNECT, state.say("Client disconnected", "クライアント切断"), self._caller.origin)
