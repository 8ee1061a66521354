"""The options and the steps of Slave Move (RC8 5.1.1)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr

_SHORTEST_TIMEOUT: Final = 0.02  # s
_LONGEST_TIMEOUT: Final = 60.0  # s


class Step(Enum):
    """A step of the sequence; the value is its name for users, in English."""

    TAKE_ARM = N_("Take the arm")
    FIRST_POSE = N_("Move to the first pose")
    ENTER = N_("Switch slave mode on")
    STREAM = N_("Send the set-points")
    LEAVE = N_("Switch slave mode off")
    GIVE_ARM = N_("Give the arm")


class StepState(Enum):
    """State of a step."""

    WAITING = "waiting"
    ACTIVE = "active"
    DONE = "done"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class SlaveMoveOptions:
    """Options of Slave Move.

    Attributes:
        mode: Slave mode: 0, 1 or 2.
        timeout: Time-out of the reply to a set-point, s.
        repeat: True to repeat the trajectory until it is stopped.
        speed: Percentage of the limits to use.
        approach: Speed of the motion to the first pose, percent.
        record: True to record in CSV and MCAP.
    """

    mode: int
    timeout: float = 0.5
    repeat: bool = False
    speed: float = 100.0
    approach: float = 20.0
    record: bool = True

    def check(self) -> SlaveMoveOptions:
        """Return the options if they are valid.

        Raises:
            InvalidValue: If one is not.
        """
        if not _SHORTEST_TIMEOUT <= self.timeout <= _LONGEST_TIMEOUT:
            raise InvalidValue(tr("the time-out must be 20 to 60,000 ms, not {value:g}", value=self.timeout * 1000))
        if self.mode not in (0, 1, 2):
            raise InvalidValue(tr("the mode must be 0, 1 or 2"))
        for value in (self.speed, self.approach):
            if not 1.0 <= value <= 100.0:
                raise InvalidValue(tr("the percentage must be 1 to 100, not {value:g}", value=value))
        return self
