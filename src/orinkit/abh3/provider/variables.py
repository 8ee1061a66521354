"""The CAO variables of an ABH3 with description, type, and functions for reading and writing.

The variables are derived from the table in :mod:`orinkit.abh3.table.signals`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any, Final, TypeAlias

from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.table.records import Feedback, Flags, Record
from orinkit.abh3.table.signals import Dialect, SignalField, Word
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, Value, Variant, VarType

Motor: TypeAlias = AsyncDriver[Any, Any]
Get: TypeAlias = Callable[[Motor], Awaitable[Value]]
Put: TypeAlias = Callable[[Motor, Any], Awaitable[Feedback]]


@dataclass(frozen=True, slots=True)
class VariableEntry:
    """A CAO variable of an ABH3.

    Attributes:
        name: Name by which clients refer to the variable.
        type: VARIANT type of its value.
        describe: Function that returns the description, with the unit, in the current language.
        get: Function that reads the value.
        put: Function that writes the value; ``None`` for a read-only variable.
        count: Number of values of an array; 0 otherwise.
    """

    name: str
    type: int
    describe: Callable[[], str]
    get: Get
    put: Put | None = None
    count: int = 0

    @property
    def help(self) -> str:
        """The description, in the current language."""
        return self.describe()


def entries_of(dialect: Dialect) -> Mapping[str, VariableEntry]:
    """Return the variables of a driver by upper-case name."""
    entries = [*_commands(), *_inputs(dialect), *_feedback(dialect), *_broadcasts(dialect), *_SYSTEM]
    return {entry.name: entry for entry in entries}


# --- commands ---------------------------------------------------------------------------------------------------------


def _commands() -> list[VariableEntry]:
    return [
        VariableEntry("AY_COMMAND", VarType.R8, lambda: tr("A/Y command, min^-1 (torque mode: %)"),
             _of_commands(0), lambda motor, value: motor.command(ay=value)),
        VariableEntry("BX_COMMAND", VarType.R8, lambda: tr("B/X command, min^-1 (torque mode: %)"),
             _of_commands(1), lambda motor, value: motor.command(bx=value)),
        VariableEntry("COMMAND", VarType.R8 | ARRAY,
             lambda: tr("A/Y and B/X command, min^-1 (torque mode: %)"),
             _both_commands, lambda motor, value: motor.command(*value), count=2),
    ]  # fmt: skip


def _of_commands(axis: int) -> Get:
    async def get(motor: Motor) -> Value:
        return motor.commands[axis]

    return get


async def _both_commands(motor: Motor) -> Value:
    return list(motor.commands)


def _inputs(dialect: Dialect) -> list[VariableEntry]:
    word = dialect.inputs
    entries = [
        VariableEntry(
            "INPUTS",
            VarType.UI4,
            lambda: tr(word.title),
            _input_word,
            lambda motor, value: motor.set_inputs(int(value)),
        ),
    ]
    for name, mask in word.masks.items():
        describe = partial(_bits_text, word, mask)
        entries.append(VariableEntry(name.upper(), VarType.BOOL, describe, _input_bit(name), _put_input(name)))
    return entries


def _bits_text(word: Word, mask: int) -> str:
    return _listed(bit.text for bit in word.bits if mask >> bit.number & 1)


async def _input_word(motor: Motor) -> Value:
    return int(motor.inputs)


def _input_bit(name: str) -> Get:
    async def get(motor: Motor) -> Value:
        return name in motor.inputs

    return get


def _put_input(name: str) -> Put:
    return lambda motor, value: motor.set_input(name, int(bool(value)))


# --- measured values --------------------------------------------------------------------------------------------------


def _feedback(dialect: Dialect) -> list[VariableEntry]:
    """Return the variables for the feedback (DP0R): one for each field that no broadcast contains, and FEEDBACK.

    The variable FEEDBACK is an array of all fields.

    Reading one of these variables requests the feedback from the driver.
    """
    known = {field.name for layout in dialect.broadcasts.values() for field in layout.fields}
    fields = [field for field in dialect.layouts["DP0R"].fields if field.name not in known]

    async def get_all(motor: Motor) -> Value:
        record = await motor.request_single(0)
        return [float(_value(record, field)) for field in dialect.layouts["DP0R"].fields]

    every = dialect.layouts["DP0R"].fields
    return [
        *(
            VariableEntry(field.name.upper(), _type_of(field), partial(_field_text, field), _of_single(field))
            for field in fields
        ),
        VariableEntry(
            "FEEDBACK", VarType.R8 | ARRAY, lambda: _listed(map(_field_text, every)), get_all, count=len(every)
        ),
    ]


def _of_single(field: SignalField) -> Get:
    async def get(motor: Motor) -> Value:
        value: Value = _value(await motor.request_single(0), field)
        return value

    return get


def _broadcasts(dialect: Dialect) -> list[VariableEntry]:
    entries = []
    for number, layout in sorted(dialect.broadcasts.items()):
        entries += [
            VariableEntry(
                field.name.upper(), _type_of(field), partial(_field_text, field), _of_broadcast(number, field)
            )
            for field in layout.fields
        ]
        if layout.name == "BR0":
            entries.append(
                VariableEntry("ERROR_TEXTS", VarType.BSTR, lambda: tr("errors and warnings as text"), _error_texts)
            )
    return entries


def _of_broadcast(number: int, field: SignalField) -> Get:
    async def get(motor: Motor) -> Value:
        value: Value = _value(await motor.request_broadcast(number), field)
        return value

    return get


async def _error_texts(motor: Motor) -> Value:
    found = await motor.errors()
    return ", ".join(dict.fromkeys((*found.errors.texts, *found.warnings.texts)))


def _value(record: Record, field: SignalField) -> Any:
    value = getattr(record, field.name)
    return int(value) if isinstance(value, Flags) else value


def _type_of(field: SignalField) -> int:
    if field.word is not None:
        return VarType.UI4
    return VarType.I4 if field.quantity is not None and field.quantity.whole else VarType.R8


def _field_text(field: SignalField) -> str:
    unit = field.quantity.unit if field.quantity is not None else ""
    name = tr(field.title)
    return tr("{name}, {unit}", name=name, unit=unit) if unit else name


def _listed(texts: Iterable[str]) -> str:
    return reduce(lambda first, second: tr("{first}; {second}", first=first, second=second), texts)


# --- the driver itself ------------------------------------------------------------------------------------------------


async def _maker(_motor: Motor) -> Value:
    return "Waco Giken"


async def _device_type(_motor: Motor) -> Value:
    return "ABH3"


async def _version(motor: Motor) -> Value:
    return (await motor.read_identification()).strip()


_SYSTEM: Final = (
    VariableEntry("@MAKER_NAME", VarType.BSTR, lambda: tr("maker"), _maker),
    VariableEntry("@TYPE", VarType.BSTR, lambda: tr("type"), _device_type),
    VariableEntry("@VERSION", VarType.BSTR, lambda: tr("version, which many drivers do not report over CAN"), _version),
)  # fmt: skip


def as_variant(entry: VariableEntry, value: Value) -> Variant:
    """Return a value with the type of a variable; a VARIANT is returned unchanged."""
    return value if isinstance(value, Variant) else Variant(entry.type, value)
