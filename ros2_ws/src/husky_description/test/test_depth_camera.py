"""The depth camera on the robot: its mass within the payload, its place, its view, its look."""

import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.kinematics import Kinematics
from husky_description.look import camera_look
from husky_description.mujoco_look import VISUAL_GROUP
from husky_description.mujoco_model import COLLISION_GROUP, build_spec
from husky_description.robot import ROBOTS, load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry
from husky_description.triangles import triangulate

GROUND_AHEAD = {"husky_carbon": 0.394, "husky_beta": 0.311}
"""Of camera_link to the ground that the bottom row sees, as the robots' files say [m]."""
T265_SIGHT = math.radians(163.0 / 2.0)
"""Half of the T265's field of view [maker]."""


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture(scope="module")
def model(robot):
    return build_spec(robot).compile()


@pytest.fixture
def data(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    return data


def case_in_base(robot):
    """Centre of the case (3,) and its axes (3, 3) in base, by SciPy."""
    axes = Rotation.from_euler("xyz", robot.d435.rpy).as_matrix()
    return robot.d435.position - axes @ robot.d435.depth_offset, axes


# Mass -------------------------------------------------------------------------------------------
def test_the_camera_weighs_within_the_payload(robot, model):
    center, axes = case_in_base(robot)
    body = model.body("camera")
    assert body.mass[0] == robot.d435.mass == 0.072
    assert body.mass[0] + model.body("payload").mass[0] == pytest.approx(robot.payload_mass)
    np.testing.assert_allclose(robot.camera_center, center, atol=1e-15)
    np.testing.assert_allclose(body.pos + axes @ body.ipos, center, atol=1e-12)
    x, y, z = robot.d435.size**2
    expected = 0.072 / 12.0 * np.array([y + z, x + z, x + y])
    np.testing.assert_allclose(np.sort(body.inertia), np.sort(expected), rtol=1e-9)


def carried(model):
    """Mass [kg] and centre of mass in base [m] (3,) of camera and payload of a model."""
    data = mujoco.MjData(model)
    data.qpos[:7] = 0, 0, 0, 1, 0, 0, 0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    names = [model.body(index).name for index in range(model.nbody)]
    parts = [names.index(name) for name in ("camera", "payload") if name in names]
    mass = model.body_mass[parts]
    return mass.sum(), mass @ data.xipos[parts] / mass.sum()


def with_payload(robot, mass):
    """The robot with another payload [kg]."""
    return load_robot(robot.name.removeprefix("husky_"), payload_mass=mass)


def test_camera_and_payload_have_the_centre_of_the_file(robot, model):
    mass, center = carried(model)
    assert mass == pytest.approx(robot.payload_mass, abs=1e-12)
    np.testing.assert_allclose(center, robot.payload.position, atol=1e-12)
    for payload in (0.25, 2.5):
        loaded = with_payload(robot, payload)
        np.testing.assert_allclose(loaded.payload_center, loaded.payload.position, atol=1e-12)


def test_a_payload_without_mass_and_one_that_is_the_camera(robot):
    """Where nothing is left of it, the rest has no mass, but finite numbers."""
    for payload in (0.0, 0.072):
        loaded = with_payload(robot, payload)
        assert loaded.camera_mass == pytest.approx(payload, abs=1e-12)
        assert 0.0 <= loaded.cargo_mass < 1e-12
        assert np.all(np.isfinite([loaded.cargo_center, loaded.payload_center]))


@pytest.mark.parametrize("payload", [0.03, 0.1])
def test_a_payload_that_cannot_balance_the_camera(robot, payload):
    """A lighter one is all camera; what is hardly heavier does not leave the robot."""
    loaded = with_payload(robot, payload)
    light = build_spec(loaded).compile()
    mass, center = carried(light)
    assert mass == pytest.approx(payload, abs=1e-12)
    assert light.body("camera").mass[0] == pytest.approx(min(payload, 0.072), abs=1e-12)
    if payload < 0.072:
        np.testing.assert_allclose(center, loaded.d435.center, atol=1e-12)
    else:
        reach = np.maximum(
            np.abs(loaded.torso.position) + loaded.torso.size / 2,
            np.abs(loaded.payload.position) + loaded.payload.size / 2,
        )
        assert np.all(np.abs(light.body("payload").pos) <= reach + 1e-12)
        assert loaded.payload.position[0] < center[0] < loaded.d435.center[0]
    # The kinematics and the rotors' geometry have the same centre of mass.
    data = mujoco.MjData(light)
    data.qpos[:7] = 0, 0, 0, 1, 0, 0, 0
    joints = loaded.stand_joint_position + 0.1
    data.qpos[7:] = joints
    mujoco.mj_forward(light, data)
    found = Kinematics(loaded).center_of_mass(joints)
    np.testing.assert_allclose(found, data.subtree_com[1], atol=1e-12)
    if loaded.legs_carry_propellers:
        place = data.site("front_left_propeller").xpos - data.subtree_com[1]
        np.testing.assert_allclose(rotor_geometry(loaded, joints).position[0], place, atol=1e-12)


# Place ------------------------------------------------------------------------------------------
def with_cases(robot):
    """Model with the cases of both cameras as boxes, and with the fans as cylinders."""
    spec, d435, t265 = build_spec(robot), robot.d435, robot.t265
    air = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": COLLISION_GROUP}
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    spec.body("camera").add_geom(
        name="case", type=box, size=d435.size / 2, pos=-d435.depth_offset, **air
    )
    base = spec.body("base")
    base.add_geom(name="t265", type=box, size=t265.size / 2, pos=t265.position, **air)
    if not robot.legs_carry_propellers:
        size = [robot.fans.outer_radius, robot.fans.height / 2, 0.0]
        for name, place in zip(robot.rotor_names, robot.fan_position, strict=True):
            base.add_geom(name=name, type=cylinder, size=size, pos=place, **air)
    return spec.compile()


def distances(model, data):
    """Distance of the case from every other geom that collides, up to 0.5 m, by name."""
    mujoco.mj_kinematics(model, data)
    case = model.geom("case").id
    return {
        model.geom(other).name: mujoco.mj_geomDistance(model, data, case, other, 0.5, None)
        for other in np.flatnonzero(model.geom_group == COLLISION_GROUP)
        if other != case
    }


def test_the_case_is_clear_of_everything(robot):
    """Of what is fixed always; of hips and legs as it stands, splayed and in flight."""
    model = with_cases(robot)
    data = mujoco.MjData(model)
    for splay in np.linspace(-robot.joints.hip_frontal_inward, robot.joints.hip_frontal_outward, 9):
        data.qpos[7:] = robot.stand_joint_position
        data.qpos[7::3] = splay * robot.side
        found = distances(model, data)
        assert min(found.values()) > 0.002, found
        assert min(found["front_left_hip"], found["front_right_hip"]) > 0.01
    if robot.legs_carry_propellers:
        data.qpos[7:] = flight_posture(robot)
        found = distances(model, data)
        assert min(value for name, value in found.items() if name.endswith("propeller")) > 0.15


def test_the_t265_does_not_see_the_case(robot):
    center, axes = case_in_base(robot)
    shares = np.stack(np.meshgrid([-0.5, 0.5], np.linspace(-0.5, 0.5, 19), [-0.5, 0.5]), -1)
    points = center + shares.reshape(-1, 3) * robot.d435.size @ axes.T
    for side in (-1.0, 1.0):
        lens = robot.t265.position + robot.t265.size * [0.5, 0.3 * side, 0.0]
        rays = points - lens
        assert np.all(np.arctan2(np.hypot(rays[:, 1], rays[:, 2]), rays[:, 0]) > T265_SIGHT)


# View -------------------------------------------------------------------------------------------
def corner_rays(robot):
    """Rays through the middle of the top and the bottom row, in base (2, 3)."""
    half = robot.d435.field_of_view[1] / 2.0
    turn = Rotation.from_euler("xyz", robot.d435.rpy)
    return turn.apply([[1.0, 0.0, math.tan(half)], [1.0, 0.0, -math.tan(half)]])


def test_it_sees_from_under_the_horizon_to_the_ground_ahead(robot, data):
    top, bottom = corner_rays(robot)
    assert math.degrees(math.atan2(top[2], top[0])) == pytest.approx(-1.0, abs=0.01)
    height = data.site("d435").xpos[2]
    ahead = -height * bottom[0] / bottom[2]
    assert ahead == pytest.approx(GROUND_AHEAD[robot.name], abs=1e-3)


def bodies_in_view(robot, model, data, turn=None):
    """Names of the bodies that rays from camera_link hit, whether they are seen or collide."""
    mujoco.mj_kinematics(model, data)
    site = data.site("d435")
    axes = site.xmat.reshape(3, 3) @ (np.eye(3) if turn is None else turn)
    across, down = np.tan(robot.d435.field_of_view / 2.0)
    y, z = np.meshgrid(np.linspace(-across, across, 41), np.linspace(-down, down, 31))
    rays = np.stack((np.ones_like(y), y, z), axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    geoms, far = np.empty(len(rays), np.int32), np.empty(len(rays))
    groups = np.zeros(6, np.uint8)
    groups[[VISUAL_GROUP, COLLISION_GROUP]] = 1
    own = model.body("camera").id
    world = (rays @ axes.T).ravel()
    mujoco.mj_multiRay(
        model, data, site.xpos, world, groups, 1, own, geoms, far, None, len(rays), 10.0
    )
    return {model.body(model.geom_bodyid[geom]).name for geom in geoms[geoms >= 0]}


def test_no_part_of_the_robot_is_in_view(robot, model, data):
    """Standing, sitting, about the stance, and splayed or in flight."""
    assert bodies_in_view(robot, model, data) == set()
    behind = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    assert "base" in bodies_in_view(robot, model, data, behind)  # it would be noticed
    rng = np.random.default_rng(1)
    postures = [robot.stand_joint_position + rng.uniform(-0.25, 0.25, 12) for _ in range(20)]
    splayed = np.array(robot.stand_joint_position)
    splayed[::3] = robot.joints.hip_frontal_outward * robot.side
    postures += [robot.sit_joint_position, splayed]
    if robot.legs_carry_propellers:
        postures.append(flight_posture(robot))
    for posture in postures:
        data.qpos[7:] = posture
        assert bodies_in_view(robot, model, data) == set(), posture


# Look -------------------------------------------------------------------------------------------
def test_it_looks_as_large_as_it_is_where_it_is(robot):
    vertices, _ = triangulate(camera_look(robot))
    half, middle = np.ptp(vertices, axis=0) / 2, (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    # Glass and lenses stand out by a millimetre or two; round ends are polygons.
    np.testing.assert_allclose(half, robot.d435.size / 2, atol=2e-3)
    np.testing.assert_allclose(middle, -robot.d435.depth_offset, atol=2e-3)
