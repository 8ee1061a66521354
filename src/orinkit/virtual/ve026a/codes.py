"""The return codes of a VE026A's own, beside those of table 3-5: THE TABLE of their names and texts.

Table 3-4 leaves 0x80040200 to 0x8004FFFF to the device. The document names one error of it, 600B, without saying how it goes
over the wire; here it is 0x8004 and that number. The others are this project's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import N_, tr

AXES: Final = 7

ROBOT_RUNNING: Final = 0x8004600B
SET_POINT_MISSED: Final = 0x80040201
EMERGENCY_STOP: Final = 0x80040202
OUT_OF_RANGE_AXIS1: Final = 0x80040211
TOO_FAST_AXIS1: Final = 0x80040221


@dataclass(frozen=True, slots=True)
class VE026ACode:
    """One return code.

    Attributes:
        value: the code.
        name: its symbol.
        message: its short text, in English.
        axis: that it is about, from 1; 0 where it is about none.
    """

    value: int
    name: str
    message: str
    axis: int = 0

    @property
    def text(self) -> str:
        """The text in the language in force."""
        return tr(self.message, axis=self.axis)


# fmt: off
_ROWS: Final = (
    VE026ACode(ROBOT_RUNNING, "ROBOT_RUNNING", N_("600B: the robot is running")),
    VE026ACode(SET_POINT_MISSED, "SET_POINT_MISSED", N_("synchronous slave mode: no slvMove came in time for a cycle of 8 ms")),
    VE026ACode(EMERGENCY_STOP, "EMERGENCY_STOP", N_("emergency stop")),
    *(VE026ACode(OUT_OF_RANGE_AXIS1 + n - 1, f"OUT_OF_RANGE_AXIS{n}", N_("axis {axis}: the set-point is outside the range"), n)
      for n in range(1, AXES + 1)),
    *(VE026ACode(TOO_FAST_AXIS1 + n - 1, f"TOO_FAST_AXIS{n}", N_("axis {axis}: faster than the axis can"), n)
      for n in range(1, AXES + 1)),
)
# fmt: on

CODES: Final = {code.value: code for code in _ROWS}
"""All of them, by value."""


def refusal(code: int, detail: str = "") -> CallError:
    """Return the exception for a code, whose text is told with the detail if it is one of these."""
    known = CODES.get(code)
    return error_for(code, ": ".join(filter(None, (known.text if known else "", detail))))
