"""The commands of cooperative control: SyncTimeStart, SyncTimeEnd, SyncMoveStart, SyncMoveEnd.

They concern the client that sends them. The motions that this client commands between the start and the end are only
planned; at the end, the arms begin in the same cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.sync_block import SyncBlock, SyncMove, SyncTime
from orinkit.virtual.rc8.variables import conversion

_WAIT, _NEXT = 0, 1


def _sync_time_start(caller: ClientContext, _: Variant) -> None:
    _require_robots(caller)
    require("SyncTimeStart", caller.robot.arm, caller)
    _require_no_block(caller)
    caller.client.sync = SyncTime()


def _sync_move_start(caller: ClientContext, parameter: Variant) -> None:
    """SyncMoveStart: the numbers of the robots that follow this one."""
    _require_robots(caller)
    require("SyncMoveStart", caller.robot.arm, caller)
    _require_no_block(caller)
    numbers = _robots(parameters.at_least(parameter, 1))
    robots, leader = caller.state.robots, caller.robot
    for number in numbers:
        if not 0 <= number < len(robots) or number == leader.number or numbers.count(number) > 1:
            raise error_for(
                hresult.E_INVALIDARG,
                tr(
                    "robot {number} cannot follow {leader}. Try: the ID of another robot",
                    number=number,
                    leader=leader.name,
                ),
            )
    followers = [caller.of_robot(number) for number in numbers]
    caller.client.sync = SyncMove(leader, caller, [(each.robot, each) for each in followers])


def _robots(given: list[Variant]) -> list[int]:
    """Return numbers of robots from the elements of an array, or of an array that is its only element."""
    if len(given) == 1 and given[0].type & ARRAY:
        given = parameters.at_least(given[0], 1)
    return [parameters.whole(conversion.double(each)) for each in given]


def _end(block: type[SyncBlock], name: str) -> Callable[[ClientContext, Variant], Deferred[None] | None]:
    def run(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
        _require_robots(caller)
        require(f"{name}End", caller.robot.arm, caller)
        (option,) = parameters.whole_numbers(parameter, _WAIT)
        if option not in (_WAIT, _NEXT):
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE, tr("option {option} is neither 0 (wait) nor 1 (NEXT)", option=option)
            )
        sync = caller.client.sync
        if not isinstance(sync, block):
            raise _no_block(f"{name}Start")
        caller.client.sync = None
        return sync.run(wait=option == _WAIT)

    return run


def _require_robots(caller: ClientContext) -> None:
    if len(caller.state.robots) < 2:
        raise error_for(
            hresult.E_NOTIMPL,
            tr("cooperative control requires a second robot. Try: second_model= or --second-model"),
        )


def _require_no_block(caller: ClientContext) -> None:
    sync = caller.client.sync
    if sync is not None:
        raise error_for(
            hresult.E_FAIL,
            tr("the motions after {name}Start have not begun yet. Try: {name}End first", name=sync.name),
        )


def _no_block(start: str) -> CallError:
    return error_for(hresult.E_FAIL, tr("there has been no {start}. Try: {start} first", start=start))


SYNC_COMMANDS: Final[dict[str, Callable[[ClientContext, Variant], Any]]] = {
    "SyncTimeStart": _sync_time_start,
    "SyncTimeEnd": _end(SyncTime, "SyncTime"),
    "SyncMoveStart": _sync_move_start,
    "SyncMoveEnd": _end(SyncMove, "SyncMove"),
}
"""The commands, by name; they check their conditions themselves."""
