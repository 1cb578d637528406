"""The IMU's mounting: what is told of base by an IMU that is turned and displaced."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_control.estimation.imu_mount import ImuMount
from husky_control.tick_data import Measurements
from husky_description.robot import load_robot

TICK = 0.002
UP = np.array([0.0, 0.0, 9.8])


def mounted(rpy, position):
    plain = load_robot()
    place = {"rpy": np.array(rpy), "position": np.array(position)}
    return ImuMount(dataclasses.replace(plain, imu=dataclasses.replace(plain.imu, **place)))


class TurningBody:
    """Base's origin goes to and fro while the body swings about it."""

    def attitude(self, time):
        """Base in world, and its angular velocity in base [rad/s]."""
        return Rotation.from_rotvec(
            np.stack([0.4 * np.sin(9 * time), 0.3 * np.sin(7 * time), 2.0 * time]).T
        )

    def velocity(self, time):
        """Of base's origin in world [m/s]."""
        return np.array([0.5 * np.sin(6 * time), 0.0, 0.2 * np.sin(11 * time)])

    def point_velocity(self, time, lever):
        """Of a point of the body [m/s], by central differences of where it is."""
        step = 1e-5
        arm = self.attitude(time + step).apply(lever) - self.attitude(time - step).apply(lever)
        return self.velocity(time) + arm / (2 * step)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -0.4, 2.0)])
@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.03), (-0.3, 0.2, 0.1)])
def test_base_is_told_whatever_the_mounting(rpy, lever):
    body, mount, turn = TurningBody(), mounted(rpy, lever), Rotation.from_euler("xyz", rpy)
    measurements, told, truth = Measurements(), np.zeros(3), np.zeros(3)
    for tick in range(500):
        time, h = tick * TICK, 1e-4
        base = body.attitude(time)
        rate = (body.attitude(time - h).inv() * body.attitude(time + h)).as_rotvec() / (2 * h)
        ahead, behind = (body.point_velocity(t, lever) for t in (time, time - TICK))
        force = base.inv().apply((ahead - behind) / TICK + UP)
        mount.tell(
            (base * turn).as_quat(), turn.inv().apply(rate), turn.inv().apply(force), measurements
        )
        seen = Rotation.from_quat(measurements.orientation_base_in_world)
        assert (seen.inv() * base).magnitude() < 1e-12
        np.testing.assert_allclose(measurements.angular_velocity_base_in_base, rate, atol=1e-12)
        if tick:
            told = told + (base.apply(measurements.specific_force_base) - UP) * TICK
            truth = body.velocity(time) - body.velocity(0.0)
    # The lever's end moves at up to 1.5 m/s; what is left is the central differences' error.
    np.testing.assert_allclose(told, truth, atol=1e-3)


def test_variances_turn_with_the_axes():
    variance = mounted((0.0, 0.0, np.pi / 2), (0.0, 0.0, 0.0)).variance(np.array([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(variance, [4.0, 1.0, 9.0], atol=1e-12)
