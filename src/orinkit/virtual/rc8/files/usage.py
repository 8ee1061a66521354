"""The limits on the file store as a whole: the number of files and folders, and the bytes of all files.

Entries and bytes are counted incrementally. Other programs may also change the files on the disk. Therefore everything
is counted again before a call is refused, and from time to time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from orinkit.virtual.rc8.files import disk, errors

MOST_ENTRIES: Final = 10_000
"""Largest number of files and folders of a store."""

MOST_STORED: Final = 256 * 1024 * 1024
"""Largest total size of the files of a store, bytes."""

_COUNTED_EVERY: Final = 64 * 1024 * 1024  # bytes; after writing so many, everything is counted again


class Usage:
    """Counts the files and folders of a store, and their bytes.

    Args:
        root: Directory of the store. Temporary files of an earlier process are removed.

    Raises:
        OSError: If a folder cannot be read.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._uncounted = 0  # bytes written since everything was counted
        self._entries, self._bytes = disk.usage(root, clean=True)

    def count(self) -> None:
        """Count everything again.

        Raises:
            OSError: If a folder cannot be read.
        """
        self._entries, self._bytes = disk.usage(self._root)
        self._uncounted = 0

    def add(self, entries: int, size: int = 0) -> None:
        """Add a change: the number of new entries and bytes, negative after deleting."""
        self._entries += entries
        self._bytes += size
        self._uncounted += max(0, size)
        if self._bytes < 0:  # another program had added files, which have been deleted or replaced now
            self._uncounted = _COUNTED_EVERY

    def check_room(self, entries: int, size: int = 0) -> None:
        """Check that there is room for new entries and for additional bytes.

        Raises:
            CallError: E_MAX_OBJECT; E_TOO_MUCH_DATA.
            OSError: If a folder cannot be read.
        """
        if self._is_full(entries, size) or (size > 0 and self._uncounted + size > _COUNTED_EVERY):
            self.count()
        if not self._is_full(entries, size):
            return
        if entries > 0 and self._entries + entries > MOST_ENTRIES:
            raise errors.too_many(self._entries, MOST_ENTRIES)
        raise errors.store_full(self._bytes + size, MOST_STORED)

    def _is_full(self, entries: int, size: int) -> bool:
        return (entries > 0 and self._entries + entries > MOST_ENTRIES) or (
            size > 0 and self._bytes + size > MOST_STORED
        )
