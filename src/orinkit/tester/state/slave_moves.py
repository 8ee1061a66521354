"""The Slave Moves of all connections: :class:`SlaveMoves`."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_move import SlaveMove
from orinkit.tester.state.slave_options import SlaveMoveOptions
from orinkit.tester.state.slave_trajectory import SlaveTrajectory


class SlaveMoves:
    """The latest Slave Move of each connection.

    Args:
        add: Function that adds a running motion to the workspace.
        discard: Function that removes it at standstill.
    """

    def __init__(self, add: Callable[[SlaveMove], object], discard: Callable[[SlaveMove], object]) -> None:
        self._add = add
        self._discard = discard
        self._latest: dict[str, tuple[SlaveMove, Path]] = {}

    def get(self, connection: str) -> SlaveMove | None:
        """Return the latest Slave Move of a connection, if there is one."""
        return self._latest[connection][0] if connection in self._latest else None

    def start(
        self, connection: ControllerConnection, trajectory: SlaveTrajectory, options: SlaveMoveOptions, *,
        absent: Callable[[], str], scope: AbstractContextManager[object] | None = None,
    ) -> SlaveMove:  # fmt: skip
        """Start a Slave Move; the recordings of the one before are deleted.

        Raises:
            InvalidValue: If an option is invalid, or the previous one is still running.
        """
        latest = self.get(connection.name)
        if latest is not None and not latest.finished:
            raise InvalidValue(tr("Slave Move is running. Try: stop it first"))
        folder = Path(tempfile.mkdtemp(prefix="orinkit-slave-move-"))
        try:
            move = SlaveMove(connection, trajectory, options, absent=absent, folder=folder, scope=scope)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._delete(connection.name)
        self._latest[connection.name] = move, folder
        self._add(move)
        move.begin(lambda: self._discard(move))
        return move

    def close(self) -> None:
        """Delete all recordings."""
        for name in list(self._latest):
            self._delete(name)

    def _delete(self, connection: str) -> None:
        _, folder = self._latest.pop(connection, (None, None))
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
