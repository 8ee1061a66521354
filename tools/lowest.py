"""Run the tests with the lowest versions of the dependencies that pyproject.toml allows: ``python tools/lowest.py [PYTEST ARGUMENTS]``."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
BOUND = re.compile(r"([A-Za-z0-9._-]+)(\[[^\]]*\])?>=([0-9.]+)")


def lowest() -> list[str]:
    """Return the requirements of the library and of its extras, each at its lower bound."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {name: needs for name, needs in project["optional-dependencies"].items() if name not in ("all", "dev")}
    found = [*project["dependencies"], *(each for needs in extras.values() for each in needs)]
    return [f"{match[1]}=={match[3]}" for match in map(BOUND.match, found) if match]


def main() -> int:
    """Install the lowest versions into a separate environment, and run the tests there."""
    with tempfile.TemporaryDirectory(prefix="orinkit-lowest-") as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        python = str(Path(folder) / "bin" / "python")
        pins = lowest()
        print(*pins, sep="\n", flush=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *pins, "-e", f"{ROOT}[dev]"], check=True)
        command = [python, "-m", "pytest", "-q", "-m", "not soak", "-n", "auto", "--dist", "loadfile", *sys.argv[1:]]
        return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
