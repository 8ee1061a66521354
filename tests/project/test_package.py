"""The public names, and the modules that importing them loads."""

from __future__ import annotations

import subprocess
import sys

import pytest

import orinkit
from orinkit import aio


@pytest.mark.parametrize("module", [orinkit, aio])
def test_all_names_exist(module):
    assert sorted(module.__all__) == sorted(set(module.__all__))
    assert all(hasattr(module, name) for name in module.__all__)
    assert len(module.__all__) <= 100  # including exceptions


def test_the_two_sides_have_the_same_objects():
    objects = {"Client", "Command", "Controller", "Extension", "File", "Message", "Robot", "Task", "Variable"}
    assert objects <= set(orinkit.__all__)
    assert {f"Async{name}" for name in objects} <= set(aio.__all__)


def test_importing_is_light():
    """``import orinkit`` loads neither an event loop nor other modules that a client does not need."""
    program = "import sys, orinkit; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"asyncio", "concurrent", "numpy", "logging", "sqlite3", "cyclopts", "rich", "ssl"}


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False)


WITHOUT_PACKAGES = (
    "import sys; sys.modules.update(dict.fromkeys(('cyclopts', 'rich', 'numpy', 'lark', 'matplotlib')))\n"
)


def test_the_library_needs_only_the_standard_library():
    done = run(
        WITHOUT_PACKAGES + "import orinkit\n"
        "from orinkit import aio\n"
        "from orinkit.values import notation, poses\n"
        "from orinkit.bcap import dissect\n"
        "class Gripper(orinkit.Device):\n"
        "    provider_names = ('CaoProv.Gripper',)\n"
        "    @orinkit.variable('WIDTH')\n"
        "    def width(self) -> float:\n"
        "        return 3.0\n"
        "with orinkit.serve(Gripper(), 'tcp://127.0.0.1:0') as server:\n"
        "    with orinkit.connect(server.url, provider='CaoProv.Gripper') as gripper:\n"
        "        print(gripper.variable('WIDTH').value)\n"
    )
    assert (done.returncode, done.stdout.strip()) == (0, "3.0"), done.stderr


def test_the_error_names_the_packages_of_the_virtual_rc8():
    done = run(
        "import importlib.machinery, sys\n"
        "class Hidden(importlib.machinery.PathFinder):\n"
        "    @classmethod\n"
        "    def find_spec(cls, name, path=None, target=None):\n"
        "        return None if name in ('numpy', 'lark') else super().find_spec(name, path, target)\n"
        "sys.meta_path[-1] = Hidden\n"
        "from orinkit.core import errors\n"
        "try:\n"
        "    import orinkit.virtual.rc8\n"
        "except errors.MissingExtra as error:\n"
        "    print(error)\n"
    )
    assert "pip install 'orinkit[virtual]'" in done.stdout, done.stderr
    assert "numpy, lark" in done.stdout


def test_public_names_are_shown_as_such():
    assert repr(orinkit.Robot) == "<class 'orinkit.Robot'>"
    assert repr(aio.AsyncRobot) == "<class 'orinkit.aio.AsyncRobot'>"
    assert orinkit.connect.__name__ == "connect"
    assert orinkit.PassMark.__name__ in orinkit.__all__


@pytest.mark.parametrize("device", ["rc8", "ve026a"])
def test_serving_without_the_extra_names_it(device: str) -> None:
    done = run(
        "import importlib.machinery, sys\n"
        "class Hidden(importlib.machinery.PathFinder):\n"
        "    @classmethod\n"
        "    def find_spec(cls, name, path=None, target=None):\n"
        "        return None if name in ('numpy', 'lark') else super().find_spec(name, path, target)\n"
        "sys.meta_path[-1] = Hidden\n"
        "from orinkit.cli.app import main\n"
        f"raise SystemExit(main(['serve', '{device}']))\n"
    )
    assert done.returncode == 1
    assert done.stderr == ("orinkit: the virtual RC8 needs numpy, lark. Try: pip install 'orinkit[virtual]'\n")
