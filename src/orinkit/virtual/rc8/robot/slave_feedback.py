"""The result of slvMove (RC8 table 4-3): the pose of the arm and the other fields that the client has selected."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.rc8.slave_fields import POSE_MASK, POSE_PARTS, RECEIVED, SlaveField
from orinkit.rc8.slave_formats import ReceiveFormat, SlaveReply, UserWindow, build_reply
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.slave_mode import io
from orinkit.virtual.rc8.variables.table import VariableTable

_MILLI: Final = 1_000
_MICRO: Final = 1_000_000
_LARGEST_TIME: Final = 0x7FFF_FFFF  # after this value the time wraps to 0: in µs, after 36 minutes


class FeedbackSources(NamedTuple):
    """The sources of the values in a result of slvMove.

    Attributes:
        arm: The arm.
        here: Pose of the arm's encoders, as returned by CurPos, CurJnt and CurTrn.
        variables: Variables of the controller, for its I/O.
        receive: The client's format of the results (slvRecvFormat).
        window: The range of user I/O that the client has requested, or ``None``.
    """

    arm: RC8Arm
    here: state_report.ArmPosition
    variables: VariableTable
    receive: ReceiveFormat
    window: UserWindow | None


def reply_of(arm: RC8Arm, variables: VariableTable, receive: ReceiveFormat, window: UserWindow | None) -> Variant:
    """Return the result of slvMove in a client's format; like CurPos, CurJnt and CurTrn, it has the encoder positions.

    Args:
        arm: The arm.
        variables: Variables of the controller, for its I/O.
        receive: The format of the result.
        window: The range of user I/O that the client has requested, or ``None``.
    """
    sources = FeedbackSources(arm, state_report.current(arm), variables, receive, window)
    rows = _rows_of(receive.number)
    return build_reply(receive, SlaveReply.of({row.name: SOURCES[row.name](sources) for row in rows}))


def require_supported(receive: ReceiveFormat) -> None:
    """Raise an exception if this controller cannot provide every field of a receive format.

    Raises:
        CallError: E_NOTIMPL if a field is not simulated.
    """
    for row in _rows_of(receive.number):
        if row.name not in SOURCES:
            raise error_for(hresult.E_NOTIMPL, tr(row.label))


@lru_cache(maxsize=256)
def _rows_of(number: int) -> tuple[SlaveField, ...]:
    kinds = POSE_PARTS[number & POSE_MASK]
    return tuple(row for row in RECEIVED if row.kind in kinds or row.receive & number)


def _timestamp(sources: FeedbackSources) -> int:
    """Return the time from power-on to the last cycle, ms or µs."""
    unit = _MICRO if sources.receive.microseconds else _MILLI
    return round(sources.arm.seconds() * unit) & _LARGEST_TIME


def _user(sources: FeedbackSources) -> bytes | None:
    return None if sources.window is None else io.user(sources.variables, sources.window)


def _currents(sources: FeedbackSources) -> tuple[float, ...]:
    arm = sources.arm
    return tuple(state_report.eight(arm.servo.sample(arm.motor.on).current))


SOURCES: Final[dict[str, Callable[[FeedbackSources], Any]]] = {
    "time": _timestamp,
    "joints": lambda sources: tuple(sources.here.angles()),
    "position": lambda sources: tuple(sources.here.position()),
    "trans": lambda sources: tuple(sources.here.trans()),
    "mini": lambda sources: io.mini(sources.variables),
    "hand": lambda sources: io.hand(sources.variables),
    "user": _user,
    "current": _currents,
}
"""The function that returns each field's value, by the field's name in :mod:`orinkit.rc8.slave_fields`."""
