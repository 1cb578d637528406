"""Rotations against SciPy."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.rotation import (
    matrix_from_quaternion,
    matrix_from_roll_pitch_yaw,
    tilt_of,
    wrap_angle,
    yaw_of,
)

ANGLE = st.floats(-math.pi, math.pi)
PITCH = st.floats(-1.5, 1.5)


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_matrix_of_a_quaternion(values):
    quaternion = np.array(values)
    assume(np.linalg.norm(quaternion) > 0.1)
    matrix = np.empty((3, 3))
    matrix_from_quaternion(quaternion, matrix)  # the length does not matter
    np.testing.assert_allclose(matrix, Rotation.from_quat(quaternion).as_matrix(), atol=1e-13)


@given(ANGLE, PITCH, ANGLE)
def test_matrix_of_roll_pitch_yaw(roll, pitch, yaw):
    matrix = np.empty((3, 3))
    matrix_from_roll_pitch_yaw(roll, pitch, yaw, matrix)
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    np.testing.assert_allclose(matrix, expected.as_matrix(), atol=1e-13)
    # abs(pitch) <= 1.5 keeps the heading's projection above 0.07.
    assert math.remainder(yaw_of(matrix) - yaw, math.tau) == pytest.approx(0.0, abs=1e-12)


@given(ANGLE, st.floats(0.01, math.pi - 0.01), ANGLE)
def test_tilt_is_the_angle_from_the_vertical(direction, tilt, yaw):
    axis = np.array([math.cos(direction), math.sin(direction), 0.0])
    rotation = Rotation.from_rotvec(tilt * axis) * Rotation.from_euler("z", yaw)
    # acos loses 1e-16 / sin(tilt), and sin(0.01) = 0.01.
    assert tilt_of(rotation.as_matrix()) == pytest.approx(tilt, abs=1e-12)


def test_tilt_survives_rounding_beyond_one():
    matrix = np.eye(3)
    matrix[2, 2] = 1.0 + 1e-15
    assert tilt_of(matrix) == 0.0
    matrix[2, 2] = -1.0 - 1e-15
    assert tilt_of(matrix) == pytest.approx(math.pi)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-12)


@pytest.mark.parametrize("angle", [math.pi, -math.pi])
def test_half_a_turn_has_one_name(angle):
    assert wrap_angle(angle) == math.pi
