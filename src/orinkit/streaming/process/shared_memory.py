"""The memory that a program and its streaming process share: set-points one way, samples the other, without locks.

It is made of 8-byte words, which this machine's Python writes whole. Each side writes its own words only; a record is
written before the count that makes it visible, and carries its number, so that one that is being overwritten is seen
as such. The memory has no name: it is gone with the last of the two, however they end.
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
"""Set-points that there is room for: 32 s at 8 ms."""
SAMPLE_ROOM: Final = 4096
"""Samples that are kept until the program has read them."""

BEHIND: Final = 15
"""Cycles by which an arm may be behind: 3 set-points that the controller queues (RC8 table 4-4), and some 0.1 s until the
encoders follow (reference: feedback in slave mode)."""

RESTS: Final = 3
"""Equal set-points at the end; two tell the controller that the arm stands (RC8 4.5)."""

_MOST_VALUES: Final = 13  # of a pose with extra axes


class SetPointSource(IntEnum):
    """Where set-points come from."""

    NONE = 0
    QUEUE = 1
    TARGET = 2


class StreamCommand(IntEnum):
    """What the program wants of the streaming process."""

    RUN = 0
    HALT = 1
    """Bring the arm to rest, forget what is queued, and go on holding it."""
    FINISH = 2
    """Take what is queued, then leave slave mode."""
    LEAVE = 3
    """Bring the arm to rest and leave slave mode."""
    GOODBYE = 4
    """The same; and nobody has the connection afterwards."""


class _Word(IntEnum):
    """Places in the head."""

    ORDER = 0
    ORDER_DONE = 1
    FEED = 2
    WRITTEN = 3
    READ = 4
    FORGOTTEN = 5
    TARGET_BEGUN = 6
    TARGET_DONE = 7
    TARGET_LENGTH = 8
    TARGET_TIME = 9
    TARGET_VALUES = 10
    OUTPUTS_BEGUN = 24
    OUTPUTS_DONE = 25
    OUTPUTS_FLAGS = 26
    SAMPLES = 32
    SENT = 33
    DRY = 34
    RESTS = 35
    BEGAN = 36
    LATE = 37
    LATE_LONGEST = 38
    LATE_TOTAL = 39
    OUTPUTS = 40


_VALUES: Final = [Struct(f"{count}d") for count in range(_MOST_VALUES + 1)]
_SENT: Final = RecordLayout(OUTPUTS, sent=True)
_GOT: Final = RecordLayout(RECEIVED)
_HEAD: Final = _Word.OUTPUTS + _SENT.size
_POINT_OUTPUTS: Final = 2 + _MOST_VALUES  # in a point: number, flags and count, values, outputs
_POINT: Final = _POINT_OUTPUTS + _SENT.size
_SAMPLE_VALUES: Final = 6  # in a sample: number, sent, code, flags and count, delay, answered, command, fields
_SAMPLE_FIELDS: Final = _SAMPLE_VALUES + _MOST_VALUES
_SAMPLE: Final = _SAMPLE_FIELDS + _GOT.size
_QUEUE_AT: Final = _HEAD
_SAMPLES_AT: Final = _QUEUE_AT + QUEUE_ROOM * _POINT
_SIZE: Final = WORD * (_SAMPLES_AT + SAMPLE_ROOM * _SAMPLE)


@dataclass(frozen=True, slots=True)
class Outputs:
    """States of outputs, as slvMove sends them (RC8 table 4-2); ``None`` for what is not sent.

    Attributes:
        mini: of the mini I/O.
        hand: of the hand I/O.
        user: first number and bytes of user I/O.
    """

    mini: int | None = None
    hand: int | None = None
    user: tuple[int, bytes] | None = None

    def given(self) -> dict[str, Any]:
        """Return those that are not ``None``, by their names."""
        return {name: value for name, value in self.items() if value is not None}

    def items(self) -> Iterable[tuple[str, Any]]:
        """Return names and values, ``None`` too."""
        return zip(_OUTPUT_NAMES, _values(self), strict=True)

    def changed(self, other: Outputs) -> Outputs:
        """Return these with what the others have put over them."""
        return self if other is _NO_OUTPUTS else Outputs(**{**self.given(), **other.given()})


_OUTPUT_NAMES: Final = tuple(row.name for row in OUTPUTS)
_values: Final[Callable[[Outputs], tuple[Any, ...]]] = attrgetter(*_OUTPUT_NAMES)


@dataclass(slots=True)
class RawSample:
    """A sample as the streaming process writes it; see :class:`~orinkit.streaming.recording.samples.Sample`.

    Attributes:
        sent_ns: of the monotonic clock.
        answered_ns: the same.
        delay_ns: how long the live target that it is the first to follow had been set when it was sent; -1: none.
        values: of the fields that the answer had, by their names.
        number: of the sample; the memory gives it.
    """

    sent_ns: int
    answered_ns: int
    code: int
    command: tuple[float, ...]
    delay_ns: int = -1
    values: Mapping[str, Any] = field(default_factory=dict)
    number: int = 0


_NO_OUTPUTS: Final = Outputs()


class StreamMemory:
    """The memory, seen from either side.

    Args:
        descriptor: of the memory; it stays open until :meth:`close`.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._lock = threading.Lock()  # of this side: several threads of a program may write
        self._memory = mmap.mmap(descriptor, _SIZE)
        self._view = memoryview(self._memory)
        self._words = self._view.cast("q")
        self._numbers = self._view.cast("d")

    @classmethod
    def make(cls) -> StreamMemory:
        """Make new memory."""
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("orinkit-stream", os.MFD_CLOEXEC)
        else:
            descriptor, name = tempfile.mkstemp(prefix="orinkit-stream-")
            os.unlink(name)  # noqa: PTH108 - it is to have no name
        os.ftruncate(descriptor, _SIZE)
        return cls(descriptor)

    @property
    def closed(self) -> bool:
        """Whether this side has let go of it."""
        return self.descriptor < 0

    def close(self) -> None:
        """Close this side; does nothing the second time.

        The memory stays mapped until nobody refers to this object any more: another thread may be reading it.
        """
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    # --- the program's side -------------------------------------------------------------------------------------

    def order(self, order: StreamCommand) -> None:
        """Tell the streaming process what to do."""
        count = self._words[_Word.ORDER] >> 8  # the same order given again is another one
        self._words[_Word.ORDER] = count + 1 << 8 | order

    @property
    def order_done(self) -> bool:
        """Whether it has done what it was told last."""
        return self._words[_Word.ORDER_DONE] == self._words[_Word.ORDER]

    @property
    def waiting(self) -> int:
        """How many set-points wait to be sent."""
        words = self._words
        return int(words[_Word.WRITTEN] - max(words[_Word.READ], words[_Word.FORGOTTEN]))

    def put(self, values: Sequence[float], outputs: Outputs = _NO_OUTPUTS) -> None:
        """Queue a set-point; there has to be room for it."""
        with self._lock:
            words = self._words
            count = words[_Word.WRITTEN]
            at = _QUEUE_AT + count % QUEUE_ROOM * _POINT
            _VALUES[len(values)].pack_into(self._view, (at + 2) * WORD, *values)
            flags = 0 if outputs is _NO_OUTPUTS else _SENT.write(self._view, at + _POINT_OUTPUTS, outputs.items())
            words[at + 1] = flags << 8 | len(values)
            words[at] = count
            words[_Word.WRITTEN] = count + 1

    def feed_queue(self) -> None:
        """Take set-points from the queue."""
        self._words[_Word.FEED] = SetPointSource.QUEUE

    @property
    def forgotten(self) -> int:
        """How many set-points had been queued when they were forgotten."""
        return int(self._words[_Word.FORGOTTEN])

    @property
    def written(self) -> int:
        """How many set-points have been queued."""
        return int(self._words[_Word.WRITTEN])

    def forget(self) -> None:
        """Have what is queued until now forgotten."""
        self._words[_Word.FORGOTTEN] = self._words[_Word.WRITTEN]

    def set_target(self, values: Sequence[float], when_ns: int) -> None:
        """Set the live target."""
        with self._lock:
            words = self._words
            count = words[_Word.TARGET_BEGUN] + 1
            words[_Word.TARGET_BEGUN] = count
            for offset, value in enumerate(values):
                self._numbers[_Word.TARGET_VALUES + offset] = value
            words[_Word.TARGET_LENGTH] = len(values)
            words[_Word.TARGET_TIME] = when_ns
            words[_Word.TARGET_DONE] = count
            words[_Word.FEED] = SetPointSource.TARGET

    def set_outputs(self, outputs: Outputs) -> None:
        """Set the outputs that go with every set-point that has none of its own."""
        with self._lock:
            words = self._words
            count = words[_Word.OUTPUTS_BEGUN] + 1
            words[_Word.OUTPUTS_BEGUN] = count
            words[_Word.OUTPUTS_FLAGS] = _SENT.write(self._view, _Word.OUTPUTS, outputs.items())
            words[_Word.OUTPUTS_DONE] = count

    def hold(self) -> None:
        """Take set-points from nowhere: the arm comes to rest and is held."""
        self._words[_Word.FEED] = SetPointSource.NONE

    @property
    def began_ns(self) -> int:
        """When the first set-point was sent, of the monotonic clock."""
        return int(self._words[_Word.BEGAN])

    @property
    def samples(self) -> int:
        """How many samples have been written."""
        return int(self._words[_Word.SAMPLES])

    @property
    def sent(self) -> int:
        """How many set-points of the queue have been sent as they were given."""
        return int(self._words[_Word.SENT])

    @property
    def dry(self) -> int:
        """How often the queue was empty while the arm moved, so that it was brought to rest."""
        return int(self._words[_Word.DRY])

    @property
    def lateness(self) -> Lateness:
        """Set-points that came too late for a real controller; none where the controller does not tell.

        ``longest`` is that of those that were told of last.
        """
        words, numbers = self._words, self._numbers
        return Lateness(int(words[_Word.LATE]), numbers[_Word.LATE_LONGEST], numbers[_Word.LATE_TOTAL])

    @property
    def at_rest(self) -> bool:
        """Whether the command stands still."""
        return bool(self._words[_Word.RESTS])

    @property
    def rested(self) -> bool:
        """Whether the controller knows that it does, and has been asked how late set-points were."""
        return self._words[_Word.RESTS] >= RESTS

    @property
    def settled(self) -> bool:
        """Whether it has stood still for so long that the arm does too."""
        return self._words[_Word.RESTS] > BEHIND

    def sample(self, number: int) -> RawSample | None:
        """Return a sample, ``None`` for one that is not there any more."""
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
        """What the program wants."""
        return StreamCommand(self._words[_Word.ORDER] & 0xFF)

    def has_done(self) -> None:
        """Tell that what the program wants has been done."""
        self._words[_Word.ORDER_DONE] = self._words[_Word.ORDER]

    @property
    def feed(self) -> SetPointSource:
        """Where set-points are to come from."""
        return SetPointSource(self._words[_Word.FEED])

    def take(self) -> tuple[tuple[float, ...], Outputs] | None:
        """Return the next set-point and take it out of the queue; ``None`` when it is empty."""
        words = self._words
        count = max(words[_Word.READ], words[_Word.FORGOTTEN])
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

    def target(self, seen: int) -> tuple[int, int, tuple[float, ...]] | None:
        """Return number, time and values of the live target if it is newer than a number; ``None`` while it is being written."""
        words = self._words
        done = words[_Word.TARGET_DONE]
        if done == seen:
            return None
        at = int(_Word.TARGET_VALUES)
        values = tuple(self._numbers[at : at + words[_Word.TARGET_LENGTH]])
        when = words[_Word.TARGET_TIME]
        return (done, when, values) if words[_Word.TARGET_BEGUN] == done else None

    def outputs(self, seen: int) -> tuple[int, Outputs] | None:
        """Return number and values of the outputs if they are newer than a number; ``None`` while they are being written."""
        words = self._words
        done = words[_Word.OUTPUTS_DONE]
        if done == seen:
            return None
        outputs = Outputs(**_SENT.read(self._view, _Word.OUTPUTS, words[_Word.OUTPUTS_FLAGS]))
        return (done, outputs) if words[_Word.OUTPUTS_BEGUN] == done else None

    def note(self, *, sent: int, dry: int, rests: int) -> None:
        """Tell how it goes: set-points sent, times that there were none, equal ones sent last while nothing is wanted."""
        words = self._words
        words[_Word.SENT], words[_Word.DRY], words[_Word.RESTS] = sent, dry, rests

    def add_lateness(self, more: Lateness) -> None:
        """Count further late set-points."""
        self._numbers[_Word.LATE_LONGEST] = more.longest
        self._numbers[_Word.LATE_TOTAL] += more.total
        self._words[_Word.LATE] += more.count

    def add(self, sample: RawSample) -> None:
        """Write a sample over the oldest one."""
        words = self._words
        number = words[_Word.SAMPLES]
        if not number:
            words[_Word.BEGAN] = sample.sent_ns
        at = _SAMPLES_AT + number % SAMPLE_ROOM * _SAMPLE
        words[at] = -1
        words[at + 1], words[at + 2], words[at + 4] = sample.sent_ns, sample.code, sample.delay_ns
        words[at + 5] = sample.answered_ns
        command = sample.command[:_MOST_VALUES]
        _VALUES[len(command)].pack_into(self._view, (at + _SAMPLE_VALUES) * WORD, *command)
        words[at + 3] = _GOT.write(self._view, at + _SAMPLE_FIELDS, sample.values.items()) << 8 | len(sample.command)
        words[at] = number
        words[_Word.SAMPLES] = number + 1
