"""The map of all ground that was seen: rolling maps of it are put together in `map`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from husky_navigation.cells import Lattice
from husky_navigation.frame_filter import LevelTransform
from husky_navigation.planning.world_map import WorldMap, shape_of

ROLLING = Lattice(0.04, 100, -50, -50)
HERE = LevelTransform()


def heights(lattice: Lattice, frame: LevelTransform, gradient: tuple[float, float]) -> np.ndarray:
    """Return what a rolling map in a frame holds of a plane in `map` through its origin."""
    x, y = np.meshgrid(*lattice.cell_centers(), indexing="ij")
    c, s = math.cos(frame.yaw), math.sin(frame.yaw)
    in_map = frame.x + c * x - s * y, frame.y + s * x + c * y
    return gradient[0] * in_map[0] + gradient[1] * in_map[1] - frame.z


@pytest.mark.parametrize(
    "frame", [HERE, LevelTransform(1.0, -2.0, 0.3, 0.7), LevelTransform(-3.0, 0.5, -0.1, -2.5)]
)
def test_a_rolling_map_of_any_frame_lies_where_it_belongs(frame: LevelTransform) -> None:
    world = WorldMap()
    count = world.merge(heights(ROLLING, frame, (0.2, -0.1)), ROLLING, frame)
    assert count == pytest.approx((4.0 / 0.05) ** 2, rel=0.03)
    x, y = np.meshgrid(*world.lattice.cell_centers(), indexing="ij")
    seen = ~np.isnan(world.elevation)
    error = (world.elevation - (0.2 * x - 0.1 * y))[seen]
    assert np.abs(error).max() < 0.3 * ROLLING.resolution
    shape = shape_of(world.elevation, world.lattice.resolution)
    np.testing.assert_allclose(np.nanmean(shape.slope_x), 0.2, atol=0.005)
    np.testing.assert_allclose(np.nanmean(shape.slope_y), -0.1, atol=0.005)


def test_ground_that_the_rolling_map_has_left_behind_is_kept() -> None:
    world = WorldMap()
    world.merge(np.full((100, 100), 0.1), ROLLING, HERE)
    world.merge(np.full((100, 100), 0.2), ROLLING._replace(x=0), HERE)
    x = world.lattice.cell_centers()[0]
    row = world.elevation[:, 200]
    np.testing.assert_array_equal(row[(x > -2.0) & (x < 0.0)], 0.1)
    np.testing.assert_array_equal(row[(x > 0.0) & (x < 4.0)], 0.2)


def test_it_keeps_the_highest_surface_of_each_cell_too() -> None:
    world, ground, top = WorldMap(), np.zeros((100, 100)), np.full((100, 100), np.nan)
    top[50:60] = 0.8
    world.merge(ground, ROLLING, HERE._replace(z=0.1), top)
    x = world.lattice.cell_centers()[0]
    wall = (x > 0.05) & (x < 0.35)
    np.testing.assert_allclose(world.highest[wall, 200], 0.9)
    np.testing.assert_allclose(world.elevation[wall, 200], 0.1)
    np.testing.assert_allclose(world.highest[(x > 0.5) & (x < 1.9), 200], 0.1)
    world.merge(ground, ROLLING, HERE)
    np.testing.assert_array_equal(world.highest[wall, 200], 0.0)
    world.merge(ground, ROLLING, HERE, top)
    world.clear()
    assert np.isnan(world.highest).all()


def test_unseen_cells_of_a_rolling_map_take_nothing_away() -> None:
    world = WorldMap()
    world.merge(np.full((100, 100), 0.1), ROLLING, HERE)
    assert world.merge(np.full((100, 100), np.nan), ROLLING, HERE) == 0
    assert np.nanmin(world.elevation) == 0.1


def test_a_rolling_map_beyond_the_border_is_cut_off() -> None:
    world = WorldMap()
    assert world.merge(np.zeros((100, 100)), ROLLING, HERE._replace(x=9.0)) < 80 * 80
    assert world.merge(np.zeros((100, 100)), ROLLING, HERE._replace(x=90.0)) == 0


def test_a_wall_is_rough_and_a_slope_is_not() -> None:
    world = WorldMap()
    x, _ = np.meshgrid(*world.lattice.cell_centers(), indexing="ij")
    assert np.nanmax(shape_of(np.where(x > 0.0, 0.5, 0.0), 0.05).roughness) > 0.05
    assert np.nanmax(shape_of(x, 0.05).roughness) < 1e-6


def test_a_gap_leads_from_one_side_to_the_other_and_open_ground_goes_on_level() -> None:
    world = WorldMap()
    x, _ = np.meshgrid(*world.lattice.cell_centers(), indexing="ij")
    world.elevation[:] = np.where(x < 0.0, 0.0, np.where(x < 1.0, np.nan, -1.0))
    row = world.filled()[:, 200]
    slope = np.diff(row[200:220]) / 0.05
    np.testing.assert_allclose(slope, -1.0, atol=0.1)
    world.elevation[:] = np.where(x < 0.0, 0.2, np.nan)
    row = world.filled()[:, 200]
    np.testing.assert_allclose(row[:215], 0.2)
    assert np.isnan(row[216:]).all()
    world.clear()
    assert np.isnan(world.filled()).all()


@pytest.mark.parametrize("cells", [0, 3, 202])
def test_a_size_that_cannot_be_halved_twice_is_refused(cells: int) -> None:
    with pytest.raises(ValueError, match=f"cells is {cells}, it must be a positive multiple of 4"):
        WorldMap(cells=cells)


def test_a_frame_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="it must be finite"):
        WorldMap().merge(np.zeros((100, 100)), ROLLING, HERE._replace(z=math.inf))
