"""Converts the parts of slvMove's parameter from and to VARIANTs (RC8 4.2 and 4.4, tables 4-2 and 4-5).

The numbers of a pose:

====  =====================  =================  ==================================================================
type  complete               may be omitted     may follow
====  =====================  =================  ==================================================================
P     x to fig: 7 numbers    fig                flags, then the values of the extended joints that they select
J     J1 to J8: 8 numbers    J7 and J8          flags, which select the extended joints among J7 and J8; the bits of
                                                J1 to J6 have no effect, because these joints always count
T     x to fig: 10 numbers   fig                as for P
====  =====================  =================  ==================================================================

Zeros may follow as well: some clients send arrays of a fixed length.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import N_, tr
from orinkit.core.record import record
from orinkit.core.validation import brief
from orinkit.rc8.slave_fields import FIELDS as TABLE
from orinkit.rc8.slave_fields import MOST_USER_BYTES, PARAMETERS, POSE_SIZES, FieldType, PoseKind, SlaveField
from orinkit.values.pose_numbers import FIELDS, FIG_AUTO
from orinkit.values.types import ARRAY, NUMERIC, VARIANT_ARRAY, VarType, type_name
from orinkit.values.variant import Variant, trusted

ExtraAxes: TypeAlias = tuple[tuple[int, float], ...]
"""Extended joints and their values: ``((7, 120.0), (8, -5.0))``, in deg or mm."""

LARGEST: Final = 1e6
"""The largest magnitude of a number of a pose, mm or deg."""

_FEWEST: Final[dict[PoseKind, int]] = {"P": 6, "J": 6, "T": 9}
_MOST: Final[dict[PoseKind, int]] = {"P": 10, "J": 9, "T": 13}
_AXES: Final[dict[float, tuple[int, ...]]] = {0x400000: (), 0x400040: (7,), 0x400080: (8,), 0x4000C0: (7, 8)}
_FLAGS: Final = {axes: float(flags) for flags, axes in _AXES.items()}
_ROBOT_BITS: Final = 0x3F  # J1 to J6
_IS_WITHIN: Final = LARGEST.__ge__


def read_numbers(kind: PoseKind, given: Variant) -> list[float]:
    """Return the numbers of an array of any numeric type, or of a VARIANT array of such numbers.

    Raises:
        CallError: DISP_E_TYPEMISMATCH if the argument is not such an array; E_INVALIDARG if the array is longer than
            any pose of this type.
    """
    if not given.type & ARRAY:
        raise _mismatch(given)
    if len(given.value) > _MOST[kind]:
        raise invalid(_wrong_count(kind, len(given.value)))
    numbers = elements(given, _MOST[kind])
    for number in numbers:
        if number.type not in NUMERIC:
            raise _mismatch(number)
    return [float(number.value) for number in numbers]


def read_pose(kind: PoseKind, numbers: Sequence[float]) -> tuple[tuple[float, ...], ExtraAxes]:
    """Return the complete pose, with default values for omitted numbers, and its extended joints.

    Raises:
        CallError: E_INVALIDARG if the count is wrong, if the flags of the extended joints are not valid or do not match
            the number of values after them, if a number is not finite or its magnitude is above LARGEST, or if the
            figure is not a whole number.
    """
    pose, extra = (tuple(numbers), ()) if len(numbers) == POSE_SIZES[kind] else _read_unusual(kind, numbers)
    if fault := _fault(kind, pose, extra):
        raise error_for(hresult.E_INVALIDARG, fault)
    return pose, extra


def numbers_to_send(kind: PoseKind, pose: Sequence[float], extra: ExtraAxes) -> list[float]:
    """Return the numbers of a pose for slvMove; omitted joints are 0, an omitted figure is FIG_AUTO.

    Raises:
        InvalidValue: If the count is wrong, a value is not a number, not finite or above LARGEST, or the extended
            joints are not 7, 8, or both in this order.
    """
    try:
        numbers = list(map(float, pose))
        axes, values = tuple([axis for axis, _ in extra]), [float(value) for _, value in extra]
    except (TypeError, ValueError, OverflowError):
        raise InvalidValue(
            tr(
                "pose {pose}, extended joints {extra}: not all values are numbers",
                pose=brief(pose),
                extra=brief(extra),
            )
        ) from None
    if len(numbers) != POSE_SIZES[kind]:
        if not _FEWEST[kind] <= len(numbers) <= POSE_SIZES[kind]:
            raise InvalidValue(_wrong_count(kind, len(numbers)))
        numbers = list(_completed(kind, numbers))
    if not axes:
        return _checked(kind, numbers, ())
    if axes not in _FLAGS:
        raise InvalidValue(
            tr("extended joints {axes} are not valid; expected 7, 8, or 7 and 8 in this order", axes=brief(axes))
        )
    if kind != "J":
        return [*_checked(kind, numbers, tuple(zip(axes, values, strict=True))), _FLAGS[axes], *values]
    for axis, value in zip(axes, values, strict=True):
        numbers[axis - 1] = value
    return [*_checked(kind, numbers, ()), _FLAGS[axes]]


def _read_unusual(kind: PoseKind, numbers: Sequence[float]) -> tuple[tuple[float, ...], ExtraAxes]:
    """Read a pose with omitted numbers, or with flags and extended joints."""
    if not _FEWEST[kind] <= len(numbers) <= _MOST[kind]:
        raise invalid(_wrong_count(kind, len(numbers)))
    size = POSE_SIZES[kind]
    pose, rest = _completed(kind, numbers[:size]), numbers[size:]
    if not any(rest):
        return pose, ()
    flags, *values = rest
    axes = _AXES.get(float(int(flags) & ~_ROBOT_BITS) if kind == "J" and flags.is_integer() else flags)
    shown = hexadecimal(int(flags)) if flags.is_integer() else str(flags)
    if axes is None:
        raise invalid(
            tr(
                "value {place} of a {kind} is {shown}; expected a flag of extended joints: 0x400040 (joint 7), "
                "0x400080 (joint 8) or 0x4000C0 (both)",
                place=size + 1,
                kind=kind,
                shown=shown,
            ),
        )
    if kind == "J":
        values = [pose[axis - 1] for axis in axes]
    if len(values) != len(axes):
        raise invalid(
            tr(
                "flags {flags} of extended joints require {wanted} values after them, got {given}",
                flags=shown,
                wanted=len(axes),
                given=len(values),
            ),
        )
    return pose, tuple(zip(axes, values, strict=True))


def _completed(kind: PoseKind, numbers: Sequence[float]) -> tuple[float, ...]:
    missing = POSE_SIZES[kind] - len(numbers)
    return (*numbers, *[0.0 if kind == "J" else float(FIG_AUTO)] * missing)


def _checked(kind: PoseKind, numbers: list[float], extra: ExtraAxes) -> list[float]:
    if fault := _fault(kind, numbers, extra):
        raise InvalidValue(fault)
    return numbers


def _fault(kind: PoseKind, pose: Sequence[float], extra: ExtraAxes) -> str:
    """Return the message about an invalid number of a complete pose; an empty string if all numbers are valid."""
    if not extra and all(map(_IS_WITHIN, map(abs, pose))) and (kind == "J" or pose[-1].is_integer()):
        return ""  # the most frequent case
    named = [*zip(FIELDS[kind], pose, strict=True), *((f"J{axis}", value) for axis, value in extra)]
    for place, (name, value) in enumerate(named, start=1):
        if not _IS_WITHIN(abs(value)):
            at = place + (place > len(pose))  # the flags are between the pose and the extended joints
            return tr(
                "{name} (value {place}) of a {kind} is {value}; expected a finite number of at most {largest:.0f}",
                name=name,
                place=at,
                kind=kind,
                value=value,
                largest=LARGEST,
            )
        if name == "fig" and not value.is_integer():
            return tr(
                "fig (value {place}) of a {kind} is {value}; expected a whole number",
                place=place,
                kind=kind,
                value=value,
            )
    return ""


def _wrong_count(kind: PoseKind, count: int) -> str:
    return tr(
        "{count} numbers for a {kind}; expected {few} to {size}, or up to {most} with extended joints",
        count=count,
        kind=kind,
        few=_FEWEST[kind],
        size=POSE_SIZES[kind],
        most=_MOST[kind],
    )


def _mismatch(given: Variant) -> CallError:
    name = type_name(given.type)
    return error_for(
        hresult.DISP_E_TYPEMISMATCH,
        tr("pose: got {name}, expected an array of numbers", name=name),
    )


# --- the other parts --------------------------------------------------------------------------------------------------

USER_STEP: Final = 8
"""I/O points per byte. User I/O is sent and requested in bytes that begin at a multiple of this number."""


@record
class UserWindow:
    """The user I/O requested for a result.

    Attributes:
        offset: Number of the first I/O point, a multiple of USER_STEP.
        size: Number of bytes, 1 to MOST_USER_BYTES.
    """

    offset: int
    size: int


_NAMES: Final = {
    "pose": N_("pose"),
    "format": N_("receive format"),
    "unit": N_("unit of timestamps"),
    "answer": N_("the whole result"),
    **{field.name: field.label for field in TABLE},
    **{f"{field.name} offset": field.offset_label for field in TABLE},
    **{f"{field.name} size": field.size_label for field in TABLE},
}
_BYTE: Final = 255


def _read_state(part: str, given: Variant) -> int:
    return whole(given, part)


def _read_window(part: str, offset: Variant, size: Variant) -> UserWindow:
    window = UserWindow(whole(offset, f"{part} offset"), whole(size, f"{part} size"))
    if fault := _window_fault(part, window.offset, window.size):
        raise error_for(hresult.E_INVALIDARG, fault)
    return window


def _read_user(part: str, offset: Variant, size: Variant, given: Variant) -> tuple[int, bytes]:
    window = _read_window(part, offset, size)
    states = [whole(each, part) for each in (elements(given, window.size) if given.type & ARRAY else [given])]
    if len(states) < window.size:
        raise invalid(
            tr(
                "{part}: got {count} bytes, expected {size}",
                part=called(part),
                count=len(states),
                size=window.size,
            ),
        )
    for place, state in enumerate(states, start=1):
        if not 0 <= state <= _BYTE:
            raise invalid(
                tr("{part}: byte {place} is {state}, expected 0 to 255", part=called(part), place=place, state=state),
            )
    return window.offset, bytes(states)


def _write_state(part: str, state: int) -> list[Variant]:
    bits = operator.index(state)
    if not -(2**31) <= bits < 2**32:
        name, shown = called(part), brief(bits)
        raise InvalidValue(tr("{name}: {shown} has more than 32 bits", name=name, shown=shown))
    return [trusted(VarType.I4, as_i4(bits))]


def _write_window(part: str, window: UserWindow) -> list[Variant]:
    if fault := _window_fault(part, window.offset, window.size):
        raise InvalidValue(fault)
    return [Variant(VarType.I4, window.offset), Variant(VarType.I4, window.size)]


def _write_user(part: str, user: tuple[int, bytes]) -> list[Variant]:
    offset, states = user[0], Variant(VarType.UI1 | ARRAY, user[1])
    return [*_write_window(part, UserWindow(offset, len(states.value))), states]


def _window_fault(part: str, offset: int, size: int) -> str:
    """Return the message about an invalid offset or size of user I/O; an empty string if both are valid."""
    if offset < 0 or offset % USER_STEP:
        name = called(f"{part} offset")
        return tr("{name} is {offset}, expected a multiple of {step}", name=name, offset=offset, step=USER_STEP)
    if not 1 <= size <= MOST_USER_BYTES:
        name = called(f"{part} size")
        return tr(
            "{name} is {size}, expected 1 to {most} bytes",
            name=name,
            size=size,
            most=MOST_USER_BYTES,
        )
    return ""


@record
class PartCodec:
    """The converter of a part that follows the pose in slvMove's parameter (table 4-2).

    Attributes:
        span: Number of elements of slvMove's parameter that the part consists of.
        read: Callback that returns the value of a part for its name and its elements.
        write: Callback that returns the elements of a part for its name and its value.
    """

    span: int
    read: Callable[..., Any]
    write: Callable[[str, Any], list[Variant]]


_FORMS: Final = {
    FieldType.BITS: PartCodec(1, _read_state, _write_state),
    FieldType.BYTES: PartCodec(3, _read_user, _write_user),
    FieldType.WINDOW: PartCodec(2, _read_window, _write_window),
}
PARTS: Final = {field.name: _FORMS[field.form] for field in PARAMETERS}
"""The converters of the parts after the pose, in the order of table 4-2, by the part's attribute name in ``SetPoint``.

Reading raises CallError: DISP_E_TYPEMISMATCH if a number is expected; E_INVALIDARG for a fraction or user I/O out of
bounds. Writing raises InvalidValue for states of more than 32 bits or user I/O out of bounds.
"""


# --- shared with slave_feedback and slave_formats ---------------------------------------------------------------------


def called(part: str) -> str:
    """Return the name that messages use for a part of slvMove's parameter or result."""
    return tr(_NAMES[part])


def called_in_answer(field: SlaveField) -> str:
    """Return the name of a field in messages about a result."""
    return tr(field.answer_label or field.label)


def whole(given: Variant, part: str) -> int:
    """Return a number of any type, or a string such as ``"17"`` or ``"0x11"``, as a whole number in the range of VT_I4.

    Args:
        given: The number or string.
        part: The part of the parameter to which it belongs, for messages.

    Raises:
        CallError: DISP_E_TYPEMISMATCH if it is not a number; E_INVALIDARG if it is a fraction or out of range.
    """
    given = coerce.unwrap_single(given)
    if given.type == VarType.BSTR and (found := _HEXADECIMAL.fullmatch(given.value.strip())):
        return as_i4(int(found[1], 16))
    try:
        return coerce.to_integer(given)
    except CallError as error:
        code = hresult.E_INVALIDARG if error.code == hresult.E_INVALIDARG else hresult.DISP_E_TYPEMISMATCH
        raise error_for(code, f"{called(part)}: {error.detail}") from None


_HEXADECIMAL: Final = re.compile(r"0[xX]([0-9A-Fa-f]{1,8})")


def as_i4(bits: int) -> int:
    """Return the lowest 32 bits of a number, interpreted as a signed number like a VT_I4."""
    return (bits + 2**31) % 2**32 - 2**31


def elements(given: Variant, most: int) -> list[Variant]:
    """Return the elements of an array, at most the first ``most`` of them."""
    if given.type == VARIANT_ARRAY:
        return list(given.value[:most])
    return [trusted(given.type & ~ARRAY, value) for value in given.value[:most]]


def invalid(text: str) -> CallError:
    """Return an E_INVALIDARG exception with a detail."""
    return error_for(hresult.E_INVALIDARG, text)


def hexadecimal(number: int) -> str:
    """Return a number as ``0x0120``, the notation of the RC8 document for formats and flags."""
    return f"0x{number:04X}" if 0 <= number < 2**32 else brief(number)
