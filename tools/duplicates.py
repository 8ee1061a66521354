"""Reject blocks of six or more lines that occur twice in ``src/orinkit``.

Usage: ``duplicates.py [FILE ...]``; if files are given, only blocks in these files are reported. Indentation, blank
lines, comments and import statements do not count; generated modules are ignored. A block may occur twice if a comment
justifies it: ``# Also in transport.links: REASON``. The comment is in one of the two blocks or directly above it, and
names the module of the other block.
"""

from __future__ import annotations

import io
import re
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
PACKAGE: Final = ROOT / "src" / "orinkit"
GENERATED: Final = "_sync"
LEAST: Final = 6
JUSTIFIED: Final = re.compile(r"#.*\bAlso in (?P<module>[\w.]+): \S")


class Line(NamedTuple):
    """A line that counts.

    Attributes:
        number: its number in the file.
        text: its text without indentation.
        justified: the modules that are named by comments in the line, or between the previous line and this one.
    """

    number: int
    text: str
    justified: frozenset[str]


class Place(NamedTuple):
    """A position in the lines of a module."""

    module: str
    begin: int


Modules = dict[str, list[Line]]


def read(path: Path) -> list[Line]:
    """Return the lines of a module that count."""
    source = path.read_text(encoding="utf-8")
    comments: dict[int, tuple[int, str]] = {}
    ignored: set[int] = set()
    statement = True  # the next token begins a statement
    imported = 0  # the line in which an import statement began
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            comments[token.start[0]] = (token.start[1], token.string)
        elif token.type == tokenize.NEWLINE:
            if imported:
                ignored.update(range(imported, token.start[0] + 1))
            statement, imported = True, 0
        elif statement and token.type == tokenize.NAME:
            statement = False
            imported = token.start[0] if token.string in {"from", "import"} else 0
        elif token.type not in {tokenize.NL, tokenize.INDENT, tokenize.DEDENT}:
            statement = False
    lines: list[Line] = []
    named: set[str] = set()
    for number, text in enumerate(source.splitlines(), 1):
        column, comment = comments.get(number, (len(text), ""))
        named.update(match["module"] for match in JUSTIFIED.finditer(comment))
        if number not in ignored and (code := text[:column].strip()):
            lines.append(Line(number, code, frozenset(named)))
            named.clear()
    return lines


def module_name(path: Path) -> str:
    """Return the name by which a justification refers to a module."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts) or "orinkit"


def repeated(modules: Modules) -> Iterator[tuple[Place, Place, int]]:
    """Yield both places and the length of each block that occurs twice; blocks are as long as possible."""
    windows: defaultdict[tuple[str, ...], list[Place]] = defaultdict(list)
    for module, lines in modules.items():
        texts = [line.text for line in lines]
        for begin in range(len(texts) - LEAST + 1):
            windows[tuple(texts[begin : begin + LEAST])].append(Place(module, begin))
    for places in windows.values():
        for first, second in combinations(places, 2):
            here, there = modules[first.module], modules[second.module]
            if first.begin and second.begin and here[first.begin - 1].text == there[second.begin - 1].text:
                continue  # the block begins before these lines
            most = min(len(here) - first.begin, len(there) - second.begin)
            if first.module == second.module:
                most = min(most, second.begin - first.begin)
            length = 0
            while length < most and here[first.begin + length].text == there[second.begin + length].text:
                length += 1
            if length >= LEAST:
                yield first, second, length


def justified(modules: Modules, place: Place, other: Place, length: int) -> bool:
    """Return True if a comment in a block, or directly above it, names the module of the other place."""
    block = modules[place.module][place.begin : place.begin + length]
    return any(other.module in line.justified for line in block)


def name(modules: Modules, place: Place, length: int) -> str:
    """Return a place as text."""
    lines = modules[place.module][place.begin : place.begin + length]
    return f"{place.module}:{lines[0].number}-{lines[-1].number}"


def main(arguments: list[str]) -> int:
    """Check and report; return 1 if a block occurs twice."""
    paths = [path for path in sorted(PACKAGE.rglob("*.py")) if GENERATED not in path.parts]
    modules = {module_name(path): read(path) for path in paths}
    asked = {module_name(Path(argument).resolve()) for argument in arguments} or modules.keys()
    found = False
    for first, second, length in sorted(repeated(modules), key=lambda block: -block[2]):
        if first.module not in asked and second.module not in asked:
            continue
        if justified(modules, first, second, length) or justified(modules, second, first, length):
            continue
        found = True
        print(f"{name(modules, first, length)} repeats {name(modules, second, length)}: {length} lines (docs/style.md)")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
