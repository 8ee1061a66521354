"""Samples: set-points and their feedback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

from orinkit.core.public_name import public
from orinkit.rc8.slave_fields import RECEIVED, SlaveField
from orinkit.values.poses import J, P, T


@public("orinkit")
@dataclass(frozen=True, slots=True)
class Sample:
    """A set-point that was sent, and the controller's feedback (RC8 table 4-3).

    Attributes:
        number: Number of the set-point, from 0.
        sent: Time of sending, s since the first set-point was sent.
        command: Pose as sent: the values of a J (deg), of a P (X, Y, Z in mm, angles in deg, figure) or of a T.
        code: Return code of slvMove: S_OK or S_BUF_FULL.
        time: The controller's own time, s. This field and the following ones up to ``current`` are ``None`` if they
            were not requested.
        joints: Actual joint position, deg; about 0.1 s behind the command.
        position: Actual position as a P, mm and deg.
        trans: Actual position as a homogeneous transformation.
        mini: States of the mini I/O.
        hand: States of the hand I/O.
        user: States of the requested user I/O.
        current: Currents of the motors, A.
        delay: If this set-point is the first one towards a live target: the time from setting the target until this
            set-point was sent, s; ``None`` for other set-points.
        replied: Time of the reply, s since the first set-point was sent. In mode 2 of slave mode, the controller
            replies when its buffer has room.
        more: Fields of the reply for which this class has no attribute, by name.
    """

    # The types are "| Any" instead of "| None": a program that requests a field need not check it in each sample.
    number: int
    sent: float
    command: tuple[float, ...]
    code: int = 0
    time: float | Any = None
    joints: J | Any = None
    position: P | Any = None
    trans: T | Any = None
    mini: int | Any = None
    hand: int | Any = None
    user: bytes | Any = None
    current: tuple[float, ...] | Any = None
    delay: float | None = None
    replied: float = 0.0
    more: Mapping[str, Any] = field(default_factory=dict, hash=False, repr=False)

    def value(self, row: SlaveField) -> Any:
        """Return the value of a field of the reply; ``None`` if the reply does not contain it."""
        return getattr(self, row.name) if row.name in OWN else self.more.get(row.name)


OWN: Final = frozenset(each.name for each in fields(Sample)) & {row.name for row in RECEIVED}
"""Names of the fields of the reply for which :class:`Sample` has an attribute."""
