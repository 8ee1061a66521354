"""Reading lines from a terminal with completion and a history file, with the module readline if it exists."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Final, Self

LONGEST_HISTORY: Final = 1000  # lines
_FILE_MODE: Final = 0o600
_DELIMITERS: Final = " \t\n"


def history_file() -> Path:
    """Return the path of the history file, in the state directory of the XDG base directory specification."""
    given = os.environ.get("XDG_STATE_HOME", "")
    base = Path(given) if given.startswith("/") else Path.home() / ".local" / "state"
    return base / "orinkit" / "shell_history"


class LineEditor:
    """Reads lines; while it is open, readline completes words and stores the history.

    Args:
        complete: Function that returns the candidates for the last word of a line.
        path: History file; only its owner can read it.
    """

    def __init__(self, complete: Callable[[str], Iterable[str]], path: Path) -> None:
        self._complete = complete
        self._path = path
        self._readline = _readline()
        self._candidates: list[str] = []

    def __enter__(self) -> Self:
        if self._readline is not None:
            self._readline.set_completer_delims(_DELIMITERS)
            self._readline.set_completer(self._next_candidate)
            libedit = "libedit" in (self._readline.__doc__ or "")
            self._readline.parse_and_bind("bind ^I rl_complete" if libedit else "tab: complete")
            self._readline.set_history_length(LONGEST_HISTORY)
            with suppress(OSError):
                self._readline.read_history_file(self._path)
        return self

    def __exit__(self, *_: object) -> None:
        if self._readline is not None:
            self._readline.set_completer(None)
            with suppress(OSError):  # the session does not fail because of its history
                self._save(self._readline)

    def read(self, prompt: str) -> str:
        """Return the next line.

        Raises:
            EOFError: At the end of the input (Ctrl-D).
            KeyboardInterrupt: After Ctrl-C.
        """
        return input(prompt)

    def _save(self, readline: ModuleType) -> None:
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.close(os.open(self._path, os.O_WRONLY | os.O_CREAT, _FILE_MODE))
        self._path.chmod(_FILE_MODE)
        before = os.umask(0o077)  # readline may replace the file
        try:
            readline.write_history_file(self._path)
        finally:
            os.umask(before)

    def _next_candidate(self, word: str, state: int) -> str | None:
        """Return a candidate; readline calls this function with 0, 1, 2 ... until it returns ``None``."""
        if state == 0:
            assert self._readline is not None
            line = self._readline.get_line_buffer()[: self._readline.get_endidx()]
            found = sorted({each for each in self._complete(line) if each.lower().startswith(word.lower())})
            self._candidates = [f"{each} " for each in found]
        return self._candidates[state] if state < len(self._candidates) else None


def _readline() -> ModuleType | None:
    try:
        import readline
    except ImportError:  # Windows
        return None
    return readline
