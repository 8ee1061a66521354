"""Check which modules imports load: a program loads only what it uses, so that it starts quickly."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"numpy", "lark", "asyncio", "ssl", "cyclopts", "logging", "subprocess", "tempfile", "dataclasses", "inspect"}


def loaded(code: str) -> set[str]:
    """Return the names of the modules that exist after a program."""
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys\nbefore = set(sys.modules)\n{code}\nprint(*set(sys.modules) - before)"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return set(done.stdout.split("\n")[-2].split())


def test_the_package_alone_has_exceptions_only():
    found = loaded("import orinkit")
    assert not found & HEAVY
    packages = {".".join(name.split(".")[:2]) for name in found if name.startswith("orinkit.")}
    assert packages == {"orinkit.core"}


def test_a_client_needs_no_server():
    found = loaded("import orinkit\norinkit.connect, orinkit.P, orinkit.Variant")
    assert not found & (HEAVY - {"inspect"})
    assert not [name for name in found if name.startswith(("orinkit.server", "orinkit.virtual", "orinkit.cli."))]


def test_a_public_name_shows_all_classes_that_its_module_needs_as_public():
    done = subprocess.run(
        [sys.executable, "-I", "-c", "import orinkit\norinkit.connect\nprint(vars(orinkit)['Robot'], orinkit.Task.__module__)"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "<class 'orinkit.Robot'> orinkit\n"


def test_every_public_name_exists():
    code = "import orinkit\nfor name in orinkit.__all__:\n    getattr(orinkit, name)\nassert set(orinkit.__all__) <= set(dir(orinkit))"
    assert "orinkit.client._sync.stream" in loaded(code)


def test_help_imports_no_command():
    found = loaded("import orinkit.cli.app as app\nassert app.main(['--help']) == 0")
    assert not [
        name for name in found if name.startswith(("orinkit.cli.commands.", "orinkit.virtual", "orinkit.client."))
    ]
    assert not found & {"numpy", "lark", "asyncio"}


def test_a_virtual_rc8_compiles_no_program_at_its_start():
    pytest.importorskip("numpy")
    found = loaded("from orinkit.virtual.rc8 import VirtualRC8\nVirtualRC8().close()")
    assert "lark" not in found
    assert "orinkit.virtual.rc8.pacscript.compiler" not in found
