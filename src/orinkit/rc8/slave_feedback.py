"""What slvMove answers: slvRecvFormat and the answers it asks for (RC8 4.2, tables 4-1 and 4-3)."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any, Final, TypeAlias

from orinkit.cao import coerce
from orinkit.core.errors import InvalidValue, ProtocolError
from orinkit.core.i18n import tr
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
from orinkit.values.pose_numbers import brief
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Value, Variant, VarType, trusted

# --- slvRecvFormat (table 4-1) -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReceiveFormat:
    """What slvRecvFormat sets; :func:`receive_format` makes it of its numbers.

    Attributes:
        number: flags of :class:`ReceiveBits` and a number of POSE_PARTS.
        microseconds: timestamps are in µs, not in ms.
    """

    number: int = 0
    microseconds: bool = False

    @property
    def kinds(self) -> tuple[PoseKind, ...]:
        """The kinds of pose in an answer, in their order."""
        return POSE_PARTS[self.number & POSE_MASK]

    @property
    def pose_only(self) -> bool:
        """Whether an answer is a bare array."""
        return self.number <= POSE_MASK

    def has(self, flag: ReceiveBits | int) -> bool:
        """Tell whether an answer has this part."""
        return bool(self.number & int(flag))


_RECEIVE_BITS: Final = POSE_MASK | sum(RECEIVE_BITS)


def receive_format(number: int, unit: int = 0) -> ReceiveFormat:
    """Return the format of the numbers of slvRecvFormat.

    Args:
        number: flags, and what the pose is.
        unit: of timestamps, 0 for ms, 1 for µs.

    Raises:
        CallError: E_INVALIDARG, there is no such pose, flag or unit.
    """
    if number & ~_RECEIVE_BITS or number & POSE_MASK not in POSE_PARTS:
        raise invalid(
            tr(
                "receive format {number}: 0 to {most} for the pose, with any of {bits}",
                number=hexadecimal(number),
                most=max(POSE_PARTS),
                bits=", ".join(f"{bit:#x}" for bit in RECEIVE_BITS),
            ),
        )
    if unit not in (0, 1):
        raise invalid(
            tr("unit {unit} of timestamps: 0 for ms, 1 for µs", unit=brief(unit)),
        )
    return ReceiveFormat(number, bool(unit))


_RECEIVE_NUMBERS: Final = ("format", "unit")


def read_receive_parameter(parameter: Variant) -> ReceiveFormat:
    """Return the format of slvRecvFormat's parameter: a number, an array of one or two, or a text like ``"0x11,1"``.

    Raises:
        CallError: DISP_E_TYPEMISMATCH, no number; E_INVALIDARG, too few or too many, a fraction, or as
            :func:`receive_format`.
    """
    given = coerce.single(parameter)
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
            tr(
                "too few or too many numbers: the receive format is wanted, and behind it the unit of "
                "timestamps if you like"
            ),
        )
    return receive_format(*map(whole, numbers, _RECEIVE_NUMBERS))


# --- slvMove's answer (table 4-3) -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SlaveAnswer:
    """What slvMove answers; what the format does not have is ``None``.

    Attributes:
        joints: where the arm is, joints 1 to 8, degrees.
        position: the same as x, y, z in mm, rx, ry, rz in degrees, fig.
        trans: the same as x, y, z, ox, oy, oz, ax, ay, az, fig.
        timestamp: the controller's time in ms, or in µs if the format says so. It is a VT_I4: one that does not fit
            begins again at -2147483648, µs after 36 minutes.
        mini: states of the mini I/O, bit by bit.
        hand: states of the hand I/O, bit by bit.
        user: states of the user I/O that were asked for.
        current: of the motors.
        more: fields without an attribute here, by their names.
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
        """Return what is there, by the names of the fields."""
        found = {name: value for name, value in zip(_NAMES, _own(self), strict=True) if value is not None}
        return {**found, **self.more} if self.more else found

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> SlaveAnswer:
        """Return the answer with these values of fields, by their names."""
        own = {name: values[each] for each, name in _ATTRIBUTES.items() if name and each in values}
        return cls(**own, more={each: value for each, value in values.items() if not _ATTRIBUTES[each]})


_STAMP: Final = "timestamp"  # the attribute of what is a time for programs
_OWN: Final = frozenset(each.name for each in fields(SlaveAnswer)) - {"more"}
_ATTRIBUTES: Final[dict[str, str]] = {
    row.name: name if (name := _STAMP if row.form is FieldType.STAMP else row.name) in _OWN else "" for row in RECEIVED
}
"""The attribute of each field; ``""`` for one that is in ``more``."""
_NAMES: Final = tuple(name for name, own in _ATTRIBUTES.items() if own)
_own: Final[Callable[[SlaveAnswer], tuple[Any, ...]]] = operator.attrgetter(*filter(None, _ATTRIBUTES.values()))


def build_answer(format: ReceiveFormat, answer: SlaveAnswer) -> Variant:  # noqa: A002 - the document's word
    """Return slvMove's answer, the server's side; what the format does not have is left out.

    Raises:
        InvalidValue: the format has something that is missing, or of another length.
    """
    pose: list[float] = []
    for kind in POSE_PARTS[format.number & POSE_MASK]:
        row = POSES[kind]
        numbers = getattr(answer, row.name)
        if numbers is None or len(numbers) != row.count:
            raise _not_there(row)
        pose += numbers
    written = trusted(R8_ARRAY, pose)
    if format.number <= POSE_MASK:
        return written
    pose_at, plan = _plan_of_answer(format.number)
    parts = []
    for _, row, attribute, _, writer in plan:
        value = getattr(answer, attribute) if attribute else answer.more.get(row.name)
        if value is None or (row.count > 1 and len(value) != row.count):
            raise _not_there(row)
        parts.append(writer(value))
    parts.insert(pose_at, written)
    return trusted(VARIANT_ARRAY, parts)


def read_answer(format: ReceiveFormat, value: Value) -> SlaveAnswer:  # noqa: A002 - the document's word
    """Return what slvMove answered, the client's side.

    Args:
        format: what slvRecvFormat set.
        value: the answer as plain Python.

    Raises:
        ProtocolError: it is not what the format says.
    """
    if format.number <= POSE_MASK:
        return SlaveAnswer(*_read_poses(format, value))
    pose_at, plan = _plan_of_answer(format.number)
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
    return SlaveAnswer(joints, position, trans, **own, more=more)


_REALS: Final = frozenset({float, int})
_IS_FINITE: Final = (1e300).__gt__  # of a magnitude; no number of an answer comes near
_SHOWN: Final = 10  # elements of a wrong answer that a message quotes
_I4: Final = int(VarType.I4)
_Numbers: TypeAlias = tuple[float, ...] | None
_Reader: TypeAlias = Callable[[ReceiveFormat, SlaveField, Any], Any]
_Writer: TypeAlias = Callable[[Any], Variant]


@lru_cache(maxsize=256)
def _plan_of_answer(number: int) -> tuple[int, tuple[tuple[int, SlaveField, str, _Reader, _Writer], ...]]:
    """Return the place of the pose in an answer (table 4-3); place, row, attribute, reader, writer of each other field."""
    has = [row for row in _OTHERS if row.receive & number]
    pose_at = sum(row.place < _POSE_PLACE for row in has)
    places = ((place + (place >= pose_at), row) for place, row in enumerate(has))
    return pose_at, tuple(
        (place, row, _ATTRIBUTES[row.name], _READERS[row.form], _WRITERS[row.form]) for place, row in places
    )


_POSE_PLACE: Final = min(row.place for row in POSES.values())
_OTHERS: Final = tuple(row for row in ON_WIRE if row.form not in (FieldType.POSE, FieldType.WINDOW))


def _read_poses(receive: ReceiveFormat, given: Any) -> tuple[_Numbers, _Numbers, _Numbers]:
    """Return joints, position and transformation of an answer's pose."""
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
            "slvMove's answer with receive format {number}: {name} is {shown} instead of {wanted}",
            number=number,
            name=name,
            shown=shown,
            wanted=wanted,
        )
    )


def _not_there(row: SlaveField) -> InvalidValue:
    name = called_in_answer(row)
    return InvalidValue(tr("{name}: the receive format has it, but it is missing or of another length", name=name))
