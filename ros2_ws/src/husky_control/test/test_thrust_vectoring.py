"""Tilted propellers against the moment that MuJoCo-checked rotor geometry gives (T21)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control.flight.thrust_vectoring import (
    TILT_LIMIT,
    ThrustVectoring,
    hover_wrench,
    tilt_per_moment,
)
from husky_control.modes.arms_in_flight import DRAWN_TOGETHER
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture

BETA = load_robot("beta")
DT = 0.002


def wrench_of(angles):
    posture = flight_posture(BETA).copy()
    posture[0::3] += angles
    return hover_wrench(BETA, posture)


def settled(moment):
    vectoring = ThrustVectoring(BETA)
    for _ in range(200):
        vectoring.advance(moment, DT)
    return vectoring


@pytest.mark.parametrize("moment", [-0.3, 0.1, 0.5])
def test_the_moment_is_the_one_asked_for_and_nothing_else(moment):
    """Second order of 8 degrees: 0.5 % of the moment, 1 % of the lift."""
    force_and_moment = wrench_of(settled(moment).angle)
    assert force_and_moment[5] == pytest.approx(moment, rel=5e-3)
    np.testing.assert_allclose(force_and_moment[[0, 1, 3, 4]], 0.0, atol=1e-9)
    assert force_and_moment[2] == pytest.approx(BETA.mass * GRAVITY, rel=0.01)


def test_closed_form_of_four_levers():
    """Each thrust of a quarter of the weight has the lever of the hip ahead of the middle."""
    per_leg = BETA.mass * GRAVITY / 4.0 * BETA.leg.hip_x
    signs = np.array((-1.0, -1.0, 1.0, 1.0))  # a positive angle leans any propeller to the right
    np.testing.assert_allclose(tilt_per_moment(BETA), signs / (4.0 * per_leg), rtol=1e-3)


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=60))
def test_no_wish_exceeds_angle_or_speed(moments):
    vectoring = ThrustVectoring(BETA)
    last = vectoring.angle.copy()
    for moment in moments:
        for _ in range(5):
            vectoring.advance(moment, DT)
            assert np.abs(vectoring.angle).max() <= TILT_LIMIT + 1e-12
            assert np.abs(vectoring.angle - last).max() <= vectoring.greatest_speed * DT + 1e-12
            np.testing.assert_allclose(vectoring.speed, (vectoring.angle - last) / DT, atol=1e-9)
            last = vectoring.angle.copy()


def test_without_a_wish_the_propellers_come_upright():
    vectoring = settled(5.0)
    assert np.abs(vectoring.angle).max() == pytest.approx(TILT_LIMIT)
    for _ in range(round(TILT_LIMIT / vectoring.greatest_speed / DT) + 1):
        vectoring.advance(0.0, DT)
    np.testing.assert_array_equal(vectoring.angle, 0.0)


def test_arms_that_near_each_other_keep_the_lift_centred():
    """Second order of 8 deg: under 0.01 N m of pitch; all arms to one side make 0.4 N m."""
    together, aside = flight_posture(BETA).copy(), flight_posture(BETA).copy()
    together[1::3] += 0.14 * DRAWN_TOGETHER
    aside[1::3] += 0.14
    np.testing.assert_allclose(hover_wrench(BETA, together)[3:], 0.0, atol=0.01)
    assert abs(hover_wrench(BETA, aside)[4]) > 0.2
