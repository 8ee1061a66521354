"""The robot's system variables: names, types and shapes, rights and conditions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import Permission
from support.cell import ADDRESS, Cell
from support.strategies import variants

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
R8, R4, I4, BOOL, BSTR = ARRAY | VarType.R8, VarType.R4, VarType.I4, VarType.BOOL, VarType.BSTR

# name: type, number of elements, the command that returns the same value
TABLE: dict[str, tuple[int, int, str]] = {
    **{f"@{source}_POSITION": (R8, 7, name + "Pos") for source, name in (("CURRENT", "Cur"), ("HIGH_CURRENT", "HighCur"), ("DEST", "Dest"))},
    **{f"@{source}_ANGLE": (R8, 8, name + "Jnt") for source, name in (("CURRENT", "Cur"), ("HIGH_CURRENT", "HighCur"), ("DEST", "Dest"))},
    **{f"@{source}_TRANS": (R8, 10, name + "Trn") for source, name in (("CURRENT", "Cur"), ("HIGH_CURRENT", "HighCur"), ("DEST", "Dest"))},
    "@SERVO_ON": (BOOL, 0, ""),
    "@BUSY_STATUS": (BOOL, 0, ""),
    "@TYPE": (I4, 0, ""),
    "@TYPE_NAME": (BSTR, 0, "GetRobotTypeName"),
    "@CURRENT_TOOL": (I4, 0, "CurTool"),
    "@CURRENT_WORK": (I4, 0, "CurWork"),
    "@SPEED": (R4, 0, "CurSpd"),
    "@ACCEL": (R4, 0, "CurAcc"),
    "@DECEL": (R4, 0, "CurDec"),
    "@JSPEED": (R4, 0, "CurJSpd"),
    "@JACCEL": (R4, 0, "CurJAcc"),
    "@JDECEL": (R4, 0, "CurJDec"),
    "@EXTSPEED": (R4, 0, "CurExtSpd"),
    "@EXTACCEL": (R4, 0, "CurExtAcc"),
    "@EXTDECEL": (R4, 0, "CurExtDec"),
}  # fmt: skip
WRITABLE = {
    "@SERVO_ON": True, "@CURRENT_TOOL": 3, "@CURRENT_WORK": 2, "@EXTSPEED": 40.0, "@EXTACCEL": 30.0, "@EXTDECEL": 20.0,
    "@SPEED": 50.0, "@ACCEL": 60.0, "@DECEL": 70.0, "@JSPEED": 51.0, "@JACCEL": 61.0, "@JDECEL": 71.0,
}  # fmt: skip
"""Writable variables, each with a value to write."""


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


def read(cell: Cell, name: str) -> Any:
    return cell.robot.get_variable(name, "").get_value().plain


def write(cell: Cell, name: str, value: Any) -> Any:
    return cell.robot.get_variable(name, "").put_value(variant(value))


def code(cell: Cell, name: str, value: Any) -> int:
    return cell.code_of(lambda: write(cell, name, value))


def test_the_table_is_complete(cell):
    assert set(cell.robot.get_variable_names("")) == {*TABLE, "Tool*", "Work*", "Area*"}


@pytest.mark.parametrize("name", TABLE)
@pytest.mark.parametrize("written", [str, str.lower, str.title, " {}  ".format])
def test_types_and_shapes(cell, name, written):
    cell.robot.speed(-1, 37)
    cell.robot.accelerate(-1, 38, 39)
    cell.robot.speed(0, 27)
    cell.robot.accelerate(0, 28, 29)
    cell.execute("ExtSpeed", [57, 58, 59])
    cell.robot.change("Tool4")
    cell.robot.change("Work5")
    cell.move(1, "J(40, 30, 95, 5, 50, 20)", "NEXT")
    cell.trace(10)
    vt, count, command = TABLE[name]
    got = cell.robot.get_variable(written(name), "").get_value()
    assert got.type == vt
    if count:
        assert len(got.value) == count
        assert all(type(each) is float and math.isfinite(each) for each in got.value)
    if command:
        assert got == variant(cell.robot.execute(command, variant(None)))


def test_values_without_a_command(cell):
    assert [read(cell, name) for name in ("@SERVO_ON", "@BUSY_STATUS", "@TYPE")] == [True, False, 0]
    cell.move(1, "J(40, 30, 95, 5, 50, 20)", "NEXT")
    assert read(cell, "@BUSY_STATUS") is True
    cell.run(cell.robot.hold(""))
    assert read(cell, "@BUSY_STATUS") is True
    cell.run(cell.robot.halt(""))
    assert read(cell, "@BUSY_STATUS") is False
    cell.execute("Motor", 0)
    assert read(cell, "@SERVO_ON") is False
    cell.execute("Motor", [1, 1])
    cell.trace(60)
    assert read(cell, "@SERVO_ON") is False  # the motor is still being switched on


@pytest.mark.parametrize(
    "name", ["", "@", "CURRENT_ANGLE", "@CURRENT", "P1", "@MODE", "@CURRENT_ANGLE1", "x" * 100_000, "@ＳＰＥＥＤ"]
)
def test_unknown_names(cell, name):
    assert cell.code_of(lambda: cell.robot.get_variable(name, "")) == hresult.E_CAO_OBJECT_NOTFOUND


@pytest.mark.parametrize("name", TABLE)
def test_writable_variables(cell, name):
    variable = cell.robot.get_variable(name, "")
    assert variable.attribute == (3 if name in WRITABLE else 1)
    assert name in variable.name.upper()
    assert "VT_" in variable.help
    if name in WRITABLE:
        assert code(cell, name, WRITABLE[name]) == 0
        assert read(cell, name) == WRITABLE[name]
    else:
        for value in (1, None, [0.0] * 7, "x"):
            assert code(cell, name, value) == hresult.E_CAO_NOT_WRITABLE


@pytest.mark.parametrize("name", TABLE)
def test_rights(name):
    cell = Cell(Permission("rw", {ADDRESS: "r", "10.0.0.1": "none"}))
    assert cell.robot.get_variable(name, "").attribute == 1
    read(cell, name)
    assert code(cell, name, WRITABLE.get(name, 1)) == hresult.NO_WRITE_RIGHT
    hidden = cell.connect("10.0.0.1").get_robot("", "").get_variable(name, "")
    for call in (hidden.get_value, hidden.get_date_time, hidden.get_microsecond):
        assert cell.code_of(call) == hresult.NO_READ_RIGHT
    assert cell.code_of(lambda: hidden.put_value(variant(WRITABLE.get(name, 1)))) == hresult.NO_WRITE_RIGHT
    cell.close()


def test_the_time_stamp_is_that_of_the_last_read(cell):
    variable = cell.robot.get_variable("@SPEED", "")
    first = variable.get_date_time()
    cell.clock.advance(1.25)
    assert variable.get_date_time() == first
    variable.get_value()
    assert (variable.get_date_time() - first).total_seconds() == 1.25
    assert variable.get_microsecond() == 250_000


# --- writing ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [True, 1, -1, "1", 1.0, [True], Variant(VarType.I2, 1), [1]])
def test_servo_on_completes_when_the_motor_is_on(value):
    cell = Cell(motor=False)
    assert cell.cycles(write(cell, "@SERVO_ON", value)) * PERIOD == pytest.approx(1.0)
    assert cell.arm.motor.on
    cell.close()


@pytest.mark.parametrize("value", [False, 0, "0", 0.0, [False], Variant(VarType.I2, 0)])
def test_servo_off(cell, value):
    assert cell.cycles(write(cell, "@SERVO_ON", value)) == 38
    assert not cell.arm.motor.on


@pytest.mark.parametrize("value", [5.0, "7", [3], Variant(VarType.I2, 5), Variant(VarType.UI1, 1), 0])
@pytest.mark.parametrize("name", ["@CURRENT_TOOL", "@CURRENT_WORK"])
def test_changing_tool_and_work(cell, name, value):
    cell.execute("SetToolDef", [5, "P(0, 0, 10, 0, 0, 0)"])
    assert code(cell, name, value) == 0
    assert read(cell, name) == int(variant(value).plain[0] if isinstance(value, list) else variant(value).plain)


@pytest.mark.parametrize("value", [50, "50", 50.0, [50.0], Variant(VarType.I2, 50), Variant(R4, 50)])
def test_the_external_speed_squares_the_accelerations(cell, value):
    cell.execute("ExtSpeed", [80, 10, 20])
    assert code(cell, "@EXTSPEED", value) == 0
    assert [read(cell, name) for name in ("@EXTSPEED", "@EXTACCEL", "@EXTDECEL")] == [50, 25, 25]


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("@SERVO_ON", 2, hresult.DISP_E_OVERFLOW), ("@SERVO_ON", "on", hresult.DISP_E_TYPEMISMATCH),
        ("@SERVO_ON", None, hresult.DISP_E_TYPEMISMATCH), ("@SERVO_ON", [1, 0], hresult.DISP_E_TYPEMISMATCH),
        ("@SERVO_ON", 0.5, hresult.E_INVALIDARG), ("@CURRENT_TOOL", 64, hresult.TOOL_NUMBER_OUT_OF_RANGE),
        ("@CURRENT_TOOL", -1, hresult.TOOL_NUMBER_OUT_OF_RANGE), ("@CURRENT_TOOL", 1.5, hresult.E_INVALIDARG),
        ("@CURRENT_TOOL", "Tool1", hresult.DISP_E_TYPEMISMATCH), ("@CURRENT_WORK", 8, hresult.WORK_NUMBER_OUT_OF_RANGE),
        ("@CURRENT_WORK", math.nan, hresult.E_INVALIDARG), ("@EXTSPEED", 0, hresult.VALUE_OUT_OF_RANGE),
        ("@EXTSPEED", 100.5, hresult.VALUE_OUT_OF_RANGE), ("@EXTSPEED", math.inf, hresult.E_INVALIDARG),
        ("@EXTSPEED", [1, 2], hresult.DISP_E_TYPEMISMATCH),
    ],
)  # fmt: skip
def test_invalid_values(cell, name, value, expected):
    before = {each: read(cell, each) for each in TABLE}
    assert f"{code(cell, name, value):08X}" == f"{expected:08X}"
    cell.trace(50)
    assert {each: read(cell, each) for each in TABLE} == before


def _taken(cell: Cell) -> None:
    cell.execute("GiveArm")
    cell.connect().get_robot("", "").execute("TakeArm", variant(0))


def _moving(cell: Cell) -> None:
    cell.move(1, "J(90, 45, 90, 0, 45, 0)", "SPEED=1,NEXT")
    cell.trace(5)


CONDITIONS = {
    "taken": (_taken, {
        "@SERVO_ON": hresult.ARM_NOT_TAKEN, "@CURRENT_TOOL": hresult.ARM_NOT_TAKEN, "@CURRENT_WORK": hresult.ARM_NOT_TAKEN,
        "@EXTSPEED": hresult.ARM_NOT_TAKEN,
    }),
    "not taken": (lambda cell: cell.execute("GiveArm"), {
        "@SERVO_ON": 0, "@CURRENT_TOOL": hresult.ARM_NOT_TAKEN, "@CURRENT_WORK": hresult.ARM_NOT_TAKEN, "@EXTSPEED": 0,
    }),
    "moving": (_moving, {
        "@SERVO_ON": 0, "@CURRENT_TOOL": hresult.TOOL_WORK_CHANGE_WHILE_MOVING,
        "@CURRENT_WORK": hresult.TOOL_WORK_CHANGE_WHILE_MOVING, "@EXTSPEED": 0,
    }),
    "manual": (lambda cell: cell.rc8.pendant.mode(1), {
        "@SERVO_ON": hresult.AUTO_MODE_REQUIRED, "@CURRENT_TOOL": 0, "@CURRENT_WORK": 0, "@EXTSPEED": 0,
    }),
    "emergency stop": (lambda cell: cell.rc8.pendant.emergency_stop(), {
        "@SERVO_ON": hresult.EMERGENCY_STOP_ON, "@CURRENT_TOOL": 0, "@CURRENT_WORK": 0, "@EXTSPEED": 0,
    }),
    "token": (lambda cell: cell.rc8.pendant.token("io"), {
        "@SERVO_ON": hresult.START_RIGHT_NOT_ETHERNET, "@CURRENT_TOOL": 0, "@CURRENT_WORK": 0, "@EXTSPEED": 0,
    }),
}  # fmt: skip


_OF_SPEEDS = {
    "taken": hresult.ARM_NOT_TAKEN, "not taken": hresult.ARM_NOT_TAKEN, "moving": hresult.SPEED_CHANGE_WHILE_MOVING,
}  # fmt: skip
for _state, (_, _expected) in CONDITIONS.items():
    _expected |= dict.fromkeys(("@EXTACCEL", "@EXTDECEL"), _expected["@EXTSPEED"])
    _expected |= {name: _OF_SPEEDS.get(_state, 0) for name in WRITABLE if name not in _expected}


@pytest.mark.parametrize("state", CONDITIONS)
@pytest.mark.parametrize("name", WRITABLE)
def test_conditions(cell, state, name):
    """The conditions are those of Motor, Change, ExtSpeed, Speed and Accelerate."""
    change, expected = CONDITIONS[state]
    change(cell)
    before = read(cell, name)
    assert f"{code(cell, name, WRITABLE[name]):08X}" == f"{expected[name]:08X}"
    assert read(cell, name) == (before if expected[name] else WRITABLE[name])


def test_the_motor_is_switched_off_after_the_motion(cell):
    _moving(cell)
    assert code(cell, "@SERVO_ON", False) == 0
    assert not cell.arm.busy
    assert not cell.arm.motor.on


@pytest.fixture(scope="module")
def shared() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


@settings(max_examples=300, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(name=st.sampled_from([*TABLE, *WRITABLE, *WRITABLE]), value=variants())
def test_any_value_is_accepted_or_rejected(shared, name, value):
    try:
        result = shared.robot.get_variable(name, "").put_value(value)
    except CallError:
        return
    assert name in WRITABLE
    if isinstance(result, Deferred):
        shared.run(result)
        shared.execute("Motor", 1)
