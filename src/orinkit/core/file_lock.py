"""Locks on files that show whether the process that has created a file still runs.

A process ID would not show this reliably, because the system assigns it again. The system releases the lock when the
process ends for any reason.
"""

from __future__ import annotations

from typing import Final

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # Windows
    _locks = False
else:
    _locks = True

SUPPORTED: Final = _locks
"""False if this system has no such locks (Windows); the files of ended processes then remain."""


def try_lock(descriptor: int) -> bool:
    """Lock an open file until it is closed; return False if another process holds the lock.

    If the system has no such locks, return True.
    """
    if _locks:
        try:
            flock(descriptor, LOCK_EX | LOCK_NB)
        except OSError:
            return False
    return True
