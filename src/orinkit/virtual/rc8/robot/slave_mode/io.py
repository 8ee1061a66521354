"""The I/O that slvMove transfers in addition to the poses (RC8 tables 4-1 to 4-3), in the mini allocation.

A set-point sets outputs: mini I/O 16 to 31, hand I/O 64 to 71, and user I/O from the point on that the set-point
specifies. The result contains inputs as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.rc8.slave_fields import OUTPUTS, PARAMETERS, RECEIVED, FieldType
from orinkit.rc8.slave_formats import ReceiveFormat, SendBits, SetPoint, UserWindow
from orinkit.virtual.rc8.variables.table import VariableTable

_BYTE: Final = 8
_MINI: Final = (0, 32)  # first point, number of points
_MINI_OUT: Final = (16, 16)
_HAND_IN: Final = (48, 8)
_HAND_OUT: Final = (64, 8)
_OUT: Final = {"mini": _MINI_OUT, "hand": _HAND_OUT}  # keys: the names of the fields
_BACK: Final = {"mini": _MINI, "hand": _HAND_OUT}


@record
class OutputRange:
    """A range of points set by a set-point.

    Attributes:
        first: Number of the first point.
        count: Number of points.
        states: The states as bits; the lowest bit is the first point.
    """

    first: int
    count: int
    states: int


def require_sent(variables: VariableTable, send: SendBits) -> None:
    """Check that the points of a send format exist.

    The points of user I/O are not part of the format: each set-point specifies them.

    Raises:
        CallError: E_INVALIDARG if one of the points does not exist.
    """
    for row in OUTPUTS:
        if row.name in _OUT and row.send & send:
            _require(variables, *_OUT[row.name])


def require_received(variables: VariableTable, receive: ReceiveFormat) -> None:
    """Check that the points of a receive format exist.

    The points of user I/O are not part of the format; :func:`require_window` checks them.

    Raises:
        CallError: E_INVALIDARG if one of the points does not exist.
    """
    for row in RECEIVED:
        if row.name in _BACK and receive.has(row.receive):
            _require(variables, *_BACK[row.name])


def require_window(variables: VariableTable, window: UserWindow) -> None:
    """Check that the user I/O requested for the result exists.

    Raises:
        CallError: E_INVALIDARG if one of the points does not exist.
    """
    _require(variables, window.offset, window.size * _BYTE)


def outputs_of(variables: VariableTable, point: SetPoint) -> tuple[OutputRange, ...]:
    """Return the outputs of a set-point.

    Raises:
        CallError: E_INVALIDARG if one of the points does not exist.
    """
    found = []
    for row in PARAMETERS:
        value = getattr(point, row.name)
        if value is None or not row.send:
            continue
        if row.form is FieldType.BYTES:
            first, states = value
            found.append(_output(first, len(states) * _BYTE, int.from_bytes(states, "little")))
        else:
            found.append(_output(*_OUT[row.name], value))
    for each in found:
        _require(variables, each.first, each.count)
    return tuple(found)


def set_outputs(variables: VariableTable, outputs: Iterable[OutputRange]) -> None:
    """Set the outputs of a set-point."""
    for output in outputs:
        variables.set_points(output.first, output.count, output.states)


def mini(variables: VariableTable) -> int:
    """Return the mini I/O, points 0 to 31, as a VT_I4."""
    states = variables.points(*_MINI)
    return states - (1 << 32) if states >> 31 else states


def hand(variables: VariableTable) -> int:
    """Return the hand I/O: inputs 48 to 55 in the lowest byte, outputs 64 to 71 in the next byte."""
    return variables.points(*_HAND_IN) | variables.points(*_HAND_OUT) << _BYTE


def user(variables: VariableTable, window: UserWindow) -> bytes:
    """Return the requested bytes of user I/O."""
    return variables.points(window.offset, window.size * _BYTE).to_bytes(window.size, "little")


def _output(first: int, count: int, states: int) -> OutputRange:
    return OutputRange(first, count, states & (1 << count) - 1)


def _require(variables: VariableTable, first: int, count: int) -> None:
    if not 0 <= first <= variables.io_points - count:
        last, most = first + count - 1, variables.io_points - 1
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "I/O {first} to {last} does not exist; the controller has I/O 0 to {most}",
                first=first,
                last=last,
                most=most,
            ),
        )
