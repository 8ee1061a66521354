"""Shared memory of a program and its streaming process: lock-free queues of set-points and of samples.

The memory consists of 8-byte words, which Python writes atomically. Each side, the program or the streaming process,
writes only its own words. A record (a set-point or a sample) is written before the counter that publishes it. Each
record contains its number, so that a reader detects a record that is being overwritten. The memory has no name: it is
freed when both processes have ended, even if they crash.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from operator import attrgetter
from struct import Struct
from typing import Any, Final

from orinkit.rc8.slave_fields import OUTPUTS, RECEIVED
from orinkit.rc8.slave_lateness import Lateness
from orinkit.streaming.process.record_layout import WORD, RecordLayout

QUEUE_ROOM: Final = 4096
"""Largest number of set-points in the queue: enough for 32 s with a period of 8 ms."""
SAMPLE_ROOM: Final = 4096
"""Largest number of samples in the buffer; if it is full, a new sample replaces the oldest one, even an unread one."""

BEHIND: Final = 15
"""Maximum number of cycles by which an arm lags behind its set-points.

The controller queues 3 set-points (RC8 table 4-4). The encoders follow about 0.1 s later, which is 12 to 13 cycles of
8 ms (in DENSO's published implementations).
"""

RESTS: Final = 3
"""Number of repetitions of a motion's last set-point; two of them make the controller detect standstill (RC8 4.5)."""

_MOST_VALUES: Final = 13  # number of values of a pose with extended joints


class SetPointSource(IntEnum):
    """The source from which the streaming process takes set-points: none, the queue or the live target."""

    NONE = 0
    QUEUE = 1
    TARGET = 2


class StreamCommand(IntEnum):
    """Commands of the program to the streaming process."""

    RUN = 0
    HALT = 1
    """Stop the arm and hold it in slave mode; the program discards the queue itself."""
    FINISH = 2
    """Send the queued set-points, then leave slave mode."""
    LEAVE = 3
    """Stop the arm and leave slave mode."""
    GOODBYE = 4
    """Like LEAVE; afterwards, the streaming process also notifies the controller that the connection ends."""


class _Word(IntEnum):
    """Offsets of the values at the beginning of the memory, in words."""

    ORDER = 0
    ORDER_DONE = 1
    SOURCE = 2
    WRITTEN = 3
    READ = 4
    DISCARDED = 5
    TARGET_BEGUN = 6
    TARGET_DONE = 7
    TARGET_LENGTH = 8
    TARGET_TIME = 9
    TARGET_VALUES = 10
    OUTPUTS_BEGUN = 24
    OUTPUTS_DONE = 25
    OUTPUTS_FLAGS = 26
    SAMPLES = 32
    TAKEN = 33
    UNDERFLOWS = 34
    RESTS = 35
    BEGAN = 36
    LATE = 37
    LATE_LONGEST = 38
    LATE_TOTAL = 39
    OUTPUTS_READ = 40
    SENT_OUTPUTS_FLAGS = 41
    OUTPUTS = 42


_VALUES: Final = [Struct(f"{count}d") for count in range(_MOST_VALUES + 1)]
_SENT: Final = RecordLayout(OUTPUTS, sent=True)
_GOT: Final = RecordLayout(RECEIVED)
_SENT_OUTPUTS_AT: Final = _Word.OUTPUTS + _SENT.size
_HEAD: Final = _SENT_OUTPUTS_AT + _SENT.size
_POINT_OUTPUTS: Final = 2 + _MOST_VALUES  # layout of a set-point: number, flags and count, values, outputs
_POINT: Final = _POINT_OUTPUTS + _SENT.size
_SAMPLE_VALUES: Final = 6  # layout of a sample: number, sent, code, flags and count, delay, replied, command, fields
_SAMPLE_FIELDS: Final = _SAMPLE_VALUES + _MOST_VALUES
_SAMPLE: Final = _SAMPLE_FIELDS + _GOT.size
_QUEUE_AT: Final = _HEAD
_SAMPLES_AT: Final = _QUEUE_AT + QUEUE_ROOM * _POINT
_SIZE: Final = WORD * (_SAMPLES_AT + SAMPLE_ROOM * _SAMPLE)


@dataclass(frozen=True, slots=True)
class Outputs:
    """States of outputs, as slvMove sends them (RC8 table 4-2); ``None`` for outputs that are not sent.

    Attributes:
        mini: States of the mini I/O.
        hand: States of the hand I/O.
        user: Number of the first user I/O point, and bytes with the states of the points from this one on.
    """

    mini: int | None = None
    hand: int | None = None
    user: tuple[int, bytes] | None = None

    def present_items(self) -> dict[str, Any]:
        """Return the outputs that are not ``None``, by name."""
        return {name: value for name, value in self.items() if value is not None}

    def items(self) -> Iterable[tuple[str, Any]]:
        """Return the names and values of all outputs, including those that are ``None``."""
        return zip(_OUTPUT_NAMES, _values(self), strict=True)

    def updated(self, other: Outputs) -> Outputs:
        """Return these outputs, overridden by those of ``other`` that are not ``None``."""
        return self if other is _NO_OUTPUTS else Outputs(**{**self.present_items(), **other.present_items()})


_OUTPUT_NAMES: Final = tuple(row.name for row in OUTPUTS)
_values: Final[Callable[[Outputs], tuple[Any, ...]]] = attrgetter(*_OUTPUT_NAMES)


@dataclass(slots=True)
class RawSample:
    """A sample as the streaming process writes it; see :class:`~orinkit.streaming.recording.samples.Sample`.

    Attributes:
        sent_ns: Time of sending, monotonic clock, ns.
        replied_ns: Time of the reply, monotonic clock, ns.
        code: Return code of slvMove.
        command: Values of the set-point.
        delay_ns: Time from setting a live target to sending the first set-point towards it, ns; -1 for others.
        values: Values of the fields of the reply, by name.
        number: Number of the sample, from 0; set by :meth:`StreamMemory.sample`.
    """

    sent_ns: int
    replied_ns: int
    code: int
    command: tuple[float, ...]
    delay_ns: int = -1
    values: Mapping[str, Any] = field(default_factory=dict)
    number: int = 0


_NO_OUTPUTS: Final = Outputs()


class StreamMemory:
    """The memory shared by a program and its streaming process; each side has an object of this class.

    Args:
        descriptor: Descriptor of the memory; it stays open until :meth:`close`.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._lock = threading.Lock()  # serializes the threads of this side
        self._memory = mmap.mmap(descriptor, _SIZE)
        self._view = memoryview(self._memory)
        self._words = self._view.cast("q")
        self._numbers = self._view.cast("d")
        self._unread_outputs = _NO_OUTPUTS

    @classmethod
    def make(cls) -> StreamMemory:
        """Create new shared memory."""
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("orinkit-stream", os.MFD_CLOEXEC)
        else:
            descriptor, name = tempfile.mkstemp(prefix="orinkit-stream-")
            os.unlink(name)  # noqa: PTH108 - the memory must have no name
        os.ftruncate(descriptor, _SIZE)
        return cls(descriptor)

    @property
    def closed(self) -> bool:
        """True if this side is closed."""
        return self.descriptor < 0

    def close(self) -> None:
        """Close this side; further calls have no effect.

        The memory stays mapped until the last reference to this object is gone, because another thread may be reading
        it.
        """
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    # --- the program's side -------------------------------------------------------------------------------------

    def order(self, order: StreamCommand) -> None:
        """Send a command to the streaming process."""
        count = self._words[_Word.ORDER] >> 8  # distinguishes a command from an earlier, equal one
        self._words[_Word.ORDER] = count + 1 << 8 | order

    @property
    def order_done(self) -> bool:
        """True if the streaming process has executed the last command."""
        return self._words[_Word.ORDER_DONE] == self._words[_Word.ORDER]

    @property
    def queued(self) -> int:
        """The number of set-points in the queue."""
        words = self._words
        return int(words[_Word.WRITTEN] - max(words[_Word.READ], words[_Word.DISCARDED]))

    def put(self, values: Sequence[float], outputs: Outputs = _NO_OUTPUTS) -> None:
        """Queue a set-point; the queue must have room for it."""
        with self._lock:
            words = self._words
            count = words[_Word.WRITTEN]
            at = _QUEUE_AT + count % QUEUE_ROOM * _POINT
            _VALUES[len(values)].pack_into(self._view, (at + 2) * WORD, *values)
            flags = 0 if outputs is _NO_OUTPUTS else _SENT.write(self._view, at + _POINT_OUTPUTS, outputs.items())
            words[at + 1] = flags << 8 | len(values)
            words[at] = count
            words[_Word.WRITTEN] = count + 1

    def select_queue(self) -> None:
        """Make the queue the source of set-points."""
        self._words[_Word.SOURCE] = SetPointSource.QUEUE

    @property
    def discarded_until(self) -> int:
        """The total number of set-points that had been queued when the queue was last discarded; 0 if it never was."""
        return int(self._words[_Word.DISCARDED])

    @property
    def written(self) -> int:
        """The total number of set-points queued so far, including those that were taken or discarded."""
        return int(self._words[_Word.WRITTEN])

    def clear_queue(self) -> None:
        """Discard the set-points queued so far."""
        self._words[_Word.DISCARDED] = self._words[_Word.WRITTEN]

    def set_target(self, values: Sequence[float], when_ns: int) -> None:
        """Set the live target, a goal of the motion that may change at any time, and make it the source of set-points.

        ``when_ns`` is the time at which the program set the target, monotonic clock, ns.
        """
        with self._lock:
            words = self._words
            count = words[_Word.TARGET_BEGUN] + 1
            words[_Word.TARGET_BEGUN] = count
            for offset, value in enumerate(values):
                self._numbers[_Word.TARGET_VALUES + offset] = value
            words[_Word.TARGET_LENGTH] = len(values)
            words[_Word.TARGET_TIME] = when_ns
            words[_Word.TARGET_DONE] = count
            words[_Word.SOURCE] = SetPointSource.TARGET

    def set_outputs(self, outputs: Outputs) -> None:
        """Change outputs; slvMove sends them from the next cycle on, until they are changed again.

        Outputs that are ``None`` do not change. The changes that the streaming process has not yet read are kept.
        """
        with self._lock:
            words = self._words
            if words[_Word.OUTPUTS_READ] != words[_Word.OUTPUTS_DONE]:
                outputs = self._unread_outputs.updated(outputs)
            self._unread_outputs = outputs
            count = words[_Word.OUTPUTS_BEGUN] + 1
            words[_Word.OUTPUTS_BEGUN] = count
            words[_Word.OUTPUTS_FLAGS] = _SENT.write(self._view, _Word.OUTPUTS, outputs.items())
            words[_Word.OUTPUTS_DONE] = count

    @property
    def last_outputs(self) -> Outputs:
        """The outputs that the streaming process last sent, with the changes by :meth:`set_outputs` that it did not read."""
        words = self._words
        sent = Outputs(**_SENT.read(self._view, _SENT_OUTPUTS_AT, words[_Word.SENT_OUTPUTS_FLAGS]))
        read = words[_Word.OUTPUTS_READ] == words[_Word.OUTPUTS_DONE]
        return sent if read else sent.updated(self._unread_outputs)

    def hold(self) -> None:
        """Remove the source of set-points: the arm stops and is held."""
        self._words[_Word.SOURCE] = SetPointSource.NONE

    @property
    def began_ns(self) -> int:
        """The time at which the first set-point was sent, monotonic clock, ns; 0 before that."""
        return int(self._words[_Word.BEGAN])

    @property
    def samples(self) -> int:
        """The number of samples written."""
        return int(self._words[_Word.SAMPLES])

    @property
    def taken(self) -> int:
        """The number of set-points taken from the queue."""
        return int(self._words[_Word.TAKEN])

    @property
    def underflows(self) -> int:
        """The number of underflows: the queue was empty while the arm moved, so that the arm was stopped."""
        return int(self._words[_Word.UNDERFLOWS])

    @property
    def lateness(self) -> Lateness:
        """Statistics of the set-points that would be too late for a real controller.

        All values are 0 if the controller has reported no late set-points. ``count`` and ``total`` refer to all reports
        of the controller, ``longest`` refers to the last report only.
        """
        words, numbers = self._words, self._numbers
        return Lateness(int(words[_Word.LATE]), numbers[_Word.LATE_LONGEST], numbers[_Word.LATE_TOTAL])

    @property
    def at_rest(self) -> bool:
        """True if the commands have come to standstill; the arm itself may still move, because it lags behind."""
        return bool(self._words[_Word.RESTS])

    @property
    def lateness_queried(self) -> bool:
        """True if the controller has detected the standstill, and has been queried for late set-points."""
        return self._words[_Word.RESTS] >= RESTS

    @property
    def settled(self) -> bool:
        """True if the command position has been constant for so long that the arm is at standstill too."""
        return self._words[_Word.RESTS] > BEHIND

    def sample(self, number: int) -> RawSample | None:
        """Return the sample with this number, from 0; ``None`` if a newer sample has overwritten it."""
        words, numbers = self._words, self._numbers
        at = _SAMPLES_AT + number % SAMPLE_ROOM * _SAMPLE
        flags = words[at + 3]
        values_at = at + _SAMPLE_VALUES
        sample = RawSample(
            words[at + 1],
            words[at + 5],
            words[at + 2],
            tuple(numbers[values_at : values_at + min(flags & 0xFF, _MOST_VALUES)]),
            words[at + 4],
            _GOT.read(self._view, at + _SAMPLE_FIELDS, flags >> 8),
            number,
        )
        whole = words[at] == number and self._words[_Word.SAMPLES] - number <= SAMPLE_ROOM
        return sample if whole else None

    # --- the streaming process's side ---------------------------------------------------------------------------

    @property
    def wanted(self) -> StreamCommand:
        """The last command of the program."""
        return StreamCommand(self._words[_Word.ORDER] & 0xFF)

    def mark_done(self) -> None:
        """Report that the streaming process has executed the last :class:`StreamCommand` of the program."""
        self._words[_Word.ORDER_DONE] = self._words[_Word.ORDER]

    @property
    def source(self) -> SetPointSource:
        """The source of set-points that the program has selected."""
        return SetPointSource(self._words[_Word.SOURCE])

    def take(self) -> tuple[tuple[float, ...], Outputs] | None:
        """Remove the next set-point from the queue; return values and outputs, or ``None`` if the queue is empty."""
        words = self._words
        count = max(words[_Word.READ], words[_Word.DISCARDED])
        words[_Word.READ] = count
        if count >= words[_Word.WRITTEN]:
            return None
        at = _QUEUE_AT + count % QUEUE_ROOM * _POINT
        head = words[at + 1]
        flags = head >> 8
        values = tuple(self._numbers[at + 2 : at + 2 + (head & 0xFF)])
        outputs = Outputs(**_SENT.read(self._view, at + _POINT_OUTPUTS, flags)) if flags else _NO_OUTPUTS
        words[_Word.READ] = count + 1
        return values, outputs

    def newer_target(self, seen: int) -> tuple[int, int, tuple[float, ...]] | None:
        """Return the live target, unless it is still the one with the number ``seen``: its number, time in ns, values.

        Return ``None`` if there is no newer target, or while the program is writing the target.
        """
        words = self._words
        done = words[_Word.TARGET_DONE]
        if done == seen:
            return None
        at = int(_Word.TARGET_VALUES)
        values = tuple(self._numbers[at : at + words[_Word.TARGET_LENGTH]])
        when = words[_Word.TARGET_TIME]
        return (done, when, values) if words[_Word.TARGET_BEGUN] == done else None

    def newer_outputs(self, seen: int) -> tuple[int, Outputs] | None:
        """Return the outputs, and the number of times that they were set; ``None`` if this number is still ``seen``.

        Also return ``None`` while the program is writing the outputs.
        """
        words = self._words
        done = words[_Word.OUTPUTS_DONE]
        if done == seen:
            return None
        outputs = Outputs(**_SENT.read(self._view, _Word.OUTPUTS, words[_Word.OUTPUTS_FLAGS]))
        if words[_Word.OUTPUTS_BEGUN] != done:
            return None
        words[_Word.OUTPUTS_READ] = done
        return done, outputs

    def report_outputs(self, outputs: Outputs) -> None:
        """Report the outputs that are sent from the next cycle on."""
        self._words[_Word.SENT_OUTPUTS_FLAGS] = _SENT.write(self._view, _SENT_OUTPUTS_AT, outputs.items())

    def report_counts(self, *, sent: int, dry: int, rests: int) -> None:
        """Report three counts to the program.

        Args:
            sent: Number of queued set-points that were sent.
            dry: Number of underflows.
            rests: Number of set-points sent since the commands came to standstill; 0 while they move the arm.
        """
        words = self._words
        words[_Word.TAKEN], words[_Word.UNDERFLOWS], words[_Word.RESTS] = sent, dry, rests

    def add_lateness(self, more: Lateness) -> None:
        """Add a report of late set-points to the statistics."""
        self._numbers[_Word.LATE_LONGEST] = more.longest
        self._numbers[_Word.LATE_TOTAL] += more.total
        self._words[_Word.LATE] += more.count

    def add(self, sample: RawSample) -> None:
        """Write a sample; if the buffer is full, the sample replaces the oldest one."""
        words = self._words
        number = words[_Word.SAMPLES]
        if not number:
            words[_Word.BEGAN] = sample.sent_ns
        at = _SAMPLES_AT + number % SAMPLE_ROOM * _SAMPLE
        words[at] = -1
        words[at + 1], words[at + 2], words[at + 4] = sample.sent_ns, sample.code, sample.delay_ns
        words[at + 5] = sample.replied_ns
        command = sample.command[:_MOST_VALUES]
        _VALUES[len(command)].pack_into(self._view, (at + _SAMPLE_VALUES) * WORD, *command)
        words[at + 3] = _GOT.write(self._view, at + _SAMPLE_FIELDS, sample.values.items()) << 8 | len(sample.command)
        words[at] = number
        words[_Word.SAMPLES] = number + 1
