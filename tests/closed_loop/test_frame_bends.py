"""The robot on a frame that bends (T6), of which drives and controller know nothing."""

import numpy as np
import pytest
from in_process import InProcessRobot

from husky_description import frame_compliance
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_sim.world import WorldOptions

pytestmark = pytest.mark.in_a_copy  # each goes on from the same standing robot
ROBOT = load_robot(frame__frequency=15.0)


def shift(world):
    """How far each hip has shifted along x, y and z of base [m] (4, 3)."""
    return np.array(
        [
            [world.data.joint(f"{leg}_frame_{axis}").qpos[0] for axis in frame_compliance.AXES]
            for leg in ROBOT.legs
        ]
    )


@pytest.fixture(scope="module")
def standing():
    robot = InProcessRobot(WorldOptions(), ROBOT)
    robot.stand()
    robot.run(1.0)
    return robot


def test_hips_of_a_standing_robot_carry_its_weight(standing):
    force = frame_compliance.stiffness(ROBOT) * shift(standing.world)
    carried = 4.0 * frame_compliance.loaded_mass(ROBOT) * GRAVITY
    assert force.sum(axis=0) == pytest.approx((0.0, 0.0, carried), abs=0.01 * carried)
    assert force[:, 2].min() > 0.1 * carried


def test_drives_measure_the_joints_and_not_the_frame(standing):
    world = standing.world
    joints = [world.data.joint(name) for name in ROBOT.joint_names]
    np.testing.assert_array_equal(world.joint_position, [joint.qpos[0] for joint in joints])
    np.testing.assert_array_equal(world.joint_velocity, [joint.qvel[0] for joint in joints])
    measured = standing.measurements.joint_position
    assert measured == pytest.approx(world.joint_position, abs=0.002)


def test_trots_at_its_speed(standing):
    assert standing.controller.request_mode("walk")[0]
    standing.run(2.0, (0.5, 0.0, 0.0))
    start, tilts = standing.world.base_position.copy(), []
    for _ in range(20):
        standing.run(0.2, (0.5, 0.0, 0.0))
        tilts.append(standing.tilt)
    assert standing.controller.mode.value == "walk", standing.controller.reason
    assert (standing.world.base_position - start)[0] / 4.0 == pytest.approx(0.5, rel=0.05)
    assert max(tilts) < 2.5
    assert np.abs(shift(standing.world)).max() < 0.01
