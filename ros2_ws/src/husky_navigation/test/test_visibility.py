"""Cells that an image looks through, of which it expects points, and that it cannot judge."""

from types import SimpleNamespace

import numpy as np
import pytest
from simulated_camera import CX, CY, FX, FY, NONE, take_image
from simulated_walk import STEADY, poses
from terrain_scenes import FLOOR, Box, Scene

from husky_navigation.cells import Lattice, unseen_cells
from husky_navigation.depth_view import DepthView, PinholeCamera, no_seen_cells
from husky_navigation.map_parameters import MapParameters
from husky_navigation.visibility import VisibilityRules, look_through

LATTICE = Lattice(0.04, 200, -100, -100)
P = MapParameters()
RULES = VisibilityRules(*(getattr(P, name) for name in VisibilityRules._fields))
FLAT = Scene((FLOOR,))


def world(scene=FLAT, drop=0.0):
    """Return unseen cells, room for what was seen, and a view of a scene without errors."""
    random = np.random.default_rng(1)
    camera = poses(scene, STEADY, 0.0, random)[0].camera()
    depth = take_image(scene, camera.rotation, camera.position, NONE, random)
    depth[random.random(depth.shape) < drop] = 0
    view = DepthView(depth, PinholeCamera(FX, FY, CX, CY), camera.rotation, camera.position, 0.0)
    return SimpleNamespace(cells=unseen_cells(200), seen=no_seen_cells(200), view=view)


def place(at, x, y, height, variance=1e-4):
    """Put cells at a height into the map, from and to x and y [m]; return where."""
    i, j = LATTICE.index_of(x[0], y[0])
    k, m = LATTICE.index_of(x[1], y[1])
    where = slice(i, k + 1), slice(j, m + 1)
    at.cells.height[where], at.cells.variance[where] = height, variance
    return where


def look(at, images=1):
    return sum(look_through(at.cells, at.seen, LATTICE, at.view, RULES) for _ in range(images))


def ground(at):
    place(at, (0.2, 3.9), (-3.9, 3.9), 0.0)


def test_what_hangs_in_the_air_is_removed_after_some_images():
    at = world()
    ground(at)
    hanging = place(at, (1.4, 1.6), (-0.1, 0.1), 0.3)
    assert look(at, RULES.see_through_images - 1) == 0
    assert look(at) == at.cells.height[hanging].size
    assert np.isnan(at.cells.height[hanging]).all()
    assert np.count_nonzero(at.cells.height == 0.0) > 9000


@pytest.mark.parametrize("height", [0.0, 0.04, -0.1])
def test_ground_is_not_removed(height):
    """At its height, less high over it than the margin, or under it."""
    at = world()
    place(at, (0.2, 3.9), (-3.9, 3.9), height)
    assert look(at, 10) == 0


def test_uncertain_cells_are_given_more_room():
    at = world()
    ground(at)
    place(at, (1.4, 1.6), (-0.1, 0.1), 0.12, variance=0.05**2)
    assert look(at, 10) == 0


def test_cells_behind_an_obstacle_stay_and_expect_nothing():
    at = world(Scene((FLOOR, Box((1.0, -0.5, -0.1), (1.1, 0.5, 0.5)))))
    hidden = place(at, (1.4, 1.6), (-0.1, 0.1), 0.3)
    assert look(at, 10) == 0
    assert not at.cells.expected[hidden].any()


def test_an_image_that_looks_through_most_cells_removes_none():
    at = world()
    place(at, (0.7, 3.0), (-0.5, 0.5), 0.3)
    assert look(at, 10) == 0


def test_points_are_expected_as_the_image_has_them():
    """Of ground without errors; half of the pixels are lost, which all cells share."""
    for drop in (0.0, 0.5):
        at = world(drop=drop)
        ground(at)
        rows, columns = at.view.depth.shape
        v, u = np.mgrid[0:rows, 0:columns]
        d = 0.001 * at.view.depth
        points = np.stack([(u - CX) / FX * d, (v - CY) / FY * d, d], axis=-1)[(d > 0.2) & (d < 3.2)]
        points = points @ at.view.rotation.T + at.view.position
        index = np.floor(points[:, :2] / 0.04).astype(int) + 100
        np.add.at(at.seen.points, tuple(index.T), 1)
        look(at)
        for x in (0.9, 1.5, 2.2):
            i, j = LATTICE.index_of(x, 0.0)
            block = slice(i - 4, i + 5), slice(j - 4, j + 5)
            expected = at.cells.expected[block].sum()
            assert expected == pytest.approx(at.seen.points[block].sum(), rel=0.2)
