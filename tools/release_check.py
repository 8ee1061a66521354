"""Build sdist and wheel, and test both in clean environments: ``python tools/release_check.py [--full]``.

1. Build both into ``dist/``, and check their contents: the sdist contains every file of the repository, and the wheel
   contains only files of the package.
2. Install the wheel without any extra into a clean environment, and run there all tests that do not require an extra.
3. Unpack the sdist, install it with all extras into another clean environment, and run its tests there: the tests of
   the core, and those of documents, packaging and types (``tests/project``). With ``--full``, run all tests except the
   long ones.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
TOOLS = ("pytest>=9.2", "pytest-timeout>=2.4", "pytest-xdist>=3.8", "hypothesis>=6.170")
GIT_LS_FILES = ("git", "ls-files")
WORKERS = ("-n", "4", "--dist", "loadfile")
IN_WHEEL = (
    "orinkit/py.typed",
    "orinkit/arms/vs050.toml",
    "orinkit/locale/ja/LC_MESSAGES/orinkit.mo",
    "orinkit/virtual/rc8/samples/",
)
NOT_IN_SDIST = (".ci/", ".github/", ".gitignore")
"""Files that only the repository requires."""


def build() -> tuple[Path, Path]:
    """Build wheel and sdist; return their paths."""
    shutil.rmtree(DIST, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT)], check=True)
    (wheel,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    return wheel, sdist


def check_contents(wheel: Path, sdist: Path) -> None:
    """Check that no file is missing in the wheel and the sdist, and that they contain no foreign files."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    missing = [each for each in IN_WHEEL if not any(name.startswith(each) for name in names)]
    foreign = [name for name in names if not name.startswith("orinkit") or name.endswith((".pyc", ".tmp"))]
    with tarfile.open(sdist) as packed:
        inside = {member.name.partition("/")[2] for member in packed.getmembers() if member.isfile()}
    if (ROOT / ".git").exists():
        listed = subprocess.run(GIT_LS_FILES, cwd=ROOT, check=True, capture_output=True, text=True).stdout
        tracked = {name for name in listed.splitlines() if not name.startswith(NOT_IN_SDIST)}
        missing += sorted(tracked - inside)
        foreign += sorted(inside - tracked - {"PKG-INFO", ".gitignore"})
    if missing or foreign:
        raise SystemExit(f"missing: {missing}; not expected: {foreign}")


def environment(folder: Path, *packages: str) -> str:
    """Create a virtual environment with some packages; return the path of its Python."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = str(folder / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages], check=True)
    return python


def run_tests(python: str, folder: Path, *arguments: str) -> None:
    """Run the tests in a folder."""
    command = [python, "-m", "pytest", "-q", *WORKERS, *arguments]
    print(f"{folder}: {' '.join(command[1:])}", flush=True)
    # The PYTHONPATH of the caller could select another orinkit than the installed one.
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run(command, cwd=folder, check=True, env=inherited | {"PYTHONDONTWRITEBYTECODE": "1"})


def main() -> int:
    """Run all steps."""
    parser = argparse.ArgumentParser(description="Build sdist and wheel, and test both in clean environments.")
    parser.add_argument(
        "--full",
        action="store_true",
        help="run all tests from the sdist, except long ones; without it, those with the marker core and tests/project",
    )
    full = parser.parse_args().full
    wheel, sdist = build()
    check_contents(wheel, sdist)
    with tempfile.TemporaryDirectory(prefix="orinkit-release-") as name:
        folder = Path(name)
        with tarfile.open(sdist) as packed:
            packed.extractall(folder, filter="data")
        unpacked = folder / sdist.name.removesuffix(".tar.gz")
        bare = folder / "bare"
        shutil.copytree(unpacked, bare, ignore=shutil.ignore_patterns("src"))
        run_tests(environment(folder / "venv-bare", str(wheel), *TOOLS), bare, "-m", "not soak", "--no-extras")
        python = environment(folder / "venv-sdist", f"{unpacked}[dev]")
        if full:
            run_tests(python, unpacked, "-m", "not soak")
        else:
            run_tests(python, unpacked, "-m", "core and not soak")
            run_tests(python, unpacked, "-m", "not core and not soak", "tests/project")
    print(f"{wheel.name} and {sdist.name}: passed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
