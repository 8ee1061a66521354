from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao.outcomes import Pending
from orinkit.cao.provider import Deferred
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.hand.cobotta import ACCELERATION, SPEED, STROKE
from orinkit.virtual.rc8.hand.fingers import Workpiece

EMPTY = Variant(VarType.EMPTY)
R8, BOOL = VarType.R8, VarType.BOOL


@pytest.fixture
def hand(rc8):
    return rc8.state.hand


@pytest.fixture
def execute(controller):
    return lambda command, parameter=None: controller.execute(command, variant(parameter))


def code(deferred: Deferred[None]) -> int:
    """Return the code with which a Deferred failed, 0 if it succeeded."""
    assert deferred.done()
    try:
        deferred.result()
    except CallError as error:
        return error.code
    return 0


def seconds_of(clock: ManualClock, deferred: Deferred[None]) -> float:
    begun = clock.now()
    while not deferred.done():
        clock.advance(PERIOD)
        assert clock.now() - begun < 60
    return clock.now() - begun


# --- moving -----------------------------------------------------------------------------------------------------------


def test_a_movement_takes_its_time(execute, clock, hand):
    assert execute("HandCurPos") == Variant(R8, STROKE)
    deferred = execute("HandMoveA", [10, 50])
    assert not deferred.done()
    assert execute("HandBusyState") == Variant(BOOL, True)
    took = seconds_of(clock, deferred)
    ideal = 20 / (SPEED / 2) + SPEED / 2 / ACCELERATION  # a trapezoid
    assert took == pytest.approx(ideal, abs=3 * PERIOD)
    assert code(deferred) == 0
    assert (hand.position, hand.busy, hand.holding) == (10.0, False, False)
    assert execute("HandBusyState") == Variant(BOOL, False)


def test_speed_and_acceleration_are_kept_in_every_cycle(execute, clock, hand):
    execute("HandMoveA", [0, 100])
    ways = [0.0]
    while hand.busy:
        before = hand.position
        clock.advance(PERIOD)
        ways.append(before - hand.position)
    assert max(ways) == pytest.approx(SPEED * PERIOD)
    assert all(way >= 0 for way in ways)
    most = ACCELERATION * PERIOD * PERIOD
    assert all(abs(after - before) <= 2.1 * most for before, after in pairwise(ways))
    assert all(after - before <= most * 1.001 for before, after in pairwise(ways))


@given(start=st.floats(0, STROKE), target=st.floats(0, STROKE), speed=st.floats(1, 100))
def test_every_movement_arrives(start, target, speed):
    clock = ManualClock()
    device = VirtualRC8(clock=clock, samples=False)
    hand = device.state.hand
    hand.position = start
    deferred = hand.move(target, speed)
    ideal = abs(target - start) / (SPEED * speed / 100) + SPEED * speed / 100 / ACCELERATION
    clock.advance(ideal + 5 * PERIOD)
    assert code(deferred) == 0
    assert hand.position == target
    device.close()


@pytest.mark.parametrize(
    ("command", "parameter", "position"),
    [
        ("HandMoveA", [0, 100], 0.0),
        ("handmovea", ["12.5", "100"], 12.5),
        ("HandMoveA", "12.5,100", 12.5),
        ("HandMoveA", Variant(VarType.R4 | 0x2000, [7.5, 80.0]), 7.5),
        (" HANDMOVER ", [-5, 100], 25.0),
        ("HandMoveR", [0, 1], 30.0),
        ("HandMoveAH", [5, 100, 10], 5.0),
        ("HandMoveRH", [-2.5, 100, 6], 27.5),
    ],
)
def test_where_movements_go(command, parameter, position, execute, clock, hand):
    deferred = execute(command, parameter)
    clock.advance(2)
    assert (code(deferred), hand.position, hand.holding) == (0, position, False)


@pytest.mark.parametrize(
    ("command", "parameter"),
    [("HandMoveA", [5, 100]), ("HandMoveR", [-25, 100]), ("HandMoveAH", [5, 100, 20]), ("HandMoveRH", [-25, 100, 20])],
)
def test_next_answers_at_once(command, parameter, execute, clock, hand):
    assert execute(command, [*parameter, "Next"]) is None
    assert hand.busy
    clock.advance(2)
    assert hand.position == 5.0


@pytest.mark.parametrize(
    ("command", "parameter", "refusal"),
    [
        ("HandMoveA", [-0.1, 100], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveA", [30.1, 100], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveA", [1e300, 100], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveA", [10, 0.9], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveA", [10, 101], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveR", [0.1, 50], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveR", [-30.1, 50], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveAH", [10, 50, 5.9], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveAH", [10, 50, 20.1], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveH", [21, True], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveH", [10, 2], hresult.DISP_E_OVERFLOW),
        ("HandMoveA", [math.nan, 50], hresult.E_INVALIDARG),
        ("HandMoveA", [10, math.inf], hresult.E_INVALIDARG),
        ("HandMoveA", [10], hresult.E_INVALIDARG),
        ("HandMoveA", [10, 50, 10], hresult.E_INVALIDARG),
        ("HandMoveA", None, hresult.E_INVALIDARG),
        ("HandMoveA", "", hresult.E_INVALIDARG),
        ("HandMoveA", "," * 100_000, hresult.E_INVALIDARG),
        ("HandMoveA", [10, "fast"], hresult.DISP_E_TYPEMISMATCH),
        ("HandMoveA", ["9" * 5000, 50], hresult.DISP_E_TYPEMISMATCH),
        ("HandMoveH", [10], hresult.E_INVALIDARG),
        ("HandMoveZH", [10, 50], hresult.E_INVALIDARG),
        ("HandMoveZH", [10, 31, 10, True], hresult.VALUE_OUT_OF_RANGE),
        ("HandMoveX", None, hresult.E_INVALID_CMD_NAME),
    ],
)
def test_refused_commands(command, parameter, refusal, execute, refused, hand):
    assert refused(execute, command, parameter) == refusal
    assert (hand.busy, hand.position) == (False, STROKE)


@pytest.mark.parametrize("arguments", [(math.nan, 50), (10, math.nan), (10, 50, math.nan), (10, 50, math.inf)])
def test_the_mechanism_refuses_numbers_that_are_not_finite(arguments, hand, refused):
    assert refused(hand.move, *arguments) == hresult.VALUE_OUT_OF_RANGE


def test_a_new_command_replaces_the_one_before(execute, clock, hand):
    first = execute("HandMoveA", [0, 100])
    clock.advance(0.1)
    second = execute("HandMoveA", [30, 100])
    assert code(first) == hresult.STOPPED_DURING_PC_MOTION
    clock.advance(1)
    assert (code(second), hand.position) == (0, 30.0)


def test_one_that_is_refused_replaces_nothing(execute, clock, hand, refused):
    deferred = execute("HandMoveA", [0, 100])
    clock.advance(0.1)
    refused(execute, "HandMoveA", [99, 100])
    clock.advance(1)
    assert (code(deferred), hand.position) == (0, 0.0)


def test_stop(execute, clock, hand):
    deferred = execute("HandMoveA", [0, 100])
    clock.advance(0.1)
    assert execute("HandStop") is None
    where = hand.position
    assert code(deferred) == hresult.STOPPED_DURING_PC_MOTION
    clock.advance(1)
    assert 0 < hand.position == where < STROKE
    assert execute("HandStop") is None  # no movement


def test_an_emergency_stop_ends_a_movement_but_not_a_grip(rc8, execute, clock, hand, refused):
    hand.put(10)
    execute("HandMoveH", [12, True])
    clock.advance(1)
    assert hand.holding
    rc8.emergency_stop(True)
    assert hand.holding
    assert refused(execute, "HandMoveA", [30, 100]) == hresult.EMERGENCY_STOP_ON
    rc8.emergency_stop(False)
    deferred = execute("HandMoveA", [30, 100])
    clock.advance(0.1)
    rc8.emergency_stop(True)
    clock.advance(PERIOD)
    where = hand.position
    assert code(deferred) == hresult.EMERGENCY_STOP_ON
    clock.advance(1)
    assert 10 < hand.position == where < STROKE


def test_cycles_end_when_the_hand_stands(rc8, execute, clock):
    execute("HandMoveA", [29, 100])
    assert rc8.state.cycles.busy
    clock.advance(1)
    assert not rc8.state.cycles.busy


# --- gripping ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "parameter", "force"),
    [
        ("HandMoveH", [8, True], 8.0),
        ("HandMoveH", [8, -1], 8.0),
        ("HandMoveAH", [0, 50, 11], 11.0),
        ("HandMoveRH", [-30, 50, 6], 6.0),
        ("HandMoveA", [0, 50], 20.0),
        ("HandMoveR", [-18, 100], 20.0),
    ],
)
def test_closing_stops_at_a_workpiece_and_holds_it(command, parameter, force, execute, clock, hand):
    hand.put(12.5)
    deferred = execute(command, parameter)
    clock.advance(3)
    assert code(deferred) == 0
    assert (hand.position, hand.force) == (12.5, force)
    assert execute("HandHoldState") == Variant(BOOL, True)
    assert execute("HandCurLoad").value == pytest.approx(force / 20 * 100)


def test_a_hand_that_opens_lets_go(execute, clock, hand):
    hand.put(12.5)
    execute("HandMoveH", [10, True])
    clock.advance(1)
    execute("HandMoveA", [13, 100])
    assert execute("HandHoldState") == Variant(BOOL, False)
    clock.advance(1)
    assert (hand.position, hand.force, hand.workpiece) == (13.0, 0.0, Workpiece(12.5))
    execute("HandMoveH", [10, True])  # the workpiece is still there
    clock.advance(1)
    assert hand.holding


def test_gripping_nothing_is_an_error(execute, clock, hand):
    deferred = execute("HandMoveH", [10, True])
    clock.advance(1)
    assert code(deferred) == hresult.GRIP_NOT_DETECTED
    assert (hand.position, hand.holding, hand.load) == (0.0, False, 0.0)


def test_moving_with_force_to_a_position_is_not_a_grip(execute, clock, hand):
    """Users open the hand with HandMoveAH, and close it step by step until it grips."""
    assert code_after(execute("HandMoveAH", [25, 100, 6]), clock) == 0
    assert code_after(execute("HandMoveAH", [30, 100, 6]), clock) == 0
    assert hand.position == 30.0


def code_after(deferred: Deferred[None], clock: ManualClock) -> int:
    clock.advance(1)
    return code(deferred)


def test_a_ring_is_gripped_by_opening(execute, clock, hand):
    execute("HandMoveA", [5, 100])
    clock.advance(1)
    hand.put(15, inside=True)
    assert code_after(execute("HandMoveH", [10, False]), clock) == 0
    assert (hand.position, hand.holding) == (15.0, True)
    hand.put(None)
    assert code_after(execute("HandMoveH", [10, False]), clock) == hresult.GRIP_NOT_DETECTED
    assert hand.position == STROKE


def test_a_workpiece_is_taken_out_of_the_fingers(execute, clock, hand):
    hand.put(12.5)
    execute("HandMoveH", [10, True])
    clock.advance(1)
    hand.put(None)
    assert execute("HandHoldState") == Variant(BOOL, False)
    assert hand.position == 12.5


@pytest.mark.parametrize(
    ("width", "inside"), [(30.1, False), (10.5, False), (-1, False), (9.5, True), (31, True), (math.nan, False), (math.nan, True)]
)  # fmt: skip
def test_a_workpiece_that_does_not_fit(width, inside, hand):
    hand.position = 10.0
    with pytest.raises(ValueError, match="does not fit"):
        hand.put(width, inside=inside)
    assert hand.workpiece is None


@given(width=st.floats(0, STROKE), target=st.floats(0, STROKE))
def test_fingers_never_go_through_a_workpiece(width, target):
    clock = ManualClock()
    device = VirtualRC8(clock=clock, samples=False)
    hand = device.state.hand
    hand.put(width)
    deferred = hand.move(target, 100)
    while not deferred.done():
        clock.advance(PERIOD)
        assert hand.position >= width
    assert hand.holding is (target <= width)
    assert hand.position == max(width, target)
    device.close()


# --- motor, extensions ------------------------------------------------------------------------------------------------


def test_without_the_motor_the_hand_does_not_move(execute, clock, hand, refused, rc8):
    hand.put(5)
    execute("HandMoveH", [10, True])
    clock.advance(1)
    hand.switch_motor(False)
    assert execute("HandMotorState") == Variant(BOOL, False)
    assert not hand.holding
    assert refused(execute, "HandMoveA", [30, 100]) == hresult.MOTOR_NOT_ON
    hand.switch_motor(True)
    deferred = execute("HandMoveA", [30, 100])
    clock.advance(0.1)
    hand.switch_motor(False)
    assert code(deferred) == hresult.MOTOR_NOT_ON
    rc8.emergency_stop(True)
    assert refused(hand.switch_motor, True) == hresult.EMERGENCY_STOP_ON


def test_extensions_by_name(controller, refused):
    assert controller.get_extension_names("") == ["Hand0"]
    extension = controller.get_extension("hand0", "")
    assert (extension.get_name(), extension.get_attribute()) == ("hand0", 3)
    assert "hand" in extension.get_help().lower()
    for name in ("Pallet", "comm"):
        assert refused(controller.get_extension, name, "") == hresult.E_NOTIMPL
    for name in ("", "Hand", "Hand1", "Hand0 Hand0"):
        assert refused(controller.get_extension, name, "") == hresult.E_CAO_OBJECT_NOTFOUND


# --- rights, and the wire ---------------------------------------------------------------------------------------------


def test_rights(connect, refused):
    device = VirtualRC8(permission=Permission.parse("10.0.0.1=r,10.0.0.2=none"), clock=ManualClock())
    reader, nobody = (connect(device=device, address=f"10.0.0.{n}") for n in (1, 2))
    move = ("HandMoveA", variant([10, 100]))
    for client in (reader, nobody):
        assert refused(client.execute, *move) == hresult.NO_WRITE_RIGHT
        assert refused(client.get_extension("Hand0", "").execute, "Chuck", variant(0)) == hresult.NO_WRITE_RIGHT
    assert reader.execute("HandCurPos", EMPTY) == Variant(R8, STROKE)
    assert refused(nobody.execute, "HandCurPos", EMPTY) == hresult.NO_READ_RIGHT
    assert refused(nobody.get_extension("Hand0", "").execute, "CurPos", EMPTY) == hresult.NO_READ_RIGHT
    device.close()


def test_through_a_session_as_a_server_calls_it(rc8, clock):
    session = Session(ProviderRegistry(rc8))
    handle = session.invoke(3, [variant(part) for part in ("", "CaoProv.DENSO.VRC", "localhost", "")]).result
    pending = session.invoke(17, [handle, variant("HandMoveA"), variant([10, 100])])
    assert isinstance(pending, Pending)
    clock.advance(1)
    assert session.complete(pending, pending.work.result()).result == EMPTY
    assert session.invoke(17, [handle, variant("HandCurPos"), EMPTY]).result == Variant(R8, 10.0)
    extension = session.invoke(5, [handle, variant("Hand0"), variant("")]).result
    assert session.invoke(28, [extension, variant("CurPos"), EMPTY]).result == Variant(VarType.R4, 30.0)
    assert session.invoke(11, [handle, variant("")]).result == variant(["Hand0"])


def test_status(hand):
    hand.put(10)
    assert hand.status() == {
        "position": 30.0, "moving": False, "holding": False, "force": 0.0, "workpiece": 10.0, "motor": True,
    }  # fmt: skip
