"""Three programs in PacScript to start with; the header of each says what it does and what it leaves."""

from __future__ import annotations

from importlib.resources import files
from typing import Final

NAMES: Final = ("Pro1.pcs", "Pro2.pcs", "Pro3.pcs")
"""Their file names."""


def sample_programs() -> dict[str, str]:
    """Return the text of each by its file name."""
    folder = files(__name__)
    return {name: folder.joinpath(name).read_text(encoding="utf-8") for name in NAMES}
