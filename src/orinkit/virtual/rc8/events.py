"""Events for clients: each subscribed client polls its own queue of limited length."""

from __future__ import annotations

from collections import deque
from datetime import datetime
from enum import IntEnum
from typing import Final

from orinkit.core.record import record

QUEUE_LENGTH: Final = 256
_LAST_SERIAL: Final = 0x7FFF_FFFF


class EventKind(IntEnum):
    """The type of an event; its value is the number that Message_GetNumber returns."""

    ERROR = 1  #: an error was raised; the value is its code, signed
    MODE = 2  #: the mode was changed; the value is the new value of ``@MODE``
    EMERGENCY_STOP = 3  #: the emergency stop was pressed (value 1) or released (value 0)
    MESSAGE = 4  #: a program executed PrintMsg; the description is the printed text


@record
class Event:
    """One event.

    Attributes:
        serial: Serial number, counted from 1 over all events of the controller; a gap means that events were lost.
        kind: Type of the event.
        value: Code or state as described in :class:`EventKind`; signed, 32 bits.
        description: Text in the controller's language.
        moment: Local date and time of the controller.
    """

    serial: int
    kind: EventKind
    value: int
    description: str
    moment: datetime


class EventQueue:
    """The pending events of one client, at most 256; older ones are dropped and counted.

    All queues share the events of :class:`Events`, so that an event takes the same time for any number of queues.

    Args:
        events: The events of the controller; those published from now on belong to the queue.
    """

    def __init__(self, events: Events) -> None:
        self._events: Events | None = events
        self._next = events.published  # number of the next event to take
        self._dropped = 0

    def __len__(self) -> int:
        self._drop()
        return 0 if self._events is None else self._events.published - self._next

    @property
    def dropped(self) -> int:
        """Number of events that this client has lost."""
        self._drop()
        return self._dropped

    def take(self) -> Event | None:
        """Remove and return the oldest event; ``None`` if the queue is empty."""
        if self._events is None or not len(self):
            return None
        event = self._events.recent[self._next - self._events.published]
        self._next += 1
        return event

    def close(self) -> None:
        """Discard the pending events, and add no further events."""
        self._events = None

    def _drop(self) -> None:
        if self._events is not None:
            lost = self._events.published - len(self._events.recent) - self._next
            if lost > 0:
                self._dropped += lost
                self._next += lost


class Events:
    """Distributes events to the queues of all subscribed clients.

    Attributes:
        recent: The latest events.
        published: Number of all events so far.
    """

    def __init__(self) -> None:
        self.recent: deque[Event] = deque(maxlen=QUEUE_LENGTH)
        self.published = 0

    def subscribe(self) -> EventQueue:
        """Return a new queue that receives every event from now on."""
        return EventQueue(self)

    def publish(self, kind: EventKind, value: int, description: str, moment: datetime) -> None:
        """Add an event to every queue."""
        self.recent.append(Event(self.published % _LAST_SERIAL + 1, kind, value, description, moment))
        self.published += 1
