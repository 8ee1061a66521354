"""The commands of Robot_Execute and of programs about motions in progress, and the settings of their speeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8.robot import parameters, queries
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.shared_command import SharedCommand

_OWN_GROUP: Final = -1
_LAST_GROUP: Final = 31
_PERCENT: Final = 100.0
_SKIP_AS_SET: Final = {0: False, 1: False, 2: True, 3: True}
"""For each pattern of MotionSkip: True if the arm decelerates as set, False if it decelerates as fast as possible."""


def _arrive(arm: RC8Arm, operator: Operator, parameter: Variant) -> Deferred[None]:
    """Arrive: wait until the running motion has covered a share of its path, %."""
    require("Arrive", arm, operator)
    (ratio,) = parameters.numbers(parameter, None)
    if not 0 < ratio <= _PERCENT:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE, tr("the ratio {ratio:g} is not above 0 and at most 100", ratio=ratio)
        )
    return arm.when_arrived(ratio / _PERCENT)


def _motion_skip(arm: RC8Arm, operator: Operator, parameter: Variant) -> Deferred[None]:
    require("MotionSkip", arm, operator)
    group, pattern = parameters.whole_numbers(parameter, _OWN_GROUP, 0)
    _check_group(group)
    if pattern not in _SKIP_AS_SET:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("pattern {pattern} is not in 0 to 3", pattern=pattern))
    arm.skip(as_set=_SKIP_AS_SET[pattern])
    return arm.when_still()


def _motion_complete(arm: RC8Arm, _: Operator, parameter: Variant) -> bool:
    group, mode = parameters.whole_numbers(parameter, _OWN_GROUP, 0)
    _check_group(group)
    return arm.settled if parameters.flag(mode) else not arm.busy


def _check_group(group: int) -> None:
    if not _OWN_GROUP <= group <= _LAST_GROUP:
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("arm group {group} is not in -1 to 31", group=group))


def _percent(name: str, read: Callable[[RC8Arm], float]) -> SharedCommand:
    """Return a command that returns a speed, an acceleration or a deceleration, %."""
    return SharedCommand(name, lambda arm, _, __: Variant(VarType.R4, read(arm)))


def _calculation(name: str, answer: queries.Answer) -> SharedCommand:
    return SharedCommand(name, lambda arm, _, parameter: answer(arm, parameter))


PROGRESS_COMMANDS: Final = (
    SharedCommand("Arrive", _arrive, reads=False, in_slave=False),
    SharedCommand("MotionSkip", _motion_skip, reads=False, in_slave=False),
    SharedCommand("MotionComplete", _motion_complete),
    _percent("CurSpd", lambda arm: arm.speeds.path.speed),
    _percent("CurAcc", lambda arm: arm.speeds.path.accel),
    _percent("CurDec", lambda arm: arm.speeds.path.decel),
    _percent("CurJSpd", lambda arm: arm.speeds.joint.speed),
    _percent("CurJAcc", lambda arm: arm.speeds.joint.accel),
    _percent("CurJDec", lambda arm: arm.speeds.joint.decel),
    _percent("CurExtSpd", lambda arm: arm.speeds.external.speed),
    _percent("CurExtAcc", lambda arm: arm.speeds.external.accel),
    _percent("CurExtDec", lambda arm: arm.speeds.external.decel),
    *(_calculation(name, answer) for name, answer in queries.CALCULATIONS.items()),
)
