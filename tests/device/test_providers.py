"""Loading of providers: packages with entry points, modules and files, and their errors."""

from __future__ import annotations

import json
import logging
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.core import i18n
from orinkit.device.discovery import (
    Installed,
    ProviderLoadFailed,
    installed,
    load,
    load_installed,
    log_served,
    reserve_names,
    warn_of_clashes,
)
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.distributions import device, forgetting, install
from support.pages import blocks

GRIPPER = "CaoProv.Example.Gripper"
PAGE = "docs/howto/gripper.md"


@pytest.fixture(autouse=True)
def _as_before(tmp_path) -> Iterator[None]:
    with forgetting(tmp_path):
        yield


@pytest.fixture
def site(tmp_path, monkeypatch) -> Path:
    """Return a directory whose packages are installed."""
    directory = tmp_path / "site"
    directory.mkdir()
    with monkeypatch.context() as patch:
        patch.syspath_prepend(str(directory))
        yield directory


def write(path: Path, source: str) -> str:
    path.parent.mkdir(exist_ok=True)
    path.write_text(source, encoding="utf-8")
    return str(path)


def names(provider: orinkit.Provider) -> list[str]:
    return [name for name in provider.provider_names if isinstance(name, str)]


# --- installed packages -----------------------------------------------------------------------------------------------


def test_installed_providers_are_listed_without_import(site):
    before = installed()
    install(site, "zz-pump", "Test.Pump = pkg_pump:Pump", pkg_pump="raise RuntimeError('imported')")
    install(site, "my-gripper", f"{GRIPPER} = pkg_gripper:Gripper\nTest.Other = pkg_gripper:Other", pkg_gripper="")
    found = [each for each in installed() if each not in before]
    assert found == [
        Installed(GRIPPER, "my-gripper 1.0", "pkg_gripper:Gripper"),
        Installed("Test.Other", "my-gripper 1.0", "pkg_gripper:Other"),
        Installed("Test.Pump", "zz-pump 1.0", "pkg_pump:Pump"),
    ]
    assert not {"pkg_pump", "pkg_gripper"} & set(sys.modules)


@pytest.mark.parametrize("value", ["pkg_g:Gripper", "pkg_g", "pkg_g:make", "pkg_g:ready", "pkg_g:Box.inner", "pkg_g:Gripper [x]"])  # fmt: skip
def test_an_entry_is_a_class_a_function_or_an_object(site, value):
    source = device("Test.Own") + "\nmake = lambda: Gripper()\nready = Gripper()\nclass Box:\n    inner = Gripper\n"
    install(site, "my-gripper", f"{GRIPPER} = {value}", pkg_g=source)
    provider = load(f" {GRIPPER.upper()} ")
    assert names(provider) == ["Test.Own", GRIPPER]
    assert names(load(GRIPPER)) == ["Test.Own", GRIPPER]
    with orinkit.serve(provider, "tcp://127.0.0.1:0") as server:
        for name in ("Test.Own", GRIPPER, GRIPPER.lower()):
            with orinkit.connect(server.url, provider=name) as controller:
                assert controller.variable("WIDTH").value == 30.0


def test_an_existing_name_is_not_added(site):
    install(site, "my-gripper", f"{GRIPPER.upper()} = pkg_g:Gripper", pkg_g=device(GRIPPER))
    assert names(load(GRIPPER)) == [GRIPPER]


def test_the_name_of_the_entry_point_is_sufficient(site):
    install(site, "my-gripper", f"{GRIPPER} = pkg_g", pkg_g="import orinkit\nclass G(orinkit.Device):\n    pass\n")
    assert names(load(GRIPPER)) == [GRIPPER]


def test_providers_that_cannot_be_loaded_are_omitted(site, caplog):
    install(site, "a-bad", "Test.Bad = pkg_bad:Bad", pkg_bad="\n\n1 / 0\n")
    install(site, "b-gone", "Test.Gone = pkg_gone:Gone")
    install(site, "c-odd", "Test.Odd = !", pkg_odd="")
    install(site, "d-exit", "Test.Exit = pkg_exit", pkg_exit="raise SystemExit(3)")
    install(site, "e-arm", "Test.Arm = orinkit.virtual.ve026a:VirtualVE026A")
    install(site, "my-gripper", f"{GRIPPER} = pkg_g:Gripper", pkg_g=device(GRIPPER))
    rc8 = VirtualRC8()
    found = load_installed([rc8])
    assert [type(each).__name__ for each in found] == ["Gripper"]
    said = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert len(said) == 5
    text = "\n".join(said)
    assert "Test.Bad (a-bad 1.0) was not loaded: Test.Bad = pkg_bad:Bad: ZeroDivisionError: " in text
    assert "(pkg_bad.py:3)" in text
    assert "neither a module nor a provider pkg_gone exists" in text
    assert "Test.Odd = !" in text
    assert "Test.Exit = pkg_exit: SystemExit: 3" in text
    assert "VirtualRC8 and VirtualVE026A use different dialects of b-CAP" in text
    with (
        orinkit.serve([rc8, *found], "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url) as controller,
        orinkit.connect(server.url, provider=GRIPPER) as gripper,
    ):
        assert (controller.variable("@TYPE").value, gripper.variable("WIDTH").value) == ("RC8 Controller", 30.0)


def test_providers_can_be_omitted_by_name_and_an_object_is_loaded_once(site):
    source = device("Test.Own") + "\nready = Gripper()\n"
    install(site, "my-gripper", f"{GRIPPER} = pkg_g:ready\nTest.Two = pkg_g:ready\nTest.Three = pkg_g", pkg_g=source)
    [ready] = load_installed(exclude=["test.THREE"])
    assert names(ready) == ["Test.Own", GRIPPER, "Test.Two"]
    assert load_installed([ready], exclude=["Test.Three"]) == []


def test_a_damaged_package_does_not_hide_others(site, caplog):
    install(site, "my-gripper", f"{GRIPPER} = pkg_g:Gripper", pkg_g=device(GRIPPER))
    install(site, "damaged", "no equals sign")
    nameless = install(site, "nameless", "Test.Nameless = pkg_g:Gripper") / "nameless-1.0.dist-info" / "METADATA"
    nameless.unlink()
    assert {GRIPPER, "Test.Nameless"} <= {each.name for each in installed()}
    assert "damaged-1.0.dist-info" in caplog.text
    assert len(load_installed()) >= 2


def test_the_first_provider_takes_precedence_and_the_conflict_is_logged(site, caplog):
    install(site, "a-first", f"{GRIPPER} = pkg_a:Gripper", pkg_a=device(GRIPPER, width=1.0))
    install(site, "b-second", f"{GRIPPER.upper()} = pkg_b:Gripper", pkg_b=device(GRIPPER, width=2.0))
    install(site, "c-third", "CaoProv.DENSO.VRC = pkg_c:Gripper", pkg_c=device("Test.Third", width=3.0))
    providers = [VirtualRC8(), *load_installed()]
    warn_of_clashes(providers)
    first = f"{GRIPPER} = pkg_a:Gripper (a-first 1.0)"
    second = f"{GRIPPER.upper()} = pkg_b:Gripper (b-second 1.0)"
    assert f"name {GRIPPER} is used by {first} and by {second}: the first one takes precedence" in caplog.text
    assert (
        "name CaoProv.DENSO.VRC is used by orinkit.virtual.rc8.provider.VirtualRC8 and by "
        "CaoProv.DENSO.VRC = pkg_c:Gripper (c-third 1.0)" in caplog.text
    )
    with orinkit.serve(providers, "tcp://127.0.0.1:0") as server:
        with orinkit.connect(server.url) as controller:
            assert controller.variable("@TYPE").value == "RC8 Controller"
        for name, width in ((GRIPPER, 1.0), ("Test.Third", 3.0)):
            with orinkit.connect(server.url, provider=name) as controller:
                assert controller.variable("WIDTH").value == width


def test_the_name_of_an_entry_point_takes_precedence_over_provider_names(site, caplog):
    install(site, "a-first", "Aaa.Greedy = pkg_a:Gripper", pkg_a=device(GRIPPER.lower(), width=1.0))
    install(site, "b-second", f"{GRIPPER} = pkg_b:Gripper", pkg_b=device("Aaa.Greedy", width=2.0))
    for providers in (load_installed(), [load("Aaa.Greedy"), load(GRIPPER)]):
        caplog.clear()
        reserve_names(providers)
        reserve_names(providers)
        warn_of_clashes(providers)
        with orinkit.serve(providers, "tcp://127.0.0.1:0") as server:
            for name, width in (("Aaa.Greedy", 1.0), (GRIPPER, 2.0)):
                with orinkit.connect(server.url, provider=name) as controller:
                    assert controller.variable("WIDTH").value == width
    one, other = "Aaa.Greedy = pkg_a:Gripper (a-first 1.0)", f"{GRIPPER} = pkg_b:Gripper (b-second 1.0)"
    assert [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING] == [
        f"provider name {GRIPPER.lower()} is used by {one} and by {other}: the entry point of that name takes precedence",
        f"provider name Aaa.Greedy is used by {other} and by {one}: the entry point of that name takes precedence",
    ]


def test_a_conflict_of_two_entry_points_of_one_class_names_the_entry_points(site, caplog):
    install(site, "my-gripper", "Test.A = pkg_g:Gripper\nTest.B = pkg_g:Gripper", pkg_g=device("Test.Own"))
    warn_of_clashes(load_installed())
    said = "Test.Own is used by Test.A = pkg_g:Gripper (my-gripper 1.0) and by Test.B = pkg_g:Gripper (my-gripper 1.0)"
    assert said in caplog.text


def test_read_only_names_are_kept(site, caplog):
    source = (
        "import orinkit\nclass G(orinkit.Device):\n    provider_names = property(lambda self: ['Test.A', 'Test.B'])\n"
    )
    install(site, "a-first", "Test.A = pkg_a", pkg_a=source)
    install(site, "b-second", "Test.B = pkg_b", pkg_b=device("Test.B"))
    providers = load_installed()
    assert [names(each) for each in providers] == [["Test.A", "Test.B"], ["Test.B"]]
    warn_of_clashes(providers)
    assert "Test.B is used by Test.A = pkg_a (a-first 1.0) and by Test.B = pkg_b (b-second 1.0)" in caplog.text


def test_served_providers_are_logged(site, tmp_path, caplog):
    caplog.set_level(logging.INFO)
    install(site, "my-gripper", f"{GRIPPER} = pkg_g:Gripper", pkg_g=device(GRIPPER))
    file = write(tmp_path / "mod_told.py", device("Test.File") + "    provider_names += ('Test.Two',)\n")
    rc8 = VirtualRC8()
    providers = [rc8, load(file), load(GRIPPER), load(GRIPPER)]
    log_served(providers, [rc8])
    assert [record.getMessage() for record in caplog.records] == [
        "serving Test.File, Test.Two (mod_told.Gripper)",
        f"serving {GRIPPER} (my-gripper 1.0)",
    ]
    i18n.use("ja")
    log_served(providers[2:])
    assert caplog.records[-1].getMessage() == f"{GRIPPER} (my-gripper 1.0) を提供します"


def test_an_error_in_a_class_names_its_file(tmp_path):
    source = "import orinkit\nclass G(orinkit.Device):\n    def connect(self): pass\n"
    with pytest.raises(ProviderLoadFailed, match=r"TypeError: G\.connect must be .* \(mod_mistaken\.py:2\)$"):
        load(write(tmp_path / "mod_mistaken.py", source))


def test_no_clash_no_warning(tmp_path, caplog):
    twice = "provider_names = ('Test.A', 'test.a')\n"
    warn_of_clashes([VirtualRC8(), load(write(tmp_path / "mod_twice.py", CLASS + twice))])
    assert not caplog.records


# --- modules and files ------------------------------------------------------------------------------------------------


def test_a_module_with_and_without_the_class(site):
    write(site / "mod_one.py", device("Test.One"))
    package = site / "mod_two"
    write(package / "__init__.py", "from orinkit import Device\nfrom mod_two.parts import Gripper\n")
    write(package / "parts.py", device("Test.Two") + "\nclass _Base(Device):\n    pass\n")
    for target, name in (
        ("mod_one:Gripper", "Test.One"),
        ("mod_one", "Test.One"),
        ("mod_two", "Test.Two"),
        ("mod_two.parts", "Test.Two"),
        ("mod_two.parts:Gripper", "Test.Two"),
    ):
        assert names(load(target)) == [name]
    assert isinstance(load("orinkit.virtual.ve026a:VirtualVE026A"), VirtualVE026A)


def test_a_file_with_and_without_the_class(tmp_path, monkeypatch):
    path = write(tmp_path / "my.gripper-2.py", device("Test.File"))
    first, second = load(f"{path}:Gripper"), load(path)
    assert type(first) is type(second)
    assert first is not second
    monkeypatch.chdir(tmp_path)
    assert type(load("my.gripper-2.py")) is type(first)


def test_a_file_imports_its_neighbours(tmp_path):
    write(tmp_path / "dir" / "neighbour_of_it.py", "WIDTH = 7.5\n")
    path = write(tmp_path / "dir" / "grip.py", "from neighbour_of_it import WIDTH\n" + device("Test.N"))
    provider = load(path)  # the fixture checks that the path is unchanged
    assert sys.modules[type(provider).__module__].WIDTH == 7.5


def test_files_of_the_same_name_and_of_names_that_are_taken(tmp_path):
    one = load(write(tmp_path / "a" / "gripper_x.py", device("Test.A")))
    two = load(write(tmp_path / "b" / "gripper_x.py", device("Test.B")))
    three = load(write(tmp_path / "a" / "json.py", device("Test.C")))
    four = load(write(tmp_path / "a" / "wave.py", device("Test.D")))  # not imported yet, but the module exists
    assert [names(each) for each in (one, two, three, four)] == [["Test.A"], ["Test.B"], ["Test.C"], ["Test.D"]]
    assert sys.modules["json"] is json
    import wave

    assert hasattr(wave, "Wave_read")


def test_a_file_may_have_dataclasses(tmp_path):
    source = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\nfrom typing import ClassVar\n"
        "@dataclass\nclass Size:\n    mm: float = 1.0\n    most: ClassVar[float] = 60.0\n"
    )
    assert names(load(write(tmp_path / "with_data.py", source + device("Test.Data")))) == ["Test.Data"]


CLASS = "import orinkit\nclass G(orinkit.Device):\n    "
NO_KIND = "not the name of an installed provider. Try: module:Class or file.py:Class"
WRONG = {
    "nothing": ("", None, f"'': {NO_KIND}"),
    "blanks": ("  ", None, NO_KIND),
    "a path": ("a/b", None, f"a/b: {NO_KIND}"),
    "a relative module": (".mod", None, NO_KIND),
    "no name and no module": ("CaoProv.Nobody", None, "neither a module nor a provider CaoProv.Nobody exists"),
    "no module": ("nobody_has_this:Gripper", None, "neither a module nor a provider nobody_has_this exists"),
    "no inner module": ("json.nobody:Gripper", None, "neither a module nor a provider json.nobody exists"),
    "no file": ("not_there.py", None, "not_there.py: the file does not exist"),
    "a name that no file can have": ("x" * 100_000 + ".py", None, "xxx.py: the file does not exist"),
    "a name with a nul": ("a\0b.py", None, "the file does not exist"),
    "no such attribute": ("{}:Grip", device("T.T"), "it has no attribute Grip. Try: Gripper"),
    "no such inner attribute": ("{}:Gripper.x.y", device("T.T"), "it has no attribute Gripper.x.y. Try: Gripper"),
    "nothing at all in it": ("{}:Gripper", "width = 1\n", "it has no attribute Gripper"),
    "a module that breaks": ("{}:Gripper", "x = 1\nraise OSError('no port')\n", "OSError: no port (mod_wrong.py:2)"),
    "a module that ends": ("{}", "import sys\nsys.exit('bye')\n", "SystemExit: bye (mod_wrong.py:2)"),
    "no Python": ("{}", "class Gripper(:\n", "SyntaxError: invalid syntax (mod_wrong.py:1)"),
    "no text": ("{}", "\0", "null bytes"),
    "a module that needs another": ("{}", "import nobody_has_this\n", "No module named 'nobody_has_this' (mod_wrong.py:1)"),
    "another class": ("{}:Lamp", "class Lamp:\n    pass\n", "not a Device or Provider: <class 'mod_wrong.Lamp'>"),
    "a value": ("{}:width", "width = 3.5\n", "not a Device or Provider: 3.5"),
    "a function of something else": ("{}:make", "def make():\n    return 'x' * 9999\n", "not a Device or Provider: 'xxx"),
    "a coroutine": ("{}:make", "async def make():\n    pass\n", "not a Device or Provider: <function make"),
    "a class with arguments": ("{}", CLASS + "def __init__(self, port, speed=1): pass\n", "G(port, speed=1) requires arguments. Try: a function"),
    "a function with arguments": ("{}:make", "def make(port: str) -> None:\n    pass\n", "requires arguments"),
    "a class that breaks": ("{}", CLASS + "def __init__(self): raise OSError('no port')\n", "OSError: no port (mod_wrong.py:3)"),
    "an attribute that breaks": ("{}:x", "def __getattr__(name): return 1 / 0\n", "ZeroDivisionError: division by zero (mod_wrong.py:1)"),
    "several classes": ("{}", device("T.T") + device("T.U", kind="Pump"), "it defines several classes. Try: one of Gripper, Pump"),
    "no class of its own": ("{}", "from orinkit import Device, Provider\n", "it defines no subclass of Device or Provider"),
    "no name": ("{}", CLASS + "pass\n", "it has no provider_names, so clients could not connect"),
    "a name that is no tuple": ("{}", CLASS + "provider_names = 'T.T'\n", "provider_names must be a tuple of names"),
    "names that are none": ("{}", CLASS + "provider_names = 5\n", "not iterable"),
    "names that break": ("{}", CLASS + "provider_names = property(lambda self: 1 / 0)\n", "ZeroDivisionError: division by zero"),
}  # fmt: skip


@pytest.mark.parametrize("which", WRONG)
def test_wrong_targets(tmp_path, which):
    target, source, said = WRONG[which]
    path = tmp_path / "mod_wrong.py"
    if source is not None:
        path.write_text(source, encoding="utf-8")
    with pytest.raises(ProviderLoadFailed) as caught:
        load(target.replace("{}", str(path)))
    text = str(caught.value)
    assert said in text
    assert len(text) < 800
    assert "\n" not in text


def test_a_module_that_failed_is_imported_again(tmp_path):
    path = write(tmp_path / "mod_mended.py", "raise OSError\n")
    with pytest.raises(ProviderLoadFailed):
        load(path)
    write(tmp_path / "mod_mended.py", device("Test.Mended"))
    assert names(load(path)) == ["Test.Mended"]


def test_a_directory_is_not_a_file(tmp_path):
    (tmp_path / "dir.py").mkdir()
    with pytest.raises(ProviderLoadFailed, match="the file does not exist"):
        load(str(tmp_path / "dir.py"))


def test_ctrl_c_in_a_module_propagates(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        load(write(tmp_path / "mod_interrupted.py", "raise KeyboardInterrupt\n"))


def test_the_error_suggests_a_file_with_the_name_of_the_module(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "mod_here.py", device("Test.Here"))
    with pytest.raises(
        ProviderLoadFailed, match=r"neither a module nor a provider mod_here exists; .* Try: mod_here.py:Class"
    ):
        load("mod_here:Gripper")


def test_a_name_that_cannot_be_added(site):
    source = "import orinkit\nclass G(orinkit.Device):\n    provider_names = property(lambda self: ['Test.Own'])\n"
    install(site, "my-gripper", f"{GRIPPER} = pkg_g", pkg_g=source)
    with pytest.raises(ProviderLoadFailed, match=f"{GRIPPER} = pkg_g: AttributeError"):
        load(GRIPPER)


PYTHONS_OWN = ("Error", "SystemExit", "null", "No module", "iterable")


@pytest.mark.parametrize(
    "which", [which for which, (*_, said) in WRONG.items() if not any(word in said for word in PYTHONS_OWN)]
)
def test_wrong_targets_in_japanese(tmp_path, which):
    target, source, said = WRONG[which]
    i18n.use("ja")
    path = tmp_path / "mod_wrong.py"
    if source is not None:
        path.write_text(source, encoding="utf-8")
    with pytest.raises(ProviderLoadFailed) as caught:
        load(target.replace("{}", str(path)))
    assert said not in str(caught.value)
    assert any("ぁ" <= sign <= "ん" for sign in str(caught.value))


# --- the tutorial -----------------------------------------------------------------------------------------------------


def test_the_gripper_of_the_tutorial_has_thirty_lines():
    [gripper] = [block.text for block in blocks(PAGE) if "class Gripper(Device)" in block.text]
    assert gripper == next(block.text for block in blocks(PAGE) if block.language == "python")
    assert len(gripper.strip().split("\n")) <= 30


def test_the_package_of_the_tutorial_is_found_by_name(site):
    gripper = next(block.text for block in blocks(PAGE) if block.language == "python")
    project = tomllib.loads(next(block.text for block in blocks(PAGE) if block.language == "toml"))["project"]
    entries = "\n".join(f"{name} = {value}" for name, value in project["entry-points"]["orinkit.providers"].items())
    install(site, project["name"], entries, my_gripper=gripper)
    assert Installed(GRIPPER, "my-gripper 1.0", "my_gripper:Gripper") in installed()
    with (
        orinkit.serve(load_installed(), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider=GRIPPER) as controller,
    ):
        assert controller.execute("Move", [29.0, 1000]) == 1.0
        assert controller.variable("WIDTH").value == 29.0
