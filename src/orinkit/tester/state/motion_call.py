"""A call that may move an arm: it belongs to the motions of the workspace, and the stop button stops it."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.rc8.motion_calls import MOVING
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.objects import Outcome, RemoteObject
from orinkit.tester.state.workspace import Workspace

logger = logging.getLogger("orinkit.tester")

ABSENCE: Final = 2.0
"""Time in s without an open page of the user after which the motion of a call is stopped."""
_CHECK: Final = 0.1  # s
_END: Final = 10.0  # s for the reply to a call whose motion has been stopped
_ALSO_MOVING: Final = frozenset({f.extension_execute.id, f.controller_execute.id, f.robot_chuck.id, f.robot_unchuck.id})


class MotionCall:
    """A call in progress that may move an arm or a hand.

    Args:
        connection: The connection.
        task: The call.
    """

    def __init__(self, connection: ControllerConnection, task: asyncio.Task[Outcome]) -> None:
        self._connection = connection
        self._task = task

    async def stop(self, reason: str) -> None:
        """Stop the motion with Robot_Halt, and wait for the reply to the call.

        Raises:
            OrinError: If the arm may not have stopped.
        """
        logger.info("%s: the motion is stopped: %s", self._connection.name, reason)
        await self._connection.stop_motion()
        await asyncio.wait([self._task], timeout=_END)


async def call_function(
    workspace: Workspace,
    connection: ControllerConnection,
    user: str,
    target: RemoteObject,
    function: Function[..., Any],
    *arguments: Any,
) -> Outcome:
    """Call a function of an object for a user.

    If the function may move an arm, the call belongs to ``workspace.motions`` while it is in progress. If the user
    closes all pages meanwhile, the motion is stopped. A Robot_Halt during another call also stops the arm over the
    second connection, because a connection executes one call at a time.

    Raises:
        OrinError: As for :meth:`~orinkit.tester.state.objects.ObjectRegistry.call`.
    """
    moving = [each for each in workspace.motions if isinstance(each, MotionCall)]
    if function is f.robot_halt and moving:
        await connection.stop_motion()
    call = connection.objects.call(target, function, *arguments)
    if function.id not in MOVING | _ALSO_MOVING:
        return await call
    task = asyncio.create_task(call)
    motion = MotionCall(connection, task)
    workspace.motions.add(motion)
    guard = asyncio.create_task(_stop_if_absent(workspace, user, motion))

    def end(_: object) -> None:
        guard.cancel()
        workspace.motions.discard(motion)

    task.add_done_callback(end)  # even if the page ends before the call, the motion remains under supervision
    return await asyncio.shield(task)


async def _stop_if_absent(workspace: Workspace, user: str, motion: MotionCall) -> None:
    """Stop a motion if its user has had no open page for a while."""
    absent = 0.0
    while absent < ABSENCE:
        await asyncio.sleep(_CHECK)
        absent = 0.0 if workspace.controls.has_page(user) else absent + _CHECK
    try:
        await motion.stop(tr("the user has closed all pages"))
    except (OrinError, OSError) as error:
        logger.warning("stop: %s", error)
