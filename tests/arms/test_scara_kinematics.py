"""SCARA arms: inverse in closed form, figures, upright flange, straight elbow, paths, and their model files."""

from __future__ import annotations

import numpy as np
import pytest

from orinkit.arms import MODEL_NAMES, load_model, model_of_type, parse_model
from orinkit.arms.frames import matrix_of_position
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult
from orinkit.core.errors import CallError
from support.codes import code_of

BENT = """
name = "Bent"
type_name = "BENT-1"
kind = "scara"
origins = [[10, -20, 100], [300, 40, 50], [200, -30, 5], [20, 10, -5]]
axes = [
    { lower = -170, upper = 170, velocity = 200 },
    { lower = -150, upper = 150, velocity = 200 },
    { lower = -50, upper = 150, velocity = 1000, linear = true },
    { lower = -360, upper = 360, velocity = 400 },
]
home = [0, 45, 0, 0]
"""
ARMS = {
    **{name: Kinematics(model) for name in MODEL_NAMES if (model := load_model(name)).is_scara},
    "Bent": Kinematics(parse_model(BENT, "bent.toml")),
}
HSR = ARMS["HSR065"]


@pytest.mark.parametrize("name", ARMS)
def test_inverse_of_forward_gives_the_joints_back(name):
    arm = ARMS[name]
    axes = arm.model.axes
    joints = np.random.default_rng(1).uniform([a.lower for a in axes], [a.upper for a in axes], (1000, 4))
    frames = arm.forward(joints)
    for one, frame in zip(joints, frames, strict=True):
        solved = arm.inverse(frame, arm.figure(one), one)
        assert arm.forward(solved) == pytest.approx(frame, abs=1e-8)
        if not arm.is_singular(one):
            assert solved == pytest.approx(one, abs=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_all_solutions_reach_the_flange_with_their_figure(name):
    arm = ARMS[name]
    frame = arm.forward((20, 60, 50, 30))
    solutions = arm.solutions(frame)
    assert [figure for figure, _ in solutions] == [0, 1, 16, 17]
    for figure, solution in solutions:
        assert arm.figure(solution) == figure
        assert arm.forward(solution) == pytest.approx(frame, abs=1e-9)
        assert arm.inverse(frame, figure) == pytest.approx(solution, abs=1e-9)


@pytest.mark.parametrize(
    ("joints", "figure"),
    [((0, 60, 0, 0), 0), ((0, -60, 0, 0), 1), ((0, 60, 0, 181), 16), ((0, -60, 0, -180), 17), ((0, 60, 0, 180), 0),
     ((0, 0, 0, 0), 0)],
)  # fmt: skip
def test_figures(joints, figure):
    assert HSR.figure(joints) == figure


@pytest.mark.parametrize("figure", [2, 4, 5, 8, 32, 63, 256, 257, -4])
def test_figures_that_do_not_exist(figure):
    assert code_of(HSR.choose, HSR.forward((0, 60, 0, 0)), figure, (0, 60, 0, 0)) == hresult.FIGURE_OUT_OF_RANGE


def test_a_figure_that_the_limits_of_joint_4_exclude():
    narrow = parse_model(BENT.replace("lower = -360, upper = 360", "lower = -90, upper = 90"), "narrow.toml")
    arm = Kinematics(narrow)
    assert code_of(arm.inverse, arm.forward((0, 45, 0, 0)), 16) == hresult.FIGURE_INVALID


@pytest.mark.parametrize(("rx", "ry"), [(180, 0), (1e-3, 0), (0, 30), (90, 0)])
def test_a_tilted_flange_cannot_be_reached(rx, ry):
    frame = matrix_of_position((400, 100, 50, rx, ry, 20))
    assert code_of(HSR.inverse, frame, 0) == hresult.OUT_OF_WORKING_RANGE
    assert HSR.solutions(frame) == []
    assert "upwards" in HSR.obstacle(frame)
    with pytest.raises(CallError, match="upwards"):
        HSR.follow(frame[None], (0, 60, 0, 0))


def test_an_upright_flange_has_no_obstacle():
    assert HSR.obstacle(matrix_of_position((4000, 100, 50, 0, 0, 20))) == ""


@pytest.mark.parametrize(("x", "reached"), [(650, True), (650.001, False), (100.001, True), (99.999, False)])
def test_the_boundary_of_the_reach(x, reached):
    assert bool(HSR.solutions(matrix_of_position((x, 0, 0, 0, 0, 0)))) is reached


def test_equal_arms_reach_the_axis_of_joint_1():
    arm = ARMS["HM-4A73"]
    found = arm.choose(matrix_of_position((0, 0, 100, 0, 0, 30)), -2, (25, 140, 50, 0))
    assert found[:3] == pytest.approx((25, 180, 54), abs=1e-6)
    assert arm.forward(found) == pytest.approx(matrix_of_position((0, 0, 100, 0, 0, 30)), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "second", "singular"),
    [("HSR065", 0, True), ("HSR065", 0.009, True), ("HSR065", 0.02, False), ("HSR065", -0.005, True),
     ("HSR065", 179.995, True), ("HSR065", 90, False), ("Bent", 0, False)],
)  # fmt: skip
def test_the_straight_elbow_is_singular(name, second, singular):
    assert ARMS[name].is_singular((10, second, 0, 20)) is singular


def test_a_path_cannot_change_the_side_of_the_elbow_except_from_full_stretch():
    assert HSR.path_bits((0, 60, 0, 0)) == HSR.path_bits((0, -60, 0, 0)) == 1
    assert HSR.path_bits((0, 0, 0, 0)) == 0


@pytest.mark.parametrize("start", [(100, 60, 0, 300), (-20, -60, 50, -350)])
def test_a_path_of_joints_is_found_again(start):
    joints = np.asarray(start) + np.linspace(0, 1, 300)[:, None] * (30, 50, 80, 55)
    assert HSR.follow(HSR.forward(joints), joints[0]) == pytest.approx(joints, abs=1e-8)


def test_choosing_keeps_the_figure_within_the_limits():
    frame = HSR.forward((100, 60, 0, 20))
    assert HSR.choose(frame, -1, (100, 60, 0, 20)) == pytest.approx((100, 60, 0, 20), abs=1e-9)
    other = HSR.inverse(frame, 1)
    assert HSR.limits_exceeded(other) == 1  # LEFTY, joint 1 would be beyond 130 deg
    assert HSR.choose(frame, -1, (90, -60, 0, 0)) == pytest.approx((100, 60, 0, 20), abs=1e-9)


def test_fewer_joints_than_axes_and_numbers_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="4 or more"):
        HSR.forward((0, 0, 0))
    assert code_of(HSR.forward, (0, 0, float("nan"), 0)) == hresult.E_INVALIDARG


# --- model files ------------------------------------------------------------------------------------------------------


def test_a_scara_of_a_users_own():
    model = ARMS["Bent"].model
    assert (model.robot_axes, len(model.axes), model.is_scara) == (4, 4, True)
    assert [axis.linear for axis in model.axes] == [False, False, True, False]
    assert load_model("VS-050").robot_axes == load_model("VE026A").robot_axes == 6


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('kind = "scara"', 'kind = "delta"', "kind"),
        ('kind = "scara"', "kind = 4", "kind"),
        ('kind = "scara"\n', "", "axes"),
        (", linear = true", "", "axes[2].linear"),
        ("velocity = 400", "velocity = 400, linear = true", "axes[3].linear"),
        (", [20, 10, -5]", "", "origins"),
        ("[300, 40, 50]", "[0, 0.5, 50]", "origins[1]"),
        ("[20, 10, -5]", "[-200, 30, -5]", "origins[2], origins[3]"),
        ("home = [0, 45, 0, 0]", "home = [0, 45, 151, 0]", "home"),
        ("]\nhome = [0, 45, 0, 0]", "{ lower = 0, upper = 1, velocity = 1 }]\nhome = [0, 45, 0, 0, 0]", "axes"),
    ],
)
def test_invalid_files_of_scaras(old, new, key):
    assert old in BENT
    with pytest.raises(ValueError, match=r"bent\.toml") as caught:
        parse_model(BENT.replace(old, new), "bent.toml")
    assert f": {key}: " in str(caught.value)


@pytest.mark.parametrize(
    ("type_name", "name"),
    [
        ("HSR065A1-N17-NNN-NNN", "HSR065"),
        ("HM4A73-XYZ", "HM-4A73"),
        ("VS060A3-AV6-NNN-NNN", "VS-060"),
        ("HM40702E", None),
    ],
)
def test_models_by_type_name(type_name, name):
    found = model_of_type(type_name)
    assert (found.name if found else None) == name
