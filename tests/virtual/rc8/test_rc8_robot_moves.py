"""Motions of a client: end points, paths, times of replies, and refused calls."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.cell import Cell

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
VALUES = (330.0, 120.0, 300.0, 180.0, 0.0, 180.0)
POSE = "P(330, 120, 300, 180, 0, 180, 5)"
ORIENT = (0.0, 1.0, 0.0, 0.0, 0.0, -1.0)
PTP, LINE, ARC, CURVE = 1, 2, 3, 4


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


@pytest.fixture
def seven() -> Iterator[Cell]:
    """An arm with a seventh axis, from -36.5 to 25."""
    made = Cell(model="VE026A").take()
    yield made
    made.close()


def turn(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    rotation = np.eye(3)
    rotation[x, x] = rotation[y, y] = c
    rotation[y, x], rotation[x, y] = s, -s
    return rotation


def frame(x: float, y: float, z: float, rx: float = 0, ry: float = 0, rz: float = 0) -> np.ndarray:
    """Return P values as a matrix, by the rule of the documents: R = Rz Ry Rx."""
    made = np.eye(4)
    made[:3, :3] = turn("z", rz) @ turn("y", ry) @ turn("x", rx)
    made[:3, 3] = x, y, z
    return made


def close(a: np.ndarray, b: np.ndarray, within: float = 1e-6) -> bool:
    return bool(np.abs(a - b).max() < within)


def tips(cell: Cell, joints: list[tuple[float, ...]]) -> np.ndarray:
    """Return the positions of the tool tip, (N, 3) mm."""
    return np.array([cell.arm.space.tcp(each)[:3, 3] for each in joints])


def path_of(cell: Cell, move: object, most: int = 2000) -> list[tuple[float, ...]]:
    """Run a motion to its end and return the command joints of every cycle, including the start."""
    joints = [cell.arm.queue.joints]
    while not move.done():
        joints += cell.trace(1)
        assert len(joints) < most
    move.result()
    return joints


# --- poses ------------------------------------------------------------------------------------------------------------


def teach(cell: Cell) -> None:
    """Put the same pose into a variable of each type."""
    cell.put("P10", [*VALUES, 5.0])
    cell.put("T11", [*VALUES[:3], *ORIENT, 5.0])
    cell.put("J12", cell.execute("P2J", POSE))


R4, R8, I4 = ARRAY | VarType.R4, ARRAY | VarType.R8, ARRAY | VarType.I4
FORMS = {
    "P text": POSE,
    "P text without Fig": "P(330, 120, 300, 180, 0, 180)",
    "P text with Fig -1": "P(330, 120, 300, 180, 0, 180, -1)",
    "lower case, blanks": "  @0   p( 330,120 ,300, 180,0,180,5 ) ",
    "no type": "(330, 120, 300, 180, 0, 180, 5)",
    "exponents": "P(3.3e2, 1.2E+2, +300, 180, -0, 180, 5)",
    "T text": "T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)",
    "T text without Fig": "T(330, 120, 300, 0, 1, 0, 0, 0, -1)",
    "P10": "P10",
    "P[10]": "@E P[10]",
    "T11": "t11",
    "J12": "J12",
    "R8 of seven": Variant(R8, [*VALUES, 5]),
    "R4 of six, as P": [Variant(R4, VALUES), "P"],
    "I4 of seven": Variant(I4, [330, 120, 300, 180, 0, 180, 5]),
    "VARIANTs of seven": [330, 120.0, 300, 180.0, 0, 180.0, 5],
    "R8 of ten": Variant(R8, [*VALUES[:3], *ORIENT, 5]),
    "R4 of nine": Variant(R4, [*VALUES[:3], *ORIENT]),
    "values and letter": [[*VALUES, 5.0], "P"],
    "values, type, pass": [Variant(R4, VALUES), 0, -2],
    "values, letter, mark": [[*VALUES, 5.0], "P", "@E"],
    "values of a T": [[*VALUES[:3], *ORIENT, 5.0], 1, 0],
    "variable, letter": [10, "P"],
    "variable, type, pass": Variant(I4, [10, 0, 0]),
    "variable T": [11, 1, 0],
    "variable J": [12, "J", "@0"],
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
def test_a_pose_in_every_form_is_the_same_place(cell, interpolation, form):
    teach(cell)
    cell.run(cell.move(interpolation, FORMS[form]))
    assert close(cell.tip, frame(*VALUES), 1e-4)  # variables have single precision


VIA = (350.0, 60.0, 310.0, 180.0, 0.0, 180.0)
ARCS = {
    "text": "P(350, 60, 310, 180, 0, 180), @E P(330, 120, 300, 180, 0, 180, 5)",
    "texts": ["P(350, 60, 310, 180, 0, 180)", POSE],
    "BSTR array": Variant(ARRAY | VarType.BSTR, ["P(350, 60, 310, 180, 0, 180)", POSE]),
    "values": [[*VIA, -1.0], [*VALUES, 5.0]],
    "values with types": [[list(VIA), "P"], [[*VALUES, 5.0], "P", "@0"]],
    "variables": "P20, P10",
    "mixed": [[20, "P"], "p10"],
}


@pytest.mark.parametrize("form", ARCS)
@pytest.mark.parametrize("interpolation", [ARC, CURVE])
def test_two_poses_in_every_form(cell, interpolation, form):
    teach(cell)
    cell.put("P20", [*VIA, -1.0])
    start = cell.tip[:3, 3]
    way = tips(cell, path_of(cell, cell.move(interpolation, ARCS[form])))
    assert close(cell.tip, frame(*VALUES), 1e-4)
    assert np.linalg.norm(way - np.array(VIA[:3]), axis=1).min() < 3.0  # between two cycles
    if interpolation == ARC:
        a, b, c = start, np.array(VIA[:3]), np.array(VALUES[:3])
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        middle = np.linalg.solve(
            np.array([b - a, c - a, normal]), [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a]
        )
        radii = np.linalg.norm(way - middle, axis=1)
        assert np.abs(radii - radii[0]).max() < 0.01


JOINTS = {
    "text": "J(10, 40, 95, 5, 40, -20)",
    "eight": "J(10, 40, 95, 5, 40, -20, 0, 0)",
    "R8 of eight": Variant(R8, [10, 40, 95, 5, 40, -20, 0, 0]),
    "six and a letter": [[10.0, 40.0, 95.0, 5.0, 40.0, -20.0], "J"],
    "type 2": [Variant(R4, [10, 40, 95, 5, 40, -20]), 2, 0],
    "variable": "J30",
}


@pytest.mark.parametrize("form", JOINTS)
def test_joints_are_taken_exactly(cell, form):
    cell.put("J30", [10, 40, 95, 5, 40, -20, 0, 0])
    cell.run(cell.move(PTP, JOINTS[form]))
    assert cell.arm.queue.joints == (10, 40, 95, 5, 40, -20)


def test_a_variable_is_read_when_the_motion_is_asked_for(cell):
    cell.put("J1", [10, 45, 90, 0, 45, 0, 0, 0])
    cell.put("F2", 10.0)
    cell.run(cell.move(PTP, "J(-10, 45, 90, 0, 45, 0)", "NEXT"))
    second = cell.move(PTP, "J1", "SPEED=F2")
    cell.put("J1", [60, 45, 90, 0, 45, 0, 0, 0])
    cell.put("F2", 100.0)
    assert cell.cycles(second) > 20 / 42.5 / PERIOD
    assert cell.arm.queue.joints == (10, 45, 90, 0, 45, 0)


@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_several_poses_are_several_motions(cell, interpolation):
    move = cell.move(interpolation, ["P(350, 50, 300, 180, 0, 180)", "@0 P(330, -50, 320, 180, 0, 180)", POSE])
    assert len(cell.arm.queue.tickets) == 3
    way = tips(cell, path_of(cell, move))
    for place in ((350, 50, 300), (330, -50, 320)):
        assert np.linalg.norm(way - place, axis=1).min() < 1e-6
    assert close(cell.tip, frame(*VALUES))


def test_a_move_to_several_poses_starts_only_if_all_are_possible(cell):
    assert cell.code_of(lambda: cell.move(PTP, [POSE, "P(2000, 0, 300, 180, 0, 180)"])) == hresult.TARGET_OUT_OF_RANGE
    assert not cell.arm.busy
    cell.move(PTP, "J(10, 45, 90, 0, 45, 0)", "NEXT,SPEED=1")
    ten = ", ".join(["J(5, 45, 90, 0, 45, 0)"] * 10)
    assert cell.code_of(lambda: cell.move(PTP, ten)) == hresult.ROBOT_MOVING
    assert len(cell.arm.queue.tickets) == 1


# --- when it is answered ----------------------------------------------------------------------------------------------


def lasts(way: float, speed: float = 100, accel: float = 100, decel: float = 100) -> float:
    """Return the time in s of joint 1 of a VS-050 by the documents: constant acceleration, smoothed over 40 ms."""
    up, down = 425 * 5 * accel / 100, 425 * 5 * decel / 100
    velocity = min(425 * speed / 100, math.sqrt(2 * way / (1 / up + 1 / down)))
    return way / velocity + velocity / up / 2 + velocity / down / 2 + 0.04


TIMES = {
    "": lasts(120),
    "SPEED=10": lasts(120, 10),
    "S=10": lasts(120, 10),
    "speed = 25 , accel=50": lasts(120, 25, 50),
    ",SPEED=25,DECEL=20": lasts(120, 25, 100, 20),
    "SPEED=F2": lasts(120, 12.5),
    "SPEED=D3": lasts(120, 40),
    "SPEED=I[4],ACCEL=I5": lasts(120, 20, 30),
    "TIME=3000": 3.0,
    "TIME=F6": 2.5,
    "TIME=1": lasts(120),
    "SPEED=10,SPEED=20": lasts(120, 20),
    "NEXT=0,SPEED=30": lasts(120, 30),
}


@pytest.mark.parametrize("option", TIMES)
def test_how_long_a_motion_takes(cell, option):
    for name, value in (("F2", 12.5), ("D3", 40.0), ("I4", 20), ("I5", 30), ("F6", 2500.0)):
        cell.put(name, value)
    move = cell.move(PTP, "J(120, 45, 90, 0, 45, 0)", option)
    assert cell.cycles(move) == math.ceil(TIMES[option] / PERIOD - 1e-6)
    assert cell.arm.queue.joints[0] == 120


SPEEDS = {
    "internal": (lambda cell: cell.robot.speed(-1, 20), lasts(120, 20)),
    "of point-to-point motions": (lambda cell: cell.robot.speed(0, 30), lasts(120, 30)),
    "acceleration": (lambda cell: cell.robot.accelerate(0, 40, -1), lasts(120, 100, 40)),
    "deceleration": (lambda cell: cell.robot.accelerate(-1, -1, 25), lasts(120, 100, 100, 25)),
    "external": (lambda cell: cell.execute("ExtSpeed", 50), lasts(120, 50, 25, 25)),
    "external, acceleration kept": (lambda cell: cell.execute("ExtSpeed", [50, -1, -1]), lasts(120, 50)),
}


@pytest.mark.parametrize("name", SPEEDS)
def test_internal_and_external_speeds_rule_motions(cell, name):
    change, seconds = SPEEDS[name]
    change(cell)
    assert cell.cycles(cell.move(PTP, "J(120, 45, 90, 0, 45, 0)")) == math.ceil(seconds / PERIOD - 1e-6)


def test_speeds_multiply(cell):
    cell.robot.speed(-1, 50)
    cell.execute("ExtSpeed", [50, 100, 100])
    move = cell.move(PTP, "J(120, 45, 90, 0, 45, 0)", "SPEED=80")  # instead of the internal speed
    assert cell.cycles(move) == math.ceil(lasts(120, 40) / PERIOD - 1e-6)


def test_the_speed_of_point_to_point_motions_is_not_that_of_paths(cell):
    usual = cell.cycles(cell.move(LINE, POSE))
    cell.stand(*HOME).robot.speed(0, 10)
    assert cell.cycles(cell.move(LINE, POSE)) == usual
    cell.stand(*HOME).robot.speed(-1, 10)
    assert cell.cycles(cell.move(LINE, POSE)) > 2 * usual


def test_a_line_takes_the_time_that_its_tip_needs(cell):
    move = cell.move(LINE, "P(364.15999231107, 200, 278.53553390593, 180, 0, 180)", "SPEED=10,ACCEL=20,DECEL=20")
    seconds = 200 / 150 + 150 / (0.2 * 7500) + 0.04
    assert cell.cycles(move) == pytest.approx(seconds / PERIOD, abs=1)


@pytest.mark.parametrize("option", ["", "SPEED=30", "ACCEL=30,DECEL=60", "SPEED=50,ACCEL=10,DECEL=10"])
@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
def test_joints_stay_within_their_part_of_the_limits(cell, interpolation, option):
    given = dict(part.split("=") for part in option.split(",") if part)
    joints = np.array(path_of(cell, cell.move(interpolation, "P(300, 250, 300, 180, 0, 180)", option)))
    velocity = np.diff(joints, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    speed = float(given.get("SPEED", 100)) / 100
    accel = max(float(given.get("ACCEL", 100)), float(given.get("DECEL", 100))) / 100
    for axis, limits in enumerate(cell.arm.model.axes):
        assert np.abs(velocity[:, axis]).max() <= limits.velocity * speed * 1.001
        assert np.abs(acceleration[:, axis]).max() <= limits.acceleration * accel * 1.001


@pytest.mark.parametrize("mark", ["@0", "", "@E"])
@pytest.mark.parametrize("where", ["pose", "option"])
def test_answered_at_the_end(cell, mark, where):
    """@0 when the command has arrived, @E when the encoders have: three cycles later."""
    pose = "J(20, 45, 90, 0, 45, 0)"
    move = cell.move(PTP, f"{mark} {pose}") if where == "pose" else cell.move(PTP, pose, mark)
    arrived = None
    for count in itertools.count(1):
        cell.trace(1)
        if arrived is None and cell.arm.queue.joints[0] == 20:
            arrived = count
        assert (cell.execute("CurJnt")[0] == 20) is (arrived is not None and count >= arrived + 3)
        if move.done():
            break
    assert count - arrived == (3 if mark == "@E" else 0)


def test_the_mark_of_the_pose_takes_precedence_over_the_options(cell):
    first = cell.cycles(cell.move(PTP, "@0 J(20, 45, 90, 0, 45, 0)", "@E"))
    assert cell.cycles(cell.move(PTP, "@E J(0, 45, 90, 0, 45, 0)", "@0")) == first + 3


@pytest.mark.parametrize("interpolation", [PTP, LINE, ARC, CURVE])
def test_passing_is_answered_when_it_begins_to_slow_down(cell, interpolation):
    pose = "P(350, 100, 310, 180, 0, 180), @P " + POSE if interpolation == ARC else "@P " + POSE
    move = cell.move(interpolation, pose, "SPEED=20")
    joints = [cell.arm.queue.joints]
    while not move.done():
        joints += cell.trace(1)
    answered = len(joints) - 1
    while cell.arm.busy:
        joints += cell.trace(1)
    speeds = np.linalg.norm(np.diff(tips(cell, joints), axis=0), axis=1) / PERIOD
    assert answered < len(joints) - 5
    if interpolation == LINE:  # constant velocity makes it visible
        top = speeds.max()
        assert speeds[answered - 3] == pytest.approx(top, rel=1e-3)
        assert speeds[answered + 3] < top * 0.999
    assert close(cell.tip, frame(*VALUES))


@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_a_radius_is_answered_when_the_tip_is_within_it(cell, interpolation):
    move = cell.move(interpolation, "@20 " + POSE, "SPEED=20")
    joints = path_of(cell, move)
    away = np.linalg.norm(tips(cell, joints) - VALUES[:3], axis=1)
    assert away[-1] <= 20 < away[-2]
    while cell.arm.busy:
        cell.trace(1)
    assert close(cell.tip, frame(*VALUES))


def test_a_mark_blends_the_next_motion_in(cell):
    lengths, corners = {}, {}
    for mark in ("@0", "@P", "@20", "@60"):
        cell.stand(*HOME)
        cell.move(LINE, f"{mark} P(364, 150, 278, 180, 0, 180)", "NEXT,SPEED=10")
        joints = path_of(cell, cell.move(LINE, "P(250, 150, 278, 180, 0, 180)", "SPEED=10"))
        assert close(cell.tip, frame(250, 150, 278, 180, 0, 180))
        way = tips(cell, joints)
        corners[mark] = float(np.linalg.norm(way - (364, 150, 278), axis=1).min())
        lengths[mark] = len(joints)
        if mark != "@0":
            assert (
                np.linalg.norm(np.diff(way, axis=0), axis=1)[5:-5].min() > 0.3
            )  # 1.2 mm at full speed: it never stops
        velocity = np.diff(np.array(joints), axis=0) / PERIOD
        acceleration = np.abs(np.diff(velocity, axis=0)) / PERIOD
        for axis, limits in enumerate(cell.arm.model.axes):
            assert np.abs(velocity[:, axis]).max() <= limits.velocity * 0.1 * 1.001
            assert acceleration[:, axis].max() <= limits.acceleration * 1.001
    assert lengths["@60"] < lengths["@20"] < lengths["@P"] < lengths["@0"]
    assert corners["@0"] == 0
    assert 0 < corners["@P"] < 2 < corners["@20"] < 20 < corners["@60"] < 60


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_move_that_comes_when_the_one_before_is_passed_is_blended_in(cell, delay):
    """As sent by a client: each motion after the reply to the previous one, a few cycles late."""
    joints = [cell.arm.queue.joints]
    for mark, place in (
        ("@P", "364, 150, 278"),
        ("@30", "300, 150, 278"),
        ("@P", "300, -50, 278"),
        ("@E", "364, -50, 278"),
    ):
        move = cell.move(LINE, f"{mark} P({place}, 180, 0, 180)", "SPEED=10")
        joints += path_of(cell, move)[1:]
        joints += cell.trace(delay if mark != "@E" else 0)
    way = tips(cell, joints)
    assert np.linalg.norm(np.diff(way, axis=0), axis=1)[5:-9].min() > 0.1
    assert close(cell.tip, frame(364, -50, 278, 180, 0, 180))
    velocity = np.diff(np.array(joints), axis=0) / PERIOD
    acceleration = np.abs(np.diff(velocity, axis=0)) / PERIOD
    assert (acceleration.max(0) <= [axis.acceleration * 1.001 for axis in cell.arm.model.axes]).all()


def test_a_passed_motion_without_a_successor_runs_to_its_end(cell):
    move = cell.move(PTP, "@P J(60, 45, 90, 0, 45, 0)")
    cell.cycles(move)
    assert cell.arm.busy
    assert cell.execute("MotionComplete", [-1, 0]) is False
    cell.trace(60)
    assert cell.arm.queue.joints[0] == 60


def test_next_answers_at_once_and_ten_motions_have_room(cell):
    for angle in range(1, 11):
        assert cell.move(PTP, f"@E J({angle}, 45, 90, 0, 45, 0)", "Next") is None
    assert not cell.arm.queue.joints[0]
    assert cell.code_of(lambda: cell.move(PTP, "J(11, 45, 90, 0, 45, 0)", "NEXT")) == hresult.ROBOT_MOVING
    assert cell.code_of(lambda: cell.execute("Depart", [1, 10, "NEXT"])) == hresult.ROBOT_MOVING
    seen = {round(joints[0], 9) for joints in cell.trace(400)}
    assert set(range(1, 11)) <= seen
    assert cell.arm.queue.joints == (10, *HOME[1:])
    assert not cell.arm.busy


def test_a_motion_behind_others_is_planned_from_where_they_end(cell):
    cell.move(LINE, "P(364, 100, 278, 180, 0, 180)", "NEXT")
    cell.execute("DriveEx", ["(1,10)", "NEXT"])
    cell.execute("DriveEx", ["(1,10)", "NEXT"])
    cell.run(cell.move(PTP, "J(0, 45, 90, 0, 45, 0)", "NEXT"))
    move = cell.robot.execute("DriveEx", variant("(6,5)"))
    cell.run(move)
    assert cell.arm.queue.joints == (0, 45, 90, 0, 45, 5)


def test_dest_is_the_end_of_the_running_motion(cell):
    cell.move(PTP, "@0 J(20, 45, 90, 0, 45, 0)", "NEXT")
    cell.move(PTP, "@0 J(40, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(3)
    assert cell.execute("DestJnt")[0] == 20
    while cell.arm.queue.joints[0] <= 20:
        cell.trace(1)
    assert cell.execute("DestJnt")[0] == 40
    cell.trace(100)
    assert cell.execute("DestJnt")[0] == 40
    cell.move(PTP, "@0 J(0, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(5)
    cell.run(cell.robot.halt(""))
    assert cell.execute("DestJnt")[:6] == list(cell.arm.queue.joints)


# --- lines, arcs, curves ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tool", [(0, 0, 0, 0, 0, 0), (30, -20, 120, 20, -30, 40)])
def test_a_line_is_straight(cell, tool):
    cell.execute("SetToolDef", [1, "P" + str(tool)])
    cell.robot.change("Tool1")
    here = cell.tip
    goal = here.copy()
    goal[:3, 3] += (-60, 150, 30)
    goal[:3, :3] = turn("z", 25) @ goal[:3, :3]
    cell.arm.space.tools.define(2, [0] * 6)
    move = cell.move(LINE, [[*cell.arm.space.values(goal)], "P"])
    way = tips(cell, path_of(cell, move)) - here[:3, 3]
    along = np.array((-60, 150, 30)) / np.linalg.norm((-60, 150, 30))
    assert np.linalg.norm(way - np.outer(way @ along, along), axis=1).max() < 0.01
    assert (np.diff(way @ along) > -1e-6).all()
    assert close(cell.tip, goal)


def test_a_curve_goes_through_a_stored_path(cell):
    points = [(350, 0, 290), (340, 60, 300), (300, 100, 320), (280, 60, 300)]
    for x, y, z in points:
        cell.execute("AddPathPoint", [3, f"P({x}, {y}, {z}, 180, 0, 180)"])
    assert cell.execute("GetPathPointCount", 3) == 4
    way = tips(cell, path_of(cell, cell.move(CURVE, 3, "SPEED=20")))
    for point in points:
        assert np.linalg.norm(way - point, axis=1).min() < 1.5
    assert close(cell.tip, frame(280, 60, 300, 180, 0, 180))


@pytest.mark.parametrize("number", [3, "3", " @0 3", "@E 3", "@p 3", "@20 3", 3.0, Variant(VarType.I2, 3)])
def test_a_stored_path_by_its_number(cell, number):
    cell.execute("AddPathPoint", [3, POSE])
    move = cell.move(CURVE, number)
    cell.run(move)
    while cell.arm.busy:
        cell.trace(1)
    assert close(cell.tip, frame(*VALUES))


def test_stored_paths_grow_and_are_cleared(cell):
    cell.put("P1", [*VALUES, 5])
    for pose in ("P1", [[*VALUES], "P"], "J(0, 45, 90, 0, 45, 0)", "T(330, 120, 300, 0, 1, 0, 0, 0, -1)"):
        cell.execute("AddPathPoint", [20, pose])
    cell.put("P1", [0] * 7)  # the path was read before
    assert cell.execute("GetPathPointCount", 20) == 4
    assert cell.execute("GetPathPointCount", 1) == 0
    cell.run(cell.move(CURVE, 20, "SPEED=50"))
    cell.execute("ClrPathPoint", 20)
    assert cell.execute("GetPathPointCount", 20) == 0
    assert cell.code_of(lambda: cell.move(CURVE, 20)) == hresult.E_INVALIDARG


@pytest.mark.parametrize("number", [0, -1, 21, 1e12, "21", "999999999", 1.5, True])
def test_there_are_paths_1_to_20(cell, number):
    assert cell.code_of(lambda: cell.move(CURVE, number)) == hresult.E_INVALIDARG
    if not isinstance(number, str):
        assert cell.code_of(lambda: cell.execute("AddPathPoint", [number, POSE])) == hresult.E_INVALIDARG
        assert cell.code_of(lambda: cell.execute("ClrPathPoint", number)) == hresult.E_INVALIDARG
        assert cell.code_of(lambda: cell.execute("GetPathPointCount", [number])) == hresult.E_INVALIDARG


# --- tool and work ----------------------------------------------------------------------------------------------------

TOOL = (20, -10, 80, 0, 30, 45)
WORK = (100, -50, 20, 0, 0, 30)
IN_WORK = (230, 60, 290, 180, 0, 150)


@pytest.fixture
def framed(cell) -> Cell:
    cell.execute("SetToolDef", [5, f"P{TOOL}"])
    cell.execute("SetWorkDef", [3, f"P{WORK}"])
    cell.robot.change("TOOL5")
    cell.robot.change(" work 3 ")
    return cell


def flange(cell: Cell) -> np.ndarray:
    return cell.arm.space.kinematics.forward(cell.arm.queue.joints)


@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
@pytest.mark.parametrize("kind", ["P", "T"])
def test_poses_are_of_the_tool_in_the_work(framed, interpolation, kind):
    goal = frame(*IN_WORK)
    pose = f"P{IN_WORK}" if kind == "P" else [[*IN_WORK[:3], *goal[:3, 1], *goal[:3, 2]], "T"]
    framed.run(framed.move(interpolation, pose))
    assert close(flange(framed) @ frame(*TOOL), frame(*WORK) @ goal)
    framed.trace(3)
    assert framed.execute("CurPos") == pytest.approx([*IN_WORK, 5], abs=1e-6)
    assert framed.execute("CurTrn") == pytest.approx([*IN_WORK[:3], *goal[:3, 1], *goal[:3, 2], 5], abs=1e-6)


def test_joints_are_of_no_tool(framed):
    framed.run(framed.move(PTP, "J(5, 45, 90, 0, 45, 0)"))
    assert framed.arm.queue.joints == (5, 45, 90, 0, 45, 0)


def test_a_line_to_joints_ends_at_them(framed):
    framed.run(framed.move(LINE, "J(20, 40, 95, 5, 40, 10)"))
    assert framed.arm.queue.joints == pytest.approx((20, 40, 95, 5, 40, 10), abs=1e-6)


@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_approach_is_back_along_the_tools_z(framed, interpolation):
    framed.execute("Approach", [interpolation, f"P{IN_WORK}", "@0 35.5"])
    assert close(framed.arm.space.in_work(framed.tip), frame(*IN_WORK) @ frame(0, 0, -35.5))
    framed.execute("Approach", [interpolation, f"P{IN_WORK}", "-10"])  # beyond the target
    assert close(framed.arm.space.in_work(framed.tip), frame(*IN_WORK) @ frame(0, 0, 10))


@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_depart_is_back_along_the_tools_z(framed, interpolation):
    here = framed.tip
    framed.execute("Depart", [interpolation, "@0 30"])
    assert close(framed.tip, here @ frame(0, 0, -30))
    framed.execute("Depart", [interpolation, -12.5])
    assert close(framed.tip, here @ frame(0, 0, -17.5))


@pytest.mark.parametrize("sixth", [180.0, -180.0, 179.9999999, 180.0000001, 360.0, -360.0, 0.0])
@pytest.mark.parametrize("fourth", [20.0, 180.0, -179.9])
@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_depart_does_not_turn_an_axis_round(cell, interpolation, fourth, sixth):
    """Even if a joint passes from SINGLE to DOUBLE."""
    cell.stand(20, 35, 90, fourth, 40, sixth)
    before, here = cell.arm.queue.joints, cell.tip
    code = cell.code_of(lambda: cell.execute("Depart", [interpolation, 20]))
    if interpolation == LINE and abs(sixth) == 360 and code:
        assert code in (hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 5, hresult.SOFT_LIMIT_OVER_AXIS1 + 5)
        return
    assert close(cell.tip, here @ frame(0, 0, -20))
    most = 400 if abs(sixth) == 360 else 20  # from its limit there may be no shorter way
    assert max(abs(a - b) for a, b in zip(before, cell.arm.queue.joints, strict=True)) < most


def test_a_new_tool_holds_for_the_next_motion(cell):
    cell.execute("SetToolDef", [1, [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]])
    cell.run(cell.move(PTP, POSE))
    cell.robot.change("Tool1")
    cell.run(cell.move(PTP, POSE))
    assert flange(cell)[2, 3] == pytest.approx(400)  # the tool points down
    cell.execute("SetToolDef", [1, "P(0, 0, 50, 0, 0, 0)"])
    cell.run(cell.move(PTP, POSE))
    assert flange(cell)[2, 3] == pytest.approx(350)
    cell.robot.change("Tool0")
    cell.run(cell.move(PTP, POSE))
    assert close(flange(cell), frame(*VALUES))


APPROACHES = {
    "P text": POSE,
    "T text": "T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)",
    "values": [*VALUES, 5.0],
    "values and letter": [[*VALUES, 5.0], "P"],
    "P10": "P10",
    "J12": "J12",
}


@pytest.mark.parametrize("form", APPROACHES)
@pytest.mark.parametrize("distance", ["20", 20, 20.0, "@0 20", "@P 20", "@E20", " @10   20 ", "+20.0", "2e1"])
def test_approach_takes_poses_and_distances_in_every_form(cell, form, distance):
    teach(cell)
    cell.run(cell.robot.execute("aPPROACH", variant([PTP, APPROACHES[form], distance])))
    while cell.arm.busy:
        cell.trace(1)
    assert close(cell.tip, frame(330, 120, 320, 180, 0, 180), 1e-4)


def test_marks_of_approach_and_depart(cell):
    for command in (["Approach", 1, POSE], ["Depart", 1]):
        name, *rest = command
        cell.stand(*HOME)
        plain = cell.cycles(cell.robot.execute(name, variant([*rest, "@0 40"])))
        cell.stand(*HOME)
        assert cell.cycles(cell.robot.execute(name, variant([*rest, "@E 40"]))) == plain + 3
        cell.stand(*HOME)
        assert cell.cycles(cell.robot.execute(name, variant([*rest, "40", "@E"]))) == plain + 3
        cell.stand(*HOME)
        assert cell.cycles(cell.robot.execute(name, variant([*rest, "@P 40"]))) < plain
        cell.trace(100)
        cell.stand(*HOME)
        assert cell.cycles(cell.robot.execute(name, variant([*rest, "@0 40", "SPEED=10"]))) > 1.5 * plain
        cell.stand(*HOME)
        assert cell.execute(name, [*rest, "@0 40", "SPEED=10,NEXT"]) is None
        assert cell.arm.busy
        cell.run(cell.robot.halt(""))


# --- drive, rotate, home ----------------------------------------------------------------------------------------------

DRIVES = {
    "text": "(1,10),(6,-20)",
    "text with a mark": "@0 (1, 10), (6, -20)",
    "text, blanks": " @E ( 1 , 10 ) ( 6 ,-2e1 ) ",
    "text and option": ["@0 (1,10),(6,-20)", "SPEED=50"],
    "arrays": [[1, 10], [6, -20]],
    "arrays of R8": [[1.0, 10.0], [6.0, -20.0]],
    "VARIANT arrays": [[1, 10.0], [6, -20.0]],
    "arrays of text": [["1", "10"], ["6", "-20"]],
    "arrays and options": [[1, 10.0], [6, -20.0], "@E", "SPEED=50"],
    "nothing for an option": ["(1,10),(6,-20)", None],
    "an empty option": ["(1,10),(6,-20)", ""],
}


@pytest.mark.parametrize("form", DRIVES)
@pytest.mark.parametrize("command", ["DriveEx", "DriveAEx"])
def test_several_axes_are_driven_by_and_to(cell, command, form):
    start = (3, 40, 95, 5, 40, 7)
    cell.stand(*start)
    cell.execute(command, DRIVES[form])
    wanted = (13, 40, 95, 5, 40, -13) if command == "DriveEx" else (10, 40, 95, 5, 40, -20)
    assert cell.arm.queue.joints == wanted


@pytest.mark.parametrize("axis", range(1, 7))
def test_one_axis_is_driven(cell, axis):
    cell.execute("DriveEx", [f"@E ({axis}, -7.5)", "SPEED=20"])
    assert cell.arm.queue.joints == tuple(joint - 7.5 * (axis == number) for number, joint in enumerate(HOME, 1))
    assert cell.arm.servo.encoder == cell.arm.queue.joints


def test_an_axis_named_twice_is_driven_by_both(cell):
    cell.execute("DriveEx", "(1,10),(1,5)")
    assert cell.arm.queue.joints[0] == 15


@pytest.mark.parametrize("axis", [0, 7, -1, 8, 2**31 - 1])
def test_there_are_six_axes(cell, axis):
    assert cell.code_of(lambda: cell.execute("DriveEx", f"({axis},1)")) == hresult.E_INVALIDARG


PLANES = {"XY": "z", "YZ": "x", "ZX": "y", " xy ": "z"}


def rotated(here: np.ndarray, rotation: np.ndarray, pivot: np.ndarray, *, keep: bool) -> np.ndarray:
    goal = here.copy()
    goal[:3, 3] = pivot + rotation @ (here[:3, 3] - pivot)
    if not keep:
        goal[:3, :3] = rotation @ here[:3, :3]
    return goal


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize(("option", "keep"), [("", False), ("@0,Pose=1", False), ("@E,Pose=2,SPEED=50", True)])
@pytest.mark.parametrize("angle", [20.0, -15.0])
def test_rotate_in_a_plane(framed, plane, option, keep, angle):
    here = framed.tip
    pivot = frame(*WORK) @ (250, 10, 200, 1)
    axis = frame(*WORK)[:3, :3] @ turn(PLANES[plane], angle) @ frame(*WORK)[:3, :3].T
    framed.run(framed.robot.rotate(variant(plane), angle, variant("V(250, 10, 200)"), option))
    assert close(framed.tip, rotated(here, axis, pivot[:3], keep=keep), 1e-4)


def test_a_rotation_stays_on_its_circle(cell):
    pivot = np.array((300.0, 0.0, 278.0))
    joints = path_of(cell, cell.robot.rotate(variant("XY"), 60.0, variant("V(300, 0, 278)"), "SPEED=50"))
    way = tips(cell, joints)
    radius = np.linalg.norm(way[:, :2] - pivot[:2], axis=1)
    assert np.abs(radius - radius[0]).max() < 0.01
    assert np.abs(way[:, 2] - way[0, 2]).max() < 0.01


THREE_POINTS = {
    "vectors": "V(0, 0, 0), V(10, 0, 0), V(0, 10, 0)",
    "vector texts": ["V(5, 5, 0)", "V(10, 5, 0)", "V(5, 10, 0)"],
    "variables": "V1, V2, V3",
    "positions": "P(1, 1, 0, 5, 6, 7), P(3, 1, 0, 5, 6, 7), P(1, 9, 0, 5, 6, 7)",
    "values": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
}


@pytest.mark.parametrize("form", THREE_POINTS)
@pytest.mark.parametrize("pivot", ["V(300, 0, 0)", "V4", "P(300, 0, 99, 1, 2, 3)", [300.0, 0.0, 0.0], "P4"])
def test_rotate_in_the_plane_of_three_points(cell, form, pivot):
    for name, value in (("V1", [0, 0, 7]), ("V2", [5, 0, 7]), ("V3", [0, 5, 7]), ("V4", [300, 0, 0])):
        cell.put(name, value)
    cell.put("P4", [300, 0, 50, 0, 0, 0, -1])
    here = cell.tip
    cell.run(cell.robot.rotate(variant(THREE_POINTS[form]), 20.0, variant(pivot), ""))
    assert close(cell.tip, rotated(here, turn("z", 20), np.array((300, 0, 0)), keep=False), 1e-4)


@pytest.mark.parametrize(
    ("plane", "pivot"),
    [
        ("XX", "V1"), ("", "V1"), ("XY", "V1, V2"), ("V(0,0,0), V(1,0,0)", "V1"), (1, "V1"), (None, "V1"), ("XY", None),
        ("V(0,0,0), V(1,1,1), V(2,2,2)", "V1"), ("V(0,0,0), V(0,0,0), V(0,0,0)", "V1"), ("XY", "nonsense"), ("XY", ""),
        ("V(1e300,0,0), V(0,1e300,0), V(0,0,1e300)", "V1"), ("XY", "V(1e300, 0, 0)"), ("XY", "V999"),
    ],
)  # fmt: skip
def test_invalid_planes_and_pivots(cell, plane, pivot):
    assert cell.code_of(lambda: cell.robot.rotate(variant(plane), 10.0, variant(pivot), "")) != 0
    assert not cell.arm.busy


@pytest.mark.parametrize("given", ["30", 30, "@0 30", "@E 30.0", ["@P 30"], ["30", "SPEED=50"], [30.0, "@E"]])
def test_rotate_hand_turns_about_the_tools_z(framed, given):
    here = framed.tip
    framed.execute("RotateH", given)
    while framed.arm.busy:
        framed.trace(1)
    assert close(framed.tip, here @ frame(0, 0, 0, 0, 0, 30))


def test_home(seven):
    seven.stand(10, 20, 90, 5, 20, 30, 15)
    seven.robot.speed(0, 20)
    slow = seven.cycles(seven.robot.go_home())
    assert seven.arm.queue.joints == seven.arm.model.home
    seven.stand(10, 20, 90, 5, 20, 30, 15).robot.speed(0, 100)
    assert seven.cycles(seven.robot.go_home()) < slow / 2


# --- figures ----------------------------------------------------------------------------------------------------------


def ways(cell: Cell, pose: str) -> dict[int, np.ndarray]:
    """All solutions for a pose, by figure."""
    found = {}
    for figure in range(64):
        parameter = variant(f"P({pose}, {figure})")
        if not cell.code_of(lambda parameter=parameter: cell.robot.execute("P2J", parameter)):
            found[figure] = np.array(cell.execute("P2J", f"P({pose}, {figure})")[:6])
    return found


def change(cell: Cell, joints: np.ndarray) -> float:
    velocities = np.array([axis.velocity for axis in cell.arm.model.axes])
    return float((np.abs(joints - np.array(cell.arm.queue.joints)) / velocities).max())


def within(cell: Cell, joints: np.ndarray) -> bool:
    return all(axis.lower <= joint <= axis.upper for joint, axis in zip(joints, cell.arm.model.axes, strict=True))


STARTS = [HOME, (30, 20, 70, 100, -45, 15), (-150, -30, -80, 0, -50, 170), (170, 60, 40, -90, 80, 0)]
PLACES = ["350, 100, 300, 180, 0, 180", "250, -200, 400, 150, 20, 90", "-200, 250, 500, 120, -30, -60"]


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("place", PLACES)
def test_a_figure_is_reached_exactly_or_refused(cell, start, place):
    cell.stand(*start)
    for figure, joints in ways(cell, place).items():
        move = cell.code_of(lambda figure=figure: cell.move(PTP, f"P({place}, {figure})"))
        if within(cell, joints):
            assert not move
            assert cell.arm.queue.joints == pytest.approx(joints, abs=1e-6)
            cell.trace(3)
            assert cell.execute("CurFig") == figure
        else:
            assert hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 <= move < hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 6
            cell.controller.execute("ClearError", variant(None))
            cell.execute("Motor", 1)
        cell.stand(*start)
    missing = min(set(range(64)) - set(ways(cell, place)))
    assert cell.code_of(lambda: cell.move(PTP, f"P({place}, {missing})")) == hresult.FIGURE_INVALID


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("place", PLACES)
def test_rules_for_a_pose_without_a_figure(cell, start, place):
    cell.stand(*start)
    every = ways(cell, place)
    possible = {figure: joints for figure, joints in every.items() if within(cell, joints)}
    least = min(change(cell, joints) for joints in every.values())
    least_possible = min(change(cell, joints) for joints in possible.values())
    present = cell.execute("CurFig")
    for rule in (-1, -2, -3):
        got = np.array(cell.execute("P2J", f"P({place}, {rule})")[:6])
        if rule == -2:
            assert change(cell, got) == pytest.approx(least)
        elif rule == -1 and present in possible:
            assert got == pytest.approx(possible[present], abs=1e-6)
        else:
            assert change(cell, got) == pytest.approx(least_possible)
        if within(cell, got):
            cell.run(cell.move(PTP, f"P({place}, {rule})"))
            assert cell.arm.queue.joints == pytest.approx(got, abs=1e-6)
            cell.stand(*start)
    without = cell.execute("P2J", f"P({place})")
    assert without == cell.execute("P2J", f"P({place}, -1)")


@pytest.mark.parametrize("figure", [64, 100, -4, -100, 2**31 - 1, 512])
@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
def test_invalid_figures(cell, interpolation, figure):
    code = cell.code_of(lambda: cell.move(interpolation, f"P(350, 100, 300, 180, 0, 180, {figure})"))
    assert code == hresult.FIGURE_OUT_OF_RANGE
    code = cell.code_of(lambda: cell.execute("Approach", [2, [*VALUES, float(figure)], 10]))
    assert code == hresult.FIGURE_OUT_OF_RANGE


def test_a_figure_is_a_whole_number(cell):
    assert cell.code_of(lambda: cell.move(PTP, "(350, 100, 300, 180, 0, 180, 5.5)")) == hresult.FIGURE_OUT_OF_RANGE
    cell.put("P1", [*VALUES, 5.5])
    for name, parameter in (("P2T", "P1"), ("AddPathPoint", [1, "P1"]), ("OutRange", "P1"), ("Dev", "P1, P2")):
        assert cell.code_of(lambda name=name, parameter=parameter: cell.execute(name, parameter)) == (
            hresult.FIGURE_OUT_OF_RANGE
        )


PATHS = {
    "line": lambda cell, pose: cell.move(LINE, pose),
    "arc": lambda cell, pose: cell.move(ARC, f"P(350, 60, 310, 180, 0, 180), {pose}"),
    "arc's via": lambda cell, pose: cell.move(ARC, f"{pose}, P(300, -60, 310, 180, 0, 180)"),
    "curve": lambda cell, pose: cell.move(CURVE, pose),
    "approach": lambda cell, pose: cell.execute("Approach", [LINE, pose, 10]),
}


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("pose", ["P(330, 120, 300, 180, 0, 180, 1)", "P(330, 120, 300, 180, 0, 180, 0)", "J12"])
def test_a_path_keeps_the_figure(cell, path, pose):
    cell.put("J12", cell.execute("P2J", "P(330, 120, 300, 180, 0, 180, 1)"))
    if pose == "J12" and path.startswith("arc"):
        pytest.skip("the two poses of an arc have the same type")
    before = cell.arm.queue.joints
    assert cell.code_of(lambda: PATHS[path](cell, pose)) == hresult.FIGURE_MISMATCH
    cell.trace(5)
    assert cell.arm.queue.joints == before
    assert cell.rc8.state.faults.code == hresult.FIGURE_MISMATCH  # an error of level 3
    assert not cell.arm.motor.on


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("figure", [-1, -2, -3, 5, 13, 37])
def test_on_a_path_single_and_double_do_not_matter(cell, path, figure):
    assert not cell.code_of(lambda: PATHS[path](cell, f"P(330, 120, 300, 180, 0, 180, {figure})"))


def test_flip_and_nonflip_are_the_same_where_joint_5_is_0(cell):
    cell.stand(0, 20, 90, 0, 30, 0)
    assert not cell.code_of(lambda: cell.move(LINE, "J(0, 20, 90, 0, 0, 0)"))
    assert cell.arm.queue.joints == pytest.approx((0, 20, 90, 0, 0, 0), abs=1e-6)
    for angle, figure in ((30, 5), (-30, 1)):
        cell.stand(0, 20, 90, 0, 0, 0)
        there = cell.execute("J2P", f"J(0, 20, 90, 0, {angle}, 0)")
        assert there[6] == figure
        assert not cell.code_of(lambda there=there: cell.move(LINE, there))
        assert cell.arm.queue.joints[4] == pytest.approx(angle, abs=1e-6)


# --- extended joints ---------------------------------------------------------------------------------------------------

SEVEN = "J(0, 30, 110, 0, 30, 0"
TIP = "P(105, 10, 55, 180, 0, 180)"
EXTRA = {
    "seven joints": (PTP, SEVEN + ", 12)", 12),
    "eight joints": (PTP, SEVEN + ", 12, 99)", 12),
    "six joints": (PTP, SEVEN + ")", 4),
    "EX": (PTP, SEVEN + ") EX((7, 5))", 9),
    "EX without brackets": (PTP, SEVEN + ") EX(7, 5)", 9),
    "EXA": (PTP, SEVEN + ") EXA((7, -20))", -20),
    "over a seventh joint": (PTP, SEVEN + ", 12) EXA((7, -20))", -20),
    "P": (PTP, TIP, 4),
    "P EX": (PTP, TIP + " EX((7, -5))", -1),
    "array": (PTP, [[105.0, 10.0, 55.0, 180.0, 0.0, 180.0], 0, 0, [1, [7, 5.0]]], 9),
    "line": (LINE, TIP, 4),
    "line EX": (LINE, TIP + " EX((7, 5))", 9),
    "line EXA": (LINE, "@E " + TIP + " EXA((7, -20))", -20),
    "line to seven joints": (LINE, "J(2, 31, 118, 0, 31, 2, 12)", 12),
    "line of the seventh alone": (LINE, "J(0, 30, 120, 0, 30, 0, -30)", -30),
    "arc": (ARC, "P(100, 20, 60, 180, 0, 180), " + TIP + " EX((7, 5))", 9),
    "arc, not through the via's": (ARC, "P(100, 20, 60, 180, 0, 180) EX((7, 20)), " + TIP, 4),
    "curve": (CURVE, "P(100, 20, 60, 180, 0, 180), " + TIP + " EXA((7, 20))", 20),
}


@pytest.mark.parametrize("form", EXTRA)
def test_a_seventh_axis_moves_along(seven, form):
    interpolation, pose, wanted = EXTRA[form]
    seven.stand(*seven.arm.model.home[:6], 4)
    joints = path_of(seven, seven.move(interpolation, pose, "SPEED=50"))
    assert seven.arm.queue.joints[6] == pytest.approx(wanted)
    places = [each[6] for each in joints]
    assert places == sorted(places, reverse=wanted < 4)
    assert max(abs(b - a) for a, b in itertools.pairwise(places)) <= 180 * 0.5 * PERIOD * 1.001
    seven.trace(3)
    assert seven.execute("CurJnt")[6:] == pytest.approx([wanted, 0])


def test_a_seventh_axis_is_driven_and_approached(seven):
    seven.execute("DriveEx", "(7, 10)")
    seven.execute("DriveAEx", "(7, -12), (1, 5)")
    assert seven.arm.queue.joints[::6] == (5, -12)
    seven.execute("Approach", [PTP, TIP + " EXA((7, 8))", 5])
    assert seven.arm.queue.joints[6] == 8
    seven.execute("Approach", [LINE, TIP + " EX((7, 2))", 8])
    assert seven.arm.queue.joints[6] == pytest.approx(10)
    seven.execute("Depart", [LINE, 5])
    assert seven.arm.queue.joints[6] == pytest.approx(10)


@pytest.mark.parametrize(
    ("interpolation", "pose", "code"),
    [
        (PTP, SEVEN + ", 26)", 0x83204237), (PTP, SEVEN + ") EX((7, 30))", 0x83204237), (LINE, TIP + " EX((7, -60))", 0x83204237),
        (PTP, SEVEN + ") EX((8, 1))", hresult.E_INVALIDARG), (LINE, TIP + " EXA((7, 1), (8, 1))", hresult.E_INVALIDARG),
    ],
)  # fmt: skip
def test_limits_of_a_seventh_axis(seven, interpolation, pose, code):
    assert seven.code_of(lambda: seven.move(interpolation, pose)) == code
    assert seven.arm.queue.joints == seven.arm.model.home


@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
def test_an_arm_without_a_seventh_axis_has_none_to_move(cell, interpolation):
    assert cell.code_of(lambda: cell.move(interpolation, POSE + " EX((7, 5))")) == hresult.E_INVALIDARG


# --- what is refused --------------------------------------------------------------------------------------------------

REFUSED = {
    "out of reach": (PTP, "P(2000, 0, 300, 180, 0, 180)", "", hresult.TARGET_OUT_OF_RANGE),
    "line out of reach": (LINE, "P(2000, 0, 300, 180, 0, 180)", "", hresult.TARGET_OUT_OF_RANGE),
    "huge": (PTP, "P(1e300, 0, 0, 0, 0, 0)", "", hresult.TARGET_OUT_OF_RANGE),
    "huge line": (LINE, "P(0, 1e300, 0, 0, 0, 0)", "", hresult.TARGET_OUT_OF_RANGE),
    "axis 1": (PTP, "J(171, 45, 90, 0, 45, 0)", "", 0x83204231),
    "axis 4": (PTP, "J(0, 45, 90, -271, 45, 0)", "", 0x83204234),
    "axis 6": (PTP, "J(0, 45, 90, 0, 45, 1e300)", "", 0x83204236),
    "huge joints of a line": (LINE, "J(0, 1e308, 1e308, 0, 0, 0)", "", hresult.FIGURE_MISMATCH),
    "line behind its back": (LINE, "P(-200, 5, 600, 180, 0, 180)", "", 0x83204231),
    "through the axis of joint 1": (LINE, "P(-250, 1, 300, 180, 0, 180)", "", hresult.SINGULAR_POINT_REFUSED),
    "no such figure": (PTP, "P(350, 0, 300, 180, 0, 180, 37)", "", hresult.FIGURE_INVALID),
    "no such interpolation": (5, POSE, "", hresult.INTERPOLATION_NOT_SUPPORTED),
    "interpolation 0": (0, POSE, "", hresult.INTERPOLATION_NOT_SUPPORTED),
    "option": (PTP, POSE, "FAST", hresult.MOTION_OPTION_INVALID),
    "program's option": (PTP, POSE, "UNTIL IO1", hresult.MOTION_OPTION_INVALID),
    "mark": (PTP, POSE, "@X", hresult.MOTION_OPTION_INVALID),
    "speed 0": (PTP, POSE, "SPEED=0", hresult.VALUE_OUT_OF_RANGE),
    "speed 101": (PTP, POSE, "SPEED=101", hresult.VALUE_OUT_OF_RANGE),
    "speed next to nothing": (PTP, POSE, "SPEED=1e-322", hresult.VALUE_OUT_OF_RANGE),
    "accel next to nothing": (PTP, POSE, "ACCEL=1e-322", hresult.VALUE_OUT_OF_RANGE),
    "speed variable of 0": (PTP, POSE, "SPEED=F2", hresult.VALUE_OUT_OF_RANGE),
    "no such speed variable": (PTP, POSE, "SPEED=F200", hresult.VARIABLE_INDEX_INVALID),
    "time": (PTP, POSE, "TIME=3600001", hresult.VALUE_OUT_OF_RANGE),
    "pose of Rotate": (PTP, POSE, "Pose=3", hresult.VALUE_OUT_OF_RANGE),
    "no such variable": (PTP, "P100", "", hresult.VARIABLE_INDEX_INVALID),
    "a vector": (PTP, "V(1, 2, 3)", "", hresult.DISP_E_TYPEMISMATCH),
    "nonsense": (PTP, "somewhere", "", hresult.E_INVALIDARG),
    "nothing": (PTP, "", "", hresult.E_INVALIDARG),
    "empty": (PTP, None, "", hresult.DISP_E_TYPEMISMATCH),
    "a number": (PTP, 1, "", hresult.DISP_E_TYPEMISMATCH),
    "empty array": (PTP, [], "", hresult.E_INVALIDARG),
    "nan": (PTP, [math.nan, *VALUES[1:]], "", hresult.E_INVALIDARG),
    "infinity": (LINE, [*VALUES[:5], math.inf], "", hresult.E_INVALIDARG),
    "T with a zero vector": (PTP, "T(330, 120, 300, 0, 0, 0, 0, 0, -1)", "", hresult.E_INVALIDARG),
    "T with parallel vectors": (LINE, "T(330, 120, 300, 0, 0, 2, 0, 0, -1)", "", hresult.E_INVALIDARG),
    "one pose for an arc": (ARC, POSE, "", hresult.E_INVALIDARG),
    "three poses for an arc": (ARC, [POSE, POSE, POSE], "", hresult.E_INVALIDARG),
    "an arc of the same pose": (ARC, [POSE, POSE], "", hresult.VALUE_OUT_OF_RANGE),
    "an empty path": (CURVE, 7, "", hresult.E_INVALIDARG),
    "a path's mark": (CURVE, "@1.2.3 7", "", hresult.E_INVALIDARG),
    "a long text": (PTP, "P(" + "1," * 100_000, "", hresult.E_INVALIDARG),
    "a long option": (PTP, POSE, "," * 100_000, hresult.MOTION_OPTION_INVALID),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_moves_move_nothing(cell, case):
    interpolation, pose, option, code = REFUSED[case]
    assert f"{cell.code_of(lambda: cell.move(interpolation, pose, option)):08X}" == f"{code:08X}"
    assert cell.trace(3) == [HOME] * 3
    stops = code >> 16 == 0x8320  # level 3 of a motion
    assert (cell.rc8.state.faults.code == code) is stops
    assert cell.arm.motor.on is not stops
    if stops:
        assert cell.code_of(lambda: cell.move(PTP, POSE)) == hresult.ERROR_PRESENT
        cell.controller.execute("ClearError", variant(None))
        cell.execute("Motor", [1, 0])
    assert not cell.code_of(lambda: cell.move(PTP, POSE))


@pytest.mark.parametrize("end", [(0, 20, 90, -2, -30, 0), (0.5, 20, 90, 0, -30, 0), (0.02, 20, 90, 0, -30, 0)])
def test_a_path_close_to_a_singular_point_is_refused(cell, end):
    cell.stand(0, 20, 90, 2 * (end[3] != 0), 30, 0)
    there = [*cell.execute("J2P", f"J{end}")[:6], -1.0]
    assert cell.code_of(lambda: cell.move(LINE, there)) == hresult.SINGULAR_POINT_REFUSED
    assert not cell.arm.busy
    assert cell.arm.motor.on
    assert not cell.code_of(lambda: cell.move(PTP, f"J{end}"))  # there is another path


def test_a_path_that_leaves_the_working_range_on_its_way(cell):
    """Both ends are within reach; in between the tool points back at the arm, and its wrist is too far out."""
    cell.run(cell.move(PTP, "P(480, 0, 345, 0, 90, 100)"))
    end = "P(480, 0, 345, 0, 90, -100)"
    assert cell.execute("OutRange", end) == 0
    assert cell.code_of(lambda: cell.move(LINE, end)) == hresult.OUT_OF_WORKING_RANGE
    assert cell.rc8.state.faults.code == hresult.OUT_OF_WORKING_RANGE
    assert not cell.arm.busy


def test_a_path_that_leaves_the_limits_on_its_way(cell):
    """In between it comes so near to the shoulder that joint 3 would have to bend more than it can."""
    cell.run(cell.move(PTP, "P(110, 200, 275, 180, 0, 180)"))
    end = "P(110, -200, 275, 180, 0, 180)"
    assert cell.execute("OutRange", end) == 0
    assert cell.code_of(lambda: cell.move(LINE, end)) == hresult.SOFT_LIMIT_OVER_AXIS1 + 2
    assert not cell.arm.busy


def test_an_error_of_planning_stops_the_running_motion(cell):
    first = cell.move(PTP, "J(90, 45, 90, 0, 45, 0)", "SPEED=10")
    cell.trace(20)
    assert cell.code_of(lambda: cell.move(PTP, "J(171, 45, 90, 0, 45, 0)", "NEXT")) == 0x83204231
    cell.trace(100)
    assert cell.code(first) == 0x83204231
    assert not cell.arm.busy
    assert not cell.arm.motor.on


def test_a_motion_to_the_present_position_ends_in_the_next_cycle(cell):
    cell.run(cell.move(PTP, POSE))
    for interpolation, pose in ((PTP, POSE), (LINE, POSE), (CURVE, POSE)):
        assert cell.cycles(cell.move(interpolation, pose)) <= 1
        assert cell.cycles(cell.move(interpolation, "@E " + pose)) <= 3
        assert cell.cycles(cell.move(interpolation, "@P " + pose)) <= 1
    assert cell.cycles(cell.robot.execute("DriveEx", variant("(1,0)"))) <= 1


# --- what is left behind by a stop ------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["Halt", "MotionSkip"])
def test_a_move_after_a_paused_one_was_dropped_is_a_new_one(cell, how):
    """The previous stop has no effect any more: the new motion can be paused, and ends with its own cause."""
    old = cell.move(PTP, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(12)
    cell.run(cell.robot.hold(""))
    if how == "Halt":
        assert cell.robot.halt("").done()
    else:
        assert cell.robot.execute("MotionSkip", variant([-1, 0])).done()
    assert old.done()
    assert cell.code(old) == (hresult.STOPPED_DURING_PC_MOTION if how == "Halt" else 0)
    new = cell.move(PTP, "J(-90, 45, 90, 0, 45, 0)")  # in the same cycle
    cell.trace(12)
    assert not cell.arm.stopping
    cell.run(cell.robot.hold(""))
    stands = cell.arm.queue.joints
    assert cell.trace(10) == [stands] * 10
    cell.rc8.pendant.emergency_stop()
    cell.trace(2)
    assert cell.code(new) == hresult.EMERGENCY_STOP_ON


def test_moves_after_a_stop_begin_where_the_arm_stands(cell):
    for interpolation in (PTP, LINE, CURVE):
        cell.move(interpolation, "P(300, 250, 300, 180, 0, 180)", "NEXT")
        cell.trace(9)
        cell.run(cell.robot.halt(""))
        joints = [cell.arm.queue.joints, *path_of(cell, cell.move(PTP, "J(0, 45, 90, 0, 45, 0)"))]
        steps = np.abs(np.diff(np.array(joints), axis=0)) / PERIOD
        assert (steps.max(0) <= [axis.velocity * 1.001 for axis in cell.arm.model.axes]).all()
        assert cell.arm.queue.joints == HOME


@pytest.mark.parametrize("pivot", [[0, 0, 0], [0.0, 0.0, 0.0], "V(0, 0, 0)", "P(0, 0, 0, 0, 0, 0)"])
def test_three_bare_numbers_are_a_vector_as_a_pivot(cell, pivot):
    cell.run(cell.robot.rotate(variant("XY"), 20.0, variant(pivot), "SPEED=50"))
    assert cell.arm.queue.joints[0] == pytest.approx(20, abs=1e-6)


@pytest.mark.parametrize("form", [Variant(R8, VALUES), VALUES, [VALUES]])
@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_six_numbers_that_may_be_joints_or_a_position_move_nothing(cell, interpolation, form):
    """Mistaking joints for a position would move the arm to an unexpected place."""
    before = cell.arm.queue.joints
    assert cell.code_of(lambda: cell.move(interpolation, form)) == hresult.E_INVALIDARG
    assert cell.code_of(lambda: cell.execute("OutRange", form)) == hresult.E_INVALIDARG
    cell.trace(10)
    assert cell.arm.queue.joints == before
