"""Events for clients: each connected client that wants them has its own bounded queue, read by polling."""

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
    """What happened; the number of the message."""

    ERROR = 1  #: an error was raised; the value is its code, signed
    MODE = 2  #: the mode was changed; the value is that of ``@MODE``
    EMERGENCY_STOP = 3  #: the emergency stop was pressed (value 1) or released (value 0)
    MESSAGE = 4  #: a program has said something with PrintMsg; the description is what it said


@dataclass(frozen=True, slots=True)
class Event:
    """One event.

    Attributes:
        serial: counts up from 1 over all events of the controller; a gap tells a client that it has lost some.
        kind: what happened.
        value: code or state, as :class:`EventKind` says; signed, 32 bits.
        description: in the controller's language.
        moment: controller's local date and time.
    """

    serial: int
    kind: EventKind
    value: int
    description: str
    moment: datetime


class EventQueue:
    """The events that wait for one client; when it is full the oldest is dropped and counted.

    Attributes:
        dropped: how many events this client has lost.
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
        """Return the oldest event and remove it; ``None`` when none waits."""
        return self._events.popleft() if self._events else None


class Events:
    """Where events come from and where they go."""

    def __init__(self) -> None:
        self._queues: list[EventQueue] = []
        self._serials = itertools.count()

    def subscribe(self) -> EventQueue:
        """Return a new queue that gets every event from now on."""
        queue = EventQueue()
        self._queues.append(queue)
        return queue

    def unsubscribe(self, queue: EventQueue) -> None:
        """Give the queue no more events; one that gets none already is left as it is."""
        self._queues = [other for other in self._queues if other is not queue]

    def publish(self, kind: EventKind, value: int, description: str, moment: datetime) -> None:
        """Give an event to every queue."""
        event = Event(next(self._serials) % _LAST_SERIAL + 1, kind, value, description, moment)
        for queue in self._queues:
            queue.put(event)
