"""A temporary directory for a controller without persistent state.

The directory of a killed process is removed when a later process creates a temporary directory.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Final

from orinkit.core import file_lock

_PREFIX: Final = "orinkit-rc8-"
_LOCK: Final = "lock"
_FLAGS: Final = os.O_RDWR | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
_swept: set[str] = set()  # parent directories that this process has already searched for leftovers


class TemporaryDirectory:
    """A temporary directory that is locked while its process runs (:mod:`orinkit.core.file_lock`).

    Attributes:
        path: Path of the directory.
    """

    def __init__(self) -> None:
        parent = tempfile.gettempdir()
        if parent not in _swept:
            _swept.add(parent)
            sweep(Path(parent))
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
            self._lock = os.open(self.path / _LOCK, _FLAGS | os.O_CREAT, 0o600)
            if file_lock.try_lock(self._lock) and (self.path / _LOCK).exists():
                return
            os.close(self._lock)  # another process has just removed the directory as a leftover

    def remove(self) -> None:
        """Remove the directory; a second call has no effect."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def sweep(parent: Path) -> None:
    """Remove the directories left by terminated processes of this user; do nothing on Windows, which has no locks."""
    if not file_lock.SUPPORTED:
        return
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if entry.name.startswith(_PREFIX):
                with suppress(OSError):
                    _remove_if_left(Path(entry.path))


def _remove_if_left(path: Path) -> None:
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        return  # a directory or a link of another user
    lock = os.open(path / _LOCK, _FLAGS)
    try:
        if file_lock.try_lock(lock):
            shutil.rmtree(path)
    finally:
        os.close(lock)
