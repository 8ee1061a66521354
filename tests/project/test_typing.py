"""Type checking of user programs: results are inferred from the table of functions, and wrong calls are rejected.

Each program is checked by mypy with the project's own settings. A line that ends in ``# reveals TYPE`` must reveal
that type; one that ends in ``# rejects TEXT`` must be an error with that text; any other error fails the test.

The Python blocks of the README and of each how-to are checked in the same way, as one program per page, in which a name may be
assigned anew.
"""

from __future__ import annotations

import os
import pydoc
import re
import subprocess
import sys

import pytest

import orinkit
from orinkit import aio
from support.pages import blocks
from support.paths import ROOT

pytest.importorskip("mypy")

RAW = """
from decimal import Decimal

import numpy as np

import orinkit
from orinkit import Variant, VarType, functions


{async_}def raw(client: {client}) -> None:
    handle = {await_}client.call(functions.controller_connect, "", "CaoProv.DENSO.VRC", "localhost", "")
    reveal_type(handle)  # reveals int
    {await_}client.call(functions.robot_move, 3, 1, "P1", "")
    reveal_type({await_}client.call(functions.robot_move, 3, 1, "P1", ""))  # reveals None
    reveal_type({await_}client.call(functions.robot_get_name, handle))  # reveals str
    reveal_type({await_}client.call(functions.robot_get_attribute, handle))  # reveals int
    reveal_type({await_}client.call(functions.variable_get_value, handle))  # reveals Any
    reveal_type({await_}client.call(functions.service_stop))  # reveals None
    {await_}client.call(functions.service_start)
    {await_}client.call(functions.service_start, None)
    {await_}client.call(functions.service_start, option="WDT=400")
    {await_}client.call(functions.robot_move, handle, interpolation=2, pose=[1.0, 2.0, 3.0], option="NEXT")
    {await_}client.call(functions.robot_drive, handle, 1, 5)
    {await_}client.call(functions.robot_execute, handle, "CurPos")
    {await_}client.call(functions.variable_put_value, handle, Variant(VarType.I2, 5))
    {await_}client.call(functions.variable_put_value, handle, [[1.0, None], "J", b"x", Decimal(1)])
    {await_}client.call(functions.variable_put_value, handle, np.zeros(8))
    {await_}client.call(functions.variable_put_value, handle, np.float32(1))

    {await_}client.call(functions.robot_move, 3, "P", "P1", "")  # rejects "str"; expected "int"
    {await_}client.call(functions.robot_move, "3", 1, "P1", "")  # rejects "str"; expected "int"
    {await_}client.call(functions.robot_move, 3, 1, "P1", 5)  # rejects "int"; expected "str"
    {await_}client.call(functions.robot_move, 3, 1)  # rejects Missing positional argument "pose"
    {await_}client.call(functions.robot_move, 3)  # rejects Missing positional arguments
    {await_}client.call(functions.robot_move, 3, 1, "P1", "", 5)  # rejects Too many arguments
    {await_}client.call(functions.robot_move, 3, 1, "P1", speed=5)  # rejects Unexpected keyword argument "speed"
    {await_}client.call(functions.robot_speed, 3, -1, "fast")  # rejects "str"; expected "float"
    {await_}client.call(functions.variable_put_value, 3, {{"a": 1}})  # rejects "dict[str, int]"
    {await_}client.call(functions.variable_put_value, 3, {{1, 2}})  # rejects "set[int]"
    {await_}client.call(functions.service_start, 400)  # rejects "int"; expected "str | None"
    {await_}client.call("Robot_Move", 3, 1, "P1", "")  # rejects "str"; expected "Function
    name: int = {await_}client.call(functions.robot_get_name, handle)  # rejects str
"""

OBJECTS = """
import orinkit
from orinkit import P, {module}


{async_}def objects() -> None:
    {async_}with {connect}("tcp://127.0.0.1:5007", timeout=1.0) as controller:
        reveal_type(controller)  # reveals {prefix}Controller
        variable = {await_}controller.variable("I1")
        reveal_type(variable)  # reveals {prefix}Variable
        reveal_type({await_}variable.get_value())  # reveals Any
        reveal_type({await_}variable.get_microsecond())  # reveals int
        {await_}variable.put_value(5)
        {await_}variable.put_tag([1.0, "x"])
        reveal_type({await_}controller.variable_names())  # reveals list[str]
        reveal_type({await_}controller.execute("ClearError"))  # reveals Any
        robot = {await_}controller.robot()
        reveal_type(robot)  # reveals {prefix}Robot
        reveal_type({await_}robot.move(1, "@E P1", "NEXT"))  # reveals None
        reveal_type({await_}robot.get_name())  # reveals str
        reveal_type({await_}controller.message())  # reveals {prefix}Message | None
        reveal_type(({await_}controller.errors())[0].code)  # reveals int
        {async_}with {await_}controller.task("Pro1") as task:
            {await_}task.start(2)
            {await_}task.start("continuous")
            {await_}task.stop()
            reveal_type({await_}task.wait(1.0))  # reveals TaskStatus

        pose = P(400, 0, 300, 180, 0, 180, 5)
        reveal_type({await_}robot.move(pose, "@E", speed=20, wait=False))  # reveals {prefix}Motion
        reveal_type({await_}robot.move_l("P1"))  # reveals {prefix}Motion
        reveal_type({await_}robot.drive({{1: 10, 2: -5.5}}, absolute=True))  # reveals {prefix}Motion
        reveal_type({await_}robot.drive(1, 10.0))  # reveals None
        reveal_type({await_}robot.to_joints(pose))  # reveals J
        reveal_type({await_}robot.get_position())  # reveals P

        {await_}robot.move(1)  # rejects No overload variant of "move"
        {await_}robot.move(1, "P1", speed=5)  # rejects No overload variant of "move"
        {await_}robot.move(pose, sped=5)  # rejects No overload variant of "move"
        {await_}robot.move_l(pose, sped=5)  # rejects Unexpected keyword argument "sped"
        {await_}robot.move_l(pose, speed="fast")  # rejects "str"; expected "float"
        {await_}robot.move_l([1.0, 2.0])  # rejects "list[float]"; expected "P | T | J | V | Target | str"
        {await_}controller.variable(1)  # rejects "int"; expected "str"
        {await_}controller.variabel("I1")  # rejects has no attribute "variabel"
        {await_}variable.put_value({{1: 2}})  # rejects "dict[int, int]"
    orinkit.connect()  # rejects Missing positional argument "url"
    orinkit.connect("tcp://127.0.0.1", timout=1.0)  # rejects Unexpected keyword argument "timout"
"""

PROPERTIES = """
import orinkit


def properties(controller: orinkit.Controller) -> None:
    variable = controller.variable("I1")
    reveal_type(variable.value)  # reveals Any
    reveal_type(variable.tag)  # reveals Any
    reveal_type(controller.variable("I1").tag)  # reveals Any
    reveal_type(variable.help)  # reveals str
    reveal_type(variable.name)  # reveals str
    reveal_type(variable.attribute)  # reveals int
    reveal_type(variable.microsecond)  # reveals int
    variable.value = [1.0, 2.0]
    variable.tag = "x"
    variable.id = 5
    controller.file("Pro1.pcs").value = "text"

    robot = controller.robot()
    reveal_type(robot.position)  # reveals P
    reveal_type(robot.joints)  # reveals J
    reveal_type(robot.moving)  # reveals bool
    robot.ext_speed = 50
    robot.tool = 1
    with robot.arm(keep=True), robot.motor():
        for fraction in robot.move("P1", wait=False):
            reveal_type(fraction)  # reveals float
    reveal_type(controller.task("Pro1").status)  # reveals TaskStatus
    reveal_type(controller.file("Pro1.pcs", create=True).text)  # reveals str
    controller.file("a.bin").data = b"x"

    robot.joints = robot.joints  # rejects read-only
    robot.tool = "Tool1"  # rejects expression has type "str"
    controller.file("a.txt").text = b"x"  # rejects expression has type "bytes"
    variable.value = {1: 2}  # rejects expression has type "dict[int, int]"
    variable.help = "x"  # rejects read-only
    variable.microsecond = 5  # rejects read-only
"""

SYNC = {
    "async_": "",
    "await_": "",
    "client": "orinkit.Client",
    "module": "connect",
    "connect": "orinkit.connect",
    "prefix": "",
}
ASYNC = {
    "async_": "async ", "await_": "await ", "client": "orinkit.aio.AsyncClient", "module": "aio",
    "connect": "await aio.connect", "prefix": "Async",
}  # fmt: skip
PROGRAMS = {
    "raw_sync": RAW.format(**SYNC),
    "raw_async": RAW.replace("import orinkit\n", "import orinkit.aio\n", 1).format(**ASYNC),
    "objects_sync": OBJECTS.format(**SYNC),
    "objects_async": OBJECTS.format(**ASYNC),
    "properties_sync": PROPERTIES,
}
PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs" / "howto").glob("*.md"))]
REDEFINES = ["--allow-redefinition-new", "--local-partial-types"]  # the blocks of a page are one program


def module_of(page: str) -> str:
    """Return the name of the module made from a page."""
    return "page_" + re.sub(r"\W", "_", page.removesuffix(".md")).lower()


def program_of(page: str) -> str:
    """Return the Python blocks of a page as one program, each line with the number that it has in the page."""
    lines = [""] * (ROOT / page).read_text(encoding="utf-8").count("\n")
    for block in blocks(page):
        if block.language == "python":
            text = re.sub(r"(?m)^from __future__ .*$", "", block.text).split("\n")
            lines[block.line - 1 : block.line - 1 + len(text)] = text
    return "\n".join(lines)


def programs() -> dict[str, str]:
    """Return all programs to check, by the name of their module."""
    saved = {block.saved: block.text for page in PAGES for block in blocks(page) if block.saved}
    assert not saved.keys() & {f"{name}.py" for name in PROGRAMS}
    pages = {module_of(page): program_of(page) for page in PAGES}
    return {**PROGRAMS, **{name.removesuffix(".py"): text for name, text in saved.items()}, **pages}


@pytest.fixture(scope="module")
def verdict(tmp_path_factory):
    """Return the findings of mypy in all programs, by file and line, from a single run, because starting mypy is slow.

    Findings in the library are not among them: ``make types`` checks it, without the options of the programs.
    """
    folder = tmp_path_factory.mktemp("programs")
    modules = programs()
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    # fmt: off
    command = [
        sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache" / "programs"),
        "--follow-imports", "silent", "--no-error-summary", "--hide-error-context", "--show-error-codes",
        *REDEFINES, *(f"{name}.py" for name in modules),
    ]
    # fmt: on
    environment = {**os.environ, "MYPYPATH": str(ROOT / "src")}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    said: dict[tuple[str, int], list[str]] = {}
    for line in done.stdout.splitlines():
        place = re.match(r"(\w+)\.py:(\d+): (.*)", line)
        assert place, done.stdout
        said.setdefault((place[1], int(place[2])), []).append(place[3])
    return said


@pytest.mark.parametrize("name", PROGRAMS)
def test_results_are_inferred_and_wrong_calls_rejected(verdict, name):
    wrong = []
    for number, line in enumerate(PROGRAMS[name].splitlines(), 1):
        said = verdict.get((name, number), [])
        if "# reveals " in line:
            wanted = line.partition("# reveals ")[2]
            shown = [re.sub(r"builtins\.|orinkit(\.\w+)+\.", "", each) for each in said]
            good = shown == [f'note: Revealed type is "{wanted}"']
        elif "# rejects " in line:
            wanted = line.partition("# rejects ")[2]
            good = any(each.startswith("error: ") and wanted in each for each in said)
        else:
            good = not said
        if not good:
            wrong.append(f"{number}: {line.strip()}\n    mypy: {said}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("page", PAGES)
def test_the_programs_of_the_documents_have_no_type_errors(verdict, page):
    name = module_of(page)
    wrong = [f"{page}:{line}: {each}" for (module, line), said in verdict.items() if module == name for each in said]
    assert not wrong, "\n".join(wrong)


def test_saved_programs_of_the_documents_have_no_type_errors(verdict):
    known = {*PROGRAMS, *map(module_of, PAGES)}
    assert not {place: said for place, said in verdict.items() if place[0] not in known}


# --- what help() shows ------------------------------------------------------------------------------------------------

OPTIONS = "speed: 'float' = ..., accel: 'float' = ..., decel: 'float' = ..., time: 'float' = ..., wait: 'bool' = True"


@pytest.mark.parametrize(("kind", "result"), [(orinkit.Robot, "Motion"), (aio.AsyncRobot, "AsyncMotion")])
def test_help_shows_the_arguments_of_a_motion(kind, result):
    shown = pydoc.plain(pydoc.render_doc(kind))
    for signature in (
        f"move(self, pose: 'PoseLike', mark: 'str | PassMark' = '', *, {OPTIONS}) -> '{result}'",
        f"move_l(self, pose: 'PoseLike', mark: 'str | PassMark' = '', *, {OPTIONS}) -> '{result}'",
        f"drive(self, axes: 'Mapping[int, float]', mark: 'str | PassMark' = '', *, absolute: 'bool' = False, {OPTIONS})",
    ):
        assert signature in shown


@pytest.mark.parametrize("module", [orinkit, aio])
def test_public_names_belong_to_the_public_module(module):
    for name in module.__all__:
        public = getattr(module, name)
        if getattr(public, "__name__", "") == name:
            assert public.__module__ == module.__name__
    assert repr(orinkit.Robot) == "<class 'orinkit.Robot'>"
    assert "connect in module orinkit\n" in pydoc.plain(pydoc.render_doc(orinkit.connect))
