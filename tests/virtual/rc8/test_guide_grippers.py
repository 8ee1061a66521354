"""Electric grippers as the provider guide describes them (5.2.36), called with exact types."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.rc8.hand.gripper import Point, PointMode
from support.guide_client import GuideClient

I4, R4 = VarType.I4, VarType.R4
BUSY, OUT_OF_RANGE = hresult.E_CAO_CMD_EXECUTE, hresult.VALUE_OUT_OF_RANGE


class Hand:
    """An extension of a client."""

    def __init__(self, client: GuideClient, name: str = "Hand0") -> None:
        self.client = client
        self.gripper = client.rc8.state.hands.fingers(name)
        self.handle = client.value("Controller_GetExtension", client.controller, name, "")

    def do(self, command, parameter=None):
        return self.client.call("Extension_Execute", self.handle, command, parameter)

    def code(self, command, parameter=None):
        return self.client.code("Extension_Execute", self.handle, command, parameter)

    def begin(self, command, parameter=None):
        return self.client.begin("Extension_Execute", self.handle, command, parameter)

    def states(self, *names):
        found = [self.do(f"get_{name}") for name in names]
        assert all(each.type == I4 for each in found)
        return tuple(each.value for each in found)


@pytest.fixture
def client():
    made = GuideClient(hands=(0, 2))
    yield made
    made.close()


@pytest.fixture
def new_hand(client):
    return Hand(client)


@pytest.fixture
def hand(new_hand):
    new_hand.do("Motor", 1)
    new_hand.do("Org")
    return new_hand


@pytest.mark.guide("5.2.6 AddExtension")
def test_the_boards_that_are_fitted(client):
    assert client.value("Controller_GetExtensionNames", client.controller, "") == ["Hand0", "Hand2"]
    Hand(client, "Hand2").do("Motor", 1)
    assert Hand(client, "hand2").states("MotorState") == (1,)
    assert Hand(client, "Hand0").states("MotorState") == (0,)
    for name in ("Hand1", "Hand7", "Hand8", "Hand", "Hand00"):
        assert client.code("Controller_GetExtension", client.controller, name, "") == hresult.E_CAO_OBJECT_NOTFOUND


@pytest.mark.parametrize("boards", [(8,), (-1,), (0, 9)])
def test_boards_that_do_not_exist(boards):
    with pytest.raises(ValueError, match="0 to 7"):
        GuideClient(hands=boards)


@pytest.mark.guide("5.2.36.3 Motor", "5.2.36.22 get_MotorState", "5.2.36.15 get_EmgState")
def test_motor(new_hand, client):
    assert new_hand.states("MotorState", "EmgState") == (0, 1)
    assert new_hand.code("Org") == hresult.MOTOR_NOT_ON
    assert new_hand.do("Motor", 1).type == VarType.EMPTY
    new_hand.do("Motor", Variant(I4, 5))  # on already
    assert new_hand.states("MotorState") == (1,)
    client.rc8.emergency_stop(True)
    assert new_hand.states("EmgState") == (0,)
    new_hand.do("Motor", 0)
    new_hand.do("Motor", 1)  # stays off, without an error
    assert new_hand.states("MotorState") == (0,)


@pytest.mark.guide("5.2.36.4 Org", "5.2.36.17 get_OrgState", "5.2.36.21 get_BusyState")
def test_the_origin_is_needed_after_power_on(new_hand, client):
    new_hand.do("Motor", 1)
    assert new_hand.states("OrgState", "BusyState") == (0, 0)
    assert new_hand.code("MoveA", variant([10, 50])) == hresult.CALSET_NOT_DONE
    assert new_hand.do("Org", "NEXT").type == VarType.EMPTY
    client.clock.advance(1)
    new_hand.gripper.position = 10.0
    returning = new_hand.begin("Org")
    assert new_hand.states("OrgState", "BusyState") == (0, 1)
    assert client.end(returning).code == 0
    assert new_hand.states("OrgState", "BusyState") == (1, 0)
    assert new_hand.do("CurPos") == Variant(R4, 30.0)
    assert new_hand.code("MoveA", variant([10, 50])) == 0
    client.rc8.state.restart()
    assert new_hand.states("OrgState", "MotorState") == (0, 0)


@pytest.mark.guide("5.2.36.6 MoveA", "5.2.36.7 MoveR", "5.2.36.13 CurPos", "5.2.36.19 get_InposState")
def test_moving_to_a_position_and_by_a_distance(hand, client):
    moving = hand.begin("MoveA", [Variant(R4, 12.5), Variant(I4, 100)])
    assert hand.states("InposState", "BusyState") == (0, 1)
    assert client.end(moving).code == 0
    assert hand.do("CurPos") == Variant(R4, 12.5)
    assert hand.states("InposState", "BusyState", "HoldState") == (1, 0, 0)
    assert hand.code("MoveR", variant([-2.5, 20])) == 0
    assert hand.do("CurPos") == Variant(R4, 10.0)


def test_speed_has_an_effect(hand, client):
    def seconds(speed):
        hand.do("MoveA", variant([30, 100]))
        before = client.clock.now()
        hand.do("MoveA", variant([0, speed]))
        return client.clock.now() - before

    assert seconds(20) > 3 * seconds(100)


@pytest.mark.guide("5.2.36.8 MoveAH", "5.2.36.9 MoveRH", "5.2.36.18 get_HoldState")
@pytest.mark.parametrize(("command", "target"), [("MoveAH", 5.0), ("MoveRH", -25.0)])
@pytest.mark.parametrize("force", [30, 100])
def test_moving_and_holding(command, target, force, hand):
    hand.gripper.put(12.5)
    hand.do(command, [Variant(R4, target), Variant(I4, 100), Variant(I4, force)])
    assert hand.states("HoldState", "InposState", "Error") == (1, 0, 0)
    assert hand.gripper.load == pytest.approx(force)
    hand.gripper.put(None)
    assert hand.states("HoldState") == (0,)


@pytest.mark.guide("5.2.36.10 MoveH")
def test_holding_at_a_constant_speed(hand):
    hand.gripper.put(8)
    assert hand.code("MoveH", variant([50, 40, 1])) == 0
    assert (hand.states("HoldState"), hand.do("CurPos").value) == ((1,), 8.0)
    hand.gripper.put(None)
    assert hand.code("MoveH", variant([50, 40, 1])) == 0  # nothing to hold is not an error
    assert (hand.states("HoldState"), hand.do("CurPos").value) == ((0,), 0.0)
    hand.gripper.put(15, inside=True)
    assert hand.code("MoveH", variant([20, 30, 0])) == 0
    assert (hand.states("HoldState"), hand.do("CurPos").value) == ((1,), 15.0)


@pytest.mark.guide("5.2.36.11 MoveZH", "5.2.36.16 get_ZonState")
@pytest.mark.parametrize(("width", "zone"), [(12, 1), (4, 0), (None, 0)])
def test_holding_within_a_zone(width, zone, hand):
    hand.gripper.put(width)
    assert hand.code("MoveZH", [Variant(R4, 10.0), Variant(R4, 15.0), *variant([50, 50, 1]).value]) == 0
    assert hand.states("ZonState", "HoldState") == (zone, int(width is not None))
    hand.do("MoveA", variant([30, 100]))
    assert hand.states("ZonState") == (0,)


@pytest.mark.guide("5.2.36.1 Chuck", "5.2.36.2 UnChuck", "5.2.36.5 MoveP", "5.2.36.14 GetPoint")
def test_points(hand):
    hand.gripper.points = [Point(PointMode.ABSOLUTE, 20 + n / 10) for n in range(31)] + [
        Point(PointMode.ZONE_HOLD, 1, 40, 60, (5.0, 15.0))
    ]
    items = [hand.do("GetPoint", variant([31, item])) for item in range(6)]
    assert [each.type for each in items] == [I4, R4, I4, I4, R4, R4]
    assert [each.value for each in items] == [5, 1.0, 40, 60, 5.0, 15.0]
    hand.gripper.put(10)
    assert hand.code("Chuck", 31) == 0
    assert hand.states("HoldState", "ZonState") == (1, 1)
    assert hand.code("UnChuck", Variant(I4, 5)) == 0
    assert hand.do("CurPos").value == 20.5
    assert hand.code("MoveP", 30) == 0
    assert hand.do("CurPos").value == 23.0
    assert hand.code("Chuck", 5) == OUT_OF_RANGE  # its mode does not hold


def test_the_points_that_are_stored_initially(hand):
    hand.gripper.put(12)
    assert hand.code("Chuck", 0) == 0
    assert hand.states("HoldState") == (1,)
    assert hand.code("UnChuck", 1) == 0
    assert hand.do("CurPos").value == 30.0
    assert hand.code("Chuck", 30) == 0


@pytest.mark.guide("5.2.36.12 Stop")
def test_stop(hand, client):
    moving = hand.begin("MoveA", variant([0, 20]))
    client.clock.advance(0.2)
    assert hand.do("Stop").type == VarType.EMPTY
    assert client.end(moving).code == hresult.STOPPED_DURING_PC_MOTION
    assert 0 < hand.do("CurPos").value < 30
    assert hand.states("BusyState", "InposState", "OrgState") == (0, 0, 1)


MOVES = [
    ("Chuck", 0), ("UnChuck", 1), ("Motor", 1), ("Motor", 0), ("Org", None), ("MoveP", 1), ("MoveA", [10, 50]), ("MoveR", [-1, 50]),
    ("MoveAH", [10, 50, 50]), ("MoveRH", [-1, 50, 50]), ("MoveH", [50, 50, 1]), ("MoveZH", [1, 2, 50, 50, 1]),
]  # fmt: skip


@pytest.mark.parametrize(("command", "parameter"), MOVES)
def test_what_is_refused_while_the_gripper_is_busy(command, parameter, hand, client):
    moving = hand.begin("MoveA", variant([5, 20]))
    client.clock.advance(0.1)
    assert hand.code(command, variant(parameter)) == BUSY
    assert client.end(moving).code == 0
    assert hand.do("CurPos").value == 5.0
    assert hand.code(command, variant(parameter)) == 0


@pytest.mark.guide("5.2.36.20 get_Error")
def test_an_error_requires_a_return_to_the_origin(hand, client):
    hand.gripper.put(10)
    assert hand.code("MoveA", variant([5, 50])) == hresult.STOPPED_DURING_PC_MOTION
    assert hand.states("Error", "OrgState", "HoldState") == (2, 0, 0)
    assert hand.code("MoveA", variant([20, 50])) == hresult.CALSET_NOT_DONE
    assert hand.code("Org") == 0
    assert hand.states("Error", "OrgState") == (0, 1)
    hand.gripper.put(None)
    moving = hand.begin("MoveA", variant([5, 20]))
    client.clock.advance(0.1)
    client.rc8.emergency_stop(True)
    assert client.end(moving).code == hresult.EMERGENCY_STOP_ON
    assert hand.states("Error", "OrgState", "MotorState", "EmgState") == (1, 0, 0, 0)
    client.rc8.emergency_stop(False)
    hand.do("Motor", 1)
    assert hand.code("Org") == 0


@pytest.mark.parametrize(
    ("command", "parameter", "code"),
    [
        ("MoveA", [1000, 50], OUT_OF_RANGE),
        ("MoveA", [-1000, 50], OUT_OF_RANGE),
        ("MoveA", [30.5, 50], OUT_OF_RANGE),
        ("MoveA", [10, 19], OUT_OF_RANGE),
        ("MoveA", [10, 101], OUT_OF_RANGE),
        ("MoveA", [10], hresult.E_INVALIDARG),
        ("MoveA", [10, 50.5], hresult.E_INVALIDARG),
        ("MoveR", [31, 50], OUT_OF_RANGE),
        ("MoveAH", [10, 50, 29], OUT_OF_RANGE),
        ("MoveAH", [10, 50, 101], OUT_OF_RANGE),
        ("MoveH", [51, 50, 1], OUT_OF_RANGE),
        ("MoveH", [19, 50, 1], OUT_OF_RANGE),
        ("MoveZH", [1000, 2, 50, 50, 1], OUT_OF_RANGE),
        ("MoveZH", [50, 50, 1], hresult.E_INVALIDARG),
        ("Chuck", 32, OUT_OF_RANGE),
        ("UnChuck", -1, OUT_OF_RANGE),
        ("MoveP", "x", hresult.DISP_E_TYPEMISMATCH),
        ("GetPoint", [0, 6], OUT_OF_RANGE),
        ("GetPoint", [32, 0], OUT_OF_RANGE),
        ("GetPoint", [0], hresult.E_INVALIDARG),
        ("Squeeze", None, hresult.E_INVALID_CMD_NAME),
    ],
)
def test_refused_parameters(command, parameter, code, hand):
    assert hand.code(command, variant(parameter)) == code
    assert hand.states("BusyState", "Error") == (0, 0)


def test_parameters_as_arrays_of_numbers_and_as_text(hand):
    assert hand.code("MoveA", Variant(R4 | ARRAY, [12.0, 50.0])) == 0
    assert hand.code("MoveA", "14, 50") == 0
    assert hand.do("CurPos").value == 14.0


@pytest.mark.field("3.2")
def test_grasp_and_release_of_the_robot(hand, client):
    hand.gripper.put(9)
    assert client.code("Robot_Chuck", client.robot, "") == 0
    assert hand.states("HoldState") == (1,)
    assert client.code("Robot_Unchuck", client.robot, "3") == 0
    assert hand.do("CurPos").value == 30.0
    assert client.code("Robot_Chuck", client.robot, "1") == OUT_OF_RANGE


def test_without_a_gripper():
    client = GuideClient(hands=())
    assert client.value("Controller_GetExtensionNames", client.controller, "") == []
    assert client.code("Robot_Chuck", client.robot, "") == hresult.E_NOTIMPL
    client.close()
