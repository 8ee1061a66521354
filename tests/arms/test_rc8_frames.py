from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.arms.frames import (
    inverse_of,
    matrix_of_position,
    matrix_of_trans,
    position_of_matrix,
    rotation_about,
    rotation_between,
    trans_of_matrix,
)
from orinkit.core import hresult
from support.codes import code_of

ANGLES = st.floats(-720, 720) | st.sampled_from([0.0, 90.0, -90.0, 180.0, -180.0, 270.0, 45.0, 1e-9, 90.0 + 1e-9])
LENGTHS = st.floats(-1e4, 1e4)
POSITIONS = st.tuples(LENGTHS, LENGTHS, LENGTHS, ANGLES, ANGLES, ANGLES)


@given(POSITIONS)
def test_p_of_its_matrix_is_the_same_pose_with_angles_in_range(values):
    frame = matrix_of_position(values)
    written = position_of_matrix(frame)
    assert np.abs(matrix_of_position(written) - frame).max() < 1e-10
    assert (written[3:] > -180).all()
    assert (written[3:] <= 180).all()
    assert abs(written[4]) <= 90


@given(st.tuples(LENGTHS, LENGTHS, LENGTHS, st.floats(-179, 180), st.floats(-89, 89), st.floats(-179, 180)))
def test_p_values_come_back(values):
    assert position_of_matrix(matrix_of_position(values)) == pytest.approx(values, abs=1e-9)


@given(POSITIONS)
def test_t_values_come_back(values):
    frame = matrix_of_position(values)
    written = trans_of_matrix(frame)
    assert written[3:6] == pytest.approx(frame[:3, 1], abs=1e-11)
    assert written[6:] == pytest.approx(frame[:3, 2], abs=1e-11)
    assert np.abs(matrix_of_trans(written) - frame).max() < 1e-11


def test_rotation_order_is_rz_ry_rx():
    expected = rotation_about((0, 0, 1), 50) @ rotation_about((0, 1, 0), 40) @ rotation_about((1, 0, 0), 30)
    assert matrix_of_position((1, 2, 3, 30, 40, 50))[:3, :3] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    ("angles", "written"),
    [
        ((180, 0, 180), (180, 0, 180)),
        ((-180, 0, -180), (180, 0, 180)),
        ((0, 180, 0), (180, 0, 180)),
        ((0, 90, 0), (0, 90, 0)),
        ((30, 90, 50), (0, 90, 20)),
        ((30, -90, 50), (0, -90, 80)),
        ((0, -90, 180), (0, -90, 180)),
        ((0, 0, 360), (0, 0, 0)),
        ((0, 0, -90), (0, 0, -90)),
    ],
)
def test_round_angles_are_written_exactly(angles, written):
    found = position_of_matrix(matrix_of_position((0.0, -0.0, 5.0, *angles)))
    assert found[3:] == pytest.approx(written, abs=1e-12)
    round_ones = [(a, b) for a, b in zip(found[3:], written, strict=True) if b % 90 == 0]
    assert all(a == b for a, b in round_ones)
    assert not np.signbit(found[found == 0]).any()


def test_many_at_once():
    values = np.random.default_rng(3).uniform(-89, 89, (4, 5, 6))
    frames = matrix_of_position(values)
    assert frames.shape == (4, 5, 4, 4)
    assert frames[2, 3] == pytest.approx(matrix_of_position(values[2, 3]), abs=1e-15)
    assert position_of_matrix(frames) == pytest.approx(values, abs=1e-9)
    assert inverse_of(frames) @ frames == pytest.approx(np.broadcast_to(np.eye(4), frames.shape), abs=1e-12)


def test_t_vectors_are_made_square_and_of_length_one():
    frame = matrix_of_trans((1, 2, 3, 0, 5, 1e-3, 0, 0, -1e300))
    assert frame[:3, 2] == pytest.approx((0, 0, -1))
    assert frame[:3, 1] == pytest.approx((0, 1, 0))
    assert frame[:3, 0] == pytest.approx((-1, 0, 0))  # normal = O x A
    assert np.linalg.det(frame[:3, :3]) == pytest.approx(1)
    assert frame[:3, 3] == pytest.approx((1, 2, 3))


@pytest.mark.parametrize(
    ("orient", "approach"),
    [((0, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 0)), ((0, 1, 0), (0, -2, 0)), ((0, 1, 0), (0, 1, 1e-12)), ((0, 1, math.nan), (0, 0, 1))],
)  # fmt: skip
def test_t_vectors_that_give_no_frame(orient, approach):
    assert code_of(matrix_of_trans, (0, 0, 0, *orient, *approach)) == hresult.E_INVALIDARG


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite(bad):
    frame = np.eye(4)
    frame[1, 3] = bad
    for call, argument in (
        (matrix_of_position, (0, 0, 0, 0, bad, 0)),
        (position_of_matrix, frame),
        (trans_of_matrix, frame),
        (inverse_of, frame),
    ):
        assert code_of(call, argument) == hresult.E_INVALIDARG
    assert code_of(rotation_about, (0, 0, 1), bad) == hresult.E_INVALIDARG
    assert code_of(rotation_about, (0, 0, 0), 1.0) == hresult.E_INVALIDARG


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (matrix_of_position, (1, 2, 3)),
        (matrix_of_position, 1.0),
        (position_of_matrix, np.eye(3)),
        (matrix_of_trans, (1,) * 6),
    ],
)
def test_other_shapes_are_programming_errors(call, argument):
    with pytest.raises(ValueError):
        call(argument)


def test_huge_numbers_are_numbers():
    frame = matrix_of_position((1e300, -1e300, 0, 1e300, 1e17, -1e300))
    assert np.isfinite(position_of_matrix(frame)).all()


@given(st.tuples(ANGLES, ANGLES, ANGLES), st.tuples(*[st.floats(-1, 1)] * 3), ANGLES)
def test_the_rotation_between_two_orientations_leads_from_one_to_the_other(angles, axis, angle):
    first = matrix_of_position((0, 0, 0, *angles))[:3, :3]
    second = (rotation_about(axis, angle) if any(axis) else np.eye(3)) @ first
    found, degrees = rotation_between(first, second)
    assert np.linalg.norm(found) == pytest.approx(1)
    assert 0 <= degrees <= 180
    assert np.abs(rotation_about(found, degrees) @ first - second).max() < 1e-12


@pytest.mark.parametrize("angle", [1e-9, 0.5, 90.0, 179.999999, 180.0])
def test_small_and_half_turns_are_exact(angle):
    axis, found = rotation_between(np.eye(3), rotation_about((3, 0, 4), angle))
    assert found == pytest.approx(angle, rel=1e-9)
    assert abs(axis @ (0.6, 0, 0.8)) == pytest.approx(1, abs=1e-12)


def test_nothing_turns():
    axis, angle = rotation_between(np.eye(3), np.eye(3))
    assert angle == 0
    assert axis.tolist() == [0, 0, 1]
