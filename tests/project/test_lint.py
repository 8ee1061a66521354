"""Planted faults that ``make lint`` must reject, in a copy of the repository."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support import paths

pytest.importorskip("babel", reason="the tools need the development packages")

PO = "src/orinkit/locale/ja/LC_MESSAGES/orinkit.po"
MESSAGE = (
    'from orinkit.core.i18n import tr\n\n\ndef refusal(name: str) -> str:\n    """Return a message."""\n    return {}\n'
)


def run(tool: str, root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "tools" / tool), *arguments], capture_output=True, text=True, check=False, cwd=root
    )


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small repository: the tools, and the packages to which the tests add faults."""
    root = tmp_path_factory.mktemp("repository")
    shutil.copytree(paths.ROOT / "tools", root / "tools", ignore=shutil.ignore_patterns("__pycache__"))
    for part in ("__init__.py", "core", "values", "client", "can", "abh3", "locale"):
        source, goal = paths.ROOT / "src/orinkit" / part, root / "src/orinkit" / part
        if source.is_dir():
            shutil.copytree(source, goal, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            goal.parent.mkdir(parents=True)
            shutil.copy(source, goal)
    shutil.copy(paths.ROOT / "pyproject.toml", root)  # the settings of ruff
    assert "translation removed" in run("messages.py", root).stdout  # the messages of the other packages
    return root


@pytest.fixture
def planted(copy: Path) -> Path:
    """A module for faults; the catalogue is restored afterwards."""
    catalogue = copy / PO
    before = {path: path.read_bytes() for path in (catalogue, catalogue.with_suffix(".mo"))}
    yield copy / "src/orinkit/core/planted.py"
    (copy / "src/orinkit/core/planted.py").unlink(missing_ok=True)
    for path, content in before.items():
        path.write_bytes(content)


def update_messages(copy: Path, *, code: int = 0) -> str:
    result = run("messages.py", copy)
    assert (result.returncode, result.stderr) == (code, "")
    return result.stdout


def translate(copy: Path, message: str, translation: str) -> None:
    """Write the translation of a message into the catalogue, as a translator does."""
    catalogue = copy / PO
    text = catalogue.read_text(encoding="utf-8")
    changed = re.sub(rf'(msgid "{re.escape(message)}"\n)msgstr ".*"', rf'\1msgstr "{translation}"', text)
    assert changed != text
    catalogue.write_text(changed, encoding="utf-8")


def check_messages(copy: Path) -> str:
    result = run("messages.py", copy, "--check")
    assert not result.stderr
    assert (result.returncode == 1) == bool(result.stdout.strip())
    return result.stdout.strip()


def test_the_catalogue_is_complete(copy: Path) -> None:
    assert check_messages(copy) == ""


def test_an_untranslated_message(copy: Path, planted: Path) -> None:
    planted.write_text(MESSAGE.format('tr("the gripper {name} is not calibrated", name=name)'), encoding="utf-8")
    assert "the gripper {name} is not calibrated" in check_messages(copy)


def test_the_way_of_a_message(copy: Path, planted: Path) -> None:
    """Each step names the next one; no translation is lost silently."""
    message, japanese = "the gripper {name} is not calibrated", "グリッパ {name} は校正されていません"
    catalogue, compiled = copy / PO, (copy / PO).with_suffix(".mo")
    planted.write_text(MESSAGE.format(f'tr("{message}", name=name)'), encoding="utf-8")
    assert f"Try: make messages; then write the msgstr in {PO}; then make messages" in check_messages(copy)
    assert f"untranslated: '{message}' (src/orinkit/core/planted.py). Try: write the msgstr" in update_messages(copy)

    before = compiled.read_bytes()
    translate(copy, message, "グリッパ {nmae} は校正されていません")
    listed = update_messages(copy, code=1)
    assert listed.startswith(f"placeholders differ: '{message}' (src/orinkit/core/planted.py)")
    assert f"Try: correct the msgstr in {PO}; then make messages" in listed
    assert compiled.read_bytes() == before
    translate(copy, message, japanese)
    assert update_messages(copy) == ""
    assert compiled.read_bytes() != before

    changed = message.replace("gripper", "hand")
    planted.write_text(MESSAGE.format(f'tr("{changed}", name=name)'), encoding="utf-8")
    listed = update_messages(copy)
    assert listed.startswith(f"to be revised, because the English text was changed: '{changed}'")
    assert japanese in listed
    assert listed.strip() in check_messages(copy)
    text = catalogue.read_text(encoding="utf-8")
    assert f"# the English text was: {message}\n" in text
    catalogue.write_text(text.replace("#, fuzzy\n", ""), encoding="utf-8")
    translate(copy, changed, "ハンド {name} は校正されていません")
    assert update_messages(copy) == ""
    assert "the English text was" not in catalogue.read_text(encoding="utf-8")

    planted.unlink()
    assert update_messages(copy) == f"translation removed: '{changed}' -> 'ハンド {{name}} は校正されていません'\n"
    assert check_messages(copy) == ""


def test_a_stale_message(copy: Path, planted: Path) -> None:
    catalogue = copy / PO
    with catalogue.open("a", encoding="utf-8") as file:
        file.write('\nmsgid "nobody says this any longer"\nmsgstr "もう使われていません"\n')
    assert "stale: 'nobody says this any longer'. Try: make messages" in check_messages(copy)


def test_a_placeholder_mismatch(copy: Path, planted: Path) -> None:
    catalogue = copy / PO
    planted.write_text(MESSAGE.format('tr("the gripper {name} is not calibrated", name=name)'), encoding="utf-8")
    with catalogue.open("a", encoding="utf-8") as file:
        file.write('\nmsgid "the gripper {name} is not calibrated"\nmsgstr "グリッパ {nmae} は校正されていません"\n')
    assert "the gripper {name} is not calibrated" in check_messages(copy)


@pytest.mark.parametrize(
    ("english", "japanese"),
    [
        ("the gripper is not calibrated. Try: calibrate it", "グリッパは校正されていません。校正してください"),
        ("the gripper is not calibrated", "グリッパは校正されていません。対処: 校正してください"),
    ],
)
def test_a_remedy_in_one_language(copy: Path, planted: Path, english: str, japanese: str) -> None:
    planted.write_text(MESSAGE.format(f"tr({english!r})"), encoding="utf-8")
    with (copy / PO).open("a", encoding="utf-8") as file:
        file.write(f'\nmsgid "{english}"\nmsgstr "{japanese}"\n')
    assert "without 対処:" in check_messages(copy)


@pytest.mark.parametrize(
    "text",
    [
        "Where there is no file, an empty one is made.",
        "Whoever has the arm may move it.",
        "It is told every packet.",
        "InvalidValue: it is none.",
        "The client wants an answer.",
        "A set-point every 8 ms is not to be had from a thread.",
    ],
)
@pytest.mark.parametrize("kind", ["docstring", "comment", "message", "document"])
def test_a_banned_pattern(copy: Path, planted: Path, tmp_path: Path, text: str, kind: str) -> None:
    sources = {
        "docstring": f'"""Summary.\n\n{text}\n"""\n',
        "comment": f"# {text}\n",
        "message": MESSAGE.format(f"tr({text!r})"),
        "document": f"# Title\n\n{text}\n",
    }
    path = tmp_path / "page.md" if kind == "document" else planted
    path.write_text(sources[kind], encoding="utf-8")
    result = run("prose.py", copy, str(path))
    assert result.returncode == 1
    assert re.search(rf"{path.name}:\d+: ", result.stdout)


@pytest.mark.parametrize("summary", ["Whether it moves.", "What a client may do.", "Tell what was sent."])
def test_a_docstring_that_does_not_say_what_to_do(copy: Path, planted: Path, summary: str) -> None:
    planted.write_text(f'"""{summary}"""\n', encoding="utf-8")
    assert "imperative" in run("prose.py", copy, str(planted)).stdout


def test_code_in_documents_is_not_prose(copy: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n```\nwhoever\n```\n\nUse `whatever`.\n", encoding="utf-8")
    assert run("prose.py", copy, str(page)).stdout == ""


BLOCK = "".join(f"    total += {number} * width\n" for number in range(7))


def function(name: str, block: str) -> str:
    return f'def {name}(width: float, total: float) -> float:\n    """Return a sum."""\n{block}    return total\n'


def repeated(copy: Path, planted: Path, first: str, second: str) -> str:
    planted.write_text(f'"""Sums."""\n\n\n{first}\n\n{second}', encoding="utf-8")
    result = run("duplicates.py", copy, str(planted))
    assert not result.stderr
    assert (result.returncode == 1) == bool(result.stdout)
    return result.stdout


def test_a_block_that_stands_twice(copy: Path, planted: Path) -> None:
    found = repeated(copy, planted, function("one", BLOCK), function("two", BLOCK))
    assert found.startswith("core.planted:5-13 repeats core.planted:17-25: 9 lines")


def test_a_block_that_stands_in_another_module(copy: Path, planted: Path) -> None:
    other = copy / "src/orinkit/values/planted.py"
    other.write_text(function("two", BLOCK), encoding="utf-8")
    try:
        assert "repeats values.planted:2-10" in repeated(copy, planted, function("one", BLOCK), "")
    finally:
        other.unlink()


def test_indentation_blank_lines_comments_and_imports_do_not_hide_a_block(copy: Path, planted: Path) -> None:
    lines = BLOCK.replace("2 * width\n", "2 * width  # twice\n\n    # thrice\n    import math\n\n")
    indented = "    if width:\n" + lines.replace("    ", "        ")
    assert ": 8 lines" in repeated(copy, planted, function("one", BLOCK), function("two", indented))


def test_shorter_blocks_may_stand_twice(copy: Path, planted: Path) -> None:
    short = "".join(BLOCK.splitlines(keepends=True)[:3])
    assert repeated(copy, planted, function("one", short), function("two", short)) == ""


def test_a_multi_line_import_is_not_a_block(copy: Path, planted: Path) -> None:
    names = "".join(f"    name_{number},\n" for number in range(8))
    imports = f"from orinkit.core.names import (\n{names})\n"
    assert repeated(copy, planted, imports + "one = 1\n", imports) == ""


@pytest.mark.parametrize(
    ("comment", "accepted"),
    [
        ("# Also in core.planted: the two must not be coupled.", True),
        ("# Also in core.planted:", False),
        ("# Also in core.other: the two must not be coupled.", False),
        ("# The two must not be coupled.", False),
    ],
)
@pytest.mark.parametrize("position", ["above", "within"])
def test_a_justified_block(copy: Path, planted: Path, comment: str, accepted: bool, position: str) -> None:
    second = function("two", BLOCK).replace("    total += 0", f"    {comment}\n    total += 0")
    if position == "above":
        second = f"{comment}\n" + function("one", BLOCK)
    found = repeated(copy, planted, function("one", BLOCK), second)
    assert (found == "") == accepted


def test_generated_modules_may_repeat_their_sources(copy: Path, planted: Path) -> None:
    generated = copy / "src/orinkit/client/_sync/planted.py"
    generated.write_text(function("one", BLOCK), encoding="utf-8")
    try:
        assert repeated(copy, planted, function("one", BLOCK), "") == ""
    finally:
        generated.unlink()


def test_a_stale_page_of_return_codes(tmp_path: Path) -> None:
    copy = tmp_path / "repository"  # the tool imports orinkit, so it requires the whole package
    for folder in ("src", "tools"):
        shutil.copytree(paths.ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    page = copy / "docs/error-codes.md"
    page.parent.mkdir()
    shutil.copy(paths.ROOT / "docs/error-codes.md", page)
    assert run("make_error_page.py", copy, "--check").returncode == 0
    rows = copy / "src/orinkit/core/_hresult_orin.py"
    before = rows.read_text(encoding="utf-8")
    rows.write_text(before.replace('"Not writable"', '"Read only"', 1), encoding="utf-8")
    result = run("make_error_page.py", copy, "--check")
    assert (result.returncode, result.stdout) == (1, "docs/error-codes.md is out of date. Try: make codes\n")
    assert run("make_error_page.py", copy).returncode == 0
    assert "| `0x8000020A` | `E_CAO_NOT_WRITABLE` | Read only |" in page.read_text(encoding="utf-8")


def test_a_stale_synchronous_client(copy: Path) -> None:
    generated = copy / "src/orinkit/client/_sync/robot.py"
    before = generated.read_text(encoding="utf-8")
    generated.write_text(f"{before}# by hand\n", encoding="utf-8")
    try:
        result = run("make_sync.py", copy, "--check")
    finally:
        generated.write_text(before, encoding="utf-8")
    assert (result.returncode, result.stderr) == (1, "robot.py: out of date. Try: make sync\n")


def test_make_lint_runs_these_tools() -> None:
    lint = (paths.ROOT / "Makefile").read_text(encoding="utf-8").partition("\nlint:")[2].partition("\n\n")[0]
    assert "tools/messages.py --check" in lint
    assert "tools/prose.py" in lint
    assert "tools/duplicates.py" in lint
    assert "tools/make_error_page.py --check" in lint
