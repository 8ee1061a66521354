"""An event as the Message object that a client fetches (RC8 A: Controller_GetMessage, Message_*)."""

from __future__ import annotations

from orinkit.cao.provider import MessageObject
from orinkit.values.variant import Value, Variant, VarType
from orinkit.virtual.rc8.events import Event


class EventMessage(MessageObject):
    """One event, fetched.

    Its number is that of :class:`~orinkit.virtual.rc8.events.EventKind`: 1 error, 2 mode, 3 emergency stop; its value
    is VT_I4. The controller waits for no answer, so a reply and a clear are taken and change nothing.

    Args:
        event: the event.
        source: type of the controller.
        destination: name that the client gave to its controller object.
    """

    def __init__(self, event: Event, source: str, destination: str) -> None:
        super().__init__(f"Message{event.serial}", help=event.description)
        self._event = event
        self._source = source
        self._destination = destination

    def reply(self, value: Variant) -> None:
        """Take an answer."""

    def clear(self) -> None:
        """Take the client's word that it has seen the event; fetching it has removed it already."""

    def get_date_time(self) -> Value:
        """When it happened, controller's local time."""
        return self._event.moment

    def get_description(self) -> str:
        """What happened, in the controller's language."""
        return self._event.description

    def get_destination(self) -> str:
        """Name of the client's controller object."""
        return self._destination

    def get_number(self) -> int:
        """Kind of event."""
        return self._event.kind

    def get_serial_number(self) -> int:
        """Serial number over all events of the controller."""
        return self._event.serial

    def get_source(self) -> str:
        """Type of the controller."""
        return self._source

    def get_value(self) -> Value:
        """Code or state, VT_I4."""
        return Variant(VarType.I4, self._event.value)
