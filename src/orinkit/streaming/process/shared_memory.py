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
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from orinkit.rc8.slave_lateness import Lateness

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
_MOST_AXES: Final = 8
_MOST_USER: Final = 64  # bytes of user I/O


class Feed(IntEnum):
    """Where set-points come from."""

    NONE = 0
    QUEUE = 1
    TARGET = 2


class Order(IntEnum):
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
    OUTPUTS_MINI = 27
    OUTPUTS_HAND = 28
    OUTPUTS_OFFSET = 29
    OUTPUTS_LENGTH = 30
    SAMPLES = 32
    SENT = 33
    DRY = 34
    RESTS = 35
    BEGAN = 36
    LATE = 37
    LATE_LONGEST = 38
    LATE_TOTAL = 39
    OUTPUTS_USER = 40


_HEAD: Final = 64
_POINT: Final = 32
_SAMPLE: Final = 72
_QUEUE_AT: Final = _HEAD
_SAMPLES_AT: Final = _QUEUE_AT + QUEUE_ROOM * _POINT
_SIZE: Final = 8 * (_SAMPLES_AT + SAMPLE_ROOM * _SAMPLE)

# of a point
_MINI, _HAND, _USER = 1, 2, 4
# of a sample
_TIME, _JOINTS, _POSITION, _TRANS, _CURRENT, _GOT_MINI, _GOT_HAND, _GOT_USER = (1 << bit for bit in range(8))


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

    def changed(self, other: Outputs) -> Outputs:
        """Return these with what the others have put over them."""
        return Outputs(
            self.mini if other.mini is None else other.mini,
            self.hand if other.hand is None else other.hand,
            self.user if other.user is None else other.user,
        )


@dataclass(slots=True)
class RawSample:
    """A sample as the streaming process writes it; see :class:`~orinkit.streaming.recording.samples.Sample`.

    Attributes:
        sent_ns: of the monotonic clock.
        answered_ns: the same.
        delay_ns: how long the live target that it is the first to follow had been set when it was sent; -1: none.
        number: of the sample; the memory gives it.
    """

    sent_ns: int
    answered_ns: int
    code: int
    command: tuple[float, ...]
    delay_ns: int = -1
    time: float | None = None
    joints: tuple[float, ...] | None = None
    position: tuple[float, ...] | None = None
    trans: tuple[float, ...] | None = None
    current: tuple[float, ...] | None = None
    mini: int | None = None
    hand: int | None = None
    user: bytes | None = None
    number: int = 0


_NO_OUTPUTS: Final = Outputs()


class Shared:
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
    def make(cls) -> Shared:
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

    def order(self, order: Order) -> None:
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
            words, numbers = self._words, self._numbers
            count = words[_Word.WRITTEN]
            at = _QUEUE_AT + count % QUEUE_ROOM * _POINT
            flags = 0
            numbers_at = at + 2
            for offset, value in enumerate(values):
                numbers[numbers_at + offset] = value
            if outputs.mini is not None:
                flags |= _MINI
                words[at + 16] = outputs.mini
            if outputs.hand is not None:
                flags |= _HAND
                words[at + 17] = outputs.hand
            if outputs.user is not None:
                flags |= _USER
                words[at + 18], words[at + 19] = outputs.user[0], len(outputs.user[1])
                self._put_bytes(at + 20, outputs.user[1])
            words[at + 1] = flags << 8 | len(values)
            words[at] = count
            words[_Word.WRITTEN] = count + 1

    def feed_queue(self) -> None:
        """Take set-points from the queue."""
        self._words[_Word.FEED] = Feed.QUEUE

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
            words[_Word.FEED] = Feed.TARGET

    def set_outputs(self, outputs: Outputs) -> None:
        """Set the outputs that go with every set-point that has none of its own."""
        with self._lock:
            words = self._words
            count = words[_Word.OUTPUTS_BEGUN] + 1
            words[_Word.OUTPUTS_BEGUN] = count
            flags = 0
            if outputs.mini is not None:
                flags |= _MINI
                words[_Word.OUTPUTS_MINI] = outputs.mini
            if outputs.hand is not None:
                flags |= _HAND
                words[_Word.OUTPUTS_HAND] = outputs.hand
            if outputs.user is not None:
                flags |= _USER
                words[_Word.OUTPUTS_OFFSET], words[_Word.OUTPUTS_LENGTH] = outputs.user[0], len(outputs.user[1])
                self._put_bytes(_Word.OUTPUTS_USER, outputs.user[1])
            words[_Word.OUTPUTS_FLAGS] = flags
            words[_Word.OUTPUTS_DONE] = count

    def hold(self) -> None:
        """Take set-points from nowhere: the arm comes to rest and is held."""
        self._words[_Word.FEED] = Feed.NONE

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
        length = min(flags >> 8, _MOST_VALUES)

        def values(offset: int, count: int) -> tuple[float, ...]:
            return tuple(numbers[at + offset : at + offset + count])

        sample = RawSample(
            words[at + 1], words[at + 70], words[at + 2], values(6, length), words[at + 4],
            numbers[at + 5] if flags & _TIME else None,
            values(20, _MOST_AXES) if flags & _JOINTS else None,
            values(28, 7) if flags & _POSITION else None,
            values(36, 10) if flags & _TRANS else None,
            values(46, _MOST_AXES) if flags & _CURRENT else None,
            words[at + 54] if flags & _GOT_MINI else None,
            words[at + 55] if flags & _GOT_HAND else None,
            self._bytes(at + 57, words[at + 56]) if flags & _GOT_USER else None,
            number,
        )  # fmt: skip
        whole = words[at] == number and self._words[_Word.SAMPLES] - number <= SAMPLE_ROOM
        return sample if whole else None

    # --- the streaming process's side ---------------------------------------------------------------------------

    @property
    def wanted(self) -> Order:
        """What the program wants."""
        return Order(self._words[_Word.ORDER] & 0xFF)

    def has_done(self) -> None:
        """Tell that what the program wants has been done."""
        self._words[_Word.ORDER_DONE] = self._words[_Word.ORDER]

    @property
    def feed(self) -> Feed:
        """Where set-points are to come from."""
        return Feed(self._words[_Word.FEED])

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
        outputs = _NO_OUTPUTS
        if flags:
            outputs = Outputs(
                words[at + 16] if flags & _MINI else None,
                words[at + 17] if flags & _HAND else None,
                (words[at + 18], self._bytes(at + 20, words[at + 19])) if flags & _USER else None,
            )
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
        flags = words[_Word.OUTPUTS_FLAGS]
        user = words[_Word.OUTPUTS_OFFSET], self._bytes(_Word.OUTPUTS_USER, words[_Word.OUTPUTS_LENGTH])
        outputs = Outputs(
            words[_Word.OUTPUTS_MINI] if flags & _MINI else None,
            words[_Word.OUTPUTS_HAND] if flags & _HAND else None,
            user if flags & _USER else None,
        )
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
        words, numbers = self._words, self._numbers
        number = words[_Word.SAMPLES]
        if not number:
            words[_Word.BEGAN] = sample.sent_ns
        at = _SAMPLES_AT + number % SAMPLE_ROOM * _SAMPLE
        words[at] = -1
        words[at + 1], words[at + 2], words[at + 4] = sample.sent_ns, sample.code, sample.delay_ns
        words[at + 70] = sample.answered_ns
        flags = 0
        if sample.time is not None:
            flags |= _TIME
            numbers[at + 5] = sample.time
        for bit, offset, room, values in (
            (0, 6, _MOST_VALUES, sample.command),
            (_JOINTS, 20, _MOST_AXES, sample.joints),
            (_POSITION, 28, 7, sample.position),
            (_TRANS, 36, 10, sample.trans),
            (_CURRENT, 46, _MOST_AXES, sample.current),
        ):
            if values is not None:
                flags |= bit
                for place, value in enumerate(values[:room]):
                    numbers[at + offset + place] = value
        for bit, offset, word in ((_GOT_MINI, 54, sample.mini), (_GOT_HAND, 55, sample.hand)):
            if word is not None:
                flags |= bit
                words[at + offset] = word
        if sample.user is not None:
            flags |= _GOT_USER
            words[at + 56] = min(len(sample.user), _MOST_USER)
            self._put_bytes(at + 57, sample.user[:_MOST_USER])
        words[at + 3] = flags | len(sample.command) << 8
        words[at] = number
        words[_Word.SAMPLES] = number + 1

    def _put_bytes(self, word: int, data: bytes) -> None:
        data = data[:_MOST_USER]
        self._view[word * 8 : word * 8 + len(data)] = data

    def _bytes(self, word: int, length: int) -> bytes:
        return bytes(self._view[word * 8 : word * 8 + min(length, _MOST_USER)])
