"""The starts of programs that wait until their programs have been loaded."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.record import record
from orinkit.virtual.engine.lane import LaneLimits

START_LIMITS: Final = LaneLimits(jobs=64, of_client=8, seconds=10.0)
"""Limits on the starts that wait; a program must not start long after the call."""


@record(eq=False)
class _Start:
    client: object
    program: str
    done: Deferred[Any]


class WaitingStarts:
    """The starts that have been requested, but not executed yet; a stop cancels them.

    The methods are called inside the lock of the controller, in which the programs are also started. A start whose
    Deferred is set is not executed.
    """

    def __init__(self) -> None:
        self._starts: set[_Start] = set()

    def add(self, client: object, program: str, done: Deferred[Any]) -> None:
        """Add a start.

        Args:
            client: The client.
            program: Name of the program, without suffix, in any case.
            done: Deferred that is set at the end of the start.
        """
        start = _Start(client, program.lower(), done)
        self._starts.add(start)
        done.add_done_callback(partial(self._starts.discard, start))

    def cancel(self, *, program: str | None = None, client: object = None) -> None:
        """Cancel the starts of a program or of a client, by default all starts; their calls fail with E_CANCEL."""
        wanted = None if program is None else program.lower()
        for start in list(self._starts):
            if wanted in (None, start.program) and client in (None, start.client):
                start.done.set_exception(error_for(hresult.E_CANCEL, start.program))
