"""Rotors about the centre of mass by the joints: against MuJoCo, and the posture of flight."""

import mujoco
import numpy as np
import pytest

from husky_description.actuation import AbsentSection
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry

ROBOT = load_robot("beta")


def test_against_mujoco_in_random_postures():
    model = build_spec(ROBOT).compile()
    data = mujoco.MjData(model)
    random = np.random.default_rng(3)
    for _ in range(50):
        joints = random.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        data.qpos[:] = [0.3, -0.2, 0.9, 1.0, 0.0, 0.0, 0.0, *joints]
        mujoco.mj_forward(model, data)
        geometry = rotor_geometry(ROBOT, joints)
        sites = [data.site(f"{leg}_propeller") for leg in ROBOT.legs]
        center = data.subtree_com[model.body("base").id]
        places = np.array([site.xpos for site in sites]) - center
        axes = np.array([site.xmat.reshape(3, 3)[:, 2] for site in sites])
        np.testing.assert_allclose(geometry.position, places, atol=1e-12)
        np.testing.assert_allclose(geometry.axis, axes, atol=1e-12)


def test_in_flight_the_lift_is_at_the_centre_of_mass_and_points_up():
    posture = flight_posture(ROBOT)
    geometry = rotor_geometry(ROBOT, posture)
    np.testing.assert_allclose(geometry.axis, np.tile([0.0, 0.0, 1.0], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(geometry.position.mean(axis=0)[:2], 0.0, atol=1e-9)
    assert np.all(posture > ROBOT.joint_lower) and np.all(posture < ROBOT.joint_upper)


def test_effectiveness_is_the_wrench_of_each_rotor():
    """Closed form of a level quadrotor: thrust, its levers, and drag against the spin."""
    geometry = rotor_geometry(ROBOT, flight_posture(ROBOT))
    matrix = geometry.effectiveness(0.012)
    x, y, _ = geometry.position.T
    np.testing.assert_allclose(matrix[2], 1.0)
    np.testing.assert_allclose(matrix[3:], [y, -x, -0.012 * geometry.spin], atol=1e-12)
    np.testing.assert_allclose(matrix[:2], 0.0, atol=1e-12)


def test_a_robot_without_propellers_is_refused():
    with pytest.raises(AbsentSection, match="propellers"):
        rotor_geometry(load_robot(), np.zeros(12))
