"""Every state x every commanding function: the code of a refusal. The expectation is the table in the docs."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from typing import Any

import pytest

from orinkit.core.errors import CallError
from orinkit.values.variant import variant
from orinkit.virtual.rc8 import Permission
from orinkit.virtual.rc8.robot.conditions import NEEDS
from support.cell import ADDRESS, Cell
from support.paths import ROOT

DOCUMENT = ROOT / "docs" / "howto" / "robot.md"
POSE = "J(10, 45, 90, 0, 45, 0)"
FAR = "J(90, 45, 90, 0, 45, 0)"


def _execute(command: str, parameter: Any = None) -> Callable[[Cell], Any]:
    return lambda cell: cell.robot.execute(command, variant(parameter))


def _sync_move_start(cell: Cell) -> Any:
    """Take the arm of the second robot, if this is allowed, and call SyncMoveStart."""
    with contextlib.suppress(CallError):
        cell.run(cell.controller.get_robot("", "ID=1").execute("TakeArm", variant([0, 0])))
    return cell.robot.execute("SyncMoveStart", variant([1]))


CALLS: dict[str, Callable[[Cell], Any]] = {
    "TakeArm": _execute("TakeArm", [0, 0]),
    "GiveArm": _execute("GiveArm"),
    "Motor on": _execute("Motor", [1, 0]),
    "Motor off": _execute("Motor", [0, 0]),
    "Move": lambda cell: cell.robot.move(1, variant(POSE), "NEXT"),
    "Approach": _execute("Approach", [1, "P(350, 0, 300, 180, 0, 180, 5)", "@0 20", "NEXT"]),
    "Depart": _execute("Depart", [2, "@0 20", "NEXT"]),
    "Draw": _execute("Draw", [2, "V(0, 0, 20)", "NEXT"]),
    "DriveEx": _execute("DriveEx", ["@0 (1,5)", "NEXT"]),
    "DriveAEx": _execute("DriveAEx", ["@0 (1,5)", "NEXT"]),
    "Rotate": lambda cell: cell.robot.rotate(variant("XY"), 5.0, variant("V(0, 0, 0)"), "NEXT"),
    "RotateH": _execute("RotateH", ["@0 5", "NEXT"]),
    "ArchMove": _execute("ArchMove", ["P(350, 50, 300, 180, 0, 180, 5)", 20.0]),
    "GoHome": lambda cell: cell.robot.go_home(),
    "Halt": lambda cell: cell.robot.halt(""),
    "Hold": lambda cell: cell.robot.hold(""),
    "Unhold": lambda cell: cell.robot.unhold(""),
    "SyncTimeStart": _execute("SyncTimeStart"),
    "SyncTimeEnd": _execute("SyncTimeEnd"),
    "SyncMoveStart": _sync_move_start,
    "SyncMoveEnd": _execute("SyncMoveEnd"),
    "Arrive": _execute("Arrive", 50.0),
    "MotionSkip": _execute("MotionSkip", [-1, 0]),
    "CrtMotionAllow": _execute("CrtMotionAllow", [True, 1.0]),
    "EncMotionAllow": _execute("EncMotionAllow", [True, 1.0]),
    "EncMotionAllowJnt": _execute("EncMotionAllowJnt", [False, 7]),
    "ErAlw": _execute("ErAlw", [False, 0]),
    "MotionTimeout": _execute("MotionTimeout", [True, 1000]),
    "SingularAvoid": _execute("SingularAvoid", 2),
    "SpeedMode": _execute("SpeedMode", 1),
    "Speed": lambda cell: cell.robot.speed(-1, 50.0),
    "Accelerate": lambda cell: cell.robot.accelerate(-1, 50.0, 50.0),
    "ExtSpeed": _execute("ExtSpeed", [50.0]),
    "Change": lambda cell: cell.robot.change("Tool1"),
    "SetToolDef": _execute("SetToolDef", [1, "P(0, 0, 100, 0, 0, 0)"]),
    "SetWorkDef": _execute("SetWorkDef", [1, "P(100, 0, 0, 0, 0, 0)"]),
    "SetBaseDef": _execute("SetBaseDef", [1, "P(0, 0, 100, 0, 0, 0)"]),
    "ChangeScene": _execute("ChangeScene", [1, 1]),
    "SetAreaDef": _execute("SetAreaDef", [1, "P(0, 0, 0, 0, 0, 0)", "V(1, 1, 1)", -1, -1]),
    "SetArea": _execute("SetArea", 1),
    "ResetArea": _execute("ResetArea", 1),
    "SetAreaEnabled": _execute("SetAreaEnabled", [1, False]),
    "PayLoad": _execute("PayLoad", [1000]),
    "ForceSensorPayLoad": _execute("ForceSensorPayLoad", [1000]),
    "GrvCtrl": _execute("GrvCtrl", 1),
    "GrvOffset": _execute("GrvOffset", 0),
    "CurLmt": _execute("CurLmt", [0, 0]),
    "Zforce": _execute("Zforce", 1e9),
    "HighPathAccuracy": _execute("HighPathAccuracy", 0),
    "ForceCtrl": _execute("ForceCtrl", 0),
    "ForceChangeTable": _execute("ForceChangeTable", 1),
    "ForceParam": _execute("ForceParam", [1, 0, [0.0] * 6]),
    "ForceSensor": _execute("ForceSensor", 0),
    "ForceWaitCondition": _execute("ForceWaitCondition", [-1, -1]),
    "AutoCal": _execute("AutoCal"),
    "slvChangeMode on": _execute("slvChangeMode", 0x102),
    "slvChangeMode off": _execute("slvChangeMode", 0),
    "slvMove": _execute("slvMove", [0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0]),
    "slvSendFormat": _execute("slvSendFormat", 0x20),
    "slvRecvFormat": _execute("slvRecvFormat", [0x11, 1]),
    "Task_Start": lambda cell: cell.controller.get_task("Pro1", "").start(1, ""),
    "RunAllTsr": lambda cell: cell.controller.execute("RunAllTsr", variant(None)),
    "Task_Stop": lambda cell: cell.controller.get_task("Pro1", "").stop(0, ""),
}


def _ready(cell: Cell) -> None:
    cell.take()


def _manual(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.mode(1)


def _emergency(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.emergency_stop()


def _protective(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.protective_stop()


def _error(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.raise_error(0x83204071)


def _motor_off(cell: Cell) -> None:
    cell.take()
    cell.run(cell.robot.execute("Motor", variant([0, 0])))


def _no_arm(cell: Cell) -> None:
    """Motor on, the arm not taken."""


def _taken(cell: Cell) -> None:
    other = cell.connect().get_robot("Arm", "")
    other.execute("TakeArm", variant([0, 0]))


def _token(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.token("tp")


def _address(cell: Cell) -> None:
    cell.take()
    cell.rc8.pendant.token("ethernet:192.168.0.9")


def _moving(cell: Cell) -> None:
    cell.take()
    cell.robot.move(1, variant(FAR), "SPEED=1,NEXT")
    cell.clock.advance(1.0)
    assert cell.rc8.state.arm.busy


def _held(cell: Cell) -> None:
    _moving(cell)
    cell.run(cell.robot.hold(""))


def _slave(cell: Cell) -> None:
    """This client has turned slave mode on."""
    cell.take()
    cell.execute("slvChangeMode", 0x002)


def _slave_elsewhere(cell: Cell) -> None:
    """Another client has turned slave mode on."""
    other = cell.connect().get_robot("Arm", "")
    for command, parameter in (("TakeArm", [0, 0]), ("slvChangeMode", 0x002)):
        cell.run(other.execute(command, variant(parameter)))


def _read_only(cell: Cell) -> None:
    """The permission of the client's address is "r"."""


STATES: dict[str, Callable[[Cell], None]] = {
    "ready": _ready,
    "manual": _manual,
    "e-stop": _emergency,
    "protective": _protective,
    "error": _error,
    "motor off": _motor_off,
    "no arm": _no_arm,
    "arm taken": _taken,
    "token TP": _token,
    "token elsewhere": _address,
    "read-only": _read_only,
    "moving": _moving,
    "held": _held,
    "slave mode": _slave,
    "slave elsewhere": _slave_elsewhere,
}


def documented() -> dict[tuple[str, str], int]:
    """Read the table of the docs: (function, state) to code, 0 if it is accepted."""
    rows = [line for line in DOCUMENT.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    head = next(index for index, line in enumerate(rows) if line.startswith("| function \\ state"))
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in rows[head:]]
    states = cells[0][1:]
    table: dict[tuple[str, str], int] = {}
    for row in cells[2:]:
        if row[0] not in CALLS:
            break
        for state, text in zip(states, row[1:], strict=True):
            table[row[0], state] = int(text, 16) if re.fullmatch("[0-9A-F]{8}", text) else 0
    return table


def outcome(function: str, state: str) -> int:
    """Put a cell into a state and call the function; return the code of the refusal, or 0."""
    second = {"second_model": "VS-060"} if function.startswith("Sync") else {}
    cell = Cell(Permission("rw", {ADDRESS: "r"}) if state == "read-only" else None, **second)
    try:
        STATES[state](cell)
        cell.run(CALLS[function](cell), 120.0)
    except CallError as error:
        return error.code
    finally:
        cell.rc8.close()
    return 0


TABLE = documented() if DOCUMENT.exists() else {}


def test_the_table_has_every_function_and_every_state():
    assert set(CALLS) == set(NEEDS)
    assert set(TABLE) == {(function, state) for function in CALLS for state in STATES}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("function", CALLS)
def test_refusals_are_those_of_the_docs(function, state):
    wanted = TABLE[function, state]
    assert f"{outcome(function, state):08X}" == f"{wanted:08X}"


@pytest.mark.parametrize("state", STATES)
def test_what_is_refused_moves_nothing(state):
    """In each state, call everything that is refused; the arm stays as it was."""
    cell = Cell(Permission("rw", {ADDRESS: "r"}) if state == "read-only" else None, second_model="VS-060")
    STATES[state](cell)
    joints, tickets = cell.rc8.state.arm.queue.joints, len(cell.rc8.state.arm.queue.tickets)
    for function, call in CALLS.items():
        if TABLE[function, state]:
            with pytest.raises(CallError):
                cell.run(call(cell))
    assert (cell.rc8.state.arm.queue.joints, len(cell.rc8.state.arm.queue.tickets)) == (joints, tickets)
    cell.rc8.close()
