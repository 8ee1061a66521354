"""The extended commands of the robot: results, accepted parameters, and errors for invalid ones."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, trusted, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import Permission
from orinkit.virtual.rc8.objects.hand_commands import ROBOT_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.objects.robot_commands import NOT_SIMULATED, OF_CONTROLLER, ROBOT_COMMANDS
from orinkit.virtual.rc8.objects.sync_commands import SYNC_COMMANDS
from orinkit.virtual.rc8.robot.motor import MotorState
from support.cell import ADDRESS, Cell
from support.strategies import variants

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
P = "P(330, 120, 300, 180, 0, 180, 5)"
SEED = [364.15999231107196, 0.0, 278.53553390593277, 180.0, 0.0, 180.0, 5.0]
"""The home pose of a VS-050 (reference 3.3)."""

R4, R8, I4, BSTR, BOOL, EMPTY = VarType.R4, VarType.R8, VarType.I4, VarType.BSTR, VarType.BOOL, VarType.EMPTY
NUMBERS = ARRAY | R8


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


# command: a parameter, the type of the result, its number of elements
ANSWERS: dict[str, tuple[Any, int, int]] = {
    "TakeArm": ([0, 0], EMPTY, 0),
    "GiveArm": (None, EMPTY, 0),
    "TakeArmState": (0, I4, 0),
    "Motor": ([1, 0], EMPTY, 0),
    "ExtSpeed": ([50.0], EMPTY, 0),
    **dict.fromkeys(("CurSpd", "CurAcc", "CurDec", "CurJSpd", "CurJAcc", "CurJDec"), (None, R4, 0)),
    **dict.fromkeys(("CurExtSpd", "CurExtAcc", "CurExtDec"), (None, R4, 0)),
    "CurTool": (None, I4, 0),
    "CurWork": (None, I4, 0),
    **{f"{source}Pos": (None, NUMBERS, 7) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}Jnt": (None, NUMBERS, 8) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}Trn": (None, NUMBERS, 10) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}Fig": (None, I4, 0) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}PosEx": (None, NUMBERS, 8) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}JntEx": (None, NUMBERS, 9) for source in ("Cur", "HighCur", "Dest")},
    **{f"{source}TrnEx": (None, NUMBERS, 11) for source in ("Cur", "HighCur", "Dest")},
    "J2P": ("J(0, 45, 90, 0, 45, 0)", NUMBERS, 7),
    "J2T": ("J(0, 45, 90, 0, 45, 0)", NUMBERS, 10),
    "P2J": (P, NUMBERS, 8),
    "P2T": (P, NUMBERS, 10),
    "T2J": ("T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)", NUMBERS, 8),
    "T2P": ("T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)", NUMBERS, 7),
    "Dev": ([P, "P(10, 0, 0, 0, 0, 0)"], NUMBERS, 7),
    "DevH": ([P, "P(10, 0, 0, 0, 0, 0)"], NUMBERS, 7),
    "OutRange": (P, I4, 0),
    "TMul": ("T(1, 2, 3, 0, 1, 0, 0, 0, 1), T(1, 2, 3, 0, 1, 0, 0, 0, 1)", NUMBERS, 10),
    "TInv": ("T(1, 2, 3, 0, 1, 0, 0, 0, 1)", NUMBERS, 10),
    "TNorm": ("T(1, 2, 3, 0, 1, 0, 0, 0, 1)", NUMBERS, 10),
    "MPS": (150.0, R4, 0),
    "RPM": ([1, 5.0], R4, 0),
    "DPS": ([1, 5.0], R4, 0),
    "Draw": ([2, "@0 V(0, 0, 10)"], EMPTY, 0),
    "ArchMove": ([P, 20.0, 5.0, 5.0], EMPTY, 0),
    "Arrive": ([50.0], EMPTY, 0),
    "CrtMotionAllow": ([True, 1.0, 1.0], EMPTY, 0),
    "EncMotionAllow": ([True, 1.0], EMPTY, 0),
    "EncMotionAllowJnt": ([False, 7], EMPTY, 0),
    "ErAlw": ([True, 1, 30.0], EMPTY, 0),
    "MotionTimeout": ([True, 5600], EMPTY, 0),
    "SingularAvoid": ([2], EMPTY, 0),
    "SpeedMode": ([3], EMPTY, 0),
    "CurSpeedMode": (None, I4, 0),
    **dict.fromkeys(OF_CONTROLLER, (None, EMPTY, 0)),
    "Approach": ([1, P, "@0 20"], EMPTY, 0),
    "Depart": ([1, "@0 20"], EMPTY, 0),
    "DriveEx": ("@0 (1, 10)", EMPTY, 0),
    "DriveAEx": ("@0 (1, 10)", EMPTY, 0),
    "RotateH": ("@0 10", EMPTY, 0),
    "MotionSkip": ([-1, 0], EMPTY, 0),
    "MotionComplete": ([-1, 0], BOOL, 0),
    "SetToolDef": ([1, "P(0, 0, 100, 0, 0, 0)"], EMPTY, 0),
    "GetToolDef": (1, NUMBERS, 6),
    "SetWorkDef": ([1, "P(0, 0, 100, 0, 0, 0)"], EMPTY, 0),
    "GetWorkDef": (1, NUMBERS, 7),
    "AddPathPoint": ([1, P], EMPTY, 0),
    "ClrPathPoint": (1, EMPTY, 0),
    "GetPathPointCount": (1, I4, 0),
    "GetSrvData": (2, NUMBERS, 8),
    "GetSrvJntData": ([4, 2], R4, 0),
    "WorkAttribute": (1, I4, 0),
    "SetBaseDef": ([1, "P(0, 0, 100, 0, 0, 0)"], EMPTY, 0),
    "GetBaseDef": (1, NUMBERS, 7),
    "ConvertPosWork": ([P, 1, 0], NUMBERS, 7),
    "SetAreaDef": ([1, "P(0, 0, 100, 0, 0, 0)", "V(10, 10, 10)", 128, 1], EMPTY, 0),
    "GetAreaDef": (1, NUMBERS, 34),
    "SetArea": (1, EMPTY, 0),
    "ResetArea": (1, EMPTY, 0),
    "AreaSize": (1, NUMBERS, 3),
    "GetAreaEnabled": (1, BOOL, 0),
    "SetAreaEnabled": ([1, True], EMPTY, 0),
    "CheckVirtualFence": ("J(0, 45, 90, 0, 45, 0)", I4, 0),
    "PayLoad": ([2000, "V(0, 0, 50)", "V(1, 1, 1)"], EMPTY, 0),
    "CurPayLoad": (None, VARIANT_ARRAY, 3),
    "ForceSensorPayLoad": ([2000, "V(0, 0, 50)"], EMPTY, 0),
    "CurForceSensorPayLoad": (None, VARIANT_ARRAY, 3),
    "GrvCtrl": ([1], EMPTY, 0),
    "GrvOffset": ([1], EMPTY, 0),
    "CurLmt": ([1, 2, 50.0], EMPTY, 0),
    "HighPathAccuracy": ([1], EMPTY, 0),
    "RobInfo": (0, I4, 0),
    "ForceCtrl": ([0], EMPTY, 0),
    "ForceParam": ([1, 0, [0.0] * 6], EMPTY, 0),
    "ForceValue": (0, NUMBERS, 6),
    "ForceSensor": (0, EMPTY, 0),
    "ForceWaitCondition": ([-1, -1], EMPTY, 0),
    "SetHandIO": ([48, 8, 4], EMPTY, 0),
    "GetHandIO": ([48, 4], I4, 0),
    "StartServoLog": (None, EMPTY, 0),
    "ClearServoLog": (None, EMPTY, 0),
    "StopServoLog": (None, EMPTY, 0),
    "GetCtrlLogMaxTime": (None, I4, 0),
    "SetCtrlLogMaxTime": (10, EMPTY, 0),
    "GetCtrlLogInterval": (None, I4, 0),
    "SetCtrlLogInterval": (8, EMPTY, 0),
    "AutoCal": (None, EMPTY, 0),
    "CurScene": (None, I4, 0),
    "CurSubScene": (None, I4, 0),
    "SceneInfo": (1, VARIANT_ARRAY, 4),
    "ChangeScene": (1, EMPTY, 0),
    "GetMechaButtonState": (0, I4, 0),
    "ClearMechaButtonState": (0, EMPTY, 0),
    "StartLog": (None, EMPTY, 0),
    "StopLog": (None, EMPTY, 0),
    "ClearLog": (None, EMPTY, 0),
    "GetLogCount": (None, I4, 0),
    "GetLogRecord": (0, VARIANT_ARRAY, 39),
    "GetRobotTypeName": (None, BSTR, 0),
    "slvChangeMode": (0, EMPTY, 0),
    "slvGetMode": (None, I4, 0),
    "slvGetLateness": ([0], NUMBERS, 3),
    "slvSendFormat": (0x20, EMPTY, 0),
    "slvRecvFormat": (1, EMPTY, 0),
}
NO_PARAMETER = [name for name, (parameter, _, _) in ANSWERS.items() if parameter is None]
ONE_NUMBER = [name for name, (parameter, _, _) in ANSWERS.items() if type(parameter) is int]


def answer(cell: Cell, name: str, parameter: Any) -> Variant:
    """Execute a command to its end and return the result as a VARIANT."""
    result = cell.robot.execute(name, variant(parameter))
    if isinstance(result, Deferred):
        cell.cycles(result)
        result = result.result()
    return variant(result)


def record(cell: Cell, cycles: int = 3) -> None:
    """Fill the control log."""
    cell.execute("StartLog")
    cell.trace(cycles)
    cell.execute("StopLog")


def test_every_command_is_in_the_table():
    """The others need what does not exist here: slave mode, a file, a point, a linear axis, force control, a second arm."""
    others = {"slvmove", "generatenonstoppath", "loadpathpoint", "getpathpoint", "zforce", "forcechangetable"}
    others |= {each.name.lower() for each in HAND_COMMANDS} | {name.lower() for name in SYNC_COMMANDS}
    assert {name.lower() for name in ANSWERS} == set(ROBOT_COMMANDS) - others
    assert not {name.lower() for name in NOT_SIMULATED} & set(ROBOT_COMMANDS)


@pytest.mark.parametrize("name", ANSWERS)
@pytest.mark.parametrize("write", [str.lower, str.upper, " {} ".format, str])
def test_the_type_of_results(cell, name, write):
    record(cell)
    parameter, vt, count = ANSWERS[name]
    got = answer(cell, write(name), parameter)
    assert got.type == vt
    if count:
        assert len(got.value) == count
        assert vt == VARIANT_ARRAY or all(type(each) is float and math.isfinite(each) for each in got.value)


@pytest.mark.parametrize("name", NO_PARAMETER)
@pytest.mark.parametrize("parameter", [None, "", 0, [], Variant(VarType.NULL), "514", [1, 2], Variant(VarType.I2, 7)])
def test_a_command_without_parameters_accepts_any(cell, name, parameter):
    assert answer(cell, name, parameter).type == ANSWERS[name][1]


@pytest.mark.parametrize("name", ONE_NUMBER)
def test_one_number_in_every_form(cell, name):
    record(cell)
    expected = answer(cell, name, ANSWERS[name][0])
    number = ANSWERS[name][0]
    for parameter in (
        str(number), [number], [str(number)], float(number), [float(number)], f" {number} ", Variant(VarType.I2, number),
        Variant(VarType.UI1, number), Variant(ARRAY | VarType.R4, [number]), [[number]], Variant(VARIANT_ARRAY, [variant(number)]),
    ):  # fmt: skip
        assert answer(cell, name, parameter) == expected


@pytest.mark.parametrize("name", [name for name in ONE_NUMBER if name != "TakeArmState"])
@pytest.mark.parametrize(
    "parameter", [None, "", [], "x", 1.5, [1, 2], math.nan, math.inf, 1e30, -1, "9" * 5000, [None]]
)
def test_invalid_numbers(cell, name, parameter):
    assert cell.code_of(lambda: cell.robot.execute(name, variant(parameter))) != 0


P1, P2 = "P(300, 0, 300, 180, 0, 180, 5)", "P(300, 50, 300, 180, 0, 180, 5)"
"""Two poses."""


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda cell: cell.execute("J2P", []), "an empty array is not a pose; expected 3 to 10 numbers"),
        (lambda cell: cell.execute("J2P", [P1, P2]), "expected 1 pose, got 2"),
        (lambda cell: cell.execute("DriveEx", [1]), "expected at least 1 pair of an axis and a value, got none"),
        (lambda cell: cell.execute("Draw", [1, ["V(1, 2, 3)", "V(1, 2, 3)"]]), "expected 1 vector, got 2"),
        (lambda cell: cell.execute("slvRecvFormat", [1, 0, 0]), "expected 1 or 2 values: the receive format"),
        (lambda cell: cell.execute("slvRecvFormat", None), "expected 1 or 2 values: the receive format"),
        (lambda cell: cell.execute("Approach", [1, P1]), "expected at least 3 parameters, got 2"),
        (lambda cell: cell.execute("MPS", [1, 2]), "got 2 parameters, expected 1"),
        (lambda cell: cell.move(3, P1), "an arc requires 2 poses, the via point and the end point; got 1"),
        (lambda cell: cell.move(3, [P1] * 3), "an arc requires 2 poses, the via point and the end point; got 3"),
        (lambda cell: cell.robot.rotate(variant("XY"), 1.0, variant([P1, P2]), ""), "expected 1 pose, got 2"),
        (lambda cell: cell.controller.execute("GetPublicValue", variant(["a"])), "expected 2 names"),
    ],
)
def test_a_wrong_number_of_elements_names_the_right_one(cell, call, text):
    with pytest.raises(CallError) as caught:
        call(cell)
    assert caught.value.code == hresult.E_INVALIDARG
    assert text in caught.value.detail


@pytest.mark.parametrize("name", NOT_SIMULATED)
def test_commands_that_are_not_simulated(cell, name):
    for written in (name, name.upper()):
        assert cell.code_of(lambda written=written: cell.execute(written)) == hresult.E_NOTIMPL


@pytest.mark.parametrize("name", ["", " ", "Fly", "Cur Pos", "CurPosition", "slvMode", "x" * 1_000_000, "現在位置"])
def test_an_unknown_command(cell, name):
    assert cell.code_of(lambda: cell.execute(name)) == hresult.E_INVALID_CMD_NAME


@pytest.mark.parametrize("name", ANSWERS)
def test_rights(name):
    """A client with the right to read cannot execute commands that write; one without rights cannot execute any."""
    cell = Cell(Permission("rw", {ADDRESS: "r", "10.0.0.1": "none"}))
    parameter, vt, _ = ANSWERS[name]
    reads = vt != EMPTY
    nothing = cell.connect("10.0.0.1").get_robot("", "")
    other = cell.connect("10.0.0.2").get_robot("", "")
    other.execute("StartLog", variant(None))
    cell.trace(2)
    refused = cell.code_of(lambda: cell.execute(name, parameter))
    assert refused == (0 if reads else hresult.NO_WRITE_RIGHT)
    refused = cell.code_of(lambda: nothing.execute(name, variant(parameter)))
    assert refused == (hresult.NO_READ_RIGHT if reads else hresult.NO_WRITE_RIGHT)
    cell.close()


# --- arm and motor ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "keeps"),
    [
        (None, False), ("", False), (0, False), ([0], False), ("0", False), ([0, 0], False), ("0,0", False), ([0, 1], True),
        ("0, 1", True), ([0.0, 1.0], True), (["0", "1"], True), ([0, True], True), ([0, False], False), ([31, 1], True),
    ],
)  # fmt: skip
def test_take_arm_keeps_or_resets(cell, parameter, keeps):
    cell.robot.speed(-1, 30)
    cell.robot.accelerate(0, 40, 50)
    cell.execute("ExtSpeed", [60, 70, 80])
    cell.robot.change("Tool5")
    cell.robot.change("Work2")
    cell.execute("TakeArm", parameter)
    names = ("CurSpd", "CurJSpd", "CurAcc", "CurJAcc", "CurJDec", "CurTool", "CurWork")
    assert [cell.execute(name) for name in names] == (
        [30, 30, 100, 40, 50, 5, 2] if keeps else [100, 100, 100, 100, 100, 0, 0]
    )
    assert [cell.execute(name) for name in ("CurExtSpd", "CurExtAcc", "CurExtDec")] == [60, 70, 80]


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        ([-1], hresult.VALUE_OUT_OF_RANGE), ([32], hresult.VALUE_OUT_OF_RANGE), ([0, 2], hresult.VALUE_OUT_OF_RANGE),
        ([0, 0, 0], hresult.E_INVALIDARG), ([0.5], hresult.E_INVALIDARG), ("Arm", hresult.DISP_E_TYPEMISMATCH),
        ([1e300], hresult.VALUE_OUT_OF_RANGE), ([[0, 1], 0], hresult.DISP_E_TYPEMISMATCH), (",", hresult.DISP_E_TYPEMISMATCH),
    ],
)  # fmt: skip
def test_take_arm_with_invalid_parameters(cell, parameter, code):
    cell.execute("GiveArm")
    assert f"{cell.code_of(lambda: cell.execute('TakeArm', parameter)):08X}" == f"{code:08X}"
    assert cell.arm.holder is None


def test_take_arm_state(cell):
    other = cell.connect().get_robot("", "")

    def state(robot: Any, *parameter: Any) -> Any:
        return robot.execute("TakeArmState", variant(*parameter or (None,)))

    assert [state(cell.robot, group) for group in (-1, 0, "-1", [0])] == [1, 1, 1, 1]
    assert [state(other, group) for group in (-1, 0)] == [0, 1]
    assert (state(cell.robot), state(other)) == (1, 0)
    cell.execute("GiveArm")
    assert [state(robot, group) for robot in (cell.robot, other) for group in (-1, 0)] == [0, 0, 0, 0]
    other.execute("TakeArm", variant(0))
    assert [state(robot, group) for robot in (cell.robot, other) for group in (-1, 0)] == [0, 1, 1, 1]


def test_a_second_robot_object_of_a_client_shares_the_arm(cell):
    second = cell.controller.get_robot("Other", "")
    assert second.execute("TakeArmState", variant(-1)) == 1
    second.execute("TakeArm", variant([0, 1]))
    assert cell.code_of(lambda: second.execute("DriveEx", variant("(1, 1)"))) == 0


def test_the_arm_is_released_with_the_last_robot_object(cell):
    second = cell.controller.get_robot("Other", "")
    cell.move(1, "J(90, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(12)
    second.release()
    assert cell.execute("TakeArmState", -1) == 1
    assert not cell.arm.stopping
    cell.robot.release()
    assert cell.execute("TakeArmState", 0) == 0
    assert cell.arm.stopping
    cell.trace(60)
    assert not cell.arm.busy


def test_the_arm_is_not_given_to_a_released_client(cell):
    """A client whose TakeArm waits for standstill is released before."""
    cell.move(1, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(12)
    cell.robot.release()
    leaving, staying = (cell.connect().get_robot("", "") for _ in range(2))
    first = leaving.execute("TakeArm", variant(0))
    second = staying.execute("TakeArm", variant(0))
    leaving.release()
    assert first.done()
    assert cell.code(first) == hresult.E_ABORT
    cell.run(second)
    assert staying.execute("TakeArmState", variant(-1)) == 1
    assert cell.code_of(lambda: staying.execute("DriveEx", variant("(1, 1)"))) == 0


def test_only_one_of_two_waiting_clients_gets_the_arm(cell):
    cell.move(1, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(12)
    cell.robot.release()
    robots = [cell.connect().get_robot("", "") for _ in range(2)]
    waiting = [robot.execute("TakeArm", variant(0)) for robot in robots]
    codes = sorted(cell.code(each) for each in waiting)
    assert codes == [0, hresult.ARM_NOT_TAKEN]
    assert sum(robot.execute("TakeArmState", variant(-1)) for robot in robots) == 1


def test_conditions_are_checked_before_waiting_for_the_arm(cell):
    cell.move(1, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(12)
    cell.robot.release()
    cell.rc8.pendant.token("tp")
    other = cell.connect().get_robot("", "")
    assert cell.code_of(lambda: other.execute("TakeArm", variant(0))) == hresult.START_RIGHT_NOT_ETHERNET
    assert cell.arm.stopping


ON = [1, [1], [1, 0], "1", "1,0", " 1 , 0 ", [True], True, 1.0, Variant(VarType.I2, 1), ["1", "0"], -1, [True, False]]
OFF = [0, [0], [0, 0], "0", "0,0", False, [False, 0], Variant(VarType.I2, 0), 0.0]


@pytest.mark.parametrize("parameter", ON)
def test_motor_on_takes_one_second(parameter):
    cell = Cell(motor=False)
    assert cell.cycles(cell.robot.execute("Motor", variant(parameter))) * PERIOD == pytest.approx(1.0)
    assert cell.arm.motor.on
    assert cell.run(cell.robot.execute("Motor", variant(parameter))) is None  # the motor is already on
    cell.close()


@pytest.mark.parametrize("parameter", OFF)
def test_motor_off_takes_a_third_of_a_second(cell, parameter):
    assert cell.cycles(cell.robot.execute("Motor", variant(parameter))) * PERIOD == pytest.approx(0.3, abs=PERIOD)
    assert cell.arm.motor.state is MotorState.OFF
    assert cell.code_of(lambda: cell.move(1, P)) == hresult.MOTOR_NOT_ON
    assert cell.cycles(cell.robot.execute("Motor", variant(parameter))) == 0


def test_motor_without_waiting():
    cell = Cell(motor=False)
    for parameter in ([1, 1], "1,1", [True, True]):
        assert cell.robot.execute("Motor", variant(parameter)) is None
        assert cell.arm.motor.state is MotorState.SWITCHING_ON
        cell.trace(125)
        assert cell.arm.motor.on
        assert cell.robot.execute("Motor", variant([0, 1])) is None
        cell.trace(40)
        assert cell.arm.motor.state is MotorState.OFF
    cell.close()


def test_motor_while_it_is_being_switched():
    cell = Cell(motor=False)
    first = cell.robot.execute("Motor", variant(1))
    cell.trace(60)
    assert cell.cycles(cell.robot.execute("Motor", variant(1))) == 65
    assert first.done()
    first = cell.robot.execute("Motor", variant(0))
    cell.trace(10)
    assert cell.cycles(cell.robot.execute("Motor", variant(0))) == 28
    cell.robot.execute("Motor", variant(1))
    cell.trace(60)
    broken = cell.robot.execute("Motor", variant(1))
    assert cell.cycles(cell.robot.execute("Motor", variant(0))) == 38
    assert cell.code(broken) == hresult.MOTOR_ON_FAILED
    cell.close()


def test_an_emergency_stop_ends_switching_off(cell):
    """The call succeeds, because the motor is off as requested."""
    going = cell.robot.execute("Motor", variant(0))
    cell.trace(10)
    cell.rc8.pendant.emergency_stop()
    assert going.done()
    assert cell.code(going) == 0
    assert cell.arm.motor.state is MotorState.OFF


@pytest.mark.parametrize(
    "parameter", [None, "", [], "on", 2, [1, 2], [1, 0, 0], 0.5, -2, math.nan, [None], ["", ""], "1;0"]
)
def test_motor_with_invalid_parameters(cell, parameter):
    assert cell.code_of(lambda: cell.execute("Motor", parameter)) != 0
    assert cell.arm.motor.on


def test_commands_while_another_client_holds_the_arm(cell):
    other = cell.connect().get_robot("", "")
    for name, parameter in (("TakeArm", 0), ("Motor", 0), ("Motor", 1), ("ExtSpeed", 10)):
        code = cell.code_of(lambda name=name, parameter=parameter: other.execute(name, variant(parameter)))
        assert code == hresult.ARM_NOT_TAKEN
    assert cell.execute("CurExtSpd") == 100


# --- speeds -----------------------------------------------------------------------------------------------------------

EXTERNAL = [
    (50, (50, 25, 25)),
    ("50", (50, 25, 25)),
    ([50], (50, 25, 25)),
    (["50"], (50, 25, 25)),
    ([50.0, 40.0], (50, 40, 25)),
    ("50, 40, 30", (50, 40, 30)),
    ([50, 40, 30], (50, 40, 30)),
    ([50, -2, -2], (50, 25, 25)),
    ([50, -1, -1], (50, 64, 64)),
    ([50, -1], (50, 64, 25)),
    ([-1], (80, 64, 64)),
    ([-1, -1, 10], (80, 64, 10)),
    ([-1, 10, -1], (80, 10, 64)),
    ([-1, -1, -1], (80, 64, 64)),
    ([0.5], (0.5, 0.01, 0.01)),
    (Variant(ARRAY | R4, [50, 40]), (50, 40, 25)),
    (Variant(VarType.I2, 50), (50, 25, 25)),
    (100, (100, 100, 100)),
]


@pytest.mark.parametrize(("parameter", "expected"), EXTERNAL)
def test_external_speeds(cell, parameter, expected):
    cell.execute("ExtSpeed", 80)
    cell.execute("ExtSpeed", parameter)
    assert tuple(cell.execute(name) for name in ("CurExtSpd", "CurExtAcc", "CurExtDec")) == pytest.approx(expected)


@pytest.mark.parametrize(
    "parameter",
    [None, "", [], 0, -3, 101, [50, 0], [50, 101], [50, 50, -3], [1, 2, 3, 4], "fast", math.nan, [50, math.inf], 1e300, -2,
     [None, 1], [[50, 1]], 0.001],
)  # fmt: skip
def test_invalid_external_speeds(cell, parameter):
    cell.execute("ExtSpeed", [80, 70, 60])
    assert cell.code_of(lambda: cell.execute("ExtSpeed", parameter)) != 0
    assert [cell.execute(name) for name in ("CurExtSpd", "CurExtAcc", "CurExtDec")] == [80, 70, 60]


def speeds(cell: Cell) -> list[float]:
    return [cell.execute(name) for name in ("CurSpd", "CurAcc", "CurDec", "CurJSpd", "CurJAcc", "CurJDec")]


def test_internal_speeds(cell):
    cell.robot.speed(-1, 50)
    assert speeds(cell) == [50, 100, 100, 50, 100, 100]
    cell.robot.speed(0, 20)
    assert speeds(cell) == [50, 100, 100, 20, 100, 100]
    cell.robot.accelerate(-1, 40, 30)
    assert speeds(cell) == [50, 40, 30, 20, 40, 30]
    cell.robot.accelerate(0, -1, 10)
    assert speeds(cell) == [50, 40, 30, 20, 40, 10]
    cell.robot.accelerate(-1, 60, -1)
    assert speeds(cell) == [50, 60, 30, 20, 60, 10]
    cell.robot.accelerate(-1, -1, -1)
    assert speeds(cell) == [50, 60, 30, 20, 60, 10]
    cell.robot.speed(-1, 0.01)
    assert speeds(cell)[0] == 0.01


@pytest.mark.parametrize("value", [0, -1, 100.001, 1e300, 0.001, -50])
def test_invalid_internal_speeds(cell, value):
    before = speeds(cell)
    assert cell.code_of(lambda: cell.robot.speed(-1, value)) == hresult.VALUE_OUT_OF_RANGE
    if value != -1:
        assert cell.code_of(lambda: cell.robot.accelerate(-1, 50, value)) == hresult.VALUE_OUT_OF_RANGE
        assert cell.code_of(lambda: cell.robot.accelerate(0, value, 50)) == hresult.VALUE_OUT_OF_RANGE
    for axis in (-2, 1, 7, 2**31 - 1):
        assert cell.code_of(lambda axis=axis: cell.robot.speed(axis, 50)) == hresult.E_INVALIDARG
        assert cell.code_of(lambda axis=axis: cell.robot.accelerate(axis, 50, 50)) == hresult.E_INVALIDARG
    assert speeds(cell) == before


# --- poses ------------------------------------------------------------------------------------------------------------


def test_poses_at_home(cell):
    assert cell.execute("CurPos") == pytest.approx(SEED)
    assert cell.execute("CurJnt") == [*HOME, 0, 0]
    assert cell.execute("CurTrn") == pytest.approx([*SEED[:3], 0, 1, 0, 0, 0, -1, 5])
    assert cell.execute("CurFig") == 5


def test_poses_during_a_motion_are_consistent(cell):
    move = cell.move(1, "J(60, 20, 80, 10, 50, 30)")
    commands = [cell.arm.queue.joints] * 4
    while not move.done():
        commands += cell.trace(1)
        joints = cell.execute("CurJnt")
        assert joints[:6] == list(commands[-4])  # the encoder lags by three cycles
        assert cell.execute("HighCurJnt") == joints
        assert cell.execute("CurPos") == cell.execute("J2P", f"J{tuple(joints[:6])}") == cell.execute("HighCurPos")
        assert cell.execute("DestJnt") == [60, 20, 80, 10, 50, 30, 0, 0]
        assert cell.execute("DestPos") == cell.execute("J2P", "J(60, 20, 80, 10, 50, 30)")


def test_time_stamps_are_milliseconds_since_power_on(cell):
    cell.clock.advance(2.4)
    for name in ("CurPosEx", "CurJntEx", "CurTrnEx", "HighCurPosEx", "HighCurJntEx", "HighCurTrnEx"):
        stamp, *values = cell.execute(name)
        assert stamp == pytest.approx(2400)
        assert values == cell.execute(name.removesuffix("Ex"))
    cell.move(1, "J(60, 20, 80, 10, 50, 30)", "NEXT")
    stamps = []
    for _ in range(5):
        cell.clock.advance(PERIOD)
        stamps.append(cell.execute("CurJntEx")[0])
    assert np.diff(stamps) == pytest.approx([8] * 4)
    cell.clock.advance(PERIOD / 2)  # between cycles: the stamp is that of the last cycle
    assert cell.execute("CurJntEx")[0] == stamps[-1]


@pytest.mark.guide("5.2.28.53 MotionComplete")
def test_motion_complete(cell):
    def complete(mode: Any) -> bool:
        return cell.execute("MotionComplete", mode)

    assert [complete(mode) for mode in (None, [-1, 0], [0, 1], "-1,1", -1, [0])] == [True] * 6
    cell.move(1, "J(10, 45, 90, 0, 45, 0)", "NEXT")
    while cell.arm.busy:
        assert [complete([-1, 0]), complete([-1, 1])] == [False, False]
        cell.trace(1)
    assert cell.arm.queue.joints[0] == 10
    assert [complete([-1, 0]), complete([-1, 1])] == [True, False]
    cell.trace(3)
    assert [complete([-1, 0]), complete([-1, 1])] == [True, True]
    cell.move(1, "J(0, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(5)
    cell.run(cell.robot.hold(""))
    cell.trace(5)
    assert [complete([-1, 0]), complete([-1, 1])] == [False, False]  # suspended
    cell.run(cell.robot.halt(""))
    cell.trace(5)
    assert [complete([-1, 0]), complete([-1, 1])] == [True, True]
    for bad in ([-1, 2], [0, 0, 0], "x", [0.5, 0]):
        assert cell.code_of(lambda bad=bad: cell.execute("MotionComplete", bad)) != 0


def test_motion_skip_ends_the_motions_with_success(cell):
    first = cell.move(1, "@P J(60, 45, 90, 0, 45, 0)")
    second = cell.move(2, "P(330, 120, 300, 180, 0, 180)")
    cell.trace(10)
    skipping = cell.robot.execute("MotionSkip", variant([-1, 0]))
    assert not skipping.done()
    cell.run(skipping)
    assert not cell.arm.busy
    assert cell.code(first) == cell.code(second) == 0
    assert 0 < cell.arm.queue.joints[0] < 60
    assert cell.run(cell.robot.execute("MotionSkip", variant(None))) is None  # no motion
    assert cell.code_of(lambda: cell.move(1, P)) == 0


# --- calculations -----------------------------------------------------------------------------------------------------

POSES = {
    "J": (0.0, 45.0, 90.0, 0.0, 45.0, 0.0),
    "P": tuple(SEED),
    "T": (*SEED[:3], 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 5.0),
}
VARIABLES = {"J": [*POSES["J"], 0, 0], "P": list(POSES["P"]), "T": list(POSES["T"])}


def forms(kind: str) -> list[Any]:
    """Return one pose in every form that clients send."""
    values = list(POSES[kind])
    text = ", ".join(map(repr, values))
    made = [
        f"{kind}({text})", f"{kind.lower()} ( {text} )", f"({text})", f"{kind}7", f"{kind}[7]", values, [values], [values, kind],
        [values, {"P": 0, "T": 1, "J": 2}[kind]], [values, kind, "@E"], [f"{kind}({text})"], [7, kind], Variant(ARRAY | R8, values),
        Variant(ARRAY | R4, values), [*values[:-1], int(values[-1])], [variant(each) for each in values],
    ]  # fmt: skip
    return [*made, VARIABLES["J"], Variant(ARRAY | R4, VARIABLES["J"])] if kind == "J" else made


@pytest.mark.parametrize("expected", "PJT")
@pytest.mark.parametrize("kind", "PJT")
def test_conversions_in_every_form(cell, kind, expected):
    if kind == expected:
        return
    cell.put(f"{kind}7", VARIABLES[kind])
    for form in forms(kind):
        got = cell.execute(f"{kind}2{expected}", form)
        assert got == pytest.approx(VARIABLES[expected], abs=1e-4), form  # variables have single precision


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("J2P", "P(1, 2, 3, 4, 5, 6)"), ("P2J", "J(0, 45, 90, 0, 45, 0)"), ("T2J", "P7"), ("P2T", "T7"), ("P2J", "V(1, 2, 3)"),
        ("J2P", [[0.0] * 6, "P"]), ("P2J", [0.0] * 8), ("T2P", [0.0] * 7), ("J2T", [0.0] * 10), ("J2P", "V7"),
    ],
)  # fmt: skip
def test_conversions_of_another_type(cell, name, parameter):
    assert cell.code_of(lambda: cell.execute(name, parameter)) == hresult.DISP_E_TYPEMISMATCH


@pytest.mark.parametrize(
    ("name", "parameter", "code"),
    [
        ("P2J", "P(2000, 0, 0, 0, 0, 0)", hresult.TARGET_OUT_OF_RANGE), ("T2J", "T(0, 0, 9000, 0, 1, 0, 0, 0, 1)", hresult.TARGET_OUT_OF_RANGE),
        ("P2J", "P(1e308, 1e308, 1e308, 1, 2, 3)", hresult.TARGET_OUT_OF_RANGE), ("J2P", "J(1, 2, 3)", hresult.E_INVALIDARG),
        ("P2J", "(1, 2, 3, 4, 5, 6, 0.5)", hresult.FIGURE_OUT_OF_RANGE), ("P2T", "(1, 2, 3, 4, 5, 6, 1e300)", hresult.FIGURE_OUT_OF_RANGE),
        ("P2J", "P(330, 120, 300, 180, 0, 180, 37)", hresult.FIGURE_INVALID), ("P2J", "P7, P8", hresult.E_INVALIDARG),
        ("P2J", "P100", hresult.VARIABLE_INDEX_INVALID), ("J2P", "", hresult.E_INVALIDARG), ("J2P", None, hresult.DISP_E_TYPEMISMATCH),
        ("T2P", "T(1, 2, 3, 0, 0, 0, 0, 0, 1)", hresult.E_INVALIDARG), ("J2P", [0.0] * 5, hresult.E_INVALIDARG),
    ],
)  # fmt: skip
def test_invalid_conversions(cell, name, parameter, code):
    assert f"{cell.code_of(lambda: cell.execute(name, parameter)):08X}" == f"{code:08X}"
    assert not cell.rc8.state.faults.code


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("SetToolDef", [1, "(1, 2, 3)"]),
        ("SetWorkDef", [1, [1.0] * 5]),
        ("Dev", ["P7", "(1, 2, 3)"]),
        ("DevH", ["P7", "(1, 2)"]),
    ],
)
def test_too_few_numbers_for_a_position(cell, name, parameter):
    assert cell.code_of(lambda: cell.execute(name, parameter)) == hresult.E_INVALIDARG
    assert not cell.rc8.state.faults.code


def test_conversions_use_tool_and_work(cell):
    cell.execute("SetToolDef", [1, "P(0, 0, 100, 0, 0, 90)"])
    cell.execute("SetWorkDef", [1, "P(100, 50, 20, 0, 0, 90)"])
    cell.robot.change("Tool1")
    cell.robot.change("Work1")
    x, y, z = SEED[0] - 100, SEED[1] - 50, SEED[2] - 100 - 20
    assert cell.execute("J2P", f"J{HOME}") == pytest.approx([y, -x, z, 180, 0, 0, 5])
    assert cell.execute("P2J", [y, -x, z, 180.0, 0.0, 0.0, 5.0])[:6] == pytest.approx(HOME, abs=1e-6)
    assert cell.execute("P2T", "P(9, 8, 7, 0, 0, 0, 2)") == [9, 8, 7, 0, 1, 0, 0, 0, 1, 2]  # the same frame


def test_conversions_without_joints_accept_unreachable_poses(cell):
    trans = cell.execute("P2T", "P(2000, 0, 0, 10, 20, 30, 3)")
    assert cell.execute("T2P", trans) == pytest.approx([2000, 0, 0, 10, 20, 30, 3])


def rotation(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    made = np.eye(3)
    made[x, x] = made[y, y] = c
    made[y, x], made[x, y] = s, -s
    return made


def matrix(values: list[float]) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = rotation("z", values[5]) @ rotation("y", values[4]) @ rotation("x", values[3])
    made[:3, 3] = values[:3]
    return made


BASE, OFFSET = [330.0, 120.0, 300.0, 170.0, 20.0, 150.0, 5.0], [10.0, -20.0, 30.0, 5.0, 10.0, 15.0, 2.0]


def test_dev_is_an_offset_of_the_base_and_devh_of_the_tool(cell):
    base, offset = matrix(BASE), matrix(OFFSET)
    moved = cell.execute("Dev", [BASE, OFFSET])
    assert matrix(moved)[:3, 3] == pytest.approx(base[:3, 3] + offset[:3, 3])
    assert matrix(moved)[:3, :3] == pytest.approx(offset[:3, :3] @ base[:3, :3])
    of_hand = cell.execute("DevH", [BASE, OFFSET])
    assert matrix(of_hand) == pytest.approx(base @ offset)
    assert (moved[6], of_hand[6]) == (5, 5)  # the figure of the offset is ignored


@pytest.mark.parametrize("name", ["Dev", "DevH"])
def test_dev_in_every_form(cell, name):
    cell.put("P1", BASE)
    cell.put("P2", OFFSET)
    expected = cell.execute(name, [BASE, OFFSET])
    trans = [cell.execute("P2T", each) for each in (BASE, OFFSET)]
    base, offset = (f"P({', '.join(map(str, each))})" for each in (BASE, OFFSET))
    for form in (
        [base, offset], f"{base}, {offset}", ["P1", "P2"], "P1, P2", [[BASE, "P"], [OFFSET, "P"]], ["P1", offset], ["P1", OFFSET],
        [trans[0], trans[1]], [trans[0], "P2"], ["P1", [trans[1], "T"]], [[1, "P"], [2, "P"]], Variant(ARRAY | BSTR, ["P1", "P2"]),
        [Variant(ARRAY | R4, BASE), Variant(ARRAY | R4, OFFSET)],
    ):  # fmt: skip
        assert cell.execute(name, form) == pytest.approx(expected, abs=1e-4), form
    joints = cell.execute("P2J", BASE)
    assert cell.execute(name, [[joints, "J"], offset]) == pytest.approx(expected)


@pytest.mark.parametrize(
    "parameter",
    [None, "", P, [P], [P, P, P], [P, "J(0, 45, 90, 0, 45, 0)"], [P, "V(1, 2, 3)"], ["V1", P], [1, 2], "P1 P2"],
)
def test_dev_with_invalid_parameters(cell, parameter):
    assert cell.code_of(lambda: cell.execute("Dev", parameter)) != 0
    assert cell.code_of(lambda: cell.execute("DevH", parameter)) != 0


RANGES = [
    (P, 0),
    ("T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)", 0),
    ([330.0, 120.0, 300.0, 180.0, 0.0, 180.0, 5.0], 0),
    ("P5", 0),
    ("J(0, 45, 90, 0, 45, 0)", 0),
    ("J(171, 45, 90, 0, 45, 0)", 0b000001),
    ("J(0, 121, 90, 0, 45, 0)", 0b000010),
    ("J(-171, 45, 152, -271, 121, 361)", 0b111101),
    ("J(170, 45, 90, 0, 45, 0)", 0),
    ("J(1e300, 45, 90, 0, 45, 0)", 1),
    ("P(2000, 0, 300, 180, 0, 180)", -1),
    ("P(1e300, 0, 300, 180, 0, 180)", -1),
    ("P(330, 120, 300, 180, 0, 180, 37)", -1),
    ("P(330, 120, 300, 180, 0, 180, 7)", 0b010010),
    ("J(0, 45, 90, 0, 0, 0)", -2),
    ([P, 1], 0),
    ([P, 1, 1], 0),
    ([P, -1, -1], 0),
    ([P, 2], -1),
    (["P5", 2, 0], -1),
    ([[330.0, 120.0, 300.0, 180.0, 0.0, 180.0, 5.0], 2], -1),
    ([[[330.0, 120.0, 300.0, 180.0, 0.0, 180.0, 5.0], "P"], 2], -1),
    ([P, 0, 2], -1),
    (["J(0, 45, 90, 0, 45, 0)", 2, 2], 0),
]


@pytest.mark.parametrize(("parameter", "expected"), RANGES)
def test_out_range(cell, parameter, expected):
    cell.put("P5", [330, 120, 300, 180, 0, 180, 5])
    cell.execute("SetToolDef", [2, "P(0, 0, 900, 0, 0, 0)"])
    cell.execute("SetWorkDef", [2, "P(900, 0, 0, 0, 0, 0)"])
    assert cell.execute("OutRange", parameter) == expected
    assert not cell.rc8.state.faults.code


def test_out_range_with_the_current_tool(cell):
    cell.execute("SetToolDef", [2, "P(0, 0, 900, 0, 0, 0)"])
    cell.robot.change("Tool2")
    assert cell.execute("OutRange", P) == -1
    assert cell.execute("OutRange", [P, -1]) == -1
    assert cell.execute("OutRange", [P, 0]) == 0


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        (None, hresult.DISP_E_TYPEMISMATCH), ("", hresult.E_INVALIDARG), ([P, P], hresult.E_INVALIDARG),
        ([P, 64], hresult.TOOL_NUMBER_OUT_OF_RANGE), ([P, -2], hresult.TOOL_NUMBER_OUT_OF_RANGE), ([P, 0, 8], hresult.WORK_NUMBER_OUT_OF_RANGE),
        ([P, 0, 0, 0], hresult.E_INVALIDARG), ([P, 0.5], hresult.E_INVALIDARG), ([P, None], hresult.DISP_E_TYPEMISMATCH),
        ("P(330, 120, 300, 180, 0, 180, 64)", hresult.FIGURE_OUT_OF_RANGE), ("V(1, 2, 3)", hresult.DISP_E_TYPEMISMATCH),
    ],
)  # fmt: skip
def test_out_range_with_invalid_parameters(cell, parameter, code):
    assert f"{cell.code_of(lambda: cell.execute('OutRange', parameter)):08X}" == f"{code:08X}"


# --- tools and works --------------------------------------------------------------------------------------------------

DEFINITIONS = [
    "P(1, 2, 3, 4, 5, 6)", "P(1, 2, 3, 4, 5, 6, -1)", "P9", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1, 2, 3, 4, 5, 6],
    Variant(ARRAY | R4, [1, 2, 3, 4, 5, 6, 5]), "(1, 2, 3, 4, 5, 6)", [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "P"], [9, "P"],
]  # fmt: skip


@pytest.mark.parametrize(("kind", "last"), [("Tool", 63), ("Work", 7)])
def test_frames_are_defined_in_every_form(cell, kind, last):
    cell.put("P9", [1, 2, 3, 4, 5, 6, -1])
    attribute = [] if kind == "Tool" else [0]
    for form in DEFINITIONS:
        for number in (1, last, str(last), float(last)):
            cell.execute(f"Set{kind}Def", [number, [0.0] * 6])
            assert cell.execute(f"Get{kind}Def", number) == [0, 0, 0, 0, 0, 0, *attribute]
            cell.execute(f"Set{kind}Def", [number, form])
            assert cell.execute(f"Get{kind}Def", number) == [1, 2, 3, 4, 5, 6, *attribute]
    assert cell.execute(f"Get{kind}Def", 0) == [0, 0, 0, 0, 0, 0, *attribute]


@pytest.mark.parametrize(
    ("kind", "code"), [("Tool", hresult.TOOL_NUMBER_OUT_OF_RANGE), ("Work", hresult.WORK_NUMBER_OUT_OF_RANGE)]
)
def test_invalid_frames(cell, kind, code):
    count = {"Tool": 64, "Work": 8}[kind]
    for number in (0, -1, count, 2**31 - 1, 1e300):
        assert (
            cell.code_of(lambda number=number: cell.execute(f"Set{kind}Def", [number, "P(1, 2, 3, 4, 5, 6)"])) == code
        )
        if number:
            assert cell.code_of(lambda number=number: cell.execute(f"Get{kind}Def", number)) == code
    for name in (f"{kind}{count}", f"{kind}999999999"):
        assert cell.code_of(lambda name=name: cell.robot.change(name)) == code
    for name in ("", f"{kind}s", f"{kind}-1", f"{kind}1.5", "Base1", f"{kind}1 x", "1", "x" * 1_000_000, f"{kind}１"):
        assert cell.code_of(lambda name=name: cell.robot.change(name)) == hresult.E_INVALIDARG
    for form in (
        None, "", "J(1, 2, 3, 4, 5, 6)", "T(1, 2, 3, 0, 1, 0, 0, 0, 1)", "V(1, 2, 3)", [1.0, 2.0], "P1, P2", "P(1e300, 0, 0, 0, 0, 0)",
        [math.nan] * 6, "P(0, 0, 0, 0, 0, -1e6)",
    ):  # fmt: skip
        assert cell.code_of(lambda form=form: cell.execute(f"Set{kind}Def", [1, form])) != 0
    for parameter in (None, "", 1, [1], "1, P(1, 2, 3, 4, 5, 6)", [[1], "P1"]):
        before = cell.execute(f"Get{kind}Def", 1)
        refused = cell.code_of(lambda parameter=parameter: cell.execute(f"Set{kind}Def", parameter))
        assert refused or parameter == [[1], "P1"]
        assert cell.execute(f"Get{kind}Def", 1) == before
    assert (cell.execute("CurTool"), cell.execute("CurWork")) == (0, 0)


def test_changing_frames_changes_reported_poses_but_not_joints(cell):
    cell.execute("SetToolDef", [3, "P(0, 0, 100, 0, 0, 0)"])
    cell.execute("SetWorkDef", [3, "P(100, 0, 0, 0, 0, 0)"])
    cell.robot.change("tool3")
    cell.robot.change("WORK 3")
    assert (cell.execute("CurTool"), cell.execute("CurWork")) == (3, 3)
    assert cell.execute("CurPos")[:3] == pytest.approx([SEED[0] - 100, 0, SEED[2] - 100])
    assert cell.execute("CurJnt")[:6] == list(HOME)
    cell.execute("SetToolDef", [3, "P(0, 0, 50, 0, 0, 0)"])  # the current tool
    assert cell.execute("CurPos")[2] == pytest.approx(SEED[2] - 50)


# --- servo data and control log ---------------------------------------------------------------------------------------


def test_servo_data(cell):
    assert cell.execute("GetSrvData", 17) == [0] * 7
    resting = cell.execute("GetSrvData", 2)
    assert 0 < max(map(abs, resting)) < 0.01  # gravity: users interpret all zeros as a motor that is off
    gravity = cell.execute("GetSrvData", 4)
    assert gravity[1] != 0
    assert gravity[0] == gravity[6] == gravity[7] == 0
    cell.move(2, "P(364, 200, 278, 180, 0, 180)", "SPEED=20,NEXT")
    cell.trace(40)
    deviation = cell.execute("GetSrvData", [2])
    encoders, commands = cell.execute("CurJnt"), cell.arm.queue.joints
    assert deviation[:6] == pytest.approx([a - b for a, b in zip(commands, encoders, strict=False)], abs=0.02)
    assert abs(deviation[0]) > 0.1
    assert math.hypot(*cell.execute("GetSrvData", "17")) == pytest.approx(300, rel=0.02)
    assert cell.execute("GetSrvData", 4) != gravity
    assert all(abs(load) < 150 for load in cell.execute("GetSrvData", 4))
    cell.trace(300)
    cell.execute("Motor", 0)
    assert cell.execute("GetSrvData", 4) == cell.execute("GetSrvData", 2) == [0] * 8
    for item in (0, 3, 6, 9, 16, 21, -1, 1e9):
        assert cell.code_of(lambda item=item: cell.execute("GetSrvData", item)) == hresult.E_INVALIDARG


def test_the_control_log(cell):
    assert cell.execute("GetLogCount") == 0
    cell.robot.change("Tool3")
    cell.execute("StartLog")
    cell.move(1, "J(20, 45, 90, 0, 45, -30)", "NEXT")
    joints = cell.trace(30)
    cell.execute("StopLog")
    cell.trace(30)
    assert cell.execute("GetLogCount") == 30
    records = [cell.execute("GetLogRecord", index) for index in range(30)]
    for index, record in enumerate(records):
        columns = np.array(record[:32]).reshape(8, 4)
        assert tuple(columns[:6, 0]) == joints[index]
        assert tuple(columns[:6, 1]) == (joints[index - 3] if index >= 3 else HOME)
        assert columns[:, 2] == pytest.approx(columns[:, 3] / 100 * 3)  # current and load
        assert not columns[6:].any()
        assert record[32:36] == [0, 0, 0, 0]
        assert record[37:] == [3, 0]
    assert [record[36] for record in records] == list(range(records[0][36], records[0][36] + 30))
    for index in (30, -1, 2**31 - 1):
        assert cell.code_of(lambda index=index: cell.execute("GetLogRecord", index)) == hresult.DISP_E_BADINDEX
    cell.execute("StartLog")
    cell.trace(5)
    assert cell.execute("GetLogCount") == 35
    cell.execute("ClearLog")
    cell.trace(2)
    assert cell.execute("GetLogCount") == 2


def test_the_control_log_keeps_the_latest_records(cell):
    cell.execute("StartLog")
    cell.clock.advance(101)
    cell.execute("StopLog")
    assert cell.execute("GetLogCount") == 12_500
    first, last = (cell.execute("GetLogRecord", index)[36] for index in (0, 12_499))
    assert last - first == 12_499


def test_names_of_the_arm():
    for model, name in (("VS-050", "VS050A3-AV6-NNN-NNN"), ("COBOTTA", "CVR038")):
        cell = Cell(model=model)
        assert name in cell.execute("GetRobotTypeName")
        cell.close()


# --- arbitrary parameters ---------------------------------------------------------------------------------------------

PIECES = st.sampled_from([
    "", " ", "@", "@0", "@P 10", "@E-1", "@1.2.3 5", "@..", "@5", "10", "-1", "1e308", "nan", "1,0", "(1,10)", "(1,10),(2,20)", "((1,2)", "()",
    "(,)", "(1,2,3)", "@E (1,1)", "P1", "P(1,2,3,4,5,6)", P, "J(0,45,90,0,45,0)", "J(1,2,3)", "T(1,2,3,0,1,0,0,0,1)", "T(0,0,0,0,0,0,0,0,0)",
    "V(1,2,3)", "(1,2,3,4,5,6,0.5)", "P1,P2", "P(1e308,1e308,1e308,1e308,1e308,1e308)", "@E P1 EX((7,10))", "EX((7,1))", "NEXT", "SPEED=1e-322",
    "SPEED=F1", "TIME=1e-320", "XY", "Tool1",
])  # fmt: skip
NUMBER = st.one_of(
    st.sampled_from([0, 1, -1, 2, 3, 7, 20, 64, 2**31 - 1, -(2**31)]),
    st.sampled_from([0.5, 1.0, 1e300, -1e308, 5e-324, math.nan, math.inf, -math.inf]),
)
VALUES = st.lists(NUMBER, min_size=1, max_size=10)
NEARLY = st.recursive(
    st.one_of(PIECES, NUMBER, VALUES, st.none(), st.booleans()),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=6,
).map(variant)
"""Values that resemble parameters."""


@pytest.fixture(scope="module")
def shared() -> Iterator[Cell]:
    made = Cell().take()
    record(made)
    yield made
    made.close()


def reset(cell: Cell) -> None:
    """Restore the initial state: slave mode off, no motion, no error, motor on, arm taken."""
    if cell.arm.slave.on:
        cell.execute("slvChangeMode", 0)
    cell.run(cell.robot.halt(""))
    cell.clock.advance(1.0)
    cell.rc8.state.clear_errors()
    cell.stand(*HOME)
    cell.execute("TakeArm", 0)
    cell.execute("Motor", 1)


ANY = st.one_of(variants(), NEARLY, NEARLY)


def send_anything(cell: Cell, name: str, parameter: Variant) -> None:
    """Check that a call raises nothing but CallError, that it ends, and that a rejected call starts no motion."""
    try:
        result = cell.robot.execute(name, parameter)
    except CallError:
        assert not cell.arm.busy
        assert cell.arm.queue.joints == HOME
        if cell.rc8.state.faults.code or not cell.arm.motor.on:
            reset(cell)
    else:
        assert variant(None if isinstance(result, Deferred) else result).type & ~ARRAY <= VarType.UI8
        reset(cell)


@pytest.mark.parametrize("name", [name for name in ANSWERS if name not in NO_PARAMETER])
@settings(max_examples=20, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(parameter=ANY)
def test_any_parameter_is_accepted_or_rejected(shared, name, parameter):
    send_anything(shared, name, parameter)


@settings(max_examples=100, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(name=st.sampled_from(NO_PARAMETER), parameter=ANY)
def test_any_parameter_of_a_command_without_parameters(shared, name, parameter):
    send_anything(shared, name, parameter)


CALLS = {
    "move": lambda cell, a, b, n: cell.robot.move(n, a, b),
    "rotate": lambda cell, a, b, n: cell.robot.rotate(a, float(n), variant(b), ""),
    "rotate about": lambda cell, a, b, n: cell.robot.rotate(variant(b), float(n), a, ""),
}


@pytest.mark.parametrize("call", CALLS)
@settings(max_examples=100, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(
    parameter=ANY,
    text=st.one_of(PIECES, st.sampled_from(["SPEED=50,NEXT", "@P", "V(1,2,3)", "YZ"])),
    number=st.one_of(st.integers(-2, 6), st.integers(-(2**31), 2**31 - 1)),
)
def test_any_argument_of_a_motion_is_accepted_or_rejected(shared, call, parameter, text, number):
    try:
        CALLS[call](shared, parameter, text, number)
    except CallError:
        assert not shared.arm.busy
        assert shared.arm.queue.joints == HOME
        if shared.rc8.state.faults.code:
            reset(shared)
    else:
        reset(shared)


def _nested(depth: int) -> Variant:
    made = trusted(VARIANT_ARRAY, [])
    for _ in range(depth):
        made = trusted(VARIANT_ARRAY, [made])
    return made


MEGA = 1_000_000
GIANTS = {
    "bytes": trusted(ARRAY | VarType.UI1, bytes(16 * MEGA)),
    "numbers": trusted(NUMBERS, [0.0] * MEGA),
    "texts": trusted(ARRAY | BSTR, ["1"] * 50_000),
    "nothings": trusted(VARIANT_ARRAY, [trusted(EMPTY, None)] * 50_000),
    "pairs": trusted(VARIANT_ARRAY, [trusted(NUMBERS, [1.0, 1.0])] * 50_000),
    "deep": _nested(500),
    "letters": variant("x" * MEGA),
    "blanks": variant("(1" + " " * MEGA + "2" + " " * MEGA + ")"),
    "brackets": variant("(" * MEGA),
    "pair text": variant("(1,1)" * MEGA),
    "digits": variant("9" * MEGA),
    "commas": variant("1," * MEGA),
    "marks": variant("@" + "1" * MEGA + "."),
    "points": variant("@" + "1." * MEGA),
}


@pytest.mark.parametrize("giant", GIANTS)
def test_giant_parameters_are_rejected_quickly(cell, giant):
    parameter = GIANTS[giant]
    within = trusted(VARIANT_ARRAY, [variant(1), parameter, parameter, parameter])
    for name, (normal, _, _) in ANSWERS.items():
        for given_parameter in (parameter, within):
            began = time.process_time()
            try:
                cell.robot.execute(name, given_parameter)
                assert normal is None or name in ("Motor", "TakeArmState"), name
            except CallError:
                pass
            assert time.process_time() - began < 1.0, name
    assert not cell.arm.busy
