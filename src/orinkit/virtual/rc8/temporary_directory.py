"""A directory for a controller that keeps nothing: removed with it, or by the next one where its process was killed."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Final

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except (
    ImportError
):  # Windows: what a killed process leaves stays until somebody clears the directory of temporary files
    _locks = False
else:
    _locks = True

_PREFIX: Final = "orinkit-rc8-"
_LOCK: Final = "lock"
_FLAGS: Final = os.O_RDWR | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
_swept: set[str] = set()  # directories of temporary files, once for each process


class TemporaryDirectory:
    """One directory. It is locked as long as its process lives, which a number of a process could not tell for sure.

    Attributes:
        path: where the controller keeps its files.
    """

    def __init__(self) -> None:
        parent = tempfile.gettempdir()
        if parent not in _swept:
            _swept.add(parent)
            sweep(Path(parent))
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
            self._lock = os.open(self.path / _LOCK, _FLAGS | os.O_CREAT, 0o600)
            if _locked(self._lock) and (self.path / _LOCK).exists():
                return
            os.close(self._lock)  # another process took it for a leftover at that very moment

    def remove(self) -> None:
        """Remove it; does nothing the second time."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def sweep(parent: Path) -> None:
    """Remove the directories of this user's processes that do not live any more."""
    if not _locks:
        return
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if entry.name.startswith(_PREFIX):
                with suppress(OSError):
                    _remove_if_left(Path(entry.path))


def _remove_if_left(path: Path) -> None:
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        return  # nor through a link that somebody else has planted
    lock = os.open(path / _LOCK, _FLAGS)
    try:
        if _locked(lock):
            shutil.rmtree(path)
    finally:
        os.close(lock)


def _locked(descriptor: int) -> bool:
    """Lock a file; False where another process has done so."""
    if _locks:
        try:
            flock(descriptor, LOCK_EX | LOCK_NB)
        except OSError:
            return False
    return True
