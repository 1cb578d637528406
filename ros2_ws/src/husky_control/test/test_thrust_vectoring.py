"""Tilted propellers against the moment that MuJoCo-checked rotor geometry gives (T21)."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control.flight.hover import HoverPhase
from husky_control.flight.thrust_vectoring import (
    TILT_LIMIT,
    ThrustVectoring,
    hover_wrench,
    tilt_per_moment,
)
from husky_control.modes.arms_in_flight import (
    DRAWN_TOGETHER,
    YAW_RATE_CUTOFF,
    ArmsInFlight,
)
from husky_control.parameters import Parameters
from husky_control.tick_data import JointCommand
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture

BETA = load_robot("beta")
DT = 0.002


def swing_of_the_hips(frequency):
    """Greatest hip angle [rad] with which arms answer a yaw rate of 0.1 rad/s amplitude [Hz]."""
    parameters = Parameters.of(BETA)
    parameters.set("quadrotor.thrust_vectoring", 1.0)
    measured = SimpleNamespace(
        angular_velocity_base_in_base=np.zeros(3), joint_position=np.zeros(12), fans_lost=-1
    )
    arms = ArmsInFlight(
        SimpleNamespace(
            robot=BETA,
            vectoring=ThrustVectoring(BETA),
            parameters=parameters,
            hover=SimpleNamespace(phase=HoverPhase.HOLD, heading=0.0, yaw_rate=0.0, lead=0.0),
            body=SimpleNamespace(rotation=np.eye(3), measurements=measured),
        )
    )
    hips = []
    for tick in range(round(3.0 / DT)):
        rate = 0.1 * np.sin(2.0 * np.pi * frequency * tick * DT)
        measured.angular_velocity_base_in_base[2] = rate
        command = JointCommand()
        arms.move(command)
        hips.append(command.position[0])
    return np.abs(hips[len(hips) // 2 :]).max()


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


def test_arms_that_damp_the_yaw_do_not_answer_to_what_rings():
    """A body on its frame and servos rings above 20 Hz; it turns below 1 Hz."""
    ring, turn = swing_of_the_hips(22.0), swing_of_the_hips(0.5)
    per_rate = Parameters.of(BETA)["quadrotor.yaw_damping"] * tilt_per_moment(BETA)[0]
    assert turn == pytest.approx(0.1 * abs(per_rate), rel=0.02)
    assert ring == pytest.approx(turn / np.hypot(1.0, 22.0 / YAW_RATE_CUTOFF), rel=0.1)
