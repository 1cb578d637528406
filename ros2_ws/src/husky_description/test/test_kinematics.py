"""Kinematics against MuJoCo's model of the robot, finite differences and their own inverse."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.kinematics import (
    FootTargets,
    JointRange,
    JointTargets,
    Kinematics,
    PlacedLegs,
    inverse_kinematics,
    leg_commands,
    solve_leg,
)
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot

ROBOT = load_robot()
KINEMATICS = Kinematics(ROBOT)
MODEL = build_spec(ROBOT).compile()


@st.composite
def joints(draw, share=1.0, straightest_knee=0.0):
    """Twelve joint positions within the range; `share` of it about the middle."""
    middle = 0.5 * (ROBOT.joint_lower + ROBOT.joint_upper)
    half = 0.5 * share * (ROBOT.joint_upper - ROBOT.joint_lower)
    unit = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(12)])
    q = middle + half * unit
    q[2::3] = np.minimum(q[2::3], -straightest_knee)
    return q


def simulated(q):
    """MuJoCo's data with the base at the origin and the joints at q."""
    data = mujoco.MjData(MODEL)
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    data.qpos[7:] = q
    mujoco.mj_kinematics(MODEL, data)
    mujoco.mj_comPos(MODEL, data)
    return data


@settings(max_examples=50)
@given(joints())
def test_feet_and_jacobians_are_those_of_mujoco(q):
    data = simulated(q)
    feet, jacobians = KINEMATICS.foot_positions_and_jacobians(q)
    translation = np.zeros((3, MODEL.nv))
    for leg, name in enumerate(ROBOT.foot_names):
        site = MODEL.site(name).id
        # Two closed forms of the same chain: only rounding is left.
        np.testing.assert_allclose(feet[leg], data.site_xpos[site], atol=1e-12)
        mujoco.mj_jacSite(MODEL, data, translation, None, site)
        own = slice(6 + 3 * leg, 9 + 3 * leg)
        np.testing.assert_allclose(jacobians[leg], translation[:, own], atol=1e-12)


@settings(max_examples=25)
@given(joints())
def test_jacobians_are_the_slopes_of_the_foot_positions(q):
    _, jacobians = KINEMATICS.foot_positions_and_jacobians(q)
    step = 1e-5
    for joint in range(12):
        ahead, behind = q.copy(), q.copy()
        ahead[joint] += step
        behind[joint] -= step
        slope = (KINEMATICS.foot_positions(ahead) - KINEMATICS.foot_positions(behind)) / (2 * step)
        leg = joint // 3
        # The error of a central difference is step^2 / 6 times a third derivative below 1 m.
        np.testing.assert_allclose(slope[leg], jacobians[leg, :, joint % 3], atol=1e-9)
        assert not np.delete(slope, leg, axis=0).any(), "a joint moves a foot of another leg"


@settings(max_examples=100)
@given(joints())
def test_center_of_mass_is_that_of_mujoco(q):
    center = KINEMATICS.center_of_mass(q)
    base = MODEL.body("base").id
    np.testing.assert_allclose(center, simulated(q).subtree_com[base], atol=1e-12)


def test_center_of_mass_of_beta_is_that_of_mujoco():
    """With what is fixed to its thighs, and a body whose centre of mass is not its origin."""
    robot = load_robot("beta")
    kinematics, model = Kinematics(robot), build_spec(robot).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    for _ in range(50):
        q = rng.uniform(robot.joint_lower, robot.joint_upper)
        data.qpos[:] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *q]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        expected = data.subtree_com[model.body("base").id]
        np.testing.assert_allclose(kinematics.center_of_mass(q), expected, atol=1e-12)


@settings(max_examples=200)
@given(joints(straightest_knee=0.01))
def test_inverse_places_the_feet_where_they_were(q):
    feet = KINEMATICS.foot_positions(q)
    found = KINEMATICS.joint_positions(feet)
    np.testing.assert_allclose(KINEMATICS.foot_positions(found), feet, atol=1e-9)
    assert (found[2::3] <= 0.0).all(), "knees bend backward"


@settings(max_examples=200)
@given(joints(straightest_knee=0.05))
def test_inverse_finds_the_joints_wherever_the_foot_is_below_its_hip(q):
    feet = KINEMATICS.foot_positions(q)
    # In the plane of the leg, below the hip sagittal axis: elsewhere two branches reach the foot.
    sagittal, knee = q[1::3], q[2::3]
    depth = ROBOT.thigh_length * np.cos(sagittal) + ROBOT.shin_length * np.cos(sagittal + knee)
    below = np.repeat(depth > 0.01, 3)
    found = KINEMATICS.joint_positions(feet)
    # Near a straight knee acos turns 1e-16 into 1e-16 / sin(knee): 1e-7 is ample for 0.05 rad.
    np.testing.assert_allclose(found[below], q[below], atol=1e-7)


def test_stand_posture_has_the_feet_under_the_hips_at_stand_height():
    feet = KINEMATICS.foot_positions(ROBOT.stand_joint_position)
    under = ROBOT.hip_position[:, :2] + np.column_stack((np.zeros(4), ROBOT.lateral_offset))
    np.testing.assert_allclose(feet[:, :2], under, atol=1e-9)
    np.testing.assert_allclose(feet[:, 2], -ROBOT.stand_height, atol=1e-9)


@pytest.mark.parametrize("leg", range(4))
@pytest.mark.parametrize("beyond", [1e-6, 0.05, 0.5])
def test_a_foot_out_of_reach_is_counted_and_placed_as_near_as_the_leg_can(leg, beyond):
    feet = KINEMATICS.foot_positions(ROBOT.stand_joint_position)
    length = ROBOT.thigh_length + ROBOT.shin_length
    feet[leg, 2] = ROBOT.hip_position[leg, 2] - length - beyond
    joints = np.empty(12)
    assert inverse_kinematics(KINEMATICS.geometry, feet, joints) == 1
    placed = KINEMATICS.foot_positions(joints)
    np.testing.assert_allclose(np.delete(placed, leg, 0), np.delete(feet, leg, 0), atol=1e-9)
    # The target is straight below the hip, and so is the straight leg; the miss is what is beyond.
    np.testing.assert_allclose(placed[leg], feet[leg] + [0.0, 0.0, beyond], atol=1e-9)
    with pytest.raises(ValueError, match="out of reach"):
        KINEMATICS.joint_positions(feet)


def test_a_foot_inside_of_the_lateral_offset_is_out_of_reach():
    feet = KINEMATICS.foot_positions(ROBOT.stand_joint_position)
    feet[0] = ROBOT.hip_position[0] + [0.3, 0.5 * ROBOT.lateral_offset[0], 0.0]
    joints = np.empty(12)
    assert inverse_kinematics(KINEMATICS.geometry, feet, joints) == 1
    assert np.isfinite(joints).all()


@settings(max_examples=50)
@given(
    joints(share=0.8, straightest_knee=0.3),
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3),
    st.integers(0, 3),
)
def test_joint_rates_move_the_foot_as_asked(q, velocity, leg):
    _, jacobians = KINEMATICS.foot_positions_and_jacobians(q)
    if np.linalg.svd(jacobians[leg])[1][-1] < 0.05:
        return  # near a singularity the answer is damped, see below
    rate = solve_leg(jacobians[leg], tuple(velocity), 0.0)
    # det(J J^T) is at least 0.05^6 of order one entries: 1e-16 / 1.6e-8 bounds the loss.
    np.testing.assert_allclose(jacobians[leg] @ rate, velocity, atol=1e-6)


def test_joint_rates_of_a_straight_leg_stay_bounded():
    _, jacobians = KINEMATICS.foot_positions_and_jacobians(np.zeros(12))
    rate = solve_leg(jacobians[0], (0.0, 0.0, -1.0), 1e-4)
    # Damped least squares never exceeds |v| / (2 sqrt(damping)).
    assert np.linalg.norm(rate) <= 1.0 / (2.0 * 1e-2) + 1e-9


def command(feet, velocity, force, lower=ROBOT.joint_lower, upper=ROBOT.joint_upper):
    """Joint targets of leg_commands: misses, feet, Jacobians, positions, rates, torques."""
    placed = PlacedLegs(np.empty((4, 3)), np.empty((4, 3, 3)))
    joints = JointTargets(*np.empty((3, 12)))
    limits = JointRange(np.array(lower), np.array(upper))
    targets = FootTargets(feet, velocity, force)
    missed = leg_commands(KINEMATICS.geometry, limits, targets, placed, joints)
    return missed, *placed, *joints


def test_commands_hold_a_foot_force_by_virtual_work():
    feet = KINEMATICS.foot_positions(ROBOT.stand_joint_position)
    force = np.array([[3.0, -2.0, 18.0], [0.0, 1.0, 20.0], [-4.0, 0.0, 15.0], [1.0, 2.0, 22.0]])
    velocity = np.tile([0.3, -0.1, 0.2], (4, 1))
    missed, placed, jacobian, _, rate, torque = command(feet, velocity, force)
    assert missed == 0
    np.testing.assert_allclose(placed, feet, atol=1e-9)
    for leg in range(4):
        own = slice(3 * leg, 3 * leg + 3)
        moved = jacobian[leg] @ rate[own]
        # Damping of 1e-4 m^2 beside the smallest squared singular value of the stand posture.
        smallest = np.linalg.svd(jacobian[leg])[1][-1]
        assert np.linalg.norm(moved - velocity[leg]) <= 0.4 * 1e-4 / smallest**2
        # The power of the joints against that of the ground: what goes in comes out.
        assert torque[own] @ rate[own] == pytest.approx(-force[leg] @ moved, abs=1e-12)


@pytest.mark.parametrize("joint", range(12))
def test_commands_stay_in_the_range_they_are_given_and_say_where_the_feet_are(joint):
    feet = KINEMATICS.foot_positions(ROBOT.stand_joint_position)
    upper, lower = np.array(ROBOT.joint_upper), np.array(ROBOT.joint_lower)
    upper[joint] = ROBOT.stand_joint_position[joint] - 0.1
    still = np.zeros((4, 3))
    missed, placed, _, position, *_ = command(feet, still, still, lower, upper)
    assert missed == 1
    assert position[joint] == upper[joint]
    np.testing.assert_allclose(KINEMATICS.foot_positions(position), placed, atol=1e-12)
    others = np.delete(np.arange(12), joint)
    np.testing.assert_allclose(position[others], ROBOT.stand_joint_position[others], atol=1e-9)


@pytest.mark.parametrize("shape", [(11,), (12, 1), (4, 3)])
def test_wrong_shapes_are_refused(shape):
    with pytest.raises(ValueError, match="shape"):
        KINEMATICS.foot_positions(np.zeros(shape))
    with pytest.raises(ValueError, match="shape"):
        KINEMATICS.joint_positions(np.zeros((3, 4)))
