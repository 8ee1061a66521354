"""Storage of variables: one SQLite file in the state directory, with one row for each variable that was ever written.

A write is committed before the client receives the reply, so the value survives a crash of the process. The value may
be lost in a power failure, because the file is not flushed to the medium on every write. Only one process can open the
file. A file is refused, and not changed, if it is empty or damaged, or if it is not a database of this program. An
empty file must have lost its content: a new file receives its name only after it is complete, so it is not empty.

If the file is deleted while the process runs, the next write creates a new file with all variables written so far. If
the directory was deleted too, writes are refused until it exists again. If another program truncates or overwrites the
file, all further writes are refused until the process is started again: SQLite does not notice the damage, so that the
writes would be lost.
"""

from __future__ import annotations

import json
import logging
import operator
import os
import sqlite3
import stat
import tempfile
from collections.abc import Mapping
from contextlib import closing, suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import OrinError, error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record

logger = logging.getLogger("orinkit.virtual.rc8")

FILE_NAME: Final = "variables.sqlite3"
_APPLICATION_ID: Final = 0x4F524B38  # "ORK8"
_VERSION: Final = 1
_CREATE: Final = """
    CREATE TABLE variable (
        class TEXT NOT NULL, number INTEGER NOT NULL, value TEXT NOT NULL, written TEXT NOT NULL,
        PRIMARY KEY (class, number)
    ) WITHOUT ROWID
"""
_ONE_ROW: Final = "(?, ?, ?, ?)"
_NEW: Final = (".variables-", ".new")  # prefix and suffix of a file that is being created
_MAGIC: Final = b"SQLite format 3\0"
_ID_AT: Final = 68  # position of the application ID in the file
_CAN_PEEK: Final = hasattr(os, "pread")  # False on Windows, where an open file also could not be moved away
_OWN_FILE: Final = 0o600
_OWN_DIRECTORY: Final = 0o700


class StateError(OrinError):
    """The state directory cannot be used.

    It is in use by another process, damaged, not writable, or contains a database of another program. The message names
    the file.
    """


@record
class StoredVariable:
    """One stored variable.

    Attributes:
        kind: Name of the class of the variable; each I/O point is a variable of class IO.
        index: Index of the variable.
        value: bool, int, float, str, or the numbers of an array.
        written: Time of the write, in the controller's local time.
    """

    kind: str
    index: int
    value: Any
    written: datetime


class VariableDatabase:
    """The open database.

    Args:
        directory: State directory; created if it does not exist.

    Raises:
        StateError: If the directory cannot be used.
    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / FILE_NAME
        self._lost = False
        try:
            directory.mkdir(mode=_OWN_DIRECTORY, parents=True, exist_ok=True)
            _warn_of_others(directory)
            self._connection = _open(self.path)
            self._identity = _identity(self.path)
            self._watch = _Watch(self.path)
        except (OSError, sqlite3.Error) as error:
            raise _refused(self.path, error) from error

    def rows(self) -> list[StoredVariable]:
        """Return every row.

        Raises:
            StateError: If a row cannot be read.
        """
        try:
            found = self._connection.execute("SELECT class, number, value, written FROM variable").fetchall()
        except sqlite3.Error as error:
            raise _refused(self.path, error) from error
        return [self._row(*columns) for columns in found]

    def save(self, kind: str, values: Mapping[int, object], written: datetime) -> None:
        """Save values of variables of one class, by index; when the method returns, all of them are saved.

        Raises:
            CallError: E_FAIL if the values cannot be saved, for example because the state directory is missing. None of
                them is saved then.
        """
        self._ensure_file()
        stamp = written.isoformat()
        columns: list[object] = []
        for index, value in values.items():
            columns += (kind, index, json.dumps(value), stamp)
        try:
            self._connection.execute(
                f"INSERT OR REPLACE INTO variable VALUES {', '.join([_ONE_ROW] * len(values))}",  # noqa: S608 - only ?
                columns,
            )
        except sqlite3.Error as error:
            logger.error("%s: %s", self.path, error)  # noqa: TRY400 - the traceback does not help
            raise self._not_written(error) from error
        self._watch.note_size()

    def delete_from(self, kind: str, index: int) -> None:
        """Delete the values of a class from an index on.

        Raises:
            CallError: E_FAIL if the file cannot be changed.
        """
        self._ensure_file()
        try:
            self._connection.execute("DELETE FROM variable WHERE class = ? AND number >= ?", (kind, index))
        except sqlite3.Error as error:
            logger.error("%s: %s", self.path, error)  # noqa: TRY400 - the traceback does not help
            raise self._not_written(error) from error

    def _ensure_file(self) -> None:
        """Check that the open file is intact and still exists; if only its directory exists, create the file again.

        Raises:
            CallError: E_FAIL if the file is damaged, if it was replaced by another file, or if it cannot be created
                again.
        """
        if self._watch.is_damaged():
            damage = self._damage()
            if not self._lost:
                self._lost = True
                logger.error("%s: %s", self.path, damage)
            raise self._not_written(damage)
        found = _identity(self.path)
        if found == self._identity:
            if self._lost:
                self._lost = False
                logger.warning("%s is available again", self.path)
            return
        reason: object = tr("it was replaced by another file")
        if found is None:
            reason = tr("{parent} no longer contains the file", parent=self.path.parent)
            if self.path.parent.is_dir():
                try:
                    self._recreate()
                except (OSError, sqlite3.Error) as error:
                    reason = error
                else:
                    self._lost = False
                    logger.warning("%s was missing; it was written again with all variables", self.path)
                    return
        if not self._lost:
            self._lost = True
            logger.error(
                "%s: %s. Variables cannot be written until the file, or its empty directory, exists again",
                self.path,
                reason,
            )
        raise self._not_written(reason)

    def _recreate(self) -> None:
        _make(self.path, self._connection)
        connection = _open(self.path)
        with suppress(sqlite3.Error):
            self._connection.close()
        self._connection = connection
        self._identity = _identity(self.path)
        self._watch.close()
        self._watch = _Watch(self.path)

    def _damage(self) -> str:
        return tr(
            "another program has truncated or overwritten it; the values on the disk are lost. Try: stop this program, "
            "restore the file from a backup, or move it and {journal} away to start without values",
            journal=_journal_of(self.path).name,
        )

    def _not_written(self, reason: object) -> OrinError:
        return error_for(hresult.E_FAIL, tr("cannot write to {path}: {reason}", path=self.path, reason=reason))

    def close(self) -> None:
        """Close the file, so that other processes can open it; a second call has no effect."""
        self._connection.close()
        self._watch.close()

    def damaged(self, kind: str, index: int, reason: object) -> StateError:
        """Return the exception for a row whose value is not valid for its variable."""
        return StateError(
            tr(
                "{path}: the stored value of {kind}{index} cannot be read ({reason}). The file was not "
                "changed. Try: repair it or move it away",
                path=self.path,
                kind=kind,
                index=index,
                reason=reason,
            )
        )

    def _row(self, kind: str, index: int, value: str, written: str) -> StoredVariable:
        try:
            return StoredVariable(kind, operator.index(index), json.loads(value), datetime.fromisoformat(written))
        except (TypeError, ValueError, RecursionError) as error:
            raise self.damaged(kind, index, error) from error


class _Watch:
    """Detects that another program has truncated or overwritten the open file.

    SQLite holds the content in its cache, so it does not notice this. The file is opened a second time, and stays open
    until SQLite has closed it: if a process closes a file, the system releases all locks of the process on this file.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0) if _CAN_PEEK else None
        self._size = 0
        self._damaged = False
        self.note_size()

    def note_size(self) -> None:
        """Store the size of the file after a write; SQLite never makes the file smaller."""
        if self._file is not None:
            self._size = max(self._size, os.fstat(self._file.fileno()).st_size)

    def is_damaged(self) -> bool:
        """Return True if the file is smaller than before or its header has changed, now or at an earlier call."""
        if self._file is not None and not self._damaged:
            descriptor = self._file.fileno()
            head = os.pread(descriptor, _ID_AT + 4, 0)
            self._damaged = (
                os.fstat(descriptor).st_size < self._size
                or not head.startswith(_MAGIC)
                or head[_ID_AT:] != _APPLICATION_ID.to_bytes(4, "big")
            )
        return self._damaged

    def close(self) -> None:
        """Close the file, after SQLite has closed it; a second call has no effect."""
        file, self._file = self._file, None
        if file is not None:
            file.close()


class _NotOurs(sqlite3.DatabaseError):
    """A SQLite file of another program or of a newer version of this program, or a file that has lost its content."""


def _open(path: Path) -> sqlite3.Connection:
    journal = _journal_of(path)
    if journal.exists() and journal.stat().st_size and not (path.exists() and path.stat().st_size):
        # SQLite would discard the journal as a leftover, including the writes that only the journal contains.
        raise _NotOurs(
            tr(
                "it is missing or empty, but {name} contains writes that were not yet transferred to it",
                name=journal.name,
            )
        )
    if not path.exists():
        _make(path)
    elif not path.stat().st_size:
        raise _NotOurs(tr("it is empty (0 bytes); its content was lost, for example by a power failure or a full disk"))
    for each in (path, journal):
        _make_private(each)
    # The connection is used by one thread at a time, but not always by the thread that opened it. There is no time-out,
    # because another process that has opened the file keeps it open.
    connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("BEGIN EXCLUSIVE")
        _check(connection)
        connection.execute("COMMIT")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
    except BaseException:
        connection.close()
        raise
    for left in path.parent.glob("*".join(_NEW)):  # left by a killed process
        with suppress(OSError):
            left.unlink()
    return connection


def _make(path: Path, content: sqlite3.Connection | None = None) -> None:
    """Create a file without variables, or with those of ``content``; it receives its name when it is complete."""
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=_NEW[0], suffix=_NEW[1])  # mode 0600
    os.close(descriptor)
    new = Path(name)
    try:
        with closing(sqlite3.connect(new, isolation_level=None)) as connection:
            if content is not None:
                content.backup(connection)
                connection.execute("PRAGMA journal_mode = DELETE")
            else:
                connection.execute("BEGIN")
                connection.execute(_CREATE)
                connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                connection.execute(f"PRAGMA user_version = {_VERSION}")
                connection.execute("COMMIT")
        try:
            os.link(new, path)
        except FileExistsError:  # another process has created the file in the meantime
            pass
        except OSError:  # the file system has no hard links
            if not path.exists():
                new.replace(path)
    finally:
        with suppress(OSError):
            new.unlink()


def _journal_of(path: Path) -> Path:
    return path.with_name(path.name + "-wal")


def _identity(path: Path) -> tuple[int, int] | None:
    """Return the device and inode of a file, or ``None`` if it does not exist."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _make_private(path: Path) -> None:
    """Remove the access rights of other users to a file."""
    with suppress(OSError):  # the file belongs to another user, or does not exist
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            path.chmod(_OWN_FILE)


def _warn_of_others(directory: Path) -> None:
    mode = stat.S_IMODE(directory.stat().st_mode)
    if os.name == "posix" and mode & 0o077:
        logger.warning(
            tr("%s: other accounts can access the directory (mode %o). Try: chmod 700 %s"), directory, mode, directory
        )


def _check(connection: sqlite3.Connection) -> None:
    def query(sql: str) -> Any:
        return connection.execute(sql).fetchone()[0]

    application, version = query("PRAGMA application_id"), query("PRAGMA user_version")
    if (application, version) == (_APPLICATION_ID, _VERSION):
        verdict = query("PRAGMA quick_check(1)")
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)
    elif application == _APPLICATION_ID:
        raise _NotOurs(
            tr(
                "it was written by a newer version of orinkit (format {version}, supported: {readable})",
                version=version,
                readable=_VERSION,
            )
        )
    else:
        raise _NotOurs(tr("it is a database of another program"))


def _refused(path: Path, error: Exception) -> StateError:
    if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY:
        return StateError(
            tr(
                "{path} is in use by another process. Try: a separate state directory for each virtual controller",
                path=path,
            )
        )
    return StateError(
        tr(
            "{path} cannot be used for the variables: {error}. It was not changed. Try: repair it or restore it "
            "from a backup; move it away to start without values; or use another state directory",
            path=path,
            error=error,
        )
    )
