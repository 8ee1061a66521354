"""Everything that the page Arm shares for one connection: :class:`ArmCell`."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

from orinkit.client._shared.common import clear_error_parameter, motor_state
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.arm.jogging import Jogging
from orinkit.tester.state.arm.monitor import ArmMonitor
from orinkit.tester.state.arm.move import PoseMotion
from orinkit.tester.state.arm.pendant import PendantLink
from orinkit.tester.state.arm.poses import PoseStore
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.workspace import Workspace

_CELLS: Final[WeakKeyDictionary[ControllerConnection, ArmCell]] = WeakKeyDictionary()
_STORES: Final[WeakKeyDictionary[Workspace, PoseStore]] = WeakKeyDictionary()


class ArmCell:
    """The arm of a connection.

    Attributes:
        connection: The connection.
        monitor: The state of the arm.
        jogging: Jogging.
        pendant: The pendant; ``None`` if the controller has no control port.
        poses: The stored poses of the user.
    """

    def __init__(self, workspace: Workspace, connection: ControllerConnection) -> None:
        self.connection = connection
        self.monitor = ArmMonitor(connection)
        self.jogging = Jogging(connection, self.monitor, workspace.motions)
        self.pendant = PendantLink(connection.spec) if connection.spec.control else None
        self.poses = poses_of(workspace)
        self._motions = workspace.motions

    @classmethod
    def of(cls, workspace: Workspace, connection: ControllerConnection) -> ArmCell:
        """Return the cell of a connection; all pages have the same one."""
        if connection not in _CELLS:
            _CELLS[connection] = cls(workspace, connection)
        return _CELLS[connection]

    async def switch_motor(self, on: bool) -> None:
        """Switch the motor on or off; jogging ends first.

        Raises:
            OrinError: If the controller refuses.
        """
        await self.jogging.disable()
        robot = await self.connection.robot()
        await robot.execute("Motor", motor_state(robot.client.dialect, on=on))

    async def clear_errors(self) -> None:
        """Clear the errors of the controller.

        Raises:
            OrinError: If the controller refuses.
        """
        controller = self.connection.controller
        await controller.execute("ClearError", clear_error_parameter(controller.client.dialect))

    async def set_speed(self, percent: float) -> None:
        """Set the external speed in %; jogging ends first.

        Raises:
            InvalidValue: If the speed is not above 0 and at most 100.
            OrinError: If the controller refuses.
        """
        if not 0 < percent <= 100:
            raise InvalidValue(tr("the speed must be above 0 and at most 100 %"))
        await self.jogging.disable()
        await (await self.connection.robot()).put_ext_speed(percent)

    async def move_to(self, joints: tuple[float, ...], speed: float) -> bool:
        """Move to a joint position; jogging ends first. Return False if the motion was stopped on request.

        Raises:
            OrinError: If the controller refuses or stops the motion.
        """
        if any(isinstance(each, PoseMotion) and each.connection is self.connection for each in self._motions):
            raise InvalidValue(tr("the arm is moving. Try: wait, or stop it"))
        await self.jogging.disable()
        return await PoseMotion(self.connection, self._motions).run(joints, speed)


def poses_of(workspace: Workspace) -> PoseStore:
    """Return the stored poses of the user, in the file ``poses.json`` beside the saved connections."""
    if workspace not in _STORES:
        _STORES[workspace] = PoseStore(workspace.profiles.path.with_name("poses.json"))
    return _STORES[workspace]
