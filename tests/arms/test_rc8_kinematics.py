from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.arms import MODEL_NAMES, ArmModel, AxisModel, load_model
from orinkit.arms.frames import matrix_of_position, position_of_matrix, trans_of_matrix
from orinkit.arms.kinematics import Kinematics
from orinkit.arms.kinematics.figures import LIMIT_TOLERANCE, figure_of, normalize_around
from orinkit.core import hresult
from orinkit.core.errors import CallError
from support.codes import code_of

pytestmark = pytest.mark.slow

ARMS = {name: Kinematics(load_model(name)) for name in MODEL_NAMES}
SCARAS = [name for name, arm in ARMS.items() if arm.model.is_scara]
SIX_AXES = {name: arm for name, arm in ARMS.items() if name not in SCARAS}
CLOSED_FORM = [name for name, arm in SIX_AXES.items() if arm._solver._wrist is not None]
SEARCHED = [name for name in SIX_AXES if name not in CLOSED_FORM]
MANY = 100_000
TYPICAL = np.array((30.0, 20.0, 70.0, 10.0, 45.0, 15.0))

# a lateral offset, for which a spherical wrist still has a closed form, and an arm whose joints 4 and 5 do not cross
_WIDE = tuple(AxisModel(-170.0, 170.0, 180.0, 900.0) for _ in range(6))
LATERAL = Kinematics(
    ArmModel(
        "L", "L", ((5, -5, 180), (30, 15, 100), (20, 0, 300), (-30, 5, 100), (0, 0, 200), (0, 0, 80)), _WIDE, (0.0,) * 6
    )
)
OFFSET = Kinematics(
    ArmModel(
        "O", "O", ((0, 0, 180), (20, 0, 100), (0, 0, 300), (-30, 0, 100), (30, 5, 200), (10, 0, 80)), _WIDE, (0.0,) * 6
    )
)


def random_joints(arm: Kinematics, count: int, seed: int) -> np.ndarray:
    axes = arm.model.axes[: arm.model.robot_axes]
    shape = count, len(axes)
    return np.random.default_rng(seed).uniform([axis.lower for axis in axes], [axis.upper for axis in axes], shape)


def turned(difference: np.ndarray) -> np.ndarray:
    """Return differences of angles, normalized to less than a turn."""
    return np.abs(difference - 360.0 * np.round(difference / 360.0))


def pose_errors(found: np.ndarray, wanted: np.ndarray) -> tuple[float, float]:
    """Return the largest errors of frames: mm, and deg."""
    turn = np.swapaxes(wanted[..., :3, :3], -1, -2) @ found[..., :3, :3] - np.eye(3)
    angle = np.degrees(np.sqrt((turn * turn).sum(axis=(-1, -2)) / 2.0))  # of a small rotation
    return float(np.abs(found - wanted)[..., :3, 3].max()), float(angle.max())


# ------------------------------------------------------------------------------------------------- poses that are known


@pytest.mark.parametrize(
    ("name", "joints", "position", "figure"),
    [
        ("VS-050", (0, 45, 90, 0, 45, 0), (364.159992, 0, 278.535534, 180, 0, 180), 5),
        ("VS-060", (0, 45, 90, 0, 45, 0), (434.870670, 0, 285.606602, 180, 0, 180), 5),
        ("VP-6242", (0, 45, 90, 0, 45, 0), (350.017857, 0, 263.033009, 180, 0, 180), 5),
        ("VS-087", (0, 45, 90, 0, 45, 0), (662.8606, 0, 339.7487, 180, 0, 180), 5),
        ("VS-068", (0, 45, 90, 0, 45, 0), (524.9747, 0, 329.1421, 180, 0, 180), 5),
        ("VS-050", (0, 0, 90, 0, 90, 0), (255, 0, 535, 180, 0, 180), 5),
        (
            "VS-050",
            (30, 20, 70, 10, 45, 15),
            (333.454509, 202.444870, 541.177658, 153.449335, 38.880102, -178.671102),
            5,
        ),
        ("VS-060", (0, 0, 90, 0, 0, 0), (370, 0, 660, 0, 90, 0), 1),
        ("COBOTTA", (0, 30, 100, 0, 50, 0), (226.1863, -44.5, 175.9919, 180, 0, 180), 5),
        ("COBOTTA-PRO-900", (0, 0, 90, 0, 90, 0), (390, 120, 560, 180, 0, 180), 5),
        ("COBOTTA-PRO-1300", (0, 0, 90, 0, 90, 0), (590, 100, 760, 180, 0, 180), 5),
        ("VM-60B1", (0, 0, 90, 0, 90, 0), (770, 0, 1005, 180, 0, 180), 5),
        ("VM-6083", (0, 0, 90, 0, 90, 0), (625, 0, 870, 180, 0, 180), 5),
        ("VE026A", (0, 30, 120, 0, 30, 0), (95.0, 0, 50.6603, 180, 0, 180), 5),
        ("VS-6556", (0, 0, 90, 0, 0, 0), (450, 0, 695, 0, 90, 0), 1),  # stated with the kinematics of this arm
        ("VS-6577", (0, 0, 90, 0, 90, 0), (480, 0, 710, 180, 0, 180), 5),
        ("HSR065", (0, 0, 0, 0), (650, 0, 0, 0, 0, 0), 0),
        ("HSR065", (0, 90, -100, -45), (375, 275, -100, 0, 0, 45), 0),
        ("HSR065", (90, -90, 220, 200), (275, 375, 220, 0, 0, -160), 17),
        ("HM-4A73", (30, 0, 300, 0), (606.217783, 350, 346, 0, 0, 30), 0),
    ],
)
def test_documented_poses(name, joints, position, figure):
    arm = ARMS[name]
    frame = arm.forward(joints)
    digits = 1e-6 if position[0] == round(position[0], 6) != round(position[0], 4) else 1e-4
    assert position_of_matrix(frame) == pytest.approx(position, abs=digits)
    assert arm.figure(joints) == figure
    assert arm.inverse(frame, figure) == pytest.approx(joints, abs=1e-8)


def test_the_seed_pose_as_a_user_reads_it():
    position = position_of_matrix(ARMS["VS-050"].forward((0, 45, 90, 0, 45, 0)))
    assert position.tolist()[3:] == [180, 0, 180]
    assert position[:3] == pytest.approx((364.159992, 0, 278.535534), abs=5e-7)
    assert trans_of_matrix(ARMS["VS-050"].forward((0, 45, 90, 0, 45, 0)))[3:].tolist() == [0, 1, 0, 0, 0, -1]


def test_a_pose_that_a_user_recorded_from_a_robot():
    frame = matrix_of_position((409.159, 19.6189, 322.2601, 180, 44.98757, -177.2548))
    joints = ARMS["VS-050"].inverse(frame, 5)
    assert joints == pytest.approx((2.745191, 40.80004, 90.991018, 0.000119, 3.22137, -0.000126), abs=6e-6)


@pytest.mark.parametrize(
    ("change", "figure"),
    [
        ({}, 5),
        ({4: -45}, 1),  # FLIP
        ({1: 100, 2: -70}, 7),  # BELOW
        ({5: 181}, 13),
        ({5: 180}, 5),
        ({5: -180}, 13),
        ({3: -190}, 21),
        ({3: 190, 5: -200}, 29),
        ({0: 185}, 37),
        ({1: -80, 2: 10, 4: -45}, 6),  # RIGHTY, NONFLIP
        ({1: -60, 2: -70}, 0),  # RIGHTY, ABOVE, FLIP
        ({4: 0}, 1),
    ],
)
def test_figure_bits(change, figure):
    joints = TYPICAL.copy()
    for index, value in change.items():
        joints[index] = value
    assert ARMS["VS-050"].figure(joints) == figure


def test_the_stretched_elbow_of_the_vs050():
    arm = ARMS["VS-050"]
    stretched = math.degrees(math.atan(10 / 255))
    assert stretched == pytest.approx(2.2457, abs=1e-4)
    assert arm.figure((0, 45, stretched + 0.001, 0, 45, 0)) == 5
    assert arm.figure((0, 45, stretched - 0.001, 0, 45, 0)) == 7


# ------------------------------------------------------------------------------------------------ forward and Jacobian


@pytest.mark.parametrize("arm", [*ARMS.values(), LATERAL, OFFSET], ids=lambda arm: arm.model.name)
def test_many_at_once_are_as_one_by_one(arm):
    count = arm.model.robot_axes
    joints = random_joints(arm, 12, 1).reshape(3, 4, count)
    frames, jacobians = arm.forward(joints), arm.jacobian(joints)
    assert (frames.shape, jacobians.shape) == ((3, 4, 4, 4), (3, 4, 6, count))
    for index in np.ndindex(3, 4):
        assert frames[index] == pytest.approx(arm.forward(joints[index]), abs=1e-12)
        assert jacobians[index] == pytest.approx(arm.jacobian(joints[index]), abs=1e-12)


@pytest.mark.parametrize("arm", [*ARMS.values(), LATERAL, OFFSET], ids=lambda arm: arm.model.name)
def test_forward_is_the_chain_of_the_reference(arm):
    """Origin, then rotation, joint by joint, about z, y, y, z, y, z; joint 3 of a SCARA moves along z."""
    for joints in random_joints(arm, 20, 2):
        frame = np.eye(4)
        axes = "zzlz" if arm.model.is_scara else "zyyzyz"
        for (x, y, z), axis, value in zip(arm.model.origins, axes, joints, strict=True):
            turn = {"l": (0, 0, 0), "y": (0, value, 0), "z": (0, 0, value)}[axis]
            frame = frame @ matrix_of_position((x, y, z + value if axis == "l" else z, *turn))
        assert arm.forward(joints) == pytest.approx(frame, abs=1e-10)


@pytest.mark.parametrize("arm", [*ARMS.values(), LATERAL, OFFSET], ids=lambda arm: arm.model.name)
def test_the_jacobian_is_the_derivative(arm):
    joints = random_joints(arm, 20, 3)
    step = 1e-4
    frames, jacobian = arm.forward(joints), arm.jacobian(joints)
    for index in range(arm.model.robot_axes):
        there = np.eye(arm.model.robot_axes)[index] * step
        change = (arm.forward(joints + there) - arm.forward(joints - there)) / (2 * step)
        turn = np.degrees(change[:, :3, :3] @ np.swapaxes(frames[:, :3, :3], 1, 2))
        assert change[:, :3, 3] == pytest.approx(jacobian[:, :3, index], abs=1e-7)
        assert turn[:, (2, 0, 1), (1, 2, 0)] == pytest.approx(jacobian[:, 3:, index], abs=1e-7)


def test_extra_axes_do_not_move_the_flange():
    arm = ARMS["VE026A"]
    assert arm.forward((*TYPICAL, 20.0, 9.0)).tolist() == arm.forward(TYPICAL).tolist()
    assert arm.figure((*TYPICAL, 20.0)) == arm.figure(TYPICAL)


# ----------------------------------------------------------------------------------------------- inverse, in great number


@pytest.mark.parametrize("count", [20_000, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("name", CLOSED_FORM)
def test_closed_form_in_every_figure(name, count):
    arm = ARMS[name]
    wrist = arm._solver._wrist
    assert wrist is not None
    joints = random_joints(arm, count, 4)
    frames = arm.forward(joints)
    found_again = np.zeros(count, dtype=bool)
    for posture in range(8):
        solved, reached = wrist.branch(frames, posture, np.zeros(6))
        millimetres, degrees = pose_errors(arm.forward(solved[reached]), frames[reached])
        assert millimetres < 1e-6
        assert degrees < 1e-8
        assert all(figure_of(arm._solver._chain, row) == posture for row in solved[reached][:200].tolist())
        found_again |= reached & (turned(solved - joints).max(axis=1) < 1e-5)
    assert found_again.all()


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("count", [1000, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("name", SEARCHED)
def test_search_finds_the_joints_that_made_the_pose(name, count):
    arm = ARMS[name]
    joints = random_joints(arm, count, 5)
    frames = arm.forward(joints)
    solved, rows = arm._solver._search.solutions(frames)
    millimetres, degrees = pose_errors(arm.forward(solved), frames[rows])
    assert millimetres < 1e-6
    assert degrees < 1e-8
    found = np.zeros(len(joints), dtype=bool)
    found[rows[turned(solved - joints[rows]).max(axis=1) < 1e-4]] = True
    assert found.all()


@pytest.mark.parametrize(
    "joints",
    [
        (-114.490961, -10.088916, 23.225511, -104.298507, 74.99136, -75.632194),
        (143.117949, -55.04973, 108.532414, -147.503214, 87.422741, -50.527246),
        (-126.147644, -23.26609, 48.553733, 169.802024, -93.49806, -72.98288),
        (-12.421672, 83.68346, 63.68894, -66.418825, 7.998927, 18.382738),
    ],
)
def test_search_finds_solutions_that_lie_close_together(joints):
    """The wrist centre is next to the boundary of the reach; gaps between samples; three roots close together."""
    arm = ARMS["COBOTTA"]
    found = [solution for _, solution in arm.solutions(arm.forward(joints))]
    assert min(turned(solution - joints).max() for solution in found) < 1e-4


@pytest.mark.parametrize("count", [20_000, pytest.param(MANY, marks=pytest.mark.soak)])
def test_newtons_method(count):
    arm = ARMS["COBOTTA"]
    joints = random_joints(arm, count, 6)
    frames = arm.forward(joints)
    seeds = joints + np.random.default_rng(7).uniform(-2, 2, joints.shape)
    solved, reached = arm._solver._search.refine(frames, seeds)
    millimetres, degrees = pose_errors(arm.forward(solved[reached]), frames[reached])
    assert millimetres < 1e-6
    assert degrees < 1e-8
    assert reached.mean() > 0.999


@pytest.mark.parametrize("arm", [ARMS["COBOTTA"], OFFSET], ids=lambda arm: arm.model.name)
def test_numeric_inverse_with_the_joints_near_by(arm):
    for joints in random_joints(arm, 200, 8):
        frame = arm.forward(joints)
        solved = arm.inverse(frame, arm.figure(joints), joints + 0.3)
        assert max(pose_errors(arm.forward(solved), frame)) < 1e-8
        assert arm.figure(solved) == arm.figure(joints)


def test_an_arm_without_any_wrist_centre():
    joints = random_joints(OFFSET, 300, 9)
    frames = OFFSET.forward(joints)
    solved, rows = OFFSET._solver._search.solutions(frames)
    assert max(pose_errors(OFFSET.forward(solved), frames[rows])) < 1e-7
    found = set(rows[turned(solved - joints[rows]).max(axis=1) < 1e-4].tolist())
    assert len(found) >= 0.98 * len(joints)


def test_a_lateral_offset_has_a_closed_form_too():
    assert LATERAL._solver._wrist is not None
    for joints in random_joints(LATERAL, 200, 10):
        frame = LATERAL.forward(joints)
        assert turned(LATERAL.inverse(frame, LATERAL.figure(joints)) - joints).max() < 1e-6


# --------------------------------------------------------------------------------------------- inverse, figure by figure


@given(st.sampled_from(CLOSED_FORM), st.tuples(*[st.floats(0, 1)] * 6))
def test_inverse_of_forward_with_its_figure_gives_the_joints_back(name, parts):
    arm = ARMS[name]
    joints = np.array([a.lower + part * (a.upper - a.lower) for a, part in zip(arm.model.axes, parts, strict=False)])
    if arm.is_singular(joints):
        return
    frame = arm.forward(joints)
    solved = arm.inverse(frame, arm.figure(joints), joints)
    assert solved == pytest.approx(joints, abs=1e-4)
    assert max(pose_errors(arm.forward(solved), frame)) < 1e-8


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(0, 1)] * 6))
def test_inverse_of_forward_of_the_cobotta(parts):
    arm = ARMS["COBOTTA"]
    joints = np.array([a.lower + part * (a.upper - a.lower) for a, part in zip(arm.model.axes, parts, strict=True)])
    frame = arm.forward(joints)
    solved = arm.inverse(frame, arm.figure(joints), joints)
    assert max(pose_errors(arm.forward(solved), frame)) < 1e-8
    assert arm.figure(solved) & 7 == arm.figure(joints) & 7


@pytest.mark.parametrize("name", SIX_AXES)
def test_all_solutions_differ_hold_the_flange_and_are_found_by_their_figure(name):
    arm = ARMS[name]
    joints = np.add(arm.model.home[:6], (10, 3, 4, 20, 5, 30))
    frame = arm.forward(joints)
    solutions = arm.solutions(frame)
    assert len(solutions) >= 8
    for index, (figure, solution) in enumerate(solutions):
        assert max(pose_errors(arm.forward(solution), frame)) < 1e-8
        assert arm.figure(solution) == figure
        assert arm.inverse(frame, figure, solution) == pytest.approx(solution, abs=1e-6)
        assert all(np.abs(solution - other).max() > 1e-3 for _, other in solutions[:index])


def test_double_variants_are_those_within_the_limits():
    arm = ARMS["VS-050"]
    frame = arm.forward((10, 20, 70, 100, 45, 15))
    mine = [solution for figure, solution in arm.solutions(frame) if figure & 7 == 5]
    found = {(round(solution[3], 6), round(solution[5], 6)) for solution in mine}
    assert found == {(100, 15), (100, -345), (-260, 15), (-260, -345)}
    assert arm.inverse(frame, 5 + 8) == pytest.approx((10, 20, 70, 100, 45, -345), abs=1e-9)
    assert arm.inverse(frame, 5 + 16) == pytest.approx((10, 20, 70, -260, 45, 15), abs=1e-9)
    assert arm.inverse(frame, 5 + 24) == pytest.approx((10, 20, 70, -260, 45, -345), abs=1e-9)


def test_which_turn_a_double_joint_takes():
    """J6 = 0 may turn to 360 and to -360."""
    arm = ARMS["VS-050"]
    frame = arm.forward((10, 20, 70, 10, 45, 0))
    for sixth in (360.0, -360.0):
        near = np.array((10, 20, 70, 10, 45, sixth / 2))
        assert arm.inverse(frame, 13, near)[5] == pytest.approx(sixth, abs=1e-9)


@pytest.mark.parametrize("figure", [5 + 32, 5 + 16])
def test_a_joint_that_cannot_be_double(figure):
    arm = ARMS["VS-050"]
    assert code_of(arm.inverse, arm.forward(TYPICAL), figure) == hresult.FIGURE_INVALID


def test_a_single_solution_is_given_beyond_the_limits():
    arm = ARMS["VS-050"]
    joints = (175, 20, 70, 10, 45, 15)
    solved = arm.inverse(arm.forward(joints), 5)
    assert solved == pytest.approx(joints, abs=1e-9)
    assert arm.limits_exceeded(solved) == 1


def test_the_wrist_centre_far_behind_cannot_be_reached_in_every_figure():
    """The shoulder of the VS-087 is 30 mm off the axis of joint 1: its farthest point is LEFTY only."""
    arm = ARMS["VS-087"]
    frame = arm.forward((0, 89, 5, 0, 45, 0))
    assert {figure & 1 for figure, _ in arm.solutions(frame)} == {1}
    assert code_of(arm.inverse, frame, 4) == hresult.FIGURE_INVALID
    with pytest.raises(CallError, match=r"\b5\b"):
        arm.inverse(frame, 4)


@pytest.mark.parametrize("name", MODEL_NAMES)
@pytest.mark.parametrize("distance", [5_000.0, 1e12, 1e300])
def test_out_of_reach(name, distance):
    arm = ARMS[name]
    frame = arm.forward(arm.model.home)
    frame[0, 3] = distance
    assert code_of(arm.inverse, frame, 1) == hresult.OUT_OF_WORKING_RANGE
    assert code_of(arm.choose, frame, -1, arm.model.home) == hresult.OUT_OF_WORKING_RANGE
    assert code_of(arm.choose, frame, -2, arm.model.home) == hresult.OUT_OF_WORKING_RANGE
    assert arm.solutions(frame) == []
    assert code_of(arm.follow, [frame], arm.model.home) == hresult.OUT_OF_WORKING_RANGE


def test_too_near_to_the_shoulder():
    frame = ARMS["VS-060"].forward(TYPICAL)
    frame[:3, 3] = ARMS["VS-060"]._solver._base + (0, 0, 163.5) + 70 * frame[:3, 2]
    assert ARMS["VS-060"].solutions(frame) == []


@pytest.mark.parametrize("figure", [-1, -4, 64, 128, 256, 261, 1 << 40, -(1 << 40)])
def test_invalid_figures(figure):
    arm = ARMS["VS-050"]
    assert code_of(arm.inverse, arm.forward(TYPICAL), figure) == hresult.FIGURE_OUT_OF_RANGE
    if figure != -1:
        assert code_of(arm.choose, arm.forward(TYPICAL), figure, TYPICAL) == hresult.FIGURE_OUT_OF_RANGE


def test_the_cobotta_returns_figure_261():
    arm = ARMS["COBOTTA"]
    frame = arm.forward(arm.model.home)
    assert arm.inverse(frame, 261) == pytest.approx(arm.model.home, abs=1e-8)
    assert arm.choose(frame, 261, arm.model.home) == pytest.approx(arm.model.home, abs=1e-8)
    assert code_of(arm.inverse, frame, 256 + 64) == hresult.FIGURE_OUT_OF_RANGE


# ------------------------------------------------------------------------------------------------------ singular points


@pytest.mark.parametrize("near", [None, (0, 0, 0, 77, 0, 0), (0, 0, 0, -200, 0, 0)])
@pytest.mark.parametrize("figure", [1, 5])
def test_where_the_wrist_is_straight_joint_4_is_as_near_by(near, figure):
    arm = ARMS["VS-050"]
    frame = arm.forward((10, 20, 70, 33, 0, 15))
    solved = arm.inverse(frame, figure, near)
    assert solved[3] == pytest.approx(0 if near is None else normalize_around(np.array(float(near[3])), np.array(0.0)))
    assert turned(solved[3] + solved[5] - 48) < 1e-8
    assert max(pose_errors(arm.forward(solved), frame)) < 1e-9


@pytest.mark.parametrize("fifth", [0.0, 1e-13, 1e-11, 1e-9, 1e-8, 1e-6, 1e-4])
def test_the_pose_is_right_however_straight_the_wrist(fifth):
    arm = ARMS["VS-050"]
    frame = arm.forward((10, 20, 70, 33, fifth, 15))
    for posture in range(8):
        millimetres, degrees = pose_errors(arm.forward(arm.inverse(frame, posture)), frame)
        assert millimetres < 1e-6
        assert degrees < 1e-8


def test_where_the_wrist_centre_is_above_joint_1_it_is_as_near_by():
    arm = ARMS["VE026A"]
    joints = np.array((40.0, 0, 0, 20, 30, 10))
    frame = arm.forward(joints)
    assert arm.inverse(frame, arm.figure(joints), joints) == pytest.approx(joints, abs=1e-6)
    other = np.array((-15.0, 0, 0, 20, 30, 10))
    solved = arm.inverse(frame, arm.figure(joints), other)
    assert solved[0] == pytest.approx(-15)
    assert max(pose_errors(arm.forward(solved), frame)) < 1e-6


@pytest.mark.parametrize(
    ("name", "joints", "singular"),
    [
        ("VS-050", TYPICAL, False),
        ("VS-050", (0, 45, 90, 0, 0, 0), True),
        ("VS-050", (0, 45, 90, 0, 0.02, 0), False),
        ("VS-050", (0, 45, 2.2458, 0, 45, 0), True),  # elbow
        ("VS-050", (0, 45, 2.3, 0, 45, 0), False),
        ("VE026A", (40, 0, 0, 20, 30, 10), True),  # elbow and shoulder
        ("VE026A", (0, -30, 66.3628, 20, 30, 10), False),
        ("VE026A", (0, -26.5651, 57.0, 20, 30, 10), False),
        ("COBOTTA", (0, 30, 100, 0, 50, 0), False),
        ("COBOTTA", (0, 30, math.degrees(math.atan(12 / 177.5)), 0, 50, 0), True),
    ],
)
def test_singular_points(name, joints, singular):
    assert ARMS[name].is_singular(joints) is singular


def test_the_shoulder_is_singular_where_the_wrist_centre_is_above_joint_1():
    arm = ARMS["VS-050"]
    second = -30.0
    both = math.degrees(math.asin(250 * math.sin(math.radians(30)) / math.hypot(255, 10)) + math.atan(10 / 255))
    assert arm.is_singular((0, second, both - second, 0, 45, 0))
    assert not arm.is_singular((0, second, both - second + 0.5, 0, 45, 0))


# -------------------------------------------------------------------------------------------------------------- choosing


def test_automatic_keeps_the_figure():
    arm = ARMS["VS-050"]
    for figure, solution in arm.solutions(arm.forward(TYPICAL)):
        if not arm.limits_exceeded(solution):
            assert arm.choose(arm.forward(TYPICAL), -1, solution) == pytest.approx(solution, abs=1e-8)
            moved = arm.choose(arm.forward(TYPICAL + 2), -1, solution)
            assert arm.figure(moved) == figure


@pytest.mark.parametrize("fifth", [-4.0, 4.0])
def test_automatic_from_a_straight_wrist_bends_it_without_turning_it(fifth):
    arm = ARMS["VS-050"]
    goal = (12, 22, 68, 30, fifth, 15)
    assert arm.choose(arm.forward(goal), -1, (10, 20, 70, 30, 0, 15)) == pytest.approx(goal, abs=1e-9)


def test_automatic_looks_for_another_figure_where_that_one_is_beyond_the_limits():
    arm = ARMS["VS-050"]
    near = np.array((165.0, 20, 70, 10, 45, 15))
    frame = arm.forward((175, 20, 70, 10, 45, 15))  # joint 1 ends at 170
    chosen = arm.choose(frame, -1, near)
    assert not arm.limits_exceeded(chosen)
    assert max(pose_errors(arm.forward(chosen), frame)) < 1e-9
    assert chosen.tolist() == arm.choose(frame, -3, near).tolist()
    assert arm.limits_exceeded(arm.choose(frame, -2, near)) == 1  # the least change


def test_automatic_where_the_figure_does_not_exist():
    arm = ARMS["VS-087"]
    frame = arm.forward((0, 89, 5, 0, 45, 0))
    righty = np.array((0.0, -60, -70, 0, 45, 0))
    assert arm.figure(righty) & 1 == 0
    assert arm.figure(arm.choose(frame, -1, righty)) & 1 == 1


def test_least_change_counts_what_takes_longest():
    arm = ARMS["VS-050"]
    near = np.array((10.0, 20, 70, 170, 45, 350))
    goal = np.array((10.0, 20, 70, 190, 45, 355))
    chosen = arm.choose(arm.forward(goal), -2, near)
    assert chosen == pytest.approx(goal, abs=1e-9)
    assert arm.choose(arm.forward(goal), -1, near)[3] == pytest.approx(-170)  # J4 stays SINGLE
    velocities = np.array([axis.velocity for axis in arm.model.axes])
    best = min((np.abs(joints - near) / velocities).max() for _, joints in arm.solutions(arm.forward(goal), near))
    assert (np.abs(chosen - near) / velocities).max() == pytest.approx(best)


def test_within_limits_takes_the_nearest_where_none_is_within():
    arm = ARMS["COBOTTA"]
    joints = (160, 95, 130, 20, 130, 165)
    frame = arm.forward(joints)
    outside = [solution for _, solution in arm.solutions(frame)]
    assert all(arm.limits_exceeded(solution) for solution in outside)
    assert arm.choose(frame, -3, joints) == pytest.approx(joints, abs=1e-7)


@pytest.mark.parametrize("rule", [-1, -2, -3])
def test_choosing_where_the_arm_is_changes_nothing(rule):
    for arm in ARMS.values():
        home = arm.model.home
        assert arm.choose(arm.forward(home), rule, home) == pytest.approx(home[: arm.model.robot_axes], abs=1e-7)


# ------------------------------------------------------------------------------------------------------------- following


def path(start, change, count=400):
    return np.asarray(start, dtype=float) + np.linspace(0, 1, count)[:, None] * np.asarray(change, dtype=float)


@pytest.mark.parametrize(
    ("name", "start", "change"),
    [
        ("VS-050", TYPICAL, (20, 30, 20, -20, 20, 100)),
        ("VS-050", TYPICAL, (-60, 30, 20, 240, 20, 330)),  # J4, J6 beyond a half turn
        ("VS-050", (10, 20, 70, 200, 45, -300), (20, 10, 10, -20, 10, 40)),  # start beyond a half turn
        ("VS-050", (0, 45, 90, 0, 45, 0), (20, 10, 10, 0, -90, 30)),  # J4 = 0 through J5 = 0
        ("VS-050", (0, 45, 90, 30, 0, 0), (20, 10, 10, 0, 0, 30)),  # J5 = 0 throughout
        ("VS-050", (0, 45, 90, 30, 0, 0), (20, 10, 10, 0, -40, 30)),  # from J5 = 0
        ("VS-087", (170, -30, -70, 30, -40, 0), (20, -10, -10, 20, -20, 30)),  # RIGHTY, J1 beyond 180
        ("VP-6242", (0, 30, 90, 0, 60, 0), (30, 30, -30, 100, 30, -200)),
        ("VE026A", (40, 0.001, 60, 10, 30, 10), (0, 30, 30, 0, 0, 0)),
        ("COBOTTA", (0, 30, 100, 0, 50, 0), (40, 30, -30, 60, 40, -100)),
        ("COBOTTA", (0, 30, 100, 10, 50, 150), (40, 10, -30, 30, -90, 100)),  # J5 = 0 is an ordinary place
    ],
)
def test_a_path_of_joints_is_found_again(name, start, change):
    arm = ARMS[name]
    joints = path(start, change)
    found = arm.follow(arm.forward(joints), joints[0])
    assert found == pytest.approx(joints, abs=1e-5)
    assert max(pose_errors(arm.forward(found), arm.forward(joints))) < 1e-8


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_a_straight_line_of_the_flange_is_a_smooth_path_of_the_joints(name):
    arm = ARMS[name]
    count = arm.model.robot_axes
    start = np.add(arm.model.home[:count], (10, 0, 0, 20, 0, 0)[:count])
    frames = np.repeat(arm.forward(start)[None], 500, axis=0)
    frames[:, :3, 3] += np.linspace(0, 1, 500)[:, None] * (20, -40, 30)
    found = arm.follow(frames, start)
    assert found[0] == pytest.approx(start, abs=1e-6)
    assert np.abs(np.diff(found, axis=0)).max() < 0.2
    assert max(pose_errors(arm.forward(found), frames)) < 1e-8


def test_extra_axes_of_the_start_are_ignored():
    arm = ARMS["VE026A"]
    assert arm.follow(arm.forward([arm.model.home]), arm.model.home).shape == (1, 6)


def test_close_to_the_straight_wrist_rows_jump_or_pass():
    """Joint 5 decreases to 0.5 deg while joint 4 turns by 180 deg: the size of the steps decides."""
    arm = ARMS["VS-050"]
    frames = np.repeat(arm.forward((0, 45, 90, 0.6, 30, 0))[None], 200, axis=0)
    tilt = np.linspace(0, -60, 200)
    for index, angle in enumerate(tilt):
        turn = matrix_of_position((0, 0, 0, 0, angle, 0))[:3, :3]
        centre = frames[index, :3, 3] - 70 * frames[index, :3, 2]
        frames[index, :3, :3] = turn @ frames[index, :3, :3]
        frames[index, :3, 3] = centre + 70 * frames[index, :3, 2]
    found = arm.follow(frames, (0, 45, 90, 0.6, 30, 0))
    assert max(pose_errors(arm.forward(found), frames)) < 1e-8
    steps = np.abs(np.diff(found, axis=0)).max(axis=1)
    assert np.median(steps) < 1
    assert steps.max() > 10


@pytest.mark.parametrize("name", ["VS-050", "COBOTTA"])
def test_the_row_that_cannot_be_reached_is_named(name):
    arm = ARMS[name]
    frames = np.repeat(arm.forward(arm.model.home)[None], 50, axis=0)
    frames[:, 0, 3] += np.linspace(0, 1000, 50)
    with pytest.raises(CallError) as caught:
        arm.follow(frames, arm.model.home)
    assert caught.value.code == hresult.OUT_OF_WORKING_RANGE
    first = next(index for index in range(50) if not arm.solutions(frames[index]))
    near_end = arm.follow(frames[:first], arm.model.home)
    assert len(near_end) == first
    assert f" {first} " in caught.value.detail


def test_an_empty_path():
    assert ARMS["VS-050"].follow(np.empty((0, 4, 4)), TYPICAL).shape == (0, 6)


# ---------------------------------------------------------------------------------------------------- limits, bad input


@pytest.mark.parametrize(
    ("joints", "mask"),
    [
        ((0, 0, 0, 0, 0, 0), 0),
        ((105, 90, 135, 140, 105, 140), 0),
        ((105 + LIMIT_TOLERANCE / 2, 0, 0, 0, 0, 0), 0),
        ((105.001, 0, 0, 0, 0, 0), 1),
        ((-80.1, -35.1, 0, 0, -90.1, 141), 0b110011),
        ((0, 0, 0, 0, 0, 0, 25.1), 64),
        ((0, 0, 0, 0, 0, 0, 25), 0),
        ((1e300, 0, 0, 0, 0, 0), 1),
    ],
)
def test_limits(joints, mask):
    assert ARMS["VE026A"].limits_exceeded(joints) == mask


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["VS-050", "COBOTTA"])
def test_numbers_that_are_not_finite(name, bad):
    arm = ARMS[name]
    joints = (0, 45, bad, 0, 45, 0)
    frame = arm.forward(arm.model.home)
    frame[1, 3] = bad
    for call, *arguments in (
        (arm.forward, joints),
        (arm.forward, [joints]),
        (arm.jacobian, joints),
        (arm.figure, joints),
        (arm.limits_exceeded, joints),
        (arm.is_singular, joints),
        (arm.inverse, frame, 5),
        (arm.inverse, arm.forward(TYPICAL), 5, joints),
        (arm.solutions, frame),
        (arm.choose, frame, -1, TYPICAL),
        (arm.follow, [frame], TYPICAL),
        (arm.follow, [arm.forward(TYPICAL)], joints),
    ):
        assert code_of(call, *arguments) == hresult.E_INVALIDARG


def test_a_matrix_that_is_not_a_frame():
    frame = ARMS["VS-050"].forward(TYPICAL)
    with pytest.raises(ValueError):
        ARMS["VS-050"].inverse(frame[:3, :3], 5)
    with pytest.raises(ValueError):
        ARMS["VS-050"].inverse(frame[None], 5)
    with pytest.raises(ValueError):
        ARMS["VS-050"].follow(np.eye(4), TYPICAL)
    with pytest.raises(ValueError):
        ARMS["VS-050"].forward((1, 2, 3))
    frame[0, 0] = 1e200
    assert code_of(ARMS["VS-050"].inverse, frame, 5) == hresult.E_INVALIDARG


@pytest.mark.parametrize("name", ["VS-050", "COBOTTA"])
def test_huge_joints_are_joints(name):
    arm = ARMS[name]
    frame = arm.forward((1e300, -1e15, 1e10, 0, 1e100, 7))
    assert np.isfinite(frame).all()
    assert arm.figure((1e300, 0, 90, 0, 45, 0)) >= 0
