"""What is measured and estimated of the body: kept, scaled, carried."""

import math

import numpy as np
import pytest

from husky_control.estimation.sensed_body import SensedBody
from husky_control.parameters import Parameters
from husky_control.tick_data import Measurements
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot()
STAND = np.array(ROBOT.stand_joint_position)
FEET, JACOBIANS = Kinematics(ROBOT).foot_positions_and_jacobians(STAND)


def standing():
    parameters = Parameters()
    body = SensedBody(ROBOT, parameters)
    assert body.accept(Measurements(joint_position=STAND))
    return body, parameters


def test_what_is_not_finite_is_not_taken():
    body, _ = standing()
    bad = Measurements(joint_position=STAND + 0.1)
    bad.specific_force_base[1] = math.inf
    assert not body.accept(bad)
    np.testing.assert_array_equal(body.measurements.joint_position, STAND)
    np.testing.assert_allclose(body.foot_in_base, FEET)


def test_standing_feet_carry_the_weight():
    """The torques are those of feet that the ground presses upward, by virtual work."""
    body, _ = standing()
    torque = np.zeros(12)
    body.carry(60.0, torque)
    forces = [-np.linalg.solve(JACOBIANS[leg].T, torque[3 * leg :][:3]) for leg in range(4)]
    np.testing.assert_allclose(np.sum(forces, axis=0), (0.0, 0.0, 60.0), atol=1e-6)


@pytest.mark.parametrize("change", [False, True])
def test_thresholds_shrink_with_the_load_and_stay_so_when_a_parameter_changes(change):
    body, parameters = standing()
    liftoff = parameters["contact.liftoff_force"]
    body.set_lightness(0.5)

    def press(newtons):
        m = Measurements(joint_position=STAND)
        for leg in range(4):
            m.joint_torque[3 * leg : 3 * leg + 3] = -JACOBIANS[leg].T @ (0.0, 0.0, newtons)
        for _ in range(200):
            body.refresh_parameters()
            body.accept(m)
            body.turn_ground(np.eye(3))
            body.feel_contacts(np.full(4, -1.0))
        return body.contacts.contact

    assert press(20.0).all()
    if change:
        parameters.set("walk.weight_share", 0.9)
    assert press(0.8 * liftoff).all()
    assert not press(0.4 * liftoff).any()
    body.set_lightness(1.0)
    press(20.0)
    assert not press(0.8 * liftoff).any()


def test_a_place_that_is_known_otherwise_takes_the_feet_along():
    body, _ = standing()
    body.place((1.0, 2.0, 0.9), (0.1, 0.0, -0.2))
    np.testing.assert_allclose(body.estimator.foot_in_world, FEET + (1.0, 2.0, 0.9))
    np.testing.assert_array_equal(body.estimator.velocity, (0.1, 0.0, -0.2))
    body.estimate_at_rest()
    np.testing.assert_array_equal(body.estimator.position[:2], (1.0, 2.0))
    assert not body.estimator.velocity.any()
