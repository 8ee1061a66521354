"""The marks ``guide`` and ``field`` name entries that exist."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.field_rows import ROWS
from support.provider_guide import ENTRIES, LEFT_OUT

TESTS = Path(__file__).parent.parent
MOST_LEFT_OUT = 8


def marked(mark: str) -> Iterator[tuple[Path, str]]:
    """Return each name in a mark of a test, and the file of the test."""
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        if f"mark.{mark}(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == mark:
                for argument in node.args:
                    yield path, ast.literal_eval(argument)


@pytest.mark.parametrize(("mark", "names"), [("guide", ENTRIES), ("field", tuple(ROWS))])
def test_marks_name_entries_that_exist(mark, names):
    unknown = [(path.name, name) for path, name in marked(mark) if name not in names]
    assert not unknown


def test_every_entry_has_a_test_unless_it_is_left_out():
    shown = {name for _, name in marked("guide")}
    assert not [name for name in ENTRIES if name not in shown and name not in LEFT_OUT]
    assert not [name for name in LEFT_OUT if name in shown]


def test_entries_left_out_exist_and_are_few():
    assert set(LEFT_OUT) <= set(ENTRIES)
    assert len(LEFT_OUT) <= MOST_LEFT_OUT
