"""The extended commands of Robot_Execute that move the arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.motion_options import MotionOptions, parse_options
from orinkit.values.poses import AT_COMMAND
from orinkit.values.variant import ARRAY, Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects.motion_calls import MotionResult, begin_motions
from orinkit.virtual.rc8.robot import parameters, pose_data
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.motion_planner import ArchHeights
from orinkit.virtual.rc8.variables import conversion


def _approach(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("Approach", caller.robot.arm, caller)
    given = parameters.at_least(parameter, 3)
    length, options = pose_data.amount(given[2]), _options(given[3:])
    target = parameters.pose(given[1])
    if target.mark is not None and not (target.mark == AT_COMMAND and given[1].type & ARRAY):  # 0 also means none
        raise error_for(
            hresult.E_INVALIDARG,
            tr("{target}: the pass mark of Approach belongs to the length", target=target),
        )
    plans = caller.robot.moves.approach(
        conversion.whole(given[0]), target, length.value, length.mark, options, length.extra
    )
    return begin_motions(caller, plans, options)


def _depart(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("Depart", caller.robot.arm, caller)
    given = parameters.at_least(parameter, 2)
    length, options = pose_data.amount(given[1]), _options(given[2:])
    plans = caller.robot.moves.depart(conversion.whole(given[0]), length.value, length.mark, options, length.extra)
    return begin_motions(caller, plans, options)


def _draw(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("Draw", caller.robot.arm, caller)
    given = parameters.at_least(parameter, 2)
    vector, options = pose_data.vector(given[1]), _options(given[2:])
    return begin_motions(caller, caller.robot.moves.draw(conversion.whole(given[0]), vector, options), options)


def _drive(name: str, absolute: bool) -> Callable[[ClientContext, Variant], MotionResult]:
    def run(caller: ClientContext, parameter: Variant) -> MotionResult:
        require(name, caller.robot.arm, caller)
        axes, rest = pose_data.axis_values(parameters.at_least(parameter, 1))
        options = _options(rest)
        plans = caller.robot.moves.drive(axes.pairs, absolute, axes.mark, options, axes.extra)
        return begin_motions(caller, plans, options)

    return run


def _rotate_hand(caller: ClientContext, parameter: Variant) -> MotionResult:
    require("RotateH", caller.robot.arm, caller)
    given = parameters.at_least(parameter, 1)
    angle, options = pose_data.amount(given[0]), _options(given[1:])
    plans = caller.robot.moves.rotate_hand(angle.value, angle.mark, options, angle.extra)
    return begin_motions(caller, plans, options)


def _arch_move(caller: ClientContext, parameter: Variant) -> MotionResult:
    """ArchMove: the target, the height, and optionally the heights at which the arch starts and ends, mm."""
    require("ArchMove", caller.robot.arm, caller)
    given = parameters.at_least(parameter, 2)
    if len(given) > 4:
        raise error_for(
            hresult.E_INVALIDARG, tr("got {given} parameters, expected {wanted}", given=len(given), wanted="2..4")
        )
    heights = [conversion.double(each) for each in given[1:]] + [0.0] * (4 - len(given))
    options = MotionOptions()
    plans = caller.robot.moves.arch(parameters.pose(given[0]), ArchHeights(*heights), options)
    return begin_motions(caller, plans, options)


def _options(given: list[Variant]) -> MotionOptions:
    texts = [each.value for each in given if each.value is not None]
    for text in texts:
        if not isinstance(text, str):
            raise error_for(
                hresult.DISP_E_TYPEMISMATCH,
                tr("{text} is not an option of a motion", text=quoted(text)),
            )
    return parse_options(",".join(texts))


MOTION_COMMANDS: Final[dict[str, Callable[[ClientContext, Variant], Any]]] = {
    "Approach": _approach,
    "Depart": _depart,
    "Draw": _draw,
    "DriveEx": _drive("DriveEx", absolute=False),
    "DriveAEx": _drive("DriveAEx", absolute=True),
    "RotateH": _rotate_hand,
    "ArchMove": _arch_move,
}
"""The commands that check their conditions themselves, by name."""
