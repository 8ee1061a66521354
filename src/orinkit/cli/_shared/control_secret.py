"""How the secret of a control port gets from ``orinkit serve rc8`` to ``orinkit pendant``: in a file that only its owner can read.

By default it is named after the port and lies in the account's runtime directory, so that commands of the same account
find it by themselves.
"""

from __future__ import annotations

import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from orinkit.cao.shared_secret import check_secret
from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.files import is_private, read
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.transport.address import Address

OPTION: Final = "--control-secret-file"
_LONGEST: Final = 4096  # bytes of a file


def read_secret(path: str) -> str:
    """Return the secret that a file holds.

    Raises:
        Failure: the file cannot be read, is not that of this account alone, or holds no secret.
    """
    text = read(OPTION, path)[:_LONGEST].decode("utf-8", "replace").strip()
    if not is_private(path):
        raise CommandError(
            tr("{option} {path}: others can read or change the file. Try: chmod 600 {path}", option=OPTION, path=path),
            2,
        )
    try:
        return check_secret(text)
    except InvalidValue as error:
        raise CommandError(f"{OPTION} {path}: {error}", 2) from None


def find_secret(address: Address) -> str:
    """Return the secret that a server of this account has left for a control port; ``""`` where there is none.

    It is not for other machines, so nothing is found for their addresses.
    """
    for directory in _candidates():
        path = directory / _name(address.port)
        if _is_ours(directory) and path.is_file() and is_private(path):
            with suppress(OSError, ValueError):
                return path.read_text(encoding="ascii").strip()[:_LONGEST]
    return ""


@contextmanager
def left_for(secret: str, port: int, path: str | None = None) -> Iterator[None]:
    """Leave a secret for commands of this account; the file is removed at the end.

    Args:
        secret: of the control port.
        port: of the control port, which tells the file's name.
        path: of another file, that must not be there yet.

    Raises:
        Failure: the file cannot be written.
    """
    file = _runtime_directory() / _name(port) if path is None else Path(path)
    try:
        if path is None:
            _replace(file, secret)
        else:
            _write(file, secret)
    except (OSError, ValueError) as error:
        raise _cannot(str(file), str(error)) from None
    try:
        yield
    finally:
        with suppress(OSError, ValueError):
            if file.read_text(encoding="ascii").strip() == secret:  # another server may have left its own meanwhile
                file.unlink()


def _name(port: int) -> str:
    return f"control-{port}"


def _candidates() -> list[Path]:
    """Return the directories in which a secret may lie, the one to be preferred first."""
    given = os.environ.get("XDG_RUNTIME_DIR", "")
    account = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    own = Path(tempfile.gettempdir()) / f"orinkit-{account}"
    base = Path(given)
    return [base / "orinkit", own] if base.is_absolute() and _is_ours(base) else [own]


def _runtime_directory() -> Path:
    """Return a directory that nobody else can look into.

    Raises:
        Failure: there is none, and none can be made.
    """
    directory = _candidates()[0]
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise _cannot(str(directory), str(error)) from None
    if not _is_ours(directory):
        raise _cannot(
            str(directory),
            tr("it is not a directory of this account alone (mode 0700)"),
        )
    return directory


def _cannot(path: str, reason: str) -> CommandError:
    return CommandError(
        tr(
            "the secret of the control port cannot be kept in {path}: {reason}. Try: {option} FILE, "
            "in a directory of yours",
            path=path,
            reason=reason,
            option=OPTION,
        )
    )


def _is_ours(directory: Path) -> bool:
    """Whether it is a directory, not a link to one, that only this account can look into."""
    try:
        found = directory.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and is_private(directory)


def _replace(file: Path, secret: str) -> None:
    """Write a file in the place of one that a server has left that is gone: the port is this server's now."""
    beside = file.with_name(f".{file.name}-{secrets.token_hex(8)}")
    try:
        _write(beside, secret)
        beside.replace(file)
    finally:
        beside.unlink(missing_ok=True)


def _write(file: Path, secret: str) -> None:
    number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o600)
    with os.fdopen(number, "w", encoding="ascii") as stream:
        stream.write(f"{secret}\n")
