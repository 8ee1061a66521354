"""A terminal is steered by this program alone: what a controller says is shown with visible escapes.

Where stdout or stderr is a terminal, :func:`screened` puts a :class:`Screen` in its place, through which everything goes that
commands print. Pipes and files get every character as it is.
"""

from __future__ import annotations

import io
import json
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, TextIO, cast

from orinkit.core.i18n import visible

_LAID_OUT: Final = "\n\t"  # characters that stay as they are
_KEY: Final = secrets.token_hex(8)  # nobody else can write these two
_BOLD: Final = f"<{_KEY}"
_PLAIN: Final = f"{_KEY}>"


class Screen(io.TextIOBase):
    """A terminal that shows control characters as escapes.

    Args:
        terminal: what is written goes there.

    Attributes:
        rich_proxied_file: the terminal itself, which the package rich writes to: it moves the cursor.
    """

    def __init__(self, terminal: TextIO) -> None:
        self.rich_proxied_file = terminal

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a plain attribute in the stubs
        """That of the terminal."""
        return self.rich_proxied_file.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]  # likewise
        """What becomes of a character that the terminal does not have."""
        return self.rich_proxied_file.errors

    def writable(self) -> bool:
        """Say that it can be written to."""
        return True

    def isatty(self) -> bool:
        """Say that it is a terminal."""
        return True

    def fileno(self) -> int:
        """Return the terminal's descriptor."""
        return self.rich_proxied_file.fileno()

    def flush(self) -> None:
        """Write what has been kept."""
        self.rich_proxied_file.flush()

    def write(self, text: str) -> int:
        """Write a text; only line ends and tabs have their effect."""
        shown = visible(text, _LAID_OUT)
        if _KEY in shown:
            shown = shown.replace(_BOLD, "\x1b[1m").replace(_PLAIN, "\x1b[0m")
        self.rich_proxied_file.write(shown)
        return len(text)


@contextmanager
def screened() -> Iterator[None]:
    """Have all that is printed to a terminal go through a :class:`Screen`."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_screen, before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _screen(stream: TextIO) -> TextIO:
    given: TextIO | None = stream  # None where a shell was told to close it
    if given is None or isinstance(stream, Screen) or not stream.isatty():
        return stream
    return cast("TextIO", Screen(stream))


def bold(line: str) -> str:
    """Return a line in bold where a person sees it on a terminal."""
    import os

    return f"{_BOLD}{line}{_PLAIN}" if isinstance(sys.stdout, Screen) and not os.environ.get("NO_COLOR") else line


def one_line(text: str) -> str:
    """Return a text for a place where a line end would begin what looks like another answer; as it is, unless on a terminal."""
    return visible(text, "\t") if isinstance(sys.stdout, Screen) else text


def json_text(written: str) -> str:
    """Return a JSON document for stdout: on a terminal with JSON's own escapes, which mean the same."""
    return visible(written, _LAID_OUT, json.dumps) if isinstance(sys.stdout, Screen) else written
