"""Pass the secret of a control port from ``orinkit serve rc8`` to ``orinkit pendant`` in a file.

Only the owner of the file can read it. By default, the file is named after the port and is in the runtime directory of
the account, where commands of the same account look for it. The server locks this file, so that a later server can
remove the files of killed servers.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from orinkit.cao.shared_secret import check_secret
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.files import exposure, is_private, read
from orinkit.core import file_lock
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.transport.address import Address

OPTION: Final = "--control-secret-file"
_LONGEST: Final = 4096  # maximum number of bytes that are read from a secret file
_COMPLETE: Final = re.compile(r"control-\d+")  # name of a secret file
_INCOMPLETE: Final = re.compile(r"\.control-\d+-[0-9a-f]{16}")  # name of a secret file that is being written
_WRITING_TIME: Final = 60.0  # s after which such a file is a leftover
_FLAGS: Final = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


def read_secret(path: str) -> str:
    """Return the secret from a file.

    Raises:
        CommandError: If the file cannot be read, other accounts have access to it, or it does not contain a secret.
    """
    text = read(OPTION, path)[:_LONGEST].decode("utf-8", "replace").strip()
    if not is_private(path):
        belongs = tr(
            "{option} {path}: the file belongs to another account. Try: a file of your own", option=OPTION, path=path
        )
        raise usage_error(exposure(OPTION, path) or belongs)
    try:
        return check_secret(text)
    except InvalidValue as error:
        raise CommandError(f"{OPTION} {path}: {error}", 2) from None


def find_secret(address: Address) -> str:
    """Return the secret that a server of this account has stored for a control port; ``""`` if there is none.

    Secrets are only stored for servers on this machine.
    """
    for directory in _candidates():
        path = directory / _name(address.port)
        if _is_ours(directory) and path.is_file() and is_private(path):
            with suppress(OSError, ValueError):
                return path.read_text(encoding="ascii").strip()[:_LONGEST]
    return ""


@contextmanager
def stored_secret(secret: str, port: int, path: str | None = None) -> Iterator[None]:
    """Store a secret for commands of this account; the file is removed when the ``with`` statement ends.

    The default files of servers that were killed are removed, too.

    Args:
        secret: The secret of the control port.
        port: The port, which determines the default name of the file.
        path: File to write instead of the default file; it must not exist yet. ``None`` for the default file.

    Raises:
        CommandError: If the file cannot be written.
    """
    file = _runtime_directory() / _name(port) if path is None else Path(path)
    lock = None
    try:
        if path is None:
            _sweep(file.parent)
            lock = _replace(file, secret)
        else:
            _write(file, secret)
    except (OSError, ValueError) as error:
        raise _cannot(str(file), str(error)) from None
    try:
        yield
    finally:
        with suppress(OSError, ValueError):
            if file.read_text(encoding="ascii").strip() == secret:  # a newer server may have replaced the secret
                file.unlink()
        _close(lock)


def _name(port: int) -> str:
    return f"control-{port}"


def _candidates() -> list[Path]:
    """Return the directories in which a secret may be stored, the preferred one first."""
    given = os.environ.get("XDG_RUNTIME_DIR", "")
    account = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    own = Path(tempfile.gettempdir()) / f"orinkit-{account}"
    base = Path(given)
    return [base / "orinkit", own] if base.is_absolute() and _is_ours(base) else [own]


def _runtime_directory() -> Path:
    """Return a directory that only this account can access; create it if needed.

    Raises:
        CommandError: If the directory cannot be created, or other accounts can access it.
    """
    directory = _candidates()[0]
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise _cannot(str(directory), str(error)) from None
    if not _is_ours(directory):
        raise _cannot(
            str(directory),
            tr("it must be a directory that only this account can access (mode 0700)"),
        )
    return directory


def _cannot(path: str, reason: str) -> CommandError:
    return CommandError(
        tr(
            "cannot store the secret of the control port in {path}: {reason}. Try: {option} FILE "
            "in a directory of your own",
            path=path,
            reason=reason,
            option=OPTION,
        )
    )


def _is_ours(directory: Path) -> bool:
    """Return True if the path is a directory, not a link to one, and only this account can access it."""
    try:
        found = directory.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and is_private(directory)


def _replace(file: Path, secret: str) -> int | None:
    """Write a file atomically, and lock it; a file that an earlier server on the same port has left is replaced.

    Returns:
        The descriptor that holds the lock; ``None`` if the system has no locks.
    """
    lock = None
    beside = file.with_name(f".{file.name}-{secrets.token_hex(8)}")
    try:
        _write(beside, secret)
        if file_lock.SUPPORTED:
            lock = os.open(beside, _FLAGS)
            file_lock.try_lock(lock)
        beside.replace(file)
    except BaseException:
        _close(lock)
        raise
    finally:
        beside.unlink(missing_ok=True)
    return lock


def _close(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _write(file: Path, secret: str) -> None:
    number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o600)
    with os.fdopen(number, "w", encoding="ascii") as stream:
        stream.write(f"{secret}\n")


def _sweep(directory: Path) -> None:
    """Remove the files of servers that have ended without removing them; do nothing on Windows, which has no locks."""
    if not file_lock.SUPPORTED:
        return
    with suppress(OSError):
        for file in directory.iterdir():
            if _COMPLETE.fullmatch(file.name) or _INCOMPLETE.fullmatch(file.name):
                with suppress(OSError):
                    _remove_if_left(file)


def _remove_if_left(file: Path) -> None:
    lock = os.open(file, _FLAGS)
    try:
        found = os.fstat(lock)
        old = _COMPLETE.fullmatch(file.name) or time.time() - found.st_mtime > _WRITING_TIME
        if old and stat.S_ISREG(found.st_mode) and file_lock.try_lock(lock):
            file.unlink()
    finally:
        os.close(lock)
