"""The user variables and I/O points: their values, the times of their writes, and their storage on disk."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType, trusted
from orinkit.virtual.rc8.variables.database import StoredVariable, VariableDatabase
from orinkit.virtual.rc8.variables.types import CLASSES, USER_CLASSES, VariableClass

DEFAULT_COUNT: Final = 100
DEFAULT_IO_POINTS: Final = 512
_MOST: Final = 2**31 - 1  # @VAR_x_LEN is VT_I4
_MOST_IO_POINTS: Final = 65536
MOST_RESIZED: Final = 65536
"""Largest count that a client can set; poses of motions have numbers up to 65535 (provider guide, appendix B)."""
_LENGTH: Final = "@VAR_{}_LEN"  # class of the row in which a changed count is stored
_SIGNED_FORMATS: Final = {8: "<b", 16: "<h", 32: "<i"}
_UNSIGNED_FORMATS: Final = {8: "<B", 16: "<H", 32: "<I"}


class VariableTable:
    """All variables, shared by all clients. Only written values are stored; the others have the default of their class.

    Args:
        counts: Number of variables of each class I F D V P J T S; 100 for a class that is not listed.
        io_points: Number of I/O points.
        store: Database in which a write is saved before the client receives the reply, or ``None``.
        now: Callback that returns the controller's local date and time.

    Raises:
        ValueError: If a class is unknown, or a count is out of range.
        StateError: If the store has a value that is not valid for its variable.
    """

    def __init__(
        self,
        counts: Mapping[str, int] | None,
        io_points: int,
        store: VariableDatabase | None,
        now: Callable[[], datetime],
    ) -> None:
        self.counts = _read_counts(counts or {})
        self._fixed = {name.strip().upper() for name in counts or {}}
        self.io_points = _within(io_points, "IO", _MOST_IO_POINTS)
        self._store = store
        self._now = now
        self._made = now()
        self._values: dict[tuple[str, int], Any] = {}
        self._written: dict[tuple[str, int], datetime] = {}
        self._points = 0  # bit n is I/O point n, so that a group of points is read and changed in one step
        if store is not None:
            self._load(store)

    def check(self, kind: VariableClass, index: int) -> None:
        """Check that a variable exists; for a group of I/O points, check that all points exist.

        Raises:
            CallError: VARIABLE_INDEX_INVALID.
        """
        count = self.io_points - kind.bits + 1 if kind.bits else self.counts[kind.name]
        if not 0 <= index < count:
            indices = f"0..{count - 1}" if count > 0 else tr("none")
            raise error_for(
                hresult.VARIABLE_INDEX_INVALID,
                tr("{name}{index} does not exist; valid indices: {range}", name=kind.name, index=index, range=indices),
            )

    def read(self, kind: VariableClass, index: int) -> Variant:
        """Return the value with its type.

        Raises:
            CallError: VARIABLE_INDEX_INVALID.
        """
        self.check(kind, index)
        if kind.bits:
            return trusted(int(kind.vt), _from_bits(kind, self._points >> index & _mask(kind)))
        value = self._values.get((kind.name, index), kind.default)
        return trusted(int(kind.vt), list(value) if isinstance(value, tuple) else value)

    def write(self, kind: VariableClass, index: int, given: Variant) -> None:
        """Set the value and save it; if an exception is raised, nothing has changed.

        Raises:
            CallError: VARIABLE_INDEX_INVALID; errors of conversion (:mod:`orinkit.virtual.rc8.variables.conversion`);
                E_FAIL if the value cannot be saved.
        """
        self.check(kind, index)
        value = kind.convert(given)
        written = self._now()
        if kind.bits:
            self._write_points(kind, index, _to_bits(kind, value), written)
            return
        self._save(kind.name, {index: value}, written)
        self._values[kind.name, index] = value
        self._written[kind.name, index] = written

    def written(self, kind: VariableClass, index: int) -> datetime:
        """Return the time of the last write, or of the controller's start if the variable was never written.

        For a group of I/O points, this is the last write of any of its points.

        Raises:
            CallError: VARIABLE_INDEX_INVALID.
        """
        self.check(kind, index)
        if not kind.bits:
            return self._written.get((kind.name, index), self._made)
        moments = [self._written[key] for n in range(kind.bits) if (key := ("IO", index + n)) in self._written]
        return max(moments, default=self._made)

    def points(self, first: int, count: int) -> int:
        """Return the states of I/O points as bits; the lowest bit is the first point. Nonexistent points are 0."""
        return self._points >> first & (1 << count) - 1

    def set_points(self, first: int, count: int, states: int) -> None:
        """Set I/O points, which must exist, to bits; the lowest bit is the first point. Unchanged points are not saved.

        Raises:
            CallError: E_FAIL if the points cannot be saved.
        """
        changed = self.points(first, count) ^ states
        numbers = [first + bit for bit in range(count) if changed >> bit & 1]
        if not numbers:
            return
        written = self._now()
        self._save("IO", {number: bool(states >> number - first & 1) for number in numbers}, written)
        self._points ^= changed << first
        self._written.update({("IO", number): written for number in numbers})

    def resize(self, name: str, count: int) -> None:
        """Change the number of variables of a class; values beyond the new number are deleted.

        Raises:
            CallError: VALUE_OUT_OF_RANGE; E_FAIL if the change cannot be saved.
        """
        if not 0 <= count <= MOST_RESIZED:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("the count of {name} must be 0 to {most}, not {count}", name=name, most=MOST_RESIZED, count=count),
            )
        if self._store is not None:
            self._store.delete_from(name, count)
        self._save(_LENGTH.format(name), {0: count}, self._now())
        for key in [key for key in self._values if key[0] == name and key[1] >= count]:
            del self._values[key]
            del self._written[key]
        self.counts[name] = count

    def close(self) -> None:
        """Close the store."""
        if self._store is not None:
            self._store.close()

    def _write_points(self, kind: VariableClass, index: int, bits: int, written: datetime) -> None:
        numbers = range(index, index + kind.bits)
        self._save("IO", {number: bool(bits >> number - index & 1) for number in numbers}, written)
        self._points = self._points & ~(_mask(kind) << index) | bits << index
        self._written.update({("IO", number): written for number in numbers})

    def _save(self, kind: str, values: Mapping[int, object], written: datetime) -> None:
        if self._store is not None:
            self._store.save(kind, values, written)

    def _load(self, store: VariableDatabase) -> None:
        rows = store.rows()
        lengths = {_LENGTH.format(name): name for name in self.counts if name not in self._fixed}
        for row in rows:
            if row.kind in lengths and type(row.value) is int and 0 <= row.value <= MOST_RESIZED:
                self.counts[lengths[row.kind]] = row.value
        for row in rows:
            if not 0 <= row.index < self._count(row.kind):
                continue  # this controller does not have the variable: leave it in the file
            value = _stored_value(store, row)
            self._written[row.kind, row.index] = row.written
            if row.kind == "IO":
                self._points |= value << row.index
            else:
                self._values[row.kind, row.index] = value

    def _count(self, kind: str) -> int:
        return self.io_points if kind == "IO" else self.counts.get(kind, 0)


def _stored_value(store: VariableDatabase, row: StoredVariable) -> Any:
    kind = CLASSES[row.kind]
    try:
        return kind.convert(Variant(kind.vt, row.value))
    except (InvalidValue, CallError) as error:
        raise store.damaged(row.kind, row.index, error) from error


def _mask(kind: VariableClass) -> int:
    return (1 << kind.bits) - 1


def _from_bits(kind: VariableClass, bits: int) -> Any:
    if kind.vt == VarType.BOOL:
        return bool(bits)
    return _repack(_UNSIGNED_FORMATS[kind.bits], _format(kind), bits)


def _to_bits(kind: VariableClass, value: Any) -> int:
    if kind.vt == VarType.BOOL:
        return int(value)
    return int(_repack(_format(kind), _UNSIGNED_FORMATS[kind.bits], value))


def _format(kind: VariableClass) -> str:
    return "<f" if kind.vt == VarType.R4 else _SIGNED_FORMATS[kind.bits]


def _repack(given: str, wanted: str, value: Any) -> Any:
    return struct.unpack(wanted, struct.pack(given, value))[0]


def _read_counts(counts: Mapping[str, int]) -> dict[str, int]:
    given = {name.strip().upper(): count for name, count in counts.items()}
    unknown = ", ".join(sorted(given.keys() - set(USER_CLASSES)))
    if unknown:
        classes = " ".join(USER_CLASSES)
        raise ValueError(tr("unknown variable class {unknown}. Try: {classes}", unknown=unknown, classes=classes))
    return {name: _within(given.get(name, DEFAULT_COUNT), name, _MOST) for name in USER_CLASSES}


def _within(count: int, name: str, most: int) -> int:
    if not 0 <= count <= most:
        raise ValueError(tr("the count of {name} must be 0 to {most}, not {count}", name=name, most=most, count=count))
    return count
