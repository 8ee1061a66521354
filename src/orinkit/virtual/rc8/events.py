"""Events for clients: each subscribed client polls its own queue of limited length."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from typing import Final

QUEUE_LENGTH: Final = 256
_LAST_SERIAL: Final = 0x7FFF_FFFF


class EventKind(IntEnum):
    """The type of an event; its value is the number that Message_GetNumber returns."""

    ERROR = 1  #: an error was raised; the value is its code, signed
    MODE = 2  #: the mode was changed; the value is the new value of ``@MODE``
    EMERGENCY_STOP = 3  #: the emergency stop was pressed (value 1) or released (value 0)
    MESSAGE = 4  #: a program executed PrintMsg; the description is the printed text


@dataclass(frozen=True, slots=True)
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
    """The pending events of one client; when it is full, the oldest event is dropped and counted.

    Attributes:
        dropped: Number of events that this client has lost.
    """

    def __init__(self, length: int = QUEUE_LENGTH) -> None:
        self._events: deque[Event] = deque(maxlen=length)
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._events)

    def put(self, event: Event) -> None:
        """Add the newest event."""
        if len(self._events) == self._events.maxlen:
            self.dropped += 1
        self._events.append(event)

    def take(self) -> Event | None:
        """Remove and return the oldest event; ``None`` if the queue is empty."""
        return self._events.popleft() if self._events else None


class Events:
    """Distributes events to the queues of all subscribed clients."""

    def __init__(self) -> None:
        self._queues: list[EventQueue] = []
        self._serials = itertools.count()

    def subscribe(self) -> EventQueue:
        """Return a new queue that receives every event from now on."""
        queue = EventQueue()
        self._queues.append(queue)
        return queue

    def unsubscribe(self, queue: EventQueue) -> None:
        """Stop adding events to a queue; does nothing for a queue that is not subscribed."""
        self._queues = [other for other in self._queues if other is not queue]

    def publish(self, kind: EventKind, value: int, description: str, moment: datetime) -> None:
        """Add an event to every queue."""
        event = Event(next(self._serials) % _LAST_SERIAL + 1, kind, value, description, moment)
        for queue in self._queues:
            queue.put(event)
