"""Read files named by options."""

from __future__ import annotations

import os
import sys
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


def exposure(option: str, path: str) -> str:
    """Return a message if the mode of a file lets other accounts access it, otherwise ``""``."""
    try:
        mode = Path(path).stat().st_mode & 0o777 if hasattr(os, "getuid") else 0
    except OSError:
        return ""
    if not mode & 0o077:
        return ""
    return tr(
        "{option} {path}: other accounts can access the file (mode {mode}). Try: chmod 600 {path}",
        option=option,
        path=path,
        mode=f"{mode:o}",
    )


def warn_of_exposure(option: str, path: str) -> None:
    """Print a warning if the mode of a file with a token or a private key lets other accounts access it."""
    text = exposure(option, path)
    if text:
        print(tr("orinkit: warning: {text}", text=text), file=sys.stderr)


def contains_private_key(path: str) -> bool:
    """Return True if a PEM file contains a private key."""
    try:
        return b"PRIVATE KEY-----" in Path(path).read_bytes()
    except (OSError, ValueError):
        return False


def read_token(path: str, option: str = "--token-file") -> str:
    """Return the token from a file, without surrounding white space.

    Raises:
        CommandError: If the file cannot be read, or is empty.
    """
    token = read(option, path)[:_LONGEST].decode("utf-8", "replace").strip()
    if not token:
        raise usage_error(tr("{option} {path}: the file does not contain a token", option=option, path=path))
    return token
