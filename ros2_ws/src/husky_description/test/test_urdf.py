"""The URDF against the MuJoCo model, with Pinocchio as the second library."""

import subprocess
import sys
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec
from husky_description.robot import ROBOTS, load_robot
from husky_description.urdf import build_urdf

pin = pytest.importorskip("pinocchio")

TOLERANCE = 1e-6


def sites_of(robot):
    """Frames of a robot that are sites of its MuJoCo model too, and these sites' names."""
    hung = "fan" if "fans" in robot.own_sections else "propeller"
    alike = (*robot.foot_names, "perch", f"hind_left_{hung}")
    return {name: name for name in alike} | {
        "imu_link": "imu",
        "t265_link": "t265",
        "camera_link": "d435",
        "camera_depth_frame": "d435",
    }


class Pair:
    """The same robot in both libraries, and the map between their velocities.

    MuJoCo's free joint has its linear velocity in the world and its angular velocity in the base;
    Pinocchio's free flyer has both in the base: v_pinocchio = T v_mujoco.
    """

    def __init__(self, robot, urdf):
        self.robot = robot
        self.model = build_spec(robot).compile()
        self.data = mujoco.MjData(self.model)
        self.pin_model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
        self.pin_model.gravity.linear[:] = 0.0, 0.0, -GRAVITY  # a URDF tells of none
        self.pin_data = self.pin_model.createData()
        ids = [self.pin_model.getJointId(name) for name in robot.joint_names]
        self.q_index = [self.pin_model.joints[i].idx_q for i in ids]
        self.v_index = [self.pin_model.joints[i].idx_v for i in ids]
        self.pin_model.armature[self.v_index] = robot.armature

    def set(self, position, rotation, joints, velocity=None):
        x, y, z, w = rotation.as_quat()
        self.data.qpos[:] = [*position, w, x, y, z, *joints]
        self.data.qvel[:] = 0.0 if velocity is None else velocity
        mujoco.mj_forward(self.model, self.data)
        self.q = pin.neutral(self.pin_model)
        self.q[:7] = [*position, x, y, z, w]
        self.q[self.q_index] = joints
        self.transform = np.zeros((18, 18))
        self.transform[:3, :3] = rotation.as_matrix().T
        self.transform[3:6, 3:6] = np.eye(3)
        self.transform[self.v_index, np.arange(6, 18)] = 1.0


@pytest.fixture(scope="module", params=ROBOTS)
def pair(request):
    robot = load_robot(request.param)
    return Pair(robot, build_urdf(robot))


@pytest.fixture(scope="module")
def postures(pair):
    robot, rng = pair.robot, np.random.default_rng(5)
    rotations = Rotation.random(100, rng=np.random.default_rng(6))
    return [
        (rng.uniform(-2, 2, 3), rotations[i], rng.uniform(robot.joint_lower, robot.joint_upper))
        for i in range(100)
    ]


def test_foot_positions_agree(pair, postures):
    for posture in postures:
        pair.set(*posture)
        pin.framesForwardKinematics(pair.pin_model, pair.pin_data, pair.q)
        for name, site in sites_of(pair.robot).items():
            frame = pair.pin_data.oMf[pair.pin_model.getFrameId(name)]
            np.testing.assert_allclose(pair.data.site(site).xpos, frame.translation, atol=TOLERANCE)
            np.testing.assert_allclose(
                pair.data.site(site).xmat.reshape(3, 3), frame.rotation, atol=TOLERANCE
            )


def test_mass_matrices_agree(pair, postures):
    for posture in postures:
        pair.set(*posture)
        expected = pin.crba(pair.pin_model, pair.pin_data, pair.q)
        expected = np.triu(expected) + np.triu(expected, 1).T
        mass = np.zeros((18, 18))
        mujoco.mj_fullM(pair.model, pair.data, mass)
        np.testing.assert_allclose(
            mass, pair.transform.T @ expected @ pair.transform, atol=TOLERANCE
        )


def test_gravity_torques_agree(pair, postures):
    for posture in postures:
        pair.set(*posture)
        expected = pin.computeGeneralizedGravity(pair.pin_model, pair.pin_data, pair.q)
        np.testing.assert_allclose(pair.data.qfrc_bias, pair.transform.T @ expected, atol=TOLERANCE)


def test_velocity_torques_agree(pair, postures):
    """A constant velocity in the world turns in the base: dv = -w x v there."""
    rng = np.random.default_rng(7)
    for position, rotation, joints in postures:
        velocity = rng.uniform(-3, 3, 18)
        pair.set(position, rotation, joints, velocity)
        pin_velocity = pair.transform @ velocity
        acceleration = np.zeros(18)
        acceleration[:3] = -np.cross(pin_velocity[3:6], pin_velocity[:3])
        expected = pin.rnea(pair.pin_model, pair.pin_data, pair.q, pin_velocity, acceleration)
        np.testing.assert_allclose(pair.data.qfrc_bias, pair.transform.T @ expected, atol=TOLERANCE)


@pytest.mark.parametrize("payload", [0.0, 0.1, 2.5])
def test_other_payloads_agree(payload, pair, postures):
    """None, one that cannot balance the depth camera, a heavy one."""
    name = pair.robot.name.removeprefix("husky_")
    camera = {"d435__rpy": [0.2, 0.6, -0.3], "d435__depth_offset": [0.01, 0.02, 0.005]}
    place = [0.03, 0.01, -0.02]
    robot = load_robot(name, payload_mass=payload, payload__position=place, **camera)
    other = Pair(robot, build_urdf(robot))
    bare = pair.robot.mass - pair.robot.payload_mass
    assert pin.computeTotalMass(other.pin_model) == pytest.approx(bare + payload, abs=1e-9)
    for posture in postures[:10]:
        other.set(*posture)
        expected = pin.computeGeneralizedGravity(other.pin_model, other.pin_data, other.q)
        np.testing.assert_allclose(
            other.data.qfrc_bias, other.transform.T @ expected, atol=TOLERANCE
        )
    pin.ccrba(other.pin_model, other.pin_data, other.q, np.zeros(other.pin_model.nv))
    mass = np.zeros((18, 18))
    mujoco.mj_fullM(other.model, other.data, mass)
    whole = other.pin_data.Ig  # of the whole robot about its centre of mass, in the world's axes
    arm = other.data.subtree_com[1] - other.data.xpos[1]
    about_base = whole.inertia + whole.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    turn = other.data.xmat[1].reshape(3, 3)
    np.testing.assert_allclose(mass[3:6, 3:6], turn.T @ about_base @ turn, atol=TOLERANCE)


def test_frames_of_the_depth_camera(pair):
    """Optical axes (REP-103) along those of camera_link: x to the right, y down, z ahead."""
    model = pair.pin_model
    optical, link = (
        model.frames[model.getFrameId(name)].placement
        for name in ("camera_depth_optical_frame", "camera_link")
    )
    expected = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    np.testing.assert_allclose(link.rotation.T @ optical.rotation, expected, atol=1e-12)
    np.testing.assert_allclose(optical.translation, link.translation, atol=1e-12)


def test_total_mass(pair):
    masses = {"husky_carbon": 7.6, "husky_beta": 6.11}
    mass = masses[pair.robot.name]
    assert pin.computeTotalMass(pair.pin_model) == pytest.approx(mass, abs=1e-9)
    assert pair.model.body_subtreemass[0] == pytest.approx(mass, abs=1e-9)


def test_limits(pair):
    model, robot = pair.pin_model, pair.robot
    np.testing.assert_allclose(model.lowerPositionLimit[pair.q_index], robot.joint_lower)
    np.testing.assert_allclose(model.upperPositionLimit[pair.q_index], robot.joint_upper)
    np.testing.assert_allclose(model.effortLimit[pair.v_index], robot.joint_torque_limit)
    np.testing.assert_allclose(model.velocityLimit[pair.v_index], robot.joint_velocity_limit)


def test_links_and_joints(pair):
    root = ElementTree.fromstring(build_urdf(pair.robot))
    assert root.get("name") == pair.robot.name
    revolute = [joint.get("name") for joint in root.iter("joint") if joint.get("type") != "fixed"]
    assert tuple(revolute) == pair.robot.joint_names
    links = [link.get("name") for link in root.iter("link")]
    children = {child.get("link") for child in root.iter("child")}
    assert len(set(links)) == len(links)
    assert [link for link in links if link not in children] == ["base_link"]
    assert root.find("link[@name='base_link']/inertial") is None
    assert not root.findall(".//mesh")
    materials = {material.get("name") for material in root.findall("material")}
    assert {m.get("name") for m in root.findall(".//visual/material")} <= materials
    assert all(value.get("rgba") for value in root.findall("material/color"))


def test_links_of_the_parallelogram_reach_the_foot(pair, postures):
    """On its mimic joints the ankle ends at the foot of the serial equivalent."""
    robot = pair.robot
    model = pin.buildModelFromXML(build_urdf(robot, parallelogram=True))
    data = model.createData()
    assert model.nq == 12 + 2 * 12  # A continuous joint is a cosine and a sine in Pinocchio.
    for _, _, joints in postures[:20]:
        q = pin.neutral(model)
        for index, name in enumerate(robot.joint_names):
            q[model.joints[model.getJointId(name)].idx_q] = joints[index]
        for leg, name in enumerate(robot.legs):
            knee = joints[3 * leg + 2]
            for link, sign in (("calf", 1), ("rod", 1), ("ankle", -1)):
                at = model.joints[model.getJointId(f"{name}_{link}_pin")].idx_q
                q[at : at + 2] = [np.cos(sign * knee), np.sin(sign * knee)]
        pin.framesForwardKinematics(model, data, q)
        for name in robot.legs:
            ankle = data.oMf[model.getFrameId(f"{name}_ankle")]
            foot = data.oMf[model.getFrameId(f"{name}_foot")]
            thigh = data.oMf[model.getFrameId(f"{name}_thigh")]
            end = ankle.act(np.array([0.0, 0.0, -robot.leg.ankle_link]))
            np.testing.assert_allclose(end, foot.translation, atol=1e-12)
            np.testing.assert_allclose(ankle.rotation, thigh.rotation, atol=1e-12)


def test_command_line_writes_the_urdf():
    result = subprocess.run(
        [sys.executable, "-m", "husky_description.urdf", "--payload-mass", "1.0"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout == build_urdf(load_robot(payload_mass=1.0))
