"""Reject wording that docs/style.md forbids: in documents, docstrings, comments, messages and help texts.

Usage: ``prose.py [FILE ...]``; without files, everything in the repository.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
DOCUMENTS: Final = ("*.md", "docs/**/*.md", ".github/**/*.md")
CODE: Final = ("src/**/*.py", "tools/**/*.py", "tests/**/*.py", "bench/**/*.py")
EXEMPT: Final = ("docs/style.md", "tests/project/test_lint.py")  # these files quote forbidden wording
GENERATED: Final = ("/_sync/",)


class Rule(NamedTuple):
    """A forbidden pattern.

    Attributes:
        pattern: The forbidden wording.
        remedy: The wording to use instead.
        summary: True if the pattern applies to the beginning of a docstring only.
    """

    pattern: re.Pattern[str]
    remedy: str
    summary: bool = False


def _rule(pattern: str, remedy: str, *, summary: bool = False) -> Rule:
    return Rule(re.compile(pattern), remedy, summary)


RULES: Final = (
    _rule(r"(?i)\bwhere there (?:is|are|was|were)\b", 'write "if there is"'),
    _rule(r"(?i)\b(?:whoever|whomever|wherever)\b", "name the client, the caller or the place"),
    _rule(r"(?i)\bwhatever\b", "name it"),
    _rule(r"(?i)\b(?:is|are|was|were) told\b(?! apart)", 'write "receives", "is notified" or "is passed"'),
    _rule(r"\b(?:[Ii]t|which|that|one) is none\b", 'write "if it is not valid"'),
    _rule(r"(?i)\bwithout a word\b", 'write "without notice"'),
    _rule(r"(?i)\b(?:nobody|who) (?:has|is|can|waits|wants|reads|listens)\b.{0,20}\bany more\b", "name the party"),
    _rule(r"(?i)\bis (?:not )?to be had\b", 'write "is (not) available"'),
    _rule(r"(?i)\bis of no (?:more )?use\b", 'write "is stale" or "cannot be used"'),
    _rule(
        r"(?i)\b(?:programs?|clients?|servers?|controllers?|devices?|drivers?) wants?\b",
        'write "requires" or "requests"',
    ),
    _rule(
        r"^(?:Tell|Tells|Say|Says|Whether|What|Who|Whose|How)\b", 'begin with an imperative: "Return ..."', summary=True
    ),
)


class Finding(NamedTuple):
    """An occurrence of a forbidden wording."""

    place: str
    found: str
    remedy: str

    def __str__(self) -> str:
        return f'{self.place}: "{self.found}": {self.remedy} (docs/style.md)'


def check_text(text: str, place: str, line: int, *, summary: bool = False) -> Iterator[Finding]:
    """Yield the findings in a text that begins at a line."""
    flat = re.sub(r"``[^`]*``|`[^`]*`", lambda match: " " * len(match[0]), text)
    for rule in RULES:
        if rule.summary and not summary:
            continue
        for match in rule.pattern.finditer(flat.replace("\n", " ")):
            at = line + flat.count("\n", 0, match.start())
            yield Finding(f"{place}:{at}", match[0], rule.remedy)


def check_document(path: Path, place: str) -> Iterator[Finding]:
    """Yield the findings in a Markdown file, outside its code blocks."""
    text = path.read_text(encoding="utf-8")
    prose = re.sub(r"(?ms)^```.*?^```", lambda match: "\n" * match[0].count("\n"), text)
    yield from check_text(prose, place, 1)


def check_code(path: Path, place: str) -> Iterator[Finding]:
    """Yield the findings in the docstrings, comments and other strings of a Python file."""
    source = path.read_text(encoding="utf-8")
    docstrings = set()
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if node.body and isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant):
            constant = node.body[0].value
            if isinstance(constant.value, str):
                docstrings.add((constant.lineno, constant.col_offset))
                yield from check_text(constant.value, place, constant.lineno, summary=True)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        is_text = token.type == tokenize.STRING and token.start not in docstrings
        if is_text or token.type == tokenize.COMMENT:
            yield from check_text(token.string, place, token.start[0])


def findings(paths: Iterator[Path]) -> Iterator[Finding]:
    """Yield the findings in files."""
    for path in paths:
        place = path.resolve().relative_to(ROOT).as_posix() if path.resolve().is_relative_to(ROOT) else str(path)
        if place in EXEMPT or any(part in place for part in GENERATED) or place == "tools/prose.py":
            continue
        yield from check_code(path, place) if path.suffix == ".py" else check_document(path, place)


def every_file() -> Iterator[Path]:
    """Yield all documents and Python files of the repository."""
    for pattern in (*DOCUMENTS, *CODE):
        yield from sorted(ROOT.glob(pattern))


def main(arguments: list[str]) -> int:
    """Check files and print the findings; return 1 if there are any."""
    paths = (Path(argument) for argument in arguments) if arguments else every_file()
    found = sorted(findings(iter(paths)))
    for finding in found:
        print(finding)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
