"""A client as the controller sees it: its name, its address, and what it may do."""

from __future__ import annotations

from dataclasses import dataclass, field

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.virtual.engine.elastic_time import DrainInput
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.robot.slave_mode.formats import Formats
from orinkit.virtual.rc8.state import Origin, RC8State
from orinkit.virtual.rc8.switches import Switches


@dataclass(frozen=True, slots=True, eq=False)  # one is itself: it is who holds the arm
class ClientContext:
    """One client's connection to the controller; every object that it holds has it.

    Attributes:
        state: the controller.
        origin: name and address of the client, for the logs.
        access: what it may do.
        drain_input: of its connection (:class:`orinkit.cao.provider.ClientInfo`).
        formats: what its slvMove carries and is answered.
    """

    state: RC8State
    origin: Origin
    access: AccessRight
    drain_input: DrainInput | None = None
    formats: Formats = field(default_factory=Formats)

    def require_read(self) -> None:
        """Check the right to read.

        Raises:
            CallError: NO_READ_RIGHT.
        """
        if not self.access & AccessRight.READ:
            raise self._refused(hresult.NO_READ_RIGHT)

    def require_write(self) -> None:
        """Check the right to change anything.

        Raises:
            CallError: NO_WRITE_RIGHT.
        """
        if not self.access & AccessRight.WRITE:
            raise self._refused(hresult.NO_WRITE_RIGHT)

    def require_not_slave(self) -> None:
        """Check that it does not move the arm in slave mode: a client that does may do little else (RC8 4.1, note 2).

        Raises:
            CallError: REFUSED_IN_SLAVE_MODE.
        """
        if self.state.arm.slave.owner is self:
            raise self._refused(hresult.REFUSED_IN_SLAVE_MODE)

    # --- as an operator of the robot (orinkit.virtual.rc8.robot.conditions) -----------------------------------------

    @property
    def program(self) -> bool:
        """Whether it is a program of the controller: no."""
        return False

    def right(self) -> int:
        """Return the code with which a write is refused, 0 if it may write."""
        return 0 if self.access & AccessRight.WRITE else hresult.NO_WRITE_RIGHT

    def token(self, switches: Switches) -> int:
        """Return the code with which a start is refused, 0 if it has the executable token (RC8 2.1)."""
        return switches.token.refusal(self.origin.address)

    def __str__(self) -> str:
        return self.origin.caller

    def _refused(self, code: int) -> CallError:
        return error_for(code, self.origin.address)
