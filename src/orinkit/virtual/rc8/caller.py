"""A client as the controller sees it: its name, its address, and what it may do."""

from __future__ import annotations

from dataclasses import dataclass

from orinkit import hresult
from orinkit.errors import CallError, error_for
from orinkit.virtual.rc8.permission import Access
from orinkit.virtual.rc8.state import Origin, State


@dataclass(frozen=True, slots=True)
class Caller:
    """One client's connection to the controller; every object that it holds has it.

    Attributes:
        state: the controller.
        origin: name and address of the client, for the logs.
        access: what it may do.
    """

    state: State
    origin: Origin
    access: Access

    def require_read(self) -> None:
        """Check the right to read.

        Raises:
            CallError: NO_READ_RIGHT.
        """
        if not self.access & Access.READ:
            raise self._refused(hresult.NO_READ_RIGHT)

    def require_write(self) -> None:
        """Check the right to change anything.

        Raises:
            CallError: NO_WRITE_RIGHT.
        """
        if not self.access & Access.WRITE:
            raise self._refused(hresult.NO_WRITE_RIGHT)

    def _refused(self, code: int) -> CallError:
        return error_for(code, self.origin.address)
