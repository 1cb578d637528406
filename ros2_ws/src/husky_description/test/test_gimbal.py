"""The axis of a vectored thrust: geometry against SciPy, servos, pulses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.gimbal import NEUTRAL, Gimbal, axis, into_base, into_unit, rotation
from husky_description.robot import load_robot

GIMBAL = Gimbal.of(load_robot(fans__mounting="vectoring"))
PITCH, ROLL = GIMBAL.limits
pitches = st.floats(-PITCH, PITCH)
rolls = st.floats(-ROLL, ROLL)


def test_a_fixed_unit_has_none():
    assert Gimbal.of(load_robot()) is None


@given(pitches, rolls)
def test_the_axis_is_z_turned_about_y_and_then_about_x(pitch, roll):
    turned = Rotation.from_euler("YX", [pitch, roll])
    np.testing.assert_allclose(rotation((pitch, roll)), turned.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(axis((pitch, roll)), turned.apply((0, 0, 1)), atol=1e-12)
    vector = (0.3, -1.2, 2.0)
    np.testing.assert_allclose(into_base((pitch, roll), vector), turned.apply(vector), atol=1e-12)
    np.testing.assert_allclose(
        into_unit((pitch, roll), vector), turned.inv().apply(vector), atol=1e-12
    )


@given(pitches, rolls, st.floats(0.01, 80.0))
def test_angles_of_a_direction_are_those_of_its_axis(pitch, roll, length):
    direction = np.array(axis((pitch, roll))) * length
    assert GIMBAL.angles(direction) == pytest.approx((pitch, roll), abs=1e-6)


def test_where_directions_point():
    assert GIMBAL.angles((0, 0, 0)) == NEUTRAL
    assert GIMBAL.angles((1, 0, 0)) == pytest.approx((math.pi / 2, 0))  # forward
    assert GIMBAL.angles((0, 1, 1)) == pytest.approx((0, -math.pi / 4))  # left
    # Up a vertical wall and into it: the body's forward and down.
    assert GIMBAL.angles((1, 0, -0.7)) == pytest.approx((math.radians(90 + 34.992), 0), abs=1e-4)
    assert GIMBAL.angles((0, 0, -1)) == pytest.approx((PITCH, 0))  # beyond the limit
    assert GIMBAL.angles((0, 1, 0)) == pytest.approx((0, -ROLL))


def test_slewing_takes_its_rate_and_arrives():
    angles, target, time = NEUTRAL, (1.0, -0.4), 0.0
    while angles != target:
        before = angles
        angles = GIMBAL.slewed(angles, target, 0.002)
        assert max(abs(a - b) for a, b in zip(angles, before, strict=True)) <= 0.012 + 1e-12
        time += 0.002
    assert time == pytest.approx(1.0 / GIMBAL.rate, abs=0.003)


def test_servos_lag_keep_their_rate_and_their_limits():
    angles = NEUTRAL
    for k in range(1, 400):
        before, angles = angles, GIMBAL.followed(angles, (9.0, -0.05), 0.0005)
        assert angles[0] - before[0] <= 0.0005 * GIMBAL.rate + 1e-12
        # The small step is the first-order lag alone.
        assert angles[1] == pytest.approx(-0.05 * (1 - math.exp(-k * 0.0005 / GIMBAL.lag)))
    for _ in range(4000):
        angles = GIMBAL.followed(angles, (9.0, -0.05), 0.0005)
    assert angles == pytest.approx((PITCH, -0.05))


@given(pitches, rolls)
def test_pulses_mean_the_angles(pitch, roll):
    pulses = GIMBAL.pulses((pitch, roll))
    assert all(1000 <= pulse <= 2000 for pulse in pulses)
    # A microsecond is a thousandth of the range.
    assert GIMBAL.told(pulses) == pytest.approx((pitch, roll), abs=PITCH / 1000 + 1e-9)


def test_without_pulses_the_axis_stays():
    assert GIMBAL.told((0, 0), (0.7, 0.1)) == (0.7, 0.1)
    assert GIMBAL.pulses(NEUTRAL) == (1500, 1500)
    assert GIMBAL.told((2000, 0), (0.7, 0.1)) == (PITCH, 0.1)
