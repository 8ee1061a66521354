"""The connection context of a client: its name, its address, its access rights, and the robot that it addresses."""

from __future__ import annotations

from dataclasses import dataclass, field

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.virtual.engine.elastic_time import WhenInputProcessed
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.robot.slave_mode.formats import Formats
from orinkit.virtual.rc8.robot.sync_block import SyncBlock
from orinkit.virtual.rc8.robot.unit import RobotUnit
from orinkit.virtual.rc8.state import Origin, RC8State
from orinkit.virtual.rc8.switches import Switches


@dataclass(slots=True)
class ClientData:
    """Data that the contexts of one client share.

    Attributes:
        contexts: The contexts, by the number of the robot.
        sync: The motions that the client has commanded since SyncTimeStart or SyncMoveStart; otherwise None.
    """

    contexts: tuple[ClientContext, ...] = ()
    sync: SyncBlock | None = None


@dataclass(frozen=True, slots=True, eq=False)  # compared by identity, because one particular instance holds the arm
class ClientContext:
    """One client's connection to the controller, seen from one robot.

    It is shared by every object that the client holds for this robot; objects that belong to no robot have the context
    of the first robot. The context is the operator of the robot's arm: the client takes the semaphore of each arm
    separately.

    Attributes:
        state: The controller.
        robot: The robot.
        origin: Name and address of the client, for the logs.
        access: Access rights of the client.
        client: Data that the contexts of this client share.
        when_input_processed: Function that invokes a callback after all data received from the client so far has been
            processed (:class:`orinkit.cao.provider.ClientInfo`); ``None`` if data is always processed immediately.
        formats: Formats of the arguments and results of the client's slvMove calls.
    """

    state: RC8State
    robot: RobotUnit
    origin: Origin
    access: AccessRight
    client: ClientData
    when_input_processed: WhenInputProcessed | None = None
    formats: Formats = field(default_factory=Formats)

    def of_robot(self, number: int) -> ClientContext:
        """Return the context of this client for another robot."""
        return self.client.contexts[number]

    def require_read(self) -> None:
        """Raise an exception unless the client has the right to read.

        Raises:
            CallError: NO_READ_RIGHT.
        """
        if not self.access & AccessRight.READ:
            raise self._refused(hresult.NO_READ_RIGHT)

    def require_write(self) -> None:
        """Raise an exception unless the client has the right to write.

        Raises:
            CallError: NO_WRITE_RIGHT.
        """
        if not self.access & AccessRight.WRITE:
            raise self._refused(hresult.NO_WRITE_RIGHT)

    def require_not_slave(self) -> None:
        """Raise an exception if the client is in slave mode, in which few calls are allowed (RC8 4.1, note 2).

        Raises:
            CallError: REFUSED_IN_SLAVE_MODE.
        """
        if any(each.robot.arm.slave.owner is each for each in self.client.contexts):
            raise self._refused(hresult.REFUSED_IN_SLAVE_MODE)

    # --- the protocol Operator (orinkit.virtual.rc8.robot.arm_owner) --------------------------------------------------

    @property
    def program(self) -> bool:
        """Always False: a client is not a program of the controller."""
        return False

    def write_refusal(self) -> int:
        """Return 0 if the client may write, otherwise the error code with which a write is refused."""
        return 0 if self.access & AccessRight.WRITE else hresult.NO_WRITE_RIGHT

    def token_refusal(self, switches: Switches) -> int:
        """Return 0 if the client has the executable token (RC8 2.1), otherwise the error code of a refused call."""
        return switches.token.refusal(self.origin.address)

    def __str__(self) -> str:
        return self.origin.caller

    def _refused(self, code: int) -> CallError:
        return error_for(code, self.origin.address)


def open_context(
    state: RC8State, origin: Origin, access: AccessRight, when_input_processed: WhenInputProcessed | None = None
) -> ClientContext:
    """Return the context of a new client for the first robot; it knows those for the other robots."""
    client = ClientData()
    client.contexts = tuple(
        ClientContext(state, robot, origin, access, client, when_input_processed) for robot in state.robots
    )
    return client.contexts[0]
