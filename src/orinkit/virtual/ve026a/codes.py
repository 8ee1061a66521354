"""The table of the device-specific return codes of a VE026A, in addition to those of table 3-5.

Table 3-4 reserves 0x80040200 to 0x8004FFFF for the device. The document names one such error, 600B, but not its return
code; this project uses 0x8004600B. The other codes are chosen by this project.
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
        value: The code.
        name: Its symbolic name.
        message: Its short text in English.
        axis: Number of the axis that it concerns, from 1; 0 for none.
    """

    value: int
    name: str
    message: str
    axis: int = 0

    @property
    def text(self) -> str:
        """The text in the current language."""
        return tr(self.message, axis=self.axis)


# fmt: off
_ROWS: Final = (
    VE026ACode(ROBOT_RUNNING, "ROBOT_RUNNING", N_("600B: the robot is running")),
    VE026ACode(SET_POINT_MISSED, "SET_POINT_MISSED", N_("synchronous slave mode: no slvMove arrived in time for a cycle of 8 ms")),
    VE026ACode(EMERGENCY_STOP, "EMERGENCY_STOP", N_("emergency stop")),
    *(VE026ACode(OUT_OF_RANGE_AXIS1 + n - 1, f"OUT_OF_RANGE_AXIS{n}", N_("axis {axis}: the set-point is outside the range"), n)
      for n in range(1, AXES + 1)),
    *(VE026ACode(TOO_FAST_AXIS1 + n - 1, f"TOO_FAST_AXIS{n}", N_("axis {axis}: the set-point exceeds the velocity limit"), n)
      for n in range(1, AXES + 1)),
)
# fmt: on

CODES: Final = {code.value: code for code in _ROWS}
"""The device-specific codes by value."""


def device_error(code: int, detail: str = "") -> CallError:
    """Return the exception for a code; its detail begins with the text of the code if the code is device-specific."""
    known = CODES.get(code)
    return error_for(code, ": ".join(filter(None, (known.text if known else "", detail))))
