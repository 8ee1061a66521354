"""Protection of the terminal: control characters in texts from a controller are shown as visible escapes.

If stdout or stderr is a terminal, :func:`screened` replaces it by a :class:`Screen`, through which commands print.
Pipes and files receive every character unchanged.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, TextIO, cast

from orinkit.core.i18n import visible

_LAID_OUT: Final = "\n\t"  # control characters that keep their effect
_KEY: Final = os.urandom(8).hex()  # random, so that no received text can contain the markers below
_BOLD: Final = f"<{_KEY}"
_PLAIN: Final = f"{_KEY}>"


class Screen(io.TextIOBase):
    """A terminal that shows control characters as escapes.

    Args:
        terminal: The stream to write to.

    Attributes:
        rich_proxied_file: The terminal itself. The package rich writes to it directly, because rich moves the cursor.
    """

    def __init__(self, terminal: TextIO) -> None:
        self.rich_proxied_file = terminal

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a plain attribute in the stubs
        """The encoding of the terminal."""
        return self.rich_proxied_file.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]  # likewise
        """The error handler of the terminal for characters that its encoding lacks."""
        return self.rich_proxied_file.errors

    def writable(self) -> bool:
        """Return True: the terminal can be written to."""
        return True

    def isatty(self) -> bool:
        """Return True, because this is a terminal."""
        return True

    def fileno(self) -> int:
        """Return the file descriptor of the terminal."""
        return self.rich_proxied_file.fileno()

    def flush(self) -> None:
        """Flush the terminal."""
        self.rich_proxied_file.flush()

    def write(self, text: str) -> int:
        """Write a text; control characters other than line ends and tabs are shown as escapes."""
        shown = visible(text, _LAID_OUT)
        if _KEY in shown:
            shown = shown.replace(_BOLD, "\x1b[1m").replace(_PLAIN, "\x1b[0m")
        self.rich_proxied_file.write(shown)
        return len(text)


@contextmanager
def screened() -> Iterator[None]:
    """Print to terminals through a :class:`Screen` while the ``with`` statement lasts."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_screen, before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _screen(stream: TextIO) -> TextIO:
    given: TextIO | None = stream  # None if the shell has closed the stream (>&-)
    if given is None or isinstance(stream, Screen) or not stream.isatty():
        return stream
    return cast("TextIO", Screen(stream))


def bold(line: str) -> str:
    """Return a line in bold if stdout is a terminal; unchanged otherwise."""
    import os

    return f"{_BOLD}{line}{_PLAIN}" if isinstance(sys.stdout, Screen) and not os.environ.get("NO_COLOR") else line


def one_line(text: str) -> str:
    """Return a text with its line ends escaped, so that a text of two lines cannot look like two results.

    If stdout is not a terminal, the text is unchanged.
    """
    return visible(text, "\t") if isinstance(sys.stdout, Screen) else text


def json_text(written: str) -> str:
    """Return a JSON document for stdout; on a terminal, control characters are written as JSON escapes."""
    return visible(written, _LAID_OUT, json.dumps) if isinstance(sys.stdout, Screen) else written
