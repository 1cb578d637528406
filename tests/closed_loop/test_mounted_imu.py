"""An IMU that is turned and sits elsewhere: the robot stands and walks as with the plain one."""

import dataclasses

import numpy as np
import pytest
from in_process import InProcessRobot
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot

PLAIN = load_robot()


def mounted(rpy, position):
    """A robot whose IMU is mounted like this."""
    place = {"rpy": np.array(rpy), "position": np.array(position)}
    return dataclasses.replace(PLAIN, imu=dataclasses.replace(PLAIN.imu, **place))


@pytest.mark.parametrize(
    ("rpy", "position"),
    [
        pytest.param((0.3, -0.4, 2.0), (0.0, 0.0, 0.03), marks=pytest.mark.slow),
        ((np.pi, 0.0, -np.pi / 2), (-0.2, 0.1, 0.08)),  # upside down, at a corner of the torso
    ],
)
def test_it_stands_and_walks(rpy, position):
    robot = InProcessRobot(robot=mounted(rpy, position))
    robot.stand()
    assert robot.controller.request_mode("walk")[0]
    robot.run(4.0, (0.3, 0.0, 0.2))
    controller, world = robot.controller, robot.world
    assert controller.mode.value == "walk", controller.reason
    truth = Rotation.from_quat(world.base_orientation)
    error = truth.inv() * Rotation.from_matrix(controller.body.rotation)
    assert error.magnitude() < 0.05  # its noise is 0.3 deg, the last sample up to 2 ms old
    x, y, _ = world.base_position
    assert np.hypot(x, y) > 0.6  # of the 1.2 m of the way, much of it a curve
    # As well as with the plain mounting, of which leg odometry loses up to a tenth of the way.
    drift = controller.body.estimator.position[:2] - world.base_position[:2]
    assert np.hypot(*drift) < 0.12
