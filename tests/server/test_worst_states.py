"""No call blocks a server, regardless of its arguments and of the state of the controller.

The controller has 10,000 files, stored paths of 5,000 points, programs of the largest size, and clients with 1,000
objects. What is measured is described in :mod:`support.watching`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.core import hresult
from orinkit.server.threaded import Server
from orinkit.values.poses import P, Target
from orinkit.values.variant import VarType
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.objects.controller_commands import COMMANDS
from orinkit.virtual.rc8.objects.extension import EXTENSION_COMMANDS
from orinkit.virtual.rc8.objects.robot_commands import ROBOT_COMMANDS
from orinkit.virtual.rc8.pacscript.code import MAX_STATEMENTS
from orinkit.virtual.rc8.pacscript.lexer import MAX_SOURCE
from orinkit.virtual.rc8.robot.motor import MotorState
from support.peers import RawClient
from support.waiting import until
from support.watching import Watch, never_blocks, watched

FILES = 9_900
POINTS = 5_000
OBJECTS = 998
LARGE = MAX_SOURCE - 100
STATEMENTS = ("I1 = 1", "I1 = (I1+1) * 2 - 3 + I2 + I3 + I4", "If I1 = 1 Then I1 = 2 Else I1 = 3", "Goto a{0}\na{0}:")
PROGRAMS = {
    "lines": "  Do\n    Move L, @P {down}\n    Move L, @P {up}\n  Loop\n",
    "path": "  Move S, 1, Next\n  Move S, 1\n",
    "zigzag": "  Move S, 2\n",
    "poses": "  Do\n    I1 = OutRange(P(1000, 0, 500, 0, 0, 0, -3))\n  Loop\n",
    "arrays": "  Do\n    Call Fill\n  Loop\nEnd Sub\nSub Fill\n  Dim a(99000)\n  a(1) = 1\n",
}


def call(name: str) -> int:
    return BY_NAME[name].id


class Client(RawClient):
    """A client with a controller object and a robot object."""

    def __init__(self, server: Server) -> None:
        super().__init__(server.url)
        self.controller = self.get("Controller_Connect", "", "CaoProv.DENSO.VRC", "", "")
        self.robot = self.get("Controller_GetRobot", self.controller, "Arm", "")

    def get(self, function: str, *arguments: Any) -> Any:
        """Make a call; return its result or its return code."""
        return self.ask(call(function), *arguments)

    def do(self, command: str, parameter: Any = None) -> Any:
        """Execute a command of the robot."""
        return self.get("Robot_Execute", self.robot, command, parameter)

    def file(self, name: str, option: str = "") -> int:
        """Return the handle of a file, or the return code."""
        return int(self.get("Controller_GetFile", self.controller, name, option))

    def program(self, source: str) -> int:
        """Write a program and return the handle of its task."""
        assert self.get("File_PutValue", self.file("p.pcs", "@Create=1"), source) is None
        return int(self.get("Controller_GetTask", self.controller, "p", ""))


@pytest.fixture(scope="module")
def rc8(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualRC8]:
    state = tmp_path_factory.mktemp("state")
    fill(state / "files" / "many")
    device = VirtualRC8(motor=True, language="en", state=state, samples=False)
    start = pose(device)
    with device.guard:
        for number in range(POINTS):
            far = number / 100
            rest = (start.rx, start.ry, start.rz, float(start.fig))
            straight = (start.x + far, start.y, start.z - far, *rest)
            zigzag = (start.x + far - 25, start.y + number % 2, start.z, *rest)
            for path, point in ((1, straight), (2, zigzag)):
                device.state.moves.add_path_point(path, Target("P", point))
    yield device
    device.close()


@pytest.fixture(scope="module")
def server(rc8) -> Iterator[Server]:
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield server


@pytest.fixture
def client(server) -> Iterator[Client]:
    with Client(server) as client:
        yield client


def fill(folder: Path) -> None:
    """Create files directly on the disk, which is faster than through the server."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(FILES):
        (folder / f"file{number:05d}.pcs").touch()


def pose(rc8: VirtualRC8) -> P:
    """Return the home pose."""
    with rc8.guard:
        return P(*rc8.state.arm.space.position(rc8.state.arm.model.home))


def reset(rc8: VirtualRC8, client: Client) -> None:
    """Bring the arm to its home pose, with the motor on, and give it to a client."""
    client.get("Robot_Halt", client.robot, "")
    rc8.clear_errors()
    with rc8.guard:
        rc8.state.arm.motor.state = MotorState.ON
        rc8.state.arm.place(rc8.state.arm.model.home)
    assert client.do("TakeArm", [0, 0]) is None


def test_planning(rc8, server, client):
    start = pose(rc8)

    def near(dx: float, dz: float, mark: str = "") -> str:
        return f"{mark}{P(start.x + dx, start.y, start.z + dz, start.rx, start.ry, start.rz, start.fig)}"

    def zigzag(mark: str) -> list[str]:
        return [near(60 * (number % 2), -50 * (number % 2), mark) for number in range(1, 10)]

    motions: tuple[tuple[str, str, Sequence[Any]], ...] = (
        ("path", "Robot_Move", (4, 1, "NEXT")),
        ("path at which joints cannot follow", "Robot_Move", (4, 2, "NEXT")),
        ("slow path that passes", "Robot_Move", (4, "@1000 1", "NEXT, TIME=3600000")),
        ("lines", "Robot_Move", (2, zigzag(""), "NEXT")),
        ("lines that pass", "Robot_Move", (2, zigzag("@1000 "), "NEXT")),
        ("slow lines that pass", "Robot_Move", (2, zigzag("@P "), "NEXT, TIME=3600000")),
        ("PTP", "Robot_Move", (1, zigzag("@1000 "), "NEXT")),
        ("arc", "Robot_Move", (3, [near(20, -20), near(0, -40)], "NEXT")),
        ("rotation", "Robot_Rotate", ("XY", 36_000.0, near(0, 0), "NEXT")),
        ("approach", "Robot_Execute", ("Approach", [2, near(0, -50), "@P 40", "NEXT"])),
        ("depart", "Robot_Execute", ("Depart", [2, "@P 40", "NEXT"])),
        ("hand", "Robot_Execute", ("RotateH", ["@P 90", "NEXT"])),
        ("axes", "Robot_Execute", ("DriveEx", [[1, 10.0], [2, -10.0], "NEXT"])),
        ("path after another motion", "Robot_Move", (4, "@P 1", "NEXT")),
    )

    def act(watch: Watch) -> None:
        for watch.label, function, arguments in motions:
            reset(rc8, client)
            client.get(function, client.robot, *arguments)
        client.get("Robot_Move", client.robot, 4, "@1000 1", "NEXT")

    never_blocks(server, act)


@pytest.mark.soak
def test_files(rc8, server, client):
    deleted = client.get("Controller_GetTask", client.controller, "many\\file00000", "")
    folder = rc8.state.files.root / "many"
    (folder / "file00000.pcs").unlink()
    calls: tuple[tuple[str, Callable[[], Any], Any], ...] = (
        ("does not exist", lambda: client.file("many\\other"), hresult.FILE_NOT_FOUND),
        ("other case", lambda: client.file("MANY\\FILE00001.PCS") < 0x8000_0000, True),
        (
            "task",
            lambda: client.get("Controller_GetTask", client.controller, "Many\\File00002", "") < 0x8000_0000,
            True,
        ),
        ("deleted task", lambda: client.get("Task_Execute", deleted, "GetStatus", None), 0),
        ("create", lambda: client.file("many\\new.txt", "@Create=1") < 0x8000_0000, True),
        ("names", lambda: len(client.get("File_GetFileNames", client.file("many"), "")), FILES),
        ("tasks", lambda: len(client.get("Controller_GetTaskNames", client.controller, "")), FILES - 1),
        ("move", lambda: client.get("File_Move", client.file("many"), "moved", ""), None),
        ("move back", lambda: client.get("File_Move", client.file("moved"), "many", ""), None),
        ("not empty", lambda: client.get("File_Delete", client.file("many"), ""), hresult.E_ACCESSDENIED),
        ("delete", lambda: client.get("File_Delete", client.file("many"), "@Recursive=1"), None),
    )

    def act(watch: Watch) -> None:
        for watch.label, make, expected in calls:
            assert make() == expected, watch.label
        fill(folder)
        (folder / "file00000.pcs").unlink()

    never_blocks(server, act)


@pytest.mark.parametrize("statement", STATEMENTS)
@pytest.mark.parametrize("size", [8_000, pytest.param(LARGE, marks=pytest.mark.soak)])
def test_programs_are_loaded(server, client, size, statement):
    count = min(size // (len(statement) + 1), MAX_STATEMENTS // 3 - 3)
    versions = iter(range(1000))

    def act(watch: Watch) -> None:
        watch.label = f"{size} {statement}"
        body = "".join(f"{statement.format(number)}\n" for number in range(count))
        task = client.program(f"Sub Main\n{body}End Sub\n' {next(versions)}\n")  # not compiled before
        assert client.get("Task_Start", task, 1, "") is None
        assert client.get("Task_Stop", task, 4, "") is None

    never_blocks(server, act)


@pytest.mark.soak
@pytest.mark.parametrize("name", list(PROGRAMS))
def test_programs_run(rc8, server, client, name):
    start = pose(rc8)
    down, up = (P(start.x, start.y, start.z - far, start.rx, start.ry, start.rz, start.fig) for far in (50, 0))
    task = client.program(f"Sub Main\n  Takearm\n{PROGRAMS[name].format(down=down, up=up)}End Sub\n")

    def act(watch: Watch) -> None:
        watch.label = name
        reset(rc8, client)
        assert client.do("GiveArm") is None
        assert client.get("Task_Start", task, 1, "") is None
        began = rc8.state.cycles.number
        until(lambda: rc8.state.cycles.number > began + 20 or not rc8.state.tasks.running)
        client.get("Task_Stop", task, 4, "")
        until(lambda: not rc8.state.arm.busy)

    never_blocks(server, act)


@pytest.mark.soak
def test_a_client_with_many_objects(server):
    def act(watch: Watch) -> None:
        with Client(server) as client:
            client.do("TakeArm", [0, 0])
            for number in range(1, OBJECTS):
                client.get("Controller_Connect", f"Controller{number}", "CaoProv.DENSO.VRC", "", "")
            for watch.label, function, *arguments in (
                ("without a name", "Controller_Connect", "", "CaoProv.DENSO.VRC", "", ""),
                ("one too many", "Controller_Connect", "", "CaoProv.DENSO.VRC", "", ""),
                ("release", "Service_Stop"),
            ):
                client.get(function, *arguments)

    never_blocks(server, act)


@pytest.mark.soak
def test_an_event_takes_the_same_time_for_any_number_of_clients():
    rc8 = VirtualRC8(language="en")
    clients = [rc8.connect("", "", "", orinkit.cao.provider.ClientInfo()) for _ in range(100_000)]
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:

        def act(watch: Watch) -> None:
            for watch.label, on in (("pressed", True), ("released", False)):
                rc8.emergency_stop(on)

        never_blocks(server, act)
    assert all(client.events for client in clients)


@pytest.mark.soak
def test_the_time_in_which_others_wait_for_a_thread_of_the_controller(rc8, server, client):
    """While motions are planned, files deleted and programs compiled, other clients are served."""
    stopped = threading.Event()

    def busy() -> None:
        with Client(server) as other:
            task = other.program("Sub Main\n" + "I1 = (I1+1) * 2 - 3 + I2 + I3 + I4\n" * 3_000 + "End Sub\n")
            while not stopped.is_set():
                other.get("Task_Start", task, 1, "")
                other.get("Task_Stop", task, 4, "")
                other.get("File_GetFileNames", other.file("many"), "")

    reset(rc8, client)
    thread = threading.Thread(target=busy)
    thread.start()
    try:

        def act(watch: Watch) -> None:
            for watch.label in ("planning",) * 3:
                client.get("Robot_Move", client.robot, 4, 2, "NEXT")
                reset(rc8, client)

        never_blocks(server, act)
    finally:
        stopped.set()
        thread.join()


# --- all functions and commands (make soak) ---------------------------------------------------------------------------

NAMES = (
    "\\" * 1024, "a\\" * 512, "é" * 1024, "(" * 1024, " " * 1024, "I" + "0" * 1000, "*" * 1024, "@" * 1024, "\u0301" * 1024,
    "Robot." * 170, "Tool" + "1" * 900, "P1," * 341,
)  # fmt: skip
OPTIONS = (
    "," * 4096, "=" * 4096, "a=b," * 1024, "a=(" * 1300, '"' * 4096, "@Create=1," * 400, "NEXT," * 800, "S=1," * 1000,
    "a=" + " " * 4000,
)  # fmt: skip
VALUES = (
    "(" * 4096, "P(1,2,3,4,5,6,7)," * 240, "@P P1," * 680, " " * 4094 + "P1", "@E " + "1" * 4000, "(1,1)," * 170,
    ["P1," * 1365] * 64, [1.0] * 64, ["@P " + " " * 900 + "10"] * 64, [[1, 1.0]] * 64,
)  # fmt: skip


@pytest.mark.soak
@pytest.mark.parametrize("interface", ["Controller", "Robot", "Variable", "File", "Task", "Extension", "Command"])
def test_no_argument_of_any_function_blocks_the_server(rc8, server, client, interface):
    commands = {"Controller": COMMANDS, "Robot": ROBOT_COMMANDS, "Extension": EXTENSION_COMMANDS}.get(interface, ("x",))
    reset(rc8, client)
    client.do("StartLog")
    for number in range(1_200):
        rc8.raise_error(0x8000_0000 + number % 7, "x" * 1000)
    rc8.clear_errors()

    def act(watch: Watch) -> None:
        with Client(server) as other:
            found = {
                "Controller": lambda: other.controller,
                "Robot": lambda: other.robot,
                "Variable": lambda: other.get("Controller_GetVariable", other.controller, "S1", ""),
                "File": lambda: other.file("a.pcs", "@Create=1"),
                "Task": lambda: other.program("Sub Main\nEnd Sub\n"),
                "Extension": lambda: other.get("Controller_GetExtension", other.controller, "Hand0", ""),
                "Command": lambda: other.get("Controller_GetCommand", other.controller, "Robot.Motor", ""),
            }[interface]()
            for function in FUNCTIONS.values():
                if function.interface != interface or function.releases or not function.arguments:
                    continue
                for command in commands if function.name.endswith("_Execute") else ("",):
                    for place, value in worst(function.arguments):
                        given = [argument(each.vt) for each in function.arguments]
                        given[0] = found
                        if command:
                            given[1] = command
                        given[place] = value
                        watch.label = f"{function.name} {command} {place} {str(value)[:20]}"
                        made = other.ask(function.id, *given)
                        if function.creates and made < 0x8000_0000:
                            other.get(f"{function.creates}_Release", made)

    never_blocks(server, act)


def argument(vt: int) -> Any:
    return {VarType.BSTR: "", VarType.VARIANT: None}.get(VarType(vt), 1)


def worst(arguments: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Yield the places of arguments, each with a value that takes long to process."""
    for place, each in enumerate(arguments):
        if each.vt == VarType.BSTR:
            yield from ((place, value) for value in (OPTIONS if each.name == "option" else NAMES))
        elif each.vt == VarType.VARIANT:
            yield from ((place, value) for value in VALUES)


def test_a_lock_that_is_held_too_long_is_detected():
    rc8 = VirtualRC8()
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server, watched(server, margin=1.0) as watch, rc8.guard:
        end = time.thread_time() + 0.2
        while time.thread_time() < end:
            pass
    assert any("lock held" in what for _, _, what in watch.slow)
