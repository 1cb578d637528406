"""The depth camera's view of the world: against MuJoCo's single rays, and scenes in closed form."""

import dataclasses
import functools
import math
import threading

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.parameters import frozen
from husky_description.robot import load_robot
from husky_sim.devices.d435.optics import D435Optics, DepthRays, WorldSnapshot, intrinsics_of
from husky_sim.scene import WorldOptions, build_scene
from husky_sim.terrain import TerrainOptions

FIGURES = load_robot().d435
PINHOLE = intrinsics_of(FIGURES)
TERRAINS = {
    "flat": TerrainOptions(),
    "tiles": TerrainOptions(kind="tiles", height=0.1, length=2.0),
    "steps": TerrainOptions(kind="steps", height=0.1, length=2.0),
    "gap": TerrainOptions(kind="gap", approach=0.8, size=0.5, height=0.2),
    "ramp": TerrainOptions(kind="ramp", slope=0.3, approach=0.5),
}


@functools.cache
def world(terrain, robot="carbon"):
    options = WorldOptions(terrain=TERRAINS[terrain], keyframe="stand")
    return build_scene(load_robot(robot), options).compile()


def standing(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    return data


def view(u, v):
    """Direction of pixels in the axes of camera_link, with 1 along the view (n, 3)."""
    right, down = (u - PINHOLE.cx) / PINHOLE.fx, (v - PINHOLE.cy) / PINHOLE.fy
    return np.stack((np.ones_like(right), -right, -down), axis=-1)


def lens_in_world(data, figures=FIGURES):
    """Place and axes of camera_link, from the figures, by SciPy."""
    base = Rotation.from_quat(np.roll(data.qpos[3:7], -1))
    place = data.qpos[:3] + base.apply(np.array(figures.position))
    return place, base * Rotation.from_euler("xyz", np.array(figures.rpy))


def random_pose(model, random):
    """Anywhere over the ground, with the legs anywhere."""
    data = standing(model)
    lower, upper = model.jnt_range[1:].T
    data.qpos[7:] = random.uniform(lower, upper)
    data.qpos[:2] += random.uniform((-0.5, -0.5), (1.5, 0.5))
    turn = Rotation.from_euler("ZYX", random.normal(0.0, (0.5, 0.2, 0.2)))
    data.qpos[3:7] = np.roll(turn.as_quat(), 1)
    return data


# Rays -------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("terrain", "robot"), [*((name, "carbon") for name in TERRAINS), ("flat", "beta")]
)
def test_each_ray_is_mujocos_own(terrain, robot):
    """Also where the legs are in view; up to the rounding of a direction at 1000 m."""
    model, figures = world(terrain, robot), load_robot(robot).d435
    rays = DepthRays(model, intrinsics_of(figures))
    random = np.random.default_rng(1)
    base, hit = model.body("base").id, np.zeros(1, np.int32)
    groups = np.array((1, 1, 0, 1, 1, 1), np.uint8)  # without the visual geoms
    bodies = set()
    for _ in range(4):
        data = random_pose(model, random)
        depth = rays.cast(WorldSnapshot.of(data))
        mujoco.mj_forward(model, data)
        place, axes = lens_in_world(data, figures)
        u, v = random.integers(PINHOLE.width, size=100), random.integers(PINHOLE.height, size=100)
        directions = view(u, v)
        lengths = np.linalg.norm(directions, axis=1)
        expected = []
        for ray in axes.apply(directions) / lengths[:, None]:
            far = mujoco.mj_ray(model, data, place, ray, groups, 1, base, hit)
            expected.append(far if far >= 0.0 else math.inf)
            bodies.add(model.body(model.geom_bodyid[hit[0]]).name if far >= 0.0 else "")
        np.testing.assert_allclose(depth[v, u], expected / lengths, rtol=1e-9, atol=1e-9)
    assert "base" not in bodies and {"world", ""} < bodies
    assert any(name.endswith(("thigh", "shin", "pod")) for name in bodies)


def test_flat_ground_in_closed_form():
    model = world("flat")
    depth = DepthRays(model, PINHOLE).cast(WorldSnapshot.of(standing(model)))
    place, axes = lens_in_world(standing(model))
    u, v = np.meshgrid(np.arange(PINHOLE.width), np.arange(PINHOLE.height))
    sinking = -axes.apply(view(u, v).reshape(-1, 3))[:, 2].reshape(depth.shape)
    assert np.all(sinking > 0.0), "carbon looks down"
    np.testing.assert_allclose(depth, place[2] / sinking, rtol=1e-9)


SHAPES = """
<mujoco>
  <worldbody>
    <body name="base" mocap="true"><site name="d435"/></body>
    <geom type="plane" size="0 0 1" pos="0 0 -4"/>
  </worldbody>
</mujoco>
"""
"""A lens over an endless plane."""
SIZES = {
    mujoco.mjtGeom.mjGEOM_PLANE: (1.0, 0.0, 1.0),
    mujoco.mjtGeom.mjGEOM_SPHERE: (1.0, 0.0, 0.0),
    mujoco.mjtGeom.mjGEOM_CAPSULE: (0.5, 1.0, 0.0),
    mujoco.mjtGeom.mjGEOM_CYLINDER: (0.5, 1.0, 0.0),
    mujoco.mjtGeom.mjGEOM_BOX: (1.0, 1.0, 1.0),
}
"""Shapes, and their sizes in a random number of metres; a plane's 0 is endless."""
LENS = """
<mujoco>
  <worldbody>
    <body name="base" mocap="true">
      <site name="d435"/>
      <geom type="box" size="0.1 0.1 0.1" pos="0.3 0 0"/>
    </body>
    <geom type="box" size="0.5 0.35 0.25" pos="2.5 0.05 -0.15"/>
    <geom type="box" size="0.1 9 9" pos="1 0 0" group="2" contype="0" conaffinity="0"/>
    <geom type="box" size="0.1 8 8" pos="6.1 0 0"/>
  </worldbody>
</mujoco>
"""
"""A lens that looks along x, with a block of base before it; a box from x = 2 m on, y from -0.3 to
0.4 and z from -0.4 to 0.1; a sheet that is only looked at; a wall at 6 m."""


def test_a_box_ahead_is_where_it_should_be():
    model = mujoco.MjModel.from_xml_string(LENS)
    depth = DepthRays(model, PINHOLE).cast(WorldSnapshot.of(mujoco.MjData(model)))
    # Faces at y = 0.4, -0.3 and z = 0.1, -0.4, at the depth of 2 m.
    left, right = (PINHOLE.cx - PINHOLE.fx * y / 2.0 for y in (0.4, -0.3))
    top, bottom = (PINHOLE.cy - PINHOLE.fy * z / 2.0 for z in (0.1, -0.4))
    assert 2.0 < left < right < PINHOLE.width - 2.0
    columns, rows = np.arange(PINHOLE.width), np.arange(PINHOLE.height)
    inside = np.outer((top <= rows) & (rows <= bottom), (left <= columns) & (columns <= right))
    np.testing.assert_allclose(depth, np.where(inside, 2.0, 6.0), rtol=1e-9)


def test_each_shape_is_met_as_mujoco_meets_it():
    """Turned at random; from the middle of one its far side is seen."""
    random = np.random.default_rng(2)
    spec = mujoco.MjSpec.from_string(SHAPES)
    for kind, sizes in SIZES.items():
        for _ in range(8):
            size = random.uniform(0.3, 1.2, 3) * sizes
            at, turn = random.normal(0.0, 2.0, 3), random.normal(size=4)
            spec.worldbody.add_geom(type=kind, size=size, pos=at, quat=turn)
    model = spec.compile()
    data = mujoco.MjData(model)
    base, hit = model.body("base").id, np.zeros(1, np.int32)
    kinds, inside = set(), 0
    for middle in range(model.ngeom):
        data.mocap_pos[0] = model.geom_pos[middle]
        data.mocap_quat[0] = random.normal(size=4)
        depth = DepthRays(model, PINHOLE).cast(WorldSnapshot.of(data))
        mujoco.mj_forward(model, data)
        axes = Rotation.from_quat(np.roll(data.mocap_quat[0], -1))
        u, v = random.integers(PINHOLE.width, size=100), random.integers(PINHOLE.height, size=100)
        for row, column, ray in zip(v, u, axes.apply(view(u, v)), strict=True):
            length = np.linalg.norm(ray)
            args = model, data, data.mocap_pos[0], ray / length, None, 1, base, hit
            far = mujoco.mj_ray(*args) / length if mujoco.mj_ray(*args) >= 0.0 else math.inf
            assert depth[row, column] == pytest.approx(far, rel=1e-9), hit
            if far < math.inf:
                kinds.add(int(model.geom_type[hit[0]]))
                inside += int(hit[0]) == middle
    assert kinds == {int(kind) for kind in SIZES} and inside > 500


def test_a_shape_that_rays_cannot_meet_is_refused():
    with_ellipsoid = LENS.replace(
        '<geom type="box" size="0.1 8 8" pos="6.1 0 0"/>',
        '<geom name="egg" type="ellipsoid" size="0.1 0.2 0.3" pos="6 0 0"/>',
    )
    model = mujoco.MjModel.from_xml_string(with_ellipsoid)
    with pytest.raises(ValueError, match="geom 'egg' has the shape ellipsoid"):
        DepthRays(model, PINHOLE)


def test_what_is_moved_by_hand_is_seen_where_it_is():
    model = mujoco.MjModel.from_xml_string(LENS)
    data = mujoco.MjData(model)
    data.mocap_pos[0] = (0.5, 6.0, 0.0)
    data.mocap_quat[0] = np.roll(Rotation.from_euler("z", 0.2).as_quat(), 1)
    depth = DepthRays(model, PINHOLE).cast(WorldSnapshot.of(data))
    u = np.arange(PINHOLE.width)
    ray = Rotation.from_euler("z", 0.2).apply(view(u, np.full(u.shape, 60)))
    seen = np.abs(6.0 + 5.5 * ray[:, 1] / ray[:, 0]) < 8.0
    assert depth[60, seen] == pytest.approx(5.5 / ray[seen, 0], abs=1e-9)


# Images -----------------------------------------------------------------------------------------
def test_an_image_depends_on_seed_number_and_scene_alone():
    model = world("flat")
    optics, other = D435Optics(model, FIGURES, 3), D435Optics(model, FIGURES, 4)
    here, there = (WorldSnapshot.of(random_pose(model, np.random.default_rng(k))) for k in (1, 2))
    image = optics.image(5, here)
    assert image.dtype == np.uint16 and image.shape == (PINHOLE.height, PINHOLE.width)
    optics.image(6, there)
    assert np.array_equal(optics.image(5, here), image), "whatever was looked at meanwhile"
    for different in (optics.image(6, here), optics.image(5, there), other.image(5, here)):
        assert not np.array_equal(different, image)
    other.restart(3)
    assert np.array_equal(other.image(5, here), image)


def test_the_world_goes_on_while_an_image_is_made():
    model = world("flat")
    optics, data = D435Optics(model, FIGURES), standing(model)
    snapshot = optics.snapshot(data)
    expected = optics.image(0, snapshot)
    images = []
    thread = threading.Thread(
        target=lambda: images.extend(optics.image(0, snapshot) for _ in range(3))
    )
    thread.start()
    while thread.is_alive():
        mujoco.mj_step(model, data)
        data.qpos[0] += 0.01
    thread.join()
    assert len(images) == 3 and all(np.array_equal(image, expected) for image in images)


def test_figures_give_the_image_its_size():
    small = dataclasses.replace(FIGURES, width=64, height=48, field_of_view=frozen([1.0, 0.5]))
    model = world("flat")
    optics = D435Optics(model, small)
    assert optics.image(0, WorldSnapshot.of(standing(model))).shape == (48, 64)
    pinhole = intrinsics_of(small)
    assert (64 - 1 - pinhole.cx + 0.5) / pinhole.fx == pytest.approx(math.tan(0.5))
    assert (48 - 1 - pinhole.cy + 0.5) / pinhole.fy == pytest.approx(math.tan(0.25))
