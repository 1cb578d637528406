"""Legs of the reduced-order model and the robot's joints: the same feet, and there and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from leg_coordinates import LegCoordinates

from husky_control.planning.rom_parameters import hips_in_base
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot()
KINEMATICS = Kinematics(ROBOT)
MAP = LegCoordinates(ROBOT)


@st.composite
def joints(draw):
    """Twelve joint positions about the stance: knees bent by 0.3 to 2.2 rad, hips within 0.6."""
    unit = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(12)]).reshape(4, 3)
    middle, half = np.array([0.0, 0.6, -1.25]), np.array([0.6, 0.6, 0.95])
    return (middle + half * unit).reshape(-1)


def test_the_standing_robot_has_straight_legs_down():
    expected = np.tile([0.0, 0.0, ROBOT.stand_height], 4)
    np.testing.assert_allclose(MAP.from_joints(ROBOT.stand_joint_position), expected, atol=1e-14)


@settings(max_examples=50)
@given(joints())
def test_the_feet_are_the_same_and_the_way_back_leads_home(q):
    legs = MAP.from_joints(q)
    np.testing.assert_allclose(MAP.feet(legs), KINEMATICS.foot_positions(q), atol=1e-14)
    # 1e-16 m over a knee that is bent by 0.3 rad or more: the inverse loses one digit or two.
    np.testing.assert_allclose(MAP.to_joints(legs), q, atol=1e-12)


@settings(max_examples=50)
@given(joints())
def test_velocities_are_slopes_and_lead_back(q):
    rate, step = np.cos(np.arange(12.0)), 1e-6
    velocity = MAP.velocity_from_joints(q, rate)
    slope = (MAP.from_joints(q + step * rate) - MAP.from_joints(q - step * rate)) / (2 * step)
    # step^2 / 6 times third derivatives below 1e3, rounding of 1e-16 over the step.
    np.testing.assert_allclose(velocity, slope, atol=1e-8)
    np.testing.assert_allclose(MAP.velocity_to_joints(q, velocity), rate, atol=1e-10)


def test_what_turns_what():
    """Both hips forward: phi falls, gamma stays. Hip frontal outward: gamma turns as the hip."""
    q = ROBOT.stand_joint_position.copy()
    q[1::3] -= 0.2  # negative swings the foot forward
    legs = MAP.from_joints(q).reshape(4, 3)
    np.testing.assert_allclose(legs, np.tile([-0.2, 0.0, ROBOT.stand_height], (4, 1)), atol=1e-14)
    q = ROBOT.stand_joint_position.copy()
    q[0] = 0.3  # front left, outward
    gamma = MAP.from_joints(q)[1]
    assert gamma > 0.3, "the offset turns with the hip: the foot goes further than the angle"


def test_a_straight_leg_cannot_do_every_velocity():
    q = ROBOT.stand_joint_position.copy()
    q[2] = 0.0
    with pytest.raises(
        ValueError, match=r"leg 0 has no such velocity: the robot's leg is straight"
    ):
        MAP.velocity_to_joints(q, np.ones(12))
    # Measured all the same.
    assert np.isfinite(MAP.velocity_from_joints(q, np.ones(12))).all()


def test_bad_input():
    hip = hips_in_base(ROBOT)
    with pytest.raises(ValueError, match="foot 0 lies in its hip: phi and gamma are undefined"):
        MAP.from_feet(hip)
    with pytest.raises(ValueError, match="a foot is out of reach"):
        MAP.to_joints(np.tile([0.0, 0.0, 0.8], 4))
    with pytest.raises(ValueError, match=r"foot_position must have shape \(4, 3\), not \(3,\)"):
        MAP.from_feet(np.zeros(3))
    with pytest.raises(ValueError, match=r"leg_position must have shape \(12,\), not \(4,\)"):
        MAP.to_joints(np.zeros(4))
    with pytest.raises(ValueError, match=r"joint_velocity must have shape \(12,\), not \(3,\)"):
        MAP.velocity_from_joints(ROBOT.stand_joint_position, np.zeros(3))
    with pytest.raises(ValueError, match=r"leg_velocity must have shape \(12,\), not \(3,\)"):
        MAP.velocity_to_joints(ROBOT.stand_joint_position, np.zeros(3))
    sideways = hip + [[0.0, s * 0.4, 0.0] for s in ROBOT.side]
    assert MAP.from_feet(sideways)[1] == pytest.approx(np.pi / 2)
