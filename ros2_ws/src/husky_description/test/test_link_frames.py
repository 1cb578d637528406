"""Transforms of the URDF's joints against MuJoCo's kinematics of the same robot."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.link_frames import LinkFrames, inverse, transform_of
from husky_description.mujoco_model import build_spec
from husky_description.robot import ROBOTS, load_robot
from husky_description.urdf import build_urdf

ROBOT = load_robot()


def matrix(transform):
    """A transform as a homogeneous matrix (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(transform[3:]).as_matrix()
    result[:3, 3] = transform[:3]
    return result


def in_root(edges):
    """Poses (4, 4) in the root of all frames of a tree, given transforms by edge."""
    poses = {"base_link": np.eye(4)}
    while len(poses) <= len(edges):
        for (parent, child), transform in edges.items():
            if parent in poses:
                poses[child] = poses[parent] @ matrix(transform)
    return poses


@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_mujoco_has_it(name):
    robot = load_robot(name)
    hung = "fan" if "fans" in robot.own_sections else "propeller"
    frames = LinkFrames(build_urdf(robot))
    assert frames.joint_names == robot.joint_names
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(20):
        joints = rng.uniform(robot.joint_lower, robot.joint_upper)
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *joints]
        mujoco.mj_forward(model, data)
        edges = dict(zip(frames.fixed_edges, frames.fixed, strict=True))
        edges |= dict(zip(frames.moving_edges, frames.moving(joints), strict=True))
        poses = in_root(edges)
        for leg in robot.legs:
            for link in ("hip", "thigh", "shin"):
                body = data.body(f"{leg}_{link}")
                pose = poses[f"{leg}_{link}"]
                np.testing.assert_allclose(pose[:3, 3], body.xpos, atol=1e-9)
                np.testing.assert_allclose(pose[:3, :3], body.xmat.reshape(3, 3), atol=1e-9)
        for frame in (*robot.foot_names, "imu_link", "t265_link", "perch", f"hind_left_{hung}"):
            site = data.site(frame.removesuffix("_link"))
            np.testing.assert_allclose(poses[frame][:3, 3], site.xpos, atol=1e-9)
        for frame in ("camera_link", "camera_depth_frame"):
            site = data.site("d435")
            np.testing.assert_allclose(poses[frame][:3, 3], site.xpos, atol=1e-9)
            np.testing.assert_allclose(poses[frame][:3, :3], site.xmat.reshape(3, 3), atol=1e-9)


def test_origins_turn_about_fixed_axes_and_joints_about_their_own():
    """A made-up arm, against SciPy: the origin's roll, pitch, yaw, then the turn about the axis."""
    urdf = (
        '<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        '<parent link="a"/><child link="b"/><origin xyz="1 2 3" rpy="0.3 -0.5 0.9"/>'
        '<axis xyz="0 3 4"/></joint></robot>'
    )
    (transform,) = LinkFrames(urdf).moving(np.array([0.7]))
    expected = Rotation.from_euler("xyz", (0.3, -0.5, 0.9)) * Rotation.from_rotvec(
        0.7 * np.array((0.0, 0.6, 0.8))
    )
    turned = Rotation.from_quat(transform[3:])
    assert (turned.inv() * expected).magnitude() == pytest.approx(0.0, abs=1e-12)
    assert transform[:3].tolist() == [1.0, 2.0, 3.0]


def test_a_joint_that_does_not_turn_by_itself_is_refused():
    urdf = build_urdf(ROBOT, parallelogram=True)
    with pytest.raises(ValueError, match="front_left_calf_pin is continuous or a mimic"):
        LinkFrames(urdf)


def test_inverse():
    forth = transform_of((0.4, -1.0, 2.0), (0.1, 0.7, -2.0))
    np.testing.assert_allclose(matrix(forth) @ matrix(inverse(forth)), np.eye(4), atol=1e-12)
