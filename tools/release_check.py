"""Build sdist and wheel, and test both in clean environments: ``python tools/release_check.py``.

1. Build both into ``dist/``, and check their contents.
2. Install the wheel without any extra into a clean environment; run all tests there that do not require an extra.
3. Unpack the sdist, install it with all extras into another clean environment, and run its tests from there.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
TOOLS = ("pytest>=9.2", "pytest-timeout>=2.4", "pytest-xdist>=3.8", "hypothesis>=6.170")
IN_WHEEL = (
    "orinkit/py.typed",
    "orinkit/arms/vs050.toml",
    "orinkit/locale/ja/LC_MESSAGES/orinkit.mo",
    "orinkit/virtual/rc8/samples/",
)
IN_SDIST = (
    "tests/conftest.py",
    "docs/howto/",
    "examples/",
    "bench/",
    "tools/make_sync.py",
    "Makefile",
    "CONTRIBUTING.md",
)


def build() -> tuple[Path, Path]:
    """Build wheel and sdist; return their paths."""
    shutil.rmtree(DIST, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT)], check=True)
    (wheel,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    return wheel, sdist


def check_contents(wheel: Path, sdist: Path) -> None:
    """Check that nothing is missing in both, and that the wheel contains no foreign files."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    missing = [each for each in IN_WHEEL if not any(name.startswith(each) for name in names)]
    foreign = [name for name in names if not name.startswith("orinkit") or name.endswith((".pyc", ".tmp"))]
    with tarfile.open(sdist) as packed:
        inside = [name.partition("/")[2] for name in packed.getnames()]
    missing += [each for each in IN_SDIST if not any(name.startswith(each) for name in inside)]
    if missing or foreign:
        raise SystemExit(f"missing: {missing}; not expected in the wheel: {foreign}")


def environment(folder: Path, *packages: str) -> str:
    """Create a virtual environment with some packages; return the path of its Python."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = str(folder / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages], check=True)
    return python


def run_tests(python: str, folder: Path, *arguments: str) -> None:
    """Run the tests in a folder."""
    command: Sequence[str] = [
        python,
        "-m",
        "pytest",
        "-q",
        "-m",
        "not soak",
        "-n",
        "4",
        "--dist",
        "loadfile",
        *arguments,
    ]
    subprocess.run(command, cwd=folder, check=True, env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"})


def main() -> int:
    """Run all steps."""
    wheel, sdist = build()
    check_contents(wheel, sdist)
    with tempfile.TemporaryDirectory(prefix="orinkit-release-") as name:
        folder = Path(name)
        with tarfile.open(sdist) as packed:
            packed.extractall(folder, filter="data")
        unpacked = folder / sdist.name.removesuffix(".tar.gz")
        bare = folder / "bare"
        shutil.copytree(unpacked, bare, ignore=shutil.ignore_patterns("src"))
        run_tests(environment(folder / "venv-bare", str(wheel), *TOOLS), bare, "-p", "support.bare")
        run_tests(environment(folder / "venv-sdist", f"{unpacked}[dev]"), unpacked)
    print(f"{wheel.name} and {sdist.name}: passed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
