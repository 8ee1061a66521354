"""Variables on disk: one SQLite file in the state directory, one row per variable that was ever written.

A write is committed before it is answered, so an answered write survives the end of the process, however sudden (not
the loss of power: the file is not flushed to the medium on every write). The process that has the file open has it
alone; another one is refused. A file that is not ours, or damaged, is refused and left as it is.
"""

from __future__ import annotations

import json
import logging
import operator
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from orinkit import hresult
from orinkit.errors import OrinError, error_for
from orinkit.language import pick

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


class StateError(OrinError):
    """The state directory cannot be used: in use, damaged, not ours, or not writable; the message names the file."""


@dataclass(frozen=True, slots=True)
class Row:
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


class Store:
    """The open file.

    Args:
        directory: state directory; made if it does not exist.

    Raises:
        StateError: it cannot be used.
    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / FILE_NAME
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._connection = _open(self.path)
        except (OSError, sqlite3.Error) as error:
            raise _refused(self.path, error) from error

    def rows(self) -> list[Row]:
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
            CallError: E_FAIL, nothing was written.
        """
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
            raise error_for(
                hresult.E_FAIL,
                pick(f"not written to {self.path}: {error}", f"{self.path} に書き込めません: {error}"),
            ) from error

    def close(self) -> None:
        """Close the file and let others have it; closing twice is no error."""
        self._connection.close()

    def damaged(self, kind: str, index: int, reason: object) -> StateError:
        """Return the exception for a row whose value cannot be that of its variable."""
        return StateError(
            pick(
                f"{self.path}: the stored value of {kind}{index} cannot be read ({reason}). The file was left as it is; "
                "repair it or move it away",
                f"{self.path}: {kind}{index} の保存値を読み取れません ({reason})。ファイルは変更していません。"
                "修復するか、別の場所へ移してください",
            )
        )

    def _row(self, kind: str, index: int, value: str, written: str) -> Row:
        try:
            return Row(kind, operator.index(index), json.loads(value), datetime.fromisoformat(written))
        except (TypeError, ValueError, RecursionError) as error:
            raise self.damaged(kind, index, error) from error


class _NotOurs(sqlite3.DatabaseError):
    """A good SQLite file that another program has written, or a newer version of this one."""


def _open(path: Path) -> sqlite3.Connection:
    journal = path.with_name(path.name + "-wal")
    if journal.exists() and journal.stat().st_size and not (path.exists() and path.stat().st_size):
        # SQLite would take the journal for a left-over and throw it away, with every write that is only there
        raise _NotOurs(
            pick(
                f"it is missing or empty, but {journal.name} beside it holds writes",
                f"ファイルがないか空ですが、隣の {journal.name} に書き込みが残っています",
            )
        )
    # One thread at a time uses it, though not always the one that opened it. No waiting: who has the file keeps it.
    connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("BEGIN EXCLUSIVE")
        _check_or_create(connection)
        connection.execute("COMMIT")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
    except BaseException:
        connection.close()
        raise
    return connection


def _check_or_create(connection: sqlite3.Connection) -> None:
    def ask(sql: str) -> Any:
        return connection.execute(sql).fetchone()[0]

    application, version = ask("PRAGMA application_id"), ask("PRAGMA user_version")
    if (application, version) == (_APPLICATION_ID, _VERSION):
        verdict = ask("PRAGMA quick_check(1)")
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)
    elif application == _APPLICATION_ID:
        raise _NotOurs(
            pick(
                f"written by a newer version of orinkit (format {version}, this one reads {_VERSION})",
                f"より新しい orinkit で書かれています (形式 {version}、対応は {_VERSION})",
            )
        )
    elif ask("SELECT count(*) FROM sqlite_master") or application or version:
        raise _NotOurs(pick("a database of another program", "別のプログラムのデータベースです"))
    else:
        connection.execute(_CREATE)
        connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {_VERSION}")


def _refused(path: Path, error: Exception) -> StateError:
    if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY:
        return StateError(
            pick(
                f"{path} is in use by another process; give each virtual controller a state directory of its own",
                f"{path} は別のプロセスが使用中です。仮想コントローラごとに別の状態ディレクトリを指定してください",
            )
        )
    return StateError(
        pick(
            f"{path} cannot be used for the variables: {error}. It was left as it is; repair it, move it away, or give "
            "another state directory",
            f"{path} を変数の保存に使えません: {error}。ファイルは変更していません。"
            "修復するか、別の場所へ移すか、別の状態ディレクトリを指定してください",
        )
    )
