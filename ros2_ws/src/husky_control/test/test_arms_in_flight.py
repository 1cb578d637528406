"""What arms do for a flight that has lost a rotor or a hip: against the rotors' geometry."""

import math

import numpy as np
import pytest

from husky_control.flight.three_rotors import SWEEP, TILT_LIMIT, ThreeRotors
from husky_control.modes.limp_arm import LimpArm
from husky_control.tick_data import TICK
from husky_description.fan import FanModel
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry

ROBOT = load_robot("beta")
POSTURE = np.array(flight_posture(ROBOT))
DRAG = FanModel.of(ROBOT).moment_per_thrust
WEIGHT = ROBOT.mass * 9.80665


def moved(lost, yaw_rate, seconds=0.5):
    """Return the posture after a time in which the body turned steadily."""
    arms = ThreeRotors(ROBOT.joint_speed)
    for _ in range(round(seconds / TICK)):
        posture = POSTURE.copy()
        arms.move_arms(lost, yaw_rate, posture, TICK)
    return posture


def hover_thrust(posture, lost):
    """Return thrusts [N] (4,) of three rotors that carry the weight without roll and pitch."""
    matrix = rotor_geometry(ROBOT, posture).effectiveness(DRAG)[2:5]
    left = [leg for leg in range(4) if leg != lost]
    thrust = np.zeros(4)
    thrust[left] = np.linalg.solve(matrix[:, left], (WEIGHT, 0.0, 0.0))
    return thrust


@pytest.mark.parametrize("lost", range(4))
def test_all_three_rotors_push_and_the_one_across_has_room_both_ways(lost):
    """In the posture of four the one across would rest; no more is asked than 14.8 V give."""
    assert abs(hover_thrust(POSTURE, lost)[3 - lost]) < 0.2
    thrust = hover_thrust(moved(lost, 0.0), lost)
    assert 0.7 < thrust[3 - lost] < 3.0
    assert thrust.max() < FanModel.of(ROBOT).steady_thrust(14.8)


@pytest.mark.parametrize("lost", range(4))
def test_hips_tilt_against_the_spin_and_push_the_body_nowhere(lost):
    thrust = hover_thrust(moved(lost, 0.0), lost)
    still = rotor_geometry(ROBOT, moved(lost, 0.0)).effectiveness(DRAG) @ thrust
    assert abs(still[5]) > 0.2  # the drag of rotors of which two turn the same way
    spin = math.copysign(3.0, still[5])
    turning = moved(lost, spin)
    force = rotor_geometry(ROBOT, turning).effectiveness(DRAG) @ thrust
    assert force[5] * still[5] < 0.0  # more than the drag, against it
    assert math.hypot(*force[:2]) < 0.15 * WEIGHT * math.sin(TILT_LIMIT) + 0.3


def test_arms_go_no_further_and_no_faster_than_they_may():
    arms, before = ThreeRotors(ROBOT.joint_speed), POSTURE
    for k in range(1000):
        posture = POSTURE.copy()
        arms.move_arms(0, 50.0 if k < 500 else -50.0, posture, TICK)
        assert np.abs(posture - before).max() / TICK < ROBOT.joint_speed + 1e-6
        before = posture
    assert np.abs(before - POSTURE).max() <= max(SWEEP, TILT_LIMIT) + 1e-9


def test_the_arm_across_mirrors_the_limp_one_and_nobody_else_moves():
    arm, measured = LimpArm(), POSTURE.copy()
    measured[6] += 0.3  # hind left
    for _ in range(20):
        commanded = POSTURE.copy()
        arm.even_out(measured, commanded, TICK)
    changed = np.flatnonzero(commanded != POSTURE)
    assert changed.tolist() == [9] and commanded[9] == -measured[6]
    geometry = rotor_geometry(ROBOT, np.where(commanded != POSTURE, commanded, measured))
    force = geometry.effectiveness(DRAG) @ np.full(4, WEIGHT / 4.0)
    alone = rotor_geometry(ROBOT, measured).effectiveness(DRAG) @ np.full(4, WEIGHT / 4.0)
    assert abs(force[1]) < 1e-9 < 0.1 * abs(alone[1])
    assert abs(force[5]) < 0.01 * abs(alone[5])


def test_a_hip_that_gives_way_for_a_moment_is_not_limp():
    arm, measured = LimpArm(), POSTURE.copy()
    for k in range(100):
        measured[0] = POSTURE[0] + (0.3 if k % 20 < 10 else 0.0)
        commanded = POSTURE.copy()
        arm.even_out(measured, commanded, TICK)
        assert np.array_equal(commanded, POSTURE)
