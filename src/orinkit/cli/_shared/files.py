"""Files that options name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from orinkit.cli._shared.errors import CommandError, unusable
from orinkit.core.i18n import tr

_LONGEST: Final = 65536  # bytes of a token's file


def read(option: str, path: str) -> bytes:
    """Return the content of a file.

    Raises:
        Failure: it cannot be read; the message names the option.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise CommandError(f"{option} {path}: {error}", 2) from None


def is_private(path: str | Path) -> bool:
    """Whether a file or directory is this account's, and closed to all others; always where the system has no such modes."""
    if not hasattr(os, "getuid"):
        return True
    found = Path(path).stat()
    return found.st_uid == os.getuid() and not found.st_mode & 0o077


def is_open_to_others(path: str) -> bool:
    """Whether other accounts can read or change a file, as far as its mode tells."""
    try:
        return hasattr(os, "getuid") and bool(Path(path).stat().st_mode & 0o077)
    except OSError:
        return False


def read_token(path: str) -> str:
    """Return the token that a file holds, without what is blank around it.

    Raises:
        Failure: the file cannot be read, or has none.
    """
    token = read("--token-file", path)[:_LONGEST].decode("utf-8", "replace").strip()
    if not token:
        raise unusable(tr("--token-file {path}: the file has no token in it", path=path))
    return token
