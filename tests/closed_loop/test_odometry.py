"""The estimated motion against the true one: how far off it is, and how far off it says it is."""

import numpy as np
import pytest
from in_process import InProcessRobot

from husky_control.estimation.odometry_covariance import OdometryCovariance
from husky_control.modes.table import Mode
from husky_description.robot import load_robot
from husky_drivers.vn200.imu import ImuFigures
from husky_sim.world import WorldOptions

FIGURES = ImuFigures.of(load_robot().imu)
ATTITUDE = np.array(FIGURES.orientation_variance)
RATE = np.full(3, FIGURES.angular_velocity_variance)
PERIOD = 0.02
"""Between two reports [s]."""
WALKS = {
    "trot": ("trot", (0.6, 0.0, 0.0), 10.0),
    "turn": ("trot", (0.3, 0.1, 0.4), 6.0),
    "pronk": ("pronk", (0.3, 0.0, 0.0), 7.0),
}
"""Gait, velocity and time [s]."""


class Watched:
    """A robot whose odometry is reported as the node does, beside the truth."""

    def __init__(self, seed):
        self.robot = InProcessRobot(WorldOptions(seed=seed))
        self.covariance = OdometryCovariance()
        self.errors, self.deviations = [], []

    def run(self, duration, velocity=None):
        """Errors of position in odom and velocity in base, in deviations that are told."""
        for _ in range(round(duration / PERIOD)):
            self.robot.run(PERIOD, velocity)
            self._report()

    def _report(self):
        controller, world = self.robot.controller, self.robot.world
        rotation, estimator = controller.body.rotation, controller.body.estimator
        velocity = estimator.velocity
        rising = controller.mode in (Mode.STAND_UP, Mode.SIT)
        if controller.present.velocity_counts:
            self.covariance.walk(velocity, ATTITUDE[2], PERIOD, rising=rising)
        self.covariance.update(
            rotation,
            estimator.horizontal,
            estimator.vertical,
            ATTITUDE,
            RATE,
            place_counts=controller.present.place_counts,
            velocity_counts=controller.present.velocity_counts,
        )
        place = estimator.position - world.base_position
        speed = velocity @ rotation - world.base_velocity_in_base()
        self.errors.append(np.concatenate((place, speed)))
        variances = np.concatenate(
            (np.diag(self.covariance.pose)[:3], np.diag(self.covariance.twist)[:3])
        )
        self.deviations.append(np.sqrt(variances))

    @property
    def normalised(self):
        """Errors over deviations (n, 6)."""
        return np.array(self.errors) / np.array(self.deviations)


def walked(seed, gait, velocity, duration):
    watched = Watched(seed)
    robot, controller = watched.robot, watched.robot.controller
    robot.enable()
    assert controller.request_mode("stand_up")[0]
    watched.run(5.0)
    assert controller.request_gait(gait)[0] and controller.request_mode("walk")[0]
    watched.run(duration, velocity)
    return watched


@pytest.fixture(scope="module")
def walks():
    return {name: walked(seed, *walk) for seed, (name, walk) in enumerate(WALKS.items())}


def test_the_estimate_is_no_further_off_than_it_says(walks):
    """On each axis within three deviations nearly always, and not by far too far: no more than
    twenty times better than told, where a filter may be cautious."""
    for name, watched in walks.items():
        n = watched.normalised
        assert np.all(np.mean(np.abs(n) < 3.0, axis=0) > 0.97), (name, np.abs(n).max(axis=0))
    together = np.sqrt(np.mean([np.mean(w.normalised**2, axis=0) for w in walks.values()], axis=0))
    assert np.all((0.05 < together) & (together < 1.5)), together


def test_what_was_walked_is_known_less_and_less(walks):
    deviations = np.array(walks["trot"].deviations)[:, :2].max(axis=1)
    assert deviations[-1] > 1.3 * deviations[300], (deviations[300], deviations[-1])


def test_odometry_has_no_jumps_when_the_drives_are_lost(walks):
    """REP-105: a robot that lies down, and stands up again, goes on from where it was."""
    watched = walks["trot"]
    controller, before = watched.robot.controller, watched.robot.controller.body.estimator.position
    start = before.copy()
    assert start[0] > 5.0
    controller.lose_drives("taken away")
    steps = []
    for _ in range(50):
        last = controller.body.estimator.position.copy()
        watched.robot.tick()
        steps.append(np.linalg.norm((controller.body.estimator.position - last)[:2]))
    assert max(steps) < 0.005, max(steps)
    assert np.linalg.norm(controller.body.estimator.position[:2] - start[:2]) < 0.1
