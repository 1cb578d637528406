"""Rays of the picture against the planes and boxes that are drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from console_bench import grid_map
from geometry_msgs.msg import Point, TransformStamped
from scipy.spatial.transform import Rotation
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_bringup.console.frame_tree import IDENTITY, Pose
from husky_bringup.console.ground_pick import first_hit, moved_ray
from husky_bringup.console.scene import Scene
from husky_bringup.console.server import PageServer
from husky_description.arrays import Array
from husky_description.rotation import about_z, to_roll_pitch_yaw
from husky_runtime import graph

SINGLE = 1e-5
"""Vertices of the scene are of single precision, of some metres [m]."""
DOWN = np.array((0.0, 0.0, -1.0))
MAP, ODOM, WORLD, BASE = graph.FRAME_MAP, graph.FRAME_ODOM, graph.FRAME_WORLD, graph.FRAME_BASE


# Rays ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(5))
def test_a_ray_hits_a_triangle_where_its_plane_is(seed: int) -> None:
    """A point within it by barycentric coordinates, in a frame that is turned."""
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(1, 3, 3))
    share = rng.dirichlet(np.ones(3))
    frame = (*rng.normal(size=3), *Rotation.random(random_state=seed).as_quat())
    turn = Rotation.from_quat(frame[3:])
    target = turn.apply(share @ triangles[0]) + frame[:3]
    origin = target + rng.normal(size=3)
    ray = np.array((origin, 0.5 * (target - origin)))
    assert first_hit(ray, triangles, frame) == pytest.approx(2.0, abs=1e-9)
    assert first_hit(np.array((origin, origin - target)), triangles, frame) == math.inf  # behind it
    edge = turn.apply(triangles[0, 1] - triangles[0, 0])
    assert first_hit(np.array((origin, edge)), triangles, frame) == math.inf  # along it


def test_of_several_triangles_the_first_counts_and_beside_them_none() -> None:
    floor = np.array([[(0.0, 0.0, z), (4.0, 0.0, z), (0.0, 4.0, z)] for z in (0.0, 1.0, -1.0)])
    assert first_hit(np.array(((1.0, 1.0, 3.0), DOWN)), floor, IDENTITY) == 2.0
    assert first_hit(np.array(((2.1, 2.1, 3.0), DOWN)), floor, IDENTITY) == math.inf
    assert first_hit(np.array(((1.0, 1.0, 3.0), DOWN)), floor[:0], IDENTITY) == math.inf


def test_a_ray_is_moved_as_its_points_are() -> None:
    pose, ray = (1.0, 2.0, 3.0, *about_z(0.7)), np.array(((1.0, 0.0, 2.0), (0.0, 0.6, -0.8)))
    moved, turn = moved_ray(ray, pose), Rotation.from_quat(pose[3:])
    np.testing.assert_allclose(moved[0], turn.apply(ray[0]) + pose[:3], atol=1e-12)
    np.testing.assert_allclose(moved[1], turn.apply(ray[1]), atol=1e-12)


# Pictures -----------------------------------------------------------------------------------------
def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Pose:
    return (x, y, z, *about_z(yaw))


ODOM_IN_MAP = pose(10.0, -5.0, 0.2, math.pi / 2)
BASE_IN_ODOM = pose(2.0, 1.0, 0.5)


def tell(scene: Scene, parent: str, child: str, where: Pose) -> None:
    told = TransformStamped(child_frame_id=child)
    told.header.frame_id = parent
    place, turn = told.transform.translation, told.transform.rotation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = where
    scene.take_transforms(TFMessage(transforms=[told]))


@pytest.fixture
def scene(server: PageServer) -> Scene:
    """A robot at (2, 1) in `odom`, which lies turned by a quarter in `map`; nothing is drawn."""
    server.scene.reset()
    server.gui.reset()
    scene = Scene(server)
    tell(scene, MAP, ODOM, ODOM_IN_MAP)
    tell(scene, ODOM, BASE, BASE_IN_ODOM)
    scene.draw(0.0)
    return scene


def picked(scene: Scene, x: float, y: float, slope: float = 0.0) -> Array:
    """Place [m] and heading that a ray hits which comes from 5 m above a place in the picture."""
    origin = np.array((x, y, 5.0)) - scene._centre
    x, y, z, *turn = scene.pick(origin, 3.0 * (DOWN + (slope, 0.0, 0.0)))
    return np.array((x, y, z, to_roll_pitch_yaw((turn[0], turn[1], turn[2], turn[3]))[2]))


def in_map(x: float, y: float, z: float) -> Array:
    """A place of `odom` in `map`."""
    return np.array((10.0 - y, -5.0 + x, 0.2 + z))


def test_on_nothing_a_click_is_on_the_plane_through_the_feet(scene: Scene) -> None:
    """The robot at (2, 1) looks from there to the place; a quarter of a turn more in `map`."""
    found = picked(scene, 3.0, 2.0)
    np.testing.assert_allclose(found, (*in_map(3.0, 2.0, -0.2), math.radians(135.0)), atol=1e-12)
    tell(scene, BASE, graph.FRAME_FOOTPRINT, pose(0.0, 0.0, -0.6))
    found = picked(scene, 3.0, 1.0, slope=0.1)
    np.testing.assert_allclose(found, (*in_map(3.51, 1.0, -0.1), math.radians(90.0)), atol=1e-12)


@pytest.mark.parametrize("fixed", [ODOM, MAP, WORLD, BASE])
def test_a_place_is_the_same_whichever_frame_stands_still(scene: Scene, fixed: str) -> None:
    """`odom` lies in the simulated `world` at (-1, 0); a point is at (3, 2) in `odom`."""
    tell(scene, WORLD, MAP, pose(-1.0, 0.0))
    scene._origin.options = (ODOM, MAP, WORLD, BASE)
    scene._origin.value = fixed
    scene.draw(0.0)
    x, y = {ODOM: (3.0, 2.0), MAP: (8.0, -2.0), WORLD: (7.0, -2.0), BASE: (1.0, 1.0)}[fixed]
    np.testing.assert_allclose(picked(scene, x, y)[:2], in_map(3.0, 2.0, 0.0)[:2], atol=1e-12)


def test_a_click_on_the_elevation_map_is_at_its_height(scene: Scene) -> None:
    """Its surface rises by 0.5 m a metre; beside it the plane counts, and while it is hidden."""
    scene.take_map(grid_map((20, 20), center=(3.0, 2.0), elevation=lambda x, y: 0.5 * (x - 3.0)))
    scene.draw(0.0)
    np.testing.assert_allclose(picked(scene, 3.5, 2.0)[:3], in_map(3.5, 2.0, 0.25), atol=SINGLE)
    assert picked(scene, 6.0, 2.0)[2] == 0.0
    scene._layers[graph.ELEVATION_MAP].value = False
    for _ in range(2):
        scene.draw(0.0)
    assert picked(scene, 3.5, 2.0)[2] == 0.0


def test_a_click_on_the_simulated_ground_is_on_its_top(scene: Scene) -> None:
    """A ramp that is turned, and two steps of one marker; in the frame `world`."""
    ramp, steps = Marker(type=Marker.CUBE, ns="ground"), Marker(type=Marker.CUBE_LIST, ns="ground")
    ramp.pose.orientation.y, ramp.pose.orientation.w = math.sin(0.1), math.cos(0.1)
    steps.id, steps.points = 1, [Point(x=5.0), Point(x=6.0, z=0.3)]
    for each, size in ((ramp, (4.0, 4.0, 0.1)), (steps, (1.0, 1.0, 0.2))):
        each.header.frame_id, each.color.a = WORLD, 1.0
        each.scale.x, each.scale.y, each.scale.z = size
    tell(scene, ODOM, WORLD, IDENTITY)
    scene.take_ground(MarkerArray(markers=[ramp, steps]))
    scene.draw(0.0)
    top = 0.05 / math.cos(0.2) - math.tan(0.2)
    np.testing.assert_allclose(picked(scene, 1.0, 0.5)[:3], in_map(1.0, 0.5, top), atol=SINGLE)
    for x, height in ((5.1, 0.1), (6.1, 0.4)):
        np.testing.assert_allclose(picked(scene, x, 0.2)[:3], in_map(x, 0.2, height), atol=SINGLE)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_a_ray_into_the_sky_hits_no_ground(scene: Scene, direction: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="there is no ground"):
        scene.pick(np.array((0.0, 0.0, 5.0)), np.array(direction))


def test_a_place_that_is_too_far_away_is_refused(scene: Scene) -> None:
    with pytest.raises(ValueError, match="more than 1000 m"):
        picked(scene, 2.0, 1.0, slope=300.0)


def test_a_robot_without_a_map_frame_is_sent_nowhere(server: PageServer) -> None:
    server.gui.reset()
    scene = Scene(server)
    tell(scene, ODOM, BASE, BASE_IN_ODOM)
    scene.draw(0.0)
    with pytest.raises(ValueError, match="no transform from odom to map"):
        picked(scene, 1.0, 1.0)
    tell(scene, MAP, ODOM, ODOM_IN_MAP)
    scene._tree._told.pop(BASE)
    scene._tree._forget_ways()
    with pytest.raises(ValueError, match="no transform from base_link to map"):
        picked(scene, 1.0, 1.0)
