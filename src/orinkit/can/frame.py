"""CAN frames, and operations that exchange them, without I/O.

An operation is a generator. It yields an :class:`OperationStep` with the frames to send and the time to wait, and
receives the next frame, or ``None`` after a time-out.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, NamedTuple, TypeAlias, TypeVar

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

T = TypeVar("T")
MAX_ID: Final = 0x1FFFFFFF
"""The highest extended identifier."""
MAX_DATA: Final = 8
"""Maximum number of data bytes of a classic CAN frame."""


class CanFrame(NamedTuple):
    """A data frame of CAN 2.0B with an extended identifier; ABH3 drivers use no other frames.

    Attributes:
        id: 29-bit identifier.
        data: 0 to 8 bytes.
        time: Time of arrival in s, by the interface's own clock; 0 for a frame to be sent.
    """

    id: int
    data: bytes
    time: float = 0.0

    def __str__(self) -> str:
        return f"{self.id:08X}#{self.data.hex().upper()}"


class OperationStep(NamedTuple):
    """The next step of an operation.

    Attributes:
        frames: Frames to send, in order.
        seconds: Seconds to wait for a frame; ``None`` to continue the previous wait, so that irrelevant frames do not
            prolong it.
        fresh: True to drop frames that arrived earlier, because they cannot be replies to the frames of this step.
    """

    frames: tuple[CanFrame, ...] = ()
    seconds: float | None = None
    fresh: bool = False


CanOperation: TypeAlias = Generator[OperationStep, CanFrame | None, T]


def checked(frame: CanFrame) -> CanFrame:
    """Check that a frame can be sent, and return it.

    Raises:
        InvalidValue: If the identifier has more than 29 bits, or the frame has more than 8 bytes.
    """
    if not 0 <= frame.id <= MAX_ID:
        raise InvalidValue(tr("a CAN identifier must be 0 to 0x1FFFFFFF (29 bits), not {id:#x}", id=frame.id))
    if len(frame.data) > MAX_DATA:
        raise InvalidValue(tr("a CAN frame must have at most 8 bytes, not {count}", count=len(frame.data)))
    return frame
