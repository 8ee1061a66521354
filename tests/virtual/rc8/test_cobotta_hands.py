"""The hands of COBOTTA and COBOTTA PRO: vacuum, zones, 2FG7 and VGC10, sent as programs in the field send them."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.guide_client import GuideClient

I4, R4, R8, BOOL = VarType.I4, VarType.R4, VarType.R8, VarType.BOOL


@pytest.fixture
def client():
    made = GuideClient()
    yield made
    made.close()


@pytest.fixture
def hands(client):
    return client.rc8.state.hands


@pytest.mark.field("2.6", "3.2")
def test_commands_of_the_hand_on_the_robot(client):
    assert client.robot_execute("HandMoveA", variant([10.0, 100])).type == VarType.EMPTY
    assert client.robot_execute("HandCurPos") == client.execute("HandCurPos") == Variant(R8, 10.0)
    assert client.robot_execute("HandInposState") == Variant(BOOL, True)
    client.robot_execute("HandMoveR", variant([5.0, 100]))
    assert client.robot_execute("HandCurPos") == Variant(R8, 15.0)
    assert client.robot_execute("HandBusyState") == Variant(BOOL, False)


def test_in_position_only_at_the_target(client, hands):
    hands.cobotta.put(12)
    moving = client.begin("Controller_Execute", client.controller, "HandMoveA", variant([5, 50]))
    assert client.execute("HandInposState").value is False
    client.end(moving)
    assert client.execute("HandInposState").value is False  # the workpiece is in between
    assert client.execute("HandHoldState").value is True


@pytest.mark.field("3.2")
@pytest.mark.parametrize(("width", "inside"), [(12.0, True), (20.0, False)])
def test_a_grip_within_a_zone(width, inside, client, hands):
    hands.cobotta.put(width)
    client.execute("HandMoveZH", variant([10.0, 15.0, 8.0, True]))
    assert client.execute("HandZonState") == Variant(BOOL, inside)
    assert client.execute("HandHoldState") == Variant(BOOL, True)


@pytest.mark.field("3.2")
def test_grip_and_release_with_stored_parameters(client, hands):
    hands.cobotta.put(12)
    client.robot_execute("HandGrip")
    assert client.execute("HandHoldState").value is True
    client.robot_execute("HandRelease")
    assert client.execute("HandCurPos").value == 30.0
    hands.cobotta.put(None)
    assert client.code("Robot_Execute", client.robot, "HandGrip", None) == hresult.GRIP_NOT_DETECTED
    assert client.execute("GetCurErrorInfo", 0).plain[0] == hresult.signed(hresult.GRIP_NOT_DETECTED)


# --- vacuum -----------------------------------------------------------------------------------------------------------


@pytest.mark.field("3.2")
def test_suction_on_a_workpiece(client, hands):
    pressure = [client.execute("HandCurPressure").value]
    hands.vacuum.put(True)
    client.execute("HandMoveVH", variant([100, True]))
    for _ in range(6):
        client.clock.advance(0.2)
        pressure.append(client.execute("HandCurPressure").value)
    assert pressure[0] == 0.0
    assert pressure == sorted(pressure, reverse=True)
    assert pressure[-1] == pytest.approx(-60, abs=1)
    assert client.execute("HandHoldState").value is True
    client.execute("HandStop")
    client.clock.advance(2.0)
    assert client.execute("HandCurPressure").value == pytest.approx(0, abs=0.1)
    assert client.execute("HandHoldState").value is False


def test_suction_without_a_workpiece_does_not_hold(client):
    client.execute("HandMoveVH", variant([100, True]))
    client.clock.advance(2.0)
    assert -10 < client.execute("HandCurPressure").value < -1
    assert client.execute("HandHoldState").value is False
    client.execute("HandMoveVH", variant([100, False]))
    client.clock.advance(2.0)
    assert client.execute("HandCurPressure").value == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("power", [40, 100])
def test_the_load_of_the_pump_rises_with_time_and_power(power, client, hands):
    hands.vacuum.start(power)
    for _ in range(round(600 / PERIOD)):
        hands.vacuum.step()
    assert client.execute("HandCurLoad").value == pytest.approx(120 * power / 100 * 0.865, rel=0.01)
    assert client.execute("HandCurLoad").type == R8


@pytest.mark.parametrize(("parameter", "code"), [
    ([101, True], hresult.VALUE_OUT_OF_RANGE), ([-1, True], hresult.VALUE_OUT_OF_RANGE), ([50], hresult.E_INVALIDARG),
])  # fmt: skip
def test_refused_suction(parameter, code, client):
    assert client.code("Controller_Execute", client.controller, "HandMoveVH", variant(parameter)) == code


# --- 2FG7 -------------------------------------------------------------------------------------------------------------


def two(client, name, parameter=None):
    return client.robot_execute(f"Twofg{name}", parameter)


@pytest.mark.field("3.2")
def test_the_widths_of_a_2fg7(client):
    widths = []
    for orientation in (1, 2):
        two(client, "SetOrientation", orientation)
        for mode in ("External", "Internal"):
            two(client, f"SwitchTo{mode}")
            widths.append((two(client, "GetMinWidth"), two(client, "GetMaxWidth")))
    assert [(low.value, high.value) for low, high in widths] == [(1, 39), (11, 49), (35, 73), (45, 83)]
    assert {each.type for pair in widths for each in pair} == {R4}
    two(client, "SetFTWidth", 8)
    assert two(client, "GetMinWidth") == Variant(R4, 51.0)
    two(client, "SetFingerLength", 9.5)
    assert two(client, "GetFingerLength") == Variant(R4, 9.5)
    assert (two(client, "GetMode"), two(client, "GetOrientation")) == (Variant(I4, 2), Variant(I4, 2))
    assert (two(client, "IsConn"), two(client, "GetErrorCode")) == (Variant(I4, 1), Variant(I4, 0))


@pytest.mark.field("3.2")
def test_a_2fg7_grips_and_releases(client, hands):
    hands.two_finger.put(20.0)
    two(client, "Grip", [Variant(R4, 10.0), Variant(I4, 30), Variant(I4, 100), Variant(I4, 1)])
    assert two(client, "GetWidth") == Variant(R4, 20.0)
    assert (two(client, "IsGrip"), two(client, "GetForce"), two(client, "IsBusy")) == (
        Variant(I4, 1), Variant(I4, 30), Variant(I4, 0),
    )  # fmt: skip
    two(client, "Release", variant([39.0, 1]))
    assert (two(client, "GetWidth").value, two(client, "IsGrip").value) == (39.0, 0)


def test_a_grip_that_is_not_waited_for(client):
    two(client, "Grip", variant([5.0, 20, 10, 0]))
    assert two(client, "IsBusy").value == 1
    client.clock.advance(2.0)
    assert (two(client, "IsBusy").value, two(client, "IsGrip").value, two(client, "GetWidth").value) == (0, 0, 5.0)
    assert client.execute("GetCurErrorCount").value == 0


def test_a_grip_of_nothing_is_an_error_of_the_controller(client):
    grip = ("Robot_Execute", client.robot, "TwofgGrip", variant([5.0, 20, 100, 1]))
    assert client.code(*grip) == hresult.GRIP_NOT_DETECTED
    assert client.execute("GetCurErrorCount").value == 1


def test_a_ring_is_gripped_from_inside(client, hands):
    two(client, "SwitchToInternal")
    two(client, "Release", variant([15.0, 1]))
    hands.two_finger.put(30.0, inside=True)
    two(client, "Grip", variant([45.0, 40, 100, 1]))
    assert (two(client, "GetWidth").value, two(client, "IsGrip").value) == (30.0, 1)


def test_stopping_a_2fg7(client):
    moving = client.begin("Robot_Execute", client.robot, "TwofgRelease", variant([1.0, 1]))
    client.clock.advance(0.05)
    two(client, "Stop")
    assert client.end(moving).code == hresult.STOPPED_DURING_PC_MOTION
    assert 1 < two(client, "GetWidth").value < 39


@pytest.mark.parametrize(
    ("command", "parameter"),
    [
        ("TwofgGrip", [0.5, 20, 50, 1]),
        ("TwofgGrip", [40.0, 20, 50, 1]),
        ("TwofgGrip", [10.0, 19, 50, 1]),
        ("TwofgGrip", [10.0, 141, 50, 1]),
        ("TwofgGrip", [10.0, 20, 9, 1]),
        ("TwofgRelease", [50.0, 1]),
        ("TwofgSetOrientation", 3),
        ("TwofgSetFTWidth", -1),
        ("Vgc10Grip", [3, 50, 1]),
        ("Vgc10Grip", [0, 101, 1]),
        ("Vgc10Release", 4),
    ],
)
def test_refused_parameters_of_onrobot_hands(command, parameter, client):
    call = ("Robot_Execute", client.robot, command, variant(parameter))
    assert client.code(*call) == hresult.VALUE_OUT_OF_RANGE


# --- VGC10 ------------------------------------------------------------------------------------------------------------


@pytest.mark.field("3.2")
def test_the_channels_of_a_vgc10(client, hands):
    hands.vacuum_gripper.channels[0].put(True)
    client.robot_execute("Vgc10Grip", variant([1, 80, 1]))
    assert client.robot_execute("Vgc10IsGrip", 1) == Variant(I4, 1)
    assert client.robot_execute("Vgc10IsGrip", 2) == Variant(I4, 0)
    assert client.robot_execute("Vgc10GetVacuum", 1).value > 20
    assert client.robot_execute("Vgc10GetVacuum", 2) == Variant(R4, 0.0)
    client.robot_execute("Vgc10Release", 1)
    client.clock.advance(1.0)
    assert client.robot_execute("Vgc10IsGrip", 1) == Variant(I4, 0)
    grip = ("Robot_Execute", client.robot, "Vgc10Grip", variant([2, 80, 1]))
    assert client.code(*grip) == hresult.GRIP_NOT_DETECTED
    assert client.robot_execute("Vgc10IsConn") == Variant(I4, 1)


def test_a_vgc10_that_is_not_waited_for(client):
    client.robot_execute("Vgc10Grip", variant([0, 60, 0]))
    client.clock.advance(3.0)
    assert client.execute("GetCurErrorCount").value == 0
