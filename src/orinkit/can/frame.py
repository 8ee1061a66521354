"""CAN frames, and operations that want them: what everything that speaks CAN has in common, without I/O.

An operation is a generator: it yields a :class:`OperationStep`, which says what to send and how long to wait, and is sent the
next frame, or ``None`` when the time is up.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, NamedTuple, TypeAlias, TypeVar

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

T = TypeVar("T")
MAX_ID: Final = 0x1FFFFFFF
"""The greatest extended identifier."""
MAX_DATA: Final = 8
"""Bytes of a classic CAN frame, at most."""


class CanFrame(NamedTuple):
    """A data frame of CAN 2.0B with an extended identifier; ABH3 drivers know no others.

    Attributes:
        id: 29-bit identifier.
        data: 0 to 8 bytes.
        time: when it arrived, in s by the interface's own clock; 0 of a frame to be sent.
    """

    id: int
    data: bytes
    time: float = 0.0

    def __str__(self) -> str:
        return f"{self.id:08X}#{self.data.hex().upper()}"


class OperationStep(NamedTuple):
    """What an operation wants next.

    Attributes:
        frames: to send, in order.
        seconds: to wait for a frame; ``None`` for what is left of the wait before, so that other frames do not make it
            any longer.
        fresh: frames that have arrived before are dropped first: they cannot be answers to what is sent now.
    """

    frames: tuple[CanFrame, ...] = ()
    seconds: float | None = None
    fresh: bool = False


CanOperation: TypeAlias = Generator[OperationStep, CanFrame | None, T]


def checked(frame: CanFrame) -> CanFrame:
    """Return a frame that can be sent.

    Raises:
        InvalidValue: its identifier has more than 29 bits, or it has more than 8 bytes.
    """
    if not 0 <= frame.id <= MAX_ID:
        raise InvalidValue(tr("a CAN identifier has 29 bits, at most 0x1FFFFFFF: {id:#x}", id=frame.id))
    if len(frame.data) > MAX_DATA:
        raise InvalidValue(tr("a CAN frame has at most 8 bytes, not {count}", count=len(frame.data)))
    return frame
