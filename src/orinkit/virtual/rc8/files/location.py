"""Files and folders on the disk, located by the name that the controller uses for them.

The functions raise the errors that :mod:`orinkit.virtual.rc8.files.store` describes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TypeAlias

from orinkit.core.record import record
from orinkit.virtual.rc8.files import disk, errors
from orinkit.virtual.rc8.files.errors import map_os_errors
from orinkit.virtual.rc8.files.names import MOST_CHARACTERS, MOST_PARTS, FileName, join

MOST_BYTES: Final = 16 * 1024 * 1024
"""Largest size of one file, bytes."""

Parts: TypeAlias = tuple[str, ...]
"""The parts of a name: folders, then the file or folder itself."""


@record
class Location:
    """The path of a name on the disk; ``status`` describes the file or folder, or is ``None`` if it does not exist."""

    name: FileName
    path: Path
    status: os.stat_result | None

    @property
    def is_folder(self) -> bool:
        """True if a folder with this name exists."""
        return self.status is not None and disk.is_folder(self.status)


def entries_below(folder: Path, parts: Parts) -> Iterator[tuple[Parts, bool]]:
    """Yield the entries of a folder and of all folders below it, sorted: the parts of a name, and True for a folder.

    ``parts`` are the parts of the name of the folder itself.
    """
    if len(parts) >= MOST_PARTS:
        return
    for name, is_folder, spelling in disk.listing(folder):
        below = (*parts, name)
        if len(join(below)) <= MOST_CHARACTERS:
            yield below, is_folder
            if is_folder:
                yield from entries_below(folder / spelling, below)


def files_below(location: Location) -> list[Parts]:
    """Return the parts of the names of all files in a folder and in the folders below it, sorted."""
    return [parts for parts, is_folder in entries_below(location.path, location.name.parts) if not is_folder]


def read(location: Location) -> bytes:
    """Return the content of a file.

    Raises:
        CallError: E_TOO_MUCH_DATA if the file is too large; otherwise as for :func:`map_os_errors`.
    """
    with map_os_errors(location.name):
        data = disk.read_file(location.path, MOST_BYTES)
    if len(data) > MOST_BYTES:
        raise errors.too_large(location.name, MOST_BYTES)
    return data


def delete_empty(location: Location) -> None:
    """Delete a folder.

    Raises:
        CallError: E_ACCESSDENIED if the folder is not empty.
    """
    with os.scandir(location.path) as entries:
        if next(entries, None) is not None:
            raise errors.not_empty(location.name)
    location.path.rmdir()


def is_within(key: Parts, folder: Parts) -> bool:
    """Return True if ``key`` is ``folder`` itself, or the name of a file or folder below it."""
    return key[: len(folder)] == folder


def check_can_be_file(location: Location) -> Location:
    """Return a location whose name may be the name of a file.

    Raises:
        CallError: E_INVALIDARG if the name can only be the name of a folder.
    """
    if location.name.folder:
        raise errors.only_a_folder(location.name)
    return location


def check_not_root(location: Location) -> None:
    """Check that a location is not the root folder.

    Raises:
        CallError: E_ACCESSDENIED if the location is the root folder.
    """
    if not location.name.parts:
        raise errors.root_stays()
