"""Arrive, ArchMove, MotionSkip, tolerances, modes, calculations and the control log of the provider guide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.servo import LAG, ControlLog
from support.cell import Cell

PTP, LINE = 1, 2
LOG_LENGTH = ControlLog().capacity
FAR = "J(60, 45, 90, 0, 45, 0)"
R4, R8S = VarType.R4, int(VarType.R8) | ARRAY


@pytest.fixture
def cell():
    cell = Cell().take()
    yield cell
    cell.close()


def execute(cell: Cell, command: str, *parameters: Any) -> Any:
    return cell.robot.execute(command, variant(list(parameters) if parameters else None))


def refused(cell: Cell, command: str, *parameters: Any) -> int:
    return cell.code_of(lambda: execute(cell, command, *parameters))


# --- Arrive, MotionSkip, ArchMove -------------------------------------------------------------------------------------


@pytest.mark.parametrize("percent", [1.0, 25.0, 50.0, 99.0, 100.0])
@pytest.mark.guide("5.2.28.51 Arrive")
def test_arrive_waits_for_a_share_of_the_motion(cell, percent):
    cell.run(cell.move(PTP, FAR, "NEXT"))
    done = execute(cell, "Arrive", percent)
    assert isinstance(done, Deferred)
    places = [0.0]
    while not done.done():
        cell.clock.advance(PERIOD)
        places.append(cell.arm.queue.joints[0])
    assert places[-2] < 0.6 * percent <= places[-1] + 1e-9
    assert done.result() is None


@pytest.mark.guide("5.2.28.51 Arrive")
def test_arrive_without_a_motion_returns_at_once(cell):
    assert execute(cell, "Arrive", 50.0).done()
    assert refused(cell, "Arrive", 0.0) == refused(cell, "Arrive", 101.0) == hresult.VALUE_OUT_OF_RANGE


def test_arrive_of_a_motion_that_is_stopped(cell):
    cell.run(cell.move(PTP, FAR, "NEXT"))
    done = execute(cell, "Arrive", 90.0)
    cell.clock.advance(0.1)
    cell.run(cell.robot.halt(""))
    assert cell.code(done) == hresult.STOPPED_DURING_PC_MOTION


@pytest.mark.parametrize("pattern", [0, 1, 2, 3])
@pytest.mark.guide("5.2.28.52 MotionSkip")
def test_motion_skip_decelerates_as_its_pattern_says(cell, pattern):
    cell.run(cell.move(PTP, FAR, "ACCEL=20,DECEL=20,NEXT"))
    cell.clock.advance(0.3)
    assert cell.arm.queue.joints[0] > 0
    first = execute(cell, "MotionSkip", -1, pattern)
    trace = np.array([cell.arm.queue.joints[0], *(joints[0] for joints in cell.trace(100))])
    assert first.done()
    hardest = np.abs(np.diff(trace, 2)).max() / PERIOD**2
    limit = cell.arm.model.axes[0].acceleration
    if pattern in (2, 3):
        assert hardest <= 0.2 * limit * (1 + 1e-6)
    else:
        assert 0.5 * limit < hardest <= limit * (1 + 1e-6)
    assert trace[-1] < 59.0


def test_a_stop_is_faster_than_a_skip_that_is_in_progress(cell):
    cell.run(cell.move(PTP, FAR, "ACCEL=5,DECEL=5,NEXT"))
    cell.clock.advance(0.4)
    execute(cell, "MotionSkip", -1, 2)
    cell.clock.advance(2 * PERIOD)
    cell.rc8.emergency_stop(True)
    trace = np.array([joints[0] for joints in cell.trace(100)])
    assert np.abs(np.diff(trace, 2)).max() / PERIOD**2 > 0.2 * cell.arm.model.axes[0].acceleration
    assert not cell.arm.busy


@pytest.mark.parametrize("parameters", [(-1, 4), (-1, 5), (-1, 9), (-1, -1), (32, 0), (-2, 0)])
@pytest.mark.guide("5.2.28.52 MotionSkip")
def test_arguments_of_motion_skip(cell, parameters):
    cell.run(cell.move(PTP, FAR, "NEXT"))
    assert refused(cell, "MotionSkip", *parameters) == hresult.VALUE_OUT_OF_RANGE
    assert cell.arm.busy


ARCH = "P(330, 120, 260, 180, 0, 180, 5)"


@pytest.mark.parametrize(("start", "end"), [(0.0, 0.0), (30.0, 30.0), (50.0, 10.0)])
@pytest.mark.guide("5.2.28.74 ArchMove")
def test_arch_move(cell, start, end):
    cell.run(cell.move(PTP, "@E P(350, -100, 300, 180, 0, 180, 5)"))
    done = execute(cell, "ArchMove", ARCH, 50.0, start, end)
    tips = []
    while not done.done():
        cell.clock.advance(PERIOD)
        tips.append(cell.tip[:3, 3])
    way = np.array(tips)
    assert cell.code(done) == 0
    assert way[-1] == pytest.approx([330, 120, 260], abs=1e-3)
    top = 350.0  # 50 mm above the higher end
    assert way[:, 2].max() <= top + 0.01
    across = np.hypot(way[:, 0] - 350, way[:, 1] + 100)
    left = np.hypot(way[:, 0] - 330, way[:, 1] - 120)
    beside = (across > 0.05) & (left > 0.05)
    rising = np.arange(len(way)) < np.argmax(way[:, 2])
    assert way[beside & rising, 2].min() >= 300 + (start or 50.0) - 1.0
    assert way[beside & ~rising, 2].min() >= 260 + (end or 90.0) - 1.0
    if not (start or end):
        assert way[:, 2].max() == pytest.approx(top, abs=0.01)


@pytest.mark.parametrize(
    ("parameters", "code"),
    [((ARCH,), hresult.E_INVALIDARG), ((ARCH, -1.0), hresult.VALUE_OUT_OF_RANGE), ((ARCH, 50.0, 1.0, 1.0, 1.0), hresult.E_INVALIDARG),
     ((ARCH, 5000.0), hresult.OUT_OF_WORKING_RANGE)],
)  # fmt: skip
def test_arguments_of_arch_move(cell, parameters, code):
    assert refused(cell, "ArchMove", *parameters) in (
        code,
        hresult.TARGET_OUT_OF_RANGE if code == hresult.OUT_OF_WORKING_RANGE else code,
    )
    assert not cell.arm.busy


# --- tolerances -------------------------------------------------------------------------------------------------------


def cycles_after_command(cell: Cell, pose: str) -> int:
    """Return the number of cycles from the end of the command to the reply of a Move."""
    move = cell.move(PTP, pose)
    while cell.arm.queue.state.value != "idle":
        cell.clock.advance(PERIOD)
        assert not (move.done() and cell.arm.busy)
    count = 0
    while not move.done():
        cell.clock.advance(PERIOD)
        count += 1
    move.result()
    return count


@pytest.mark.guide("5.2.28.76 EncMotionAllow")
def test_tolerance_of_the_encoders(cell):
    assert cycles_after_command(cell, "@E " + FAR) == LAG
    assert execute(cell, "EncMotionAllow", True, 5.0) is None
    assert cycles_after_command(cell, "@E J(0, 45, 90, 0, 45, 0)") < LAG
    execute(cell, "EncMotionAllow", 1, 5.0 * 131072 / 360, 1)
    assert cell.arm.accuracy.encoder == pytest.approx(5.0)
    execute(cell, "EncMotionAllow", False)
    assert cycles_after_command(cell, "@E " + FAR) == LAG


@pytest.mark.guide("5.2.28.75 CrtMotionAllow")
def test_tolerance_of_the_tool(cell):
    assert cycles_after_command(cell, "@C " + FAR) == LAG
    execute(cell, "CrtMotionAllow", True, 20.0)
    near = cycles_after_command(cell, "@C J(0, 45, 90, 0, 45, 0)")
    execute(cell, "CrtMotionAllow", True, 20.0, 1e-6)
    assert near < cycles_after_command(cell, "@C " + FAR) <= LAG
    execute(cell, "CrtMotionAllow", 0)
    assert cell.arm.accuracy.position is None


@pytest.mark.guide("5.2.28.77 EncMotionAllowJnt")
def test_tolerance_of_an_extended_joint():
    cell = Cell(model="VE026A").take()
    assert cycles_after_command(cell, "@E J(0, 30, 120, 0, 30, 0, 20)") == LAG
    execute(cell, "EncMotionAllowJnt", True, 7, 5.0)
    assert cycles_after_command(cell, "@E J(0, 30, 120, 0, 30, 0, -20)") < LAG
    execute(cell, "EncMotionAllowJnt", False, 7)
    assert cycles_after_command(cell, "@E J(0, 30, 120, 0, 30, 0, 20)") == LAG
    for axis in (6, 8):
        assert refused(cell, "EncMotionAllowJnt", True, axis, 5.0) == hresult.E_INVALIDARG
    cell.close()


@pytest.mark.parametrize(
    ("model", "axis", "text"),
    [
        ("HSR065", 4, "axis 4 belongs to the robot and is not an extended joint. Try: EncMotionAllow"),
        ("HSR065", 5, "HSR065 has no extended joint 5"),
        ("HSR065", 7, "HSR065 has no extended joint 7"),
        ("VS-050", 7, "VS-050 has no extended joint 7"),
        ("VE026A", 8, "VE026A has no extended joint 8"),
        ("VE026A", 0, "VE026A has no extended joint 0"),
    ],
)
def test_a_joint_that_is_not_an_extended_joint_is_named(model, axis, text):
    cell = Cell(model=model).take()
    with pytest.raises(CallError) as caught:
        execute(cell, "EncMotionAllowJnt", True, axis, 5.0)
    assert (caught.value.code, caught.value.detail) == (hresult.E_INVALIDARG, text)
    cell.close()


@pytest.mark.guide("5.2.28.78 ErAlw")
def test_a_deviation_beyond_the_tolerance_stops_the_arm(cell):
    execute(cell, "ErAlw", True, 1, 0.01)
    assert cell.code(cell.move(PTP, FAR)) == hresult.POSITION_DEVIATION_AXIS1
    assert cell.rc8.state.faults.code == hresult.POSITION_DEVIATION_AXIS1
    cell.run(cell.arm.when_still())
    assert not cell.arm.motor.on
    assert cell.arm.queue.joints[0] < 59.0


@pytest.mark.parametrize("off", [(False, 1), (0, 0)])
@pytest.mark.guide("5.2.28.78 ErAlw")
def test_a_tolerance_that_is_large_enough_or_off(cell, off):
    execute(cell, "ErAlw", True, 1, 30.0)
    assert cell.code(cell.move(PTP, FAR)) == 0
    execute(cell, "ErAlw", True, 1, 0.01)
    execute(cell, "ErAlw", *off)
    assert cell.code(cell.move(PTP, "J(0, 45, 90, 0, 45, 0)")) == 0


@pytest.mark.guide("5.2.28.92 MotionTimeout")
def test_encoders_that_do_not_arrive_in_time(cell):
    execute(cell, "MotionTimeout", True, 9)
    assert cell.code(cell.move(PTP, "@E " + FAR)) == hresult.E_TIMEOUT
    assert cell.rc8.state.faults.code == 0
    assert cell.code(cell.move(PTP, "@0 J(0, 45, 90, 0, 45, 0)")) == 0
    execute(cell, "MotionTimeout", True, 5600)
    assert cell.code(cell.move(PTP, "@E " + FAR)) == 0
    execute(cell, "MotionTimeout", False)
    for time in (0, 30_001):
        assert refused(cell, "MotionTimeout", True, time) == hresult.VALUE_OUT_OF_RANGE


def test_take_arm_resets_the_tolerances(cell):
    execute(cell, "ErAlw", True, 1, 0.01)
    execute(cell, "SingularAvoid", 2)
    execute(cell, "SpeedMode", 3)
    cell.execute("TakeArm", [0, 1])
    assert cell.arm.accuracy.deviation == {1: 0.01}
    cell.execute("TakeArm", [0, 0])
    assert cell.arm.accuracy.deviation == {}
    assert (cell.arm.speeds.avoid_singular, cell.execute("CurSpeedMode")) == (False, 0)


BAD = {
    "CrtMotionAllow": [(True,), (True, 0.0), (True, -1.0), (True, 1.0, 1.0, 1.0), ("x", 1.0)],
    "EncMotionAllow": [(True,), (True, 0.0), (True, 1.0, 2), ()],
    "EncMotionAllowJnt": [(True, 7), (False,)],
    "ErAlw": [(True, 1), (True, 7, 1.0), (True, 0, 1.0), (False,), (False, 9)],
    "MotionTimeout": [(True,), (True, 1.5)],
    "SingularAvoid": [(1,), (3,), ()],
    "SpeedMode": [(4,), (-1,), ()],
}


@pytest.mark.parametrize(("command", "parameters"), [(name, each) for name, sets in BAD.items() for each in sets])
def test_invalid_settings(cell, command, parameters):
    codes = (hresult.E_INVALIDARG, hresult.VALUE_OUT_OF_RANGE, hresult.DISP_E_TYPEMISMATCH)
    assert refused(cell, command, *parameters) in codes


# --- modes ------------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.93 SingularAvoid")
def test_a_path_near_a_singular_point_is_slowed_down_instead_of_refused(cell):
    cell.stand(0, 20, 90, 2, 30, 0)
    pose = [*cell.execute("J2P", "J(0, 20, 90, -2, -30, 0)")[:6], -1.0]
    assert cell.code_of(lambda: cell.move(LINE, pose)) == hresult.SINGULAR_POINT_REFUSED
    execute(cell, "SingularAvoid", 2)
    move = cell.move(LINE, pose)
    trace = np.array(cell.trace(100))
    speeds = np.abs(np.diff(trace, axis=0)).max(0) / PERIOD
    assert (speeds <= [axis.velocity * (1 + 1e-6) for axis in cell.arm.model.axes]).all()
    cell.run(cell.robot.halt(""))
    assert move.done()


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
@pytest.mark.guide("5.2.28.94 SpeedMode")
def test_speed_mode_is_stored(cell, mode):
    assert execute(cell, "SpeedMode", mode) is None
    assert execute(cell, "CurSpeedMode") == mode


@pytest.mark.guide("5.2.28.96 GenerateNonStopPath")
def test_the_calculator_of_non_stop_paths_requires_a_licence(cell):
    assert refused(cell, "GenerateNonStopPath", 1, 2) == hresult.OPTION_NOT_LICENSED


@pytest.mark.guide("5.2.19 Accelerate")
def test_accelerate_with_two_numbers_keeps_the_deceleration(cell):
    from orinkit.cao.functions import robot_accelerate

    assert [argument.optional for argument in robot_accelerate.arguments] == [False, False, False, True]
    cell.robot.accelerate(-1, 40.0, 30.0)
    cell.robot.accelerate(-1, 50.0, robot_accelerate.arguments[3].default)
    assert (cell.arm.speeds.path.accel, cell.arm.speeds.path.decel) == (50.0, 30.0)


# --- calculations -----------------------------------------------------------------------------------------------------

T1 = [100.0, 20.0, 30.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 5.0]
T2 = [10.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0]


def typed(cell: Cell, command: str, *parameters: Any) -> Variant:
    result = execute(cell, command, *parameters)
    assert isinstance(result, Variant)
    return result


@pytest.mark.guide("5.2.28.1 TMul")
def test_product_of_transformations(cell):
    result = typed(cell, "TMul", T1, T2)
    assert result.type == R8S
    assert result.plain == pytest.approx([110, 20, 30, 1, 0, 0, 0, 0, -1, 5])
    cell.put("T1", T1)
    cell.put("T2", T2)
    assert typed(cell, "TMul", "T1", "T2").plain == pytest.approx(result.plain)
    assert cell.robot.execute("TMul", variant("T1, T2")).plain == pytest.approx(result.plain)


@pytest.mark.guide("5.2.28.2 TInv")
def test_inverse_of_a_transformation(cell):
    inverse = typed(cell, "TInv", T2)
    assert inverse.type == R8S
    assert typed(cell, "TMul", T2, inverse.plain).plain == pytest.approx([0, 0, 0, 0, 1, 0, 0, 0, 1, 1])
    cell.put("T7", T2)
    assert cell.robot.execute("TInv", variant("T7")).plain == pytest.approx(inverse.plain)


@pytest.mark.guide("5.2.28.3 TNorm")
def test_normalization_of_a_transformation(cell):
    result = cell.robot.execute("TNorm", variant([1.0, 2.0, 3.0, 0.0, 2.0, 0.5, 0.0, 0.0, 3.0, 5.0]))
    assert result.type == R8S
    assert result.plain == pytest.approx([1, 2, 3, 0, 1, 0, 0, 0, 1, 5])


@pytest.mark.parametrize("command", ["TMul", "TInv", "TNorm"])
def test_calculations_require_transformations(cell, command):
    given = ("P1", "P2") if command == "TMul" else ("P1",)
    assert refused(cell, command, *given) in (hresult.DISP_E_TYPEMISMATCH, hresult.E_INVALIDARG)


@pytest.mark.parametrize(
    ("command", "parameters", "percent"),
    [
        pytest.param("MPS", [750.0], 50.0, marks=pytest.mark.guide("5.2.28.13 MPS")),
        pytest.param("RPM", [1, 425 / 6 / 4], 25.0, marks=pytest.mark.guide("5.2.28.14 RPM")),
        pytest.param("DPS", [1, 42.5], 10.0, marks=pytest.mark.guide("5.2.28.15 DPS")),
        pytest.param("DPS", [36.0], 10.0, marks=pytest.mark.guide("5.2.28.15 DPS")),
    ],
)
def test_values_of_speed(cell, command, parameters, percent):
    result = typed(cell, command, *parameters)
    assert result.type == R4
    assert result.plain == pytest.approx(percent, rel=1e-6)
    cell.robot.speed(-1, result.plain)


@pytest.mark.parametrize(
    ("command", "parameters"),
    [("MPS", [0.0]), ("MPS", [2000.0]), ("RPM", [1, 1000.0]), ("RPM", [9, 1.0]), ("DPS", [0, 5.0])],
)
def test_values_of_speed_out_of_range(cell, command, parameters):
    assert refused(cell, command, *parameters) in (hresult.VALUE_OUT_OF_RANGE, hresult.E_INVALIDARG)


@pytest.mark.parametrize(
    ("command", "count"),
    [
        pytest.param("DestPosEx", 8, marks=pytest.mark.guide("5.2.28.19 DestPosEx")),
        pytest.param("DestJntEx", 9, marks=pytest.mark.guide("5.2.28.24 DestJntEx")),
        pytest.param("DestTrnEx", 11, marks=pytest.mark.guide("5.2.28.29 DestTrnEx")),
    ],
)
def test_destination_with_a_time_stamp(cell, command, count):
    cell.run(cell.move(PTP, FAR, "NEXT"))
    cell.clock.advance(10 * PERIOD)
    result = typed(cell, command)
    assert result.type == R8S
    time, *pose = result.plain
    assert len(pose) == count - 1
    assert time == pytest.approx(cell.arm.seconds() * 1000)
    assert pose == pytest.approx(execute(cell, command.removesuffix("Ex")).plain)


# --- control log ------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.40 ClearLog")
def test_clear_log_begins_to_record_into_a_ring_buffer(cell):
    execute(cell, "ClearLog")
    assert execute(cell, "GetLogCount").plain == 0
    cell.trace(LOG_LENGTH + 10)
    assert execute(cell, "GetLogCount").plain == LOG_LENGTH
    assert cell.arm.log.running
    execute(cell, "StopLog")
    newest = cell.arm.log.record(LOG_LENGTH - 1)
    cell.trace(5)
    assert cell.arm.log.record(LOG_LENGTH - 1) == newest


@pytest.mark.guide("5.2.28.38 StartLog")
def test_recording_ends_by_itself_after_start_log(cell):
    execute(cell, "ClearLog")
    cell.trace(20)
    execute(cell, "StartLog")
    cell.trace(LOG_LENGTH - 5)
    assert cell.arm.log.running
    cell.trace(10)
    assert not cell.arm.log.running
    assert execute(cell, "GetLogCount").plain == LOG_LENGTH
    first = cell.arm.log.record(0)
    cell.trace(5)
    assert cell.arm.log.record(0) == first
