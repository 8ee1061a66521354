"""Variables on disk: one SQLite file in the state directory, one row per variable that was ever written.

A write is committed before it is answered, so an answered write survives the end of the process, however sudden (not
the loss of power: the file is not flushed to the medium on every write). The process that has the file open has it
alone; another one is refused. A file that is not ours, empty, or damaged, is refused and left as it is. A new one comes into
being whole, under its name, so an empty one has lost what it held.

If the file is deleted under the running process, writes are refused. As soon as its directory is there again, the next write
makes a new file of everything that was written so far.
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
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import OrinError, error_for
from orinkit.core.i18n import tr

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
_NEW: Final = (".variables-", ".new")  # around the name of a file that is being made
_OWN_FILE: Final = 0o600
_OWN_DIRECTORY: Final = 0o700


class StateError(OrinError):
    """The state directory cannot be used: in use, damaged, not ours, or not writable; the message names the file."""


@dataclass(frozen=True, slots=True)
class StoredVariable:
    """One variable as it is kept.

    Attributes:
        kind: name of its class; each I/O point is one of class IO.
        index: its index.
        value: bool, int, float, str, or the numbers of an array.
        written: controller's local date and time of the write.
    """

    kind: str
    index: int
    value: Any
    written: datetime


class VariableDatabase:
    """The open file.

    Args:
        directory: state directory; made if it does not exist.

    Raises:
        StateError: it cannot be used.
    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / FILE_NAME
        self._lost = False
        try:
            directory.mkdir(mode=_OWN_DIRECTORY, parents=True, exist_ok=True)
            _warn_of_others(directory)
            self._connection = _open(self.path)
            self._identity = _identity(self.path)
        except (OSError, sqlite3.Error) as error:
            raise _refused(self.path, error) from error

    def rows(self) -> list[StoredVariable]:
        """Return every row.

        Raises:
            StateError: a row cannot be read.
        """
        try:
            found = self._connection.execute("SELECT class, number, value, written FROM variable").fetchall()
        except sqlite3.Error as error:
            raise _refused(self.path, error) from error
        return [self._row(*columns) for columns in found]

    def save(self, kind: str, values: Mapping[int, object], written: datetime) -> None:
        """Write the values of some variables of one class, by index, all or none; when this returns they are kept.

        Raises:
            CallError: E_FAIL, nothing was written; also as long as the file is gone.
        """
        self._find_again()
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
            logger.error("%s: %s", self.path, error)  # noqa: TRY400 - the reason is all there is to tell
            raise self._not_written(error) from error

    def _find_again(self) -> None:
        """See to it that the file is still the one under its name; make it again where only its directory is left.

        Raises:
            CallError: E_FAIL, it is gone, or another one.
        """
        found = _identity(self.path)
        if found == self._identity:
            if self._lost:
                self._lost = False
                logger.warning("%s is there again", self.path)
            return
        reason: object = tr("another file has taken its place")
        if found is None:
            reason = tr("{parent} has no such file any more", parent=self.path.parent)
            if self.path.parent.is_dir():
                try:
                    self._make_again()
                except (OSError, sqlite3.Error) as error:
                    reason = error
                else:
                    self._lost = False
                    logger.warning("%s was gone; it was written again with all variables", self.path)
                    return
        if not self._lost:
            self._lost = True
            logger.error(
                "%s: %s. Variables cannot be written until it is there again, or its directory, empty",
                self.path,
                reason,
            )
        raise self._not_written(reason)

    def _make_again(self) -> None:
        _make(self.path, self._connection)
        again = _open(self.path)
        with suppress(sqlite3.Error):
            self._connection.close()
        self._connection = again
        self._identity = _identity(self.path)

    def _not_written(self, reason: object) -> OrinError:
        return error_for(hresult.E_FAIL, tr("not written to {path}: {reason}", path=self.path, reason=reason))

    def close(self) -> None:
        """Close the file and let others have it; closing twice is no error."""
        self._connection.close()

    def damaged(self, kind: str, index: int, reason: object) -> StateError:
        """Return the exception for a row whose value cannot be that of its variable."""
        return StateError(
            tr(
                "{path}: the stored value of {kind}{index} cannot be read ({reason}). The file was left "
                "as it is; repair it or move it away",
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


class _NotOurs(sqlite3.DatabaseError):
    """A good SQLite file that another program has written, or a newer version of this one."""


def _open(path: Path) -> sqlite3.Connection:
    journal = path.with_name(path.name + "-wal")
    if journal.exists() and journal.stat().st_size and not (path.exists() and path.stat().st_size):
        # SQLite would take the journal for a left-over and throw it away, with every write that is only there
        raise _NotOurs(tr("it is missing or empty, but {name} beside it holds writes", name=journal.name))
    if not path.exists():
        _make(path)
    elif not path.stat().st_size:
        raise _NotOurs(tr("it is empty (0 bytes): what it held is lost, as after a power failure or a full disk"))
    for each in (path, journal):
        _keep_to_ourselves(each)
    # One thread at a time uses it, though not always the one that opened it. No waiting: who has the file keeps it.
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
    for left in path.parent.glob("*".join(_NEW)):  # by a process that was killed
        with suppress(OSError):
            left.unlink()
    return connection


def _make(path: Path, content: sqlite3.Connection | None = None) -> None:
    """Make a file, without variables or with those of another one; under its name it is there whole or not at all."""
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
        except FileExistsError:  # another process was quicker
            pass
        except OSError:  # a file system without links
            if not path.exists():
                new.replace(path)
    finally:
        with suppress(OSError):
            new.unlink()


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what tells a file from another one of its name, ``None`` where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _keep_to_ourselves(path: Path) -> None:
    """Let nobody else read or write a file."""
    with suppress(OSError):  # it belongs to somebody else, or is not there
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            path.chmod(_OWN_FILE)


def _warn_of_others(directory: Path) -> None:
    if os.name == "posix" and directory.stat().st_mode & 0o077:
        logger.warning(
            "%s can be used by others on this machine (mode %o); chmod 700 keeps it to yourself",
            directory,
            stat.S_IMODE(directory.stat().st_mode),
        )


def _check(connection: sqlite3.Connection) -> None:
    def ask(sql: str) -> Any:
        return connection.execute(sql).fetchone()[0]

    application, version = ask("PRAGMA application_id"), ask("PRAGMA user_version")
    if (application, version) == (_APPLICATION_ID, _VERSION):
        verdict = ask("PRAGMA quick_check(1)")
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)
    elif application == _APPLICATION_ID:
        raise _NotOurs(
            tr(
                "written by a newer version of orinkit (format {version}, this one reads {readable})",
                version=version,
                readable=_VERSION,
            )
        )
    else:
        raise _NotOurs(tr("a database of another program"))


def _refused(path: Path, error: Exception) -> StateError:
    if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY:
        return StateError(
            tr(
                "{path} is in use by another process; give each virtual controller a state directory of its own",
                path=path,
            )
        )
    return StateError(
        tr(
            "{path} cannot be used for the variables: {error}. It was left as it is. Try: repair it, "
            "or restore it from a backup; move it away to begin anew, without any values; or give "
            "another state directory",
            path=path,
            error=error,
        )
    )
