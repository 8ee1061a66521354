"""Build sdist and wheels, and test them in clean environments: ``python tools/release_check.py [--full] [--from STEP]``.

1. ``build``: build them into ``dist/``: the sdist, a wheel with the extension in C, and a wheel without it. Check their
   contents: the sdist contains every file of the repository, and the wheels contain only files of the package.
2. ``bare``: install the wheel with the extension, but without any extra, into a clean environment, and run there all
   tests that do not require an extra.
3. ``pure``: install the wheel without the extension in the same way, and run the tests of the codec.
4. ``no-compiler``: install the sdist on a machine without a compiler; check that the extension is missing.
5. ``editable``: make an editable installation with and without the extension.
6. ``sdist``: unpack the sdist, install it with all extras into another clean environment, and run its tests there: the
   tests of the core, and those of documents, packaging and types (``tests/project``). With ``--full``, run all tests
   except the long ones.

``--from STEP`` skips the steps before STEP, and uses the files in ``dist/`` if ``build`` is among them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
TOOLS = ("pytest>=9.2", "pytest-timeout>=2.4", "pytest-xdist>=3.8", "hypothesis>=6.170")
GIT_LS_FILES = ("git", "ls-files")
WORKERS = ("-n", "auto", "--dist", "loadfile")
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


@dataclass(frozen=True)
class Files:
    """The files of a release."""

    native: Path
    """The wheel with the extension in C."""
    pure: Path
    """The wheel without it."""
    sdist: Path


def built() -> Files:
    """Return the files in ``dist/``."""
    pure = [*DIST.glob("*-py3-none-any.whl")]
    native = [wheel for wheel in DIST.glob("*.whl") if wheel not in pure]
    sdists = [*DIST.glob("*.tar.gz")]
    if not len(native) == len(pure) == len(sdists) == 1:
        raise SystemExit(f"a wheel with the extension, one without it and an sdist expected, not {[*DIST.glob('*')]}")
    return Files(native[0], pure[0], sdists[0])


def build() -> None:
    """Build sdist and wheels, and check their contents."""
    shutil.rmtree(DIST, ignore_errors=True)
    command = [sys.executable, "-m", "build", "--outdir", str(DIST)]
    subprocess.run([*command, str(ROOT)], check=True)
    subprocess.run([*command, "--wheel", str(ROOT)], check=True, env=os.environ | {"ORINKIT_PURE": "1"})
    files = built()
    for wheel in (files.native, files.pure):
        check_contents(wheel, files.sdist)
    check_extension(files.native, files.pure)


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


def unpack(sdist: Path, folder: Path) -> Path:
    """Unpack an sdist into a new folder; return the path of its root."""
    with tarfile.open(sdist) as packed:
        packed.extractall(folder, filter="data")
    return folder / sdist.name.removesuffix(".tar.gz")


def without_source(sdist: Path, folder: Path) -> Path:
    """Unpack an sdist without ``src``, so that its tests import the installed orinkit; return the path of its root."""
    unpacked = unpack(sdist, folder)
    shutil.rmtree(unpacked / "src")
    return unpacked


def run_tests(python: str, folder: Path, *arguments: str) -> None:
    """Run the tests in a folder."""
    command = [python, "-m", "pytest", "-q", *WORKERS, *arguments]
    print(f"{folder}: {' '.join(command[1:])}", flush=True)
    subprocess.run(command, cwd=folder, check=True, env=OWN_ENV)


def test_bare(files: Files, folder: Path) -> None:
    """Run the tests that need no extra, with the wheel with the extension."""
    python = environment(folder / "venv", str(files.native), *TOOLS)
    check_status(python, "in use")
    run_tests(python, without_source(files.sdist, folder), "-m", "not soak", "--no-extras")


def test_pure(files: Files, folder: Path) -> None:
    """Run the tests of the codec, with the wheel without the extension."""
    python = environment(folder / "venv", str(files.pure), *TOOLS)
    check_status(python, "not built")
    run_tests(python, without_source(files.sdist, folder), *CODEC_TESTS)


def test_without_compiler(files: Files, folder: Path) -> None:
    """Install the sdist without a compiler: with a notice, and without the extension."""
    python = environment(folder / "venv")
    command = [python, "-m", "pip", "install", "--verbose", "--disable-pip-version-check", str(files.sdist)]
    output = subprocess.run(
        command, check=True, capture_output=True, text=True, env=os.environ | {"CC": "/nonexistent"}
    )
    if "the optional C extension is left out" not in output.stdout + output.stderr:
        raise SystemExit("an installation without a compiler printed no notice")
    check_status(python, "not built")


def test_editable(files: Files, folder: Path) -> None:
    """Make an editable installation with the extension, then one without it, which replaces the first one."""
    source = str(unpack(files.sdist, folder))
    python = environment(folder / "venv", "--editable", source)
    check_status(python, "in use")
    command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--editable", source]
    subprocess.run(command, check=True, env=os.environ | {"ORINKIT_PURE": "1"})
    check_status(python, "not built")


def test_sdist(files: Files, folder: Path) -> None:
    """Run the tests of the core and of ``tests/project`` from the unpacked sdist, with all extras."""
    unpacked = unpack(files.sdist, folder)
    python = environment(folder / "venv", f"{unpacked}[dev]")
    run_tests(python, unpacked, "-m", "core and not soak")
    run_tests(python, unpacked, "-m", "not core and not soak", "tests/project")


def test_all_of_sdist(files: Files, folder: Path) -> None:
    """Run all tests except the long ones from the unpacked sdist, with all extras."""
    unpacked = unpack(files.sdist, folder)
    run_tests(environment(folder / "venv", f"{unpacked}[dev]"), unpacked, "-m", "not soak")


TESTS: dict[str, Callable[[Files, Path], None]] = {
    "bare": test_bare,
    "pure": test_pure,
    "no-compiler": test_without_compiler,
    "editable": test_editable,
    "sdist": test_sdist,
}
STEPS = ("build", *TESTS)


def arguments() -> argparse.Namespace:
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(description="Build sdist and wheels, and test them in clean environments.")
    parser.add_argument(
        "--full",
        action="store_true",
        help="run all tests from the sdist, except long ones; without it, those with the marker core and tests/project",
    )
    parser.add_argument("--from", dest="first", choices=STEPS, default="build", help="skip the steps before this one")
    return parser.parse_args()


def main() -> int:
    """Run all steps, each in a folder of its own."""
    chosen = arguments()
    tests = TESTS | {"sdist": test_all_of_sdist} if chosen.full else TESTS
    for step in STEPS[STEPS.index(chosen.first) :]:
        began = time.monotonic()
        with tempfile.TemporaryDirectory(prefix=f"orinkit-{step}-") as name:
            if step == "build":
                build()
            else:
                tests[step](built(), Path(name))
        print(f"{step}: passed in {time.monotonic() - began:.0f} s", flush=True)
    files = built()
    print(f"{files.native.name}, {files.pure.name} and {files.sdist.name}: passed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
