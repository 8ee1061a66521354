"""Words of programs that are commands of the provider guide: each one works, or is refused by its name."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8.pacscript.functions import FUNCTIONS
from orinkit.virtual.rc8.pacscript.keywords import REFUSED, STARTERS
from orinkit.virtual.rc8.pacscript.robot_words import STATEMENTS, VALUES
from orinkit.virtual.rc8.robot.shared_commands import SHARED_COMMANDS
from support.cell import Cell
from support.provider_guide import robot_execute_commands

OTHER_SPELLING = {
    "DriveEx": "Drive", "DriveAEx": "DriveA", "SetToolDef": "Tool", "SetWorkDef": "Work", "GetToolDef": "ToolPos",
    "GetWorkDef": "WorkPos", "GetBaseDef": "BasePos", "GetAreaDef": "AreaPos", "SetAreaDef": None, "SetBaseDef": None,
}  # fmt: skip
"""Commands of clients that have another name in programs, or none."""


@pytest.fixture
def cell():
    cell = Cell()
    yield cell
    cell.close()


def run(cell: Cell, text: str, cycles: int = 1500) -> None:
    cell.rc8.state.files.write("Words.pcs", f"Sub Main\n{text}\nEnd Sub\n".encode())
    task = cell.controller.get_task("Words", "")
    cell.run(task.start(1, ""))
    for _ in range(cycles):
        cell.clock.advance(PERIOD)
        if not task.task.running:
            return


def get(cell: Cell, name: str):
    return cell.controller.get_variable(name, "").get_value().plain


@pytest.mark.parametrize("command", robot_execute_commands())
def test_a_command_of_the_guide_is_a_word_or_refused_by_name(command):
    word = OTHER_SPELLING.get(command, command)
    if word is None:
        return
    key = word.lower()
    assert (key in STARTERS) + (key in FUNCTIONS) + (key in REFUSED) == 1


def test_a_row_is_all_that_a_word_needs():
    for word, row in (STATEMENTS | VALUES).items():
        assert row.name in SHARED_COMMANDS, word
    assert {word.lower() for word in STATEMENTS} <= set(STARTERS)
    assert {word.lower() for word in VALUES} <= set(FUNCTIONS)


@pytest.mark.parametrize(
    "word",
    ["SyncTimeStart", "SyncTimeEnd", "SyncMoveStart 1", "AddPathPoint 1, P1", "Draw L, V(0, 0, 9)", "I1 = CurPosEx()"],
)
def test_words_that_are_refused(cell, word):
    assert cell.code_of(lambda: run(cell, word)) == hresult.SYNTAX_ERROR
    assert variant(cell.controller.execute("GetErrorLog", variant(0))).plain[12].endswith("is not supported")


@pytest.mark.parametrize(
    ("statement", "name", "value"),
    [
        ("F1 = CurSpd", "F1", 30), ("F1 = CurAcc()", "F1", 40), ("F1 = CurDec", "F1", 50), ("F1 = CurJSpd()", "F1", 30),
        ("F1 = CurExtSpd", "F1", 80), ("F1 = CurExtAcc", "F1", 64), ("F1 = MPS(150)", "F1", 10), ("F1 = DPS(36)", "F1", 10),
        ("F1 = DPS(1, 42.5)", "F1", 10), ("F1 = RPM(1, 425 / 60)", "F1", 10), ("I1 = MotionComplete()", "I1", -1),
        ("I1 = MotionComplete(-1, 1)", "I1", -1), ("I1 = GetAreaEnabled(3)", "I1", 0), ("I1 = WorkAttribute(1)", "I1", 0),
        ("SpeedMode 2\nI1 = CurSpeedMode", "I1", 2), ("SetAreaEnabled 3, True\nI1 = GetAreaEnabled(3)", "I1", -1),
        ("Tool 2, P(1, 2, 3, 4, 5, 6)\nP1 = ToolPos(2)", "P1", [1, 2, 3, 4, 5, 6, -1]),
        ("T1 = TInv(T(10, 0, 0, 1, 0, 0, 0, 0, -1, 1))", "T1", [0, -10, 0, 1, 0, 0, 0, 0, -1, 1]),
        ("T1 = TNorm(T(1, 2, 3, 0, 2, 0.5, 0, 0, 3, 5))", "T1", [1, 2, 3, 0, 1, 0, 0, 0, 1, 5]),
    ],
)  # fmt: skip
def test_values(cell, statement, name, value):
    run(cell, f"TakeArm\nSpeed 30\nAccel 40, 50\nExtSpeed 80\n{statement}\nGiveArm")
    assert not cell.rc8.state.faults.code, cell.rc8.state.faults.message
    assert get(cell, name) == pytest.approx(value, abs=1e-4)


MOVE = "TakeArm\nMove P, J(60, 45, 90, 0, 45, 0), S = 20, Next\n"


def test_arrive_and_motion_skip(cell):
    run(
        cell,
        MOVE + "Arrive 50\nJ1 = DestJnt()\nJ2 = CurJnt()\nI1 = MotionComplete()\nMotionSkip\nJ3 = CurJnt()\n"
        "Wait MotionComplete(-1, 1)\nI2 = 1\nGiveArm",
    )
    assert not cell.rc8.state.faults.code, cell.rc8.state.faults.message
    assert (get(cell, "I1"), get(cell, "I2")) == (0, 1)
    assert get(cell, "J1")[0] == pytest.approx(60)
    assert 28 < get(cell, "J2")[0] < 35
    assert get(cell, "J2")[0] <= get(cell, "J3")[0] < 50
    assert cell.arm.queue.joints[0] < 50


def test_the_accuracy_of_a_program(cell):
    run(
        cell,
        "TakeArm\nErAlw True, 1, 30\nCrtMotionAllow True, 2, 3\nEncMotionAllow True, 1.5\nMotionTimeout True, 5600\n"
        "SingularAvoid 2\nEncMotionAllowJnt False, 7\nI1 = 1\nDelay 100000\n",
        20,
    )
    accuracy = cell.arm.accuracy
    assert get(cell, "I1") == 1
    assert (accuracy.deviation, accuracy.position, accuracy.posture, accuracy.encoder) == ({1: 30}, 2, 3, 1.5)
    assert cell.arm.speeds.avoid_singular


@pytest.mark.parametrize(("word", "code"), [
    ("ErAlw True, 1, 30", hresult.ARM_NOT_TAKEN), ("Arrive 50", hresult.ARM_NOT_TAKEN), ("MotionSkip", hresult.ARM_NOT_TAKEN),
    ("TakeArm\nArrive 0", hresult.VALUE_OUT_OF_RANGE), ("TakeArm\nMotionSkip -1, 4", hresult.VALUE_OUT_OF_RANGE),
    ("TakeArm\nSingularAvoid 1", hresult.VALUE_OUT_OF_RANGE), ("F1 = MPS(2000)", hresult.VALUE_OUT_OF_RANGE),
])  # fmt: skip
def test_errors(cell, word, code):
    run(cell, word, 50)
    assert cell.rc8.state.faults.code == code
    assert cell.controller.execute("GetCurErrorCount", variant(None)) == 1
