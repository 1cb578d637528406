"""A hanging robot's legs: posture, treading, and the modes that lead there."""

import numpy as np
import pytest

from husky_control.controller import Controller
from husky_control.gait.suspended import Suspended
from husky_control.gait.table import GAITS
from husky_control.modes.table import Mode
from husky_control.tick_data import Measurements
from husky_description.kinematics import LEGS, Kinematics
from husky_description.robot import load_robot

DT = 0.002
ROBOT = load_robot()
TROT = GAITS["trot"]


@pytest.fixture
def legs():
    legs = Suspended(ROBOT, TROT)
    legs.begin(ROBOT.sit_joint_position, ROBOT.stand_joint_position, 1.0)
    return legs


def tick(legs, seconds):
    """Return feet in base (n, 4, 3) and joint velocities (n, 12) of the targets."""
    kinematics = Kinematics(ROBOT)
    feet, rates = [], []
    for _ in range(round(seconds / DT)):
        legs.tick(DT)
        feet.append(kinematics.foot_positions(legs.joint_position))
        rates.append(legs.joint_velocity.copy())
    return np.array(feet), np.array(rates)


def test_it_takes_the_posture_and_holds_it(legs):
    assert not legs.ready
    tick(legs, 1.1)
    assert legs.ready and legs.at_rest
    np.testing.assert_allclose(legs.joint_position, ROBOT.stand_joint_position, atol=1e-9)
    assert not legs.joint_velocity.any()


def test_diagonal_feet_go_up_and_down_under_their_hips(legs):
    tick(legs, 1.1)
    legs.tread(TROT)
    feet, _ = tick(legs, 4 * TROT.period)
    rise = feet[..., 2] - feet[0, :, 2]
    np.testing.assert_allclose(rise.max(axis=0), TROT.swing_height, rtol=0.01)
    assert rise.min() > -1e-6
    assert np.ptp(feet[..., :2], axis=0).max() < 1e-6
    np.testing.assert_allclose(rise[:, 0], rise[:, 3], atol=1e-9)
    np.testing.assert_allclose(rise[:, 1], rise[:, 2], atol=1e-9)
    assert np.minimum(rise[:, 0], rise[:, 1]).max() < 1e-6  # one diagonal at a time


def test_rates_are_those_of_the_positions(legs):
    tick(legs, 1.1)
    legs.tread(TROT)
    joints, rates = [], []
    for _ in range(round(TROT.period / DT)):
        legs.tick(DT)
        joints.append(legs.joint_position.copy())
        rates.append(legs.joint_velocity.copy())
    differences = np.diff(joints, axis=0) / DT
    middle = (np.array(rates[1:]) + np.array(rates[:-1])) / 2
    assert np.abs(differences).max() > 1.0
    # the clock holds for a tick at each touchdown
    assert np.quantile(np.abs(differences - middle), 0.95) < 0.02 * np.abs(differences).max()


def test_stopped_feet_come_down_and_stay(legs):
    tick(legs, 1.1)
    legs.tread(TROT)
    tick(legs, 0.3 * TROT.period)
    legs.stop()
    assert not legs.at_rest
    feet, _ = tick(legs, TROT.period)
    assert legs.at_rest
    assert np.ptp(feet[-20:], axis=0).max() == 0.0


@pytest.mark.parametrize("velocity", [(0.4, 0.0, 0.0), (0.1, -0.2, 0.0), (0.0, 0.0, 0.5)])
def test_feet_that_stand_go_with_the_ground(legs, velocity):
    """Seen from a body that moves as commanded they stand still, and pass under their places."""
    tick(legs, 1.1)
    places, _ = tick(legs, DT)
    legs.tread(TROT)
    legs.velocity[:] = velocity
    ahead, left, turning = velocity
    ground, stands = [], []
    tick(legs, 2 * TROT.period)
    for _ in range(round(TROT.period / DT)):
        feet, _ = tick(legs, DT)
        ground.append(feet[0])
        stands.append(~legs.clock.swinging)
    ground, stands = np.array(ground), np.array(stands)
    x, y = places[0, :, 0], places[0, :, 1]
    drift = np.stack((turning * y - ahead, -turning * x - left), axis=1)
    slip = np.abs(np.diff(ground[..., :2], axis=0) / DT - drift)[stands[1:] & stands[:-1]]
    assert slip.max() < 0.01
    for leg in range(LEGS):
        middle = ground[stands[:, leg], leg, :2].mean(axis=0)
        np.testing.assert_allclose(middle, places[0, leg, :2], atol=0.004)


def hanging(tilt=0.0):
    """Return a controller in the mode hang, its posture reached, and what it measures."""
    controller = Controller(ROBOT, warm_up=False)
    m = Measurements(drives_operational=True)
    m.joint_position[:] = ROBOT.sit_joint_position
    controller.tick(m)
    assert controller.request_mode("hang") == (True, "hang")
    assert controller.request_mode("tread") == (
        False,
        "tread refused: the legs are still on their way to the posture",
    )
    follow(controller, m, 4.0)
    return controller, m


def follow(controller, m, seconds):
    """Let the joints be where they are wanted."""
    for _ in range(round(seconds / DT)):
        m.joint_position[:] = controller.tick(m).position


def test_treading_by_request_and_back():
    controller, m = hanging()
    assert controller.request_mode("tread")[0]
    follow(controller, m, 2.2 * TROT.period)
    assert controller.mode is Mode.TREAD
    assert 0 < controller.present.clock.swinging.sum() < LEGS
    assert controller.request_mode("hang") == (True, "stopping")
    follow(controller, m, TROT.period)
    assert controller.mode is Mode.HANG
    assert controller.request_mode("walk")[0] is False
    assert controller.request_mode("passive")[0]


def test_no_ground_is_believed():
    """The estimate stays: nothing says where a hanging body goes."""
    controller, m = hanging()
    controller.request_mode("tread")
    start = controller.body.estimator.position.copy()
    m.specific_force_base[:] = 0.3, 0.2, 9.0
    follow(controller, m, 2.0)
    np.testing.assert_allclose(controller.body.estimator.position, start, atol=0.1)
    assert np.abs(controller.body.estimator.velocity).max() == 0.0


def test_drives_that_fail_in_the_air_end_in_damping():
    controller, m = hanging()
    controller.request_mode("tread")
    follow(controller, m, 0.5)
    m.drives_operational = False
    follow(controller, m, 0.01)
    assert controller.mode is Mode.DAMPING
