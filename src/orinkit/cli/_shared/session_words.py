"""Words that complete the lines of an interactive session."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from orinkit.cao.functions import FUNCTIONS
from orinkit.cli._shared.session import Session
from orinkit.core.errors import OrinError

_USER_VARIABLES: Final = ("I0", "F0", "D0", "V0", "P0", "J0", "T0", "S0", "IO128")
_OWNERS: Final = {
    "--robot": "robot_names",
    "--task": "task_names",
    "--file": "file_names",
    "--extension": "extension_names",
}
_OPTIONS: Final = ("--robot", "--task", "--file", "--extension", "--json")


class SessionWords:
    """Returns the candidates for the last word of a line.

    Args:
        session: The session; names are requested from its controller once.
        commands: Names of the commands of the session.
    """

    def __init__(self, session: Session, commands: Sequence[str]) -> None:
        self._session = session
        self._commands = commands
        self._known: dict[str, list[str]] = {}

    def __call__(self, line: str) -> Iterable[str]:
        """Return the candidates; other words than those that begin like the last word may be among them."""
        words = line.split(" ")
        before, last = [word for word in words[:-1] if word], words[-1]
        if not before:
            return self._commands
        if last.startswith("-"):
            return _OPTIONS
        if before[-1] in _OWNERS:
            return self._names(_OWNERS[before[-1]])
        return self._arguments(before)

    def forget(self) -> None:
        """Forget all names; the controller may have changed."""
        self._known.clear()

    def _arguments(self, before: list[str]) -> Iterable[str]:
        first = len([word for word in before if not word.startswith("-")]) == 1
        match before[0]:
            case "get" | "put" if first:
                return [*self._names("variable_names"), *_USER_VARIABLES]
            case "call" if first:
                return [entry.name for entry in FUNCTIONS.values()]
            case "functions" if first:
                return [entry.name for entry in FUNCTIONS.values()]
            case "call" if before[-1].endswith("_Execute"):
                return self._names("command_names")
            case "execute" if first:
                return self._names("command_names")
            case "trace":
                return ("on", "off")
            case "help" if first:
                return self._commands
        return ()

    def _names(self, method: str) -> list[str]:
        """Return names from the controller; none if it does not report them."""
        if method not in self._known and self._session.connected:
            try:
                self._known[method] = list(getattr(self._session.controller, method)())
            except OrinError:
                self._known[method] = []
        return self._known.get(method, [])
