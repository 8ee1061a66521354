"""A call that may move an arm: it belongs to the motions of the workspace, and the stop button stops it."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.core.errors import CallError, ConnectionClosed, OrinError
from orinkit.core.i18n import tr
from orinkit.rc8.motion_calls import MOVING, leaves_moving
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.objects import Outcome, RemoteObject
from orinkit.tester.state.workspace import Workspace
from orinkit.transport.runner import Deadline

logger = logging.getLogger("orinkit.tester")

ABSENCE: Final = 2.0
"""Time in s without an open page of the user after which the motion of a call is stopped."""
_CHECK: Final = 0.1  # s
_END: Final = 10.0  # s for the reply to a call whose motion has been stopped, and for standstill
_RETRY: Final = 1.0  # s after which a stop that has failed is tried again
_TRIES: Final = 3
_WITH_ENCODERS: Final = 1
_ALSO_MOVING: Final = frozenset({f.extension_execute.id, f.controller_execute.id, f.robot_chuck.id, f.robot_unchuck.id})
_SUPERVISION: Final[set[asyncio.Task[None]]] = set()


class MotionCall:
    """A call in progress that may move an arm or a hand, and the motion that it leaves behind (option NEXT).

    Args:
        connection: The connection.
        task: The call.
        continues: True if the controller may reply before the end of the motion.
    """

    def __init__(self, connection: ControllerConnection, task: asyncio.Task[Outcome], *, continues: bool) -> None:
        self._connection = connection
        self._task = task
        self._continues = continues

    async def stop(self, reason: str) -> None:
        """Stop the motion with Robot_Halt; wait for the reply to the call, and for standstill.

        Raises:
            OrinError: If the arm may not have stopped.
        """
        logger.info("%s: the motion is stopped: %s", self._connection.name, reason)
        await self._connection.stop_motion()
        await asyncio.wait([self._task], timeout=_END)
        deadline = Deadline(_END)
        while not await self.is_over() and not deadline.passed:  # noqa: ASYNC110 - the controller has no event for this
            await asyncio.sleep(_CHECK)

    async def is_over(self) -> bool:
        """Return True if the call has ended, and the arm stands still."""
        if not self._task.done():
            return False
        if not self._continues or self._task.cancelled() or isinstance(self._task.exception(), CallError):
            return True
        try:
            return await (await self._connection.monitored_robot()).motion_complete(_WITH_ENCODERS)
        except (CallError, ConnectionClosed) as error:  # no motions, or the controller has stopped the arm
            logger.debug("%s: %s", self._connection.name, error)
            return True
        except (OrinError, OSError) as error:  # the arm may still move
            logger.debug("%s: %s", self._connection.name, error)
            return False

    async def ended(self, seconds: float) -> None:
        """Wait for the end of the call, at most for a time."""
        if self._task.done():
            await asyncio.sleep(seconds)
        else:
            await asyncio.wait([self._task], timeout=seconds)


async def call_function(
    workspace: Workspace,
    connection: ControllerConnection,
    user: str,
    target: RemoteObject,
    function: Function[..., Any],
    *arguments: Any,
) -> Outcome:
    """Call a function of an object for a user.

    If the function may move an arm, the call belongs to ``workspace.motions`` while it is in progress, and with the
    option NEXT until the arm stands still. If the user closes all pages meanwhile, the motion is stopped. A Robot_Halt
    during another call also stops the arm over the second connection, because a connection executes one call at a time.

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
    continues = bool(leaves_moving(function, arguments))
    motion = MotionCall(connection, task, continues=continues)
    workspace.motions.add(motion)
    if not continues:
        task.add_done_callback(lambda _: workspace.motions.discard(motion))
    guard = asyncio.create_task(_supervise(workspace, user, motion))
    _SUPERVISION.add(guard)  # even if the page ends before the call, the motion remains under supervision
    guard.add_done_callback(_SUPERVISION.discard)
    return await asyncio.shield(task)


async def _supervise(workspace: Workspace, user: str, motion: MotionCall) -> None:
    """Stop a motion if its user has had no open page for a while."""
    absent = 0.0
    try:
        while not await motion.is_over():
            await motion.ended(_CHECK)
            absent = 0.0 if workspace.controls.has_page(user) else absent + _CHECK
            if absent >= ABSENCE:
                await _stop(motion)
                return
    finally:
        workspace.motions.discard(motion)


async def _stop(motion: MotionCall) -> None:
    for _ in range(_TRIES):
        try:
            await motion.stop(tr("the user has closed all pages"))
        except (OrinError, OSError) as error:
            logger.warning("stop: %s", error)
            await asyncio.sleep(_RETRY)
        else:
            return
