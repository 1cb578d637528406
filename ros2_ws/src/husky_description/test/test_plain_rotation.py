"""Rotations as plain numbers against SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.rotation import (
    about_z,
    conjugate,
    from_roll_pitch_yaw,
    from_rows,
    multiply,
    rotate,
    swap_body,
    swap_world_and_body,
    tilt_of,
    to_roll_pitch_yaw,
)

ANGLE = st.floats(-math.pi, math.pi)
PITCH = st.floats(-1.5, 1.5)  # beyond it roll and yaw are poorly told apart
TURN = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(random_state=seed))
VECTOR = st.tuples(*[st.floats(-10.0, 10.0)] * 3)


def plain(turn):
    return tuple(turn.as_quat().tolist())


@given(TURN, TURN, VECTOR)
def test_products_and_turned_vectors(a, b, vector):
    product = Rotation.from_quat(multiply(plain(a), plain(b)))
    assert (product.inv() * a * b).magnitude() < 1e-12
    assert rotate(plain(a), vector) == pytest.approx(a.apply(vector), abs=1e-12)
    assert rotate(conjugate(plain(a)), vector) == pytest.approx(a.inv().apply(vector), abs=1e-12)


@given(TURN, st.sampled_from([None, "x", "y", "z"]))
def test_the_rows_of_a_matrix(turn, half_turn_about):
    """Near half a turn as well, where one element of the quaternion vanishes."""
    if half_turn_about is not None:
        turn = Rotation.from_euler(half_turn_about, math.pi)
    made = from_rows(turn.as_matrix().ravel().tolist())
    assert (Rotation.from_quat(made).inv() * turn).magnitude() < 1e-7
    assert np.linalg.norm(made) == pytest.approx(1.0, abs=1e-12)


@given(ANGLE, PITCH, ANGLE)
def test_roll_pitch_yaw_there_and_back(roll, pitch, yaw):
    turn = from_roll_pitch_yaw(roll, pitch, yaw)
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw])
    assert (Rotation.from_quat(turn).inv() * expected).magnitude() < 1e-12
    back = np.subtract(to_roll_pitch_yaw(turn), (roll, pitch, yaw))
    # abs(pitch) <= 1.5 loses a factor of 14 in roll and yaw.
    np.testing.assert_allclose([math.remainder(each, math.tau) for each in back], 0.0, atol=1e-12)
    assert math.cos(tilt_of(turn)) == pytest.approx(expected.as_matrix()[2, 2], abs=1e-12)


@given(ANGLE)
def test_a_turn_about_the_vertical(angle):
    turn = Rotation.from_quat(about_z(angle))
    assert (turn.inv() * Rotation.from_euler("z", angle)).magnitude() < 1e-12


@given(TURN)
def test_axes_of_aircraft_and_of_ros(turn):
    ned_to_enu = Rotation.from_rotvec(math.pi / math.sqrt(2) * np.array([1.0, 1.0, 0.0]))
    expected = ned_to_enu * turn * Rotation.from_rotvec([math.pi, 0.0, 0.0])
    swapped = swap_world_and_body(plain(turn))
    assert (Rotation.from_quat(swapped).inv() * expected).magnitude() < 1e-12
    assert swap_world_and_body(swapped) == pytest.approx(plain(turn), abs=1e-12)
    assert swap_body((1.0, 2.0, 3.0)) == (1.0, -2.0, -3.0)
