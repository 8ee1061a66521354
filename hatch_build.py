"""Build hook: compiles the optional extension in C (``csrc``) and adds it to the wheel.

If the extension cannot be built, the hook prints a notice with the reason, and the wheel contains only Python. The
package works without the extension. ``ORINKIT_PURE=1`` builds such a wheel on purpose.
"""

from __future__ import annotations

import os
import platform
import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

MODULE = "orinkit.core._speedups"
FOLDER = "orinkit/core"
FLAGS = ("-fvisibility=hidden", "-g0", "-Wall", "-Wextra")
LINUX_FLAGS = ("-fno-plt",)  # a call from C touches fewer pages


def declined() -> str:
    """Return the reason for which the extension is not built here; ``""`` if it can be tried."""
    if os.environ.get("ORINKIT_PURE", "") not in ("", "0"):
        return "ORINKIT_PURE is set"
    if platform.python_implementation() != "CPython":
        return "it is for CPython only"
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "it relies on the GIL, which this Python does not have"
    if sys.byteorder != "little":
        return "it is for little-endian machines only"
    return ""


def compiled(root: Path, folder: Path) -> Path:
    """Compile the extension in a folder; return the path of the module."""
    from setuptools import Distribution, Extension

    extension = Extension(
        MODULE,
        sources=[str(path) for path in sorted((root / "csrc").glob("*.c"))],
        depends=[str(root / "csrc" / "speedups.h")],
        extra_compile_args=[]
        if os.name == "nt"
        else [*FLAGS, *(LINUX_FLAGS if sys.platform == "linux" else ()), *os.environ.get("ORINKIT_CFLAGS", "").split()],
        extra_link_args=os.environ.get("ORINKIT_CFLAGS", "").split(),
    )
    command = Distribution({"name": "orinkit", "ext_modules": [extension]}).get_command_obj("build_ext")
    command.build_lib, command.build_temp = str(folder / "lib"), str(folder / "temp")
    command.ensure_finalized()
    command.run()
    (module,) = (folder / "lib").rglob("_speedups*.*")
    return module


def put_in_place(module: Path, target: Path) -> None:
    """Copy a module to a path, in one step.

    A file that a running program has loaded must not be written to: the program would crash.
    """
    new = target.with_name(f"{target.name}.new")
    shutil.copy(module, new)
    new.replace(target)


class SpeedupsHook(BuildHookInterface[Any]):
    """Adds the extension to a wheel; for an editable installation, puts it beside its package."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the extension, or print why it is left out."""
        installed = Path(self.root, "src", FOLDER, f"_speedups{sysconfig.get_config_var('EXT_SUFFIX')}")
        reason = declined()
        if not reason:
            self._folder = tempfile.mkdtemp(prefix="orinkit-build-")
            try:
                module = compiled(Path(self.root), Path(self._folder))
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a compiler can fail in any way
                reason = f"{type(error).__name__}: {error}"
        if reason:
            if version == "editable":
                installed.unlink(missing_ok=True)  # of an earlier installation; it may not fit the modules in Python
            self.app.display_warning(f"orinkit: the optional C extension is left out: {reason}")
            return
        if version == "editable":
            put_in_place(module, installed)
            return
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["force_include"][str(module)] = f"{FOLDER}/{module.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary files."""
        shutil.rmtree(getattr(self, "_folder", ""), ignore_errors=True)
