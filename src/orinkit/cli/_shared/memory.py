"""Return of freed memory to the operating system."""

from __future__ import annotations

import ctypes
import os
from typing import Final

_TRIM_THRESHOLD: Final = -1  # parameters of mallopt in malloc.h
_MMAP_THRESHOLD: Final = -3
_LARGE: Final = 512 * 1024  # bytes
_TOP: Final = 4 * 1024 * 1024


def return_large_blocks() -> None:
    """Make the C library return large blocks of memory to the system as soon as they are freed.

    By default, glibc does so only until the first large block is freed: after that, it keeps blocks of this size. As it
    does this separately for each of up to eight arenas per processor, a server that has sent large files would keep
    hundreds of megabytes. Other C libraries do not have this setting, and need none.
    """
    if os.name != "posix":
        return
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return
    mallopt(_MMAP_THRESHOLD, _LARGE)
    mallopt(_TRIM_THRESHOLD, _TOP)  # otherwise 128 KiB, because the first setting fixes this one, too
