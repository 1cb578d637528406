"""The reduced-order model beside the whole robot in MuJoCo: what it has, what it leaves out."""

import mujoco
import numpy as np
import pytest
from leg_coordinates import LegCoordinates
from scipy.spatial.transform import Rotation

from husky_control.planning.reduced_order import (
    RomState,
    body_acceleration,
    foot_positions,
    foot_velocities,
    ground_input_matrix,
    leg_vector,
    pack_state,
    standing_state,
)
from husky_control.planning.rom_parameters import rom_parameters
from husky_description.kinematics import Kinematics
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot

ROBOT = load_robot()
PARAMETERS = rom_parameters(ROBOT)
MAP = LegCoordinates(ROBOT)
MODEL = build_spec(ROBOT).compile()
STAND = ROBOT.stand_joint_position
WEIGHT = -PARAMETERS.mass * PARAMETERS.gravity[2]


def placed(joints, rotation, position, joint_velocity, angular_velocity, velocity):
    """MuJoCo's data of the robot in the air, base at a position, in motion."""
    data = mujoco.MjData(MODEL)
    data.qpos[:3] = position
    data.qpos[3:7] = np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
    data.qpos[7:] = joints
    data.qvel[:3], data.qvel[3:6], data.qvel[6:] = velocity, angular_velocity, joint_velocity
    mujoco.mj_forward(MODEL, data)
    return data


def foot_jacobian(data, name):
    """(3, nv) of a foot's centre."""
    jacobian = np.zeros((3, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, jacobian, None, MODEL.site(name).id)
    return jacobian


@pytest.mark.parametrize("seed", range(5))
def test_feet_and_their_velocities_are_those_of_the_robot(seed):
    """Joint positions and velocities into leg coordinates, those into the world."""
    rng = np.random.default_rng(seed)
    joints = STAND + rng.uniform(-0.4, 0.4, 12)
    rates = rng.uniform(-3.0, 3.0, 12)
    rotation = Rotation.from_rotvec(rng.uniform(-1.0, 1.0, 3)).as_matrix()
    position, velocity, omega = rng.random(3), rng.random(3), rng.uniform(-3.0, 3.0, 3)
    data = placed(joints, rotation, position, rates, omega, velocity)
    center = PARAMETERS.center_of_mass
    x = pack_state(
        RomState(
            MAP.from_joints(joints),
            MAP.velocity_from_joints(joints, rates),
            rotation,
            position + rotation @ center,
            omega,
            velocity + rotation @ np.cross(omega, center),
        )
    )
    for leg, name in enumerate(ROBOT.foot_names):
        where = data.site_xpos[MODEL.site(name).id]
        np.testing.assert_allclose(foot_positions(x, PARAMETERS)[leg], where, atol=1e-12)
        speed = foot_jacobian(data, name) @ data.qvel
        np.testing.assert_allclose(foot_velocities(x, PARAMETERS)[leg], speed, atol=1e-11)


@pytest.mark.parametrize("seed", range(5))
def test_with_locked_joints_in_the_stand_it_moves_as_the_robot(seed):
    """All rows of MuJoCo's equations, joints without acceleration: exact, tumbling and pushed."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.uniform(-1.0, 1.0, 3)).as_matrix()
    omega = rng.uniform(-3.0, 3.0, 3)
    data = placed(STAND, rotation, np.zeros(3), np.zeros(12), omega, rng.random(3))
    u_g, u_t = rng.uniform(-30.0, 30.0, 12), rng.uniform(-30.0, 30.0, 3)
    pushed = -data.qfrc_bias.copy()
    for leg, name in enumerate(ROBOT.foot_names):
        pushed += foot_jacobian(data, name).T @ u_g[3 * leg : 3 * leg + 3]
    at_center = np.zeros((3, MODEL.nv))
    mujoco.mj_jacSubtreeCom(MODEL, data, at_center, MODEL.body("base").id)
    pushed += at_center.T @ u_t
    matrix = np.zeros((MODEL.nv, MODEL.nv))
    mujoco.mj_fullM(MODEL, data, matrix)
    base = np.linalg.solve(matrix[:6, :6], pushed[:6])  # origin in world, turn in body

    center = PARAMETERS.center_of_mass
    x = standing_state(PARAMETERS, ROBOT.stand_height)
    x[24:33] = rotation.T.reshape(-1)
    x[36:39] = omega
    reduced = body_acceleration(x, u_g, u_t, PARAMETERS)
    turn = np.cross(base[3:], center) + np.cross(omega, np.cross(omega, center))
    np.testing.assert_allclose(reduced[:3], base[:3] + rotation @ turn, atol=1e-9)
    np.testing.assert_allclose(reduced[3:], base[3:], atol=1e-9)


def standing_forces():
    """Vertical forces (4,) N of the ground that hold the reduced model, with the least squares."""
    x = standing_state(PARAMETERS, ROBOT.stand_height)
    columns = [ground_input_matrix(x, leg, PARAMETERS)[:, 2] for leg in range(4)]
    wanted = np.concatenate((-PARAMETERS.mass * PARAMETERS.gravity, np.zeros(3)))
    return np.linalg.lstsq(np.column_stack(columns), wanted, rcond=None)[0]


def test_static_ground_forces_are_those_of_the_standing_robot():
    """MuJoCo's robot, its joints held, comes to rest on its four feet."""
    spec = build_spec(ROBOT)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    for _ in range(int(3.0 / model.opt.timestep)):
        data.ctrl[:] = 300.0 * (STAND - data.qpos[7:]) - 4.0 * data.qvel[6:]
        mujoco.mj_step(model, data)
    forces = dict.fromkeys(ROBOT.foot_names, 0.0)
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        # The plane has no name.
        forces[max(model.geom(geom).name for geom in data.contact[index].geom)] += force[0]
    measured, expected = np.array(list(forces.values())), standing_forces()
    assert measured.sum() == pytest.approx(WEIGHT, rel=1e-3)
    # Knees yield by some degrees under the servo's gain: the centre of mass moves by a millimetre
    # or two of the 400 between the feet.
    np.testing.assert_allclose(measured, expected, rtol=0.02)
    assert expected[0] < expected[2], "the shins hang behind: hind feet carry more"


def trot_step(time, period=0.4, stride=0.06, height=0.05):
    """Feet (4, 3) m in base while one diagonal swings and the other stands, smooth in time."""
    feet = Kinematics(ROBOT).foot_positions(STAND)
    share = (time % period) / (period / 2.0)
    for leg in range(4):
        phase = share if leg in (0, 3) else share - 1.0
        swing = 0.0 <= phase < 1.0
        s = phase % 1.0
        along = s * s * s * (10.0 + s * (6.0 * s - 15.0)) - 0.5
        feet[leg, 0] += stride * (along if swing else 0.5 - s)
        feet[leg, 2] += 16.0 * height * s * s * (1.0 - s) ** 2 if swing else 0.0
    return feet


def test_what_massless_legs_leave_out_in_a_trot():
    """A base that glides level while the legs trot: what else must hold it, the model has not."""
    kinematics, dt = Kinematics(ROBOT), 1e-4
    joints = lambda t: kinematics.joint_positions(trot_step(t))  # noqa: E731
    data = mujoco.MjData(MODEL)
    force, moment, offset = [], [], []
    for t in np.arange(0.01, 0.19, 0.005):
        before, now, after = joints(t - dt), joints(t), joints(t + dt)
        data.qpos[:] = 0.0
        data.qpos[3], data.qpos[7:] = 1.0, now
        data.qvel[:], data.qacc[:] = 0.0, 0.0
        data.qvel[6:] = (after - before) / (2.0 * dt)
        data.qacc[6:] = (after - 2.0 * now + before) / dt**2
        mujoco.mj_inverse(MODEL, data)
        center = data.subtree_com[MODEL.body("base").id]
        force.append(data.qfrc_inverse[:3] - [0.0, 0.0, WEIGHT])
        moment.append(data.qfrc_inverse[3:6] - np.cross(center, data.qfrc_inverse[:3]))
        offset.append(center - PARAMETERS.center_of_mass)
    # 0.3 m/s, period 0.4 s, 5 cm high: the figures in docs/incline_theory.md.
    force_peak, moment_peak, offset_peak = (
        np.abs(values).max(axis=0) for values in (force, moment, offset)
    )
    assert force_peak == pytest.approx([2.3, 0.0, 3.1], abs=0.1)
    assert moment_peak == pytest.approx([0.0, 0.79, 0.0], abs=0.05)
    assert (offset_peak < 1e-3).all()
    assert force_peak.max() < 0.05 * WEIGHT


def test_leg_vector_is_where_the_robot_stands():
    """The legs of the model reach from the hips to the feet of the standing robot."""
    feet = Kinematics(ROBOT).foot_positions(STAND) - PARAMETERS.center_of_mass
    down = leg_vector(0.0, 0.0, ROBOT.stand_height)
    np.testing.assert_allclose(PARAMETERS.hip_position + down, feet, atol=1e-14)
