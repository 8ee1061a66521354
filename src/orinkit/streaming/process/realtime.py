"""Real-time scheduling and memory locking for the streaming process."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from typing import Final

from orinkit.core.i18n import tr
from orinkit.core.public_name import public

PRIORITY: Final = 80
"""Requested priority with SCHED_FIFO (from 1 to 99): above ordinary programs, below the kernel's own threads."""

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_PR_SET_TIMERSLACK: Final = 29
_SHORTEST_SLACK: Final = 1  # ns


@public("orinkit")
@dataclass(frozen=True, slots=True)
class RealTime:
    """The real-time properties that the operating system granted.

    Attributes:
        priority: Priority with SCHED_FIFO; 0 if the system did not permit it.
        locked: True if the memory of the process is locked, so that it is never swapped to disk.
    """

    priority: int = 0
    locked: bool = False

    def __str__(self) -> str:
        if self.priority:
            first = tr("real-time priority {priority}", priority=self.priority)
        else:
            first = tr(
                "ordinary priority (SCHED_FIFO is not permitted; set rtprio in "
                "/etc/security/limits.conf, or CAP_SYS_NICE)"
            )
        second = (
            tr("memory locked") if self.locked else tr("memory not locked (set memlock in /etc/security/limits.conf)")
        )
        return tr("{first}; {second}", first=first, second=second)


def obtain() -> RealTime:
    """Request real-time priority and locked memory, and return what was granted.

    Also disable the garbage collector permanently.
    """
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
        # With MCL_FUTURE, all future memory of the process is locked and counts towards the limit. If the limit were
        # reached, the process could not allocate memory any more. Therefore the flag is set only if there is no limit.
        flags = _MCL_CURRENT | _MCL_FUTURE if boundless else _MCL_CURRENT
        return bool(ctypes.CDLL(None).mlockall(flags) == 0)
    except (ImportError, OSError, AttributeError, TypeError):
        return False


def _shorten_sleeps() -> None:
    """Reduce the timer slack: the delay with which sleeps end if the priority is an ordinary one (50 us by default)."""
    if sys.platform == "linux":
        try:
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _SHORTEST_SLACK, 0, 0, 0)
        except (OSError, AttributeError):
            return
