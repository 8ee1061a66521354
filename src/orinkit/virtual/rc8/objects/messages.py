"""Message objects: events fetched by a client (RC8 A: Controller_GetMessage, Message_*)."""

from __future__ import annotations

from orinkit.cao.provider import MessageObject
from orinkit.values.variant import Value, Variant, VarType
from orinkit.virtual.rc8.events import Event


class EventMessage(MessageObject):
    """An event that a client has fetched.

    The number of the message is its :class:`~orinkit.virtual.rc8.events.EventKind`: 1 error, 2 mode, 3 emergency stop,
    4 text printed by a program. The value is a VT_I4. The controller does not wait for an answer, so Message_Reply and
    Message_Clear have no effect.

    Args:
        event: The event.
        source: Type of the controller.
        destination: The client's name for its controller object.
    """

    def __init__(self, event: Event, source: str, destination: str) -> None:
        super().__init__(f"Message{event.serial}", help=event.description)
        self._event = event
        self._source = source
        self._destination = destination

    def reply(self, value: Variant) -> None:
        """Accept a reply without effect."""

    def clear(self) -> None:
        """Accept an acknowledgement without effect: the event has already been removed from the queue."""

    def get_date_time(self) -> Value:
        """Return the time of the event, in the controller's local time."""
        return self._event.moment

    def get_description(self) -> str:
        """Return a description of the event in the controller's language."""
        return self._event.description

    def get_destination(self) -> str:
        """Return the name of the client's controller object."""
        return self._destination

    def get_number(self) -> int:
        """Return the number of the type of event."""
        return self._event.kind

    def get_serial_number(self) -> int:
        """Return the serial number, counted over all events of the controller."""
        return self._event.serial

    def get_source(self) -> str:
        """Return the type of the controller."""
        return self._source

    def get_value(self) -> Value:
        """Return the error code or the new state as a VT_I4; 0 for a printed text."""
        return Variant(VarType.I4, self._event.value)
