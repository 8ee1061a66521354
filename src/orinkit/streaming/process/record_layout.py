"""Layout of the fields of slvMove (poses, I/O states and others) in records of 8-byte words.

The layout is derived from the table in :mod:`orinkit.rc8.slave_fields`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from struct import Struct
from typing import Any, Final, TypeAlias

from orinkit.rc8.slave_fields import MOST_USER_BYTES, FieldType, SlaveField

WORD: Final = 8
"""Bytes per word."""

_Writer: TypeAlias = Callable[..., object]  # arguments: memory, offset, value
_Reader: TypeAlias = Callable[[memoryview, int], Any]
_Place: TypeAlias = tuple[
    int, int, _Writer, bool
]  # flag bit; offset in the record; writer; True if the writer has the numbers as separate arguments
_Codec: TypeAlias = tuple[int, _Writer, _Reader]  # number of words, writer, reader


class RecordLayout:
    """The layout of fields in a record.

    Flags, which are stored outside these fields, have a bit for each field. The bit is set if the record contains a
    value of the field.

    Args:
        fields: Rows of the table in :mod:`orinkit.rc8.slave_fields`, at most 32.
        sent: True if the fields are sent to the controller. A field with I/O states as bytes then also contains the
            number of the first I/O point.

    Attributes:
        size: Number of words of all fields, without the flags.
    """

    __slots__ = ("_known", "_places", "_readers", "size")

    def __init__(self, fields: Iterable[SlaveField], *, sent: bool = False) -> None:
        self._places: dict[str, _Place] = {}
        self._known: list[tuple[str, int, _Reader]] = []
        self._readers: dict[int, list[tuple[str, int, _Reader]]] = {}  # readers by flags, for the flags used so far
        self.size = 0
        for number, field in enumerate(fields):
            words, write, read = _sent_bytes() if sent and field.form is FieldType.BYTES else _CODECS[field.form](field)
            self._places[field.name] = (1 << number, self.size * WORD, write, field.form is FieldType.POSE)
            self._known.append((field.name, self.size * WORD, read))
            self.size += words

    def write(self, view: memoryview, word: int, values: Iterable[tuple[str, Any]]) -> int:
        """Write the values that are not ``None`` into the record at the offset ``word``, in words; return the flags."""
        start, flags = word * WORD, 0
        for name, value in values:
            if value is None:
                continue
            bit, offset, write, one_by_one = self._places[name]
            if one_by_one:
                write(view, start + offset, *value)
            else:
                write(view, start + offset, value)
            flags |= bit
        return flags

    def read(self, view: memoryview, word: int, flags: int) -> dict[str, Any]:
        """Return the values of the fields whose flags are set, from the record at the offset ``word``, in words."""
        start = word * WORD
        readers = self._readers.get(flags)
        if readers is None:
            readers = [each for bit, each in enumerate(self._known) if flags >> bit & 1]
            # A record that is being overwritten may contain any flags. Unknown flags must not add further entries.
            self._readers[flags & (1 << len(self._known)) - 1] = readers
        return {name: read(view, start + at) for name, at, read in readers}


def _one(form: str) -> _Codec:
    packed = Struct(form)

    def read(view: memoryview, at: int) -> Any:
        return packed.unpack_from(view, at)[0]

    return 1, packed.pack_into, read


def _pose(field: SlaveField) -> _Codec:
    packed = Struct(f"{field.count}d")
    return field.count, packed.pack_into, packed.unpack_from


def _reals(field: SlaveField) -> _Codec:
    most = field.count
    packed = [Struct(f"q{count}d") for count in range(most + 1)]

    def write(view: memoryview, at: int, values: tuple[float, ...]) -> None:
        count = min(len(values), most)
        packed[count].pack_into(view, at, count, *values[:count])

    def read(view: memoryview, at: int) -> tuple[float, ...]:
        (count,) = _WHOLE.unpack_from(view, at)  # a record that is being overwritten may contain any count
        values: tuple[float, ...] = packed[count if 0 <= count <= most else 0].unpack_from(view, at)
        return values[1:]

    return 1 + field.count, write, read


def _bytes(_: SlaveField) -> _Codec:
    return 1 + MOST_USER_BYTES // WORD, _write_bytes, _read_bytes


def _sent_bytes() -> _Codec:
    def write(view: memoryview, at: int, value: tuple[int, bytes]) -> None:
        _WHOLE.pack_into(view, at, value[0])
        _write_bytes(view, at + WORD, value[1])

    def read(view: memoryview, at: int) -> tuple[int, bytes]:
        return _WHOLE.unpack_from(view, at)[0], _read_bytes(view, at + WORD)

    return 2 + MOST_USER_BYTES // WORD, write, read


def _write_bytes(view: memoryview, at: int, data: bytes) -> None:
    data = data[:MOST_USER_BYTES]
    _WHOLE.pack_into(view, at, len(data))
    view[at + WORD : at + WORD + len(data)] = data


def _read_bytes(view: memoryview, at: int) -> bytes:
    (count,) = _WHOLE.unpack_from(view, at)
    return bytes(view[at + WORD : at + WORD + max(0, min(count, MOST_USER_BYTES))])


_WHOLE: Final = Struct("q")
_CODECS: Final[dict[FieldType, Callable[[SlaveField], _Codec]]] = {
    FieldType.POSE: _pose,
    FieldType.REALS: _reals,
    FieldType.REAL: lambda _: _one("d"),
    FieldType.STAMP: lambda _: _one("d"),  # seconds
    FieldType.BITS: lambda _: _one("q"),
    FieldType.BYTES: _bytes,
}
