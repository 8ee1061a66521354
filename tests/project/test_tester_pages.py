"""The documents of the Tester: a picture of every page in both languages, and a test for every row of b-CAP Tester."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import orinkit
from support.paths import ROOT, TESTS

PICTURES = ROOT / "docs" / "pictures"
GUIDE = (ROOT / "docs" / "howto" / "tester.md").read_text(encoding="utf-8")
READMES = {"en": "README.md", "ja": "README.ja.md"}
LARGEST = {".png": 150_000, ".webp": 2_000_000}
PACKAGE = Path(orinkit.__file__).parent  # the tests of an installed wheel have no src
PAGES = re.findall(r'^    Page\("([^"]+)"', (PACKAGE / "tester/pages/__init__.py").read_text("utf-8"), re.MULTILINE)
IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)\s]+)\)")
TEST = re.compile(r"`([\w/]+\.py)::(test_\w+)`")


def name_of(path: str) -> str:
    """Return the name of the picture of a page, as tools/pictures.py does."""
    return path.strip("/").replace("/", "-") or "connections"


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", PAGES)
def test_every_page_has_a_picture_in_both_languages_which_the_guide_shows(path):
    name = name_of(path)
    for language in READMES:
        assert (PICTURES / f"{name}.{language}.png").exists(), "make pictures"
    assert f"](../pictures/{name}.en.png)" in GUIDE
    assert f"](../pictures/{name}.ja.png)" in GUIDE


@pytest.mark.parametrize("language", READMES)
def test_the_readme_opens_with_the_moving_arm_and_shows_pages(language):
    text = (ROOT / READMES[language]).read_text(encoding="utf-8")
    images = IMAGE.findall(text)
    assert images[0][1] == f"docs/pictures/jogging.{language}.webp"
    assert text.index(images[0][1]) < text.index("\n## ")
    assert len(images) >= 3
    for description, path in images:
        assert description
        assert (ROOT / path).exists()
        assert path.endswith((f".{language}.png", f".{language}.webp"))


def test_pictures_are_small_and_every_one_is_shown():
    shown = {path.rpartition("/")[2] for _, path in re.findall(r"\[([^\]]*)\]\(([^)\s]+)\)", GUIDE)}
    for readme in READMES.values():
        shown |= {path.rpartition("/")[2] for _, path in IMAGE.findall((ROOT / readme).read_text(encoding="utf-8"))}
    for path in PICTURES.iterdir():
        assert path.stat().st_size <= LARGEST[path.suffix], path
        assert path.name in shown


# --- b-CAP Tester, row by row -----------------------------------------------------------------------------------------


def rows() -> list[list[str]]:
    """Return the rows of all tables of the section, without their heads."""
    section = GUIDE.partition("\n## b-CAP Tester, row by row\n")[2].partition("\n## ")[0]
    found: list[list[str]] = []
    for line in section.split("\n"):
        if line.startswith("|---"):
            found.pop()  # the head
        elif line.startswith("| "):
            found.append([cell.strip() for cell in line.split("|")[1:-1]])
    return found


@cache
def rows_of_tests(path: str) -> frozenset[str]:
    """Return the names of the test functions of a file."""
    tree = ast.parse((TESTS / path).read_text(encoding="utf-8"))
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, functions))


def test_the_tables_are_complete():
    assert len(rows()) >= 71
    assert len({row[0] for row in rows() if "AddVariable" in row[0]}) == 2


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0][:40])
def test_every_row_has_tests_that_exist_or_a_reason(row):
    element, place, tests = row
    assert element
    assert place
    named = TEST.findall(tests)
    for path, name in named:
        assert (TESTS / path).exists(), path
        assert name in rows_of_tests(path)
    if not named:
        assert len(tests) > 20
        assert "::" not in tests
