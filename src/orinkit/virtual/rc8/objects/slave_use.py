"""Which commands a client may use on the connection on which it streams set-points."""

from __future__ import annotations

from enum import Enum

from orinkit.virtual.rc8.client_context import ClientContext


class SlaveUse(Enum):
    """Use of a command by the client that is in slave mode; every other client may use it.

    The provider guide marks the commands that are refused. The b-CAP document allows only the commands of slave mode
    (RC8 4.1, note 2).
    """

    REFUSED = "refused"
    ANSWERED = "answered, except by a strict controller"
    ALWAYS = "always answered"

    def require(self, caller: ClientContext) -> None:
        """Raise an exception if the client is in slave mode and may not use the command.

        Raises:
            CallError: REFUSED_IN_SLAVE_MODE.
        """
        strict = caller.state.switches.strict
        if self is SlaveUse.REFUSED or (self is SlaveUse.ANSWERED and strict):
            caller.require_not_slave()
