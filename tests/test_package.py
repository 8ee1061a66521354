"""What a user imports, and what that brings along."""

from __future__ import annotations

import subprocess
import sys

import pytest

import orinkit
from orinkit import aio


@pytest.mark.parametrize("module", [orinkit, aio])
def test_all_names_what_there_is(module):
    assert sorted(module.__all__) == sorted(set(module.__all__))
    assert all(hasattr(module, name) for name in module.__all__)
    assert len(module.__all__) <= 40


def test_the_two_sides_have_the_same_objects():
    objects = {"Client", "Command", "Controller", "Extension", "File", "Message", "Robot", "Task", "Variable"}
    assert objects <= set(orinkit.__all__)
    assert {f"Async{name}" for name in objects} <= set(aio.__all__)


def test_importing_is_light():
    """Neither an event loop nor anything that a plain client does not need comes with ``import orinkit``."""
    program = "import sys, orinkit; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"asyncio", "concurrent", "numpy", "logging", "sqlite3", "cyclopts", "rich", "ssl"}


def test_the_library_needs_only_the_standard_library():
    program = (
        "import sys; sys.modules.update(dict.fromkeys(('cyclopts', 'rich', 'numpy')))\n"
        "import orinkit\n"
        "from orinkit import aio, notation\n"
        "from orinkit.bcap import explain\n"
        "from orinkit.virtual.rc8 import VirtualRC8\n"
        "with orinkit.serve(VirtualRC8(), 'tcp://127.0.0.1:0') as server, orinkit.connect(server.url) as rc8:\n"
        "    print(rc8.variable('@MODE').value)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "3"), done.stderr
