"""Disk access of the file store: one file or folder at a time, without following links.

Callers pass only paths whose parent folders they have checked. Symbolic links, devices and pipes are never opened. An
error of the operating system is raised as ``OSError``.
"""

from __future__ import annotations

import os
import secrets
import stat
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from orinkit.virtual.rc8.files.names import TEMPORARY_PREFIX, name_on_disk, part_key

_ALWAYS: Final = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
_READ: Final = _ALWAYS | os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)  # opening a pipe must not block
_CREATE: Final = _ALWAYS | os.O_WRONLY | os.O_CREAT | os.O_EXCL
_MODE: Final = 0o600
_JUNCTION: Final = 0xA0000003  # reparse tag of a junction: a link of Windows that has the attribute of a directory
_EARLIEST: Final = datetime(1980, 1, 1)
_LATEST: Final = datetime(2099, 12, 31, 23, 59, 59)
_SECOND: Final = 1_000_000_000


def status_of(path: Path) -> os.stat_result | None:
    """Return the status of a path without following a link; ``None`` if the path does not exist."""
    try:
        return os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def is_folder(status: os.stat_result) -> bool:
    """Return True if a status describes a folder."""
    return stat.S_ISDIR(status.st_mode) and getattr(status, "st_reparse_tag", 0) != _JUNCTION


def is_file(status: os.stat_result) -> bool:
    """Return True if a status describes an ordinary file."""
    return stat.S_ISREG(status.st_mode)


def spelling(folder: Path, part: str) -> str:
    """Return the name, as spelled on the disk, of the entry of a folder that differs from ``part`` at most in case.

    If there is no such entry, or an entry is spelled exactly like ``part``, return ``part``. If several
    entries differ from it only in case, return the first of them in sorted order.
    """
    if status_of(folder / part) is not None:
        return part
    key = part_key(part)
    with os.scandir(folder) as entries:
        return min((entry.name for entry in entries if part_key(entry.name) == key), default=part)


def listing(folder: Path) -> list[tuple[str, bool, str]]:
    """Return the files and folders in a folder, sorted by name.

    Links, special files, and entries whose names are not valid on the controller are omitted. Each entry is a tuple:
    its name on the controller, True if it is a folder, and its name on the disk.
    """
    found: dict[str, tuple[str, bool, str]] = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            name = name_on_disk(entry.name)
            folderish = _is_folder_entry(entry)
            if name is not None and (folderish or entry.is_file(follow_symlinks=False)) and name not in found:
                found[name] = (name, folderish, entry.name)
    return sorted(found.values(), key=lambda each: (part_key(each[0]), each[0]))


def usage(root: Path, *, clean: bool = False) -> tuple[int, int]:
    """Return the number of entries in a folder and all folders below, and the size of all files, bytes.

    Temporary files do not count; with ``clean``, they are removed.
    """
    count, size, folders = 0, 0, [root]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if _is_folder_entry(entry):
                    folders.append(Path(entry.path))
                elif entry.name.startswith(TEMPORARY_PREFIX):
                    if clean:
                        Path(entry.path).unlink()
                    continue
                elif entry.is_file(follow_symlinks=False):
                    size += entry.stat(follow_symlinks=False).st_size
                count += 1
    return count, size


def read_file(path: Path, most: int) -> bytes:
    """Return the content of a file; if it is larger than ``most`` bytes, its first ``most + 1`` bytes.

    Raises:
        FileNotFoundError: If the path does not exist, or is not an ordinary file.
    """
    with os.fdopen(os.open(path, _READ), "rb") as file:
        if not is_file(os.fstat(file.fileno())):
            raise FileNotFoundError(path)
        return file.read(most + 1)


def write_temporary(folder: Path, data: bytes) -> Path:
    """Write a new temporary file in a folder and return its path; :func:`put_in_place` renames it."""
    temporary = folder / f"{TEMPORARY_PREFIX}{secrets.token_hex(8)}"
    try:
        with os.fdopen(os.open(temporary, _CREATE, _MODE), "wb") as file:
            file.write(data)
    except BaseException:
        discard(temporary)
        raise
    return temporary


def put_in_place(temporary: Path, path: Path, moment: datetime) -> None:
    """Set the dates of a temporary file to ``moment`` and rename the file to ``path``.

    An existing file at ``path`` is replaced atomically: a reader finds either the old file or the new one.
    """
    try:
        stamp(temporary, moment)
        temporary.replace(path)
    except BaseException:
        discard(temporary)
        raise


def discard(temporary: Path) -> None:
    """Delete a temporary file if it still exists."""
    with suppress(OSError):
        temporary.unlink()


def stamp(path: Path, accessed: datetime, modified_ns: int | None = None) -> None:
    """Set the access and modification times of a file or folder; the modification time defaults to the access time."""
    ns = round(accessed.timestamp() * 1_000_000) * 1000
    times = (ns, ns if modified_ns is None else modified_ns)
    if os.utime in os.supports_follow_symlinks:
        os.utime(path, ns=times, follow_symlinks=False)
    else:
        os.utime(path, ns=times)


def moment_of(ns: int) -> datetime:
    """Convert a time of the file system (ns) to local time, limited to the controller's years (1980 to 2099)."""
    seconds, rest = divmod(ns, _SECOND)
    try:
        moment = datetime.fromtimestamp(seconds).replace(microsecond=rest // 1000)
    except (OverflowError, ValueError, OSError):
        return _LATEST if ns > 0 else _EARLIEST
    return min(max(moment, _EARLIEST), _LATEST)


def born_ns(status: os.stat_result) -> int:
    """Return the creation time of a file or folder, in ns.

    If the system does not record the creation time, or the creation time is later than the modification time, return
    the modification time.
    """
    born = getattr(status, "st_birthtime", None)
    return status.st_mtime_ns if born is None else min(status.st_mtime_ns, int(born * _SECOND))


def _is_folder_entry(entry: os.DirEntry[str]) -> bool:
    return entry.is_dir(follow_symlinks=False) and is_folder(entry.stat(follow_symlinks=False))
