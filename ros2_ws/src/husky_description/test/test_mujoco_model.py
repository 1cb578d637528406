"""The MuJoCo model: kinematics, statics, contacts and symmetry."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.inertia import box_inertia
from husky_description.mujoco_model import (
    COLLISION_GROUP,
    build_spec,
    build_unit_spec,
    composite_inertia,
)
from husky_description.robot import Robot, load_robot

ROBOT = load_robot()


def make(floor: bool = True, robot: Robot = ROBOT) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = build_spec(robot)
    if floor:
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 0.1])
    model = spec.compile()
    return model, mujoco.MjData(model)


def reset(model, data, key):
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    mujoco.mj_forward(model, data)


def contacts(model, data):
    return {
        tuple(sorted((model.geom(c.geom1).name, model.geom(c.geom2).name))): c.dist
        for c in data.contact[: data.ncon]
    }


def rotation(axis, angle):
    return Rotation.from_rotvec(angle * np.array(axis, dtype=float)).as_matrix()


def test_it_falls_as_everybody_believes():
    for spec in (build_spec(ROBOT), build_unit_spec(ROBOT)):
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[:3], [0.0, 0.0, -GRAVITY], atol=1e-9)


def test_joints_and_actuators_are_in_the_robot_s_order():
    model, _ = make(floor=False)
    assert (model.nq, model.nv, model.nu) == (19, 18, 12)
    assert tuple(model.joint(i + 1).name for i in range(12)) == ROBOT.joint_names
    assert tuple(model.actuator(i).name for i in range(12)) == ROBOT.joint_names
    assert [model.joint(n).qposadr[0] for n in ROBOT.joint_names] == list(range(7, 19))
    assert np.all(model.jnt_range[1:, 0] == ROBOT.joint_lower)
    assert np.all(model.jnt_range[1:, 1] == ROBOT.joint_upper)
    assert np.all(model.dof_armature[6:] == ROBOT.armature)
    assert not np.any(model.dof_armature[:6])


def test_control_is_joint_torque():
    model, data = make(floor=False)
    data.ctrl[:] = np.arange(12) - 5.5
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qfrc_actuator[6:], data.ctrl)
    assert not np.any(data.qfrc_actuator[:6])


def test_total_mass_and_thirteen_masses():
    model, _ = make(floor=False)
    assert model.body("base").subtreemass[0] == pytest.approx(7.6, abs=1e-12)
    bare, _ = make(floor=False, robot=load_robot(payload_mass=0.0))
    assert bare.body("base").subtreemass[0] == pytest.approx(6.32, abs=1e-12)
    assert np.count_nonzero(bare.body_mass) == 13


def test_foot_positions_in_closed_form():
    model, data = make(floor=False)
    rng = np.random.default_rng(2)
    down = np.array([0.0, 0.0, -1.0])
    for _ in range(50):
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        data.qpos[7:] = rng.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        mujoco.mj_kinematics(model, data)
        for leg, name in enumerate(ROBOT.legs):
            frontal, sagittal, knee = data.qpos[7 + 3 * leg : 10 + 3 * leg]
            calf = ROBOT.thigh_length * down + rotation([0, 1, 0], knee) @ (
                ROBOT.shin_length * down
            )
            foot = ROBOT.hip_position[leg] + rotation([1, 0, 0], frontal) @ (
                [0, ROBOT.lateral_offset[leg], 0] + rotation([0, 1, 0], sagittal) @ calf
            )
            np.testing.assert_allclose(data.site(f"{name}_foot").xpos, foot, atol=1e-12)
            np.testing.assert_allclose(data.geom(f"{name}_foot").xpos, foot, atol=1e-12)


def test_signs_of_the_joints():
    """Positive frontal moves a foot left, positive sagittal backward, negative knee forward."""
    model, data = make(floor=False)
    for joint, axis, sign in ((0, 1, 1), (1, 0, -1), (2, 0, -1)):
        data.qpos[7:] = 0.0
        mujoco.mj_kinematics(model, data)
        before = data.site("hind_left_foot").xpos.copy()
        data.qpos[7 + 6 + joint] = 0.1
        mujoco.mj_kinematics(model, data)
        assert sign * (data.site("hind_left_foot").xpos - before)[axis] > 0.01


@pytest.mark.parametrize("key", ["stand", "sit"])
def test_keyframes_touch_the_floor_with_the_feet_and_nothing_else(key):
    model, data = make()
    reset(model, data, key)
    data.qpos[2] -= 1e-4
    mujoco.mj_forward(model, data)
    touching = contacts(model, data)
    assert set(touching) == {tuple(sorted(("floor", f"{leg}_foot"))) for leg in ROBOT.legs}
    assert all(dist == pytest.approx(-1e-4, abs=1e-9) for dist in touching.values())


def hold(model, data, seconds, feed_forward):
    """Hold the posture by the servo's law, closed at every step."""
    desired = data.qpos[7:].copy()
    for _ in range(round(seconds / model.opt.timestep)):
        error = desired - data.qpos[7:]
        data.ctrl[:] = ROBOT.servo.kp * error - ROBOT.servo.kd * data.qvel[6:] + feed_forward
        mujoco.mj_step(model, data)
    return desired


def test_stands_on_the_servos():
    """With each foot's quarter of the weight fed forward, the posture holds within 1 mm."""
    model, data = make()
    reset(model, data, "stand")
    start = data.qpos[:3].copy()
    torque = np.zeros(model.nv)
    jacobian = np.zeros((3, model.nv))
    for leg in ROBOT.legs:
        mujoco.mj_jacSite(model, data, jacobian, None, model.site(f"{leg}_foot").id)
        torque -= jacobian.T @ [0, 0, ROBOT.mass * GRAVITY / 4]
    torque += data.qfrc_bias
    hold(model, data, 3.0, torque[6:])
    np.testing.assert_allclose(data.qpos[:3], start, atol=1e-3)
    assert np.abs(data.qvel).max() < 1e-3
    touching = contacts(model, data)
    assert len(touching) == 4
    assert min(touching.values()) > -1e-3
    assert not any(warning.number for warning in data.warning)


def test_droop_of_the_servos_is_the_weight_over_their_stiffness():
    """Without feed-forward the knee gives way by its static torque / kp."""
    model, data = make()
    reset(model, data, "stand")
    height = data.qpos[2]
    hold(model, data, 3.0, 0.0)
    lever = ROBOT.shin_length * np.sin(ROBOT.stand_joint_position[1])
    torque = (ROBOT.mass - 4 * ROBOT.shin_mass) * GRAVITY / 4 * lever
    droop = torque / ROBOT.servo.kp * lever
    # The feet sink 0.3 mm into the ground, and the hips turn too.
    assert height - data.qpos[2] == pytest.approx(droop, abs=6e-4)


def test_sits_on_the_perch():
    model, data = make()
    reset(model, data, "sit")
    hold(model, data, 1.0, 0.0)
    touching = contacts(model, data)
    assert ("floor", "perch") in touching
    assert min(touching.values()) > -1e-3
    data.ctrl[:] = 0.0
    mujoco.mj_step(model, data, nstep=2000)
    assert data.qpos[2] == pytest.approx(model.key("sit").qpos[2], abs=2e-3)
    assert data.xmat[1, 8] > 0.999


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_second_of_random_control_gives_no_warning(seed):
    model, data = make()
    reset(model, data, "stand")
    rng = np.random.default_rng(seed)
    for _ in range(200):
        data.ctrl[:] = rng.uniform(-10.0, 10.0, 12)
        mujoco.mj_step(model, data, nstep=10)
    assert data.time == pytest.approx(1.0)
    assert not any(warning.number for warning in data.warning)
    assert np.all(np.isfinite(data.qpos)) and np.all(np.abs(data.qvel) < 100.0)


def test_legs_collide_with_each_other_the_body_and_the_ground():
    model, data = make()
    data.qpos[2] = 2.0
    data.qpos[7:] = ROBOT.stand_joint_position
    data.qpos[[7, 10]] = [-0.5, 0.5]
    mujoco.mj_forward(model, data)
    assert any(
        a.startswith("front_left") and b.startswith("front_right") for a, b in contacts(model, data)
    )
    touched = set()
    for frontal in np.linspace(0.0, ROBOT.joint_lower[0], 50):
        data.qpos[7:10] = [frontal, 0.7, -0.1]
        mujoco.mj_forward(model, data)
        touched |= set(contacts(model, data))
    assert ("front_left_thigh", "perch") in touched
    # Lying on the right side, legs stretched.
    data.qpos[:7] = [0, 0, 0.105, np.sqrt(0.5), np.sqrt(0.5), 0, 0]
    data.qpos[7:] = 0.0
    mujoco.mj_forward(model, data)
    touched = {name for pair in contacts(model, data) for name in pair}
    assert {"front_right_hip", "front_right_thigh", "front_right_shin"} <= touched


def test_no_self_collision_around_the_stance():
    """Feet anywhere within 12 cm fore and aft, 8 cm up and 0.2 rad sideways."""
    model, data = make(floor=False)
    rng = np.random.default_rng(3)
    for _ in range(300):
        stride, lift = rng.uniform(-0.12, 0.12, 4), rng.uniform(0.0, 0.08, 4)
        length = np.hypot(stride, ROBOT.stand_height - lift)
        bend = np.arccos(length / 2 / ROBOT.thigh_length)
        data.qpos[7::3] = rng.uniform(-0.2, 0.2, 4)
        data.qpos[8::3] = bend - np.arctan2(stride, ROBOT.stand_height - lift)
        data.qpos[9::3] = -2 * bend
        mujoco.mj_fwdPosition(model, data)
        assert data.ncon == 0, contacts(model, data)


def test_what_is_seen_neither_collides_nor_weighs():
    model, _ = make(floor=False)
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    assert np.all(collides == (model.geom_group == COLLISION_GROUP))
    assert np.count_nonzero(collides) == 4 + 4 * 4


def test_left_and_right_are_mirror_images():
    """M(mirrored q) = S M(q) S, with S the mirror of the velocities in the x-z plane."""
    model, data = make(floor=False)
    rng = np.random.default_rng(4)
    leg_sign = np.array([-1.0, 1.0, 1.0])
    mirror = np.zeros((18, 18))
    mirror[:6, :6] = np.diag([1, -1, 1, -1, 1, -1])
    for here, there in ((0, 1), (1, 0), (2, 3), (3, 2)):
        rows = slice(6 + 3 * here, 9 + 3 * here)
        mirror[rows, 6 + 3 * there : 9 + 3 * there] = np.diag(leg_sign)

    def mass_and_gravity(joints):
        data.qpos[:7] = [0, 0, 1, 1, 0, 0, 0]
        data.qpos[7:] = joints
        mujoco.mj_forward(model, data)
        mass = np.zeros((18, 18))
        mujoco.mj_fullM(model, data, mass)
        return mass, data.qfrc_bias.copy()

    for _ in range(20):
        joints = rng.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        mass, gravity = mass_and_gravity(joints)
        mirrored_mass, mirrored_gravity = mass_and_gravity(mirror[6:, 6:] @ joints)
        np.testing.assert_allclose(mirrored_mass, mirror @ mass @ mirror, atol=1e-12)
        np.testing.assert_allclose(mirrored_gravity, mirror @ gravity, atol=1e-10)


def test_sites_are_where_the_robot_says():
    model, data = make(floor=False)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("imu").xpos, ROBOT.imu.position, atol=1e-12)
    np.testing.assert_allclose(data.site("t265").xpos, ROBOT.t265.position, atol=1e-12)
    np.testing.assert_allclose(data.site("d435").xpos, ROBOT.d435.position, atol=1e-12)
    for leg, position in zip(ROBOT.legs, ROBOT.fan_position, strict=True):
        np.testing.assert_allclose(data.site(f"{leg}_fan").xpos, position, atol=1e-12)
    assert data.site("perch").xpos[2] == pytest.approx(-0.16)


def test_the_unit_with_a_fan_at_its_nose_has_the_inertia_of_its_parts():
    """Half of the payload is the box, half the fans, as points."""
    rotors = {name: dict(vars(rotor)) for name, rotor in ROBOT.fans.rotors.items()}
    rotors |= {"nose": {"x": 0.3, "y": 0.0, "spin": 1.0}}
    robot = load_robot(fans__rotors=rotors)
    half, place = robot.payload_mass / 2, robot.fan_position
    masses = np.array([half, *[half / len(place)] * len(place)])
    positions = np.vstack(([0.0, 0.0, robot.fans.z], place))
    center = masses @ positions / masses.sum()
    arms = positions - center
    expected = np.diag(box_inertia(half, robot.payload.size))
    for mass, arm in zip(masses, arms, strict=True):
        expected += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    found_center, found = composite_inertia(robot, "unit")
    np.testing.assert_allclose(found_center, center, atol=1e-9)
    np.testing.assert_allclose(found, expected, atol=1e-9)
