"""Saved connections: :class:`ProfileStore`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.json_file import JsonFile

MAX_PROFILES: Final = 200


def default_path() -> Path:
    """Return the path of the file with the saved connections, in the user's configuration directory."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "orinkit" / "connections.json"


class ProfileStore:
    """The saved connections of a user, in a file (:class:`JsonFile`).

    Args:
        path: Path of the file.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or default_path()
        self._file = JsonFile(self.path)
        found = self._file.read(lambda rows: [ConnectionSpec.from_json(each).check() for each in rows])
        self._specs = {spec.name: spec for spec in found}

    def __iter__(self) -> Iterator[ConnectionSpec]:
        return iter(list(self._specs.values()))

    def get(self, name: str) -> ConnectionSpec | None:
        """Return the saved connection with a name, if there is one."""
        return self._specs.get(name)

    def save(self, spec: ConnectionSpec) -> None:
        """Save a connection; it replaces the one of the same name.

        Raises:
            InvalidValue: If a parameter is invalid, or too many connections are saved.
            OSError: If the file cannot be written.
        """
        specs = {**self._specs, spec.name: spec.check()}
        if len(specs) > MAX_PROFILES:
            raise InvalidValue(tr("at most {most} connections can be saved. Try: delete some", most=MAX_PROFILES))
        self._write(specs)

    def delete(self, name: str) -> None:
        """Delete a saved connection.

        Raises:
            OSError: If the file cannot be written.
        """
        self._write({key: spec for key, spec in self._specs.items() if key != name})

    def _write(self, specs: dict[str, ConnectionSpec]) -> None:
        self._file.write([spec.to_json() for spec in specs.values()])
        self._specs = specs
