"""What slvMove answers (RC8 table 4-3): where the arm is at that moment, and what else its client has asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.rc8.slave_fields import POSE_MASK, POSE_PARTS, RECEIVED, SlaveField
from orinkit.rc8.slave_formats import ReceiveFormat, SlaveAnswer, UserWindow, build_answer
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.slave_mode import io
from orinkit.virtual.rc8.variables.table import VariableTable

_MILLI: Final = 1_000
_MICRO: Final = 1_000_000
_LARGEST_TIME: Final = 0x7FFF_FFFF  # then it begins at 0 again: µs after 36 minutes


class FeedbackSnapshot(NamedTuple):
    """What values of an answer are taken from.

    Attributes:
        arm: the arm.
        here: where its encoders are, as CurPos, CurJnt and CurTrn have it.
        variables: of the controller, for its I/O.
        receive: the client's format.
        window: the user I/O that was asked for.
    """

    arm: RC8Arm
    here: state_report.Source
    variables: VariableTable
    receive: ReceiveFormat
    window: UserWindow | None


def answer_of(arm: RC8Arm, variables: VariableTable, receive: ReceiveFormat, window: UserWindow | None) -> Variant:
    """Return the answer in a client's format; poses are those of the encoders, as CurPos, CurJnt and CurTrn.

    Args:
        arm: the arm.
        variables: of the controller, for its I/O.
        receive: the format.
        window: the user I/O that was asked for.
    """
    moment = FeedbackSnapshot(arm, state_report.current(arm), variables, receive, window)
    rows = _rows_of(receive.number)
    return build_answer(receive, SlaveAnswer.of({row.name: SOURCES[row.name](moment) for row in rows}))


def require_sources(receive: ReceiveFormat) -> None:
    """Check that this controller has everything that a receive format asks for.

    Raises:
        CallError: E_NOTIMPL, a field is not simulated.
    """
    for row in _rows_of(receive.number):
        if row.name not in SOURCES:
            raise error_for(hresult.E_NOTIMPL, tr(row.label))


@lru_cache(maxsize=256)
def _rows_of(number: int) -> tuple[SlaveField, ...]:
    kinds = POSE_PARTS[number & POSE_MASK]
    return tuple(row for row in RECEIVED if row.kind in kinds or row.receive & number)


def _timestamp(moment: FeedbackSnapshot) -> int:
    """Return when the last cycle was, since power-on."""
    unit = _MICRO if moment.receive.microseconds else _MILLI
    return round(moment.arm.seconds() * unit) & _LARGEST_TIME


def _user(moment: FeedbackSnapshot) -> bytes | None:
    return None if moment.window is None else io.user(moment.variables, moment.window)


def _currents(moment: FeedbackSnapshot) -> tuple[float, ...]:
    arm = moment.arm
    return tuple(state_report.eight(arm.servo.sample(arm.motor.on).current))


SOURCES: Final[dict[str, Callable[[FeedbackSnapshot], Any]]] = {
    "time": _timestamp,
    "joints": lambda moment: tuple(moment.here.angles()),
    "position": lambda moment: tuple(moment.here.position()),
    "trans": lambda moment: tuple(moment.here.trans()),
    "mini": lambda moment: io.mini(moment.variables),
    "hand": lambda moment: io.hand(moment.variables),
    "user": _user,
    "current": _currents,
}
"""Where the value of each field comes from, by the names of the table."""
