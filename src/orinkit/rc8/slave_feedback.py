"""What slvMove answers: slvRecvFormat and the answers it asks for (RC8 4.2, tables 4-1 and 4-3)."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from enum import IntFlag
from functools import lru_cache
from typing import Any, Final, TypeAlias

from orinkit.cao import coerce
from orinkit.core.errors import InvalidValue, ProtocolError
from orinkit.core.i18n import tr
from orinkit.rc8.slave_values import POSE_SIZES, PoseKind, as_i4, called, elements, hexadecimal, invalid, whole
from orinkit.values.pose_numbers import brief
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Value, Variant, VarType, trusted

CURRENTS: Final = 8
"""How many motor currents an answer has."""


# --- slvRecvFormat (table 4-1) -----------------------------------------------------------------------------------------


class Receive(IntFlag):
    """What slvMove answers beside the pose; the pose itself is a number in POSE_MASK."""

    TIME = 0x10
    HAND = 0x20
    CURRENT = 0x40
    MINI = 0x100
    USER = 0x200


POSE_MASK: Final = 0x0F
"""The part of a receive format that says what the pose is."""
POSE_PARTS: Final[dict[int, tuple[PoseKind, ...]]] = {
    0: ("J",), 1: ("P",), 2: ("J",), 3: ("T",), 4: ("P", "J"), 5: ("T", "J"),
}  # fmt: skip
"""The kinds of pose of each number in POSE_MASK; 0 is what a controller answers before any slvRecvFormat (RC8 4.6.3)."""


@dataclass(frozen=True, slots=True)
class ReceiveFormat:
    """What slvRecvFormat sets; :func:`receive_format` makes it of its numbers.

    Attributes:
        number: flags of :class:`Receive` and a number of POSE_PARTS.
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

    def has(self, flag: Receive) -> bool:
        """Tell whether an answer has this part."""
        return bool(self.number & int(flag))


_RECEIVE_BITS: Final = POSE_MASK | sum(map(int, Receive))


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
                "receive format {number}: 0 to 5 for the pose, with any of 0x10, 0x20, 0x40, 0x100 and 0x200",
                number=hexadecimal(number),
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
    """

    joints: tuple[float, ...] | None = None
    position: tuple[float, ...] | None = None
    trans: tuple[float, ...] | None = None
    timestamp: int | None = None
    mini: int | None = None
    hand: int | None = None
    user: bytes | None = None
    current: tuple[float, ...] | None = None


def build_answer(format: ReceiveFormat, answer: SlaveAnswer) -> Variant:  # noqa: A002 - the document's word
    """Return slvMove's answer, the server's side; what the format does not have is left out.

    Raises:
        InvalidValue: the format has something that is missing, or of another length.
    """
    pose: list[float] = []
    for kind in POSE_PARTS[format.number & POSE_MASK]:
        numbers = getattr(answer, _POSE_NAMES[kind])
        if numbers is None or len(numbers) != POSE_SIZES[kind]:
            raise _not_there(_POSE_NAMES[kind])
        pose += numbers
    if format.number <= POSE_MASK:
        return trusted(R8_ARRAY, pose)
    parts = _parts_of_answer(format.number)
    return trusted(VARIANT_ARRAY, [_written(part, pose if part == "pose" else getattr(answer, part)) for part in parts])


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
    parts = _parts_of_answer(format.number)
    if not isinstance(value, list | tuple) or len(value) != len(parts):
        raise _wrong(format, "answer", value, tr("{count} values", count=len(parts)))
    found = dict(zip(parts, value, strict=True))
    joints, position, trans = _read_poses(format, found.pop("pose"))
    return SlaveAnswer(joints, position, trans, **{part: _read_part(format, part, found[part]) for part in found})


_POSE_NAMES: Final[dict[PoseKind, str]] = {"J": "joints", "P": "position", "T": "trans"}
_ANSWER_ORDER: Final = {
    "timestamp": int(Receive.TIME), "pose": ~0, "mini": int(Receive.MINI), "user": int(Receive.USER),
    "hand": int(Receive.HAND), "current": int(Receive.CURRENT),
}  # fmt: skip
_REALS: Final = frozenset({float, int})
_IS_FINITE: Final = (1e300).__gt__  # of a magnitude; no number of an answer comes near
_ANSWER_NAMES: Final = {"user": "states"}  # where a message calls it something else than in a parameter
_SHOWN: Final = 10  # elements of a wrong answer that a message quotes
_I4: Final = int(VarType.I4)
_Numbers: TypeAlias = tuple[float, ...] | None


@lru_cache(maxsize=256)
def _parts_of_answer(number: int) -> tuple[str, ...]:
    """Return what is in an answer that is not a pose alone, in the order of table 4-3."""
    return tuple(part for part, flag in _ANSWER_ORDER.items() if number & flag)


def _written(part: str, value: Any) -> Variant:
    if value is None or (part == "current" and len(value) != CURRENTS):
        raise _not_there(part)
    if part == "user":
        return Variant(VarType.UI1 | ARRAY, value)
    if part in ("pose", "current"):
        return trusted(R8_ARRAY, list(value))
    return trusted(_I4, as_i4(operator.index(value)))


def _read_poses(receive: ReceiveFormat, given: Any) -> tuple[_Numbers, _Numbers, _Numbers]:
    """Return joints, position and transformation of an answer's pose."""
    kinds = POSE_PARTS[receive.number & POSE_MASK]
    count = sum([POSE_SIZES[kind] for kind in kinds])
    numbers = _read_reals(receive, "pose", given, count, count)
    first = kinds[0]
    if first == "J":
        return numbers, None, None
    size = POSE_SIZES[first]
    joints = numbers[size:] or None
    return (joints, numbers[:size], None) if first == "P" else (joints, None, numbers[:size])


def _read_part(receive: ReceiveFormat, part: str, given: Any) -> Any:
    if part == "current":
        return _read_reals(receive, part, given, 1, CURRENTS)
    if type(given) is not (bytes if part == "user" else int):
        wanted = tr("an array of VT_UI1") if part == "user" else tr("a whole number")
        raise _wrong(receive, part, given, wanted)
    return given


def _read_reals(receive: ReceiveFormat, part: str, given: Any, few: int, most: int) -> tuple[float, ...]:
    if (
        isinstance(given, list | tuple)
        and few <= len(given) <= most
        and _REALS.issuperset(map(type, given))
        and all(map(_IS_FINITE, map(abs, given)))
    ):
        return tuple(map(float, given))
    count = str(few) if few == most else f"{few}..{most}"
    raise _wrong(receive, part, given, tr("{count} finite numbers", count=count))


def _wrong(receive: ReceiveFormat, part: str, given: Any, wanted: str) -> ProtocolError:
    shown = brief(given[:_SHOWN] if isinstance(given, list | tuple | str | bytes) else given)
    if isinstance(given, list | tuple | bytes):
        shown = tr("{count} values, {shown}", count=len(given), shown=shown)
    name, number = called(_ANSWER_NAMES.get(part, part)), hexadecimal(receive.number)
    return ProtocolError(
        tr(
            "slvMove's answer with receive format {number}: {name} is {shown} instead of {wanted}",
            number=number,
            name=name,
            shown=shown,
            wanted=wanted,
        )
    )


def _not_there(part: str) -> InvalidValue:
    name = called(_ANSWER_NAMES.get(part, part))
    return InvalidValue(tr("{name}: the receive format has it, but it is missing or of another length", name=name))
