"""What slvMove answers (RC8 table 4-3): where the arm is at that moment, and what else its client has asked for."""

from __future__ import annotations

from typing import Final

from orinkit.rc8.slave_formats import Receive, ReceiveFormat, SlaveAnswer, UserWindow, build_answer
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import state_report
from orinkit.virtual.rc8.robot.arm import Arm
from orinkit.virtual.rc8.robot.slave_mode import io
from orinkit.virtual.rc8.variables.table import Variables

_MILLI: Final = 1_000
_MICRO: Final = 1_000_000
_LARGEST_TIME: Final = 0x7FFF_FFFF  # then it begins at 0 again: µs after 36 minutes


def answer_of(arm: Arm, variables: Variables, receive: ReceiveFormat, window: UserWindow | None) -> Variant:
    """Return the answer in a client's format; poses are those of the encoders, as CurPos, CurJnt and CurTrn.

    Args:
        arm: the arm.
        variables: of the controller, for its I/O.
        receive: the format.
        window: the user I/O that was asked for.
    """
    here, kinds = state_report.current(arm), receive.kinds
    return build_answer(
        receive,
        SlaveAnswer(
            joints=tuple(here.angles()) if "J" in kinds else None,
            position=tuple(here.position()) if "P" in kinds else None,
            trans=tuple(here.trans()) if "T" in kinds else None,
            timestamp=_timestamp(arm, receive) if receive.has(Receive.TIME) else None,
            mini=io.mini(variables) if receive.has(Receive.MINI) else None,
            hand=io.hand(variables) if receive.has(Receive.HAND) else None,
            user=io.user(variables, window) if window is not None else None,
            current=_currents(arm) if receive.has(Receive.CURRENT) else None,
        ),
    )


def _timestamp(arm: Arm, receive: ReceiveFormat) -> int:
    """Return when the last cycle was, since power-on."""
    return round(arm.seconds() * (_MICRO if receive.microseconds else _MILLI)) & _LARGEST_TIME


def _currents(arm: Arm) -> tuple[float, ...]:
    return tuple(state_report.eight(arm.servo.sample(arm.motor.on).current))
