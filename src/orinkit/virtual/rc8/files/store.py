"""The controller's files: programs and data, in folders below one directory of the disk.

Names are those of :mod:`orinkit.virtual.rc8.files.names`. What is below the directory and is no file or folder with such
a name is treated as not there: symbolic links, devices, names that the controller does not have. A link is never
followed, neither to read nor to write; the directory itself may be reached through one, as its owner likes.

A write is one step: whoever reads sees the old content or the new one, and so does the next start after a sudden end.
Like the variables, the store belongs to one process; half-written files that an earlier one left are removed at the
start.

============================  ==========================================================================================
E_INVALIDARG                  a name that cannot be, or not for this
FILE_NOT_FOUND                nothing there, or no folder for it
E_CAO_COLLECTION_REGISTERED   the name is taken
E_ACCESSDENIED                not with what is there: a folder has no content, is not empty, is the root; a link, a pipe
                              is in the way
E_TOO_MUCH_DATA               more than 16 MiB in a file
E_MAX_OBJECT                  more than 10,000 files and folders
E_FAIL                        the system refuses, for example because the disk is full; the log says why
============================  ==========================================================================================
"""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final, TypeAlias

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.files import disk, errors
from orinkit.virtual.rc8.files.errors import reported
from orinkit.virtual.rc8.files.names import (
    MOST_CHARACTERS,
    MOST_PARTS,
    SEPARATOR,
    FileName,
    extension,
    join,
    name_on_disk,
    read_name,
)
from orinkit.virtual.rc8.variables.database import StateError

logger = logging.getLogger("orinkit.virtual.rc8")

MOST_BYTES: Final = 16 * 1024 * 1024
"""Bytes of one file."""

MOST_ENTRIES: Final = 10_000
"""Files and folders of a store, all together."""

PROGRAM: Final = "pcs"
"""Extension of the programs that can run, in lower case."""

_Parts: TypeAlias = tuple[str, ...]
_ROOT: Final = FileName((), folder=True)


@dataclass(frozen=True, slots=True)
class FileDates:
    """When something happened to a file, controller's local time.

    Attributes:
        created: when it was created; where the system does not tell (Linux does not) and the controller has been
            restarted since, when its content was written.
        accessed: when it was read or written through the store.
        modified: when its content was written.
    """

    created: datetime
    accessed: datetime
    modified: datetime


@dataclass(frozen=True, slots=True)
class Staged:
    """Content that has been written to the disk and belongs to no file yet; see :meth:`FileStore.stage`."""

    path: Path

    def discard(self) -> None:
        """Delete it, if it has not become a file."""
        disk.discard(self.path)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a name leads; ``status`` is that of the file or folder there, ``None`` for nothing."""

    name: FileName
    path: Path
    status: os.stat_result | None

    @property
    def is_folder(self) -> bool:
        return self.status is not None and disk.is_folder(self.status)


class FileStore:
    """The files of one controller. The codes that it refuses with are those of this module.

    Args:
        root: directory; made if it does not exist.
        now: gives the controller's local date and time.

    Attributes:
        root: the directory, absolute.
        changed: each is called with the controller's name of a file that has been written, created, deleted or moved
            (its old name, then its new one), after it has happened.

    Raises:
        StateError: the directory cannot be used.
    """

    def __init__(self, root: Path, now: Callable[[], datetime]) -> None:
        self.changed: list[Callable[[str], None]] = []
        self._now = now
        self._created: dict[_Parts, datetime] = {}
        try:
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.root = root.resolve()
            self._entries = disk.survey(self.root, clean=True)
        except OSError as error:
            raise StateError(
                tr(
                    "{root} cannot be used for the files: {error}. Give a directory that can be read and written",
                    root=root,
                    error=error,
                )
            ) from error

    # --- what is there --------------------------------------------------------------------------------------------

    def exists(self, name: str) -> bool:
        """Return whether there is a file or folder of that name; only a folder if the name ends in a separator.

        Raises:
            CallError: E_INVALIDARG; E_FAIL.
        """
        wanted = read_name(name)
        with reported(wanted):
            return self._locate(wanted).status is not None

    def is_folder(self, name: str) -> bool:
        """Return whether there is a folder of that name.

        Raises:
            CallError: E_INVALIDARG; E_FAIL.
        """
        wanted = read_name(name)
        with reported(wanted):
            return self._locate(wanted).is_folder

    def path(self, name: str) -> str:
        r"""Return the whole name as it was created, ``dir\Pro1.pcs``; the root folder is ``\``.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_FAIL.
        """
        return str(self._existing(read_name(name)).name)

    def names(self, folder: str = "") -> list[str]:
        r"""Return what is in a folder, sorted without regard to case; names of folders end in ``\``.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND, no folder of that name; E_FAIL.
        """
        wanted = read_name(folder)
        place = self._existing(wanted)
        if not place.is_folder:
            raise errors.not_found(wanted)
        with reported(wanted):
            found = disk.listing(place.path)
        return [name + SEPARATOR if is_folder else name for name, is_folder, _ in found]

    def programs(self) -> list[str]:
        r"""Return all programs (``*.pcs``) in all folders as names of tasks: ``Pro1``, ``dir\Pro1``.

        Raises:
            CallError: E_FAIL.
        """
        with reported(_ROOT):
            names = map(join, _files(_Place(_ROOT, self.root, None)))
            return [name[: -len(PROGRAM) - 1] for name in names if extension(name) == PROGRAM]

    def size(self, name: str) -> int:
        """Return the bytes of a file; 0 for a folder.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_FAIL.
        """
        place = self._existing(read_name(name))
        return 0 if place.is_folder or place.status is None else place.status.st_size

    def dates(self, name: str) -> FileDates:
        """Return the dates of a file or folder.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_FAIL.
        """
        place = self._existing(read_name(name))
        assert place.status is not None
        accessed, modified = place.status.st_atime_ns, place.status.st_mtime_ns
        return FileDates(self._creation(place), disk.moment_of(accessed), disk.moment_of(modified))

    def read(self, name: str) -> bytes:
        """Return the content of a file.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_ACCESSDENIED, a folder; E_TOO_MUCH_DATA; E_FAIL.
        """
        place = self._content(read_name(name))
        assert place.status is not None
        data = _read(place)
        with suppress(OSError):  # a file that may be read but not touched
            disk.stamp(place.path, self._now(), place.status.st_mtime_ns)
        return data

    # --- changes --------------------------------------------------------------------------------------------------

    def stage(self, name: str, data: bytes) -> Staged:
        """Write the content of a file to the disk for :meth:`write` or :meth:`copy`, which then only rename it.

        Writing a large file takes long; this method may be called from any thread, without the controller's lock.

        Raises:
            CallError: E_INVALIDARG; E_TOO_MUCH_DATA; E_FAIL.
        """
        wanted = read_name(name)
        if len(data) > MOST_BYTES:
            raise errors.too_large(wanted, MOST_BYTES)
        with reported(wanted):
            return Staged(disk.write_temporary(self.root, data))

    def write(self, name: str, data: bytes | Staged) -> None:
        """Set the content of a file; it is created if it is not there. What is refused leaves all as it was.

        Args:
            name: its name.
            data: the content, or what :meth:`stage` has returned, which is used up in any case.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND, no folder for it; E_ACCESSDENIED; E_TOO_MUCH_DATA; E_MAX_OBJECT;
                E_FAIL.
        """
        with _used_up(data):
            wanted = read_name(name)
            with reported(wanted):
                place = self._locate(wanted, change=True)
                if place.is_folder:
                    raise errors.no_content(wanted)
                self._put(_for_file(place), data)
        self._tell([str(place.name)])

    def create(self, name: str) -> None:
        """Create an empty file.

        Raises:
            CallError: E_INVALIDARG; E_CAO_COLLECTION_REGISTERED; FILE_NOT_FOUND, no folder for it; E_ACCESSDENIED;
                E_MAX_OBJECT; E_FAIL.
        """
        place = _for_file(self._free(read_name(name)))
        with reported(place.name):
            self._put(place, b"")
        self._tell([str(place.name)])

    def make_folder(self, name: str) -> None:
        """Create a folder in one that exists; the name may end in a separator.

        Raises:
            CallError: E_INVALIDARG; E_CAO_COLLECTION_REGISTERED; FILE_NOT_FOUND, no folder for it; E_ACCESSDENIED;
                E_MAX_OBJECT; E_FAIL.
        """
        place = self._free(read_name(name))
        with reported(place.name):
            self._check_room()
            place.path.mkdir(mode=0o700)
            self._note_new(place)

    def delete(self, name: str, *, recursive: bool = False) -> None:
        """Delete a file or folder.

        Args:
            name: its name.
            recursive: whether a folder goes with all that is in it; else only an empty one goes.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_ACCESSDENIED, the root, a folder that is not empty; E_FAIL.
        """
        place = self._existing(read_name(name))
        _check_not_root(place)
        with reported(place.name):
            if not place.is_folder:
                place.path.unlink()
                self._entries -= 1
            elif recursive:
                self._delete_tree(place)
            else:
                _delete_empty(place)
                self._entries -= 1
            self._stamp_folder_of(place)
        if place.is_folder:
            old = place.name.key
            self._created = {key: moment for key, moment in self._created.items() if not _within(key, old)}
        else:
            self._created.pop(place.name.key, None)
            self._tell([str(place.name)])

    def copy(self, name: str, new: str, data: Staged | None = None) -> None:
        """Copy a file to a name that is free; a folder is not copied.

        Args:
            name: its name.
            new: the name of the copy.
            data: its content, if it has been staged; it is used up in any case.

        Raises:
            CallError: as :meth:`read` and :meth:`create`.
        """
        with _used_up(data):
            source = self._content(read_name(name))
            place = _for_file(self._free(read_name(new)))
            content = _read(source) if data is None else data
            with reported(place.name):
                self._put(place, content)
        self._tell([str(place.name)])

    def move(self, name: str, new: str) -> None:
        """Move or rename a file, or a folder with all that is in it, to a name that is free; the dates stay.

        The new name may be the old one in other letters of upper and lower case.

        Raises:
            CallError: E_INVALIDARG, also for a folder into itself; FILE_NOT_FOUND, it or the new folder;
                E_CAO_COLLECTION_REGISTERED; E_ACCESSDENIED; E_FAIL.
        """
        place, target = self._existing(read_name(name)), read_name(new)
        _check_not_root(place)
        with reported(place.name):
            inside = list(_below(place.path, place.name.parts)) if place.is_folder else [(place.name.parts, False)]
        goal = self._goal(place, target)
        goal = goal if place.is_folder else _for_file(goal)
        depth, moved = len(place.name.parts), list[str]()
        for parts, is_folder in inside:
            later = join((*goal.name.parts, *parts[depth:]))
            read_name(later)  # it may be too long or too deep there
            moved += [] if is_folder else [join(parts), later]
        with reported(goal.name):
            place.path.rename(goal.path)
        self._note_moved(place, goal)
        self._tell(moved)

    # --- finding --------------------------------------------------------------------------------------------------

    def _locate(self, wanted: FileName, *, change: bool = False) -> _Place:
        """Find where a name leads, part by part; with ``change``, refuse what cannot be changed or made there."""
        path, status, parts = self.root, disk.status_of(self.root), list[str]()
        for part in wanted.parts:
            if status is None or not disk.is_folder(status):
                if change:
                    raise errors.not_found(FileName(tuple(parts)))
                return _Place(wanted, path, None)
            path /= disk.spelling(path, part)
            parts.append(name_on_disk(path.name) or part)
            status = disk.status_of(path)
            if status is not None and not (disk.is_folder(status) or disk.is_file(status)):
                if change:
                    raise errors.in_the_way(FileName(tuple(parts)))
                status = None
        name = FileName(tuple(parts), wanted.folder)
        if wanted.folder and status is not None and not disk.is_folder(status):
            if change:
                raise errors.taken(name)
            status = None
        return _Place(name, path, status)

    def _existing(self, wanted: FileName) -> _Place:
        with reported(wanted):
            place = self._locate(wanted)
        if place.status is None:
            raise errors.not_found(wanted)
        return place

    def _content(self, wanted: FileName) -> _Place:
        place = self._existing(wanted)
        if place.is_folder:
            raise errors.no_content(wanted)
        return place

    def _free(self, wanted: FileName) -> _Place:
        with reported(wanted):
            place = self._locate(wanted, change=True)
        if place.status is not None:
            raise errors.taken(wanted)
        return place

    def _goal(self, place: _Place, target: FileName) -> _Place:
        """Where something moves to: a free place, or its own in another spelling."""
        if target.key != place.name.key:
            if place.is_folder and _within(target.key, place.name.key):
                raise errors.into_itself(place.name)
            return self._free(target)
        last = target.parts[-1]
        goal = _Place(FileName((*place.name.parts[:-1], last), target.folder), place.path.with_name(last), None)
        with reported(target):
            there = disk.status_of(goal.path)
        if there is not None and place.status is not None and not os.path.samestat(there, place.status):
            raise errors.taken(target)
        return goal

    # --- changing -------------------------------------------------------------------------------------------------

    def _put(self, place: _Place, data: bytes | Staged) -> None:
        if isinstance(data, bytes) and len(data) > MOST_BYTES:
            raise errors.too_large(place.name, MOST_BYTES)
        if place.status is None:
            self._check_room()
        else:
            self._created[place.name.key] = self._creation(place)
        temporary = disk.write_temporary(place.path.parent, data) if isinstance(data, bytes) else data.path
        disk.put_in_place(temporary, place.path, self._now())
        if place.status is None:
            self._note_new(place)

    def _delete_tree(self, place: _Place) -> None:
        inside = _files(place)
        try:
            shutil.rmtree(place.path)  # follows no link
        finally:  # some of it may be gone even where it fails
            self._tell(map(join, inside))
            self._entries = disk.survey(self.root)

    def _note_new(self, place: _Place) -> None:
        self._entries += 1
        self._created[place.name.key] = self._now()
        self._stamp_folder_of(place)

    def _note_moved(self, place: _Place, goal: _Place) -> None:
        old, new = place.name.key, goal.name.key
        self._created = {
            new + key[len(old) :] if _within(key, old) else key: moment for key, moment in self._created.items()
        }
        self._stamp_folder_of(place)
        self._stamp_folder_of(goal)

    def _stamp_folder_of(self, place: _Place) -> None:
        with suppress(OSError):  # its dates are not worth a refusal
            disk.stamp(place.path.parent, self._now())

    def _creation(self, place: _Place) -> datetime:
        assert place.status is not None
        known = self._created.get(place.name.key)
        return disk.moment_of(disk.born_ns(place.status)) if known is None else known

    def _check_room(self) -> None:
        if self._entries >= MOST_ENTRIES:
            self._entries = disk.survey(self.root)  # somebody may have deleted some on the disk
        if self._entries >= MOST_ENTRIES:
            raise errors.too_many(self._entries, MOST_ENTRIES)

    def _tell(self, names: Iterable[str]) -> None:
        for name in names:
            for listener in tuple(self.changed):
                try:
                    listener(name)
                except Exception:  # the file has changed all the same
                    logger.exception("%s has changed", name)


def _below(folder: Path, parts: _Parts) -> Iterator[tuple[_Parts, bool]]:
    """The parts of all that a name can reach in a folder and those below it, in order, and whether it is a folder."""
    if len(parts) >= MOST_PARTS:
        return
    for name, is_folder, spelling in disk.listing(folder):
        below = (*parts, name)
        if len(join(below)) <= MOST_CHARACTERS:
            yield below, is_folder
            if is_folder:
                yield from _below(folder / spelling, below)


def _files(place: _Place) -> list[_Parts]:
    return [parts for parts, is_folder in _below(place.path, place.name.parts) if not is_folder]


@contextmanager
def _used_up(data: bytes | Staged | None) -> Iterator[None]:
    try:
        yield
    finally:
        if isinstance(data, Staged):
            data.discard()


def _read(place: _Place) -> bytes:
    with reported(place.name):
        data = disk.read_file(place.path, MOST_BYTES)
    if len(data) > MOST_BYTES:
        raise errors.too_large(place.name, MOST_BYTES)
    return data


def _delete_empty(place: _Place) -> None:
    with os.scandir(place.path) as entries:
        if next(entries, None) is not None:
            raise errors.not_empty(place.name)
    place.path.rmdir()


def _within(key: _Parts, folder: _Parts) -> bool:
    return key[: len(folder)] == folder


def _for_file(place: _Place) -> _Place:
    if place.name.folder:
        raise errors.only_a_folder(place.name)
    return place


def _check_not_root(place: _Place) -> None:
    if not place.name.parts:
        raise errors.root_stays()
