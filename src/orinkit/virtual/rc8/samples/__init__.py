"""Three sample programs in PacScript; the header of each program describes its actions and its results."""

from __future__ import annotations

from importlib.resources import files
from typing import Final

NAMES: Final = ("Pro1.pcs", "Pro2.pcs", "Pro3.pcs")
"""The file names of the sample programs."""


def sample_programs() -> dict[str, str]:
    """Return the text of each sample program, by its file name."""
    folder = files(__name__)
    return {name: folder.joinpath(name).read_text(encoding="utf-8") for name in NAMES}
