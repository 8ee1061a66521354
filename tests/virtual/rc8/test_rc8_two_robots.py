"""Two robots on one controller: each has its own arm; what concerns the controller stops both."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

import orinkit
from orinkit.cao.provider import ClientInfo
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider
from orinkit.virtual.rc8.robot.motor import MotorState
from support.cell import Cell
from support.codes import code_of
from support.two_arms import FAR, HOME, TwoArms

J0 = 0x002


@pytest.fixture
def cell() -> Iterator[TwoArms]:
    made = TwoArms().take()
    yield made
    made.close()


@pytest.fixture
def strict() -> Iterator[TwoArms]:
    """Return two robots with strict time: a late set-point is an error immediately."""
    made = TwoArms(strict_time=True).take()
    yield made
    made.close()


# --- objects ----------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.3 AddRobot")
def test_the_option_id_chooses_the_robot(cell):
    assert cell.controller.get_robot_names("") == ["Arm0", "Arm1"]
    names = [
        cell.run(cell.controller.get_robot(name, option).execute("GetRobotTypeName", variant(None)))
        for name, option in (("", ""), ("Arm1", ""), ("a", "ID=0"), ("a", "ID"), ("a", "ID=1"), ("", "id = 1"))
    ]
    first, second = (arm.model.type_name for arm in cell.arms)
    assert first != second
    assert names == [first, first, first, first, second, second]
    assert cell.controller.get_robot("", "ID=1").name == "Arm1"
    for option in ("ID=2", "ID=-1", "ID=x"):
        assert code_of(lambda option=option: cell.controller.get_robot("", option)) == hresult.E_CAO_OBJECT_NOTFOUND


def test_one_robot_has_the_id_0():
    cell = Cell()
    assert cell.controller.get_robot_names("") == ["Arm0"]
    assert code_of(lambda: cell.controller.get_robot("", "ID=1")) == hresult.E_CAO_OBJECT_NOTFOUND
    cell.close()


def test_every_command_of_a_robot_object_concerns_its_arm(cell):
    cell.run(cell.move_of(1, 1, "@E J(10, 45, 90, 0, 45, 0)"))
    cell.cycle(100)
    assert cell.arms[0].queue.joints == HOME
    assert [cell.of(robot, "CurJnt")[0] for robot in (0, 1)] == pytest.approx([0, 10])
    cell.of(1, "ExtSpeed", 50)
    assert [cell.of(robot, "CurExtSpd") for robot in (0, 1)] == [100, 50]
    cell.of(1, "SetToolDef", [3, "P(0, 0, 50, 0, 0, 0)"])
    cell.robots[1].change("Tool3")
    assert [cell.of(robot, "CurTool") for robot in (0, 1)] == [0, 3]
    cell.of(1, "AddPathPoint", [1, "P(300, 100, 400, 180, 0, 180, 5)"])
    assert [cell.of(robot, "GetPathPointCount", 1) for robot in (0, 1)] == [0, 1]
    angles = [robot.get_variable("@CURRENT_ANGLE", "").get_value().value[0] for robot in cell.robots]
    assert angles == pytest.approx([0, 10])
    cell.of(1, "Motor", [0, 0])
    assert [arm.motor.on for arm in cell.arms] == [True, False]


def test_each_arm_has_a_semaphore(cell):
    other = cell.connect().get_robot("", "ID=1")
    taking = variant([0, 0])
    assert code_of(lambda: other.execute("TakeArm", taking)) == hresult.ARM_NOT_TAKEN
    cell.of(1, "GiveArm")
    other.execute("TakeArm", taking)
    assert cell.of(0, "TakeArmState") == 1
    assert cell.of(1, "TakeArmState") == 0
    assert code_of(lambda: cell.move_of(1, 1, FAR[1])) == hresult.ARM_NOT_TAKEN
    cell.run(other.move(1, variant("J(10, 45, 90, 0, 45, 0)"), ""))
    other.release()
    assert cell.arms[1].holder is None
    assert cell.arms[0].holder is not None


def test_commands_of_the_second_robot_have_a_prefix(cell):
    names = cell.controller.get_command_names("")
    assert {"Robot.Motor", "Arm1.Motor", "Arm1.SyncTimeStart"} <= set(names)
    command = cell.controller.get_command("arm1.motor", "")
    command.put_parameters(variant([0, 1]))
    cell.run(command.execute(0))
    cell.cycle(60)
    assert [arm.motor.state for arm in cell.arms] == [MotorState.ON, MotorState.OFF]
    moving = cell.controller.get_command("Arm0.DriveEx", "")
    moving.put_parameters(variant([["1, 30"]]))
    assert not code_of(lambda: cell.controller.get_command("Arm0.Motor", ""))


def test_programs_act_on_the_first_robot(cell):
    cell.rc8.state.files.write(
        "Pro1.pcs", b"Sub Main\n  Takearm\n  Move P, J(10, 45, 90, 0, 45, 0)\n  Givearm\nEnd Sub\n"
    )
    task = cell.controller.get_task("Pro1", "")
    cell.of(0, "GiveArm")
    cell.run(task.start(1, ""))
    cell.cycle(300)
    assert cell.moved == [True, False]


# --- what stops both --------------------------------------------------------------------------------------------------


def _error(level: int) -> Callable[[TwoArms], None]:
    return lambda cell: cell.rc8.pendant.raise_error(0x80204999 | level << 24)


def _crash(cell: TwoArms) -> None:
    def fail() -> bool:
        cell.rc8.state.timers.step = original  # type: ignore[method-assign]  # replaced by the test
        raise RuntimeError("test")

    original = cell.rc8.state.timers.step
    cell.rc8.state.timers.step = fail  # type: ignore[method-assign]  # replaced by the test
    cell.cycle()


def _mode(cell: TwoArms) -> None:
    cell.rc8.pendant.mode(1)


# the stop: its function, and whether the motors go off
STOPS: dict[str, tuple[Callable[[TwoArms], None], bool]] = {
    "emergency stop": (lambda cell: cell.rc8.pendant.emergency_stop(), True),
    "protective stop": (lambda cell: cell.rc8.pendant.protective_stop(), True),
    "mode": (_mode, True),
    "auto enable": (lambda cell: cell.rc8.pendant.auto_enable(False), True),
    "error of level 2": (_error(2), False),
    "error of level 3": (_error(3), True),
    "error of level 4": (_error(4), True),
    "error of level 5": (_error(5), True),
    "restart": (lambda cell: cell.rc8.pendant.restart(), True),
    "crash of the control loop": (_crash, True),
    "the client is released": (lambda cell: cell.controller.release(), False),
    "the client is silent": (lambda cell: cell.controller.stop_moving(), False),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("after", [3, 14])
@pytest.mark.parametrize("cause", STOPS)
def test_both_arms_stop_within_their_limits(cell, cause, after):
    stop, motor_off = STOPS[cause]
    moves = [cell.move_of(robot, 1, FAR[robot]) for robot in (0, 1)]
    cell.cycle(after)
    assert all(arm.busy for arm in cell.arms)
    stop(cell)
    cell.cycle(150)
    cell.check_limits()
    for robot, (move, arm) in enumerate(zip(moves, cell.arms, strict=True)):
        assert move.done()
        assert code_of(move.result)
        assert arm.queue.joints[0] != pytest.approx((120, -60)[robot])
        assert (arm.motor.state is MotorState.OFF) is motor_off
    before = [arm.queue.joints for arm in cell.arms]
    cell.cycle(200)  # nothing continues by itself
    assert [arm.queue.joints for arm in cell.arms] == before


@pytest.mark.parametrize("streaming", [0, 1])
@pytest.mark.parametrize(
    "cause", ["emergency stop", "protective stop", "error of level 2", "crash of the control loop"]
)
@pytest.mark.filterwarnings("ignore")
def test_an_arm_in_slave_mode_stops_with_the_other_one(strict, cause, streaming):
    move = strict.move_of(1 - streaming, 1, FAR[1 - streaming])
    strict.of(streaming, "slvChangeMode", J0)
    joints = list(HOME)
    for step in range(1, 15):
        joints[0] += 0.02 * step
        strict.begin(streaming, "slvMove", [*joints, 0.0, 0.0])
        strict.cycle()
    strict.begin(streaming, "slvMove", [joints[0] + 0.3, *joints[1:], 0.0, 0.0])
    STOPS[cause][0](strict)
    strict.cycle(150)
    strict.check_limits()
    assert move.done()
    assert not any(arm.slave.on for arm in strict.arms)
    assert strict.rc8.state.faults.code != hresult.COMMAND_DELAY


def test_a_fault_of_one_arm_stops_the_other_one(cell):
    move = cell.move_of(0, 1, FAR[0])
    cell.of(1, "slvChangeMode", J0)
    cell.begin(1, "slvMove", [30.0, *HOME[1:], 0.0, 0.0])
    cell.cycle(150)
    cell.check_limits()
    assert code_of(move.result) == cell.rc8.state.faults.code
    assert "Arm1" in cell.rc8.state.faults.log.at(0).message
    assert cell.arms[1].queue.joints == HOME


def test_a_failure_at_one_arm_does_not_keep_the_other_one_moving(cell):
    moves = [cell.move_of(robot, 1, FAR[robot]) for robot in (0, 1)]
    cell.cycle(10)
    cell.arms[0].stop_and_power_off = None  # type: ignore[method-assign]  # replaced by the test
    with pytest.raises(TypeError):
        cell.rc8.pendant.emergency_stop()
    del cell.arms[0].stop_and_power_off
    cell.cycle(150)
    assert moves[1].done()
    assert cell.arms[1].motor.state is MotorState.OFF
    cell.rc8.state.robots.stop(hresult.E_ABORT)


def test_a_stop_of_one_robot_leaves_the_other_one(cell):
    moves = [cell.move_of(robot, 1, FAR[robot]) for robot in (0, 1)]
    cell.cycle(10)
    cell.robots[1].halt("")
    assert code_of(lambda: cell.until_done(moves[1])) == hresult.STOPPED_DURING_PC_MOTION
    cell.until_done(moves[0])
    assert cell.arms[0].queue.joints == pytest.approx((120, 20, 110, 40, 30, 90))


def test_releasing_the_objects_of_one_robot_stops_only_its_arm(cell):
    moves = [cell.move_of(robot, 1, FAR[robot]) for robot in (0, 1)]
    cell.cycle(10)
    cell.robots[1].release()
    assert code_of(lambda: cell.until_done(moves[1])) == hresult.STOPPED_DURING_PC_MOTION
    cell.until_done(moves[0])


def test_closing_ends_all_calls():
    cell = TwoArms().take()
    moves = [cell.move_of(robot, 1, FAR[robot]) for robot in (0, 1)]
    cell.cycle(10)
    cell.close()
    assert [code_of(move.result) for move in moves] == [hresult.E_ABORT] * 2
    assert not any(arm.motor.on for arm in cell.arms)


def test_a_client_moves_if_one_of_its_arms_moves(cell):
    assert not cell.controller.is_moving()
    move = cell.move_of(1, 1, FAR[1])
    assert cell.controller.is_moving()
    cell.until_done(move)
    assert not cell.controller.is_moving()


def test_kill_all_waits_for_both_arms(cell):
    for robot in (0, 1):
        cell.move_of(robot, 1, FAR[robot], "SPEED=20,NEXT")
    cell.cycle(10)
    killed = cell.controller.execute("KillAll", variant(1))
    cell.robots[0].halt("")
    cell.cycle(60)
    assert not cell.arms[0].busy
    assert not killed.done()
    cell.run(killed)
    assert not cell.arms[1].busy


def test_the_state_of_the_system_is_that_of_both_arms(cell):
    def bits() -> tuple[bool, bool]:
        state = int(cell.run(cell.controller.execute("SysState", variant(None))))
        return bool(state & 1 << 2), bool(state & 1 << 20)

    assert bits() == (True, False)
    cell.move_of(1, 1, FAR[1])
    cell.cycle(3)
    assert bits() == (True, True)
    cell.robots[1].halt("")
    cell.cycle(100)
    cell.of(1, "Motor", [0, 0])
    assert bits() == (False, False)


def test_the_machine_lock_concerns_both_arms(cell):
    assert code_of(lambda: cell.rc8.pendant.machine_lock()) == hresult.MOTOR_IS_ON
    cell.of(0, "Motor", [0, 0])
    assert code_of(lambda: cell.rc8.pendant.machine_lock()) == hresult.MOTOR_IS_ON
    cell.of(1, "Motor", [0, 0])
    cell.rc8.pendant.machine_lock()
    assert all(arm.servo.frozen for arm in cell.arms)


# --- slave mode -------------------------------------------------------------------------------------------------------


def test_two_clients_stream_to_one_arm_each(cell):
    cell.of(1, "GiveArm")
    other = cell.connect().get_robot("", "ID=1")
    other.execute("TakeArm", variant([0, 0]))
    robots = [cell.robots[0], other]
    for robot in robots:
        cell.run(robot.execute("slvChangeMode", variant(J0)))
    for step in range(1, 40):
        for number, robot in enumerate(robots):
            joints = [0.05 * step * (1 if number else -1), *HOME[1:], 0.0, 0.0]
            robot.execute("slvMove", variant(joints))
        cell.cycle()
    assert [arm.queue.joints[0] for arm in cell.arms] == pytest.approx([-1.95, 1.95])
    robots[0].execute("slvChangeMode", variant(0))
    other.execute("slvMove", variant([1.95, *HOME[1:], 0.0, 0.0]))
    cell.cycle()
    other.execute("slvMove", variant([1.95, *HOME[1:], 0.0, 0.0]))
    cell.cycle(10)
    assert not cell.arms[0].slave.on
    assert cell.rc8.state.cycles.pace is not None  # the other arm is still in slave mode
    cell.run(other.execute("slvChangeMode", variant(0)))
    assert cell.rc8.state.cycles.pace is None
    assert cell.rc8.state.faults.code == 0


def test_time_stands_still_while_one_of_two_clients_is_late(cell):
    """Both arms stop with the controller's time; the set-point that then arrives is late, that of the other arm is not."""
    for robot in (0, 1):
        cell.of(robot, "slvChangeMode", J0)
    for step in range(1, 10):
        for robot in (0, 1):
            cell.begin(robot, "slvMove", [0.05 * step, *HOME[1:], 0.0, 0.0])
        cell.cycle()
    for number in range(10, 15):  # the second client sends on, the first one is late
        if number < 13:
            cell.begin(1, "slvMove", [0.05 * number, *HOME[1:], 0.0, 0.0])
        cell.cycle()
    assert [arm.queue.joints[0] for arm in cell.arms] == pytest.approx([0.45, 0.45])
    cell.begin(0, "slvMove", [0.5, *HOME[1:], 0.0, 0.0])
    cell.cycle()
    assert [arm.queue.joints[0] for arm in cell.arms] == pytest.approx([0.5, 0.5])
    assert [arm.slave.lateness(0).count for arm in cell.arms] == [1, 0]


def test_a_late_client_ends_slave_mode_of_both_arms(strict):
    for robot in (0, 1):
        strict.of(robot, "slvChangeMode", J0)
    for step in range(1, 10):
        for robot in (0, 1):
            strict.begin(robot, "slvMove", [0.05 * step, *HOME[1:], 0.0, 0.0])
        strict.cycle()
    strict.begin(1, "slvMove", [0.5, *HOME[1:], 0.0, 0.0])
    strict.cycle(50)
    assert strict.rc8.state.faults.code == hresult.COMMAND_DELAY
    assert not any(arm.slave.on for arm in strict.arms)
    strict.check_limits()


def test_the_connection_of_a_stream_is_refused_commands_of_both_robots(cell):
    cell.of(1, "slvChangeMode", J0)
    assert cell.code_of(lambda: cell.begin(0, "Motor", [0, 0])) == hresult.REFUSED_IN_SLAVE_MODE
    assert cell.of(0, "slvGetMode") == 0
    assert cell.of(1, "slvGetMode") == J0


def test_the_connection_of_a_stream_is_refused_functions_of_both_robots(cell):
    """The functions of CaoRobot, which are no commands, and the writable variables; Halt is always accepted."""
    cell.of(1, "slvChangeMode", J0)
    one = cell.robots[0]
    calls = (
        lambda: cell.move_of(0, 1, FAR[0]),
        lambda: one.rotate(variant("XY"), 5.0, variant("V(0, 0, 0)"), ""),
        one.go_home,
        lambda: one.hold(""),
        lambda: one.unhold(""),
        lambda: one.speed(-1, 50.0),
        lambda: one.accelerate(-1, 50.0, 50.0),
        lambda: one.change("Tool1"),
        lambda: one.get_variable("@SPEED", "").put_value(variant(50.0)),
        lambda: one.get_variable("@SERVO_ON", "").put_value(variant(False)),
        lambda: one.get_variable("Tool1", "").put_value(variant([0.0] * 6)),
    )
    assert [cell.code_of(call) for call in calls] == [hresult.REFUSED_IN_SLAVE_MODE] * len(calls)
    assert cell.code_of(lambda: one.halt("")) == 0
    assert cell.of(1, "slvGetMode") == J0
    cell.of(1, "slvChangeMode", 0)
    assert cell.code_of(lambda: cell.move_of(0, 1, FAR[0])) == 0


# --- the pendant ------------------------------------------------------------------------------------------------------


def test_the_pendant_moves_the_robot_that_is_chosen(cell):
    pendant = cell.rc8.pendant
    pendant.mode(1)
    cell.cycle(100)
    pendant.deadman()
    pendant.motor(robot=1)
    cell.cycle(200)
    assert [arm.motor.on for arm in cell.arms] == [False, True]
    assert code_of(lambda: pendant.jog(1, 5.0)) == hresult.MOTOR_NOT_ON
    pendant.jog(1, 5.0, robot=1)
    cell.cycle(300)
    assert [arm.queue.joints[0] for arm in cell.arms] == pytest.approx([0, 5])
    assert pendant.status(robot=1)["joints"][0] == pytest.approx(5)
    assert pendant.status()["joints"][0] == 0
    pendant.motor()
    cell.cycle(200)
    assert all(arm.motor.on for arm in cell.arms)
    for robot in (0, 1):
        pendant.jog(1, 20.0, robot=robot)
    cell.cycle(20)
    pendant.deadman(False)
    cell.cycle(100)
    assert not any(arm.busy or arm.motor.on for arm in cell.arms)
    assert all(arm.queue.joints[0] < 19 for arm in cell.arms)
    pendant.speed(30, robot=1)
    assert [cell.of(robot, "CurExtSpd") for robot in (0, 1)] == [100, 30]
    with pytest.raises(ValueError, match="robot 2"):
        pendant.jog(1, 5.0, robot=2)
    with pytest.raises(ValueError, match="robot -1"):
        pendant.speed(10, robot=-1)


def test_the_control_port_chooses_a_robot_with_an_option(cell):
    provider = ControlProvider(cell.rc8, secret="s" * 20)
    panel = provider.connect("", "", f"Secret={'s' * 20},Robot=1", ClientInfo("", "tcp"))
    status = cell.run(panel.execute("Status", variant(None)))
    assert '"joints": [0.0, 45.0' in status
    cell.run(panel.execute("Motor", variant([False, True])))
    assert [arm.motor.on for arm in cell.arms] == [True, False]
    panel.execute("Surface", variant(["table", 300.0, 0.0, 100.0, 0.0, 0.0, 0.0]))
    assert [list(each.surfaces) for each in cell.rc8.workspaces] == [[], ["table"]]
    every = provider.connect("", "", f"Secret={'s' * 20}", ClientInfo("", "tcp"))
    cell.run(every.execute("Motor", variant([False, True])))
    assert not any(arm.motor.on for arm in cell.arms)
    for wrong in ("2", "x", "-1"):
        with pytest.raises(CallError):
            provider.connect("", "", f"Secret={'s' * 20},Robot={wrong}", ClientInfo("", "tcp"))


def test_the_calibration_of_one_arm_is_lost(cell):
    assert code_of(lambda: cell.rc8.workspaces[1].lose_calibration()) == hresult.MOTOR_IS_ON
    cell.of(1, "Motor", [0, 0])
    cell.rc8.workspaces[1].lose_calibration()
    assert cell.code_of(lambda: cell.begin(1, "Motor", [1, 0])) == hresult.ENCODER_REFERENCE_LOST
    assert cell.arms[0].hardware.calibrated


# --- the provider -----------------------------------------------------------------------------------------------------


def test_second_joints_place_the_second_arm():
    rc8 = VirtualRC8(second_model="VS-060", second_joints=(10, 30, 90, 0, 60, 0))
    assert rc8.state.robots[1].arm.queue.joints[0] == 10
    rc8.close()
    with pytest.raises(ValueError, match="second_joints"):
        VirtualRC8(second_joints=(10, 30, 90, 0, 60, 0))
    with pytest.raises(ValueError, match="joint position"):
        VirtualRC8(second_model="VS-060", second_joints=(1000, 30, 90, 0, 60, 0))


def test_a_client_of_orinkit_chooses_the_robot():
    rc8 = VirtualRC8(second_model="VS-060", motor=True)
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url) as controller,
        controller.robot("Arm", "ID=1") as robot,
    ):
        assert controller.robot_names() == ["Arm0", "Arm1"]
        with robot.arm():
            assert rc8.state.robots[1].arm.holder is not None
            assert rc8.state.arm.holder is None
    rc8.close()


def test_a_cycle_of_time_is_one_cycle_of_both_arms(cell):
    cell.move_of(0, 1, FAR[0], "NEXT")
    cell.move_of(1, 1, FAR[1], "NEXT")
    number = cell.rc8.state.cycles.number
    cell.clock.advance(10 * PERIOD)
    assert cell.rc8.state.cycles.number == number + 10
