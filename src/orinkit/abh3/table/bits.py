"""The bits of all flag words of an ABH3, as data: name, text, and the gate that combines input and terminal.

A name that begins with ``ay_`` or ``bx_`` (``a_`` or ``b_``) belongs to one axis; without the prefix it means both
axes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

from orinkit.core.i18n import N_, tr, translate

Values: TypeAlias = tuple[tuple[str, object], ...]
"""Names and values of the placeholders in a title."""


class TerminalGate(Enum):
    """The gate that combines a terminal of the driver and a bit from CAN into a bit of the control flags."""

    AND = "and"
    OR = "or"
    NOT_AND = "not and"


@dataclass(frozen=True, slots=True)
class Bit:
    """One bit of a flag word.

    Attributes:
        number: Number of the bit, 0 to 31.
        name: Name for programs.
        title: Meaning of the value 1, in English, with placeholders.
        gate: Gate that combines the bit with a terminal; ``None`` if the bit is not combined with a terminal.
        title_args: Values of the placeholders.
    """

    number: int
    name: str
    title: str
    gate: TerminalGate | None = None
    title_args: Values = ()

    @property
    def text(self) -> str:
        """The meaning of the value 1, in the current language."""
        return tr(self.title, **dict(self.title_args))

    @property
    def english(self) -> str:
        """The meaning of the value 1, in English."""
        return translate("en", self.title, **dict(self.title_args))


def _axis(first: int, letter: str, names: tuple[tuple[int, str, str, TerminalGate], ...]) -> tuple[Bit, ...]:
    small = letter.replace("/", "").lower()
    return tuple(
        Bit(first + offset, f"{small}_{name}", title, gate, (("axis", letter),)) for offset, name, title, gate in names
    )


def _pair(first: int, name: str, title: str) -> tuple[Bit, ...]:
    return tuple(
        Bit(first + offset, f"{axis}_{name}", title, title_args=(("axis", axis.upper()),))
        for offset, axis in enumerate("ab")
    )


def _numbered(first: int, numbers: Iterable[int], name: str, title: str) -> tuple[Bit, ...]:
    return tuple(
        Bit(first + offset, f"{name}_{number}", title, title_args=(("number", number),))
        for offset, number in enumerate(numbers)
    )


# --- inputs and control flags -----------------------------------------------------------------------------------------


def _of_an_axis(select: TerminalGate) -> tuple[tuple[int, str, str, TerminalGate], ...]:
    return (
        (0, "servo_on", N_("{axis} servo on"), TerminalGate.AND),
        (1, "start", N_("{axis} start"), TerminalGate.AND),
        (2, "polarity", N_("{axis} command polarity inverted"), TerminalGate.AND),
        (3, "correction", N_("{axis} correction added"), TerminalGate.AND),
        (4, "select_0", N_("{axis} data select 0"), select),
        (5, "select_1", N_("{axis} data select 1"), select),
        (6, "select_2", N_("{axis} data select 2"), select),
    )


_POLARITY: Final = (7, "correction_polarity", N_("{axis} correction subtracted"), TerminalGate.AND)
_POLARITY_BX_V1: Final = (11, "correction_polarity", N_("{axis} correction subtracted"), TerminalGate.AND)

# error_reset: the driver clears its errors when this bit changes from 0 to 1. While the bit is 1, the servo is off.
INPUTS_V1: Final = (
    *_axis(0, "A/Y", (*_of_an_axis(TerminalGate.NOT_AND), _POLARITY)),
    Bit(8, "a_pulse_clear", N_("A axis pulse count cleared (rising edge)"), TerminalGate.OR),
    *_axis(12, "B/X", (*_of_an_axis(TerminalGate.NOT_AND), _POLARITY_BX_V1)),
    Bit(19, "b_pulse_clear", N_("B axis pulse count cleared (rising edge)"), TerminalGate.OR),
    Bit(24, "ay_torque", N_("A/Y torque mode (0: velocity mode)"), TerminalGate.AND),
    Bit(25, "bx_torque", N_("B/X torque mode (0: velocity mode)"), TerminalGate.AND),
    Bit(26, "slave", N_("slave (0: master)"), TerminalGate.AND),
    Bit(28, "brake_release", N_("brake released (0: the brake follows servo and errors)"), TerminalGate.AND),
    Bit(31, "error_reset", N_("error reset (errors are cleared when it changes from 0 to 1; servo off while it is 1)"), TerminalGate.OR),
)  # fmt: skip
CONTROL_V1: Final = (
    *INPUTS_V1,
    Bit(27, "travel_model", N_("travel axis model (0: motor axis model)")),
)

INPUTS_V2: Final = (
    *_axis(0, "A/Y", (*_of_an_axis(TerminalGate.AND), _POLARITY)),
    *_axis(8, "B/X", (*_of_an_axis(TerminalGate.AND), _POLARITY)),
    Bit(16, "ay_torque", N_("A/Y torque mode (0: velocity mode)"), TerminalGate.AND),
    Bit(17, "bx_torque", N_("B/X torque mode (0: velocity mode)"), TerminalGate.AND),
    Bit(18, "slave", N_("master/slave operation enabled"), TerminalGate.AND),
    Bit(19, "brake_release", N_("brake released (0: the brake follows servo and errors)"), TerminalGate.AND),
    Bit(20, "a_pulse_clear", N_("A axis pulse count cleared (rising edge)"), TerminalGate.OR),
    Bit(21, "b_pulse_clear", N_("B axis pulse count cleared (rising edge)"), TerminalGate.OR),
    Bit(22, "error_reset", N_("error reset (errors are cleared when it changes from 0 to 1; servo off while it is 1)"), TerminalGate.OR),
)  # fmt: skip
CONTROL_V2: Final = (
    *INPUTS_V2,
    Bit(25, "ay_ready", N_("A/Y ready")),
    Bit(26, "ay_busy", N_("A/Y busy")),
    Bit(27, "bx_ready", N_("B/X ready")),
    Bit(28, "bx_busy", N_("B/X busy")),
    Bit(29, "travel_model", N_("travel axis model (0: motor axis model)")),
    Bit(30, "brake_released", N_("brake is released")),
    Bit(31, "error", N_("an error is present")),
)

# --- errors and warnings ----------------------------------------------------------------------------------------------

FAULTS_V1: Final = (
    *_pair(0, "mechanical_lock", N_("{axis} axis mechanical lock")),
    Bit(2, "overheat", N_("driver overheated")),
    Bit(3, "brake", N_("brake fault")),
    *_pair(4, "resolver", N_("{axis} axis resolver fault")),
    *_pair(6, "overcurrent", N_("{axis} axis overcurrent")),
    Bit(8, "control_undervoltage", N_("control supply undervoltage")),
    Bit(9, "parameter", N_("parameter fault")),
    *_pair(10, "pdu", N_("{axis} axis PDU fault")),
    *_pair(12, "electronic_thermal", N_("{axis} axis electronic thermal relay")),
    Bit(14, "main_undervoltage", N_("main supply undervoltage")),
    Bit(15, "overvoltage", N_("control or main supply overvoltage")),
    *_pair(16, "overspeed", N_("{axis} axis overspeed")),
    *_pair(18, "speed_limit", N_("{axis} axis speed limit")),
    *_pair(20, "current_limit", N_("{axis} axis current limit")),
    Bit(22, "can_communication", N_("CAN communication time-out")),
    Bit(23, "can_traffic", N_("CAN traffic overload")),
)
ERRORS_V2: Final = (*FAULTS_V1, *_numbered(28, range(4), "error_code", N_("error code bit {number}")))
WARNINGS_V2: Final = (*FAULTS_V1, *_numbered(28, range(4), "alarm_code", N_("alarm code bit {number}")))

# --- terminals --------------------------------------------------------------------------------------------------------

_TERMINALS_V1: Final = (0, 1, 2, 3, 12, 13, 14, 15, 16, 17, 18, 19, 4, 5, 6, 7, 8, 9, 10, 11)
IO_V1: Final = (
    Bit(0, "error", N_("an error is present")),
    Bit(1, "alarm", N_("an alarm is present")),
    Bit(2, "ay_ready", N_("A/Y ready")),
    Bit(3, "ay_busy", N_("A/Y busy")),
    Bit(4, "bx_ready", N_("B/X ready")),
    Bit(5, "bx_busy", N_("B/X busy")),
    *_numbered(6, range(4), "error_code", N_("error code bit {number}")),
    Bit(10, "brake_released", N_("brake is released")),
    *_numbered(11, _TERMINALS_V1, "di", N_("digital input #{number}")),
    Bit(31, "error_reset_input", N_("error reset terminal")),
)
IO_V2: Final = (
    *_numbered(0, range(8), "do", N_("digital output #{number}")),
    *_numbered(8, range(20), "di", N_("digital input #{number}")),
    Bit(31, "error_reset_input", N_("error reset terminal")),
)
