"""Installed packages: modules with a ``.dist-info`` directory beside them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import orinkit


def install(directory: Path, name: str, entries: str, *, group: str = "orinkit.providers", **modules: str) -> Path:
    """Write a package with entry points of orinkit; it is installed if the directory is on the path.

    Args:
        directory: created if it does not exist; may contain several packages.
        name: the name of the package; its version is 1.0.
        entries: lines ``name = module:attribute``.
        group: the group of the entry points.
        modules: module names and their source code.

    Returns:
        The directory.
    """
    info = directory / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[{group}]\n{entries}\n", encoding="utf-8")
    for module, source in modules.items():
        (directory / f"{module}.py").write_text(source, encoding="utf-8")
    return directory


def device(name: str, *, width: float = 30.0, kind: str = "Gripper") -> str:
    """Return the source code of a device with a variable WIDTH."""
    return f"""
from orinkit import Device, variable

class {kind}(Device):
    provider_names = ({name!r},)

    @variable("WIDTH", quick=True)
    def width(self) -> float:
        return {width}
"""


@contextmanager
def forgetting(directory: Path) -> Iterator[None]:
    """Remove the modules of a directory that are imported meanwhile, and check that ``sys.path`` has not changed."""
    path = list(sys.path)
    yield
    assert sys.path == path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(str(directory)):
            del sys.modules[name]


def environment(*directories: Path) -> dict[str, str]:
    """Return the environment of a process in which the packages of directories are installed."""
    path = [*map(str, directories), str(Path(orinkit.__file__).parent.parent)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path), "ORINKIT_LANG": "en"}
