"""Run the tests of the extension in C with AddressSanitizer and UndefinedBehaviorSanitizer: ``python tools/sanitize.py``.

The extension is compiled into a copy of the package, and the tests are run there. Requires gcc with its sanitizers; exit
status 77 and a reason if they are not available. Further arguments are passed to pytest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
SKIPPED = 77
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer", "-g", "-O1")
TESTS = ("tests/values/test_codec_in_c.py", "tests/transport/test_exchange_in_c.py", "tests/client/test_direct_path.py")


def skip(reason: str) -> int:
    """Print the reason for which nothing was run; return the exit status."""
    print(f"skipped: {reason}")
    return SKIPPED


def library(gcc: str, name: str) -> str:
    """Return the path of a library of gcc; ``""`` if it is not installed."""
    found = subprocess.run([gcc, f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
    return found if Path(found).is_absolute() else ""


def compile_extension(gcc: str, folder: Path) -> str:
    """Compile the extension with the sanitizers into a folder; return the output of the compiler if it fails."""
    module = folder / f"_speedups{sysconfig.get_config_var('EXT_SUFFIX')}"
    sources = sorted(map(str, (ROOT / "csrc").glob("*.c")))
    include = f"-I{sysconfig.get_path('include')}"
    command = [gcc, *SANITIZERS, "-Wall", "-Wextra", "-shared", "-fPIC", include, *sources, "-o", str(module)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stderr if done.returncode else ""


def main() -> int:
    """Compile the extension, and run the tests with it."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return skip("gcc is not installed")
    libraries = [library(gcc, name) for name in ("libasan.so", "libubsan.so")]
    if not libraries[0]:
        return skip("libasan is not installed")
    with tempfile.TemporaryDirectory(prefix="orinkit-sanitize-") as name:
        source = Path(name, "src")
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
        failure = compile_extension(gcc, source / "orinkit" / "core")
        if failure:
            return skip(f"the extension cannot be compiled with sanitizers: {failure}")
        environment = os.environ | {
            "PYTHONPATH": str(source),
            "PYTHONMALLOC": "malloc",  # so that each object is checked
            "LD_PRELOAD": " ".join(filter(None, libraries)),
            "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1",  # Python itself never frees some objects
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }
        environment.pop("ORINKIT_PURE", None)
        check = "from orinkit.core.speedups import EXTENSION as e; import os; assert e.__file__.startswith(os.environ['PYTHONPATH'])"
        subprocess.run([sys.executable, "-c", check], check=True, env=environment)
        tests = sys.argv[1:] or [*TESTS, "-m", "not soak"]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        return subprocess.run(command, cwd=ROOT, check=False, env=environment).returncode


if __name__ == "__main__":
    raise SystemExit(main())
