"""The contents of ABH3 frames as typed records in physical units (section 4.10).

A record also contains the codes of its values, which are the numbers in the frame. For example, if ``reply.a_velocity``
is -14.8 (min^-1), ``reply.raw_values["a_velocity"]`` is -74.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Final, TypeAlias

from orinkit.abh3.table.signals import Bit, Word


@dataclass(frozen=True, slots=True, repr=False)
class Flags:
    """A word of 32 flags, for use in ``"servo_on" in flags``, ``flags["ay_start"]``, ``list(flags)``, ``int(flags)``.

    A name without an axis means both axes. Such a name counts as set if the flags of both axes are set.

    Attributes:
        value: The word.
        word: Description of its bits.
    """

    value: int
    word: Word = field(compare=False)

    def __int__(self) -> int:
        return self.value

    __index__ = __int__

    def __bool__(self) -> bool:
        return self.value != 0

    def __contains__(self, name: str) -> bool:
        """Return True if a flag is set, by its name.

        Raises:
            InvalidValue: If there is no such flag. Without this exception, a mistyped name would look like a flag that
                is off.
        """
        return self[name]

    def __getitem__(self, name: str | int) -> bool:
        """Return True if a flag is set, by its name or its number.

        Raises:
            InvalidValue: If there is no such flag.
        """
        mask = self.word.mask(name)
        return self.value & mask == mask

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the flags that are set; an undefined bit is named like ``bit_29``."""
        for number in range(32):
            if self.value >> number & 1:
                bit = self.word.by_number.get(number)
                yield bit.name if bit else f"bit_{number}"

    @property
    def set_bits(self) -> tuple[Bit, ...]:
        """The defined bits that are set."""
        return tuple(bit for bit in self.word.bits if self.value >> bit.number & 1)

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts of the flags that are set, in the current language."""
        return tuple(bit.text for bit in self.set_bits)

    def __str__(self) -> str:
        return f"0x{self.value:08X}" + (f" ({', '.join(self)})" if self.value else "")

    def __repr__(self) -> str:
        return f"<{self}>"


Raw: TypeAlias = Mapping[str, int | float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The base of all records.

    Attributes:
        codes: The numbers in the frame as received, in the order of the fields; empty if the record was not decoded
            from a frame.
    """

    codes: tuple[int | float, ...] = field(default=(), repr=False, compare=False)

    @property
    def raw_values(self) -> Raw:
        """The numbers in the frame as received, by field name; empty if the record was not decoded from a frame."""
        names = (each.name for each in fields(self) if each.name != "codes")
        return dict(zip(names, self.codes, strict=False))


@dataclass(frozen=True, slots=True)
class DP0S(Record):
    """The command of a host (section 2.1).

    Attributes:
        ay_command: A/Y command in min^-1, or in % if the inputs select torque.
        bx_command: B/X command in min^-1, or in % if the inputs select torque.
        inputs: The input word.
    """

    ay_command: float
    bx_command: float
    inputs: Flags


@dataclass(frozen=True, slots=True)
class DP0R(Record):
    """The feedback of a driver with dialect v1 (section 2.1): velocities in min^-1."""

    a_velocity: float
    b_velocity: float
    y_velocity: float
    x_velocity: float


@dataclass(frozen=True, slots=True)
class DP0RV2(Record):
    """The feedback of a driver with dialect v2: velocities in min^-1 and the control flags."""

    ay_velocity: float
    bx_velocity: float
    control: Flags


@dataclass(frozen=True, slots=True)
class DP1R(Record):
    """The pulse counts (section 2.2; the document withholds this frame)."""

    a_pulses: int
    b_pulses: int


@dataclass(frozen=True, slots=True)
class BR0(Record):
    """Errors and warnings (section 2.3)."""

    errors: Flags
    warnings: Flags


@dataclass(frozen=True, slots=True)
class BR1(Record):
    """The states of a driver with dialect v1 (section 2.4): control flags and terminals."""

    control: Flags
    io: Flags


@dataclass(frozen=True, slots=True)
class BR1V2(Record):
    """The states of a driver with dialect v2.

    ``io`` contains all terminals. ``external`` contains only the input terminals; their bits have the same numbers as
    the inputs from the host.
    """

    io: Flags
    external: Flags


@dataclass(frozen=True, slots=True)
class BR2(Record):
    """Velocities in min^-1 (section 2.5)."""

    ay_velocity_command: float
    bx_velocity_command: float
    ay_velocity: float
    bx_velocity: float


@dataclass(frozen=True, slots=True)
class BR3(Record):
    """Current commands and loads in % (section 2.6)."""

    ay_current_command: float
    bx_current_command: float
    a_load: float
    b_load: float


@dataclass(frozen=True, slots=True)
class BR4(Record):
    """The pulse counts (section 2.7): signed 32-bit numbers that wrap around."""

    a_pulses: int
    b_pulses: int


@dataclass(frozen=True, slots=True)
class BR5(Record):
    """Analog inputs and supply voltages in V (section 2.8)."""

    analog_0: float
    analog_1: float
    main_voltage: float
    control_voltage: float


@dataclass(frozen=True, slots=True)
class BR6(Record):
    """The two monitors selected by the driver's parameters (section 2.9): numbers without a unit."""

    monitor_0: float
    monitor_1: float


@dataclass(frozen=True, slots=True)
class BUF(Record):
    """A frame of unknown content (section 4.10)."""

    data: bytes


Feedback: TypeAlias = DP0R | DP0RV2
States: TypeAlias = BR1 | BR1V2
AnyRecord: TypeAlias = DP0S | DP0R | DP0RV2 | DP1R | BR0 | BR1 | BR1V2 | BR2 | BR3 | BR4 | BR5 | BR6 | BUF
ALIKE: Final[Mapping[str, type[Record]]] = {kind.__name__: kind for kind in (DP0S, DP1R, BR0, BR2, BR3, BR4, BR5, BR6)}
"""The records that are the same in both dialects, by frame name."""
RECORDS: Final[Mapping[str, Mapping[str, type[Record]]]] = {
    "v1": {**ALIKE, "DP0R": DP0R, "BR1": BR1},
    "v2": {**ALIKE, "DP0R": DP0RV2, "BR1": BR1V2},
}
"""The record classes by dialect and frame name."""
