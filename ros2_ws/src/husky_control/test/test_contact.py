"""The contact observer: foot forces from torques that are known, and the phase in its decision."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.estimation.contact import (
    OBSERVER_GAIN,
    ContactObserver,
    ContactThresholds,
    LegLoads,
    joint_inertias,
)
from husky_description.kinematics import Kinematics
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot

ROBOT = load_robot()
_, JACOBIAN = Kinematics(ROBOT).foot_positions_and_jacobians(ROBOT.stand_joint_position)
THRESHOLDS = ContactThresholds(touchdown=10.0, early=25.0, standing=10.0, liftoff=5.0)
DT = 0.002
STANCE = np.full(4, -1.0)


def motor_torque(force_in_base):
    """Torque of the motors that holds the legs still against forces (4, 3) on the feet: -J^T f."""
    return np.concatenate([-JACOBIAN[leg].T @ force_in_base[leg] for leg in range(4)])


def settle(observer, force_in_base, rotation=None, progress=STANCE, ticks=50):
    """Let legs at rest feel forces for some ticks: 20 time constants of the observer."""
    matrix = np.eye(3) if rotation is None else rotation
    torque = motor_torque(force_in_base)
    for _ in range(ticks):
        observer.update(LegLoads(np.zeros(12), torque, JACOBIAN, matrix, progress), THRESHOLDS, DT)


def vertical(*newtons):
    force = np.zeros((4, 3))
    force[:, 2] = newtons
    return force


@settings(max_examples=30)
@given(st.lists(st.floats(-50.0, 50.0), min_size=12, max_size=12), st.integers(0, 100))
def test_standing_legs_tell_the_forces_on_their_feet(values, seed):
    force = np.array(values).reshape(4, 3)
    rotation = Rotation.random(random_state=seed).as_matrix()
    observer = ContactObserver(ROBOT)
    settle(observer, force, rotation)
    # 50 ticks of a factor 1 - 200 x 0.002 leave 8e-12 of the first error.
    np.testing.assert_allclose(observer.foot_force, force @ rotation.T, atol=1e-8)
    np.testing.assert_allclose(observer.external_torque, -motor_torque(force), atol=1e-8)


def test_the_observer_is_of_first_order_with_its_gain():
    observer = ContactObserver(ROBOT)
    force = vertical(20.0, 0.0, 0.0, 0.0)
    seen = []
    for _ in range(10):
        settle(observer, force, ticks=1)
        seen.append(observer.foot_force[0, 2])
    # Explicit Euler of r' = gain (f - r).
    expected = 20.0 * (1.0 - (1.0 - observer.gain * DT) ** np.arange(1, 11))
    np.testing.assert_allclose(seen, expected, atol=1e-9)


def test_torque_that_accelerates_a_joint_is_no_contact():
    observer, inertia = ContactObserver(ROBOT), joint_inertias(ROBOT)
    torque = np.tile([0.5, -0.8, 0.3], 4)
    velocity = np.zeros(12)
    for _ in range(100):
        velocity = velocity + torque / inertia * DT
        observer.update(LegLoads(velocity, torque, JACOBIAN, np.eye(3), STANCE), THRESHOLDS, DT)
        np.testing.assert_allclose(observer.external_torque, 0.0, atol=1e-9)
    assert not observer.contact.any()


def test_reset_of_a_moving_leg_begins_without_a_torque():
    observer = ContactObserver(ROBOT)
    settle(observer, vertical(20.0, 20.0, 20.0, 20.0))
    velocity = np.linspace(-3.0, 3.0, 12)
    observer.reset(velocity)
    assert not observer.contact.any() and not observer.foot_force.any()
    observer.update(LegLoads(velocity, np.zeros(12), JACOBIAN, np.eye(3), STANCE), THRESHOLDS, DT)
    np.testing.assert_allclose(observer.external_torque, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("progress", "threshold"),
    [(-1.0, 10.0), (0.0, 25.0), (0.25, 25.0), (0.49, 25.0), (0.5, 10.0), (1.0, 10.0)],
)
def test_contact_begins_at_the_threshold_of_the_phase(progress, threshold):
    phase = np.full(4, progress)
    observer = ContactObserver(ROBOT)
    settle(observer, vertical(threshold - 0.01, threshold + 0.01, 0.0, -50.0), progress=phase)
    assert observer.contact.tolist() == [False, True, False, False]


@pytest.mark.parametrize("progress", [-1.0, 0.2, 0.8])
def test_contact_ends_below_the_liftoff_force_only(progress):
    phase = np.full(4, progress)
    observer = ContactObserver(ROBOT)
    settle(observer, vertical(30.0, 30.0, 30.0, 30.0), progress=phase)
    assert observer.contact.all()
    settle(observer, vertical(5.01, 4.99, 30.0, -1.0), progress=phase)
    assert observer.contact.tolist() == [True, False, True, False]


def test_force_is_judged_along_the_world_s_vertical():
    observer = ContactObserver(ROBOT)
    # Lying on its left side: what pushes along base y is what carries.
    on_side = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    force = np.zeros((4, 3))
    force[:, 1] = 20.0
    settle(observer, force, on_side)
    np.testing.assert_allclose(observer.foot_force, vertical(*[20.0] * 4), atol=1e-8)
    assert observer.contact.all()


def test_a_singular_leg_gives_a_finite_force():
    observer = ContactObserver(ROBOT)
    straight = np.zeros((4, 3, 3))
    torque = np.full(12, 1.0)
    for _ in range(50):
        observer.update(LegLoads(np.zeros(12), torque, straight, np.eye(3), STANCE), THRESHOLDS, DT)
    assert np.isfinite(observer.foot_force).all()


def test_joint_inertia_is_the_rotor_and_a_smaller_leg():
    inertia = joint_inertias(ROBOT)
    link = inertia - ROBOT.armature
    assert (link > 0.0).all() and (link < ROBOT.armature).all()
    # The shin about the knee: a thin rod about its end.
    np.testing.assert_allclose(link[2::3], ROBOT.shin_mass * ROBOT.shin_length**2 / 3)


def test_the_observer_is_as_slow_as_the_joints_are_read():
    """Torques that are held for two ticks halve it; those of every tick, and faster, do not."""
    assert ContactObserver(ROBOT).gain == OBSERVER_GAIN
    for cycle, gain in ((0.002, OBSERVER_GAIN), (0.004, OBSERVER_GAIN / 2), (0.02, 20.0)):
        beta = load_robot("beta", bus_servo__cycle=cycle)
        assert ContactObserver(beta).gain == pytest.approx(gain)


def test_joint_inertia_of_beta_has_what_hangs_at_its_knees():
    """Against the mass matrix of the standing robot, which has the links' own inertia as well."""
    robot = load_robot("beta")
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    np.testing.assert_allclose(joint_inertias(robot), np.diag(mass)[6:], rtol=0.33)
