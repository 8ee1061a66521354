"""The pages of the documentation, and the code blocks in them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from support.paths import ROOT

SAVED = re.compile(r"<!-- saved as: (\w+\.py) -->")


@dataclass(frozen=True)
class Block:
    """A fenced code block of a page."""

    language: str
    text: str
    line: int
    skipped: bool
    saved: str = ""


def blocks(page: str) -> list[Block]:
    """Return the fenced code blocks of a page."""
    found: list[Block] = []
    lines = (ROOT / page).read_text(encoding="utf-8").split("\n")
    above, start, language, skipped, saved = "", 0, "", False, ""
    for number, line in enumerate(lines, 1):
        if line.startswith("```") and not start:
            start, language, skipped = number, line[3:].strip(), above.startswith("<!-- not run:")
            saved = match[1] if (match := SAVED.fullmatch(above)) else ""
        elif line == "```":
            found.append(Block(language, "\n".join(lines[start : number - 1]), start + 1, skipped, saved))
            start, above = 0, ""
        elif line.strip():
            above = line
    assert not start, f"{page}:{start}: unclosed code block"
    return found
