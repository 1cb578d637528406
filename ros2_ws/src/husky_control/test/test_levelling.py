"""Legs of different length under a level body, against the kinematics of the legs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_control.modes.levelling import MOST, Levelling, turn_to_level
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot("beta")
KINEMATICS = Kinematics(ROBOT)
STAND = np.array(ROBOT.stand_joint_position)
ALL, THREE = np.ones(4), np.array((1.0, 1.0, 1.0, 0.0))


def turned(turn, standing=ALL, times=1):
    """Return a levelling that has turned the standing robot, step by step."""
    levelling = Levelling()
    for _ in range(times):
        joints = STAND + levelling.joints
        levelling.turn(
            np.asarray(turn) / times, *KINEMATICS.foot_positions_and_jacobians(joints), standing
        )
    return levelling


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("standing", [ALL, THREE])
def test_the_feet_are_level_in_world_when_the_body_has_turned(axis, standing):
    """A tilted body's feet stand on level ground; turned back, they lie in a tilted plane of it."""
    tilt = Rotation.from_euler(axis, 0.08)
    turn = turn_to_level(tilt.as_matrix())
    np.testing.assert_allclose(turn, tilt.inv().as_rotvec(), atol=1e-4)
    feet = KINEMATICS.foot_positions(STAND + turned(turn, standing, 10).joints)
    before = KINEMATICS.foot_positions(STAND)
    stand = standing > 0.0
    # Seen from the ground the feet keep their places; the body has turned by `turn` about them.
    seen = Rotation.from_rotvec(turn).apply(feet)[stand]
    seen += before[stand].mean(axis=0) - seen.mean(axis=0)
    np.testing.assert_allclose(seen, before[stand], atol=2.5e-3)
    assert np.ptp(feet[stand, 2]) > 0.01
    np.testing.assert_array_equal(feet[~stand], before[~stand])


def test_nothing_turns_about_an_axis_that_is_left_out():
    axis = np.array((0.6, 0.8, 0.0))
    across = np.array((-0.8, 0.6, 0.0))
    tilt = Rotation.from_rotvec(0.05 * axis) * Rotation.from_rotvec(0.03 * across)
    turn = turn_to_level(tilt.as_matrix(), axis)
    assert turn @ axis == pytest.approx(0.0, abs=2e-3)
    assert turn @ across == pytest.approx(-0.03, abs=1e-3)


def test_it_goes_only_so_far_and_comes_back():
    levelling = turned((0.0, 5.0, 0.0))
    assert np.abs(levelling.joints).max() == MOST
    levelling = turned((0.0, 0.05, 0.0))
    for _ in range(10):
        feet, jacobian = KINEMATICS.foot_positions_and_jacobians(STAND)
        levelling.turn(np.array((0.0, -0.005, 0.0)), feet, jacobian, ALL)
    np.testing.assert_allclose(levelling.joints, 0.0, atol=1e-12)
    levelling = turned((0.1, 0.0, 0.0))
    levelling.reset()
    np.testing.assert_array_equal(levelling.joints, 0.0)


def test_a_leg_in_the_air_keeps_what_it_was_given():
    levelling = turned((0.0, 0.05, 0.0))
    before = levelling.joints.copy()
    levelling.turn(
        np.array((0.05, 0.0, 0.0)), *KINEMATICS.foot_positions_and_jacobians(STAND), THREE
    )
    changed = np.abs(levelling.joints - before).reshape(4, 3).max(axis=1)
    assert changed[3] == 0.0 and changed[:3].min() > 1e-3


def test_a_straight_leg_stays_where_it_is():
    """Its length cannot change at first order; the others do what they can."""
    joints = STAND.copy()
    joints[1:3] = 0.0
    levelling = Levelling()
    levelling.turn(np.array((0.0, 0.1, 0.0)), *KINEMATICS.foot_positions_and_jacobians(joints), ALL)
    assert np.isfinite(levelling.joints).all() and np.abs(levelling.joints).max() < MOST
