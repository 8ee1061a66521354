"""Small files of the user: :class:`JsonFile`."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

logger = logging.getLogger("orinkit.tester")

T = TypeVar("T")
_LARGEST: Final = 4_000_000  # bytes


class JsonFile:
    """A list in a JSON file, which is always written as a whole.

    A file that cannot be read is reported in the log, and not changed until something is written; its previous contents
    are then kept beside it, with the suffix ``.bak``.

    Args:
        path: Path of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._damaged = False

    def read(self, convert: Callable[[Any], list[T]]) -> list[T]:
        """Return the list; an empty one if the file does not exist or cannot be read.

        Args:
            convert: Function that returns the list for the parsed contents; its exceptions mean that they are damaged.
        """
        try:
            if self.path.stat().st_size > _LARGEST:
                raise ValueError(tr("larger than {most} bytes", most=_LARGEST))
            return convert(json.loads(self.path.read_text("utf-8")))
        except FileNotFoundError:
            return []
        except (OSError, ValueError, AttributeError, KeyError, TypeError, RecursionError, InvalidValue) as error:
            logger.warning("%s: cannot read the file: %s", self.path, error)
            self._damaged = self.path.exists()
            return []

    def write(self, rows: list[Any]) -> None:
        """Replace the file.

        Raises:
            OSError: If the file cannot be written.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self._damaged:
            self.path.replace(self.path.with_suffix(".json.bak"))
            self._damaged = False
        draft = self.path.with_suffix(f".{os.getpid()}.tmp")
        draft.write_text(json.dumps(rows, indent=2, ensure_ascii=False) + "\n", "utf-8")
        draft.replace(self.path)
