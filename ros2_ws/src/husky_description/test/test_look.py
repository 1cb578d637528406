"""What is seen: closed surfaces of the right size, at the right place."""

import mujoco
import numpy as np
import pytest

from husky_description.look import MATERIALS, base_look, hip_look, parallelogram
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot
from husky_description.shapes import ball, box, disc, ring, rotation_of, tube, without_rings
from husky_description.triangles import SECTORS, triangulate

ROBOT = load_robot()
PRISM = SECTORS / (2 * np.pi) * np.sin(2 * np.pi / SECTORS)
"""Area of the polygon that stands for a circle, over that of the circle."""


def update(model, data, scene):
    option, camera = mujoco.MjvOption(), mujoco.MjvCamera()
    mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)


def volume_and_center(shape):
    vertices, faces = triangulate([shape])
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    return volumes.sum(), (volumes[:, None] * (a + b + c) / 4).sum(axis=0) / volumes.sum()


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (box("red", (0.1, 0.2, 0.3), (0.1, 0.2, 0.4), (0.3, -0.4, 0.5)), 0.008),
        (disc("red", (0.1, 0.2, 0.3), 0.1, 0.5), np.pi * 0.005 * PRISM),
        (ring("red", (0.1, 0.2, 0.3), 0.1, 0.2, 0.5), np.pi * 0.015 * PRISM),
    ],
)
def test_surfaces_are_closed_and_face_outward(shape, volume):
    """By the divergence theorem, with the volume of the solid."""
    measured, center = volume_and_center(shape)
    assert measured == pytest.approx(volume, rel=1e-9)
    np.testing.assert_allclose(center, shape.position, atol=1e-9)


def test_sphere_is_nearly_one():
    measured, center = volume_and_center(ball("red", (0.1, 0.2, 0.3), 0.1))
    assert measured == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.03)
    np.testing.assert_allclose(center, (0.1, 0.2, 0.3), atol=1e-9)


def test_tube_runs_between_its_ends():
    start, end = np.array([0.1, 0.2, 0.3]), np.array([-0.4, 0.1, 0.7])
    shape = tube("red", start, end, 0.01)
    axis = rotation_of(shape.rpy) @ [0, 0, shape.size[1]]
    np.testing.assert_allclose(np.array(shape.position) + axis / 2, end, atol=1e-12)
    np.testing.assert_allclose(np.array(shape.position) - axis / 2, start, atol=1e-12)


def test_rings_become_boxes():
    shapes = without_rings(base_look(ROBOT))
    assert {shape.kind for shape in shapes} == {"box", "cylinder", "sphere"}


def test_materials_are_known():
    used = {shape.material for shape in (*base_look(ROBOT), *hip_look(ROBOT, 0))}
    assert used <= set(MATERIALS)


def test_skins_are_the_parallelogram():
    """The rendered vertices of thigh, calf, rod and ankle lie where the links are."""
    spec = build_spec(ROBOT)
    model = spec.compile()
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=200)
    rng = np.random.default_rng(8)
    skin = next(i for i in range(model.nskin) if model.skin(i).name == "legs_aluminium")
    first = model.skin_vertadr[skin]
    count = model.skin_vertnum[skin]
    bound = model.skin_vert[first : first + count]
    bones = range(model.skin_boneadr[skin], model.skin_boneadr[skin] + model.skin_bonenum[skin])
    frames = {frame.name: frame for frame in parallelogram(ROBOT)}
    order = [(leg, name) for leg in ROBOT.legs for name in ("thigh", "calf", "rod", "ankle")]
    turning = [bone for bone in bones if model.skin_bonevertnum[bone] and _starts(model, bone)]
    assert len(turning) == len(order)
    for _ in range(5):
        data.qpos[:3] = rng.uniform(-1, 1, 3)
        data.qpos[3:7] = rng.normal(size=4)
        data.qpos[7:] = rng.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        mujoco.mj_forward(model, data)
        update(model, data, scene)
        seen = np.reshape(scene.skinvert, (-1, 3))[first : first + count]
        for bone, (leg, name) in zip(turning, order, strict=True):
            frame = frames[name]
            thigh, shin = data.body(f"{leg}_thigh"), data.body(f"{leg}_shin")
            thigh_axis = thigh.xmat.reshape(3, 3) @ [0, 0, -1]
            shin_axis = shin.xmat.reshape(3, 3) @ [0, 0, -1]
            origin = thigh.xpos + frame.thigh * thigh_axis + frame.shin * shin_axis
            turn = (shin if frame.turns_with == "shin" else thigh).xmat.reshape(3, 3)
            start = model.skin_bonevertadr[bone]
            part = model.skin_bonevertid[start : start + model.skin_bonevertnum[bone]]
            # MuJoCo keeps the vertices of a skin as 32-bit floats.
            np.testing.assert_allclose(seen[part], bound[part] @ turn.T + origin, atol=2e-6)


def test_ankles_end_at_the_feet():
    """The drawn balls of the feet are centred where the robot touches the ground."""
    model = build_spec(ROBOT).compile()
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=200)
    rng = np.random.default_rng(9)
    skin = next(i for i in range(model.nskin) if model.skin(i).name == "legs_rubber")
    first, count = model.skin_vertadr[skin], model.skin_vertnum[skin]
    for _ in range(5):
        data.qpos[3:7] = rng.normal(size=4)
        data.qpos[7:] = rng.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        mujoco.mj_forward(model, data)
        update(model, data, scene)
        balls = np.reshape(scene.skinvert, (-1, 3))[first : first + count].reshape(4, -1, 3)
        for ball_vertices, name in zip(balls, ROBOT.foot_names, strict=True):
            radii = np.linalg.norm(ball_vertices - data.site(name).xpos, axis=1)
            np.testing.assert_allclose(radii, ROBOT.foot_radius, atol=2e-6)


def _starts(model, bone):
    """Whether the bone is the first of those that carry its vertices."""
    start = model.skin_bonevertadr[bone]
    others = range(bone)
    vertex = model.skin_bonevertid[start]
    return not any(
        vertex in model.skin_bonevertid[a : a + model.skin_bonevertnum[other]]
        for other in others
        for a in [model.skin_bonevertadr[other]]
    )
