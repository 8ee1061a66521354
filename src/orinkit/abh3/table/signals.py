"""The table of ABH3: quantities, flag words, and every frame of the document, for both dialects.

Codec, host, virtual driver, DBC export, documentation and tests are derived from this table. Section numbers are those
of the document. Titles are in English; ``tr`` translates them for display.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from struct import Struct
from typing import Final

from orinkit.abh3.table import bits as _bits
from orinkit.abh3.table.bits import Bit as Bit
from orinkit.abh3.table.bits import TerminalGate as TerminalGate
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.validation import brief, real, whole

# --- quantities (section 3) -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity and its codes, which are the numbers in frames.

    Attributes:
        name: Name for programs.
        title: Name for people.
        unit: Unit of the value.
        steps: Number of codes per unit; 0 if the frame contains the value itself as a single-precision float.
        low: Lowest code.
        high: Highest code.
        whole: True if the value is a whole number, an ``int``.
    """

    name: str
    title: str
    unit: str
    steps: int
    low: int
    high: int
    whole: bool = False

    @property
    def digits(self) -> int:
        """Decimal places of a value."""
        return math.ceil(math.log10(self.steps)) if self.steps else 6

    def decode(self, code: float) -> float:
        """Return the value that a code represents, as the nearest float.

        Raises:
            InvalidValue: If the code is out of range.
        """
        if not self.steps:
            return code
        if not self.low <= code <= self.high:
            raise InvalidValue(
                tr(
                    "{name}: the code must be {low} to {high}, not {code}",
                    name=tr(self.title),
                    code=brief(code),
                    low=self.low,
                    high=self.high,
                )
            )
        return int(code) if self.whole else code / self.steps

    def encode(self, value: float) -> int:
        """Return the code nearest to a value; if two codes are equally near, return the one further from zero.

        Raises:
            InvalidValue: If the value has no code, or is not a number.
        """
        assert self.steps  # a quantity that is sent as a single float has no codes
        number = real(value)
        if number is None or abs(number) > _MAX_MAGNITUDE:
            raise self._out_of_range(value)
        scaled = abs(number) * self.steps
        whole = int(scaled)
        code = whole + (scaled - whole >= _HALF)
        code = -code if number < 0 else code
        if not self.low <= code <= self.high:
            raise self._out_of_range(value)
        return code

    def _out_of_range(self, value: object) -> InvalidValue:
        low, high = self.low / self.steps, self.high / self.steps
        unit = f" {self.unit}" if self.unit else ""
        return InvalidValue(
            tr(
                "{name} must be {low:.{digits}f} to {high:.{digits}f}{unit}, not {value}{unit}",
                name=tr(self.title),
                value=brief(value),
                unit=unit,
                digits=self.digits,
                low=low,
                high=high,
            )
        )


_HALF: Final = 0.5
_MAX_MAGNITUDE: Final = 2.0**40  # exceeds the codes of all quantities
_SHORT: Final = (-0x8000, 0x7FFF)
_USHORT: Final = (0, 0xFFFF)
VELOCITY: Final = Quantity("velocity", N_("velocity"), "min^-1", 5, *_SHORT)
CURRENT: Final = Quantity("current", N_("current"), "%", 100, *_SHORT)
PULSES: Final = Quantity("pulses", N_("pulse count"), "pulse", 1, -0x80000000, 0x7FFFFFFF, whole=True)
LOAD: Final = Quantity("load", N_("load"), "%", 1, *_USHORT)
LOAD_TENTHS: Final = Quantity("load", N_("load"), "%", 10, *_USHORT)
VOLTAGE: Final = Quantity("voltage", N_("supply voltage"), "V", 10, *_USHORT)
ANALOG: Final = Quantity("analog", N_("analog input"), "V", 100, *_SHORT)
MONITOR: Final = Quantity("monitor", N_("monitor"), "", 0, 0, 0)

# --- flag words -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Word:
    """A word of 32 flags.

    Attributes:
        name: Name for programs.
        title: Name for people.
        bits: The defined bits.
    """

    name: str
    title: str
    bits: tuple[Bit, ...]

    @cached_property
    def by_name(self) -> Mapping[str, Bit]:
        """The bits by name."""
        return {bit.name: bit for bit in self.bits}

    @cached_property
    def by_number(self) -> Mapping[int, Bit]:
        """The bits by number."""
        return {bit.number: bit for bit in self.bits}

    @cached_property
    def masks(self) -> Mapping[str, int]:
        """The masks by name.

        A name without an axis covers both axes: ``servo_on`` is the mask of ``ay_servo_on`` and ``bx_servo_on``.
        """
        masks = {bit.name: 1 << bit.number for bit in self.bits}
        for name, mask in list(masks.items()):
            axis, _, rest = name.partition("_")
            if axis in _AXES and rest not in self.by_name:
                masks[rest] = masks.get(rest, 0) | mask
        return masks

    def mask(self, name: object) -> int:
        """Return the mask of a bit by its number, or by a name of :attr:`masks`.

        Raises:
            InvalidValue: If there is no such bit.
        """
        number = None if isinstance(name, str) else whole(name)
        if number is not None:
            if 0 <= number <= _LAST_BIT:
                return 1 << number
        elif isinstance(name, str) and name in self.masks:
            return self.masks[name]
        names = ", ".join(self.masks)
        raise InvalidValue(
            tr(
                "{name} is not a bit of the {word}; valid: 0 to 31, {names}",
                name=brief(name),
                word=tr(self.title),
                names=names,
            )
        )


_AXES: Final = ("ay", "bx", "a", "b")
_LAST_BIT: Final = 31

# --- frames (section 2) -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SignalField:
    """A field of a frame's data.

    Attributes:
        name: Name for programs, as in the records.
        title: Name for people.
        code: Format character of :mod:`struct` (little endian): ``h``, ``H``, ``i``, ``I`` or ``f``.
        quantity: Quantity of the field; ``None`` for a flag word.
        word: The flag word of the field; ``None`` for a quantity.
        torque_input: The input that changes the field from a velocity to a current in %; ``""`` if there is none.
    """

    name: str
    title: str
    code: str
    quantity: Quantity | None = None
    word: Word | None = None
    torque_input: str = ""


@dataclass(frozen=True)
class FrameLayout:
    """The layout of a frame that contains data.

    Attributes:
        name: Name of the type in section 4.10 of the document.
        title: Name for people.
        section: Section of the document that describes the frame.
        fields: The fields in order.
        dp: Data page in the identifier, 0 or 1.
        broadcast: Number 0 to 7 of a broadcast, otherwise ``None``.
        from_host: True if the host sends this frame.
        undocumented: True if the document withholds this frame ("保留").
    """

    name: str
    title: str
    section: str
    fields: tuple[SignalField, ...]
    dp: int = 0
    broadcast: int | None = None
    from_host: bool = False
    undocumented: bool = False

    @property
    def struct(self) -> Struct:
        """The byte layout of the fields, for encoding and decoding."""
        return Struct("<" + "".join(field.code for field in self.fields))

    @property
    def starts(self) -> Iterator[tuple[SignalField, int]]:
        """Yield each field and the number of its first bit."""
        start = 0
        for field in self.fields:
            yield field, start
            start += 8 * Struct(field.code).size


def _of(quantity: Quantity, code: str, *fields: tuple[str, str]) -> tuple[SignalField, ...]:
    return tuple(SignalField(name, title, code, quantity) for name, title in fields)


def _flags(name: str, word: Word) -> SignalField:
    return SignalField(name, word.title, "I", word=word)


_COMMANDS: Final = (
    SignalField("ay_command", N_("A/Y command"), "h", VELOCITY, torque_input="ay_torque"),
    SignalField("bx_command", N_("B/X command"), "h", VELOCITY, torque_input="bx_torque"),
)
_COMMON: Final = (
    FrameLayout("DP1R", N_("pulse counts"), "2.2",
        _of(PULSES, "i", ("a_pulses", N_("A axis pulse count")), ("b_pulses", N_("B axis pulse count"))),
        dp=1, undocumented=True),
    FrameLayout("BR2", N_("velocities"), "2.5", _of(VELOCITY, "h",
        ("ay_velocity_command", N_("A/Y velocity command")),
        ("bx_velocity_command", N_("B/X velocity command")),
        ("ay_velocity", N_("A/Y velocity feedback")),
        ("bx_velocity", N_("B/X velocity feedback"))), broadcast=2),
    FrameLayout("BR3", N_("currents and loads"), "2.6", (
        *_of(CURRENT, "h", ("ay_current_command", N_("A/Y current command")),
             ("bx_current_command", N_("B/X current command"))),
        *_of(LOAD, "H", ("a_load", N_("A axis load")), ("b_load", N_("B axis load")))), broadcast=3),
    FrameLayout("BR4", N_("pulse counts"), "2.7",
        _of(PULSES, "i", ("a_pulses", N_("A axis pulse count")), ("b_pulses", N_("B axis pulse count"))),
        broadcast=4),
    FrameLayout("BR5", N_("analog inputs and supplies"), "2.8", (
        *_of(ANALOG, "h", ("analog_0", N_("analog input 0")), ("analog_1", N_("analog input 1"))),
        *_of(VOLTAGE, "H", ("main_voltage", N_("main supply voltage")),
             ("control_voltage", N_("control supply voltage")))), broadcast=5),
    FrameLayout("BR6", N_("monitors"), "2.9",
        _of(MONITOR, "f", ("monitor_0", N_("monitor 0")), ("monitor_1", N_("monitor 1"))),
        broadcast=6),
)  # fmt: skip
"""The frames that are the same in both dialects."""

# --- dialects ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Dialect:
    """The variant of the protocol that a generation of drivers uses.

    Attributes:
        name: ``"v1"``, ``"v2"``.
        title: Name for people.
        inputs: Flag word that the host sends (called "input" in v1, "operation" in v2).
        control: The control flags: inputs and terminals combined.
        errors: Flag word of the errors.
        warnings: Flag word of the warnings.
        io: The terminals.
        layouts: The frames by name.
    """

    name: str
    title: str
    inputs: Word
    control: Word
    errors: Word
    warnings: Word
    io: Word
    layouts: Mapping[str, FrameLayout]

    @cached_property
    def broadcasts(self) -> Mapping[int, FrameLayout]:
        """The broadcasts by number."""
        return {layout.broadcast: layout for layout in self.layouts.values() if layout.broadcast is not None}

    def with_load_unit(self, percent: float) -> Dialect:
        """Return this dialect with a resolution of the load of 1 % or 0.1 %.

        Raises:
            InvalidValue: If ``percent`` is not 1 or 0.1.
        """
        load = _LOADS.get(real(percent) or 0.0)
        if load is None:
            raise InvalidValue(tr("the unit of the load must be 1 or 0.1 %, not {percent}", percent=brief(percent)))
        br3 = self.layouts["BR3"]
        fields = tuple(replace(f, quantity=load) if f.quantity in _LOADS.values() else f for f in br3.fields)
        return replace(self, layouts={**self.layouts, "BR3": replace(br3, fields=fields)})


_LOADS: Final = {1.0: LOAD, 0.1: LOAD_TENTHS}


def _dialect(
    name: str, title: str, words: tuple[Word, ...], feedback: tuple[SignalField, ...], states: tuple[SignalField, ...]
) -> Dialect:
    inputs, control, errors, warnings, io = words
    layouts = (
        FrameLayout("DP0S", N_("command"), "2.1", (*_COMMANDS, _flags("inputs", inputs)), from_host=True),
        FrameLayout("DP0R", N_("feedback"), "2.1", feedback),
        _COMMON[0],
        FrameLayout("BR0", N_("errors and warnings"), "2.3",
               (_flags("errors", errors), _flags("warnings", warnings)), broadcast=0),
        FrameLayout("BR1", N_("states"), "2.4", states, broadcast=1),
        *_COMMON[1:],
    )  # fmt: skip
    return Dialect(name, title, inputs, control, errors, warnings, io, {layout.name: layout for layout in layouts})


_CONTROL_V1: Final = Word("control", N_("control flags"), _bits.CONTROL_V1)
_IO_V1: Final = Word("io", N_("I/O flags"), _bits.IO_V1)
V1: Final = _dialect(
    "v1", N_("manufacturer's document of 2021"),
    (
        Word("inputs", N_("inputs"), _bits.INPUTS_V1),
        _CONTROL_V1,
        Word("errors", N_("error flags"), _bits.FAULTS_V1),
        Word("warnings", N_("warning flags"), _bits.FAULTS_V1),
        _IO_V1,
    ),
    _of(VELOCITY, "h", ("a_velocity", N_("A axis velocity feedback")), ("b_velocity", N_("B axis velocity feedback")),
        ("y_velocity", N_("Y axis velocity feedback")), ("x_velocity", N_("X axis velocity feedback"))),
    (_flags("control", _CONTROL_V1), _flags("io", _IO_V1)),
)  # fmt: skip
"""The dialect in the document."""

_CONTROL_V2: Final = Word("control", N_("control flags"), _bits.CONTROL_V2)
_IO_V2: Final = Word("io", N_("I/O flags"), _bits.IO_V2)
V2: Final = _dialect(
    "v2", N_("new specification, 2023"),
    (
        Word("inputs", N_("operation flags"), _bits.INPUTS_V2),
        _CONTROL_V2,
        Word("errors", N_("error flags"), _bits.ERRORS_V2),
        Word("warnings", N_("warning flags"), _bits.WARNINGS_V2),
        _IO_V2,
    ),
    (
        *_of(VELOCITY, "h", ("ay_velocity", N_("A/Y velocity feedback")),
             ("bx_velocity", N_("B/X velocity feedback"))),
        _flags("control", _CONTROL_V2),
    ),
    (_flags("io", _IO_V2), _flags("external", Word("external", N_("input flags"), _bits.INPUTS_V2))),
)  # fmt: skip
"""The dialect of drivers of 2023 and later, in which the flags have other positions."""

DIALECTS: Final[Mapping[str, Dialect]] = {dialect.name: dialect for dialect in (V1, V2)}


def dialect_of(name: object) -> Dialect:
    """Return a dialect by its name; a :class:`Dialect` is returned unchanged.

    Raises:
        InvalidValue: If there is no dialect of that name.
    """
    if isinstance(name, Dialect):
        return name
    if not isinstance(name, str) or name not in DIALECTS:
        raise InvalidValue(tr("unknown dialect {name}; available: v1, v2", name=brief(name)))
    return DIALECTS[name]
