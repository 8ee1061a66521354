"""A motion to a stored pose: :class:`PoseMotion`."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.values.poses import J

if TYPE_CHECKING:
    from orinkit.tester.state.workspace import ActiveMotion

_POLL: Final = 0.05  # s
_STOPPED: Final = (hresult.STOPPED_DURING_PC_MOTION, hresult.ARM_NOT_TAKEN)


class PoseMotion:
    """A point-to-point motion to a joint position. It can be stopped at any time.

    Args:
        connection: The connection.
        motions: The running motions of the workspace.

    Attributes:
        connection: The connection.
    """

    def __init__(self, connection: ControllerConnection, motions: set[ActiveMotion]) -> None:
        self.connection, self._motions = connection, motions
        self._over = asyncio.Event()
        self._stopped = False

    async def run(self, joints: tuple[float, ...], speed: float) -> bool:
        """Take the arm, move, and give the arm back; return False if the motion was stopped by :meth:`stop`.

        Args:
            joints: Joint position, deg (mm for linear axes).
            speed: Speed in %.

        Raises:
            OrinError: If the controller refuses or stops the motion.
        """
        robot = await self.connection.robot()
        self._motions.add(self)
        try:
            async with robot.arm(keep=True):
                motion = await robot.move(J(*joints), "@E", speed=speed, wait=False)
                while not await motion.get_done():  # noqa: ASYNC110 - the controller has no event for this
                    await asyncio.sleep(_POLL)
        except CallError as error:
            if not (self._stopped and error.code in _STOPPED):
                raise
        finally:
            self._motions.discard(self)
            self._over.set()
        return not self._stopped

    async def stop(self, reason: str) -> None:
        """Stop the arm within the limits; return at standstill.

        Args:
            reason: Why, for the user.
        """
        self._stopped = True
        await self.connection.stop_motion()
        await self._over.wait()
