"""The result of slvMove: its format, which slvRecvFormat sets, and its fields (RC8 4.2, tables 4-1 and 4-3)."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any, Final, TypeAlias

from orinkit.cao import coerce
from orinkit.core.errors import InvalidValue, ProtocolError
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.validation import brief
from orinkit.rc8.slave_fields import (
    ON_WIRE,
    POSE_MASK,
    POSE_PARTS,
    POSE_SIZES,
    POSES,
    RECEIVE_BITS,
    RECEIVED,
    FieldType,
    PoseKind,
    ReceiveBits,
    SlaveField,
)
from orinkit.rc8.slave_values import as_i4, called, called_in_answer, elements, hexadecimal, invalid, whole
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Value, Variant, VarType, trusted

# --- slvRecvFormat (table 4-1) -----------------------------------------------------------------------------------------


@record
class ReceiveFormat:
    """A format of slvRecvFormat; :func:`receive_format` creates one from its numbers.

    Attributes:
        number: Flags of :class:`ReceiveBits`, plus the number that selects the poses, a key of POSE_PARTS.
        microseconds: True if timestamps are in µs, False for ms.
    """

    number: int = 0
    microseconds: bool = False

    @property
    def kinds(self) -> tuple[PoseKind, ...]:
        """The types of the poses in a result, in the order of the poses."""
        return POSE_PARTS[self.number & POSE_MASK]

    @property
    def pose_only(self) -> bool:
        """True if a result is only the array of the pose, without other fields."""
        return self.number <= POSE_MASK

    def has(self, flag: ReceiveBits | int) -> bool:
        """Return True if a result contains the part that a flag stands for."""
        return bool(self.number & int(flag))


_RECEIVE_BITS: Final = POSE_MASK | sum(RECEIVE_BITS)


def receive_format(number: int, unit: int = 0) -> ReceiveFormat:
    """Return the format for the one or two numbers of slvRecvFormat's parameter.

    Args:
        number: Flags, plus the number that selects the poses.
        unit: Unit of timestamps, 0 for ms, 1 for µs.

    Raises:
        CallError: E_INVALIDARG if the number that selects the poses, a flag, or the unit does not exist.
    """
    if number & ~_RECEIVE_BITS or number & POSE_MASK not in POSE_PARTS:
        raise invalid(
            tr(
                "receive format {number} is not valid; expected 0 to {most} for the pose, plus any of {bits}",
                number=hexadecimal(number),
                most=max(POSE_PARTS),
                bits=", ".join(f"{bit:#x}" for bit in RECEIVE_BITS),
            ),
        )
    if unit not in (0, 1):
        raise invalid(
            tr("unit {unit} of timestamps is not valid; expected 0 (ms) or 1 (µs)", unit=brief(unit)),
        )
    return ReceiveFormat(number, bool(unit))


_RECEIVE_NUMBERS: Final = ("format", "unit")


def read_receive_parameter(parameter: Variant) -> ReceiveFormat:
    """Parse slvRecvFormat's parameter: a number, an array of one or two numbers, or a string such as ``"0x11,1"``.

    Raises:
        CallError: DISP_E_TYPEMISMATCH if a value is not a number; E_INVALIDARG for a wrong number of values or a
            fraction, and in the cases of :func:`receive_format`.
    """
    given = coerce.unwrap_single(parameter)
    most = len(_RECEIVE_NUMBERS)
    if given.type & ARRAY:
        numbers = elements(given, most + 1)
    elif given.type in (VarType.EMPTY, VarType.NULL) or given.value == "":
        numbers = []
    else:
        parts = given.value.split(",", most) if given.type == VarType.BSTR else [given.value]
        numbers = [trusted(given.type, part) for part in parts]
    if not 1 <= len(numbers) <= most:
        raise invalid(
            tr("expected 1 or 2 values: the receive format, and optionally the unit of timestamps"),
        )
    return receive_format(*map(whole, numbers, _RECEIVE_NUMBERS))


# --- the result of slvMove (table 4-3) --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SlaveReply:
    """The result of slvMove; a field that is not in the format is ``None``.

    Attributes:
        joints: Joint position of the arm, joints 1 to 8, deg (mm for linear axes).
        position: The pose of the arm as type P: x, y, z in mm, rx, ry, rz in deg, fig.
        trans: The pose of the arm as type T: x, y, z in mm, ox, oy, oz, ax, ay, az, fig.
        timestamp: The controller's time in ms, or in µs if :attr:`ReceiveFormat.microseconds` is True. It is a VT_I4
            and wraps around to -2147483648. In µs, this happens after 36 minutes.
        mini: States of the mini I/O as bits.
        hand: States of the hand I/O as bits.
        user: States of the requested user I/O.
        current: Currents of the motors, A.
        more: Fields for which this class has no attribute, by name.
    """

    joints: tuple[float, ...] | None = None
    position: tuple[float, ...] | None = None
    trans: tuple[float, ...] | None = None
    timestamp: int | None = None
    mini: int | None = None
    hand: int | None = None
    user: bytes | None = None
    current: tuple[float, ...] | None = None
    more: Mapping[str, Any] = field(default_factory=dict, hash=False, repr=False)

    def values(self) -> dict[str, Any]:
        """Return the fields that are present, by name."""
        found = {name: value for name, value in zip(_NAMES, _own(self), strict=True) if value is not None}
        return {**found, **self.more} if self.more else found

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> SlaveReply:
        """Return a result with the given values; the keys of ``values`` are the names of the fields."""
        own = {name: values[each] for each, name in _ATTRIBUTES.items() if name and each in values}
        return cls(**own, more={each: value for each, value in values.items() if not _ATTRIBUTES[each]})


_STAMP: Final = "timestamp"  # the attribute of the field of type STAMP
_OWN: Final = frozenset(each.name for each in fields(SlaveReply)) - {"more"}
_ATTRIBUTES: Final[dict[str, str]] = {
    row.name: name if (name := _STAMP if row.form is FieldType.STAMP else row.name) in _OWN else "" for row in RECEIVED
}
"""The attribute of :class:`SlaveReply` for each field, by field name; ``""`` for a field in ``more``."""
_NAMES: Final = tuple(name for name, own in _ATTRIBUTES.items() if own)
_own: Final[Callable[[SlaveReply], tuple[Any, ...]]] = operator.attrgetter(*filter(None, _ATTRIBUTES.values()))


def build_reply(format: ReceiveFormat, reply: SlaveReply) -> Variant:  # noqa: A002 - the document's word
    """Return slvMove's result (server side); fields that are not in the format are omitted.

    Raises:
        InvalidValue: If a field of the format is missing or has a wrong length.
    """
    pose: list[float] = []
    for kind in POSE_PARTS[format.number & POSE_MASK]:
        row = POSES[kind]
        numbers = getattr(reply, row.name)
        if numbers is None or len(numbers) != row.count:
            raise _missing(row)
        pose += numbers
    written = trusted(R8_ARRAY, pose)
    if format.number <= POSE_MASK:
        return written
    pose_at, plan = _plan_of_reply(format.number)
    parts = []
    for _, row, attribute, _, writer in plan:
        value = getattr(reply, attribute) if attribute else reply.more.get(row.name)
        if value is None or (row.count > 1 and len(value) != row.count):
            raise _missing(row)
        parts.append(writer(value))
    parts.insert(pose_at, written)
    return trusted(VARIANT_ARRAY, parts)


def read_reply(format: ReceiveFormat, value: Value) -> SlaveReply:  # noqa: A002 - the document's word
    """Parse slvMove's result (client side).

    Args:
        format: The format set with slvRecvFormat.
        value: The result as plain Python.

    Raises:
        ProtocolError: If the result does not match the format.
    """
    if format.number <= POSE_MASK:
        return SlaveReply(*_read_poses(format, value))
    pose_at, plan = _plan_of_reply(format.number)
    if not isinstance(value, list | tuple) or len(value) != len(plan) + 1:
        raise _wrong(format, called("answer"), value, tr("{count} values", count=len(plan) + 1))
    joints, position, trans = _read_poses(format, value[pose_at])
    own: dict[str, Any] = {}
    more: dict[str, Any] = {}
    for place, row, attribute, reader, _ in plan:
        if attribute:
            own[attribute] = reader(format, row, value[place])
        else:
            more[row.name] = reader(format, row, value[place])
    return SlaveReply(joints, position, trans, **own, more=more)


_REALS: Final = frozenset({float, int})
_IS_FINITE: Final = (1e300).__gt__  # for an absolute value; no number of a result is as large as 1e300
_SHOWN: Final = 10  # number of elements of an invalid result that a message quotes
_I4: Final = int(VarType.I4)
_Numbers: TypeAlias = tuple[float, ...] | None
_Reader: TypeAlias = Callable[[ReceiveFormat, SlaveField, Any], Any]
_Writer: TypeAlias = Callable[[Any], Variant]


@lru_cache(maxsize=256)
def _plan_of_reply(number: int) -> tuple[int, tuple[tuple[int, SlaveField, str, _Reader, _Writer], ...]]:
    """Return, for a number of slvRecvFormat, the index of the pose in a result (table 4-3), and a plan of its fields.

    For each field other than the pose, the plan contains: its index in the result, its row in the table of fields, its
    attribute of :class:`SlaveReply` (or ``""``), its reader, and its writer.
    """
    has = [row for row in _OTHERS if row.receive & number]
    pose_at = sum(row.place < _POSE_PLACE for row in has)
    places = ((place + (place >= pose_at), row) for place, row in enumerate(has))
    return pose_at, tuple(
        (place, row, _ATTRIBUTES[row.name], _READERS[row.form], _WRITERS[row.form]) for place, row in places
    )


_POSE_PLACE: Final = min(row.place for row in POSES.values())
_OTHERS: Final = tuple(row for row in ON_WIRE if row.form not in (FieldType.POSE, FieldType.WINDOW))


def _read_poses(receive: ReceiveFormat, given: Any) -> tuple[_Numbers, _Numbers, _Numbers]:
    """Return the joints, position and transformation of a result; ``None`` for those not in the format."""
    kinds = POSE_PARTS[receive.number & POSE_MASK]
    count = sum([POSE_SIZES[kind] for kind in kinds])
    numbers = _read_reals(receive, None, given, count, count)
    first = kinds[0]
    if first == "J":
        return numbers, None, None
    size = POSE_SIZES[first]
    joints = numbers[size:] or None
    return (joints, numbers[:size], None) if first == "P" else (joints, None, numbers[:size])


def _read_whole(receive: ReceiveFormat, row: SlaveField, given: Any) -> int:
    if type(given) is not int:
        raise _wrong(receive, called_in_answer(row), given, tr("a whole number"))
    return given


def _read_bytes(receive: ReceiveFormat, row: SlaveField, given: Any) -> bytes:
    if type(given) is not bytes:
        raise _wrong(receive, called_in_answer(row), given, tr("an array of VT_UI1"))
    return given


def _read_up_to_count(receive: ReceiveFormat, row: SlaveField, given: Any) -> tuple[float, ...]:
    return _read_reals(receive, row, given, 1, row.count)


def _read_real(receive: ReceiveFormat, row: SlaveField, given: Any) -> float:
    if type(given) in _REALS and _IS_FINITE(abs(given)):
        return float(given)
    raise _wrong(receive, called_in_answer(row), given, tr("a finite number"))


def _read_reals(receive: ReceiveFormat, row: SlaveField | None, given: Any, few: int, most: int) -> tuple[float, ...]:
    if (
        isinstance(given, list | tuple)
        and few <= len(given) <= most
        and _REALS.issuperset(map(type, given))
        and all(map(_IS_FINITE, map(abs, given)))
    ):
        return tuple(map(float, given))
    count = str(few) if few == most else f"{few}..{most}"
    name = called("pose") if row is None else called_in_answer(row)
    raise _wrong(receive, name, given, tr("{count} finite numbers", count=count))


_READERS: Final[dict[FieldType, _Reader]] = {
    FieldType.STAMP: _read_whole, FieldType.BITS: _read_whole, FieldType.BYTES: _read_bytes, FieldType.REALS: _read_up_to_count,
    FieldType.REAL: _read_real,
}  # fmt: skip
_WRITERS: Final[dict[FieldType, _Writer]] = {
    FieldType.STAMP: lambda value: trusted(_I4, as_i4(operator.index(value))),
    FieldType.BITS: lambda value: trusted(_I4, as_i4(operator.index(value))),
    FieldType.BYTES: lambda value: Variant(VarType.UI1 | ARRAY, value),
    FieldType.REALS: lambda value: trusted(R8_ARRAY, list(value)),
    FieldType.REAL: lambda value: trusted(VarType.R8, float(value)),
}


def _wrong(receive: ReceiveFormat, name: str, given: Any, wanted: str) -> ProtocolError:
    shown = brief(given[:_SHOWN] if isinstance(given, list | tuple | str | bytes) else given)
    if isinstance(given, list | tuple | bytes):
        shown = tr("{count} values, {shown}", count=len(given), shown=shown)
    number = hexadecimal(receive.number)
    return ProtocolError(
        tr(
            "result of slvMove with receive format {number}: {name} is {shown}, expected {wanted}",
            number=number,
            name=name,
            shown=shown,
            wanted=wanted,
        )
    )


def _missing(row: SlaveField) -> InvalidValue:
    name = called_in_answer(row)
    return InvalidValue(tr("{name}: required by the receive format, but missing or of another length", name=name))
