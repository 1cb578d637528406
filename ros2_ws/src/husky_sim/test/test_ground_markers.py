"""The ground as viewers get it is the ground that the robot walks on."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rclpy")

from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker

from husky_description.plain_mujoco import mujoco
from husky_description.robot import load_robot
from husky_sim.nodes.ground_markers import ground_markers
from husky_sim.scene import WorldOptions, build_scene
from husky_sim.terrain import FLOOR, KINDS, TerrainOptions

SPOTS = np.random.default_rng(3).uniform((-1.0, -0.9), (6.0, 0.9), (60, 2))
SQUARE = 0.002
"""By how much squares stand out of a plane, which is more than a plane's thickness counts [m]."""


def boxes_of(markers):
    """Centres (n, 3), rotations (n, 3, 3) and half edges (n, 3) of all boxes [m]."""
    parts = []
    for marker in markers:
        p, q, size = marker.pose.position, marker.pose.orientation, marker.scale
        rotation = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_matrix()
        half = np.array((size.x, size.y, size.z)) / 2
        for at in marker.points or [Point()]:
            parts.append((rotation @ (at.x, at.y, at.z) + (p.x, p.y, p.z), rotation, half))
    return tuple(map(np.array, zip(*parts, strict=True)))


def height_of_boxes(boxes, x, y):
    """Height of the highest box at a place [m], by slabs, seen from 5 m above."""
    centre, rotation, half = boxes
    start = np.einsum("nij,ni->nj", rotation, (x, y, 5.0) - centre)
    way = -rotation[:, 2] + 1e-15  # a ray in a face is in the box
    ends = np.sort(np.stack(((-half - start) / way, (half - start) / way)), axis=0)
    enter, leave = ends[0].max(axis=1), ends[1].min(axis=1)
    return 5.0 - enter[enter <= leave].min()


def height_of_geoms(model, data, x, y):
    """The same of the model's ground, by MuJoCo's rays."""
    geom, normal = np.zeros(1, dtype=np.int32), np.zeros(3)
    groups, height = None, 5.0
    while True:
        start = np.array((x, y, height))
        distance = mujoco.mj_ray(
            model, data, start, np.array((0.0, 0.0, -1.0)), groups, 1, -1, geom, normal
        )
        assert distance >= 0.0
        height -= distance
        if model.geom(int(geom[0])).name.startswith(FLOOR):
            return height
        height -= 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_markers_are_where_the_ground_is(kind):
    options = WorldOptions(terrain=TerrainOptions(kind=kind, slope=0.3, height=0.05), seed=4)
    model = build_scene(load_robot(), options).compile()
    data = mujoco.MjData(model)
    data.qpos[2] += 50.0  # the robot is out of the way
    mujoco.mj_forward(model, data)
    markers = ground_markers(model)
    assert {marker.type for marker in markers} <= {Marker.CUBE, Marker.CUBE_LIST}
    assert [marker.id for marker in markers] == list(range(len(markers)))
    boxes = boxes_of(markers)
    for x, y in SPOTS:
        shown, true = height_of_boxes(boxes, x, y), height_of_geoms(model, data, x, y)
        assert true - 1e-6 <= shown <= true + 1.1 * SQUARE, (x, y)
