"""The leg odometry: standing, moving at known velocities, slipping feet, feet in the air."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_control.estimation.estimator import Estimator, EstimatorNoise, LegOdometry
from husky_control.parameters import Parameters
from husky_description.gravity import GRAVITY
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot()
KINEMATICS = Kinematics(ROBOT)
DT = 0.002
P = Parameters()
NOISE = EstimatorNoise(*(P[f"estimator.{name}"] for name in EstimatorNoise._fields))
STAND = np.array(ROBOT.stand_joint_position)
FIRM = np.ones(4)


class Body:
    """A rigid body over feet that do not move, without errors, and its estimator.

    The estimator takes a foot to roll on its sphere; `foot_radius` 0 takes that away, so that
    the feet's centres rest.
    """

    def __init__(self, rotation=None, foot_radius=0.0):
        self.rotation = np.eye(3) if rotation is None else rotation
        self.estimator = Estimator(ROBOT)
        self.estimator.foot_radius = foot_radius
        self.feet = KINEMATICS.foot_positions(STAND)
        self.estimator.reset(self.feet, self.rotation)
        self.start = self.estimator.position.copy()
        self.anchors = self.start + self.feet @ self.rotation.T
        self.displacement = np.zeros(3)

    def step(
        self,
        velocity,
        acceleration=(0.0, 0.0, 0.0),
        trust=FIRM,
        slip=None,
        noise=NOISE,
        angular=(0.0, 0.0, 0.0),
    ):
        """Move the body by a tick.

        slip: velocities of slipping feet (4, 3) m/s in world; angular: rad/s in base.
        """
        velocity = np.asarray(velocity, float)
        slip = np.zeros((4, 3)) if slip is None else slip
        angular = np.asarray(angular, float)
        self.rotation = self.rotation @ Rotation.from_rotvec(angular * DT).as_matrix()
        self.displacement = self.displacement + velocity * DT
        self.anchors = self.anchors + slip * DT
        feet = (self.anchors - self.start - self.displacement) @ self.rotation
        joints = KINEMATICS.joint_positions(feet)
        feet, jacobian = KINEMATICS.foot_positions_and_jacobians(joints)
        relative = (slip - velocity) @ self.rotation - np.cross(angular, feet)
        rate = np.concatenate([np.linalg.solve(jacobian[k], relative[k]) for k in range(4)])
        specific = self.rotation.T @ (np.asarray(acceleration) + [0.0, 0.0, GRAVITY])
        measured = LegOdometry(
            self.rotation, angular, specific, feet, jacobian, joints, rate, np.asarray(trust, float)
        )
        self.estimator.update(measured, noise, DT)

    def rolling(self, velocity, slip):
        """Velocities (4, 3) m/s of the centres of rolling balls when the shins move like this."""
        feet = (self.anchors - self.start - self.displacement) @ self.rotation
        joints = KINEMATICS.joint_positions(feet)
        _, jacobian = KINEMATICS.foot_positions_and_jacobians(joints)
        relative = (slip - np.asarray(velocity)) @ self.rotation
        rolling = np.zeros((4, 3))
        for leg in range(4):
            rate = np.linalg.solve(jacobian[leg], relative[leg])
            about_frontal = Rotation.from_euler("x", joints[3 * leg]).as_matrix()
            spin = np.array([rate[0], 0.0, 0.0]) + about_frontal @ [0.0, rate[1] + rate[2], 0.0]
            up = ROBOT.foot_radius * np.array([0.0, 0.0, 1.0])
            rolling[leg] = np.cross(self.rotation @ spin, up)
        return rolling

    @property
    def error(self):
        return self.estimator.position - self.start - self.displacement


def test_reset_puts_the_lowest_foot_on_the_ground():
    estimator = Estimator(ROBOT)
    rotation = Rotation.from_euler("xyz", [0.1, -0.2, 0.7]).as_matrix()
    estimator.reset(KINEMATICS.foot_positions(STAND), rotation)
    assert estimator.foot_in_world[:, 2].min() == pytest.approx(ROBOT.foot_radius, abs=1e-12)
    assert not estimator.position[:2].any() and not estimator.velocity.any()


def test_on_ground_of_another_height_feet_are_found_there():
    """Set down a hand's breadth too low, it comes up to the ground that it was told of."""
    body = Body()
    body.estimator.ground_height = height = 0.5
    body.estimator.reset(KINEMATICS.foot_positions(STAND), np.eye(3))
    standing = body.estimator.position[2]
    assert body.estimator.foot_in_world[:, 2].min() == pytest.approx(height)
    body.estimator.position[2] -= 0.1
    body.estimator.foot_in_world[:, 2] -= 0.1
    for _ in range(20):
        body.step((0.0, 0.0, 0.0), trust=np.zeros(4))
        body.step((0.0, 0.0, 0.0))  # each time the feet touch down anew
    assert body.estimator.position[2] == pytest.approx(standing, abs=0.01)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.05, -0.08, 1.2)])
def test_a_standing_robot_stays_where_it_is(angles):
    body = Body(Rotation.from_euler("xyz", angles).as_matrix())
    for _ in range(1000):
        body.step((0.0, 0.0, 0.0))
    np.testing.assert_allclose(body.estimator.velocity, 0.0, atol=1e-6)
    np.testing.assert_allclose(body.error[:2], 0.0, atol=1e-6)


def test_a_wrong_velocity_dies_out_over_standing_feet():
    body = Body()
    body.estimator.velocity[:] = 0.3, -0.2, 0.1
    for _ in range(250):
        body.step((0.0, 0.0, 0.0))
    np.testing.assert_allclose(body.estimator.velocity, 0.0, atol=2e-3)


@pytest.mark.parametrize("velocity", [(0.3, 0.0, 0.0), (0.0, -0.15, 0.0), (0.2, 0.1, 0.05)])
def test_velocity_over_fixed_feet_is_found_and_position_follows(velocity):
    body = Body()
    for _ in range(20):
        body.step((0.0, 0.0, 0.0))
    # An abrupt start: the accelerometer of this test does not see it, the legs do.
    for _ in range(250):
        body.step(velocity)
    np.testing.assert_allclose(body.estimator.velocity, velocity, atol=5e-3)
    # What is missed while the filter learns: 0.3 m/s for a few of its time constants.
    assert np.abs(body.error[:2]).max() < 5e-3


def test_what_the_accelerometer_sees_needs_no_learning():
    body = Body()
    for _ in range(20):
        body.step((0.0, 0.0, 0.0))
    velocity, acceleration = np.zeros(3), np.array([0.8, 0.0, 0.0])
    worst = 0.0
    for _ in range(250):
        velocity = velocity + acceleration * DT
        body.step(velocity, acceleration)
        worst = max(worst, float(np.abs(body.estimator.velocity - velocity).max()))
    assert worst < 1e-3


def test_velocity_goes_on_by_the_accelerometer_with_all_feet_in_the_air():
    body = Body()
    for _ in range(50):
        body.step((0.0, 0.0, 0.0))
    body.estimator.velocity[:] = 0.2, 0.0, 0.5
    z0 = body.estimator.position[2]
    for _ in range(50):
        body.step((0.0, 0.0, 0.0), acceleration=(0.0, 0.0, -GRAVITY), trust=np.zeros(4))
    t = 50 * DT
    np.testing.assert_allclose(body.estimator.velocity, [0.2, 0.0, 0.5 - GRAVITY * t], atol=1e-9)
    expected = z0 + 0.5 * t - 0.5 * GRAVITY * t * t
    assert body.estimator.position[2] == pytest.approx(expected, abs=1e-9)


def test_a_foot_in_the_air_does_not_disturb():
    body = Body()
    swing = np.zeros((4, 3))
    swing[0] = 0.5, 0.1, 0.1
    for _ in range(100):
        body.step((0.0, 0.0, 0.0), trust=(0.0, 1.0, 1.0, 1.0), slip=swing)
    np.testing.assert_allclose(body.estimator.velocity, 0.0, atol=1e-9)
    # A foot in the air is carried along where kinematics has it.
    np.testing.assert_allclose(body.estimator.foot_in_world[0], body.anchors[0], atol=1e-6)


def slip_error(gate):
    """Velocity error [m/s] that one slipping foot of four has caused after 0.1 s."""
    body = Body()
    for _ in range(100):
        body.step((0.0, 0.0, 0.0))
    slip = np.zeros((4, 3))
    slip[0, 0] = 1.0
    noise = NOISE._replace(innovation_gate=gate)
    worst = 0.0
    for _ in range(50):
        body.step((0.0, 0.0, 0.0), slip=slip, noise=noise)
        worst = max(worst, abs(float(body.estimator.velocity[0])))
    return worst


def test_a_slipping_foot_is_gated():
    gated, open_gate = slip_error(NOISE.innovation_gate), slip_error(100.0)
    # One foot of four at 1 m/s drags an ungated mean by about a quarter of that.
    assert open_gate > 0.1
    assert gated < 0.5 * open_gate


def rolling_error(velocity, yaw, foot_radius):
    """Velocity error [m/s] of a filter that takes feet for balls of a radius, when they roll."""
    body = Body(Rotation.from_euler("z", yaw).as_matrix(), foot_radius)
    slip = np.zeros((4, 3))
    for _ in range(250):
        for _ in range(3):  # shins and rolling depend on each other by radius / height
            slip = body.rolling(velocity, slip)
        body.step(velocity, slip=slip)
    return float(np.linalg.norm(body.estimator.velocity - velocity))


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("velocity", [(0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.15, -0.15, 0.0)])
def test_feet_that_roll_on_their_spheres_are_told_from_points(velocity, yaw):
    told = rolling_error(np.array(velocity), yaw, ROBOT.foot_radius)
    assert told < 0.2 * rolling_error(np.array(velocity), yaw, 0.0)


@pytest.mark.parametrize("angular", [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.5)])
def test_a_body_that_only_turns_does_not_move(angular):
    body = Body(Rotation.from_euler("z", 0.7).as_matrix())
    for _ in range(200):
        body.step((0.0, 0.0, 0.0), angular=angular)
    np.testing.assert_allclose(body.estimator.velocity, 0.0, atol=1e-4)
    np.testing.assert_allclose(body.error, 0.0, atol=1e-4)


def test_height_is_held_by_the_ground_at_touchdowns():
    body = Body()
    body.estimator.position[2] += 0.05
    for cycle in range(40):
        for tick in range(50):
            lifted = cycle % 4 if tick < 20 else -1
            body.step((0.0, 0.0, 0.0), trust=[0.0 if k == lifted else 1.0 for k in range(4)])
    # The feet are points here, and stand at the height 0; each of forty touchdowns, believed to
    # 20 mm, takes away a share of what is left of the 50 mm: nine tenths of it in all.
    np.testing.assert_allclose(body.estimator.foot_in_world[:, 2], 0.0, atol=5e-3)


def test_covariances_stay_symmetric_and_positive():
    body = Body()
    random = np.random.default_rng(0)
    trust = np.ones(4)
    for tick in range(2000):
        if tick % 25 == 0:
            trust = random.choice([0.0, 0.3, 1.0], 4)
        body.step((0.0, 0.0, 0.0), trust=trust)
    for covariance in (body.estimator.horizontal, body.estimator.vertical):
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12)
        assert np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min() > -1e-12


def test_equal_measurements_give_equal_estimates_to_the_bit():
    bodies = Body(), Body()
    for body in bodies:
        random = np.random.default_rng(3)
        for _ in range(200):
            body.step(random.normal(0.0, 0.1, 3), trust=random.uniform(0.0, 1.0, 4))
    first, second = (body.estimator for body in bodies)
    assert first.position.tobytes() == second.position.tobytes()
    assert first.velocity.tobytes() == second.velocity.tobytes()
    assert first.horizontal.tobytes() == second.horizontal.tobytes()
