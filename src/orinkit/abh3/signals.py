"""THE TABLE of ABH3: quantities, flag words, and every frame of the document, for both dialects.

Codec, host, virtual driver, DBC, documentation and tests come from it. Sections are those of the document. A text in two
languages is a pair (English, Japanese).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from struct import Struct
from typing import Final, TypeAlias

from orinkit._pose_checks import brief
from orinkit.abh3 import _bits
from orinkit.abh3._bits import Bit as Bit
from orinkit.abh3._bits import Logic as Logic
from orinkit.abh3._checks import real, whole
from orinkit.errors import InvalidValue
from orinkit.language import pick

Texts: TypeAlias = tuple[str, str]

# --- quantities (section 3) -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity and its code on the wire.

    Attributes:
        name: for programs.
        text: what it is.
        unit: of the value.
        steps: codes per unit; 0 where the wire has the number itself, a single float.
        low: least code.
        high: greatest code.
        whole: the value is a whole number, an ``int``.
    """

    name: str
    text: Texts
    unit: str
    steps: int
    low: int
    high: int
    whole: bool = False

    @property
    def digits(self) -> int:
        """Decimal places that a value has."""
        return math.ceil(math.log10(self.steps)) if self.steps else 6

    def decode(self, code: float) -> float:
        """Return the value of a code: the double nearest to it.

        Raises:
            InvalidValue: there is no such code.
        """
        if not self.steps:
            return code
        if not self.low <= code <= self.high:
            raise InvalidValue(
                pick(
                    f"{pick(*self.text)}: {brief(code)} is no code; there are {self.low} to {self.high}",
                    f"{pick(*self.text)}: コード {brief(code)} は範囲外です ({self.low} から {self.high})",
                )
            )
        return int(code) if self.whole else code / self.steps

    def encode(self, value: float) -> int:
        """Return the code nearest to a value; of two that are equally near the one further from zero.

        Raises:
            InvalidValue: it has no code, or is no number.
        """
        assert self.steps  # a single float is its own code
        number = real(value)
        if number is None or abs(number) > _FAR:
            raise self._unusable(value)
        scaled = abs(number) * self.steps
        whole = int(scaled)
        code = whole + (scaled - whole >= _HALF)
        code = -code if number < 0 else code
        if not self.low <= code <= self.high:
            raise self._unusable(value)
        return code

    def _unusable(self, value: object) -> InvalidValue:
        low, high = self.low / self.steps, self.high / self.steps
        unit = f" {self.unit}" if self.unit else ""
        return InvalidValue(
            pick(
                f"{pick(*self.text)}: {brief(value)}{unit} cannot be sent; {low:.{self.digits}f} to {high:.{self.digits}f}{unit} can",
                f"{pick(*self.text)}: {brief(value)}{unit} は送れません。範囲は {low:.{self.digits}f} から {high:.{self.digits}f}{unit} です",
            )
        )


_HALF: Final = 0.5
_FAR: Final = 2.0**40  # beyond every code of every quantity
_SHORT: Final = (-0x8000, 0x7FFF)
_USHORT: Final = (0, 0xFFFF)
VELOCITY: Final = Quantity("velocity", ("velocity", "速度"), "min^-1", 5, *_SHORT)
CURRENT: Final = Quantity("current", ("current", "電流"), "%", 100, *_SHORT)
PULSES: Final = Quantity("pulses", ("pulse count", "パルス積算値"), "pulse", 1, -0x80000000, 0x7FFFFFFF, whole=True)
LOAD: Final = Quantity("load", ("load", "負荷率"), "%", 1, *_USHORT)
LOAD_TENTHS: Final = Quantity("load", ("load", "負荷率"), "%", 10, *_USHORT)
VOLTAGE: Final = Quantity("voltage", ("supply voltage", "電源電圧"), "V", 10, *_USHORT)
ANALOG: Final = Quantity("analog", ("analog input", "アナログ入力"), "V", 100, *_SHORT)
MONITOR: Final = Quantity("monitor", ("monitor", "モニタデータ"), "", 0, 0, 0)

# --- flag words -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Word:
    """A word of 32 flags.

    Attributes:
        name: for programs.
        text: what it is.
        bits: those that mean something.
    """

    name: str
    text: Texts
    bits: tuple[Bit, ...]

    @cached_property
    def by_name(self) -> Mapping[str, Bit]:
        """The bits by their names."""
        return {bit.name: bit for bit in self.bits}

    @cached_property
    def by_number(self) -> Mapping[int, Bit]:
        """The bits by their numbers."""
        return {bit.number: bit for bit in self.bits}

    @cached_property
    def masks(self) -> Mapping[str, int]:
        """What a name stands for as a mask: one bit, or that of both axes: ``servo_on`` is ``ay_`` and ``bx_servo_on``."""
        masks = {bit.name: 1 << bit.number for bit in self.bits}
        for name, mask in list(masks.items()):
            axis, _, rest = name.partition("_")
            if axis in _AXES and rest not in self.by_name:
                masks[rest] = masks.get(rest, 0) | mask
        return masks

    def mask(self, name: object) -> int:
        """Return the mask of a bit by its number, or by a name of :attr:`masks`.

        Raises:
            InvalidValue: there is none.
        """
        number = None if isinstance(name, str) else whole(name)
        if number is not None:
            if 0 <= number <= _LAST_BIT:
                return 1 << number
        elif isinstance(name, str) and name in self.masks:
            return self.masks[name]
        names = ", ".join(self.masks)
        raise InvalidValue(
            pick(
                f"{brief(name)} is no bit of the {self.text[0]}; there are 0 to 31 and {names}",
                f"{brief(name)} は{self.text[1]}のビットではありません。0 から 31、または {names} を指定してください",
            )
        )


_AXES: Final = ("ay", "bx", "a", "b")
_LAST_BIT: Final = 31

# --- frames (section 2) -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a frame's data.

    Attributes:
        name: for programs, as in the records.
        text: as in the document.
        code: of :mod:`struct`, little endian: ``h H i I f``.
        quantity: what it holds; ``None`` of a flag word.
        word: the flag word that it is.
        torque: the flag that makes it a current in %, where there is one.
    """

    name: str
    text: Texts
    code: str
    quantity: Quantity | None = None
    word: Word | None = None
    torque: str = ""


@dataclass(frozen=True)
class Layout:
    """A frame with data.

    Attributes:
        name: type of the document's section 4.10.
        text: what it is.
        section: of the document, where it is told.
        fields: in order.
        dp: data page in the identifier, 0 or 1.
        broadcast: number n of a broadcast 0 to 7, else ``None``.
        from_host: whether the host sends it.
        withheld: the document withholds it ("保留").
    """

    name: str
    text: Texts
    section: str
    fields: tuple[Field, ...]
    dp: int = 0
    broadcast: int | None = None
    from_host: bool = False
    withheld: bool = False

    @property
    def struct(self) -> Struct:
        """How the bytes are laid out."""
        return Struct("<" + "".join(field.code for field in self.fields))

    @property
    def starts(self) -> Iterator[tuple[Field, int]]:
        """Each field and the number of its first bit."""
        start = 0
        for field in self.fields:
            yield field, start
            start += 8 * Struct(field.code).size


def _of(quantity: Quantity, code: str, *fields: tuple[str, str, str]) -> tuple[Field, ...]:
    return tuple(Field(name, (en, ja), code, quantity) for name, en, ja in fields)


def _flags(name: str, word: Word) -> Field:
    return Field(name, word.text, "I", word=word)


_COMMANDS: Final = (
    Field("ay_command", ("A/Y command", "A/Y 指令"), "h", VELOCITY, torque="ay_torque"),
    Field("bx_command", ("B/X command", "B/X 指令"), "h", VELOCITY, torque="bx_torque"),
)
_ALIKE: Final = (
    Layout("DP1R", ("pulse counts", "パルス積算値"), "2.2",
        _of(PULSES, "i", ("a_pulses", "A pulse count", "Aパルス積算値"), ("b_pulses", "B pulse count", "Bパルス積算値")),
        dp=1, withheld=True),
    Layout("BR2", ("velocities", "速度"), "2.5", _of(VELOCITY, "h",
        ("ay_velocity_command", "A/Y velocity command", "A/Y 速度指令"),
        ("bx_velocity_command", "B/X velocity command", "B/X 速度指令"),
        ("ay_velocity", "A/Y velocity feedback", "A/Y 速度帰還"),
        ("bx_velocity", "B/X velocity feedback", "B/X 速度帰還")), broadcast=2),
    Layout("BR3", ("currents and loads", "電流と負荷率"), "2.6", (
        *_of(CURRENT, "h", ("ay_current_command", "A/Y current command", "A/Y 電流指令"),
             ("bx_current_command", "B/X current command", "B/X 電流指令")),
        *_of(LOAD, "H", ("a_load", "A load", "A 負荷率"), ("b_load", "B load", "B 負荷率"))), broadcast=3),
    Layout("BR4", ("pulse counts", "パルス積算値"), "2.7",
        _of(PULSES, "i", ("a_pulses", "A pulse count", "A パルス積算値"), ("b_pulses", "B pulse count", "B パルス積算値")),
        broadcast=4),
    Layout("BR5", ("analog inputs and supplies", "アナログ入力と電源電圧"), "2.8", (
        *_of(ANALOG, "h", ("analog_0", "analog input 0", "アナログ入力 0"), ("analog_1", "analog input 1", "アナログ入力 1")),
        *_of(VOLTAGE, "H", ("main_voltage", "main supply voltage", "主電源電圧"),
             ("control_voltage", "control supply voltage", "制御電源電圧"))), broadcast=5),
    Layout("BR6", ("monitors", "モニタ"), "2.9",
        _of(MONITOR, "f", ("monitor_0", "monitor 0", "モニタ 0 データ"), ("monitor_1", "monitor 1", "モニタ 1 データ")),
        broadcast=6),
)  # fmt: skip
"""The frames that both dialects have alike."""

# --- dialects ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Dialect:
    """What a generation of drivers means by the same frames.

    Attributes:
        name: ``"v1"``, ``"v2"``.
        text: what it is.
        inputs: what the host asks for ("input" in v1, "operation" in v2).
        control: what the driver makes of it.
        io: its terminals.
        layouts: the frames by their names.
    """

    name: str
    text: Texts
    inputs: Word
    control: Word
    errors: Word
    warnings: Word
    io: Word
    layouts: Mapping[str, Layout]

    @cached_property
    def broadcasts(self) -> Mapping[int, Layout]:
        """The broadcasts by their numbers."""
        return {layout.broadcast: layout for layout in self.layouts.values() if layout.broadcast is not None}

    def with_load_unit(self, percent: float) -> Dialect:
        """Return the same with a load that is counted in 1 % or in 0.1 %.

        Raises:
            InvalidValue: another unit.
        """
        load = _LOADS.get(real(percent) or 0.0)
        if load is None:
            raise InvalidValue(
                pick(
                    f"the unit of the load is 1 or 0.1 %, not {brief(percent)}",
                    f"負荷率の単位は 1 または 0.1 % です: {brief(percent)}",
                )
            )
        br3 = self.layouts["BR3"]
        fields = tuple(replace(f, quantity=load) if f.quantity in _LOADS.values() else f for f in br3.fields)
        return replace(self, layouts={**self.layouts, "BR3": replace(br3, fields=fields)})


_LOADS: Final = {1.0: LOAD, 0.1: LOAD_TENTHS}


def _dialect(
    name: str, text: Texts, words: tuple[Word, ...], feedback: tuple[Field, ...], states: tuple[Field, ...]
) -> Dialect:
    inputs, control, errors, warnings, io = words
    layouts = (
        Layout("DP0S", ("command", "指令"), "2.1", (*_COMMANDS, _flags("inputs", inputs)), from_host=True),
        Layout("DP0R", ("feedback", "帰還"), "2.1", feedback),
        _ALIKE[0],
        Layout("BR0", ("errors and warnings", "異常・警告フラグ"), "2.3",
               (_flags("errors", errors), _flags("warnings", warnings)), broadcast=0),
        Layout("BR1", ("states", "状態フラグ"), "2.4", states, broadcast=1),
        *_ALIKE[1:],
    )  # fmt: skip
    return Dialect(name, text, inputs, control, errors, warnings, io, {layout.name: layout for layout in layouts})


_CONTROL_V1: Final = Word("control", ("control flags", "制御フラグ"), _bits.CONTROL_V1)
_IO_V1: Final = Word("io", ("I/O flags", "I/O フラグ"), _bits.IO_V1)
V1: Final = _dialect(
    "v1", ("the document, 2021", "仕様書 (2021)"),
    (
        Word("inputs", ("inputs", "入力"), _bits.INPUTS_V1),
        _CONTROL_V1,
        Word("errors", ("error flags", "異常フラグ"), _bits.FAULTS_V1),
        Word("warnings", ("warning flags", "警告フラグ"), _bits.FAULTS_V1),
        _IO_V1,
    ),
    _of(VELOCITY, "h", ("a_velocity", "A velocity feedback", "A 速度帰還"), ("b_velocity", "B velocity feedback", "B 速度帰還"),
        ("y_velocity", "Y velocity feedback", "Y 速度帰還"), ("x_velocity", "X velocity feedback", "X 速度帰還")),
    (_flags("control", _CONTROL_V1), _flags("io", _IO_V1)),
)  # fmt: skip
"""The document's dialect."""

_CONTROL_V2: Final = Word("control", ("control flags", "制御フラグ"), _bits.CONTROL_V2)
_IO_V2: Final = Word("io", ("I/O flags", "I/O フラグ"), _bits.IO_V2)
V2: Final = _dialect(
    "v2", ("new specification, 2023", "新仕様 (2023)"),
    (
        Word("inputs", ("operation flags", "操作フラグ"), _bits.INPUTS_V2),
        _CONTROL_V2,
        Word("errors", ("error flags", "異常フラグ"), _bits.ERRORS_V2),
        Word("warnings", ("warning flags", "警告フラグ"), _bits.WARNINGS_V2),
        _IO_V2,
    ),
    (
        *_of(VELOCITY, "h", ("ay_velocity", "A/Y velocity feedback", "A/Y 速度帰還"),
             ("bx_velocity", "B/X velocity feedback", "B/X 速度帰還")),
        _flags("control", _CONTROL_V2),
    ),
    (_flags("io", _IO_V2), _flags("external", Word("external", ("input flags", "入力フラグ"), _bits.INPUTS_V2))),
)  # fmt: skip
"""The dialect of 2023, which packs flags otherwise."""

DIALECTS: Final[Mapping[str, Dialect]] = {dialect.name: dialect for dialect in (V1, V2)}


def dialect_of(name: object) -> Dialect:
    """Return a dialect by its name.

    Raises:
        InvalidValue: there is none of that name.
    """
    if isinstance(name, Dialect):
        return name
    if not isinstance(name, str) or name not in DIALECTS:
        raise InvalidValue(
            pick(f"there is no dialect {brief(name)}; v1 and v2 are there", f"方言 {brief(name)} はありません (v1, v2)")
        )
    return DIALECTS[name]
