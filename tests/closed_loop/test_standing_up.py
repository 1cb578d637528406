"""Standing up and sitting down in one process: the feet stand still under the weight."""

import numpy as np
import pytest
from in_process import InProcessRobot

from husky_description.robot import load_robot
from husky_sim.world import WorldOptions

ROBOT = load_robot()
ROLLING = 0.008
"""Two feet roll sideways by radius times change of the hip frontal angle, 3.6 mm each [m]."""
LOADED = 5.0
"""Vertical force above which a foot stands [N]; each carries 18.6 N."""


def spread_and_torques(robot, duration):
    """How much the feet's distances change while they carry the body [m]; peak torques (12,)."""
    distances, torque = [], np.zeros(12)
    for _ in range(round(duration / 0.002)):
        robot.tick()
        off_its_perch = robot.world.base_position[2] > 1.1 * (ROBOT.sit_height + ROBOT.foot_radius)
        if off_its_perch and (robot.world.foot_forces()[:, 2] > LOADED).all():
            feet = robot.world.foot_positions()
            torque = np.maximum(torque, np.abs(robot.measurements.joint_torque))
            distances.append(np.linalg.norm(feet - np.roll(feet, 1, axis=0), axis=1))
    assert len(distances) > 100, "the feet were loaded"
    return np.ptp(distances, axis=0).max(), torque


@pytest.mark.parametrize("friction", [0.4, pytest.param(0.7, marks=pytest.mark.slow), 1.8])
def test_feet_stand_still_while_the_body_rises_and_sinks(friction):
    robot = InProcessRobot(WorldOptions(friction=friction))
    robot.enable()
    assert robot.controller.request_mode("stand_up")[0]
    change, torque = spread_and_torques(robot, 4.0)
    assert robot.controller.mode.value == "stand", robot.controller.reason
    assert change < ROLLING
    limit = ROBOT.joint_torque_limit
    assert (torque[0::3] < 0.6 * limit[0::3]).all(), "hip frontal joints push the feet outward"

    assert robot.controller.request_mode("sit")[0]
    change, torque = spread_and_torques(robot, 4.0)
    assert robot.controller.mode.value == "sit" and robot.controller.present.settled
    assert change < ROLLING
    assert (torque[0::3] < 0.6 * limit[0::3]).all()
    sit = ROBOT.sit_joint_position
    np.testing.assert_allclose(robot.measurements.joint_position, sit, atol=0.02)
    assert robot.controller.counters.faults == 0
