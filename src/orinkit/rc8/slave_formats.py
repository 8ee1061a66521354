"""Slave mode in numbers: modes, formats, the parameter and the result of slvMove (RC8 4.2, tables 4-1 to 4-5).

Both the server and the client use this module. slvMove's parameter and its result consist of parts. The parts in
brackets are present if the bit for them is set in slvSendFormat or slvRecvFormat. If the pose is the only part, it is
sent as a VT_R8 array. Otherwise all parts are elements of a VARIANT array::

    parameter   pose, [mini I/O], [user I/O to send: offset, size, bytes], [user I/O to receive: offset, size],
                [hand I/O]
    result      [timestamp], pose, [mini I/O], [user I/O], [hand I/O], [motor currents]

If a result has two poses (P and J, or T and J), they are in one array.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import islice
from operator import attrgetter
from typing import Final

from orinkit.core.errors import CallError, InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.validation import brief
from orinkit.rc8.slave_feedback import ReceiveFormat as ReceiveFormat
from orinkit.rc8.slave_feedback import SlaveReply as SlaveReply
from orinkit.rc8.slave_feedback import build_reply as build_reply
from orinkit.rc8.slave_feedback import read_receive_parameter as read_receive_parameter
from orinkit.rc8.slave_feedback import read_reply as read_reply
from orinkit.rc8.slave_feedback import receive_format as receive_format
from orinkit.rc8.slave_fields import MOST_USER_BYTES as MOST_USER_BYTES
from orinkit.rc8.slave_fields import PARAMETERS, POSES, FieldType
from orinkit.rc8.slave_fields import POSE_MASK as POSE_MASK
from orinkit.rc8.slave_fields import POSE_PARTS as POSE_PARTS
from orinkit.rc8.slave_fields import POSE_SIZES as POSE_SIZES
from orinkit.rc8.slave_fields import SEND_FORMATS as SEND_FORMATS
from orinkit.rc8.slave_fields import PoseKind as PoseKind
from orinkit.rc8.slave_fields import ReceiveBits as ReceiveBits
from orinkit.rc8.slave_fields import SendBits as SendBits
from orinkit.rc8.slave_values import LARGEST as LARGEST
from orinkit.rc8.slave_values import (
    PARTS,
    ExtraAxes,
    called,
    hexadecimal,
    invalid,
    numbers_to_send,
    read_numbers,
    read_pose,
)
from orinkit.rc8.slave_values import USER_STEP as USER_STEP
from orinkit.rc8.slave_values import UserWindow as UserWindow
from orinkit.rc8.user_io_unit import UserIoUnit as UserIoUnit
from orinkit.rc8.user_io_unit import size_in_bytes, size_to_send
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Value, Variant, trusted

# --- modes and formats (table 4-1) ------------------------------------------------------------------------------------


@record
class SlaveMode:
    """A mode of slvChangeMode (RC8 4.3).

    Attributes:
        number: Number for slvChangeMode, 0x001 to 0x203.
        kind: Pose type of the set-points.
        buffering: 0: set-points are queued, and slvMove returns immediately. 1: a set-point overwrites the previous
            one. 2: set-points are queued, and slvMove returns when the queue has room.
    """

    number: int
    kind: PoseKind
    buffering: int


OFF: Final = 0
"""The number for slvChangeMode to leave slave mode."""
_LOW_BYTES: Final[dict[int, PoseKind]] = dict(sorted((row.mode, kind) for kind, row in POSES.items()))
SLAVE_MODES: Final[dict[int, SlaveMode]] = {
    buffering << 8 | low: SlaveMode(buffering << 8 | low, kind, buffering)
    for buffering in (0, 1, 2)
    for low, kind in _LOW_BYTES.items()
}
"""The nine modes by number."""


def mode_of(number: int) -> SlaveMode | None:
    """Return the slave mode that a number of slvChangeMode selects; ``None`` for OFF.

    Raises:
        CallError: E_INVALIDARG if the mode does not exist.
    """
    if number == OFF:
        return None
    if number not in SLAVE_MODES:
        raise _unknown(tr("slave mode"), number, (OFF, *SLAVE_MODES))
    return SLAVE_MODES[number]


def mode_number(buffering: int, kind: str) -> int:
    """Return the number of a mode for slvChangeMode.

    Raises:
        InvalidValue: If the mode does not exist.
    """
    for mode in SLAVE_MODES.values():
        if (mode.buffering, mode.kind) == (buffering, kind):
            return mode.number
    raise InvalidValue(
        tr("slave mode {buffering} with pose type {kind} does not exist. Try: mode 0, 1 or 2, with pose type "
            "\"P\", \"J\" or \"T\"", buffering=brief(buffering), kind=brief(kind))
    )  # fmt: skip


def send_format(number: int) -> SendBits:
    """Return the format for a number of slvSendFormat.

    Raises:
        CallError: E_INVALIDARG if the format does not exist.
    """
    if number not in SEND_FORMATS:
        raise _unknown(tr("send format"), number, SEND_FORMATS)
    return SendBits(number)


_WINDOW_BITS: Final = sum(int(row.receive) for row in PARAMETERS if row.form is FieldType.WINDOW)


# --- slvMove's parameter (tables 4-2 and 4-5) -------------------------------------------------------------------------


@record
class SetPoint:
    """The parameter of one slvMove. A part that is ``None`` is not sent.

    Attributes:
        pose: P: x, y, z in mm, rx, ry, rz in deg, fig. J: joints 1 to 8 in deg (mm for linear axes). T: x, y, z in mm,
            ox, oy, oz, ax, ay, az, fig.
        extra: Extended joints and their values, 7 before 8. In a pose of type J, the values are also elements of
            ``pose``; if they differ, the values of ``extra`` are sent.
        mini: States of the mini I/O as bits.
        hand: States of the hand I/O as bits.
        user: Number of the first user I/O point, a multiple of USER_STEP, and the bytes to set from this point on.
        window: The user I/O requested for the result.
    """

    pose: tuple[float, ...]
    extra: ExtraAxes = ()
    mini: int | None = None
    hand: int | None = None
    user: tuple[int, bytes] | None = None
    window: UserWindow | None = None


def encode_set_point(
    kind: PoseKind, point: SetPoint, send: SendBits, receive: ReceiveFormat, unit: UserIoUnit = UserIoUnit.BYTES
) -> Value:
    """Return slvMove's parameter (client side); missing joints are 0, a missing figure is FIG_AUTO.

    ``unit`` is the unit of the size of user I/O.

    Raises:
        InvalidValue: If a part that the formats require is missing, a part is present that the formats do not include,
            a count is wrong, a number is not finite or above LARGEST, or user I/O is out of bounds.
    """
    parts = _parts_of_set_point(int(send), receive.number & _WINDOW_BITS)
    numbers = numbers_to_send(kind, point.pose, point.extra)
    if not parts and _OPTIONAL(point) == _NOTHING:
        return numbers
    parameter = [trusted(R8_ARRAY, numbers)]
    for name, part in PARTS.items():
        value = getattr(point, name)
        if (value is None) == (name in parts):
            raise _not_as_formats(name, name in parts)
        if value is not None:
            written = part.write(name, value)
            parameter += size_to_send(written, unit) if name in _SIZED else written
    return trusted(VARIANT_ARRAY, parameter)


def read_set_point(
    kind: PoseKind, parameter: Variant, send: SendBits, receive: ReceiveFormat, unit: UserIoUnit = UserIoUnit.BYTES
) -> SetPoint:
    """Return the set-point of slvMove's parameter (server side).

    Numbers may be of any numeric type, and a pose may be an array of any numeric type. A pose of type J may end after
    joint 6; a pose of type P or T may end before the figure. A complete pose may be followed by flags and extended
    joints (table 4-5), or by zeros. ``unit`` is the unit of the size of user I/O, if the bytes that are sent along do
    not show it (:mod:`orinkit.rc8.user_io_unit`).

    Raises:
        CallError: DISP_E_TYPEMISMATCH if an array or a number is expected; E_INVALIDARG if a count is wrong, flags are
            not valid or do not match the values after them, a number is not finite or above LARGEST, or user I/O is
            out of bounds.
    """
    parts = _parts_of_set_point(int(send), receive.number & _WINDOW_BITS)
    if not parts and parameter.type == R8_ARRAY:  # the most frequent case
        return SetPoint(*read_pose(kind, parameter.value))
    given = iter(_split(parameter, parts))
    pose, extra = read_pose(kind, read_numbers(kind, next(given)))
    found = {}
    for part in parts:
        values = list(islice(given, PARTS[part].span))
        if part in _SIZED:
            values, unit = size_in_bytes(part, values, unit)
        found[part] = PARTS[part].read(part, *values)
    return SetPoint(pose, extra, **found)


_SIZED: Final = frozenset(row.name for row in PARAMETERS if row.form in (FieldType.BYTES, FieldType.WINDOW))
_OPTIONAL: Final = attrgetter(*PARTS)
_NOTHING: Final = (None,) * len(PARTS)


@lru_cache(maxsize=64)
def _parts_of_set_point(send: int, window_bits: int) -> tuple[str, ...]:
    """Return the names of the parts that the formats require after the pose, in the order of table 4-2."""
    return tuple(
        row.name
        for row in PARAMETERS
        if row.send & send or (row.form is FieldType.WINDOW and row.receive & window_bits)
    )


def _split(parameter: Variant, parts: Sequence[str]) -> Sequence[Variant]:
    """Return the elements of a parameter, the pose first."""
    wanted = 1 + sum(PARTS[part].span for part in parts)
    given: Sequence[Variant] = [parameter]  # the pose is the only part; it may be a VARIANT array of numbers
    if parameter.type == VARIANT_ARRAY and parameter.value:
        begins_with_array = parameter.value[0].type & ARRAY
        given = parameter.value if begins_with_array or len(parameter.value) == wanted > 1 else given
    if len(given) != wanted and parameter.type & ARRAY:
        names = ", ".join(map(called, ("pose", *parts)))
        raise invalid(
            tr(
                "slvMove has {count} elements, the current formats require {wanted}: {names}",
                count=len(given),
                wanted=wanted,
                names=names,
            ),
        )
    return given  # if the parameter is not an array, read_numbers refuses it


def _not_as_formats(part: str, is_required: bool) -> InvalidValue:
    name = called(part)
    if is_required:
        return InvalidValue(tr("{name}: required by the current formats", name=name))
    return InvalidValue(tr("{name}: not included in the current formats", name=name))


def _unknown(what: str, number: int, known: Iterable[int]) -> CallError:
    shown, names = hexadecimal(number), ", ".join(map(hexadecimal, known))
    return invalid(tr("{what} {number} does not exist; valid values: {known}", what=what, number=shown, known=names))
