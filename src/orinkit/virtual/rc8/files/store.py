"""The controller's files: programs and data, in folders below one directory of the disk.

Names follow the rules of :mod:`orinkit.virtual.rc8.files.names`. Other entries below the directory are ignored:
symbolic links, devices, and entries whose names the controller does not allow. A link is never followed, neither to
read nor to write. The directory itself may be a link.

A write is atomic: a reader, or the next start after a crash, finds either the old content or the new content. Like the
variables, the store must be used by only one process. Temporary files of an earlier process are removed at the start.

============================  ==========================================================================================
E_INVALIDARG                  the name is not valid, or not valid for this operation
FILE_NOT_FOUND                the file does not exist, or the folder that should contain it does not exist
E_CAO_COLLECTION_REGISTERED   a file or folder of this name exists already
E_ACCESSDENIED                the operation requires a file, but the name belongs to a folder; or the folder is the root
                              folder or is not empty; or the name belongs to a link or another special file
E_TOO_MUCH_DATA               the file, or the content to be written, has more than 16 MiB; or all files together would
                              have more than 256 MiB
E_MAX_OBJECT                  the store would have more than 10,000 files and folders
E_FAIL                        an error of the operating system, for example a full disk; the log has the reason
============================  ==========================================================================================
"""

from __future__ import annotations

import itertools
import logging
import os
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.rc8.files import disk, errors, location
from orinkit.virtual.rc8.files.errors import map_os_errors
from orinkit.virtual.rc8.files.location import MOST_BYTES, Location, Parts
from orinkit.virtual.rc8.files.names import (
    SEPARATOR,
    FileName,
    extension,
    join,
    name_on_disk,
    read_name,
)
from orinkit.virtual.rc8.files.usage import Usage
from orinkit.virtual.rc8.variables.database import StateError

logger = logging.getLogger("orinkit.virtual.rc8")

PROGRAM: Final = "pcs"
"""Extension of programs, in lower case."""

_ROOT: Final = FileName((), folder=True)


@record
class FileDates:
    """The dates of a file, in the controller's local time.

    Attributes:
        created: Time of creation. If the system does not record it (for example Linux), and the controller has been
            restarted since the file was created, ``created`` is the time of the last write of the content.
        accessed: Last read or write through the store.
        modified: Last write of the content.
    """

    created: datetime
    accessed: datetime
    modified: datetime


class FileStore:
    """The files of one controller. The return codes are described in this module.

    All methods are thread-safe. They access the disk, and those for a folder take long if it has many entries.
    Therefore the controller calls them in a thread (:class:`~orinkit.virtual.engine.lane.Lane`), except :meth:`has`.

    Args:
        root: Directory; created if it does not exist.
        now: Callback that returns the controller's local date and time.

    Attributes:
        root: The directory, absolute.
        changed: Callbacks invoked after a file was created, written, deleted or moved. Their arguments are the
            controller's name of the file, and True if the file exists now. After a move, they are invoked with the old
            name, then with the new name.

    Raises:
        StateError: If the directory cannot be used.
    """

    def __init__(self, root: Path, now: Callable[[], datetime]) -> None:
        self.changed: list[Callable[[str, bool], None]] = []
        self._now = now
        self._lock = threading.RLock()  # held during changes, but not while listeners are invoked
        self._created: dict[Parts, datetime] = {}
        self._numbers: dict[str, int] = {}
        self._next_number = itertools.count(1)
        try:
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.root = root.resolve()
            self._usage = Usage(self.root)
        except OSError as error:
            raise StateError(
                tr(
                    "{root} cannot be used for the files: {error}. Try: a directory that can be read and written",
                    root=root,
                    error=error,
                )
            ) from error

    # --- queries --------------------------------------------------------------------------------------------------

    def has(self, name: str) -> bool:
        """Return True if a file or folder exists and its name on the disk is spelled exactly like ``name``.

        Unlike :meth:`exists`, this method takes the same short time for any number of files.

        Raises:
            CallError: E_INVALIDARG; E_FAIL.
        """
        wanted = read_name(name)
        with map_os_errors(wanted):
            return self._locate(wanted, exact=True).status is not None

    def exists(self, name: str) -> bool:
        """Return True if a file or folder exists; a name that ends in a separator matches only a folder.

        Raises:
            CallError: E_INVALIDARG; E_FAIL.
        """
        wanted = read_name(name)
        with map_os_errors(wanted):
            return self._locate(wanted).status is not None

    def is_folder(self, name: str) -> bool:
        """Return True if a folder of that name exists.

        Raises:
            CallError: E_INVALIDARG; E_FAIL.
        """
        wanted = read_name(name)
        with map_os_errors(wanted):
            return self._locate(wanted).is_folder

    def full_name(self, name: str) -> str:
        r"""Return the path from the root folder, ``dir\Pro1.pcs``, spelled as it was created; the root folder is ``\``.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_FAIL.
        """
        return str(self._existing(read_name(name)).name)

    def names(self, folder: str = "") -> list[str]:
        r"""Return the names in a folder, sorted without regard to case; names of folders end in ``\``.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND if the folder does not exist; E_FAIL.
        """
        wanted = read_name(folder)
        place = self._existing(wanted)
        if not place.is_folder:
            raise errors.not_found(wanted)
        with map_os_errors(wanted):
            found = disk.listing(place.path)
        return [name + SEPARATOR if is_folder else name for name, is_folder, _ in found]

    def programs(self) -> list[str]:
        r"""Return the task names of all programs (``*.pcs``) in all folders: ``Pro1``, ``dir\Pro1``.

        Raises:
            CallError: E_FAIL.
        """
        with map_os_errors(_ROOT):
            names = map(join, location.files_below(Location(_ROOT, self.root, None)))
            return [name[: -len(PROGRAM) - 1] for name in names if extension(name) == PROGRAM]

    def number(self, name: str) -> int:
        """Return the number of a file or folder, counted from 1 in the order of first use; its name may not exist.

        The numbers identify programs in errors and in ``@LINE_NO``; after a restart, they are different.
        """
        key = name.lower().lstrip(SEPARATOR)
        if key not in self._numbers:
            self._numbers[key] = next(self._next_number)
        return self._numbers[key]

    def size(self, name: str) -> int:
        """Return the size of a file in bytes; 0 for a folder.

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
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_ACCESSDENIED for a folder; E_TOO_MUCH_DATA; E_FAIL.
        """
        place = self._content(read_name(name))
        assert place.status is not None
        data = location.read(place)
        with suppress(OSError):  # the access time of a read-only file may not be changeable
            disk.stamp(place.path, self._now(), place.status.st_mtime_ns)
        return data

    # --- changes --------------------------------------------------------------------------------------------------

    def write(self, name: str, data: bytes) -> None:
        """Set the content of a file; if the file does not exist, create it.

        If an exception is raised, nothing has changed.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND if its folder does not exist; E_ACCESSDENIED; E_TOO_MUCH_DATA;
                E_MAX_OBJECT; E_FAIL.
        """
        wanted = read_name(name)
        with self._changing() as changed, map_os_errors(wanted):
            place = self._locate(wanted, change=True)
            if place.is_folder:
                raise errors.no_content(wanted)
            self._put(location.check_can_be_file(place), data)
            changed[str(place.name)] = True

    def create(self, name: str) -> None:
        """Create an empty file.

        Raises:
            CallError: E_INVALIDARG; E_CAO_COLLECTION_REGISTERED; FILE_NOT_FOUND if its folder does not exist;
                E_ACCESSDENIED; E_MAX_OBJECT; E_FAIL.
        """
        with self._changing() as changed:
            place = location.check_can_be_file(self._free(read_name(name)))
            with map_os_errors(place.name):
                self._put(place, b"")
            changed[str(place.name)] = True

    def make_folder(self, name: str) -> None:
        """Create a folder in an existing folder; the name may end in a separator.

        Raises:
            CallError: E_INVALIDARG; E_CAO_COLLECTION_REGISTERED; FILE_NOT_FOUND if its folder does not exist;
                E_ACCESSDENIED; E_MAX_OBJECT; E_FAIL.
        """
        with self._changing():
            place = self._free(read_name(name))
            with map_os_errors(place.name):
                self._usage.check_room(1)
                place.path.mkdir(mode=0o700)
                self._usage.add(1)
                self._note_new(place)

    def delete(self, name: str, *, recursive: bool = False) -> None:
        """Delete a file or folder.

        Args:
            name: Name of the file or folder.
            recursive: True to delete a folder with all its content; otherwise only an empty folder can be deleted.

        Raises:
            CallError: E_INVALIDARG; FILE_NOT_FOUND; E_ACCESSDENIED for the root or a folder that is not empty; E_FAIL.
        """
        with self._changing() as changed:
            place = self._existing(read_name(name))
            location.check_not_root(place)
            with map_os_errors(place.name):
                if not place.is_folder:
                    place.path.unlink()
                    changed[str(place.name)] = False
                    self._usage.add(-1, -_size_of(place))
                elif recursive:
                    self._delete_tree(place, changed)
                else:
                    location.delete_empty(place)
                    self._usage.add(-1)
                self._stamp_folder_of(place)
            old = place.name.key
            if place.is_folder:
                self._created = {
                    key: moment for key, moment in self._created.items() if not location.is_within(key, old)
                }
            else:
                self._created.pop(old, None)

    def copy(self, name: str, new: str) -> None:
        """Copy a file to a name that does not exist; folders cannot be copied.

        Raises:
            CallError: As for :meth:`read` and :meth:`create`.
        """
        with self._changing() as changed:
            source = self._content(read_name(name))
            place = location.check_can_be_file(self._free(read_name(new)))
            content = location.read(source)
            with map_os_errors(place.name):
                self._put(place, content)
            changed[str(place.name)] = True

    def move(self, name: str, new: str) -> None:
        """Move or rename a file, or a folder with its content, to a name that does not exist; the dates are kept.

        A new name that differs from the old name only in case is allowed as well.

        Raises:
            CallError: E_INVALIDARG, also if a folder would be moved into itself; FILE_NOT_FOUND if the file, or the
                folder of the new name, does not exist; E_CAO_COLLECTION_REGISTERED; E_ACCESSDENIED; E_FAIL.
        """
        with self._changing() as changed:
            place, target = self._existing(read_name(name)), read_name(new)
            location.check_not_root(place)
            with map_os_errors(place.name):
                entries = (
                    list(location.entries_below(place.path, place.name.parts))
                    if place.is_folder
                    else [(place.name.parts, False)]
                )
            goal = self._goal(place, target)
            goal = goal if place.is_folder else location.check_can_be_file(goal)
            depth, moved = len(place.name.parts), dict[str, bool]()
            for parts, is_folder in entries:
                moved_to = join((*goal.name.parts, *parts[depth:]))
                read_name(moved_to)  # the new name may be too long or too deep
                if not is_folder:
                    moved |= {join(parts): goal.name.key == place.name.key, moved_to: True}
            with map_os_errors(goal.name):
                place.path.rename(goal.path)
            changed |= moved
            self._note_moved(place, goal)

    # --- locating -------------------------------------------------------------------------------------------------

    def _locate(self, wanted: FileName, *, change: bool = False, exact: bool = False) -> Location:
        """Return the place of a name.

        Args:
            wanted: The name.
            change: True to raise an error if no file can be changed or created there.
            exact: True to find only a name that is spelled on the disk exactly like ``wanted``.
        """
        path, status, parts = self.root, disk.status_of(self.root), list[str]()
        for part in wanted.parts:
            if status is None or not disk.is_folder(status):
                if change:
                    raise errors.not_found(FileName(tuple(parts)))
                return Location(wanted, path, None)
            path /= part if exact else disk.spelling(path, part)
            parts.append(name_on_disk(path.name) or part)
            status = disk.status_of(path)
            if status is not None and not (disk.is_folder(status) or disk.is_file(status)):
                if change:
                    raise errors.special_file(FileName(tuple(parts)))
                status = None
        name = FileName(tuple(parts), wanted.folder)
        if wanted.folder and status is not None and not disk.is_folder(status):
            if change:
                raise errors.taken(name)
            status = None
        return Location(name, path, status)

    def _existing(self, wanted: FileName) -> Location:
        with map_os_errors(wanted):
            place = self._locate(wanted)
        if place.status is None:
            raise errors.not_found(wanted)
        return place

    def _content(self, wanted: FileName) -> Location:
        place = self._existing(wanted)
        if place.is_folder:
            raise errors.no_content(wanted)
        return place

    def _free(self, wanted: FileName) -> Location:
        with map_os_errors(wanted):
            place = self._locate(wanted, change=True)
        if place.status is not None:
            raise errors.taken(wanted)
        return place

    def _goal(self, place: Location, target: FileName) -> Location:
        """Return the destination of a move: a name that does not exist, or the same name in another spelling."""
        if target.key != place.name.key:
            if place.is_folder and location.is_within(target.key, place.name.key):
                raise errors.into_itself(place.name)
            return self._free(target)
        last = target.parts[-1]
        goal = Location(FileName((*place.name.parts[:-1], last), target.folder), place.path.with_name(last), None)
        with map_os_errors(target):
            existing = disk.status_of(goal.path)
        if existing is not None and place.status is not None and not os.path.samestat(existing, place.status):
            raise errors.taken(target)
        return goal

    # --- changing -------------------------------------------------------------------------------------------------

    @contextmanager
    def _changing(self) -> Iterator[dict[str, bool]]:
        """Hold the lock; then invoke the listeners with the names that the caller has put into the mapping.

        The value of a name is True if the file exists now.
        """
        changed = dict[str, bool]()
        try:
            with self._lock:
                yield changed
        finally:  # if a folder cannot be deleted completely, some of its files may be deleted
            self._notify(changed)

    def _put(self, place: Location, data: bytes) -> None:
        if len(data) > MOST_BYTES:
            raise errors.too_large(place.name, MOST_BYTES)
        growth = len(data) - _size_of(place)
        self._usage.check_room(int(place.status is None), growth)
        if place.status is not None:
            self._created[place.name.key] = self._creation(place)
        disk.put_in_place(disk.write_temporary(place.path.parent, data), place.path, self._now())
        self._usage.add(int(place.status is None), growth)
        if place.status is None:
            self._note_new(place)

    def _delete_tree(self, place: Location, changed: dict[str, bool]) -> None:
        names = list(map(join, location.files_below(place)))
        try:
            shutil.rmtree(place.path)  # follows no link
        except BaseException:  # some of the entries may be deleted
            changed |= {name: self.has(name) for name in names}
            raise
        else:
            changed |= dict.fromkeys(names, False)
        finally:
            self._usage.count()

    def _note_new(self, place: Location) -> None:
        self._created[place.name.key] = self._now()
        self._stamp_folder_of(place)

    def _note_moved(self, place: Location, goal: Location) -> None:
        old, new = place.name.key, goal.name.key
        self._created = {
            new + key[len(old) :] if location.is_within(key, old) else key: moment
            for key, moment in self._created.items()
        }
        self._stamp_folder_of(place)
        self._stamp_folder_of(goal)

    def _stamp_folder_of(self, place: Location) -> None:
        with suppress(OSError):  # the dates of the folder are not important enough for an error
            disk.stamp(place.path.parent, self._now())

    def _creation(self, place: Location) -> datetime:
        assert place.status is not None
        known = self._created.get(place.name.key)
        return disk.moment_of(disk.born_ns(place.status)) if known is None else known

    def _notify(self, changed: Mapping[str, bool]) -> None:
        for name, exists in changed.items():
            for listener in tuple(self.changed):
                try:
                    listener(name, exists)
                except Exception:  # the file has already been changed, so the operation must not fail
                    logger.exception("%s has changed", name)


def _size_of(place: Location) -> int:
    return 0 if place.status is None or place.is_folder else place.status.st_size
