"""Saved connections: :class:`ProfileStore`."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_spec import ConnectionSpec

logger = logging.getLogger("orinkit.tester")

MAX_PROFILES: Final = 200


def default_path() -> Path:
    """Return the path of the file with the saved connections, in the user's configuration directory."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "orinkit" / "connections.json"


class ProfileStore:
    """The saved connections of a user, in a JSON file.

    A file that cannot be read is reported in the log and not overwritten until a connection is saved; its previous
    contents are then kept beside it, with the suffix ``.bak``.

    Args:
        path: Path of the file.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or default_path()
        self._damaged = False
        self._specs = {spec.name: spec for spec in self._load()}

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
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self._damaged:
            self.path.replace(self.path.with_suffix(".json.bak"))
            self._damaged = False
        draft = self.path.with_suffix(f".{os.getpid()}.tmp")
        draft.write_text(
            json.dumps([spec.to_json() for spec in specs.values()], indent=2, ensure_ascii=False) + "\n", "utf-8"
        )
        draft.replace(self.path)
        self._specs = specs

    def _load(self) -> list[ConnectionSpec]:
        try:
            found = json.loads(self.path.read_text("utf-8"))
            return [ConnectionSpec.from_json(each).check() for each in found]
        except FileNotFoundError:
            return []
        except (OSError, ValueError, AttributeError, TypeError, InvalidValue) as error:
            logger.warning("%s: cannot read the saved connections: %s", self.path, error)
            self._damaged = self.path.exists()
            return []
