"""The map of all ground that was seen: rolling maps of it are put together in `map`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from husky_navigation.cells import Lattice
from husky_navigation.frame_filter import LevelTransform
from husky_navigation.planning.world_map import MapHeights, WorldMap, shape_of

ROLLING = Lattice(0.04, 100, -50, -50)
HERE = LevelTransform()


def heights_of(
    elevation: np.ndarray, x: int = ROLLING.x, top: np.ndarray | None = None, age: float = 0.0
) -> MapHeights:
    """Return a rolling map of an age [s], its lowest corner x cells from its frame's origin."""
    top = elevation if top is None else np.fmax(elevation, top)
    return MapHeights(elevation, top, np.full(elevation.shape, age), ROLLING._replace(x=x))


def cells_seen(world: WorldMap) -> int:
    """Return the number of cells that have a height."""
    return int(np.isfinite(world.elevation).sum())


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
    world.merge(heights_of(heights(ROLLING, frame, (0.2, -0.1))), frame)
    assert cells_seen(world) == pytest.approx((4.0 / 0.05) ** 2, rel=0.03)
    x, y = np.meshgrid(*world.lattice.cell_centers(), indexing="ij")
    seen = ~np.isnan(world.elevation)
    error = (world.elevation - (0.2 * x - 0.1 * y))[seen]
    assert np.abs(error).max() < 0.3 * ROLLING.resolution
    shape = shape_of(world.elevation, world.lattice.resolution)
    np.testing.assert_allclose(np.nanmean(shape.slope_x), 0.2, atol=0.005)
    np.testing.assert_allclose(np.nanmean(shape.slope_y), -0.1, atol=0.005)


def test_ground_that_the_rolling_map_has_left_behind_is_kept() -> None:
    world = WorldMap()
    world.merge(heights_of(np.full((100, 100), 0.1)), HERE)
    world.merge(heights_of(np.full((100, 100), 0.2), x=0), HERE)
    x = world.lattice.cell_centers()[0]
    row = world.elevation[:, 200]
    np.testing.assert_array_equal(row[(x > -2.0) & (x < 0.0)], 0.1)
    np.testing.assert_array_equal(row[(x > 0.0) & (x < 4.0)], 0.2)


def test_it_keeps_the_highest_surface_of_each_cell_too() -> None:
    world, ground, top = WorldMap(), np.zeros((100, 100)), np.full((100, 100), np.nan)
    top[50:60] = 0.8
    world.merge(heights_of(ground, top=top), HERE._replace(z=0.1))
    x = world.lattice.cell_centers()[0]
    wall = (x > 0.05) & (x < 0.35)
    np.testing.assert_allclose(world.highest[wall, 200], 0.9)
    np.testing.assert_allclose(world.elevation[wall, 200], 0.1)
    np.testing.assert_allclose(world.highest[(x > 0.5) & (x < 1.9), 200], 0.1)
    world.merge(heights_of(ground), HERE)
    np.testing.assert_array_equal(world.highest[wall, 200], 0.0)
    world.merge(heights_of(ground, top=top), HERE)
    world.clear()
    assert np.isnan(world.highest).all()


def test_unseen_cells_of_a_rolling_map_take_nothing_away() -> None:
    world = WorldMap()
    world.merge(heights_of(np.full((100, 100), 0.1)), HERE)
    count = cells_seen(world)
    world.merge(heights_of(np.full((100, 100), np.nan)), HERE)
    assert np.nanmin(world.elevation) == 0.1
    assert cells_seen(world) == count


def test_cells_that_were_not_measured_since_stay_where_they_were() -> None:
    """The frame drifts by less than a jump; all cells are taken over after one."""
    world = WorldMap()
    world.merge(heights_of(np.full((100, 100), 0.1)), HERE)
    newer = heights_of(np.full((100, 100), 0.1), age=0.5)
    newer.age[:50] = 3.0
    x = world.lattice.cell_centers()[0]
    before, ahead = (x > -1.9) & (x < -0.1), (x > 0.1) & (x < 1.9)
    world.merge(newer, HERE._replace(z=0.06), oldest=1.0)
    np.testing.assert_array_equal(world.elevation[before, 200], 0.1)
    np.testing.assert_allclose(world.elevation[ahead, 200], 0.16)
    world.merge(newer, HERE._replace(z=0.12), oldest=1.0)
    np.testing.assert_array_equal(world.elevation[before, 200], 0.1)
    world.merge(newer, HERE._replace(z=0.32), oldest=1.0)
    np.testing.assert_allclose(world.elevation[before | ahead, 200], 0.42)


def test_the_first_map_is_taken_over_as_a_whole() -> None:
    world = WorldMap()
    for _ in range(2):
        world.merge(heights_of(np.full((100, 100), 0.1), age=5.0), HERE, oldest=1.0)
        assert cells_seen(world) > 0
        world.clear()


def test_a_rolling_map_beyond_the_border_is_cut_off() -> None:
    world = WorldMap()
    world.merge(heights_of(np.zeros((100, 100))), HERE._replace(x=90.0))
    assert cells_seen(world) == 0
    world.merge(heights_of(np.zeros((100, 100))), HERE._replace(x=9.0))
    assert 0 < cells_seen(world) < 80 * 80


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
        WorldMap().merge(heights_of(np.zeros((100, 100))), HERE._replace(z=math.inf))
