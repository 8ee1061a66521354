"""Allocation of the handles of objects."""

from __future__ import annotations

from collections.abc import Container
from typing import Final

_FIRST_HANDLE: Final = 2  # as in the samples of the documents (RC8 3.1.2); 1 is the service itself
_LAST_HANDLE: Final = 0x7FFF_FFFF


class HandleAllocator:
    """Allocates handles from 2 to 2,147,483,647, then from 2 again; several sessions may share it."""

    def __init__(self) -> None:
        self._next = _FIRST_HANDLE

    def take(self, used: Container[int]) -> int:
        """Return the next unused handle."""
        while self._next in used:
            self._next = _following(self._next)
        number = self._next
        self._next = _following(number)
        return number


def _following(handle: int) -> int:
    return handle + 1 if handle < _LAST_HANDLE else _FIRST_HANDLE
