"""Build sdist and wheels, and test them in clean environments: ``python tools/release_check.py [--full]``.

1. Build them into ``dist/``: the sdist, a wheel with the extension in C, and a wheel without it. Check their contents:
   the sdist contains every file of the repository, and the wheels contain only files of the package.
2. Install the wheel with the extension, but without any extra, into a clean environment, and run there all tests that
   do not require an extra.
3. Install the wheel without the extension, and the sdist on a machine without a compiler; check that the extension is
   missing, and run the tests of the codec. Make an editable installation with and without the extension.
4. Unpack the sdist, install it with all extras into another clean environment, and run its tests there: the tests of
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
    "orinkit/core/_speedups.pyi",
)
EXTENSION = "orinkit/core/_speedups."
CODEC_TESTS = ("-m", "not soak", "--no-extras", "tests/values", "tests/bcap", "tests/client/test_direct_path.py")
# The PYTHONPATH of the caller could select another orinkit than the installed one.
OWN_ENV = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "ORINKIT_PURE")} | {
    "PYTHONDONTWRITEBYTECODE": "1",
    "ORINKIT_LANG": "en",
}
NOT_IN_SDIST = (".ci/", ".github/", ".gitignore")
"""Files that only the repository requires."""


def build() -> tuple[Path, Path, Path]:
    """Build sdist and wheels; return the paths of the wheel with the extension, the pure wheel and the sdist."""
    shutil.rmtree(DIST, ignore_errors=True)
    command = [sys.executable, "-m", "build", "--outdir", str(DIST)]
    subprocess.run([*command, str(ROOT)], check=True)
    (native,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    subprocess.run([*command, "--wheel", str(ROOT)], check=True, env=os.environ | {"ORINKIT_PURE": "1"})
    pure = DIST / (native.name.split("-cp")[0] + "-py3-none-any.whl")
    if pure == native or not pure.exists():
        raise SystemExit(f"a wheel with the extension and {pure.name} expected, not {[*DIST.glob('*.whl')]}")
    return native, pure, sdist


def names_in(wheel: Path) -> set[str]:
    """Return the names of the files in a wheel, except for the extension and the metadata."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    return {name for name in names if not name.startswith(EXTENSION)}


def check_extension(native: Path, pure: Path) -> None:
    """Check that the wheels differ only in the extension."""
    if names_in(native) != names_in(pure):
        raise SystemExit(f"the wheels differ in {sorted(names_in(native) ^ names_in(pure))}")
    for wheel, count in ((native, 1), (pure, 0)):
        with zipfile.ZipFile(wheel) as archive:
            found = [name for name in archive.namelist() if name.startswith(EXTENSION) and not name.endswith(".pyi")]
        if len(found) != count:
            raise SystemExit(f"{wheel.name} contains {found}")


def check_status(python: str, expected: str) -> None:
    """Check which implementation an installed orinkit uses."""
    program = "from orinkit.core import speedups; print(speedups.status())"
    done = subprocess.run([python, "-P", "-c", program], check=True, capture_output=True, text=True, env=OWN_ENV)
    if not done.stdout.startswith(f"C extension: {expected}"):
        raise SystemExit(f"{expected!r} expected, not {done.stdout!r}")


def check_contents(wheel: Path, sdist: Path) -> None:
    """Check that no file is missing in a wheel and the sdist, and that they contain no foreign files."""
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


def environment(folder: Path, *packages: str, **variables: str) -> str:
    """Create a virtual environment with some packages; return the path of its Python.

    Args:
        folder: The folder to create.
        packages: Arguments of ``pip install``.
        variables: Environment variables of ``pip``.
    """
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = str(folder / "bin" / "python")
    command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages]
    if packages:
        subprocess.run(command, check=True, env=os.environ | variables)
    return python


def check_without_compiler(folder: Path, sdist: Path) -> None:
    """Install the sdist without a compiler: with a notice, and without the extension."""
    python = environment(folder)
    command = [python, "-m", "pip", "install", "--verbose", "--disable-pip-version-check", str(sdist)]
    output = subprocess.run(
        command, check=True, capture_output=True, text=True, env=os.environ | {"CC": "/nonexistent"}
    )
    if "the optional C extension is left out" not in output.stdout + output.stderr:
        raise SystemExit("an installation without a compiler printed no notice")
    check_status(python, "not built")


def check_editable(folder: Path, source: Path) -> None:
    """Make an editable installation with the extension, then one without it, which replaces the first one."""
    python = environment(folder, "--editable", str(source))
    check_status(python, "in use")
    command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--editable", str(source)]
    subprocess.run(command, check=True, env=os.environ | {"ORINKIT_PURE": "1"})
    check_status(python, "not built")


def run_tests(python: str, folder: Path, *arguments: str) -> None:
    """Run the tests in a folder."""
    command = [python, "-m", "pytest", "-q", *WORKERS, *arguments]
    print(f"{folder}: {' '.join(command[1:])}", flush=True)
    subprocess.run(command, cwd=folder, check=True, env=OWN_ENV)


def main() -> int:
    """Run all steps."""
    parser = argparse.ArgumentParser(description="Build sdist and wheels, and test them in clean environments.")
    parser.add_argument(
        "--full",
        action="store_true",
        help="run all tests from the sdist, except long ones; without it, those with the marker core and tests/project",
    )
    full = parser.parse_args().full
    native, pure, sdist = build()
    for wheel in (native, pure):
        check_contents(wheel, sdist)
    check_extension(native, pure)
    with tempfile.TemporaryDirectory(prefix="orinkit-release-") as name:
        folder = Path(name)
        with tarfile.open(sdist) as packed:
            packed.extractall(folder, filter="data")
        unpacked = folder / sdist.name.removesuffix(".tar.gz")
        bare = folder / "bare"
        shutil.copytree(unpacked, bare, ignore=shutil.ignore_patterns("src"))
        python = environment(folder / "venv-bare", str(native), *TOOLS)
        check_status(python, "in use")
        run_tests(python, bare, "-m", "not soak", "--no-extras")
        python = environment(folder / "venv-pure", str(pure), *TOOLS)
        check_status(python, "not built")
        run_tests(python, bare, *CODEC_TESTS)
        check_without_compiler(folder / "venv-no-compiler", sdist)
        check_editable(folder / "venv-editable", Path(shutil.copytree(unpacked, folder / "editable")))
        python = environment(folder / "venv-sdist", f"{unpacked}[dev]")
        if full:
            run_tests(python, unpacked, "-m", "not soak")
        else:
            run_tests(python, unpacked, "-m", "core and not soak")
            run_tests(python, unpacked, "-m", "not core and not soak", "tests/project")
    print(f"{native.name}, {pure.name} and {sdist.name}: passed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
