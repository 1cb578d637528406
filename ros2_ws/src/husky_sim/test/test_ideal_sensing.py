"""Sensors without errors tell the truth to the last digit."""

import numpy as np

from husky_description.robot import load_robot
from husky_drivers.t265.frames import odometry
from husky_drivers.vn200.imu import ImuFigures
from husky_sim.devices.t265.device import T265Device
from husky_sim.devices.vn200.noise import ImuNoise
from husky_sim.ideal_sensing import IDEAL_SENSING

IDEAL = load_robot("beta", **IDEAL_SENSING)


def test_the_imu_has_neither_noise_nor_a_wrong_attitude():
    noise = ImuNoise(ImuFigures.of(IDEAL.imu), 3)
    assert not np.any([noise.next() for _ in range(2000)])
    usual = ImuNoise(ImuFigures.of(load_robot("beta").imu), 3)
    assert np.all(usual.next())


def test_the_camera_neither_drifts_nor_trembles():
    camera, upright = T265Device(IDEAL.t265, 3), (0.0, 0.0, 0.0, 1.0)
    for step in range(400):
        place = (0.01 * step, 0.002 * step, 0.3)
        frame = camera.track(5_000_000 * step, place, upright, (2.0, 0.4, 0.0), (0.0, 0.0, 0.0))
    pose, twist = odometry(frame)
    np.testing.assert_allclose(pose, (*np.subtract(place, (0.0, 0.0, 0.3)), *upright), atol=1e-6)
    np.testing.assert_allclose(twist, (2.0, 0.4, 0.0, 0.0, 0.0, 0.0), atol=1e-6)
