"""Everything that the page ABH3 shares for one connection: :class:`DriverCell`."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.abh3.drive import Drive
from orinkit.tester.state.abh3.parameters import ParameterStore
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.workspace import Workspace

_CELLS: Final[WeakKeyDictionary[DriverConnection, DriverCell]] = WeakKeyDictionary()


class DriverCell:
    """The driver of a connection.

    Attributes:
        connection: The connection.
        drive: The motors.
        parameters: The parameters that have been read.
    """

    def __init__(self, workspace: Workspace, connection: DriverConnection) -> None:
        self.connection = connection
        self.drive = Drive(connection, workspace.motions)
        self.parameters = ParameterStore(connection)

    @classmethod
    def of(cls, workspace: Workspace, connection: DriverConnection) -> DriverCell:
        """Return the cell of a connection; all pages have the same one."""
        if connection not in _CELLS:
            _CELLS[connection] = cls(workspace, connection)
        return _CELLS[connection]

    async def reset_errors(self) -> None:
        """Clear errors and warnings; the commands are then 0, and servo and start are off.

        Raises:
            InvalidValue: If a motor is driven.
            DriverFault: If errors or warnings remain.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        if self.drive.driving:
            raise InvalidValue(tr("errors cannot be reset while a motor is driven. Try: let the button go first"))
        await self.drive.disable()
        await self.connection.driver.reset_errors()

    async def write_parameter(self, address: int, text: str) -> None:
        """Write a parameter.

        Args:
            address: Address of the parameter.
            text: The new value, as the user has entered it.

        Raises:
            InvalidValue: If the value is not valid, or a motor is driven; nothing was sent.
            ParameterRefused: If the driver refuses the value.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        if self.drive.driving:
            raise InvalidValue(tr("parameters cannot be written while a motor is driven. Try: let the button go first"))
        await self.parameters.write(address, text)
