"""What comes back for each set-point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

from orinkit.rc8.slave_fields import RECEIVED, SlaveField
from orinkit.values.poses import J, P, T


@dataclass(frozen=True, slots=True)
class Sample:
    """One set-point that was sent, and what the controller answered (RC8 table 4-3).

    Attributes:
        number: of the set-point, from 0.
        sent: when it was sent, s since the first one was.
        command: its pose, as sent: joints in degrees, or X, Y, Z in mm, angles in degrees and figure, or a T.
        code: return code, S_OK or S_BUF_FULL.
        time: the controller's own time, s; ``None`` where it was not asked for (``"time"``), as all that follows.
        joints: where the arm is, degrees; some 0.1 s behind the command.
        position: the same as a position, mm and degrees.
        trans: the same as a homogeneous transformation.
        mini: states of the mini I/O.
        hand: states of the hand I/O.
        user: states of the user I/O that were asked for.
        current: of the motors, A.
        delay: s from when a live target was set until this set-point, the first one towards it, was sent; ``None`` for
            any other.
        answered: when the answer was there, s of the same clock as ``sent``; in mode 2 that is when there was room.
        more: fields of the answer that have no attribute here, by their names.
    """

    number: int
    sent: float
    command: tuple[float, ...]
    code: int = 0
    time: float | None = None
    joints: J | None = None
    position: P | None = None
    trans: T | None = None
    mini: int | None = None
    hand: int | None = None
    user: bytes | None = None
    current: tuple[float, ...] | None = None
    delay: float | None = None
    answered: float = 0.0
    more: Mapping[str, Any] = field(default_factory=dict, hash=False, repr=False)

    def value(self, row: SlaveField) -> Any:
        """Return the value of a field of the answer, ``None`` if there is none."""
        return getattr(self, row.name) if row.name in OWN else self.more.get(row.name)


OWN: Final = frozenset(each.name for each in fields(Sample)) & {row.name for row in RECEIVED}
"""Fields of the answer that have an attribute."""
