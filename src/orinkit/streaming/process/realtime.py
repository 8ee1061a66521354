"""What a streaming process asks of the operating system, so that nothing keeps it waiting; and what it was given."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from typing import Final

from orinkit.core.i18n import tr

PRIORITY: Final = 80
"""Of SCHED_FIFO, 1 to 99: above ordinary programs, below the kernel's own threads."""

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_PR_SET_TIMERSLACK: Final = 29
_SHORTEST_SLACK: Final = 1  # ns


@dataclass(frozen=True, slots=True)
class RealTime:
    """What was obtained.

    Attributes:
        priority: of SCHED_FIFO; 0 where the system did not permit it.
        locked: whether the process's memory is locked, so that none of it has to be read back from a disk.
    """

    priority: int = 0
    locked: bool = False

    def __str__(self) -> str:
        if self.priority:
            first = tr("real-time priority {priority}", priority=self.priority)
        else:
            first = tr(
                "ordinary priority (the system does not permit SCHED_FIFO: rtprio in "
                "/etc/security/limits.conf, or CAP_SYS_NICE)"
            )
        second = tr("memory locked") if self.locked else tr("memory not locked (memlock in /etc/security/limits.conf)")
        return f"{first}; {second}"


def obtain() -> RealTime:
    """Ask for what there is, and turn the garbage collector off for good."""
    gc.collect()
    gc.freeze()
    gc.disable()
    locked = _lock_memory()
    _shorten_sleeps()
    return RealTime(_raise_priority(), locked)


def _raise_priority() -> int:
    if sys.platform != "linux":
        return 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except OSError:
        return 0
    return PRIORITY


def _lock_memory() -> bool:
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        boundless = os.geteuid() == 0 or limit == resource.RLIM_INFINITY
        # what is locked in advance counts against the limit: beyond it the process would get no memory at all
        flags = _MCL_CURRENT | _MCL_FUTURE if boundless else _MCL_CURRENT
        return bool(ctypes.CDLL(None).mlockall(flags) == 0)
    except (ImportError, OSError, AttributeError, TypeError):
        return False


def _shorten_sleeps() -> None:
    """Have sleeps end when they should, where the priority is an ordinary one: by default they are 50 us late."""
    if sys.platform == "linux":
        try:
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _SHORTEST_SLACK, 0, 0, 0)
        except (OSError, AttributeError):
            return
