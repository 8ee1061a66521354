"""Read files named by options."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.i18n import tr

_LONGEST: Final = 65536  # maximum number of bytes that are read from a token file


def read(option: str, path: str) -> bytes:
    """Return the content of a file.

    Raises:
        CommandError: If the file cannot be read; the message contains the option.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise CommandError(f"{option} {path}: {error}", 2) from None


def is_private(path: str | Path) -> bool:
    """Return True if only this account can access a file or directory; always True on systems without file modes."""
    if not hasattr(os, "getuid"):
        return True
    found = Path(path).stat()
    return found.st_uid == os.getuid() and not found.st_mode & 0o077


def is_open_to_others(path: str) -> bool:
    """Return True if the mode of a file lets other accounts read or change it."""
    try:
        return hasattr(os, "getuid") and bool(Path(path).stat().st_mode & 0o077)
    except OSError:
        return False


def read_token(path: str) -> str:
    """Return the token from a file, without surrounding white space.

    Raises:
        CommandError: If the file cannot be read, or is empty.
    """
    token = read("--token-file", path)[:_LONGEST].decode("utf-8", "replace").strip()
    if not token:
        raise usage_error(tr("--token-file {path}: the file does not contain a token", path=path))
    return token
