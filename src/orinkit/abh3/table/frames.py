"""Conversion between the data of frames and records, as described by the table in :mod:`orinkit.abh3.table.signals`."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from operator import truediv
from typing import Any, Final, NamedTuple, TypeVar

from orinkit.abh3.table.records import BUF, RECORDS, Flags, Record
from orinkit.abh3.table.signals import CURRENT, V1, Dialect, FrameLayout, Quantity, SignalField, Word
from orinkit.core.errors import InvalidValue, ProtocolError
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, rounded_to_single

R = TypeVar("R", bound=Record)
_LENGTH: Final = 8
_ALL_BITS: Final = 0xFFFFFFFF


class Codec:
    """Encodes and decodes the frames of one dialect.

    Args:
        dialect: Dialect of the drivers.
    """

    def __init__(self, dialect: Dialect = V1) -> None:
        self.dialect = dialect
        self._records = RECORDS[dialect.name]
        self._readers = {name: _FrameReader.of(self._records[name], layout) for name, layout in dialect.layouts.items()}

    def decode(self, name: str, data: bytes) -> Record:
        """Return the record of a frame.

        Args:
            name: Name of the frame, as in :attr:`Dialect.layouts`.
            data: The 8 bytes of the frame.

        Raises:
            ProtocolError: If the length is not 8 bytes.
        """
        if len(data) != _LENGTH:
            raise ProtocolError(tr("{name} must have 8 bytes, not {count}", name=name, count=len(data)))
        reader = self._readers[name]
        codes = reader.unpack(data)
        if reader.steps:
            return reader.kind(*map(truediv, codes, reader.steps), codes=codes)
        values = [read(code) for read, code in zip(reader.reads, codes, strict=True)]
        if name == "DP0S":
            values[:2] = self._commands(codes)
        return reader.kind(*values, codes=codes)

    def read(self, kind: type[R], name: str, data: bytes) -> R:
        """Return the record of a frame; the record must be an instance of ``kind``.

        Raises:
            ProtocolError: If the length is not 8 bytes.
        """
        record = self.decode(name, data)
        assert isinstance(record, kind)
        return record

    def encode(self, record: Record, name: str = "") -> bytes:
        """Return the data of a frame from the physical values of a record.

        Args:
            record: A record of this dialect.
            name: Name of the frame; by default the name of the frame for which this dialect uses the record's class.

        Raises:
            InvalidValue: If a value has no code, or the dialect has no such record.
        """
        if isinstance(record, BUF):
            return record.data
        name = name or self._name_of(record)
        layout = self.dialect.layouts[name]
        codes = [self._code(layout, field, record) for field in layout.fields]
        return layout.struct.pack(*codes)

    def flags(self, word: Word, value: int) -> Flags:
        """Return the lower 32 bits of a number as the flags of a word."""
        return Flags(value & _ALL_BITS, word)

    def _name_of(self, record: Record) -> str:
        for name, kind in self._records.items():
            if type(record) is kind:
                return name
        kinds = ", ".join(kind.__name__ for kind in self._records.values())
        raise InvalidValue(
            tr(
                "dialect {dialect} has no frame of class {kind}; its frame classes: {kinds}",
                dialect=self.dialect.name,
                kind=type(record).__name__,
                kinds=kinds,
            )
        )

    def _code(self, layout: FrameLayout, field: SignalField, record: Record) -> int | float:
        value = getattr(record, field.name)
        if field.word is not None:
            return _word(field.title, value)
        assert field.quantity is not None
        if not field.quantity.steps:
            return _single(field, value)
        inputs = _word(self.dialect.inputs.title, getattr(record, "inputs", 0))
        return self._quantity(layout, field, inputs).encode(value)

    def _quantity(self, layout: FrameLayout, field: SignalField, inputs: int) -> Quantity:
        """Return the quantity of a field; for a command, a current if the inputs in the frame select torque mode."""
        assert field.quantity is not None
        if field.torque_input and layout.name == "DP0S" and inputs & self.dialect.inputs.masks[field.torque_input]:
            return CURRENT
        return field.quantity

    def _commands(self, codes: tuple[int, ...]) -> list[float]:
        """Return the commands of a DP0S frame from its codes, each in the unit that the inputs in the frame select."""
        layout = self.dialect.layouts["DP0S"]
        inputs = codes[2]
        return [
            self._quantity(layout, field, inputs).decode(code)
            for field, code in zip(layout.fields[:2], codes, strict=False)
        ]


class _FrameReader(NamedTuple):
    """Reads one kind of frame.

    Attributes:
        kind: Class of the record.
        unpack: Function that returns the codes in the data.
        reads: Converters from code to value, one per field.
        steps: For faster decoding, the number of codes per unit of each field. Empty if any field is a flag word, a
            whole number or a single-precision float.
    """

    kind: Callable[..., Record]
    unpack: Callable[[bytes], tuple[Any, ...]]
    reads: tuple[Callable[[Any], Any], ...]
    steps: tuple[int, ...]

    @classmethod
    def of(cls, kind: type[Record], layout: FrameLayout) -> _FrameReader:
        """Return the reader for a layout."""
        quantities = [field.quantity for field in layout.fields]
        steps = tuple(q.steps for q in quantities if q is not None and q.steps and not q.whole)
        reads = tuple(_reader(field) for field in layout.fields)
        return cls(kind, layout.struct.unpack, reads, steps if len(steps) == len(quantities) else ())


def _reader(field: SignalField) -> Callable[[Any], Any]:
    word = field.word
    if word is not None:
        return lambda code: Flags(code, word)
    quantity = field.quantity
    assert quantity is not None
    if quantity.whole or not quantity.steps:
        return lambda code: code
    steps = quantity.steps
    return lambda code: code / steps  # without a check, because every code of this width is valid


def _word(title: str, value: object) -> int:
    """Return flags as a 32-bit word.

    Raises:
        InvalidValue: If the value is not a 32-bit word.
    """
    number = int(value) if isinstance(value, Flags) else value
    if isinstance(number, int) and 0 <= number <= _ALL_BITS:
        return number
    raise InvalidValue(tr("{name} must be a 32-bit word, not {number}", name=tr(title), number=brief(number)))


def _single(field: SignalField, value: float) -> float:
    """Round a number to single precision, in which it is sent.

    Raises:
        InvalidValue: If the number does not fit in a single-precision float.
    """
    try:
        number = rounded_to_single(value)
    except (OverflowError, ValueError, struct.error):  # ValueError: a signalling NaN of the module decimal
        raise InvalidValue(
            tr("{name}: {value} does not fit in a single float", name=tr(field.title), value=brief(value))
        ) from None
    return number if not math.isnan(number) else value
