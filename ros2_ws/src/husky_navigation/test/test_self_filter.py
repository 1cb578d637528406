"""Capsules of the legs against kinematics and MuJoCo's model of either robot."""

import numpy as np
import pytest

from husky_description.kinematics import Kinematics
from husky_description.mujoco_model import build_spec
from husky_description.plain_mujoco import mujoco
from husky_description.robot import load_robot
from husky_navigation.self_filter import LegCapsules


def is_inside(capsules, points):
    held = np.zeros(len(points), dtype=bool)
    for row in capsules:
        start, line = row[:3], row[3:6] - row[:3]
        along = np.clip((points - start) @ line / max(line @ line, 1e-12), 0.0, 1.0)
        held |= np.linalg.norm(points - start - along[:, None] * line, axis=1) < row[6]
    return held


@pytest.mark.parametrize("name", ["carbon", "beta"])
def test_legs_of_the_model_are_held(name):
    """Feet, tubes and parallelogram links, wherever joints are; hip housings never get ahead."""
    robot = load_robot(name)
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    filter_ = LegCapsules(robot)
    random = np.random.default_rng(2)
    parts = [
        index
        for index in range(model.ngeom)
        if model.geom(index).name.endswith(("_thigh", "_shin", "_foot"))
    ]
    assert len(parts) == 12
    for _ in range(5):
        joints = random.uniform(robot.joint_lower, robot.joint_upper)
        data.qpos[:3], data.qpos[3:7], data.qpos[7:19] = 0.0, (1.0, 0.0, 0.0, 0.0), joints
        mujoco.mj_kinematics(model, data)
        capsules = filter_.in_base(joints)
        for index in parts:
            along = data.geom_xmat[index].reshape(3, 3)[:, 2]
            half = model.geom_size[index, 1]
            ends = data.geom_xpos[index] + np.linspace(-half, half, 9)[:, None] * along
            around = random.standard_normal((9, 3))
            around /= np.linalg.norm(around, axis=1)[:, None]
            assert is_inside(capsules, ends + model.geom_size[index, 0] * around).all()


def test_feet_are_where_kinematics_has_them():
    robot = load_robot()
    joints = np.random.default_rng(1).uniform(robot.joint_lower, robot.joint_upper)
    feet = Kinematics(robot).foot_positions(joints)
    capsules = LegCapsules(robot).in_base(joints).reshape(4, -1, 7)
    np.testing.assert_allclose(capsules[:, 1, 3:6], feet, atol=1e-12)
    np.testing.assert_allclose(capsules[:, 3, 3:6], feet, atol=1e-12)  # of the parallelogram


def test_capsules_turn_and_move_with_the_base():
    robot = load_robot()
    joints = robot.stand_joint_position
    filter_ = LegCapsules(robot)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    inside, outside = filter_.in_base(joints), filter_.in_odom(joints, quarter, np.ones(3))
    np.testing.assert_allclose(outside[:, 0], 1.0 - inside[:, 1])
    np.testing.assert_allclose(outside[:, 4], 1.0 + inside[:, 3])
    np.testing.assert_array_equal(outside[:, 6], inside[:, 6])


@pytest.mark.parametrize("joints", [np.zeros(11), np.full(12, np.nan)])
def test_bad_joints_are_refused(joints):
    with pytest.raises(ValueError, match="12 finite numbers"):
        LegCapsules(load_robot()).in_base(joints)
