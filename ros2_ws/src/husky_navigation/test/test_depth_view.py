"""Cells of a depth image against projection by SciPy, variances against errors that are drawn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_camera import true_depth
from simulated_walk import OPTICAL_IN_BASE
from terrain_scenes import FLOOR, Box, Scene

from husky_navigation.cells import Lattice
from husky_navigation.depth_view import (
    DepthNoise,
    DepthView,
    PinholeCamera,
    PixelCounts,
    gather,
    no_seen_cells,
)
from husky_navigation.map_parameters import MapParameters

CAMERA = PinholeCamera(84.3, 108.2, 79.5, 59.5)
LATTICE = Lattice(0.04, 200, -100, -100)
POSITION = np.array([0.013, -0.021, 0.63])


def noise_of(parameters=None):
    p = parameters or MapParameters()
    return DepthNoise(*(getattr(p, name) for name in DepthNoise._fields))


def look(depth, rotation=OPTICAL_IN_BASE, capsules=None, parameters=None):
    """Return the cells seen, how many, and the fates of pixels; depth in m."""
    view = DepthView(np.rint(1000.0 * depth).astype(np.uint16), CAMERA, rotation, POSITION, 0.0)
    seen = no_seen_cells(200)
    found, fates = gather(
        view.depth,
        view.inverse_depth,
        view.pose,
        noise_of(parameters),
        LATTICE,
        np.zeros((0, 7)) if capsules is None else capsules,
        seen,
    )
    assert sorted(seen.touched[:found]) == np.flatnonzero(seen.points).tolist()
    assert fates.sum() == depth.size
    return seen, found, PixelCounts(*fates)


def ground_depth(u, v, rotation=OPTICAL_IN_BASE, height=POSITION[2]):
    """Return depth [m] of level ground along rays (u, v, 1)."""
    return height / -(rotation[2, 0] * u + rotation[2, 1] * v + rotation[2, 2])


def grid():
    return np.meshgrid((np.arange(160) - 79.5) / 84.3, (np.arange(120) - 59.5) / 108.2)


def points_of(depth, rotation):
    u, v = grid()
    turned = Rotation.from_matrix(rotation).apply(
        np.stack([u * depth, v * depth, depth], axis=-1).reshape(-1, 3)
    )
    return turned + POSITION


def test_points_are_added_up_where_they_are():
    tilt = Rotation.from_euler("xyz", [0.05, -0.03, 0.4]).as_matrix()
    rotation = tilt @ OPTICAL_IN_BASE
    depth = np.rint(1000.0 * ground_depth(*grid(), rotation)) / 1000.0
    depth = np.where((depth > 0.2) & (depth < 2.8), depth, 0.0)
    points = points_of(depth, rotation)[depth.ravel() > 0.0]
    index = np.floor(points[:, :2] / 0.04).astype(int) + 100
    seen, found, pixels = look(depth, rotation)
    counts = np.zeros((200, 200), dtype=int)
    np.add.at(counts, tuple(index.T), 1)
    heights = np.zeros((200, 200))
    np.add.at(heights, tuple(index.T), points[:, 2])
    # Without noise no pixel is taken for a flying one.
    np.testing.assert_array_equal(seen.points, counts)
    assert found == np.count_nonzero(counts)
    assert pixels.used == counts.sum()
    assert pixels.without_depth == np.count_nonzero(depth == 0.0)
    full = counts > 0
    np.testing.assert_allclose(seen.height[full], heights[full] / counts[full], atol=1e-9)


def test_variance_is_that_of_drawn_errors():
    """Heights of a pixel on level ground whose ray and depth are disturbed as the model says."""
    random = np.random.default_rng(3)
    for row in (30, 60, 110):
        u, v = 0.1, (row - 59.5) / 108.2
        d = ground_depth(u, v)
        jitter = 0.01576 * random.standard_normal((2, 200_000))
        axial = (0.000611 + 0.003587 * (d - 0.3515) ** 2) * random.standard_normal(200_000)
        measured = ground_depth(u + jitter[0], v + jitter[1]) + axial
        ray = OPTICAL_IN_BASE @ [u, v, 1.0]
        drawn = np.var(POSITION[2] + measured * ray[2])
        depth = np.zeros((120, 160))
        depth[row - 1 : row + 2, 86:90] = d
        seen, _, _ = look(depth)
        column = np.argmax(seen.points)
        alone = seen.variance.ravel()[column] * seen.points.ravel()[column]
        assert alone == pytest.approx(drawn, rel=0.1)  # of second order in the errors


def test_flying_pixels_are_left_out_and_edges_kept():
    u, v = grid()
    depth = ground_depth(u, v)
    far = np.where((depth > 0.0) & (depth < 3.2), depth, 0.0)
    depth = far.copy()
    depth[40:90, 60:100] = np.minimum(0.9, depth[40:90, 60:100])  # a board in front
    clean = look(depth)[2]
    assert clean.flying <= 4  # its corners
    flying = depth.copy()
    flying[39, 60:100:3] = 0.5 * (0.9 + far[39, 60:100:3])
    assert look(flying)[2].flying >= clean.flying + 13


@pytest.mark.parametrize(("behind_centre", "expected"), [(-0.01, 0.1), (0.01, 0.0)])
def test_a_cell_with_a_step_takes_the_ground_at_its_centre(behind_centre, expected):
    """The face of a step of 0.1 m stands before the centre of a cell, or behind it."""
    scene = Scene((FLOOR, Box((1.02 + behind_centre, -2.0, -0.1), (3.0, 2.0, 0.1))))
    depth = true_depth(scene, OPTICAL_IN_BASE, POSITION)
    seen, _, _ = look(np.where((depth > 0.0) & (depth < 3.2), depth, 0.0))
    lower, middle, upper = (seen.height[LATTICE.index_of(x, 0.02)] for x in (0.98, 1.02, 1.06))
    assert seen.edge[LATTICE.index_of(1.02, 0.02)]
    assert (lower, upper) == pytest.approx((0.0, 0.1), abs=1e-3)
    # The mean of all points lies in the middle of the face: each step of it is seen 2.4 times as
    # often as ground. Ground on one side shifts it, and its noise is taken for 1 cm.
    assert middle == pytest.approx(expected, abs=0.035)


def test_points_on_the_robot_are_left_out():
    u, v = grid()
    depth = ground_depth(u, v)
    depth = np.where((depth > 0.0) & (depth < 3.2), depth, 0.0)
    points = points_of(depth, OPTICAL_IN_BASE)[depth.ravel() > 0.0]
    start, end, radius = np.array([0.7, -0.2, 0.1]), np.array([1.1, 0.1, -0.05]), 0.12
    along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
    inside = np.linalg.norm(points - start - along[:, None] * (end - start), axis=1) < radius
    pixels = look(depth, capsules=np.array([[*start, *end, radius]]))[2]
    assert inside.sum() > 100
    assert abs(pixels.of_robot - inside.sum()) <= 2  # depth in mm
    assert pixels.used + pixels.of_robot == len(points)


def test_points_high_above_the_camera_are_no_ground():
    depth = np.full((120, 160), 1.0)
    upward = Rotation.from_euler("y", -1.5).as_matrix() @ OPTICAL_IN_BASE
    assert look(depth, upward)[2].used == 0


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"depth": np.zeros((3, 4))}, "depth is float64"),
        ({"depth": np.zeros(4, dtype=np.uint16)}, "depth is uint16"),
        ({"position": np.array([0.0, np.nan, 0.0])}, "position is"),
        ({"rotation": np.eye(2)}, "rotation is"),
        ({"rotation": 2.0 * np.eye(3)}, "no rotation"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "no rotation"),
        ({"camera": PinholeCamera(0.0, 1.0, 0.0, 0.0)}, "focal lengths"),
        ({"time": np.inf}, "time is inf"),
    ],
)
def test_a_bad_view_is_refused(changed, message):
    good = {
        "depth": np.zeros((4, 4), dtype=np.uint16),
        "camera": CAMERA,
        "rotation": np.eye(3),
        "position": np.zeros(3),
        "time": 0.0,
    }
    DepthView(**good)
    with pytest.raises(ValueError, match=message):
        DepthView(**{**good, **changed})


def test_views_of_all_kinds_of_arrays_share_one_kernel():
    """Read-only images, as they come from messages, are no reason to compile again."""
    depth = np.frombuffer(np.full((120, 160), 1500, np.uint16).tobytes(), np.uint16)
    view = DepthView(
        depth.reshape(120, 160), PinholeCamera(84, 108, 79, 59), OPTICAL_IN_BASE.T.T, POSITION, 0
    )
    assert view.depth.flags.writeable
    assert view.rotation.flags.c_contiguous
    assert all(isinstance(value, float) for value in view.camera)
